"""Heights of instruments and targets: forgotten, or taken with another tape.

Of every station, and of every target at all stations and at each of them, the height is an unknown for once. Which of
them are worth an adjustment is told by the Lagrange multiplier test: with b the derivatives of the observations by the
height, T = (bᵀPw)² / (bᵀPb − bᵀPA Q AᵀPb), w = l − A Q AᵀPl what a step leaves of the misclosures l of all
observations, also of those that a robust adjustment left out: a wrong height may have won its points against them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.diagnose.edits import CellEdit, Edit, cells, computed, with_amount
from mor.diagnose.hypothesis import Hypothesis, with_blocks, with_observed, with_unknown
from mor.diagnose.situation import Situation
from mor.errors import InputError
from mor.observations import PLAIN_TYPES
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.plausibility.set_ups import beyond_reach, usual_height
from mor.quality.solved import Amount
from mor.sparse.cholesky import NotFiniteError

_TRIED = 8
"""Heights that are tried: those that promise most."""
_PROMISED = 20.0
"""Reduction of vᵀPv that is worth an adjustment: less would not be offered."""
_MOST = 400
"""Heights that are looked at."""
_ENTRIES = 20_000_000
"""Numbers that their test may take."""
_INSTRUMENT = ("station", "from")


class Sights(NamedTuple):
    """Rows (group, rows, slot of the height) that share a height."""

    cause: str
    things: tuple[str, ...]
    rows: tuple[tuple[int, IntArray, int], ...]


def height_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The heights that promise most."""
    if not situation.settled or not situation.begun or "height" not in situation.network.blocks:
        return []
    sights = list(height_sights(situation.network))[:_MOST]
    if not sights:
        return []
    try:
        all_of_them = situation.linearised
    except (InputError, NotFiniteError):
        return []
    sights = sights[: _ENTRIES // max(all_of_them.problem.index.count, 1)]
    promised = _reductions(all_of_them, sights)
    best = np.argsort(-promised, kind="stable")[:_TRIED]
    return [_hypothesis(situation, sights[k], len(sights)) for k in best if promised[k] > _PROMISED]


def implausible_height_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the heights that nobody can reach, as unknowns that begin at the usual height."""
    beyond = beyond_reach(situation.network)
    if not beyond.any():
        return []
    found = []
    for one in height_sights(situation.network):
        number, rows, slot = one.rows[0]
        if len(one.things) == 1 and beyond[situation.network.groups[number].blocks[slot][rows]].all():
            found.append(
                replace(_hypothesis(situation, one, 1, usual_height(situation.network)), afresh=True)
            )
    return found[:_TRIED]


def antenna_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the antenna heights that score tests name, with their amounts: vectors are linear in them."""
    return [
        _antenna(situation, one.things[0], one.amount)
        for one in situation.scored
        if one.cause == "antenna height" and one.amount is not None
    ]


def _antenna(situation: Situation, name: str, amount: Amount) -> Hypothesis:
    """The antenna at a point that was higher by an amount than it was said to be."""
    network = situation.network
    ends = []
    for number, group in enumerate(network.groups):
        if group.type == PLAIN_TYPES["vector"]:
            for column, sign in ((0, 1.0), (1, -1.0)):
                rows = np.flatnonzero([one == name for one in group.references[column]])
                if len(rows):
                    ends.append((number, rows, sign * amount.value))

    def change(changed: Network) -> Network:
        for number, rows, by in ends:
            shift = np.array([0.0, 0.0, by])
            changed = with_observed(changed, number, rows, lambda d, shift=shift: d + shift)  # type: ignore[misc]
        return changed

    edits = [
        cells(network, number, rows.tolist(), "dz", computed(partial(float.__add__, by)))
        for number, rows, by in ends
    ]
    return Hypothesis(
        "antenna height",
        (name,),
        change,
        f"observations, vectors at {name}: antenna height",
        len(ends),
        parameters=1,
        edits=tuple(edit for some in edits for edit in some),
        amount=lambda _values: amount,
    )


def height_sights(network: Network) -> Iterator[Sights]:
    """Yield all sets of rows that may share a wrong height: sights from stations, or sights with given heights."""
    sets: dict[tuple[str, tuple[str, ...]], list[tuple[int, IntArray, int]]] = {}
    stations = set(network.things["station"].ids) if "station" in network.things else set()
    free = network.blocks["height"].free[:, 0]
    for number, group in enumerate(network.groups):
        if not group.type.distances or group.type.between_marks:
            continue
        pairs = zip(group.type.references, group.references, strict=True)
        names = {reference.name: np.array(list(column)) for reference, column in pairs}
        begin, end = group.type.distances
        for slot, own in enumerate(group.type.slots):
            if own.kind != "height" or own.of not in names:
                continue
            fixed = np.flatnonzero(~free[group.blocks[slot]])
            if not (network.start["height"][group.blocks[slot], 0] != 0.0).any():
                fixed = fixed[[name in stations for name in names[begin][fixed]]]
            at, to = names[begin][fixed], names[end][fixed]
            if own.of in _INSTRUMENT:
                keys = [("instrument height", (a,)) for a in at]
                _collect(sets, keys, number, fixed, slot)
            else:
                _collect(sets, [("target height", (t,)) for t in to], number, fixed, slot)
                _collect(
                    sets,
                    [("target height", (t, a)) for a, t in zip(at, to, strict=True)],
                    number,
                    fixed,
                    slot,
                )
    for (cause, things), rows in sets.items():
        yield Sights(cause, tuple(str(t) for t in things), tuple(rows))


def _collect(sets, keys, number, rows, slot) -> None:  # type: ignore[no-untyped-def]
    """Add the rows of a group to the sets they belong to by their keys."""
    for key in dict.fromkeys(keys):
        mine = np.array([k == key for k in keys], dtype=bool)
        sets.setdefault(key, []).append((number, rows[mine], slot))


def _reductions(here: Adjustment, sights: list[Sights]) -> FloatArray:
    """(k,) by how much vᵀPv becomes smaller with each height an unknown, to first order."""
    problem, values = here.problem, here.values
    tangent = rotation_tangents(problem.index, values)
    coupling = np.zeros((problem.index.count, len(sights)))
    own, right = np.zeros(len(sights)), np.zeros(len(sights))
    for k, one in enumerate(sights):
        for number, rows, slot in one.rows:
            group = problem.groups[number]
            blocks = [values[s.kind][b[rows]] for s, b in zip(group.type.slots, group.blocks, strict=True)]
            derivative = group.type.equation(blocks, group.constants[rows]).jacobians[slot][:, :, 0]
            weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
            b = np.nan_to_num(derivative) * weight
            part = linearise(group, problem.index, values, tangent, rows)
            own[k] += float(np.sum(b**2))
            right[k] += float(np.sum(b * weight * np.nan_to_num(misclosures(group, values, rows))))
            products = np.einsum("nm,nmk->nk", b * weight, part.jacobian)
            free = part.columns >= 0
            np.add.at(coupling[:, k], part.columns[free], products[free])
    left = own - np.einsum("uk,uk->k", coupling, here.inverse.solve(coupling))
    right -= coupling.T @ here.inverse.step(here.normals)
    good = left > 1e-6 * own
    return np.where(good, right**2 / np.where(good, left, 1.0), 0.0)


def _hypothesis(
    situation: Situation, sights: Sights, candidates: int, begin: float | None = None
) -> Hypothesis:
    network = situation.network
    number = len(network.blocks["height"].ids)
    given = _given(network, sights) if begin is None else begin

    def change(changed: Network) -> Network:
        changed, own = with_unknown(changed, "height", np.array([given]), np.array([True]))
        for group, rows, slot in sights.rows:
            changed = with_blocks(changed, group, list(rows), {slot: [own] * len(rows)})
        return changed

    def amount(values: Values) -> Amount:
        return Amount("height", float(values["height"][number, 0]))

    what = "stations, {}: height" if sights.cause == "instrument height" else "observations, to {}: to_height"
    line = what.format(", from ".join(sights.things))
    return Hypothesis(
        sights.cause,
        sights.things,
        change,
        line,
        candidates,
        parameters=1,
        edits=_edits(network, sights),
        amount=amount,
    )


def _edits(network: Network, sights: Sights) -> tuple[Edit, ...]:
    write = with_amount(lambda _old, value: value)
    if sights.cause == "instrument height":
        return (CellEdit(("stations",), "height", write, cells={"id": sights.things[0]}),)
    found = [cells(network, number, rows.tolist(), "to_height", write) for number, rows, _ in sights.rows]
    return tuple(edit for edits in found for edit in edits)


def _given(network: Network, sights: Sights) -> float:
    """The height as it is given in the first of the rows."""
    group, rows, slot = sights.rows[0]
    return float(network.start["height"][network.groups[group].blocks[slot][rows[0]], 0])
