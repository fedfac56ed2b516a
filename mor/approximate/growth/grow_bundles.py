"""Grow a part by resection of frames and intersection of points, until nothing more can be known.

Every round looks only at what is new: points that newly posed frames see, frames that see newly known points. The time
is that of the rays, however many frames see one another.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.growth.forward_intersection import SMALLEST_ANGLE, PosedFrames, meet, posed_frames
from mor.approximate.growth.pose_frame import pose_frame
from mor.approximate.parts.frames import SLACKS, Frame
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.sightings import Sightings
from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.arrays import BoolArray, IntArray

ENOUGH = 6
"""Known points in a frame from which a resection is unambiguous and controlled."""
SHARE = 0.5
"""Frames are posed in one round that see so large a part of the most known points that any of them sees."""
FIRST = 200
"""Frames just joined to given positions that settle with those posed first."""
BATCH = 6
"""Frames at least that are posed before they settle."""
FRONT = 5
"""Batches before them that settle with them: with fewer, errors still grow from row to row of an aerial block."""
ROUGH = (0.03, 0.1)
"""Slacks (radians) of frames that see points whose places are rough."""
FEWEST = 4
"""Known points from which a frame can be resected where there is no other way."""


def grow_bundles(
    part: Part, frames: Sequence[Frame], seen: Sightings, fewest: int, most: int | None = None
) -> bool:
    """Add poses and points to the part; true where anything was added.

    ``fewest`` known points a frame needs for a resection: with 4 a wrong solution may pass for right. The growth pauses
    once ``most`` frames were posed.
    """
    poses = posed_frames(part.poses, seen.frames)
    refused = np.zeros(seen.frames, dtype=np.int64)
    counts = _seen(seen, np.flatnonzero(np.isfinite(part.points).all(axis=1)))
    posed = sorted(part.poses)
    just_tied = part.place_sigma > 0.0 and len(posed) <= FIRST
    front = [[number for number in posed if just_tied and frames[number].name in part.how]]
    before, grown = len(posed), False
    while True:
        _enter(part, frames, poses, posed)
        fresh = _intersect(part, frames, seen, poses, posed)
        if front[-1] and (len(front[-1]) >= BATCH or not posed):
            from mor.approximate.growth.local_bundle import settle  # no network without bundles waits for it

            moving = [number for batch in front for number in batch]
            settle(part, frames, seen, poses, moving)
            # What only frames between see changes little, and again with the next batch.
            _intersect(part, frames, seen, poses, [*front[0], *front[-1]] if posed else moving)
            front = [*front[-FRONT:], []]
        counts += _seen(seen, fresh)
        paused = most is not None and len(part.poses) - before >= most
        without = np.isnan(poses.centres[:, 0])
        posed = [] if paused else _pose_best(part, frames, np.where(without, counts, 0), refused, fewest)
        front[-1].extend(posed)
        grown |= bool(len(fresh) or posed)
        if not (len(fresh) or posed) or paused:
            return grown


def _enter(part: Part, frames: Sequence[Frame], poses: PosedFrames, numbers: Sequence[int]) -> None:
    for number in numbers:
        part.seen_by[frames[number].points] = number
        poses.centres[number], poses.turns[number] = part.poses[number]


def _intersect(
    part: Part, frames: Sequence[Frame], seen: Sightings, poses: PosedFrames, posed: Sequence[int]
) -> IntArray:
    """Intersect the points that some frames see, also again; those newly known."""
    touched = np.zeros(len(part.points), dtype=bool)
    for number in posed:
        touched[frames[number].points] = True
    points = np.flatnonzero(touched & ~part.fixed)
    known = part.known(points)
    found = meet(points, seen, poses, max(part.slack, SLACKS[1]))
    part.points[points[found.good]] = found.X[found.good]
    fresh: IntArray = points[found.good & ~known]
    return fresh


def intersect_again(part: Part, frames: Sequence[Frame], seen: Sightings, moved: Sequence[int]) -> None:
    """Intersect the points that frames see whose poses are others now."""
    _intersect(part, frames, seen, posed_frames(part.poses, seen.frames), moved)


def _seen(seen: Sightings, points: IntArray) -> IntArray:
    """How many of the points each frame sees."""
    return np.bincount(seen.frame[seen.of_points(points)], minlength=seen.frames)


def _pose_best(
    part: Part, frames: Sequence[Frame], counts: IntArray, refused: IntArray, fewest: int
) -> list[int]:
    """Pose the frames that see the most known points; ``refused`` remembers with how many a frame failed."""
    usable = (counts >= fewest) & (counts > refused)
    posed: list[int] = []
    while usable.any() and not posed:
        threshold = max(fewest, int(SHARE * counts[usable].max()))
        chosen = np.flatnonzero(usable & (counts >= threshold))
        for number in chosen[np.argsort(-counts[chosen], kind="stable")].tolist():
            if pose_frame(part, frames[number], number):
                posed.append(number)
            else:
                refused[number] = counts[number]
        usable &= counts > refused
    return posed


def pose_the_rest(part: Part, frames: Sequence[Frame]) -> bool:
    """Frames that contradict the points they see, which may be rough themselves: better a rough pose than none."""
    posed = False
    for number, frame in enumerate(frames):
        if number in part.poses:
            continue
        known = part.known(frame.points)
        if np.count_nonzero(known) >= FEWEST:
            posed |= pose_frame(part, frame, number, ROUGH) or _turned(part, frame, number, known)
    return posed


def _turned(part: Part, frame: Frame, number: int, known: BoolArray) -> bool:
    """The attitude that fits best at a place that is known."""
    centre = part.points[frame.position] + np.array([0.0, 0.0, frame.offset[0]])
    if not (frame.stands and np.isfinite(centre).all()):
        return False
    away = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0]) - centre
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    part.poses[number] = centre, nearest_rotation(frame.rays[known].T @ away)
    part.how[frame.name] = rule("turned towards {count} points from its place", count=int(known.sum()))
    return True


def intersect_the_rest(part: Part, seen: Sightings) -> None:
    """Points that only rays see that do not meet, or hardly at an angle: better a rough value than none.

    The adjustment will tell which of their rays is wrong.
    """
    points = np.flatnonzero(np.isnan(part.points).any(axis=1) & (np.diff(seen.pointers) > 1))
    if len(points) and len(part.poses) > 1:
        poses = posed_frames(part.poses, seen.frames)
        found = meet(points, seen, poses, np.inf, 0.1 * SMALLEST_ANGLE, rounds=1)
        here = part.points[points[found.good]]
        part.points[points[found.good]] = np.where(np.isnan(here), found.X[found.good], here)
