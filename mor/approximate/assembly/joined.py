"""Parts begin, grow and join until everything is in the object system; what nothing ties comes last."""

from __future__ import annotations

import numpy as np

from mor.approximate.assembly.assembly import Assembly
from mor.approximate.assembly.growing import grow, grow_until_tied
from mor.approximate.assembly.seeds import next_seed
from mor.approximate.choices import ROWS
from mor.approximate.growth.grow_bundles import ENOUGH, FEWEST, intersect_the_rest, pose_the_rest
from mor.approximate.growth.grow_levelled import (
    begin_heights,
    place_as_if_level,
    stand_level_with_sights,
)
from mor.approximate.growth.poses.pose_by_rays import pose_by_rays
from mor.approximate.growth.rigid_seeds import rigid_seeds
from mor.approximate.growth.single_points import grow_single_points
from mor.approximate.observation_ties.tie_by_observations import tie_by_observations
from mor.approximate.parts.joining import (
    carry,
    free_movements,
    join,
    open_movements,
    stand_on_marks,
    tie,
)
from mor.approximate.parts.level_and_scale import direct_roughly, level_roughly, scale_roughly
from mor.approximate.parts.movement import Movement
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.parts.transfer import starting_part
from mor.project.network.build import Network

CONTROL = 3
"""Points that a part must know to grow by itself."""


def assembled(network: Network, scene: Scene) -> Assembly:
    """All parts in the object system."""
    parts = [starting_part(network, scene.frames), *rigid_seeds(scene)]
    assembly = Assembly(network, scene, parts, begun=len(parts) - 1)
    for number, part in enumerate(parts):
        part.number = number
    waits = _known_ones_wait(assembly)
    for fewest in (ENOUGH, FEWEST):
        assembly.fewest, assembly.reasons = fewest, []
        assembly.given_up, assembly.tried_stations = np.zeros((3, len(scene.frames)), dtype=bool), set()
        assembly.tried_frames = set()
        for part in [] if waits and fewest == ENOUGH else parts:
            grow(part, scene, fewest)
        _assemble(assembly)
    _place_the_rest(assembly)
    stand_on_marks(parts[0], scene)
    intersect_the_rest(parts[0], scene.seen)
    if pose_the_rest(parts[0], scene.frames):
        grow(parts[0], scene, FEWEST)
        while grow_single_points(parts[0], scene, ambiguous=True):
            grow(parts[0], scene, FEWEST)
    while grow_single_points(parts[0], scene, ambiguous=True, contradicting=True):
        grow(parts[0], scene, FEWEST)
    if stand_level_with_sights(parts[0], scene.terrestrial):
        grow(parts[0], scene, FEWEST)
    return assembly


def _known_ones_wait(assembly: Assembly) -> bool:
    """Do the object system, and parts of measured coordinates, wait for others that are laid upon all their points?

    What grows from few points is hung on each of them: one wrong name, and all that follows is wrong.
    """
    given, *others = assembly.parts
    known = [int(np.count_nonzero(np.isfinite(part.points).all(axis=1))) for part in others]
    if not given.poses:
        known.append(int(np.count_nonzero(np.isfinite(given.points).any(axis=1))))
    asks = max(known, default=0) >= CONTROL and assembly.network.observations <= ROWS
    return asks and bool(assembly.scene.choices.take(2, alike=False))


def _assemble(assembly: Assembly) -> None:
    """Begin parts, grow them and join them until nothing more can be begun or joined."""
    scene, parts = assembly.scene, assembly.parts
    while True:
        _join_all(assembly)
        part = next_seed(assembly)
        if part is not None:
            assembly.begun += 1
            part.number = assembly.begun
            grow_until_tied(parts[0], part, scene, assembly.fewest)
            parts.append(part)
        elif not _join_all(assembly, ambiguous=True) and not _join_by_observations(assembly):
            return


def _join_all(assembly: Assembly, ambiguous: bool = False) -> bool:
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
        grow(target, scene, assembly.fewest)


def _join_by_observations(assembly: Assembly) -> bool:
    """Join two parts by whatever was observed between them, where nothing simpler is left; true where any was."""
    parts, scene = assembly.parts, assembly.scene
    if assembly.fewest > FEWEST:
        return False
    ordered = sorted(parts, key=lambda part: part.rank, reverse=True)
    for number, target in enumerate(ordered):
        for source in ordered[number + 1 :]:
            found = tie_by_observations(assembly.network, target, source, scene)
            if found is not None and not found.open:
                carry(target, source, scene, found)
                parts[:] = [part for part in parts if part is not source]
                grow(target, scene, assembly.fewest)
                return True
    return False


def _joined_pair(parts: list[Part], scene: Scene, ambiguous: bool) -> tuple[Part, Part] | None:
    """The first two parts that could be joined, the one that knows more of its place first."""
    ordered = sorted(parts, key=lambda part: part.rank, reverse=True)
    for number, target in enumerate(ordered):
        for source in ordered[number + 1 :]:
            if join(target, source, scene, ambiguous):
                return target, source
    return None


def _place_the_rest(assembly: Assembly) -> None:
    """Parts that nothing ties to the object system well enough: those that leave least open first.

    Where nothing is given it becomes the object system, wherever it is.
    """
    parts, scene = assembly.parts, assembly.scene
    while len(parts) > 1:
        source = min(parts[1:], key=lambda part: (open_movements(parts[0], part, scene), -part.size))
        parts.remove(source)
        carry(parts[0], source, scene, _last_tie(assembly, source))
        grow(parts[0], scene, assembly.fewest)
        _join_all(assembly)
    if begin_heights(parts[0], scene.terrestrial):
        grow(parts[0], scene, assembly.fewest)
    while pose_by_rays(parts[0], scene, 0, ambiguous=True) or grow_single_points(
        parts[0], scene, ambiguous=True
    ):
        grow(parts[0], scene, assembly.fewest)
    if place_as_if_level(parts[0], scene.terrestrial, scene.distances[1], scene.choices):
        grow(parts[0], scene, assembly.fewest)


def _last_tie(assembly: Assembly, source: Part) -> Movement | None:
    """What ties a part to the object system at last, be it controlled or not: all observations, where these tell more.

    What nothing tells of the vertical, the scale and the direction it finds as well as it can.
    """
    system, scene = assembly.parts[0], assembly.scene
    by_all = tie_by_observations(assembly.network, system, source, scene, 0)
    if by_all is not None and by_all.open < open_movements(system, source, scene):
        settles = by_all.open < free_movements(system, source) or source.levelled
        if settles or not level_roughly(source, scene):
            return by_all
    level_roughly(source, scene)
    scale_roughly(source, scene)
    direct_roughly(source, scene)
    return tie(system, source, scene)
