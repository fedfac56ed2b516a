"""Redundancy numbers and the influence of observations on positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from mor import long_arrays
from mor.linalg import compilation
from mor.linalg.block_matrix import BlockMatrix, row_cofactors
from mor.linalg.compilation import compile_kernel
from mor.linalg.selected_inverse import operations
from mor.model import rotations
from mor.model.contract import OUT, ObservationGroup
from mor.model.images import FOLLOWER_TYPES, IMAGE_TYPES, MOVING_TYPES
from mor.model.parameters import Values
from mor.quality.test_statistics import CONTROLLED, Correlated, ObservationQuality, in_pieces, joint_statistic
from mor.solve.datum import STransformation
from mor.solve.elimination import RayChunk, Split, ray_chunks, ray_residuals, split
from mor.solve.elimination import cofactors as ray_cofactors
from mor.solve.engine import Put, in_lanes
from mor.solve.iterate import Adjustment
from mor.solve.normals import Plan, RowClusters, RowSet, image_of_rays, point_of_ray, reduced_columns
from mor.solve.problem import (
    AlikeClusters,
    Linearised,
    linearise,
    linearised_parts,
    misclosures,
    rotation_tangents,
    spread,
)
from mor.solve.rays import Chunk, RayPlan
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray, SmallestIntArray, SmallIntArray

# ---- Kernels that note the quality of rays: what ``redundancy`` does for all observations, for millions of rays.


@compile_kernel
def fill(
    rows: SmallIntArray,
    place: IntArray,
    weight: FloatArray,
    white: FloatArray,
    shares: FloatArray,
    by_point: FloatArray,
    controlled: float,
    v: FloatArray,
    absorbed: FloatArray,
    carried: FloatArray,
    joint: FloatArray,
    freedom: SmallestIntArray,
) -> None:
    """Set the quality of the rays at ``place`` (k,) of a chunk, which are these rows (n, 2) and (n,) of their group.

    ``white`` (n, 2, 2) are the cofactors of the whitened computed values, ``shares`` (n, 2) what of an error of 1 goes
    into their points, ``by_point`` (n, 2, 3) the whitened derivatives by these, ``weight`` (n, 2) is 1/σ; the residuals
    v are there already. Eigenvalues of the joint test below ``controlled`` are left out. ``joint`` and ``freedom`` have
    one column for the row, or one for each component.
    """
    for k in range(rows.size):
        row, i = rows[k], place[k]
        w, z = weight[i, 0], weight[i, 1]
        a = 1.0 - white[i, 0, 0] if w != 0.0 else 0.0
        c = 1.0 - white[i, 1, 1] if z != 0.0 else 0.0
        b = -white[i, 0, 1] if w != 0.0 and z != 0.0 else 0.0
        x, y = v[row, 0] * w if w != 0.0 else 0.0, v[row, 1] * z if z != 0.0 else 0.0
        mean, half = 0.5 * (a + c), 0.5 * (a - c)
        radius = np.sqrt(half * half + b * b)
        large, small = mean + radius, mean - radius
        total, count = 0.0, 0
        if small > controlled:
            total = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
            count = 2
        elif large > controlled:  # along the axis of the larger eigenvalue alone
            along = (a - small) * x * x + 2.0 * b * x * y + (c - small) * y * y
            total = along / ((large - small) * large)
            count = 1
        joint[row], freedom[row] = total, count
        for m in range(2):
            if weight[i, m] != 0.0:
                absorbed[row, m] = white[i, m, m]
                a, b, c = by_point[i, m, 0], by_point[i, m, 1], by_point[i, m, 2]
                slope = np.sqrt(a * a + b * b + c * c)
                carried[row, m] = shares[i, m] * weight[i, m] / slope if slope > 0.0 else 0.0


@compile_kernel
def note_residuals(
    rows: SmallIntArray, place: IntArray, weight: FloatArray, residual: FloatArray, v: FloatArray
) -> None:
    """Set the residuals v (n, 2) in these rows (k,) from the whitened ones at ``place``; NaN where nothing is seen."""
    for k in range(rows.size):
        row, i = rows[k], place[k]
        for m in range(2):
            v[row, m] = residual[i, m] / weight[i, m] if weight[i, m] > 0.0 else np.nan


@compile_kernel
def add_directions_kernel(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    own: FloatArray,
    through_frames: FloatArray,
    through: FloatArray,
    shares: FloatArray,
) -> None:
    """Add a own (A through)ᵀ to the shares (n, 2) of rays: what a minimal datum and weak directions keep from them.

    Directions ``own`` and ``through`` are given on the points (p, 3, d), through on the frames (f, d, K) too.
    """
    width, count = by_others.shape[2], own.shape[2]
    for p in range(pointers.size - 1):
        for i in range(pointers[p], pointers[p + 1]):
            x, y, of_frame = by_others[i, 0], by_others[i, 1], through_frames[frame[i]]
            a, b, c = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
            d, e, f = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
            of_x, of_y = 0.0, 0.0
            for m in range(count):
                row, s, t = of_frame[m], 0.0, 0.0
                for k in range(width):
                    s += x[k] * row[k]
                    t += y[k] * row[k]
                one, two, three = through[p, 0, m], through[p, 1, m], through[p, 2, m]
                s += a * one + b * two + c * three
                t += d * one + e * two + f * three
                one, two, three = own[p, 0, m], own[p, 1, m], own[p, 2, m]
                of_x += s * (a * one + b * two + c * three)
                of_y += t * (d * one + e * two + f * three)
            shares[i, 0] += of_x
            shares[i, 1] += of_y


# ---- What an error of 1 in an observation does to its points: what EP, the influence on position, is made of.
#
# An error ∇ in observation i moves all unknowns by x = Q Aᵀ P e_i ∇ in the datum of the adjustment. What it *carries*
# into its points is, with a' the derivatives of the observation by the coordinates that count,
#
#     a' x/∇ = a' (Q Aᵀ P)_i    for all terrestrial observations: every free coordinate counts; angles are
#   multiplied by
#                               the length of the sight,
#     a' x/∇ / |∂x/∂X|          for image coordinates: their object point counts, the projection centre does
#   not. It is
#                               the movement of the point across the ray.
#
# The cofactors Q of the factorisation are those of a minimal datum without the weak directions. As A G = 0
# for the null vectors G, all that is missing in Q Aᵀ is a sum of few directions:
#
#     S Q Sᵀ Aᵀ = Q Aᵀ + own (A through)ᵀ,    own = (weak, −G H),  through = (weak, Q B)    with S = I − G H Bᵀ.

OF_IMAGES = frozenset(kind.key for kinds in (IMAGE_TYPES, FOLLOWER_TYPES, MOVING_TYPES) for kind in kinds.values())
"""Keys of the observation types that are image coordinates of a point, their last block."""


class WeakDirections(NamedTuple):
    """Contribution (u, k) of weak directions and datum to Q Aᵀ: own (A through)ᵀ."""

    own: FloatArray
    through: FloatArray

    def added(self, own: FloatArray, jacobian: FloatArray, columns: IntArray) -> FloatArray:
        """a' own (A through)ᵀ (n, m) for rows with a' and A (n, m, K) and their columns (n, K), −1 where fixed."""
        free = (columns >= 0)[:, :, None]
        parts = (np.where(free, array[columns], 0.0) for array in self)
        moved, image = (form @ part for form, part in zip((own, jacobian), parts, strict=True))
        added: FloatArray = np.sum(moved * image, axis=2)
        return added


def directions(adjustment: Adjustment, datum: STransformation) -> WeakDirections:
    """Return the part missing in the cofactors of the factorisation, for the datum of the adjustment."""
    weak = adjustment.inverse.weak
    return WeakDirections(
        np.concatenate([weak, -datum.null @ datum.binding], axis=1), np.concatenate([weak, datum.through], axis=1)
    )


def counted_columns(adjustment: Adjustment, number: int, rows: IntArray, columns: IntArray) -> BoolArray:
    """(n, K) those of the columns of the rows of a group whose movement counts."""
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    if group.type.key not in OF_IMAGES:
        is_point = np.array([kind == "point" for kind in index.unknown_kind])
        return np.asarray((columns >= 0) & is_point[index.kind_of[np.maximum(columns, 0)]])
    target = index.columns["point"][group.blocks[-1][rows]]
    counted: BoolArray = (columns[:, :, None] == target[:, None, :]).any(axis=2) & (columns >= 0)
    return counted


def add_directions(plan: Plan, lane: RayPlan, chunk: RayChunk, extra: WeakDirections, shares: FloatArray) -> None:
    """Add to the shares (n, 2) of the rays of a chunk what the minimal datum lacks, in place."""
    if extra.own.shape[1] == 0:
        return
    rays, columns = chunk.rays, lane.columns[chunk.points]
    own, through = (np.ascontiguousarray(array[columns]) for array in extra)
    reduced = extra.through[plan.kept]
    if compilation.wanted():
        of_frames = np.where((rays.columns >= 0)[:, :, None], reduced[rays.columns], 0.0)
        of_frames = np.ascontiguousarray(np.swapaxes(of_frames, 1, 2))
        arrays = rays.by_point, rays.by_others, rays.frame, rays.point_pointers
        add_directions_kernel(*arrays, own, of_frames, through, shares)
        return
    image = image_of_rays(rays, reduced, through)
    shares += np.sum((rays.by_point @ own[point_of_ray(rays)]) * image, axis=2)


def lengths_of_rows(
    adjustment: Adjustment, number: int, rows: IntArray, jacobian: FloatArray, columns: IntArray
) -> FloatArray:
    """The same (n, m) for rows of a group with Jacobians (n, m, K); 0 for image coordinates of points that are held."""
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    if group.type.key not in OF_IMAGES:
        return length_of_sight(adjustment, number, rows)
    target = index.columns["point"][group.blocks[-1][rows]]
    if not np.array_equal(columns[:, -3:], target):  # held throughout, and left out of the columns
        return np.zeros(jacobian.shape[:2])
    slope = np.linalg.norm(jacobian[:, :, -3:], axis=2)
    return _quotient(np.ones_like(slope), slope)


def _quotient(above: FloatArray, below: FloatArray) -> FloatArray:
    quotient: FloatArray = np.divide(above, below, out=np.zeros_like(below), where=below > 0.0)
    return quotient


def length_of_sight(adjustment: Adjustment, number: int, rows: IntArray) -> FloatArray:
    """(n, m) length of the sight for angular components of the rows, 1 for all others."""
    group = adjustment.problem.groups[number]
    positions = [
        adjustment.values["point"][blocks[rows]]
        for slot, blocks in group.blocks_by_slot
        if slot.kind == "point" and slot.part == "position"
    ]
    angular = group.type.wraps
    if len(positions) < 2 or not angular.any():
        return np.ones((len(rows), group.observed.shape[1]))
    along = positions[-1] - positions[0]
    horizontal, slope = np.hypot(along[:, 0], along[:, 1]), np.linalg.norm(along, axis=1)
    columns = [
        (horizontal if component in group.type.turns else slope) if turns else np.ones(len(slope))
        for component, turns in enumerate(angular)
    ]
    return np.stack(columns, axis=1)


# ---- Quality of correlated observations, which have a covariance matrix of their own: all alike clusters at once.


def cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    alike: AlikeClusters,
    quality: tuple[ObservationQuality, ...],
    tangent: FloatArray | None,
    extra: WeakDirections,
) -> dict[int, Correlated]:
    """Quality of the entries of alike clusters, by group; what errors carry is set in ``quality``."""
    plan = adjustment.plan
    rows = _derivatives(adjustment, alike, tangent)
    both = np.concatenate([rows.jacobian, rows.own], axis=1)
    q = row_cofactors(cofactors, plan.target.block_of, both, plan.reduced[alike.columns])
    k = rows.jacobian.shape[1]
    image = rows.jacobian @ adjustment.inverse.weak[alike.columns]
    adjusted = q[:, :k, :k] + image @ np.swapaxes(image, 1, 2)
    moved = rows.own @ extra.own[alike.columns]
    through = q[:, k:, :k] + moved @ np.swapaxes(rows.jacobian @ extra.through[alike.columns], 1, 2)
    precision = np.swapaxes(alike.whitening, 1, 2) @ alike.whitening
    weighted = np.einsum("nij,nj->ni", precision, rows.v(quality))
    weighted_cofactors = precision - precision @ adjusted @ precision
    joint, freedom = _joint_of_clusters(alike, weighted, weighted_cofactors, np.sqrt(_diagonal(precision)))
    of_entries = _of_entries(
        adjusted, precision, rotations.inv(precision), weighted, weighted_cofactors, joint, freedom
    )
    carried = (np.sum(through * precision, axis=2) * rows.length).ravel()
    found = {}
    for part in alike.parts:
        place = part.rows[part.row], part.component
        quality[part.group].carried[place] = carried[part.entry]
        own = {name: values.ravel()[part.entry] for name, values in of_entries.items()}
        found[part.group] = Correlated(place[0], place[1], **own)
    return found


def row_cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    clusters: RowClusters,
    quality: ObservationQuality,
    tangent: FloatArray | None,
    extra: WeakDirections,
) -> dict[int, Correlated]:
    """The same of all clusters of a group that are single rows, together; quality is that of the group."""
    number = clusters.group
    rows, own, q = _row_cofactors(adjustment, cofactors, number, clusters.rows, tangent)
    m = rows.jacobian.shape[1]
    image = rows.jacobian @ _of_columns(adjustment.inverse.weak, rows.columns)
    adjusted = q[:, :m, :m] + image @ np.swapaxes(image, 1, 2)
    moved = own @ _of_columns(extra.own, rows.columns)
    through = q[:, m:, :m] + moved @ np.swapaxes(rows.jacobian @ _of_columns(extra.through, rows.columns), 1, 2)
    precision = np.swapaxes(clusters.whitening, 1, 2) @ clusters.whitening
    length = lengths_of_rows(adjustment, number, clusters.rows, rows.jacobian, rows.columns)
    carried = np.sum(through * precision, axis=2) * length
    here = _diagonal(precision) > 0.0
    row, component = np.nonzero(here)
    place = clusters.rows[row], component
    quality.carried[place] = carried[here]
    weighted = np.einsum("nij,nj->ni", precision, np.where(here, quality.v[clusters.rows], 0.0))
    weighted_cofactors = precision - precision @ adjusted @ precision
    # Of what is not observed the variance is 1, apart from all else, so that the others have theirs.
    apart = precision + np.eye(m) * ~here[:, None, :]
    scale = np.sqrt(_diagonal(apart))
    joint, freedom = joint_statistic(
        weighted / scale, weighted_cofactors / (scale[:, :, None] * scale[:, None, :]), here
    )
    of_row = (np.broadcast_to(values[:, None], here.shape) for values in (joint, freedom))
    of_entries = _of_entries(adjusted, precision, rotations.inv(apart), weighted, weighted_cofactors, *of_row)
    return {number: Correlated(place[0], place[1], **{name: values[here] for name, values in of_entries.items()})}


def _of_entries(
    adjusted: FloatArray,
    precision: FloatArray,
    covariance: FloatArray,
    weighted: FloatArray,
    weighted_cofactors: FloatArray,
    joint: FloatArray,
    freedom: FloatArray,
) -> dict[str, FloatArray]:
    """Values (n, k) of :class:`Correlated` from matrices (n, k, k) of n clusters and what is known of their entries."""
    diagonal = _diagonal(precision)
    return {
        "r": 1.0 - _diagonal(adjusted @ precision),
        "q_adjusted": _diagonal(adjusted),
        "q_residual": np.maximum(_diagonal(covariance - adjusted), 0.0),
        "weighted": weighted,
        "precision": diagonal,
        "q_weighted": np.clip(_diagonal(weighted_cofactors), 0.0, diagonal),
        "joint": joint,
        "freedom": freedom,
    }


def _row_cofactors(
    adjustment: Adjustment, cofactors: BlockMatrix, number: int, chosen: IntArray, tangent: FloatArray | None
) -> tuple[Linearised, FloatArray, FloatArray]:
    """Equations of rows of a group, J by the counted columns alone (k, m, c), and (J; J') Q (J; J')ᵀ (k, 2m, 2m)."""
    plan, problem = adjustment.plan, adjustment.problem
    rows = linearise(problem.groups[number], problem.index, adjustment.inverse.values, tangent, chosen)
    own = np.where(counted_columns(adjustment, number, chosen, rows.columns)[:, None, :], rows.jacobian, 0.0)
    both = np.concatenate([rows.jacobian, own], axis=1)
    q = row_cofactors(cofactors, plan.target.block_of, both, reduced_columns(rows.columns, plan.reduced))
    return rows, own, q


def _of_columns(directions: FloatArray, columns: IntArray) -> FloatArray:
    return np.where((columns >= 0)[:, :, None], directions[columns], 0.0)


class _Derivatives(NamedTuple):
    """Derivatives of n clusters with k entries and c unknowns each."""

    jacobian: FloatArray
    """(n, k, c)."""
    own: FloatArray
    """(n, k, c) by the coordinates whose movement counts, 0 elsewhere."""
    length: FloatArray
    """(n, k) factors to lengths."""
    alike: AlikeClusters

    def v(self, quality: Sequence[ObservationQuality]) -> FloatArray:
        """(n, k) residuals."""
        v = np.zeros(self.length.size)
        for part in self.alike.parts:
            v[part.entry] = quality[part.group].v[part.rows[part.row], part.component]
        return v.reshape(self.length.shape)


def _derivatives(adjustment: Adjustment, alike: AlikeClusters, tangent: FloatArray | None) -> _Derivatives:
    n, k, c = alike.shape
    jacobian, counted, length = np.zeros((n * k, c)), np.zeros((n * k, c)), np.zeros(n * k)
    for part, rows in linearised_parts(alike, adjustment.problem, adjustment.inverse.values, tangent):
        spread(jacobian, part, part.of(rows.jacobian))
        counts = counted_columns(adjustment, part.group, part.rows, rows.columns)
        spread(counted, part, counts[part.row].astype(float))
        lengths = lengths_of_rows(adjustment, part.group, part.rows, rows.jacobian, rows.columns)
        length[part.entry] = part.of(lengths)
    own = np.where(counted > 0.0, jacobian, 0.0)
    return _Derivatives(jacobian.reshape(n, k, c), own.reshape(n, k, c), length.reshape(n, k), alike)


def _diagonal(matrices: FloatArray) -> FloatArray:
    return np.diagonal(matrices, axis1=1, axis2=2)


def _joint_of_clusters(
    alike: AlikeClusters, weighted: FloatArray, cofactors: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Statistic and freedom (n, k) of the joint tests of rows, those with as many entries together."""
    n, k = weighted.shape
    statistic, freedom = np.zeros((n, k)), np.zeros((n, k))
    for part in alike.parts:
        of_row = part.entry // k * len(part.rows) + part.row
        order = np.argsort(of_row, kind="stable")
        rows = np.split(order, np.flatnonzero(np.diff(of_row[order])) + 1)
        for size in {len(row) for row in rows}:
            entry = part.entry[np.stack([row for row in rows if len(row) == size])]
            one, here = entry[:, :1] // k, entry % k
            factor = scale[one, here]
            S = cofactors[one[:, :, None], here[:, :, None], here[:, None, :]]
            S = S / (factor[:, :, None] * factor[:, None, :])
            found = joint_statistic(weighted[one, here] / factor, S, np.ones(here.shape, dtype=bool))
            statistic[one, here], freedom[one, here] = (values[:, None] for values in found)
    return statistic, freedom


# ---- Reliability of every observation: what a gross error in it would look like, and what it would do if not found.
#
# In its general form, for correlated observations too (W. Baarda, 1968), with e the unit vector of an
# observation, P the weights and Q_vv the cofactors of the residuals:
#
#     test value                 w_B = eᵀPv / √(eᵀ P Q_vv P e),         standard normal without gross error
#     estimated gross error      ∇̂ = −eᵀPv / (eᵀ P Q_vv P e),           −v/r without correlations
#     smallest detectable one    ∇ = δ0 / √(eᵀ P Q_vv P e),             δ0² the non-centrality of α0, β0
#     external reliability       δ̄0 = ∇ √(eᵀ P e − eᵀ P Q_vv P e),      bound of its effect on any function f of the
#                                                                       unknowns, in units of σ_f
#     influence on position      EP = ∇̂ · what an error of 1 carries into the points of the observation
#   (``external_reliability.py``)
# None of them but EP depends on the datum. Without correlations w_B is the normalised residual v/σ_v.


class Reliability(NamedTuple):
    """Reliability of one observation group, (n, m) each; NaN where there is no test. For σ0 = 1."""

    quality: ObservationQuality
    ncp: float
    """Non-centrality δ0²."""

    def at(self, rows: IntArray | slice) -> Reliability:
        """Reliability of some of the rows."""
        return Reliability(self.quality.at(rows), self.ncp)

    @property
    def test(self) -> FloatArray:
        """w_B; for excluded observations that of the test whether they fit."""
        return self._piecewise(lambda one, q: one.weighted / np.sqrt(q), lambda v, spread: v / spread)

    @property
    def error(self) -> FloatArray:
        """Estimated gross error, in the sense observed − true."""
        return self._piecewise(lambda one, q: -one.weighted / q, lambda v, spread: -v)

    @property
    def smallest(self) -> FloatArray:
        """∇, the smallest detectable gross error."""
        delta = np.sqrt(self.ncp)
        return self._piecewise(lambda one, q: delta / np.sqrt(q), lambda v, spread: delta * spread)

    @property
    def external(self) -> FloatArray:
        """δ̄0."""
        delta = np.sqrt(self.ncp)
        return self._piecewise(
            lambda one, q: delta / np.sqrt(q) * np.sqrt(np.maximum(one.precision - q, 0.0)),
            lambda v, spread: np.zeros(len(v)),
        )

    @property
    def influence(self) -> FloatArray:
        """EP, what the estimated error does to the position of the points of the observation; length unit."""
        influence: FloatArray = self.error * self.quality.carried
        return influence

    def _piecewise(
        self,
        of_tested: Callable[[ObservationQuality, FloatArray], FloatArray],
        of_excluded: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray:
        """Values (n, m) from the quality of some rows and their q, the diagonal of P Q_vv P.

        q is NaN where an observation is not controlled. Excluded ones are put against what all others say of them: v
        has the variance σ² + q, q of the others.
        """

        def of_rows(rows: slice) -> FloatArray:
            one = self.quality.at(rows)
            q = one.q_weighted
            values = of_tested(one, np.where(q > CONTROLLED * one.precision, q, np.nan))
            if one.out.any():
                spread = np.sqrt((one.sigma[one.out] / OUT) ** 2 + np.maximum(one.q_adjusted[one.out], 0.0))
                values[one.out] = of_excluded(one.v[one.out], spread)
            return values

        return in_pieces(self.quality.v.shape, of_rows)


def student_square(test: FloatArray, omega: float, redundancy: int) -> FloatArray:
    """t² = w² / ((Ω − w²)/(f − 1)): the test with σ0 estimated from all other observations; F(1, f − 1) distributed."""
    if redundancy <= 1:
        return np.full(test.shape, np.nan)
    square = test**2
    rest = (omega - square) / (redundancy - 1)
    ratio: FloatArray = square / np.where(rest > 0.0, rest, np.nan)
    return ratio


# ---- How much work the statistics of an adjustment are: whoever watches can tell how long they take.

Done: TypeAlias = Callable[[int], None]
"""Told how much more is done, in rays; from several threads."""

OPERATIONS_PER_RAY = 30_000
"""Operations of the dense matrices of the selected inverse in the time that the quality of one ray takes."""


def effort(adjustment: Adjustment) -> int:
    """Return the total that :func:`mor.quality.assessment.assess` reports to its watcher."""
    of_inverse = float(operations(adjustment.plan.elimination).sum())
    return len(adjustment.plan.rays.row) + int(of_inverse / OPERATIONS_PER_RAY)


def of_operations(done: Done) -> Callable[[float], None]:
    """A watcher that is told operations of the selected inverse, and tells them on."""
    told = 0
    whole = 0.0

    def more(count: float) -> None:
        nonlocal told, whole
        whole += count
        done(int(whole / OPERATIONS_PER_RAY) - told)
        told = int(whole / OPERATIONS_PER_RAY)

    return more


# ---- Residuals, redundancy numbers and what the tests need of every observation, exact, correlated or not.
#
# With Q_vv = P⁻¹ − A Q Aᵀ, r = diag(Q_vv P). The tests rest on P Q_vv P (W. Baarda, 1968), of which the
# diagonal is kept, and for the components of one observation row the statistic of the joint test, (Pv)ᵀ (P
# Q_vv P)⁻¹ (Pv) over them.


def observation_quality(
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation, done: Done | None = None
) -> tuple[tuple[ObservationQuality, ...], FloatArray]:
    """Residuals, redundancy numbers and cofactors of all groups, from the selected inverse of the reduced system.

    Also the cofactors of the eliminated points (n, 3, 3), by point block, zero for all others; out of the same pass
    (without weak directions, in the minimal datum). What errors carry into points is in the datum of the adjustment.
    Residuals are those of the solution; Jacobians are taken where the system was factorised, a tiny last step before,
    so that Σ r comes out right to the last digits. ``done`` is told how many more rays are done.
    """
    plan, values = adjustment.plan, adjustment.inverse.values
    quality = _residuals(adjustment)
    tangent = rotation_tangents(adjustment.problem.index, values)
    extra = directions(adjustment, datum)
    for row_set in plan.row_sets:
        if len(row_set.rows):
            _fill_row_set(adjustment, cofactors, row_set, quality[row_set.group], tangent, extra)
    of_rows, wide = plan.sorted_clusters
    correlated = [
        *(row_cluster_quality(adjustment, cofactors, some, quality[some.group], tangent, extra) for some in of_rows),
        *(cluster_quality(adjustment, cofactors, alike, quality, tangent, extra) for alike in wide),
    ]
    of_points = long_arrays.full((len(adjustment.problem.index.columns.get("point", ())), 3, 3), 0.0)
    weak = adjustment.inverse.weak
    selected = split(reduced_columns(plan.rays.frames.columns, plan.reduced), cofactors)

    def put(points: slice, cofactors: FloatArray, rows: _RowsOfRays, white: FloatArray, shares: FloatArray) -> None:
        of_points[plan.rays.points[points]] = cofactors
        _fill_rays(quality, rows, white, shares)
        if done is not None:
            done(len(rows.row))

    in_lanes(plan, 0, _cofactors_of_rays, values, selected, weak, extra, put=put)
    return tuple(_with_correlated(number, one, correlated) for number, one in enumerate(quality)), of_points


class _RowsOfRays(NamedTuple):
    """Rays of a chunk, as rows of their groups."""

    group: IntArray
    row: SmallIntArray
    weight: FloatArray
    by_point: FloatArray


def _cofactors_of_rays(
    plan: Plan,
    rays: RayPlan,
    put: Put,
    values: Values,
    selected: Split,
    weak: FloatArray,
    extra: WeakDirections,
) -> None:
    for chunk in ray_chunks(plan.problem, rays, plan.reduced, values):
        of_points, white, shares = ray_cofactors(chunk.rays, selected)
        if weak.shape[1]:
            image = image_of_rays(chunk.rays, weak[plan.kept], weak[rays.columns[chunk.points]])
            white = white + image @ np.swapaxes(image, 1, 2)
        add_directions(plan, rays, chunk, extra, shares)
        put(
            chunk.points,
            of_points,
            _RowsOfRays(chunk.group, chunk.row, chunk.weight, chunk.rays.by_point),
            white,
            shares,
        )


def _fill_row_set(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    row_set: RowSet,
    quality: ObservationQuality,
    tangent: FloatArray | None,
    extra: WeakDirections,
) -> None:
    number = row_set.group
    rows, own, q = _row_cofactors(adjustment, cofactors, number, row_set.rows, tangent)
    m = rows.jacobian.shape[1]
    q, shares = q[:, :m, :m], np.diagonal(q[:, m:, :m], axis1=1, axis2=2)
    shares = shares + extra.added(own, rows.jacobian, rows.columns)
    weak = adjustment.inverse.weak
    if weak.shape[1]:
        image = rows.jacobian @ _of_columns(weak, rows.columns)
        q = q + image @ np.swapaxes(image, 1, 2)
    here = row_set.weight > 0.0
    white = q * row_set.weight[:, :, None] * row_set.weight[:, None, :]
    length = lengths_of_rows(adjustment, number, row_set.rows, rows.jacobian, rows.columns)
    _fill(quality, row_set.rows, here, white, shares * row_set.weight**2 * length, row_set.weight)


def _fill_rays(
    quality: tuple[ObservationQuality, ...], rays: _RowsOfRays, white: FloatArray, shares: FloatArray
) -> None:
    for number, place in _of_each_group(rays.group):
        one = quality[number]
        rows = rays.row[place]
        if compilation.wanted():
            arrays = one.v, one.absorbed, one.carried, one.joint_of_row, one.freedom_of_row
            fill(rows, place, rays.weight, white, shares, rays.by_point, CONTROLLED, *arrays)
        else:
            # (n, 2) 1/|∂x/∂X|, which makes of shares of rays what an error of 1 carries into their points.
            slope = np.sqrt(np.einsum("ncj,ncj->nc", rays.by_point, rays.by_point))
            weight, carries = rays.weight[place], shares[place] * _quotient(rays.weight, slope)[place]
            _fill(one, rows, weight > 0.0, white[place], carries, weight)


def _residuals(adjustment: Adjustment) -> tuple[ObservationQuality, ...]:
    rays, values = adjustment.plan.rays, adjustment.values
    groups = adjustment.problem.groups
    result = tuple(_empty(group) for group in groups)
    for number, (group, one) in enumerate(zip(groups, result, strict=True)):
        others = np.ones(group.count, dtype=bool)
        others[rays.rows_of_group(number)] = False
        rows = np.flatnonzero(others)
        if len(rows):
            one.v[rows] = -misclosures(group, values, rows)

    def put(chunk: Chunk, residual: FloatArray) -> None:
        weight = rays.measurements.of(chunk.rays).weight
        for number, here in _of_each_group(rays.group_of_frame[chunk.frames][rays.frame[chunk.rays]]):
            rows, v = rays.row[chunk.rays][here], result[number].v
            if compilation.wanted():
                note_residuals(rows, here, weight, residual, v)
            else:
                v[rows] = np.divide(
                    residual[here], weight[here], out=np.full((len(here), 2), np.nan), where=weight[here] > 0.0
                )

    in_lanes(adjustment.plan, 0, _residuals_of_rays, values, put=put)
    return result


def _residuals_of_rays(plan: Plan, rays: RayPlan, put: Put, values: Values) -> None:
    for chunk, residual in ray_residuals(plan.problem, rays, values):
        put(chunk, residual)


def _of_each_group(group: IntArray) -> Iterator[tuple[int, IntArray]]:
    """The groups of rays, and the rays of each; nothing is searched where all are of one, as in most blocks."""
    if len(group) and group.min() == group.max():
        yield int(group[0]), np.arange(len(group))
        return
    for number in np.unique(group):
        yield int(number), np.flatnonzero(group == number)


def _empty(group: ObservationGroup) -> ObservationQuality:
    v, absorbed, carried = (long_arrays.full(group.observed.shape, np.nan) for _ in range(3))
    joint, freedom = long_arrays.full(group.count, np.nan), long_arrays.full(group.count, 0, np.int8)
    return ObservationQuality(v, absorbed, carried, joint, freedom, group.sigma, group.left_out)


def _fill(
    quality: ObservationQuality,
    rows: AnyIntArray,
    here: BoolArray,
    white: FloatArray,
    carries: FloatArray,
    weight: FloatArray,
) -> None:
    joint, freedom = joint_statistic(quality.v[rows] * weight, np.eye(white.shape[1]) - white, here)
    quality.absorbed[rows] = np.where(here, np.diagonal(white, axis1=1, axis2=2), quality.absorbed[rows])
    quality.carried[rows] = np.where(here, carries, quality.carried[rows])
    quality.joint_of_row[rows] = joint
    quality.freedom_of_row[rows] = freedom


def _with_correlated(
    number: int, quality: ObservationQuality, found: list[dict[int, Correlated]]
) -> ObservationQuality:
    parts = [cluster[number] for cluster in found if number in cluster]
    if not parts:
        return quality
    return replace(quality, correlated=Correlated(*map(np.concatenate, zip(*parts, strict=True))))
