"""Detectable errors and their effects on the unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.contract import ObservationGroup
from mor.quality.assessment import Quality
from mor.quality.redundancy import Reliability
from mor.quality.test_statistics import comparable, in_pieces, largest_entries
from mor.solve.elimination import RayChunk, ray_chunks
from mor.solve.iterate import Adjustment
from mor.solve.normals import RowSet, add_to_others, image_of_rays, reduce_right_hand_side, reduced_columns
from mor.solve.problem import cluster_rows, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray, pieces

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    AnyMatrix = FloatArray | csr_array

# ------------------------------------------------------------
# What gross errors of chosen observations do to all unknowns.
#
# A gross error ∇ in observation i moves all unknowns by Q Aᵀ P e_i ∇, in the datum of the adjustment.


class ObservationComponent(NamedTuple):
    """One observation: group, row, component."""

    group: int
    row: int
    component: int


def movements(quality: Quality, entries: list[ObservationComponent], errors: FloatArray) -> FloatArray:
    """Movement (u, k) of all unknowns by the gross errors (k,) of k observations, in the datum of the adjustment."""
    adjustment = quality.adjustment
    right = np.zeros((adjustment.problem.index.count, len(entries)))
    for k, (entry, error) in enumerate(zip(entries, errors, strict=True)):
        columns, values = gradient(adjustment, entry)
        np.add.at(right[:, k], columns, values * error)
    moved = adjustment.inverse.solve(right)
    datum = quality.datum
    if datum.null.shape[1] == 0:
        return moved
    return np.asarray(moved - datum.null @ (datum.binding @ (adjustment.constraint.normals.T @ moved)))


def gradient(adjustment: Adjustment, entry: ObservationComponent) -> tuple[IntArray, FloatArray]:
    """Aᵀ P e of an observation: unknowns (k,) and values (k,)."""
    problem = adjustment.problem
    tangent = rotation_tangents(problem.index, adjustment.values)
    found = adjustment.plan.places_in_clusters.get((entry.group, entry.row, entry.component))
    if found is not None:
        cluster, place = found
        _, jacobian, columns = cluster_rows(adjustment.problem, cluster, adjustment.values, tangent)
        return columns, jacobian.T @ (cluster.whitening.T @ cluster.whitening[:, place])
    group = problem.groups[entry.group]
    rows = linearise(group, problem.index, adjustment.values, tangent, np.array([entry.row]))
    used = rows.columns[0] >= 0
    weight = 1.0 / group.sigma[entry.row, entry.component] ** 2
    return rows.columns[0][used], rows.jacobian[0, entry.component][used] * weight


# ---- Points that are eliminated by their own rays, without a pass over everything.
#
# N_p are the normal equations of such a point, C = A_rᵀ A_p their coupling with the unknowns of its rays. Only the rays
# of points that a right-hand side b touches are looked at:
#
#     reduced system   b_r − C N_p⁻¹ b_p,    x_r = Q_rr of it
#     the point        x_p = N_p⁻¹ (b_p − Cᵀ x_r)


class EliminatedPoints(NamedTuple):
    """P points that are eliminated during accumulation."""

    place: IntArray
    """(points,) number of each point block among them, −1 where it is not."""
    columns: IntArray
    """(P, 3) their unknowns."""
    inverse: FloatArray
    """(P, 3, 3) N_p⁻¹."""
    coupling: AnyMatrix
    """(r, 3P) C of all of them, side by side, by the reduced unknowns; sparse if there are any."""

    def alone(self, right: AnyMatrix) -> AnyMatrix:
        """N_p⁻¹ b_p (3P, k) of all of them."""
        if not len(self.inverse):
            return right
        from scipy.sparse import bsr_array

        count = np.arange(len(self.inverse) + 1)
        return bsr_array((self.inverse, count[:-1], count)).tocsr() @ right


def eliminated_points(adjustment: Adjustment, blocks: IntArray) -> EliminatedPoints:
    """Those of the point blocks that are eliminated during accumulation."""
    problem, plan = adjustment.problem, adjustment.plan
    own = problem.index.columns["point"]
    blocks = np.unique(blocks)
    blocks = blocks[(own[blocks] >= 0).all(axis=1)]
    blocks = blocks[(plan.reduced[own[blocks]] < 0).all(axis=1)]
    place = np.full(len(own), -1, dtype=np.int64)
    place[blocks] = np.arange(len(blocks))
    shape = (len(plan.kept), 3 * len(blocks))
    if not len(blocks):
        return EliminatedPoints(place, own[blocks], np.zeros((0, 3, 3)), np.zeros(shape))
    normals, coupling = np.zeros((len(blocks), 3, 3)), sparse_matrix([], shape)
    tangent = rotation_tangents(problem.index, adjustment.values)
    for group in problem.groups:
        if group.type.slots[-1].kind != "point":
            continue
        number = place[group.blocks[-1]]
        seen = np.flatnonzero(number >= 0)
        # Larger arrays than these would be had from the system again each time, which clears them first.
        for piece in pieces(len(seen), 20_000):
            rows = seen[piece]
            part = linearise(group, problem.index, adjustment.values, tangent, rows)
            weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
            J = part.jacobian * weight[:, :, None]
            by_point, by_others = J[:, :, -3:], J[:, :, :-3]
            np.add.at(normals, number[rows], by_point.transpose(0, 2, 1) @ by_point)
            others = np.where(part.columns >= 0, plan.reduced[part.columns], -1)[:, :-3, None]
            at = (3 * number[rows, None] + np.arange(3))[:, None, :]
            entries = by_others.transpose(0, 2, 1) @ by_point
            others, at = np.broadcast_to(others, entries.shape), np.broadcast_to(at, entries.shape)
            free = others >= 0
            coupling = coupling + sparse_matrix([(others[free], at[free], entries[free])], shape)
    return EliminatedPoints(place, own[blocks], np.asarray(rotations.inv(normals)), coupling)


# ---- Solutions of the normal equations for right-hand sides that touch few points.


class NormalEquationSolver(NamedTuple):
    """The normal equations, for right-hand sides and solutions at chosen unknowns."""

    adjustment: Adjustment
    columns: IntArray
    """(c,) the unknowns, each once, in ascending order."""
    points: EliminatedPoints | None
    """Those of them that are eliminated on the fly; ``None`` where they are too many."""

    def solve(self, right: FloatArray) -> FloatArray:
        """x (c, k) of N x = b at the unknowns, for b (c, k) there and 0 elsewhere, in the range of N."""
        inverse, count = self.adjustment.inverse, right.shape[1]
        if self.points is None:
            whole = np.zeros((self.adjustment.problem.index.count, count))
            whole[self.columns] = right
            return inverse.solve(whole)[self.columns]
        at_a_time = max(1, 2_000_000 // max(len(inverse.scale), 1))
        parts = [self._locally(right[:, some]) for some in pieces(max(count, 1), at_a_time)]
        return np.concatenate(parts, axis=1)

    def _locally(self, right: FloatArray) -> FloatArray:
        inverse, plan, columns = self.adjustment.inverse, self.adjustment.plan, self.columns
        assert self.points is not None
        _, reduced, alone = self._reduced(right)
        kept = plan.reduced[columns] >= 0
        x = np.zeros(right.shape)
        x[kept] = reduced[plan.reduced[columns[kept]]]
        x[self._at_points] = _dense(alone) - _dense(self.points.alone(self.points.coupling.T @ reduced))
        weak = inverse.weak[columns]
        return np.asarray(x + weak @ (weak.T @ right))

    def factors(self, right: csr_array) -> tuple[FloatArray, FloatArray]:
        """L and S (l, k) with LᵀS = bᵀ N⁻¹ b, for b (c, k) in the range of N."""
        inverse, plan = self.adjustment.inverse, self.adjustment.plan
        along = inverse.weak[self.columns].T @ right
        if self.points is None:
            whole = np.zeros((self.adjustment.problem.index.count, right.shape[1]))
            whole[self.columns] = right.toarray()
            before, alone = reduce_right_hand_side(plan, inverse.values, whole)
            after, of_points = inverse.reduced(before), whole[plan.rays.columns].reshape(-1, right.shape[1])
            return np.vstack([before, of_points, along]), np.vstack([after, alone.reshape(of_points.shape), along])
        before, after, of_touched = self._reduced(right)
        own = _dense(right[self._at_points])
        return np.vstack([before, own, along]), np.vstack([after, _dense(of_touched), along])

    def _reduced(self, right: AnyMatrix) -> tuple[FloatArray, FloatArray, AnyMatrix]:
        """b_r − C N_p⁻¹ b_p, x_r, and N_p⁻¹ b_p."""
        inverse, plan, points = self.adjustment.inverse, self.adjustment.plan, self.points
        assert points is not None
        kept = plan.reduced[self.columns] >= 0
        alone = points.alone(right[self._at_points])
        reduced = -_dense(points.coupling @ alone)
        reduced[plan.reduced[self.columns[kept]]] += _dense(right[kept])
        return reduced, inverse.reduced(reduced), alone

    @property
    def _at_points(self) -> IntArray:
        assert self.points is not None
        return np.searchsorted(self.columns, self.points.columns.ravel())


def _dense(matrix: AnyMatrix) -> FloatArray:
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


FEW_POINTS = 20_000
"""Eliminated points up to which their rays are gathered; beyond that takes more memory than passes over all rays."""


def local_system(adjustment: Adjustment, columns: IntArray) -> NormalEquationSolver:
    """The system for the unknowns ``columns`` (any, −1 for what is fixed); points that are touched are in it whole."""
    index, reduced = adjustment.problem.index, adjustment.plan.reduced
    used = np.unique(columns[columns >= 0])
    blocks = np.unique(index.block_of[used[reduced[used] < 0]])
    if len(blocks) > FEW_POINTS:
        return NormalEquationSolver(adjustment, used, None)
    used = np.union1d(used, index.columns["point"][blocks].ravel())
    return NormalEquationSolver(adjustment, used, eliminated_points(adjustment, blocks))


# ---- What gross errors do to the points next to them: x − G H (QB)ᵀ b for b = AᵀP e ∇, nonzero in a handful of places.


def point_movements(
    quality: Quality, entries: list[ObservationComponent], errors: FloatArray, points: list[list[int]]
) -> list[FloatArray]:
    """Movements (q, 3) of the point blocks listed for each entry by its gross error, in the datum of the adjustment."""
    adjustment, datum = quality.adjustment, quality.datum
    own = adjustment.problem.index.columns["point"]
    gradients = [gradient(adjustment, entry) for entry in entries]
    none = np.zeros(0, dtype=np.int64)
    touched = [*(columns for columns, _ in gradients), *(own[some].ravel() for some in points)]
    system = local_system(adjustment, np.concatenate([none, *touched]))
    right = np.zeros((len(system.columns), len(entries)))
    for k, ((columns, values), error) in enumerate(zip(gradients, errors, strict=True)):
        np.add.at(right[:, k], np.searchsorted(system.columns, columns), values * error)
    x = system.solve(right)
    x -= datum.null[system.columns] @ (datum.binding @ (datum.through[system.columns].T @ right))
    moved = []
    for k, some in enumerate(points):
        at = np.minimum(np.searchsorted(system.columns, own[some]), len(system.columns) - 1)
        moved.append(np.where(own[some] >= 0, x[at, k], 0.0).reshape(-1, 3))
    return moved


# ---- Some observations as whitened rows: W A x and (W A)ᵀ z for them alone, correlated or not.
#
# With W Σ Wᵀ = I, Q the cofactors of the unknowns and R = I − W A Q Aᵀ Wᵀ, whitened residuals W v have the
# cofactors R.


class WhitenedRows(NamedTuple):
    """N chosen observations, in the order of the groups, and of rows and components in them."""

    system: NormalEquationSolver
    """The unknowns they refer to, of which there are c."""
    places: tuple[IntArray, ...]
    """(n, m) of each group: which of the N an observation is; −1 where it is not chosen."""
    design: csr_array
    """(N, c) W A."""
    whitening: csr_array
    """(N, N) W."""

    def whitened(self, values: Sequence[FloatArray]) -> FloatArray:
        """(N,) W y, for y given as one array (n, m) for each group; what is not chosen counts as 0."""
        y = [np.zeros(0), *(own[place >= 0] for own, place in zip(values, self.places, strict=True))]
        return np.asarray(self.whitening @ np.concatenate(y))

    def residuals_of(self, z: FloatArray) -> FloatArray:
        """R z (N, k) for the chosen rows of R and z (N, k) there, 0 elsewhere."""
        return np.asarray(z - self.design @ self.system.solve(self.design.T @ z))


def whitened_rows(quality: Quality, chosen: Sequence[BoolArray]) -> WhitenedRows:
    """The chosen observations (n, m) of each group. Of a correlated cluster all have to be chosen, or none."""
    adjustment = quality.adjustment
    problem, values = adjustment.problem, adjustment.inverse.values
    tangent = rotation_tangents(problem.index, values)
    ends = np.cumsum([0, *(np.count_nonzero(mask) for mask in chosen)])
    places = tuple(np.full(mask.shape, -1, dtype=np.int64) for mask in chosen)
    for place, mask, first in zip(places, chosen, ends[:-1], strict=True):
        place[mask] = first + np.arange(np.count_nonzero(mask))
    count, alone = int(ends[-1]), [mask.copy() for mask in chosen]
    design: list[MatrixEntries] = []
    whitening: list[MatrixEntries] = []
    for cluster in adjustment.plan.clusters:
        entries = list(zip(cluster.groups, cluster.rows, cluster.components, strict=True))
        at = np.array([places[group][row, component] for group, row, component in entries])
        for group, row, component in entries:
            alone[group][row, component] = False
        inside = at >= 0
        if inside.any():
            _, jacobian, columns = cluster_rows(problem, cluster, values, tangent)
            design.append(_entries(at[inside], columns[None], (cluster.whitening @ jacobian)[inside]))
            whitening.append(_entries(at[inside], at[inside][None], cluster.whitening[np.ix_(inside, inside)]))
    for group, place, mask in zip(problem.groups, places, alone, strict=True):
        rows = np.flatnonzero(mask.any(axis=1))
        if len(rows):
            part, use = linearise(group, problem.index, values, tangent, rows), mask[rows]
            weight, at = 1.0 / group.sigma[rows][use], place[rows][use]
            columns = np.repeat(part.columns, use.sum(axis=1), axis=0)
            design.append(_entries(at, columns, part.jacobian[use] * weight[:, None]))
            whitening.append((at, at, weight))
    none = np.zeros(0, dtype=np.int64)
    system = local_system(adjustment, np.concatenate([none, *(columns for _, columns, _ in design)]))
    design = [(rows, np.searchsorted(system.columns, columns), entries) for rows, columns, entries in design]
    A = sparse_matrix(design, (count, len(system.columns)))
    return WhitenedRows(system, places, A, sparse_matrix(whitening, (count, count)))


def residuals_of_table(adjustment: Adjustment, number: int, z: FloatArray) -> FloatArray:
    """R z (n, m, k) of a table without correlations, for whitened z (n, m, k) in all of its rows and 0 elsewhere.

    Two passes over the network do it without the design matrix of the table, which takes more memory than all else.
    """
    plan, rays, count = adjustment.plan, adjustment.plan.rays, z.shape[2]
    right, below = np.zeros((adjustment.problem.index.count, count)), np.zeros((len(plan.kept), count))
    others = [(one, _white_design(adjustment, one)) for one in plan.row_sets if one.group == number]
    for own, (jacobian, columns) in others:
        free = columns >= 0
        np.add.at(below, columns[free], (np.swapaxes(jacobian, 1, 2) @ z[own.rows])[free])
    for chunk, here in _rays_of_table(adjustment, number):
        image = np.zeros((len(here), 2, count))
        image[here] = z[chunk.row[here]]
        by_point = np.swapaxes(chunk.rays.by_point, 1, 2) @ image
        right[rays.columns[chunk.points]] = np.add.reduceat(by_point, chunk.rays.point_pointers[:-1], axis=0)
        add_to_others(chunk.rays, image, below)
    right[plan.kept] += below
    x, answer = adjustment.inverse.solve(right), z.copy()
    reduced = x[plan.kept]
    for own, (jacobian, columns) in others:
        moved = np.where((columns >= 0)[:, :, None], reduced[columns], 0.0)
        answer[own.rows] -= jacobian @ moved
    for chunk, here in _rays_of_table(adjustment, number):
        answer[chunk.row[here]] -= image_of_rays(chunk.rays, reduced, x[rays.columns[chunk.points]])[here]
    return answer


def _rays_of_table(adjustment: Adjustment, number: int) -> Iterator[tuple[RayChunk, BoolArray]]:
    """Yield the chunks with rays of a table, and which of their rays these are (n,)."""
    plan = adjustment.plan
    for chunk in ray_chunks(plan.problem, plan.rays, plan.reduced, adjustment.inverse.values):
        here = chunk.group == number
        if here.any():
            yield chunk, here


def _white_design(adjustment: Adjustment, own: RowSet) -> tuple[FloatArray, IntArray]:
    problem, plan, values = adjustment.problem, adjustment.plan, adjustment.inverse.values
    part = linearise(
        problem.groups[own.group], problem.index, values, rotation_tangents(problem.index, values), own.rows
    )
    return own.weight[:, :, None] * part.jacobian, reduced_columns(part.columns, plan.reduced)


MatrixEntries = tuple[IntArray, IntArray, FloatArray]
"""Rows, columns and values of entries (e,)."""


def sparse_matrix(entries: Sequence[MatrixEntries], shape: tuple[int, int]) -> csr_array:
    """Return the matrix of all entries; those in one place are added."""
    from scipy.sparse import coo_array

    none = np.zeros(0, dtype=np.int64)
    rows, columns, values = (np.concatenate(part) for part in zip((none, none, np.zeros(0)), *entries, strict=True))
    return coo_array((values, (rows, columns)), shape=shape).tocsr()


def _entries(rows: IntArray, columns: IntArray, values: FloatArray) -> MatrixEntries:
    """Row, column and value of each entry of (n, K) that is not 0, for ``rows`` (n,) and ``columns`` (n or 1, K)."""
    columns = np.broadcast_to(columns, values.shape)
    free = (columns >= 0) & (values != 0.0)
    return np.broadcast_to(rows[:, None], values.shape)[free], columns[free], values[free]


# ---- Which point the suspicious observations move, and where to: what a gross error means for the result.


class PointEffect(NamedTuple):
    """Effect of an observation on the point that it moves most."""

    entry: ObservationComponent
    test: float
    r: float
    error: float
    """Estimated gross error."""
    smallest: float
    """Smallest detectable one."""
    point: int
    """Point block that moves most among those the observation names, −1 where it names no free point."""
    movement: FloatArray
    """(3,) its movement by the estimated error, in the datum of the adjustment, internal axes."""
    tells: bool
    """False where the estimated error says nothing: next to nothing controls the observation, and it would move the
    point by a good part of the size of the network, where no linear estimate holds."""


HARDLY_CONTROLLED = 1e-4
"""Redundancy number below which an error is estimated from less than a ten thousandth of it."""


def effects(quality: Quality) -> list[PointEffect]:
    """Effects of the flagged observations, the worst first; of the worst few where none is flagged."""
    entries = _chosen(quality)
    tested = _tested(quality, entries)
    points = [_points_of(quality, entry) for entry in entries]
    moved = point_movements(quality, entries, tested[:, 2], points)
    # No observation could cause a movement of a tenth of the network unseen.
    far = 0.1 * float(np.ptp(quality.adjustment.values["point"], axis=0).max(initial=0.0))
    return [_effect(*each, far) for each in zip(entries, tested, points, moved, strict=True)]


def _points_of(quality: Quality, entry: ObservationComponent) -> list[int]:
    """Free point blocks that an observation names; frames' own positions are not among them."""
    problem = quality.adjustment.problem
    group, columns = problem.groups[entry.group], problem.index.columns["point"]
    named = [
        int(blocks[entry.row]) for slot, blocks in group.blocks_by_slot if slot.kind == "point" and slot.of != "image"
    ]
    return [point for point in named if (columns[point] >= 0).any()]


def _chosen(quality: Quality) -> list[ObservationComponent]:
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    wanted = min(flagged, 200) or 10
    best: list[tuple[float, ObservationComponent]] = []
    for number, (one, group) in enumerate(zip(quality.reliability, quality.adjustment.problem.groups, strict=True)):
        for place, compared in _largest(one, group, wanted):
            best.append((compared, ObservationComponent(number, *divmod(place, group.observed.shape[1]))))
    best.sort(key=lambda pair: (-pair[0], pair[1]))
    return [entry for _, entry in best[:wanted]]


def _largest(tests: Reliability, group: ObservationGroup, wanted: int) -> list[tuple[int, float]]:
    """Places of the largest test values of a group, and those as they are compared; equal ones in their order."""

    def of_rows(rows: slice) -> FloatArray:
        return np.where(group.used_among(rows), np.nan_to_num(np.abs(tests.at(rows).test)), 0.0)

    places, sizes = largest_entries(group.observed.shape, of_rows, wanted)
    compared = comparable(sizes)
    order = np.argsort(-compared, kind="stable")[:wanted]
    return [(int(places[k]), float(compared[k])) for k in order if compared[k] > 0.0]


def _tested(quality: Quality, entries: list[ObservationComponent]) -> FloatArray:
    """(k, 4) test value, redundancy number, estimated and smallest detectable error of each entry."""
    groups, rows, components = np.array(entries, dtype=np.int64).reshape(-1, 3).T
    tested = np.zeros((len(entries), 4))
    for number in np.unique(groups):
        here = np.flatnonzero(groups == number)
        tests = quality.reliability[number].at(rows[here])
        place = np.arange(len(here)), components[here]
        for k, values in enumerate((tests.test, tests.quality.r, tests.error, tests.smallest)):
            tested[here, k] = values[place]
    return tested


def _effect(
    entry: ObservationComponent, tested: FloatArray, points: list[int], moved: FloatArray, far: float
) -> PointEffect:
    lengths = np.linalg.norm(moved, axis=1)
    most = int(np.argmax(lengths)) if points else -1
    test, r, error, smallest = tested.tolist()
    return PointEffect(
        entry,
        test,
        r,
        error,
        smallest,
        points[most] if points else -1,
        moved[most] if points else np.zeros(3),
        tells=r >= HARDLY_CONTROLLED or not points or float(lengths[most]) <= far,
    )


# ---- Points that rest on an observation: more than half of their variance, in some direction, comes from it.
#
# An error of σ_i in observation i moves a point by x = (Q Aᵀ P)_i σ_i. Of the variance of the point in any
# direction it has the share of the square of that movement, at most xᵀ Q_pp⁺ x, which is 1 where nothing else
# determines it.

_FLAT = 1e-10
"""Part of the largest variance of a point below which it has none in a direction."""


def most_at_a_time(quality: Quality) -> int:
    """Observations whose movements of all unknowns have room."""
    return max(1, 2_000_000 // max(quality.adjustment.problem.index.count, 1))


def _least_eigenvalues(Q: FloatArray) -> FloatArray:
    """(p,) bounds from below of the eigenvalues of cofactor matrices (p, 3, 3), 0 of singular ones.

    The product of two of the three is at most the square of half of their sum.
    """
    trace = np.trace(Q, axis1=1, axis2=2)
    determinant = np.einsum("pi,pi->p", Q[:, :, 0], np.cross(Q[:, :, 1], Q[:, :, 2]))
    above = np.maximum(determinant - _FLAT * trace**3, 0.0)  # without what round-off does to the determinant
    return 0.5 * np.asarray(4.0 * np.divide(above, trace**2, out=np.zeros(len(Q)), where=trace > 0.0))


def carried_points(quality: Quality, entries: list[ObservationComponent]) -> list[IntArray]:
    """Point blocks that each of the observations carries, those first that it carries most of."""
    if not entries:
        return []
    problem = quality.adjustment.problem
    columns = problem.index.columns["point"]
    sigma = np.array([problem.groups[e.group].sigma[e.row, e.component] for e in entries])
    moved = movements(quality, entries, sigma)
    Q = quality.cofactors["point"]
    least = in_pieces((len(Q),), lambda rows: _least_eigenvalues(np.nan_to_num(Q[rows])))
    found = []
    for k in range(len(entries)):
        x = np.where(columns >= 0, moved[columns, k], 0.0)
        some = np.flatnonzero(np.einsum("pi,pi->p", x, x) >= least)
        share = np.sum(np.einsum("pij,pj->pi", _inverse_roots(np.nan_to_num(Q[some])), x[some]) ** 2, axis=1)
        carried = share > 0.5
        order = np.argsort(-np.round(share[carried], 6), kind="stable")
        found.append(some[carried][order])
    return found


def _inverse_roots(Q: FloatArray) -> FloatArray:
    """(p, 3, 3) roots of the pseudo-inverses of cofactor matrices."""
    eigenvalues, axes = rotations.eigh(Q)
    used = eigenvalues > _FLAT * np.maximum(eigenvalues[:, -1:], 1e-300)
    scale = np.where(used, 1.0 / np.sqrt(np.where(used, eigenvalues, 1.0)), 0.0)
    return np.asarray(scale[:, :, None] * np.swapaxes(axes, 1, 2))
