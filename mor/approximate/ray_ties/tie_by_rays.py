"""Two parts, rays of each of which go to points of the other: the movement between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.approximate.parts.movement import Movement, Turn
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.ray_ties.movement_by_rays import Planes, movement_by_rays
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

CONTROLLED = 3
"""Planes beyond those that a movement takes, from which on they tell it beyond doubt."""
MOST = 100
"""Rays and points of each sort of which the movement is worked out."""

UP = np.array([0.0, 0.0, 1.0])

_Row = tuple[FloatArray, FloatArray, FloatArray, bool, float, FloatArray]


def tie_by_rays(target: Part, source: Part, scene: Scene, redundant: int = CONTROLLED) -> Movement | None:
    """The movement from source to target by rays of each to points of the other, and by common points.

    ``None`` where fewer planes than ``redundant`` beyond those it takes agree with one.
    """
    rows = [*_of_rays(target, source, scene, False), *_of_sights(target, source, scene, False)]
    rows += [*_of_rays(source, target, scene, True), *_of_sights(source, target, scene, True)]
    if not rows:
        return None
    rows += _of_points(target, source, scene)
    columns = list(zip(*rows, strict=True))
    both = source.levelled and target.levelled
    turn = (Turn.NONE if source.oriented and target.oriented else Turn.VERTICAL) if both else Turn.ANY
    planes = Planes(
        np.array(columns[0]),
        np.array(columns[1]),
        np.array(columns[2]),
        np.array(columns[3]),
        np.array(columns[4]),
        np.array(columns[5]),
    )
    return movement_by_rays(planes, turn, source.scaled and target.scaled, redundant)


def _evenly(rows: IntArray) -> IntArray:
    """Some of the rows where there are very many."""
    return rows if len(rows) <= MOST else rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]


def _of_rays(part: Part, other: Part, scene: Scene, of_source: bool) -> Iterator[_Row]:
    """Two planes for each ray of a part to a point that only the other one knows."""
    seen = scene.rays_for(part)[1]
    posed = np.zeros(seen.frames, dtype=bool)
    posed[list(part.poses)] = True
    told = posed[seen.frame] & other.known(seen.point) & ~part.known(seen.point)
    for ray in _evenly(np.flatnonzero(told)).tolist():
        place = _raised(part, other, scene, int(seen.point[ray]), float(seen.height[ray]))
        centre, D = part.poses[int(seen.frame[ray])]
        towards = D.T @ seen.rays[ray]
        for normal in tolerant.svd(towards[None])[2][1:]:
            yield normal, centre - place[1] * UP, place[0], of_source, 0.0, towards


def _raised(part: Part, other: Part, scene: Scene, point: int, height: float) -> tuple[FloatArray, float]:
    """The point as the other part has it, raised to its target there, or else by how much it is to be here."""
    stands = float(scene.target_heights[point])
    place = other.points[point]
    if not part.lifts:
        return (place + stands * UP, 0.0) if other.lifts else (place, 0.0)
    if other.lifts:
        return (place, height) if other.levelled and part.levelled else (place + height * UP, 0.0)
    return place, height - stands


def _of_sights(part: Part, other: Part, scene: Scene, of_source: bool) -> Iterator[_Row]:
    """One plane for each horizontal direction of an oriented set to a point that only the other part knows."""
    if not part.levelled:
        return
    middle = _middle(part)
    posed = {scene.frames[number].rotation for number in part.poses}
    for number, kappa in part.kappas.items():
        sight = scene.terrestrial.sights[number]
        place = part.points[sight.position]
        if sight.rotation in posed or not np.isfinite(place[:2]).all():
            continue
        told = other.known(sight.points) & np.isnan(part.points[sight.points, :2]).any(axis=1)
        for k in np.flatnonzero(told & np.isfinite(sight.directions)).tolist():
            t = float(sight.directions[k]) - kappa
            towards = np.array([np.sin(t), np.cos(t), 0.0])
            normal = np.array([np.cos(t), -np.sin(t), 0.0])
            point = other.points[int(sight.points[k])]
            yield normal, np.where(np.isfinite(place), place, middle), point, of_source, 0.0, towards


def _of_points(target: Part, source: Part, scene: Scene) -> Iterator[_Row]:
    """A plane for each component that the target knows of a point of the source."""
    rows: IntArray = np.flatnonzero(
        source.known(np.arange(scene.points)) & np.isfinite(target.points).any(axis=1)
    )
    if len(rows) == 0:
        return
    known, middle = target.points[np.isfinite(target.points).all(axis=1)], _middle(target)
    size = float(np.linalg.norm(np.ptp(known, axis=0))) if len(known) > 1 else 1.0
    for row in _evenly(rows).tolist():
        place, goal = source.points[row].copy(), target.points[row].copy()
        if target.lifts is not source.lifts:
            (goal if target.lifts else place)[2] += scene.target_heights[row]
        for axis in np.flatnonzero(np.isfinite(goal)).tolist():
            at = np.where(np.isfinite(goal), goal, middle)
            yield np.eye(3)[axis], at, place, False, size, np.zeros(3)


def _middle(part: Part) -> FloatArray:
    """(3,) of what is known of its points, 0 where nothing is: it stands for components that do not matter."""
    known = np.isfinite(part.points)
    middle: FloatArray = np.where(known, part.points, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return middle


__all__ = ["tie_by_rays"]
