"""Hypotheses about control points, distances and standard deviations."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.diagnose.hypothesis import (
    OBSERVED_POINTS,
    SMALL,
    CellEdit,
    Edit,
    Hypothesis,
    KeyEdit,
    Situation,
    key_edit,
    table_key,
    table_of,
    to,
    with_group,
    with_observed,
    with_points,
    with_unknown,
)
from mor.model.contract import ObservationGroup
from mor.model.images import is_image_point
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import Values
from mor.project.network import Network
from mor.quality.outliers import by_sights_alone, costs_at_places
from mor.quality.plausibility import beyond_any_instrument
from mor.quality.solution import AddedParameter
from mor.quality.test_statistics import robust_sigma
from mor.solve.problem import misclosures
from mor.start.bundle import similarity
from mor.types import BoolArray, FloatArray, IntArray

# ---- Distances of one instrument: a common offset, a common scale, slope for horizontal.

DISTANCE, HORIZONTAL_DISTANCE = PLAIN_TYPES["distance"], PLAIN_TYPES["horizontal_distance"]
_AT_LEAST = 3
"""Distances that a common error shows in."""
_COMPONENTS = {"scale": 0, "offset": 1}


def distance_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Hypotheses about every group of distances, and about those that share an instrument."""
    network = situation.network
    numbers = [k for k, g in enumerate(network.groups) if g.type in (DISTANCE, HORIZONTAL_DISTANCE)]
    sets: list[tuple[str, tuple[int, ...]]] = [
        (network.groups[k].name, (k,)) for k in numbers if network.groups[k].count >= _AT_LEAST
    ]
    if len(numbers) > 1:
        sets.append((", ".join(network.groups[k].name for k in numbers), tuple(numbers)))
    found = []
    for label, chosen in sets:
        names = [name for name in _COMPONENTS if not _is_free(network, chosen, name)]
        found += [_common(network, label, chosen, name, len(sets)) for name in names]
    return found + [_other_kind(network, k) for k in numbers]


LENGTHS = {
    "mm for m": 0.001,
    "m for mm": 1000.0,
    "ft for m": 0.3048,
    "m for ft": 1.0 / 0.3048,
    "cm for m": 0.01,
    "m for cm": 100.0,
}


def table_unit_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the hypotheses that all lengths of a table are in another unit, those that score tests name first."""
    network, found = situation.network, []
    scored = [one.things for one in situation.scored if one.cause == "table unit"]
    for number, group in enumerate(network.groups):
        lengths = np.array([c.quantity.length == 1 for c in group.type.components])
        if not lengths.any() or not group.type.distances or group.count < _AT_LEAST or is_image_point(group.type):
            continue
        count = int(np.count_nonzero(group.mask[:, lengths]))
        for words, factor in LENGTHS.items():
            unit = words.split()[0]
            factors = np.where(lengths, factor, 1.0)
            names = [c.name for c, own in zip(group.type.components, lengths, strict=True) if own]
            found.append(
                Hypothesis(
                    "table unit",
                    (group.name, words),
                    partial(_scaled, number=number, factors=factors),
                    f"observations, {group.name}: units: {unit}",
                    len(LENGTHS),
                    stretch=count * float(np.log(factor)),
                    afresh=True,
                    edits=table_key(network, number, "units", f"{{{', '.join(f'{n}: {unit}' for n in names)}}}"),
                )
            )
    return sorted(found, key=lambda one: one.things not in scored)


def _scaled(network: Network, number: int, factors: FloatArray) -> Network:
    return with_observed(network, number, np.arange(network.groups[number].count), lambda observed: observed * factors)


def _is_free(network: Network, chosen: tuple[int, ...], name: str) -> bool:
    free = network.blocks["distance meter"].free[:, _COMPONENTS[name]]
    return any(bool(free[network.groups[k].blocks[-1]].any()) for k in chosen)


def _common(network: Network, label: str, chosen: tuple[int, ...], name: str, sets: int) -> Hypothesis:
    component = _COMPONENTS[name]
    number = len(network.blocks["distance meter"].ids)
    meter = int(network.groups[chosen[0]].blocks[-1][0])

    def change(changed: Network) -> Network:
        free = changed.blocks["distance meter"].free[meter].copy()
        free[component] = True
        changed, own = with_unknown(changed, "distance meter", changed.start["distance meter"][meter], free)
        for k in chosen:
            group = changed.groups[k]
            changed = with_group(changed, k, replace(group, blocks=(*group.blocks[:-1], np.full(group.count, own))))
        return changed

    def amount(values: Values) -> AddedParameter:
        return AddedParameter(name, float(values["distance meter"][number, component]))

    given = {"offset": "{free: 0}", "scale": "{free: 1}"}[name]
    line = f"instruments: {{edm: {{{name}: {given}}}}}; observations, {label}: instrument: edm"
    tables = [edit for k in chosen for edit in table_key(network, k, "instrument", "edm")]
    edits = (key_edit(("instruments", "edm", name), given), *tables) if len(tables) == len(chosen) else ()
    return Hypothesis(f"distance {name}", (label,), change, line, sets, parameters=1, edits=edits, amount=amount)


def other_kind(group: ObservationGroup) -> tuple[str, ObservationGroup, str]:
    """Cause, group and line of slope distances taken for horizontal ones, or the other way round."""
    other = DISTANCE if group.type == HORIZONTAL_DISTANCE else HORIZONTAL_DISTANCE
    cause = "slope distance" if other == DISTANCE else "horizontal distance"
    return cause, replace(group, type=other), f"observations, {group.name}: type: {other.key}"


def _other_kind(network: Network, number: int) -> Hypothesis:
    group = network.groups[number]
    cause, other, line = other_kind(group)
    return Hypothesis(
        cause,
        (group.name,),
        lambda changed: with_group(changed, number, replace(changed.groups[number], type=other.type)),
        line,
        edits=table_key(network, number, "type", other.type.key),
    )


# ---- Control points: two exchanged, all in another unit, northing and easting exchanged.

_PAIRS = 6
"""Exchanges that are tried, of all pairs."""


class ControlPoints(NamedTuple):
    """Points of one table whose coordinates are all given, fixed or observed."""

    label: str
    points: IntArray
    given: FloatArray
    """(k, 3) internal axes."""
    observed: bool


def control_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Another unit, and exchanged axes, of every table of control."""
    tables = [control for control in control_tables(situation) if len(control.points) >= 2]
    return [h for control in tables for h in (_axes(situation, control), *_units(situation, control))]


def exchange_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Two points of a table exchanged, where one of them does not fit."""
    return [h for control in control_tables(situation) for h in _exchanges(situation, control)]


def moved_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the control points that score tests say have moved, as free ones: alone, and all of a cause together."""
    place = {name: k for k, name in enumerate(situation.network.blocks["point"].ids)}
    found = []
    for one in situation.scored:
        if one.cause != "control moved":
            continue
        points = np.array([place[name] for name in one.things if name in place])
        observed = {situation.network.groups[number].type.key for number, _ in one.rows} <= {*OBSERVED_POINTS}
        components = np.array(one.components if observed else (0, 1, 2))
        found.append(
            Hypothesis(
                "control moved",
                one.things,
                partial(_released, points=points, components=components),
                f"points, {', '.join(one.things)}: x, y, z",
                max(sum(len(control.points) for control in control_tables(situation)), 1),
                parameters=3 * len(points),  # any of its coordinates might have been wrong
            )
        )
    return found


def _released(network: Network, points: IntArray, components: IntArray) -> Network:
    blocks = network.blocks["point"]
    free = blocks.free.copy()
    free[np.ix_(points, components)] = True
    network = replace(network, blocks={**network.blocks, "point": blocks._replace(free=free)})
    for number, group in enumerate(network.groups):
        if group.type.key in OBSERVED_POINTS:
            rows = np.flatnonzero(np.isin(group.blocks[0], points))
            observed = group.observed.copy()
            observed[np.ix_(rows, components)] = np.nan
            network = with_group(network, number, replace(group, observed=observed))
    return network


def control_tables(situation: Situation) -> list[ControlPoints]:
    """Control as the tables of the project have it."""
    network = situation.network
    own = network.things["point"]
    ids, blocks = network.blocks["point"].ids, network.blocks["point"]
    tables = []
    for group in network.groups:
        if group.type.key not in OBSERVED_POINTS:
            continue
        points = np.asarray(group.blocks[0], dtype=np.int64)
        declared = np.isin(points, own.parts["position"])
        full = np.isfinite(group.observed).all(axis=1) & declared
        if full.any():
            names = {network.point_groups.get(int(p), "") for p in points[full]}
            label = names.pop() if len(names) == 1 else ""
            tables.append(ControlPoints(label or group.name, points[full], group.observed[full], True))
    held = ~blocks.free.any(axis=1) & np.isin(np.arange(len(ids)), own.parts["position"])
    seen = np.zeros(len(ids), dtype=bool)
    for group in network.groups:
        for numbers in group.blocks_of("point"):
            seen[numbers] = True
    fixed = np.flatnonzero(held & seen)
    if len(fixed):
        labels = {network.point_groups.get(int(p), "") for p in fixed} - {""}
        label = labels.pop() if len(labels) == 1 else "points"
        tables.append(ControlPoints(label, fixed, situation.start["point"][fixed], False))
    return tables


def _table(situation: Situation, control: ControlPoints) -> tuple[str | int, ...] | None:
    entries = situation.network.project.points
    found = [k for k, e in enumerate(entries) if control.label in (e.group, e.name, e.file)]
    if control.label == "points" and len(entries) == 1:
        found = [0]
    return ("points", found[0]) if len(found) == 1 else None


def _axes_edits(situation: Situation, control: ControlPoints) -> tuple[Edit, ...]:
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


def _units(situation: Situation, control: ControlPoints) -> Iterator[Hypothesis]:
    at = _table(situation, control)
    for name, factor in LENGTHS.items():
        unit = name.split()[0]
        units = f"{{x: {unit}, y: {unit}, z: {unit}}}"
        yield Hypothesis(
            "control unit",
            (control.label, name),
            partial(with_points, points=control.points, change=partial(np.multiply, factor)),
            f"points, {control.label}: units: {units}",
            len(LENGTHS),
            afresh=True,
            stretch=control.given.size * float(np.log(factor)) if control.observed else 0.0,
            recomputed={"point": control.points},
            edits=() if at is None else (key_edit((*at, "units"), units),),
        )


def _axes(situation: Situation, control: ControlPoints) -> Hypothesis:
    turn = situation.network.edge.matrix
    swap = turn @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ turn.T
    return Hypothesis(
        "axes exchanged",
        (control.label,),
        lambda network: with_points(network, control.points, lambda xyz: xyz @ swap.T),
        f"points, {control.label}: columns: {{x: y, y: x}}",
        afresh=True,
        recomputed={"point": control.points},
        edits=_axes_edits(situation, control),
    )


def _exchanges(situation: Situation, control: ControlPoints) -> list[Hypothesis]:
    """The pairs whose sights fit each other's places, and that leave least misclosure of a similarity to theirs."""
    count = len(control.points)
    if count < 3:
        return []
    best = _scored(situation, control)
    best += [pair for pair in _sighted_exchanged(situation, control) if pair not in best]
    # Control points up to which all pairs are looked through.
    if count <= 60:
        adjusted = _without_control(situation, control)
        sums = {pair: _misfit(control, adjusted, pair) for pair in combinations(range(count), 2)}
        best += [pair for pair in sorted(sums, key=lambda pair: sums[pair])[:_PAIRS] if pair not in best]
    return [_exchange(situation, control, pair, count * (count - 1) // 2) for pair in best]


def _scored(situation: Situation, control: ControlPoints) -> list[tuple[int, int]]:
    """Pairs that score tests name: as exchanged, or as two that moved."""
    ids = situation.network.blocks["point"].ids
    place = {ids[point]: k for k, point in enumerate(control.points.tolist())}
    found = []
    for one in situation.scored:
        pair = sorted(place[name] for name in one.things if name in place)
        if one.cause in ("control exchanged", "control moved") and len(pair) == 2 == len(one.things):
            found.append((pair[0], pair[1]))
    return list(dict.fromkeys(found))


def _without_control(situation: Situation, control: ControlPoints) -> FloatArray:
    """(k, 3) where the points are by their sights; where nobody sights them, where they are in the adjustment."""
    adjusted = situation.values["point"][control.points]
    if situation.count > SMALL:
        return adjusted
    problem = situation.make(situation.network, situation.start, situation.values)
    places = by_sights_alone(problem, situation.values, control.points)
    return np.where(np.isfinite(places), places, adjusted)


def _sighted_exchanged(situation: Situation, control: ControlPoints) -> list[tuple[int, int]]:
    """Pairs of which the sights to each fit the given place of the other, and not its own; the clearest first."""
    if situation.count > SMALL:
        return []
    problem, values = situation.make(situation.network, situation.start, situation.values), situation.values
    points, given = control.points.tolist(), control.given
    own = [float(costs_at_places(problem, values, p, given[[k]])[0]) for k, p in enumerate(points)]
    # Control points whose sights are put to each other's places: those they fit worst at their own.
    worst = np.argsort(-np.array(own), kind="stable")[:12].tolist()
    there = {k: costs_at_places(problem, values, points[k], given[worst]) for k in worst}
    drops = {}
    for (m, one), (n, other) in combinations(enumerate(worst), 2):
        drop = own[one] + own[other] - there[one][n] - there[other][m]
        if drop > 0.5 * (own[one] + own[other]):
            drops[min(one, other), max(one, other)] = drop
    return sorted(drops, key=lambda pair: -drops[pair])[:_PAIRS]


def _misfit(control: ControlPoints, adjusted: FloatArray, pair: tuple[int, int]) -> float:
    """Misfit of the given coordinates, two exchanged, to those that were adjusted: as they are, or moved as a whole."""
    order = np.arange(len(control.given))
    order[list(pair)] = order[list(reversed(pair))]
    given = control.given[order]
    plain = float(np.median(np.linalg.norm(adjusted - given, axis=1)))
    if len(given) < 4:
        return float(np.sum((adjusted - given) ** 2))
    fitted = similarity(adjusted, given)
    residuals = fitted.residuals if fitted.outcome.usable else adjusted - given
    return min(float(np.sum(residuals**2)), plain**2 + float(np.sum((adjusted - given) ** 2)))


def _exchange(situation: Situation, control: ControlPoints, pair: tuple[int, int], candidates: int) -> Hypothesis:
    names = [situation.network.blocks["point"].ids[control.points[k]] for k in pair]
    points = control.points[list(pair)]
    return Hypothesis(
        "control exchanged",
        tuple(names),
        lambda network: with_points(network, points, lambda xyz: xyz[::-1]),
        f"points, {control.label}: {names[0]} ↔ {names[1]}",
        candidates,
        recomputed={"point": points},
        edits=tuple(
            CellEdit(("points",), "id", to(other), cells={"id": own})
            for own, other in zip(names, reversed(names), strict=True)
        ),
    )


# ---- Standard deviations in another unit: those that no instrument has, and those a thousand times off the residuals.

_FACTORS = (1e3, 1e-3, 1e6, 1e-6)


def sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Groups whose σ nobody has; without any, those whose residuals are near to the factor between two units.

    As long as a σ is one that nobody has, residuals in units of others say nothing.
    """
    groups = [
        (number, group, int(np.count_nonzero(group.used))) for number, group in enumerate(situation.network.groups)
    ]
    groups = [one for one in groups if one[2] >= 5]
    found = []
    for number, group, count in groups:
        beyond = beyond_any_instrument(situation.network, group)
        if beyond:  # what too small a σ says of how likely residuals are counts for nothing
            told = count if beyond < 0 else 0
            found.append(_hypothesis(situation, number, group.name, 1e3**beyond, told))
    return found or [h for number, group, count in groups for h in _near_to_units(situation, number, count)]


def scored_sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the tables whose σ is wrong by the factor that score tests name."""
    found = []
    for one in situation.scored:
        for number, group in enumerate(situation.network.groups):
            if one.cause == "sigma of a table" and one.things == (group.name,) and one.amount is not None:
                count = int(np.count_nonzero(group.used))
                plain = _hypothesis(situation, number, group.name, float(f"{one.amount.value:.3g}"), count)
                found.append(
                    replace(plain, cause="sigma of a table", parameters=1, amount=partial(_the_same, one.amount))
                )
    return found


def _the_same(amount: AddedParameter, _values: Values) -> AddedParameter:
    return amount


def _near_to_units(situation: Situation, number: int, count: int) -> Iterator[Hypothesis]:
    group = situation.network.groups[number]
    used = group.used
    found = {unit_factor(scale) for scale in _scales(situation, number, group, used)}
    for factor in _FACTORS:
        if factor in found:
            yield _hypothesis(situation, number, group.name, factor, count)


def unit_factor(scale: float) -> float | None:
    """Return the factor between two units that a factor of σ is near to, None if it is near to none."""
    for factor in _FACTORS:
        # Factor within which residuals that are too large agree with a unit; those too small have no other reason.
        near = 4.0 if factor > 1.0 else np.sqrt(1e3)
        if 1.0 / near < scale / factor < near:
            return factor
    return None


def _scales(situation: Situation, number: int, group: ObservationGroup, used: BoolArray) -> Iterator[float]:
    """Factors of σ by the median where most observations fit, and in the adjustment of all of them.

    Of the latter also √(Ω/Σ r), with the residuals and redundancy numbers of the group (W. Förstner 1979): the median
    of sights so precise that all else follows them is next to nothing.
    """
    yield robust_sigma(situation.sizes[number][used])
    if situation.solution is None:
        return
    sizes = np.abs(misclosures(group, situation.solution.values) / group.given_sigma)
    yield robust_sigma(sizes[used])
    if situation.redundancy_of_solution is not None:
        numbers = situation.redundancy_of_solution[number]
        known = used & np.isfinite(numbers)
        freedom = float(np.sum(numbers[known]))
        yield float(np.sqrt(np.sum(sizes[known] ** 2) / freedom)) if freedom > 0.0 else np.nan


def _hypothesis(situation: Situation, number: int, name: str, factor: float, count: int) -> Hypothesis:
    def change(network: Network) -> Network:
        group = network.groups[number]
        return with_group(network, number, replace(group, sigma=group.sigma * factor))

    line, at = f"observations, {name}: factor: {factor:g}", table_of(situation.network, number)
    return Hypothesis(
        "sigma unit",
        (name,),
        change,
        line,
        len(_FACTORS),
        stretch=-count * float(np.log(factor)),
        edits=() if at is None else (KeyEdit((*at, "factor"), lambda old, _: f"{float(old or 1) * factor:g}"),),
    )
