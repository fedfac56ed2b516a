"""Everything measured, in the form the growth of parts works with."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mor.approximate.choices import Choices
from mor.approximate.parts.distances import Distances
from mor.approximate.parts.frames import Frame, given_pose, image_frames, theodolite_frames
from mor.approximate.parts.movement import Movement
from mor.approximate.parts.part import Part
from mor.approximate.parts.sightings import Sightings, bare_frames, sightings, target_heights
from mor.approximate.terrestrial.clusters import Cluster, clusters
from mor.approximate.terrestrial.sights import Terrestrial, terrestrial
from mor.arrays import FloatArray, IntArray
from mor.project.network.build import Network


class StereoPair(NamedTuple):
    """A relative orientation: frames of leader and follower that have it, and what is given of it."""

    members: tuple[tuple[int, int], ...]
    turn: FloatArray
    """(3, 3) from leader to follower, NaN where not given."""
    base: FloatArray
    """(3,) in the axes of the leader, NaN where not given."""
    known: dict[int, tuple[FloatArray, FloatArray]]
    """Follower → (projection centre, rotation D) of its leader, where that is given."""


class LocalSystem(NamedTuple):
    """Points measured in a system of their own."""

    name: str
    rotation: int
    points: IntArray
    coordinates: FloatArray
    """(n, 3) all three known; NaN among those of a system in part."""
    scaled: bool
    """True where its length unit is that of the network."""


@dataclass(frozen=True)
class Scene:
    """Everything measured, in the form the growth works with."""

    frames: tuple[Frame, ...]
    terrestrial: Terrestrial
    seen: Sightings
    """The rays of all frames."""
    target_heights: FloatArray
    """(points,) height of the target that a point stands for in parts without vertical or scale."""
    bare: tuple[tuple[Frame, ...], Sightings]
    """Frames and rays as such parts use them."""
    points: int
    image_count: int
    measured: IntArray
    """Point blocks that images, theodolites or lengths refer to."""
    pairs: tuple[StereoPair, ...]
    level_lines: tuple[Cluster, ...]
    vector_clusters: tuple[Cluster, ...]
    systems: tuple[LocalSystem, ...]
    partial_systems: tuple[LocalSystem, ...]
    """Those of which single coordinates are measured, with all their points."""
    with_surfaces: IntArray
    """Points of distances, horizontal and vertical directions, and single coordinates of a system."""
    sights_to: dict[int, list[int]]
    """Of these points: the numbers of the levelled sets that see them."""
    attitudes: dict[int, FloatArray]
    """Frame → rotation D that is fixed or observed."""
    distances: tuple[Distances, Distances]
    """Of parts without scale, and of those that have it."""
    shared: dict[tuple[int, float], list[int]]
    """Position block and height above it → the frames with that centre, where there are several."""
    choices: Choices = field(default_factory=Choices)
    """Which of several answers that fit alike are taken."""
    tied: dict[bytes, Movement | None] = field(default_factory=dict)
    """Movements that all observations between two parts told, by what was asked."""

    def rays_for(self, part: Part) -> tuple[tuple[Frame, ...], Sightings]:
        """The frames and rays that a part can use."""
        return (self.frames, self.seen) if part.lifts else self.bare


def scene_of(network: Network) -> Scene:
    """Frames, sights, lengths, pairs and systems of a network."""
    images = image_frames(network)
    frames = (*images, *theodolite_frames(network))
    sights = terrestrial(network)
    used = [frame.points for frame in frames] + [np.array([frame.position]) for frame in frames]
    used += [sight.points for sight in sights.sights] + [np.array([s.position]) for s in sights.sights]
    for lengths in (sights.slopes, sights.horizontals, sights.height_differences, sights.vectors):
        used += [lengths.start, lengths.end]
    measured = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *used])).astype(np.int64)
    count = len(network.blocks["point"].ids)
    partial = _systems(network, partial=True)
    ends = [sights.slopes.start, sights.slopes.end, sights.verticals.start, sights.verticals.end]
    ends += [sight.points for sight in sights.sights]
    surfaced = np.unique(np.concatenate([*ends, *(one.points for one in partial)])).astype(np.int64)
    seen = sightings(frames, count)
    heights = target_heights(frames, count, _marks(network, frames, sights))
    bare = frames, seen
    if seen.height.any():
        lowered = bare_frames(frames, heights)
        bare = lowered, sightings(lowered, count)
    return Scene(
        frames,
        sights,
        seen,
        heights,
        bare,
        count,
        len(images),
        measured,
        _pairs(network, frames),
        tuple(clusters(sights.height_differences)),
        tuple(clusters(sights.vectors)),
        _systems(network, partial=False),
        partial,
        surfaced,
        _sights_to(sights, surfaced),
        _attitudes(network, frames),
        (Distances(sights, False), Distances(sights, True)),
        _shared(frames),
    )


def _marks(network: Network, frames: tuple[Frame, ...], measured: Terrestrial) -> IntArray:
    """Points that are measured themselves, not only by targets above them: frames, systems, vectors, levelling."""
    local = [group.blocks[-1] for group in network.groups if group.type.key == "local"]
    lines = measured.height_differences, measured.vectors
    ends = [end for lengths in lines for end in (lengths.start, lengths.end)]
    places = np.array([frame.position for frame in frames], dtype=np.int64)
    return np.unique(np.concatenate([places, *local, *ends])).astype(np.int64)


def _pairs(network: Network, frames: tuple[Frame, ...]) -> tuple[StereoPair, ...]:
    leaders = {frame.rotation: n for n, frame in enumerate(frames) if frame.relative is None}
    members: dict[tuple[int, int], list[tuple[int, int]]] = {}
    known: dict[tuple[int, int], dict[int, tuple[FloatArray, FloatArray]]] = {}
    for number, frame in enumerate(frames):
        if frame.relative is None:
            continue
        found = members.setdefault(frame.relative, [])
        if frame.rotation in leaders:
            found.append((leaders[frame.rotation], number))
        pose = given_pose(network, frame)
        if pose is not None:
            known.setdefault(frame.relative, {})[number] = pose
    start = network.start
    return tuple(
        StereoPair(tuple(found), start["rotation"][turn], start["base"][base], known.get((turn, base), {}))
        for (turn, base), found in members.items()
    )


def _systems(network: Network, partial: bool) -> tuple[LocalSystem, ...]:
    """Systems in which points are known in all three coordinates, or, ``partial``, in single ones; no features."""
    systems = []
    for group in network.groups:
        if group.type.key != "local":
            continue
        _, rotation, scale, offset, point = group.blocks
        seen = np.isfinite(group.observed)
        usable = (network.start["eccentricity"][offset] == 0.0).all(axis=1)
        usable &= seen.any(axis=1) if partial else seen.all(axis=1)
        about_axes = network.blocks["rotation"].about_axes
        usable &= True if about_axes is None else ~about_axes[rotation]
        for system in np.unique(rotation[usable]):
            rows = np.flatnonzero(usable & (rotation == system))
            if len(rows) < 3 or (partial and seen[rows].all()):
                continue
            block = scale[rows[0]]
            free = bool(network.blocks["scale"].free[block, 0])
            unit = 1.0 if free else float(network.start["scale"][block, 0])
            name = network.blocks["rotation"].ids[system]
            coordinates = group.observed[rows] / unit
            systems.append(
                LocalSystem(name, int(system), point[rows].astype(np.int64), coordinates, not free)
            )
    return tuple(systems)


def _sights_to(measured: Terrestrial, points: IntArray) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {p: [] for p in points.tolist()}
    for number, sight in enumerate(measured.sights):
        for p in sight.points.tolist():
            if p in found:
                found[p].append(number)
    return found


def _attitudes(network: Network, frames: tuple[Frame, ...]) -> dict[int, FloatArray]:
    if "rotation" not in network.start:
        return {}
    blocks, start = network.blocks["rotation"], network.start["rotation"]
    held = ~blocks.free | np.isfinite(network.sigma["rotation"])
    known = np.asarray(held.all(axis=1) & np.isfinite(start).all(axis=(1, 2)))
    return {
        n: start[frame.rotation]
        for n, frame in enumerate(frames)
        if frame.relative is None and known[frame.rotation]
    }


def _shared(frames: tuple[Frame, ...]) -> dict[tuple[int, float], list[int]]:
    found: dict[tuple[int, float], list[int]] = {}
    for number, frame in enumerate(frames):
        if frame.relative is None:
            found.setdefault((frame.position, float(frame.offset[0])), []).append(number)
    return {key: numbers for key, numbers in found.items() if len(numbers) > 1}
