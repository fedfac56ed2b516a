"""Planes, lines and right angles as they came out: where they lie, and how well their points fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.project.file.model import Feature
from mor.project.network.features import feature_label
from mor.quality.solved import Solved

SCHEMA: dict[str, type[pl.DataType]] = {
    "id": pl.String,
    "type": pl.String,
    "part": pl.String,
    "dx": pl.Float64,
    "dy": pl.Float64,
    "dz": pl.Float64,
    "distance": pl.Float64,
    "x": pl.Float64,
    "y": pl.Float64,
    "z": pl.Float64,
    "points": pl.Int64,
    "rms": pl.Float64,
}
_X, _Z = np.eye(3)[[0, 2]]


def feature_table(solved: Solved) -> pl.DataFrame:
    """One row for every plane and line, two for a right angle, in project axes and length unit.

    (dx, dy, dz) is the unit normal of a plane or the unit direction of a line; (x, y, z) the mean of its points, put on
    it; ``distance`` of a plane that from the origin, dx x + dy y + dz z; ``rms`` the root mean square distance of the
    points from it.
    """
    rows = [row for feature in solved.network.project.features for row in _rows(solved, feature)]
    return pl.DataFrame(rows, schema=SCHEMA)


def _rows(solved: Solved, feature: Feature) -> list[dict[str, Any]]:
    label = feature_label(feature)
    group = next(g for g in solved.adjustment.problem.groups if g.name == label and g.type.key == "local")
    position, rotation, _, eccentricity, points = group.blocks
    values, M = solved.adjustment.values, solved.network.edge.matrix
    D, offset = values["rotation"][rotation[0]], values["eccentricity"][eccentricity[0]]
    local = (values["point"][points] - values["point"][position[0]]) @ D.T + offset
    rows = []
    for part, axis, chosen in _parts(feature, len(points)):
        on = local[chosen].mean(axis=0)
        off = local[chosen][:, :2] if feature.type == "line" else local[chosen] @ axis[:, None]
        on[:2] = 0.0 if feature.type == "line" else on[:2]
        on = on if feature.type == "line" else on * (1.0 - axis)
        place = ((on - offset) @ D + values["point"][position[0]]) @ M
        direction = _upright(axis @ D @ M)
        rows.append(
            {
                "id": feature.id,
                "type": feature.type,
                "part": part,
                **dict(zip(("dx", "dy", "dz"), direction.tolist(), strict=True)),
                "distance": None if feature.type == "line" else float(direction @ place),
                **dict(zip("xyz", place.tolist(), strict=True)),
                "points": int(np.count_nonzero(chosen)),
                "rms": float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
            }
        )
    return rows


def _parts(feature: Feature, count: int) -> list[tuple[str, FloatArray, np.ndarray]]:
    """Name, axis in the local system and points (count,) of each plane or line of a feature."""
    first = np.arange(count) < len(feature.points)
    if feature.type == "right angle":
        return [("points", _Z, first), ("other", _X, ~first)]
    return [("", _Z, first)]


def _upright(direction: FloatArray) -> FloatArray:
    """The direction or its opposite: that whose largest component is positive."""
    upright: FloatArray = direction * np.sign(direction[np.argmax(np.abs(direction))])
    return upright
