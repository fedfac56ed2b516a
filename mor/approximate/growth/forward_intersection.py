"""Many points at once by the rays of posed frames that see them; rays that pass by are taken out."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.approximate.growth.compiled import intersections as kernels
from mor.approximate.parts.frames import loosened
from mor.approximate.parts.sightings import Sightings
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant

SMALLEST_ANGLE = 0.02
"""Radians at which two rays must meet at least for an intersection to be of use."""
ROUNDS = 3
"""Rounds in which rays that pass by are taken out, or back in."""


class PosedFrames(NamedTuple):
    """Poses of all frames, as far as they are known."""

    centres: FloatArray
    """(frames, 3) projection centres, NaN where there is no pose."""
    turns: FloatArray
    """(frames, 3, 3) rotations D."""


class Meetings(NamedTuple):
    """Where the rays to some points meet."""

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
    rounds: int = ROUNDS,
) -> Meetings:
    """Intersect ``points`` (m,) by all rays from posed frames.

    Rays count as passing by beyond three times their σ, ``slack`` radians added; ``smallest`` is the least angle at
    which rays must meet. Closed form: the point of least sum of squared distances from the rays, each of them lowered
    by the height of its target. A wrong ray may draw it away from all of them: where less than half agree, those do
    that most pairs are for.
    """
    if not compilation.wanted():
        return meet_plainly(points, seen, posed, slack, smallest, rounds)
    rays = (seen.pointers, seen.frame, seen.rays, seen.sigma, seen.height)
    return Meetings(*kernels.meet(points, *rays, *posed, slack, smallest, rounds))


def meet_plainly(
    points: IntArray,
    seen: Sightings,
    posed: PosedFrames,
    slack: float,
    smallest: float = SMALLEST_ANGLE,
    rounds: int = ROUNDS,
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
    found = _in_rounds(lines, np.ones(len(rays), dtype=bool), len(points), smallest, rounds)
    if rounds > 1:
        begin = _likelier_pairs(lines, found, len(points), smallest)
        found = _in_rounds(lines, begin, len(points), smallest, rounds)
    X, good, use = found
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


def _in_rounds(
    lines: _Lines, use: BoolArray, count: int, smallest: float, rounds: int
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Places (count, 3) nearest to the rays in use, whether they are good, and the rays (n,) in use at last."""
    X, good = np.full((count, 3), np.nan), np.zeros(count, dtype=bool)
    for _ in range(rounds):
        X, good = _nearest(lines.point[use], lines.centre[use], lines.direction[use], count, smallest)
        before, use = use, good[lines.point] & lines.agree(X[lines.point])
        if (use == before).all():
            break
    return X, good, use


def _likelier_pairs(
    lines: _Lines, found: tuple[FloatArray, BoolArray, BoolArray], count: int, smallest: float
) -> BoolArray:
    """(n,) rays to begin with anew: where less than half agree, the two on whose meeting more of them do; else all."""
    use = np.ones(len(lines.point), dtype=bool)
    for point in range(count):
        rows = np.flatnonzero(lines.point == point)
        agreeing = int(np.count_nonzero(found[2][rows]))
        if len(rows) < 3 or 2 * agreeing >= len(rows):
            continue
        pairs = np.array(list(combinations(range(min(len(rows), kernels.PAIRED)), 2)))
        own = _Lines._make(array[rows] for array in lines)
        meeting, centre, direction = (
            np.repeat(np.arange(len(pairs)), 2),
            own.centre[pairs],
            own.direction[pairs],
        )
        X, good = _nearest(meeting, centre.reshape(-1, 3), direction.reshape(-1, 3), len(pairs), smallest)
        votes = np.where(good, np.count_nonzero(own.agree(X[:, None]), axis=1), 0)
        most = int(votes.max())
        if most > max(agreeing, 1) and (most > 2 or np.count_nonzero(votes == most) == 1):
            use[rows] = False
            use[rows[pairs[np.argmax(votes)]]] = True
    return use


def _nearest(
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
    smallest_eigenvalue = tolerant.eigvalsh(normal)[:, 0]
    good = (rays >= 2) & (smallest_eigenvalue > 0.5 * smallest**2)
    X = np.full((count, 3), np.nan)
    X[good] = tolerant.solve(normal[good], side[good][:, :, None])[:, :, 0] + reference
    depth = np.einsum("ni,ni->n", X[point] - centre, direction)
    behind = np.bincount(point, weights=~(depth > 0.0), minlength=count)
    good &= behind < 0.5 * rays
    return X, good
