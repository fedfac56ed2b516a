"""Three bundles of directions in the plane that see the same points, and nothing else of each other.

Two bundles in a plane always meet. Three lines through S_a, S_b, S_c with bearings t_a, t_b, t_c have a common point
where Σ sin(t_j − t_k) n_i · S_i = 0 over the cyclic (i, j, k), n = (cos t, −sin t): linear in the stations where the
orientations are known. So the two orientations relative to the first bundle are searched for over the half circle,
the stations are the null vector, and both are refined with all rays. A bundle turned by half a circle has the same
lines: the points are in front of it in one of the two cases. Three bundles in the plane leave two shapes (Åström and
Oskarsson 2000, "Solutions and ambiguities of the structure and motion problem for 1D retinal vision"), which only a
fourth one, or a point behind a station, tells apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant

STEPS = 60
"""Orientations over the half circle of either bundle that the search begins with."""
KEPT = 12
"""Minima of the search that are refined."""
SAME = 1e-3
"""Radians between orientations that are the same."""


class PlanShape(NamedTuple):
    """Stations (3, 2) with the first at the origin, κ (3,) with r = t + κ and 0 for the first, points (n, 2)."""

    stations: FloatArray
    kappas: FloatArray
    points: FloatArray
    misfit: float
    """√ of the mean square of the angles by which the rays pass by the points, radians, per redundant ray."""


def three_bundles(directions: FloatArray) -> list[PlanShape]:
    """Shapes that fit the directions (3, n ≥ 6) of the same points, clockwise in radians, the best first.

    Only those with every point in front of every station. The farther of the other two stations is at the distance 1.
    """
    r = np.asarray(directions, dtype=float)
    grid = (np.arange(STEPS) + 0.5) * np.pi / STEPS
    b, c = np.meshgrid(grid, grid, indexing="ij")
    values, vectors = tolerant.eigh(_normals(r, b, c))
    least = values[..., 0]
    beside = [np.roll(least, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    minima = np.argwhere(least <= np.min(beside, axis=0))
    best = minima[np.argsort(least[tuple(minima.T)])][:KEPT]
    shapes: list[PlanShape] = []
    for i, j in best:
        shape = _refined(r, np.array([0.0, b[i, j], c[i, j]]), vectors[i, j, :, 0])
        if shape is not None and not any(_alike(shape, other) for other in shapes):
            shapes.append(shape)
    return sorted(shapes, key=lambda shape: shape.misfit)


def _normals(r: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(…, 4, 4) of the condition of every point, by S_b and S_c."""
    t = [np.broadcast_to(r[0], (*b.shape, r.shape[1])), r[1] - b[..., None], r[2] - c[..., None]]
    rows = np.concatenate(
        [
            np.sin(t[j] - t[k])[..., None] * np.stack([np.cos(t[i]), -np.sin(t[i])], axis=-1)
            for i, j, k in ((1, 2, 0), (2, 0, 1))
        ],
        axis=-1,
    )
    return np.asarray(np.swapaxes(rows, -1, -2) @ rows)


def _refined(r: FloatArray, kappas: FloatArray, places: FloatArray) -> PlanShape | None:
    """The nearest minimum of the angles; ``None`` where some points are in front of a station and some are behind."""
    from scipy.optimize import least_squares  # hardly any network needs it

    def passed_by(x: FloatArray) -> FloatArray:
        stations, t = np.append([0.0, 0.0], x[2:]).reshape(3, 2), r - np.append(0.0, x[:2])[:, None]
        towards = _intersected(stations, t) - stations[:, None]
        across = towards[..., 0] * np.cos(t) - towards[..., 1] * np.sin(t)
        return np.append((across / np.linalg.norm(towards, axis=2)).ravel(), x[2:] @ x[2:] - 1.0)

    found = least_squares(passed_by, np.append(kappas[1:], places), x_scale="jac", max_nfev=60)
    kappas, stations = np.append(0.0, found.x[:2]), np.append([0.0, 0.0], found.x[2:]).reshape(3, 2)
    t = r - kappas[:, None]
    points = _intersected(stations, t)
    towards = points - stations[:, None]
    ahead = np.sign(towards[..., 0] * np.sin(t) + towards[..., 1] * np.cos(t))
    if not np.all(ahead == ahead[:, :1]):
        return None
    # Ahead of the first by the sign of the whole, of the others by half a turn of theirs.
    size = float(ahead[0, 0] * np.linalg.norm(stations, axis=1).max())
    kappas = (kappas + np.where(ahead[:, 0] == ahead[0, 0], 0.0, np.pi)) % (2.0 * np.pi)
    misfit = float(np.sqrt(2.0 * found.cost / (r.shape[1] - 5)))
    return PlanShape(stations / size, kappas, points / size, misfit)


def _intersected(stations: FloatArray, t: FloatArray) -> FloatArray:
    """Points (n, 2) nearest to the lines through the stations (m, 2) with bearings t (m, n)."""
    normals = np.stack([np.cos(t), -np.sin(t)], axis=-1)
    matrix = np.einsum("mni,mnj->nij", normals, normals)
    right = np.einsum("mni,mnk,mk->ni", normals, normals, stations)
    return np.asarray(tolerant.solve(matrix, right[..., None])[..., 0])


def _alike(one: PlanShape, other: PlanShape) -> bool:
    return bool(np.abs(np.exp(1j * one.kappas) - np.exp(1j * other.kappas)).max() < SAME)
