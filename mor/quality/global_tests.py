"""The global test, check points, fixed coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, cast

import numpy as np
from scipy.special import kolmogorov, ndtr, ndtri

from mor.model import rotations
from mor.model.contract import ObservationGroup
from mor.model.parameters import Index, Values, index_unknowns
from mor.quality.assessment import Quality
from mor.quality.external_reliability import WhitenedRows, residuals_of_table
from mor.quality.test_statistics import CONTROLLED, LEVEL, log_p_chi2, log_p_f, robust_sigma
from mor.solve.datum import network_components
from mor.solve.normals import Plan
from mor.solve.problem import cluster_rows, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray, pieces

# ---- Check points and check distances: what observations that were kept out say of the result.
#
# Deviations are adjusted − known. Of points: mean, root mean square, largest deviation for each axis. Of
# distances: the largest length measurement error in the manner of VDI/VDE 2634, the largest |adjusted −
# calibrated| length.


@dataclass(frozen=True)
class CheckOutcome:
    """One group of checks; arrays by component (m,), NaN where a component was not known."""

    count: FloatArray
    mean: FloatArray
    rms: FloatArray
    largest: FloatArray
    """Deviation that is largest in size, with its sign."""
    exceeding: FloatArray
    """Number of deviations beyond the critical value of their test, σ of the known value and of the result together."""


def check_outcome(quality: Quality, number: int) -> CheckOutcome:
    """Deviations of a group that was kept out."""
    group: ObservationGroup = quality.adjustment.problem.groups[number]
    v = np.where(group.left_out, quality.groups[number].v, np.nan)
    test = np.where(group.left_out, quality.reliability[number].test, np.nan)
    count = np.isfinite(v).sum(axis=0)
    some = np.maximum(count, 1)
    known = np.where(count > 0, 1.0, np.nan)
    filled = np.nan_to_num(v)
    worst = np.argmax(np.abs(filled), axis=0) if len(v) else np.zeros(v.shape[1], dtype=np.int64)
    largest = filled[worst, np.arange(v.shape[1])] if len(v) else np.zeros(v.shape[1])
    return CheckOutcome(
        count.astype(float),
        filled.sum(axis=0) / some * known,
        np.sqrt((filled**2).sum(axis=0) / some) * known,
        largest * known,
        (np.abs(np.nan_to_num(test)) > quality.critical).sum(axis=0).astype(float),
    )


# ---- A common offset or scale in the observations of a group: how large it would be, and what would be left with it.
#
# With c the derivatives of the whitened observations by the effect (1 for an offset, the measured value for a
# scale, each over σ), R the cofactors of their residuals and v these residuals (W. Baarda, 1968, for one bias
# in many observations):
#
#     ∇̂ = −cᵀv / (cᵀ R c),    σ = 1/√(cᵀ R c),    w = ∇̂/σ,    v' = v + R c ∇̂
#
# v' are the residuals beside the effect, whose sum of squares in the group has the expectation Σr − ‖R_g
# c‖²/(cᵀ R c).


class GroupEffect(NamedTuple):
    """An effect on one component of the observations of one group, in internal units."""

    kind: Literal["offset", "scale"]
    group: int
    component: int
    size: float
    """∇̂, in the sense observed − true: of an offset in the unit of the component, of a scale a ratio."""
    sigma: float
    """Its standard deviation, σ0 = 1."""
    omega: float
    """What is left of the part of vᵀPv of all chosen observations."""
    redundancy: float
    """What is left of their Σr."""

    @property
    def test(self) -> float:
        """w, standard normal where there is no such effect; its square is what vᵀPv of all loses."""
        return self.size / self.sigma

    @property
    def factor(self) -> float:
        """√(Ω/Σr) that is left."""
        return float(np.sqrt(max(self.omega, 0.0) / self.redundancy)) if self.redundancy > 0.0 else np.nan


ROWS_OF_A_LONG_TABLE = 50_000
"""Rows of a table from which on passes over the network replace its design matrix: 25 MB for so many image points."""


def common_effects(
    quality: Quality, rows: Callable[[], WhitenedRows], chosen: list[BoolArray], redundancy: float
) -> list[GroupEffect]:
    """Effects in the chosen observations, (n, m) of each group, whose Σr is given; the most significant first.

    ``rows`` makes them, or those of them that are not correlated with others; they are not made of a long table.
    """
    forms = [
        _Form(kind, number, component, values)
        for number, (group, mask) in enumerate(zip(quality.adjustment.problem.groups, chosen, strict=True))
        for component in np.flatnonzero(mask.sum(axis=0) > 1).tolist()
        for kind, values in _forms(group, mask, component)
    ]
    if not forms:
        return []
    table = _long_table(quality, chosen)
    white, answer, residuals = _of_rows(quality, rows(), forms) if table is None else _of_table(quality, table, forms)
    q = np.sum(white * answer, axis=0)
    found = []
    for k, form in enumerate(forms):
        if q[k] <= CONTROLLED * float(white[:, k] @ white[:, k]):
            continue
        size = -float(white[:, k] @ residuals) / q[k]
        left = residuals + answer[:, k] * size
        taken = float(answer[:, k] @ answer[:, k]) / q[k]
        sigma = float(1.0 / np.sqrt(q[k]))
        rest = float(left @ left), redundancy - taken
        found.append(GroupEffect(form.kind, form.group, form.component, size, sigma, *rest))
    return sorted(found, key=lambda effect: -abs(effect.test))


class _Form(NamedTuple):
    """Derivatives (n, m) of the observations of a group by an effect."""

    kind: Literal["offset", "scale"]
    group: int
    component: int
    values: FloatArray


def _of_rows(quality: Quality, rows: WhitenedRows, forms: list[_Form]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """W c and R W c (N, k) of the forms, and whitened residuals (N,)."""
    groups = quality.adjustment.problem.groups
    none = [np.zeros(group.observed.shape) for group in groups]
    white = [rows.whitened([*none[: one.group], one.values, *none[one.group + 1 :]]) for one in forms]
    residuals = rows.whitened([np.nan_to_num(one.v) for one in quality.groups])
    return np.stack(white, axis=1), rows.residuals_of(np.stack(white, axis=1)), residuals


def _of_table(quality: Quality, number: int, forms: list[_Form]) -> tuple[FloatArray, FloatArray, FloatArray]:
    group = quality.adjustment.problem.groups[number]
    used = group.used
    white = np.stack([np.where(used, one.values / group.sigma, 0.0) for one in forms], axis=2)
    answer = residuals_of_table(quality.adjustment, number, white)
    return white[used], answer[used], (quality.groups[number].v / group.sigma)[used]


def _long_table(quality: Quality, chosen: list[BoolArray]) -> int | None:
    """The table that is chosen as a whole, if it is so long that its design matrix takes more time than passes do."""
    problem = quality.adjustment.problem
    some = [number for number, mask in enumerate(chosen) if mask.any()]
    if len(some) != 1 or problem.groups[some[0]].count <= ROWS_OF_A_LONG_TABLE or problem.clusters:
        return None
    return some[0] if np.array_equal(chosen[some[0]], problem.groups[some[0]].used) else None


def _forms(
    group: ObservationGroup, mask: BoolArray, component: int
) -> list[tuple[Literal["offset", "scale"], FloatArray]]:
    """Derivatives (n, m) of the observations by an offset of one component and, of lengths, by a scale."""
    ones = np.zeros(group.observed.shape)
    ones[mask[:, component], component] = 1.0
    forms: list[tuple[Literal["offset", "scale"], FloatArray]] = [("offset", ones)]
    if not group.type.wraps[component] and group.type.components[component].quantity.length == 1:
        forms.append(("scale", ones * np.nan_to_num(group.observed)))
    return forms


# ---- Whether the standardised residuals of tables are normal with one factor: then a σ is wrong, and nothing else.
#
# A gross error, a wrong height or a wrong name also makes vᵀPv too large, but its residuals are not normal with any
# factor. Two tests of |w|/s are made for each table, s being the factor: the test of A. N. Kolmogorov (1933) against
# |N(0, 1)|, and that of the largest value. Both together have the level ``LEVEL`` for each table. The residuals are
# correlated and s is estimated from them, so the tests reject true hypotheses a little less often than that.

_AT_LEAST = 5
"""Tested observations of a table from which on their distribution is judged."""


def fits_one_factor(quality: Quality) -> bool:
    """Return True if the w of every table are normal with the same factor."""
    sizes = [_tested(quality, number) for number in range(len(quality.groups))]
    every = np.concatenate([np.zeros(0), *sizes])
    if len(every) < _AT_LEAST:
        return True
    factor = robust_sigma(every)
    judged = [one for one in (every, *sizes) if len(one) >= _AT_LEAST]
    return factor > 0.0 and all(_is_normal(one / factor, LEVEL / len(judged)) for one in judged)


def factor_of_group(quality: Quality, number: int) -> float | None:
    """Return the robust factor of the w of a table, None if too few of its observations are tested."""
    sizes = _tested(quality, number)
    factor = robust_sigma(sizes) if len(sizes) >= _AT_LEAST else 0.0
    return factor if factor > 0.0 else None


def fits_factor(quality: Quality, number: int, factor: float) -> bool:
    """Return True if the w of a table are normal with a factor."""
    return _is_normal(_tested(quality, number) / factor, LEVEL)


def _tested(quality: Quality, number: int) -> FloatArray:
    """(k,) |w| of the observations of a table that take part in the adjustment and are controlled."""
    group = quality.adjustment.problem.groups[number]
    test = np.abs(quality.reliability[number].at(slice(None)).test)[group.used]
    return cast("FloatArray", test[np.isfinite(test)])


def _is_normal(sizes: FloatArray, level: float) -> bool:
    """Return True if absolute values (k,) may be those of a standard normal distribution."""
    count = len(sizes)
    if sizes.max() > -ndtri(0.25 * level / count):
        return False
    expected = 2.0 * ndtr(np.sort(sizes)) - 1.0
    steps = np.arange(count + 1) / count
    distance = max(float(np.max(steps[1:] - expected)), float(np.max(expected - steps[:-1])))
    root = np.sqrt(count)
    return bool(kolmogorov((root + 0.12 + 0.11 / root) * distance) > 0.5 * level)


# ---- Fixed coordinates put to the test: would the observations rather have the point elsewhere?
#
# With B the derivatives of the observations by the fixed coordinates of one point, the movement that the
# observations want is ∇ = S⁻¹ BᵀPl, S = BᵀPB − BᵀPA Q AᵀPB, and T = (BᵀPl)ᵀ S⁻¹ BᵀPl is χ² distributed. Its
# degrees of freedom are the directions that something controls: of two points that alone fix a plane network,
# only the distance between them.


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
    points = np.flatnonzero(fixed.any(axis=1))[:300]  # at most
    at_a_time = max(1, 20_000_000 // (3 * max(problem.index.count, 1)))
    tests: list[FixedPointTest] = []
    for piece in pieces(len(points), at_a_time):
        chosen, some = np.zeros_like(fixed), points[piece]
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
        movement_test(int(p), places[p], S, found.own, found.right, quality.redundancy, quality.omega) for p in points
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
    for blocks in group.blocks_of("point"):
        looks |= touched[blocks]
    return looks


def movement_test(
    point: int, places: IntArray, S: FloatArray, own: FloatArray, right: FloatArray, redundancy: int, omega: float
) -> FixedPointTest:
    """The test of a point whose coordinates stand at some places (3,) of the normal equations; −1 where not fixed."""
    here = np.flatnonzero(places >= 0)
    chosen = places[here]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(own)[chosen], 1e-300))
    eigenvalues, axes = rotations.eigh(S[np.ix_(chosen, chosen)] * np.outer(scale, scale))
    used = eigenvalues > CONTROLLED
    along = axes[:, used].T @ (right[chosen] * scale)
    movement = np.zeros(3)
    movement[here] = scale * (axes[:, used] @ (along / eigenvalues[used]))
    freedom, total = int(np.count_nonzero(used)), float(np.sum(along**2 / eigenvalues[used]))
    rest = redundancy - freedom
    mean = total / freedom if freedom else 0.0
    ratio = mean / ((omega - total) / rest) if rest > 0 and omega > total else np.nan
    log_p = float(log_p_chi2(total, max(freedom, 1)))
    return FixedPointTest(point, movement, freedom, mean, ratio, log_p, float(log_p_f(ratio, max(freedom, 1), rest)))
