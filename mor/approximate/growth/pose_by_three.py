"""Frames that see three known points: of the poses these leave, the one at which its other rays meet those of others.

Every further point that a posed frame sees too is one condition, that both rays and the base are coplanar.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.bundle import direction_bundle
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.approximate.resection.space_resection import resect
from mor.arrays import FloatArray

KNOWN = 3
AGREES = 0.01
"""Median angle (radians) by which the rays of the best pose pass by each other, at the most."""
CLEAR = 4.0
"""Factor from which on the second best is told from it."""


def pose_by_three(part: Part, scene: Scene) -> bool:
    """Add the poses of frames that three known points and rays of others determine; true where any was."""
    frames, added = scene.rays_for(part)[0], False
    for number, frame in enumerate(frames):
        if number in part.poses:
            continue
        known = part.known(frame.points)
        if np.count_nonzero(known) != KNOWN:
            continue
        targets = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0])
        bundle = direction_bundle(frame.rays[known], loosened(frame.sigma[known], SLACKS[1]))
        result = resect(bundle, targets)
        poses = [(result.position, result.rotation)]
        poses += [(one.position, one.rotation) for one in result.alternatives]
        off = [_misses(part, scene, number, frame, *pose) for pose in poses if np.isfinite(pose[0]).all()]
        order = np.argsort(off)
        if len(off) == 0 or not off[order[0]] < AGREES:
            continue
        if len(off) == 1 or off[order[1]] > CLEAR * max(off[order[0]], SLACKS[1]):
            part.poses[number] = poses[int(order[0])]
            part.how[frame.name] = rule("resection from {count} of {of} points", count=KNOWN, of=KNOWN)
            added = True
    return added


def _misses(part: Part, scene: Scene, number: int, frame: Frame, centre: FloatArray, D: FloatArray) -> float:
    """Median angle by which rays of the frame at a pose pass by those of posed frames; infinite where none tells."""
    seen = scene.rays_for(part)[1]
    off = []
    for point, ray in zip(frame.points.tolist(), frame.rays, strict=True):
        if part.known(np.array([point]))[0]:
            continue
        for other in seen.of_points(np.array([point])).tolist():
            pose = part.poses.get(int(seen.frame[other]))
            if pose is None or int(seen.frame[other]) == number:
                continue
            base, own, theirs = pose[0] - centre, D.T @ ray, pose[1].T @ seen.rays[other]
            across = np.cross(base, own)
            off.append(abs(float(across @ theirs)) / max(float(np.linalg.norm(across)), 1e-300))
    return float(np.median(off)) if off else np.inf
