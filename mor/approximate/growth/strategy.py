"""Start values for everything that has none: repeat until everything that can be known is known.

Given values are never overridden. What ties to them is worked out in the object system; what does not is oriented in a
part of its own (Rinner for images, a levelled local system for theodolites) and joined through common points. Where
nothing is given at all, the first part becomes the object system, scaled by the distances measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mor.approximate.growth.frames import Frame, image_frames, theodolite_frames
from mor.approximate.growth.grow_bundles import ENOUGH, FEWEST, grow_bundles, intersect_the_rest
from mor.approximate.growth.grow_levelled import grow_levelled
from mor.approximate.growth.joining import (
    join,
    scale_by_lengths,
    spread_positions,
    take_over,
    tied_by_positions,
)
from mor.approximate.growth.part import Part, empty_part
from mor.approximate.growth.seed_bundles import Pairs, common_pairs, seed_bundles
from mor.approximate.growth.seed_levelled import seed_levelled
from mor.approximate.growth.sightings import Sightings, sightings
from mor.approximate.growth.transfer import fill_in, starting_part, with_observed
from mor.approximate.terrestrial.sights import Terrestrial, terrestrial
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Undeterminable
from mor.geometry.rotations import rotation_from_angles
from mor.parameters.index import all_known
from mor.project.network.build import Network

FIRST_FRAMES = 20
"""Frames a part is grown by before given positions are asked whether they tie it."""


@dataclass(frozen=True)
class Approximation:
    """Start values, how each was obtained, and what is still missing."""

    start: Mapping[str, FloatArray]
    how: Mapping[str, str]
    """Name of a point, image or station → how its start value was obtained."""
    missing: tuple[Undeterminable, ...]
    """What has no start value yet, and why."""
    remarks: tuple[str, ...] = ()
    """Why frames could not begin a part of their own, where something is missing."""


@dataclass(frozen=True)
class Scene:
    """Everything measured, in the form the growth works with."""

    frames: tuple[Frame, ...]
    terrestrial: Terrestrial
    seen: Sightings
    """The rays of all frames."""
    points: int
    image_count: int
    measured: IntArray
    """Point blocks that images, theodolites or lengths refer to."""


def approximate(network: Network) -> Approximation:
    """Start values of a network; nothing is done where all are given."""
    if all_known(network.start):
        return Approximation(network.start, {}, ())
    network = replace(network, start=with_observed(network))
    scene = _scene(network)
    system = starting_part(network, scene.frames)
    reasons: list[str] = []
    for fewest in (ENOUGH, FEWEST):
        _grow(system, scene, fewest)
        reasons = _orient_the_rest(system, scene, fewest)
    intersect_the_rest(system, scene.seen)
    start, how, missing = fill_in(network, system, scene.frames, scene.terrestrial)
    return Approximation(start, how, missing, tuple(reasons) if missing else ())


def _scene(network: Network) -> Scene:
    images = image_frames(network)
    frames = (*images, *theodolite_frames(network))
    sights = terrestrial(network)
    used = [frame.points for frame in frames] + [np.array([frame.position]) for frame in frames]
    used += [sight.points for sight in sights.sights] + [np.array([s.position]) for s in sights.sights]
    for lengths in (sights.slopes, sights.horizontals, sights.height_differences, sights.vectors):
        used += [lengths.start, lengths.end]
    measured = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *used])).astype(np.int64)
    count = len(network.blocks["point"].ids)
    return Scene(frames, sights, sightings(frames, count), count, len(images), measured)


def _grow(part: Part, scene: Scene, fewest: int, most: int | None = None) -> bool:
    """Levelled and bundle growth in turns, until neither adds anything; false where ``most`` frames made it pause."""
    before = len(part.poses)
    while True:
        grown = grow_levelled(part, scene.terrestrial) if part.levelled else False
        _poses_of_sets(part, scene)
        grown |= grow_bundles(part, scene.frames, scene.seen, fewest, most)
        spread_positions(part, scene.frames)
        if not grown:
            return True
        if most is not None and len(part.poses) - before >= most:
            return False


def _grow_until_tied(system: Part, part: Part, scene: Scene, fewest: int) -> None:
    """Growth of a part of its own, only as far as needed where positions of its frames are given.

    In the object system every given position then holds the growth; alone, a large block would bend.
    """
    most = FIRST_FRAMES
    while not _grow(part, scene, fewest, most) and not tied_by_positions(system, part, scene.frames):
        most *= 2


def _poses_of_sets(part: Part, scene: Scene) -> None:
    """Oriented levelled sets are frames too: their rays intersect those of images."""
    by_rotation = {frame.rotation: n for n, frame in enumerate(scene.frames) if n >= scene.image_count}
    for number, kappa in part.kappas.items():
        sight = scene.terrestrial.sights[number]
        frame = by_rotation.get(sight.rotation)
        if frame is None or frame in part.poses or not np.isfinite(part.points[sight.position]).all():
            continue
        centre = part.points[sight.position] + np.array([0.0, 0.0, sight.height])
        part.poses[frame] = (centre, rotation_from_angles(np.array([[0.0, 0.0, kappa]]))[0])


def _orient_the_rest(system: Part, scene: Scene, fewest: int) -> list[str]:
    """Parts of their own for what does not tie to the object system, joined one after the other.

    Returned is why the frames that are left could not begin a part.
    """
    reasons: list[str] = []
    tried: set[int] = set()
    waiting: list[Part] = []
    given_up = np.zeros(len(scene.frames), dtype=bool)
    pairs: Pairs | None = None
    while True:
        part = seed_levelled(scene.terrestrial, _unknown_stations(system, scene), scene.points, tried)
        free = _free_frames(system, scene, waiting) & ~given_up
        if part is None and np.count_nonzero(free) > 1:
            pairs = common_pairs(scene.seen) if pairs is None else pairs
            part, reason = seed_bundles(scene.frames, free, pairs, scene.points)
            given_up |= free if part is None else False
            reasons += [reason] if reason else []
        if part is None and waiting and not system.poses and not system.kappas:
            # Nothing ties any part to what is given: the largest one becomes the object system as it is.
            part = max(waiting, key=_size)
            waiting.remove(part)
            _become(system, part, scene)
            _grow(system, scene, fewest)
            _join_all(system, waiting, scene, fewest)
            continue
        if part is None:
            return reasons
        _grow_until_tied(system, part, scene, fewest)
        waiting.append(part)
        _join_all(system, waiting, scene, fewest)


def _unknown_stations(system: Part, scene: Scene) -> set[int]:
    places = np.array([sight.position for sight in scene.terrestrial.sights], dtype=np.int64)
    return set(places[np.isnan(system.points[places, :2]).any(axis=1)].tolist())


def _free_frames(system: Part, scene: Scene, waiting: list[Part]) -> BoolArray:
    """Frames (n,) that neither the object system nor a part has a pose of."""
    free = np.ones(len(scene.frames), dtype=bool)
    for part in (system, *waiting):
        free[list(part.poses)] = False
    return free


def _join_all(system: Part, waiting: list[Part], scene: Scene, fewest: int) -> None:
    """Join what can be joined, again and again: a part may tie another one to the system."""
    joined = True
    while joined:
        joined = False
        for part in list(waiting):
            if _nothing_known(system, scene):
                _become(system, part, scene)
                waiting.remove(part)
                joined = True
            elif join(system, part, scene.frames):
                waiting.remove(part)
                joined = True
        if joined:
            _grow(system, scene, fewest)


def _size(part: Part) -> int:
    return len(part.poses) + len(part.kappas) + int(np.isfinite(part.points).sum())


def _nothing_known(system: Part, scene: Scene) -> bool:
    """True where no position that anything measured refers to is known."""
    return not system.poses and not np.isfinite(system.points[scene.measured, :2]).any()


def _become(system: Part, part: Part, scene: Scene) -> None:
    """The part becomes the object system."""
    spread_positions(part, scene.frames)
    if not part.scaled:
        t = scene.terrestrial
        scale_by_lengths(part, (t.slopes, t.horizontals), (False, True))
    components = range(3) if part.levelled and part.scaled else (2,) if part.levelled else ()
    for k in components:
        both = np.isfinite(system.points[:, k]) & np.isfinite(part.points[:, k])
        if both.any():
            part.points[:, k] += np.median(system.points[both, k] - part.points[both, k])
    take_over(system, part)
    system.levelled = part.levelled


__all__ = ["Approximation", "approximate", "empty_part"]
