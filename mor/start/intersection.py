"""Intersection of rays."""

from __future__ import annotations

from enum import Enum
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.linalg import compilation
from mor.linalg.compilation import compile_kernel
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


# ---- Where rays meet, point after point: the same steps as ``meet_plainly``.

PAIRED = 16
"""Rays of a point that are put together in pairs."""


@compile_kernel
def meet_kernel(
    points: IntArray,
    pointers: IntArray,
    frame: IntArray,
    rays: FloatArray,
    sigma: FloatArray,
    height: FloatArray,
    centres: FloatArray,
    turns: FloatArray,
    slack: float,
    smallest: float,
    rounds: int,
) -> tuple[FloatArray, BoolArray]:
    """Places (m, 3) of m ``points`` and which of them are good; frames without a pose have no finite centre."""
    X = np.full((len(points), 3), np.nan)
    good = np.zeros(len(points), dtype=np.bool_)
    most = 1
    for p in points:
        most = max(most, pointers[p + 1] - pointers[p])
    centre, direction = np.empty((most, 3)), np.empty((most, 3))
    limit, use = np.empty(most), np.empty(most, dtype=np.bool_)
    for m in range(len(points)):
        p = points[m]
        count = 0
        for ray in range(pointers[p], pointers[p + 1]):
            f = frame[ray]
            if not np.isfinite(centres[f, 0]):
                continue
            for j in range(3):
                centre[count, j] = centres[f, j]
                direction[count, j] = (
                    rays[ray, 0] * turns[f, 0, j] + rays[ray, 1] * turns[f, 1, j] + rays[ray, 2] * turns[f, 2, j]
                )
            centre[count, 2] -= height[ray]
            limit[count] = 3.0 * np.sqrt(sigma[ray] ** 2 + slack**2)
            use[count] = True
            count += 1
        good[m] = _meet_in_rounds(centre, direction, limit, use, count, smallest, rounds, X[m])
    return X, good


@compile_kernel
def _meet_in_rounds(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    use: BoolArray,
    count: int,
    smallest: float,
    rounds: int,
    X: FloatArray,
) -> bool:
    """Place of one point; true where two or more rays agree.

    It begins with all of them and, where less than half of them agree, with the two on whose meeting more of them do.
    """
    good = _in_rounds(centre, direction, limit, use, count, smallest, rounds, X)
    agreeing = int(np.sum(use[:count])) if good else 0
    if rounds > 1 and count > 2 and 2 * agreeing < count:
        tried, place = np.empty(count, dtype=np.bool_), np.empty(3)
        first, second = _likeliest_pair(centre, direction, limit, count, smallest, agreeing, tried, place)
        if first >= 0:
            for n in range(count):
                use[n] = n == first or n == second
            good = _in_rounds(centre, direction, limit, use, count, smallest, rounds, X)
    return good and bool(np.sum(use[:count]) >= 2)


@compile_kernel
def _in_rounds(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    use: BoolArray,
    count: int,
    smallest: float,
    rounds: int,
    X: FloatArray,
) -> bool:
    """Place nearest to the rays in use, those that pass by taken out and back in for some rounds."""
    good = False
    for _ in range(rounds):
        good = _nearest(centre, direction, use, count, smallest, X)
        changed = False
        for n in range(count):
            agrees = good and _passes(centre[n], direction[n], X) < limit[n]
            changed = changed or agrees != use[n]
            use[n] = agrees
        if not (good and changed):
            break
    return good


@compile_kernel
def _likeliest_pair(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    count: int,
    smallest: float,
    least: int,
    pair: BoolArray,
    place: FloatArray,
) -> tuple[int, int]:
    """The two rays on whose meeting most rays agree, more than ``least``; −1 where there are none.

    Two with which no third one agrees must be the only ones that meet.
    """
    first, second, most, alike = -1, -1, max(least, 1), 0
    sampled = min(count, PAIRED)
    for i in range(sampled):
        for j in range(i + 1, sampled):
            for n in range(count):
                pair[n] = n == i or n == j
            if not _nearest(centre, direction, pair, count, smallest, place):
                continue
            agreeing = 0
            for n in range(count):
                agreeing += _passes(centre[n], direction[n], place) < limit[n]
            if agreeing > most:
                first, second, most, alike = i, j, agreeing, 1
            elif agreeing == most:
                alike += 1
    if most == 2 and alike > 1:
        return -1, -1
    return first, second


@compile_kernel
def _passes(centre: FloatArray, direction: FloatArray, X: FloatArray) -> float:
    x, y, z = X[0] - centre[0], X[1] - centre[1], X[2] - centre[2]
    length = np.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return np.inf
    x, y, z = x / length - direction[0], y / length - direction[1], z / length - direction[2]
    return float(np.sqrt(x * x + y * y + z * z))


@compile_kernel
def _nearest(
    centre: FloatArray, direction: FloatArray, use: BoolArray, count: int, smallest: float, X: FloatArray
) -> bool:
    """Point nearest to the used rays, into ``X``; false where they meet at too small an angle, or behind."""
    X[:] = np.nan
    rays = 0
    a = b = c = d = e = f = 0.0
    u = v = w = 0.0
    first = -1
    for n in range(count):
        if not use[n]:
            continue
        if first < 0:
            first = n
        rays += 1
        x, y, z = direction[n]
        p, q, r = (centre[n, 0] - centre[first, 0], centre[n, 1] - centre[first, 1], centre[n, 2] - centre[first, 2])
        along = x * p + y * q + z * r
        a += 1.0 - x * x
        b -= x * y
        c -= x * z
        d += 1.0 - y * y
        e -= y * z
        f += 1.0 - z * z
        u += p - along * x
        v += q - along * y
        w += r - along * z
    # The smallest eigenvalue of Σ (I − ddᵀ) is about the sum of squared angles between the rays and their mean;
    # all eigenvalues exceed t where the pivots of the matrix less t are positive.
    t = 0.5 * smallest**2
    if rays < 2 or not _positive(a - t, b, c, d - t, e, f - t):
        return False
    k, o, m = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * k + b * o + c * m
    X[0] = centre[first, 0] + (k * u + o * v + m * w) / determinant
    X[1] = centre[first, 1] + (o * u + (a * f - c * c) * v + (b * c - a * e) * w) / determinant
    X[2] = centre[first, 2] + (m * u + (b * c - a * e) * v + (a * d - b * b) * w) / determinant
    behind = 0
    for n in range(count):
        if use[n]:
            depth = 0.0
            for j in range(3):
                depth += (X[j] - centre[n, j]) * direction[n, j]
            behind += not depth > 0.0
    return behind < 0.5 * rays


@compile_kernel
def _positive(a: float, b: float, c: float, d: float, e: float, f: float) -> bool:
    if not a > 0.0:
        return False
    second = d - b * b / a
    mixed = e - b * c / a
    if not second > 0.0:
        return False
    return f - c * c / a - mixed * mixed / second > 0.0


# ---- Many points at once by the rays of posed frames that see them; rays that pass by are taken out.

SMALLEST_ANGLE = 0.02
"""Radians at which two rays must meet at least for an intersection to be of use."""


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
    if not compilation.wanted():
        return meet_plainly(points, seen, posed, slack, smallest, rounds)
    rays = (seen.pointers, seen.frame, seen.rays, seen.sigma, seen.height)
    return Meetings(*meet_kernel(points, *rays, *posed, slack, smallest, rounds))


def meet_plainly(
    points: IntArray,
    seen: Sightings,
    posed: PosedFrames,
    slack: float,
    smallest: float = SMALLEST_ANGLE,
    rounds: int = 3,
) -> Meetings:
    """The same without a compiler: the readable form."""
    rays = seen.of_points(points)
    point = np.repeat(np.arange(len(points)), seen.pointers[points + 1] - seen.pointers[points])
    known = np.isfinite(posed.centres[seen.frame[rays], 0])
    rays, point = rays[known], point[known]
    frame = seen.frame[rays]
    centre, direction = posed.centres[frame], np.einsum("ni,nij->nj", seen.rays[rays], posed.turns[frame])
    centre[:, 2] -= seen.height[rays]
    lines = _Lines(point, centre, direction, 3.0 * loosened(seen.sigma[rays], slack))
    everything = np.ones(len(rays), dtype=bool)
    X, good, use = _forward_intersection_in_rounds(lines, everything, len(points), smallest, rounds)
    doubtful = 2 * np.bincount(point[use], minlength=len(points)) < np.bincount(point, minlength=len(points))
    begin = everything.copy()
    for number in np.flatnonzero(doubtful).tolist() if rounds > 1 else ():
        rows = np.flatnonzero(point == number)
        own = _Lines._make(array[rows] for array in lines)
        begin[rows] = _likelier_pair(own, int(np.count_nonzero(use[rows])), smallest)
    if not begin.all():
        X, good, use = _forward_intersection_in_rounds(lines, begin, len(points), smallest, rounds)
    return Meetings(X, good & (np.bincount(point[use], minlength=len(points)) >= 2))


class _Lines(NamedTuple):
    """Rays in space."""

    point: IntArray
    """(n,) number of the point each sees."""
    centre: FloatArray
    direction: FloatArray
    limit: FloatArray
    """(n,) what they may pass by at, as the difference of unit vectors."""

    def agree(self, X: FloatArray) -> BoolArray:
        """(…, n) true where they go to ``X`` (…, n, 3)."""
        away = X - self.centre
        with np.errstate(invalid="ignore", divide="ignore"):
            off = away / np.linalg.norm(away, axis=-1)[..., None] - self.direction
            return np.asarray(np.linalg.norm(off, axis=-1) < self.limit)


def _forward_intersection_in_rounds(
    lines: _Lines, use: BoolArray, count: int, smallest: float, rounds: int
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Places (count, 3) nearest to the rays in use, whether they are good, and the rays (n,) in use at last."""
    X, good = np.full((count, 3), np.nan), np.zeros(count, dtype=bool)
    for _ in range(rounds):
        X, good = _forward_intersection_nearest(
            lines.point[use], lines.centre[use], lines.direction[use], count, smallest
        )
        before, use = use, good[lines.point] & lines.agree(X[lines.point])
        if (use == before).all():
            break
    return X, good, use


def _likelier_pair(lines: _Lines, agreeing: int, smallest: float) -> BoolArray:
    """The two rays (n,) to one point on whose meeting more rays agree than on that of all; all without such two.

    Two with which no third one agrees must be the only ones that meet.
    """
    count = len(lines.point)
    everything = np.ones(count, dtype=bool)
    if count < 3:
        return everything
    pairs = np.array(list(combinations(range(min(count, PAIRED)), 2)))
    meeting, centre, direction = np.repeat(np.arange(len(pairs)), 2), lines.centre[pairs], lines.direction[pairs]
    X, good = _forward_intersection_nearest(
        meeting, centre.reshape(-1, 3), direction.reshape(-1, 3), len(pairs), smallest
    )
    votes = np.where(good, np.count_nonzero(lines.agree(X[:, None]), axis=1), 0)
    most = int(votes.max())
    if most <= max(agreeing, 1) or (most == 2 and np.count_nonzero(votes == most) > 1):
        return everything
    begin: BoolArray = np.isin(np.arange(count), pairs[np.argmax(votes)])
    return begin


def _forward_intersection_nearest(
    point: IntArray, centre: FloatArray, direction: FloatArray, count: int, smallest: float
) -> tuple[FloatArray, BoolArray]:
    """Points (count, 3) nearest to their rays, and which of them are good.

    ``point`` (n,) numbers the point of each ray, given by ``centre`` (n, 3) and unit ``direction`` (n, 3). Good are
    points with two rays or more that meet at an angle of at least ``smallest`` radians, in front of their frames.
    """
    projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    normal = np.zeros((count, 3, 3))
    side = np.zeros((count, 3))
    reference = centre.mean(axis=0) if len(centre) else np.zeros(3)
    moved = np.einsum("nij,nj->ni", projector, centre - reference)
    for i in range(3):
        side[:, i] = np.bincount(point, weights=moved[:, i], minlength=count)
        for j in range(3):
            normal[:, i, j] = np.bincount(point, weights=projector[:, i, j], minlength=count)
    rays = np.bincount(point, minlength=count)
    # The smallest eigenvalue of Σ (I − ddᵀ) is about the sum of squared angles between the rays and their mean.
    smallest_eigenvalue = rotations.eigvalsh(normal)[:, 0]
    good = (rays >= 2) & (smallest_eigenvalue > 0.5 * smallest**2)
    X = np.full((count, 3), np.nan)
    X[good] = rotations.solve(normal[good], side[good][:, :, None])[:, :, 0] + reference
    depth = np.einsum("ni,ni->n", X[point] - centre, direction)
    behind = np.bincount(point, weights=~(depth > 0.0), minlength=count)
    good &= behind < 0.5 * rays
    return X, good
