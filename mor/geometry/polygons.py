"""Plane polygons in space: cut into triangles by taking ears off (G. H. Meisters 1975)."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray

_FLAT = 1e-9
"""Part of the size of a polygon by which three of its corners may leave a straight line."""


def newell_normal(corners: FloatArray) -> FloatArray:
    """(3,) twice the area of a polygon (k, 3) along its normal, to the side from which its corners turn to the left.

    Source: M. E. Newell's method, as in F. Tampieri, Graphics Gems III (1992), p. 231.
    """
    origin = corners - corners[0]
    return np.asarray(np.cross(origin, np.roll(origin, -1, axis=0)).sum(axis=0))


def triangulated(corners: FloatArray) -> IntArray:
    """(k − 2, 3) corners of the triangles that a simple polygon (k, 3) consists of, whatever its shape, or fewer.

    Corners on a straight line make no triangle. Raises ``ValueError`` where the polygon crosses itself or has no area.
    """
    flat = _in_plane(corners)
    size = float(np.abs(flat - flat.mean(axis=0)).max())
    left = list(range(len(flat)))
    found: list[tuple[int, int, int]] = []
    while len(left) > 2:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            area = _turn(flat[a], flat[b], flat[c])
            straight = abs(area) <= _FLAT * size * size
            if straight or (area > 0.0 and not _any_inside(flat, (a, b, c), left)):
                if not straight:
                    found.append((a, b, c))
                del left[k]
                break
        else:
            raise ValueError("it crosses itself")
    if not found:
        raise ValueError("it has no area")
    return np.array(found, dtype=np.int64)


def _in_plane(corners: FloatArray) -> FloatArray:
    """(k, 2) corners in two axes of their plane, in which they turn to the left."""
    normal = newell_normal(corners)
    length = np.linalg.norm(normal)
    size = np.abs(corners - corners.mean(axis=0)).max()
    if length <= _FLAT * size * size:
        raise ValueError("it has no area")
    normal = normal / length
    x = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    x /= np.linalg.norm(x)
    return np.asarray((corners - corners[0]) @ np.stack([x, np.cross(normal, x)], axis=1))


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Twice the area of a triangle, above 0 where it turns to the left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _any_inside(flat: FloatArray, ear: tuple[int, int, int], left: list[int]) -> bool:
    """Return True if another corner is inside an ear, or on its edges: nothing can be cut off there."""
    a, b, c = (flat[k] for k in ear)
    for k in left:
        if k in ear or any(np.array_equal(flat[k], corner) for corner in (a, b, c)):
            continue
        if _turn(a, b, flat[k]) >= 0.0 and _turn(b, c, flat[k]) >= 0.0 and _turn(c, a, flat[k]) >= 0.0:
            return True
    return False
