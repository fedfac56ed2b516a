"""A part grows by everything it can, in turns."""

from __future__ import annotations

import numpy as np

from mor.approximate.growth.grow_bundles import FEWEST, grow_bundles
from mor.approximate.growth.grow_levelled import grow_arcs, grow_levelled
from mor.approximate.growth.poses.pose_by_rays import pose_by_rays
from mor.approximate.growth.rigid_seeds import grow_polar
from mor.approximate.growth.single_points import grow_single_points
from mor.approximate.growth.trilateration import grow_distances
from mor.approximate.parts.joining import spread_positions, tied_by_positions
from mor.approximate.parts.level_and_scale import level_and_scale
from mor.approximate.parts.part import Part
from mor.approximate.parts.relative_poses import grow_relative
from mor.approximate.parts.scene import Scene
from mor.geometry.rotations import rotation_from_angles

FIRST_FRAMES = 20
"""Frames a part is grown by before given positions are asked whether they tie it."""


def grow(part: Part, scene: Scene, fewest: int, most: int | None = None) -> bool:
    """Growth of every kind in turns, until none adds anything; false where ``most`` frames made it pause."""
    before = len(part.poses)
    while not part.handed and _grow_shape(part, scene):
        pass
    while part.handed:
        grown = level_and_scale(part, scene)
        grown |= _grow_levelled(part, scene)
        _sets_and_poses(part, scene)
        grown |= grow_polar(part, scene)
        grown |= grow_relative(part, scene)
        grown |= grow_bundles(part, *scene.rays_for(part), fewest, most)
        grown = grown or grow_distances(part, scene.distances[1])
        grown = grown or grow_single_points(part, scene)
        grown = grown or (fewest <= FEWEST and pose_by_rays(part, scene))
        spread_positions(part, scene.frames)
        if not grown:
            return True
        if most is not None and len(part.poses) - before >= most:
            return False
    return True


def _grow_shape(part: Part, scene: Scene) -> bool:
    """What distances alone tell; directions would take a mirrored shape for right."""
    distances = scene.distances[1]
    return grow_arcs(part, distances) if part.levelled else grow_distances(part, distances)


def _grow_levelled(part: Part, scene: Scene) -> bool:
    return part.levelled and grow_levelled(part, scene.terrestrial, scene.distances[int(part.scaled)])


def grow_until_tied(system: Part, part: Part, scene: Scene, fewest: int) -> None:
    """Growth of a part of its own, only as far as needed where positions of its frames are given.

    In the object system every given position then holds the growth; alone, a large block would bend.
    """
    most = FIRST_FRAMES
    while not grow(part, scene, fewest, most) and not tied_by_positions(system, part, scene.frames):
        most *= 2


def _sets_and_poses(part: Part, scene: Scene) -> None:
    """Oriented levelled sets are frames too, and frames that stand upright are oriented sets."""
    if not part.levelled:
        return
    by_rotation = {frame.rotation: n for n, frame in enumerate(scene.frames) if n >= scene.image_count}
    for number, sight in enumerate(scene.terrestrial.sights):
        frame = by_rotation.get(sight.rotation)
        if frame is None or (number in part.kappas) == (frame in part.poses):
            continue
        if frame in part.poses:
            D = part.poses[frame][1]
            part.kappas[number] = float(np.arctan2(D[0, 1], D[0, 0]))
        elif np.isfinite(part.points[sight.position]).all():
            lift = sight.height if part.scaled else 0.0
            turn = rotation_from_angles(np.array([[0.0, 0.0, part.kappas[number]]]))[0]
            part.poses[frame] = (part.points[sight.position] + [0.0, 0.0, lift], turn)
