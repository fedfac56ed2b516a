"""Fixed coordinates put to the test: would the observations rather have the point elsewhere?

With B the derivatives of the observations by the fixed coordinates of one point, the movement that the observations
want is ∇ = S⁻¹ BᵀPl, S = BᵀPB − BᵀPA Q AᵀPB, and T = (BᵀPl)ᵀ S⁻¹ BᵀPl is χ² distributed. Its degrees of freedom are the
directions that something controls: of two points that alone fix a plane network, only the distance between them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.correlated_rows import cluster_rows
from mor.adjustment.datum.defect import network_components
from mor.adjustment.linearise import linearise, rotation_tangents
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Index, index_unknowns
from mor.quality.assess import Quality
from mor.quality.tests.p_values import log_p_chi2, log_p_f
from mor.quality.tests.test_statistics import CONTROLLED

MOST = 300
"""Points that are tested at most."""
_ENTRIES = 20_000_000


class FixedPointTest(NamedTuple):
    """Test of the hypothesis that a fixed point stands where it is said to stand."""

    point: int
    movement: FloatArray
    """(3,) estimated movement, 0 where a coordinate is not fixed or not controlled."""
    freedom: int
    statistic: float
    """T/freedom, σ0 known."""
    ratio: float
    """T/freedom over the variance factor of all else: F(freedom, f − freedom); NaN without redundancy."""
    log_p: float
    log_p_estimated: float


def fixed_point_tests(quality: Quality) -> list[FixedPointTest]:
    """Tests of all points with fixed coordinates that observations look at, at most ``MOST``."""
    problem = quality.adjustment.problem
    _, fixed = network_components(problem, quality.adjustment.values)
    points = np.flatnonzero(fixed.any(axis=1))[:MOST]
    at_a_time = max(1, _ENTRIES // (3 * max(problem.index.count, 1)))
    tests: list[FixedPointTest] = []
    for first in range(0, len(points), at_a_time):
        chosen = np.zeros_like(fixed)
        some = points[first : first + at_a_time]
        chosen[some] = fixed[some]
        tests += _tests(quality, some, chosen)
    return tests


def _tests(quality: Quality, points: IntArray, released: BoolArray) -> list[FixedPointTest]:
    problem = quality.adjustment.problem
    blocks = problem.index.blocks
    free = blocks["point"]._replace(free=blocks["point"].free | released)
    extended = index_unknowns({**blocks, "point": free})
    places = np.full(released.shape, -1, dtype=np.int64)
    places[released] = np.arange(np.count_nonzero(released))
    own, coupling, right = _normals(quality, extended, places)
    answer = quality.adjustment.inverse.solve(coupling)
    S = own - coupling.T @ answer
    return [_test(quality, int(p), places[p], S, own, right) for p in points]


def _normals(
    quality: Quality, extended: Index, places: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """BᵀPB (f, f), AᵀPB (u, f) and BᵀPl (f,) of the released coordinates."""
    problem = quality.adjustment.problem
    count = int(places.max(initial=-1)) + 1
    own, coupling = np.zeros((count, count)), np.zeros((problem.index.count, count))
    right = np.zeros(count)
    to_fixed, to_free = _numbering(problem.index, extended, places)
    for jacobian, misclosure, columns in _rows(quality, extended, places):
        fixed = np.where(columns >= 0, to_fixed[columns], -1)
        free = np.where(columns >= 0, to_free[columns], -1)
        products = np.einsum("nmk,nml->nkl", jacobian, jacobian)
        gradient = np.einsum("nmk,nm->nk", jacobian, misclosure)
        np.add.at(right, fixed[fixed >= 0], gradient[fixed >= 0])
        both = (fixed[:, :, None] >= 0) & (fixed[:, None, :] >= 0)
        n, k, m = np.nonzero(both)
        np.add.at(own, (fixed[n, k], fixed[n, m]), products[n, k, m])
        n, k, m = np.nonzero((free[:, :, None] >= 0) & (fixed[:, None, :] >= 0))
        np.add.at(coupling, (free[n, k], fixed[n, m]), products[n, k, m])
    return own, coupling, right


def _numbering(index: Index, extended: Index, places: IntArray) -> tuple[IntArray, IntArray]:
    """For every extended unknown: its number among the released ones, and among the original ones; −1 where none."""
    to_fixed, to_free = np.full(extended.count, -1), np.full(extended.count, -1)
    for kind, columns in extended.columns.items():
        original = index.columns[kind]
        here = (columns >= 0) & (original >= 0)
        to_free[columns[here]] = original[here]
    released = places >= 0
    to_fixed[extended.columns["point"][released]] = places[released]
    return to_fixed, to_free


def _rows(quality: Quality, extended: Index, places: IntArray):  # type: ignore[no-untyped-def]
    """Whitened Jacobians, misclosures and extended columns of the rows that look at a released coordinate."""
    adjustment = quality.adjustment
    problem = replace(adjustment.problem, index=extended)
    tangent = rotation_tangents(extended, adjustment.values)
    touched: BoolArray = np.asarray((places >= 0).any(axis=1))
    looks = [_looks(group, touched) for group in problem.groups]
    correlated = [np.zeros(group.observed.shape, dtype=bool) for group in problem.groups]
    for cluster in adjustment.plan.clusters:
        looking = False
        for group, row, component in zip(cluster.groups, cluster.rows, cluster.components, strict=True):
            correlated[group][row, component] = True
            looking |= bool(looks[group][row])
        if not looking:
            continue
        misclosure, jacobian, columns = cluster_rows(problem, cluster, adjustment.values, tangent)
        yield (cluster.whitening @ jacobian)[None], (cluster.whitening @ misclosure)[None], columns[None]
    for number, group in enumerate(problem.groups):
        rows = np.flatnonzero(looks[number])
        if len(rows) == 0:
            continue
        part = linearise(group, extended, adjustment.values, tangent, rows)
        use: BoolArray = group.mask[rows] & ~correlated[number][rows]
        weight = np.where(use, 1.0 / group.sigma[rows], 0.0)
        yield part.jacobian * weight[:, :, None], part.misclosure * weight, part.columns


def _looks(group: ObservationGroup, touched: BoolArray) -> BoolArray:
    """(n,) rows of a group that refer to a touched point."""
    looks = np.zeros(group.count, dtype=bool)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind == "point":
            looks |= touched[blocks]
    return looks


def _test(
    quality: Quality, point: int, places: IntArray, S: FloatArray, own: FloatArray, right: FloatArray
) -> FixedPointTest:
    here = np.flatnonzero(places >= 0)
    chosen = places[here]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(own)[chosen], 1e-300))
    eigenvalues, axes = np.linalg.eigh(S[np.ix_(chosen, chosen)] * np.outer(scale, scale))
    used = eigenvalues > CONTROLLED
    along = axes[:, used].T @ (right[chosen] * scale)
    movement = np.zeros(3)
    movement[here] = scale * (axes[:, used] @ (along / eigenvalues[used]))
    freedom, total = int(np.count_nonzero(used)), float(np.sum(along**2 / eigenvalues[used]))
    rest = quality.redundancy - freedom
    mean = total / freedom if freedom else 0.0
    ratio = mean / ((quality.omega - total) / rest) if rest > 0 and quality.omega > total else np.nan
    log_p = log_p_chi2(np.array([total]), np.array([float(max(freedom, 1))]))
    log_estimated = log_p_f(np.array([ratio]), float(max(freedom, 1)), rest)
    return FixedPointTest(point, movement, freedom, mean, ratio, float(log_p[0]), float(log_estimated[0]))
