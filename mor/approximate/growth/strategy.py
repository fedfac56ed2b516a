"""Start values for everything that has none: parts grow, join, and become the object system.

A part is a set of things in one system with the movements it is still free to make. The object system, with what the
project gives, is one of them; others begin at systems with measured coordinates, GNSS vectors, stations with distances,
pairs of bundles. Every part grows as far as it can, finds the vertical and the scale from what was measured inside it,
and joins another one as soon as what ties them determines the movement between them. What nothing ties comes last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mor.approximate.growth.bearing_network import grow_by_bearings
from mor.approximate.growth.grow_bundles import ENOUGH, FEWEST, grow_bundles, intersect_the_rest
from mor.approximate.growth.grow_levelled import begin_heights, grow_arcs, grow_levelled
from mor.approximate.growth.mixed_intersection import grow_mixed
from mor.approximate.growth.rigid_seeds import grow_polar, rigid_seeds, seed_polar
from mor.approximate.growth.seed_bundles import Pairs, common_pairs, seed_bundles
from mor.approximate.growth.seed_levelled import seed_levelled
from mor.approximate.growth.seed_plan import seed_plan
from mor.approximate.growth.trilateration import grow_distances, place_by_few_distances, seed_distances
from mor.approximate.parts.contradictions import (
    Contradiction,
    contradicting_frames,
    contradicting_points,
    put_back,
    without,
)
from mor.approximate.parts.frames import Frame
from mor.approximate.parts.history import Join
from mor.approximate.parts.joining import (
    carry,
    join,
    spread_positions,
    stand_on_marks,
    tie,
    tied_by_positions,
)
from mor.approximate.parts.level_and_scale import (
    direct_roughly,
    level_and_scale,
    level_roughly,
    scale_roughly,
)
from mor.approximate.parts.part import Part
from mor.approximate.parts.relative_poses import grow_relative
from mor.approximate.parts.rule import Rule
from mor.approximate.parts.scene import Scene, scene_of
from mor.approximate.parts.transfer import fill_in, starting_part, with_observed
from mor.approximate.standing_still import at_all_times, standing_still
from mor.approximate.terrestrial.on_the_earth import to_plane
from mor.approximate.terrestrial.projection_centres import to_places
from mor.approximate.terrestrial.sights import Sight
from mor.arrays import BoolArray, FloatArray
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
    how: Mapping[str, Rule]
    """Name of a point, image or station → how its start value was obtained."""
    missing: tuple[Undeterminable, ...]
    """What has no start value yet, and why."""
    remarks: tuple[Rule, ...] = ()
    """Why frames could not begin a part of their own, where something is missing."""
    replaced: tuple[str, ...] = ()
    """Given start values that the observations contradict, which others took the place of."""
    parts: tuple[Join, ...] = ()
    """The parts that began beside the object system, in the order in which they joined another one."""
    frames: tuple[Frame, ...] = ()
    """Images and theodolite sets by the numbers they have in ``parts``."""
    sights: tuple[Sight, ...] = ()
    """Levelled sets by the numbers they have in ``parts``."""


@dataclass
class _Assembly:
    """Parts on their way to one system, the object system first, and what was tried."""

    scene: Scene
    parts: list[Part]
    fewest: int = ENOUGH
    tried_stations: set[int] = field(default_factory=set)
    tried_shapes: set[tuple[int, ...]] = field(default_factory=set)
    tried_frames: set[frozenset[int]] = field(default_factory=set)
    """Frames that parts began with: what joined and lost its poses again would begin for ever."""
    given_up: BoolArray = field(default_factory=lambda: np.zeros((2, 0), dtype=bool))
    """(2, frames) of which no two, or none with a neighbour in a part, can be oriented relative to each other."""
    pairs: Pairs | None = None
    reasons: list[Rule] = field(default_factory=list)
    begun: int = 0
    """Parts that have begun so far, the object system aside."""


def approximate(network: Network) -> Approximation:
    """Start values of a network; nothing is done where all are given.

    Given poses and points that are start values and no more are tested against the rays; those that contradict are
    replaced where the rest can be worked out without them.
    """
    if all_known(network.start):
        return Approximation(network.start, {}, ())
    moving = network
    network = to_plane(standing_still(network))
    network = to_places(replace(network, start=with_observed(network)))
    scene = scene_of(network)
    assembly = _assembled(network, scene)
    found = _contradicting(network, assembly.parts[0], scene)
    better = _with_others(network, scene, found) if found else None
    result = _approximation(network, assembly) if better is None else better
    return replace(result, start=at_all_times(moving, result.start))


def _contradicting(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    return contradicting_frames(network, system, scene) + contradicting_points(network, system, scene)


def _with_others(network: Network, scene: Scene, found: list[Contradiction]) -> Approximation | None:
    """Start values without the poses and points that contradict; ``None`` where not everything starts without them.

    One that contradicts only because another one had spoiled what it is tied to stays as it was given.
    """
    reduced = replace(network, start=without(network, scene, found))
    assembly = _assembled(reduced, scene)
    approximation = _approximation(reduced, assembly)
    if approximation.missing:
        return None
    wrong = _contradicting(network, assembly.parts[0], scene)
    names = {one.name for one in wrong}
    start = {kind: values.copy() for kind, values in approximation.start.items()}
    put_back(network, scene, start, [one for one in found if one.name not in names])
    return replace(approximation, start=start, replaced=tuple(str(one) for one in wrong))


def _assembled(network: Network, scene: Scene) -> _Assembly:
    """All parts in the object system."""
    parts = [starting_part(network, scene.frames), *rigid_seeds(scene)]
    assembly = _Assembly(scene, parts, begun=len(parts) - 1)
    for number, part in enumerate(parts):
        part.number = number
    for fewest in (ENOUGH, FEWEST):
        assembly.fewest, assembly.reasons = fewest, []
        assembly.given_up, assembly.tried_stations = np.zeros((2, len(scene.frames)), dtype=bool), set()
        assembly.tried_frames = set()
        for part in parts:
            _grow(part, scene, fewest)
        _assemble(assembly)
    _place_the_rest(assembly)
    stand_on_marks(parts[0], scene)
    intersect_the_rest(parts[0], scene.seen)
    if grow_mixed(parts[0], scene, contradicting=True):
        _grow(parts[0], scene, FEWEST)
    return assembly


def _approximation(network: Network, assembly: _Assembly) -> Approximation:
    scene = assembly.scene
    start, how, missing = fill_in(network, assembly.parts[0], scene.frames, scene.terrestrial)
    reasons, parts = tuple(assembly.reasons) if missing else (), tuple(assembly.parts[0].joined)
    return Approximation(start, how, missing, reasons, (), parts, scene.frames, scene.terrestrial.sights)


def _assemble(assembly: _Assembly) -> None:
    """Begin parts, grow them and join them until nothing more can be begun or joined."""
    scene, parts = assembly.scene, assembly.parts
    while True:
        _join_all(assembly)
        part = _next_seed(assembly)
        if part is not None:
            assembly.begun += 1
            part.number = assembly.begun
            _grow_until_tied(parts[0], part, scene, assembly.fewest)
            parts.append(part)
        elif not _join_all(assembly, ambiguous=True):
            return


def _grow(part: Part, scene: Scene, fewest: int, most: int | None = None) -> bool:
    """Growth of every kind in turns, until none adds anything; false where ``most`` frames made it pause."""
    before = len(part.poses)
    while True:
        if not part.handed:
            while _grow_shape(part, scene):
                pass
            return True
        grown = level_and_scale(part, scene)
        grown |= _grow_levelled(part, scene)
        _sets_and_poses(part, scene)
        grown |= grow_polar(part, scene)
        grown |= grow_relative(part, scene)
        grown |= grow_bundles(part, scene.frames, scene.seen, fewest, most)
        grown |= grow_mixed(part, scene)
        grown = grown or grow_distances(part, scene.distances[1])
        grown = grown or (part.levelled and grow_by_bearings(part, scene.terrestrial))
        spread_positions(part, scene.frames)
        if not grown:
            return True
        if most is not None and len(part.poses) - before >= most:
            return False


def _grow_shape(part: Part, scene: Scene) -> bool:
    """What distances alone tell; directions would take a mirrored shape for right."""
    distances = scene.distances[1]
    return grow_arcs(part, distances) if part.levelled else grow_distances(part, distances)


def _grow_levelled(part: Part, scene: Scene) -> bool:
    return part.levelled and grow_levelled(part, scene.terrestrial, scene.distances[int(part.scaled)])


def _grow_until_tied(system: Part, part: Part, scene: Scene, fewest: int) -> None:
    """Growth of a part of its own, only as far as needed where positions of its frames are given.

    In the object system every given position then holds the growth; alone, a large block would bend.
    """
    most = FIRST_FRAMES
    while not _grow(part, scene, fewest, most) and not tied_by_positions(system, part, scene.frames):
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


def _next_seed(assembly: _Assembly) -> Part | None:
    """A part of its own for something that no part knows yet."""
    scene, measured = assembly.scene, assembly.scene.terrestrial
    unknown, tried = _unknown_stations(assembly), assembly.tried_stations
    part = seed_levelled(measured, unknown, scene.points, tried, with_distances=True)
    if part is not None:
        return part
    free = _free_frames(assembly)
    for chained in (False, True):
        part = _seed_of_frames(assembly, free, chained)
        if part is not None:
            return part
    part = seed_polar(scene, [n for n in np.flatnonzero(free).tolist() if n >= scene.image_count])
    part = part or seed_levelled(measured, unknown, scene.points, tried, with_distances=False)
    if part is None:
        part, reason = seed_plan(measured, unknown, scene.points, tried)
        assembly.reasons += [reason] if reason else []
    return part or seed_distances(scene, assembly.parts[0], _known_points(assembly), assembly.tried_shapes)


def _seed_of_frames(assembly: _Assembly, free: BoolArray, chained: bool) -> Part | None:
    """A part of two frames that no part has; or, ``chained``, of one and a neighbour that ties it to its part."""
    scene, given_up = assembly.scene, assembly.given_up[int(chained)]
    open_ = free & ~given_up
    if np.count_nonzero(open_) < (1 if chained else 2):
        return None
    assembly.pairs = pairs = common_pairs(scene.seen) if assembly.pairs is None else assembly.pairs
    if chained:
        among = (open_[pairs.first] & ~free[pairs.second]) | (open_[pairs.second] & ~free[pairs.first])
    else:
        among = open_[pairs.first] & open_[pairs.second]
    part, reason = seed_bundles(scene.frames, np.flatnonzero(among), pairs, scene.points)
    given_up |= open_ if part is None else False
    assembly.reasons += [reason] if reason and not chained else []
    if part is not None:
        frames = frozenset(part.poses)
        if frames in assembly.tried_frames:
            given_up[list(frames)] = True
            return _seed_of_frames(assembly, free, chained)
        assembly.tried_frames.add(frames)
    return part


def _unknown_stations(assembly: _Assembly) -> set[int]:
    places = np.array([sight.position for sight in assembly.scene.terrestrial.sights], dtype=np.int64)
    known = np.zeros(len(places), dtype=bool)
    for part in assembly.parts:
        known |= np.isfinite(part.points[places, :2]).all(axis=1)
    return set(places[~known].tolist())


def _known_points(assembly: _Assembly) -> BoolArray:
    """Points (n,) that some part knows, in plan at least."""
    known = np.zeros(assembly.scene.points, dtype=bool)
    for part in assembly.parts:
        known |= np.isfinite(part.points[:, :2]).all(axis=1)
    return known


def _free_frames(assembly: _Assembly) -> BoolArray:
    """Frames (n,) that no part has a pose of."""
    free = np.ones(len(assembly.scene.frames), dtype=bool)
    for part in assembly.parts:
        free[list(part.poses)] = False
    return free


def _join_all(assembly: _Assembly, ambiguous: bool = False) -> bool:
    """Join what can be joined, again and again: a part may tie another one to the system; true where any was."""
    parts, scene = assembly.parts, assembly.scene
    joined_any = False
    while True:
        pair = _joined_pair(parts, scene, ambiguous)
        if pair is None:
            return joined_any
        joined_any = True
        target, source = pair
        parts[:] = [part for part in parts if part is not source]
        _grow(target, scene, assembly.fewest)


def _joined_pair(parts: list[Part], scene: Scene, ambiguous: bool) -> tuple[Part, Part] | None:
    """The first two parts that could be joined, the one that knows more of its place first."""
    ordered = sorted(parts, key=_rank, reverse=True)
    for number, target in enumerate(ordered):
        for source in ordered[number + 1 :]:
            if join(target, source, scene, ambiguous):
                return target, source
    return None


def _rank(part: Part) -> tuple[bool, bool, bool, bool, int]:
    return part.given, part.oriented, part.levelled, part.scaled, _size(part)


def _size(part: Part) -> int:
    return len(part.poses) + len(part.kappas) + int(np.isfinite(part.points).sum())


def _place_the_rest(assembly: _Assembly) -> None:
    """Parts that nothing ties to the object system well enough: the largest first, as well as its ties say.

    Where nothing is given it becomes the object system, wherever it is.
    """
    parts, scene = assembly.parts, assembly.scene
    while len(parts) > 1:
        source = max(parts[1:], key=_size)
        parts.remove(source)
        level_roughly(source, scene)
        scale_roughly(source, scene)
        direct_roughly(source, scene)
        carry(parts[0], source, scene, tie(parts[0], source, scene))
        _grow(parts[0], scene, assembly.fewest)
        _join_all(assembly)
    if begin_heights(parts[0], scene.terrestrial):
        _grow(parts[0], scene, assembly.fewest)
    while place_by_few_distances(parts[0], scene.distances[1]):
        _grow(parts[0], scene, assembly.fewest)
