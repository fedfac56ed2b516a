"""The problem of least squares, and its linearisation."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.linalg import compilation
from mor.model.contract import Computed, ObservationGroup, ObservationType, wrap
from mor.model.parameters import Index, Values, tangents
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray

# ---- The equations of a problem, evaluated.
#
# An iteration asks for the same derivatives two or three times: for the normal equations, for the steps of
# the points, for the size of round-off. In a small project, in plain numpy, a call costs about as much as a
# hundred rows, so there all rows of a type are evaluated together, whichever group they are of, and what was
# found at the last places is kept. In a large one that would take too much room: only the rows of a chunk are
# evaluated together.


class _Together(NamedTuple):
    """All n rows of one type that observe anything."""

    type: ObservationType
    blocks: tuple[AnyIntArray, ...]
    constants: FloatArray
    place: dict[int, IntArray]
    """By number of the group: place of each of its rows among them, −1 of those that observe nothing."""
    known: deque[tuple[tuple[FloatArray, ...], Computed]]
    """What was found at the last places, and the values of all blocks there."""

    def at(self, values: Values) -> Computed:
        """The rows at some values, which nobody changes in place."""
        arrays = tuple(values[slot.kind] for slot in self.type.slots)
        for before, found in self.known:
            if all(one is other for one, other in zip(before, arrays, strict=True)):
                return found
        blocks = [array[number] for array, number in zip(arrays, self.blocks, strict=True)]
        found = self.type.equation(blocks, self.constants)
        self.known.append((arrays, found))
        return found


class Equations:
    """The equations of some groups."""

    def __init__(self, groups: tuple[ObservationGroup, ...]) -> None:
        self._groups = groups
        self._together: dict[int, _Together] = {}
        """By number of the group, those of the types that were asked for."""

    def computed(self, number: int, values: Values, rows: AnyIntArray) -> Computed:
        """Rows of a group at some values."""
        found, place = self._found(number, values, rows)
        return Computed(found.values[place], tuple(jacobian[place] for jacobian in found.jacobians))

    def computed_values(self, number: int, values: Values, rows: AnyIntArray) -> FloatArray:
        """Return computed observations (n, m), without derivatives."""
        found, place = self._found(number, values, rows)
        return found.values[place]

    def of_several(
        self, numbers: Sequence[int], values: Values, rows: Sequence[AnyIntArray], derivatives: bool = True
    ) -> list[Computed]:
        """Rows of several groups at some values; some networks have a group for each image."""
        if compilation.is_small():
            if derivatives:
                return [self.computed(number, values, own) for number, own in zip(numbers, rows, strict=True)]
            return [Computed(self.computed_values(n, values, own), ()) for n, own in zip(numbers, rows, strict=True)]
        found: dict[int, Computed] = {}
        types = {id(self._groups[number].type): self._groups[number].type for number in numbers}
        for type_ in types.values():
            alike = [k for k, number in enumerate(numbers) if self._groups[number].type is type_]
            parts = [(self._groups[numbers[k]], rows[k]) for k in alike]
            blocks = [
                values[slot.kind][np.concatenate([group.blocks[j][own] for group, own in parts])]
                for j, slot in enumerate(type_.slots)
            ]
            computed = type_.equation(blocks, np.concatenate([group.constants[own] for group, own in parts]))
            ends = np.cumsum([len(own) for _, own in parts]).tolist()
            for k, first, last in zip(alike, [0, *ends], ends, strict=False):
                jacobians = tuple(one[first:last] for one in computed.jacobians)
                found[k] = Computed(computed.values[first:last], jacobians)
        return [found[k] for k in range(len(numbers))]

    def _found(self, number: int, values: Values, rows: AnyIntArray) -> tuple[Computed, AnyIntArray | slice]:
        """Return the linearisation, and the rows' places in it."""
        if not compilation.is_small():
            return evaluated(self._groups[number], values, rows), slice(None)
        if number not in self._together:
            self._put_together(self._groups[number].type)
        together = self._together[number]
        place = together.place[number][rows]
        if (place < 0).any():  # some observe nothing
            return evaluated(self._groups[number], values, rows), slice(None)
        return together.at(values), place

    def _put_together(self, type_: ObservationType) -> None:
        alike = {number: group for number, group in enumerate(self._groups) if group.type is type_}
        rows = {number: np.flatnonzero(group.mask.any(axis=1)) for number, group in alike.items()}
        place, first = {}, 0
        for number, own in rows.items():
            place[number] = np.full(alike[number].count, -1, dtype=np.int64)
            place[number][own] = first + np.arange(len(own))
            first += len(own)
        blocks = tuple(
            np.concatenate([group.blocks[slot][rows[number]] for number, group in alike.items()])
            for slot in range(len(type_.slots))
        )
        constants = np.concatenate([group.constants[rows[number]] for number, group in alike.items()])
        # Equations are kept of two places: where the iteration is, and where it tries to go.
        together = _Together(type_, blocks, constants, place, deque(maxlen=2))
        self._together |= dict.fromkeys(alike, together)


def evaluated(group: ObservationGroup, values: Values, rows: AnyIntArray | slice) -> Computed:
    """The equation of a group for the chosen rows."""
    blocks = [values[slot.kind][number[rows]] for slot, number in zip(group.type.slots, group.blocks, strict=True)]
    return group.type.equation(blocks, group.constants[rows])


# ---- The adjustment problem: unknowns, observation groups, correlations, datum; complete before anything is solved.


class CorrelatedObservations(NamedTuple):
    """Correlated observations: entry numbers (k,) and their covariance matrix (k, k)."""

    entries: IntArray
    covariance: FloatArray


class DatumDefinition(NamedTuple):
    """Components that carry the datum where observations leave it open, and the coordinates they refer to.

    ``mask[kind]`` (n, size) is true for the components whose total corrections from ``reference[kind]`` the inner
    constraints bind. ``free`` is false where the user wants no free network: then a defect is an error.
    """

    name: str
    free: bool
    mask: Mapping[str, BoolArray]
    reference: Values
    movements: Values | None = None
    """Coordinates at which the movements of the inner constraints are taken; ``None``: the adjusted ones."""


@dataclass(frozen=True)
class Problem:
    """Everything the solver needs. Entry (i, c) of group g has the number ``offsets[g] + i·m + c``."""

    index: Index
    groups: tuple[ObservationGroup, ...]
    clusters: tuple[CorrelatedObservations, ...]
    datum: DatumDefinition

    @cached_property
    def equations(self) -> Equations:
        """The equations of the groups."""
        return Equations(self.groups)

    @property
    def offsets(self) -> IntArray:
        """(g+1,) first entry number of each group."""
        return np.concatenate([[0], np.cumsum([group.observed.size for group in self.groups])]).astype(np.int64)

    @property
    def left_out(self) -> tuple[BoolArray, ...]:
        """(n, m) of each group: observations that are kept out of the adjustment."""
        return tuple(group.left_out for group in self.groups)

    @property
    def observations(self) -> int:
        """Number of observations n; excluded ones do not count."""
        return int(sum(np.count_nonzero(group.used) for group in self.groups))


# ---- Linearise observation groups: misclosures, Jacobians and the columns they belong to.


class Linearised(NamedTuple):
    """n observation rows of m components, K columns each."""

    misclosure: FloatArray
    """(n, m) observed − computed, wrapped for angles, 0 where not observed."""
    jacobian: FloatArray
    """(n, m, K), zero rows where not observed."""
    columns: IntArray
    """(n, K) unknowns, −1 where fixed."""


def rotation_tangents(index: Index, values: Values) -> FloatArray | None:
    """Tangents of the rotations that move by angles (see :func:`mor.model.parameters.tangents`)."""
    return tangents(index.blocks["rotation"], values["rotation"]) if "rotation" in index.blocks else None


def misclosures(group: ObservationGroup, values: Values, rows: IntArray | slice = slice(None)) -> FloatArray:
    """(n, m) observed − computed of the chosen rows; NaN where not observed."""
    return _difference(group, group.observed[rows], evaluated(group, values, rows).values)


def misclosures_of(problem: Problem, number: int, values: Values, rows: IntArray) -> FloatArray:
    """The same of rows of a group of a problem."""
    group = problem.groups[number]
    return _difference(group, group.observed[rows], problem.equations.computed_values(number, values, rows))


def linearise(
    group: ObservationGroup, index: Index, values: Values, tangent: FloatArray | None, rows: IntArray | slice
) -> Linearised:
    """Linearise the chosen rows of a group at the given values; slots that are fixed throughout are left out."""
    return _linearised(group, index, tangent, rows, evaluated(group, values, rows))


def linearise_of(
    problem: Problem, number: int, values: Values, tangent: FloatArray | None, rows: IntArray
) -> Linearised:
    """The same of rows of a group of a problem."""
    computed = problem.equations.computed(number, values, rows)
    return _linearised(problem.groups[number], problem.index, tangent, rows, computed)


def _linearised(
    group: ObservationGroup, index: Index, tangent: FloatArray | None, rows: IntArray | slice, computed: Computed
) -> Linearised:
    numbers = [blocks[rows] for blocks in group.blocks]
    observed = group.observed[rows]
    difference = _difference(group, observed, computed.values)
    seen = np.isfinite(observed)
    parts, columns = [], []
    for slot, number, jacobian in zip(group.type.slots, numbers, computed.jacobians, strict=True):
        column = index.columns[slot.kind][number]
        if (column < 0).all():
            continue
        if slot.kind == "rotation" and tangent is not None:
            jacobian = jacobian @ tangent[number]
        parts.append(jacobian)
        columns.append(column)
    n, m = observed.shape
    jacobian = np.concatenate(parts, axis=2) if parts else np.zeros((n, m, 0))
    column = np.concatenate(columns, axis=1) if columns else np.zeros((n, 0), dtype=np.int64)
    if not seen.all():
        jacobian = np.where(seen[:, :, None], jacobian, 0.0)
    return Linearised(np.where(seen, difference, 0.0), jacobian, column)


def _difference(group: ObservationGroup, observed: FloatArray, computed: FloatArray) -> FloatArray:
    difference = observed - computed
    wraps = group.type.wraps
    if wraps.any():
        difference[:, wraps] = wrap(difference[:, wraps])
    return difference


# ---- Clusters of correlated observations that reach over rows: their Jacobians, of all that are alike together.


class ClusterRows(NamedTuple):
    """A correlated cluster: where its entries stand, and the matrix that makes them uncorrelated."""

    groups: IntArray
    rows: IntArray
    components: IntArray
    whitening: FloatArray
    """(k, k) W with W Σ Wᵀ = I."""


class PartOfClusters(NamedTuple):
    """Part of clusters of one shape in one group: e entries in r of its rows."""

    group: int
    rows: IntArray
    """(r,) each once."""
    entry: IntArray
    """(e,) numbers of the entries, those of the first cluster first."""
    row: IntArray
    """(e,) places of their rows among ``rows``."""
    component: IntArray
    """(e,)."""
    place: IntArray
    """(e, K) places of the columns of the rows among those of the cluster, −1 where fixed."""

    def of(self, values: FloatArray) -> FloatArray:
        """Return the values (e, …) of the entries from values (r, m, …) of the rows."""
        chosen: FloatArray = values[self.row, self.component]
        return chosen


class AlikeClusters(NamedTuple):
    """n clusters of as many entries k and unknowns c each."""

    whitening: FloatArray
    """(n, k, k)."""
    columns: IntArray
    """(n, c) unknowns, sorted, each once."""
    parts: tuple[PartOfClusters, ...]

    @property
    def shape(self) -> tuple[int, int, int]:
        """n, k, c."""
        return *self.whitening.shape[:2], self.columns.shape[1]

    def rows(self, problem: Problem, values: Values, tangent: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Misclosures (n, k) and Jacobians (n, k, c), not whitened."""
        n, k, c = self.shape
        misclosure, jacobian = np.zeros(n * k), np.zeros((n * k, c))
        for part in self.parts:
            found = linearise(problem.groups[part.group], problem.index, values, tangent, part.rows)
            misclosure[part.entry] = part.of(found.misclosure)
            spread(jacobian, part, part.of(found.jacobian))
        return misclosure.reshape(n, k), jacobian.reshape(n, k, c)

    def misclosures(self, problem: Problem, values: Values) -> FloatArray:
        """Misclosures (n, k) alone."""
        n, k, _ = self.shape
        misclosure = np.zeros(n * k)
        for part in self.parts:
            misclosure[part.entry] = part.of(misclosures(problem.groups[part.group], values, part.rows))
        return misclosure.reshape(n, k)


def spread(matrix: FloatArray, part: PartOfClusters, values: FloatArray) -> None:
    """Add values (e, K) to the rows of a matrix (n·k, c), where the columns of their cluster are."""
    free = part.place >= 0
    entry = np.broadcast_to(part.entry[:, None], free.shape)[free]
    np.add.at(matrix, (entry, part.place[free]), values[free])


def alike_clusters(problem: Problem, clusters: Sequence[ClusterRows]) -> tuple[AlikeClusters, ...]:
    """Clusters by their numbers of entries and unknowns, in pieces that have room in memory."""
    alike: dict[tuple[int, int], list[tuple[ClusterRows, IntArray]]] = {}
    for cluster, columns in zip(clusters, columns_of_clusters(problem, clusters), strict=True):
        alike.setdefault((len(cluster.rows), len(columns)), []).append((cluster, columns))
    found = []
    for (k, c), some in alike.items():
        many = max(2_000_000 // (k * (k + c)), 1)  # so that their Jacobians and whitening matrices have room
        found += [_together(problem, some[first : first + many]) for first in range(0, len(some), many)]
    return tuple(found)


def _together(problem: Problem, some: Sequence[tuple[ClusterRows, IntArray]]) -> AlikeClusters:
    groups, rows, components = (
        np.concatenate([getattr(cluster, name) for cluster, _ in some]) for name in ("groups", "rows", "components")
    )
    columns = np.stack([columns for _, columns in some])
    parts = []
    for number in np.unique(groups).tolist():
        entry = np.flatnonzero(groups == number)
        own, row = np.unique(rows[entry], return_inverse=True)
        of_rows = group_columns(problem.groups[number], problem.index, own)[row.ravel()]
        place = _places(columns, entry // (len(rows) // len(some)), of_rows, problem.index.count)
        parts.append(PartOfClusters(number, own, entry, row.ravel(), components[entry], place))
    return AlikeClusters(np.stack([cluster.whitening for cluster, _ in some]), columns, tuple(parts))


def _places(columns: IntArray, cluster: IntArray, wanted: IntArray, count: int) -> IntArray:
    """Places (e, K) of unknowns among the sorted ``columns`` (n, c) of their clusters (e,); −1 stays."""
    ahead = np.arange(len(columns))[:, None] * count
    found = np.searchsorted((columns + ahead).ravel(), wanted + cluster[:, None] * count)
    return np.where(wanted >= 0, found - cluster[:, None] * columns.shape[1], -1)


def cluster_rows(
    problem: Problem, cluster: ClusterRows, values: Values, tangent: FloatArray | None
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Misclosures (k,), dense Jacobian (k, c) and unknowns (c,) of one cluster, not whitened."""
    (alone,) = alike_clusters(problem, [cluster])
    misclosure, jacobian = alone.rows(problem, values, tangent)
    return misclosure[0], jacobian[0], alone.columns[0]


def linearised_parts(
    alike: AlikeClusters, problem: Problem, values: Values, tangent: FloatArray | None
) -> list[tuple[PartOfClusters, Linearised]]:
    """The parts of alike clusters with their linearised rows."""
    groups, index = problem.groups, problem.index
    return [(part, linearise(groups[part.group], index, values, tangent, part.rows)) for part in alike.parts]


def group_columns(group: ObservationGroup, index: Index, rows: IntArray) -> IntArray:
    """(n, K) unknowns of the chosen rows, over all slots that are not fixed throughout."""
    parts = [
        index.columns[slot.kind][number[rows]] for slot, number in zip(group.type.slots, group.blocks, strict=True)
    ]
    used = [part for part in parts if (part >= 0).any()]
    return np.concatenate(used, axis=1) if used else np.zeros((len(rows), 0), dtype=np.int64)


def columns_of_clusters(problem: Problem, clusters: Sequence[ClusterRows]) -> list[IntArray]:
    """Unknowns (sorted, each once) that the entries of each cluster depend on."""
    if not clusters:
        return []
    groups, rows = (np.concatenate([getattr(c, name) for c in clusters]) for name in ("groups", "rows"))
    cluster = np.repeat(np.arange(len(clusters)), [len(one.rows) for one in clusters])
    count = problem.index.count
    found = [np.zeros(0, dtype=np.int64)]
    for number in np.unique(groups).tolist():
        own = groups == number
        columns = group_columns(problem.groups[number], problem.index, rows[own])
        found.append((columns + cluster[own, None] * count)[columns >= 0])
    which, columns = np.divmod(np.unique(np.concatenate(found)), max(count, 1))
    return np.split(columns, np.searchsorted(which, np.arange(1, len(clusters))))


# ---- Observations that have no value or no derivative at a place: a bearing between two points that coincide there.


def undefined_rows(group: ObservationGroup, index: Index, values: Values) -> IntArray:
    """Rows of a group whose misclosure or derivatives, or their weighted squares, are no numbers at ``values``."""
    tangent = rotation_tangents(index, values)
    found = [np.zeros(0, dtype=np.int64)]
    with np.errstate(all="ignore"):
        rows_at_a_time = 100_000
        for first in range(0, group.count, rows_at_a_time):
            piece = slice(first, first + rows_at_a_time)
            rows = linearise(group, index, values, tangent, piece)
            weight = np.where(np.isfinite(group.observed[piece]), group.sigma[piece], 1.0) ** -2
            sums = weight * (rows.misclosure**2 + (rows.jacobian**2).sum(axis=2))
            good = np.isfinite(sums).all(axis=1)
            found.append(first + np.flatnonzero(~good))
    return np.concatenate(found)
