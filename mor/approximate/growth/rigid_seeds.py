"""Parts that are there from the start: systems with measured coordinates, GNSS vectors, tilted total stations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.arrays import FloatArray


def rigid_seeds(scene: Scene) -> Iterator[Part]:
    """Every part of points that were measured in one system of their own."""
    for system in scene.systems:
        part = empty_part(scene.points)
        part.points[system.points] = system.coordinates
        part.scaled = system.scaled
        part.began = rule("coordinates in {one}", one=system.name)
        part.how |= {f"point {p}": part.began for p in system.points.tolist()}
        yield part
    for cluster in scene.vector_clusters:
        part = empty_part(scene.points)
        part.points[cluster.points] = cluster.values
        part.began = rule("vector")
        part.levelled = part.oriented = part.scaled = True
        part.how |= {f"point {p}": part.began for p in cluster.points.tolist()}
        yield part


def seed_polar(scene: Scene, free: list[int]) -> Part | None:
    """The axes of the first free instrument that measured distances and is not upright; its points are polar points."""
    for number in free:
        if len(polar_points(scene, scene.bare[0], number)) >= 3:
            part = empty_part(scene.points)
            part.poses[number] = (np.zeros(3), np.eye(3))
            part.scaled = True
            part.began = rule("axes of {one}", one=scene.frames[number].name)
            part.how[scene.frames[number].name] = part.began
            return part
    return None


def polar_points(scene: Scene, frames: Sequence[Frame], number: int) -> dict[int, FloatArray]:
    """Point → its coordinates (3,) in the axes of an instrument, where ray and distance were measured."""
    frame, slopes = frames[number], scene.terrestrial.slopes
    rows = np.flatnonzero((slopes.start == frame.position) & (slopes.start_block == frame.height))
    length = dict(zip(slopes.end[rows].tolist(), slopes.value[rows, 0], strict=True))
    return {
        p: length[p] * ray for p, ray in zip(frame.points.tolist(), frame.rays, strict=True) if p in length
    }


def grow_polar(part: Part, scene: Scene) -> bool:
    """Add points by ray and distance from posed instruments; true where anything was added."""
    if not part.scaled:
        return False
    added, frames = False, scene.rays_for(part)[0]
    for number in range(scene.image_count, len(frames)):
        if number not in part.poses or part.known(frames[number].points).all():
            continue
        centre, D = part.poses[number]
        frame = frames[number]
        heights = dict(zip(frame.points.tolist(), frame.heights, strict=True))
        for point, star in polar_points(scene, frames, number).items():
            if np.isnan(part.points[point]).any():
                part.points[point] = centre + D.T @ star - [0.0, 0.0, heights[point]]
                part.how[f"point {point}"] = rule("polar from {one}", one=frame.name)
                added = True
    return added
