"""Intersection of rays."""

from __future__ import annotations

from enum import Enum
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model import rotations as tolerant
from mor.start.bundle import Bundle, ahead, reproject, unit
from mor.start.part import Sightings, loosened
from mor.types import BoolArray, FloatArray, IntArray

# ---- Spatial intersection: a point from its rays in frames of known position and attitude.

PARALLEL = 3.0
"""Rays are parallel if the distance along them is not known to a part of one in so many."""


class IntersectionOutcome(Enum):
    """Outcome of an intersection."""

    DETERMINED = "the rays meet in front of their frames"
    TOO_FEW = "fewer than two rays"
    PARALLEL = "the rays are nearly parallel: the distance of their intersection is undetermined"
    BEHIND = "the rays meet behind a frame"
    DOES_NOT_MEET = "the rays do not meet within their precision"

    @property
    def usable(self) -> bool:
        """True if the point can serve as a start value."""
        return self is IntersectionOutcome.DETERMINED


class Intersection(NamedTuple):
    """A point and how well its rays determine it."""

    outcome: IntersectionOutcome
    point: FloatArray
    """(3,); of parallel rays not a number."""
    covariance: FloatArray
    """(3, 3) for the a-priori σ of the rays."""
    sigma0: float
    """√(Σ (v/σ)² / (2n − 3))."""
    residuals: FloatArray
    """(n, 2) in units of σ."""
    front: BoolArray
    """(n,)"""
    angle: float
    """Largest angle between two of the rays, in radians, at most π/2."""


def intersect(bundle: Bundle, positions: FloatArray, rotations: FloatArray) -> Intersection:
    """Intersect n ≥ 2 rays: ray i of ``bundle`` stands in the frame ``positions[i]`` (3,), ``rotations[i]``
    (3, 3).

    Closed form: the point of least Σ |distance from ray|², weighted by (distance of the frame)⁻²; then Gauss–
    Newton on the measured coordinates. The covariance follows from the latter.
    """
    if len(bundle) < 2:
        return _failed(IntersectionOutcome.TOO_FEW, len(bundle))
    rays = unit(np.einsum("nij,ni->nj", rotations, bundle.rays))
    angle = float(np.arcsin(min(1.0, np.max(np.linalg.norm(np.cross(rays[:, None], rays[None]), axis=-1)))))
    if angle < PARALLEL * bundle.noise:
        return _failed(IntersectionOutcome.PARALLEL, len(bundle), angle)
    point = nearest_point(positions, rays)
    for _ in range(10):
        star = np.einsum("nij,nj->ni", rotations, point - positions)
        computed = reproject(bundle, star)
        design = (computed.by_star @ rotations).reshape(-1, 3)
        step = -tolerant.lstsq(design, computed.residuals.ravel(), rcond=None)
        point = point + step
        if not np.all(np.isfinite(point)) or np.linalg.norm(step) < 1e-13 * np.max(np.abs(point - positions)):
            break
    return _judged(bundle, positions, rotations, point, angle)


def nearest_point(positions: FloatArray, directions: FloatArray) -> FloatArray:
    """Point (3,) nearest to n lines through ``positions`` (n, 3) along unit ``directions`` (n, 3).

    Solved twice: the second time every distance counts by the range at which it is seen. Raises nothing;
    parallel lines give the solution of least norm relative to the mean position.
    """
    centre = positions.mean(axis=0)
    weights = np.ones(len(positions))
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point = centre
    for _ in range(2):
        normal = np.einsum("n,nij->ij", weights, across)
        side = np.einsum("n,nij,nj->i", weights, across, positions - centre)
        point = centre + tolerant.lstsq(normal, side, rcond=1e-15)
        ranges = np.linalg.norm(point - positions, axis=1)
        if not ranges.any():
            break  # all lines come from one place
        weights = 1.0 / np.maximum(ranges, 1e-9 * (np.max(ranges) + 1e-300)) ** 2
    return np.asarray(point)


def _judged(
    bundle: Bundle, positions: FloatArray, rotations: FloatArray, point: FloatArray, angle: float
) -> Intersection:
    star = np.einsum("nij,nj->ni", rotations, point - positions)
    computed = reproject(bundle, star)
    design = (computed.by_star @ rotations).reshape(-1, 3)
    values, axes = tolerant.eigh(design.T @ design)
    residuals = computed.residuals
    sigma0 = float(np.sqrt(np.sum(residuals**2) / (2 * len(bundle) - 3)))
    front = ahead(bundle, star)
    distance = float(np.min(np.linalg.norm(star, axis=1)))
    if not np.all(np.isfinite(point)) or values[0] * distance**2 < PARALLEL**2:
        return _failed(IntersectionOutcome.PARALLEL, len(bundle), angle)
    outcome = IntersectionOutcome.DETERMINED
    # σ0 beyond which the rays do not meet.
    if sigma0 > 5.0:
        outcome = IntersectionOutcome.DOES_NOT_MEET
    elif not np.all(front):
        outcome = IntersectionOutcome.BEHIND
    return Intersection(outcome, point, (axes / values) @ axes.T, sigma0, residuals, front, angle)


def _failed(outcome: IntersectionOutcome, rays: int, angle: float = 0.0) -> Intersection:
    nothing = np.full((rays, 2), np.nan)
    front = np.zeros(rays, dtype=bool)
    return Intersection(outcome, np.full(3, np.nan), np.full((3, 3), np.nan), np.nan, nothing, front, angle)


# ---- Many points at once by the rays of posed frames that see them; rays that pass by are taken out.

SMALLEST_ANGLE = 0.02
"""Radians at which two rays must meet at least for an intersection to be of use."""
PAIRED = 16
"""Rays of a point that are put together in pairs."""


class PosedFrames(NamedTuple):
    """Poses of all frames, as far as they are known."""

    centres: FloatArray
    """(frames, 3) projection centres, NaN where there is no pose."""
    turns: FloatArray
    """(frames, 3, 3) rotations D."""


class Meetings(NamedTuple):
    """Intersections of the rays to some points."""

    X: FloatArray
    """(m, 3), not a number where they do not."""
    good: BoolArray
    """(m,) two rays or more meet, at an angle of use, in front of their frames."""


def posed_frames(poses: dict[int, tuple[FloatArray, FloatArray]], count: int) -> PosedFrames:
    """Arrays over all ``count`` frames of the poses by frame number."""
    posed = PosedFrames(np.full((count, 3), np.nan), np.zeros((count, 3, 3)))
    for number, (centre, D) in poses.items():
        posed.centres[number], posed.turns[number] = centre, D
    return posed


def meet(
    points: IntArray,
    seen: Sightings,
    posed: PosedFrames,
    slack: float,
    smallest: float = SMALLEST_ANGLE,
    rounds: int = 3,
) -> Meetings:
    """Intersect ``points`` (m,) by all rays from posed frames.

    Rays count as passing by beyond three times their σ, ``slack`` radians added; ``smallest`` is the least angle at
    which rays must meet. Closed form: the point of least sum of squared distances from the rays, each of them lowered
    by the height of its target; in ``rounds`` rays that pass by are taken out, or back in. A wrong ray may draw it away
    from all of them: where less than half agree, those do that most pairs are for.
    """
    rays = seen.of_points(points)
    point = np.repeat(np.arange(len(points)), seen.pointers[points + 1] - seen.pointers[points])
    known = np.isfinite(posed.centres[seen.frame[rays], 0])
    rays, point = rays[known], point[known]
    frame = seen.frame[rays]
    centre, direction = posed.centres[frame], np.einsum("ni,nij->nj", seen.rays[rays], posed.turns[frame])
    centre[:, 2] -= seen.height[rays]
    lines = _Lines(point, centre, direction, 3.0 * loosened(seen.sigma[rays], slack))
    X, good, use = _meet_in_rounds(lines, np.ones(len(rays), dtype=bool), len(points), smallest, rounds)
    of_all, agreeing = np.bincount(point, minlength=len(points)), np.bincount(point[use], minlength=len(points))
    for number in np.flatnonzero((2 * agreeing < of_all) & (of_all > 2)).tolist() if rounds > 1 else ():
        rows = np.flatnonzero(point == number)
        own = lines.take(rows)._replace(point=np.zeros(len(rows), dtype=np.int64))
        begin = _likelier_pair(own, int(agreeing[number]), smallest)
        if begin is not None:
            X[[number]], good[[number]], use[rows] = _meet_in_rounds(own, begin, 1, smallest, rounds)
    return Meetings(X, good & (np.bincount(point[use], minlength=len(points)) >= 2))


class _Lines(NamedTuple):
    """Rays in space."""

    point: IntArray
    """(n,) number of the point each sees."""
    centre: FloatArray
    direction: FloatArray
    limit: FloatArray
    """(n,) what they may pass by at, as the difference of unit vectors."""

    def take(self, rows: IntArray | BoolArray) -> _Lines:
        return _Lines._make(array[rows] for array in self)

    def agree(self, X: FloatArray) -> BoolArray:
        """(…, n) true where they go to ``X`` (…, n, 3)."""
        away = X - self.centre
        with np.errstate(invalid="ignore", divide="ignore"):
            off = away / np.linalg.norm(away, axis=-1)[..., None] - self.direction
            return np.asarray(np.linalg.norm(off, axis=-1) < self.limit)


def _meet_in_rounds(
    lines: _Lines, use: BoolArray, count: int, smallest: float, rounds: int
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Places (count, 3) nearest to the rays in use, whether they are good, and the rays (n,) in use at last."""
    X, good, use = np.full((count, 3), np.nan), np.zeros(count, dtype=bool), use.copy()
    changed = np.ones(count, dtype=bool)
    for _ in range(rounds):
        rows = np.flatnonzero(changed[lines.point])
        here = lines.take(rows)
        there, are_good = _nearest(here.take(use[rows]), count, smallest)
        X[changed], good[changed] = there[changed], are_good[changed]
        agree = good[here.point] & here.agree(X[here.point])
        changed = np.bincount(here.point[agree != use[rows]], minlength=count) > 0
        use[rows] = agree
        if not changed.any():
            break
    return X, good, use


def _likelier_pair(lines: _Lines, agreeing: int, smallest: float) -> BoolArray | None:
    """The two rays (n,) to one point on whose meeting more rays agree than on that of all; ``None`` without such two.

    Two with which no third one agrees must be the only ones that meet.
    """
    count = len(lines.point)
    pairs = np.array(list(combinations(range(min(count, PAIRED)), 2)))
    of_pairs = lines.take(pairs.ravel())._replace(point=np.repeat(np.arange(len(pairs)), 2))
    X, good = _nearest(of_pairs, len(pairs), smallest)
    votes = np.where(good, np.count_nonzero(lines.agree(X[:, None]), axis=1), 0)
    most = int(votes.max())
    if most <= max(agreeing, 1) or (most == 2 and np.count_nonzero(votes == most) > 1):
        return None
    return np.isin(np.arange(count), pairs[np.argmax(votes)])


def _nearest(lines: _Lines, count: int, smallest: float) -> tuple[FloatArray, BoolArray]:
    """Points (count, 3) nearest to their lines, and which of them are good.

    Good are points with two rays or more that meet at an angle of at least ``smallest`` radians, in front of their
    frames.
    """
    point, centre, direction, _ = lines
    reference = centre.mean(axis=0) if len(centre) else np.zeros(3)
    along = np.einsum("ni,ni->n", direction, centre - reference)
    moved = centre - reference - along[:, None] * direction
    rays = np.bincount(point, minlength=count)
    normal, side = rays[:, None, None] * np.eye(3), np.zeros((count, 3, 1))
    for i in range(3):
        side[:, i, 0] = np.bincount(point, weights=moved[:, i], minlength=count)
        for j in range(i + 1):
            normal[:, i, j] -= np.bincount(point, weights=direction[:, i] * direction[:, j], minlength=count)
            normal[:, j, i] = normal[:, i, j]
    # The smallest eigenvalue of Σ (I − ddᵀ) is about the sum of squared angles between the rays and their mean.
    good = (rays >= 2) & (rotations.eigvalsh(normal)[:, 0] > 0.5 * smallest**2)
    X = np.full((count, 3), np.nan)
    X[good] = rotations.solve(normal[good], side[good])[:, :, 0] + reference
    behind = np.bincount(point, weights=~(np.einsum("ni,ni->n", X[point] - centre, direction) > 0.0), minlength=count)
    return X, good & (behind < 0.5 * rays)
