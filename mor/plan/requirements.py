"""Required precision and reliability, and how far a design falls short of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import NamedTuple, TypeVar

import numpy as np

from mor.errors import InputError, Message, nearest
from mor.model import rotations
from mor.model.contract import ObservationGroup, with_sigma_model
from mor.project.axes import UnitError
from mor.project.network import Network
from mor.project.schema import RequiredReliability, RequiredSigma
from mor.quality.assessment import Quality
from mor.solve.problem import Problem, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import LENGTH

# ---- What a project requires of its plan, and whether an adjustment reaches it.
#
# Standard deviations are those of the quality that is asked, in its datum: a priori for a plan. Redundancy
# numbers and external reliability do not depend on the datum.

_Given = TypeVar("_Given", RequiredSigma, RequiredReliability)
_ROUND_OFF = 1e-9
"""Part of a limit that a value may be beyond it."""


class RequiredPrecision(NamedTuple):
    """A largest σ of coordinates of points, or of the longest semi-axis of their error ellipsoids."""

    of: str
    """What: ``x``, ``xy``, …, ``ellipsoid``."""
    pattern: tuple[str, ...]
    names: tuple[str, ...]
    blocks: IntArray
    """(k,) point blocks."""
    components: tuple[int, ...]
    """Internal components that are looked at; none for the ellipsoid."""
    limit: float
    """Length unit of the project."""


class RequiredControl(NamedTuple):
    """A least redundancy number, or a largest external reliability, of the observations of some groups."""

    of: str
    """``r`` or ``external``."""
    pattern: tuple[str, ...]
    groups: tuple[int, ...]
    """Numbers of the groups."""
    limit: float


Requirement = RequiredPrecision | RequiredControl


@dataclass(frozen=True)
class RequirementResult:
    """The outcome of a requirement, and its largest excess."""

    requirement: Requirement
    worst: float
    """Largest σ or δ̄0, smallest r; infinite where something is not controlled at all."""
    where: tuple[int, ...]
    """Number of the point among its names; group, row and component of the observation."""
    count: int
    """Points or observations that it is about."""
    failing: int
    """Those of them that do not reach it."""

    @property
    def met(self) -> bool:
        """True where nothing fails."""
        return self.failing == 0


def requirements(network: Network) -> tuple[Requirement, ...]:
    """Requirements of the project with their names resolved. Raises :class:`InputError` for unknown names."""
    problems: list[Message] = []
    wanted = network.project.require
    result: list[Requirement] = []
    for precision in _listed(wanted.sigma):
        result += _precision(network, precision, problems)
    for control in _listed(wanted.reliability):
        result += _control(network, control, problems)
    if problems:
        raise InputError(problems)
    return tuple(result)


def _listed(given: _Given | list[_Given]) -> list[_Given]:
    return given if isinstance(given, list) else [given]


def chosen_names(
    patterns: Iterable[str], names: Sequence[str], what: str, file: str, problems: list[Message]
) -> list[int]:
    """Numbers of the names that patterns stand for, each once; a pattern that stands for nothing is a mistake."""
    found: set[int] = set()
    for pattern in patterns:
        here = [k for k, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]
        if not here:
            problems.append(Message(f"there is no {what} {pattern!r}{nearest(pattern, names)}", file))
        found.update(here)
    return sorted(found)


def _precision(network: Network, wanted: RequiredSigma, problems: list[Message]) -> list[RequiredPrecision]:
    things = network.things["point"]
    positions = things.parts["position"]
    of_group: dict[str, list[int]] = {}
    for k, block in enumerate(positions.tolist()):
        of_group.setdefault(network.point_groups.get(block, ""), []).append(k)
    groups = [p for p in wanted.points if p in of_group and p not in things.numbers]
    plain = [p for p in wanted.points if p not in groups]
    chosen = set(chosen_names(plain, things.ids, "point", network.file, problems))
    chosen.update(k for name in groups for k in of_group[name])
    free = np.asarray(network.blocks["point"].free[positions].any(axis=1))
    numbers = np.array([k for k in sorted(chosen) if free[k]], dtype=np.int64)
    if chosen and not len(numbers):
        problems.append(Message(f"require: all of {', '.join(wanted.points)} are fixed", network.file))
    source = np.argmax(np.abs(network.edge.matrix), axis=0)
    found = []
    for key in ("x", "y", "z", "xy", "xyz", "ellipsoid"):
        text = getattr(wanted, key)
        if text is None:
            continue
        try:
            limit = network.edge.number(text, LENGTH)
            if limit <= 0.0:
                raise UnitError(f"found {text}, expected a σ > 0")
        except UnitError as error:
            problems.append(Message(f"require: sigma: {key}: {error}", network.file))
            continue
        components = tuple(int(source["xyz".index(axis)]) for axis in (key if key != "ellipsoid" else ""))
        names = tuple(things.ids[k] for k in numbers)
        found.append(RequiredPrecision(key, tuple(wanted.points), names, positions[numbers], components, limit))
    return found


def _control(network: Network, wanted: RequiredReliability, problems: list[Message]) -> list[RequiredControl]:
    names = [group.name for group in network.groups]
    groups = tuple(chosen_names(wanted.groups, names, "group of observations", network.file, problems))
    pairs = (("r", wanted.r), ("external", wanted.external))
    return [RequiredControl(of, tuple(wanted.groups), groups, limit) for of, limit in pairs if limit is not None]


def judged(requirement: Requirement, quality: Quality, absent: BoolArray | None = None) -> RequirementResult:
    """Return whether a quality meets a requirement; point blocks that are ``absent`` (n,) have no σ and do not."""
    if isinstance(requirement, RequiredPrecision):
        covariance = quality.sigma_factor**2 * np.nan_to_num(quality.cofactors["point"][requirement.blocks])
        sigma = sigmas(requirement, covariance)
        if absent is not None:
            sigma = np.where(absent[requirement.blocks], np.inf, sigma)
        failing = int(np.count_nonzero(sigma > requirement.limit * (1.0 + _ROUND_OFF)))
        worst = int(np.argmax(sigma))
        return RequirementResult(requirement, float(sigma[worst]), (worst,), len(sigma), failing)
    return _judged_control(requirement, quality)


def sigmas(requirement: RequiredPrecision, covariance: FloatArray) -> FloatArray:
    """(k,) the largest σ that a requirement is about of each point, for covariances (k, 3, 3), internal axes."""
    if requirement.components:
        variance = np.diagonal(covariance, axis1=1, axis2=2)[:, list(requirement.components)].max(axis=1)
    else:
        variance = rotations.eigvalsh(covariance)[:, -1] if len(covariance) else np.zeros(0)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _judged_control(requirement: RequiredControl, quality: Quality) -> RequirementResult:
    """The worst of all observations of the groups; one that is not controlled has r = 0 and any effect whatever."""
    worst, where, count, failing = np.inf, (-1, -1, -1), 0, 0  # type: float, tuple[int, ...], int, int
    sign = 1.0 if requirement.of == "r" else -1.0
    for number in requirement.groups:
        r = quality.groups[number].r
        values = r if requirement.of == "r" else quality.reliability[number].external
        values = np.where(np.isfinite(r) & ~np.isfinite(values), np.inf, values)
        known = np.isfinite(r)
        if not known.any():
            continue
        signed = np.where(known, sign * values, np.inf)
        count += int(np.count_nonzero(known))
        failing += int(np.count_nonzero(signed < sign * requirement.limit - _ROUND_OFF))
        at = int(np.argmin(signed))
        if signed.flat[at] < worst:
            worst = float(signed.flat[at])
            where = (number, *(int(k) for k in np.unravel_index(at, signed.shape)))
    return RequirementResult(requirement, sign * worst, where, count, failing)


# ---- Cofactors of all that a plan is about: its observations, those it might have, and the coordinates with a
# required σ.
#
# Let the rows of M be the whitened derivatives of the observations, planned and possible, and the required
# coordinates in their datum, so that no row changes with a free movement of the network. Then K = M Q Mᵀ has
# everything: 1 − K_ii is the redundancy number of a planned observation i, K_tt the variance of a coordinate
# t. To add (+) or to spare (−) the observations j, k of them at a time, is an exact update
#
#     K' = K ∓ K_·j R⁻¹ K_j·,    R = I ± K_jj.
#
# Nothing has to be adjusted again, however many such steps follow each other (W. Baarda's cofactors, the
# matrix inversion lemma).

MOST_ROWS = 8_000
"""Rows that are looked at together: their cofactors are half a gigabyte."""


class Unit(NamedTuple):
    """Observations that are made together: the components of a row, or all that are correlated with each other."""

    group: int
    """Number of the group; of a candidate among the candidates."""
    row: int
    """The first of its rows."""
    rows: IntArray
    """(k,) rows of M."""
    is_candidate: bool

    @property
    def cost(self) -> int:
        """Number of measurements."""
        return len(self.rows)


class Interest(NamedTuple):
    """The cofactors K (m, m), and what their rows are."""

    cofactors: FloatArray
    active: BoolArray
    """(m,) rows of observations that take part."""
    group: IntArray
    """(m,) number of the group of an observation; candidates count on; −1 for coordinates."""
    units: tuple[Unit, ...]
    correlated: tuple[tuple[IntArray, FloatArray], ...]
    """Rows of correlated observations, and the triangle L of their covariance matrix LLᵀ."""
    coordinates: IntArray
    """(points, 3) row of each coordinate that is looked at, by point block; −1 where it is not."""
    unestimable: tuple[tuple[int, int], ...]
    """Candidates (group, row) that would change the datum: what they bring cannot be told by an update."""


class ObservationRows(NamedTuple):
    """Whitened derivatives of all observations of a plan and of its candidates, as they are gathered."""

    rows: MatrixRows
    units: list[Unit]
    correlated: list[tuple[IntArray, FloatArray]]
    unestimable: list[tuple[int, int]]
    """Candidates (group, row) that would change the datum; they are no units."""


def observation_rows(quality: Quality, candidates: Sequence[ObservationGroup]) -> ObservationRows:
    """The rows of M of the observations of a plan, and behind them those of its candidates."""
    adjustment = quality.adjustment
    problem, values = adjustment.problem, adjustment.values
    tangent = rotation_tangents(problem.index, values)
    rows = MatrixRows(problem.index.count)
    units: list[Unit] = []
    entry = np.full(int(problem.offsets[-1]), -1)
    for number, group in enumerate(problem.groups):
        part = linearise(group, problem.index, values, tangent, slice(None))
        mask = group.used  # checks take no part
        first = rows.add(part.jacobian, part.columns, mask, group.sigma, number)
        entry[problem.offsets[number] :][: mask.size][mask.ravel()] = np.arange(first, first + np.count_nonzero(mask))
        if len(group.lines):
            units += _units(mask, number, first, False)
    correlated = _whiten_clusters(problem, entry, rows)
    units = _together(units, correlated)
    skipped: list[tuple[int, int]] = []
    null = adjustment.inverse.null
    for number, given in enumerate(candidates):
        group = with_sigma_model(given, values)
        part = linearise(group, problem.index, values, tangent, slice(None))
        first = rows.add(part.jacobian, part.columns, group.mask, group.sigma, len(problem.groups) + number)
        for unit in _units(group.mask, number, first, True):
            if _changes_datum(rows, unit, null):
                skipped.append((number, unit.row))
            else:
                units.append(unit)
    return ObservationRows(rows, units, correlated, skipped)


def interest_of(quality: Quality, candidates: Sequence[ObservationGroup], blocks: IntArray) -> Interest:
    """The cofactors of a plan, its candidates, and the coordinates of some point blocks. Raises :class:`InputError`."""
    adjustment = quality.adjustment
    rows, units, correlated, skipped = observation_rows(quality, candidates)
    dense, coordinates = datum_rows(quality, blocks, rows.count)
    rows.put(dense, -1)
    M = rows.matrix()
    if len(M) > MOST_ROWS:
        words = f"ranking considers {len(M)} observations and coordinates together, expected {MOST_ROWS} at most"
        raise InputError([Message(f"{words}; require less, or rank a part of the plan")])
    K = M @ adjustment.inverse.solve(np.ascontiguousarray(M.T))
    group_of = rows.group()
    taking_part = (group_of >= 0) & (group_of < len(adjustment.problem.groups))
    return Interest(
        0.5 * (K + K.T), taking_part, group_of, tuple(units), tuple(correlated), coordinates, tuple(skipped)
    )


class MatrixRows:
    """Rows of M while they are gathered."""

    def __init__(self, unknowns: int) -> None:
        self.unknowns = unknowns
        self.parts: list[FloatArray] = []
        self.groups: list[IntArray] = []
        self.count = 0

    def add(self, jacobian: FloatArray, columns: IntArray, mask: BoolArray, sigma: FloatArray, number: int) -> int:
        """Add the observations of a group, divided by their σ; returns the first of their rows."""
        row, component = np.nonzero(mask)
        dense = np.zeros((len(row), self.unknowns + 1))
        weighted = jacobian[row, component] / sigma[row, component][:, None]
        np.add.at(dense, (np.arange(len(row))[:, None], columns[row]), weighted)
        return self.put(dense[:, :-1], number)

    def put(self, dense: FloatArray, number: int) -> int:
        """Add rows as they are."""
        first = self.count
        self.parts.append(dense)
        self.groups.append(np.full(len(dense), number))
        self.count += len(dense)
        return first

    def matrix(self) -> FloatArray:
        """(m, u) M."""
        return np.concatenate(self.parts)

    def group(self) -> IntArray:
        """(m,) number of the group of each row."""
        return np.concatenate(self.groups).astype(np.int64)

    def at(self, rows: IntArray) -> FloatArray:
        """Some of the rows that were added last."""
        part = self.parts[-1]
        return part[rows - (self.count - len(part))]


def _units(mask: BoolArray, number: int, first: int, is_candidate: bool) -> list[Unit]:
    """One unit for each row of a group with observations (n, m)."""
    count = np.count_nonzero(mask, axis=1)
    ends = first + np.cumsum(count)
    return [
        Unit(number, row, np.arange(end - size, end), is_candidate)
        for row, (end, size) in enumerate(zip(ends.tolist(), count.tolist(), strict=True))
        if size
    ]


def _whiten_clusters(problem: Problem, entry: IntArray, rows: MatrixRows) -> list[tuple[IntArray, FloatArray]]:
    """Replace rows of correlated observations, which were divided by σ, by whitened ones."""
    found = []
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in rows.parts])])
    sigma = np.concatenate([group.sigma.ravel() for group in problem.groups])
    for cluster in problem.clusters:
        where = entry[cluster.entries]
        triangle = np.asarray(rotations.cholesky(cluster.covariance), dtype=np.float64)
        part = np.searchsorted(offsets, where, side="right") - 1
        plain = np.stack([rows.parts[p][w - offsets[p]] for p, w in zip(part, where, strict=True)])
        white = rotations.solve(triangle, plain * sigma[cluster.entries][:, None])
        for p, w, row in zip(part, where, white, strict=True):
            rows.parts[p][w - offsets[p]] = row
        found.append((where, triangle))
    return found


def _together(units: list[Unit], correlated: Sequence[tuple[IntArray, FloatArray]]) -> list[Unit]:
    cluster_of = {int(row): number for number, (rows, _) in enumerate(correlated) for row in rows}
    result: list[Unit] = []
    place: dict[int, int] = {}
    for unit in units:
        number = next((cluster_of[int(row)] for row in unit.rows if int(row) in cluster_of), -1)
        if number < 0:
            result.append(unit)
        elif number not in place:
            place[number] = len(result)
            result.append(unit._replace(rows=np.sort(correlated[number][0])))
    return result


def _changes_datum(rows: MatrixRows, unit: Unit, null: FloatArray) -> bool:
    if null.shape[1] == 0:
        return False
    own = rows.at(unit.rows)
    size = np.maximum(np.abs(own) @ np.abs(null), 1e-300)
    # Part of a row along a free movement of the network from which on it would change the datum.
    return bool((np.abs(own @ null) > 1e-6 * size).any())


def datum_rows(quality: Quality, blocks: IntArray, first: int) -> tuple[FloatArray, IntArray]:
    """Rows (t, u) of the free coordinates of point blocks in the datum, Sᵀe = e − B Hᵀ Gᵀe, numbered from ``first``.

    With them (points, 3) the row of each coordinate, −1 where it is fixed or not looked at.
    """
    chosen, places = coordinates_at(quality, blocks, first)
    dense = np.zeros((len(chosen), quality.adjustment.problem.index.count))
    dense[np.arange(len(chosen)), chosen] = 1.0
    datum = quality.datum
    if datum.null.shape[1]:
        dense -= datum.null[chosen] @ datum.binding @ quality.adjustment.constraint.normals.T
    return dense, places


def coordinates_at(quality: Quality, blocks: IntArray, first: int) -> tuple[IntArray, IntArray]:
    """Columns (t,) of the free coordinates of point blocks, and the rows of :func:`datum_rows` they have."""
    columns = quality.adjustment.problem.index.columns["point"]
    places = np.full(columns.shape, -1)
    own = columns[blocks]
    free = own >= 0
    chosen = own[free]
    within = np.full(own.shape, -1)
    within[free] = np.arange(first, first + len(chosen))
    places[blocks] = within
    return chosen, places


# ---- How far a plan is from what is required of it, in one number, for many changes of the plan at once.
#
# The shortfall adds up, for every coordinate with a required σ, by how much its variance is beyond the limit
# in parts of that, and for every observation with a required redundancy number, by how much it is below in
# parts of that: it is 0 where all is reached. An external reliability δ̄0 is a redundancy number, r =
# δ0²/(δ0² + δ̄0²); of correlated observations their own r is taken for it.

REACHED = 1e-9
"""Shortfall that is round-off."""


class RowLimits(NamedTuple):
    """Requirements as limits of single rows."""

    variance: FloatArray
    """(t,) limits of the variances of the coordinates ``rows``."""
    rows: IntArray
    ellipsoids: IntArray
    """(e, 3) rows of points whose longest semi-axis is limited."""
    ellipsoid_limit: FloatArray
    """(e,) limits of their squares."""
    least_r: FloatArray
    """(m,) least redundancy number of each observation, 0 where nothing is required."""

    @property
    def is_empty(self) -> bool:
        """True where nothing is required."""
        return not (len(self.rows) or len(self.ellipsoids) or (self.least_r > 0.0).any())


class PlanMeasures(NamedTuple):
    """Measures of a plan after each of c changes, (c,) each."""

    shortfall: FloatArray
    precision: FloatArray
    """Mean of variance/limit of the coordinates that are looked at."""
    largest_ratio: FloatArray
    """Largest σ by its limit; NaN where none is required."""
    smallest_r: FloatArray
    """Of the observations with a required r, or of all where there is none."""
    possible: BoolArray
    """False where something would be undetermined."""


def wanted_of(required: Sequence[Requirement], interest: Interest, quality: Quality, names: Sequence[str]) -> RowLimits:
    """Limits of single rows; ``names`` are those of all groups, candidates last."""
    rows, limits, ellipsoids, squares = [], [], [], []
    least = np.zeros(len(interest.group))
    for one in required:
        if isinstance(one, RequiredPrecision):
            places = interest.coordinates[one.blocks]
            if one.components:
                chosen = places[:, list(one.components)]
                chosen = chosen[chosen >= 0]
                rows.append(chosen)
                limits.append(np.full(len(chosen), one.limit**2))
            else:
                ellipsoids.append(places)
                squares.append(np.full(len(places), one.limit**2))
    of_group = least_redundancies(required, quality, names)
    observed = interest.group >= 0
    least[observed] = of_group[interest.group[observed]]
    none = np.zeros(0, dtype=np.int64)
    return RowLimits(
        np.concatenate([np.zeros(0), *limits]),
        np.concatenate([none, *rows]),
        np.concatenate([np.zeros((0, 3), dtype=np.int64), *ellipsoids]),
        np.concatenate([np.zeros(0), *squares]),
        least,
    )


def least_redundancies(required: Sequence[Requirement], quality: Quality, names: Sequence[str]) -> FloatArray:
    """(g,) required redundancy numbers of the observations of groups of these names; 0 where there are none."""
    least, delta = np.zeros(len(names)), quality.noncentrality
    for one in required:
        if isinstance(one, RequiredControl):
            r = one.limit if one.of == "r" else delta / (delta + one.limit**2)
            here = [k for k, name in enumerate(names) if any(fnmatchcase(name, p) for p in one.pattern)]
            least[here] = np.maximum(least[here], r)
    return least


def redundancies(interest: Interest, diagonal: FloatArray, K: FloatArray) -> FloatArray:
    """(m,) redundancy numbers of the observations, correlated ones in their own sense."""
    r = 1.0 - diagonal
    for rows, triangle in interest.correlated:
        r[rows] = 1.0 - np.diagonal(triangle @ K[np.ix_(rows, rows)] @ rotations.inv(triangle))
    return r


def solvable(R: FloatArray) -> BoolArray:
    """(c,) true where R (c, k, k) has an inverse that is worth something.

    It has none where something would be undetermined without the observations, or where a candidate is so far outside
    of what its equation holds for that its derivatives are beyond all measure.
    """
    finite = np.asarray(np.isfinite(R).all(axis=(1, 2)))
    values = rotations.eigvalsh(np.where(finite[:, None, None], R, np.eye(R.shape[1])))
    # Variance of a candidate's value, by that of its measurement, beyond which it says nothing: it is no such sight.
    # Smallest eigenvalue of R below which something would be undetermined without the observations.
    return np.asarray(finite & (values[:, 0] > 1e-9) & (values[:, -1] < 1e12))


def outcomes(interest: Interest, wanted: RowLimits, units: Sequence[Unit], sign: float) -> PlanMeasures:
    """Outcomes of adding (+1) or removing (−1) each of some units, all of the same size k."""
    K = interest.cofactors
    index = np.stack([unit.rows for unit in units])  # (c, k)
    count, k = index.shape
    R = np.eye(k) + sign * K[index[:, :, None], index[:, None, :]]
    possible = solvable(R)
    R[~possible] = np.eye(k)
    L = rotations.inv(rotations.cholesky(R))  # R⁻¹ = LᵀL
    W = np.einsum("cjk,cmk->cmj", L, K[:, index].transpose(1, 0, 2))  # (c, m, k): K_·j Lᵀ
    diagonal = np.diagonal(K)[None] - sign * np.einsum("cmj,cmj->cm", W, W)
    r = 1.0 - diagonal
    for rows, triangle in interest.correlated:
        own = K[np.ix_(rows, rows)][None] - sign * W[:, rows] @ W[:, rows].transpose(0, 2, 1)
        r[:, rows] = 1.0 - np.diagonal(triangle @ own @ rotations.inv(triangle), axis1=1, axis2=2)
    taking = np.broadcast_to(interest.active, (count, len(K))).copy()
    taking[np.arange(count)[:, None], index] = sign > 0.0
    return judged_outcome(interest, wanted, diagonal, r, taking, K, W, possible, sign)


def judged_outcome(
    interest: Interest,
    wanted: RowLimits,
    diagonal: FloatArray,
    r: FloatArray,
    taking: BoolArray,
    K: FloatArray,
    W: FloatArray,
    possible: BoolArray,
    sign: float = 1.0,
) -> PlanMeasures:
    """Outcome of changes that subtract W Wᵀ (c, m, k) from its cofactors K, or add it."""
    ellipsoids = _largest_axes(K, W, wanted.ellipsoids, sign)
    return _judged(interest, wanted, diagonal, r, taking, ellipsoids, possible)


def _largest_axes(K: FloatArray, W: FloatArray, points: IntArray, sign: float) -> FloatArray:
    """(c, e) largest eigenvalues of the cofactors of points after each change; fixed coordinates are 0."""
    if not len(points):
        return np.zeros((len(W), 0))
    known = points >= 0
    both = known[:, :, None] & known[:, None, :]
    block = np.where(both, K[points[:, :, None], points[:, None, :]], 0.0)
    moved = np.where(known[None, :, :, None], W[:, points], 0.0)  # (c, e, 3, k)
    after = block[None] - sign * moved @ moved.transpose(0, 1, 3, 2)
    return np.asarray(rotations.eigvalsh(after)[..., -1])


def _judged(
    interest: Interest,
    wanted: RowLimits,
    diagonal: FloatArray,
    r: FloatArray,
    taking: BoolArray,
    ellipsoids: FloatArray,
    possible: BoolArray,
) -> PlanMeasures:
    parts = np.concatenate([diagonal[:, wanted.rows] / wanted.variance, ellipsoids / wanted.ellipsoid_limit], axis=1)
    least = wanted.least_r
    asked = least > 0.0
    below = np.maximum(1.0 - r[:, asked] / least[asked], 0.0) * taking[:, asked]
    beyond = np.maximum(parts - 1.0, 0.0)
    beyond[beyond < REACHED] = 0.0
    below[below < REACHED] = 0.0
    observed = taking & (asked if asked.any() else interest.group >= 0)
    smallest = np.where(observed, r, np.inf).min(axis=1)
    return PlanMeasures(
        beyond.sum(axis=1) + below.sum(axis=1),
        _shortfall_of_precision(interest, parts, diagonal),
        np.sqrt(parts.max(axis=1)) if parts.shape[1] else np.full(len(parts), np.nan),
        np.maximum(smallest, 0.0),
        possible,
    )


def _shortfall_of_precision(interest: Interest, parts: FloatArray, diagonal: FloatArray) -> FloatArray:
    """(c,) mean of variance by limit; of the variances of all coordinates where no σ is required."""
    if parts.shape[1]:
        return np.asarray(parts.mean(axis=1))
    rows = np.flatnonzero(interest.group < 0)
    return np.asarray(diagonal[:, rows].mean(axis=1)) if len(rows) else np.zeros(len(diagonal))


def present(interest: Interest, wanted: RowLimits) -> PlanMeasures:
    """Outcome of the plan as it is; arrays of one."""
    K = interest.cofactors
    diagonal = np.diagonal(K).copy()
    r = redundancies(interest, diagonal, K)
    ellipsoids = _largest_axes(K, np.zeros((1, len(K), 1)), wanted.ellipsoids, 1.0)
    return _judged(interest, wanted, diagonal[None], r[None], interest.active[None], ellipsoids, np.ones(1, dtype=bool))


# ---- What planned observations see, where a project leaves that to be worked out.

REASONS = ("seen", "range", "frame", "incidence", "hidden")
"""What becomes of a sight: seen; out of range; off the format, or too steep; too slanting; hidden by a surface."""


class Sighted(NamedTuple):
    """Things that a group of planned observations sees."""

    name: str
    section: str
    """``observations`` or ``candidates``."""
    counts: tuple[int, ...]
    """Sights by what becomes of them, in the order of ``REASONS``: the first that keeps them from being seen."""
    unseen: tuple[str, ...]
    """Targets that nothing sees."""
    once: tuple[str, ...]
    """Targets that are seen from one place only."""


# ---- What is needed to take planned observations out and put them in again without an adjustment: rows and cofactors.
#
# With the rows a of the whitened derivatives, and Q the cofactors of all unknowns in their datum,
#
#     Q' = Q ∓ Q aᵀ (a Q aᵀ ± 1)⁻¹ a Q,    r = 1 − a Q' aᵀ,
#
# row by row. Rows do not change with free movements of the network, so that Q' stays in the datum.

MOST_UNKNOWNS = 300
"""Unknowns of networks small enough for this."""
MOST_UNITS = 3_000


class Switching(NamedTuple):
    """A small network, ready for observations to be switched off and on."""

    rows: FloatArray
    """(m, u) whitened derivatives of all observations, candidates last."""
    group: IntArray
    """(m,) number of the group of each; candidates count on."""
    cofactors: FloatArray
    """(u, u) Q of the unknowns, in the datum of the plan."""
    columns: IntArray
    """(points, 3) unknown of each coordinate by point block; −1 where it is fixed."""
    units: tuple[Unit, ...]
    correlated: tuple[tuple[IntArray, FloatArray], ...]
    """Rows of correlated observations, and the triangle L of their covariance matrix LLᵀ."""


def switching(quality: Quality, candidates: Sequence[ObservationGroup]) -> Switching | None:
    """Rows and cofactors of a plan; ``None`` where it is too large for them."""
    adjustment = quality.adjustment
    index = adjustment.problem.index
    if index.count > MOST_UNKNOWNS:
        return None
    rows, units, correlated, _ = observation_rows(quality, candidates)
    if len(units) > MOST_UNITS:
        return None
    T = np.eye(index.count)
    datum = quality.datum
    if datum.null.shape[1]:
        T -= datum.null @ datum.binding @ adjustment.constraint.normals.T
    Q = T @ adjustment.inverse.solve(np.ascontiguousarray(T.T))
    return Switching(
        rows.matrix(), rows.group(), 0.5 * (Q + Q.T), index.columns["point"], tuple(units), tuple(correlated)
    )
