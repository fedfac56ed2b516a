"""The summary of results."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.model.parameters import KINDS, index_unknowns
from mor.project.entities import said_thing, thing_of
from mor.project.network import Network
from mor.quality.reliability_map import uncontrolled_count
from mor.quality.singularity import weakness
from mor.quality.solution import Solved
from mor.report.estimates import undeterminable_rows
from mor.report.identity import schema_of
from mor.report.language import ENGLISH, Words, datum_name
from mor.report.observations import SCHEMA as OBSERVATIONS_SCHEMA
from mor.report.observations import assessed_pieces, table_of
from mor.report.units import angle_unit, angle_unit_of, number_or_none, picked, unit_of
from mor.units import ANGLE_UNITS

# ---- The summary of an adjustment as plain data: the head of ``results.json`` and of every report.

SCHEMA = "mor-results"
SCHEMA_VERSION = 2


def summary(solved: Solved) -> dict[str, Any]:
    """Outcome, counts, σ0, global test, datum, conventions."""
    project, adjustment = solved.network.project, solved.adjustment
    # Movements that no observation notices to first order.
    by_curvature = ["movement that the curvature of vTPv determines"] * adjustment.defect.to_second_order
    movements = [*adjustment.defect.movements, *by_curvature]
    return {
        **schema_of(SCHEMA, SCHEMA_VERSION),
        "title": project.title,
        "units": {"length": project.units.length, "angle": angle_unit_of(project)},
        "axes": project.axes.model_dump(),
        "outcome": adjustment.outcome.value,
        "reason": adjustment.reason,
        "solution": solved.quality is not None,
        "iterations": len(adjustment.iterations),
        "kernels": "numba" if adjustment.kernels else "numpy",
        "observations": adjustment.problem.observations,
        "unknowns": adjustment.problem.index.count,
        "defect": len(movements),
        "movements": movements,
        "undetermined": [
            {
                "unknowns": [f"{said_thing(*unknown[:2])} {unknown[2]}" for unknown in direction.unknowns],
                "amounts": list(direction.amounts),
            }
            for direction in adjustment.defect.undetermined
        ],
        "undeterminable": undeterminable_rows(solved),
        "datum": adjustment.problem.datum.name,
        **statistics(solved),
        "iteration_log": [
            picked(step, "number", "objective", "largest_change", "damping") for step in adjustment.iterations
        ],
    }


def statistics(solved: Solved) -> dict[str, Any]:
    """Redundancy, σ0, global test and what the tests of single observations count."""
    quality = solved.quality
    if quality is None:
        return dict.fromkeys(("redundancy", "redundancy_sum", "sigma0", "global_test", "flagged"))
    apriori = solved.network.project.settings.sigma0
    aposteriori = apriori * quality.sigma0
    return {
        "redundancy": quality.redundancy,
        "redundancy_sum": quality.redundancy_sum,
        "sigma0": {
            "apriori": apriori,
            "aposteriori": aposteriori if quality.redundancy > 0 else None,
            "ratio": quality.sigma0**2 if quality.redundancy > 0 else None,
            "ratio_of_sigmas": quality.sigma0 if quality.redundancy > 0 else None,
            "used_for_sigma": apriori * quality.sigma_factor,
        },
        "global_test": picked(quality.global_test, "statistic", "lower", "upper", "level", "accepted"),
        "hardly_determined": weakness(solved),
        "critical_w": quality.critical,
        "snooping_level": quality.levels.snooping,
        "flagged": int(sum(np.count_nonzero(flags) for flags in quality.flagged)),
        "uncontrolled": uncontrolled_count(quality),
    }


# ---- Report of a failed adjustment: unknowns that do not settle, and the worst residuals.


def failure(solved: Solved) -> dict[str, Any] | None:
    """Return the unknowns that do not settle and the worst residuals of a failed adjustment."""
    if solved.quality is not None:
        return None
    return {
        "notice": "NOT A SOLUTION: all values are those of the last iteration",
        "moving": moving_rows(solved),
        "worst": worst_misfits(solved, 100).to_dicts(),
    }


def moving_rows(solved: Solved) -> list[dict[str, Any]]:
    """Unknowns that do not come to rest: their last steps in project units, and whether they go to and fro."""
    found = solved.movements
    if found is None:
        return []
    rows = []
    for (kind, block, component), steps, back in zip(found.unknowns, found.steps, found.to_and_fro, strict=True):
        quantity = KINDS[kind].components[KINDS[kind].names.index(component)].quantity
        factor = ANGLE_UNITS[angle_unit(solved)] if quantity.angle == 1 else 1.0
        space, name = thing_of(kind, block)
        rows.append(
            {
                "kind": kind,
                "of": space,
                "id": name,
                "component": component,
                "unit": unit_of(solved, quantity),
                "steps": [number_or_none(step / factor) for step in steps],
                # Part of the way that was taken back from which on an unknown moves to and fro.
                "way": ("wanted" if len(steps) == 1 else "to and fro" if float(back) > 0.5 else "away"),
            }
        )
    return rows


def worst_misfits(solved: Solved, count: int) -> pl.DataFrame:
    """The observations with the largest |v|/σ at the last values, the worst first, with it as ``misfit``."""
    parts, largest = [], np.zeros(0)
    for rows in assessed_pieces(solved):
        size = np.where(rows.group.left_out, 0.0, np.abs(rows.one.v) / rows.group.sigma)
        size = np.nan_to_num(size, nan=0.0, posinf=np.inf)
        largest = np.sort(np.concatenate([largest, size.max(axis=1)]))[-count:]
        if (size.max(axis=1) >= largest[0]).any():
            parts.append(table_of(rows))
    if not parts:
        return pl.DataFrame(schema={**OBSERVATIONS_SCHEMA, "misfit": pl.Float64})
    table = pl.concat(parts).with_columns((pl.col("v") / pl.col("sigma")).abs().alias("misfit"))
    return table.filter(pl.col("flag") != "excluded").sort("misfit", descending=True, nulls_last=True).head(count)


# ---- Content of a project before it is adjusted.


def contents(network: Network, words: Words = ENGLISH) -> str:
    """Counts of things, observations and unknowns; what has no start value."""
    lines = [network.project.title] if network.project.title else []
    things = {
        "camera": "{count:camera|cameras}",
        "image": "{count:image|images}",
        "point": "{count:point|points}",
        "station": "{count:station|stations}",
        "system": "{count:system|systems}",
        "pair": "{count:pair|pairs}",
        "instrument": "{count:instrument|instruments}",
    }
    counts = {name: len(network.things[name].ids) for name in things}
    lines += [_row(words(things[name], count=count)) for name, count in counts.items() if count]
    lines.append(words("observations"))
    for group in network.groups:
        lines.append(f"{int(np.count_nonzero(group.mask)):8d} {group.type.name} ({group.name})")
    observations = sum(int(np.count_nonzero(group.mask)) for group in network.groups)
    total = _row(words("{count:observation|observations}", count=observations))
    unknowns = words("{count:unknown|unknowns}", count=index_unknowns(network.blocks).count)
    lines.append(f"{total}, {unknowns}, {words('datum')}: {datum_name(network.datum.name, words)}")
    missing = sum(
        int(np.count_nonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
        for values in network.start.values()
    )
    if missing:
        lines.append(_row(words("{count:block|blocks} without start values", count=missing)))
    return "\n".join(lines)


def _row(said: str) -> str:
    number, _, words = said.partition(" ")
    return f"{number:>8s} {words}"
