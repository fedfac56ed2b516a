"""Points from the distances between them alone, in the plane or in space: trilateration without known points.

Minimal stress: the sum of squared differences between measured and present distances (Levenberg-Marquardt). It begins
in a space of two more dimensions, where hardly any wrong minima are, and is then pressed into the wanted one. Several
beginnings, the first by classical scaling of the shortest paths (W. S. Torgerson, Psychometrika 17 (1952)), tell
whether the distances leave more than one shape; mirrored ones count as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import shortest_path

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

BEGINNINGS = 16
AGREEING = 4
"""Shapes within the precision of the distances after which no other is looked for."""
PRECISE = 1.5
"""Root mean square of the residuals in units of σ up to which a shape is as good as the distances."""
FITS = 0.01
"""Root mean square of the residuals, in parts of the mean distance, up to which a shape fits."""
SAME = 0.05
"""Root mean square difference of the distances between all points of two shapes, in the same measure."""
FLEXIBLE = 1e-4
"""Smallest singular value, in parts of the largest, of a shape that is stiff."""
_EXTRA = 2
_STEPS = 60
_PRESSURES = (0.0, 0.1, 1.0, 10.0)


@dataclass(frozen=True)
class Lengths:
    """Distances between ``count`` points, numbered from 0."""

    count: int
    start: IntArray
    end: IntArray
    value: FloatArray
    sigma: FloatArray

    def among(self, points: IntArray) -> Lengths:
        """The distances among some points (sorted), which get new numbers in their order."""
        here = np.isin(self.start, points) & np.isin(self.end, points)
        start, end = (np.searchsorted(points, one[here]) for one in (self.start, self.end))
        return Lengths(len(points), start, end, self.value[here], self.sigma[here])


def shape_of_distances(lengths: Lengths, dimension: int) -> FloatArray | None:
    """Coordinates (n, dimension) up to a movement and a mirror; ``None`` where there is no shape, or more than one."""
    unknowns = lengths.count * dimension - dimension * (dimension + 1) // 2
    if len(lengths.value) < unknowns:
        return None
    size = float(np.mean(lengths.value))
    scaled = Lengths(lengths.count, lengths.start, lengths.end, lengths.value / size, lengths.sigma / size)
    shapes = _shapes(scaled, dimension)
    if not shapes:
        return None
    best, shape = min(shapes, key=lambda one: one[0])
    rivals = [other for misfit, other in shapes if misfit < max(PRECISE * best, PRECISE)]
    if any(_different(shape, other) for other in rivals) or not _stiff(scaled, shape, unknowns):
        return None
    return size * shape


def _shapes(lengths: Lengths, dimension: int) -> list[tuple[float, FloatArray]]:
    """Shapes that fit, with the root mean squares of their residuals in units of σ."""
    draw = np.random.default_rng(1)
    shapes: list[tuple[float, FloatArray]] = []
    for number in range(BEGINNINGS):
        random = draw.standard_normal((lengths.count, dimension + _EXTRA))
        found = _pressed(lengths, random if number else _scaling(lengths, dimension + _EXTRA), dimension)
        off = _residuals(lengths, found)
        if np.sqrt(np.mean(off**2)) < FITS:
            shapes.append((float(np.sqrt(np.mean((off / np.maximum(lengths.sigma, 1e-9)) ** 2))), found))
        if sum(misfit < PRECISE for misfit, _ in shapes) == AGREEING or (
            number == BEGINNINGS // 3 and not shapes
        ):
            break
    return shapes


def _scaling(lengths: Lengths, dimension: int) -> FloatArray:
    """Classical scaling of the lengths of the shortest paths."""
    graph = scipy.sparse.csr_array(
        (lengths.value, (lengths.start, lengths.end)), shape=(lengths.count, lengths.count)
    )
    square = shortest_path(graph, directed=False) ** 2
    centred = square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean()
    values, vectors = tolerant.eigh(-0.5 * centred)
    largest: FloatArray = vectors[:, -dimension:] * np.sqrt(np.maximum(values[-dimension:], 0.0))
    return largest[:, ::-1]


def _pressed(lengths: Lengths, points: FloatArray, dimension: int) -> FloatArray:
    """Minimal stress in more dimensions, then with ever heavier weight on those too many, then without them."""
    for pressure in _PRESSURES:
        points = _minimal_stress(lengths, points, dimension, pressure)
    centred = points - points.mean(axis=0)
    return _minimal_stress(lengths, centred[:, :dimension], dimension, 0.0)


def _residuals(lengths: Lengths, points: FloatArray) -> FloatArray:
    off: FloatArray = np.linalg.norm(points[lengths.end] - points[lengths.start], axis=1) - lengths.value
    return off


def _minimal_stress(lengths: Lengths, points: FloatArray, dimension: int, pressure: float) -> FloatArray:
    damping = 1e-2
    cost = _cost(lengths, points, dimension, pressure)
    for _ in range(_STEPS):
        n, d = points.shape
        towards = points[lengths.end] - points[lengths.start]
        span = np.maximum(np.linalg.norm(towards, axis=1), 1e-12)
        A = _derivatives(lengths, towards / span[:, None])
        weight = np.tile(np.where(np.arange(d) >= dimension, pressure, 0.0), n)
        N = A.T @ A + np.diag(weight)
        gradient = A.T @ (span - lengths.value) + weight * points.ravel()
        while True:
            step = tolerant.solve(N + damping * np.eye(n * d), gradient).reshape(n, d)
            trial = _cost(lengths, points - step, dimension, pressure)
            if trial < cost or damping > 1e6:
                break
            damping *= 4.0
        if not trial < cost:
            return points
        settled = cost - trial < 1e-10 * cost
        points, cost, damping = points - step, trial, max(damping / 5.0, 1e-9)
        if settled:
            break
    return points


def _cost(lengths: Lengths, points: FloatArray, dimension: int, pressure: float) -> float:
    return float(np.sum(_residuals(lengths, points) ** 2) + pressure * np.sum(points[:, dimension:] ** 2))


def _derivatives(lengths: Lengths, towards: FloatArray) -> FloatArray:
    """(m, n·d) rows of the distances: ``towards`` (m, d) at their ends, the opposite at their starts."""
    rows, d = np.arange(len(towards)), towards.shape[1]
    A = np.zeros((len(towards), lengths.count, d))
    A[rows, lengths.end], A[rows, lengths.start] = towards, -towards
    return A.reshape(len(towards), lengths.count * d)


def _different(one: FloatArray, other: FloatArray) -> bool:
    """True where the distances between all points differ: neither movements nor mirrors change them."""
    apart = [np.linalg.norm(shape[:, None] - shape[None], axis=2) for shape in (one, other)]
    return bool(np.sqrt(np.mean((apart[0] - apart[1]) ** 2)) > SAME)


def _stiff(lengths: Lengths, points: FloatArray, unknowns: int) -> bool:
    """True where no point can move while all distances stay."""
    A = _derivatives(lengths, points[lengths.end] - points[lengths.start])
    values = tolerant.singular_values(A)
    return bool(values[unknowns - 1] > FLEXIBLE * values[0])


def core_of(lengths: Lengths, links: int, most: int) -> IntArray:
    """Points (k,) of which each has distances to ``links`` others or more; of many ``most`` that hang together best."""
    neighbours: list[set[int]] = [set() for _ in range(lengths.count)]
    for a, b in zip(lengths.start.tolist(), lengths.end.tolist(), strict=True):
        neighbours[a].add(b)
        neighbours[b].add(a)
    alive = _linked(neighbours, {k for k in range(lengths.count) if neighbours[k]}, links)
    chosen: set[int] = set()
    while alive - chosen and len(chosen) < most:
        best = max(
            sorted(alive - chosen), key=lambda k: (len(neighbours[k] & chosen), len(neighbours[k] & alive))
        )
        if chosen and not neighbours[best] & chosen:
            break
        chosen.add(best)
    return np.array(sorted(_linked(neighbours, chosen, links)), dtype=np.int64)


def _linked(neighbours: list[set[int]], among: set[int], links: int) -> set[int]:
    """What is left when points with fewer than ``links`` neighbours are taken out, one after the other."""
    while True:
        loose = {k for k in among if len(neighbours[k] & among) < links}
        if not loose:
            return among
        among = among - loose
