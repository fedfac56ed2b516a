"""Tables of knots with the adjusted values; those at a spacing are knots now, and images on trajectories have times."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.project.trajectories.images import TRAJECTORY
from mor.report.results.adjusted.start_columns import Placed, angle_columns, coordinate_columns

_KEYS = ("interpolation", "gap", "constancy", "smoothness")


def trajectory_tables(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    """A table for each one of the project, with the keys it has there."""
    network = placed.network
    parts = network.things["knot"].parts
    columns: dict[str, Any] = {
        "trajectory": [t.name for t in network.trajectories.values() for _ in t.times],
        "time": np.concatenate([np.zeros(0), *(t.times for t in network.trajectories.values())]),
    }
    if not len(columns["time"]):
        return []
    columns |= coordinate_columns(placed, parts["position"])
    columns |= angle_columns(placed, parts["rotation"], np.eye(3))
    whole = pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))
    result, first = [], 0
    for (name, count), table in zip(network.tables["knot"], network.project.trajectories, strict=True):
        said = table.model_dump(include=set(_KEYS), exclude_defaults=True, exclude_none=True)
        result.append((whole[first : first + count], {**({"name": name} if name else {}), **said}))
        first += count
    return result


def on_trajectories(placed: Placed, columns: dict[str, Any], pose: dict[str, Any]) -> dict[str, Any]:
    """Columns of images, those on trajectories with trajectory and time in place of the columns of a ``pose``."""
    network = placed.network
    images = network.things["image"]
    on = images.parts[TRAJECTORY] >= 0
    leads = images.parts["base"] < 0
    if not on.any():
        return columns
    for name in pose:
        if isinstance(columns[name], np.ndarray):
            columns[name][on] = np.nan
        else:
            columns[name] = ["" if no else text for no, text in zip(on, columns[name], strict=True)]
    ids = list(network.trajectories)
    named = zip(images.parts[TRAJECTORY], leads, strict=True)
    columns["trajectory"] = [ids[k] if k >= 0 and own else "" for k, own in named]
    tabled = {name for name, lines in network.lines.items() if not lines.steady}
    timed = on & leads & np.array([name not in tabled for name in images.ids])
    columns["time"] = np.array(
        [network.image_times[name] if own else np.nan for name, own in zip(images.ids, timed, strict=True)]
    )
    return columns
