"""What Gauss-Newton leaves out of the curvature, residual times second derivative, learnt from the steps themselves.

Where residuals are large and stay so, steps shrink by a constant rate, or do not shrink at all: along a direction in
which the true curvature is κ times that of N, a step leaves 1 − κ of itself. A step s that was taken changed b = AᵀPl
by −y = b' − b, and y is the true curvature times s, whatever it consists of. N⁻¹ with the last few such pairs put
into it (C. G. Broyden, R. Fletcher, D. Goldfarb, D. F. Shanno; by the two loops of J. Nocedal 1980) is the inverse of
the true curvature as far as these directions go: a few wrong observations bend few. Only pairs with sᵀy > 0 count.
"""

from __future__ import annotations

from typing import NamedTuple

from mor.adjustment.inverse import Inverse
from mor.arrays import FloatArray
from mor.long_arrays import kept

_KEPT = 6
"""Pairs that are remembered at most: half of the unknowns of a point or pose and its neighbour."""
_CURVED = 1e-3
"""Part of sᵀb from which on sᵀy says something of a curvature."""


class Secants(NamedTuple):
    """The last steps, and how much of b = AᵀPl each of them took away."""

    steps: tuple[FloatArray, ...] = ()
    """(u,) each, the latest last."""
    taken_away: tuple[FloatArray, ...] = ()
    """(u,) each: y = b before − b after."""

    def after(self, step: FloatArray, before: FloatArray, now: FloatArray) -> Secants:
        """With a step (u,) that has led from b = ``before`` to ``now``; what it contradicts is forgotten."""
        change = before - now
        if not step @ change > _CURVED * abs(float(step @ before)):
            return NOTHING_LEARNT
        steps, taken_away = (*self.steps, kept(step)), (*self.taken_away, kept(change))
        return Secants(steps[-_KEPT:], taken_away[-_KEPT:])

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
