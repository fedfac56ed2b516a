"""All parts of a network, their levels and scales."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from mor.model import rotations
from mor.model.shapes import SHAPE_TYPES
from mor.project.network import Network
from mor.start.bundle import movement_by, sphere
from mor.start.movement import Movement
from mor.start.part import (
    Distances,
    Frame,
    Part,
    Sightings,
    bare_frames,
    given_pose,
    image_frames,
    rule,
    sightings,
    target_heights,
    theodolite_frames,
)
from mor.start.sights import (
    Choices,
    PositionDifferences,
    Terrestrial,
    bearing,
    frame_verticals,
    terrestrial,
)
from mor.types import FloatArray, IntArray

# ---- Points that differences tie to one another: their values up to a common shift.


class TiedPoints(NamedTuple):
    """Points tied by differences."""

    points: IntArray
    """(n,) blocks."""
    values: FloatArray
    """(n, m) heights or coordinates, the first point at zero."""


def clusters(differences: PositionDifferences) -> list[TiedPoints]:
    """Clusters by height differences (m = 1) or vectors (m = 3), heights of instrument and target taken off."""
    values = differences.value.copy()
    values[:, -1] += differences.start_height - differences.end_height
    whole = np.isfinite(values).all(axis=1)
    start, end, values = differences.start[whole], differences.end[whole], values[whole]
    if len(start) == 0:
        return []
    points, numbers = np.unique(np.concatenate([start, end]), return_inverse=True)
    a, b = numbers[: len(start)], numbers[len(start) :]
    edge = {(int(i), int(j)): v for i, j, v in zip((*a, *b), (*b, *a), (*values, *-values), strict=True)}
    graph = scipy.sparse.csr_array((np.ones(len(a)), (a, b)), shape=(len(points),) * 2)
    count, labels = connected_components(graph, directed=False)
    return [_cluster(graph, edge, points, int(np.flatnonzero(labels == k)[0])) for k in range(count)]


def _cluster(
    graph: scipy.sparse.csr_array, edge: dict[tuple[int, int], FloatArray], points: IntArray, first: int
) -> TiedPoints:
    order, before = breadth_first_order(graph, first, directed=False)
    placed = {first: np.zeros_like(next(iter(edge.values())))}
    for number in order[1:].tolist():
        placed[number] = placed[int(before[number])] + edge[int(before[number]), number]
    return TiedPoints(points[order], np.array([placed[number] for number in order.tolist()]))


# ---- Everything measured, in the form the growth of parts works with.


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
    up: FloatArray
    """(3,) the vertical in the axes of the system, NaN where it is not known."""


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
    level_lines: tuple[TiedPoints, ...]
    vector_clusters: tuple[TiedPoints, ...]
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
    )


def _marks(network: Network, frames: tuple[Frame, ...], measured: Terrestrial) -> IntArray:
    """Points that are measured themselves, not only by targets above them: frames, systems, vectors, levelling."""
    local = [group.blocks[4] for group in network.groups if group.type.name in ("local", *SHAPE_TYPES)]
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
    up = frame_verticals(network)
    marks = np.concatenate([network.things[kind].parts["position"] for kind in ("point", "station", "image")])
    for group in network.groups:
        if group.type.key != "local":
            continue
        origin, rotation, scale, offset, point = group.blocks
        seen = np.isfinite(group.observed)
        usable = (network.start["eccentricity"][offset] == 0.0).all(axis=1)
        usable &= seen.any(axis=1) if partial else seen.all(axis=1)
        about_axes = network.blocks["rotation"].about_axes
        usable &= True if about_axes is None else ~about_axes[rotation]
        for system in np.unique(rotation[usable]):
            rows = np.flatnonzero(usable & (rotation == system))
            points, coordinates = point[rows], group.observed[rows]
            if origin[rows[0]] in marks:
                points, coordinates = (np.append(points, origin[rows[0]]), np.vstack([coordinates, np.zeros(3)]))
            if len(points) < 3 or (partial and seen[rows].all()):
                continue
            block = scale[rows[0]]
            free = bool(network.blocks["scale"].free[block, 0])
            unit = 1.0 if free else float(network.start["scale"][block, 0])
            name = network.blocks["rotation"].ids[system]
            systems.append(
                LocalSystem(name, int(system), points.astype(np.int64), coordinates / unit, not free, up[system])
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
        n: start[frame.rotation] for n, frame in enumerate(frames) if frame.relative is None and known[frame.rotation]
    }


# ---- Frames posed by other frames: stereo followers and leaders by their pair.


def grow_relative(part: Part, scene: Scene) -> bool:
    """Add what pairs tell; true where anything was added."""
    added, frames = False, scene.rays_for(part)[0]
    for pair in scene.pairs:
        added |= _follow(part, frames, pair)
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


# ---- A part finds the vertical and the length unit from what was measured inside it.
#
# The vertical from posed frames that know it (levelled instruments, levels); the scale from distances, height
# differences, and bases of stereo pairs that are given. What nothing else levels is turned at last so that height
# differences fit.


def level_and_scale(part: Part, scene: Scene) -> bool:
    """Turn the part upright and bring it to the length unit, as far as it tells; true where it gained either."""
    lifted = part.lifts
    gained = not part.scaled and _scale(part, scene)
    if not part.levelled:
        gained |= _level_by_frames(part, scene.frames)
    if not part.scaled:
        gained |= _scale(part, scene)
    if part.lifts and not lifted:
        part.lower_to_marks(scene.target_heights)
    return gained


def _level_by_frames(part: Part, frames: Sequence[Frame]) -> bool:
    # (n, 3) the vertical in the axes of the part, of every posed frame that knows it.
    found = [D.T @ frames[n].up for n, (_, D) in part.poses.items() if np.isfinite(frames[n].up).all()]
    verticals = np.array(found).reshape(-1, 3)
    if len(verticals) == 0:
        return False
    # The vertical with which the others agree best: a wrong pose among several must not tilt the part.
    off = np.linalg.norm(verticals[:, None] - verticals[None], axis=2)
    centre = int(np.argmin(np.median(off, axis=1)))
    near = off[centre] <= max(3.0 * float(np.median(off[centre])), 1e-6)
    make_upright(part, verticals[near].mean(axis=0))
    return True


def make_upright(part: Part, vertical: FloatArray) -> None:
    """Turn a part so that a direction becomes its Z axis."""
    z = vertical / np.linalg.norm(vertical)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    part.transform(movement_by(rotation=np.stack([x, np.cross(z, x), z])))
    part.levelled = True


def level_roughly(part: Part, scene: Scene) -> bool:
    """Turn a part so that heights of instruments and height differences inside it fit as well as they can.

    True where it is upright after that.
    """
    lift = _lift(part, scene.frames)
    if not part.levelled and np.any(lift):
        make_upright(part, lift)
    difference, dz = _between_known(part, scene.level_lines)
    if part.levelled or len(dz) == 0:
        return part.levelled
    up = sphere(400)
    rise = up @ difference.T
    factor = np.ones(len(up))
    if not part.scaled:
        factor = np.maximum(rise @ dz, 0.0) / np.maximum(np.sum(rise**2, axis=1), 1e-300)
    cost = np.sum((factor[:, None] * rise - dz) ** 2, axis=1)
    # Factor of the misfits up to which two verticals fit alike.
    # Relative misfit beyond which height differences and points do not belong together.
    alike = up[cost <= max(3.0**2 * float(cost.min()), (0.05 * float(np.linalg.norm(dz))) ** 2)]
    best = up[int(np.argmin(cost))]
    if part.poses:  # those who see are above what they see, as far as nothing else tells
        seen = part.points[np.isfinite(part.points).all(axis=1)]
        above = np.mean([centre for centre, _ in part.poses.values()], axis=0) - (
            seen.mean(axis=0) if len(seen) else 0.0
        )
        best = alike[int(np.argmax(alike @ above))]
    for _ in range(20 if part.scaled else 0):
        across = difference - np.outer(difference @ best, best)
        best = best - rotations.lstsq(across, difference @ best - dz, rcond=1e-6)
        best = best / np.linalg.norm(best)
    make_upright(part, best)
    return True


def _lift(part: Part, frames: Sequence[Frame]) -> FloatArray:
    """(3,) sum of what leads up over one position: from its point to instrument, from instrument to instrument."""
    over: dict[int, list[tuple[float, FloatArray]]] = {}
    for number, (centre, _) in part.poses.items():
        frame = frames[number]
        if frame.stands:
            over.setdefault(frame.position, []).append((float(frame.offset[0]), centre))
    lift = np.zeros(3)
    for position, places in over.items():
        if np.isfinite(part.points[position]).all():
            places.append((0.0, part.points[position]))
        (low, below), (high, above) = min(places, key=lambda one: one[0]), max(places, key=lambda one: one[0])
        if high > low:
            lift += above - below
    return lift


def direct_roughly(part: Part, scene: Scene) -> None:
    """Turn a part about its Z axis so that the bearings between its points fit, whether or not it is upright."""
    known = np.asarray(np.isfinite(part.points[:, :2]).all(axis=1))
    turns = []
    for sight in scene.terrestrial.sights:
        if sight.oriented and known[sight.position] and known[sight.points].all():
            present = bearing(part.points[sight.position, :2], part.points[sight.points, :2])
            turns.append(np.exp(1j * (sight.directions - present)))
    if part.oriented or not turns:
        return
    turn = float(np.angle(np.mean(np.concatenate(turns))))
    c, s = np.cos(turn), np.sin(turn)
    part.transform(movement_by(rotation=np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])))


def _between_known(part: Part, lines: Sequence[TiedPoints]) -> tuple[FloatArray, FloatArray]:
    """Differences (n, 3) of known points and of their heights (n,), along lines of levelling of any length."""
    known = np.asarray(np.isfinite(part.points).all(axis=1))
    start, end, dz = [], [], []
    for line in lines:
        points = line.points[known[line.points]]
        values = line.values[known[line.points], 0]
        start.append(points[:-1])
        end.append(points[1:])
        dz.append(np.diff(values))
    if not start:
        return np.zeros((0, 3)), np.zeros(0)
    return part.points[np.concatenate(end)] - part.points[np.concatenate(start)], np.concatenate(dz)


def _scale(part: Part, scene: Scene) -> bool:
    measured = scene.terrestrial
    bases = np.array(
        [
            (float(np.linalg.norm(base)), float(np.linalg.norm(pair.base)))
            for pair in scene.pairs
            if np.isfinite(pair.base).all() and np.any(pair.base)
            for _, base in _posed(part, pair)
        ]
    ).reshape(-1, 2)
    spans = _spans(part, scene.frames, measured.slopes)
    ratios = [_ratios(spans, measured.slopes.value[:, 0]), _ratios(bases[:, 0], bases[:, 1])]
    if part.levelled:
        flat = part.points[:, :2][measured.horizontals.end] - part.points[:, :2][measured.horizontals.start]
        ratios.append(_ratios(np.linalg.norm(flat, axis=1), measured.horizontals.value[:, 0]))
    together = np.concatenate(ratios)
    if len(together) == 0 and part.levelled:
        difference, dz = _between_known(part, scene.level_lines)
        # Extension of height differences across their main direction, relative to that along, from which they level a
        # part.
        steep = np.abs(difference[:, 2]) > 0.02 * np.linalg.norm(difference, axis=1)
        together = dz[steep] / difference[steep, 2]
        together = together[together > 0.0]
    if len(together) == 0:
        return False
    part.transform(movement_by(float(np.median(together))))
    part.scaled = True
    forget_marks(part, scene)
    return True


def forget_marks(part: Part, scene: Scene) -> None:
    """Heights of marks below instruments, which without scale were those of the instruments, are not known any more."""
    places = [sight.position for sight in scene.terrestrial.sights if sight.height != 0.0]
    places += [frame.position for frame in scene.frames if frame.stands and frame.offset[0] != 0.0]
    marks = np.unique(np.array(places, dtype=np.int64))
    part.points[marks[~part.fixed[marks]], 2] = np.nan


def _ratios(present: FloatArray, measured: FloatArray) -> FloatArray:
    usable = np.isfinite(present) & (present > 0.0)
    return np.asarray(measured[usable] / present[usable])


def _spans(part: Part, frames: Sequence[Frame], lengths: PositionDifferences) -> FloatArray:
    """Present lengths (n,): from the centre of the instrument, where a frame at that height is posed, to the target."""
    start = part.points[lengths.start].copy()
    centres = {
        (frames[n].position, frames[n].height): centre
        for n, (centre, _) in part.poses.items()
        if frames[n].offset[0] != 0.0 and frames[n].stands
    }
    for i in np.flatnonzero(lengths.start_height != 0.0) if centres else ():
        key = int(lengths.start[i]), int(lengths.start_block[i])
        if key in centres:
            start[i] = centres[key]
    spans: FloatArray = np.linalg.norm(part.points[lengths.end] - start, axis=1)
    return spans
