"""Two parts, and any observations between them or inside the one that joins: the movement that these determine."""

from __future__ import annotations

from hashlib import sha256

import numpy as np

from mor.approximate.observation_ties.equations import PRECISION, Moves, Rows, Sides, rows_between, sides_of
from mor.approximate.observation_ties.robust_minimum import Minima, minima, some
from mor.approximate.observation_ties.search import Search, Sight, extent, stance_of, standing, starts
from mor.approximate.parts.movement import Movement, Turn
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.similarity import Similarity, SimilarityOutcome
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
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
SMALL = 5_000
"""Observations of a network up to which it is tried."""
SEARCHED = 400
"""Observations of the first search in a network, at the most; the k-th one is made among a k-th of them.

A search refines hundreds of starts, and if nothing fits, there is always another pair of parts. All searches together
take at most a few times as long as the largest one.
"""


def tie_by_observations(
    network: Network, target: Part, source: Part, scene: Scene, redundant: int = CONTROLLED
) -> Movement | None:
    """The movement from source to target that most observations agree with.

    ``None`` where fewer than ``redundant`` beyond those it takes agree, where nothing came in since it was asked, or
    after too many searches in the network (``SEARCHED``).
    """
    known = np.asarray(np.isfinite(source.points).all(axis=1))
    if network.observations > SMALL or not (known.any() or source.poses):
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
    search = standing(search._replace(sights=_sights(scene, sides)).compressed())
    return _remembered(search, told, redundant, scene.tied)


def _remembered(
    search: Search, observations: int, redundant: int, tied: dict[bytes, Movement | None]
) -> Movement | None:
    """The movement looked for; other answers to what was in doubt elsewhere come to the same question again."""
    told = [*search.sides[:-1], search.own, search.goal, *(one.sigma for one in search.rows)]
    arrays = [array for one in told for array in (one if isinstance(one, tuple) else (one,))]
    asked = search.goal_sigma, search.size, search.turn, search.scaled, search.stance, redundant
    words = repr(asked).encode()
    key = sha256(words + b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).digest()
    if key not in tied and observations * (len(tied) + 1) <= SEARCHED:
        with np.errstate(all="ignore"):
            tied[key] = _judged(search, minima(search, starts(search)), redundant)
    return tied.get(key)


def _search(
    target: Part,
    source: Part,
    scene: Scene,
    sides: Sides,
    rows: list[Rows],
    common: IntArray,
    middle: FloatArray,
) -> Search:
    both = source.levelled and target.levelled
    turn = (Turn.NONE if source.oriented and target.oriented else Turn.VERTICAL) if both else Turn.ANY
    goal = target.points[common].copy()
    goal[:, 2] += scene.target_heights[common] if target.lifts and not source.lifts else 0.0
    own = sides.points[sides.known.points == 2]
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
        turn,
        source.scaled and target.scaled,
        stance_of(target, source),
    )


def _sights(scene: Scene, sides: Sides) -> tuple[Sight, ...]:
    """One set of each orientation that is looked for, with the points that either part knows."""
    found = []
    for block in sides.sets.tolist():
        sight = next(one for one in scene.terrestrial.sights if one.rotation == block)
        told = (sides.known.points[sight.points] > 0) & np.isfinite(sight.directions)
        rises = np.tan(sight.verticals[told])
        found.append(Sight(sight.position, sight.points[told], sight.directions[told], rises))
    return tuple(found)


def _judged(search: Search, found: Minima, redundant: int) -> Movement | None:
    agrees = np.abs(found.residuals[0]) < FITS
    count = int(np.count_nonzero(agrees))
    values, axes, without = _determined(search, found.derivatives[agrees])
    open_ = values * OPEN < 1.0
    redundancy = count - search.unknowns + int(np.count_nonzero(open_)) + without
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


def _determined(search: Search, rows: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Reciprocal σ (m,) of combinations of the movements, these (m, m), whatever else is looked for.

    The last: how many movements of the target itself the observations leave open.
    """
    n, stance = search.movements, search.unknowns - search.stance.unknowns
    of_target = _whatever(rows[:, n:stance], rows[:, stance:], 0.0)
    rest = _whatever(rows[:, n:stance], rows[:, :n], 0.0)
    rest = _whatever(of_target, rest, 1.0 / OPEN)
    told = tolerant.singular_values(of_target)
    padded = np.concatenate([rest, np.zeros((n, n))])
    _, values, axes = tolerant.svd(padded, full_matrices=False)
    return values, axes, search.stance.unknowns - int(np.count_nonzero(told * OPEN >= 1.0))


def _whatever(further: FloatArray, rows: FloatArray, least: float) -> FloatArray:
    """Rows (n, m) without what ``further`` (n, k) unknowns explain whose reciprocal σ is more than ``least``."""
    if not further.shape[1]:
        return rows
    left, values, _ = tolerant.svd(further, full_matrices=False)
    left = left[:, values > max(1e-9 * values.max(initial=1e-300), least)]
    return np.asarray(rows - left @ (left.T @ rows))


def _apart(search: Search, found: Minima, one: int, other: int, axes: FloatArray) -> bool:
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


def _movement(search: Search, found: Minima, number: int) -> Similarity:
    states = some(Moves(*found.states), np.array([number]))
    scale, rotation = float(states.scale[0]), states.rotation[0]
    shift = states.shift[0] - scale * rotation @ search.middle
    return Similarity(SimilarityOutcome.DETERMINED, scale, rotation, shift, np.zeros((0, 3)), 0.0)


__all__ = ["CONTROLLED", "tie_by_observations"]
