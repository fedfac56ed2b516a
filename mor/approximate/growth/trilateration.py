"""Parts of distances alone: they begin with a shape in plan or in space, and grow from point to point.

Distances cannot tell a shape from its mirrored one: such a part is not ``handed`` until it has joined another.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.distances import Distances
from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.approximate.terrestrial.distance_network import Lengths, core_of, shape_of_distances
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant

SIZES = (40, 20, 10)
"""Points, at the most, of which a shape is looked for; the others grow from it."""
AGREES = 0.01
"""Misfit of a point in space, in parts of its mean distance, up to which it is taken."""
FLAT = 0.02
"""Extension of known points across their plane, relative to that along it, from which they tell the side."""


def seed_distances(scene: Scene, system: Part, known: BoolArray, tried: set[tuple[int, ...]]) -> Part | None:
    """A part of points of which one at least is not ``known`` (points,) in any part; ``tried`` remembers all tries."""
    if known[list(scene.distances[1].neighbours)].all():
        return None
    for dimension, lengths in ((2, _in_plan(scene, system)), (3, _in_space(scene))):
        for links, most in (*((dimension + 1, size) for size in SIZES), (dimension, dimension + 1)):
            core = core_of(lengths, links, most)
            key = (dimension, *core.tolist())
            if len(core) <= dimension or key in tried or known[core].all():
                continue
            tried.add(key)
            shape = shape_of_distances(lengths.among(core), dimension)
            if shape is None:
                continue
            part = empty_part(scene.points)
            part.scaled, part.handed, part.levelled = True, False, dimension == 2
            part.points[core, :dimension] = shape
            part.began = rule("distances between {count} points", count=len(core))
            part.how |= {f"point {p}": part.began for p in core.tolist()}
            return part
    return None


def _in_plan(scene: Scene, system: Part) -> Lengths:
    """Horizontal distances, measured or following from slopes with verticals or known heights."""
    distances = scene.distances[1]
    rows = [
        (a, b, distances.between(system, a, b))
        for a, others in distances.neighbours.items()
        for b in others
        if a < b
    ]
    return _lengths(scene, [row for row in rows if np.isfinite(row[2])])


def _in_space(scene: Scene) -> Lengths:
    """Slope distances between points themselves, without heights of instruments and targets."""
    slopes = scene.distances[1].slope.items()
    return _lengths(scene, [(a, b, length) for (a, b), (length, rise) in slopes if a < b and rise == 0.0])


def _lengths(scene: Scene, rows: list[tuple[int, int, float]]) -> Lengths:
    start, end = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
    value = np.array([row[2] for row in rows])
    sigma = np.array([scene.distances[1].sigma.get((a, b), 0.0) for a, b, _ in rows])
    return Lengths(scene.points, start, end, value, sigma)


def grow_distances(part: Part, distances: Distances) -> bool:
    """Points in space from four slope distances and more to known points; true where any was added."""
    if not part.scaled:
        return False
    added = False
    missing = np.asarray(np.isnan(part.points).any(axis=1))
    for point, neighbours in distances.neighbours.items():
        if not missing[point] or len(neighbours) < 4:
            continue
        slopes = _known_slopes(part, distances, point, neighbours)
        if len(slopes) < 4:
            continue
        found = multilaterated(*_spheres(part, slopes))
        if found is not None:
            part.points[point] = np.where(np.isnan(part.points[point]), found, part.points[point])
            part.how[f"point {point}"] = rule("section of {count} spheres", count=len(slopes))
            added = True
    return added


def _known_slopes(
    part: Part, distances: Distances, point: int, neighbours: set[int]
) -> list[tuple[int, float, float]]:
    """Known points around a point, the distances and the rises of instrument and target."""
    slopes = [(p, *distances.slope[p, point]) for p in sorted(neighbours) if (p, point) in distances.slope]
    return [s for s in slopes if np.isfinite(part.points[s[0]]).all() and (part.levelled or s[2] == 0.0)]


def _spheres(part: Part, slopes: list[tuple[int, float, float]]) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 3) and radii (n,)."""
    lift = np.array([[0.0, 0.0, rise] for *_, rise in slopes])
    return part.points[[p for p, *_ in slopes]] + lift, np.array([length for _, length, _ in slopes])


def multilaterated(centres: FloatArray, lengths: FloatArray) -> FloatArray | None:
    """The point (3,) at measured distances (n,) from four known ones (n, 3) or more that lie in no plane."""
    middle = centres.mean(axis=0)
    away = centres - middle
    values = tolerant.singular_values(away)
    if len(values) < 3 or values[2] < FLAT * values[0]:
        return None
    # |X|² − 2 aᵀX + |a|² = s²; the mean of all taken off each, |X|² drops out.
    square = lengths**2 - np.sum(away**2, axis=1)
    X: FloatArray = tolerant.lstsq(-2.0 * away, square - square.mean(), rcond=None)
    for _ in range(10):
        towards = X - away
        span = np.maximum(np.linalg.norm(towards, axis=1), 1e-12)
        X = X - tolerant.lstsq(towards / span[:, None], span - lengths, rcond=None)
    off = np.linalg.norm(X - away, axis=1) - lengths
    return X + middle if np.sqrt(np.mean(off**2)) < AGREES * np.mean(lengths) else None
