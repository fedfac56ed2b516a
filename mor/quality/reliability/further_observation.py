"""The one further observation that would control a weak one best.

A further observation j of the kinds at hand, with the whitened derivatives A_j and R_jj = I + A_j Q A_jᵀ, changes the
cofactors by Q' = Q − Q A_jᵀ R_jj⁻¹ A_j Q, and the redundancy number of an observation i, whitened a_i, hence by

    r_i' = r_i + hᵀ R_jj⁻¹ h,    h = A_j Q a_iᵀ.

One solution with a_i gives h of all candidates. As R_jj ≥ I, hᵀh bounds what each can gain: candidates are worked out
in its order, until none that is left can be better. What determines a movement that the datum settles controls nothing.
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
from mor.quality.reliability.influence_on_unknowns import Entry, gradient
from mor.quality.reliability.local_system import LocalSystem, local_system

_AT_A_TIME = 8
_MOST = 64
"""Candidates that are worked out for one weak observation."""
_NULL = 1e-6
"""Part of a candidate's derivatives along a movement that nothing determines, from which on it is no control."""


class Further(NamedTuple):
    """A further observation: a row of a group, with another target."""

    group: int
    row: int
    """The row at the same place, whose σ it has; the weak observation itself where that is to be measured once more."""
    target: int
    """Point block it would be made to, −1 for the same observation once more."""
    r: float
    """Redundancy number that the weak observation would have then."""


class _Candidates(NamedTuple):
    group: int
    rows: IntArray
    target: int
    jacobian: FloatArray
    """(k, m, K) whitened."""
    columns: IntArray


def best_further(quality: Quality, entry: Entry, targets: list[int]) -> Further:
    """What raises the redundancy number of an observation most; targets are the free point blocks it refers to.

    The same observation once more controls it, but repeats what is wrong with its place: it is taken where none from
    another place does half as much.
    """
    adjustment = quality.adjustment
    columns, values = gradient(adjustment, entry)
    group = adjustment.problem.groups[entry.group]
    sigma = float(group.sigma[entry.row, entry.component])
    r = float(quality.groups[entry.group].at(np.array([entry.row])).r[0, entry.component])
    again = (1.0 - r) ** 2 / (2.0 - r)
    repeated = Further(entry.group, entry.row, -1, r + again)
    best = repeated._replace(r=r + 0.5 * again)
    found = [one for target in targets for one in _candidates(quality, target)]
    if not found:
        return repeated
    used = np.concatenate([columns, *(one.columns.ravel() for one in found)])
    system = local_system(adjustment, used)
    right = np.zeros((len(system.columns), 1))
    np.add.at(right[:, 0], np.searchsorted(system.columns, columns), values * sigma)
    answer = system.solve(right)[:, 0]
    h = [_image(one, system, answer) for one in found]
    bound = np.concatenate([np.sum(part**2, axis=1) for part in h])
    which = np.concatenate([np.full(len(one.rows), k) for k, one in enumerate(found)])
    place = np.concatenate([np.arange(len(one.rows)) for one in found])
    order = np.argsort(-bound, kind="stable")[:_MOST]
    for first in range(0, len(order), _AT_A_TIME):
        some = order[first : first + _AT_A_TIME]
        some = some[bound[some] + r > best.r]
        if not len(some):
            break
        for k, gain in zip(some, _gains(system, found, h, which[some], place[some]), strict=True):
            if r + gain > best.r:
                one = found[which[k]]
                best = Further(one.group, int(one.rows[place[k]]), one.target, float(r + gain))
    return best if best.target >= 0 else repeated


def _image(one: _Candidates, system: LocalSystem, x: FloatArray) -> FloatArray:
    """(k, m) A_j x."""
    moved = np.where(one.columns >= 0, x[_places(system, one.columns)], 0.0)
    image: FloatArray = np.einsum("kmc,kc->km", one.jacobian, moved)
    return image


def _gains(
    system: LocalSystem, found: list[_Candidates], h: list[FloatArray], which: IntArray, place: IntArray
) -> list[float]:
    """hᵀ R_jj⁻¹ h of some candidates, all solved for together."""
    rows = [(found[w].jacobian[p], found[w].columns[p]) for w, p in zip(which, place, strict=True)]
    right = np.zeros((len(system.columns), sum(len(jacobian) for jacobian, _ in rows)))
    at = 0
    for jacobian, columns in rows:
        free = columns >= 0
        for component in jacobian:
            np.add.at(right[:, at], _places(system, columns[free]), component[free])
            at += 1
    answer, at, gains = system.solve(right), 0, []
    for (jacobian, columns), w, p in zip(rows, which, place, strict=True):
        m, free = len(jacobian), columns >= 0
        q = jacobian[:, free] @ answer[_places(system, columns[free]), at : at + m]
        at += m
        gains.append(_gain(h[w][p], 0.5 * (q + q.T)))
    return gains


def _gain(own: FloatArray, q: FloatArray) -> float:
    """hᵀ (I + q)⁻¹ h of one candidate (m,), (m, m); nothing where its cofactors cannot be computed.

    By eigenvalues, none below 0: the cofactors of what hardly anything determines are large, and of less than full rank
    to their last digit.
    """
    if not np.isfinite(q).all():
        return 0.0
    large, axes = np.linalg.eigh(q)
    return float(np.sum((axes.T @ own) ** 2 / (1.0 + np.maximum(large, 0.0))))


def _places(system: LocalSystem, columns: IntArray) -> IntArray:
    """Places of columns among the unknowns of the system; anything where fixed."""
    return np.minimum(np.searchsorted(system.columns, columns), len(system.columns) - 1)


def _candidates(quality: Quality, target: int) -> Iterator[_Candidates]:
    """Observations of every table that sees points, from each place of it that does not see the target yet."""
    adjustment = quality.adjustment
    index, values = adjustment.problem.index, adjustment.values
    tangent = rotation_tangents(index, values)
    null = adjustment.inverse.null
    for number, group in enumerate(adjustment.problem.groups):
        rows = _templates(group, target)
        if not len(rows):
            continue
        further = aimed_at(group, rows, target)
        part = linearise(further, index, values, tangent, slice(None))
        seen = _in_view(group, further, part, values) & _estimable(part, null)
        if seen.any():
            weight = np.where(further.mask, 1.0 / further.sigma, 0.0)
            jacobian = part.jacobian * weight[:, :, None]
            yield _Candidates(number, rows[seen], target, jacobian[seen], part.columns[seen])


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


def _target_slot(group: ObservationGroup) -> int:
    """Slot of the position of the last thing a type refers to, −1 where it is no point that is looked at."""
    last = group.type.references[-1].name if len(group.type.references) > 1 else ""
    for k, slot in enumerate(group.type.slots):
        if slot.of == last and slot.kind == "point" and slot.part == "position":
            return k
    return -1


def _templates(group: ObservationGroup, target: int) -> IntArray:
    """One row for each place of a group that does not see the target, the most complete one."""
    place = _target_slot(group)
    if place < 0 or len(group.type.references) != 2 or group.type.references[-1].name == "system":
        return np.zeros(0, dtype=np.int64)
    inside = (group.mask & ~group.left_out).any(axis=1)
    standpoint = group.references[0].numbers
    sees = np.unique(standpoint[inside & (group.blocks[place] == target)])
    usable = np.flatnonzero(inside & ~np.isin(standpoint, sees))
    own = [k for k, slot in enumerate(group.type.slots) if slot.kind == "point" and k != place]
    usable = usable[np.all([group.blocks[k][usable] != target for k in own], axis=0)] if own else usable
    order = usable[np.argsort(-group.mask[usable].sum(axis=1), kind="stable")]
    _, first = np.unique(standpoint[order], return_index=True)
    return np.sort(order[first])


def _in_view(
    group: ObservationGroup, further: ObservationGroup, part: Linearised, values: Values
) -> BoolArray:
    """True (k,) where an image would show the target: before the camera, and inside what its images have measured."""
    if group.type.key not in OF_IMAGES:
        return np.ones(further.count, dtype=bool)
    slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
    interior = group.blocks[slots["image", "interior"]]
    seen = np.ones(further.count, dtype=bool)
    computed = -part.misclosure  # of an observation that is 0
    for camera in np.unique(further.blocks[slots["image", "interior"]]):
        here = further.blocks[slots["image", "interior"]] == camera
        measured = group.observed[interior == camera]
        low, high = np.nanmin(measured, axis=0), np.nanmax(measured, axis=0)
        seen[here] = ((computed[here] >= low) & (computed[here] <= high)).all(axis=1)
    if ("image", "base") in slots:
        return seen
    D = values["rotation"][further.blocks[slots["image", "rotation"]]]
    sight = values["point"][further.blocks[-1]] - values["point"][further.blocks[slots["image", "position"]]]
    before: BoolArray = np.einsum("kj,kj->k", D[:, 2], sight) < 0.0
    return seen & before


def _estimable(part: Linearised, null: FloatArray) -> BoolArray:
    """True (k,) for rows that no movement left open by the observations changes."""
    if null.shape[1] == 0:
        return np.ones(len(part.jacobian), dtype=bool)
    moved = np.where((part.columns >= 0)[:, :, None], null[part.columns], 0.0)
    image = np.abs(part.jacobian @ moved)
    size = np.abs(part.jacobian) @ np.abs(moved)
    return np.asarray((image <= _NULL * np.maximum(size, 1e-300)).all(axis=(1, 2)))
