"""Do the standard deviations of an orientation hold? Σ (v/σ)² some σ away, compared with what they promise.

σ come from the linear terms of the estimate at the solution. An error of k σ costs k² of Σ (v/σ)², if they are all;
where the quadratic ones are not small beside them, Σ (v/σ)² rises otherwise. So the base is turned by three and by five
σ, either way along both axes of its error ellipse, all else is adjusted anew, and the rise is compared with 9 and 25
(the profile of the objective: D. M. Bates, D. G. Watts, Nonlinear regression analysis, 1988, chapter 6).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.coplanarity import Coplanarity, design, misfit, turned_by
from mor.approximate.vectors import cross, unit
from mor.arrays import FloatArray
from mor.geometry import tolerant

FAR = (3.0, 5.0)
"""Standard deviations by which the base is turned."""
PROMISED = 0.64
"""Part of the promised rise that must be there: what σ say is five σ are at least four."""
STEPS = 4
"""Most steps of the other four parameters; they halt where one promises less than ``ENOUGH``."""
ENOUGH = 0.5


def sigma_hold(a: Bundle, b: Bundle, chosen: Coplanarity, covariance: FloatArray) -> bool:
    """True if Σ (v/σ)² rises as ``covariance`` (6, 6) of b and δ promises, in all directions of the base."""
    values, axes = tolerant.eigh(covariance[:3, :3])
    if not max(FAR) * np.sqrt(values[2]) < 0.5 * np.pi:
        return False
    for k, far, sign in product((2, 1), FAR, (1.0, -1.0)):
        axis, sigma = axes[:, k], float(np.sqrt(max(values[k], 1e-300)))
        rest = covariance[3:, :3] @ axis / sigma**2
        step = sign * far * sigma * np.concatenate([axis, rest])
        least = _least(a, b, turned_by(chosen.base, chosen.rotation, step), axis)
        if least - chosen.objective < PROMISED * far**2:
            return False
    return True


def _least(a: Bundle, b: Bundle, start: tuple[FloatArray, FloatArray], axis: FloatArray) -> float:
    """Least Σ (v/σ)² with the base held towards ``axis`` (3,): it moves across it only, and the rotation is free."""
    base, rotation = start
    state = misfit(a, b, base, rotation)
    objective = float(state.residuals @ state.residuals)
    for _ in range(STEPS):
        across = unit(cross(base, axis))
        rows = design(state, base, rotation, across[:, None])
        step = -tolerant.lstsq(rows, state.residuals, rcond=1e-12)
        if -float(state.residuals @ (rows @ step)) < ENOUGH:
            break
        moved = turned_by(base, rotation, np.concatenate([step[0] * across, step[1:]]))
        tried = misfit(a, b, *moved)
        gain = objective - float(tried.residuals @ tried.residuals)
        if gain <= 0.0:
            break
        (base, rotation), state, objective = moved, tried, objective - gain
    return objective
