"""The datum: which null directions are free movements of the whole network, and how the datum binds them.

The inner constraint binds the total correction of the masked components to their reference,
Bᵀ(x − x₀) = 0 with B = M G, G the movements of the network at the adjusted coordinates (then the sum of squared
corrections of the masked components is the smallest), or at coordinates the datum names, usually the reference. Any
solution of a minimal datum is carried there by x ← x + G t (S-transformation), and its cofactors by Q ← S Q Sᵀ,
S = I − G (BᵀG)⁻¹ Bᵀ. Shifts and rotations of whole points lead to the same coordinates either way, scale does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import similarities
from mor.adjustment.problem import Datum, Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.parameters.index import Index, Values

_SPREAD = 1e-12
"""Least of the sizes of movements on the points of the datum, as a part of the largest."""
_SMALL_TURN = 0.1
"""Radians, or part of the scale, up to which a movement is told by its first two derivatives."""
_NEAR = 1e-2
"""Corrections in parts of the median distance of a coordinate from the centre below which movements stay the same on
the way into the datum."""


class Constraint(NamedTuple):
    """Inner constraints Bᵀ(x − x₀) = 0."""

    normals: FloatArray
    """(u, d) B."""
    mask: BoolArray
    """(u,) components that carry the datum."""


@dataclass(frozen=True)
class STransformation:
    """S = I − G H Bᵀ with H = (BᵀG)⁻¹, applied to a minimal-datum solution and to its cofactors."""

    null: FloatArray
    """(u, d) G."""
    binding: FloatArray
    """(d, d) H."""
    through: FloatArray
    """(u, d) U = Q B of the minimal datum."""
    core: FloatArray
    """(d, d) BᵀQB."""

    @cached_property
    def _bound(self) -> FloatArray:
        return self.null @ self.binding

    def correction(self, one: IntArray, other: IntArray) -> FloatArray:
        """What S Q Sᵀ adds to the cofactors Q of the unknowns one (…, k) and other (…, l): (…, k, l).

        Negative numbers stand for fixed components and yield zeros.
        """
        g, u = _rows(self._bound, one), _rows(self.through, one)
        h, w = _rows(self._bound, other), _rows(self.through, other)
        return _outer(g @ self.core, h) - _outer(g, w) - _outer(u, h)


def datum_mask(datum: Datum, index: Index) -> BoolArray:
    """(u,) the unknowns that carry the datum."""
    mask = np.zeros(index.count, dtype=bool)
    for kind, chosen in datum.mask.items():
        columns = index.columns[kind][chosen]
        mask[columns[columns >= 0]] = True
    return mask


def constraint(null: FloatArray, problem: Problem, values: Values) -> Constraint:
    """Inner constraints over the components that carry the datum, for movements (u, d) of the network at ``values``.

    Where the datum names coordinates to take the movements at, points are displaced by the same similarity there.
    """
    mask = datum_mask(problem.datum, problem.index)
    normals = np.where(mask[:, None], null, 0.0)
    chosen = problem.datum.mask.get("point")
    elsewhere = problem.datum.movements
    if chosen is None or elsewhere is None or null.shape[1] == 0:
        return Constraint(normals, mask)
    columns = problem.index.columns["point"]
    free = columns >= 0
    centre = values["point"][free.any(axis=1)].mean(axis=0)
    now = similarities(values["point"], centre)[free]
    movement = np.linalg.lstsq(now, null[columns[free]], rcond=1e-12)[0]
    used = free & chosen
    normals[columns[used]] = similarities(elsewhere["point"], centre)[used] @ movement
    return Constraint(normals, mask)


def corrections(datum: Datum, index: Index, values: Values) -> FloatArray:
    """(u,) total corrections x − x₀ of the masked unknowns, zero elsewhere."""
    total = np.zeros(index.count)
    for kind, chosen in datum.mask.items():
        columns = index.columns[kind]
        used = chosen & (columns >= 0)
        total[columns[used]] = (values[kind] - datum.reference[kind])[used]
    return total


def binds(null: FloatArray, constraint: Constraint, index: Index) -> bool:
    """Return True if the constraint determines every movement (u, d) of the network.

    The movements are made orthonormal on the points of the datum first. So the answer depends neither on the unit of
    length, nor on how the movements are combined, nor on how far away other points are.
    """
    if null.shape[1] == 0:
        return True
    columns = index.columns["point"]
    carries = ((columns >= 0) & constraint.mask[columns]).any(axis=1)
    own = columns[carries]
    triangle: FloatArray = np.asarray(np.linalg.qr(null[own[own >= 0]], mode="r"))
    spread = np.linalg.svd(triangle, compute_uv=False)
    if triangle.shape[0] < triangle.shape[1] or not spread[-1] > _SPREAD * spread[0]:
        return False
    normals, movements = (np.linalg.solve(triangle.T, matrix.T).T for matrix in (constraint.normals, null))
    size = float(np.linalg.norm(normals, axis=0).max())
    return bool(size > 0.0 and np.linalg.svd(normals.T @ movements, compute_uv=False)[-1] > 1e-9 * size)


def into_datum(
    step: FloatArray, null: FloatArray, constraint: Constraint, problem: Problem, values: Values
) -> tuple[FloatArray, float]:
    """Step (u,) from ``values`` moved along the null directions so that the total corrections satisfy the constraint.

    With it by how much more an error of the step moves it there than BᵀG says. B changes with the movements t: the
    derivative of Bᵀ(x − x₀) by them is BᵀG + K. Where x₀ is bad K is not small, and a network that is moved without it
    swings into its datum slowly, or for ever. The step is NaN if the constraint does not bind the movements here.
    """
    total = corrections(problem.datum, problem.index, values) + np.where(constraint.mask, step, 0.0)
    missing, across = constraint.normals.T @ total, constraint.normals.T @ null
    movement: FloatArray = tolerant.solve(across, missing)
    gain = 1.0
    if not np.isfinite(movement).all():
        return np.full(len(step), np.nan), gain
    bent = _bent(null, problem, values, total)
    if bent is not None:
        relative = tolerant.solve(across, bent.derivative) + np.eye(len(across))
        least = float(np.abs(tolerant.eigvals(relative)).min())
        settles = least > np.finfo(float).eps * float(np.linalg.norm(relative))
        better = tolerant.solve(relative, movement) if settles else movement
        if float(np.abs(bent.turns @ better).max(initial=0.0)) < _SMALL_TURN:
            movement, gain = better, max(1.0, 1.0 / least) if settles else 1.0
    turned: FloatArray = step - null @ movement
    return turned, gain


class _Bent(NamedTuple):
    """What changes in the movements as the network moves."""

    derivative: FloatArray
    """(d, d) K."""
    turns: FloatArray
    """(4, d) turns and scale in each movement."""


def _bent(null: FloatArray, problem: Problem, values: Values, total: FloatArray) -> _Bent | None:
    """K of the movements at ``values``; ``None`` where it is nothing beside BᵀG or no number, or B stays as it is."""
    chosen = problem.datum.mask.get("point")
    if chosen is None or problem.datum.movements is not None or null.shape[1] == 0:
        return None
    columns, points = problem.index.columns["point"], values["point"]
    used = chosen & (columns >= 0)
    within = used.any(axis=1)
    if not within.any():
        return None
    centre = points[within].mean(axis=0)
    size = float(
        np.median(np.abs(points[within] - centre))
    )  # a far point says nothing of the size of the rest
    if float(np.abs(total).max(initial=0.0)) < _NEAR * size:
        return None
    fields = similarities(points[within], centre)
    movements = np.asarray(np.linalg.lstsq(fields[used[within]], null[columns[used]], rcond=1e-12)[0], float)
    apart = np.zeros((len(fields), 3))
    apart[used[within]] = total[columns[used]]
    linear = similarities(np.eye(3), np.zeros(3))[:, :, 3:]
    with np.errstate(over="ignore", invalid="ignore"):
        by_field = np.einsum("na,nbg->abg", apart, fields) @ movements
        derivative = np.einsum("bag,abj,gk->kj", linear, by_field, movements[3:])
    return _Bent(derivative, movements[3:]) if np.isfinite(derivative).all() else None


def s_transformation(null: FloatArray, constraint: Constraint, through: FloatArray) -> STransformation:
    """S-transformation from the minimal datum with U = Q B (u, d) into the datum of the constraint."""
    binding = np.asarray(np.linalg.inv(constraint.normals.T @ null), dtype=np.float64)
    return STransformation(null, binding, through, constraint.normals.T @ through)


def _rows(matrix: FloatArray, columns: IntArray) -> FloatArray:
    return np.where((columns >= 0)[..., None], matrix[columns], 0.0)


def _outer(one: FloatArray, other: FloatArray) -> FloatArray:
    return one @ np.swapaxes(other, -1, -2)
