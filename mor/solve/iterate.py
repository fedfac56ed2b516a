"""Iterate to the least-squares solution: steps, step control, convergence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.linalg import compilation
from mor.linalg.cholesky import threads_for
from mor.long_arrays import is_limited, kept
from mor.machine import check_room
from mor.model import rotations
from mor.model.parameters import Values, move
from mor.model.rotations import exponential
from mor.solve.datum import (
    NOTHING_KNOWN,
    Constraint,
    Defect,
    binds,
    constraint,
    explain_defect,
    into_datum,
    similarities,
    units_of_length,
    weak_turns,
)
from mor.solve.elimination import Rays, ray_chunks
from mor.solve.inverse import DampedStep, Inverse, damped_step, find_anchors, invert, invert_alike
from mor.solve.normals import (
    NormalEquations,
    Plan,
    build_normals,
    eliminable_rays,
    gradient_elsewhere,
    make_plan,
    normal_product,
    objective,
)
from mor.solve.problem import Problem, linearise, linearise_of, rotation_tangents
from mor.solve.rays import is_ray
from mor.types import LARGEST, FloatArray, IntArray, pieces

# ---- What Gauss-Newton leaves out of the curvature, residual times second derivative, learnt from the steps
# themselves.
#
# Where residuals are large and stay so, steps shrink by a constant rate, or do not shrink at all: along a
# direction in which the true curvature is κ times that of N, a step leaves 1 − κ of itself. A step s that was
# taken changed b = AᵀPl by −y = b' − b, and y is the true curvature times s, whatever it consists of. N⁻¹
# with the last few such pairs put into it (C. G. Broyden, R. Fletcher, D. Goldfarb, D. F. Shanno; by the two
# loops of J. Nocedal 1980) is the inverse of the true curvature as far as these directions go: a few wrong
# observations bend few. Only pairs with sᵀy > 0 count.


class Secants(NamedTuple):
    """The last steps, and how much of b = AᵀPl each of them took away."""

    steps: tuple[FloatArray, ...] = ()
    """(u,) each, the latest last."""
    taken_away: tuple[FloatArray, ...] = ()
    """(u,) each: y = b before − b after."""

    def after(self, step: FloatArray, before: FloatArray, now: FloatArray) -> Secants:
        """With a step (u,) that has led from b = ``before`` to ``now``; what it contradicts is forgotten."""
        change = before - now
        # From this part of sᵀb on, sᵀy says something of a curvature.
        if not step @ change > 1e-3 * abs(float(step @ before)):
            return NOTHING_LEARNT
        steps, taken_away = (*self.steps, kept(step)), (*self.taken_away, kept(change))
        # Six pairs are remembered: half of the unknowns of a point or pose and its neighbour.
        return Secants(steps[-6:], taken_away[-6:])

    def step(self, inverse: Inverse, rhs: FloatArray) -> FloatArray:
        """The step (u,) from where b is ``rhs``, N⁻¹ corrected by what is known of the true curvature."""
        rest, shares = rhs.copy(), []
        for step, change in zip(reversed(self.steps), reversed(self.taken_away), strict=True):
            shares.append(float(step @ rest) / float(step @ change))
            rest -= shares[-1] * change
        result = inverse.solve(rest)
        for step, change, share in zip(self.steps, self.taken_away, reversed(shares), strict=True):
            result = result + step * (share - float(change @ result) / float(step @ change))
        return result


NOTHING_LEARNT = Secants()


# ---- What an adjustment is while it is iterated and when it is over: values, system, datum, history, outcome.


A_WEAK_TURN = "a rotation of the whole network is not usefully determined"
RAN_AWAY = "the iteration moved away from the start values to a place where unknowns are not determined"
STANDS_STILL = "the iteration makes no progress"
PAST_CAMERAS = "steps lead points past cameras that see them"
OPEN = "unknowns are not determined by the observations"
NO_DATUM = "the datum is not defined"
UNSETTLED = "the datum points do not define the datum"
"""Reasons of outcomes."""


class Outcome(Enum):
    """End of an adjustment."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    DIVERGED = "diverged"
    SINGULAR = "singular"

    @property
    def is_solution(self) -> bool:
        """True where the values are a least-squares solution."""
        return self is Outcome.CONVERGED


class Iteration(NamedTuple):
    """One step: objective before it, its size in units of σ, the damping it needed, the redundancy of the system."""

    number: int
    objective: float
    largest_change: float
    damping: float
    redundancy: int

    @property
    def sigma0(self) -> float | None:
        """σ0 before the step, in units of the one given a priori; nothing where nothing is redundant."""
        return float(np.sqrt(self.objective / self.redundancy)) if self.redundancy > 0 else None


class Stride(NamedTuple):
    """The last step along weak directions, and what was taken of it: how far the next one may go.

    Gauss-Newton takes a residual for small and may overshoot on a curve: with ρ the ratio of the true curvature to the
    one it sees, a share s of a step leaves 1 − sρ of it for the next one. From that ρ is known, and s = 1/ρ hits.
    """

    whole: FloatArray
    """(u,) the Gauss-Newton step along weak directions."""
    share: float = 1.0

    @property
    def weak(self) -> FloatArray:
        """(u,) the part of it to take."""
        return self.share * self.whole

    def next(self, whole: FloatArray) -> Stride:
        """The stride after this one, for the Gauss-Newton step (u,) there."""
        size = float(self.whole @ self.whole) if len(self.whole) == len(whole) else 0.0
        if size == 0.0 or self.share == 0.0:
            return Stride(whole)
        ratio = (1.0 - float(self.whole @ whole) / size) / self.share
        return Stride(whole, float(np.clip(1.0 / ratio, 0.02, 1.0)) if ratio > 1.0 else 1.0)


_NO_POINTS: IntArray = np.zeros(0, dtype=np.int64)


class Adjustment(NamedTuple):
    """Outcome of the solver, complete with the inverse of the system at the solution."""

    problem: Problem
    plan: Plan
    outcome: Outcome
    reason: str
    start: Values
    values: Mapping[str, FloatArray]
    normals: NormalEquations
    anchors: IntArray
    inverse: Inverse
    defect: Defect
    constraint: Constraint
    iterations: tuple[Iteration, ...]
    stride: Stride
    damping: float = 1e-4
    """Damping μ with which the next damped step begins; the first is that of Ceres."""
    secants: Secants = NOTHING_LEARNT
    """What the last steps say of the curvature; empty where they do not creep."""
    kernels: bool = False
    """True where compiled kernels did the work, False where plain NumPy did."""
    gone: IntArray = _NO_POINTS
    """Numbers of the point blocks at which it has stopped: at infinity, or led past a camera by the next step."""

    @property
    def redundancy(self) -> int:
        """n − u + d, with d movements that the observations leave free."""
        return self.problem.observations - self.problem.index.count + self.defect.dimension


Watcher = Callable[[Iteration], None]
"""Is told of every iteration."""


def counting_on(watch: Watcher | None, count: int) -> Watcher | None:
    """A watcher that is told of iterations numbered after ``count`` earlier ones."""
    if watch is None:
        return None
    return lambda step: watch(step._replace(number=step.number + count))


# ---- Step control: take the whole Gauss-Newton step if it gains, otherwise a damped one.
#
# A step has two parts. The observations determine the *regular* part. The rest goes along directions that
# they determine hardly or not at all: weak directions, and the shift of a free network into its datum. To
# first order this rest changes no observation, but only to first order: a network that turns by θ along the
# tangent of its turn grows by θ²/2. So the rest is taken a piece at a time, and regular steps from there lead
# back to the solution.
#
# Damped steps are those of Levenberg and Marquardt, δ = (N + μ diag N)⁻¹ b. The gain ratio compares the fall
# of vᵀPv with the one that the linear equations promise. It accepts a step and sets the next μ (H. B.
# Nielsen, *Damping parameter in Marquardt's method*, 1999). A long step along a narrow, bent valley ends on
# its slope. The damped equations, with the derivatives they have, then lead back to its floor (M. K.
# Transtrum, J. P. Sethna, *Improvements to the Levenberg-Marquardt algorithm*, 2012, whose second-order
# correction is the first of these steps).

_EXPECTED = 0.25
"""Part of the gain a step promises that it must keep."""
_LARGEST_TURN = 0.5
"""Largest turn (rad) of any rotation that is tried at once along directions that hardly change the observations."""


def moved_by(plan: Plan, values: Values, step: FloatArray) -> dict[str, FloatArray]:
    """Return values after a step (u,), which changes the inverse distances of points that only rays meet.

    To first order this is the same as a step of their coordinates. A point at X = C + r, seen from C, goes to
    C' + (r + Δ) / (1 − q), with q the part of its distance by which it gets farther and Δ the rest of its step. So it
    stays in front of the camera, and comes to no more than ten times its distance.
    """
    moved = move(plan.problem.index, values, step)
    for points, camera, r, change, q in _toward_points(plan, values, moved):
        rest = r + change - q * r
        moved["point"][points] = (camera + rest / (1.0 - np.minimum(q, 0.9))).T
    return moved


class _Toward(NamedTuple):
    """Points (k,) that only rays meet, C' of cameras that see them, r, its change, all (3, k), and q (k,)."""

    points: IntArray
    camera: FloatArray
    r: FloatArray
    change: FloatArray
    q: FloatArray


def _toward_points(plan: Plan, values: Values, moved: Values) -> Iterator[_Toward]:
    """Yield what :func:`moved_by` needs of so many points as stay in the cache, and axis by axis, which is quicker."""
    points, cameras = plan.seen_points
    for some in pieces(len(points), 4096):
        here, seen_from, before, after = points[some], cameras[some], values["point"], moved["point"]
        camera = after.take(seen_from, axis=0).T
        r = (before.take(here, axis=0) - before.take(seen_from, axis=0)).T
        change = after.take(here, axis=0).T - camera - r
        squares = np.einsum("in,in->n", r, r)
        q = np.einsum("in,in->n", r, change) / np.where(squares > 0.0, squares, 1.0)
        yield _Toward(here, camera, r, change, q)


class Taken(NamedTuple):
    """A step that was taken: where it leads, its damping, the share taken along, the system there if known."""

    values: Mapping[str, FloatArray]
    damping: float
    share: float
    normals: NormalEquations | None = None
    next_damping: float = 0.0
    """Damping with which the next damped step begins, if this one is damped."""
    step: FloatArray | None = None
    """(u,) the step without the shift into the datum, where it is not the one of Gauss-Newton."""


def accept(state: Adjustment, regular: FloatArray, weak: FloatArray, shift: FloatArray, change: float) -> Taken | None:
    """The first of the steps that makes the objective so much smaller as can be expected; ``None`` where there is none.

    The whole step nearly always does, unless the last one was damped, so the system is built there at once. It is
    expected to gain ``change``². With κ the ratio of the true curvature along it to the one that Gauss-Newton sees, it
    gains the part ρ = 2 − κ of that: where residuals are large, κ may exceed 2, and steps go to and fro. The part
    1/κ = 1/(2 − ρ) of the step then hits.
    """
    along = weak + shift
    whole = regular + along
    values = moved_by(state.plan, state.values, whole)
    damped_before = bool(state.iterations) and state.iterations[-1].damping > 0.0
    normals = None if damped_before else build_normals(state.plan, values)
    reached = objective(state.plan, values) if normals is None else normals.objective
    full = Taken(values, 0.0, 1.0, normals) if reached <= _limit(state) else None
    gained = state.normals.objective - reached
    curved = state.inverse.weak.shape[1] == 0 and -1.0 < _share_of(gained, change) < _EXPECTED
    if full is not None and not (curved and change**2 > _round_off_of_sum(state)):
        return full
    if full is None and shift.any():
        shifted = _as_a_whole(state, moved_by(state.plan, state.values, regular + weak), shift)
        if objective(state.plan, shifted) <= _limit(state):
            return Taken(shifted, 0.0, 1.0)
    if full is None and weak.any():
        # Damping takes weak directions with the others, unless they all turn the whole network: these are bent.
        turns = weak_turns(state.inverse.weak, state.problem, state.values)
        if len(turns) < state.inverse.weak.shape[1] and (taken := _damped(state)) is not None:
            return taken
    if full is None and along.any() and (taken := _along(state, regular, along)) is not None:
        return taken
    if curved:
        share = 1.0 / (2.0 - _share_of(gained, change))
        values = moved_by(state.plan, state.values, share * whole)
        if objective(state.plan, values) < min(state.normals.objective, reached):
            return Taken(values, 1.0 / share - 1.0, share)
    return full or _damped(state)


def accept_whole(state: Adjustment, step: FloatArray, shift: FloatArray, change: float) -> Taken | None:
    """The step (u,) and the shift into the datum (u,), where that gains a quarter of ``change``² or more."""
    values = moved_by(state.plan, state.values, step + shift)
    normals = build_normals(state.plan, values)
    gained = state.normals.objective - normals.objective
    if normals.objective <= _limit(state) and gained >= _EXPECTED * change**2 - _round_off_of_sum(state):
        return Taken(values, 0.0, 1.0, normals, step=step)
    return None


def _share_of(gained: float, change: float) -> float:
    return gained / change**2 if change > 0.0 and np.isfinite(gained) else -np.inf


def _round_off_of_sum(state: Adjustment) -> float:
    return 1e-12 * state.normals.objective + 1e-6


def _limit(state: Adjustment) -> float:
    return state.normals.objective * (1.0 + 1e-6) + 1e-6


def _as_a_whole(
    state: Adjustment, values: Mapping[str, FloatArray], shift: FloatArray, exactly: bool = False
) -> Mapping[str, FloatArray]:
    """Return values moved by the similarity of all points whose derivative is the shift (u,), as far as it is one.

    ``exactly``: by the similarity of its kind that leads into the datum, however large it is.
    """
    index, moved = state.problem.index, dict(values)
    columns = index.columns["point"]
    free = columns >= 0
    if not free.any():
        return move(index, values, shift)
    centre = state.values["point"][free.any(axis=1)].mean(axis=0)
    fields = similarities(state.values["point"], centre)[free]
    lengths = np.linalg.norm(fields, axis=0)
    fields = fields / np.where(lengths > 0.0, lengths, 1.0)

    def movements(directions: FloatArray) -> FloatArray:
        found: FloatArray = np.asarray(np.linalg.lstsq(fields, directions[columns[free]], rcond=1e-12)[0], float)
        return (found.T / np.where(lengths > 0.0, lengths, 1.0)).T

    def at(movement: FloatArray) -> FloatArray:
        there = centre + movement[:3] + np.exp(movement[6]) * (values["point"] - centre) @ exponential(movement[3:6]).T
        return np.asarray(np.where(free, there, values["point"]))

    found = movements(shift)
    if exactly:
        from scipy.optimize import least_squares  # hardly any network needs it

        # The inner constraint is the condition of the least sum of squared corrections.
        ways, carries = movements(state.defect.datum), free & state.problem.datum.mask["point"]
        reference = state.problem.datum.reference["point"]
        begin = np.zeros(ways.shape[1])

        def corrections(movement: FloatArray) -> FloatArray:
            return np.asarray((at(ways @ movement) - reference)[carries])

        fit = least_squares(corrections, begin, xtol=_EPS, ftol=_EPS, gtol=_EPS)
        found = ways @ fit.x
    else:
        found = found * min(1.0, _LARGEST_TURN / max(float(np.abs(found[3:]).max()), 1e-300))
    R, scale = exponential(found[3:6]), float(np.exp(found[6]))
    for kind, own in index.columns.items():
        change = np.where(own >= 0, shift[own], 0.0)
        touched = (change != 0.0).any(axis=1)
        if index.blocks[kind].kind.is_rotation:
            moved[kind] = np.where(touched[:, None, None], values[kind] @ R.T, values[kind])
        elif kind == "point":
            moved[kind] = at(found)
        else:
            powers = [float(one.quantity.length) for one in index.blocks[kind].kind.components]
            moved[kind] = np.where(change != 0.0, values[kind] * scale ** np.array(powers), values[kind])
    return moved


def _along(state: Adjustment, regular: FloatArray, along: FloatArray) -> Taken | None:
    """The regular step with as much of the rest as leads back to the solution.

    ``None`` where the regular step itself does not help.
    """
    without = moved_by(state.plan, state.values, regular)
    if objective(state.plan, without) > _limit(state):
        return None
    for share in _first_share(state, along) * 0.25 ** np.arange(5):
        values, before = moved_by(state.plan, state.values, regular + share * along), np.inf
        for _ in range(6):  # regular steps that lead back to the solution
            normals = build_normals(state.plan, values)
            if not normals.objective < 0.5 * before:
                break
            before = normals.objective
            inverse = invert(state.plan, normals, values, state.anchors)
            values = moved_by(state.plan, values, inverse.parts_of_step(normals)[0])
            if objective(state.plan, values) <= _limit(state):
                return Taken(values, 0.0, float(share))
    return Taken(without, 0.0, 0.0)


def _first_share(state: Adjustment, along: FloatArray) -> float:
    columns = state.problem.index.columns.get("rotation")
    if columns is None:
        return 1.0
    turn = float(np.abs(along[columns[columns >= 0]]).max(initial=0.0))
    return min(1.0, _LARGEST_TURN / turn) if turn > 0.0 else 1.0


def _damped(state: Adjustment) -> Taken | None:
    """Return the first damped step that gains, beginning with the damping the last one ended with, or None."""
    damping, growth = max(state.damping, 1e-14), 2.0
    while damping < 1e12:
        tried = damped_step(state.plan, state.values, damping)
        values, ratio = _led_back(state, tried)
        if ratio > 1e-3:  # as in Ceres
            easier = max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            return Taken(values, damping, 1.0, next_damping=damping * easier)
        damping, growth = damping * growth, 2.0 * growth
    return None


def _led_back(state: Adjustment, tried: DampedStep) -> tuple[Mapping[str, FloatArray], float]:
    """Return where a damped step leads and its gain ratio, after corrections as long as they raise a poor ratio."""
    step, b = tried.step, state.normals.rhs
    of_step = normal_product(state.plan, state.values, step[:, None])[:, 0]
    promised = float(step @ (2.0 * b - of_step))

    def gain_ratio(values: Mapping[str, FloatArray]) -> float:
        within = all(float(np.abs(one).max(initial=0.0)) <= LARGEST for one in values.values())
        if not within or not promised > 0.0:
            return -np.inf
        return (state.normals.objective - objective(state.plan, values)) / promised

    values = moved_by(state.plan, state.values, step)
    ratio = gain_ratio(values)
    for _ in range(5):  # steps that lead back to the floor of a valley
        if ratio > 0.75 or not np.isfinite(ratio):
            break
        step = step + tried.solve(gradient_elsewhere(state.plan, state.values, values) - (b - of_step))
        corrected = moved_by(state.plan, state.values, step)
        better = gain_ratio(corrected)
        if not better > ratio:
            break
        values, ratio = corrected, better
    return values, ratio


# ---- When an iteration is over: what is left is nothing beside the accuracy wanted, or beside the round-off of the
# data.
#
# With the step δ of N δ = b, √(δᵀNδ) = √(bᵀδ) = c is what it gains: vᵀPv falls by c², and no unknown moves by
# more than c in units of its own σ. Steps that shrink by q leave c q/(1 − q) for all those after this one
# together. (Near a solution q is constant where residuals are large, and falls with the square of the steps
# where they are small: then this is an upper bound.) Likewise for the movement m of a free network into its
# datum, which changes no observation and so does not show in c.
#
# An observation is known to η = ε (|l| + Σ |a_j x_j|), ε the last digit: coordinates, of which the computed
# value is a function, are no better than that. Through the normal equations these errors make steps of up to
# τ,
#
#     τ² = Σ (η/σ)² + ε vᵀPv (1 + ε Σ_k |g_k|²),
#
# the middle term being the last digit of vᵀPv itself, the last sum over the weak directions g_k, whose part of b is a
# difference of large numbers. Steps of that size that no longer halve are noise.
#
# docs/convergence.md describes the criterion for users.

ACCURACY = 1e-8
"""Change in units of σ that leaves results as they are, to the digits that anybody looks at.

1e-6 would not do: a network of 5 m with σ of 0.3 mm then moves by 1e-10 of its size, and cofactors in a datum of few
points by 2e-9 of themselves."""
_STANDS = 1e-3
"""Part of vᵀPv by which it still falls at a standstill, at most: σ0 then keeps its first three digits."""


class Patience(NamedTuple):
    """Largest gains at which an iteration counts as standing still."""

    iterations: int = 10
    """They are compared with as many before them."""
    gain: float = _STANDS
    """Part of vᵀPv that all of them gain."""
    damped: float = 1e-6
    """The same of damped ones in the second half: a point on its way to infinity gains little by little."""


ABSURD = 1e4
"""vᵀPv in terms of the redundancy that is absurd: all residuals are a hundred times their σ."""
_EPS = float(np.finfo(float).eps)


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
    # Near a solution steps fall faster where residuals are no larger than their σ.
    return change > 0.25 * state.iterations[-1].largest_change


def residuals_stay(before: Adjustment, after: Adjustment) -> bool:
    """True where a step has not halved vᵀPv: then what Gauss-Newton leaves out will not vanish with the residuals."""
    return after.normals.objective > 0.5 * before.normals.objective


def without_progress(iterations: tuple[Iteration, ...]) -> int:
    """Return the number of iterations since vᵀPv was last a thousandth larger than it is now."""
    objectives = [iteration.objective for iteration in iterations]
    larger = (k for k, one in enumerate(reversed(objectives)) if one > (1.0 + _STANDS) * objectives[-1])
    return next(larger, len(objectives))


def settles(iterations: tuple[Iteration, ...]) -> bool:
    """True where steps below a tenth of σ become smaller from ten iterations to the next ten, or the damping falls."""
    if len(iterations) >= 10 and iterations[-1].damping < 0.5 * iterations[-10].damping:
        return True
    steps = [iteration.largest_change for iteration in iterations[-20:]]
    return len(steps) == 20 and max(steps[10:]) < min(0.1, 0.9 * max(steps[:10]))


def stands_still(iterations: tuple[Iteration, ...], patience: Patience | None = None) -> bool:
    """Return True if iterations, twenty by default, have made neither vᵀPv smaller, nor the steps, nor the damping.

    Steps that shrink slowly, all those to come together by less than one σ, do not stand still. Nor does an iteration
    whose damping falls: its steps grow along a direction that was damped. Steps of zero are not compared: an adjustment
    in another datum that begins at the solution begins with one.
    """
    # An iteration with a vᵀPv that no network has leads to no solution, or to one with gross errors.
    absurd = bool(iterations) and iterations[-1].objective > ABSURD * max(iterations[-1].redundancy, 1)
    count, gain, damped = patience or (Patience(10, 5e-2, 5e-2) if absurd else Patience())
    if len(iterations) < 2 * count:
        return False
    earlier, later = iterations[-2 * count : -count], iterations[-count:]
    if earlier[0].objective - later[-1].objective > gain * later[-1].objective:
        return False
    if later[-1].damping and later[0].objective - later[-1].objective > damped * later[-1].objective:
        return False
    if 0.0 < later[-1].damping < 0.5 * later[0].damping and not absurd:
        return False
    steps = [iteration.largest_change for iteration in earlier if iteration.largest_change > ACCURACY]
    before, now = min(steps, default=0.0), min(iteration.largest_change for iteration in later)
    rate = (now / before) ** (1.0 / count) if before > 0.0 else 0.0
    return now > 0.5 * before and (rate >= 1.0 or now * rate / (1.0 - rate) > 1.0)


def left_after(state: Adjustment, change: float) -> float:
    """Return the sum of all steps after one of size ``change``, in units of σ; infinite without a known rate."""
    if change <= ACCURACY:
        return change
    if not state.iterations or state.iterations[-1].damping:
        return np.inf
    before = state.iterations[-1].largest_change
    rate = change / before if before > 0.0 else np.inf
    # A rate of convergence that is taken from two steps needs a margin.
    return 4.0 * change * rate / (1.0 - rate) if rate < 1.0 else np.inf


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
    digits = 16.0 * _EPS * float(np.abs(coordinates).max(initial=0.0)) * condition
    sigma = float(np.abs(step[mask]).max(initial=0.0)) / change if change > 0.0 else 0.0
    if moving <= gain * (max(ACCURACY, min(change, 1e-3)) * sigma + digits):
        return True
    # σ (for σ0 = 1) of an unknown in the datum of the inner constraints, and in the minimal datum of the
    # anchors. They are √(sᵀQs) and √Q_ii, s the row of S = I − G H Bᵀ.
    unknown = int(np.argmax(np.where(mask, np.abs(shift), 0.0)))
    null, bound = state.defect.datum, state.constraint.normals
    unit = np.zeros(len(null))
    unit[unknown] = 1.0
    row = unit - bound @ np.linalg.solve(null.T @ bound, null[unknown])
    both = np.stack([row, unit], axis=1)
    squares = np.einsum("uk,uk->k", both, state.inverse.solve(both))
    in_datum, anchored = np.sqrt(np.maximum(squares, 0.0))
    return bool(moving <= gain * (max(ACCURACY * in_datum, min(ACCURACY, change) * anchored) + digits))


def round_off(plan: Plan, values: Values, normals: NormalEquations, weak: FloatArray) -> float:
    """τ: the largest step in units of σ that is nothing but round-off of the observations and coordinates."""
    problem = plan.problem
    sizes = _sizes_of_unknowns(plan, values)
    tangent = rotation_tangents(problem.index, values)
    total = 0.0
    for row_set in plan.row_sets:
        group = problem.groups[row_set.group]
        rows = linearise_of(problem, row_set.group, values, tangent, row_set.rows)
        observed = np.nan_to_num(np.abs(group.observed[row_set.rows]))
        total += float(np.sum((row_set.weight * (observed + _moved(rows.jacobian, rows.columns, sizes))) ** 2))
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


# ---- Memory of an adjustment from its sizes, before any of it is done.
#
# The coefficients were measured: the largest resident size of the whole command, on blocks of 32 000 to 504 000 image
# points and networks of 625 to 10 000 points with up to 2 000 long ties (``python -m tests.memory``).


def memory_of_adjustment(plan: Plan) -> float:
    """Bytes that iterations and statistics take beside what is there when the plan is made."""
    elimination = plan.elimination
    others = sum(len(row_set.rows) for row_set in plan.row_sets)
    # The factor, and fronts that wait for others; the dense front of a parent and the update it gets.
    factor = float(elimination.pivots @ elimination.orders)
    waiting = 0.0 if is_limited() else factor + elimination.most_waiting
    dense = 8 * (waiting + 3 * float(elimination.largest_front) ** 2)
    kernels = 30e6 if len(plan.rays.row) else 0.0  # compiled passes over rays, which are loaded when they are needed
    # Bytes of an image point, and of another row: derivatives, residuals, and what is kept of their quality. With long
    # arrays in files mostly what is kept of the object point of an image point.
    of_ray, of_other = 80 if is_limited() else 210, 350
    buffers = 20e6
    return buffers + kernels + dense + of_ray * len(plan.rays.row) + of_other * others


# ---- The iteration: linearise, build the normal equations, take a step, until nothing moves.
#
# Steps are those of Gauss and Newton. If a full step does not gain, a damped one is taken (Levenberg and
# Marquardt, see :mod:`mor.solve.iterate`). :mod:`mor.solve.iterate` says when the iteration is over.


class SolverSettings(NamedTuple):
    """Settings of the solver."""

    max_iterations: int = 50
    """Most iterations without progress; twice as many in all."""
    patience: Patience | None = None
    gone: bool = False
    """Stop where points have moved to infinity, so that they can be directions, or are about to pass a camera."""


def adjust(
    problem: Problem, start: Values, settings: SolverSettings | None = None, watch: Watcher | None = None
) -> Adjustment:
    """Adjust from the start values. The outcome says whether it converged; nothing is raised for a bad network."""
    settings = settings or SolverSettings()
    plan = make_plan(problem, eliminable_rays(problem, start))
    check_room(
        memory_of_adjustment(plan),
        "the adjustment",
        "adjust fewer observations at a time, or parts of the network separately",
    )
    with threads_for(plan.elimination.largest_front):
        return _iterated(plan, start, settings, watch)


def _iterated(plan: Plan, start: Values, settings: SolverSettings, watch: Watcher | None) -> Adjustment:
    state = _begin(plan, start)
    while (
        state.outcome is Outcome.NOT_CONVERGED
        and (without_progress(state.iterations) < settings.max_iterations or settles(state.iterations))
        and len(state.iterations) < 2 * settings.max_iterations
    ):
        before, state = len(state.iterations), _advance(state, settings)
        if watch is not None and len(state.iterations) > before:
            watch(state.iterations[-1])
        if state.outcome is Outcome.NOT_CONVERGED and stands_still(state.iterations, settings.patience):
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
        return state._replace(outcome=Outcome.SINGULAR, reason=OPEN)
    if defect.datum.shape[1] and not datum.free:
        return state._replace(outcome=Outcome.SINGULAR, reason=NO_DATUM)
    if not binds(defect.datum, state.constraint, state.problem.index):
        return state._replace(outcome=Outcome.SINGULAR, reason=UNSETTLED)
    return state


def _advance(state: Adjustment, settings: SolverSettings) -> Adjustment:
    """One accepted step, or the end."""
    regular, weak = state.inverse.parts_of_step(state.normals)
    stride = state.stride.next(weak)
    step = regular + stride.weak
    shift, gain = _into_datum(state, step)
    change = _gain(state, regular + weak)
    if settings.gone:
        for gone, reason in zip(
            _gone(state, regular + weak), ("points have moved to infinity", PAST_CAMERAS), strict=True
        ):
            if len(gone):
                return state._replace(outcome=Outcome.DIVERGED, reason=reason, gone=gone)
    ended = is_over(state, change, state.inverse.weak)
    over = ended and is_in_datum(state, step, shift, gain, change)
    iteration = Iteration(len(state.iterations) + 1, state.normals.objective, change, 0.0, state.redundancy)
    if over and change <= ACCURACY:
        return _converged(_last_step(state, step + shift, iteration))
    taken = None if over else _with_curvature(state, change)  # steps of round-off tell no curvature
    if not over and _swings(state, shift, change):
        taken = Taken(_as_a_whole(state, moved_by(state.plan, state.values, step), shift, exactly=True), 0.0, 1.0)
    if taken is None:
        taken = accept(state, regular, stride.weak, shift, change)
    if ended and not over and (taken is None or taken.share < 1.0):  # the sum of squares is round-off here
        taken = Taken(_as_a_whole(state, state.values, shift), 0.0, 1.0)
    # At a minimum no step of any length and damping makes vᵀPv smaller. If the observations hardly determine a
    # direction there, round-off moves the network along it by up to 0.1 σ.
    if taken is None and change <= 0.1:
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
    return _converged(moved) if over else moved


def _swings(state: Adjustment, shift: FloatArray, change: float) -> bool:
    """True where the datum alone is missed, by far, after steps that are nothing: the way into it bends too much."""
    last = state.iterations[-3:]
    bends = state.problem.datum.movements is None and state.problem.datum.mask.get("point") is not None
    if not bends or len(last) < 3 or max(change, *(one.largest_change for one in last)) > ACCURACY:
        return False
    size = float(np.ptp(state.values["point"], axis=0).max())
    # From this part of the extent of a network, steps that shrink with their squares lead it into its datum.
    return float(np.abs(shift[state.constraint.mask]).max(initial=0.0)) > 1e-6 * size


def _gone(state: Adjustment, step: FloatArray) -> tuple[IntArray, IntArray]:
    """Return points (k,) at infinity, and those that pass their camera, by the step (u,) at a standstill.

    What they gain is little, but as they leave the range of their derivatives all others wait for them.
    """
    now = state.normals.objective
    if not state.iterations or state.iterations[-1].objective > (1.0 + _STANDS) * now:
        return _NO_POINTS, _NO_POINTS
    # After five damped iterations without a gain they are taken to wait for points that steps lead past cameras.
    rounds = 5
    points, last = state.plan.seen_points[0], state.iterations[-rounds:]
    waits = len(last) == rounds and all(one.damping for one in last) and last[0].objective <= (1.0 + _STANDS) * now
    # In inverse distances: a point is at infinity if a step takes so many from it; 1 if all others wait for it.
    moved = move(state.problem.index, state.values, step)
    toward = _toward_points(state.plan, state.values, moved)
    far = np.concatenate([_NO_POINTS, *(some.points[some.q > (1.0 if waits else 1e3)] for some in toward)])
    # With a larger vᵀPv a step past a camera is not the fault of a point.
    if not waits or now > 10.0 * max(last[-1].redundancy, 1):
        return far, _NO_POINTS
    passing = _passing(state, step)
    return far, passing if len(passing) <= max(1, len(points) // 100) else _NO_POINTS


def _passing(state: Adjustment, step: FloatArray) -> IntArray:
    """Return points (k,) that only rays meet and that a step (u,) leads past a camera that sees them."""
    only = np.zeros(len(state.values["point"]), dtype=bool)
    only[state.plan.seen_points[0]] = True
    there = move(state.problem.index, state.values, step)["point"]
    passing = [_NO_POINTS]
    for group in filter(is_ray, state.problem.groups):
        rows = np.flatnonzero(only[group.blocks[-1]])
        point, camera = group.blocks[-1][rows], group.blocks[0][rows]
        before, after = (places[point] - places[camera] for places in (state.values["point"], there))
        passing.append(point[np.einsum("ni,ni->n", before, after) < 0.0])
    return np.unique(np.concatenate(passing))


def _with_curvature(state: Adjustment, change: float) -> Taken | None:
    """The step with the curvature that the last steps have shown, where they creep and it is as good as it promises."""
    if not state.secants.steps or not creeps(state, change):
        return None
    step = state.secants.step(state.inverse, state.normals.rhs)
    shift, _ = _into_datum(state, step)
    return accept_whole(state, step, shift, _gain(state, step))


def _learnt(state: Adjustment, moved: Adjustment, step: FloatArray) -> Secants:
    """Return the curvature that a step (u,) has shown; nothing unless residuals stay as large as they are.

    What was known before is kept only while steps creep.
    """
    damped = moved.iterations[-1].damping > 0.0
    if damped or moved.inverse.weak.shape[1] or not residuals_stay(state, moved):
        return NOTHING_LEARNT
    known = state.secants if creeps(state, moved.iterations[-1].largest_change) else NOTHING_LEARNT
    return known.after(step, state.normals.rhs, moved.normals.rhs)


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
        secants=NOTHING_LEARNT,
        normals=state.normals.spent(),
    )


def _last_step(state: Adjustment, step: FloatArray, iteration: Iteration) -> Adjustment:
    """The solution, a step away that is so small that the system stays the same there."""
    objective_there = max(state.normals.objective - iteration.largest_change**2, 0.0)
    checked = _at_minimum(state)
    if checked.outcome is not Outcome.NOT_CONVERGED:
        return checked
    return checked._replace(
        values=moved_by(state.plan, state.values, step),
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
        return checked._replace(outcome=Outcome.NOT_CONVERGED, reason="") if checked.defect.inside else checked
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
    # With a larger condition of its movements, each of length one, a network is anchored again while it turns.
    return bool(np.linalg.cond(np.linalg.qr(movements / sizes, mode="r")) > 10.0)


def _at_minimum(state: Adjustment) -> Adjustment:
    """Return the state at the end of the iteration, with new anchors if a direction has become weak on the way."""
    checked = _with_checked_defect(state)
    if not checked.inverse.is_weak or checked.outcome is not Outcome.NOT_CONVERGED:
        return checked
    anchored = find_anchors(state.plan, state.normals)
    inverse = invert(state.plan, state.normals, state.values, *anchored)
    defect = explain_defect(inverse.null, state.problem, state.values)
    again = _with_defect(checked._replace(anchors=anchored.unknowns), inverse, defect)
    if again.outcome is not Outcome.SINGULAR:
        return again
    return _bound_by_curvature(again) or again._replace(
        reason="at the minimum of the sum of squares, a movement of the network changes no observation"
    )


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
    step = 1e-4  # in parts of the size of the network
    for k, movement in enumerate(movements.T):
        there = [
            gradient_elsewhere(state.plan, move(problem.index, state.values, sign * step * movement), state.values)
            for sign in (1.0, -1.0)
        ]
        curvature[:, k] = movements.T @ (there[1] - there[0]) / (2.0 * step)
    sizes, axes = rotations.eigh(0.5 * (curvature + curvature.T))
    if not sizes[0] > 0.0:
        return None
    weak = movements @ (axes / np.sqrt(sizes))
    if not float(np.abs(weak / units).max()) < NOTHING_KNOWN:
        return None
    none = np.zeros((problem.index.count, 0))
    defect = replace(state.defect, movements=(), datum=none, to_second_order=datum.shape[1])
    inverse = state.inverse._replace(null=none, weak=np.concatenate([state.inverse.weak, weak], axis=1))
    bound = constraint(none, problem, state.values)
    return state._replace(outcome=Outcome.NOT_CONVERGED, reason="", inverse=inverse, defect=defect, constraint=bound)


def _with_checked_defect(state: Adjustment) -> Adjustment:
    """The state with its null and weak directions worked out, where that has not been done at its values."""
    if len(state.anchors) == 0 and state.inverse.values is state.values:
        return state
    inverse = invert(state.plan, state.normals, state.values, state.anchors)
    return _with_defect(state, inverse, explain_defect(inverse.null, state.problem, state.values))


def _with_defect(state: Adjustment, inverse: Inverse, defect: Defect) -> Adjustment:
    bound = constraint(defect.datum, state.problem, state.values)
    return _judge_defect(state._replace(inverse=inverse, defect=defect, constraint=bound))
