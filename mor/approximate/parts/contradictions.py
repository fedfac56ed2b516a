"""Start values that the observations contradict: frames whose rays pass by what they see, points that rays pass by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.growth.forward_intersection import posed_frames
from mor.approximate.parts.frames import SLACKS, Frame
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.parts.transfer import starting_part
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.project.network.build import Network
from mor.units import ANGLE_UNITS

LARGE = 0.1
"""Radians beyond which it is no small angle, and said in gon."""
MOST = 0.5
"""Part of the rays of a frame that must agree with what they see."""
FEWEST = 3
AGREES = 3.0 * SLACKS[-1]
"""Radians within which a ray agrees with a start value."""


FEWEST_OF_POINT = 2


class Contradiction(NamedTuple):
    """A frame or a point whose given values do not agree with the rays."""

    number: int
    """Of the frame, or the block of the point."""
    name: str
    off: float
    """Median difference of unit vectors, of the rays and where they should go: 2 sin(α/2)."""
    is_point: bool = False

    def __str__(self) -> str:
        angle = 2.0 * float(np.arcsin(min(0.5 * self.off, 1.0)))
        if angle > LARGE:
            return f"{self.name}: the observations contradict it by {angle / ANGLE_UNITS['gon']:.0f} gon"
        return f"{self.name}: the observations contradict it by {1e3 * angle:.3g} mrad"


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


def contradicting_points(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    """Points given as start values and no more that most rays from posed frames pass by."""
    point, off = _rays_past_points(network, system, scene)
    doubtful = np.flatnonzero(_tested(point, scene) & ~_agreeing(point, off, scene))
    ids = network.blocks["point"].ids
    return [
        Contradiction(p, f"point {ids[p]}", float(np.median(off[point == p])), True)
        for p in doubtful.tolist()
    ]


def agreeing_points(network: Network, system: Part, scene: Scene) -> IntArray:
    """Points given as start values and no more that the rays from posed frames go to."""
    point, off = _rays_past_points(network, system, scene)
    return np.flatnonzero(_tested(point, scene) & _agreeing(point, off, scene))


def _rays_past_points(network: Network, system: Part, scene: Scene) -> tuple[IntArray, FloatArray]:
    """Of every ray from a posed frame to such a point: the point, and the angle (radians) by which it passes by."""
    seen, given = scene.seen, network.start["point"]
    loose = network.blocks["point"].free & np.isnan(network.sigma["point"])
    tested = np.asarray(loose.all(axis=1) & np.isfinite(given).all(axis=1))
    rays = np.flatnonzero(tested[seen.point])
    if len(rays) == 0 or not system.poses:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    posed = posed_frames(system.poses, seen.frames)
    rays = rays[np.isfinite(posed.centres[seen.frame[rays], 0])]
    frame, point = seen.frame[rays], seen.point[rays]
    away = given[point] + _lifted(seen.height[rays]) - posed.centres[frame]
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    there = np.einsum("nij,nj->ni", posed.turns[frame], away)
    return point, np.asarray(np.linalg.norm(there - seen.rays[rays], axis=1))


def _tested(point: IntArray, scene: Scene) -> BoolArray:
    return np.asarray(np.bincount(point, minlength=scene.points) >= FEWEST_OF_POINT)


def _agreeing(point: IntArray, off: FloatArray, scene: Scene) -> BoolArray:
    count = np.bincount(point, minlength=scene.points)
    return np.asarray(np.bincount(point[off < AGREES], minlength=scene.points) >= MOST * count)


def started_only(network: Network, scene: Scene) -> tuple[list[Contradiction], list[Contradiction]]:
    """Points, and frames, that are given as start values and no more, whether or not anything contradicts them."""
    given = network.start["point"]
    loose = (network.blocks["point"].free & np.isnan(network.sigma["point"])).all(axis=1)
    held = {frame.position for frame in scene.frames}
    rows = np.flatnonzero(loose & np.isfinite(given).all(axis=1)).tolist()
    ids = network.blocks["point"].ids
    points = [Contradiction(p, f"point {ids[p]}", 0.0, True) for p in rows if p not in held]
    frames = [
        Contradiction(number, frame.name, 0.0)
        for number, frame in enumerate(scene.frames)
        if _only_started(network, frame)
    ]
    return points, frames


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
    network: Network, scene: Scene, start: dict[str, FloatArray], found: list[Contradiction]
) -> None:
    """Give some frames the poses, and some points the coordinates, of the project again."""
    for one in found:
        if one.is_point:
            start["point"][one.number] = network.start["point"][one.number]
            continue
        frame = scene.frames[one.number]
        start["rotation"][frame.rotation] = network.start["rotation"][frame.rotation]
        given = network.start["point"][frame.position]
        start["point"][frame.position] = np.where(np.isnan(given), start["point"][frame.position], given)


def without(network: Network, scene: Scene, found: list[Contradiction]) -> dict[str, FloatArray]:
    """Start values without those of some poses and points; what is fixed or observed stays."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for one in found:
        if one.is_point:
            start["point"][one.number] = np.nan
            continue
        frame = scene.frames[one.number]
        if np.isnan(network.sigma["rotation"][frame.rotation]).all():
            start["rotation"][frame.rotation] = np.nan
        start["point"][frame.position, _loose(network, "point", frame.position)] = np.nan
    return start
