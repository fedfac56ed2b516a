"""Space resection on a plane object from four or more points: no ambiguity of three points.

The collineation between plane and bundle, p ~ M (u, v, 1)ᵀ with M = D (e1, e2, O − X0), carries the
attitude in its first two columns; what noise does to their lengths and right angle is taken out by the
nearest rotation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.approximate.vectors import cross, principal_rows, tangent_axes, unit
from mor.arrays import FloatArray

FLAT = 1e-3
"""Thickness of the object, relative to its smaller extension in the plane, below which it is treated as plane."""


class ObjectPlane(NamedTuple):
    """The plane that fits object points best."""

    origin: FloatArray
    axes: FloatArray
    """(3, 3) rows: two axes in the plane, its normal."""
    extensions: FloatArray
    """(3,) root mean square extension along the axes."""


def object_plane(points: FloatArray) -> ObjectPlane:
    """Plane through points (n, 3) by principal axes."""
    origin = points.mean(axis=0)
    values, axes = principal_rows(points - origin)
    if np.linalg.det(axes) < 0.0:
        axes = axes * np.array([1.0, 1.0, -1.0])[:, None]
    return ObjectPlane(origin, axes, values / np.sqrt(len(points)))


def is_plane(plane: ObjectPlane) -> bool:
    """True if the points lie in a plane for the purpose of a start value."""
    return bool(plane.extensions[2] < FLAT * plane.extensions[1])


def resect_plane(bundle: Bundle, points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Position (3,) and rotation (3, 3) from n ≥ 4 points (n, 3) near a plane; none if they are too collinear."""
    plane = object_plane(points)
    if plane.extensions[1] <= 0.0:
        return None
    size = plane.extensions[0]
    flat = np.column_stack([(points - plane.origin) @ plane.axes[:2].T / size, np.ones(len(points))])
    directions = unit(bundle.rays)
    rows = np.einsum("nij,nk->njik", tangent_axes(directions), flat).reshape(-1, 9)
    matrix = principal_rows(rows)[1][8].reshape(3, 3)
    if np.sum(np.einsum("ni,ni->n", flat @ matrix.T, directions)) < 0.0:
        matrix = -matrix
    scale = np.linalg.norm(matrix[:, 0]) + np.linalg.norm(matrix[:, 1])
    if not scale > 0.0:
        return None
    matrix = matrix * (2.0 / scale)
    columns = np.column_stack([matrix[:, :2], cross(matrix[:, 0], matrix[:, 1])])
    in_plane = nearest_rotation(columns)
    position = plane.origin - size * plane.axes.T @ in_plane.T @ matrix[:, 2]
    return position, in_plane @ plane.axes
