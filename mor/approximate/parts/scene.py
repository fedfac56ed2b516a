"""Everything measured, in the form the growth of parts works with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.approximate.parts.distances import Distances
from mor.approximate.parts.frames import Frame, given_pose, image_frames, theodolite_frames
from mor.approximate.parts.sightings import Sightings, sightings
from mor.approximate.terrestrial.clusters import Cluster, clusters
from mor.approximate.terrestrial.sights import Terrestrial, terrestrial
from mor.arrays import FloatArray, IntArray
from mor.project.network.build import Network


@dataclass(frozen=True)
class StereoPair:
    """A relative orientation: frames of leader and follower that have it, and what is given of it."""

    members: tuple[tuple[int, int], ...]
    turn: FloatArray
    """(3, 3) from leader to follower, NaN where not given."""
    base: FloatArray
    """(3,) in the axes of the leader, NaN where not given."""
    known: dict[int, tuple[FloatArray, FloatArray]]
    """Follower → (projection centre, rotation D) of its leader, where that is given."""


@dataclass(frozen=True)
class LocalSystem:
    """Points measured in a system of their own."""

    name: str
    rotation: int
    points: IntArray
    coordinates: FloatArray
    """(n, 3) all three known."""
    scaled: bool
    """True where its length unit is that of the network."""


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
    pairs: tuple[StereoPair, ...]
    level_lines: tuple[Cluster, ...]
    vector_clusters: tuple[Cluster, ...]
    systems: tuple[LocalSystem, ...]
    attitudes: dict[int, FloatArray]
    """Frame → rotation D that is fixed or observed."""
    distances: tuple[Distances, Distances]
    """Of parts without scale, and of those that have it."""
    shared: dict[tuple[int, float], list[int]]
    """Position block and height above it → the frames with that centre, where there are several."""


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
    return Scene(
        frames,
        sights,
        sightings(frames, count),
        count,
        len(images),
        measured,
        _pairs(network, frames),
        tuple(clusters(sights.height_differences)),
        tuple(clusters(sights.vectors)),
        _systems(network),
        _attitudes(network, frames),
        (Distances(sights, False), Distances(sights, True)),
        _shared(frames),
    )


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


def _systems(network: Network) -> tuple[LocalSystem, ...]:
    """Systems in which points are known in all three coordinates; features are none."""
    systems = []
    for group in network.groups:
        if group.type.key != "local":
            continue
        _, rotation, scale, offset, point = group.blocks
        whole = np.isfinite(group.observed).all(axis=1)
        whole &= (network.start["eccentricity"][offset] == 0.0).all(axis=1)
        for system in np.unique(rotation[whole]):
            rows = np.flatnonzero(whole & (rotation == system))
            if len(rows) >= 3:
                block = scale[rows[0]]
                free = bool(network.blocks["scale"].free[block, 0])
                unit = 1.0 if free else float(network.start["scale"][block, 0])
                name = network.blocks["rotation"].ids[system]
                coordinates = group.observed[rows] / unit
                systems.append(
                    LocalSystem(name, int(system), point[rows].astype(np.int64), coordinates, not free)
                )
    return tuple(systems)


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
