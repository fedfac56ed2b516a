"""Report of a failed adjustment: unknowns that do not settle, and the worst residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.parameters.kinds import KINDS
from mor.project.network.entities import thing_of
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.tables.assessed_observations import AssessedGroups
from mor.report.tables.observations import SCHEMA, table_of
from mor.units import ANGLE_UNITS

OSCILLATES = 0.5
"""Part of the way that was taken back from which on an unknown moves to and fro."""


WORST_MISFITS = 100
"""Observations that are told where there is no solution."""


def failure(solved: Solved) -> dict[str, Any] | None:
    """Return the unknowns that do not settle and the worst residuals of a failed adjustment."""
    if solved.quality is not None:
        return None
    worst = worst_misfits(solved, WORST_MISFITS).to_dicts()
    return {
        "notice": "NOT A SOLUTION: all values are those of the last iteration",
        "moving": moving_rows(solved),
        "worst": worst,
    }


def moving_rows(solved: Solved) -> list[dict[str, Any]]:
    """Unknowns that do not come to rest: their last steps in project units, and whether they go to and fro."""
    found = solved.movements
    if found is None:
        return []
    rows = []
    for (kind, block, component), steps, back in zip(
        found.unknowns, found.steps, found.to_and_fro, strict=True
    ):
        quantity = KINDS[kind].components[KINDS[kind].names.index(component)].quantity
        angle = angle_unit(solved)
        factor = ANGLE_UNITS[angle] if quantity.angle == 1 else 1.0
        space, name = thing_of(kind, block)
        rows.append(
            {
                "kind": kind,
                "of": space,
                "id": name,
                "component": component,
                "unit": quantity.unit(solved.network.project.units.length, angle, _image_unit(solved)),
                "steps": [_number(step / factor) for step in steps],
                "way": _way(len(steps), float(back)),
            }
        )
    return rows


def _way(steps: int, back: float) -> str:
    return "wanted" if steps == 1 else "to and fro" if back > OSCILLATES else "away"


def _image_unit(solved: Solved) -> str:
    return next((scale.unit for scale in solved.network.scales.values()), "mm")


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def worst_misfits(solved: Solved, count: int) -> pl.DataFrame:
    """The observations with the largest |v|/σ at the last values, the worst first, with it as ``misfit``."""
    tested, parts = AssessedGroups(solved), []
    largest = np.zeros(0)
    for rows in tested.pieces():
        size = np.where(rows.group.left_out, 0.0, np.abs(rows.one.v) / rows.group.sigma)
        size = np.nan_to_num(size, nan=0.0, posinf=np.inf)
        largest = np.sort(np.concatenate([largest, size.max(axis=1)]))[-count:]
        if (size.max(axis=1) >= largest[0]).any():
            parts.append(table_of(rows))
    if not parts:
        return pl.DataFrame(schema={**SCHEMA, "misfit": pl.Float64})
    table = pl.concat(parts).with_columns((pl.col("v") / pl.col("sigma")).abs().alias("misfit"))
    return (
        table.filter(pl.col("flag") != "excluded")
        .sort("misfit", descending=True, nulls_last=True)
        .head(count)
    )
