"""When an iteration is over: what is left is nothing beside the accuracy wanted, or beside the round-off of the data.

With the step δ of N δ = b, √(δᵀNδ) = √(bᵀδ) = c is what it gains: vᵀPv falls by c², and no unknown moves by more than c
in units of its own σ. Steps that shrink by q leave c q/(1 − q) for all those after this one together. (Near a solution
q is constant where residuals are large, and falls with the square of the steps where they are small: then this is
an upper bound.) Likewise for the movement m of a free network into its datum, which changes no observation and so
does not show in c.

An observation is known to η = ε (|l| + Σ |a_j x_j|), ε the last digit: coordinates, of which the computed value is a
function, are no better than that. Through the normal equations these errors make steps of up to τ,

    τ² = Σ (η/σ)² + ε vᵀPv (1 + ε Σ_k |g_k|²),

the middle term being the last digit of vᵀPv itself, the last sum over the weak directions g_k, whose part of b is a
difference of large numbers. Steps of that size that no longer halve are noise.

The derivation, and what was tried, is in docs/convergence.md.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mor.adjustment.linearise import linearise, linearise_of, rotation_tangents
from mor.adjustment.normals import Normals
from mor.adjustment.plan import Plan
from mor.adjustment.rays.chunks import ray_chunks
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.state import Adjustment, Iteration
from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Values

ACCURACY = 1e-8
"""Change in units of σ that leaves results as they are, to the digits that anybody looks at.

1e-6 would not do: a network of 5 m with σ of 0.3 mm then moves by 1e-10 of its size, and cofactors in a datum of few
points by 2e-9 of themselves."""
AT_THE_LAST_DIGIT = 0.1
"""Largest step in units of σ at a minimum, where no step of any length and damping makes vᵀPv smaller.

The observations hardly determine a direction there, and round-off moves the network along it by up to this."""
_RATE_KNOWN_TO = 4.0
"""Margin for a rate of convergence that is taken from two steps."""
_CREEPS = 0.25
"""Rate from which on steps creep: near a solution they fall faster where residuals are no larger than their σ."""
_STANDING = 10
"""Iterations that are compared with as many before them."""
_STANDS = 1e-3
"""Part of vᵀPv by which it still falls at a standstill, at most: σ0 then keeps its first three digits."""
_CRAWLS = 1e-6
"""The same of ten damped iterations: a point on its way to infinity gains little by little."""
_EPS = float(np.finfo(float).eps)


class Iterated(Protocol):
    """What has been iterated so far."""

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """The steps that were taken."""


def is_over(state: Adjustment, change: float, weak: FloatArray) -> bool:
    """True where nothing is left to do after a step of size ``change``; ``weak`` are the weak directions (u, w)."""
    if left_after(state, change) <= ACCURACY:
        return True
    if change > 1.0 or not state.iterations or change < 0.5 * state.iterations[-1].largest_change:
        return False
    return change <= round_off(state.plan, state.values, state.normals, weak)


def creeps(state: Adjustment, change: float) -> bool:
    """True where a whole step of size ``change`` is more than a quarter of the one before it, and not yet nothing."""
    if change <= ACCURACY or not state.iterations or state.iterations[-1].damping:
        return False
    return change > _CREEPS * state.iterations[-1].largest_change


def residuals_stay(before: Adjustment, after: Adjustment) -> bool:
    """True where a step has not halved vᵀPv: then what Gauss-Newton leaves out will not vanish with the residuals."""
    return after.normals.objective > 0.5 * before.normals.objective


def without_progress(iterations: tuple[Iteration, ...]) -> int:
    """Return the number of iterations since vᵀPv was last a thousandth larger than it is now."""
    objectives = [iteration.objective for iteration in iterations]
    larger = (k for k, one in enumerate(reversed(objectives)) if one > (1.0 + _STANDS) * objectives[-1])
    return next(larger, len(objectives))


def stands_still(iterations: tuple[Iteration, ...]) -> bool:
    """Return True if twenty iterations have made neither vᵀPv smaller, nor the steps, nor the damping.

    Steps that shrink slowly, all those to come together by less than one σ, do not stand still. Nor does an iteration
    whose damping falls: its steps grow along a direction that was damped. Steps of zero are not compared: an adjustment
    in another datum that begins at the solution begins with one.
    """
    if len(iterations) < 2 * _STANDING:
        return False
    earlier, later = iterations[-2 * _STANDING : -_STANDING], iterations[-_STANDING:]
    if earlier[0].objective - later[-1].objective > _STANDS * later[-1].objective:
        return False
    if later[-1].damping and later[0].objective - later[-1].objective > _CRAWLS * later[-1].objective:
        return False
    if 0.0 < later[-1].damping < 0.5 * later[0].damping:
        return False
    steps = [iteration.largest_change for iteration in earlier if iteration.largest_change > ACCURACY]
    before, now = min(steps, default=0.0), min(iteration.largest_change for iteration in later)
    rate = (now / before) ** (1.0 / _STANDING) if before > 0.0 else 0.0
    return now > 0.5 * before and (rate >= 1.0 or now * rate / (1.0 - rate) > 1.0)


def left_after(state: Iterated, change: float) -> float:
    """What is left to do after a whole step of size ``change``, in units of σ; infinite where no rate is known."""
    if change <= ACCURACY:
        return change
    if not state.iterations or state.iterations[-1].damping:
        return np.inf
    before = state.iterations[-1].largest_change
    rate = change / before if before > 0.0 else np.inf
    return _RATE_KNOWN_TO * change * rate / (1.0 - rate) if rate < 1.0 else np.inf


def is_in_datum(state: Adjustment, step: FloatArray, shift: FloatArray, gain: float, change: float) -> bool:
    """True where the network has stopped moving as a whole.

    That is where the ``shift`` (u,) into the datum is nothing beside the accuracy of the coordinates: that of the
    ``step`` (u,), which moves them by some of their σ for every unit of ``change``, and that of their last digits,
    through the condition of the constraint. A step of round-off tells less than the σ there is; then the one of the
    coordinate that moves farthest is worked out, in the datum, and in the minimal datum of the anchors: a step that is
    nothing may be that times ``change`` there, and the shift takes it back. All of that may be ``gain`` times as large.
    """
    if not np.isfinite(shift).all():  # the constraint does not bind the movements here
        return False
    mask = state.constraint.mask
    moving = float(np.abs(shift[mask]).max(initial=0.0))
    if moving == 0.0:
        return True
    coordinates = state.values["point"] if "point" in state.values else np.zeros((1, 3))
    together = state.constraint.normals.T @ state.defect.datum
    condition = float(np.linalg.cond(together)) if together.size else 1.0
    digits = 4.0 * _EPS * float(np.abs(coordinates).max(initial=0.0)) * condition
    sigma = float(np.abs(step[mask]).max(initial=0.0)) / change if change > 0.0 else 0.0
    if moving <= gain * (max(ACCURACY, min(change, 1e-3)) * sigma + digits):
        return True
    in_datum, anchored = _sigmas(state, int(np.argmax(np.where(mask, np.abs(shift), 0.0))))
    return moving <= gain * (max(ACCURACY * in_datum, min(ACCURACY, change) * anchored) + digits)


def _sigmas(state: Adjustment, unknown: int) -> tuple[float, float]:
    """σ (for σ0 = 1) of an unknown in the datum of the inner constraints, and in the minimal datum of the anchors.

    They are √(sᵀQs) and √Q_ii, s the row of S = I − G H Bᵀ.
    """
    null, bound = state.defect.datum, state.constraint.normals
    unit = np.zeros(len(null))
    unit[unknown] = 1.0
    row = unit - bound @ np.linalg.solve(null.T @ bound, null[unknown])
    both = np.stack([row, unit], axis=1)
    squares = np.einsum("uk,uk->k", both, state.inverse.solve(both))
    return tuple(np.sqrt(np.maximum(squares, 0.0)).tolist())


def round_off(plan: Plan, values: Values, normals: Normals, weak: FloatArray) -> float:
    """τ: the largest step in units of σ that is nothing but round-off of the observations and coordinates."""
    problem = plan.problem
    sizes = _sizes_of_unknowns(plan, values)
    tangent = rotation_tangents(problem.index, values)
    total = 0.0
    for row_set in plan.row_sets:
        group = problem.groups[row_set.group]
        rows = linearise_of(problem, row_set.group, values, tangent, row_set.rows)
        observed = np.nan_to_num(np.abs(group.observed[row_set.rows]))
        total += float(
            np.sum((row_set.weight * (observed + _moved(rows.jacobian, rows.columns, sizes))) ** 2)
        )
    for cluster in plan.clusters:
        for number in np.unique(cluster.groups):
            group, here = problem.groups[number], cluster.groups == number
            rows = linearise(group, problem.index, values, tangent, cluster.rows[here])
            size = np.nan_to_num(np.abs(group.observed[cluster.rows[here]]))
            size = size + _moved(rows.jacobian, rows.columns, sizes)
            own = size[np.arange(len(size)), cluster.components[here]]
            total += float(np.sum((cluster.whitening[:, here] * own) ** 2))
    for chunk in ray_chunks(problem, plan.rays, plan.reduced, values):
        total += _of_rays(chunk.rays, chunk.weight, sizes[plan.kept], sizes[plan.rays.columns[chunk.points]])
    scaled = np.sqrt(normals.diagonal)[:, None] * weak[plan.kept]
    hidden = normals.objective * (1.0 + _EPS * float(np.sum(scaled**2)))
    return float(np.sqrt(_EPS**2 * total + _EPS * hidden))


def _sizes_of_unknowns(plan: Plan, values: Values) -> FloatArray:
    """(u,) sizes |x| of the unknowns; of rotations 1."""
    index = plan.problem.index
    sizes = np.zeros(index.count)
    for kind, columns in index.columns.items():
        free = columns >= 0
        sizes[columns[free]] = 1.0 if index.blocks[kind].kind.is_rotation else np.abs(values[kind])[free]
    return sizes


def _moved(jacobian: FloatArray, columns: IntArray, sizes: FloatArray) -> FloatArray:
    """Σ |a_j x_j| (n, m) of rows with Jacobian (n, m, K)."""
    own = np.where(columns >= 0, sizes[columns], 0.0) if columns.shape[1] else np.zeros(columns.shape)
    moved: FloatArray = np.einsum("nmk,nk->nm", np.abs(jacobian), own)
    return moved


def _of_rays(rays: Rays, weight: FloatArray, sizes: FloatArray, of_points: FloatArray) -> float:
    """Σ (η/σ)²/ε² of a chunk of rays; what was observed is as large as what the unknowns make of it, or smaller."""
    own = np.where(rays.columns >= 0, sizes[rays.columns], 0.0)[rays.frame]
    point = np.repeat(np.arange(rays.points), np.diff(rays.point_pointers))
    moved = np.einsum("nmk,nk->nm", np.abs(rays.by_others), own)
    moved += np.einsum("nmk,nk->nm", np.abs(rays.by_point), of_points[point])
    return float(np.sum(moved**2))
