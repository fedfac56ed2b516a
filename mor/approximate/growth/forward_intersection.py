"""Many points at once by the rays of posed frames that see them; rays that pass by are taken out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.approximate.growth.compiled import intersections as kernels
from mor.approximate.parts.frames import loosened
from mor.approximate.parts.sightings import Sightings
from mor.arrays import BoolArray, FloatArray, IntArray

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
    which rays must meet. Closed form: the point of least sum of squared distances from the rays.
    """
    if not compilation.wanted():
        return meet_plainly(points, seen, posed, slack, smallest, rounds)
    rays = (seen.pointers, seen.order, seen.frame, seen.rays, seen.sigma, seen.height)
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
    sigma = loosened(seen.sigma[rays], slack)
    use = np.ones(len(rays), dtype=bool)
    X, good = np.full((len(points), 3), np.nan), np.zeros(len(points), dtype=bool)
    for _ in range(rounds):
        X, good = _nearest(point[use], centre[use], direction[use], len(points), smallest)
        away = X[point] - centre
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.linalg.norm(away / np.linalg.norm(away, axis=1)[:, None] - direction, axis=1)
        use = good[point] & (off < 3.0 * sigma)
        if (use == good[point]).all():
            break
    X[:, 2] -= _mean(point, seen.height[rays], len(points))
    return Meetings(X, good & (np.bincount(point[use], minlength=len(points)) >= 2))


def _mean(point: IntArray, height: FloatArray, count: int) -> FloatArray:
    total = np.bincount(point, weights=height, minlength=count)
    return total / np.maximum(np.bincount(point, minlength=count), 1)


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
    smallest_eigenvalue = np.linalg.eigvalsh(normal)[:, 0]
    good = (rays >= 2) & (smallest_eigenvalue > 0.5 * smallest**2)
    X = np.full((count, 3), np.nan)
    X[good] = np.linalg.solve(normal[good], side[good][:, :, None])[:, :, 0] + reference
    depth = np.einsum("ni,ni->n", X[point] - centre, direction)
    behind = np.bincount(point, weights=~(depth > 0.0), minlength=count)
    good &= behind < 0.5 * rays
    return X, good
