"""The solved system: factorisation, directions that are null or nearly so, steps and cofactors.

A few unknowns are *anchored*: N' = N + C Cᵀ, C their unit vectors in units of the scaled system, as many as there are
directions the observations hardly determine. N' is regular and as sparse as N. With Y = N'⁻¹ C, T = CᵀY and M = YᵀNY
(formed from A Y itself, hence exact) it follows that M = T (I − T), and in the common eigenvectors w of M and T

    M w = 0     : g = Y w is a null vector of N,
    M w = m w   : a weak direction, and N⁻¹ = N'⁻¹ + Σ (Y w)(Y w)ᵀ t/m gives back exactly what the anchors took.

So nothing weak is lost, nothing singular is hidden, and which unknowns are anchored changes no result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from mor.adjustment.normals import Normals, build_normals, image_of, normal_product
from mor.adjustment.plan import Plan
from mor.adjustment.rays.point_solutions import full_directions, full_step, reduce_right_hand_side
from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Values
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.cholesky import Factor, factorise
from mor.sparse.selected_inverse import selected_inverse
from mor.sparse.symbolic_factorisation import Elimination

NULL = 1e-17
"""‖A g‖²/‖g‖² of a null vector, columns scaled to unit diagonal; round-off leaves some 1e-22."""
HARDLY_DETERMINED = 1e-8
"""‖A g‖²/‖g‖² below which a direction is anchored, so that the factorisation keeps its accuracy."""
_PROBES = 12


class Inverse(NamedTuple):
    """A factorised normal system."""

    plan: Plan
    values: Values
    factor: Factor
    """Factor of the reduced system, anchored."""
    scale: FloatArray
    """(n,) 1/√N_ii of the reduced unknowns."""
    null: FloatArray
    """(u, d) null vectors, in the units of the unknowns."""
    weak: FloatArray
    """(u, w) weak directions, scaled so that weak·weakᵀ is their part of the cofactors."""

    @property
    def is_weak(self) -> bool:
        """True if a pivot shows a direction that the observations hardly determine and no anchor holds."""
        return self.factor.smallest_pivot < HARDLY_DETERMINED

    def solve(self, rhs: FloatArray) -> FloatArray:
        """A solution x of N x = rhs, (u,) or (u, k), for a right-hand side in the range of N."""
        columns = rhs.reshape(len(rhs), -1)
        if columns.shape[1] == 0:
            return rhs.copy()
        if len(self.plan.rays.columns) == 0:
            x = self._reduced(columns)
        else:
            reduced, alone = reduce_right_hand_side(self.plan, self.values, columns)
            x = full_directions(self.plan, self.values, self._reduced(reduced))
            x[self.plan.rays.columns] += alone
        if self.weak.shape[1]:
            x = x + self.weak @ (self.weak.T @ columns)
        return x.reshape(rhs.shape)

    def step(self, normals: Normals) -> FloatArray:
        """Gauss-Newton step (u,) of normal equations whose reduced right-hand side is there already."""
        regular, weak = self.parts_of_step(normals)
        return regular + weak

    def parts_of_step(self, normals: Normals) -> tuple[FloatArray, FloatArray]:
        """The Gauss-Newton step (u,) without the weak directions, and (u,) along them."""
        reduced = self._reduced(normals.reduced_rhs[:, None])[:, 0]
        return full_step(self.plan, self.values, reduced), self.weak @ (self.weak.T @ normals.rhs)

    def refined(self, null: FloatArray) -> FloatArray:
        """Null vectors (u, d) with the round-off of the normal equations taken out of them.

        Out of the factorisation they come with errors of round-off times the condition of N. An unknown that no
        movement changes, the principal point say, then moves by 1e-14 of a metre; multiplied with the cofactors of
        the minimal datum, which are large, this would be the largest error of all in another datum.
        """
        product = normal_product(self.plan, self.values, null)
        return null - self.solve(product)

    def selected(self, watch: Callable[[float], None] | None = None) -> BlockMatrix:
        """Cofactors of the reduced unknowns at the stored pattern, without the part of the weak directions.

        ``watch`` is told how many more operations are done.
        """
        return selected_inverse(self.factor, watch).scaled(self.scale)

    def _reduced(self, rhs: FloatArray) -> FloatArray:
        anchored: FloatArray = self.scale[:, None] * self.factor.solve(self.scale[:, None] * rhs)
        return anchored


class Anchored(NamedTuple):
    """Unknowns that are anchored, and the factor of the scaled matrix with them."""

    unknowns: IntArray
    factor: Factor


def invert(
    plan: Plan, normals: Normals, values: Values, anchors: IntArray, factor: Factor | None = None
) -> Inverse:
    """Split what the anchors (k,) hold into null and weak directions.

    ``factor``: the one of :func:`find_anchors`; without it the system is factorised here.
    """
    scale = _unit_diagonal(normals)
    factor = factor or _factorised(plan, normals, scale, anchors)
    Y = factor.solve(unit_vectors(normals.matrix, anchors))
    if len(anchors) == 0:
        none = np.zeros((plan.problem.index.count, 0))
        return Inverse(plan, values, factor, scale, none, none)
    full = full_directions(plan, values, scale[:, None] * Y)
    eigenvalues, vectors = _stretches(plan, values, full)
    is_null = eigenvalues < NULL * np.sum((Y @ vectors) ** 2, axis=0)
    share = np.einsum("kw,kw->w", vectors, Y[anchors] @ vectors)
    directions = full @ vectors
    weak = directions[:, ~is_null] * np.sqrt(share[~is_null] / eigenvalues[~is_null])
    return Inverse(plan, values, factor, scale, directions[:, is_null], weak)


def invert_alike(plan: Plan, normals: Normals, values: Values, anchors: IntArray) -> Inverse:
    """Factorise where the anchors are known to hold null vectors and nothing else, as they did near by."""
    scale = _unit_diagonal(normals)
    factor = _factorised(plan, normals, scale, anchors)
    held = scale[:, None] * factor.solve(unit_vectors(normals.matrix, anchors))
    return Inverse(
        plan,
        values,
        factor,
        scale,
        full_directions(plan, values, held),
        np.zeros((plan.problem.index.count, 0)),
    )


def _factorised(plan: Plan, normals: Normals, scale: FloatArray, anchors: IntArray) -> Factor:
    return factorise(with_diagonal(normals.matrix.scaled(scale), anchors, 1.0), plan.elimination)


def find_anchors(plan: Plan, normals: Normals) -> Anchored:
    """Unknowns to anchor: vanishing pivots first, then whatever inverse iteration still finds hardly determined."""
    return anchors_of(normals.matrix.scaled(_unit_diagonal(normals)), plan.elimination)


def anchors_of(matrix: BlockMatrix, elimination: Elimination) -> Anchored:
    """Unknowns to anchor of a matrix whose columns are scaled: see :func:`find_anchors`."""
    anchors = np.zeros(0, dtype=np.int64)
    for _ in range(matrix.structure.unknowns):
        factor = factorise(with_diagonal(matrix, anchors, 1.0), elimination)
        directions = factor.solve(unit_vectors(matrix, anchors))
        loose = (
            _released(matrix, factor)
            if len(factor.set_aside)
            else _hardly_determined(matrix.structure.unknowns, factor)
        )
        if loose.shape[1] == 0:
            return Anchored(anchors, factor)
        anchors = _spread_out(np.concatenate([directions, loose], axis=1))
    return Anchored(anchors, factorise(with_diagonal(matrix, anchors, 1.0), elimination))


class DampedStep(NamedTuple):
    """A Levenberg-Marquardt step (u,), the objective before it, and bᵀδ: what it gains at least, to first order."""

    step: FloatArray
    objective: float
    gain: float
    solve: Callable[[FloatArray], FloatArray]
    """Returns (N + μ diag N)⁻¹ b (u,) for a right-hand side b (u,)."""


def damped_step(plan: Plan, values: Values, damping: float) -> DampedStep:
    """Return the step δ = (N + μ diag N)⁻¹ b; unknowns that no observation contains stay."""
    normals = build_normals(plan, values, damping)
    scale = _unit_diagonal(normals)
    factor = factorise(normals.matrix.scaled(scale), plan.elimination, tolerance=1e-16)
    reduced = scale * factor.solve(scale * normals.reduced_rhs)
    step = full_step(plan, values, reduced, damping)

    def solve(rhs: FloatArray) -> FloatArray:
        below, alone = reduce_right_hand_side(plan, values, rhs[:, None], damping)
        x = full_directions(plan, values, scale[:, None] * factor.solve(scale[:, None] * below), damping)
        x[plan.rays.columns] += alone
        return np.asarray(x[:, 0])

    return DampedStep(step, normals.objective, float(step @ normals.rhs), solve)


def _stretches(plan: Plan, values: Values, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (k,) and eigenvectors (k, k) of GᵀNG for directions G (u, k), small ones beside large ones exact.

    An eigenvalue is as good as round-off of the largest one; what the start values left weak and the solution
    determines well must not blur what is null. Hence the small ones are worked out once more among themselves.
    """
    eigenvalues, vectors = scipy.linalg.eigh(image_of(plan, values, directions))
    small = eigenvalues < 1e-6 * eigenvalues[-1]
    if eigenvalues[-1] > HARDLY_DETERMINED and small.any():
        among, turned = scipy.linalg.eigh(image_of(plan, values, directions @ vectors[:, small]))
        eigenvalues[small], vectors[:, small] = among, vectors[:, small] @ turned
    return eigenvalues, vectors


def _hardly_determined(unknowns: int, factor: Factor) -> FloatArray:
    """Directions (n, k) with gᵀN'g small against ‖g‖², by block inverse iteration from seeded random probes.

    The factor is that of N', with the anchors there are: what they hold already must not be found again.
    """
    probes = np.random.default_rng(1984).standard_normal((unknowns, min(_PROBES, unknowns)))
    for _ in range(2):
        before = probes
        probes, triangle = np.linalg.qr(factor.solve(before))
    gram = scipy.linalg.solve_triangular(
        triangle, before.T @ probes, trans="T"
    )  # N' probes = before · triangle⁻¹
    eigenvalues, vectors = scipy.linalg.eigh(0.5 * (gram + gram.T))
    return probes @ vectors[:, eigenvalues < HARDLY_DETERMINED]


def _released(matrix: BlockMatrix, factor: Factor) -> FloatArray:
    """One direction (u, k) for each set-aside unknown: itself 1, all else as the factor answers."""
    units = unit_vectors(matrix, factor.set_aside)
    answer = factor.solve(matrix.multiply(units))
    answer[factor.set_aside] = 0.0
    return units - answer


def _spread_out(directions: FloatArray) -> IntArray:
    """As many unknowns as directions (u, k), such that the directions differ most on them (pivoted QR)."""
    if directions.shape[1] == 0:
        return np.zeros(0, dtype=np.int64)
    normed = directions / np.linalg.norm(directions, axis=0)
    _, _, order = scipy.linalg.qr(np.linalg.qr(normed)[0].T, mode="economic", pivoting=True)
    return np.sort(order[: directions.shape[1]]).astype(np.int64)


def _unit_diagonal(normals: Normals) -> FloatArray:
    diagonal = normals.diagonal
    scale: FloatArray = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return scale


def unit_vectors(matrix: BlockMatrix, unknowns: IntArray) -> FloatArray:
    """(n, k) the unit vectors of some unknowns (k,)."""
    units = np.zeros((matrix.structure.unknowns, len(unknowns)))
    units[unknowns, np.arange(len(unknowns))] = 1.0
    return units


def with_diagonal(matrix: BlockMatrix, unknowns: IntArray, amount: float) -> BlockMatrix:
    """The matrix with an amount added to the diagonal at some unknowns (k,)."""
    if len(unknowns) == 0:
        return matrix
    structure = matrix.structure
    block = np.searchsorted(structure.offsets, unknowns, side="right") - 1
    within = unknowns - structure.offsets[block]
    values = matrix.values.copy()
    values[structure.position[structure.indptr[block]] + within * (structure.sizes[block] + 1)] += amount
    return BlockMatrix(structure, values)
