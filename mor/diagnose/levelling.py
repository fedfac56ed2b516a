"""Lines of levels that were booked the other way round.

With the other sign the misclosure of a line changes by δ = −2 Δh, and vᵀPv, to first order and with all else adjusted
anew, by −2 δ v/σ² + δ² r/σ²: the lines for which it falls most are tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.diagnose.edits import cells, computed
from mor.diagnose.hypothesis import Hypothesis, with_observed
from mor.diagnose.situation import Situation
from mor.observations import PLAIN_TYPES, ObservationGroup

_TRIED = 3
_LINES = 100
"""Lines whose redundancy is worked out, the worst first."""


def levelling_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The lines that promise most with the other sign."""
    found = list(_reversed_vectors(situation))
    for number, group in enumerate(situation.network.groups):
        if group.type != PLAIN_TYPES["height_difference"] or not situation.misfitting[number].any():
            continue
        promised = _reductions(situation, number, group)
        best = np.argsort(-promised, kind="stable")[:_TRIED]
        for row in (int(row) for row in best if promised[row] > 0.0):
            names = tuple(column[row] for column in group.references)
            found.append(
                Hypothesis(
                    "levelling sign",
                    names,
                    partial(with_observed, number=number, rows=np.array([row]), change=np.negative),
                    f"{group.name}, {' → '.join(names)}: {names[1]} → {names[0]}",
                    group.count,
                    rows=((number, row),),
                    edits=cells(
                        situation.network,
                        number,
                        [row],
                        group.type.components[0].name,
                        computed(lambda value: -value),
                    ),
                )
            )
    return found


_FITS = 0.1
"""Part of its misclosure that is left of a vector with the other sign, at most: the others are not right yet."""


def _reversed_vectors(situation: Situation) -> Iterator[Hypothesis]:
    """Vectors that fit with the other sign, all of a table together; those that score tests name, if they name any."""
    scored = [place for one in situation.scored if one.cause == "vector sign" for place in one.rows]
    for number, group in enumerate(situation.network.groups):
        if group.type != PLAIN_TYPES["vector"]:
            continue
        misclosure = np.nan_to_num(misclosures(group, situation.values))
        other = misclosure - 2.0 * np.nan_to_num(group.observed)
        now, then = np.linalg.norm(misclosure, axis=1), np.linalg.norm(other, axis=1)
        rows = np.flatnonzero((then < _FITS * now) & situation.misfitting[number].any(axis=1))
        if scored:
            rows = np.array(sorted(row for k, row in scored if k == number), dtype=np.int64)
        if not len(rows):
            continue
        names = tuple(dict.fromkeys(column[row] for row in rows.tolist() for column in group.references[:2]))
        columns = [component.name for component in group.type.components]
        edits = [
            cells(situation.network, number, rows.tolist(), c, computed(lambda value: -value))
            for c in columns
        ]
        yield Hypothesis(
            "vector sign",
            names,
            partial(with_observed, number=number, rows=rows, change=np.negative),
            "; ".join(
                f"{group.name}, {group.references[1][r]} → {group.references[0][r]}" for r in rows.tolist()
            ),
            group.count,
            rows=tuple((number, int(row)) for row in rows),
            edits=tuple(edit for some in edits for edit in some),
        )


def _reductions(situation: Situation, number: int, group: ObservationGroup) -> FloatArray:
    """(n,) by how much vᵀPv becomes smaller with the other sign of a line; −∞ where that is not worked out."""
    solution = situation.solution
    values = situation.values if solution is None else solution.values
    used = group if solution is None else solution.problem.groups[number]
    misclosure, sigma = misclosures(group, values)[:, 0], group.given_sigma[:, 0]
    reductions = np.full(group.count, -np.inf)
    rows = np.argsort(-np.abs(misclosure / sigma), kind="stable")[:_LINES]
    rows = rows[group.mask[rows, 0]]
    redundancy = np.ones(len(rows))
    if solution is not None:
        own = np.flatnonzero(~used.left_out[rows, 0])
        redundancy[own] = _redundancy(solution, number, used, rows[own])
    change = -2.0 * group.observed[rows, 0]
    reductions[rows] = (-2.0 * change * misclosure[rows] - change**2 * redundancy) / sigma[rows] ** 2
    return reductions


def _redundancy(solution: Adjustment, number: int, group: ObservationGroup, rows: IntArray) -> FloatArray:
    """(k,) redundancy numbers r = 1 − a Q aᵀ/σ² of some rows of a group of single values."""
    problem, values = solution.problem, solution.values
    part = linearise(group, problem.index, values, rotation_tangents(problem.index, values), rows)
    coupling = np.zeros((problem.index.count, len(rows)))
    for k in range(len(rows)):
        free = part.columns[k] >= 0
        np.add.at(coupling[:, k], part.columns[k][free], part.jacobian[k, 0][free] / group.sigma[rows[k], 0])
    found: FloatArray = 1.0 - np.einsum("uk,uk->k", coupling, solution.inverse.solve(coupling))
    return found
