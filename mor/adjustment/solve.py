"""The iteration: linearise, build the normal equations, take a step, until nothing moves.

Steps are those of Gauss and Newton. If a full step does not gain, a damped one is taken (Levenberg and Marquardt, see
:mod:`mor.adjustment.step_control`). :mod:`mor.adjustment.convergence` says when the iteration is over.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.adjustment.convergence import (
    ACCURACY,
    AT_THE_LAST_DIGIT,
    creeps,
    is_in_datum,
    is_over,
    residuals_stay,
    stands_still,
    without_progress,
)
from mor.adjustment.datum.defect import Defect, explain_defect, units_of_length
from mor.adjustment.datum.s_transformation import binds, constraint, into_datum
from mor.adjustment.datum.weak_directions import NOTHING_KNOWN, weak_turns
from mor.adjustment.inverse import Inverse, find_anchors, invert, invert_alike
from mor.adjustment.memory import LESS, memory_of_adjustment
from mor.adjustment.normals import build_normals, gradient_elsewhere
from mor.adjustment.plan import Plan, make_plan
from mor.adjustment.problem import Problem
from mor.adjustment.rays.eliminable import eliminable_rays
from mor.adjustment.secants import NOTHING_LEARNT, Secants
from mor.adjustment.state import (
    A_WEAK_TURN,
    RAN_AWAY,
    SINGULAR_MINIMUM,
    STANDS_STILL,
    Adjustment,
    Iteration,
    Outcome,
    Stride,
    Watcher,
)
from mor.adjustment.step_control import Taken, accept, accept_whole
from mor.arrays import LARGEST, FloatArray
from mor.geometry import tolerant
from mor.machine import check_room
from mor.parameters.index import Values, move
from mor.sparse.blas_threads import threads_for

_ALIKE = 10.0
"""Condition of the movements of a network, each of length one, from which on it is anchored anew while it turns."""
_SMALL_STEP = 1e-4
"""Movement, in parts of the size of the network, by which second derivatives are taken."""


class Settings(NamedTuple):
    """What the user may set of the solver."""

    max_iterations: int = 50
    """Most iterations without progress."""


def adjust(
    problem: Problem, start: Values, settings: Settings | None = None, watch: Watcher | None = None
) -> Adjustment:
    """Adjust from the start values. The outcome says whether it converged; nothing is raised for a bad network."""
    settings = settings or Settings()
    plan = make_plan(problem, eliminable_rays(problem, start))
    check_room(memory_of_adjustment(plan), "the adjustment", LESS)
    with threads_for(plan.elimination.largest_front):
        return _iterated(plan, start, settings, watch)


def _iterated(plan: Plan, start: Values, settings: Settings, watch: Watcher | None) -> Adjustment:
    state = _begin(plan, start)
    while (
        state.outcome is Outcome.NOT_CONVERGED
        and without_progress(state.iterations) < settings.max_iterations
    ):
        state = _advance(state)
        if watch is not None and state.iterations:
            watch(state.iterations[-1])
        if state.outcome is Outcome.NOT_CONVERGED and stands_still(state.iterations):
            return state._replace(reason=STANDS_STILL)
    return state


def _begin(plan: Plan, start: Values) -> Adjustment:
    problem = plan.problem
    normals = build_normals(plan, start)
    anchored = find_anchors(plan, normals)
    inverse = invert(plan, normals, start, *anchored)
    defect = explain_defect(inverse.null, problem, start)
    bound = constraint(defect.datum, problem, start)
    state = Adjustment(
        problem=problem,
        plan=plan,
        outcome=Outcome.NOT_CONVERGED,
        reason="",
        start=start,
        values=start,
        normals=normals,
        anchors=anchored.unknowns,
        inverse=inverse,
        defect=defect,
        constraint=bound,
        iterations=(),
        stride=Stride(np.zeros(0)),
        kernels=compilation.wanted(),
    )
    return _judge_defect(state)


def _judge_defect(state: Adjustment) -> Adjustment:
    """Singular where something inside the network is loose, or a defect is there that the datum does not settle."""
    defect, datum = state.defect, state.problem.datum
    if defect.inside:
        return state._replace(
            outcome=Outcome.SINGULAR, reason="unknowns are not determined by the observations"
        )
    if defect.datum.shape[1] and not datum.free:
        return state._replace(outcome=Outcome.SINGULAR, reason="the datum is not defined")
    if not binds(defect.datum, state.constraint, state.problem.index):
        return state._replace(outcome=Outcome.SINGULAR, reason="the datum points do not settle the datum")
    return state


def _advance(state: Adjustment) -> Adjustment:
    """One accepted step, or the end."""
    regular, weak = state.inverse.parts_of_step(state.normals)
    stride = state.stride.next(weak)
    step = regular + stride.weak
    shift, gain = _into_datum(state, step)
    change = _gain(state, regular + weak)
    over = is_over(state, change, state.inverse.weak) and is_in_datum(state, step, shift, gain, change)
    iteration = Iteration(len(state.iterations) + 1, state.normals.objective, change, 0.0, _redundancy(state))
    if over and change <= ACCURACY:
        return _converged(_last_step(state, step + shift, iteration))
    taken = None if over else _with_curvature(state, change)  # steps of round-off tell no curvature
    if taken is None:
        taken = accept(state, regular, stride.weak, shift, change)
    if taken is None and change <= AT_THE_LAST_DIGIT:
        return _converged(_at_minimum(state._replace(iterations=(*state.iterations, iteration))))
    if taken is None:
        return state._replace(outcome=Outcome.DIVERGED, reason="no step makes the sum of squares smaller")
    if any(np.abs(values).max(initial=0.0) > LARGEST for values in taken.values.values()):
        return state._replace(outcome=Outcome.DIVERGED, reason=RAN_AWAY)
    iteration = iteration._replace(damping=taken.damping)
    moved = _at(state, taken, (*state.iterations, iteration), last=over)
    moved = moved._replace(
        stride=Stride(stride.whole, stride.share * taken.share),
        damping=taken.next_damping or state.damping,
        secants=_learnt(state, moved, step if taken.step is None else taken.step),
    )
    return _converged(moved) if over and taken.share == 1.0 else moved


def _with_curvature(state: Adjustment, change: float) -> Taken | None:
    """The step with the curvature that the last steps have shown, where they creep and it is as good as it promises."""
    if not state.secants.steps or not creeps(state, change):
        return None
    step = state.secants.step(state.inverse, state.normals.rhs)
    shift, _ = _into_datum(state, step)
    return accept_whole(state, step, shift, _gain(state, step))


def _learnt(state: Adjustment, moved: Adjustment, step: FloatArray) -> Secants:
    """What is known of the curvature after a step (u,); nothing where residuals do not stay as large as they are."""
    damped = moved.iterations[-1].damping > 0.0
    if damped or moved.inverse.weak.shape[1] or not residuals_stay(state, moved):
        return NOTHING_LEARNT
    return state.secants.after(step, state.normals.rhs, moved.normals.rhs)


def _gain(state: Adjustment, step: FloatArray) -> float:
    """√(bᵀδ) of a step δ (u,): how far it moves the unknowns, in units of σ."""
    return float(np.sqrt(max(float(step @ state.normals.rhs), 0.0)))


def _converged(state: Adjustment) -> Adjustment:
    """The solution, its movements of the network and what binds them to full accuracy.

    No solution where the network as a whole may stand any way about: where the observations say less of a turn of it
    than nothing at all.
    """
    if state.outcome is not Outcome.NOT_CONVERGED:
        return state
    turns = weak_turns(state.inverse.weak, state.problem, state.values)
    if turns and turns[0].sigma > NOTHING_KNOWN:
        return state._replace(outcome=Outcome.SINGULAR, reason=A_WEAK_TURN)
    datum = state.defect.datum
    if datum.shape[1]:
        datum = state.inverse.refined(datum)
    return state._replace(
        outcome=Outcome.CONVERGED,
        defect=replace(state.defect, datum=datum),
        constraint=constraint(datum, state.problem, state.inverse.values),
        stride=Stride(np.zeros(0)),
        normals=state.normals.spent(),
    )


def _redundancy(state: Adjustment) -> int:
    problem = state.problem
    return problem.observations - problem.index.count + state.defect.dimension


def _last_step(state: Adjustment, step: FloatArray, iteration: Iteration) -> Adjustment:
    """The solution, a step away that is so small that the system stays the same there."""
    objective_there = max(state.normals.objective - iteration.largest_change**2, 0.0)
    checked = _at_minimum(state)
    if checked.outcome is not Outcome.NOT_CONVERGED:
        return checked
    return checked._replace(
        values=move(state.problem.index, state.values, step),
        normals=state.normals._replace(objective=objective_there),
        iterations=(*state.iterations, iteration),
    )


def _into_datum(state: Adjustment, step: FloatArray) -> tuple[FloatArray, float]:
    """Movement (u,) of the whole network that brings it into its datum after the step, and its ``gain``."""
    if state.defect.datum.shape[1] == 0:
        return np.zeros(len(step)), 1.0
    there, gain = into_datum(step, state.defect.datum, state.constraint, state.problem, state.values)
    return there - step, gain


def _at(state: Adjustment, taken: Taken, iterations: tuple[Iteration, ...], last: bool) -> Adjustment:
    """The state after a step. Only the last one checks once more what the anchors hold."""
    values = taken.values
    normals = build_normals(state.plan, values) if taken.normals is None else taken.normals
    moved = state._replace(values=values, normals=normals, iterations=iterations)
    if last:
        return _at_minimum(moved)
    if state.inverse.weak.shape[1] or state.defect.inside:
        checked = _with_checked_defect(moved)
        # A point on its way to infinity is not determined here; whether the solution is, its own defect says.
        return (
            checked._replace(outcome=Outcome.NOT_CONVERGED, reason="") if checked.defect.inside else checked
        )
    inverse = invert_alike(state.plan, normals, values, state.anchors)
    turns = taken.share < 1.0 and taken.damping == 0.0
    if turns and _are_alike(inverse.null / units_of_length(state.problem.index, values)[:, None]):
        anchored = find_anchors(state.plan, normals)
        inverse = invert(state.plan, normals, values, *anchored)
        moved = moved._replace(anchors=anchored.unknowns)
        return _with_defect(moved, inverse, explain_defect(inverse.null, state.problem, values))
    return _with_defect(moved, inverse, replace(state.defect, datum=inverse.null))


def _are_alike(movements: FloatArray) -> bool:
    """Return True if movements (u, d) are hardly independent: the network has turned away from its anchors."""
    sizes = np.linalg.norm(movements, axis=0)
    if movements.shape[1] < 2 or not (np.isfinite(sizes).all() and sizes.all()):
        return False
    return bool(np.linalg.cond(np.linalg.qr(movements / sizes, mode="r")) > _ALIKE)


def _at_minimum(state: Adjustment) -> Adjustment:
    """Return the state at the end of the iteration, anchored anew if a direction has become weak on the way."""
    checked = _with_checked_defect(state)
    if not checked.inverse.is_weak or checked.outcome is not Outcome.NOT_CONVERGED:
        return checked
    anchored = find_anchors(state.plan, state.normals)
    inverse = invert(state.plan, state.normals, state.values, *anchored)
    defect = explain_defect(inverse.null, state.problem, state.values)
    again = _with_defect(checked._replace(anchors=anchored.unknowns), inverse, defect)
    if again.outcome is not Outcome.SINGULAR:
        return again
    return _bound_by_curvature(again) or again._replace(reason=SINGULAR_MINIMUM)


def _bound_by_curvature(state: Adjustment) -> Adjustment | None:
    """The state at a minimum where residuals determine what no observation does to first order; ``None`` if not.

    Movements G of the network with A G = 0 change vᵀPv by the second derivatives of the observations alone. Where
    GᵀSG, S = −Σ p l ∂²f, is positive and keeps the movement small, vᵀPv has a minimum there, and G (GᵀSG)⁻¹ Gᵀ is its
    part of the cofactors.
    """
    datum, problem = state.defect.datum, state.problem
    if problem.datum.free or state.defect.inside or datum.shape[1] == 0:
        return None
    units = units_of_length(problem.index, state.values)[:, None]
    movements = units * np.linalg.qr(datum / units)[0]
    curvature = np.empty((movements.shape[1], movements.shape[1]))
    for k, movement in enumerate(movements.T):
        there = [
            gradient_elsewhere(
                state.plan, move(problem.index, state.values, sign * _SMALL_STEP * movement), state.values
            )
            for sign in (1.0, -1.0)
        ]
        curvature[:, k] = movements.T @ (there[1] - there[0]) / (2.0 * _SMALL_STEP)
    sizes, axes = tolerant.eigh(0.5 * (curvature + curvature.T))
    if not sizes[0] > 0.0:
        return None
    weak = movements @ (axes / np.sqrt(sizes))
    if not float(np.abs(weak / units).max()) < NOTHING_KNOWN:
        return None
    none = np.zeros((problem.index.count, 0))
    defect = replace(state.defect, movements=(), datum=none, to_second_order=datum.shape[1])
    inverse = state.inverse._replace(null=none, weak=np.concatenate([state.inverse.weak, weak], axis=1))
    bound = constraint(none, problem, state.values)
    return state._replace(
        outcome=Outcome.NOT_CONVERGED, reason="", inverse=inverse, defect=defect, constraint=bound
    )


def _with_checked_defect(state: Adjustment) -> Adjustment:
    """The state with its null and weak directions worked out, where that has not been done at its values."""
    if len(state.anchors) == 0 and state.inverse.values is state.values:
        return state
    inverse = invert(state.plan, state.normals, state.values, state.anchors)
    return _with_defect(state, inverse, explain_defect(inverse.null, state.problem, state.values))


def _with_defect(state: Adjustment, inverse: Inverse, defect: Defect) -> Adjustment:
    bound = constraint(defect.datum, state.problem, state.values)
    return _judge_defect(state._replace(inverse=inverse, defect=defect, constraint=bound))
