"""Grow a part by resection of frames and intersection of points, until nothing more can be known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.bundle import direction_bundle
from mor.approximate.frames import SLACKS, Frame, loosened
from mor.approximate.part import Part
from mor.approximate.resection import resect
from mor.approximate.resection_outcome import ResectionOutcome
from mor.geometry.arrays import BoolArray, FloatArray, IntArray

ENOUGH = 6
"""Known points in a frame from which a resection is unambiguous and controlled."""
FEWEST = 4
"""Known points from which a frame can be resected where there is no other way."""
SMALLEST_ANGLE = 0.02
"""Radians at which two rays must meet at least for an intersection to be of use."""
WIDE_ANGLE = 0.15
_SAMPLE = 60
"""Points of a frame a resection uses at the most."""


def grow_bundles(part: Part, frames: Sequence[Frame], fewest: int) -> bool:
    """Add poses and points to the part; true where anything was added.

    ``fewest`` known points a frame needs for a resection: with 4 a wrong solution may pass for right.
    """
    grown = False
    refused: dict[int, int] = {}
    while True:
        added_points = _intersect_all(part, frames, SMALLEST_ANGLE)
        added_frames = _resect_best(part, frames, refused, fewest)
        if not added_frames and not added_points:
            return grown
        grown = True


def _resect_best(part: Part, frames: Sequence[Frame], refused: dict[int, int], fewest: int) -> bool:
    """Resect the frames that see the most known points; ``refused`` remembers with how many a frame failed."""
    counts = {
        number: int(np.count_nonzero(part.known(frame.points)))
        for number, frame in enumerate(frames)
        if number not in part.poses
    }
    usable = {n: c for n, c in counts.items() if c >= fewest and c > refused.get(n, 0)}
    if not usable:
        return False
    best = max(usable.values())
    threshold = max(fewest, int(0.5 * best))
    added = False
    for number in sorted((n for n, c in usable.items() if c >= threshold), key=lambda n: (-usable[n], n)):
        if _resect(part, frames[number], number):
            added = True
        else:
            refused[number] = usable[number]
    return added or any(c > refused.get(n, 0) for n, c in usable.items())


def _resect(part: Part, frame: Frame, number: int) -> bool:
    known = np.flatnonzero(part.known(frame.points))
    if len(known) > _SAMPLE:
        known = known[np.linspace(0, len(known) - 1, _SAMPLE).astype(int)]
    targets = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0])
    for slack in [s for s in SLACKS if s >= part.slack]:
        result = resect(direction_bundle(frame.rays[known], loosened(frame.sigma[known], slack)), targets)
        if result.outcome in (ResectionOutcome.DETERMINED, ResectionOutcome.WEAK) and (
            np.count_nonzero(result.agreeing) >= max(4, 0.6 * len(known))
        ):
            part.poses[number] = (result.position, result.rotation)
            part.how[frame.name] = (
                f"resection from {np.count_nonzero(result.agreeing)} of {len(known)} points"
            )
            return True
    return False


def _intersect_all(part: Part, frames: Sequence[Frame], smallest: float) -> bool:
    """Intersect all points that posed frames see, also those of earlier intersections; true where points were added."""
    numbers = sorted(part.poses)
    if len(numbers) < 2:
        return False
    point, centre, direction, sigma, height = _rays_of(part, frames, numbers)
    mine = ~np.isin(point, list(part.fixed)) if part.fixed else np.ones(len(point), dtype=bool)
    point, centre, direction, sigma, height = (
        array[mine] for array in (point, centre, direction, sigma, height)
    )
    if len(point) == 0:
        return False
    use = np.ones(len(point), dtype=bool)
    before = np.isfinite(part.points[:, 0])
    for _ in range(3):
        X, good = intersections(point[use], centre[use], direction[use], len(part.points), smallest)
        away = X[point] - centre
        length = np.linalg.norm(away, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.linalg.norm(away / length[:, None] - direction, axis=1)
        use = good[point] & (off < 3.0 * sigma)
        if (use == good[point]).all():
            break
    enough = np.bincount(point[use], minlength=len(part.points)) >= 2
    fresh = good & enough
    X[:, 2] -= _mean_height(point, height, len(X))
    part.points[fresh] = X[fresh]
    return bool((fresh & ~before).any())


def intersect_the_rest(part: Part, frames: Sequence[Frame]) -> None:
    """Points that only rays see that do not meet, or hardly at an angle: better a rough value than none.

    The adjustment will tell which of their rays is wrong.
    """
    numbers = sorted(part.poses)
    if len(numbers) < 2:
        return
    point, centre, direction, _, height = _rays_of(part, frames, numbers)
    X, good = intersections(point, centre, direction, len(part.points), 0.1 * SMALLEST_ANGLE)
    X[:, 2] -= _mean_height(point, height, len(X))
    lost = good & np.isnan(part.points).all(axis=1)
    part.points[lost] = X[lost]


def _mean_height(point: IntArray, height: FloatArray, count: int) -> FloatArray:
    total = np.bincount(point, weights=height, minlength=count)
    return total / np.maximum(np.bincount(point, minlength=count), 1)


def _rays_of(
    part: Part, frames: Sequence[Frame], numbers: Sequence[int]
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    point = np.concatenate([frames[n].points for n in numbers])
    centre = np.concatenate([np.broadcast_to(part.poses[n][0], (len(frames[n].points), 3)) for n in numbers])
    direction = np.concatenate([frames[n].rays @ part.poses[n][1] for n in numbers])
    sigma = loosened(np.concatenate([frames[n].sigma for n in numbers]), max(part.slack, SLACKS[1]))
    height = np.concatenate([frames[n].heights for n in numbers])
    return point, centre, direction, sigma, height


def intersections(
    point: IntArray, centre: FloatArray, direction: FloatArray, count: int, smallest: float
) -> tuple[FloatArray, BoolArray]:
    """Points (count, 3) nearest to their rays, and which of them are good.

    ``point`` (n,) numbers the point of each ray, given by ``centre`` (n, 3) and unit ``direction`` (n, 3). Good are points
    with two rays or more that meet at an angle of at least ``smallest`` radians, in front of their frames.
    """
    projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    normal = np.zeros((count, 3, 3))
    side = np.zeros((count, 3))
    reference = centre.mean(axis=0)
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
