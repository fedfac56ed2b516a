"""Frames that were posed when few points were known, from wrong ones among them: posed again once more are known.

A wrong pose that six points allow passes by what the frame sees of the rest. It stands the test by which it would be
made, that three in five of all known points agree with it, or another one is looked for.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.growth.grow_bundles import ENOUGH, intersect_again
from mor.approximate.growth.pose_frame import least_agreeing, pose_frame
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.joining import place_of
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.resection.space_resection import AGREES
from mor.arrays import FloatArray

Pose = tuple[FloatArray, FloatArray]
"""Projection centre and rotation D."""


def pose_again(part: Part, scene: Scene) -> bool:
    """Pose frames anew that most known points contradict; true where any has another pose.

    What such a frame sees is intersected again. Given poses stay, and those of stereo followers.
    """
    frames, seen = scene.rays_for(part)
    moved: list[int] = []
    for number in list(part.poses):
        frame = frames[number]
        known = int(np.count_nonzero(part.known(frame.points)))
        own = frame.stands and frame.name in part.how
        if not own or known < ENOUGH or known <= part.posed_again.get(number, 0):
            continue
        agreeing = _agreeing(part, frame, number)
        if agreeing >= least_agreeing(known):
            continue
        part.posed_again[number] = known
        before, how = part.poses.pop(number), part.how[frame.name]
        if pose_frame(part, frame, number) and _agreeing(part, frame, number) > agreeing:
            moved.append(number)
            _forget_place(part, frame, before, part.poses[number])
        else:
            part.poses[number], part.how[frame.name] = before, how
    if moved:
        intersect_again(part, frames, seen, moved)
    return bool(moved)


def _forget_place(part: Part, frame: Frame, before: Pose, after: Pose) -> None:
    """The position of a frame is not known any more where it was that of the pose before."""
    here = part.points[frame.position]
    away = [np.linalg.norm(here - place_of(frame, *pose)) for pose in (before, after)]
    if not part.fixed[frame.position] and away[0] < away[1]:
        here[:] = np.nan


def _agreeing(part: Part, frame: Frame, number: int) -> int:
    """How many rays of a posed frame go to the known points they see, with the largest slack."""
    centre, D = part.poses[number]
    known = part.known(frame.points)
    star = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0]) - centre
    star = star @ D.T
    star /= np.maximum(np.linalg.norm(star, axis=1, keepdims=True), 1e-300)
    off = np.linalg.norm(star - frame.rays[known], axis=1)
    return int(np.count_nonzero(off < AGREES * loosened(frame.sigma[known], max(part.slack, SLACKS[-1]))))


__all__ = ["pose_again"]
