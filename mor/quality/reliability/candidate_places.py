"""Further observations that could be made: of every table that sees points, from each of its places to another point.

A candidate has the σ and the constants of the most complete row that its table has from that place; an image shows a
point only where it lies before the camera and inside of what the camera has measured so far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import Linearised, linearise, rotation_tangents
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup, some_rows
from mor.parameters.index import Values
from mor.quality.assess import Quality
from mor.quality.reliability.influence_on_position import OF_IMAGES

_NULL = 1e-6
"""Part of a candidate's derivatives along a movement that nothing determines, from which on it is no control."""


class Candidates(NamedTuple):
    """Observations that could be made to one target."""

    group: int
    rows: IntArray
    """(k,) row of the same place whose σ each has."""
    target: int
    jacobian: FloatArray
    """(k, m, K) whitened."""
    columns: IntArray


class CandidatePlaces(NamedTuple):
    """The places of all tables from which further points can be observed."""

    quality: Quality
    tangent: FloatArray | None
    tables: tuple[_Table, ...]

    def candidates(self, target: int) -> Iterator[Candidates]:
        """Candidates to a point block from every place that does not see it yet and could, and is of some use."""
        adjustment = self.quality.adjustment
        index, values = adjustment.problem.index, adjustment.values
        for table in self.tables:
            rows = table.places_without(target)
            if not len(rows):
                continue
            further = aimed_at(table.group, rows, target)
            part = linearise(further, index, values, self.tangent, slice(None))
            seen = table.in_view(further, part, values) & _estimable(part, adjustment.inverse.null)
            if seen.any():
                weight = np.where(further.mask, 1.0 / further.sigma, 0.0)
                jacobian = part.jacobian * weight[:, :, None]
                yield Candidates(table.number, rows[seen], target, jacobian[seen], part.columns[seen])


def candidate_places(quality: Quality) -> CandidatePlaces:
    """Gather the places once, for any number of targets."""
    problem = quality.adjustment.problem
    tables = (
        _table(number, group)
        for number, group in enumerate(problem.groups)
        if group.count
        and _target_slot(group) >= 0
        and len(group.type.references) == 2
        and group.type.references[-1].name != "system"
    )
    tangent = rotation_tangents(problem.index, quality.adjustment.values)
    return CandidatePlaces(quality, tangent, tuple(tables))


def aimed_at(group: ObservationGroup, rows: IntArray, target: int) -> ObservationGroup:
    """The rows of a group with a point block as their target; what would be observed is set to 0."""
    further, place = some_rows(group, rows), _target_slot(group)
    aimed = np.full(len(rows), target)
    return replace(
        further,
        blocks=tuple(aimed if k == place else own for k, own in enumerate(further.blocks)),
        observed=np.where(further.mask, 0.0, np.nan),
        sigma=further.given_sigma,
        excluded=None,
    )


class _Table(NamedTuple):
    """A group of observations from places to points."""

    number: int
    group: ObservationGroup
    order: IntArray
    """Rows with observations: by their place, the most complete row of each first."""
    measured: dict[int, tuple[FloatArray, FloatArray]]
    """What each camera has measured: the smallest and the largest coordinates; empty where it is no table of images."""

    def places_without(self, target: int) -> IntArray:
        """One row for each place that does not see the target, the most complete one, in ascending order."""
        group, order, slot = self.group, self.order, _target_slot(self.group)
        standpoint = group.references[0].numbers[order]
        seen = np.zeros(int(group.references[0].numbers.max()) + 1, dtype=bool)
        seen[standpoint[group.blocks[slot][order] == target]] = True
        usable = ~seen[standpoint]
        for k, other in enumerate(group.type.slots):
            if other.kind == "point" and k != slot:
                usable &= group.blocks[k][order] != target
        rows, standpoint = order[usable], standpoint[usable]
        first = np.append(True, standpoint[1:] != standpoint[:-1]) if len(rows) else usable[:0]
        return np.sort(rows[first])

    def in_view(self, further: ObservationGroup, part: Linearised, values: Values) -> BoolArray:
        """True (k,) where an image would show the target: before it, and inside what its camera has measured."""
        seen: BoolArray = np.ones(further.count, dtype=bool)
        if not self.measured:
            return seen
        slots = {(slot.of, slot.part): k for k, slot in enumerate(further.type.slots)}
        computed = -part.misclosure  # of an observation that is 0
        interior = further.blocks[slots["image", "interior"]]
        for camera in np.unique(interior):
            here, (low, high) = interior == camera, self.measured[int(camera)]
            seen[here] = ~((computed[here] < low) | (computed[here] > high)).any(axis=1)
        if ("image", "base") in slots:
            return seen
        D = values["rotation"][further.blocks[slots["image", "rotation"]]]
        centre = values["point"][further.blocks[slots["image", "position"]]]
        sight = values["point"][further.blocks[-1]] - centre
        before: BoolArray = np.einsum("kj,kj->k", D[:, 2], sight) < 0.0
        return seen & before


def _table(number: int, group: ObservationGroup) -> _Table:
    complete = group.mask.sum(axis=1)
    inside = np.flatnonzero((group.mask & ~group.left_out).any(axis=1))
    order = inside[np.lexsort((-complete[inside], group.references[0].numbers[inside]))]
    measured = {}
    if group.type.key in OF_IMAGES:
        slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
        interior = group.blocks[slots["image", "interior"]]
        for camera in np.unique(interior).tolist():
            own = group.observed[interior == camera]
            measured[camera] = np.fmin.reduce(own, axis=0), np.fmax.reduce(own, axis=0)
    return _Table(number, group, order, measured)


def _target_slot(group: ObservationGroup) -> int:
    """Slot of the position of the last thing a type refers to, −1 where it is no point that is looked at."""
    last = group.type.references[-1].name if len(group.type.references) > 1 else ""
    for k, slot in enumerate(group.type.slots):
        if slot.of == last and slot.kind == "point" and slot.part == "position":
            return k
    return -1


def _estimable(part: Linearised, null: FloatArray) -> BoolArray:
    """True (k,) for rows that no movement left open by the observations changes."""
    if null.shape[1] == 0:
        return np.ones(len(part.jacobian), dtype=bool)
    moved = np.where((part.columns >= 0)[:, :, None], null[part.columns], 0.0)
    image = np.abs(part.jacobian @ moved)
    size = np.abs(part.jacobian) @ np.abs(moved)
    return np.asarray((image <= _NULL * np.maximum(size, 1e-300)).all(axis=(1, 2)))
