"""Rank planned observations by what they contribute."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, vstack

from mor.errors import InputError, Message
from mor.model import rotations
from mor.model.contract import ObservationGroup, some_rows, with_sigma_model
from mor.plan.requirements import (
    REACHED,
    Interest,
    PlanMeasures,
    RowLimits,
    Unit,
    coordinates_at,
    datum_rows,
    judged_outcome,
    outcomes,
    present,
    solvable,
)
from mor.quality.assessment import Quality
from mor.quality.external_reliability import EliminatedPoints, eliminated_points
from mor.solve.problem import linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray

# ---- N⁻¹ and N⁻¹Cᵀ of points that are eliminated by their own rays, as in ``quality/external_reliability.py``.
#
# Rows of all points are as long as the longest, filled up with zeros.


class PointRows(NamedTuple):
    """What P eliminated points do with the reduced unknowns of their rays."""

    points: EliminatedPoints
    others: IntArray
    """(P, k) reduced unknowns of their rays; 0 where there are less than k."""
    back: FloatArray
    """(P, 3, k) N⁻¹Cᵀ, 0 there."""
    parts: tuple[tuple[IntArray, int], ...]
    """Points that are worked on together, by how many unknowns their rays have, and the most of them."""

    def put_solutions(self, found: FloatArray, reduced: FloatArray, chosen: IntArray, right: FloatArray) -> None:
        """Put what they do (u, m) where the reduced unknowns do x (r, m), with right-hand sides (c, 3, m) of some."""
        for some, most in self.parts:
            found[self.points.columns[some]] = -(self.back[some, :, :most] @ reduced[self.others[some, :most]])
        found[self.points.columns[chosen]] += self.points.inverse[chosen] @ right

    def cofactors(self, reduced: FloatArray) -> FloatArray:
        """(P, 3, 3) N⁻¹ + N⁻¹Cᵀ Q_rr C N⁻¹."""
        found = self.points.inverse.copy()
        for some, most in self.parts:
            others, back = self.others[some, :most], self.back[some, :, :most]
            inner = reduced[others[:, :, None], others[:, None, :]]
            found[some] += back @ inner @ back.transpose(0, 2, 1)
        return found


def _rows_of(points: EliminatedPoints) -> PointRows:
    entries, count = csr_matrix(points.coupling).tocoo(), len(points.inverse)
    size = entries.shape[0]
    point, component = np.divmod(entries.col.astype(np.int64), 3)
    key, place = np.unique(point * size + entries.row, return_inverse=True)
    point, other = np.divmod(key, size)
    begin = np.searchsorted(point, np.arange(count + 1))
    number = np.diff(begin)
    within = np.arange(len(other)) - begin[point]
    most = int(number.max(initial=0))
    others = np.zeros((count, most), dtype=np.int64)
    padded = np.zeros((count, most, 3))
    others[point, within], padded[point[place], within[place], component] = other, entries.data
    order = np.lexsort((others[:, 0], number)) if most else np.argsort(number)  # neighbours meet the same cofactors
    # At a time: larger arrays than these make are had from the system again each time, which clears them first.
    points_at_a_time = 200
    parts = [order[first : first + points_at_a_time] for first in range(0, len(order), points_at_a_time)]
    back = points.inverse @ padded.transpose(0, 2, 1)
    return PointRows(points, others, back, tuple((some, int(number[some].max())) for some in parts))


# ---- Candidates of large blocks, ranked without the cofactors of everything.
#
# As in ``requirements.py``, but only three things are worked out: G = M_I Q M_jᵀ for the few rows I that can
# change the verdict (coordinates with a required σ, observations that are weak: r only grows by what is
# added), K_jj of every candidate by itself, and nothing else. A point that is eliminated by its own rays, N
# its normal equations and C their coupling with the reduced unknowns, has the cofactors N⁻¹ + N⁻¹CᵀQ_rr C
# N⁻¹; a candidate to it with the derivatives J_r, J_p hence
#
#     K_jj = J_r Q_rr J_rᵀ − J_r Q_rr D ᵀ− D Q_rr J_rᵀ + D Q_rr Dᵀ + J_p N⁻¹ J_pᵀ,    D = J_p N⁻¹ Cᵀ.

MOST_LOOKED_AT = 600
_WEAKEST = 40
"""Observations whose redundancy numbers are followed, whatever is required."""


class Wide(NamedTuple):
    """The rows that can change the verdict, and what is needed of the rest."""

    interest: Interest
    """Of these rows alone; it has no units."""
    solutions: FloatArray
    """(u, m) Q M_Iᵀ at the reduced unknowns and the points below."""
    reduced: FloatArray
    """(r, r) Q_rr of the reduced unknowns, without the part of the weak directions."""
    rows: PointRows
    """Those that candidates, or rows of the interest, refer to."""
    spread: FloatArray
    """(P, 3, 3) their cofactors, without that part."""


def wide_interest(
    quality: Quality, blocks: IntArray, weak: Sequence[IntArray], candidates: Sequence[ObservationGroup]
) -> Wide:
    """The rows of the coordinates of point blocks and of ``weak`` observations: (k, 2) row and component by group.

    Raises :class:`InputError` where there are too many of them, or too many images.
    """
    adjustment = quality.adjustment
    problem, plan, inverse = adjustment.problem, adjustment.plan, adjustment.inverse
    looked_at = sum(len(some) for some in weak) + int((problem.index.columns["point"][blocks] >= 0).sum())
    _check_size(looked_at, len(plan.kept))
    rows, groups = [], []
    tangent = rotation_tangents(problem.index, adjustment.values)
    for number, some in enumerate(weak):
        if not len(some):
            continue
        group = problem.groups[number]
        chosen = some_rows(group, some[:, 0])
        part = linearise(chosen, problem.index, adjustment.values, tangent, slice(None))
        own = np.arange(len(some))
        weighted = part.jacobian[own, some[:, 1]] / chosen.sigma[own, some[:, 1]][:, None]
        row = np.broadcast_to(own[:, None], part.columns.shape)
        free = part.columns >= 0
        shape = (len(some), problem.index.count)
        rows.append(csr_matrix((weighted[free], (row[free], part.columns[free])), shape=shape))
        groups.append(np.full(len(some), number))
    first = sum(part.shape[0] for part in rows)
    of_datum, places = _coordinate_rows(quality, blocks, first)
    M = csr_matrix(vstack([*rows, of_datum]))
    reduced = inverse.scale[:, None] * inverse.factor.solve(np.diag(inverse.scale))
    there = np.unique(M.indices).astype(np.int64)
    used = problem.index.block_of[there[plan.reduced[there] < 0]]
    met = [_points_of(group) for group in candidates]
    of_points = _rows_of(eliminated_points(adjustment, np.concatenate([used.astype(np.int64), *met])))
    solutions = _solutions(quality, M, reduced, of_points)
    K = np.asarray(M @ solutions)
    group_of = np.concatenate([*groups, np.full(of_datum.shape[0], -1)]).astype(np.int64)
    interest = Interest(0.5 * (K + K.T), group_of >= 0, group_of, (), (), places, ())
    return Wide(interest, solutions, reduced, of_points, of_points.cofactors(reduced))


def _coordinate_rows(quality: Quality, blocks: IntArray, first: int) -> tuple[csr_matrix, IntArray]:
    """Rows of :func:`datum_rows`, of which few entries are not 0 where no datum is free."""
    if quality.datum.null.shape[1]:
        dense, places = datum_rows(quality, blocks, first)
        return csr_matrix(dense), places
    chosen, places = coordinates_at(quality, blocks, first)
    count = quality.adjustment.problem.index.count
    rows = csr_matrix((np.ones(len(chosen)), (np.arange(len(chosen)), chosen)), shape=(len(chosen), count))
    return rows, places


def _check_size(looked_at: int, reduced: int) -> None:
    """Raise :class:`InputError` where there are too many rows, or too many images: before anything is held of them."""
    # Reduced unknowns whose cofactors are held as a whole: more than a gigabyte.
    most_reduced = 12_000
    if looked_at > MOST_LOOKED_AT or reduced > most_reduced:
        words = (
            f"ranking considers {looked_at} coordinates and weak observations in {reduced} unknowns of images "
            f"and stations, expected {MOST_LOOKED_AT} in {most_reduced} at most; require σ of fewer points, or less r"
        )
        raise InputError([Message(words)])


def _solutions(quality: Quality, M: csr_matrix, reduced: FloatArray, of_points: PointRows) -> FloatArray:
    """(u, m) Q Mᵀ at the reduced unknowns and at the points; 0 at all other points.

    The rows of M are 0 at these, but for coordinates in a free datum, whose inner constraints reach all points.
    """
    adjustment = quality.adjustment
    inverse, plan = adjustment.inverse, adjustment.plan
    solved = 48
    if quality.datum.null.shape[1]:
        starts = range(0, M.shape[0], solved)
        parts = [inverse.solve(np.ascontiguousarray(M[k : k + solved].toarray().T)) for k in starts]
        return np.concatenate(parts, axis=1)
    index = adjustment.problem.index
    met = np.unique(M.indices)
    own = of_points.points.place[index.block_of[met[plan.reduced[met] < 0]]]
    own = np.unique(own[own >= 0])
    right = M[:, of_points.points.columns[own].ravel()].toarray().T.reshape(len(own), 3, M.shape[0])
    alone = np.ascontiguousarray(M[:, plan.kept].toarray().T)
    for k, its_right in zip(own.tolist(), right, strict=True):
        np.subtract.at(alone, of_points.others[k], of_points.back[k].T @ its_right)
    x = reduced @ alone
    found = np.zeros((index.count, M.shape[0]))
    found[plan.kept] = x
    of_points.put_solutions(found, x, own, right)
    weak = inverse.weak
    return found + weak @ np.asarray(M @ weak).T if weak.shape[1] else found


def _points_of(group: ObservationGroup) -> IntArray:
    found = group.blocks_of("point")
    return np.concatenate([np.asarray(b, dtype=np.int64) for b in found] or [np.zeros(0, dtype=np.int64)])


def weak_observations(quality: Quality, least: FloatArray) -> list[IntArray]:
    """By group rows and components (k, 2) of observations below a required r, and of the weakest of all."""
    numbers, rows, components, r_of = [], [], [], []
    for number, one in enumerate(quality.groups):
        r = one.r
        weak = np.isfinite(r) & (r < max(float(least[number]), _weakest(r)))
        row, component = np.nonzero(weak)
        numbers.append(np.full(len(row), number))
        rows.append(row)
        components.append(component)
        r_of.append(r[weak])
    group, r_all = np.concatenate(numbers), np.concatenate(r_of)
    places = np.stack([np.concatenate(rows), np.concatenate(components)], axis=1)
    chosen = r_all < least[group]
    chosen[np.argsort(r_all, kind="stable")[:_WEAKEST]] = True
    return [places[chosen & (group == k)] for k in range(len(quality.groups))]


def _weakest(r: FloatArray) -> float:
    known = r[np.isfinite(r)]
    return float(np.partition(known, _WEAKEST)[_WEAKEST]) if len(known) > _WEAKEST else np.inf


def wide_outcomes(
    quality: Quality, wide: Wide, wanted: RowLimits, candidates: Sequence[ObservationGroup], least: FloatArray
) -> Iterator[tuple[list[Unit], PlanMeasures, BoolArray]]:
    """Outcomes of the plan with each candidate, by units, and which of them are estimable.

    ``least`` is the required redundancy number of the observations of each group of candidates.
    """
    at_a_time = 1_000
    for number, given in enumerate(candidates):
        group = with_sigma_model(given, quality.adjustment.values)
        whole = group.mask.sum(axis=1)
        for size in np.unique(whole[whole > 0]).tolist():
            here = np.flatnonzero(whole == size)
            here = here[np.argsort(group.blocks[0][here], kind="stable")]  # neighbours meet the same cofactors
            for first in range(0, len(here), at_a_time):
                rows = here[first : first + at_a_time]
                outcome, estimable = _outcomes(quality, wide, wanted, some_rows(group, rows), size, least[number])
                yield [Unit(number, int(row), np.arange(size), True) for row in rows], outcome, estimable


def _outcomes(
    quality: Quality, wide: Wide, wanted: RowLimits, group: ObservationGroup, size: int, least: float
) -> tuple[PlanMeasures, BoolArray]:
    adjustment = quality.adjustment
    tangent = rotation_tangents(adjustment.problem.index, adjustment.values)
    part = linearise(group, adjustment.problem.index, adjustment.values, tangent, slice(None))
    chosen = np.argsort(~group.mask, axis=1, kind="stable")[:, :size]
    rows = np.arange(group.count)[:, None]
    J = part.jacobian[rows, chosen] / group.sigma[rows, chosen][:, :, None]
    J = np.where((part.columns >= 0)[:, None, :], J, 0.0)
    columns = np.maximum(part.columns, 0)
    own = _own_cofactors(quality, wide, J, columns)
    G = np.einsum("cjk,ckm->cmj", J, wide.solutions[columns])
    R = np.eye(size) + own
    possible = solvable(R)
    R[~possible], G[~possible] = np.eye(size), 0.0
    L = rotations.inv(rotations.cholesky(R))
    W = np.einsum("cjk,cmk->cmj", L, G)
    K = wide.interest.cofactors
    after = np.diagonal(K)[None] - np.einsum("cmj,cmj->cm", W, W)
    its_r = np.einsum("ckj,ckj->cj", L, L)  # the diagonal of (I + K_jj)⁻¹
    diagonal = np.concatenate([after, 1.0 - its_r], axis=1)
    interest = wide.interest._replace(
        group=np.concatenate([wide.interest.group, np.full(size, len(adjustment.problem.groups))])
    )
    full = wanted._replace(least_r=np.concatenate([wanted.least_r, np.full(size, least)]))
    taking = np.broadcast_to(interest.group >= 0, diagonal.shape)
    outcome = judged_outcome(interest, full, diagonal, 1.0 - diagonal, taking, K, W, possible)
    return outcome, _estimable(adjustment.inverse.null, J, columns)


def _estimable(null: FloatArray, J: FloatArray, columns: IntArray) -> BoolArray:
    """(c,) false for candidates that a free movement of the network would change."""
    if null.shape[1] == 0:
        return np.ones(len(J), dtype=bool)
    image = np.abs(np.einsum("cjk,ckd->cjd", J, null[columns]))
    size = np.einsum("cjk,ckd->cjd", np.abs(J), np.abs(null[columns]))
    return np.asarray((image <= 1e-6 * np.maximum(size, 1e-300)).all(axis=(1, 2)))


def _own_cofactors(quality: Quality, wide: Wide, J: FloatArray, columns: IntArray) -> FloatArray:
    """(c, k, k) K_jj of candidates with derivatives (c, k, K) by the unknowns ``columns`` (c, K)."""
    adjustment = quality.adjustment
    plan, index = adjustment.plan, adjustment.problem.index
    place = plan.reduced[columns]
    kept = place >= 0
    used = (J != 0.0).any(axis=1)
    out = ~kept & used
    by_reduced = np.where(kept[:, None, :], J, 0.0)
    at = np.maximum(place, 0)
    K = by_reduced @ wide.reduced[at[:, :, None], at[:, None, :]] @ by_reduced.transpose(0, 2, 1)
    if out.any():
        numbers = np.where(out, index.block_of[columns], -1)
        point = numbers.max(axis=1)
        if (np.where(out, numbers, point[:, None]) != point[:, None]).any():
            words = "candidates between two points that only images see cannot be ranked in so large a block"
            raise InputError([Message(words)])
        some = np.flatnonzero(point >= 0)
        K[some] += _through_points(wide, J[some], columns[some], by_reduced[some], at[some], point[some])
    weak = adjustment.inverse.weak
    if weak.shape[1]:
        along = np.einsum("cjk,ckd->cjd", J, weak[columns])
        K += along @ along.transpose(0, 2, 1)
    return np.asarray(0.5 * (K + K.transpose(0, 2, 1)))


def _through_points(
    wide: Wide, J: FloatArray, columns: IntArray, by_reduced: FloatArray, at: IntArray, point: IntArray
) -> FloatArray:
    """(c, k, k) what the eliminated points of candidates add to K_jj."""
    rows, number = wide.rows, wide.rows.points.place[point]
    # derivatives by the three coordinates, wherever they stand among the columns
    at_point = (columns[:, :, None] == rows.points.columns[number][:, None, :]).astype(float)
    J_p = J @ at_point
    others, back = rows.others[number], rows.back[number]
    crossing = wide.reduced[at[:, :, None], others[:, None, :]] @ back.transpose(0, 2, 1)
    cross = by_reduced @ crossing @ J_p.transpose(0, 2, 1)
    return np.asarray(J_p @ wide.spread[number] @ J_p.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1))


# ---- Which planned observations can be spared, which candidates bring most, and a plan made of the best, one by one.
#
# Every figure is that of the plan with this one change, adjusted again, to round-off (``requirements.py``).


class Ranked(NamedTuple):
    """A unit and what the plan would be with it, or without it."""

    unit: Unit
    shortfall: float
    precision: float
    largest_ratio: float
    smallest_r: float
    possible: bool


class GreedyStep(NamedTuple):
    """One choice of a greedy plan, and what the plan is after it."""

    ranked: Ranked
    measurements: int
    """All that were added so far."""


def ranked(interest: Interest, wanted: RowLimits, candidates: bool) -> list[Ranked]:
    """All candidates, the most useful first; or all planned units, the most easily spared first."""
    units = [unit for unit in interest.units if unit.is_candidate == candidates]
    found = list(_scored(interest, wanted, units, 1.0 if candidates else -1.0))
    return by_worth(found, present(interest, wanted), candidates)


def by_worth(found: Sequence[Ranked], present: PlanMeasures, candidates: bool) -> list[Ranked]:
    """Changes of a plan, the most useful candidates first, or what is most easily spared."""
    now = _one(present, 0)

    def worth(one: Ranked) -> tuple[float, ...]:
        cost = one.unit.cost
        gain = now.shortfall - one.shortfall, now.precision - one.precision
        if candidates:
            return (0.0 if one.possible else 1.0, -_rounded(gain[0] / cost), -_rounded(gain[1] / cost))
        return (0.0 if one.possible else 1.0, _rounded(-gain[0] / cost), _rounded(-gain[1] / cost))

    return sorted(found, key=worth)


def of_units(units: Sequence[Unit], found: PlanMeasures) -> list[Ranked]:
    """Units with what the plan would be with each."""
    columns = (found.shortfall, found.precision, found.largest_ratio, found.smallest_r, found.possible)
    return list(map(Ranked, units, *(column.tolist() for column in columns)))


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")


def greedy(interest: Interest, wanted: RowLimits, most: int) -> list[GreedyStep]:
    """Candidates one after the other, each the one that takes away most of the shortfall for a measurement.

    It ends where nothing falls short, where no candidate is left that helps, or after ``most`` of them. A plan that
    reaches what is required is gone over once more: what later choices have made superfluous is taken out again, and
    any two for which one will do.
    """
    left = [unit for unit in interest.units if unit.is_candidate]
    steps = list(_one_by_one(interest, wanted, left, most))
    # Choices up to which a greedy plan is gone over once more.
    if wanted.is_empty or not steps or steps[-1].ranked.shortfall > REACHED or len(steps) > 30:
        return steps
    chosen = _fewer(interest, wanted, [step.ranked.unit for step in steps], left)
    return list(_one_by_one(interest, wanted, chosen, most)) if len(chosen) < len(steps) else steps


def _one_by_one(interest: Interest, wanted: RowLimits, units: Sequence[Unit], most: int) -> Iterator[GreedyStep]:
    left = list(units)
    now = _one(present(interest, wanted), 0)
    total = 0
    for _ in range(most):
        if not left or (now.shortfall <= REACHED and not wanted.is_empty):
            return
        best = _best(now, [one for one in _scored(interest, wanted, left, 1.0) if one.possible])
        if best is None:
            return
        interest = added(interest, best.unit)
        left = [unit for unit in left if unit is not best.unit]
        total += best.unit.cost
        now = best
        yield GreedyStep(best, total)


def _fewer(interest: Interest, wanted: RowLimits, chosen: Sequence[Unit], candidates: Sequence[Unit]) -> list[Unit]:
    """A choice that reaches what is required as well, with fewer measurements where one is found near by."""
    whole = interest
    for unit in chosen:
        whole = added(whole, unit)
    kept, again = list(chosen), True
    while again:
        again = False
        for out in (*((unit,) for unit in kept), *combinations(kept, 2)):
            without = whole
            for unit in out:
                without = spared(without, unit)
            rest = [unit for unit in kept if all(unit is not one for one in out)]
            if len(out) == 1:
                again = present(without, wanted).shortfall[0] <= REACHED
                new: list[Unit] = []
            else:
                new = _one_that_will_do(without, wanted, rest, out, candidates)
                again = bool(new)
            if again:
                kept = [*rest, *new]
                whole = without
                for unit in new:
                    whole = added(whole, unit)
                break
    return kept


def _one_that_will_do(
    interest: Interest, wanted: RowLimits, rest: Sequence[Unit], out: Sequence[Unit], candidates: Sequence[Unit]
) -> list[Unit]:
    """The candidate that takes the place of others with fewer measurements; nothing where there is none."""
    cost = sum(unit.cost for unit in out)
    taken = {id(unit) for unit in (*rest, *out)}
    others = [unit for unit in candidates if id(unit) not in taken and unit.cost < cost]
    found = [one for one in _scored(interest, wanted, others, 1.0) if one.possible and one.shortfall <= REACHED]
    return [min(found, key=lambda one: (one.unit.cost, _rounded(one.precision))).unit] if found else []


def _best(now: Ranked, found: Sequence[Ranked]) -> Ranked | None:
    """Candidate that lowers the shortfall most per measurement; if none does, the variance."""
    if not found:
        return None
    gain = [(now.shortfall - one.shortfall) / one.unit.cost for one in found]
    if max(gain) > REACHED:
        return found[int(np.argmax([_rounded(value) for value in gain]))]
    gain = [(now.precision - one.precision) / one.unit.cost for one in found]
    best = found[int(np.argmax([_rounded(value) for value in gain]))]
    # Part of the mean variance that a candidate has to take away to be worth a measurement.
    return best if max(gain) > 1e-12 * now.precision else None


def added(interest: Interest, unit: Unit) -> Interest:
    """The cofactors with a candidate taking part."""
    K = interest.cofactors
    column = K[:, unit.rows]
    R = np.eye(unit.cost) + K[np.ix_(unit.rows, unit.rows)]
    half = rotations.solve(rotations.cholesky(R), column.T)
    active = interest.active.copy()
    active[unit.rows] = True
    return interest._replace(cofactors=K - half.T @ half, active=active)


def spared(interest: Interest, unit: Unit) -> Interest:
    """The cofactors without observations that take part."""
    K = interest.cofactors
    R = np.eye(unit.cost) - K[np.ix_(unit.rows, unit.rows)]
    half = rotations.solve(rotations.cholesky(R), K[:, unit.rows].T)
    active = interest.active.copy()
    active[unit.rows] = False
    return interest._replace(cofactors=K + half.T @ half, active=active)


def _scored(interest: Interest, wanted: RowLimits, units: Sequence[Unit], sign: float) -> Iterator[Ranked]:
    scores: dict[int, Ranked] = {}
    sizes = np.array([unit.cost for unit in units])
    for size in np.unique(sizes).tolist():
        here = np.flatnonzero(sizes == size)
        # Numbers that are worked on together.
        at_a_time = max(1, 20_000_000 // (len(interest.cofactors) * size))
        for first in range(0, len(here), at_a_time):
            some = here[first : first + at_a_time].tolist()
            chosen = [units[k] for k in some]
            scores |= zip(some, of_units(chosen, outcomes(interest, wanted, chosen, sign)), strict=True)
    return (scores[k] for k in range(len(units)))


def _one(found: PlanMeasures, number: int) -> Ranked:
    unit = Unit(-1, -1, np.zeros(0, dtype=np.int64), True)
    return Ranked(
        unit,
        float(found.shortfall[number]),
        float(found.precision[number]),
        float(found.largest_ratio[number]),
        float(found.smallest_r[number]),
        bool(found.possible[number]),
    )


def points_looked_at(blocks: Sequence[IntArray], every: IntArray) -> IntArray:
    """The point blocks with a required σ, or ``every`` one where there are none."""
    found = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *blocks]))
    return found if len(found) else every
