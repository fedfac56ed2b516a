"""Plane polygons and triangle meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mor.types import BoolArray, FloatArray, IntArray

# ---- Plane polygons in space: cut into triangles by taking ears off (G. H. Meisters 1975).

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


# ---- Triangles in space, and what stands between two points: the faces of meshes and plane polygons.
#
# Boxes around the triangles form a binary tree over their order along a space-filling curve (G. M. Morton 1966). All
# sights go down it together, level by level, and leave it where they miss a box.

_LEAF = 4
"""Triangles in the smallest boxes."""
_BESIDE = 1e-9
"""Part of a triangle beside its edges that still is it: nothing is seen through the joint of two faces."""


@dataclass(frozen=True)
class Triangles:
    """m triangles in the order of their boxes."""

    corners: FloatArray
    """(m, 3, 3) corners of each."""
    normals: FloatArray
    """(m, 3) unit normals."""

    boxes: tuple[tuple[FloatArray, FloatArray], ...]
    """By level from the root, lowest and highest coordinates (2^level, 3) of the boxes; the last level has leaves."""

    @property
    def count(self) -> int:
        """Number of triangles m."""
        return len(self.corners)


def triangles(corners: FloatArray, normals: FloatArray | None = None) -> Triangles:
    """Triangles with corners (m, 3, 3); their ``normals`` (m, 3) are those of corners that turn to the left."""
    if normals is None:
        normals = face_normals(corners)
    order = _along_curve(corners.mean(axis=1))
    corners, normals = corners[order], normals[order]
    leaves = 1 << max(0, int(np.ceil(np.log2(max(len(order), 1) / _LEAF))))
    # Where boxes without a triangle are.
    nowhere = 1e100
    low, high = np.full((leaves * _LEAF, 3), nowhere), np.full((leaves * _LEAF, 3), -nowhere)
    low[: len(order)], high[: len(order)] = corners.min(axis=1), corners.max(axis=1)
    level = low.reshape(leaves, _LEAF, 3).min(axis=1), high.reshape(leaves, _LEAF, 3).max(axis=1)
    boxes = [level]
    while len(level[0]) > 1:
        level = level[0].reshape(-1, 2, 3).min(axis=1), level[1].reshape(-1, 2, 3).max(axis=1)
        boxes.append(level)
    return Triangles(corners, normals, tuple((low, np.where(low > high, low, high)) for low, high in reversed(boxes)))


def face_normals(corners: FloatArray) -> FloatArray:
    """(m, 3) unit normals of triangles (m, 3, 3) to the side from which their corners turn to the left."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _along_curve(places: FloatArray) -> IntArray:
    """Order of places (m, 3) along the Z-order curve through the cells of a grid."""
    if not len(places):
        return np.zeros(0, dtype=np.int64)
    low = places.min(axis=0)
    size = max(float((places.max(axis=0) - low).max()), 1e-300)
    bits = 10
    cell = ((places - low) / size * ((1 << bits) - 1)).astype(np.int64)
    key = np.zeros(len(places), dtype=np.int64)
    for bit in range(bits):
        for axis in range(3):
            key |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")


def hidden(origins: FloatArray, targets: FloatArray, some: Triangles, clearance: float) -> BoolArray:
    """(n,) true where a triangle stands between origin and target, (n, 3) each.

    A triangle whose plane is not further from either of the two than ``clearance`` is not in the way: it is what the
    target is fixed to.
    """
    # Sights that go down the tree together: their pairs with boxes stay in the cache.
    at_a_time = 2_000
    parts = [slice(first, first + at_a_time) for first in range(0, len(targets), at_a_time)]
    found = [_hidden(origins[part], targets[part], some, clearance) for part in parts]
    return np.concatenate([np.zeros(0, dtype=bool), *found])


def _hidden(origins: FloatArray, targets: FloatArray, some: Triangles, clearance: float) -> BoolArray:
    found = np.zeros(len(targets), dtype=bool)
    step = targets - origins
    # Step of a sight along an axis on which it does not move.
    still = 1e-150
    inverse = 1.0 / np.where(np.abs(step) < still, still, step)

    def meets(sight: IntArray, low: FloatArray, high: FloatArray) -> BoolArray:
        return _through_boxes(origins[sight], inverse[sight], low, high)

    for sight, triangle in _pairs(some, len(targets), meets):
        left = ~found[sight]
        sight, triangle = sight[left], triangle[left]
        # (k,) true where the sight goes through the triangle, and neither of its ends is on it.
        origin = origins[sight]
        target = targets[sight]
        corners = some.corners[triangle]
        normals = some.normals[triangle]
        before = np.einsum("ki,ki->k", origin - corners[:, 0], normals)
        behind = np.einsum("ki,ki->k", target - corners[:, 0], normals)
        apart = (np.minimum(np.abs(before), np.abs(behind)) > clearance) & (before * behind < 0.0)
        inside = np.zeros(len(origin), dtype=bool)
        k = np.flatnonzero(apart)
        part = (before[k] / (before[k] - behind[k]))[:, None]
        inside[k] = _within(origin[k] + part * (target[k] - origin[k]), corners[k])
        found[sight[inside]] = True
    return found


def faces_of(points: FloatArray, some: Triangles, within: float) -> IntArray:
    """(n,) the triangle, in the order of ``some``, that each point (n, 3) is nearest to; −1: none is ``within``."""
    nearest = np.full(len(points), -1)
    least = np.full(len(points), within)

    def meets(point: IntArray, low: FloatArray, high: FloatArray) -> BoolArray:
        at = points[point]
        return np.asarray(((at >= low - within) & (at <= high + within)).all(axis=1))

    for point, triangle in _pairs(some, len(points), meets):
        distance = _distances(points[point], some.corners[triangle], some.normals[triangle])
        for k in np.flatnonzero(distance <= least[point]).tolist():
            if distance[k] < least[point[k]] or nearest[point[k]] < 0:
                least[point[k]], nearest[point[k]] = distance[k], triangle[k]
    return nearest


def _pairs(
    some: Triangles, count: int, meets: Callable[[IntArray, FloatArray, FloatArray], BoolArray]
) -> list[tuple[IntArray, IntArray]]:
    """Pairs (item, triangle) left over where each of ``count`` items meets all boxes around the triangle.

    One array of pairs for each place in the leaves.
    """
    item = np.arange(count)
    box = np.zeros(count, dtype=np.int64)
    for depth, (low, high) in enumerate(some.boxes):
        if depth:
            item, box = np.repeat(item, 2), np.stack([2 * box, 2 * box + 1], axis=1).ravel()
        met = meets(item, low[box], high[box])
        item, box = item[met], box[met]
    found = []
    for place in range(_LEAF):
        triangle = box * _LEAF + place
        there = triangle < some.count
        found.append((item[there], triangle[there]))
    return found


def _through_boxes(origin: FloatArray, inverse: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """(k,) true where the sight from ``origin``, with the ``inverse`` of its step, meets a box, faces included.

    Source: the slabs of T. L. Kay and J. T. Kajiya, SIGGRAPH 1986.
    """
    enters, leaves = np.full(len(origin), -_BESIDE), np.full(len(origin), 1.0 + _BESIDE)
    for axis in range(3):
        size = _BESIDE * (1.0 + np.abs(origin[:, axis]))
        first = (low[:, axis] - size - origin[:, axis]) * inverse[:, axis]
        second = (high[:, axis] + size - origin[:, axis]) * inverse[:, axis]
        np.maximum(enters, np.minimum(first, second), out=enters)
        np.minimum(leaves, np.maximum(first, second), out=leaves)
    return np.asarray(enters <= leaves)


def _within(at: FloatArray, corners: FloatArray) -> BoolArray:
    """(k,) true where places (k, 3) in the planes of triangles are in these, their edges included."""
    return np.asarray((_barycentric(at, corners) >= -_BESIDE).all(axis=1))


def _barycentric(at: FloatArray, corners: FloatArray) -> FloatArray:
    """(k, 3) barycentric coordinates of the feet of places (k, 3) in the planes of triangles (k, 3, 3)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = at - corners[:, 0]
    aa, ab, bb = (np.einsum("ki,ki->k", u, v) for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = (np.einsum("ki,ki->k", p, u) for u in (a, b))
    size = aa * bb - ab * ab
    u, v = (bb * pa - ab * pb) / size, (aa * pb - ab * pa) / size
    return np.asarray(np.stack([1.0 - u - v, u, v], axis=1), dtype=np.float64)


def _distances(points: FloatArray, corners: FloatArray, normals: FloatArray) -> FloatArray:
    """(k,) distances of points (k, 3) from triangles (k, 3, 3): from their planes, or from their edges beside them."""
    found: FloatArray = np.abs(np.einsum("ki,ki->k", points - corners[:, 0], normals))
    beside = np.flatnonzero(~_within(points, corners))
    at, edges = points[beside, None, :], corners[beside]
    along = np.roll(edges, -1, axis=1) - edges
    part = np.einsum("kei,kei->ke", at - edges, along) / np.einsum("kei,kei->ke", along, along)
    foot = edges + np.clip(part, 0.0, 1.0)[:, :, None] * along
    found[beside] = np.linalg.norm(at - foot, axis=2).min(axis=1)
    return found
