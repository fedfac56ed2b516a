"""Frames posed while few points were known, and posed wrongly: resected again once more points are known.

A pose from six points, wrong ones among them, can pass for right. It has to stand the test by which it would be made
now, that three in five of all known points agree with it; otherwise another pose is looked for.
"""

from __future__ import annotations

import numpy as np

from mor.start.join import place_of
from mor.start.local_adjustment import ENOUGH, intersect_again, least_agreeing, pose_frame
from mor.start.part import SLACKS, Frame, Part, loosened, misses
from mor.start.resection import AGREES
from mor.start.scene import Scene
from mor.types import FloatArray

Pose = tuple[FloatArray, FloatArray]
"""Projection centre and rotation D."""


def pose_again(part: Part, scene: Scene) -> bool:
    """Resect frames that most known points contradict; true where any has another pose.

    What such a frame sees is intersected again. Given poses stay, and those of stereo followers.
    """
    frames, seen = scene.rays_for(part)
    moved: list[int] = []
    for number in list(part.poses):
        frame = frames[number]
        count = int(np.count_nonzero(part.known(frame.points)))
        if not frame.stands or count < ENOUGH or count <= part.posed_again.get(number, 0):
            continue
        sets = _sets(part, scene, frame)
        if frame.name not in part.how and not sets:
            continue
        part.posed_again[number] = count
        before, how = part.poses[number], part.how.get(frame.name)
        if not _another(part, frame, number, least_agreeing(count)):
            continue
        if part.poses[number] is before:
            part.how |= {} if how is None else {frame.name: how}
            continue
        moved.append(number)
        after = part.poses[number]
        here = part.points[frame.position]
        away = [np.linalg.norm(here - place_of(frame, *pose)) for pose in (before, after)]
        if not part.fixed[frame.position] and away[0] < away[1]:
            here[:] = np.nan
        for one in sets:
            del part.kappas[one]
    if moved:
        intersect_again(part, frames, seen, moved)
    return bool(moved)


def _another(part: Part, frame: Frame, number: int, least: int) -> bool:
    """Look for another pose with the least slack with which one stands the test; true where the present one does not.

    ``least`` rays must agree. The present pose stays where none stands the test.
    """
    before, failed = part.poses[number], False
    # Radians by which rays may be off: parts are bent a little.
    for slack in (slack for slack in SLACKS[2:] if slack >= part.slack):
        if _agreeing(part, frame, number, slack) >= least:
            return failed
        failed = True
        if pose_frame(part, frame, number, (slack,)):
            if _agreeing(part, frame, number, slack) >= least:
                return True
            part.poses[number] = before
    return failed


def _sets(part: Part, scene: Scene, frame: Frame) -> list[int]:
    """The oriented levelled sets that are the frame: their orientation is that of its pose."""
    sights = scene.terrestrial.sights
    return [number for number in part.kappas if sights[number].rotation == frame.rotation]


def _agreeing(part: Part, frame: Frame, number: int, slack: float) -> int:
    known, off = misses(part, frame, *part.poses[number])
    return int(np.count_nonzero(off < AGREES * loosened(frame.sigma[known], slack)))
