"""Step control: take the whole Gauss-Newton step if it gains, otherwise a damped one.

A step has two parts. The observations determine the *regular* part. The rest goes along directions that they determine
hardly or not at all: weak directions, and the shift of a free network into its datum. To first order this rest changes
no observation, but only to first order: a network that turns by θ along the tangent of its turn grows by θ²/2. So the
rest is taken a piece at a time, and regular steps from there lead back to the solution.

Damped steps are those of Levenberg and Marquardt, δ = (N + μ diag N)⁻¹ b. The gain ratio compares the fall of vᵀPv with
the one that the linear equations promise. It accepts a step and sets the next μ (H. B. Nielsen, *Damping parameter in
Marquardt's method*, 1999). A long step along a narrow, bent valley ends on its slope. The damped equations,
with the derivatives they have, then lead back to its floor (M. K. Transtrum, J. P. Sethna, *Improvements to the
Levenberg-Marquardt algorithm*, 2012, whose second-order correction is the first of these steps).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import similarities
from mor.adjustment.datum.weak_directions import weak_turns
from mor.adjustment.inverse import DampedStep, damped_step, invert
from mor.adjustment.normals import Normals, build_normals, gradient_elsewhere, normal_product, objective
from mor.adjustment.state import Adjustment
from mor.arrays import LARGEST, FloatArray
from mor.geometry.rotations import exponential
from mor.parameters.index import move

_CORRECTIONS = 6
"""Regular steps that lead back to the solution at most."""
_BACK = 5
"""Steps that lead back to the floor of a valley at most."""
_EXPECTED = 0.25
"""Part of the gain a step promises that it must keep."""
_LEAST_GAIN = 1e-3
"""Gain ratio from which on a damped step is taken, as in Ceres."""
_GOOD_GAIN = 0.75
"""Gain ratio from which on a damped step needs no correction."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-14, 1e12
_LARGEST_TURN = 0.5
"""Largest turn (rad) of any rotation that is tried at once along directions that hardly change the observations."""


class Taken(NamedTuple):
    """A step that was taken: where it leads, its damping, the share taken along, the system there if known."""

    values: Mapping[str, FloatArray]
    damping: float
    share: float
    normals: Normals | None = None
    next_damping: float = 0.0
    """Damping with which the next damped step begins, if this one is damped."""
    step: FloatArray | None = None
    """(u,) the step without the shift into the datum, where it is not the one of Gauss-Newton."""


def accept(
    state: Adjustment, regular: FloatArray, weak: FloatArray, shift: FloatArray, change: float
) -> Taken | None:
    """The first of the steps that makes the objective so much smaller as can be expected; ``None`` where there is none.

    The whole step nearly always does, unless the last one was damped, so the system is built there at once. It is
    expected to gain ``change``². With κ the ratio of the true curvature along it to the one that Gauss-Newton sees, it
    gains the part ρ = 2 − κ of that: where residuals are large, κ may exceed 2, and steps go to and fro. The part
    1/κ = 1/(2 − ρ) of the step then hits.
    """
    along = weak + shift
    whole = regular + along
    values = move(state.problem.index, state.values, whole)
    damped_before = bool(state.iterations) and state.iterations[-1].damping > 0.0
    normals = None if damped_before else build_normals(state.plan, values)
    reached = objective(state.plan, values) if normals is None else normals.objective
    full = Taken(values, 0.0, 1.0, normals) if reached <= _limit(state) else None
    gained = state.normals.objective - reached
    curved = state.inverse.weak.shape[1] == 0 and -1.0 < _share_of(gained, change) < _EXPECTED
    if full is not None and not (curved and change > 1.0):
        return full
    if full is None and shift.any():
        shifted = _as_a_whole(state, move(state.problem.index, state.values, regular + weak), shift)
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
        values = move(state.problem.index, state.values, share * whole)
        if objective(state.plan, values) < min(state.normals.objective, reached):
            return Taken(values, 1.0 / share - 1.0, share)
    return full or _damped(state)


def accept_whole(state: Adjustment, step: FloatArray, shift: FloatArray, change: float) -> Taken | None:
    """The step (u,) and the shift into the datum (u,), where that gains a quarter of ``change``² or more."""
    values = move(state.problem.index, state.values, step + shift)
    normals = build_normals(state.plan, values)
    gained = state.normals.objective - normals.objective
    if normals.objective <= _limit(state) and gained >= _EXPECTED * change**2 - _last_digits(state):
        return Taken(values, 0.0, 1.0, normals, step=step)
    return None


def _last_digits(state: Adjustment) -> float:
    """Differences of vᵀPv that round-off makes."""
    return 1e-12 * state.normals.objective + 1e-6


def _share_of(gained: float, change: float) -> float:
    return gained / change**2 if change > 0.0 and np.isfinite(gained) else -np.inf


def _limit(state: Adjustment) -> float:
    return state.normals.objective * (1.0 + 1e-6) + 1e-6


def _as_a_whole(
    state: Adjustment, values: Mapping[str, FloatArray], shift: FloatArray
) -> Mapping[str, FloatArray]:
    """Return values moved by the similarity of all points whose derivative is the shift (u,), as far as it is one."""
    index, moved = state.problem.index, dict(values)
    columns = index.columns["point"]
    free = columns >= 0
    if not free.any():
        return move(index, values, shift)
    centre = state.values["point"][free.any(axis=1)].mean(axis=0)
    fields = similarities(state.values["point"], centre)[free]
    lengths = np.linalg.norm(fields, axis=0)
    fields = fields / np.where(lengths > 0.0, lengths, 1.0)
    found: FloatArray = np.asarray(np.linalg.lstsq(fields, shift[columns[free]], rcond=1e-12)[0], float)
    found /= np.where(lengths > 0.0, lengths, 1.0)
    found *= min(1.0, _LARGEST_TURN / max(float(np.abs(found[3:]).max()), 1e-300))
    R, scale = exponential(found[3:6]), float(np.exp(found[6]))
    for kind, own in index.columns.items():
        change = np.where(own >= 0, shift[own], 0.0)
        touched = (change != 0.0).any(axis=1)
        if index.blocks[kind].kind.is_rotation:
            moved[kind] = np.where(touched[:, None, None], values[kind] @ R.T, values[kind])
        elif kind == "point":
            there = centre + found[:3] + scale * (values[kind] - centre) @ R.T
            moved[kind] = np.where(own >= 0, there, values[kind])
        else:
            powers = [float(one.quantity.length) for one in index.blocks[kind].kind.components]
            moved[kind] = np.where(change != 0.0, values[kind] * scale ** np.array(powers), values[kind])
    return moved


def _along(state: Adjustment, regular: FloatArray, along: FloatArray) -> Taken | None:
    """The regular step with as much of the rest as leads back to the solution.

    ``None`` where the regular step itself does not help.
    """
    index = state.problem.index
    without = move(index, state.values, regular)
    if objective(state.plan, without) > _limit(state):
        return None
    for share in _first_share(state, along) * 0.25 ** np.arange(5):
        values, before = move(index, state.values, regular + share * along), np.inf
        for _ in range(_CORRECTIONS):
            normals = build_normals(state.plan, values)
            if not normals.objective < 0.5 * before:
                break
            before = normals.objective
            inverse = invert(state.plan, normals, values, state.anchors)
            values = move(index, values, inverse.parts_of_step(normals)[0])
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
    damping, growth = max(state.damping, _LEAST_DAMPING), 2.0
    while damping < _MOST_DAMPING:
        tried = damped_step(state.plan, state.values, damping)
        values, ratio = _led_back(state, tried)
        if ratio > _LEAST_GAIN:
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

    values = move(state.problem.index, state.values, step)
    ratio = gain_ratio(values)
    for _ in range(_BACK):
        if ratio > _GOOD_GAIN or not np.isfinite(ratio):
            break
        step = step + tried.solve(gradient_elsewhere(state.plan, state.values, values) - (b - of_step))
        corrected = move(state.problem.index, state.values, step)
        better = gain_ratio(corrected)
        if not better > ratio:
            break
        values, ratio = corrected, better
    return values, ratio
