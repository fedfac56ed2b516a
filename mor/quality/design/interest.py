"""Cofactors of all that a plan is about: its observations, those it might have, and the coordinates with a required σ.

Let the rows of M be the whitened derivatives of the observations, planned and possible, and the required coordinates in
their datum, so that no row changes with a free movement of the network. Then K = M Q Mᵀ has everything: 1 − K_ii is the
redundancy number of a planned observation i, K_tt the variance of a coordinate t. To add (+) or to spare (−) the
observations j, k of them at a time, is an exact update

    K' = K ∓ K_·j R⁻¹ K_j·,    R = I ± K_jj.

Nothing has to be adjusted anew, however many such steps follow each other (W. Baarda's cofactors, the matrix inversion
lemma).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.geometry import tolerant
from mor.observations import ObservationGroup
from mor.observations.sigma import with_sigma_model
from mor.quality.assess import Quality

MOST_ROWS = 8_000
"""Rows that are looked at together: their cofactors are half a gigabyte."""
_NULL = 1e-6
"""Part of a row along a free movement of the network from which on it would change the datum."""


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

    rows: Rows
    units: list[Unit]
    correlated: list[tuple[IntArray, FloatArray]]
    unestimable: list[tuple[int, int]]
    """Candidates (group, row) that would change the datum; they are no units."""


def observation_rows(quality: Quality, candidates: Sequence[ObservationGroup]) -> ObservationRows:
    """The rows of M of the observations of a plan, and behind them those of its candidates."""
    adjustment = quality.adjustment
    problem, values = adjustment.problem, adjustment.values
    tangent = rotation_tangents(problem.index, values)
    rows = Rows(problem.index.count)
    units: list[Unit] = []
    entry = np.full(int(problem.offsets[-1]), -1)
    for number, group in enumerate(problem.groups):
        part = linearise(group, problem.index, values, tangent, slice(None))
        mask = group.mask & ~group.left_out  # checks take no part
        first = rows.add(part.jacobian, part.columns, mask, group.sigma, number)
        entry[problem.offsets[number] :][: mask.size][mask.ravel()] = np.arange(
            first, first + np.count_nonzero(mask)
        )
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
        words = (
            f"ranking looks at {len(M)} observations and coordinates together, expected {MOST_ROWS} at most"
        )
        raise InputError([Mistake(f"{words}; require less, or rank a part of the plan")])
    K = M @ adjustment.inverse.solve(np.ascontiguousarray(M.T))
    group_of = rows.group()
    taking_part = (group_of >= 0) & (group_of < len(adjustment.problem.groups))
    return Interest(
        0.5 * (K + K.T), taking_part, group_of, tuple(units), tuple(correlated), coordinates, tuple(skipped)
    )


class Rows:
    """Rows of M while they are gathered."""

    def __init__(self, unknowns: int) -> None:
        self.unknowns = unknowns
        self.parts: list[FloatArray] = []
        self.groups: list[IntArray] = []
        self.count = 0

    def add(
        self, jacobian: FloatArray, columns: IntArray, mask: BoolArray, sigma: FloatArray, number: int
    ) -> int:
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


def _whiten_clusters(problem: Problem, entry: IntArray, rows: Rows) -> list[tuple[IntArray, FloatArray]]:
    """Replace rows of correlated observations, which were divided by σ, by whitened ones."""
    found = []
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in rows.parts])])
    sigma = np.concatenate([group.sigma.ravel() for group in problem.groups])
    for cluster in problem.clusters:
        where = entry[cluster.entries]
        triangle = np.asarray(tolerant.cholesky(cluster.covariance), dtype=np.float64)
        part = np.searchsorted(offsets, where, side="right") - 1
        plain = np.stack([rows.parts[p][w - offsets[p]] for p, w in zip(part, where, strict=True)])
        white = tolerant.solve(triangle, plain * sigma[cluster.entries][:, None])
        for p, w, row in zip(part, where, white, strict=True):
            rows.parts[p][w - offsets[p]] = row
        found.append((where, triangle))
    return found


def _together(units: list[Unit], correlated: Sequence[tuple[IntArray, FloatArray]]) -> list[Unit]:
    """Units of which all that are correlated with each other are one."""
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


def _changes_datum(rows: Rows, unit: Unit, null: FloatArray) -> bool:
    if null.shape[1] == 0:
        return False
    own = rows.at(unit.rows)
    size = np.maximum(np.abs(own) @ np.abs(null), 1e-300)
    return bool((np.abs(own @ null) > _NULL * size).any())


def datum_rows(quality: Quality, blocks: IntArray, first: int) -> tuple[FloatArray, IntArray]:
    """Rows (t, u) of the free coordinates of point blocks in the datum, Sᵀe = e − B Hᵀ Gᵀe, numbered from ``first``.

    With them (points, 3) the row of each coordinate, −1 where it is fixed or not looked at.
    """
    chosen, places = coordinates_at(quality, blocks, first)
    dense = np.zeros((len(chosen), quality.adjustment.problem.index.count))
    dense[np.arange(len(chosen)), chosen] = 1.0
    datum = quality.datum
    if datum.null.shape[1]:
        normals = quality.adjustment.constraint.normals
        dense -= datum.null[chosen] @ datum.binding @ normals.T
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
