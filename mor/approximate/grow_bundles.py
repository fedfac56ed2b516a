"""Grow a part by resection of frames and intersection of points, until nothing more can be known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.bundle import direction_bundle
from mor.approximate.frames import SLACKS, Frame, loosened
from mor.approximate.part import Part
from mor.approximate.reprojection import misfits
from mor.approximate.resection import resect
from mor.approximate.resection_adjust import Pose, adjust_pose, star_of
from mor.approximate.resection_outcome import Resection, ResectionOutcome
from mor.approximate.sightings import Sightings
from mor.geometry.arrays import BoolArray, FloatArray, IntArray

ENOUGH = 6
"""Known points in a frame from which a resection is unambiguous and controlled."""
FEWEST = 4
"""Known points from which a frame can be resected where there is no other way."""
SMALLEST_ANGLE = 0.02
"""Radians at which two rays must meet at least for an intersection to be of use."""
NEIGHBOUR = 10
"""Known points from which the pose of a neighbour is tried as a start."""
_SAMPLE = 60
"""Points of a frame a resection uses at the most."""


def grow_bundles(part: Part, frames: Sequence[Frame], seen: Sightings, fewest: int) -> bool:
    """Add poses and points to the part; true where anything was added.

    ``fewest`` known points a frame needs for a resection: with 4 a wrong solution may pass for right. Only points that
    newly posed frames see are intersected (again), only frames that see new points are looked at again.
    """
    refused = np.zeros(seen.frames, dtype=np.int64)
    posed = np.array(sorted(part.poses), dtype=np.int64)
    for number in posed:
        part.seen_by[frames[number].points] = number
    grown = False
    while True:
        added = _intersect(part, seen, np.unique(seen.point[np.isin(seen.frame, posed)]))
        posed = _resect_best(part, frames, seen, refused, fewest)
        if not added and not len(posed):
            return grown
        grown = True


def _resect_best(
    part: Part, frames: Sequence[Frame], seen: Sightings, refused: IntArray, fewest: int
) -> IntArray:
    """Resect the frames that see the most known points; ``refused`` remembers with how many a frame failed."""
    counts = np.bincount(seen.frame, weights=part.known(seen.point), minlength=seen.frames).astype(np.int64)
    counts[list(part.poses)] = 0
    usable = (counts >= fewest) & (counts > refused)
    posed: list[int] = []
    while usable.any() and not posed:
        threshold = max(fewest, int(0.5 * counts[usable].max()))
        chosen = np.flatnonzero(usable & (counts >= threshold))
        for number in chosen[np.argsort(-counts[chosen], kind="stable")].tolist():
            if _resect(part, frames[number], number):
                posed.append(number)
                part.seen_by[frames[number].points] = number
            else:
                refused[number] = counts[number]
        usable &= counts > refused
    return np.array(posed, dtype=np.int64)


def _resect(part: Part, frame: Frame, number: int) -> bool:
    known = np.flatnonzero(part.known(frame.points))
    if len(known) > _SAMPLE:
        known = known[np.linspace(0, len(known) - 1, _SAMPLE).astype(int)]
    targets = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0])
    if len(known) >= NEIGHBOUR and _like_a_neighbour(part, frame, number, known, targets):
        return True
    for slack in [s for s in SLACKS if s >= part.slack]:
        result = resect(direction_bundle(frame.rays[known], loosened(frame.sigma[known], slack)), targets)
        agreeing = int(np.count_nonzero(result.agreeing))
        usable = result.outcome in (ResectionOutcome.DETERMINED, ResectionOutcome.WEAK)
        if usable and agreeing >= max(4, 0.6 * len(known)):
            part.poses[number] = (_given_centre(part, frame, result), result.rotation)
            part.how[frame.name] = f"resection from {agreeing} of {len(known)} points"
            return True
    return False


def _like_a_neighbour(part: Part, frame: Frame, number: int, known: IntArray, targets: FloatArray) -> bool:
    """Pose by adjustment alone, begun at the pose of the frame that shares most points; true where it fits.

    Aerial images and image sequences go this way; a closed form with sampling takes ten times as long.
    """
    neighbours = part.seen_by[frame.points[known]]
    neighbours = neighbours[neighbours >= 0]
    if len(neighbours) == 0:
        return False
    start = Pose(*part.poses[int(np.bincount(neighbours).argmax())])
    bundle = direction_bundle(frame.rays[known], loosened(frame.sigma[known], max(part.slack, SLACKS[1])))
    pose = adjust_pose(bundle, targets, start, iterations=15)
    agreeing = misfits(bundle, star_of(targets, pose)[None])[0] < 3.0
    if np.count_nonzero(agreeing) < 0.8 * len(known):
        return False
    part.poses[number] = (_given_centre(part, frame, pose), pose.rotation)
    part.how[frame.name] = f"resection from {np.count_nonzero(agreeing)} of {len(known)} points"
    return True


def _given_centre(part: Part, frame: Frame, found: Resection | Pose) -> FloatArray:
    """The centre that a given position says, so that nothing drifts away from it; else the one found."""
    if frame.position not in part.fixed:
        return found.position
    lifted = part.points[frame.position] + np.array([0.0, 0.0, frame.offset[0]])
    centre: FloatArray = lifted - found.rotation.T @ frame.offset[1:]
    return centre


def _intersect(part: Part, seen: Sightings, points: IntArray) -> bool:
    """Intersect points by all posed frames that see them, also again; true where any became known."""
    points = points[~np.isin(points, np.fromiter(part.fixed, dtype=np.int64, count=len(part.fixed)))]
    if len(points) == 0 or len(part.poses) < 2:
        return False
    rays, centre, direction = _posed_rays(part, seen, points)
    point = np.searchsorted(points, seen.point[rays])
    sigma = loosened(seen.sigma[rays], max(part.slack, SLACKS[1]))
    use = np.ones(len(rays), dtype=bool)
    for _ in range(3):
        X, good = intersections(point[use], centre[use], direction[use], len(points), SMALLEST_ANGLE)
        away = X[point] - centre
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.linalg.norm(away / np.linalg.norm(away, axis=1)[:, None] - direction, axis=1)
        use = good[point] & (off < 3.0 * sigma)
        if (use == good[point]).all():
            break
    fresh = good & (np.bincount(point[use], minlength=len(points)) >= 2)
    before = part.known(points)
    _put(part, points, X, fresh, _mean_height(point, seen.height[rays], len(points)))
    return bool((fresh & ~before).any())


def intersect_the_rest(part: Part, seen: Sightings) -> None:
    """Points that only rays see that do not meet, or hardly at an angle: better a rough value than none.

    The adjustment will tell which of their rays is wrong.
    """
    points = np.flatnonzero(np.isnan(part.points).all(axis=1) & (np.diff(seen.pointers) > 1))
    if len(points) == 0 or len(part.poses) < 2:
        return
    rays, centre, direction = _posed_rays(part, seen, points)
    point = np.searchsorted(points, seen.point[rays])
    X, good = intersections(point, centre, direction, len(points), 0.1 * SMALLEST_ANGLE)
    _put(part, points, X, good, _mean_height(point, seen.height[rays], len(points)))


def _posed_rays(part: Part, seen: Sightings, points: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rays from posed frames to points: their numbers, centres (n, 3) and directions (n, 3)."""
    centres, turns = np.full((seen.frames, 3), np.nan), np.zeros((seen.frames, 3, 3))
    for number, (centre, D) in part.poses.items():
        centres[number], turns[number] = centre, D
    rays = seen.of_points(points)
    rays = rays[np.isfinite(centres[seen.frame[rays], 0])]
    frame = seen.frame[rays]
    return rays, centres[frame], np.einsum("ni,nij->nj", seen.rays[rays], turns[frame])


def _put(part: Part, points: IntArray, X: FloatArray, chosen: BoolArray, height: FloatArray) -> None:
    X[:, 2] -= height
    part.points[points[chosen]] = X[chosen]


def _mean_height(point: IntArray, height: FloatArray, count: int) -> FloatArray:
    total = np.bincount(point, weights=height, minlength=count)
    return total / np.maximum(np.bincount(point, minlength=count), 1)


def intersections(
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
