"""Table of undetermined unknowns, with reason and treatment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.errors import Undeterminable
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.units import ANGLE_UNITS

SCHEMA = {
    "kind": pl.String,
    "id": pl.String,
    "reason": pl.String,
    "treatment": pl.String,
    "observations": pl.Int64,
    "dx": pl.Float64,
    "dy": pl.Float64,
    "dz": pl.Float64,
    "sigma": pl.Float64,
}
FILE = "undetermined.csv"


def undeterminable_rows(solved: Solved) -> list[dict[str, Any]]:
    """One row for each thing; of points at infinity the unit vector to them, and its σ (the larger semi-axis)."""
    directions = _directions(solved)
    return [
        {**_row(thing), **directions.get(thing.name if thing.treatment == "at infinity" else "", _NOTHING)}
        for thing in solved.network.undeterminable
    ]


def undeterminable_table(things: Sequence[dict[str, Any] | Undeterminable]) -> pl.DataFrame:
    """The rows as a table."""
    rows = [_row(thing) | _NOTHING if isinstance(thing, Undeterminable) else thing for thing in things]
    return pl.DataFrame(rows, schema=SCHEMA)


_NOTHING: dict[str, float | None] = dict.fromkeys(("dx", "dy", "dz", "sigma"))


def _row(thing: Undeterminable) -> dict[str, Any]:
    return {
        "kind": thing.kind,
        "id": thing.name,
        "reason": thing.reason,
        "treatment": thing.treatment,
        "observations": thing.observations,
    }


def _directions(solved: Solved) -> dict[str, dict[str, float | None]]:
    """Unit vectors in project axes by the names of points at infinity, σ in the project's angle unit."""
    network = solved.network
    unit = ANGLE_UNITS[angle_unit(solved)]
    found: dict[str, dict[str, float | None]] = {}
    for point, rotation in network.directions.items():
        vector = solved.adjustment.values["rotation"][rotation][2] @ network.edge.matrix
        sigma = None
        if solved.quality is not None:
            cofactor = solved.quality.cofactors["rotation"][rotation][:2, :2]
            largest = float(np.linalg.eigvalsh(cofactor)[-1])
            sigma = solved.quality.sigma_factor * float(np.sqrt(max(largest, 0.0))) / unit
        row = {f"d{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        found[network.blocks["point"].ids[point]] = {**row, "sigma": sigma}
    return found
