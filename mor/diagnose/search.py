"""Search for likely mistakes in a rejected network by re-adjusting it under each hypothesis.

Hypotheses come in stages, in each the most promising first. Each one is tried by changing the network and adjusting
it. Hypotheses are ranked by description length; those that are better than none at the level 0.001, the number of
candidates counted in, are offered. None is applied.

The order of hypotheses about whole groups follows how well start values fit with them: Σ ln max(s, 1) − ln |dl'/dl|
with s = |v|/σ, over the observations whose start values are all given. A change of observations that fit already is
less likely, unless it changes the start values too: coordinates that were given twice, as observations and as start
values, fit in any unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.diagnose.angles import (
    circle_hypotheses,
    face_hypotheses,
    frame_hypotheses,
    implausible_zenith_hypotheses,
    scored_frame_hypotheses,
    turned_circle_hypotheses,
)
from mor.diagnose.control import (
    control_hypotheses,
    distance_hypotheses,
    exchange_hypotheses,
    moved_hypotheses,
    scored_sigma_hypotheses,
    sigma_hypotheses,
    table_unit_hypotheses,
)
from mor.diagnose.heights import (
    antenna_hypotheses,
    curvature_hypotheses,
    height_hypotheses,
    implausible_height_hypotheses,
    levelling_hypotheses,
)
from mor.diagnose.hypothesis import (
    NOTHING_FOUND,
    SMALL,
    Before,
    Begin,
    Diagnosis,
    GoOn,
    HopelessError,
    Hypothesis,
    Make,
    NetworkFit,
    Offered,
    Situation,
    Trial,
    attempt,
    changed_observations,
    controlled_part,
    fit_of,
)
from mor.diagnose.images import camera_constant_hypotheses, image_hypotheses, other_camera_hypotheses
from mor.diagnose.names import name_hypotheses
from mor.errors import InputError
from mor.linalg.cholesky import NotFiniteError
from mor.model.contract import some_rows
from mor.model.parameters import Values, all_known, with_shared_components
from mor.project.network import Network
from mor.quality.assessment import Quality
from mor.quality.group_tests import Rejection
from mor.quality.outliers import BY_CHANCE, cost_of_choice, cost_of_residuals, reintersected, sizes_of
from mor.quality.robust_estimation import exclude, graduated_weights
from mor.quality.solution import ScoredHypothesis
from mor.quality.test_statistics import LEVEL, log_p_chi2
from mor.solve.iterate import Adjustment, Outcome
from mor.solve.problem import Problem, misclosures
from mor.start.sights import ROWS
from mor.types import BoolArray, FloatArray

_ABSURD = 10.0
"""Factor of all σ that nobody errs by."""
_RIVAL = 0.5
"""Part of what a hypothesis that explains everything promised, or gained, below which another one is no rival to it."""
Family = Callable[[Situation], list[Hypothesis]]
OF_ROWS: tuple[Family, ...] = (
    levelling_hypotheses,
    name_hypotheses,
    exchange_hypotheses,
    face_hypotheses,
    antenna_hypotheses,
    frame_hypotheses,
    other_camera_hypotheses,
)
"""Families that change a few observations or points: what explains everything so has no rival among the others."""
OF_UNKNOWNS: tuple[Family, ...] = (distance_hypotheses, height_hypotheses, camera_constant_hypotheses)
BEYOND_REACH: tuple[Family, ...] = (implausible_height_hypotheses, implausible_zenith_hypotheses)
"""Families of values that nobody has: they are tried first, even if nothing else is known."""
OF_A_WHOLE: tuple[Family, ...] = (control_hypotheses, circle_hypotheses, image_hypotheses, table_unit_hypotheses)
"""Families that change all of a group, an image or a station: asked only where as much does not fit."""


def control_point_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Two control points exchanged, and points that moved."""
    return [*exchange_hypotheses(situation), *moved_hypotheses(situation)]


def distance_or_unit_hypotheses(situation: Situation) -> list[Hypothesis]:
    """A table in another unit, which is a scale too, and what else is wrong with distances."""
    return [*table_unit_hypotheses(situation), *distance_hypotheses(situation)]


_FAMILIES: dict[str, Family] = {
    "names exchanged": name_hypotheses,
    "wrong name": name_hypotheses,
    "wrong station": name_hypotheses,
    "levelling sign": levelling_hypotheses,
    "vector sign": levelling_hypotheses,
    "antenna height": antenna_hypotheses,
    "control exchanged": exchange_hypotheses,
    "control unit": control_hypotheses,
    "axes exchanged": control_hypotheses,
    "control moved": control_point_hypotheses,
    "orientation changed": turned_circle_hypotheses,
    "sigma of a table": scored_sigma_hypotheses,
    "pixel origin": camera_constant_hypotheses,
    "distance offset": distance_hypotheses,
    "distance scale": distance_or_unit_hypotheses,
    "slope distance": distance_hypotheses,
    "horizontal distance": distance_hypotheses,
    "table unit": table_unit_hypotheses,
    "instrument height": height_hypotheses,
    "target height": height_hypotheses,
    "set-ups exchanged": scored_frame_hypotheses,
    "images exchanged": scored_frame_hypotheses,
    "image flipped": image_hypotheses,
    "image turned": image_hypotheses,
    "image unit": image_hypotheses,
    "image scale": camera_constant_hypotheses,
    "camera of images": other_camera_hypotheses,
    "circle sense": circle_hypotheses,
    "circle unit": circle_hypotheses,
    "elevation for zenith": circle_hypotheses,
    "face": face_hypotheses,
    "curvature": curvature_hypotheses,
}
"""Families of the causes that score tests name."""


def _scored(situation: Situation) -> list[Hypothesis]:
    """The hypotheses that score tests speak for, the best score first."""
    of_family: dict[Family, list[Hypothesis]] = {}
    found: list[Hypothesis] = []
    for one in situation.scored:
        family = _FAMILIES.get(one.cause)
        if family is None:
            continue
        if family not in of_family:
            of_family[family] = family(situation)
        things = set(one.things)
        found += [
            hypothesis
            for hypothesis in of_family[family]
            if (hypothesis.cause == one.cause or family in (control_point_hypotheses, distance_or_unit_hypotheses))
            and (things <= set(hypothesis.things) or set(hypothesis.things) <= things)
        ]
    return found


class SolvedHypothesis(NamedTuple):
    """A hypothesis whose adjustment has a solution."""

    hypothesis: Hypothesis
    fit: NetworkFit
    promised: float
    """By how much the start values speak for it; 0 where that was not asked."""
    scored: bool = False
    """True if a score test names it."""


def possible_causes(situation: Situation, before: Before, go_on: GoOn) -> Diagnosis:
    """Try hypotheses one after the other until all are tried, or ``go_on`` says no."""
    found: list[SolvedHypothesis] = []
    trials: list[Trial] = []
    untried, explained, done = 0, -np.inf, False
    known: set[tuple[str, tuple[str, ...]]] = set()
    later = {(one.cause, one.things) for one in implausible_height_hypotheses(situation)}  # begun at a usual height
    for hypothesis in _scored(situation):
        if (hypothesis.cause, hypothesis.things) in known | later:
            continue
        known.add((hypothesis.cause, hypothesis.things))
        if untried or not go_on(hypothesis):
            untried += 1
            continue
        fit = tried(situation, hypothesis, scored=True)
        trials.append(_trial(situation, hypothesis, fit))
        if fit is not None:
            found.append(SolvedHypothesis(hypothesis, fit, 0.0, scored=True))
            done |= _explains(hypothesis, fit)
    stages = _stages(situation)
    if done:  # a change of a whole is no rival then
        stages = tuple(stage for stage in stages if stage in (OF_ROWS, OF_UNKNOWNS))
    # If one of these causes explains everything, the others may as well.
    mirror_images = ("circle sense", "image flipped", "axes exchanged")
    for stage in stages:
        for hypothesis, promised in _of_stage(situation, stage):
            no_rival = promised < _RIVAL * explained and hypothesis.cause not in mirror_images
            if no_rival or (hypothesis.cause, hypothesis.things) in known:
                continue
            if untried or not go_on(hypothesis):
                untried += 1
                continue
            mirrored = done and hypothesis.cause in mirror_images
            fit = tried(situation, hypothesis, mirrored or not done, mirrored or promised > BY_CHANCE)
            trials.append(_trial(situation, hypothesis, fit))
            if fit is None:
                continue
            found.append(SolvedHypothesis(hypothesis, fit, promised))
            if _explains(hypothesis, fit):
                done = True
                explained = max(explained, promised) if stage is OF_A_WHOLE else explained
        if stage is OF_ROWS and done:
            break
    if not done and before.compared > _ABSURD * before.freedom:  # what all begin with may be what is wrong
        for number, (hypothesis, fit, _) in enumerate(trials):
            if fit is not None or not hypothesis.afresh or untried or not go_on(hypothesis):
                continue
            fit = tried(situation, hypothesis, spoken_for=True)
            if fit is not None:
                trials[number] = _trial(situation, hypothesis, fit)
                found.append(SolvedHypothesis(hypothesis, fit, 0.0))
                if _explains(hypothesis, fit):
                    break
    return Diagnosis(before, _offered(situation, before, found), tuple(trials), untried)


def _trial(situation: Situation, hypothesis: Hypothesis, fit: NetworkFit | None) -> Trial:
    return Trial(hypothesis, fit, 0.0 if fit is None else _gain(situation, fit))


def _stages(situation: Situation) -> tuple[tuple[Family, ...], ...]:
    """Families that are asked together: those of a whole first if most observations do not fit, else last."""
    of_sigmas: tuple[Family, ...] = (sigma_hypotheses,)
    if not situation.larger:
        return of_sigmas, OF_A_WHOLE  # of the others only another unit may make residuals smaller
    if not situation.settled:
        return BEYOND_REACH, of_sigmas, OF_A_WHOLE
    of_the_earth: tuple[Family, ...] = (curvature_hypotheses,)
    if situation.most_do_not_fit or situation.solution is None:
        return BEYOND_REACH, of_sigmas, of_the_earth, OF_A_WHOLE, OF_ROWS, OF_UNKNOWNS
    return BEYOND_REACH, of_sigmas, of_the_earth, OF_ROWS, OF_UNKNOWNS, OF_A_WHOLE


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
        spoken_for = 2.0 * BY_CHANCE if stage is BEYOND_REACH else 0.0
        return [(hypothesis, spoken_for) for hypothesis in found]
    promised = promises(situation, found)
    seen = not situation.begun or (situation.settled and situation.something_is_wrong_as_a_whole)
    least = -np.inf if seen else BY_CHANCE
    told = np.where(promised > BY_CHANCE, promised, 0.0)  # else a table comes before its stations
    order = np.lexsort((-promised, np.array([len(one.things) for one in found]), -told)).tolist()
    return [(found[k], float(promised[k])) for k in order if promised[k] >= least]


def _offered(situation: Situation, before: Before, found: list[SolvedHypothesis]) -> tuple[Offered, ...]:
    """Hypotheses that are better than none beyond chance, or say what a single wrong observation is; the best first."""
    if situation.many_are_out:  # of a single observation only what explains all of it
        found = [one for one in found if len(one.hypothesis.rows) != 1 or nothing_is_left(one.fit)]
    good = _in_order(
        situation,
        [
            one
            for one in found
            if (
                _gain(situation, one.fit) > (0.0 if one.scored and _explains(one.hypothesis, one.fit) else BY_CHANCE)
                and _nearer(one.fit, before)
                and one.fit.scale <= max(_ABSURD, 0.3 * situation.fit.scale)
            )
        ],
    )
    if good and nothing_is_left(good[0].fit):  # then what explains much less is no rival
        least = _RIVAL * _gain(situation, good[0].fit)
        good = [one for one in good if _gain(situation, one.fit) >= least]
    return tuple(
        Offered(
            one.hypothesis,
            one.fit.omega,
            one.fit.freedom,
            _gain(situation, one.fit),
            one.hypothesis.amount_at(one.fit.values),
            one is not good[0] and _are_alike(one.fit, good[0].fit),
        )
        for one in good[:5]
    )


def _in_order(situation: Situation, good: list[SolvedHypothesis]) -> list[SolvedHypothesis]:
    """The shortest description first; of those that chance may put before it, what the start values speak for.

    Where the observations cannot tell them apart, the one that changes fewest cells comes first.
    """
    by_gain = sorted(good, key=lambda one: -round(_gain(situation, one.fit), 6))
    alike = [one for one in by_gain if _gain(situation, one.fit) > _gain(situation, by_gain[0].fit) - BY_CHANCE]
    told = sorted(alike, key=lambda one: -one.promised if one.promised > BY_CHANCE else 0.0)
    same = [one for one in told if _are_alike(one.fit, told[0].fit)]
    same.sort(key=lambda one: len(one.hypothesis.edits) or np.inf)
    others = [one for one in told if not any(one is other for other in same)]
    return [*same, *others, *by_gain[len(alike) :]]


def _are_alike(one: NetworkFit, other: NetworkFit) -> bool:
    # vᵀPv that differ by less tell nothing: likelihoods are the same to a twentieth.
    return one.freedom == other.freedom and abs(one.omega - other.omega) < 0.1


def nothing_is_left(fit: NetworkFit) -> bool:
    """True where chance explains the residuals that a change leaves."""
    return bool(log_p_chi2(fit.omega, max(fit.freedom, 1)) > np.log(LEVEL))


def _explains(hypothesis: Hypothesis, fit: NetworkFit) -> bool:
    """True where chance explains what a mistake leaves.

    With large σ nothing is ever left, and several points that moved may be one mistake in all of them.
    """
    # Parameters of a mistake in one point.
    one = not hypothesis.cause.startswith("sigma") and hypothesis.parameters <= 3
    return one and nothing_is_left(fit)


def _gain(situation: Situation, fit: NetworkFit) -> float:
    return float(situation.fit.length - fit.length)


def _before(situation: Situation, plain: Adjustment) -> Before:
    objective = plain.normals.objective
    compared = objective if plain.outcome is Outcome.CONVERGED else situation.fit.omega
    return Before(objective, compared, plain.redundancy)


class RejectedAdjustment(NamedTuple):
    """End of the adjustment of a network with a mistake."""

    plain: Adjustment
    """That of all observations."""
    solution: Adjustment | None
    """The adjustment there is in the end, without suspects it may be."""
    quality: Quality | None
    """That of the solution."""
    rejected: Rejection = Rejection.LARGER
    led: Values | None = None
    """Where graduated weights lead from the start values of the plain one, where that is known."""
    scored: tuple[ScoredHypothesis, ...] = ()
    """Possible causes by score tests of the solution, the best first."""


def causes(
    network: Network, start: Values, ended: RejectedAdjustment, make: Make, begin: Begin, go_on: GoOn
) -> Diagnosis:
    """Search for mistakes in a network whose plain adjustment did not end well, or is rejected.

    ``start`` has the start values of the whole network, also of what was left out of the adjustment.
    """
    plain, solution = ended.plain, ended.solution
    if not plain.problem.index.count:
        return NOTHING_FOUND
    adjusted = plain.problem.groups[: len(network.groups)]
    whole = [group.count for group in adjusted] == [group.count for group in network.groups]
    if ended.rejected is Rejection.SMALLER and solution is not None:
        values = solution.values if whole else _graduated(make(network, start, start), start)
        there = solution if whole else None
        situation = Situation(network, start, values, there, make, begin, larger=False)
        return possible_causes(situation, _before(situation, plain), go_on)
    useless = plain.outcome is Outcome.CONVERGED and ended.quality is None  # no number of it can be relied on
    if not useless and plain.outcome is Outcome.SINGULAR and not plain.iterations:
        situation = Situation(network, start, start, None, make, begin, settled=False)
        if fit_of(make(network, start, start), start, 0, situation.count).scale <= _ABSURD:
            return NOTHING_FOUND  # something is missing, a datum say; nothing contradicts anything
        before = _before(situation, plain)
        return possible_causes(situation, before._replace(compared=situation.fit.omega), go_on)
    if not whole:
        solution = None  # of a network without some of its things: what is wrong may be with them
        values = _graduated(make(network, start, start), start)
    else:
        values = _where_most_fit(plain, solution, ended.led)
    situation = Situation(network, start, values, solution, make, begin, scored=ended.scored)
    return possible_causes(situation, _before(situation, plain), go_on)


def causes_without_start(
    network: Network, unstarted: Iterable[str], make: Make, begin: Begin, go_on: GoOn
) -> Diagnosis:
    """Search for changes that give start values to a network that has none for the objects named ``unstarted``."""
    start = network.start
    situation = Situation(network, start, start, None, make, begin, frozenset(unstarted), settled=False)
    return possible_causes(situation, Before(np.nan, np.inf, 0), go_on)


def _nearer(fit: NetworkFit, before: Before) -> bool:
    """True where vᵀPv falls by more than chance does and by a part of it, or rises towards its degrees of freedom."""
    if fit.omega <= before.compared:
        # Part of what is too much in vᵀPv that a mistake explains, at least.
        least = max(BY_CHANCE, 0.1 * (before.compared - before.freedom))
        return bool(before.compared - fit.omega > least)
    ratios = np.array([fit.omega / max(fit.freedom, 1), before.compared / max(before.freedom, 1)])
    after, now = np.abs(np.log(np.maximum(ratios, 1e-300)))
    return bool(after < now)


def _graduated(problem: Problem, begin: Values) -> Values:
    with np.errstate(all="ignore"):
        return graduated_weights(problem, begin).values


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


def tried(
    situation: Situation, hypothesis: Hypothesis, afresh: bool = True, spoken_for: bool = False, scored: bool = False
) -> NetworkFit | None:
    """Fit of the network with the change; nothing if its adjustment does not converge.

    ``afresh`` allows that start values are worked out for it, which takes longer than all else; ``spoken_for`` says
    that the given ones speak for it clearly, ``scored`` that the solution does.
    """
    network = hypothesis.change(situation.network)
    best: NetworkFit | None = None
    for begin in _beginnings(situation, network, hypothesis, afresh, spoken_for, scored):
        found = _adjusted(situation, network, begin, hypothesis)
        if found is None:
            continue
        values, defect = found.values, found.defect.dimension
        lost = 0 if situation.solution is None else situation.defect - defect
        stretch = hypothesis.stretch
        if stretch:
            stretch *= controlled_part(situation, network, found)
        cost = cost_of_choice(situation.count, hypothesis.candidates, hypothesis.parameters + lost, stretch)
        fit = fit_of(situation.make(network, values, values), values, defect, situation.count, cost)
        if best is None or fit.length < best.length:
            best = fit
        # vᵀPv over its degrees of freedom up to which no other beginning is tried.
        if best.omega <= 2.0 * best.freedom:
            break
    return best


def _beginnings(
    situation: Situation, network: Network, hypothesis: Hypothesis, afresh: bool, spoken_for: bool, scored: bool = False
) -> Iterator[Values]:
    """Start values: the solution that speaks for it, those that most observations fit, new ones if it is not local.

    Which of them is better is not seen before the adjustment: what fits a wrong observation well begins far off.
    """
    missing = False
    at = [situation.values] if situation.begun else []
    if scored and situation.solution is not None and situation.solution.values is not situation.values:
        at.insert(0, situation.solution.values)
    for some in at:
        here = {kind: _longer(values, network.start[kind]) for kind, values in some.items()}
        open_ = dict(here)
        for kind, blocks in hypothesis.recomputed.items():
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
    # or an image that was placed again needs no other ones.
    afresh &= hypothesis.afresh and (
        spoken_for or situation.most_do_not_fit or (not missing and _most_of_it_does_not_fit(situation, network))
    )
    if not hypothesis.rows and (afresh or known or not situation.begun):
        begin = situation.begin(network)
        if begin is not None:
            yield begin


def _most_of_it_does_not_fit(situation: Situation, network: Network) -> bool:
    count = bad = 0
    changed = changed_observations(situation.network, network)
    for mask, misfitting in zip(changed, situation.misfitting, strict=False):
        rows = mask.any(axis=1)
        count += int(np.count_nonzero(rows))
        bad += int(np.count_nonzero(rows & misfitting.any(axis=1)))
    return 2 * bad > count


def _adjusted(situation: Situation, network: Network, begin: Values, hypothesis: Hypothesis) -> Adjustment | None:
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


def _with_all(situation: Situation, problem: Problem, reduced: Adjustment) -> Adjustment:
    """The adjustment of all observations from there, where it converges and does not go anywhere else."""
    try:
        found = attempt(problem, reduced.values)
    except (NotFiniteError, HopelessError):
        return reduced
    costs = [cost_of_residuals(sizes_of(problem.groups, v), situation.count) for v in (found.values, reduced.values)]
    kept = found.outcome.is_solution and costs[0] <= costs[1] + 1.0
    return found if kept else reduced


def _longer(values: FloatArray, start: FloatArray) -> FloatArray:
    """Values (n, …) with those of blocks that were added."""
    return values if len(values) == len(start) else np.concatenate([values, start[len(values) :]])


def scored_readings_of_tables(network: Network, make: Make, begin: Begin) -> tuple[ScoredHypothesis, ...]:
    """Return the other readings of tables, circles or images for which the given start values speak most clearly.

    No adjustment is made. The gain is twice what a reading promises; readings that chance may not put first are
    left out. Of long tables only some rows, evenly spread, are used and count in the gain.
    """
    parts = [
        some_rows(group, np.linspace(0, group.count - 1, ROWS).astype(np.int64)) if group.count > ROWS else group
        for group in network.groups
    ]
    network = replace(network, groups=tuple(parts), correlations=())
    if sum(_of_group(network, number) for number in range(len(network.groups))) <= BY_CHANCE:
        return ()  # all that start values are given for fits
    situation = Situation(network, network.start, network.start, None, make, begin, settled=False)
    found = sorted(_of_stage(situation, OF_A_WHOLE), key=lambda pair: -pair[1])
    least = max(BY_CHANCE, found[0][1] - 0.5 * BY_CHANCE) if found else BY_CHANCE
    return tuple(
        ScoredHypothesis(
            one.cause, one.things, one.line, 2.0 * by, 0, float(log_p_chi2(2.0 * by, 1) / np.log(10.0)), None
        )
        for one, by in found
        if by > least
    )


def promises(situation: Situation, hypotheses: Sequence[Hypothesis]) -> FloatArray:
    """(k,) what hypotheses promise; 0 where start values and residuals say nothing of it."""
    network = situation.network
    now = [_of_group(network, number) for number in range(len(network.groups))]
    promised = []
    for hypothesis in hypotheses:
        changed = hypothesis.change(network)
        follow = changed.start is not network.start  # start values that were observed fit in any unit
        other = [k for k, group in enumerate(changed.groups) if follow or group is not network.groups[k]]
        count = known = every = 0
        for k, bad in enumerate(situation.misfitting[: len(changed.groups)]):
            old, new = network.groups[k], changed.groups[k]
            if old is not new:
                other_value = old.mask & (old.observed != new.observed)
                count += int(np.count_nonzero(other_value & ~bad))
                every += int(np.count_nonzero(other_value))
                known += int(np.count_nonzero(other_value[_told(changed, k)]))
        # ln of how much less likely it is that an observation is wrong where it fits.
        own = hypothesis.stretch * known / max(every, 1) - 2.0 * count
        gained = sum(now[k] - _of_group(changed, k) for k in other)
        promised.append(gained + (0.0 if follow else own))
    return np.array(promised)


def _told(network: Network, number: int) -> BoolArray:
    """(n,) rows of a group that the given start values are enough for."""
    group = network.groups[number]
    known = np.full(group.count, all(slot.kind in network.start for slot in group.type.slots))
    for slot, blocks in group.blocks_by_slot if known.any() else ():
        start = network.start[slot.kind]
        given: BoolArray = np.asarray(np.isfinite(start.reshape(len(start), -1)).all(axis=1))
        known &= given[blocks]
    return known


def _of_group(network: Network, number: int) -> float:
    """Σ ln max(s, 1) over the observations of a group that the given start values are enough for."""
    group = network.groups[number]
    if not group.count or any(slot.kind not in network.start for slot in group.type.slots):
        return 0.0
    with np.errstate(all="ignore"):
        sizes: FloatArray = np.abs(misclosures(group, network.start)) / group.given_sigma
    return float(np.sum(np.log(np.maximum(sizes[np.isfinite(sizes)], 1.0))))
