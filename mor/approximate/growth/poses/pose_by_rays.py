"""Frames that see fewer known points than a resection takes, and others that posed frames see too.

A known point is two conditions, a point that a posed frame sees one: both rays and the base are coplanar. Six determine
the pose. Starts come in closed form, from three known points (Grunert), from two (the angle between them leaves the
centre on a surface of revolution about their line, which is sampled), or from the relative orientation to a posed frame
with five common points or more, whose base has the length that all conditions tell; they are adjusted together.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import direction_bundle
from mor.approximate.growth.seed_bundles import common_rays
from mor.approximate.observation_ties.robust_minimum import Minima, minima, some
from mor.approximate.parts.frames import SLACKS, loosened
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.approximate.relative_orientation.fitting import FEWEST, fitting_orientations
from mor.approximate.remembered import remembered
from mor.approximate.resection.three_points import nearly_resect_three_points
from mor.approximate.vectors import unit
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential

POSE = 6
CONTROLLED = 2
"""Conditions beyond those that a pose takes, from which on they tell it beyond doubt."""
MOST_KNOWN = 3
"""Known points up to which other rays are asked; with more it is a resection."""
FITS = 5.0
"""Units of what a ray is good to, up to which it agrees."""
CLEAR = 9.0
"""Difference of two objectives from which on one pose is told from another."""
OPEN = 0.1
"""σ of a pose (radians, or parts of the distance) from which on it is open."""
APART = 0.05
_ALONG, _AROUND = 24, 36
"""Places on the surface from which two points are seen under an angle."""
_SMALLEST = 1e-3
"""Angle (radians) between the rays of two points that such places are sampled of."""
_REMEMBERED = 512
"""Pairs that are not oriented again: every further ray, and every other answer tried, asks for the same ones."""


class Poses(NamedTuple):
    """Poses of a frame."""

    centre: FloatArray
    """(k, 3)"""
    rotation: FloatArray
    """(k, 3, 3) D"""


class Conditions(NamedTuple):
    """What a frame sees: known points, and points on rays of posed frames. The unknowns of its pose are about 1."""

    targets: FloatArray
    """(n, 3)"""
    rays: FloatArray
    """(n, 3) to them, unit vectors in the axes of the frame."""
    across: FloatArray
    """(n, 2, 3) unit vectors across these."""
    sigma: FloatArray
    """(n,) radians."""
    at: FloatArray
    """(m, 3) a place on a ray of a posed frame, its centre."""
    along: FloatArray
    """(m, 3) its direction."""
    other: FloatArray
    """(m, 3) the ray of the frame to the same point, in its axes."""
    other_sigma: FloatArray
    """(m,) radians, of both rays."""
    size: float
    """Distance that steps of the centre are parts of."""

    @property
    def unknowns(self) -> int:
        """Three of the centre, three of the attitude."""
        return POSE

    @property
    def equations(self) -> int:
        """Number of conditions."""
        return 2 * len(self.rays) + len(self.other)

    def residuals(self, poses: Poses) -> FloatArray:
        """(k, 2n + m) in units of what the rays are good to."""
        towards = unit((self.targets - poses.centre[:, None]) @ np.swapaxes(poses.rotation, 1, 2))
        away = np.arccos(np.clip(np.sum(towards * self.rays, axis=2), -1.0, 1.0))
        stretched = away / np.maximum(np.sin(away), 1e-12) / self.sigma
        off = np.einsum("nci,kni->knc", self.across, towards) * stretched[:, :, None]
        normal = unit(np.cross(self.at - poses.centre[:, None], self.along))
        coplanar = np.sum(normal * (self.other @ poses.rotation), axis=2) / self.other_sigma
        return np.concatenate([off.reshape(len(off), -1), coplanar], axis=1)

    def moved(self, states: Poses, steps: FloatArray) -> Poses:
        """Poses after steps (k, 6): parts of the size, radians."""
        turned = exponential(steps[:, 3:]) @ states.rotation
        return Poses(states.centre + self.size * steps[:, :3], turned)

    def ahead(self, pose: Poses) -> BoolArray:
        """(2n + m,) true where what a condition is about lies before the frame, and before the other one, too."""
        centre, D = pose.centre[0], pose.rotation[0]
        before = np.repeat(np.sum(((self.targets - centre) @ D.T) * self.rays, axis=1) > 0.0, 2)
        own, base = self.other @ D, self.at - centre
        cosine = np.sum(own * self.along, axis=1)
        # X = centre + s own = at + t along, nearest to each other
        a, b = np.sum(base * own, axis=1), np.sum(base * self.along, axis=1)
        square = np.maximum(1.0 - cosine**2, 1e-12)
        return np.concatenate([before, ((a - cosine * b) / square > 0.0) & (cosine * a - b > 0.0)])


def pose_by_rays(part: Part, scene: Scene, redundant: int = CONTROLLED, ambiguous: bool = False) -> bool:
    """Add the pose of a frame that few known points and rays of others determine; true where one was added.

    ``redundant``: conditions that agree beyond those it takes, at the least. ``ambiguous``: also one of several that
    fit alike.
    """
    frames = scene.rays_for(part)[0]
    for number in _with_enough(part, scene, POSE + redundant):
        frame = frames[number]
        known = np.count_nonzero(part.known(frame.points))
        conditions = _conditions(part, scene, number, SLACKS[1])
        asked = part.asked_for_poses
        key = number, redundant, ambiguous
        if conditions.equations < POSE + redundant or asked.get(key, 0) == conditions.equations:
            continue
        asked[key] = conditions.equations
        found = _found(part, scene, number, redundant, ambiguous)
        if found is not None:
            part.poses[number] = found.centre[0], found.rotation[0]
            part.how[frame.name] = rule(
                "resection from {count} points and {rays} rays of others",
                count=int(known),
                rays=len(conditions.other),
            )
            return True
    return False


def _with_enough(part: Part, scene: Scene, least: int) -> list[int]:
    """Frames without a pose, of few known points, that may have as many conditions."""
    seen = scene.rays_for(part)[1]
    posed = np.zeros(seen.frames, dtype=bool)
    posed[list(part.poses)] = True
    known = part.known(seen.point)
    beside = np.bincount(seen.point[posed[seen.frame]], minlength=scene.points)[seen.point]
    points = np.bincount(seen.frame, known, seen.frames)
    conditions = np.bincount(seen.frame, np.where(known, 2, beside), seen.frames)
    return np.flatnonzero(~posed & (points <= MOST_KNOWN) & (conditions >= least)).tolist()


def _found(part: Part, scene: Scene, number: int, redundant: int, ambiguous: bool) -> Poses | None:
    for slack in (s for s in SLACKS[1:3] if s >= part.slack):
        conditions = _conditions(part, scene, number, slack)
        starts = _starts(part, scene, number, conditions)
        if len(starts.centre) == 0:
            return None
        with np.errstate(all="ignore"):
            poses = _that_fit(conditions, minima(conditions, starts), redundant)
        if len(poses) == 1 or (ambiguous and poses):
            return poses[scene.choices.take(len(poses))]
        if poses:
            return None
    return None


def _that_fit(conditions: Conditions, found: Minima, redundant: int) -> list[Poses]:
    """Poses that all conditions agree with, the best first; none where the best one does not, or is open."""
    values = tolerant.singular_values(found.derivatives)
    if not np.isfinite(values).all() or values[-1] * OPEN < 1.0 or conditions.equations < POSE + redundant:
        return []
    poses: list[Poses] = []
    for k in range(len(found.objectives)):
        pose = some(Poses(*found.states), np.array([k]))
        if found.objectives[k] > found.objectives[0] + CLEAR or not np.all(np.abs(found.residuals[k]) < FITS):
            continue
        if conditions.ahead(pose).all() and all(_apart(pose, one, conditions.size) for one in poses):
            poses.append(pose)
    return poses


def _apart(one: Poses, other: Poses, size: float) -> bool:
    turned = np.trace(one.rotation[0] @ other.rotation[0].T) < 3.0 - APART**2
    return bool(turned or np.linalg.norm(one.centre - other.centre) > APART * size)


def _conditions(part: Part, scene: Scene, number: int, slack: float) -> Conditions:
    frames, seen = scene.rays_for(part)
    frame, known = frames[number], part.known(frames[number].points)
    targets = part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0])
    at, along, other, sigma = [], [], [], []
    for row in np.flatnonzero(~known).tolist():
        for ray in seen.of_points(frame.points[row : row + 1]).tolist():
            pose = part.poses.get(int(seen.frame[ray]))
            if pose is not None:
                at.append(pose[0] + [0.0, 0.0, float(frame.heights[row] - seen.height[ray])])
                along.append(pose[1].T @ seen.rays[ray])
                other.append(frame.rays[row])
                sigma.append(np.hypot(frame.sigma[row], seen.sigma[ray]))
    centres = np.array([centre for centre, _ in part.poses.values()]).reshape(-1, 3)
    near = np.concatenate([targets, centres])
    rays = frame.rays[known]
    return Conditions(
        targets,
        rays,
        tolerant.svd(rays[:, None, :])[2][:, 1:] if len(rays) else np.zeros((0, 2, 3)),
        loosened(frame.sigma[known], slack),
        np.array(at).reshape(-1, 3),
        np.array(along).reshape(-1, 3),
        np.array(other).reshape(-1, 3),
        loosened(np.array(sigma), slack),
        float(np.linalg.norm(near - near.mean(axis=0), axis=1).max(initial=0.0)) or 1.0,
    )


def _starts(part: Part, scene: Scene, number: int, conditions: Conditions) -> Poses:
    found = [Poses(np.zeros((0, 3)), np.zeros((0, 3, 3)))]
    known = len(conditions.rays)
    for three in combinations(range(known), 3):
        solved = nearly_resect_three_points(conditions.targets[[three]], conditions.rays[[three]])
        found.append(Poses(solved.positions, solved.rotations))
    if known == 2:
        found.append(_over_two(conditions.targets, conditions.rays))
    if known < 2:
        found.extend(_beside_others(part, scene, number, conditions))
    return Poses(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _over_two(targets: FloatArray, rays: FloatArray) -> Poses:
    """Poses (k) all over the surface from which two points (2, 3) are seen under the angle of their rays."""
    apart = float(np.arccos(np.clip(rays[0] @ rays[1], -1.0, 1.0)))
    if apart < _SMALLEST:
        return Poses(np.zeros((0, 3)), np.zeros((0, 3, 3)))
    line = targets[1] - targets[0]
    length = float(np.linalg.norm(line))
    u, (v, w) = line / length, tolerant.svd(line[None])[2][1:]
    at_first = (np.pi - apart) * (np.arange(_ALONG) + 0.5) / _ALONG
    about = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    a, phi = (grid.ravel() for grid in np.meshgrid(at_first, about, indexing="ij"))
    distance = length * np.sin(a + apart) / np.sin(apart)
    aside = np.cos(phi)[:, None] * v + np.sin(phi)[:, None] * w
    centre = targets[0] + distance[:, None] * (np.cos(a)[:, None] * u + np.sin(a)[:, None] * aside)
    theirs = _triads(unit(targets[0] - centre), unit(targets[1] - centre))
    own = _triads(rays[:1], rays[1:2])
    return Poses(centre, np.swapaxes(own, 1, 2) @ theirs)


def _triads(first: FloatArray, second: FloatArray) -> FloatArray:
    """(k, 3, 3) rows: the first direction, the normal of both, and their product."""
    normal = unit(np.cross(first, second))
    return np.stack([first, normal, np.cross(first, normal)], axis=1)


def _beside_others(part: Part, scene: Scene, number: int, conditions: Conditions) -> Iterator[Poses]:
    """Poses by relative orientation to each posed frame with enough common points, scaled by all conditions."""
    frames = scene.rays_for(part)[0]
    frame = frames[number]
    for other, (centre, D) in part.poses.items():
        at_other, at_own = common_rays(frames[other], frame)
        if len(at_own) >= FEWEST:
            theirs = frames[other].rays[at_other], frames[other].sigma[at_other]
            for base, turn in _orientations(*theirs, frame.rays[at_own], frame.sigma[at_own]):
                rotation, towards = turn @ D, D.T @ base
                length = _length(conditions, centre, towards, rotation)
                if np.isfinite(length) and length > 0.0:
                    yield Poses((centre + length * towards)[None], rotation[None])


@remembered(_REMEMBERED)
def _orientations(
    rays_of_one: FloatArray, sigma_of_one: FloatArray, rays_of_other: FloatArray, sigma_of_other: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    for slack in SLACKS[:-1]:
        one = direction_bundle(rays_of_one, loosened(sigma_of_one, slack))
        other = direction_bundle(rays_of_other, loosened(sigma_of_other, slack))
        found = fitting_orientations(one, other)
        if found:
            return [(seed.base, seed.rotation) for seed in found]
    return []


def _length(conditions: Conditions, centre: FloatArray, towards: FloatArray, D: FloatArray) -> float:
    """λ of a centre + λ towards, at an attitude: known points lie on their rays, other rays are coplanar."""
    rays, other = conditions.rays @ D, conditions.other @ D
    normals = np.cross(rays, towards)
    normals = np.cross(rays, np.where(np.linalg.norm(normals, axis=1)[:, None] > 1e-12, normals, 1.0))
    across = np.concatenate([unit(normals), unit(np.cross(other, conditions.along))])
    away = np.concatenate([conditions.targets, conditions.at]) - centre
    sigma = np.concatenate([conditions.sigma, conditions.other_sigma])
    by_length, off = across @ towards / sigma, np.sum(across * away, axis=1) / sigma
    square = float(by_length @ by_length)
    return float(by_length @ off) / square if square > 0.0 else np.nan


__all__ = ["pose_by_rays"]
