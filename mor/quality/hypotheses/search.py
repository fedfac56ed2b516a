"""Which mistakes may have been made: asked only where something is rejected, answered by an adjustment for each.

Candidates come from the families, the best by what they promise; each is tried by changing the project as it says and
adjusting it. What describes the observations shorter than they are without it, by more than chance does (level 0.001
with the number of candidates counted in), is offered, the shortest first. Nothing is applied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from mor import allowance
from mor.adjustment.problem import Problem
from mor.adjustment.state import Adjustment, Outcome
from mor.allowance import Allowance, SpentError, counted_in, within
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.gross_errors.description_length import cost_of_residuals, sizes_of
from mor.quality.gross_errors.graduated_weights import graduated_weights
from mor.quality.gross_errors.reintersection import reintersected
from mor.quality.gross_errors.suspects import ADJUSTMENTS
from mor.quality.hypotheses.effort import SMALL, allowed
from mor.quality.hypotheses.hypothesis import Causes, Fit, Hypothesis, Looking, Offered, ignore_looking
from mor.quality.hypotheses.mistakes.circles import circle_hypotheses, face_hypotheses
from mor.quality.hypotheses.mistakes.control import control_hypotheses, exchange_hypotheses
from mor.quality.hypotheses.mistakes.curvature import curvature_hypotheses
from mor.quality.hypotheses.mistakes.distances import distance_hypotheses
from mor.quality.hypotheses.mistakes.heights import height_hypotheses
from mor.quality.hypotheses.mistakes.images import camera_constant_hypotheses, image_hypotheses
from mor.quality.hypotheses.mistakes.levelling import levelling_hypotheses
from mor.quality.hypotheses.mistakes.names import name_hypotheses
from mor.quality.hypotheses.mistakes.sigmas import sigma_hypotheses
from mor.quality.hypotheses.promise import promises
from mor.quality.hypotheses.rejection import LEVEL, Rejection, nothing_is_left
from mor.quality.hypotheses.situation import Begin, Make, Situation, fit_of
from mor.quality.hypotheses.trying import tried

OFFERED = 5
_ABSURD, _LESS = 10.0, 0.3
"""Factor of all σ that nobody errs by, and part of it that is less."""
_RIVAL = 0.5
"""Part of what a hypothesis that explains everything promised, or gained, below which another one is no rival to it."""
_BY_CHANCE = float(-2.0 * np.log(LEVEL))
"""By how much chance may make a description shorter, in units of χ²."""
Family = Callable[[Situation], list[Hypothesis]]
OF_ROWS: tuple[Family, ...] = (levelling_hypotheses, name_hypotheses, exchange_hypotheses, face_hypotheses)
"""Families that change a few observations or points: what explains everything so has no rival among the others."""
OF_UNKNOWNS: tuple[Family, ...] = (
    distance_hypotheses,
    height_hypotheses,
    camera_constant_hypotheses,
)
OF_THE_EARTH: tuple[Family, ...] = (curvature_hypotheses,)
OF_SIGMAS: tuple[Family, ...] = (sigma_hypotheses,)
OF_A_WHOLE: tuple[Family, ...] = (control_hypotheses, circle_hypotheses, image_hypotheses)
"""Families that change all of a group, an image or a station: asked only where as much does not fit."""


class Before(NamedTuple):
    """vᵀPv without a hypothesis."""

    told: float
    """That of the plain adjustment, or of its last iteration; not finite where there was none."""
    compared: float
    """That which a hypothesis has to improve."""
    freedom: int


class Tried(NamedTuple):
    """A hypothesis whose adjustment has a solution."""

    hypothesis: Hypothesis
    fit: Fit
    promised: float
    """By how much the start values speak for it; 0 where that was not asked."""


def possible_causes(situation: Situation, before: Before) -> Causes:
    """Hypotheses for observations of which something is rejected."""
    with counted_in(situation.effort):
        return _possible_causes(situation, before)


def _possible_causes(situation: Situation, before: Before) -> Causes:
    found: list[Tried] = []
    untried, explained, done = 0, -np.inf, False
    stages = _stages(situation)
    for number, stage in enumerate(stages, 1):
        share = number / len(stages)  # no stage takes what the next ones need
        for hypothesis, promised in _of_stage(situation, stage):
            if promised < _RIVAL * explained:
                continue
            try:
                with within(situation.effort, share * situation.effort.most):
                    fit = tried(situation, hypothesis, not done, promised > _BY_CHANCE)
            except SpentError:
                untried += 1
                continue
            if fit is None:
                continue
            found.append(Tried(hypothesis, fit, promised))
            if nothing_is_left(fit) and stage is not OF_SIGMAS:  # with large σ nothing is ever left
                done = True
                explained = max(explained, promised) if stage is OF_A_WHOLE else explained
        if stage is OF_ROWS and done:
            break
    return Causes(_offered(situation, before, found), untried)


def _stages(situation: Situation) -> tuple[tuple[Family, ...], ...]:
    """Families that are asked together: those of a whole first where most observations do not fit, else last."""
    if not situation.larger:
        return (OF_SIGMAS,)  # of the others only control in a smaller unit may make residuals smaller
    if not situation.settled:
        return OF_SIGMAS, OF_A_WHOLE
    if situation.most_do_not_fit:
        return OF_SIGMAS, OF_THE_EARTH, OF_A_WHOLE, OF_ROWS, OF_UNKNOWNS
    return OF_SIGMAS, OF_THE_EARTH, OF_ROWS, OF_UNKNOWNS, OF_A_WHOLE


def _of_stage(situation: Situation, stage: tuple[Family, ...]) -> list[tuple[Hypothesis, float]]:
    """The different hypotheses of some families, and what they promise; 0 where that is not asked.

    Changes of a whole come with the most promising first; where nothing as large is seen to be wrong, those alone that
    the start values speak for.
    """
    different: dict[tuple[str, tuple[str, ...]], Hypothesis] = {}
    for family in stage:
        for hypothesis in family(situation):
            different.setdefault((hypothesis.cause, hypothesis.things), hypothesis)
    found = list(different.values())
    if stage is not OF_A_WHOLE or not found:
        return [(hypothesis, 0.0) for hypothesis in found]
    promised = promises(situation, found)
    seen = not situation.begun or (situation.settled and situation.something_is_wrong_as_a_whole)
    least = -np.inf if seen else _BY_CHANCE
    order = np.argsort(-promised, kind="stable").tolist()
    return [(found[k], float(promised[k])) for k in order if promised[k] >= least]


def _offered(situation: Situation, before: Before, found: list[Tried]) -> tuple[Offered, ...]:
    """Those that are better than none by more than chance, the best first."""
    good = _in_order(situation, [one for one in found if _is_good(situation, before, one.fit)])
    if good and nothing_is_left(good[0].fit):  # then what explains much less is no rival
        least = _RIVAL * _gain(situation, good[0].fit)
        good = [one for one in good if _gain(situation, one.fit) >= least]
    return tuple(
        Offered(
            one.hypothesis,
            before.told,
            before.freedom,
            one.fit.omega,
            one.fit.freedom,
            _gain(situation, one.fit),
            one.hypothesis.amount_at(one.fit.values),
        )
        for one in good[:OFFERED]
    )


def _in_order(situation: Situation, good: list[Tried]) -> list[Tried]:
    """The shortest description first; of those that chance may put before it, what the start values speak for."""
    by_gain = sorted(good, key=lambda one: -_gain(situation, one.fit))
    alike = [
        one for one in by_gain if _gain(situation, one.fit) > _gain(situation, by_gain[0].fit) - _BY_CHANCE
    ]
    told = sorted(alike, key=lambda one: -one.promised if one.promised > _BY_CHANCE else 0.0)
    return [*told, *by_gain[len(alike) :]]


def _gain(situation: Situation, fit: Fit) -> float:
    return float(situation.fit.length - fit.length)


def _is_good(situation: Situation, before: Before, fit: Fit) -> bool:
    """True where a change is better than none by more than chance."""
    return (
        _gain(situation, fit) > _BY_CHANCE and _nearer(fit, before) and _is_an_explanation(fit, situation.fit)
    )


def _before(situation: Situation, plain: Adjustment) -> Before:
    freedom = plain.problem.observations - plain.problem.index.count + int(plain.defect.datum.shape[1])
    objective = plain.normals.objective
    compared = objective if plain.outcome is Outcome.CONVERGED else situation.fit.omega
    return Before(objective, compared, freedom)


class Ended(NamedTuple):
    """How the adjustment of a network ended, in which something is wrong."""

    plain: Adjustment
    """That of all observations."""
    solution: Adjustment | None
    """The adjustment there is in the end, without suspects it may be."""
    quality: Quality | None
    """That of the solution."""
    rejected: Rejection = Rejection.LARGER
    led: Values | None = None
    """Where graduated weights lead from the start values of the plain one, where that is known."""
    spent: int = 0
    """Units of work that were spent on a solution after the plain adjustment had none."""


def causes(
    network: Network,
    start: Values,
    ended: Ended,
    make: Make,
    begin: Begin,
    looking: Looking = ignore_looking,
) -> Causes:
    """What may be wrong with a network whose plain adjustment did not end well, or is rejected.

    ``start`` are the start values of the whole of it, of which some things may have been left out.
    """
    plain, solution = ended.plain, ended.solution
    if not plain.problem.index.count:
        return Causes()
    effort = allowed(network.observations, looking, ended.spent)
    whole = _is_of_all(plain, network)
    if ended.rejected is Rejection.SMALLER and solution is not None:
        values = solution.values if whole else _graduated(make(network, start, start), start)
        there = solution if whole else None
        situation = Situation(network, start, values, there, make, begin, effort, larger=False)
        return possible_causes(situation, _before(situation, plain))
    useless = plain.outcome is Outcome.CONVERGED and ended.quality is None  # no number of it can be relied on
    if not useless and plain.outcome is Outcome.SINGULAR and not plain.iterations:
        situation = Situation(network, start, start, None, make, begin, effort, settled=False)
        if fit_of(make(network, start, start), start, 0, situation.count).scale <= _ABSURD:
            return Causes()  # something is missing, a datum say; nothing contradicts anything
        before = _before(situation, plain)
        return possible_causes(situation, before._replace(compared=situation.fit.omega))
    if not whole:
        solution = None  # of a network without some of its things: what is wrong may be with them
        values = _graduated(make(network, start, start), start)
    else:
        values = _where_most_fit(plain, solution, ended.led)
    situation = Situation(network, start, values, solution, make, begin, effort)
    return possible_causes(situation, _before(situation, plain))


def _is_of_all(plain: Adjustment, network: Network) -> bool:
    """False where an adjustment is without some of the things of a network, or has points of it at infinity."""
    adjusted = plain.problem.groups[: len(network.groups)]
    return [group.count for group in adjusted] == [group.count for group in network.groups]


def causes_without_start(
    network: Network,
    unstarted: Iterable[str],
    make: Make,
    begin: Begin,
    looking: Looking = ignore_looking,
) -> Causes:
    """What may be wrong with a network some things of which have no start values: changes that give it some."""
    effort = allowed(network.observations, looking)
    start = network.start
    names = frozenset(unstarted)
    situation = Situation(network, start, start, None, make, begin, effort, names, settled=False)
    return possible_causes(situation, Before(np.nan, np.inf, 0))


def _is_an_explanation(fit: Fit, without: Fit) -> bool:
    """False where half of all residuals stay absurd, and hardly become smaller: an iteration that ended elsewhere."""
    return fit.scale <= max(_ABSURD, _LESS * without.scale)


def _nearer(fit: Fit, before: Before) -> bool:
    """True where vᵀPv falls by more than chance does, or rises towards its degrees of freedom."""
    if fit.omega <= before.compared:
        return bool(before.compared - fit.omega > _BY_CHANCE)
    ratios = np.array([fit.omega / max(fit.freedom, 1), before.compared / max(before.freedom, 1)])
    after, now = np.abs(np.log(np.maximum(ratios, 1e-300)))
    return bool(after < now)


def _graduated(problem: Problem, begin: Values) -> Values:
    further = Allowance(allowance.allowed(problem.observations, ADJUSTMENTS))
    with np.errstate(all="ignore"), suppress(SpentError), within(further):
        return graduated_weights(problem, begin).values
    return begin


def _where_most_fit(plain: Adjustment, solution: Adjustment | None, led: Values | None) -> Values:
    """The solution, or where graduated weights lead from the start values or from it: what costs least."""
    problem = plain.problem
    if solution is not None and problem.observations > SMALL:
        return solution.values
    known = [plain.values] if solution is None else [solution.values]
    if solution is plain:
        known.append(_graduated(problem, plain.values))
    if solution is None or solution is plain:
        known.append(_graduated(problem, plain.start) if led is None else led)
    costs = [cost_of_residuals(sizes_of(problem.groups, values), problem.observations) for values in known]
    best = known[int(np.argmin(costs))]
    if problem.observations > SMALL:
        return best
    return reintersected(problem, best, sizes_of(problem.groups, best))
