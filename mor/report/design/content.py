"""A plan as plain data, and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.quality.design.requirements import Judged, RequiredControl, RequiredPrecision
from mor.quality.plausibility.images import count_outside_the_format
from mor.quality.reliability.reliability_map import detectable
from mor.quality.solved import Solved
from mor.report.edge import said
from mor.report.identity import Identity, identity_of
from mor.report.results.summary import summary
from mor.report.tables.estimates import image_table, point_table, station_table
from mor.report.tables.observations import observation_table
from mor.report.verdict.reliability_map import reliability_rows

SCHEMA = "mor-design"
SCHEMA_VERSION = 1
OBSERVATIONS = (
    *("type", "group", "at", "from", "to", "component", "unit", "planned", "sigma", "sigma_adjusted"),
    *("r", "nabla", "external"),
)
"""Columns of the table of planned observations."""
_OF_MEASUREMENT = (
    *("iterations", "iteration_log", "kernels", "global_test", "flagged", "sigma0", "critical_w", "schema"),
)


def design_data(solved: Solved, judged: Sequence[Judged], of: Identity) -> dict[str, Any]:
    """Return the expected precision of a plan; nothing in it depends on measured values."""
    about = {key: value for key, value in summary(solved).items() if key not in _OF_MEASUREMENT}
    about["schema_version"] = SCHEMA_VERSION
    data: dict[str, Any] = {"schema": SCHEMA, **about, "plan": True}
    data["require"] = [requirement_row(one, solved) for one in judged]
    data["fulfilled"] = solved.quality is not None and all(one.met for one in judged)
    data["outside_format"] = count_outside_the_format(solved.network)
    data["identity"] = identity_of(solved.network.project, of)
    if solved.quality is None:
        return data
    data["groups"] = group_rows(solved)
    data["reliability"] = reliability_rows(solved)
    data["points"] = point_table(solved).to_dicts()
    data["images"] = image_table(solved).drop("rms").to_dicts()
    data["stations"] = station_table(solved).to_dicts()
    return data


def requirement_row(judged: Judged, solved: Solved) -> dict[str, Any]:
    """A requirement with its verdict, in the units of the project."""
    wanted = judged.requirement
    row = {
        "of": wanted.of,
        "pattern": list(wanted.pattern),
        "limit": wanted.limit,
        "worst": float(judged.worst) if np.isfinite(judged.worst) else None,
        "where": _where(judged, solved),
        "count": judged.count,
        "failing": judged.failing,
        "met": judged.met,
    }
    unit = solved.network.project.units.length if isinstance(wanted, RequiredPrecision) else "1"
    return {"what": "sigma" if isinstance(wanted, RequiredPrecision) else "reliability", **row, "unit": unit}


def _where(judged: Judged, solved: Solved) -> str:
    wanted = judged.requirement
    if isinstance(wanted, RequiredControl):
        number, row, component = judged.where
        if number < 0:
            return ""
        group = solved.adjustment.problem.groups[number]
        names = ", ".join(
            f"{reference.name} {names[row]}"
            for reference, names in zip(group.type.references, group.references, strict=True)
        )
        return f"{group.type.name} {names} {group.type.components[component].name}"
    return wanted.names[judged.where[0]]


def group_rows(solved: Solved) -> list[dict[str, Any]]:
    """Each group with its number of observations, Σ r, smallest r and ∇, largest δ̄0."""
    quality = solved.quality
    assert quality is not None
    rows = []
    for number, (group, one, tests) in enumerate(
        zip(solved.adjustment.problem.groups, quality.groups, quality.reliability, strict=True)
    ):
        r = one.r
        known = np.isfinite(r)
        if not known.any():
            continue
        at = np.unravel_index(int(np.nanargmin(r)), r.shape)
        external = np.where(known & ~np.isfinite(tests.external), np.inf, tests.external)
        largest = float(np.nanmax(external))
        nabla = detectable(quality, np.array([[number, *at]]))[0]
        out = said(group)
        component = int(np.flatnonzero(out.source == at[1])[0])
        found = float(nabla / out.external.factors[component])
        rows.append(
            {
                "name": group.name,
                "type": group.type.name,
                "observations": int(np.count_nonzero(known)),
                "redundancy": float(np.nansum(r)),
                "smallest_r": float(r[at]),
                "nabla": found if np.isfinite(found) else None,
                "unit": out.external.units[component],
                "largest_external": largest if np.isfinite(largest) else None,
            }
        )
    return rows


def planned_table(solved: Solved) -> pl.DataFrame:
    """All planned observations: the value to be expected, σ, σ adjusted, r, ∇, δ̄0."""
    frame = observation_table(solved).rename({"observed": "planned"})
    return frame.select(OBSERVATIONS)
