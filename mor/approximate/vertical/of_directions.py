"""The vertical of points in any attitude from horizontal directions and vertical angles to them.

For a given vertical each set of horizontal directions is a free station in the plan, or a set to be oriented where its
place is known: a linear problem each, so that only the vertical is searched for. It is sampled over the sphere, and the
best are adjusted (Gauss-Newton, Cauchy weights). Sets of different places share it: each of n directions leaves n − 3
conditions for it, n − 1 where its place is known, a vertical angle between known points one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential

PRECISION = 2e-3
"""Radians that directions to known points are good to: distortion and constants of cameras may be unknown yet."""
FITS = 5.0 * PRECISION
"""Residual of a direction that agrees with a vertical."""
CLEAR = 9.0
"""Difference of two objectives from which on one vertical is told from another."""
APART = 0.1
"""Radians between two verticals from which on they are two."""
OPEN = 0.1
"""σ of the vertical (radians) from which on it is open."""
_SAMPLES = 600
_REFINED = 8
_STEPS = 15
_DIFFERENCE = 1e-6
_DAMPING = 1e-8
"""Added to the squares of the derivatives: a turn that nothing tells is not made."""
_REWEIGHTED = 5


class HorizontalSet(NamedTuple):
    """Horizontal directions (n,), clockwise, to points (n, 3) from a place (3,), NaN where that is not known."""

    place: FloatArray
    points: FloatArray
    directions: FloatArray


class Angles(NamedTuple):
    """Vertical angles above the horizon (n,) from points (n, 3) to points (n, 3)."""

    start: FloatArray
    end: FloatArray
    values: FloatArray


class Vertical(NamedTuple):
    """A vertical that fits, and whether another one does as well."""

    up: FloatArray
    """(3,) unit vector."""
    agreeing: int
    """Directions and angles that agree with it."""
    redundancy: int
    """Those of them that are more than it takes."""
    sigma: float
    """σ (radians) of its weaker turn, infinite where that is open."""
    alone: bool
    """False where another vertical fits alike."""


def vertical_of_directions(sets: list[HorizontalSet], angles: Angles) -> Vertical | None:
    """The vertical that most directions agree with; ``None`` where fewer are left than it takes."""
    sets = [one for one in sets if len(one.points) > _taken(one)]
    equations = sum(len(one.points) - _taken(one) for one in sets) + len(angles.values)
    if equations < 3:
        return None
    k = np.arange(_SAMPLES) + 0.5
    z, around = 1.0 - 2.0 * k / _SAMPLES, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - z**2)
    ups = np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)
    order = np.argsort(_objectives(_residuals(ups, sets, angles), 10.0 * PRECISION), kind="stable")
    objectives, ups = _refined(ups[order[:_REFINED]], sets, angles)
    order = np.argsort(objectives, kind="stable")
    return _judged(objectives[order], ups[order], sets, angles)


def _taken(one: HorizontalSet) -> int:
    """Directions that orienting a set takes, and placing it where its place is not known."""
    return 1 if np.isfinite(one.place).all() else 3


def _judged(
    objectives: FloatArray, ups: FloatArray, sets: list[HorizontalSet], angles: Angles
) -> Vertical | None:
    """The first of verticals (k, 3), with objectives (k,) in ascending order."""
    up = ups[0]
    residuals = _residuals(ups[:1], sets, angles)
    agrees = np.abs(residuals[0]) < FITS
    agreeing = int(np.count_nonzero(agrees))
    redundancy = agreeing - sum(_taken(one) for one in sets) - 2
    others = ups[1:][objectives[1:] < objectives[0] + CLEAR]
    alone = all(np.linalg.norm(np.cross(other, up)) < APART and other @ up > 0.0 for other in others)
    rows = _derivatives(ups[:1], sets, angles, residuals)[0][agrees]
    least = float(tolerant.singular_values(rows)[-1]) if len(rows) > 1 else 0.0
    sigma = PRECISION / least if least > 0.0 else np.inf
    return Vertical(up, agreeing, redundancy, sigma, alone) if redundancy >= 0 else None


def _refined(ups: FloatArray, sets: list[HorizontalSet], angles: Angles) -> tuple[FloatArray, FloatArray]:
    """Objectives (k,) and verticals (k, 3) at the minima near verticals; residuals that are large count less."""
    residuals = _residuals(ups, sets, angles)
    for step in range(_STEPS):
        width = max(PRECISION, 10.0 * PRECISION * 0.5**step)
        root = 1.0 / np.hypot(1.0, residuals / width)
        rows = _derivatives(ups, sets, angles, residuals) * root[..., None]
        matrix = np.swapaxes(rows, 1, 2) @ rows + _DAMPING * np.eye(2)
        turns = -tolerant.solve(matrix, np.swapaxes(rows, 1, 2) @ (root * residuals)[..., None])[..., 0]
        ups = _tilted(ups, np.clip(turns, -0.2, 0.2))
        residuals = _residuals(ups, sets, angles)
        if width == PRECISION and float(np.abs(turns).max()) < 1e-9:
            break
    return _objectives(residuals, PRECISION), ups


def _derivatives(
    ups: FloatArray, sets: list[HorizontalSet], angles: Angles, residuals: FloatArray
) -> FloatArray:
    """(k, n, 2) of the residuals (k, n) by the two tilts of verticals (k, 3)."""
    there = np.concatenate([_tilted(ups, np.tile(step, (len(ups), 1))) for step in _DIFFERENCE * np.eye(2)])
    change = _residuals(there, sets, angles).reshape(2, *residuals.shape) - residuals
    return np.moveaxis(_wrapped(change), 0, 2) / _DIFFERENCE


def _tilted(ups: FloatArray, tilts: FloatArray) -> FloatArray:
    """Verticals (k, 3) turned by tilts (k, 2) about the axes of their plans."""
    about = np.einsum("ki,kij->kj", tilts, _plan_axes(ups))
    turned: FloatArray = np.einsum("kij,kj->ki", exponential(about), ups)
    tilted: FloatArray = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return tilted


def _plan_axes(ups: FloatArray) -> FloatArray:
    """Axes X and Y (k, 2, 3) of plans whose verticals are given (k, 3)."""
    x = np.eye(3)[np.argmin(np.abs(ups), axis=1)]
    x = x - ups * np.sum(x * ups, axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(ups, x)], axis=1)


def _objectives(residuals: FloatArray, width: float) -> FloatArray:
    """(k,) sums of log(1 + (v/s)²)."""
    return np.asarray(np.log1p(np.square(residuals / width)).sum(axis=1))


def _residuals(ups: FloatArray, sets: list[HorizontalSet], angles: Angles) -> FloatArray:
    """(k, n) angular residuals of all sets and vertical angles for verticals (k, 3)."""
    axes = _plan_axes(ups)
    found = [np.zeros((len(ups), 0))]
    for one in sets:
        plan = one.points @ np.swapaxes(axes, 1, 2)
        place = np.nan_to_num(one.place) @ np.swapaxes(axes, 1, 2)
        if not np.isfinite(one.place).all():
            place = _robust_stations(plan, one.directions)
        away = plan - place[:, None, :]
        off = np.arctan2(away[..., 0], away[..., 1]) - one.directions
        centre = _middle(off)
        found.append(_wrapped(off - centre[:, None]))
    line = angles.end - angles.start
    length = np.maximum(np.linalg.norm(line, axis=1), 1e-300)
    sines = np.clip(ups @ line.T / length, -1.0, 1.0)
    return np.concatenate([*found, np.arcsin(sines) - angles.values], axis=1)


def _robust_stations(plan: FloatArray, directions: FloatArray) -> FloatArray:
    """Stations (k, 2) from directions (n,) to points (k, n, 2); of few plans, those that pass far by count less."""
    weight = np.ones(plan.shape[:2])
    place = _stations(plan, directions, weight)
    for _ in range(_REWEIGHTED if len(plan) < _SAMPLES else 0):
        away = plan - place[:, None, :]
        off = np.arctan2(away[..., 0], away[..., 1]) - directions
        off = _wrapped(off - _middle(off)[:, None])
        weight = (
            1.0 / np.hypot(1.0, off / (2.0 * PRECISION)) / np.maximum(np.linalg.norm(away, axis=2), 1e-300)
        )
        place = _stations(plan, directions, weight)
    return place


def _stations(plan: FloatArray, directions: FloatArray, weight: FloatArray) -> FloatArray:
    """Stations (k, 2) in closed form, directions with weights (k, n)."""
    centre = plan.mean(axis=1, keepdims=True)
    size = np.maximum(np.linalg.norm(plan - centre, axis=2).max(axis=1), 1e-300)[:, None, None]
    x, y = np.moveaxis((plan - centre) / size, 2, 0)
    sine, cosine = np.sin(directions), np.cos(directions)
    rows = np.stack(
        [
            cosine * x - sine * y,
            cosine * y + sine * x,
            np.broadcast_to(-cosine, x.shape),
            np.broadcast_to(sine, x.shape),
        ],
        axis=2,
    )
    rows = rows * weight[..., None] / weight.max(axis=1)[:, None, None]
    c, s, u, v = tolerant.svd(rows, full_matrices=len(directions) < 4)[2][:, 3].T
    scale = np.maximum(np.square(c) + np.square(s), 1e-300)
    position = np.stack([(c * u - s * v) / scale, (s * u + c * v) / scale], axis=1)
    return np.asarray(centre[:, 0] + size[:, 0] * position)


def _middle(off: FloatArray) -> FloatArray:
    """(k,) the angle that is nearest to most angles of each row."""
    between = np.abs(_wrapped(off[:, :, None] - off[:, None, :]))
    best = np.argmin(np.log1p(np.square(between / PRECISION)).sum(axis=2), axis=1)
    centre = off[np.arange(len(off)), best]
    near = _wrapped(off - centre[:, None])
    weight = 1.0 / (1.0 + np.square(near / PRECISION))
    return np.asarray(centre + np.sum(weight * near, axis=1) / np.sum(weight, axis=1))


def _wrapped(angles: FloatArray) -> FloatArray:
    folded: FloatArray = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
    return folded


__all__ = ["Angles", "HorizontalSet", "Vertical", "vertical_of_directions"]
