"""Points that are eliminated by their own rays, many at once: N⁻¹ and N⁻¹Cᵀ of each.

As ``quality/reliability/local_influence.py`` has them one by one: N the normal equations of a point, C their coupling
with the unknowns of its rays. Rows of all points are as long as the longest, filled up with zeros.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

_RAYS = 20_000
"""At a time: larger arrays than these make are had from the system anew each time, which clears them first."""
_POINTS = 200


class Eliminated(NamedTuple):
    """P eliminated points."""

    place: IntArray
    """(points,) number of each point block among them, −1 where it is not."""
    columns: IntArray
    """(P, 3) their unknowns."""
    inverse: FloatArray
    """(P, 3, 3) N⁻¹."""
    others: IntArray
    """(P, k) reduced unknowns of their rays; 0 where there are less than k."""
    back: FloatArray
    """(P, 3, k) N⁻¹Cᵀ, 0 there."""
    parts: tuple[tuple[IntArray, int], ...]
    """Points that are worked on together, by how many unknowns their rays have, and the most of them."""

    def put_solutions(
        self, found: FloatArray, reduced: FloatArray, chosen: IntArray, right: FloatArray
    ) -> None:
        """Put what they do (u, m) where the reduced unknowns do x (r, m), with right-hand sides (c, 3, m) of some."""
        for some, most in self.parts:
            found[self.columns[some]] = -(self.back[some, :, :most] @ reduced[self.others[some, :most]])
        found[self.columns[chosen]] += self.inverse[chosen] @ right

    def cofactors(self, reduced: FloatArray) -> FloatArray:
        """(P, 3, 3) N⁻¹ + N⁻¹Cᵀ Q_rr C N⁻¹."""
        found = self.inverse.copy()
        for some, most in self.parts:
            others, back = self.others[some, :most], self.back[some, :, :most]
            inner = reduced[others[:, :, None], others[:, None, :]]
            found[some] += back @ inner @ back.transpose(0, 2, 1)
        return found


def eliminated(adjustment: Adjustment, blocks: IntArray) -> Eliminated:
    """Those of the point blocks that are eliminated on the fly."""
    problem, plan = adjustment.problem, adjustment.plan
    own = problem.index.columns["point"]
    blocks = np.unique(blocks)
    blocks = blocks[(own[blocks] >= 0).all(axis=1)]
    blocks = blocks[(plan.reduced[own[blocks]] < 0).all(axis=1)]
    place = np.full(len(own), -1, dtype=np.int64)
    place[blocks] = np.arange(len(blocks))
    normals = np.zeros((len(blocks), 3, 3))
    keys, values = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    size = len(plan.kept)
    tangent = rotation_tangents(problem.index, adjustment.values)
    for group in problem.groups:
        if not len(blocks) or group.type.slots[-1].kind != "point":
            continue
        number = place[group.blocks[-1]]
        seen = np.argsort(number, kind="stable")[int((number < 0).sum()) :]
        for first in range(0, len(seen), _RAYS):
            rows = seen[first : first + _RAYS]
            part = linearise(group, problem.index, adjustment.values, tangent, rows)
            weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
            J = part.jacobian * weight[:, :, None]
            by_point, by_others = J[:, :, -3:], J[:, :, :-3]
            normals += _summed(number[rows], by_point.transpose(0, 2, 1) @ by_point, len(blocks))
            coupling = by_others.transpose(0, 2, 1) @ by_point
            others = part.columns[:, :-3]
            free = others >= 0
            key = number[rows, None] * size + plan.reduced[np.maximum(others, 0)]
            keys.append(key[free])
            values.append(coupling[free])
    inverse = np.asarray(tolerant.inv(normals), dtype=np.float64)
    return Eliminated(place, own[blocks], inverse, *_padded(inverse, keys, values, size))


def _summed(number: IntArray, parts: FloatArray, count: int) -> FloatArray:
    """(count, 3, 3) sums of matrices (n, 3, 3) by their numbers (n,)."""
    flat = parts.reshape(len(parts), 9)
    sums = np.stack([np.bincount(number, flat[:, k], count) for k in range(9)], axis=1)
    return np.asarray(sums.reshape(count, 3, 3))


def _padded(
    inverse: FloatArray, keys: list[IntArray], values: list[FloatArray], size: int
) -> tuple[IntArray, FloatArray, tuple[tuple[IntArray, int], ...]]:
    """Unknowns (P, k) of the rays of each point, each once, N⁻¹Cᵀ (P, 3, k), and the parts to work in."""
    key = np.concatenate(keys)
    order = np.argsort(key, kind="stable")  # rays come by point: few runs to merge
    key = key[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    coupling = np.concatenate(values)[order]
    if len(first) < len(key):  # unknowns that several rays of a point share
        key, coupling = key[first], np.add.reduceat(coupling, first, axis=0)
    point, other = np.divmod(key, size)
    begin = np.searchsorted(point, np.arange(len(inverse) + 1))
    count = np.diff(begin)
    point = np.repeat(np.arange(len(inverse)), count)
    within = np.arange(len(other)) - begin[point]
    most = int(count.max(initial=0))
    others = np.zeros((len(inverse), most), dtype=np.int64)
    padded = np.zeros((len(inverse), most, 3))
    others[point, within], padded[point, within] = other, coupling
    order = (
        np.lexsort((others[:, 0], count)) if most else np.argsort(count)
    )  # neighbours meet the same cofactors
    parts = [order[first : first + _POINTS] for first in range(0, len(order), _POINTS)]
    return (
        others,
        inverse @ padded.transpose(0, 2, 1),
        tuple((some, int(count[some].max())) for some in parts),
    )
