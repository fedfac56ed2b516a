"""What is looked for between two parts, and the starts from which it is looked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.observation_ties.equations import Moves, Rows, Sides, only_used, placed, residuals
from mor.approximate.parts.movement import Turn
from mor.approximate.parts.part import Part
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential

STARTS = 500
"""Starts at the least: turns that are sampled come again with other shifts and scales."""
MEMORY = 3e7
"""Coordinates that are held at once, at the most."""
_TURNS = {Turn.ANY: 3, Turn.VERTICAL: 1, Turn.NONE: 0}
_TIMES = {Turn.ANY: 4, Turn.VERTICAL: 2, Turn.NONE: 1}
"""Times as many starts, where the target may be turned against what observations refer to."""
FEWEST_DIRECTIONS = 3
WANTED = 3
"""Number by which points that neither part knows are known."""
_SAME = 1e-6
"""Change of misclosures up to which these do not depend on what was changed."""


class Stance(NamedTuple):
    """What the target does not know of what observations refer to: vertical and north, and the length unit."""

    turn: Turn
    unit: bool
    """True where neither part knows it."""
    by_source: bool
    """True where only the source knows it."""

    @property
    def is_known(self) -> bool:
        """True where nothing is left to look for."""
        return self.turn is Turn.NONE and not self.unit and not self.by_source

    @property
    def unknowns(self) -> int:
        """Turns and the logarithm of the unit."""
        return _TURNS[self.turn] + self.unit


KNOWN = Stance(Turn.NONE, False, False)


def sampled_turns(turn: Turn) -> FloatArray:
    """Return rotations (k, 3, 3) over all attitudes, about the vertical, or none."""
    if turn is Turn.NONE:
        return np.eye(3)[None]
    angles = 2.0 * np.pi * np.arange(72) / 72
    about = exponential(np.stack([0.0 * angles, 0.0 * angles, angles], axis=1))
    if turn is Turn.VERTICAL:
        return about
    k = np.arange(60) + 0.5
    z, around = 1.0 - 2.0 * k / 60.0, np.pi * (1.0 + 5.0**0.5) * k
    tilt, azimuth = np.arccos(z), around
    axes = np.stack([-np.sin(azimuth), np.cos(azimuth), 0.0 * k], axis=1) * tilt[:, None]
    return np.concatenate([one @ about[::4] for one in exponential(axes)])


def stance_of(target: Part, source: Part) -> Stance:
    """What a target does not know; no source that it takes up knows more of directions."""
    turn = Turn.NONE if target.oriented else Turn.VERTICAL if target.levelled else Turn.ANY
    return Stance(turn, not (target.scaled or source.scaled), source.scaled and not target.scaled)


class Sight(NamedTuple):
    """A set whose orientation is looked for: its place, points of known place, directions to them."""

    place: int
    points: IntArray
    directions: FloatArray
    rises: FloatArray
    """(n,) what its points are higher than it at a distance of 1; NaN where no vertical direction was read."""


class Search(NamedTuple):
    """What is looked for, and everything that tells it."""

    sides: Sides
    rows: list[Rows]
    own: FloatArray
    """(n, 3) common points in the source, about its middle."""
    goal: FloatArray
    """(n, 3) the same in the target, NaN where it is not known."""
    goal_sigma: float
    size: float
    """Of the source."""
    middle: FloatArray
    turn: Turn
    scaled: bool
    stance: Stance = KNOWN
    sights: tuple[Sight, ...] = ()

    def compressed(self) -> Search:
        """The same with none but the points that rows refer to."""
        sides, rows, kept = only_used(self.sides, self.rows)
        number = np.full(len(self.sides.points), -1, dtype=np.int64)
        number[kept] = np.arange(len(kept))
        sights = []
        for one in self.sights:
            told = number[one.points] >= 0
            points, place = number[one.points[told]], int(number[one.place])
            sights.append(Sight(place, points, one.directions[told], one.rises[told]))
        return self._replace(sides=sides, rows=rows, sights=tuple(sights))

    @property
    def movements(self) -> int:
        """Unknowns of the movement itself."""
        return 3 + _TURNS[self.turn] + (not self.scaled)

    @property
    def unknowns(self) -> int:
        """All of them; those of the stance are the last."""
        return self.movements + len(self.sides.sets) + 3 * len(self.sides.places) + self.stance.unknowns

    def residuals(self, states: Moves) -> FloatArray:
        """(k, n) in units of what everything is good to."""
        off = residuals(self.rows, self.sides, states)
        moved = states.scale[:, None, None] * (self.own @ np.swapaxes(states.rotation, 1, 2))
        there = (moved + states.shift[:, None, :] - self.goal) / self.goal_sigma
        return np.concatenate([off, there[:, np.isfinite(self.goal)]], axis=1)

    def moved(self, states: Moves, steps: FloatArray) -> Moves:
        """States after steps (k, unknowns): parts of the size, radians, logarithms of scale and unit."""
        unit = (states.scale * self.size)[:, None]
        n, sets = self.movements, len(self.sides.sets)
        factor = np.ones(len(steps)) if self.scaled else np.exp(steps[:, n - 1])
        stance = self.unknowns - self.stance.unknowns
        places = steps[:, n + sets : stance].reshape(len(steps), -1, 3)
        of_target = np.exp(steps[:, -1]) if self.stance.unit else np.ones(len(steps))
        return Moves(
            states.scale * factor,
            exponential(_turns(steps[:, 3:], self.turn)) @ states.rotation,
            states.shift + unit * steps[:, :3],
            states.kappas + steps[:, n : n + sets],
            states.places + unit[:, None] * places,
            states.unit / factor if self.stance.by_source else states.unit * of_target,
            exponential(_turns(steps[:, stance:], self.stance.turn)) @ states.stance,
        )


def _turns(steps: FloatArray, turn: Turn) -> FloatArray:
    """(k, 3) rotation vectors, from the first columns of steps."""
    turns = np.zeros((len(steps), 3))
    if turn is Turn.ANY:
        turns = steps[:, :3]
    elif turn is Turn.VERTICAL:
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
        search.stance.turn if needs_turn else Turn.NONE,
        search.stance.unit and needs_unit,
        search.stance.by_source and needs_unit,
    )
    return search if stance.is_known else floating._replace(stance=stance)


def _differ(search: Search, one: Moves, other: Moves) -> bool:
    """True where observations fit two stances differently, whatever the orientations of sets are."""
    off = [search.residuals(states._replace(kappas=_orientations(search, states))) for states in (one, other)]
    return bool((np.abs(off[1] - off[0]) > _SAME * (1.0 + np.abs(off[0]))).any())


def starts(search: Search) -> Moves:
    """Turns all over, with shifts and scales drawn about what is common or in reach."""
    draw = np.random.default_rng(1)
    turns = sampled_turns(search.turn)
    most = int(MEMORY / (3 * max(len(search.sides.points), 1) * (search.unknowns + 1)))
    wanted = STARTS * _TIMES[search.stance.turn]
    turns = np.tile(turns, (-(-wanted // len(turns)), 1, 1))
    turns = turns[draw.permutation(len(turns))[: max(most, 50)]] if len(turns) > most else turns
    states = _drawn(search, draw, turns)
    k = len(turns)
    if search.stance.turn is not Turn.NONE:
        some = sampled_turns(search.stance.turn)
        states = states._replace(stance=some[draw.integers(len(some), size=k)])
    if search.stance.unit:
        reach = np.maximum(
            states.scale * search.size, extent(search.sides.points[search.sides.known.points == 1])
        )
        unit = _lengths(search) / np.maximum(reach, 1e-300) * np.exp(draw.uniform(-1.0, 1.0, k))
        states = states._replace(unit=np.where(unit > 0.0, unit, 1.0))
    elif search.stance.by_source:
        states = states._replace(unit=1.0 / states.scale)
    states = _stationed(search, states)
    return states._replace(kappas=_orientations(search, states))


def _drawn(search: Search, draw: np.random.Generator, turns: FloatArray) -> Moves:
    """A state for each turn (k, 3, 3), of a target that knows all that observations refer to."""
    k = len(turns)
    scale = np.ones(k) if search.scaled else _scales(search, k, draw)
    theirs = search.sides.points[search.sides.known.points == 1]
    reach = np.maximum(scale * search.size, extent(theirs))[:, None]
    fixed = np.isfinite(search.goal).all(axis=1)
    if fixed.any():
        turned = search.own[fixed].mean(axis=0) @ np.swapaxes(turns, 1, 2)
        shift = search.goal[fixed].mean(axis=0) - scale[:, None] * turned
    else:
        about = theirs.mean(axis=0) if len(theirs) else np.zeros(3)
        shift = about + reach * draw.uniform(0.0, 1.0, (k, 1)) * draw.standard_normal((k, 3))
    wanted = len(search.sides.places)
    away = reach[:, None] * draw.uniform(0.2, 2.0, (k, 1, 1)) * draw.standard_normal((k, wanted, 3))
    kappas = np.zeros((k, len(search.sides.sets)))
    upright = np.ones(k), np.tile(np.eye(3), (k, 1, 1))
    return Moves(scale, turns, shift, kappas, shift[:, None, :] + away, *upright)


def _scales(search: Search, count: int, draw: np.random.Generator) -> FloatArray:
    """As common points tell, or as distances do, or anything."""
    known = np.isfinite(search.goal).all(axis=1)
    size = extent(search.goal[known])
    if size:
        return np.asarray(size / extent(search.own[known]) * np.exp(0.2 * draw.standard_normal(count)))
    reach = _lengths(search) if search.sides.stands else 0.0
    reach = reach or extent(search.sides.points[search.sides.known.points == 1])
    if reach:
        return np.asarray(reach / search.size * np.exp(draw.uniform(-1.5, 1.5, count)))
    return np.asarray(10.0 ** draw.uniform(-3.0, 4.0, count))


def _lengths(search: Search) -> float:
    """The largest distance between the parts, 0 where none was measured."""
    lengths = [
        one.group.observed for one in search.rows if one.group.type.key in ("distance", "horizontal_distance")
    ]
    return float(np.nanmax(np.concatenate(lengths))) if lengths else 0.0


def _stationed(search: Search, states: Moves) -> Moves:
    """States whose stations that are looked for are free stations, by three directions and more to known points."""
    points = placed(search.sides, states)[0]
    places = states.places.copy()
    for place, sighted, directions, rises in search.sights:
        column = np.flatnonzero(search.sides.places == place)
        told = np.asarray(search.sides.known.points[sighted] != WANTED)
        if len(column) and np.count_nonzero(told) >= FEWEST_DIRECTIONS:
            there = _free_stations(points[:, sighted[told]], directions[told], rises[told])
            back = (there[:, None, :] @ states.stance) / states.unit[:, None, None]
            places[:, column[0]] = np.where(
                np.isfinite(there.sum(axis=1, keepdims=True)), back[:, 0], places[:, column[0]]
            )
    return states._replace(places=places)


def _free_stations(points: FloatArray, directions: FloatArray, rises: FloatArray) -> FloatArray:
    """(k, 3) places from directions (n,) to points (k, n, 3): across every direction n · R_κ (P − S) = 0.

    Linear and homogeneous in cos κ, sin κ and R_κ S; of these S is eliminated, with cos² κ + sin² κ = 1.
    """
    c, s = np.cos(directions), np.sin(directions)
    middle = points.mean(axis=1, keepdims=True)
    x, y, z = np.moveaxis(points - middle, 2, 0)
    across = np.stack([c, -s], axis=1)
    turn = np.stack([c * x - s * y, c * y + s * x], axis=2)
    inverse = tolerant.pinv(across)
    rest = turn - across @ (inverse @ turn)
    _, axes = tolerant.eigh(np.swapaxes(rest, 1, 2) @ rest)
    kappa = axes[:, :, 0]
    own = np.einsum("ij,kjl,kl->ki", inverse, turn, kappa)
    cosine, sine = kappa.T
    along = s * (cosine[:, None] * x + sine[:, None] * y) + c * (cosine[:, None] * y - sine[:, None] * x)
    away = along - own @ np.stack([s, c])
    plan = np.stack([cosine * own[:, 0] - sine * own[:, 1], sine * own[:, 0] + cosine * own[:, 1]], axis=1)
    told = np.isfinite(rises)
    height = (
        np.median(z[:, told] - np.abs(away[:, told]) * rises[told], axis=1) if told.any() else 0.0 * cosine
    )
    return np.asarray(np.concatenate([plan, height[:, None]], axis=1) + middle[:, 0])


def _orientations(search: Search, states: Moves) -> FloatArray:
    """(k, a) of sets, from the places that their points have at the start: the circular mean."""
    points, _ = placed(search.sides, states)
    kappas = np.zeros((len(states.scale), len(search.sides.sets)))
    for column, (place, sighted, directions, _) in enumerate(search.sights):
        away = points[:, sighted, :2] - points[:, place, None, :2]
        turn = np.exp(1j * (directions - np.arctan2(away[..., 0], away[..., 1])))
        kappas[:, column] = np.angle(turn.sum(axis=1))
    return kappas


__all__ = ["Search", "Sight", "extent", "stance_of", "standing", "starts"]
