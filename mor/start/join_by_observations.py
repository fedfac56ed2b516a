"""Join parts by the equations of all observations."""

from __future__ import annotations

from hashlib import sha256
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from mor.model import rotations
from mor.model.contract import ObservationGroup, some_rows, wrap
from mor.model.images import is_image_point, read_out_at_once
from mor.model.rotations import exponential
from mor.project.network import Network
from mor.start.bundle import Similarity, evenly, movement_by
from mor.start.join import turn_between
from mor.start.movement import OPEN, FreeRotation, Movement, sampled_turns
from mor.start.part import Part
from mor.start.scene import Scene
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE, IMAGE

# ---- The observations between two parts, and those inside one that tell its vertical or scale, under a movement.
#
# Any type of observation counts, by its own equation: distances between the parts, directions of sets that
# are not oriented yet (their orientations are further unknowns), angles, vertical directions, levelling,
# vectors, rays. Stations and points that neither part knows the place of are further unknowns, where enough
# is measured from or to them.

PRECISION = 2e-3
"""Radians, or parts of a length, that an observation fits at the best: parts are bent a little."""


class SimilarityTransformations(NamedTuple):
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


class GroupRows(NamedTuple):
    """Rows of a group: numbers among the points and rotations that take part, σ beside what parts are bent by."""

    group: ObservationGroup
    blocks: tuple[FloatArray | IntArray, ...]
    """One per slot: (n,) numbers of points and rotations, else values (n, size)."""
    sigma: FloatArray


class Sides(NamedTuple):
    """Who knows what, and the values."""

    known: IntArray
    """(points,) 0: nobody knows it, 1: the target, 2: the source, 3: unknown and wanted."""
    turned: IntArray
    """(rotations,) likewise."""
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
        np.zeros(count, dtype=np.int64),
        np.zeros(turns, dtype=np.int64),
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
    known, turned, rotations = told.known, told.turned, told.rotations
    if target.given:
        given = np.asarray(np.isfinite(attitudes).all(axis=(1, 2)))
        turned[given], rotations[given] = 1, attitudes[given]
    places = _places(network, scene, known, turned)
    known[places] = 3
    found = [
        sight.rotation
        for sight in scene.terrestrial.sights
        if sight.rotation >= 0
        and turned[sight.rotation] == 0
        and known[sight.position]
        and np.count_nonzero(known[sight.points] & np.isfinite(sight.directions)) > 1
    ]
    sets = np.unique(np.array(found, dtype=np.int64))
    turned[sets] = 3
    return told._replace(sets=sets, places=places)


def _put(told: Sides, scene: Scene, part: Part, middle: FloatArray, who: int) -> None:
    """Enter what a part knows; a point that it does not know the mark of is where a frame over it is."""
    known = np.asarray(np.isfinite(part.points).all(axis=1))
    told.known[known], told.points[known] = who, part.points[known] - middle
    told.lowered[known] = 0.0 if part.lifts else scene.target_heights[known]
    told.lever[known] = 0.0
    for number, kappa in part.kappas.items():
        block = scene.terrestrial.sights[number].rotation
        if block >= 0:
            told.turned[block], told.rotations[block] = who, about_vertical(np.array([kappa]))[0]
    for number, (centre, D) in part.poses.items():
        frame = scene.frames[number]
        if frame.stands:
            told.turned[frame.rotation], told.rotations[frame.rotation] = who, D
        if frame.stands and (who == 2 or told.known[frame.position] == 0):
            told.known[frame.position], told.points[frame.position] = who, centre - middle
            told.lowered[frame.position] = frame.offset[0]
            told.lever[frame.position] = D.T @ frame.offset[1:]


def _places(network: Network, scene: Scene, told: IntArray, turned: IntArray) -> IntArray:
    """Points that neither part knows, from or to which more is measured than tells where they are.

    Those go again that have enough only beside others that go; at the most six of them are left.
    """
    levelled = {sight.rotation: sight.position for sight in scene.terrestrial.sights if sight.rotation >= 0}
    sets = [place for block, place in levelled.items() if turned[block] == 0]
    fit = turned > 0
    fit[list(levelled)] = True
    wanted = np.asarray(told == 0)
    for round_ in range(5):
        counts = -np.bincount(np.array(sets, dtype=np.int64), minlength=len(told))
        for group in network.groups:
            _count(group, (told > 0) | wanted, fit, counts)
        counts[~wanted] = 0
        order = np.argsort(-counts, kind="stable")[: 6 if round_ else len(counts)]
        # Components measured from or to such a point, from which on it says more than where it is.
        kept = order[counts[order] >= 4]
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


def rows_between(network: Network, sides: Sides) -> list[GroupRows]:
    """The rows of which everything is known or wanted, and that a movement may change."""
    found = []
    for group in network.groups:
        if group.type.key.partition("/")[0] in ("observed", "coordinates") or group.count == 0:
            continue
        known, moving = np.ones(group.count, dtype=bool), np.zeros(group.count, dtype=bool)
        fixed = np.zeros(group.count, dtype=bool)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in ("point", "rotation"):
                told = (sides.known if slot.kind == "point" else sides.turned)[blocks]
                known &= told > 0
                moving |= told > 1
                fixed |= told != 2
            else:
                values = network.start[slot.kind][blocks].reshape(group.count, -1)
                known &= np.isfinite(values).all(axis=1)
        inside = is_image_point(group.type)
        rows: IntArray = np.flatnonzero(known & moving & (fixed | (not inside)))
        if len(rows):
            found.append(_rows(network, group, evenly(rows, 60)))
    return found


def only_used(sides: Sides, rows: list[GroupRows]) -> tuple[Sides, list[GroupRows], IntArray]:
    """Sides and rows with none but the points and rotations that rows refer to, and the numbers (n,) of those points.

    What is looked for stays.
    """
    points, turns = sides.known == 3, sides.turned == 3
    for one in rows:
        for slot, blocks in zip(one.group.type.slots, one.blocks, strict=True):
            if slot.kind in ("point", "rotation"):
                (points if slot.kind == "point" else turns)[blocks.astype(np.int64)] = True
    new_points, new_turns = np.cumsum(points) - 1, np.cumsum(turns) - 1
    renumbered = []
    for one in rows:
        numbers = tuple(
            new_points[given] if slot.kind == "point" else new_turns[given] if slot.kind == "rotation" else given
            for slot, given in zip(one.group.type.slots, one.blocks, strict=True)
        )
        renumbered.append(one._replace(blocks=numbers))
    kept = Sides(
        sides.known[points],
        sides.turned[turns],
        sides.points[points],
        sides.rotations[turns],
        sides.lowered[points],
        sides.lever[points],
        new_turns[sides.sets],
        new_points[sides.places],
        sides.stands,
    )
    return kept, renumbered, np.flatnonzero(points)


def _rows(network: Network, group: ObservationGroup, rows: IntArray) -> GroupRows:
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
    return GroupRows(taken, tuple(blocks), np.hypot(taken.sigma, PRECISION * unit))


def residuals(rows: list[GroupRows], sides: Sides, moves: SimilarityTransformations) -> FloatArray:
    """(k, n) misclosures of all rows, in units of what they are good to."""
    k = len(moves.scale)
    there = placed(sides, moves)
    found = [np.zeros((k, 0))]
    found += [_misclosures(one, _computed(one, *there)[0])[:, one.group.mask] for one in rows]
    return np.clip(np.nan_to_num(np.concatenate(found, axis=1), nan=BEYOND), -BEYOND, BEYOND)


BEYOND = 1e6
"""Misclosure that cannot be computed, and the largest, in units of what rows are good to: it changes no more."""


def _computed(one: GroupRows, points: FloatArray, turns: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Values (k, n, m) of rows at k places of everything, and their derivatives (k, n, m, size), one per slot."""
    k, n = len(points), one.group.count
    blocks: list[FloatArray] = []
    for slot, given in zip(one.group.type.slots, one.blocks, strict=True):
        if slot.kind == "point":
            blocks.append(points[:, given.astype(np.int64)].reshape(k * n, 3))
        elif slot.kind == "rotation":
            blocks.append(turns[:, given.astype(np.int64)].reshape(k * n, 3, 3))
        else:
            blocks.append(np.tile(given, (k, *(1,) * (given.ndim - 1))))
    with np.errstate(all="ignore"):
        computed = one.group.type.equation(blocks, np.tile(one.group.constants, (k, 1)))
    return computed.values.reshape(k, n, -1), [one.reshape(k, n, *one.shape[1:]) for one in computed.jacobians]


def _misclosures(one: GroupRows, values: FloatArray) -> FloatArray:
    off = values - one.group.observed
    return np.asarray(np.where(one.group.type.wraps, wrap(off), off) / one.sigma)


def derivatives(
    rows: list[GroupRows], sides: Sides, moves: SimilarityTransformations, beside: SimilarityTransformations
) -> FloatArray:
    """(k, n, u) changes of the misclosures of k movements, by equation, to u movements ``beside`` each (k · u)."""
    k, u = len(moves.scale), len(beside.scale) // len(moves.scale)
    points, turns = placed(sides, moves)
    other_points, other_turns = placed(sides, beside)
    shifts = np.moveaxis(other_points.reshape(k, u, *points.shape[1:]) - points[:, None], 1, 3)
    small = other_turns.reshape(k, u, *turns.shape[1:]) @ np.swapaxes(turns, 2, 3)[:, None]
    # D' = exp(−[δ]×) D
    delta = 0.5 * np.stack([small[..., j, i] - small[..., i, j] for i, j in ((2, 1), (0, 2), (1, 0))], axis=3)
    turned = np.moveaxis(delta, 1, 3)
    found = [np.zeros((k, 0, u))]
    for one in rows:
        values, by_slot = _computed(one, points, turns)
        change = np.zeros((*values.shape, u))
        for slot, given, by_block in zip(one.group.type.slots, one.blocks, by_slot, strict=True):
            if slot.kind in ("point", "rotation"):
                moved = shifts if slot.kind == "point" else turned
                change += by_block @ moved[:, given.astype(np.int64)]
        change /= one.sigma[:, :, None]
        fixed = ~(np.abs(_misclosures(one, values)) < BEYOND)
        found.append(np.where(fixed[..., None], 0.0, change)[:, one.group.mask])
    return np.nan_to_num(np.concatenate(found, axis=1))


def placed(sides: Sides, moves: SimilarityTransformations) -> tuple[FloatArray, FloatArray]:
    """Points (k, n, 3) and rotations (k, m, 3, 3) after movements, as observations refer to them."""
    k = len(moves.scale)
    points = np.broadcast_to(sides.points, (k, *sides.points.shape)).copy()
    mine: BoolArray = sides.known == 2
    turned = np.swapaxes(moves.rotation, 1, 2)
    points[:, mine] = moves.scale[:, None, None] * (sides.points[mine] @ turned) + moves.shift[:, None, :]
    lever = np.broadcast_to(sides.lever, points.shape).copy()
    lever[:, mine] = sides.lever[mine] @ turned
    points[:, sides.places] = moves.places
    turns = np.broadcast_to(sides.rotations, (k, *sides.rotations.shape)).copy()
    own = sides.turned == 2
    turns[:, own] = sides.rotations[own] @ turned[:, None]
    if not sides.stands:
        back = np.swapaxes(moves.stance, 1, 2)
        points, lever, turns = (moves.unit[:, None, None] * (points @ back), lever @ back, turns @ back[:, None])
    points += lever
    points[..., 2] -= sides.lowered
    turns[:, sides.sets] = about_vertical(moves.kappas.ravel()).reshape(k, -1, 3, 3)
    return points, turns


def about_vertical(kappas: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) of sets from their orientations (n,)."""
    c, s, o = np.cos(kappas), np.sin(kappas), np.zeros_like(kappas)
    return np.stack([c, s, o, -s, c, o, o, o, o + 1.0], axis=1).reshape(-1, 3, 3)


# ---- Many starts of one small problem at once: Σ log(1 + v²), by Gauss-Newton with Cauchy weights, damped.


States = TypeVar("States", bound=tuple[FloatArray, ...])
"""Many states: arrays whose first axis counts them."""


class Searched(Protocol[States]):
    """Function to minimise; unknowns are scaled to about one."""

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""

    def residuals(self, states: States) -> FloatArray:
        """(k, n) of k states."""

    def derivatives(self, states: States) -> FloatArray:
        """(k, n, unknowns) of k states."""

    def moved(self, states: States, steps: FloatArray) -> States:
        """States after steps (k, unknowns)."""


class Minima(NamedTuple):
    """The best minima, the best first."""

    states: tuple[FloatArray, ...]
    objectives: FloatArray
    """(k,)"""
    residuals: FloatArray
    """(k, n)"""
    derivatives: FloatArray
    """(n, unknowns) at the best one."""


def minima(searched: Searched[States], starts: States) -> Minima:
    """The minima that the most promising of many starts lead to."""
    order = np.argsort(_objectives(searched.residuals(starts), 30.0), kind="stable")[:200]
    # Steps of the most promising starts, and of the best of these.
    states, off = _iterated(searched, some(starts, order), 6, 10.0)
    states = some(states, np.argsort(_objectives(off, 3.0), kind="stable")[:16])
    states, off = _iterated(searched, states, 30, 5.0)
    order = np.argsort(_objectives(off, 1.0), kind="stable")
    states, off = some(states, order), off[order]
    return Minima(states, _objectives(off, 1.0), off, searched.derivatives(some(states, np.array([0])))[0])


def some(states: States, numbers: IntArray) -> States:
    """Some of the states, by their numbers."""
    return type(states)(*(array[numbers] for array in states))


def _objectives(off: FloatArray, width: float) -> FloatArray:
    return np.asarray(np.log1p(np.square(off / width)).sum(axis=1))


def _iterated(searched: Searched[States], states: States, steps: int, width: float) -> tuple[States, FloatArray]:
    """Steps that are not taken where they make it worse; large residuals count ever less."""
    off = searched.residuals(states)
    count, unknowns = len(off), searched.unknowns
    damping = np.full(count, 1e-2)
    for step in range(steps):
        wide = max(1.0, width * (1.0 - step / (0.6 * steps)))
        root = 1.0 / np.hypot(1.0, off / wide)
        rows = searched.derivatives(states) * root[:, :, None]
        normal = np.swapaxes(rows, 1, 2) @ rows
        diagonal = np.einsum("kii->ki", normal)
        load = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
        side = np.einsum("kni,kn->ki", rows, root * off)
        normal[:, np.arange(unknowns), np.arange(unknowns)] += load
        change = -rotations.solve(np.nan_to_num(normal), side[:, :, None])[:, :, 0]
        moved = searched.moved(states, np.clip(np.nan_to_num(change), -0.5, 0.5))
        tried = searched.residuals(moved)
        better = _objectives(tried, wide) < _objectives(off, wide)
        both = type(states)(*(np.concatenate(pair) for pair in zip(states, moved, strict=True)))
        states = some(both, np.arange(count) + count * better)
        off = np.where(better[:, None], tried, off)
        damping = np.clip(np.where(better, 0.2 * damping, 8.0 * damping), 1e-9, 1e6)
    return states, off


# ---- What is looked for between two parts, and the starts from which it is looked for.


class Stance(NamedTuple):
    """Reference that the target lacks and observations need: vertical, north, and the length unit."""

    turn: FreeRotation
    unit: bool
    """True where neither part knows it."""
    by_source: bool
    """True where only the source knows it."""

    @property
    def is_known(self) -> bool:
        """True where nothing is left to look for."""
        return self.turn is FreeRotation.NONE and not self.unit and not self.by_source

    @property
    def unknowns(self) -> int:
        """Turns and the logarithm of the unit."""
        return self.turn.count + self.unit


KNOWN = Stance(FreeRotation.NONE, False, False)


def stance_of(target: Part, source: Part) -> Stance:
    """Return the reference that a target lacks; no source knows more of directions."""
    turn = FreeRotation.NONE if target.oriented else FreeRotation.VERTICAL if target.levelled else FreeRotation.ANY
    return Stance(turn, not (target.scaled or source.scaled), source.scaled and not target.scaled)


class UnorientedSet(NamedTuple):
    """A set whose orientation is looked for: its place, points of known place, directions to them."""

    place: int
    points: IntArray
    directions: FloatArray


class Search(NamedTuple):
    """Unknowns of a search, and all observations of them."""

    sides: Sides
    rows: list[GroupRows]
    own: FloatArray
    """(n, 3) common points in the source, about its middle."""
    goal: FloatArray
    """(n, 3) the same in the target, NaN where it is not known."""
    goal_sigma: float
    size: float
    """Of the source."""
    middle: FloatArray
    turn: FreeRotation
    scaled: bool
    stance: Stance = KNOWN
    sights: tuple[UnorientedSet, ...] = ()

    def compressed(self) -> Search:
        """The same with none but the points that rows refer to."""
        sides, rows, kept = only_used(self.sides, self.rows)
        number = np.full(len(self.sides.points), -1, dtype=np.int64)
        number[kept] = np.arange(len(kept))
        sights = []
        for one in self.sights:
            told = number[one.points] >= 0
            points, place = number[one.points[told]], int(number[one.place])
            sights.append(UnorientedSet(place, points, one.directions[told]))
        return self._replace(sides=sides, rows=rows, sights=tuple(sights))

    @property
    def movements(self) -> int:
        """Unknowns of the movement itself."""
        return 3 + self.turn.count + (not self.scaled)

    @property
    def unknowns(self) -> int:
        """All of them; those of the stance are the last."""
        return self.movements + len(self.sides.sets) + 3 * len(self.sides.places) + self.stance.unknowns

    def residuals(self, states: SimilarityTransformations) -> FloatArray:
        """(k, n) in units of what everything is good to."""
        off = residuals(self.rows, self.sides, states)
        return np.concatenate([off, self._beside_goal(states)], axis=1)

    def derivatives(self, states: SimilarityTransformations) -> FloatArray:
        """(k, n, unknowns): those of the equations, and differences of places and turns."""
        k, u = len(states.scale), self.unknowns
        # Places change nearly in proportion to the step of the differences, and are known to 1e-16 of their size.
        step = 1e-6
        beside = self.moved(some(states, np.repeat(np.arange(k), u)), np.tile(step * np.eye(u), (k, 1)))
        there = self._beside_goal(beside).reshape(k, u, -1) - self._beside_goal(states)[:, None]
        change = derivatives(self.rows, self.sides, states, beside)
        return np.asarray(np.concatenate([change, np.swapaxes(there, 1, 2)], axis=1) / step)

    def _beside_goal(self, states: SimilarityTransformations) -> FloatArray:
        moved = states.scale[:, None, None] * (self.own @ np.swapaxes(states.rotation, 1, 2))
        there = (moved + states.shift[:, None, :] - self.goal) / self.goal_sigma
        return np.asarray(there[:, np.isfinite(self.goal)])

    def moved(self, states: SimilarityTransformations, steps: FloatArray) -> SimilarityTransformations:
        """States after steps (k, unknowns): parts of the size, radians, logarithms of scale and unit."""
        unit = (states.scale * self.size)[:, None]
        n, sets = self.movements, len(self.sides.sets)
        factor = np.ones(len(steps)) if self.scaled else np.exp(steps[:, n - 1])
        stance = self.unknowns - self.stance.unknowns
        places = steps[:, n + sets : stance].reshape(len(steps), -1, 3)
        of_target = np.exp(steps[:, -1]) if self.stance.unit else np.ones(len(steps))
        return SimilarityTransformations(
            states.scale * factor,
            exponential(_turns(steps[:, 3:], self.turn)) @ states.rotation,
            states.shift + unit * steps[:, :3],
            states.kappas + steps[:, n : n + sets],
            states.places + unit[:, None] * places,
            states.unit / factor if self.stance.by_source else states.unit * of_target,
            exponential(_turns(steps[:, stance:], self.stance.turn)) @ states.stance,
        )


def _turns(steps: FloatArray, turn: FreeRotation) -> FloatArray:
    """(k, 3) rotation vectors, from the first columns of steps."""
    turns = np.zeros((len(steps), 3))
    if turn is FreeRotation.ANY:
        turns = steps[:, :3]
    elif turn is FreeRotation.VERTICAL:
        turns[:, 2] = steps[:, 0]
    return turns


def extent(points: FloatArray) -> float:
    """Diagonal of the box about points, 0 of a single one."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) > 1 else 0.0


def standing(search: Search) -> Search:
    """The search with as much of its stance as the observations refer to."""
    if search.stance.is_known:
        return search
    floating = search._replace(sides=search.sides._replace(stands=False), stance=KNOWN)
    states = _drawn(floating, np.random.default_rng(2), exponential(np.zeros((3, 3))))
    turned = exponential(_turns(np.tile([[1.9, 0.7, -1.1]], (3, 1))[:, ::-1], search.stance.turn))
    needs_turn = _differ(floating, states, states._replace(stance=turned))
    needs_unit = _differ(floating, states, states._replace(unit=np.full(3, 1.7)))
    stance = Stance(
        search.stance.turn if needs_turn else FreeRotation.NONE,
        search.stance.unit and needs_unit,
        search.stance.by_source and needs_unit,
    )
    return search if stance.is_known else floating._replace(stance=stance)


def _differ(search: Search, one: SimilarityTransformations, other: SimilarityTransformations) -> bool:
    off = [search.residuals(states._replace(kappas=_orientations(search, states))) for states in (one, other)]
    # Change of misclosures up to which these do not depend on what was changed.
    return bool((np.abs(off[1] - off[0]) > 1e-6 * (1.0 + np.abs(off[0]))).any())


def starts(search: Search) -> SimilarityTransformations:
    """Turns all over, with shifts and scales drawn about what is common or in reach."""
    draw = np.random.default_rng(1)
    turns = sampled_turns(search.turn)
    # Coordinates that are held at once, at the most.
    most = int(3e7 / (3 * max(len(search.sides.points), 1) * (search.unknowns + 1)))
    # Starts at the least: turns that are sampled come again with other shifts and scales.
    wanted = 500 * (1, 2, 2, 4)[search.stance.turn.count]
    turns = np.tile(turns, (-(-wanted // len(turns)), 1, 1))
    turns = turns[draw.permutation(len(turns))[: max(most, 50)]] if len(turns) > most else turns
    states = _drawn(search, draw, turns)
    k = len(turns)
    if search.stance.turn is not FreeRotation.NONE:
        some = sampled_turns(search.stance.turn)
        states = states._replace(stance=some[draw.integers(len(some), size=k)])
    if search.stance.unit:
        reach = np.maximum(states.scale * search.size, extent(search.sides.points[search.sides.known == 1]))
        unit = _lengths(search) / np.maximum(reach, 1e-300) * np.exp(draw.uniform(-1.0, 1.0, k))
        states = states._replace(unit=np.where(unit > 0.0, unit, 1.0))
    elif search.stance.by_source:
        states = states._replace(unit=1.0 / states.scale)
    return states._replace(kappas=_orientations(search, states))


def _drawn(search: Search, draw: np.random.Generator, turns: FloatArray) -> SimilarityTransformations:
    """A state for each turn (k, 3, 3), of a target that knows all that observations refer to."""
    k = len(turns)
    scale = np.ones(k) if search.scaled else _scales(search, k, draw)
    theirs = search.sides.points[search.sides.known == 1]
    reach = np.maximum(scale * search.size, extent(theirs))[:, None]
    fixed = np.isfinite(search.goal).all(axis=1)
    if fixed.any():
        turned = search.own[fixed].mean(axis=0) @ np.swapaxes(turns, 1, 2)
        shift = search.goal[fixed].mean(axis=0) - scale[:, None] * turned
    elif len(theirs):
        shift = theirs.mean(axis=0) + reach * draw.uniform(0.0, 1.0, (k, 1)) * draw.standard_normal((k, 3))
    else:  # nothing is there that it could be away from
        shift = np.tile(search.middle, (k, 1))
    wanted = len(search.sides.places)
    away = reach[:, None] * draw.uniform(0.2, 2.0, (k, 1, 1)) * draw.standard_normal((k, wanted, 3))
    kappas = np.zeros((k, len(search.sides.sets)))
    upright = np.ones(k), np.tile(np.eye(3), (k, 1, 1))
    return SimilarityTransformations(scale, turns, shift, kappas, shift[:, None, :] + away, *upright)


def _scales(search: Search, count: int, draw: np.random.Generator) -> FloatArray:
    """Return scales that common points tell, or else distances, or else any scales."""
    known = np.isfinite(search.goal).all(axis=1)
    size = extent(search.goal[known])
    if size:
        return np.asarray(size / extent(search.own[known]) * np.exp(0.2 * draw.standard_normal(count)))
    reach = _lengths(search) if search.sides.stands else 0.0
    reach = reach or extent(search.sides.points[search.sides.known == 1])
    if reach:
        return np.asarray(reach / search.size * np.exp(draw.uniform(-1.5, 1.5, count)))
    return np.asarray(10.0 ** draw.uniform(-3.0, 4.0, count))


def _lengths(search: Search) -> float:
    lengths = [one.group.observed for one in search.rows if one.group.type.key in ("distance", "horizontal_distance")]
    return float(np.nanmax(np.concatenate(lengths))) if lengths else 0.0


def _orientations(search: Search, states: SimilarityTransformations) -> FloatArray:
    """(k, a) of sets, from the places that their points have at the start: the circular mean."""
    points, _ = placed(search.sides, states)
    kappas = np.zeros((len(states.scale), len(search.sides.sets)))
    for column, (place, sighted, directions) in enumerate(search.sights):
        away = points[:, sighted, :2] - points[:, place, None, :2]
        turn = np.exp(1j * (directions - np.arctan2(away[..., 0], away[..., 1])))
        kappas[:, column] = np.angle(turn.sum(axis=1))
    return kappas


# ---- Two parts, and any observations between them or inside the one that joins: the movement that these determine.

SEARCHED = 400
"""Observations of the first search in a network, at the most; the k-th one is made among a k-th of them.

A search refines hundreds of starts, and if nothing fits, there is always another pair of parts. All searches together
take at most a few times as long as the largest one.
"""


def tie_by_observations(
    network: Network, target: Part, source: Part, scene: Scene, redundant: int = 3
) -> Movement | None:
    """The movement from source to target that most observations agree with.

    ``None`` where fewer than ``redundant`` beyond those it takes agree (three tell it beyond doubt), where nothing came
    in since it was asked, or after too many searches in the network (``SEARCHED``).
    """
    known = np.asarray(np.isfinite(source.points).all(axis=1))
    # Observations of a network up to which it is tried.
    if network.observations > 5_000 or not (known.any() or source.poses):
        return None
    middle = source.points[known].mean(axis=0) if known.any() else np.zeros(3)
    sides = sides_of(network, scene, target, source, middle)
    rows = rows_between(network, sides)
    common = np.flatnonzero(known & np.isfinite(target.points).any(axis=1))
    told = sum(int(one.group.mask.sum()) for one in rows) + 3 * len(common)
    asked = source.asked_for_ties
    if told <= asked.get((target.number, redundant), 0):
        return None
    asked[target.number, redundant] = told
    search = _search(target, source, scene, sides, rows, common, middle)
    if told < search.unknowns - search.stance.unknowns + redundant - (3 if not len(common) else 0):
        return None
    return _remembered(search._replace(sights=_sights(scene, sides)).compressed(), told, redundant, scene.tied)


def _remembered(
    search: Search, observations: int, redundant: int, tied: dict[bytes, Movement | None]
) -> Movement | None:
    """The movement looked for; other answers to what was in doubt elsewhere come to the same question again."""
    arrays = [*search.sides[:-1], search.own, search.goal, *(one.sigma for one in search.rows)]
    asked = search.goal_sigma, search.size, search.turn, search.scaled, search.stance, redundant
    words = repr(asked).encode()
    key = sha256(words + b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).digest()
    if key not in tied and observations * (len(tied) + 1) <= SEARCHED:
        with np.errstate(all="ignore"):
            search = standing(search)
            tied[key] = _judged(search, minima(search, starts(search)), redundant)
    return tied.get(key)


def _search(
    target: Part, source: Part, scene: Scene, sides: Sides, rows: list[GroupRows], common: IntArray, middle: FloatArray
) -> Search:
    goal = target.points[common].copy()
    goal[:, 2] += scene.target_heights[common] if target.lifts and not source.lifts else 0.0
    own = sides.points[sides.known == 2]
    size = extent(own) or extent(source.points[np.isfinite(source.points).all(axis=1)]) or 1.0
    reach = extent(target.points[np.isfinite(target.points).all(axis=1)])
    return Search(
        sides,
        rows,
        source.points[common] - middle,
        goal,
        PRECISION * (reach or size),
        size,
        middle,
        turn_between(target, source),
        source.scaled and target.scaled,
        stance_of(target, source),
    )


def _sights(scene: Scene, sides: Sides) -> tuple[UnorientedSet, ...]:
    found = []
    for block in sides.sets.tolist():
        sight = next(one for one in scene.terrestrial.sights if one.rotation == block)
        told = (sides.known[sight.points] > 0) & np.isfinite(sight.directions)
        found.append(UnorientedSet(sight.position, sight.points[told], sight.directions[told]))
    return tuple(found)


def _judged(search: Search, found: Minima, redundant: int) -> Movement | None:
    # Units of what an observation is good to, up to which it agrees.
    agrees = np.abs(found.residuals[0]) < 5.0
    count = int(np.count_nonzero(agrees))
    values, axes, without = _determined(search, found.derivatives[agrees])
    open_ = values * OPEN < 1.0
    redundancy = count - search.unknowns + int(np.count_nonzero(open_)) + without
    # Part of all that agree with a movement, at the least.
    if redundancy < redundant or count < 0.7 * len(agrees):
        return None
    best = _movement(search, found, 0)
    others: list[int] = []
    # Difference of two objectives from which on one movement is told from another.
    for k in np.flatnonzero(found.objectives < found.objectives[0] + 9.0)[1:].tolist():
        if all(_apart(search, found, k, other, axes[~open_]) for other in (0, *others)):
            others.append(k)
    misfit = PRECISION * float(np.sqrt(np.mean(np.square(found.residuals[0][agrees]))))
    return Movement(
        best.scale,
        best.rotation,
        best.translation,
        int(np.count_nonzero(open_)),
        misfit,
        redundancy,
        tuple(_movement(search, found, k) for k in others),
    )


def _determined(search: Search, rows: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Reciprocal σ (m,) of combinations of the movements, these (m, m), whatever else is looked for.

    The last: how many movements of the target itself the observations leave open.
    """
    n, stance = search.movements, search.unknowns - search.stance.unknowns
    of_target = _whatever(rows[:, n:stance], rows[:, stance:], 0.0)
    rest = _whatever(rows[:, n:stance], rows[:, :n], 0.0)
    rest = _whatever(of_target, rest, 1.0 / OPEN)
    told = rotations.singular_values(of_target)
    padded = np.concatenate([rest, np.zeros((n, n))])
    _, values, axes = rotations.svd(padded, full_matrices=False)
    return values, axes, search.stance.unknowns - int(np.count_nonzero(told * OPEN >= 1.0))


def _whatever(further: FloatArray, rows: FloatArray, least: float) -> FloatArray:
    """Rows (n, m) without what ``further`` (n, k) unknowns explain whose reciprocal σ is more than ``least``."""
    if not further.shape[1]:
        return rows
    left, values, _ = rotations.svd(further, full_matrices=False)
    left = left[:, values > max(1e-9 * values.max(initial=1e-300), least)]
    return np.asarray(rows - left @ (left.T @ rows))


def _apart(search: Search, found: Minima, one: int, other: int, axes: FloatArray) -> bool:
    """True where two movements differ in what is determined."""
    a, b = (SimilarityTransformations(*(array[k] for array in found.states)) for k in (one, other))
    turn = b.rotation @ a.rotation.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    cosine = 0.5 * (np.trace(turn) - 1.0)
    small = small if cosine > 0.0 else small + np.pi / 2.0
    turns = {FreeRotation.ANY: small, FreeRotation.VERTICAL: small[2:], FreeRotation.NONE: small[:0]}[search.turn]
    size = np.maximum(a.scale, b.scale) * search.size
    scales = [] if search.scaled else [np.log(b.scale / a.scale)]
    difference = np.concatenate([(b.shift - a.shift) / size, turns, scales])
    return bool(np.abs(axes @ difference).max(initial=0.0) > 0.05)


def _movement(search: Search, found: Minima, number: int) -> Similarity:
    states = some(SimilarityTransformations(*found.states), np.array([number]))
    scale, rotation = float(states.scale[0]), states.rotation[0]
    shift = states.shift[0] - scale * rotation @ search.middle
    return movement_by(scale, rotation, shift)
