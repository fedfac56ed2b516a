"""Solutions of the normal equations for right-hand sides that touch few points, without a pass over everything.

As in ``local_influence.py``: only the rays of the points that are touched are looked at, b_r − A_rᵀ A_p N_pp⁻¹ b_p.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.reliability.local_influence import EliminatedPoint, eliminated_points

_FEW = 2_000
"""Eliminated points up to which they are gathered one by one; a pass over all rays is quicker beyond."""


class LocalSystem(NamedTuple):
    """The normal equations, for right-hand sides and solutions at chosen unknowns."""

    adjustment: Adjustment
    columns: IntArray
    """(c,) the unknowns, each once, in ascending order."""
    points: tuple[EliminatedPoint, ...] | None
    """Those of them that are eliminated on the fly; ``None`` where they are too many."""

    def solve(self, right: FloatArray) -> FloatArray:
        """x (c, k) of N x = b at the unknowns, for b (c, k) there and 0 elsewhere, in the range of N."""
        inverse, plan, columns = self.adjustment.inverse, self.adjustment.plan, self.columns
        if self.points is None:
            whole = np.zeros((self.adjustment.problem.index.count, right.shape[1]))
            whole[columns] = right
            return inverse.solve(whole)[columns]
        kept = plan.reduced[columns] >= 0
        reduced = np.zeros((len(plan.kept), right.shape[1]))
        reduced[plan.reduced[columns[kept]]] = right[kept]
        alone = []
        for point in self.points:
            own = tolerant.solve(point.normals, right[self._at(point)])
            reduced[plan.reduced[point.others]] -= point.coupling @ own
            alone.append(own)
        reduced = inverse.scale[:, None] * inverse.factor.solve(inverse.scale[:, None] * reduced)
        x = np.zeros(right.shape)
        x[kept] = reduced[plan.reduced[columns[kept]]]
        for point, own in zip(self.points, alone, strict=True):
            back = point.coupling.T @ reduced[plan.reduced[point.others]]
            x[self._at(point)] = own - tolerant.solve(point.normals, back)
        weak = inverse.weak[columns]
        return np.asarray(x + weak @ (weak.T @ right))

    def _at(self, point: EliminatedPoint) -> IntArray:
        return np.searchsorted(self.columns, point.columns)


def local_system(adjustment: Adjustment, columns: IntArray) -> LocalSystem:
    """The system for the unknowns ``columns`` (any, −1 for what is fixed); points that are touched are in it whole."""
    index, reduced = adjustment.problem.index, adjustment.plan.reduced
    used = np.unique(columns[columns >= 0])
    blocks = np.unique(index.block_of[used[reduced[used] < 0]])
    if len(blocks) > _FEW:
        return LocalSystem(adjustment, used, None)
    used = np.union1d(used, index.columns["point"][blocks].ravel())
    points = eliminated_points(adjustment, set(blocks.tolist()))
    return LocalSystem(adjustment, used, tuple(points.values()))
