"""The factorised normal equations: solution, selected inverse, local precision, changed weights."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg

from mor.linalg.block_matrix import BlockMatrix
from mor.linalg.cholesky import Factor, factorise
from mor.linalg.selected_inverse import selected_inverse
from mor.linalg.symbolic import Elimination
from mor.model.parameters import Values
from mor.solve.elimination import ray_residuals
from mor.solve.engine import Put, in_lanes
from mor.solve.normals import (
    NormalEquations,
    Plan,
    build_normals,
    full_directions,
    full_step,
    image_of,
    normal_product,
    reduce_right_hand_side,
)
from mor.solve.problem import ClusterRows, Problem, linearise, misclosures, misclosures_of, rotation_tangents
from mor.solve.rays import Measurements, RayPlan
from mor.types import AnyIntArray, FloatArray, IntArray

# ---- The solved system: factorisation, directions that are null or nearly so, steps and cofactors.
#
# A few unknowns are *anchored*: N' = N + C Cᵀ, C their unit vectors in units of the scaled system, as many as
# there are directions the observations hardly determine. N' is regular and as sparse as N. With Y = N'⁻¹ C, T
# = CᵀY and M = YᵀNY (formed from A Y itself, hence exact) it follows that M = T (I − T), and in the common
# eigenvectors w of M and T
#
#     M w = 0     : g = Y w is a null vector of N,
#     M w = m w   : a weak direction, and N⁻¹ = N'⁻¹ + Σ (Y w)(Y w)ᵀ t/m gives back exactly what the anchors took.
#
# So nothing weak is lost, nothing singular is hidden, and which unknowns are anchored changes no result.

HARDLY_DETERMINED = 1e-8
"""‖A g‖²/‖g‖² below which a direction is anchored, so that the factorisation keeps its accuracy."""


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
        if rhs.size == 0:
            return rhs.copy()
        columns = rhs.reshape(len(rhs), -1)
        if len(self.plan.rays.columns) == 0:
            x = self.reduced(columns)
        else:
            reduced, alone = reduce_right_hand_side(self.plan, self.values, columns)
            x = full_directions(self.plan, self.values, self.reduced(reduced))
            x[self.plan.rays.columns] += alone
        if self.weak.shape[1]:
            x = x + self.weak @ (self.weak.T @ columns)
        return x.reshape(rhs.shape)

    def step(self, normals: NormalEquations) -> FloatArray:
        """Gauss-Newton step (u,) of normal equations whose reduced right-hand side is there already."""
        regular, weak = self.parts_of_step(normals)
        return regular + weak

    def parts_of_step(self, normals: NormalEquations) -> tuple[FloatArray, FloatArray]:
        """The Gauss-Newton step (u,) without the weak directions, and (u,) along them."""
        reduced = self.reduced(normals.reduced_rhs[:, None])[:, 0]
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

    def reduced(self, rhs: FloatArray) -> FloatArray:
        """A solution (n, k) of the reduced system for a right-hand side (n, k), without the weak directions."""
        anchored: FloatArray = self.scale[:, None] * self.factor.solve(self.scale[:, None] * rhs)
        return anchored


class Anchored(NamedTuple):
    """Unknowns that are anchored, and the factor of the scaled matrix with them."""

    unknowns: IntArray
    factor: Factor


def invert(
    plan: Plan, normals: NormalEquations, values: Values, anchors: IntArray, factor: Factor | None = None
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
    # Round-off leaves some 1e-22 of ‖A g‖²/‖g‖² of a null vector g, columns scaled to unit diagonal.
    is_null = eigenvalues < 1e-17 * np.sum((Y @ vectors) ** 2, axis=0)
    share = np.einsum("kw,kw->w", vectors, Y[anchors] @ vectors)
    directions = full @ vectors
    weak = directions[:, ~is_null] * np.sqrt(share[~is_null] / eigenvalues[~is_null])
    return Inverse(plan, values, factor, scale, directions[:, is_null], weak)


def invert_alike(plan: Plan, normals: NormalEquations, values: Values, anchors: IntArray) -> Inverse:
    """Factorise where the anchors are known to hold null vectors and nothing else, as they did near by."""
    scale = _unit_diagonal(normals)
    factor = _factorised(plan, normals, scale, anchors)
    held = scale[:, None] * factor.solve(unit_vectors(normals.matrix, anchors))
    return Inverse(
        plan, values, factor, scale, full_directions(plan, values, held), np.zeros((plan.problem.index.count, 0))
    )


def _factorised(plan: Plan, normals: NormalEquations, scale: FloatArray, anchors: IntArray) -> Factor:
    return factorise(with_diagonal(normals.matrix.scaled(scale), anchors, 1.0), plan.elimination)


def find_anchors(plan: Plan, normals: NormalEquations) -> Anchored:
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
    probes = np.random.default_rng(1984).standard_normal((unknowns, min(12, unknowns)))
    for _ in range(2):
        before = probes
        probes, triangle = np.linalg.qr(factor.solve(before))
    gram = scipy.linalg.solve_triangular(triangle, before.T @ probes, trans="T")  # N' probes = before · triangle⁻¹
    eigenvalues, vectors = scipy.linalg.eigh(0.5 * (gram + gram.T))
    return probes @ vectors[:, eigenvalues < HARDLY_DETERMINED]


def _released(matrix: BlockMatrix, factor: Factor) -> FloatArray:
    """One direction (u, k) for each set-aside unknown: itself 1, all else as the factor answers."""
    units = unit_vectors(matrix, factor.set_aside)
    answer = factor.solve(matrix.multiply(units))
    answer[factor.set_aside] = 0.0
    return units - answer


def _spread_out(directions: FloatArray) -> IntArray:
    """Return unknowns, one for each direction (u, k) with a length, on which these differ most (pivoted QR)."""
    sizes = np.linalg.norm(directions, axis=0)
    directions, sizes = directions[:, sizes > 0.0], sizes[sizes > 0.0]
    if directions.shape[1] == 0:
        return np.zeros(0, dtype=np.int64)
    normed = directions / sizes
    _, _, order = scipy.linalg.qr(np.linalg.qr(normed)[0].T, mode="economic", pivoting=True)
    return np.sort(order[: directions.shape[1]]).astype(np.int64)


def _unit_diagonal(normals: NormalEquations) -> FloatArray:
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


# ---- What its own observations say of a few unknowns while all others are held: σ, and how well they fit.
#
# At given values the block of the normal matrix that belongs to the unknowns of one thing, a point or a pose,
# is inverted by itself; nothing is solved for. Misclosures are observed − computed at these values, in units
# of σ.


class Local(NamedTuple):
    """Rows of n things with up to k unknowns each."""

    sigma: FloatArray
    """(n, k) σ a priori, everything else held; NaN where the own observations do not determine the thing."""
    misfit: FloatArray
    """(n,) root mean square of the misclosures in units of their σ; NaN where there are no observations."""
    observations: IntArray
    """(n,) observations that depend on the thing."""


def local_precision(problem: Problem, values: Values, columns: IntArray) -> Local:
    """Precision of things whose unknowns are ``columns`` (n, k), −1 where there are fewer.

    An unknown may belong to one thing only. Correlations between observations are not looked at.
    """
    count, size = columns.shape
    owner, place = np.full((2, problem.index.count + 1), -1, dtype=np.int64)
    thing, slot = np.nonzero(columns >= 0)
    owner[columns[thing, slot]], place[columns[thing, slot]] = thing, slot
    normal, squares = np.zeros((count, size, size)), np.zeros(count)
    observations = np.zeros(count, dtype=np.int64)
    for jacobian, misclosure, column in _weighted(problem, values):
        whose = np.where(column >= 0, owner[column], -1)
        for first in range(whose.shape[1]):
            mine = np.flatnonzero(whose[:, first] >= 0)
            one = whose[mine, first]
            _add_products(normal, jacobian[mine], whose[mine], place[column[mine]], first)
            # A thing that several columns of a row belong to counts the row once.
            fresh = ~(whose[mine, :first] == one[:, None]).any(axis=1)
            seen = misclosure[mine[fresh]]
            np.add.at(squares, one[fresh], np.nansum(seen**2, axis=1))
            np.add.at(observations, one[fresh], np.isfinite(seen).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        misfit = np.sqrt(squares / observations)
    used = columns >= 0
    diagonal = np.sqrt(np.einsum("nii->ni", normal))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    scaled = normal / (scale[:, :, None] * scale[:, None, :]) + np.where(used, 0.0, 1.0)[:, :, None] * np.eye(
        normal.shape[1]
    )
    sound = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~sound] = np.eye(normal.shape[1])
    sound &= np.linalg.eigvalsh(scaled)[:, 0] > 1e-10
    scaled[~sound] = np.eye(normal.shape[1])
    sigma = np.sqrt(np.einsum("nii->ni", np.linalg.inv(scaled))) / scale
    return Local(np.where(used & sound[:, None], sigma, np.nan), misfit, observations)


def _weighted(problem: Problem, values: Values) -> Iterator[tuple[FloatArray, FloatArray, IntArray]]:
    """Jacobians and misclosures in units of σ, NaN in the misclosure where nothing counts, and their columns.

    What depends on a value that is missing does not count.
    """
    tangent = rotation_tangents(problem.index, values)
    rows_at_a_time = 50_000
    for group in problem.groups:
        for start in range(0, group.count, rows_at_a_time):
            rows = np.arange(start, min(start + rows_at_a_time, group.count))
            found = linearise(group, problem.index, values, tangent, rows)
            counts = group.used_among(rows)
            counts &= np.isfinite(found.jacobian).all(axis=2) & np.isfinite(found.misclosure)
            with np.errstate(divide="ignore", invalid="ignore"):
                weight = np.where(counts, 1.0 / group.sigma[rows], 0.0)
            weighted = np.where(counts[:, :, None], found.jacobian, 0.0) * weight[:, :, None]
            yield weighted, np.where(counts, found.misclosure * weight, np.nan), found.columns


def _add_products(normal: FloatArray, jacobian: FloatArray, whose: IntArray, place: IntArray, first: int) -> None:
    size = normal.shape[1]
    for other in range(whose.shape[1]):
        same = np.flatnonzero(whose[:, first] == whose[:, other])
        if len(same):
            products = np.sum(jacobian[same, :, first] * jacobian[same, :, other], axis=1)
            cell = (whose[same, first] * size + place[same, first]) * size + place[same, other]
            np.add.at(normal.reshape(-1), cell, products)


# ---- Residuals in units of σ and weights multiplied by factors, within the plan of an adjustment: nothing is
# sorted again.
#
# Factors are one array (n, m) for each observation group. Correlated observations keep their correlations: a
# factor f on the weight divides σ by √f, so that whitening W becomes W diag(√f).

Factors = Sequence[FloatArray]


def normalised_misclosures(plan: Plan, values: Values) -> tuple[FloatArray, ...]:
    """(observed − computed)/σ of every group (n, m), 0 where not observed; correlated ones each by its own σ."""
    problem = plan.problem
    found = tuple(np.zeros(group.observed.shape) for group in problem.groups)

    def put(number: int, rows: AnyIntArray, misclosure: FloatArray) -> None:
        found[number][rows] = misclosure

    in_lanes(plan, 0, _misclosures_of_rays, values, put=put)
    for row_set in plan.row_sets:
        misclosure = misclosures_of(problem, row_set.group, values, row_set.rows)
        seen = row_set.weight > 0.0
        found[row_set.group][row_set.rows] = np.where(seen, row_set.weight * misclosure, 0.0)
    for cluster in plan.clusters:
        sigma = _sigmas(cluster)
        for number in np.unique(cluster.groups):
            here = cluster.groups == number
            rows, components = cluster.rows[here], cluster.components[here]
            misclosure = misclosures(problem.groups[number], values, rows)
            own = misclosure[np.arange(len(rows)), components]
            found[number][rows, components] = own / sigma[here]
    return found


def _misclosures_of_rays(plan: Plan, rays: RayPlan, put: Put, values: Values) -> None:
    for chunk, residual in ray_residuals(plan.problem, rays, values):
        rows = rays.row[chunk.rays]
        group_of_ray = rays.group_of_frame[chunk.frames[rays.frame[chunk.rays]]]
        for group in rays.frames.groups:
            here = group_of_ray == group.group
            put(group.group, rows[here], -residual[here])


def _sigmas(cluster: ClusterRows) -> FloatArray:
    """(k,) standard deviations of the entries: Σ = W⁻¹W⁻ᵀ."""
    root = np.linalg.inv(cluster.whitening)
    sigma: FloatArray = np.linalg.norm(root, axis=1)
    return sigma


def reweighted_plan(plan: Plan, factors: Factors) -> Plan:
    """The plan with weights multiplied by factors (n, m) of each group."""
    roots = [np.sqrt(factor) for factor in factors]
    row_sets = tuple(
        row_set._replace(weight=row_set.weight * roots[row_set.group][row_set.rows]) for row_set in plan.row_sets
    )
    return replace(
        plan,
        rays=_reweighted_rays(plan, roots),
        row_sets=row_sets,
        clusters=tuple(_reweighted_cluster(cluster, roots) for cluster in plan.clusters),
    )


def _reweighted_rays(plan: Plan, roots: Factors) -> RayPlan:
    rays = plan.rays
    if len(rays.row) == 0:
        return rays
    kept = rays.measurements
    observed = kept.observed if kept.row is None else kept.observed[kept.row]
    weight = np.empty((len(rays.row), 2))
    group_of_ray = rays.group_of_frame[rays.frame_of_ray]
    for own in rays.frames.groups:
        here = group_of_ray == own.group
        group, rows = plan.problem.groups[own.group], rays.row[here]
        seen = np.isfinite(group.observed[rows])
        weight[here] = np.where(seen, roots[own.group][rows] / group.sigma[rows], 0.0)
    measured = observed if kept.measured is kept.observed else kept.measured
    return rays._replace(measurements=Measurements(observed, weight, measured, kept.clock))


def _reweighted_cluster(cluster: ClusterRows, roots: Factors) -> ClusterRows:
    own = np.array(
        [
            roots[group][row, component]
            for group, row, component in zip(cluster.groups, cluster.rows, cluster.components, strict=True)
        ]
    )
    return cluster._replace(whitening=cluster.whitening * own)
