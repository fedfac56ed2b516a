"""Frames posed by other frames: stereo followers and leaders by their pair, images that turn about one tripod."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene, StereoPair
from mor.arrays import FloatArray
from mor.geometry.rotations import nearest_rotation

AGREE = 0.02
"""Radians within which a ray agrees with a turn about one tripod."""
SMALLEST_ANGLE = 0.05
"""Radians between two rays that a turn can be taken from."""
_SAMPLES = 60


def grow_relative(part: Part, scene: Scene) -> bool:
    """Add what pairs and common tripods tell; true where anything was added."""
    added, frames = False, scene.rays_for(part)[0]
    for pair in scene.pairs:
        added |= _follow(part, frames, pair)
    for numbers in scene.shared.values():
        posed = [n for n in numbers if n in part.poses]
        for number in numbers if posed else ():
            added |= number not in part.poses and _turned(part, frames, posed, number)
    return added


def _follow(part: Part, frames: Sequence[Frame], pair: StereoPair) -> bool:
    lacking = [(a, b) for a, b in pair.members if (a in part.poses) != (b in part.poses)]
    if not lacking:
        return False
    known = _relative(part, pair)
    if known is None:
        return False
    turn, base = known
    for leader, follower in lacking:
        if leader in part.poses:
            centre, D = part.poses[leader]
            part.poses[follower] = (centre + D.T @ base, turn @ D)
            part.how[frames[follower].name] = rule("follows {one}", one=frames[leader].name)
        else:
            centre, D = part.poses[follower]
            D = turn.T @ D
            part.poses[leader] = (centre - D.T @ base, D)
            part.how[frames[leader].name] = rule("leads {one}", one=frames[follower].name)
    return True


def _relative(part: Part, pair: StereoPair) -> tuple[FloatArray, FloatArray] | None:
    """Turn and base of a pair in the units of the part: as given, or as of the median of those posed already."""
    if np.isfinite(pair.turn).all() and np.isfinite(pair.base).all() and part.scaled:
        return pair.turn, pair.base
    found = list(_posed(part, pair))
    if not found:
        return None
    bases = np.array([base for _, base in found])
    centre = int(np.argmin(np.linalg.norm(bases - np.median(bases, axis=0), axis=1)))
    return found[centre]


def _posed(part: Part, pair: StereoPair) -> Iterator[tuple[FloatArray, FloatArray]]:
    for leader, follower in pair.members:
        if leader in part.poses and follower in part.poses:
            (O_a, D_a), (O_b, D_b) = part.poses[leader], part.poses[follower]
            yield D_b @ D_a.T, D_a @ (O_b - O_a)


def known_bases(part: Part, pairs: Sequence[StereoPair]) -> list[tuple[float, float]]:
    """Present and given lengths of the bases that are given and posed."""
    return [
        (float(np.linalg.norm(base)), float(np.linalg.norm(pair.base)))
        for pair in pairs
        if np.isfinite(pair.base).all() and np.any(pair.base)
        for _, base in _posed(part, pair)
    ]


def _turned(part: Part, frames: Sequence[Frame], posed: Sequence[int], number: int) -> bool:
    """Pose of a frame on the tripod of another one: rays to points that frames there see too, or that are known."""
    frame, centre = frames[number], part.poses[posed[0]][0]
    towards: dict[int, FloatArray] = {}
    for other in posed:
        D = part.poses[other][1]
        for point, ray in zip(frames[other].points.tolist(), frames[other].rays, strict=True):
            towards.setdefault(point, D.T @ ray)
    own, there = [], []
    for point, height, ray in zip(frame.points.tolist(), frame.heights, frame.rays, strict=True):
        if np.isfinite(part.points[point]).all():
            away = part.points[point] + [0.0, 0.0, height] - centre
            towards[point] = away / max(float(np.linalg.norm(away)), 1e-300)
        if point in towards:
            own.append(ray)
            there.append(towards[point])
    turn = _agreed_turn(np.array(own).reshape(-1, 3), np.array(there).reshape(-1, 3))
    if turn is None:
        return False
    part.poses[number] = (centre.copy(), turn)
    part.how[frame.name] = rule("turned about the tripod of {one}", one=frames[posed[0]].name)
    return True


def _agreed_turn(own: FloatArray, there: FloatArray) -> FloatArray | None:
    """Rotation D with own = D there, from the two rays that most others agree with."""
    best: tuple[int, FloatArray] | None = None
    for i, j in islice(combinations(range(len(own)), 2), _SAMPLES):
        if np.linalg.norm(np.cross(own[i], own[j])) < SMALLEST_ANGLE:
            continue
        D = nearest_rotation(own[[i, j]].T @ there[[i, j]])
        agree = np.linalg.norm(own - there @ D.T, axis=1) < AGREE
        count = int(agree.sum())
        if count >= 2 and (best is None or count > best[0]):
            best = count, nearest_rotation(own[agree].T @ there[agree])
    enough = best is not None and best[0] >= max(2, 0.6 * len(own))
    return best[1] if best is not None and enough else None
