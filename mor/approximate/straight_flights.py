"""Trajectories nobody has observed, from rays to points that are known: as if the flight had been straight and steady.

    X0(t) = X_m + V (t − t_m)        D(t) = D

Where attitudes are known, X_m and V follow from linear equations: points lie on their rays. Where positions are known,
D is the rotation that fits best to the directions of the points (Kabsch 1976). Where neither is, the camera is taken to
look down: in plan the points are then at X_m + V t + s R(κ) (x, y), which is linear in X_m, V, s cos κ and s sin κ; D
and V are improved from there, with attitudes near the level. The adjustment bends the flight to what it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix, exponential

_LEAST_SIGHTS = 3
_LEAST_SINGULAR = 1e-6
"""Part of the largest singular value, columns of one size, at which equations leave something open."""
_SWAY, _TILT, _CLIMB = 0.01, 0.05, 0.05
"""σ in radians of a ray, for a flight sways, and of tilts; σ of the climb as a part of the speed."""
_FITS = 0.1
"""Radians (rms) by which rays may pass their points."""
_ROUNDS = 8


class Sights(NamedTuple):
    """n points that are known, as they are seen from a flight."""

    time: FloatArray
    """(n,)"""
    ray: FloatArray
    """(n, 3) unit, in the axes of the camera, scene at z < 0."""
    point: FloatArray
    """(n, 3)"""


class Flight(NamedTuple):
    """A straight and steady flight; what was known stays as it was."""

    middle: float
    place: FloatArray
    velocity: FloatArray
    rotation: FloatArray

    def positions(self, times: FloatArray) -> FloatArray:
        """X0 (n, 3) at times (n,)."""
        places: FloatArray = self.place + (times - self.middle)[:, None] * self.velocity
        return places


def positions_of(sights: Sights, rotations: FloatArray) -> Flight | None:
    """The flight whose attitudes (n, 3, 3) at the sights are known; ``None`` where these leave it open."""
    middle = float(sights.time.mean())
    across = cross_matrix(np.einsum("nji,nj->ni", rotations, sights.ray))
    since = (sights.time - middle)[:, None, None]
    design = np.concatenate([across, across * since], axis=2).reshape(-1, 6)
    nearby = sights.point - sights.point.mean(axis=0)
    found = _solved(design, np.einsum("nij,nj->ni", across, nearby).ravel())
    if found is None:
        return None
    return Flight(middle, found[:3] + sights.point.mean(axis=0), found[3:], rotations[0])


def attitude_of(sights: Sights, positions: FloatArray) -> FloatArray | None:
    """The one rotation (3, 3) of a flight whose positions (n, 3) at the sights are known; ``None`` where it is open."""
    away = sights.point - positions
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    u, size, vt = tolerant.svd(sights.ray.T @ away)
    if not size[1] > _LEAST_SINGULAR * size[0]:
        return None
    D: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return D if _rms(sights.ray - away @ D.T) < _FITS else None


def level_flight(sights: Sights) -> Flight | None:
    """The flight of a camera that looks down, more or less; ``None`` where the points leave it open or do not fit."""
    start = _in_plan(sights)
    return None if start is None else _tilted(sights, start)


def _in_plan(sights: Sights) -> Flight | None:
    """A level flight; the height above each point is that above all of them, and what it lies higher or lower."""
    down = -sights.ray[:, 2]
    if len(down) < _LEAST_SIGHTS or not (down > 0.0).all():
        return None
    middle, centre = float(sights.time.mean()), sights.point.mean(axis=0)
    one, since = np.ones(len(down)), sights.time - middle
    nothing, relative = np.zeros(len(down)), sights.point - centre
    right, height = relative[:, :2].T.ravel(), np.inf
    found = None
    for _ in range(3):
        x, y = sights.ray[:, :2].T / down * (1.0 - relative[:, 2] / height)
        east = np.stack([one, nothing, since, nothing, x, -y], axis=1)
        north = np.stack([nothing, one, nothing, since, y, x], axis=1)
        found = _solved(np.concatenate([east, north]), right)
        if found is None:
            return None
        height = float(np.hypot(*found[4:]))
    cosine, sine = found[4:] / height  # type: ignore[index]
    D = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    place = centre + np.array([*found[:2], height])  # type: ignore[index]
    return Flight(middle, place, np.array([*found[2:4], 0.0]), D)  # type: ignore[index]


def _tilted(sights: Sights, flight: Flight) -> Flight | None:
    """Gauss and Newton's method: the rays pass their points as near as may be, tilts and climb are near 0."""
    level, climb = flight.rotation, _CLIMB * max(float(np.linalg.norm(flight.velocity)), 1e-9)
    tilt, left = np.zeros(3), np.inf
    place, velocity = flight.place, flight.velocity
    for _ in range(_ROUNDS):
        D = exponential(-tilt[None])[0] @ level
        since = sights.time - flight.middle
        q = (sights.point - place - since[:, None] * velocity) @ D.T
        depth = -q[:, 2]
        if not (depth > 0.0).all():
            return None
        wrong = q[:, :2] / depth[:, None] + sights.ray[:, :2] / sights.ray[:, 2:]
        by_q = np.zeros((len(q), 2, 3))
        by_q[:, 0, 0] = by_q[:, 1, 1] = 1.0 / depth
        by_q[:, :, 2] = q[:, :2] / depth[:, None] ** 2
        by_place = -by_q @ D
        design = np.concatenate([by_place, by_place * since[:, None, None], by_q @ cross_matrix(q)], axis=2)
        known = np.zeros((3, 9))
        known[0, 6], known[1, 7], known[2, 5] = 1.0 / _TILT, 1.0 / _TILT, 1.0 / climb
        rows = np.concatenate([design.reshape(-1, 9) / _SWAY, known])
        misses = np.concatenate([-wrong.ravel() / _SWAY, -tilt[:2] / _TILT, [-velocity[2] / climb]])
        step = _solved(rows, misses)
        if step is None:
            return None
        place, velocity, tilt = place + step[:3], velocity + step[3:6], tilt + step[6:]
        left = _rms(wrong)
    found = Flight(flight.middle, place, velocity, exponential(-tilt[None])[0] @ level)
    return found if left < _FITS else None


def _solved(design: FloatArray, right: FloatArray) -> FloatArray | None:
    """Least squares; ``None`` where something is left open."""
    size = np.linalg.norm(design, axis=0)
    if not (np.isfinite(design).all() and (size > 0.0).all()):
        return None
    values = tolerant.singular_values(design / size)
    if len(design) < len(size) or not values[-1] > _LEAST_SINGULAR * values[0]:
        return None
    solution: FloatArray = tolerant.lstsq(design / size, right, rcond=_LEAST_SINGULAR) / size
    return solution


def _rms(wrong: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(wrong * wrong, axis=1))))
