"""Hypotheses about heights, levelling lines and the curvature of the Earth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from mor.diagnose.hypothesis import (
    CellEdit,
    Edit,
    Hypothesis,
    Situation,
    cells,
    computed,
    key_edit,
    with_amount,
    with_blocks,
    with_observed,
    with_unknown,
)
from mor.errors import InputError
from mor.linalg.cholesky import NotFiniteError
from mor.model.contract import ObservationGroup
from mor.model.curvature import on_sphere
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import Values
from mor.project.network import Network
from mor.quality.plausibility import NOTED, beyond_reach, largest_effect, sphere_under, usual_height
from mor.quality.solution import AddedParameter
from mor.solve.iterate import Adjustment
from mor.solve.problem import linearise, misclosures, rotation_tangents
from mor.types import FloatArray, IntArray

# ---- Heights of instruments and targets: forgotten, or taken with another tape.
#
# Of every station, and of every target at all stations and at each of them, the height is an unknown for
# once. Which of them are worth an adjustment is told by the Lagrange multiplier test: with b the derivatives
# of the observations by the height, T = (bᵀPw)² / (bᵀPb − bᵀPA Q AᵀPb), w = l − A Q AᵀPl what a step leaves
# of the misclosures l of all observations, also of those that a robust adjustment left out: a wrong height
# may have won its points against them.

_TRIED = 8
"""Heights that are tried: those that promise most."""


class HeightRows(NamedTuple):
    """Rows (group, rows, slot of the height) that share a height."""

    cause: str
    things: tuple[str, ...]
    rows: tuple[tuple[int, IntArray, int], ...]

    @property
    def line(self) -> str:
        """Line to write in the project."""
        names = ", from ".join(self.things)
        is_instrument = self.cause == "instrument height"
        return f"stations, {names}: height" if is_instrument else f"observations, to {names}: to_height"


def height_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The heights that promise most."""
    if not situation.settled or not situation.begun or "height" not in situation.network.blocks:
        return []
    # Heights that are looked at.
    sights = list(height_sights(situation.network))[:400]
    if not sights:
        return []
    try:
        all_of_them = situation.linearised
    except (InputError, NotFiniteError):
        return []
    # Numbers that their test may take.
    sights = sights[: 20_000_000 // max(all_of_them.problem.index.count, 1)]
    promised = _reductions(all_of_them, sights)
    best = np.argsort(-promised, kind="stable")[:_TRIED]
    # Reduction of vᵀPv that is worth an adjustment: less would not be offered.
    return [_hypothesis(situation, sights[k], len(sights)) for k in best if promised[k] > 20.0]


def implausible_height_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the heights that nobody can reach, as unknowns that begin at the usual height."""
    beyond = beyond_reach(situation.network)
    if not beyond.any():
        return []
    found = []
    for one in height_sights(situation.network):
        number, rows, slot = one.rows[0]
        if len(one.things) == 1 and beyond[situation.network.groups[number].blocks[slot][rows]].all():
            found.append(replace(_hypothesis(situation, one, 1, usual_height(situation.network)), afresh=True))
    return found[:_TRIED]


def antenna_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the antenna heights that score tests name, with their amounts: vectors are linear in them."""
    return [
        _antenna(situation, one.things[0], one.amount)
        for one in situation.scored
        if one.cause == "antenna height" and one.amount is not None
    ]


def _antenna(situation: Situation, name: str, amount: AddedParameter) -> Hypothesis:
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

    edits = (
        cells(network, number, rows.tolist(), "dz", computed(partial(float.__add__, by))) for number, rows, by in ends
    )
    return Hypothesis(
        "antenna height",
        (name,),
        change,
        f"observations, vectors at {name}: antenna height",
        len(ends),
        parameters=1,
        edits=sum(edits, ()),
        amount=lambda _values: amount,
    )


def height_sights(network: Network) -> Iterator[HeightRows]:
    """Yield all sets of rows that may share a wrong height: sights from stations, or sights with given heights."""
    sets: dict[tuple[str, tuple[str, ...]], list[tuple[int, IntArray, int]]] = {}
    stations = set(network.things["station"].ids) if "station" in network.things else set()
    free = network.blocks["height"].free[:, 0]
    for number, group in enumerate(network.groups):
        if not group.type.distances or group.type.between_marks:
            continue
        pairs = zip(group.type.references, group.references, strict=True)
        names = {reference.name: np.asarray(column) for reference, column in pairs}
        begin, end = group.type.distances
        for slot, own in enumerate(group.type.slots):
            if own.kind != "height" or own.of not in names:
                continue
            fixed = np.flatnonzero(~free[group.blocks[slot]])
            if not (network.start["height"][group.blocks[slot], 0] != 0.0).any():
                fixed = fixed[[name in stations for name in names[begin][fixed]]]
            at, to = names[begin][fixed], names[end][fixed]
            if own.of in ("station", "from"):
                keys = [("instrument height", (a,)) for a in at]
                _collect(sets, keys, number, fixed, slot)
            else:
                _collect(sets, [("target height", (t,)) for t in to], number, fixed, slot)
                _collect(sets, [("target height", (t, a)) for a, t in zip(at, to, strict=True)], number, fixed, slot)
    for (cause, things), rows in sets.items():
        yield HeightRows(cause, tuple(str(t) for t in things), tuple(rows))


def _collect(sets, keys, number, rows, slot) -> None:  # type: ignore[no-untyped-def]
    places: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for place, key in enumerate(keys):
        places.setdefault(key, []).append(place)
    for key, mine in places.items():
        sets.setdefault(key, []).append((number, rows[mine], slot))


def _reductions(here: Adjustment, sights: list[HeightRows]) -> FloatArray:
    """(k,) by how much vᵀPv becomes smaller with each height an unknown, to first order."""
    problem, values = here.problem, here.values
    tangent = rotation_tangents(problem.index, values)
    coupling = np.zeros((problem.index.count, len(sights)))
    own, right = np.zeros(len(sights)), np.zeros(len(sights))
    for k, one in enumerate(sights):
        for number, rows, slot in one.rows:
            group = problem.groups[number]
            blocks = [values[s.kind][b[rows]] for s, b in group.blocks_by_slot]
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


def _hypothesis(situation: Situation, sights: HeightRows, candidates: int, begin: float | None = None) -> Hypothesis:
    network = situation.network
    number = len(network.blocks["height"].ids)
    given = given_height(network, sights) if begin is None else begin

    def change(changed: Network) -> Network:
        changed, own = with_unknown(changed, "height", np.array([given]), np.array([True]))
        for group, rows, slot in sights.rows:
            changed = with_blocks(changed, group, list(rows), {slot: [own] * len(rows)})
        return changed

    def amount(values: Values) -> AddedParameter:
        return AddedParameter("height", float(values["height"][number, 0]))

    return Hypothesis(
        sights.cause,
        sights.things,
        change,
        sights.line,
        candidates,
        parameters=1,
        edits=_edits(network, sights),
        amount=amount,
    )


def _edits(network: Network, sights: HeightRows) -> tuple[Edit, ...]:
    write = with_amount(lambda _old, value: value)
    if sights.cause == "instrument height":
        return (CellEdit(("stations",), "height", write, cells={"id": sights.things[0]}),)
    return sum((cells(network, number, rows.tolist(), "to_height", write) for number, rows, _ in sights.rows), ())


def given_height(network: Network, sights: HeightRows) -> float:
    """Return the height that the rows of a hypothesis were read with."""
    group, rows, slot = sights.rows[0]
    return float(network.start["height"][network.groups[group].blocks[slot][rows[0]], 0])


# ---- Lines of levels that were booked the other way round.
#
# With the other sign the misclosure of a line changes by δ = −2 Δh, and vᵀPv, to first order and with all
# else adjusted again, by −2 δ v/σ² + δ² r/σ²: the lines for which it falls most are tried.


def levelling_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The lines that score tests name, and those that promise most, with the other sign."""
    found = list(_reversed_vectors(situation))
    for number, group in enumerate(situation.network.groups):
        if group.type != PLAIN_TYPES["height_difference"] or not situation.misfitting[number].any():
            continue
        scored = [place for one in situation.scored if one.cause == "levelling sign" for place in one.rows]
        rows = sorted({row for k, row in scored if k == number})
        if len(rows) > 1:
            found.append(_other_sign(situation, "levelling sign", number, rows))
        promised = _reductions_of_lines(situation, number, group)
        best = np.argsort(-promised, kind="stable")[:3]
        singles = (int(row) for row in best if promised[row] > 0.0)
        found += [_other_sign(situation, "levelling sign", number, [row]) for row in singles]
    return found


def _other_sign(situation: Situation, cause: str, number: int, rows: list[int]) -> Hypothesis:
    group = situation.network.groups[number]
    ends = [tuple(column[row] for column in group.references[:2]) for row in rows]
    columns = [component.name for component in group.type.components]
    edits = [cells(situation.network, number, rows, c, computed(lambda value: -value)) for c in columns]
    return Hypothesis(
        cause,
        tuple(dict.fromkeys(name for pair in ends for name in pair)),
        partial(with_observed, number=number, rows=np.array(rows), change=np.negative),
        "; ".join(f"{group.name}, {one} → {other}: {other} → {one}" for one, other in ends),
        group.count,
        rows=tuple((number, row) for row in rows),
        edits=sum(edits, ()),
    )


def _reversed_vectors(situation: Situation) -> Iterator[Hypothesis]:
    """Vectors that fit with the other sign, all of a table together; those that score tests name, if they name any."""
    scored = [place for one in situation.scored if one.cause == "vector sign" for place in one.rows]
    for number, group in enumerate(situation.network.groups):
        if group.type != PLAIN_TYPES["vector"]:
            continue
        misclosure = np.nan_to_num(misclosures(group, situation.values))
        other = misclosure - 2.0 * np.nan_to_num(group.observed)
        now, then = np.linalg.norm(misclosure, axis=1), np.linalg.norm(other, axis=1)
        # Part of its misclosure that is left of a vector with the other sign, at most: the others are not right yet.
        rows = np.flatnonzero((then < 0.1 * now) & situation.misfitting[number].any(axis=1))
        if scored:
            rows = np.array(sorted(row for k, row in scored if k == number), dtype=np.int64)
        if not len(rows):
            continue
        yield _other_sign(situation, "vector sign", number, rows.tolist())


def _reductions_of_lines(situation: Situation, number: int, group: ObservationGroup) -> FloatArray:
    """(n,) by how much vᵀPv becomes smaller with the other sign of a line; −∞ where that is not worked out."""
    solution = situation.solution
    values = situation.values if solution is None else solution.values
    used = group if solution is None else solution.problem.groups[number]
    misclosure, sigma = misclosures(group, values)[:, 0], group.given_sigma[:, 0]
    reductions = np.full(group.count, -np.inf)
    rows = np.argsort(-np.abs(misclosure / sigma), kind="stable")[:100]  # their redundancy is worked out
    rows = rows[group.mask[rows, 0]]
    redundancy = np.ones(len(rows))
    if solution is not None:
        own = np.flatnonzero(~used.left_out[rows, 0])
        redundancy[own] = _redundancy(solution, used, rows[own])
    change = -2.0 * group.observed[rows, 0]
    reductions[rows] = (-2.0 * change * misclosure[rows] - change**2 * redundancy) / sigma[rows] ** 2
    return reductions


def _redundancy(solution: Adjustment, group: ObservationGroup, rows: IntArray) -> FloatArray:
    problem, values = solution.problem, solution.values
    part = linearise(group, problem.index, values, rotation_tangents(problem.index, values), rows)
    coupling = np.zeros((problem.index.count, len(rows)))
    for k in range(len(rows)):
        free = part.columns[k] >= 0
        np.add.at(coupling[:, k], part.columns[k][free], part.jacobian[k, 0][free] / group.sigma[rows[k], 0])
    return np.asarray(1.0 - np.einsum("uk,uk->k", coupling, solution.inverse.solve(coupling)))


# ---- The curvature of the earth, where a project with parallel verticals was measured over distances at which it
# shows.


def curvature_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the hypothesis that the verticals are not parallel, if that changes any observation by enough."""
    effect = largest_effect(situation.network, situation.values) if situation.begun else None
    if effect is None or effect.in_sigma < NOTED:
        return []
    sphere = sphere_under(situation.network, situation.values)

    def change(network: Network) -> Network:
        metres = network.edge.metres
        groups = (replace(group, type=on_sphere(group.type, sphere, metres)) for group in network.groups)
        return replace(network, groups=tuple(groups), sphere=sphere)

    return [Hypothesis("curvature", (), change, "curvature: true", edits=(key_edit(("curvature",), "true"),))]
