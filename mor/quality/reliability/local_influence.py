"""What gross errors do to the points next to them, without a pass over everything.

An observation has few unknowns, and a point that only rays meet is eliminated by its own rays alone. So with
b = AᵀP e ∇, nonzero in a handful of places, only the rays of that one point are looked at:

    reduced system   b_r − A_rᵀ A_p N_pp⁻¹ b_p,    x_r = Q_rr of it
    the point        x_p = N_pp⁻¹ (b_p − A_pᵀ A_r x_r)
    into the datum   x − G H (QB)ᵀ b
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.assess import Quality
from mor.quality.reliability.influence_on_unknowns import Entry, gradient

_NUMBERS = 4_000_000
"""Numbers of right-hand sides at a time. More are fresh memory with every array: to clear it takes most of the time."""


class EliminatedPoint(NamedTuple):
    """The rays of one eliminated point."""

    columns: IntArray
    """(3,) its unknowns."""
    normals: FloatArray
    """(3, 3)."""
    others: IntArray
    """(k,) unknowns of all its rays, each once."""
    coupling: FloatArray
    """(k, 3) A_rᵀ A_p."""


def point_movements(
    quality: Quality, entries: list[Entry], errors: FloatArray, points: list[list[int]]
) -> list[FloatArray]:
    """Movements (q, 3) of the point blocks listed for each entry by its gross error, in the datum of the adjustment."""
    eliminated = eliminated_points(quality.adjustment, {p for some in points for p in some})
    some = max(1, _NUMBERS // max(len(quality.adjustment.plan.kept), 1))
    parts = (slice(first, first + some) for first in range(0, len(entries), some))
    return [
        moved
        for part in parts
        for moved in _movements(quality, entries[part], errors[part], points[part], eliminated)
    ]


def _movements(
    quality: Quality,
    entries: list[Entry],
    errors: FloatArray,
    points: list[list[int]],
    eliminated: Mapping[int, EliminatedPoint],
) -> list[FloatArray]:
    """The same of some entries, with the rays of all eliminated points that are listed."""
    adjustment, plan = quality.adjustment, quality.adjustment.plan
    right = np.zeros((len(plan.kept), len(entries)))
    sparse: list[tuple[IntArray, FloatArray]] = []
    for k, (entry, error) in enumerate(zip(entries, errors, strict=True)):
        columns, values = gradient(adjustment, entry)
        values = values * error
        sparse.append((columns, values))
        inside = plan.reduced[columns] >= 0
        np.add.at(right[:, k], plan.reduced[columns[inside]], values[inside])
        for point in points[k]:
            if point in eliminated:
                rays = eliminated[point]
                own = _at(columns, values, rays.columns)
                back = rays.coupling @ tolerant.solve(rays.normals, own)
                np.subtract.at(right[:, k], plan.reduced[rays.others], back)
    inverse = adjustment.inverse
    reduced = inverse.scale[:, None] * inverse.factor.solve(inverse.scale[:, None] * right)
    result = []
    for k, some in enumerate(points):
        columns, values = sparse[k]
        along_weak = inverse.weak[columns].T @ values
        shift = quality.datum.binding @ (quality.datum.through[columns].T @ values)
        moved = []
        for point in some:
            own = adjustment.problem.index.columns["point"][point]
            x = _solution(plan.reduced, own, eliminated.get(point), reduced[:, k], columns, values)
            free = own >= 0
            x[free] += inverse.weak[own[free]] @ along_weak - quality.datum.null[own[free]] @ shift
            moved.append(x)
        result.append(np.array(moved).reshape(-1, 3))
    return result


def _solution(
    numbers: IntArray,
    own: IntArray,
    rays: EliminatedPoint | None,
    reduced: FloatArray,
    columns: IntArray,
    values: FloatArray,
) -> FloatArray:
    """(3,) x of a point in the minimal datum."""
    if rays is not None:
        back = rays.coupling.T @ reduced[numbers[rays.others]]
        return np.asarray(tolerant.solve(rays.normals, _at(columns, values, rays.columns) - back))
    return np.where(own >= 0, reduced[numbers[np.maximum(own, 0)]], 0.0)


def _at(columns: IntArray, values: FloatArray, wanted: IntArray) -> FloatArray:
    """Values at the wanted columns, 0 where there is none."""
    return np.array([float(values[columns == column].sum()) for column in wanted])


def eliminated_points(adjustment: Adjustment, points: set[int]) -> dict[int, EliminatedPoint]:
    """Rays of those of the points that are eliminated on the fly."""
    problem, plan = adjustment.problem, adjustment.plan
    own = problem.index.columns["point"]
    chosen = [p for p in sorted(points) if (own[p] >= 0).all() and (plan.reduced[own[p]] < 0).all()]
    place = np.full(len(own), -1, dtype=np.int64)
    place[chosen] = np.arange(len(chosen))
    tangent = rotation_tangents(problem.index, adjustment.values)
    parts: list[list[tuple[FloatArray, FloatArray, IntArray]]] = [[] for _ in chosen]
    for group in problem.groups:
        slot = group.type.slots[-1]
        if not chosen or slot.kind != "point":
            continue
        rows = np.flatnonzero(place[group.blocks[-1]] >= 0)
        if len(rows) == 0:
            continue
        part = linearise(group, problem.index, adjustment.values, tangent, rows)
        weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
        jacobian = part.jacobian * weight[:, :, None]
        for i, row in enumerate(rows):
            parts[place[group.blocks[-1][row]]].append(
                (jacobian[i, :, -3:], jacobian[i, :, :-3], part.columns[i, :-3])
            )
    return {p: _gathered(own[p], parts[k]) for k, p in enumerate(chosen)}


def _gathered(own: IntArray, rays: list[tuple[FloatArray, FloatArray, IntArray]]) -> EliminatedPoint:
    others = np.unique(np.concatenate([columns[columns >= 0] for _, _, columns in rays]))
    normals, coupling = np.zeros((3, 3)), np.zeros((len(others), 3))
    for by_point, by_others, columns in rays:
        normals += by_point.T @ by_point
        free = columns >= 0
        np.add.at(coupling, np.searchsorted(others, columns[free]), by_others[:, free].T @ by_point)
    return EliminatedPoint(own, normals, others, coupling)
