"""Lines of levels that were booked the other way round.

With the other sign the misclosure of a line changes by δ = −2 Δh, and vᵀPv, to first order and with all else adjusted
anew, by −2 δ v/σ² + δ² r/σ²: the lines for which it falls most are tried.
"""

from __future__ import annotations

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
    found = []
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
