"""Error ellipses and ellipsoids of points, and those of the differences of pairs of points."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.project.edge import Edge
from mor.quality.assess import Quality
from mor.quality.precision.covariance import joint_cofactors
from mor.quality.precision.ellipses import error_ellipses, error_ellipsoids
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.units import ANGLE_UNITS

AT_A_TIME = 100
"""Pairs whose covariances are worked out together."""


def ellipse_table(solved: Solved) -> pl.DataFrame:
    """Points with unknowns: ellipse in plan, and the semi-axes of the ellipsoid with directions.

    Azimuths as the project counts bearings, elevations above the horizontal plane, in its unit of angles.
    """
    numbers = free_points(solved)
    covariance = _covariances(solved, numbers)
    ids = solved.network.blocks["point"].ids
    return pl.DataFrame(
        {"id": [ids[k] for k in numbers], **_in_plan(solved, covariance), **_in_space(solved, covariance)}
    )


def free_points(solved: Solved) -> IntArray:
    """Point blocks of named points that have unknowns and σ."""
    numbers = solved.network.things["point"].parts["position"]
    if solved.quality is None:
        return numbers[:0]
    free = solved.network.blocks["point"].free[numbers].any(axis=1)
    if "point" in solved.network.absent:
        known = solved.network.absent["point"]
        free &= ~np.isin(numbers, np.flatnonzero(known))
    return np.asarray(numbers[free])


def relative_rows(solved: Solved, pairs: IntArray) -> list[dict[str, Any]]:
    """Pairs (n, 2) of point blocks: distance with σ, ellipse in plan and σ of the height of their difference."""
    if solved.quality is None:
        return []
    ids = solved.network.blocks["point"].ids
    differences = np.diff(solved.adjustment.values["point"][pairs], axis=1)[:, 0]
    parts = [
        _of_differences(solved.quality, pairs[first : first + AT_A_TIME])
        for first in range(0, len(pairs), AT_A_TIME)
    ]
    covariance = np.concatenate([np.zeros((0, 3, 3)), *parts])
    lengths = np.linalg.norm(differences, axis=1)
    along = differences / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    sigma = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", along, covariance, along), 0.0))
    plan = _in_plan(solved, covariance)
    azimuth = error_ellipses(covariance).azimuth
    axis = np.column_stack([np.sin(azimuth), np.cos(azimuth), np.zeros(len(azimuth))])
    direction = (
        axis @ solved.network.edge.matrix
    )  # the inverse of a rotation, or of a reflection, of the axes
    return [
        {
            "from": ids[one],
            "to": ids[other],
            "distance": float(lengths[k]),
            "sdistance": float(sigma[k]) if lengths[k] > 0.0 else None,
            **{name: float(column[k]) for name, column in plan.items()},
            "direction": [float(part) for part in direction[k, :2]],
            "sdz": float(np.sqrt(max(covariance[k, 2, 2], 0.0))),
        }
        for k, (one, other) in enumerate(pairs.tolist())
    ]


def chosen_pairs(solved: Solved) -> IntArray:
    """(n, 2) point blocks of the pairs that the project asks for (``report: {relative: …}``)."""
    points = solved.network.things["point"]
    pairs = [
        [points.part(name, "position") for name in pair] for pair in solved.network.project.report.relative
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def neighbouring_pairs(solved: Solved, most: int) -> IntArray:
    """(n, 2) every point with its nearest neighbour, of the first ``most`` points with unknowns; a pair once."""
    from scipy.spatial import KDTree

    numbers = free_points(solved)[:most]
    if len(numbers) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    places = solved.adjustment.values["point"][numbers]
    nearest = np.asarray(KDTree(places).query(places, k=2)[1])
    # Of two points at one place either may come first.
    other = np.where(nearest[:, 0] == np.arange(len(numbers)), nearest[:, 1], nearest[:, 0])
    pairs = np.sort(np.stack([np.arange(len(numbers)), other], axis=1), axis=1)
    return np.asarray(numbers[np.unique(pairs, axis=0)])


def _of_differences(quality: Quality, pairs: IntArray) -> FloatArray:
    """Covariances (n, 3, 3) of second minus first, internal axes."""
    used, where = np.unique(pairs, return_inverse=True)
    columns = quality.adjustment.problem.index.columns["point"][used]
    q = joint_cofactors(quality, columns.ravel()).reshape(len(used), 3, len(used), 3)
    i, j = where.reshape(pairs.shape).T
    covariance = q[i, :, i] + q[j, :, j] - q[i, :, j] - q[j, :, i]
    return np.asarray(covariance * quality.sigma_factor**2)


def _covariances(solved: Solved, numbers: IntArray) -> FloatArray:
    quality = solved.quality
    if quality is None:
        return np.zeros((len(numbers), 3, 3))
    return np.asarray(np.nan_to_num(quality.cofactors["point"][numbers]) * quality.sigma_factor**2)


def _in_plan(solved: Solved, covariance: FloatArray) -> dict[str, FloatArray]:
    plan = error_ellipses(covariance)
    return {"a": plan.a, "b": plan.b, "azimuth": bearings(solved, plan.azimuth) % _half_circle(solved)}


def _in_space(solved: Solved, covariance: FloatArray) -> dict[str, FloatArray]:
    space = error_ellipsoids(covariance)
    unit = ANGLE_UNITS[angle_unit(solved)]
    columns: dict[str, FloatArray] = {}
    for k in range(3):
        columns[f"axis{k + 1}"] = space.axes[:, k]
        columns[f"azimuth{k + 1}"] = bearings(solved, space.azimuths[:, k])
        columns[f"elevation{k + 1}"] = space.elevations[:, k] / unit
    return columns


def ellipse_columns(solved: Solved, covariance: FloatArray | None, count: int) -> dict[str, FloatArray]:
    """Columns ``ellipse_…`` of a table of ``count`` points with covariances (n, 3, 3) in project axes."""
    if covariance is None:
        return {f"ellipse_{name}": np.full(count, np.nan) for name in ("a", "b", "azimuth")}
    M = solved.network.edge.matrix
    return {
        f"ellipse_{name}": column
        for name, column in _in_plan(solved, M @ np.nan_to_num(covariance) @ M.T).items()
    }


def bearings(solved: Solved, azimuth: FloatArray) -> FloatArray:
    """Azimuths (radians, clockwise from north) as the project counts bearings, in its unit, within the circle."""
    return bearings_of(solved.network.edge, angle_unit(solved), azimuth)


def bearings_of(edge: Edge, unit: str, azimuth: FloatArray) -> FloatArray:
    """The same by the axes of a project and a unit of angles."""
    size = ANGLE_UNITS[unit]
    return np.asarray(edge.sense * (azimuth - edge.zero_azimuth) / size % (2.0 * np.pi / size))


def _half_circle(solved: Solved) -> float:
    return float(np.pi / ANGLE_UNITS[angle_unit(solved)])
