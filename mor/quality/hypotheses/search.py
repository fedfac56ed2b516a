"""Which mistakes may have been made: asked only where something is rejected, answered by an adjustment for each.

Candidates come from the families, the best by what they promise; each is tried by changing the project as it says and
adjusting it. What describes the observations shorter than they are without it, by more than chance does (level 0.001
with the number of candidates counted in), is offered, the shortest first. Nothing is applied.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.state import Adjustment, Outcome
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.effort import Done
from mor.quality.gross_errors.graduated_weights import graduated_weights
from mor.quality.hypotheses.circles import circle_hypotheses, face_hypotheses
from mor.quality.hypotheses.control import control_hypotheses, exchange_hypotheses
from mor.quality.hypotheses.description_length import cost_of_residuals
from mor.quality.hypotheses.distances import distance_hypotheses
from mor.quality.hypotheses.heights import height_hypotheses
from mor.quality.hypotheses.hypothesis import Fit, Hypothesis, Offered
from mor.quality.hypotheses.images import camera_constant_hypotheses, image_hypotheses
from mor.quality.hypotheses.levelling import levelling_hypotheses
from mor.quality.hypotheses.names import name_hypotheses
from mor.quality.hypotheses.reintersection import reintersected
from mor.quality.hypotheses.sigmas import sigma_hypotheses
from mor.quality.hypotheses.situation import SMALL, SUSPECT, Begin, Make, Situation, sizes_of
from mor.quality.tests.group_tests import group_tests
from mor.quality.tests.levels import sidak
from mor.quality.tests.p_values import log_p_chi2, log_p_normal
from mor.quality.tests.quadratic_form import Moments, log_tail

LEVEL = 1e-3
"""Of every question that is asked: is anything rejected; is a hypothesis better than none."""
OFFERED = 5
_MOST, _LEAST = 40, 3
"""Adjustments that are tried at most, in small networks and in large ones."""
_BEGUN = 4
"""Hypotheses for which start values are worked out at most: it takes longer than the adjustment."""

Looking = Callable[[int], Done]
"""Told how many hypotheses may be tried; what it returns is told each of them."""


def ignore_looking(_: int) -> Done:
    """Nobody watches."""
    return lambda _: None


Family = Callable[[Situation], list[Hypothesis]]
FAMILIES: tuple[Family, ...] = (
    name_hypotheses,
    levelling_hypotheses,
    exchange_hypotheses,
    face_hypotheses,
    distance_hypotheses,
    height_hypotheses,
    camera_constant_hypotheses,
    sigma_hypotheses,
)
OF_A_WHOLE: tuple[Family, ...] = (control_hypotheses, circle_hypotheses, image_hypotheses)
"""Families that change all of a group, an image or a station: asked only where as much does not fit."""


def is_rejected(quality: Quality, network: Network) -> bool:
    """True where a test of the verdict rejects at ``LEVEL``: of all, of single observations, or of groups."""
    freedom = float(quality.redundancy)
    if freedom > 0.0 and _two_sided(quality.omega, freedom) < np.log(LEVEL):
        return True
    if _largest(quality) < np.log(LEVEL):
        return True
    tests = group_tests(quality, network)
    limit = np.log(sidak(LEVEL, len(tests.tests)))
    return any(test.log_p < limit for test in tests.rejected)


def _two_sided(omega: float, freedom: float) -> float:
    """ln of the two-sided probability of χ²."""
    one = np.array([freedom])
    return float(log_tail(np.array([omega]), Moments(one, one, one))[0])


def _largest(quality: Quality) -> float:
    """ln of the probability of the largest test value among so many; 0 where none is flagged."""
    largest = 0.0
    for reliability, flags in zip(quality.reliability, quality.flagged, strict=True):
        rows = np.flatnonzero(flags.any(axis=1))
        if len(rows):
            largest = max(largest, float(np.abs(reliability.at(rows).test[flags[rows]]).max()))
    count = quality.adjustment.problem.observations
    return float(log_p_normal(np.array([largest]))[0] + np.log(max(count, 1)))


def possible_causes(situation: Situation, plain: Adjustment, looking: Looking) -> tuple[Offered, ...]:
    """Hypotheses for observations of which something is rejected, the best first; none where none is good enough."""
    most = int(np.clip(_MOST * SMALL // max(situation.count, 1), _LEAST, _MOST))
    done = looking(most)
    found: list[tuple[Hypothesis, Fit]] = []
    count = begun = 0
    families = (*FAMILIES, *OF_A_WHOLE) if situation.something_is_wrong_as_a_whole else FAMILIES
    for family in families:
        different: dict[tuple[str, tuple[str, ...]], Hypothesis] = {}
        for hypothesis in family(situation):
            different.setdefault((hypothesis.cause, hypothesis.things), hypothesis)
        candidates = list(different.values())[: most - count]
        count += len(candidates)
        for hypothesis in candidates:
            afresh = begun < _BEGUN and not any(nothing_is_left(one) for _, one in found)
            begun += int(afresh and hypothesis.afresh)
            fit = situation.tried(hypothesis, afresh)
            found += [(hypothesis, fit)] if fit is not None else []
            done(1)
        if any(h.rows and nothing_is_left(fit) for h, fit in found):
            break  # what changes a few rows, and explains everything, has no rival among what changes whole groups
    if not found:
        return ()
    gains = [situation.fit.length - fit.length for _, fit in found]
    before = plain.normals.objective if plain.outcome is Outcome.CONVERGED else situation.fit.omega
    order = sorted(range(len(found)), key=lambda k: -gains[k])
    freedom = plain.problem.observations - plain.problem.index.count + int(plain.defect.datum.shape[1])
    return tuple(
        Offered(
            found[k][0],
            plain.normals.objective,
            freedom,
            found[k][1].omega,
            found[k][1].freedom,
            gains[k],
            found[k][0].amount_at(found[k][1].values),
        )
        for k in order
        if gains[k] > -2.0 * np.log(LEVEL) and _nearer(found[k][1], before, freedom)
    )[:OFFERED]


def causes(
    network: Network,
    adjusted: Network,
    start: Values,
    plain: Adjustment,
    solution: Adjustment | None,
    quality: Quality | None,
    make: Make,
    begin: Begin,
    looking: Looking = ignore_looking,
) -> tuple[Offered, ...]:
    """What may be wrong with a network whose ``plain`` adjustment did not end well; nothing where nothing is rejected.

    ``start`` are the start values of the whole of it; ``adjusted`` is what took part, for things may have been left
    out. ``solution`` is the adjustment there is in the end, without suspects it may be, and ``quality`` its quality.
    """
    if solution is plain and quality is not None and not is_rejected(quality, adjusted):
        return ()
    if not plain.problem.index.count or (plain.outcome is Outcome.SINGULAR and not plain.iterations):
        return ()
    if [group.count for group in plain.problem.groups[: len(network.groups)]] != [
        g.count for g in network.groups
    ]:
        solution = None  # of a network without some of its things: what is wrong may be with them
        values = _graduated(make(network, start, start), start)
    else:
        values = _where_most_fit(plain, solution)
    return possible_causes(Situation(network, start, values, solution, make, begin), plain, looking)


def _nearer(fit: Fit, before: float, freedom: int) -> bool:
    """True where vᵀPv falls by more than chance does, or rises towards its degrees of freedom."""
    if fit.omega <= before:
        return bool(before - fit.omega > -2.0 * np.log(LEVEL))
    ratios = np.array([fit.omega / max(fit.freedom, 1), before / max(freedom, 1)])
    after, now = np.abs(np.log(np.maximum(ratios, 1e-300)))
    return bool(after < now)


def nothing_is_left(fit: Fit) -> bool:
    """True where chance explains the residuals that a change leaves."""
    p = log_p_chi2(np.array([fit.omega]), np.array([max(float(fit.freedom), 1.0)]))
    return bool(p[0] > np.log(LEVEL))


def _graduated(problem: Problem, begin: Values) -> Values:
    with np.errstate(all="ignore"):
        return graduated_weights(problem, begin).values


def _where_most_fit(plain: Adjustment, solution: Adjustment | None) -> Values:
    """The solution, or where graduated weights lead from the start values or from it: what costs least."""
    problem = plain.problem
    if solution is not None and problem.observations > SMALL:
        return solution.values
    known = [plain.values] if solution is None else [solution.values]
    begin = plain.start if solution is None else plain.values
    if solution is None or solution is plain:
        known.append(_graduated(problem, begin))
    costs = [cost_of_residuals(sizes_of(problem.groups, values), problem.observations) for values in known]
    best = known[int(np.argmin(costs))]
    if problem.observations > SMALL:
        return best
    return reintersected(problem, best, sizes_of(problem.groups, best), SUSPECT)
