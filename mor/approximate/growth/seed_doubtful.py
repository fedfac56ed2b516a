"""Begin a part where no pair of frames is oriented beyond doubt: a third frame tells which of the orientations holds.

Five to seven common points, points in a plane and weak pairs leave several orientations, or one of which σ does not
hold. Each is tried: the part that grows from it is judged by the rays that agree with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.approximate.bundle import direction_bundle
from mor.approximate.growth.seed_bundles import Pairs, by_parallax, common_rays
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.approximate.relative_orientation.fitting import FEWEST, fitting_orientations
from mor.approximate.relative_orientation.two_bundles import Seed as Orientation
from mor.arrays import IntArray

PAIRS_TRIED = 8
FRAMES_TRIED = 4
"""Frames by which a part is grown before it is judged."""
TRUNCATION = 5.0
"""σ from which on a ray speaks for nothing."""

Grow = Callable[[Part, int], object]
"""Grows a part by a number of frames."""


def seed_doubtful(scene: Scene, among: IntArray, pairs: Pairs, grow: Grow) -> Part | None:
    """A part of the pair ``among`` some whose best orientation the most rays of further frames agree with.

    Where no further frame can be posed, a pair of which a single orientation fits begins it, weak as it may be, and at
    the very last the one of several that fits best; five points control nothing.
    """
    both = among[pairs.common[among] >= FEWEST]
    frames = scene.bare[0]
    best: tuple[float, Part | None] = (0.0, None)
    several: list[tuple[float, Part]] = []
    ordered = by_parallax(frames, pairs.first[both], pairs.second[both], pairs.common[both])
    for i, j in ordered[:PAIRS_TRIED]:
        judged: list[tuple[float, Part]] = []
        for part in _candidates(scene, i, j):
            grow(part, FRAMES_TRIED)
            judged.append((support(part, scene.rays_for(part)[0]), part))
        judged.sort(key=lambda one: -one[0])
        controlled = len(common_rays(frames[i], frames[j])[0]) > FEWEST
        if judged and (len(judged[0][1].poses) > 2 or (controlled and len(judged) == 1)):
            best = max(best, judged[0], key=lambda one: one[0])
        elif judged and controlled:
            several = max(several, judged, key=lambda one: one[0][0] if one else 0.0)
    if best[1] is not None or not several:
        return best[1]
    return several[scene.choices.take(len(several))][1]


def _candidates(scene: Scene, i: int, j: int) -> list[Part]:
    """Parts of two frames, one for each orientation that fits, with the smallest slack with which any does."""
    one, other = scene.bare[0][i], scene.bare[0][j]
    at_i, at_j = common_rays(one, other)
    for slack in SLACKS[:-1]:
        a = direction_bundle(one.rays[at_i], loosened(one.sigma[at_i], slack))
        b = direction_bundle(other.rays[at_j], loosened(other.sigma[at_j], slack))
        found = fitting_orientations(a, b)
        if found:
            return [_part(scene, i, j, seed, slack, len(at_i), len(found)) for seed in found]
    return []


def _part(scene: Scene, i: int, j: int, seed: Orientation, slack: float, common: int, of: int) -> Part:
    one, other = scene.frames[i].name, scene.frames[j].name
    part = empty_part(scene.points)
    part.slack = slack
    part.poses[i], part.poses[j] = (np.zeros(3), np.eye(3)), (seed.base, seed.rotation)
    part.began = rule(
        "relative orientation of {one} and {other}, {count} points, one of {of} that fit: most rays agree with it",
        one=one,
        other=other,
        count=common,
        of=of,
    )
    part.how[one] = part.how[other] = part.began
    return part


def support(part: Part, frames: Sequence[Frame]) -> float:
    """How much the rays of posed frames speak for a part: Σ max(0, 25 − (v/σ)²) over those to known points."""
    total = 0.0
    for number, (centre, D) in part.poses.items():
        frame = frames[number]
        known = part.known(frame.points)
        star = part.points[frame.points[known]] - centre
        star[:, 2] += frame.heights[known]
        star = star @ D.T
        star /= np.linalg.norm(star, axis=1, keepdims=True)
        off = np.linalg.norm(star - frame.rays[known], axis=1) / loosened(frame.sigma[known], part.slack)
        total += float(np.sum(np.maximum(TRUNCATION**2 - off**2, 0.0)))
    return total
