"""Which mistakes may have been made: asked only where something is rejected, answered by an adjustment for each.

Candidates come from the families, the best by what they promise; each is tried by changing the project as it says and
adjusting it. What describes the observations shorter than they are without it, by more than chance does (level 0.001
with the number of candidates counted in), is offered, the shortest first. Nothing is applied.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammainc

from mor.adjustment.problem import Problem
from mor.adjustment.state import Adjustment, Outcome
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.assess import Quality
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
from mor.quality.hypotheses.sigmas import sigma_hypotheses
from mor.quality.hypotheses.situation import Begin, Make, Situation, sizes_of
from mor.quality.tests.p_values import log_p_chi2

LEVEL = 1e-3
"""Of every question that is asked: is anything rejected; is a hypothesis better than none."""
OFFERED = 5
_SMALL = 20_000
"""Observations up to which graduated weights and many adjustments cost next to nothing."""
_MOST, _LEAST = 40, 3
"""Adjustments that are tried at most, in small networks and in large ones."""

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


def is_rejected(quality: Quality) -> bool:
    """True where all residuals, those of a group, or a single one are beyond what chance allows at ``LEVEL``."""
    tested = [(quality.omega, float(quality.redundancy))]
    for own, group in zip(quality.groups, quality.adjustment.problem.groups, strict=True):
        used = group.mask & ~group.left_out
        tested.append((float(np.sum((own.v[used] / group.sigma[used]) ** 2)), float(np.nansum(own.r[used]))))
    limit = np.log(LEVEL / (2.0 * len(tested)))
    for omega, freedom in tested:
        if freedom > 0.5 and _two_sided(omega, freedom) < limit:
            return True
    return bool(_largest(quality) < np.log(LEVEL))


def _two_sided(omega: float, freedom: float) -> float:
    """ln of the smaller one of both probabilities of χ²."""
    upper = float(log_p_chi2(np.array([omega]), np.array([freedom]))[0])
    lower = float(gammainc(0.5 * freedom, 0.5 * omega))
    return min(upper, float(np.log(max(lower, 1e-300))))


def _largest(quality: Quality) -> float:
    """ln of the probability of the largest test value among so many."""
    largest, count = 0.0, 0
    for one, group in zip(quality.reliability, quality.adjustment.problem.groups, strict=True):
        for first in range(0, group.count, 100_000):
            rows = np.arange(first, min(first + 100_000, group.count))
            used = group.mask[rows] & ~group.left_out[rows]
            tests = np.abs(np.nan_to_num(one.at(rows).test))[used]
            largest, count = max(largest, float(tests.max(initial=0.0))), count + tests.size
    own = float(log_p_chi2(np.array([largest**2]), np.array([1.0]))[0])
    return own + float(np.log(max(count, 1)))


def possible_causes(situation: Situation, plain: Adjustment) -> tuple[Offered, ...]:
    """Hypotheses for observations of which something is rejected, the best first; none where none is good enough."""
    most = int(np.clip(_MOST * _SMALL // max(situation.count, 1), _LEAST, _MOST))
    found: list[tuple[Hypothesis, Fit]] = []
    count = 0
    families = (*FAMILIES, *OF_A_WHOLE) if situation.something_is_wrong_as_a_whole else FAMILIES
    for family in families:
        candidates = family(situation)[: most - count]
        count += len(candidates)
        tried = [(hypothesis, situation.tried(hypothesis)) for hypothesis in candidates]
        found += [(hypothesis, fit) for hypothesis, fit in tried if fit is not None]
        if any(h.rows and nothing_is_left(fit) for h, fit in found):
            break  # what changes a few rows, and explains everything, has no rival among what changes whole groups
    if not found:
        return ()
    spread = min(fit.spread for _, fit in found)
    gains = [(situation.fit.length - fit.length) / spread for _, fit in found]
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
        if gains[k] > -2.0 * np.log(LEVEL) and found[k][1].omega < before
    )[:OFFERED]


def causes(
    network: Network,
    start: Values,
    plain: Adjustment,
    solution: Adjustment | None,
    quality: Quality | None,
    make: Make,
    begin: Begin,
) -> tuple[Offered, ...]:
    """What may be wrong with a network whose ``plain`` adjustment did not end well; nothing where nothing is rejected.

    ``start`` are the start values of the whole of it; things may have been left out of the adjustment. ``solution`` is
    the adjustment there is in the end, without suspects it may be, and ``quality`` its quality.
    """
    if solution is plain and quality is not None and not is_rejected(quality):
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
    return possible_causes(Situation(network, start, values, solution, make, begin), plain)


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
    known = [plain.values] if solution is None else [solution.values]
    begin = plain.start if solution is None else plain.values
    if solution is None or (solution is plain and problem.observations <= _SMALL):
        known.append(_graduated(problem, begin))
    costs = [cost_of_residuals(sizes_of(problem.groups, values), problem.observations) for values in known]
    return known[int(np.argmin(costs))]
