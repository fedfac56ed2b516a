"""Control points: two exchanged, all in another unit, northing and easting exchanged."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.approximate.similarity import similarity
from mor.arrays import FloatArray, IntArray
from mor.diagnose.distances import LENGTHS
from mor.diagnose.edits import CellEdit, Edit, KeyEdit, key, to
from mor.diagnose.hypothesis import Hypothesis, with_group, with_points
from mor.diagnose.situation import SMALL, Situation
from mor.project.network.build import Network
from mor.quality.gross_errors.reintersection import by_sights_alone, costs_at_places

_PAIRS = 3
"""Exchanges that are tried, of all pairs."""
_SUSPECTED = 12
"""Control points whose sights are put to each other's places: those they fit worst at their own."""
_POINTS = 60
"""Control points up to which all pairs are looked through."""


class Control(NamedTuple):
    """Points of one table whose coordinates are all given, fixed or observed."""

    label: str
    points: IntArray
    given: FloatArray
    """(k, 3) internal axes."""
    observed: bool


def control_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Another unit, and exchanged axes, of every table of control."""
    tables = [control for control in control_tables(situation) if len(control.points) >= 2]
    return [h for control in tables for h in (*_axes(situation, control), *_units(situation, control))]


def exchange_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Two points of a table exchanged, where one of them does not fit."""
    return [h for control in control_tables(situation) for h in _exchanges(situation, control)]


def moved_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the control points that score tests say have moved, as free ones: alone, and all of a cause together."""
    ids = situation.network.blocks["point"].ids
    place = {name: k for k, name in enumerate(ids)}
    found = []
    for one in situation.scored:
        if one.cause != "control moved":
            continue
        points = np.array([place[name] for name in one.things if name in place])
        found.append(
            Hypothesis(
                "control moved",
                one.things,
                partial(_released, points=points),
                f"points, {', '.join(one.things)}: x, y, z",
                max(sum(len(control.points) for control in control_tables(situation)), 1),
                parameters=3 * len(points),
            )
        )
    return found


def _released(network: Network, points: IntArray) -> Network:
    """The network with some points neither fixed nor observed."""
    blocks = network.blocks["point"]
    free = blocks.free.copy()
    free[points] = True
    network = replace(network, blocks={**network.blocks, "point": blocks._replace(free=free)})
    for number, group in enumerate(network.groups):
        if group.type.key in ("observed/point", "coordinates"):
            rows = np.flatnonzero(np.isin(group.blocks[0], points))
            observed = group.observed.copy()
            observed[rows] = np.nan
            network = with_group(network, number, replace(group, observed=observed))
    return network


def control_tables(situation: Situation) -> list[Control]:
    """Control as the tables of the project have it."""
    network = situation.network
    own = network.things["point"]
    ids, blocks = network.blocks["point"].ids, network.blocks["point"]
    tables = []
    for group in network.groups:
        if group.type.key not in ("observed/point", "coordinates"):
            continue
        points = np.asarray(group.blocks[0], dtype=np.int64)
        declared = np.isin(points, own.parts["position"])
        full = np.isfinite(group.observed).all(axis=1) & declared
        if full.any():
            names = {network.point_groups.get(int(p), "") for p in points[full]}
            label = names.pop() if len(names) == 1 else ""
            tables.append(Control(label or group.name, points[full], group.observed[full], True))
    held = ~blocks.free.any(axis=1) & np.isin(np.arange(len(ids)), own.parts["position"])
    seen = np.zeros(len(ids), dtype=bool)
    for group in network.groups:
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point":
                seen[numbers] = True
    fixed = np.flatnonzero(held & seen)
    if len(fixed):
        labels = {network.point_groups.get(int(p), "") for p in fixed} - {""}
        label = labels.pop() if len(labels) == 1 else "points"
        tables.append(Control(label, fixed, situation.start["point"][fixed], False))
    return tables


def _table(situation: Situation, control: Control) -> tuple[str | int, ...] | None:
    """Path of the table of points by its label."""
    entries = situation.network.project.points
    found = [k for k, e in enumerate(entries) if control.label in (e.group, e.name, e.file)]
    if control.label == "points" and len(entries) == 1:
        found = [0]
    return ("points", found[0]) if len(found) == 1 else None


def _unit_edits(situation: Situation, control: Control, unit: str) -> tuple[Edit, ...]:
    at = _table(situation, control)
    return () if at is None else (key((*at, "units"), f"{{x: {unit}, y: {unit}, z: {unit}}}"),)


def _axes_edits(situation: Situation, control: Control) -> tuple[Edit, ...]:
    at = _table(situation, control)
    if at is None:
        return ()

    def exchanged(old: str, _amount: object) -> str | None:
        if not old:
            return "{x: y, y: x}"
        if not old.startswith("["):
            return None
        other = {"x": "y", "y": "x", "sigma_x": "sigma_y", "sigma_y": "sigma_x"}
        return re.sub(r"\w+", lambda found: other.get(found[0], found[0]), old)

    return (KeyEdit((*at, "columns"), exchanged),)


def _units(situation: Situation, control: Control) -> list[Hypothesis]:
    return [
        Hypothesis(
            "control unit",
            (control.label, name),
            partial(with_points, points=control.points, change=partial(np.multiply, factor)),
            f"points, {control.label}: units: {{x: {name.split()[0]}, y: {name.split()[0]}, z: {name.split()[0]}}}",
            len(LENGTHS),
            afresh=True,
            stretch=control.given.size * float(np.log(factor)) if control.observed else 0.0,
            anew={"point": control.points},
            edits=_unit_edits(situation, control, name.split()[0]),
        )
        for name, factor in LENGTHS.items()
    ]


def _axes(situation: Situation, control: Control) -> list[Hypothesis]:
    turn = situation.network.edge.matrix
    swap = turn @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ turn.T
    return [
        Hypothesis(
            "axes exchanged",
            (control.label,),
            lambda network: with_points(network, control.points, lambda xyz: xyz @ swap.T),
            f"points, {control.label}: columns: {{x: y, y: x}}",
            afresh=True,
            anew={"point": control.points},
            edits=_axes_edits(situation, control),
        )
    ]


def _exchanges(situation: Situation, control: Control) -> list[Hypothesis]:
    """The pairs whose sights fit each other's places, and that leave least misclosure of a similarity to theirs."""
    count = len(control.points)
    if count < 3:
        return []
    best = _scored(situation, control)
    best += [pair for pair in _sighted_exchanged(situation, control) if pair not in best]
    if count <= _POINTS:
        adjusted = _without_control(situation, control)
        sums = {pair: _misfit(situation, control, adjusted, pair) for pair in combinations(range(count), 2)}
        best += [pair for pair in sorted(sums, key=lambda pair: sums[pair])[:_PAIRS] if pair not in best]
    return [_exchange(situation, control, pair, count * (count - 1) // 2) for pair in best]


def _scored(situation: Situation, control: Control) -> list[tuple[int, int]]:
    """Pairs that score tests name: as exchanged, or as two that moved."""
    ids = situation.network.blocks["point"].ids
    place = {ids[point]: k for k, point in enumerate(control.points.tolist())}
    found = []
    for one in situation.scored:
        pair = sorted(place[name] for name in one.things if name in place)
        if one.cause in ("control exchanged", "control moved") and len(pair) == 2 == len(one.things):
            found.append((pair[0], pair[1]))
    return list(dict.fromkeys(found))


def _without_control(situation: Situation, control: Control) -> FloatArray:
    """(k, 3) where the points are by their sights; where nobody sights them, where they are in the adjustment."""
    adjusted = situation.values["point"][control.points]
    if situation.count > SMALL:
        return adjusted
    problem = situation.make(situation.network, situation.start, situation.values)
    places = by_sights_alone(problem, situation.values, control.points)
    return np.where(np.isfinite(places), places, adjusted)


def _sighted_exchanged(situation: Situation, control: Control) -> list[tuple[int, int]]:
    """Pairs of which the sights to each fit the given place of the other, and not its own; the clearest first."""
    if situation.count > SMALL:
        return []
    problem, values = situation.make(situation.network, situation.start, situation.values), situation.values
    points, given = control.points.tolist(), control.given
    own = [float(costs_at_places(problem, values, p, given[[k]])[0]) for k, p in enumerate(points)]
    worst = np.argsort(-np.array(own), kind="stable")[:_SUSPECTED].tolist()
    there = {k: costs_at_places(problem, values, points[k], given[worst]) for k in worst}
    drops = {}
    for (m, one), (n, other) in combinations(enumerate(worst), 2):
        drop = own[one] + own[other] - there[one][n] - there[other][m]
        if drop > 0.5 * (own[one] + own[other]):
            drops[min(one, other), max(one, other)] = drop
    return sorted(drops, key=lambda pair: -drops[pair])[:_PAIRS]


def _swapped(given: FloatArray, pair: tuple[int, int]) -> FloatArray:
    order = np.arange(len(given))
    order[list(pair)] = order[list(reversed(pair))]
    return given[order]


def _misfit(situation: Situation, control: Control, adjusted: FloatArray, pair: tuple[int, int]) -> float:
    """Misfit of the given coordinates, two exchanged, to those that were adjusted: as they are, or moved as a whole."""
    given = _swapped(control.given, pair)
    plain = float(np.median(np.linalg.norm(adjusted - given, axis=1)))
    if len(given) < 4:
        return float(np.sum((adjusted - given) ** 2))
    fitted = similarity(adjusted, given)
    residuals = fitted.residuals if fitted.outcome.usable else adjusted - given
    return min(float(np.sum(residuals**2)), plain**2 + float(np.sum((adjusted - given) ** 2)))


def _exchange(situation: Situation, control: Control, pair: tuple[int, int], candidates: int) -> Hypothesis:
    names = [situation.network.blocks["point"].ids[control.points[k]] for k in pair]
    points = control.points[list(pair)]
    return Hypothesis(
        "control exchanged",
        tuple(names),
        lambda network: with_points(network, points, lambda xyz: xyz[::-1]),
        f"points, {control.label}: {names[0]} ↔ {names[1]}",
        candidates,
        anew={"point": points},
        edits=tuple(
            CellEdit(("points",), "id", to(other), cells={"id": own})
            for own, other in zip(names, reversed(names), strict=True)
        ),
    )
