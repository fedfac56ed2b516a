"""A hypothesis put to the test: the network changed as it says, and adjusted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment, Iteration, Watcher
from mor.allowance import SpentError
from mor.arrays import BoolArray, FloatArray
from mor.errors import InputError
from mor.parameters.index import Values, all_known, with_shared_components
from mor.project.network.build import Network
from mor.quality.gross_errors.description_length import cost_of_choice, cost_of_residuals, sizes_of
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.hypotheses.controlled_part import changed_observations, controlled_part
from mor.quality.hypotheses.hypothesis import Fit, Hypothesis
from mor.quality.hypotheses.situation import Situation, fit_of
from mor.sparse.cholesky import NotFiniteError

_ITERATIONS = 15
_AS_EXPECTED = 2.0
"""vᵀPv over its degrees of freedom up to which no other beginning is tried."""
_PATIENCE = 2
"""Iterations one after the other that do not halve vᵀPv, as long as it is far from what is expected."""


class HopelessError(Exception):
    """An iteration that leads nowhere."""


def tried(
    situation: Situation, hypothesis: Hypothesis, afresh: bool = True, spoken_for: bool = False
) -> Fit | None:
    """How the network fits with the change; nothing where its adjustment does not converge.

    Of several beginnings those that may still be tried count; :class:`SpentError` where that is not even the first one.

    ``afresh`` allows that start values are worked out for it, which takes longer than all else; ``spoken_for`` says
    that the given ones speak for it clearly.
    """
    network = hypothesis.change(situation.network)
    best: Fit | None = None
    try:
        for begin in _beginnings(situation, network, hypothesis, afresh, spoken_for):
            found = _adjusted(situation, network, begin, hypothesis)
            if found is None:
                continue
            fit = _fit(situation, network, hypothesis, found)
            if best is None or fit.length < best.length:
                best = fit
            if best.omega <= _AS_EXPECTED * best.freedom:
                break
    except SpentError:
        if best is None:
            raise
    return best


def _fit(situation: Situation, network: Network, hypothesis: Hypothesis, found: Adjustment) -> Fit:
    """How an adjustment of the changed network fits, the choice of the change counted in."""
    values, defect = found.values, found.defect.datum.shape[1]
    lost = 0 if situation.solution is None else situation.defect - defect
    stretch = hypothesis.stretch
    if stretch:
        stretch *= controlled_part(situation, network, found)
    cost = cost_of_choice(situation.count, hypothesis.candidates, hypothesis.parameters + lost, stretch)
    return fit_of(situation.make(network, values, values), values, defect, situation.count, cost)


def _beginnings(
    situation: Situation, network: Network, hypothesis: Hypothesis, afresh: bool, spoken_for: bool
) -> Iterator[Values]:
    """Where to begin: where most observations fit; for what is not local, at new start values, too.

    Which of them is better is not seen before the adjustment: what fits a wrong observation well begins far off.
    """
    missing = False
    if situation.begun:
        here = {kind: _longer(values, network.start[kind]) for kind, values in situation.values.items()}
        open_ = dict(here)
        for kind, blocks in hypothesis.anew.items():
            given = network.start[kind][blocks]
            told: BoolArray = np.asarray(np.isfinite(given.reshape(len(given), -1)).all(axis=1))
            here[kind], open_[kind] = here[kind].copy(), here[kind].copy()
            here[kind][blocks[told]] = open_[kind][blocks[told]] = given[told]
            open_[kind][blocks[~told]] = np.nan
            missing |= not told.all()
        yield with_shared_components(network.blocks, here)
        if missing:  # worked out from all else, which is known
            begin = situation.begin(replace(network, start=open_))
            if begin is not None:
                yield begin
    known = all_known(network.start)
    # Of what is wrong as a whole little fits; start values of a wrong change take long, for nothing agrees. A station
    # or an image that was placed anew needs no other ones.
    afresh &= hypothesis.afresh and (
        spoken_for
        or situation.most_do_not_fit
        or (not missing and _most_of_it_does_not_fit(situation, network))
    )
    if not hypothesis.rows and (afresh or known or not situation.begun):
        begin = situation.begin(network)
        if begin is not None:
            yield begin


def _most_of_it_does_not_fit(situation: Situation, network: Network) -> bool:
    """True where half of the rows that are changed do not fit as they are."""
    count = bad = 0
    changed = changed_observations(situation.network, network)
    for mask, misfitting in zip(changed, situation.misfitting, strict=False):
        rows = mask.any(axis=1)
        count += int(np.count_nonzero(rows))
        bad += int(np.count_nonzero(rows & misfitting.any(axis=1)))
    return 2 * bad > count


def _adjusted(
    situation: Situation, network: Network, begin: Values, hypothesis: Hypothesis
) -> Adjustment | None:
    """The adjustment of the changed network.

    With a change of few observations the others that do not fit are left out.
    """
    try:
        problem = situation.make(network, begin, begin)
        if hypothesis.rows:
            out = [mask.copy() for mask in situation.misfitting]
            for group, row in hypothesis.rows:
                out[group][row] = False
            masks = [o | g.left_out for o, g in zip(out, problem.groups, strict=True)]
            found = attempt(exclude(problem, masks), begin)
            if found.outcome.is_solution:
                return _with_all(situation, problem, found)
        found = attempt(problem, begin)
    except (InputError, NotFiniteError, HopelessError):
        return None
    return found if found.outcome.is_solution else None


def attempt(problem: Problem, begin: Values) -> Adjustment:
    """An adjustment that ends early where it leads nowhere.

    Raises:
        HopelessError: it does not come near to a solution as quickly as one that will.
    """
    with np.errstate(all="ignore"):
        return adjust(problem, begin, Settings(_ITERATIONS), _impatient())


def without_row(situation: Situation, group: int, row: int) -> Values:
    """Where the others lead without a row; where most fit, if they have no solution."""
    problem = situation.make(situation.network, situation.start, situation.values)
    masks = [own.left_out.copy() for own in problem.groups]
    masks[group][row] = True
    try:
        found = attempt(exclude(problem, masks), situation.values)
    except (InputError, NotFiniteError, HopelessError):
        return situation.values
    return found.values if found.outcome.is_solution else situation.values


def _with_all(situation: Situation, problem: Problem, reduced: Adjustment) -> Adjustment:
    """The adjustment of all observations from there, where it converges and does not go anywhere else."""
    try:
        found = attempt(problem, reduced.values)
    except (NotFiniteError, HopelessError):
        return reduced
    costs = [
        cost_of_residuals(sizes_of(problem.groups, v), situation.count)
        for v in (found.values, reduced.values)
    ]
    kept = found.outcome.is_solution and costs[0] <= costs[1] + 1.0
    return found if kept else reduced


def _impatient() -> Watcher:
    """A watcher that ends an iteration which does not come near to a solution as quickly as one that will."""
    seen: list[float] = []

    def watch(iteration: Iteration) -> None:
        seen.append(iteration.objective)
        last = seen[-1 - _PATIENCE :]
        slow = len(last) > _PATIENCE and all(b > 0.5 * a for a, b in pairwise(last))
        if (
            slow
            and iteration.objective > 25.0 * max(iteration.redundancy, 1)
            and iteration.largest_change > 1.0
        ):
            raise HopelessError

    return watch


def _longer(values: FloatArray, start: FloatArray) -> FloatArray:
    """Values (n, …) with those of blocks that were added."""
    return values if len(values) == len(start) else np.concatenate([values, start[len(values) :]])
