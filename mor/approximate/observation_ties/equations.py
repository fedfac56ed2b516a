"""The observations between two parts, and those inside one that tell its vertical or scale, under a movement.

Any type of observation counts, by its own equation: distances between the parts, directions of sets that are not
oriented yet (their orientations are further unknowns), angles, vertical directions, levelling, vectors, rays. Stations
and points that neither part knows the place of are further unknowns, where enough is measured from or to them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup, is_image_point, read_out_at_once, some_rows, wrap
from mor.project.network.build import Network
from mor.units import ANGLE, IMAGE

PRECISION = 2e-3
"""Radians, or parts of a length, that an observation fits at the best: parts are bent a little."""
MOST = 60
"""Rows of a group that take part."""
PLACES = 6
"""Points that neither part knows and that take part, at the most."""
FEWEST = 4
"""Components measured from or to such a point, from which on it says more than where it is."""
_PEELED = 5
_ABSURD = 1e6


class Moves(NamedTuple):
    """Many movements x → s R (x − m) + c of the source, m its middle, with what else is not known.

    Observations refer to the vertical, to north and to the length unit; where the target knows none of them it stands
    in their system by a movement x → u Q x of its own, which everything that has come to it makes, too.
    """

    scale: FloatArray
    """(k,)"""
    rotation: FloatArray
    """(k, 3, 3)"""
    shift: FloatArray
    """(k, 3) c"""
    kappas: FloatArray
    """(k, a) orientations of sets."""
    places: FloatArray
    """(k, b, 3) of points that neither knows, in the system of the target."""
    unit: FloatArray
    """(k,) u"""
    stance: FloatArray
    """(k, 3, 3) Q"""


class Rows(NamedTuple):
    """Rows of a group: numbers among the points and rotations that take part, σ beside what parts are bent by."""

    group: ObservationGroup
    blocks: tuple[FloatArray | IntArray, ...]
    """One per slot: (n,) numbers of points and rotations, else values (n, size)."""
    sigma: FloatArray


class Known(NamedTuple):
    """What is known of points and rotations: (n,) 0 nothing, 1 by the target, 2 by the source, 3 looked for."""

    points: IntArray
    rotations: IntArray


class Sides(NamedTuple):
    """Who knows what, and the values."""

    known: Known
    points: FloatArray
    """(points, 3) of the target where it knows them, else of the source, with its middle at 0."""
    rotations: FloatArray
    """(rotations, 3, 3) likewise."""
    lowered: FloatArray
    """(points,) how far a mark is below what the parts know in its place, along the vertical, in the length unit."""
    lever: FloatArray
    """(points, 3) from the projection centre to the position, in the axes of the part, in the length unit."""
    sets: IntArray
    """(a,) rotations that are looked for."""
    places: IntArray
    """(b,) points that are looked for."""
    stands: bool
    """True where the target knows the vertical, north and the length unit, or as much as observations refer to."""


def sides_of(network: Network, scene: Scene, target: Part, source: Part, middle: FloatArray) -> Sides:
    """Who knows what of two parts; sets and places that neither knows are looked for where it is worth it."""
    attitudes = network.start.get("rotation", np.zeros((0, 3, 3)))
    count, turns = len(target.points), len(attitudes)
    told = Sides(
        Known(np.zeros(count, dtype=np.int64), np.zeros(turns, dtype=np.int64)),
        np.full((count, 3), np.nan),
        np.full((turns, 3, 3), np.nan),
        np.zeros(count),
        np.zeros((count, 3)),
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        True,
    )
    _put(told, scene, source, middle, 2)
    _put(told, scene, target, np.zeros(3), 1)
    (known, turned), rotations = told.known, told.rotations
    if target.given:
        given = np.asarray(np.isfinite(attitudes).all(axis=(1, 2)))
        turned[given], rotations[given] = 1, attitudes[given]
    places = _places(network, scene, known, turned)
    known[places] = 3
    sets = _sets(scene, known, turned)
    turned[sets] = 3
    return told._replace(sets=sets, places=places)


def _put(told: Sides, scene: Scene, part: Part, middle: FloatArray, who: int) -> None:
    """Enter what a part knows; a point that it does not know the mark of is where a frame over it is."""
    known = np.asarray(np.isfinite(part.points).all(axis=1))
    told.known.points[known], told.points[known] = who, part.points[known] - middle
    told.lowered[known] = 0.0 if part.lifts else scene.target_heights[known]
    told.lever[known] = 0.0
    for number, (centre, D) in part.poses.items():
        frame = scene.frames[number]
        if frame.stands and (who == 2 or told.known.points[frame.position] == 0):
            told.known.points[frame.position], told.points[frame.position] = who, centre - middle
            told.lowered[frame.position] = frame.offset[0]
            told.lever[frame.position] = D.T @ frame.offset[1:]
    _put_rotations(told, scene, part, who)


def _put_rotations(told: Sides, scene: Scene, part: Part, who: int) -> None:
    for number, kappa in part.kappas.items():
        block = scene.terrestrial.sights[number].rotation
        if block >= 0:
            told.known.rotations[block] = who
            told.rotations[block] = about_vertical(np.array([kappa]))[0]
    for number, (_, D) in part.poses.items():
        frame = scene.frames[number]
        if frame.relative is None:
            told.known.rotations[frame.rotation], told.rotations[frame.rotation] = who, D


def _places(network: Network, scene: Scene, told: IntArray, turned: IntArray) -> IntArray:
    """Points that neither part knows, from or to which more is measured than tells where they are.

    Those go again that have enough only beside others that go; at the most ``PLACES`` of them are left.
    """
    levelled = {sight.rotation: sight.position for sight in scene.terrestrial.sights if sight.rotation >= 0}
    sets = [place for block, place in levelled.items() if turned[block] == 0]
    fit = turned > 0
    fit[list(levelled)] = True
    wanted = np.asarray(told == 0)
    for round_ in range(_PEELED):
        counts = -np.bincount(np.array(sets, dtype=np.int64), minlength=len(told))
        for group in network.groups:
            _count(group, (told > 0) | wanted, fit, counts)
        counts[~wanted] = 0
        order = np.argsort(-counts, kind="stable")[: PLACES if round_ else len(counts)]
        kept = order[counts[order] >= FEWEST]
        if len(kept) == np.count_nonzero(wanted):
            break
        wanted[:] = False
        wanted[kept] = True
    return np.flatnonzero(wanted)


def _count(group: ObservationGroup, known: BoolArray, turned: BoolArray, counts: IntArray) -> None:
    """Add the components of rows that refer to nothing else that is not known to the counts of their points."""
    if group.type.key.partition("/")[0] in ("observed", "coordinates"):
        return
    slots = list(zip(group.type.slots, group.blocks, strict=True))
    usable = np.ones(group.count, dtype=bool)
    for slot, blocks in slots:
        if slot.kind in ("point", "rotation"):
            usable &= (known if slot.kind == "point" else turned)[blocks]
    told = np.where(usable, group.mask.sum(axis=1), 0)
    for slot, blocks in slots:
        if slot.kind == "point":
            np.add.at(counts, blocks, told)


def _sets(scene: Scene, told: IntArray, turned: IntArray) -> IntArray:
    """Levelled sets of known or wanted places whose orientation neither part knows, of two known points and more."""
    found = [
        sight.rotation
        for sight in scene.terrestrial.sights
        if sight.rotation >= 0
        and turned[sight.rotation] == 0
        and told[sight.position]
        and np.count_nonzero(told[sight.points] & np.isfinite(sight.directions)) > 1
    ]
    return np.unique(np.array(found, dtype=np.int64))


def rows_between(network: Network, sides: Sides) -> list[Rows]:
    """The rows of which everything is known or wanted, and that a movement may change."""
    found = []
    for group in network.groups:
        if group.type.key.partition("/")[0] in ("observed", "coordinates"):
            continue
        rows = _usable(network, group, sides)
        if len(rows) > MOST:
            rows = rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
        if len(rows):
            found.append(_rows(network, group, rows))
    return found


def _usable(network: Network, group: ObservationGroup, sides: Sides) -> IntArray:
    known, moving = np.ones(group.count, dtype=bool), np.zeros(group.count, dtype=bool)
    fixed = np.zeros(group.count, dtype=bool)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind in ("point", "rotation"):
            told = (sides.known.points if slot.kind == "point" else sides.known.rotations)[blocks]
            known &= told > 0
            moving |= told > 1
            fixed |= told != 2
        else:
            values = network.start[slot.kind][blocks].reshape(group.count, -1)
            known &= np.isfinite(values).all(axis=1)
    inside = is_image_point(group.type)
    usable: IntArray = np.flatnonzero(known & moving & (fixed | (not inside)))
    return usable


def only_used(sides: Sides, rows: list[Rows]) -> tuple[Sides, list[Rows], IntArray]:
    """Sides and rows with none but the points and rotations that rows refer to, and the numbers (n,) of those points.

    What is looked for stays.
    """
    points, turns = sides.known.points == 3, sides.known.rotations == 3
    for one in rows:
        for slot, blocks in zip(one.group.type.slots, one.blocks, strict=True):
            if slot.kind in ("point", "rotation"):
                (points if slot.kind == "point" else turns)[blocks.astype(np.int64)] = True
    new_points, new_turns = np.cumsum(points) - 1, np.cumsum(turns) - 1
    renumbered = []
    for one in rows:
        numbers = tuple(
            new_points[given]
            if slot.kind == "point"
            else new_turns[given]
            if slot.kind == "rotation"
            else given
            for slot, given in zip(one.group.type.slots, one.blocks, strict=True)
        )
        renumbered.append(one._replace(blocks=numbers))
    kept = Sides(
        Known(sides.known.points[points], sides.known.rotations[turns]),
        sides.points[points],
        sides.rotations[turns],
        sides.lowered[points],
        sides.lever[points],
        new_turns[sides.sets],
        new_points[sides.places],
        sides.stands,
    )
    return kept, renumbered, np.flatnonzero(points)


def _rows(network: Network, group: ObservationGroup, rows: IntArray) -> Rows:
    # As everywhere in start values: how far an image moves while it is read out is left to the adjustment.
    taken = read_out_at_once(some_rows(group, rows))
    blocks, constant = [], np.ones(len(rows))
    for slot, numbers in zip(taken.type.slots, taken.blocks, strict=True):
        kept = slot.kind in ("point", "rotation")
        blocks.append(numbers if kept else network.start[slot.kind][numbers])
        if slot.part == "interior":
            constant = np.abs(network.start[slot.kind][numbers][:, 0])
    lengths = np.sqrt(np.nanmean(np.square(taken.observed)))
    unit = np.empty(taken.observed.shape)
    for k, component in enumerate(taken.type.components):
        unit[:, k] = 1.0 if component.quantity == ANGLE else lengths
        if component.quantity == IMAGE:
            unit[:, k] = constant
    if taken.type.key in ("distance", "horizontal_distance"):
        unit = np.abs(taken.observed)
    return Rows(taken, tuple(blocks), np.hypot(taken.sigma, PRECISION * unit))


def residuals(rows: list[Rows], sides: Sides, moves: Moves) -> FloatArray:
    """(k, n) misclosures of all rows, in units of what they are good to."""
    k = len(moves.scale)
    points, turns = placed(sides, moves)
    found = [np.zeros((k, 0))]
    for one in rows:
        n = one.group.count
        blocks: list[FloatArray] = []
        for slot, given in zip(one.group.type.slots, one.blocks, strict=True):
            if slot.kind == "point":
                blocks.append(points[:, given.astype(np.int64)].reshape(k * n, 3))
            elif slot.kind == "rotation":
                blocks.append(turns[:, given.astype(np.int64)].reshape(k * n, 3, 3))
            else:
                blocks.append(np.tile(given, (k, *(1,) * (given.ndim - 1))))
        with np.errstate(all="ignore"):
            computed = one.group.type.equation(blocks, np.tile(one.group.constants, (k, 1))).values
        off = computed.reshape(k, n, -1) - one.group.observed
        off = np.where(one.group.type.wraps, wrap(off), off) / one.sigma
        found.append(off[:, one.group.mask])
    return np.clip(np.nan_to_num(np.concatenate(found, axis=1), nan=_ABSURD), -_ABSURD, _ABSURD)


def placed(sides: Sides, moves: Moves) -> tuple[FloatArray, FloatArray]:
    """Points (k, n, 3) and rotations (k, m, 3, 3) after movements, as observations refer to them."""
    k = len(moves.scale)
    points = np.broadcast_to(sides.points, (k, *sides.points.shape)).copy()
    mine: BoolArray = sides.known.points == 2
    turned = np.swapaxes(moves.rotation, 1, 2)
    points[:, mine] = moves.scale[:, None, None] * (sides.points[mine] @ turned) + moves.shift[:, None, :]
    lever = np.broadcast_to(sides.lever, points.shape).copy()
    lever[:, mine] = sides.lever[mine] @ turned
    points[:, sides.places] = moves.places
    turns = np.broadcast_to(sides.rotations, (k, *sides.rotations.shape)).copy()
    own = sides.known.rotations == 2
    turns[:, own] = sides.rotations[own] @ turned[:, None]
    if not sides.stands:
        back = np.swapaxes(moves.stance, 1, 2)
        points, lever, turns = (
            moves.unit[:, None, None] * (points @ back),
            lever @ back,
            turns @ back[:, None],
        )
    points += lever
    points[..., 2] -= sides.lowered
    turns[:, sides.sets] = about_vertical(moves.kappas.ravel()).reshape(k, -1, 3, 3)
    return points, turns


def about_vertical(kappas: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) of sets from their orientations (n,)."""
    c, s, o = np.cos(kappas), np.sin(kappas), np.zeros_like(kappas)
    return np.stack([c, s, o, -s, c, o, o, o, o + 1.0], axis=1).reshape(-1, 3, 3)


__all__ = [
    "Moves",
    "Rows",
    "Sides",
    "about_vertical",
    "only_used",
    "placed",
    "residuals",
    "rows_between",
    "sides_of",
]
