"""Movements of points in one adjustment as tables, in project axes: what moves them, and how far they have moved."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.quality.deformation.movements import Movements, Tested, movements
from mor.quality.solved import Solved
from mor.report.tables.shared import once

PER = {"velocity": "/a", "annual oscillation": "", "step": ""}
"""What stands behind the unit of length of a parameter: velocities are lengths in a year."""
_COMPONENTS = ("x", "y", "z", "cos_x", "cos_y", "cos_z")


@once
def found_movements(solved: Solved) -> Movements | None:
    """Movements of an adjustment, worked out once."""
    return movements(solved)


def epoch_rows(solved: Solved) -> list[dict[str, Any]]:
    """The epochs in the order of time."""
    motion = solved.network.motion
    return [{"epoch": motion.labels[k], "year": motion.times[k]} for k in motion.in_order]


def motion_table(solved: Solved) -> pl.DataFrame:
    """One row for each parameter of a point: velocity, step; of an annual oscillation the sine, then the cosine."""
    found = found_movements(solved)
    if found is None:
        return pl.DataFrame()
    tested = found.parameters
    begins = {"point": list(tested.names), "parameter": list(tested.what), "time": list(tested.end)}
    return _with_tests(solved, tested, begins, 6)


def movement_rows(solved: Solved) -> pl.DataFrame:
    """One row for each point and epoch: movement since the first epoch of the point."""
    found = found_movements(solved)
    if found is None:
        return pl.DataFrame()
    tested = found.between
    begins = {"point": list(tested.names), "from": list(tested.begin), "to": list(tested.end)}
    return _with_tests(solved, tested, begins, 3)


def _with_tests(solved: Solved, tested: Tested, begins: dict[str, Any], size: int) -> pl.DataFrame:
    quality = solved.quality
    assert quality is not None
    M = solved.network.edge.matrix
    vectors = _turned(tested.tests.vectors, M)
    variances = np.diagonal(tested.tests.cofactors, axis1=1, axis2=2)
    sigma = _turned(np.sqrt(np.maximum(variances, 0.0)), np.abs(M)) * quality.sigma_factor
    has = np.array([what == "annual oscillation" for what in tested.what], dtype=bool)
    columns: dict[str, Any] = dict(begins)
    for k, name in enumerate(_COMPONENTS[:size]):
        columns[name] = np.where(has | (k < 3), vectors[:, k], np.nan)
        columns[f"s{name}"] = np.where(has | (k < 3), sigma[:, k], np.nan)
    columns["freedom"] = tested.tests.freedom
    columns["test"] = tested.tests.statistic / (quality.sigma_factor**2)
    columns["p"] = np.exp(tested.log_p)
    columns["smallest"] = tested.smallest
    columns["moved"] = tested.significant
    texts = dict.fromkeys(begins, pl.String)
    return pl.DataFrame(columns, schema_overrides=texts).with_columns(pl.col(pl.Float64).fill_nan(None))


def _turned(vectors: FloatArray, M: FloatArray) -> FloatArray:
    """(n, 6) two vectors a row, from internal to project axes."""
    return np.concatenate([vectors[:, :3] @ M, vectors[:, 3:] @ M], axis=1)
