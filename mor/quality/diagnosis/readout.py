"""Readout times that nothing tells: of images that do not move, and of motions that nobody knows."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, IntArray
from mor.observations.time.rolling_shutter import MOTION_SLOTS
from mor.parameters.kinds import IMAGE_VELOCITY, READOUT, ROTATION_RATE
from mor.project.trajectories.images import TRAJECTORY
from mor.project.trajectories.poses import image_poses
from mor.quality.diagnosis.sentences import Say, english
from mor.quality.solved import Solved

OF_READOUT = frozenset(slot.kind for slot in MOTION_SLOTS)
"""Kinds of blocks that act by their products only."""


def readout_sentences(solved: Solved, say: Say = english) -> list[str]:
    """One line for every camera whose free readout time no image can tell; both reasons follow from the model."""
    cameras, images = solved.network.things["camera"], solved.network.things["image"]
    lines = []
    for number, name in enumerate(cameras.ids):
        block = int(cameras.parts[READOUT.key][number])
        if block < 0 or not _untold(solved, READOUT.key, np.array([block])).all():
            continue
        mine = np.asarray(images.parts[READOUT.key] == block)
        flown = mine & (images.parts[TRAJECTORY] >= 0)
        if flown.any() and _any_moves(solved, flown):
            continue
        motions = {
            kind: np.unique(images.parts[kind][mine & ~flown])
            for kind in (IMAGE_VELOCITY.key, ROTATION_RATE.key)
        }
        if flown.any() and (flown == mine).all():
            lines.append(
                say(
                    "Camera {id}: the trajectories of its images stand still at their times, so its readout time has "
                    "no effect. Fix the readout time.",
                    id=name,
                )
            )
        elif all(not solved.adjustment.start[kind][own].any() for kind, own in motions.items()):
            lines.append(
                say(
                    "Camera {id}: none of its images moves, so its readout time has no effect. Give the images their "
                    "velocity or rate of rotation, or fix the readout time.",
                    id=name,
                )
            )
        elif all(_scales(solved, kind, own) for kind, own in motions.items()):
            lines.append(
                say(
                    "Camera {id}: its readout time and the motions of its images act by their product alone. Fix or "
                    "observe the readout time, or a velocity or rate of rotation.",
                    id=name,
                )
            )
    return lines


def _any_moves(solved: Solved, flown: BoolArray) -> bool:
    """True where the trajectory of one of the images ``flown`` (n,) moves or turns at its time."""
    return any(
        own.pose.velocity[flown[own.images]].any() or own.pose.rate[flown[own.images]].any()
        for own in image_poses(solved.network, solved.adjustment.start)
    )


def _scales(solved: Solved, kind: str, own: IntArray) -> bool:
    """True where all components that are not 0 are unknowns that nothing but images tells."""
    return bool((_untold(solved, kind, own) | (solved.adjustment.start[kind][own] == 0.0)).all())


def _untold(solved: Solved, kind: str, own: IntArray) -> BoolArray:
    """(n, k) unknowns of blocks (n,) that no observation names but image coordinates."""
    untold = solved.network.blocks[kind].free.copy()
    for group in solved.adjustment.problem.groups:
        if group.type.key in (f"observed/{kind}", f"difference/{kind}"):
            for numbers in group.blocks:
                untold[numbers] &= ~group.mask
    chosen: BoolArray = untold[own]
    return chosen
