"""Free stationing in the plane and in space: directions and distances to known points, in any mixture.

Three directions give the station in closed form (Rückwärtsschnitt): with the known orientation turned into
the instrument, n · R (P − S) = 0 is linear and homogeneous in cos κ, sin κ and R S; its null vector is the
solution, and where it has two, the points and the station lie on one circle, the dangerous one. Two
distances give two stations (arc section), direction and distance together a congruence. Every seed is
refined with all that was measured; what then fits alike is ambiguous.
"""

from __future__ import annotations

from enum import Enum
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.approximate.similarity import congruence
from mor.approximate.terrestrial.bearings_and_arcs import arc_section
from mor.approximate.terrestrial.polar import bearing, orient
from mor.approximate.vectors import principal_rows
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant

SEED_PAIRS = 30
"""Combinations of points that seeds are taken from."""
AS_GOOD = 25.0
"""Σ (v/σ)² by which another station may be worse and still fit as well (5 σ)."""
CIRCLE = 30.0
"""σ of a direction, relative to the singular value, beyond which the station is on the dangerous circle."""


class StationOutcome(Enum):
    """What became of a free station, in words."""

    DETERMINED = "determined"
    AMBIGUOUS = "several stations fit: a further direction or distance decides"
    TOO_FEW = "too few measurements: three directions, or two distances, or both to two points"
    DANGEROUS_CIRCLE = "station and sighted points lie on one circle: directions alone do not determine it"
    DOES_NOT_FIT = "no station fits the measurements: wrong points, or a distance that reaches nowhere"

    @property
    def usable(self) -> bool:
        """True if the station, or one of several, can serve as a start value."""
        return self in (StationOutcome.DETERMINED, StationOutcome.AMBIGUOUS)


class FreeStation(NamedTuple):
    """A station with the orientation of its directions, r = t + κ."""

    outcome: StationOutcome
    position: FloatArray
    """(2,) or (3,)"""
    kappa: float
    """Not a number where no direction was observed."""
    residuals: FloatArray
    """(n, 2) direction (radians) and horizontal distance, computed minus observed; NaN where not observed."""
    sigma0: float
    """In units of the a-priori σ; not a number without redundancy."""
    alternatives: tuple[tuple[FloatArray, float], ...] = ()
    """Other positions and κ that fit as well."""


def free_station_level(
    points: FloatArray,
    directions: FloatArray,
    distances: FloatArray,
    sigma_direction: float,
    sigma_distance: float,
) -> FreeStation:
    """Station (2,) from known points (n, 2): ``directions`` (n,), horizontal ``distances`` (n,), NaN where missing."""
    points = np.asarray(points, dtype=float)
    observed = np.column_stack([directions, distances]).astype(float)
    sigma = np.array([sigma_direction, sigma_distance])
    has = np.isfinite(observed)
    count = int(np.sum(has))
    unknowns = 3 if np.any(has[:, 0]) else 2
    places, sights = _places(points[np.any(has, axis=1)]), _places(points[has[:, 0]])
    if count < unknowns or (not np.any(has[:, 1]) and sights < 3) or places < 2:
        return _no_station(StationOutcome.TOO_FEW, len(points))
    if not np.any(has[:, 1]) and _on_circle(points[has[:, 0]], observed[has[:, 0], 0], sigma_direction):
        return _no_station(StationOutcome.DANGEROUS_CIRCLE, len(points))
    refined = [_refine(points, observed, sigma, seed) for seed in _seeds(points, observed, has)]
    fitting = [one for one in refined if one is not None]
    if not fitting:
        return _no_station(StationOutcome.DOES_NOT_FIT, len(points))
    return _judged(points, observed, sigma, fitting, count - unknowns)


def resect_directions(points: FloatArray, directions: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Station (2,) and κ from n ≥ 3 directions in closed form, and the singular values (4,) of its system.

    Points are taken relative to their centre and size, so that the third singular value measures the distance
    from the dangerous circle.
    """
    centre = points.mean(axis=0)
    size = float(np.max(np.linalg.norm(points - centre, axis=1)))
    x, y = ((points - centre) / size).T
    sine, cosine = np.sin(directions), np.cos(directions)
    # Across the direction r in the instrument: (cos r, −sin r); R turns object into instrument axes by κ.
    rows = np.column_stack([cosine * x - sine * y, cosine * y + sine * x, -cosine, sine])
    padded, right = principal_rows(rows)
    solution = right[3] / np.hypot(right[3, 0], right[3, 1])
    c, s, u, v = solution
    if _looking_back(x, y, directions, c, s, u, v):
        c, s, u, v = -c, -s, -u, -v
    position = centre + size * np.array([c * u - s * v, s * u + c * v])
    return position, float(np.arctan2(s, c)), padded


def _places(points: FloatArray) -> int:
    """Number of different places: a target that is sighted again tells nothing more of where the station is."""
    return len(np.unique(points, axis=0))


def _looking_back(
    x: FloatArray, y: FloatArray, directions: FloatArray, c: float, s: float, u: float, v: float
) -> bool:
    ahead = np.sin(directions) * (c * x + s * y - u) + np.cos(directions) * (c * y - s * x - v)
    return bool(np.sum(ahead > 0.0) < np.sum(ahead < 0.0))


def _on_circle(points: FloatArray, directions: FloatArray, sigma: float) -> bool:
    values = resect_directions(points, directions)[2]
    return bool(values[2] < CIRCLE * sigma + 1e-9)


def _seeds(points: FloatArray, observed: FloatArray, has: BoolArray) -> list[tuple[FloatArray, float]]:
    seeds: list[tuple[FloatArray, float]] = []
    sighted, measured = np.flatnonzero(has[:, 0]), np.flatnonzero(has[:, 1])
    both = np.flatnonzero(has[:, 0] & has[:, 1])
    if len(both) > 1:
        r, d = observed[both].T
        local = np.column_stack([d * np.sin(r), d * np.cos(r)])
        fit = congruence(points[both], local)
        if fit.outcome.usable:
            seeds.append((fit.origin, float(np.arctan2(fit.rotation[0, 1], fit.rotation[0, 0]))))
    if _places(points[sighted]) > 2:
        position, kappa, _ = resect_directions(points[sighted], observed[sighted, 0])
        seeds.append((position, kappa))
    if len(both) > 2:
        return seeds
    for i, j in list(combinations(measured, 2))[:SEED_PAIRS]:
        for position in arc_section(points[[i, j]], observed[[i, j], 1]).points:
            seeds.append((position, _kappa(points, observed, position)))
    for i in both[:SEED_PAIRS]:
        for j in sighted[sighted != i][:SEED_PAIRS]:
            seeds.extend(_side_side_angle(points, observed, int(i), int(j)))
    return seeds


def _side_side_angle(
    points: FloatArray, observed: FloatArray, i: int, j: int
) -> list[tuple[FloatArray, float]]:
    """Distance and direction to i, direction to j: the distance to j from the cosine law, up to two."""
    reach, angle = observed[i, 1], observed[j, 0] - observed[i, 0]
    side = float(np.linalg.norm(points[j] - points[i]))
    discriminant = side**2 - (reach * np.sin(angle)) ** 2
    seeds = []
    if discriminant >= 0.0:
        for sign in (1.0, -1.0):
            other = reach * np.cos(angle) + sign * np.sqrt(discriminant)
            if other > 0.0:
                r, d = observed[[i, j], 0], np.array([reach, other])
                fit = congruence(points[[i, j]], np.column_stack([d * np.sin(r), d * np.cos(r)]))
                if fit.outcome.usable:
                    seeds.append((fit.origin, float(np.arctan2(fit.rotation[0, 1], fit.rotation[0, 0]))))
    return seeds


def _kappa(points: FloatArray, observed: FloatArray, position: FloatArray) -> float:
    sighted = np.isfinite(observed[:, 0])
    return orient(position, points[sighted], observed[sighted, 0]).kappa


def _misclosure(points: FloatArray, observed: FloatArray, position: FloatArray, kappa: float) -> FloatArray:
    direction = np.angle(np.exp(1j * (bearing(position, points) + np.nan_to_num(kappa) - observed[:, 0])))
    return np.column_stack([direction, np.linalg.norm(points - position, axis=1) - observed[:, 1]])


def _refine(
    points: FloatArray, observed: FloatArray, sigma: FloatArray, seed: tuple[FloatArray, float]
) -> tuple[FloatArray, float] | None:
    position, kappa = seed
    used = np.isfinite(observed)
    for _ in range(30):
        offset = points - position
        square = np.maximum(np.sum(offset**2, axis=1), 1e-24)
        design = np.zeros((len(points), 2, 3))
        design[:, 0, 0], design[:, 0, 1], design[:, 0, 2] = -offset[:, 1] / square, offset[:, 0] / square, 1.0
        design[:, 1, :2] = -offset / np.sqrt(square)[:, None]
        misclosure = _misclosure(points, observed, position, kappa)
        rows = (design / sigma[:, None])[used]
        step = -tolerant.lstsq(rows, (misclosure / sigma)[used], rcond=1e-13)
        position, kappa = position + step[:2], kappa + step[2]
        if not np.all(np.isfinite(position)) or np.linalg.norm(step[:2]) > 1e3 * np.sqrt(np.max(square)):
            return None
        if np.linalg.norm(step[:2]) < 1e-13 * np.sqrt(np.max(square)) and abs(step[2]) < 1e-13:
            break
    return position, float(np.angle(np.exp(1j * kappa)))


def _judged(
    points: FloatArray,
    observed: FloatArray,
    sigma: FloatArray,
    fitting: list[tuple[FloatArray, float]],
    redundancy: int,
) -> FreeStation:
    def objective(one: tuple[FloatArray, float]) -> float:
        return float(np.nansum((_misclosure(points, observed, *one) / sigma) ** 2))

    ordered = sorted(fitting, key=objective)
    best = ordered[0]
    size = float(np.max(np.linalg.norm(points - best[0], axis=1)))
    limit = objective(best) + AS_GOOD * max(1.0, objective(best) / max(redundancy, 1))
    rivals: list[tuple[FloatArray, float]] = []
    for one in ordered[1:]:
        far = all(np.linalg.norm(one[0] - other[0]) > 1e-3 * size for other in (best, *rivals))
        if far and objective(one) <= limit:
            rivals.append(one)
    sigma0 = float(np.sqrt(objective(best) / redundancy)) if redundancy > 0 else float("nan")
    outcome = StationOutcome.AMBIGUOUS if rivals else StationOutcome.DETERMINED
    if (redundancy > 0 and sigma0 > 30.0) or (redundancy == 0 and objective(best) > 1.0):
        outcome = StationOutcome.DOES_NOT_FIT
    kappa = best[1] if np.any(np.isfinite(observed[:, 0])) else float("nan")
    return FreeStation(outcome, best[0], kappa, _misclosure(points, observed, *best), sigma0, tuple(rivals))


def _no_station(outcome: StationOutcome, count: int) -> FreeStation:
    return FreeStation(outcome, np.full(2, np.nan), float("nan"), np.full((count, 2), np.nan), float("nan"))
