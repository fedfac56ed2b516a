"""What one does with the shape of a plane object: scale, level or wall, further points, sides and angles (Killian)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.planar.plane_shape import PlaneShape
from mor.arrays import FloatArray


class PlacedPlane(NamedTuple):
    """Points of the plane and the frames in an object system."""

    points: FloatArray
    """(n, 3)"""
    positions: FloatArray
    """(m, 3)"""
    rotations: FloatArray
    """(m, 3, 3)"""
    turn: FloatArray
    """(3, 3) from the axes of the shape to those of the object system."""
    scale: float
    """Length in the object system over that of the shape."""


class SidesAndAngles(NamedTuple):
    """A polygon by its sides and angles."""

    sides: FloatArray
    """(k,) from each corner to the next."""
    angles: FloatArray
    """(k,) interior angle at each corner in radians, 0 to 2π for a polygon without crossing sides."""


def scale_from_length(shape: PlaneShape, first: int, second: int, length: float) -> float:
    """Factor from the unit of the shape to that of ``length``, measured between two of its points, also off the plane.

    Raises ``ValueError`` if the length is not positive or the points coincide.
    """
    space = in_space(shape)
    distance = float(np.linalg.norm(space[second] - space[first]))
    if not length > 0.0 or not distance > 0.0:
        raise ValueError("the scale needs two different points and a positive length")
    return length / distance


def in_space(shape: PlaneShape) -> FloatArray:
    """Points (n, 3) of a shape, the plane Z = 0."""
    return np.column_stack([shape.points, shape.heights])


def on_level_plane(shape: PlaneShape, origin: int, towards: int, scale: float) -> PlacedPlane:
    """Plane as the level plane Z = 0, its normal upwards to the cameras: Z of a position is its flight
    height.

    ``origin`` becomes (0, 0, 0), the X axis runs to the point ``towards``.
    """
    turn = np.eye(3)
    turn[:2, :2] = _axes(shape, origin, towards)
    return _placed(shape, origin, turn, scale)


def on_wall(shape: PlaneShape, origin: int, towards: int, scale: float) -> PlacedPlane:
    """Plane as a wall Y = 0 seen by cameras at Y < 0: X to the right along the wall, Y into it, Z up.

    The line from ``origin`` to the point ``towards`` is level and leads to the right.
    """
    turn = np.zeros((3, 3))
    along = _axes(shape, origin, towards)
    turn[0, :2], turn[2, :2] = along
    turn[1, 2] = -1.0
    return _placed(shape, origin, turn, scale)


def _axes(shape: PlaneShape, origin: int, towards: int) -> FloatArray:
    along = shape.points[towards] - shape.points[origin]
    x, y = along / np.linalg.norm(along)
    return np.array([[x, y], [-y, x]])


def _placed(shape: PlaneShape, origin: int, turn: FloatArray, scale: float) -> PlacedPlane:
    zero = np.append(shape.points[origin], 0.0)
    return PlacedPlane(
        scale * (in_space(shape) - zero) @ turn.T,
        scale * (shape.positions - zero) @ turn.T,
        np.asarray(shape.rotations @ turn.T),
        turn,
        scale,
    )


def sides_and_angles(corners: FloatArray) -> SidesAndAngles:
    """Sides and interior angles of a polygon (k, 2), corners in order round it either way."""
    following, previous = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
    turning = np.arctan2(
        following[:, 0] * previous[:, 1] - following[:, 1] * previous[:, 0],
        np.sum(following * previous, axis=1),
    )
    x, y = corners.T
    counter_clockwise = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0.0
    angles = np.mod(turning if counter_clockwise else -turning, 2.0 * np.pi)
    return SidesAndAngles(np.linalg.norm(following, axis=1), angles)
