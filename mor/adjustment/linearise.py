"""Linearise observation groups: misclosures, Jacobians and the columns they belong to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.equations import evaluated
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray, IntArray
from mor.observations import Computed, ObservationGroup, wrap
from mor.parameters.index import Index, Values, tangents


class Linearised(NamedTuple):
    """n observation rows of m components, K columns each."""

    misclosure: FloatArray
    """(n, m) observed − computed, wrapped for angles, 0 where not observed."""
    jacobian: FloatArray
    """(n, m, K), zero rows where not observed."""
    columns: IntArray
    """(n, K) unknowns, −1 where fixed."""


def rotation_tangents(index: Index, values: Values) -> FloatArray | None:
    """Tangents of the rotations that move by angles (see :func:`mor.parameters.index.tangents`)."""
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
    group: ObservationGroup,
    index: Index,
    tangent: FloatArray | None,
    rows: IntArray | slice,
    computed: Computed,
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
