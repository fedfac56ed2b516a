"""Two parts, and any observations between them or inside the one that joins: the movement that these determine."""

from __future__ import annotations

from hashlib import sha256
from typing import NamedTuple

import numpy as np

from mor.approximate.observation_ties.equations import (
    PRECISION,
    Moves,
    Rows,
    Sides,
    only_used,
    placed,
    residuals,
    rows_between,
    sides_of,
)
from mor.approximate.observation_ties.robust_minimum import Minima, minima, some
from mor.approximate.parts.movement import Movement, Turn
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.ray_ties.movement_by_rays import sampled_turns
from mor.approximate.similarity import Similarity, SimilarityOutcome
from mor.arrays import FloatArray, IntArray
from mor.geometry.rotations import exponential
from mor.project.network.build import Network

CONTROLLED = 3
"""Observations beyond those that a movement takes, from which on they tell it beyond doubt."""
AGREEING = 0.7
"""Part of all that agree with a movement, at the least."""
FITS = 5.0
"""Units of what an observation is good to, up to which it agrees."""
CLEAR = 9.0
"""Difference of two objectives from which on one movement is told from another."""
OPEN = 0.1
"""σ of a movement (radians, or parts of the size) from which on it is open."""
APART = 0.05
STARTS = 500
"""Starts at the least: turns that are sampled come again with other shifts and scales."""
MEMORY = 3e7
"""Coordinates that are held at once, at the most."""
SMALL = 5_000
"""Observations of a network up to which it is tried."""


def tie_by_observations(
    network: Network, target: Part, source: Part, scene: Scene, redundant: int = CONTROLLED
) -> Movement | None:
    """The movement from source to target that most observations agree with.

    ``None`` where fewer than ``redundant`` beyond those it takes agree, or where nothing came in since it was asked.
    """
    known = np.asarray(np.isfinite(source.points).all(axis=1))
    if network.observations > SMALL or not (known.any() or source.poses):
        return None
    middle = source.points[known].mean(axis=0) if known.any() else np.zeros(3)
    sides = sides_of(network, scene, target, source, middle)
    rows = rows_between(network, sides, target.lifts)
    common = np.flatnonzero(known & np.isfinite(target.points).any(axis=1))
    told = sum(int(one.group.mask.sum()) for one in rows) + 3 * len(common)
    asked = source.asked_for_ties
    if told <= asked.get((target.number, redundant), 0):
        return None
    asked[target.number, redundant] = told
    search = _search(target, source, sides, rows, common, middle)
    if told < search.unknowns + redundant - (3 if not len(common) else 0):
        return None
    return _remembered(search._replace(sights=_sights(scene, sides)).compressed(), redundant, scene.tied)


def _remembered(search: _Search, redundant: int, tied: dict[bytes, Movement | None]) -> Movement | None:
    """The movement looked for; other answers to what was in doubt elsewhere come to the same question again."""
    told = [*search.sides, search.own, search.goal, *(one.sigma for one in search.rows)]
    arrays = [array for one in told for array in (one if isinstance(one, tuple) else (one,))]
    words = repr((search.goal_sigma, search.size, search.turn, search.scaled, redundant)).encode()
    key = sha256(words + b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).digest()
    if key not in tied:
        with np.errstate(all="ignore"):
            tied[key] = _judged(search, minima(search, _starts(search)), redundant)
    return tied[key]


class _Sight(NamedTuple):
    """A set whose orientation is looked for: its place, points of known place, directions to them."""

    place: int
    points: IntArray
    directions: FloatArray


class _Search(NamedTuple):
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
    sights: tuple[_Sight, ...] = ()

    def compressed(self) -> _Search:
        """The same with none but the points that rows refer to."""
        sides, rows, kept = only_used(self.sides, self.rows)
        number = np.full(len(self.sides.points), -1, dtype=np.int64)
        number[kept] = np.arange(len(kept))
        sights = []
        for one in self.sights:
            told = number[one.points] >= 0
            sights.append(_Sight(int(number[one.place]), number[one.points[told]], one.directions[told]))
        return self._replace(sides=sides, rows=rows, sights=tuple(sights))

    @property
    def movements(self) -> int:
        """Unknowns of the movement itself."""
        return 3 + {Turn.ANY: 3, Turn.VERTICAL: 1, Turn.NONE: 0}[self.turn] + (not self.scaled)

    @property
    def unknowns(self) -> int:
        """All of them."""
        return self.movements + len(self.sides.sets) + 3 * len(self.sides.places)

    def residuals(self, states: Moves) -> FloatArray:
        """(k, n) in units of what everything is good to."""
        off = residuals(self.rows, self.sides, states)
        moved = states.scale[:, None, None] * (self.own @ np.swapaxes(states.rotation, 1, 2))
        there = (moved + states.shift[:, None, :] - self.goal) / self.goal_sigma
        return np.concatenate([off, there[:, np.isfinite(self.goal)]], axis=1)

    def moved(self, states: Moves, steps: FloatArray) -> Moves:
        """States after steps (k, unknowns): parts of the size, radians, logarithm of the scale."""
        unit = (states.scale * self.size)[:, None]
        turns = np.zeros((len(steps), 3))
        if self.turn is Turn.ANY:
            turns = steps[:, 3:6]
        elif self.turn is Turn.VERTICAL:
            turns[:, 2] = steps[:, 3]
        n, sets = self.movements, len(self.sides.sets)
        factor = np.ones(len(steps)) if self.scaled else np.exp(steps[:, n - 1])
        places = steps[:, n + sets :].reshape(len(steps), -1, 3)
        return Moves(
            states.scale * factor,
            exponential(turns) @ states.rotation,
            states.shift + unit * steps[:, :3],
            states.kappas + steps[:, n : n + sets],
            states.places + unit[:, None] * places,
        )


def _search(
    target: Part, source: Part, sides: Sides, rows: list[Rows], common: IntArray, middle: FloatArray
) -> _Search:
    both = source.levelled and target.levelled
    turn = (Turn.NONE if source.oriented and target.oriented else Turn.VERTICAL) if both else Turn.ANY
    goal = target.points[common].copy()
    lift = np.zeros(len(common)) if target.lifts is source.lifts else sides.lowered[common]
    goal[:, 2] += lift
    own = sides.points[sides.known.points == 2]
    size = _extent(own) or _extent(source.points[np.isfinite(source.points).all(axis=1)]) or 1.0
    extent = _extent(target.points[np.isfinite(target.points).all(axis=1)])
    return _Search(
        sides,
        rows,
        source.points[common] - middle,
        goal,
        PRECISION * (extent or size),
        size,
        middle,
        turn,
        source.scaled and target.scaled,
    )


def _extent(points: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) > 1 else 0.0


def _sights(scene: Scene, sides: Sides) -> tuple[_Sight, ...]:
    """One set of each orientation that is looked for, with the points that either part knows."""
    found = []
    for block in sides.sets.tolist():
        sight = next(one for one in scene.terrestrial.sights if one.rotation == block)
        told = (sides.known.points[sight.points] > 0) & np.isfinite(sight.directions)
        found.append(_Sight(sight.position, sight.points[told], sight.directions[told]))
    return tuple(found)


def _starts(search: _Search) -> Moves:
    """Turns all over, with shifts and scales drawn about what is common or in reach."""
    draw = np.random.default_rng(1)
    turns = sampled_turns(search.turn)
    most = int(MEMORY / (3 * max(len(search.sides.points), 1) * (search.unknowns + 1)))
    turns = np.tile(turns, (-(-STARTS // len(turns)), 1, 1))
    turns = turns[draw.permutation(len(turns))[: max(most, 50)]] if len(turns) > most else turns
    k = len(turns)
    scale = np.ones(k) if search.scaled else _scales(search, k, draw)
    theirs = search.sides.points[search.sides.known.points == 1]
    reach = np.maximum(scale * search.size, _extent(theirs))[:, None]
    fixed = np.isfinite(search.goal).all(axis=1)
    if fixed.any():
        turned = search.own[fixed].mean(axis=0) @ np.swapaxes(turns, 1, 2)
        shift = search.goal[fixed].mean(axis=0) - scale[:, None] * turned
    else:
        about = theirs.mean(axis=0) if len(theirs) else np.zeros(3)
        shift = about + reach * draw.uniform(0.0, 1.0, (k, 1)) * draw.standard_normal((k, 3))
    wanted = len(search.sides.places)
    away = reach[:, None] * draw.uniform(0.2, 2.0, (k, 1, 1)) * draw.standard_normal((k, wanted, 3))
    states = Moves(scale, turns, shift, np.zeros((k, len(search.sides.sets))), shift[:, None, :] + away)
    return states._replace(kappas=_orientations(search, states))


def _scales(search: _Search, count: int, draw: np.random.Generator) -> FloatArray:
    """As common points tell, or as distances do, or anything."""
    known = np.isfinite(search.goal).all(axis=1)
    size = _extent(search.goal[known])
    if size:
        return np.asarray(size / _extent(search.own[known]) * np.exp(0.2 * draw.standard_normal(count)))
    lengths = [
        one.group.observed for one in search.rows if one.group.type.key in ("distance", "horizontal_distance")
    ]
    reach = float(np.nanmax(np.concatenate(lengths))) if lengths else 0.0
    reach = reach or _extent(search.sides.points[search.sides.known.points == 1])
    if reach:
        return np.asarray(reach / search.size * np.exp(draw.uniform(-1.5, 1.5, count)))
    return np.asarray(10.0 ** draw.uniform(-3.0, 4.0, count))


def _orientations(search: _Search, states: Moves) -> FloatArray:
    """(k, a) of sets, from the places that their points have at the start: the circular mean."""
    points, _ = placed(search.sides, states)
    kappas = np.zeros((len(states.scale), len(search.sides.sets)))
    for column, (place, sighted, directions) in enumerate(search.sights):
        away = points[:, sighted, :2] - points[:, place, None, :2]
        turn = np.exp(1j * (directions - np.arctan2(away[..., 0], away[..., 1])))
        kappas[:, column] = np.angle(turn.sum(axis=1))
    return kappas


def _judged(search: _Search, found: Minima, redundant: int) -> Movement | None:
    agrees = np.abs(found.residuals[0]) < FITS
    count = int(np.count_nonzero(agrees))
    values, axes = _determined(search, found.derivatives[agrees])
    open_ = values * OPEN < 1.0
    redundancy = count - search.unknowns + int(np.count_nonzero(open_))
    if redundancy < redundant or count < AGREEING * len(agrees):
        return None
    best = _movement(search, found, 0)
    others: list[int] = []
    for k in np.flatnonzero(found.objectives < found.objectives[0] + CLEAR)[1:].tolist():
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


def _determined(search: _Search, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Reciprocal σ (m,) of combinations of the movements, and these (m, m), whatever else is looked for."""
    n = search.movements
    further = rows[:, n:]
    rest = rows[:, :n]
    if further.shape[1]:
        left, values, _ = np.linalg.svd(further, full_matrices=False)
        left = left[:, values > 1e-9 * values.max(initial=1e-300)]
        rest = rest - left @ (left.T @ rest)
    padded = np.concatenate([rest, np.zeros((n, n))])
    _, values, axes = np.linalg.svd(padded, full_matrices=False)
    return values, axes


def _apart(search: _Search, found: Minima, one: int, other: int, axes: FloatArray) -> bool:
    """True where two movements differ in what is determined."""
    a, b = (Moves(*(array[k] for array in found.states)) for k in (one, other))
    turn = b.rotation @ a.rotation.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    cosine = 0.5 * (np.trace(turn) - 1.0)
    small = small if cosine > 0.0 else small + np.pi / 2.0
    turns = {Turn.ANY: small, Turn.VERTICAL: small[2:], Turn.NONE: small[:0]}[search.turn]
    size = np.maximum(a.scale, b.scale) * search.size
    scales = [] if search.scaled else [np.log(b.scale / a.scale)]
    difference = np.concatenate([(b.shift - a.shift) / size, turns, scales])
    return bool(np.abs(axes @ difference).max(initial=0.0) > APART)


def _movement(search: _Search, found: Minima, number: int) -> Similarity:
    states = some(Moves(*found.states), np.array([number]))
    scale, rotation = float(states.scale[0]), states.rotation[0]
    shift = states.shift[0] - scale * rotation @ search.middle
    return Similarity(SimilarityOutcome.DETERMINED, scale, rotation, shift, np.zeros((0, 3)), 0.0)


__all__ = ["CONTROLLED", "tie_by_observations"]
