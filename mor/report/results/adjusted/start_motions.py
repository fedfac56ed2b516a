"""Movements of the adjusted project: velocities and oscillations start at their adjusted values.

Steps and coordinates of single epochs start among the points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.parameters.kinds import MOTIONS
from mor.report.results.adjusted.start_columns import Placed, motion_columns, start_frame

_MODELS = {"velocity": ("velocity",), "seasonal": ("sine", "cosine")}


def motions(
    placed: Placed, entries: list[dict[str, Any]], tables: dict[str, pl.DataFrame | str]
) -> list[dict[str, Any]]:
    """The entries of the section ``motions``; tables of start values are added to ``tables``."""
    result = []
    points = placed.network.things["point"]
    for number, (entry, (model, names)) in enumerate(
        zip(entries, placed.network.motion.tables, strict=True), 1
    ):
        if model not in _MODELS:
            result.append(entry)
            continue
        columns: dict[str, Any] = {}
        for kind in (kind for kind in MOTIONS if kind.key in _MODELS[model]):
            blocks = np.array([points.part(name, kind.key) for name in names], dtype=np.int64)
            columns |= motion_columns(placed, kind, blocks)
        file = f"start_motions_{number}.csv"
        tables[file] = start_frame(names, columns)
        name = {"name": entry["name"]} if "name" in entry else {"name": f"motions {number}"}
        result.append({"model": model, "file": file, **name})
    return result
