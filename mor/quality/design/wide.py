"""Candidates of large blocks, ranked without the cofactors of everything.

As in ``interest.py``, but only three things are worked out: G = M_I Q M_jᵀ for the few rows I that can change the
verdict (coordinates with a required σ, observations that are weak: r only grows by what is added), K_jj of every
candidate by itself, and nothing else. A point that is eliminated by its own rays, N its normal equations and C their
coupling with the reduced unknowns, has the cofactors N⁻¹ + N⁻¹CᵀQ_rr C N⁻¹; a candidate to it with the derivatives J_r,
J_p hence

    K_jj = J_r Q_rr J_rᵀ − J_r Q_rr D ᵀ− D Q_rr J_rᵀ + D Q_rr Dᵀ + J_p N⁻¹ J_pᵀ,    D = J_p N⁻¹ Cᵀ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, vstack

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.geometry import tolerant
from mor.observations import ObservationGroup, some_rows
from mor.observations.sigma import with_sigma_model
from mor.quality.assess import Quality
from mor.quality.design.eliminated import Eliminated, eliminated
from mor.quality.design.interest import Interest, Unit, coordinates_at, datum_rows
from mor.quality.design.shortfall import Outcome, Wanted, judged_outcome, solvable

MOST_REDUCED = 12_000
"""Reduced unknowns whose cofactors are held as a whole: more than a gigabyte."""
MOST_LOOKED_AT = 600
_WEAKEST = 40
"""Observations whose redundancy numbers are followed, whatever is required."""
_AT_A_TIME = 1_000
_SOLVED = 48
_NULL = 1e-6


class Wide(NamedTuple):
    """The rows that can change the verdict, and what is needed of the rest."""

    interest: Interest
    """Of these rows alone; it has no units."""
    solutions: FloatArray
    """(u, m) Q M_Iᵀ at the reduced unknowns and the points below."""
    reduced: FloatArray
    """(r, r) Q_rr of the reduced unknowns, without the part of the weak directions."""
    points: Eliminated
    """Those that candidates, or rows of the interest, refer to."""
    spread: FloatArray
    """(P, 3, 3) their cofactors, without that part."""


def wide_interest(
    quality: Quality,
    blocks: IntArray,
    weak: Sequence[IntArray],
    candidates: Sequence[ObservationGroup],
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
    points = eliminated(adjustment, np.concatenate([used.astype(np.int64), *met]))
    solutions = _solutions(quality, M, reduced, points)
    K = np.asarray(M @ solutions)
    group_of = np.concatenate([*groups, np.full(of_datum.shape[0], -1)]).astype(np.int64)
    interest = Interest(0.5 * (K + K.T), group_of >= 0, group_of, (), (), places, ())
    return Wide(interest, solutions, reduced, points, points.cofactors(reduced))


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
    if looked_at > MOST_LOOKED_AT or reduced > MOST_REDUCED:
        words = (
            f"ranking looks at {looked_at} coordinates and weak observations in {reduced} unknowns of images "
            f"and stations, expected {MOST_LOOKED_AT} in {MOST_REDUCED} at most; require σ of fewer points, or less r"
        )
        raise InputError([Mistake(words)])


def _solutions(quality: Quality, M: csr_matrix, reduced: FloatArray, points: Eliminated) -> FloatArray:
    """(u, m) Q Mᵀ at the reduced unknowns and at the points; 0 at all other points.

    The rows of M are 0 at these, but for coordinates in a free datum, whose inner constraints reach all points.
    """
    adjustment = quality.adjustment
    inverse, plan = adjustment.inverse, adjustment.plan
    if quality.datum.null.shape[1]:
        starts = range(0, M.shape[0], _SOLVED)
        parts = [inverse.solve(np.ascontiguousarray(M[k : k + _SOLVED].toarray().T)) for k in starts]
        return np.concatenate(parts, axis=1)
    index = adjustment.problem.index
    met = np.unique(M.indices)
    own = points.place[index.block_of[met[plan.reduced[met] < 0]]]
    own = np.unique(own[own >= 0])
    right = M[:, points.columns[own].ravel()].toarray().T.reshape(len(own), 3, M.shape[0])
    alone = np.ascontiguousarray(M[:, plan.kept].toarray().T)
    for k, its_right in zip(own.tolist(), right, strict=True):
        np.subtract.at(alone, points.others[k], points.back[k].T @ its_right)
    x = reduced @ alone
    found = np.zeros((index.count, M.shape[0]))
    found[plan.kept] = x
    points.put_solutions(found, x, own, right)
    weak = inverse.weak
    return found + weak @ np.asarray(M @ weak).T if weak.shape[1] else found


def _points_of(group: ObservationGroup) -> IntArray:
    """Point blocks that a group refers to."""
    found = [b for s, b in zip(group.type.slots, group.blocks, strict=True) if s.kind == "point"]
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
    """The redundancy number below which the weakest of a group are."""
    known = r[np.isfinite(r)]
    return float(np.partition(known, _WEAKEST)[_WEAKEST]) if len(known) > _WEAKEST else np.inf


def wide_outcomes(
    quality: Quality, wide: Wide, wanted: Wanted, candidates: Sequence[ObservationGroup], least: FloatArray
) -> Iterator[tuple[list[Unit], Outcome, BoolArray]]:
    """What the plan is with each candidate: units with their outcomes, and which of them are estimable.

    ``least`` is the required redundancy number of the observations of each group of candidates.
    """
    for number, given in enumerate(candidates):
        group = with_sigma_model(given, quality.adjustment.values)
        whole = group.mask.sum(axis=1)
        for size in np.unique(whole[whole > 0]).tolist():
            here = np.flatnonzero(whole == size)
            here = here[
                np.argsort(group.blocks[0][here], kind="stable")
            ]  # neighbours meet the same cofactors
            for first in range(0, len(here), _AT_A_TIME):
                rows = here[first : first + _AT_A_TIME]
                outcome, estimable = _outcomes(
                    quality, wide, wanted, some_rows(group, rows), size, least[number]
                )
                units = [Unit(number, int(row), np.arange(size), True) for row in rows]
                yield units, outcome, estimable


def _outcomes(
    quality: Quality,
    wide: Wide,
    wanted: Wanted,
    group: ObservationGroup,
    size: int,
    least: float,
) -> tuple[Outcome, BoolArray]:
    """What the plan is with each row of a group that has so many components."""
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
    L = tolerant.inv(tolerant.cholesky(R))
    W = np.einsum("cjk,cmk->cmj", L, G)
    K = wide.interest.cofactors
    after = np.diagonal(K)[None] - np.einsum("cmj,cmj->cm", W, W)
    its_r = np.einsum("ckj,ckj->cj", L, L)  # the diagonal of (I + K_jj)⁻¹
    diagonal = np.concatenate([after, 1.0 - its_r], axis=1)
    interest = wide.interest._replace(
        group=np.concatenate([wide.interest.group, np.full(size, len(adjustment.problem.groups))]),
    )
    full = wanted.with_least(np.concatenate([wanted.least_r, np.full(size, least)]))
    taking = np.broadcast_to(interest.group >= 0, diagonal.shape)
    outcome = judged_outcome(interest, full, diagonal, 1.0 - diagonal, taking, K, W, possible)
    return outcome, _estimable(adjustment.inverse.null, J, columns)


def _estimable(null: FloatArray, J: FloatArray, columns: IntArray) -> BoolArray:
    """(c,) false for candidates that a free movement of the network would change."""
    if null.shape[1] == 0:
        return np.ones(len(J), dtype=bool)
    image = np.abs(np.einsum("cjk,ckd->cjd", J, null[columns]))
    size = np.einsum("cjk,ckd->cjd", np.abs(J), np.abs(null[columns]))
    return np.asarray((image <= _NULL * np.maximum(size, 1e-300)).all(axis=(1, 2)))


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
            raise InputError([Mistake(words)])
        some = np.flatnonzero(point >= 0)
        K[some] += _through_points(wide, J[some], columns[some], by_reduced[some], at[some], point[some])
    weak = adjustment.inverse.weak
    if weak.shape[1]:
        along = np.einsum("cjk,ckd->cjd", J, weak[columns])
        K += along @ along.transpose(0, 2, 1)
    return np.asarray(0.5 * (K + K.transpose(0, 2, 1)))


def _through_points(
    wide: Wide,
    J: FloatArray,
    columns: IntArray,
    by_reduced: FloatArray,
    at: IntArray,
    point: IntArray,
) -> FloatArray:
    """(c, k, k) what the eliminated points of candidates add to K_jj."""
    number = wide.points.place[point]
    # derivatives by the three coordinates, wherever they stand among the columns
    at_point = (columns[:, :, None] == wide.points.columns[number][:, None, :]).astype(float)
    J_p = J @ at_point
    others, back = wide.points.others[number], wide.points.back[number]
    crossing = wide.reduced[at[:, :, None], others[:, None, :]] @ back.transpose(0, 2, 1)
    cross = by_reduced @ crossing @ J_p.transpose(0, 2, 1)
    spread = wide.spread[number]
    return np.asarray(J_p @ spread @ J_p.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1))
