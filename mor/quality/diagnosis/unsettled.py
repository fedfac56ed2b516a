"""Why there is no solution: unknowns that move to and fro, or away, and what a singular place has to do with the data.

What is said of an iteration that failed is seen from its last values: a few further steps of it, and whether the
system is singular beside them as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.local_defects import beside
from mor.adjustment.datum.weak_directions import NOTHING_KNOWN, weak_turns
from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import A_WEAK_TURN, RAN_AWAY, Adjustment, Outcome
from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Index, Values
from mor.quality.diagnosis.loose_things import OPEN

UNSETTLED = "the datum points do not settle the datum"
NO_DATUM = "the datum is not defined"
AT_THE_START = (
    "singular at the start values, not by the observations: at other values they determine everything"
)
PUT_ANYWHERE = (
    "but parts of the network were put anywhere, for want of start values: "
    "observations may determine it all the same"
)
"""Reasons of outcomes."""
OF_THE_START = (AT_THE_START, PUT_ANYWHERE)
"""Those that say nothing of the observations."""
MISFIT = 10.0
"""vᵀPv by the number of observations, from which on values do not fit them."""
STEPS = 5
"""Further steps that are looked at."""
LISTED = 20
_ROWS = 50_000


class Movements(NamedTuple):
    """Unknowns that do not come to rest, those that change the observations most first."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component)."""
    steps: FloatArray
    """(k, s) their last steps, internal units; one alone is the step that could not be taken."""
    to_and_fro: FloatArray
    """(k,) part of the way that was taken back: 0 for one way, near 1 for an oscillation."""


def last_movements(adjustment: Adjustment) -> Movements:
    """What moved in further steps from the last values; where none can be taken, the step that was wanted."""
    steps = _further_steps(adjustment)
    if steps.shape[1] == 0:
        wanted = adjustment.inverse.step(adjustment.normals)
        steps = wanted[:, None]
    index = adjustment.problem.index
    way, net = np.abs(steps).sum(axis=1), np.abs(steps.sum(axis=1))
    size = way * np.sqrt(_diagonal(adjustment.problem, adjustment.values))
    order = np.argsort(-np.nan_to_num(size), kind="stable")[:LISTED]
    order = order[size[order] > 0.0]
    labels = tuple(index.label(int(column)) for column in order)
    return Movements(labels, steps[order], 1.0 - net[order] / way[order])


def with_fitting_reason(adjustment: Adjustment, untied: bool = False) -> Adjustment:
    """The outcome with a reason that fits: of the observations, of the start values, or of an iteration gone astray.

    ``untied``: parts of the network lie anywhere, because nothing was found that ties them to the rest.
    """
    if adjustment.outcome is Outcome.NOT_CONVERGED:
        return _hardly_determined(adjustment)
    if adjustment.outcome is not Outcome.SINGULAR or adjustment.reason not in (OPEN, UNSETTLED, NO_DATUM):
        return adjustment
    if not adjustment.plan.problem.index.count:
        return adjustment
    begin = adjust(adjustment.problem, adjustment.start, Settings(max_iterations=0))
    if adjustment.iterations and begin.outcome is not Outcome.SINGULAR:
        return adjustment._replace(outcome=Outcome.DIVERGED, reason=RAN_AWAY)
    if only_here(adjustment):
        return adjustment._replace(reason=AT_THE_START)
    if untied and not _fits(adjustment):
        return adjustment._replace(reason=PUT_ANYWHERE)
    return adjustment


def _fits(adjustment: Adjustment) -> bool:
    return adjustment.normals.objective <= MISFIT * adjustment.problem.observations


def _hardly_determined(adjustment: Adjustment) -> Adjustment:
    """Singular where the last values show a turn of which nothing is known: it alone keeps the iteration going."""
    here = adjust(adjustment.problem, adjustment.values, Settings(max_iterations=0))
    turns = weak_turns(here.inverse.weak, here.problem, here.values)
    if not turns or turns[0].sigma <= NOTHING_KNOWN:
        return adjustment
    iterations = adjustment.iterations
    return here._replace(
        outcome=Outcome.SINGULAR, reason=A_WEAK_TURN, start=adjustment.start, iterations=iterations
    )


def only_here(adjustment: Adjustment) -> bool:
    """True where the start values are singular, do not fit the observations, and beside them nothing is singular."""
    problem = adjustment.problem
    if adjustment.outcome is not Outcome.SINGULAR or adjustment.iterations:
        return False
    if _fits(adjustment):
        return False
    there = adjust(problem, beside(problem, adjustment.values), Settings(max_iterations=0))
    return there.outcome is not Outcome.SINGULAR


def _further_steps(adjustment: Adjustment) -> FloatArray:
    """(u, s) steps of the iteration if it went on from its last values."""
    problem, values = adjustment.problem, adjustment.values
    steps: list[FloatArray] = []
    while len(steps) < STEPS and adjustment.outcome is Outcome.NOT_CONVERGED:
        after = adjust(problem, values, Settings(max_iterations=1))
        if not after.iterations or after.outcome is Outcome.DIVERGED:
            break
        steps.append(_difference(problem.index, values, after.values))
        values = after.values
        if after.outcome is not Outcome.NOT_CONVERGED:
            break
    return np.stack(steps, axis=1) if steps else np.zeros((problem.index.count, 0))


def _difference(index: Index, before: Values, after: Values) -> FloatArray:
    """(u,) the step from one place to another; of rotations the vector of the small rotation."""
    step = np.zeros(index.count)
    for kind, columns in index.columns.items():
        if index.blocks[kind].kind.is_rotation:
            turn = after[kind] @ np.swapaxes(before[kind], 1, 2)
            # D' = (I − [δ]×) D to first order
            change = 0.5 * np.stack(
                [turn[:, 1, 2] - turn[:, 2, 1], turn[:, 2, 0] - turn[:, 0, 2], turn[:, 0, 1] - turn[:, 1, 0]],
                axis=1,
            )
        else:
            change = after[kind] - before[kind]
        step[columns[columns >= 0]] = change[columns >= 0]
    return step


def _diagonal(problem: Problem, values: Values) -> FloatArray:
    """(u,) diagonal of the normal matrix: what one unit of each unknown does to all observations, squared."""
    diagonal = np.zeros(problem.index.count + 1)
    tangent = rotation_tangents(problem.index, values)
    for group in problem.groups:
        for start in range(0, group.count, _ROWS):
            rows: IntArray = np.arange(start, min(start + _ROWS, group.count))
            found = linearise(group, problem.index, values, tangent, rows)
            weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
            squares = np.nan_to_num(np.sum((weight[:, :, None] * found.jacobian) ** 2, axis=1))
            np.add.at(diagonal, found.columns, squares)
    return diagonal[:-1]
