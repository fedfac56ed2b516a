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
from mor.adjustment.plan import Plan
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.observations import ObservationGroup
from mor.parameters.index import Index, Values, index_unknowns
from mor.quality.assess import Quality
from mor.quality.tests.p_values import log_p_chi2, log_p_f
from mor.quality.tests.test_statistics import CONTROLLED

MOST = 300
"""Points that are tested at most."""
ENTRIES = 20_000_000


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
    at_a_time = max(1, ENTRIES // (3 * max(problem.index.count, 1)))
    tests: list[FixedPointTest] = []
    for first in range(0, len(points), at_a_time):
        chosen = np.zeros_like(fixed)
        some = points[first : first + at_a_time]
        chosen[some] = fixed[some]
        tests += _tests(quality, some, chosen)
    return tests


class Released(NamedTuple):
    """Fixed coordinates as if they were free, in the order of their points."""

    own: FloatArray
    """(f, f) BᵀPB."""
    coupling: FloatArray
    """(u, f) AᵀPB."""
    right: FloatArray
    """(f,) BᵀPl."""


def _tests(quality: Quality, points: IntArray, chosen: BoolArray) -> list[FixedPointTest]:
    adjustment = quality.adjustment
    found = released(adjustment.plan, adjustment.values, chosen)
    S = found.own - found.coupling.T @ adjustment.inverse.solve(found.coupling)
    places = _places(chosen)
    return [
        movement_test(int(p), places[p], S, found.own, found.right, quality.redundancy, quality.omega)
        for p in points
    ]


def _places(chosen: BoolArray) -> IntArray:
    places = np.full(chosen.shape, -1, dtype=np.int64)
    places[chosen] = np.arange(np.count_nonzero(chosen))
    return places


def released(plan: Plan, values: Values, chosen: BoolArray) -> Released:
    """Normal equations of the chosen coordinates (n, 3) of the points at some values."""
    problem, places = plan.problem, _places(chosen)
    free = problem.index.blocks["point"]._replace(free=problem.index.blocks["point"].free | chosen)
    extended = index_unknowns({**problem.index.blocks, "point": free})
    count = int(np.count_nonzero(chosen))
    own, coupling = np.zeros((count, count)), np.zeros((problem.index.count, count))
    right = np.zeros(count)
    to_fixed, to_free = _numbering(problem.index, extended, places)
    for jacobian, misclosure, columns in _rows(plan, values, extended, places):
        fixed = np.where(columns >= 0, to_fixed[columns], -1)
        unknown = np.where(columns >= 0, to_free[columns], -1)
        products = np.einsum("nmk,nml->nkl", jacobian, jacobian)
        gradient = np.einsum("nmk,nm->nk", jacobian, misclosure)
        np.add.at(right, fixed[fixed >= 0], gradient[fixed >= 0])
        both = (fixed[:, :, None] >= 0) & (fixed[:, None, :] >= 0)
        n, k, m = np.nonzero(both)
        np.add.at(own, (fixed[n, k], fixed[n, m]), products[n, k, m])
        n, k, m = np.nonzero((unknown[:, :, None] >= 0) & (fixed[:, None, :] >= 0))
        np.add.at(coupling, (unknown[n, k], fixed[n, m]), products[n, k, m])
    return Released(own, coupling, right)


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


def _rows(plan: Plan, values: Values, extended: Index, places: IntArray):  # type: ignore[no-untyped-def]
    """Whitened Jacobians, misclosures and extended columns of the rows that look at a released coordinate."""
    problem = replace(plan.problem, index=extended)
    tangent = rotation_tangents(extended, values)
    touched: BoolArray = np.asarray((places >= 0).any(axis=1))
    looks = [_looks(group, touched) for group in problem.groups]
    correlated = [np.zeros(group.observed.shape, dtype=bool) for group in problem.groups]
    for cluster in plan.clusters:
        looking = False
        for group, row, component in zip(cluster.groups, cluster.rows, cluster.components, strict=True):
            correlated[group][row, component] = True
            looking |= bool(looks[group][row])
        if not looking:
            continue
        misclosure, jacobian, columns = cluster_rows(problem, cluster, values, tangent)
        yield (cluster.whitening @ jacobian)[None], (cluster.whitening @ misclosure)[None], columns[None]
    for number, group in enumerate(problem.groups):
        rows = np.flatnonzero(looks[number])
        if len(rows) == 0:
            continue
        part = linearise(group, extended, values, tangent, rows)
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


def movement_test(
    point: int,
    places: IntArray,
    S: FloatArray,
    own: FloatArray,
    right: FloatArray,
    redundancy: int,
    omega: float,
) -> FixedPointTest:
    """The test of a point whose coordinates stand at some places (3,) of the normal equations; −1 where not fixed."""
    here = np.flatnonzero(places >= 0)
    chosen = places[here]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(own)[chosen], 1e-300))
    eigenvalues, axes = tolerant.eigh(S[np.ix_(chosen, chosen)] * np.outer(scale, scale))
    used = eigenvalues > CONTROLLED
    along = axes[:, used].T @ (right[chosen] * scale)
    movement = np.zeros(3)
    movement[here] = scale * (axes[:, used] @ (along / eigenvalues[used]))
    freedom, total = int(np.count_nonzero(used)), float(np.sum(along**2 / eigenvalues[used]))
    rest = redundancy - freedom
    mean = total / freedom if freedom else 0.0
    ratio = mean / ((omega - total) / rest) if rest > 0 and omega > total else np.nan
    log_p = log_p_chi2(np.array([total]), np.array([float(max(freedom, 1))]))
    log_estimated = log_p_f(np.array([ratio]), float(max(freedom, 1)), rest)
    return FixedPointTest(point, movement, freedom, mean, ratio, float(log_p[0]), float(log_estimated[0]))
