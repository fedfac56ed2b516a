"""Start values for everything that has none: parts grow, join, and become the object system.

A part is a set of things in one system with the movements it is still free to make. The object system, with what the
project gives, is one of them; others begin at systems with measured coordinates, GNSS vectors, stations with distances,
pairs of bundles. Every part grows as far as it can, finds the vertical and the scale from what was measured inside it,
and joins another one as soon as what ties them determines the movement between them. What nothing ties comes last.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mor.approximate.along_trajectories import without_trajectories
from mor.approximate.approximation import Approximation, untied
from mor.approximate.choices import AGREES, ROWS, Choices, disagreement
from mor.approximate.growth.bearing_network import grow_by_bearings
from mor.approximate.growth.grow_bundles import (
    ENOUGH,
    FEWEST,
    grow_bundles,
    intersect_the_rest,
    pose_the_rest,
)
from mor.approximate.growth.grow_levelled import begin_heights, grow_arcs, grow_levelled
from mor.approximate.growth.mixed_intersection import grow_mixed
from mor.approximate.growth.pose_by_three import pose_by_three
from mor.approximate.growth.rigid_seeds import grow_polar, rigid_seeds, seed_polar
from mor.approximate.growth.seed_bundles import Pairs, common_pairs, seed_bundles
from mor.approximate.growth.seed_doubtful import seed_doubtful
from mor.approximate.growth.seed_levelled import seed_levelled
from mor.approximate.growth.seed_plan import seed_plan
from mor.approximate.growth.single_points import grow_single_points
from mor.approximate.growth.trilateration import grow_distances, place_by_few_distances, seed_distances
from mor.approximate.parts.contradictions import (
    Contradiction,
    contradicting_frames,
    contradicting_points,
    put_back,
    without,
)
from mor.approximate.parts.joining import (
    carry,
    join,
    open_movements,
    spread_positions,
    stand_on_marks,
    tie_at_last,
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
from mor.arrays import BoolArray
from mor.geometry.rotations import rotation_from_angles
from mor.parameters.index import all_known
from mor.project.network.build import Network

OTHERS_TRIED = 8
"""Other answers that are tried where several fitted alike."""
BETTER = 0.1
"""Mean of log(1 + (v/σ)²) by which start values must agree better to be taken for others."""
FIRST_FRAMES = 20
"""Frames a part is grown by before given positions are asked whether they tie it."""


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
    given_up: BoolArray = field(default_factory=lambda: np.zeros((3, 0), dtype=bool))
    """(3, frames) of which no two, or none with a neighbour in a part, can be oriented relative to each other; those
    that a doubtful orientation was tried of."""
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
    network = to_plane(standing_still(without_trajectories(network)))
    network = to_places(replace(network, start=with_observed(network)))
    scene, assembly = _likeliest(network, scene_of(network))
    found = _contradicting(network, assembly.parts[0], scene)
    better = _with_others(network, scene, found) if found else None
    result = _approximation(network, assembly) if better is None else better
    return replace(result, start=at_all_times(moving, result.start))


def _likeliest(network: Network, scene: Scene) -> tuple[Scene, _Assembly]:
    """The parts in the object system; where several answers fitted alike on the way, with those that agree best."""
    assembly = _assembled(network, scene)
    if not scene.choices.among:
        return scene, assembly
    missing, best, worst = _disagreement(network, assembly)
    most = max(OTHERS_TRIED * ROWS // max(network.observations, ROWS), 1)
    for wanted in scene.choices.others(most):
        if not missing and worst <= AGREES:
            break
        other = replace(scene, choices=Choices(wanted))
        tried = _assembled(network, other)
        lost, fit, off = _disagreement(network, tried)
        if lost < missing or (lost == missing and fit < best - BETTER):
            scene, assembly, missing, best, worst = other, tried, lost, fit, off
    return scene, assembly


def _disagreement(network: Network, assembly: _Assembly) -> tuple[int, float, float]:
    """How many things have no start values, how badly the others fit all in all, and the worst group."""
    found = _approximation(network, assembly)
    return len(found.missing), *disagreement(network.groups, found.start)


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
        assembly.given_up, assembly.tried_stations = np.zeros((3, len(scene.frames)), dtype=bool), set()
        assembly.tried_frames = set()
        for part in parts:
            _grow(part, scene, fewest)
        _assemble(assembly)
    _place_the_rest(assembly)
    stand_on_marks(parts[0], scene)
    intersect_the_rest(parts[0], scene.seen)
    if grow_mixed(parts[0], scene, contradicting=True) | pose_the_rest(parts[0], scene.frames):
        _grow(parts[0], scene, FEWEST)
        while grow_single_points(parts[0], scene, ambiguous=True):
            _grow(parts[0], scene, FEWEST)
    while grow_single_points(parts[0], scene, ambiguous=True, contradicting=True):
        _grow(parts[0], scene, FEWEST)
    return assembly


def _approximation(network: Network, assembly: _Assembly) -> Approximation:
    scene = assembly.scene
    start, how, missing = fill_in(network, assembly.parts[0], scene.frames, scene.terrestrial)
    reasons, parts = tuple(assembly.reasons) if missing else (), tuple(assembly.parts[0].joined)
    given = bool(np.isfinite(network.start["point"]).any())
    sights = scene.terrestrial.sights
    return Approximation(start, how, missing, reasons, (), parts, scene.frames, sights, untied(parts, given))


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
    while not part.handed and _grow_shape(part, scene):
        pass
    while part.handed:
        grown = level_and_scale(part, scene)
        grown |= _grow_levelled(part, scene)
        _sets_and_poses(part, scene)
        grown |= grow_polar(part, scene)
        grown |= grow_relative(part, scene)
        grown |= grow_bundles(part, *scene.rays_for(part), fewest, most)
        grown |= grow_mixed(part, scene)
        grown = grown or grow_distances(part, scene.distances[1])
        grown = grown or (part.levelled and grow_by_bearings(part, scene.terrestrial))
        grown = grown or grow_single_points(part, scene)
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
    fresh = [n for n in range(scene.image_count, len(free)) if free[n]]
    part = seed_polar(scene, [n for n in fresh if frozenset([n]) not in assembly.tried_frames])
    assembly.tried_frames |= {frozenset(part.poses)} if part else set()
    part = part or seed_levelled(measured, unknown, scene.points, tried, with_distances=False)
    if part is None:
        part, reason = seed_plan(measured, unknown, scene.points, tried)
        assembly.reasons += [reason] if reason else []
    part = part or seed_distances(scene, assembly.parts[0], _known_points(assembly), assembly.tried_shapes)
    return part or _doubtful_seed(assembly, free)


def _doubtful_seed(assembly: _Assembly, free: BoolArray) -> Part | None:
    """A part of two frames whose orientation is in doubt, where nothing else is left."""
    scene = assembly.scene
    open_ = free & ~assembly.given_up[2]
    if assembly.fewest > FEWEST or np.count_nonzero(open_) < 2:
        return None
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    among = np.flatnonzero(open_[pairs.first] & open_[pairs.second])
    part = seed_doubtful(scene, among, pairs, lambda part, most: _grow(part, scene, FEWEST, most))
    assembly.given_up[2] |= open_ if part is None else np.isin(np.arange(len(open_)), list(part.poses))
    return part


def _seed_of_frames(assembly: _Assembly, free: BoolArray, chained: bool) -> Part | None:
    """A part of two frames that no part has; or, ``chained``, of one and a neighbour that ties it to its part."""
    scene, given_up = assembly.scene, assembly.given_up[int(chained)]
    open_ = free & ~given_up
    if np.count_nonzero(open_) < (1 if chained else 2):
        return None
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    if chained:
        among = (open_[pairs.first] & ~free[pairs.second]) | (open_[pairs.second] & ~free[pairs.first])
    else:
        among = open_[pairs.first] & open_[pairs.second]
    part, reason = seed_bundles(scene.bare[0], np.flatnonzero(among), pairs, scene.points)
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
    ordered = sorted(parts, key=lambda part: part.rank, reverse=True)
    for number, target in enumerate(ordered):
        for source in ordered[number + 1 :]:
            if join(target, source, scene, ambiguous):
                return target, source
    return None


def _place_the_rest(assembly: _Assembly) -> None:
    """Parts that nothing ties to the object system well enough: those that leave least open first.

    Where nothing is given it becomes the object system, wherever it is.
    """
    parts, scene = assembly.parts, assembly.scene
    while len(parts) > 1:
        source = min(parts[1:], key=lambda part: (open_movements(parts[0], part, scene), -part.size))
        parts.remove(source)
        level_roughly(source, scene)
        scale_roughly(source, scene)
        direct_roughly(source, scene)
        carry(parts[0], source, scene, tie_at_last(parts[0], source, scene))
        _grow(parts[0], scene, assembly.fewest)
        _join_all(assembly)
    if begin_heights(parts[0], scene.terrestrial):
        _grow(parts[0], scene, assembly.fewest)
    while pose_by_three(parts[0], scene) or grow_single_points(parts[0], scene, ambiguous=True):
        _grow(parts[0], scene, assembly.fewest)
    while place_by_few_distances(parts[0], scene.distances[1]):
        _grow(parts[0], scene, assembly.fewest)
