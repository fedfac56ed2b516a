"""Which part of a step is taken, so that no step makes anything worse: whole, along a curve, or damped.

A step has two parts. The *regular* one the observations determine. The rest goes along directions in which they do so
hardly, or not at all: weak directions, and the shift of a free network into its datum. To first order it changes no
observation, but only to first order: a network that turns by θ along the tangent of its turn grows by θ²/2. So such a
part is taken a piece at a time, and regular steps from there lead back to the solution: a way along the curve on which
the network turns as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mor.adjustment.inverse import damped_step, invert
from mor.adjustment.normals import Normals, build_normals, objective
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray
from mor.parameters.index import move

_CORRECTIONS = 3
"""Regular steps that lead back to the solution at most."""
_EXPECTED = 0.25
"""Part of the gain a step promises that it must keep."""
_LARGEST_TURN = 0.5
"""Largest turn (rad) of any rotation that is tried at once along directions that hardly change the observations."""


class Taken(NamedTuple):
    """A step that was taken: where it leads, its damping, the share taken along, the system there if known."""

    values: Mapping[str, FloatArray]
    damping: float
    share: float
    normals: Normals | None = None
    step: FloatArray | None = None
    """(u,) the step without the shift into the datum, where it is not the one of Gauss-Newton."""


def accept(state: Adjustment, regular: FloatArray, along: FloatArray, change: float) -> Taken | None:
    """The first of the steps that makes the objective so much smaller as can be expected; ``None`` where there is none.

    The whole step nearly always does, so the system is built there at once. The whole step is expected to gain
    ``change``². With κ the ratio of the true curvature along it to the one that Gauss-Newton sees, it gains the part
    ρ = 2 − κ of that: where residuals are large, κ may exceed 2, and steps go to and fro. The part 1/κ = 1/(2 − ρ) of
    the step then hits.
    """
    whole = regular + along
    values = move(state.problem.index, state.values, whole)
    normals = build_normals(state.plan, values)
    full = Taken(values, 0.0, 1.0, normals) if normals.objective <= _limit(state) else None
    gained = state.normals.objective - normals.objective
    curved = state.inverse.weak.shape[1] == 0 and -1.0 < _share_of(gained, change) < _EXPECTED
    if full is not None and not (curved and change > 1.0):
        return full
    if full is None and along.any() and (taken := _along(state, regular, along)) is not None:
        return taken
    if curved:
        share = 1.0 / (2.0 - _share_of(gained, change))
        values = move(state.problem.index, state.values, share * whole)
        if objective(state.plan, values) < min(state.normals.objective, normals.objective):
            return Taken(values, 1.0 / share - 1.0, share)
    return full or _damped(state)


def accept_whole(state: Adjustment, step: FloatArray, shift: FloatArray, change: float) -> Taken | None:
    """The step (u,) and the shift into the datum (u,), where that gains a quarter of ``change``² or more."""
    values = move(state.problem.index, state.values, step + shift)
    normals = build_normals(state.plan, values)
    gained = state.normals.objective - normals.objective
    if normals.objective <= _limit(state) and gained >= _EXPECTED * change**2 - _last_digits(state):
        return Taken(values, 0.0, 1.0, normals, step)
    return None


def _last_digits(state: Adjustment) -> float:
    """Differences of vᵀPv that round-off makes."""
    return 1e-12 * state.normals.objective + 1e-6


def _share_of(gained: float, change: float) -> float:
    return gained / change**2 if change > 0.0 and np.isfinite(gained) else -np.inf


def _limit(state: Adjustment) -> float:
    return state.normals.objective * (1.0 + 1e-6) + 1e-6


def _along(state: Adjustment, regular: FloatArray, along: FloatArray) -> Taken | None:
    """The regular step with as much of the rest as leads back to the solution.

    ``None`` where the regular step itself does not help.
    """
    index = state.problem.index
    without = move(index, state.values, regular)
    if objective(state.plan, without) > _limit(state):
        return None
    for share in _first_share(state, along) * 0.25 ** np.arange(6):
        values = move(index, state.values, regular + share * along)
        for _ in range(_CORRECTIONS):
            normals = build_normals(state.plan, values)
            if not np.isfinite(normals.objective):
                break
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
    """The least damped step that makes the objective smaller, and by no mere fraction of what it promises."""
    damping = max(state.iterations[-1].damping * 0.1, 1e-6) if state.iterations else 1e-6
    fallback = None
    while damping < 1e6:
        tried = damped_step(state.plan, state.values, damping)
        values = move(state.problem.index, state.values, tried.step)
        gained = tried.objective - objective(state.plan, values)
        if gained > _EXPECTED * tried.gain:
            return Taken(values, damping, 1.0)
        if gained > 0.0 and fallback is None:
            fallback = Taken(values, damping, 1.0)
        damping *= 10.0
    return fallback
