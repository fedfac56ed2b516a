"""Trajectories in the result: every knot with its pose and σ, misalignments of inertial systems."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.quality.solved import Solved
from mor.report.edge import points, rotations
from mor.report.tables.shared import once

POSE = ("x", "y", "z", "omega", "phi", "kappa")


@once
def knot_table(solved: Solved) -> pl.DataFrame:
    """One row for each knot: trajectory, time in seconds, stretch (from 1), pose with σ."""
    network = solved.network
    trajectories = network.trajectories.values()
    if not trajectories:
        return pl.DataFrame()
    positions = points(solved, np.concatenate([t.positions for t in trajectories]))
    attitudes = rotations(solved, np.concatenate([t.rotations for t in trajectories]))
    columns: dict[str, Any] = {
        "trajectory": [t.name for t in trajectories for _ in t.times],
        "time": np.concatenate([t.times for t in trajectories]),
        "stretch": np.concatenate([t.stretch + 1 for t in trajectories]),
    }
    for part, names in ((positions, POSE[:3]), (attitudes, POSE[3:])):
        columns |= {name: part.values[:, k] for k, name in enumerate(names)}
        columns |= {f"s{name}": part.sigma[:, k] for k, name in enumerate(names)}
    return pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))


def boresight_rows(solved: Solved) -> list[dict[str, Any]]:
    """Misalignments of inertial systems that are unknown: ω, φ, κ with σ, by instrument."""
    things = solved.network.things["instrument"]
    numbers = things.parts["boresight"]
    blocks = solved.network.blocks.get("rotation")
    rows = []
    for name, number in zip(things.ids, numbers.tolist(), strict=True):
        if number < 0 or blocks is None or not blocks.free[number].any():
            continue
        found = rotations(solved, np.array([number]))
        row: dict[str, Any] = {"instrument": name}
        for k, part in enumerate(POSE[3:]):
            sigma = float(found.sigma[0, k])
            row |= {part: float(found.values[0, k]), f"s{part}": sigma if np.isfinite(sigma) else None}
        rows.append(row)
    return rows
