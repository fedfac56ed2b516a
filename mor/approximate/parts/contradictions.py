"""Start values that the observations contradict: frames whose rays pass by what they see."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.parts.frames import SLACKS, Frame
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.parts.transfer import starting_part
from mor.arrays import BoolArray, FloatArray
from mor.project.network.build import Network

MOST = 0.5
"""Part of the rays of a frame that must agree with what they see."""
FEWEST = 3
AGREES = 3.0 * SLACKS[-1]
"""Radians within which a ray agrees with a start value."""


class Contradiction(NamedTuple):
    """A frame whose given pose does not agree with its rays."""

    frame: int
    name: str
    off: float
    """Median angle (radians) by which its rays pass by."""

    def __str__(self) -> str:
        return f"{self.name}: the observations contradict it by {1e3 * self.off:.3g} mrad"


def contradicting_frames(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    """Frames whose start values do not agree with the rest.

    Of a pose most rays pass by the points they see, as far as these are known; an attitude alone is another one than
    that which was found.
    """
    given, found = starting_part(network, scene.frames).poses, []
    for number, frame in enumerate(scene.frames):
        if not _only_started(network, frame) or number not in system.poses:
            continue
        if number in given:
            off = _misses(system, frame, *given[number])
            doubtful = len(off) >= FEWEST and np.mean(off < AGREES) < MOST
        else:
            turn = network.start["rotation"][frame.rotation] @ system.poses[number][1].T
            off = np.array([float(np.linalg.norm(turn - np.eye(3))) / np.sqrt(2.0)])
            doubtful = off[0] > AGREES
        if doubtful:
            found.append(Contradiction(number, frame.name, float(np.median(off))))
    return found


def _misses(system: Part, frame: Frame, centre: FloatArray, D: FloatArray) -> FloatArray:
    """Angles (n,) by which the rays of a frame pass by the known points they go to."""
    known = system.known(frame.points)
    star = (system.points[frame.points[known]] + _lifted(frame.heights[known]) - centre) @ D.T
    star /= np.linalg.norm(star, axis=1, keepdims=True)
    off: FloatArray = np.linalg.norm(star - frame.rays[known], axis=1)
    return off


def _lifted(heights: FloatArray) -> FloatArray:
    return np.column_stack([np.zeros((len(heights), 2)), heights])


def _only_started(network: Network, frame: Frame) -> bool:
    """True where the attitude of a frame is given, as a start value and no more."""
    given = np.isfinite(network.start["rotation"][frame.rotation]).all()
    return frame.relative is None and bool(given and _loose(network, "rotation", frame.rotation)[2])


def _loose(network: Network, kind: str, block: int) -> BoolArray:
    """Components that are free and not observed."""
    return np.asarray(network.blocks[kind].free[block] & np.isnan(network.sigma[kind][block]))


def put_back(
    network: Network, scene: Scene, start: dict[str, FloatArray], frames: list[Contradiction]
) -> None:
    """Give some frames the poses of the project again."""
    for one in frames:
        frame = scene.frames[one.frame]
        start["rotation"][frame.rotation] = network.start["rotation"][frame.rotation]
        start["point"][frame.position] = network.start["point"][frame.position]


def without_poses(network: Network, scene: Scene, frames: list[Contradiction]) -> dict[str, FloatArray]:
    """Start values without those of the poses of some frames; what is fixed or observed stays."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for one in frames:
        frame = scene.frames[one.frame]
        if np.isnan(network.sigma["rotation"][frame.rotation]).all():
            start["rotation"][frame.rotation] = np.nan
        start["point"][frame.position, _loose(network, "point", frame.position)] = np.nan
    return start
