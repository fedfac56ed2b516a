"""What keeps a plain adjustment from a solution: suspects found by graduated weights, and the adjustment without them.

Least squares finds gross errors only once it has converged, and near the truth. Where it does not converge, or where it
lands at a place that all observations contradict, graduated weights tell the observations apart first; those without
weight in the end are suspects. What the rest cannot do without stays in, however bad it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import betaln, gammaln

from mor.adjustment.problem import Problem
from mor.adjustment.reweighting import normalised_misclosures
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment, Outcome, Watcher
from mor.arrays import BoolArray, FloatArray
from mor.observations import is_image_point
from mor.parameters.index import Blocks, Values, index_unknowns
from mor.quality.gross_errors.description_length import cost_of_residuals
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.graduated_weights import (
    Graduated,
    graduated_weights,
    robust_scales,
    settled_weights,
)
from mor.quality.gross_errors.on_the_sphere import problem_on_the_sphere
from mor.quality.gross_errors.reintersection import (
    OF_THEMSELVES,
    Starts,
    points_in_doubt,
    reintersected,
    starts_of,
)

_WORSE = 3.0
"""Times that half of all residuals are larger than they need be, where a converged solution is no good."""
SUSPECT = "what is observed of it contradicts the rest or itself"
"""Reason why a thing is left out."""
_SAME = 1e-6
"""Part of vᵀPv by which two minima that are one may differ."""
_MANY = 3
"""Degrees of freedom left for each that suspects take, from which the rest outvotes them beyond doubt."""
_LEVEL = 1e-3
"""Of the question whether suspects are more than the largest residuals of a poor fit."""
_ROUNDS = 8
"""Times that what suspects leave undetermined is given up with them."""
_FROM_FAR = 40
"""Iterations by directions: where nothing but start values is wrong, a dozen do, seldom thirty."""
_FROM_NEAR = 15
"""Iterations of all observations from where most of them fit: a solution, if there is one, is not far from there."""
BY_WEIGHTS = (
    "the start values lead to no solution, or to one that fits badly; "
    "all observations were adjusted from where graduated weights lead"
)
BY_DIRECTIONS = (
    "the start values lead to no solution, or to one that fits badly; "
    "all observations were adjusted from where directions instead of image coordinates lead"
)
"""Notes on how the start values were repaired."""
_GIVEN_UP = ("point", "rotation")
"""Kinds of blocks that are given up where suspects are most of what tells of them."""


@dataclass(frozen=True)
class Suspects:
    """Observations left out so that the rest has a solution that fits."""

    plain: Adjustment
    """The adjustment of all observations, which is none, or an absurd one."""
    masks: tuple[BoolArray, ...]
    """(n, m) of each group."""
    sizes: tuple[FloatArray, ...]
    """(n, m) |v|/σ of all observations against the robust solution."""
    lost: tuple[tuple[str, str], ...]
    """(kind, name) of the blocks of which so little is left that all that refers to them is among the suspects."""

    @property
    def count(self) -> int:
        """Number of suspects."""
        return _count(self.masks)


class Attempt(NamedTuple):
    """An adjustment, and what it took to reach it from the start values."""

    adjustment: Adjustment
    suspects: Suspects | None = None
    robust: Values | None = None
    """Values found with graduated weights, if the plain adjustment was not enough."""
    note: str = ""
    """How the start values were repaired, if they were."""

    @property
    def is_complete(self) -> bool:
        """True for a solution of all observations."""
        return self.adjustment.outcome.is_solution and self.suspects is None


def may_be_absurd(adjustment: Adjustment) -> bool:
    """True where a converged solution fits so badly, half of its residuals beyond 3 σ, that another one might exist."""
    problem = adjustment.problem
    redundancy = problem.observations - problem.index.count + adjustment.defect.dimension
    if redundancy <= 0 or adjustment.normals.objective <= redundancy * _WORSE**2:
        return False
    return _overall(adjustment) > _WORSE


def without_suspects(
    plain: Adjustment, settings: Settings | None = None, watch: Watcher | None = None
) -> Attempt:
    """Return the plain adjustment if it is a sensible solution; otherwise repair start values, then leave out suspects.

    All observations are tried again from where graduated weights have led; where that converges and fits, nothing is
    left out. A solution is absurd where another one is known that half of the observations fit three times better. In
    place of none, or of an absurd one, comes the adjustment without the suspects. But a solution of all observations
    stands, however bad, where it is come to from there, too (then it is no matter of where the iteration began), unless
    suspects are few; where most of a group of observations are among them, or all that see a given point (of two
    sources that contradict each other they would only be the smaller one); and where as many chosen ones would lessen
    vᵀPv so by chance.

    Weights lead by the medians of parts first, and where that leads to nothing, as where most rays to control points
    are wrong, by those of whole groups.
    """
    if plain.outcome is Outcome.SINGULAR and not plain.iterations:
        return Attempt(plain)
    if plain.outcome in (Outcome.SINGULAR, Outcome.CONVERGED) and not may_be_absurd(plain):
        return Attempt(plain)
    first = _led(plain, settings, watch, by_parts=True)
    if first.adjustment.outcome is Outcome.CONVERGED or not any(
        is_image_point(group.type) for group in plain.problem.groups
    ):
        return first
    other = _led(plain, settings, watch, by_parts=False)
    return other if other.adjustment.outcome is Outcome.CONVERGED else first


def _led(plain: Adjustment, settings: Settings | None, watch: Watcher | None, by_parts: bool) -> Attempt:
    """What there is where graduated weights lead; ``by_parts``: where most of every part is right."""
    found = graduated_weights(plain.problem, plain.start, watch, by_parts)
    found = _with_points_moved(plain.problem, found, plain.start, watch)
    return _attempt(plain, found, settings, watch)._replace(robust=found.values)


def _attempt(
    plain: Adjustment, found: Graduated, settings: Settings | None, watch: Watcher | None
) -> Attempt:
    problem = plain.problem
    scale = robust_scales(problem, found.sizes).overall
    if plain.outcome is Outcome.CONVERGED and not _overall(plain) > _WORSE * scale:
        return Attempt(plain)
    most = settings if plain.outcome is Outcome.CONVERGED else _from_near(settings)
    again = adjust(problem, found.values, most, watch)
    if again.outcome is Outcome.CONVERGED and not _overall(again) > _WORSE * scale:
        return Attempt(again, note=BY_WEIGHTS)
    suspects = _enough_left(problem, Suspects(plain, found.suspects, found.sizes, ()))
    for _ in range(_ROUNDS):
        remaining = left_out(problem, suspects)
        if 2 * remaining.index.count < problem.index.count:
            break
        if plain.outcome is Outcome.CONVERGED and _outvoted(problem, suspects):
            break
        rest = adjust(remaining, found.values, settings, watch)
        if rest.outcome is Outcome.CONVERGED:
            if plain.outcome is Outcome.CONVERGED and not (
                _are_gross(plain, rest) and (_are_few(plain, rest) or not _same_place(plain, again))
            ):
                break
            mostly_lost = _are_mostly_lost(problem, suspects)
            anew = _from_far(plain, settings, watch) if mostly_lost else Attempt(plain)
            return anew if anew.adjustment is not plain else Attempt(rest, suspects)
        missing = {unknown[:2] for one in rest.defect.undetermined for unknown in one.unknowns[:1]}
        missing = {block for block in missing if block[0] in _GIVEN_UP and block not in suspects.lost}
        if not missing:
            break
        suspects = _enough_left(problem, _without(problem, suspects, missing))
    return _from_far(plain, settings, watch)


def _with_points_moved(problem: Problem, found: Graduated, start: Values, watch: Watcher | None) -> Graduated:
    """Where points whose sights do not fit have been intersected anew, as long as that explains all better.

    A few observations of large weight may have drawn a point away from all its rays before weights told them apart.
    Each point is looked at once.
    """
    if "point" not in problem.index.blocks:
        return found
    starts, seen = starts_of(problem, found.values, start), set[int]()
    for _ in range(_ROUNDS):
        moved = reintersected(problem, found.values, found.sizes, starts, but=seen)
        seen.update(points_in_doubt(problem, found.sizes, seen))
        if np.array_equal(moved["point"], found.values["point"], equal_nan=True):
            break
        other = settled_weights(problem, moved, watch)
        if not _cost(problem, other, starts) < _cost(problem, found, starts):
            break
        found = other
    return found


def _cost(problem: Problem, found: Graduated, starts: Starts) -> float:
    """What all observations cost where weights lead, and the way of the points there."""
    count = _used(problem)
    ways = starts.costs(found.values["point"], slice(None), count)
    return cost_of_residuals(found.sizes, count) + float(np.sum(ways))


def _count(masks: Sequence[BoolArray]) -> int:
    return int(sum(np.count_nonzero(mask) for mask in masks))


def _are_mostly_lost(problem: Problem, suspects: Suspects) -> bool:
    """True where most suspects are such for what is lost with them: that alone may be what is far off."""
    of_lost = tuple(np.zeros_like(mask) for mask in suspects.masks)
    _add_rows(problem, of_lost, set(suspects.lost))
    return 2 * sum(int(np.count_nonzero(mask)) for mask in of_lost) > suspects.count


def _from_near(settings: Settings | None) -> Settings:
    return Settings(min((settings or Settings()).max_iterations, _FROM_NEAR))


def _from_far(plain: Adjustment, settings: Settings | None, watch: Watcher | None) -> Attempt:
    """All observations once more, all with their weights, from where directions in place of coordinates lead.

    Where nothing is wrong but the start values, weights may lose a point for ever whose few rays were far off at first.
    The plain adjustment where that does not converge to a place that fits either.
    """
    sphere = problem_on_the_sphere(plain.problem, plain.start)
    if sphere is None:
        return Attempt(plain)
    there = adjust(sphere, plain.start, Settings(_FROM_FAR), watch)
    if there.outcome is not Outcome.CONVERGED:
        return Attempt(plain)
    again = adjust(plain.problem, there.values, _from_near(settings), watch)
    fits = again.outcome is Outcome.CONVERGED and not may_be_absurd(again)
    return Attempt(again, note=BY_DIRECTIONS) if fits else Attempt(plain)


def _are_few(plain: Adjustment, rest: Adjustment) -> bool:
    """True where the rest keeps so much redundancy that it does not matter which of them would fit as well."""
    return _freedom(rest) >= _MANY * (_freedom(plain) - _freedom(rest))


def _same_place(one: Adjustment, other: Adjustment) -> bool:
    """True where two adjustments of the same observations have come to the same minimum."""
    objectives = one.normals.objective, other.normals.objective
    return other.outcome is Outcome.CONVERGED and abs(objectives[0] - objectives[1]) <= _SAME * objectives[0]


def _outvoted(problem: Problem, suspects: Suspects) -> bool:
    """True where most observations of a group are suspects, or all that see a point of which something is given."""
    used = [group.mask & ~group.left_out for group in problem.groups]
    return _given_points_contradicted(problem, suspects, used) or any(
        2 * np.count_nonzero(mask) > np.count_nonzero(own)
        for mask, own in zip(suspects.masks, used, strict=True)
    )


def _given_points_contradicted(problem: Problem, suspects: Suspects, used: Sequence[BoolArray]) -> bool:
    """True where a point that is held or observed itself is seen more than once, and every time by a suspect."""
    given: BoolArray = np.asarray(~(problem.index.columns["point"] >= 0).all(axis=1))
    seen, wrong = (np.zeros(len(given), dtype=np.int64) for _ in range(2))
    for group, mask, own in zip(problem.groups, suspects.masks, used, strict=True):
        itself = group.type.key.startswith(OF_THEMSELVES)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind != "point":
                continue
            if itself:
                given[blocks[own.any(axis=1)]] = True
            else:
                np.add.at(seen, blocks, own.any(axis=1))
                np.add.at(wrong, blocks, (own & mask).any(axis=1))
    return bool(np.any(given & (wrong == seen) & (seen > 1)))


def _are_gross(plain: Adjustment, rest: Adjustment) -> bool:
    """True where vᵀPv falls more without the suspects than without any other as many, by chance, whatever σ0 is.

    With normal residuals the part of vᵀPv that is left with r' of r degrees of freedom is a Beta(r'/2, (r − r')/2);
    its lower tail is told by its first term, and taken as often as there are choices of so many of all (Bonferroni).
    """
    before, after = _freedom(plain), _freedom(rest)
    if after <= 0 or plain.normals.objective <= 0.0:
        return False
    count, gone = _used(plain.problem), max(before - after, 1)
    a, b = 0.5 * after, 0.5 * gone
    part = max(rest.normals.objective / plain.normals.objective, 1e-300)
    choices = gammaln(count + 1) - gammaln(gone + 1) - gammaln(count - gone + 1)
    return bool(a * np.log(part) - np.log(a) - betaln(a, b) + choices < np.log(_LEVEL))


def _freedom(adjustment: Adjustment) -> int:
    """Redundancy of what takes part."""
    return _used(adjustment.problem) - adjustment.problem.index.count + adjustment.defect.dimension


def _used(problem: Problem) -> int:
    return sum(int(np.count_nonzero(group.mask & ~group.left_out)) for group in problem.groups)


def left_out(problem: Problem, suspects: Suspects) -> Problem:
    """The problem without the suspects; what was kept out before stays out, and lost blocks are held."""
    kept_out = (group.left_out for group in problem.groups)
    masks = [mask | out for mask, out in zip(suspects.masks, kept_out, strict=True)]
    return replace(exclude(problem, masks), index=index_unknowns(held(problem.index.blocks, suspects.lost)))


def with_suspects(rest: Problem, suspects: Suspects) -> tuple[Problem, tuple[BoolArray, ...]]:
    """The problem of the rest with the suspects in it again, and which they are. Lost blocks stay out."""
    plain = suspects.plain.problem
    gone = tuple(np.zeros(group.observed.shape, dtype=bool) for group in plain.groups)
    _add_rows(plain, gone, set(suspects.lost))
    kept_out = [group.left_out | mask for group, mask in zip(plain.groups, gone, strict=True)]
    masks = tuple(mask & ~out for mask, out in zip(suspects.masks, kept_out, strict=True))
    return exclude(replace(rest, clusters=plain.clusters), kept_out), masks


def held(blocks: Mapping[str, Blocks], lost: Sequence[tuple[str, str]]) -> dict[str, Blocks]:
    """Blocks with the lost ones (kind, name) fixed."""
    result = dict(blocks)
    for kind in {kind for kind, _ in lost}:
        gone = lost_blocks(blocks[kind], kind, lost)
        result[kind] = blocks[kind]._replace(free=blocks[kind].free & ~gone[:, None])
    return result


def lost_blocks(blocks: Blocks, kind: str, lost: Sequence[tuple[str, str]]) -> BoolArray:
    """(n,) which blocks of a kind are lost."""
    names = {name for k, name in lost if k == kind}
    return np.array([name in names for name in blocks.ids], dtype=bool)


def _overall(adjustment: Adjustment) -> float:
    sizes = tuple(map(np.abs, normalised_misclosures(adjustment.plan, adjustment.values)))
    return robust_scales(adjustment.problem, sizes).overall


def _enough_left(problem: Problem, suspects: Suspects) -> Suspects:
    """The suspects, and with them whatever has fewer observations left than free components."""
    while True:
        short = {
            (kind, problem.index.blocks[kind].ids[block])
            for kind in _GIVEN_UP
            if kind in problem.index.blocks
            for block in _short(problem, suspects.masks, kind)
        }
        short.difference_update(suspects.lost)
        if not short:
            return suspects
        suspects = _without(problem, suspects, short)


def _short(problem: Problem, masks: Sequence[BoolArray], kind: str) -> list[int]:
    """Blocks of a kind that had enough observations, and have no longer."""
    columns = problem.index.columns[kind]
    needed = np.count_nonzero(columns >= 0, axis=1)
    before, left = (np.zeros(len(columns), dtype=np.int64) for _ in range(2))
    for group, mask in zip(problem.groups, masks, strict=True):
        had = group.mask & ~group.left_out
        counts = np.count_nonzero(had, axis=1), np.count_nonzero(had & ~mask, axis=1)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == kind:
                np.add.at(before, blocks, counts[0])
                np.add.at(left, blocks, counts[1])
    return [int(block) for block in np.flatnonzero((left < needed) & (before > left))]


def _without(problem: Problem, suspects: Suspects, blocks: set[tuple[str, str]]) -> Suspects:
    """The suspects with all observations that refer to these blocks."""
    masks = tuple(mask.copy() for mask in suspects.masks)
    _add_rows(problem, masks, blocks)
    return replace(suspects, masks=masks, lost=(*suspects.lost, *sorted(blocks)))


def _add_rows(problem: Problem, masks: tuple[BoolArray, ...], blocks: set[tuple[str, str]]) -> None:
    """Add all observations that refer to these blocks (kind, name) to the masks, in place."""
    for kind in {kind for kind, _ in blocks}:
        gone = lost_blocks(problem.index.blocks[kind], kind, sorted(blocks))
        for group, mask in zip(problem.groups, masks, strict=True):
            for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
                if slot.kind == kind:
                    mask |= gone[numbers][:, None] & group.mask & ~group.left_out
