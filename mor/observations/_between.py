"""The vector between two positions, with the heights of instrument and target, that the terrestrial types share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._contract import Reference, Slot

POSITIONS = ("point", "station", "image")

FROM_TO = (Reference("from", POSITIONS), Reference("to", POSITIONS))
BETWEEN_SLOTS = (
    Slot("point", "from", "position"),
    Slot("height", "from", "height"),
    Slot("point", "to", "position"),
    Slot("height", "to", "height"),
)


def between(blocks: Sequence[FloatArray]) -> FloatArray:
    """Vectors (n, 3) from the instrument at ``from`` to the target at ``to``; blocks as in BETWEEN_SLOTS."""
    start, start_height, end, end_height = blocks
    difference = end - start
    difference[:, 2] += end_height[:, 0] - start_height[:, 0]
    return difference


def by_between(by_vector: FloatArray) -> tuple[FloatArray, ...]:
    """Chain (n, m, 3) derivatives by the vector on to the slots of BETWEEN_SLOTS."""
    vertical = by_vector[:, :, 2:]
    return -by_vector, -vertical, by_vector, vertical


def horizontal_length(vector: FloatArray) -> FloatArray:
    """√(ΔX² + ΔY²) (n,), never zero: a vertical sight keeps its derivatives finite."""
    tiny = np.finfo(float).tiny
    length: FloatArray = np.maximum(np.hypot(vector[:, 0], vector[:, 1]), tiny**0.5)
    return length


def bearing(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bearings atan2(X, Y) (n,), clockwise from +Y, and their derivatives (n, 3)."""
    square = horizontal_length(vector) ** 2
    derivative = np.zeros_like(vector)
    derivative[:, 0] = vector[:, 1] / square
    derivative[:, 1] = -vector[:, 0] / square
    return np.arctan2(vector[:, 0], vector[:, 1]), derivative


def elevation(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vertical directions atan(Z / √(X² + Y²)) (n,) and their derivatives (n, 3)."""
    horizontal = horizontal_length(vector)
    square = horizontal**2 + vector[:, 2] ** 2
    derivative = np.empty_like(vector)
    derivative[:, :2] = -(vector[:, :2] / horizontal[:, None]) * (vector[:, 2] / square)[:, None]
    derivative[:, 2] = horizontal / square
    return np.arctan2(vector[:, 2], horizontal), derivative


def spatial_length(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths √(X² + Y² + Z²) (n,) and their derivatives (n, 3)."""
    length = np.linalg.norm(vector, axis=1)
    return length, vector / np.maximum(length, np.finfo(float).tiny ** 0.5)[:, None]
