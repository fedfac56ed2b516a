"""Circles of instruments: another unit, the other sense, elevations for zenith angles, the other face."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.diagnose.edits import Edit, cells, computed, key, table_key
from mor.diagnose.hypothesis import Hypothesis, with_blocks, with_observed, with_unknown
from mor.diagnose.situation import Situation
from mor.observations import ObservationGroup, wrap
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.observations.observation_rows import group_name
from mor.units import ANGLE_UNITS

_BAD = 0.5
"""Part of the rows of a station that do not fit, from which on its circle is looked at."""
_STATIONS = 3
"""Stations of a group that are looked at, the worst first."""
_UNITS = ("gon", "deg", "rad")
_ZENITH = ("zenith", "zenith_angle")


def circle_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Hypotheses about the circles of every group, and of the stations whose rows do not fit."""
    found = []
    for number, group in enumerate(situation.network.groups):
        if not group.type.wraps.any() or group.type.distances is None:
            continue
        for things, rows in _sets(situation, number, group):
            found += list(_of_rows(situation, number, group, things, rows))
    return found


def face_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Rows whose horizontal circle is that of the other face."""
    groups = enumerate(situation.network.groups)
    return [h for number, group in groups if group.count for h in _faces(situation, number, group)]


def turned_circle_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the sets that score tests say were turned between two of their rows."""
    found = []
    for one in situation.scored:
        rows: dict[int, list[int]] = {}
        for number, row in one.rows if one.cause == "orientation changed" else ():
            rows.setdefault(number, []).append(row)
        for number, own in rows.items():
            group = situation.network.groups[number]
            slot = next((k for k, s in enumerate(group.type.slots) if s.kind == "rotation"), -1)
            if slot >= 0:
                found.append(
                    Hypothesis(
                        one.cause,
                        one.things,
                        partial(_turned_on, number=number, rows=own, slot=slot, values=situation.values),
                        one.line,
                        group.count,
                        parameters=1,
                    )
                )
    return found


def _turned_on(network: Network, number: int, rows: list[int], slot: int, values: Values) -> Network:
    """The network with an orientation of their own for some rows of a set of directions."""
    block = int(network.groups[number].blocks[slot][rows[0]])
    free = network.blocks["rotation"].free[block]
    network, own = with_unknown(network, "rotation", values["rotation"][block], free, block)
    return with_blocks(network, number, rows, {slot: [own] * len(rows)})


def _sets(
    situation: Situation, number: int, group: ObservationGroup
) -> Iterator[tuple[tuple[str, ...], IntArray]]:
    """The whole group, which may fit a mirrored place of its stations, and the rows of each station that fit badly."""
    bad: BoolArray = np.asarray(situation.misfitting[number].any(axis=1))
    yield (group.name,), np.arange(group.count)
    stations = np.array(list(group.references[0]))
    names = list(dict.fromkeys(stations.tolist()))
    shares = {name: float(bad[stations == name].mean()) for name in names if np.sum(stations == name) > 1}
    worst = sorted((name for name in shares if shares[name] >= _BAD), key=lambda name: -shares[name])
    causes = ("circle sense", "circle unit", "elevation for zenith")
    scored = [
        name for one in situation.scored if one.cause in causes for name in one.things if name in shares
    ]
    for name in dict.fromkeys([*scored, *worst[:_STATIONS]]) if len(names) > 1 else []:
        yield (name, group.name), np.flatnonzero(stations == name)


def _of_rows(
    situation: Situation, number: int, group: ObservationGroup, things: tuple[str, ...], rows: IntArray
) -> Iterator[Hypothesis]:
    edge, seen = situation.network.edge, int(np.count_nonzero(group.mask[rows]))
    given = _given_unit(situation.network, group)
    bad = situation.misfitting[number][rows].any(axis=1)
    spoiled = bad.any() and bad.mean() >= _BAD
    anew = _stations(group, rows) if spoiled else {}  # else they stand where they should
    network, full = situation.network, 2.0 * np.pi / ANGLE_UNITS[given]
    angles = [c.name for c, wraps in zip(group.type.components, group.type.wraps, strict=True) if wraps]
    for other in _UNITS:
        factor = ANGLE_UNITS[other] / ANGLE_UNITS[given]
        if factor != 1.0 and _is_on_circle(group, rows, factor):
            yield _hypothesis(
                "circle unit",
                (*things, other),
                anew,
                number,
                rows,
                partial(_read_in, factor),
                f"observations, {things[0]}: units: {other}",
                seen * float(np.log(factor)),
                table_key(network, number, "units", f"{{{', '.join(f'{a}: {other}' for a in angles)}}}")
                if len(rows) == group.count
                else _in_cells(network, number, rows, angles, partial(float.__mul__, factor)),
            )
    if group.type.turns:
        columns = list(group.type.turns)
        yield _hypothesis(
            "circle sense",
            things,
            anew,
            number,
            rows,
            partial(_negative, columns),
            f"axes: {{angles: {'counterclockwise' if edge.sense > 0 else 'clockwise'}}} ({things[0]})",
            0.0,
            (key(("axes", "angles"), "counterclockwise" if edge.sense > 0 else "clockwise"),)
            if len(rows) == group.count and sum(bool(g.type.turns) for g in network.groups) == 1
            else _in_cells(
                network,
                number,
                rows,
                [group.type.components[group.type.turns[0]].name],
                lambda angle: (full - angle) % full,
            ),
        )
    names = [component.name for component in group.type.components]
    columns = [k for k, name in enumerate(names) if name in _ZENITH]
    if columns:
        yield _hypothesis(
            "elevation for zenith",
            things,
            anew,
            number,
            rows,
            partial(_complement, columns),
            f"observations, {things[0]}: type: directions",
            0.0,
            _in_cells(
                network,
                number,
                rows,
                [names[k] for k in columns],
                lambda angle: (0.25 * full - angle) % full,
            ),
        )


def _in_cells(
    network: Network, number: int, rows: IntArray, names: list[str], change: Callable[[float], float]
) -> tuple[Edit, ...]:
    """Edits of some columns in some rows."""
    found = [cells(network, number, rows.tolist(), name, computed(change)) for name in names]
    return tuple(edit for edits in found for edit in edits)


def _is_on_circle(group: ObservationGroup, rows: IntArray, factor: float) -> bool:
    """True where the angles (n, m) of some rows, times a factor, do not go beyond a full circle."""
    angles = np.abs(group.observed[rows][:, group.type.wraps])
    return bool(factor * np.nanmax(angles, initial=0.0) <= 2.0 * np.pi)


def _given_unit(network: Network, group: ObservationGroup) -> str:
    """Unit in which the angles of a group were given: that of its table, or of the project."""
    unit: str = network.edge.units.angle
    angles = [c.name for c, wraps in zip(group.type.components, group.type.wraps, strict=True) if wraps]
    for number, entry in enumerate(network.project.observations):
        if group_name(entry, number) == group.name:
            own = entry.units if isinstance(entry.units, dict) else dict.fromkeys(angles, entry.units)
            unit = next((own[name] for name in angles if own.get(name)), unit)
    return unit if unit in _UNITS else "deg"


def _hypothesis(
    cause: str,
    things: tuple[str, ...],
    anew: dict[str, IntArray],
    number: int,
    rows: IntArray,
    change: Callable[[FloatArray], FloatArray],
    line: str,
    stretch: float,
    edits: tuple[Edit, ...],
) -> Hypothesis:
    return Hypothesis(
        cause,
        things,
        lambda network: with_observed(network, number, rows, change),
        line,
        len(_UNITS),
        stretch=stretch,
        anew=anew,
        afresh=True,
        edits=edits,
    )


def _stations(group: ObservationGroup, rows: IntArray) -> dict[str, IntArray]:
    """Positions and rotations of what observes some rows."""
    found: dict[str, list[IntArray]] = {}
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.of == group.type.references[0].name and slot.part in ("position", "rotation"):
            found.setdefault(slot.kind, []).append(np.asarray(blocks[rows]))
    return {kind: np.unique(np.concatenate(blocks)) for kind, blocks in found.items()}


def _read_in(factor: float, angles: FloatArray) -> FloatArray:
    return _folded(factor * angles)


def _folded(angles: FloatArray) -> FloatArray:
    return np.asarray(np.remainder(angles, 2.0 * np.pi))


def _negative(columns: list[int], angles: FloatArray) -> FloatArray:
    changed = angles.copy()
    changed[:, columns] = _folded(-angles[:, columns])
    return changed


def _complement(columns: list[int], angles: FloatArray) -> FloatArray:
    changed = angles.copy()
    changed[:, columns] = _folded(0.5 * np.pi - angles[:, columns])
    return changed


def _faces(situation: Situation, number: int, group: ObservationGroup) -> Iterator[Hypothesis]:
    """Rows of a station whose horizontal directions are off by half a circle."""
    if not group.type.turns or group.type.tell_face is None:
        return
    column = group.type.turns[0]
    full = 2.0 * np.pi / ANGLE_UNITS[_given_unit(situation.network, group)]
    misclosure = np.nan_to_num(misclosures(group, situation.values)[:, column])
    stations = np.array(list(group.references[0]))
    for name in dict.fromkeys(stations.tolist()):
        here = np.flatnonzero(stations == name)
        middle = _middle(misclosure[here])
        off = here[np.abs(wrap(misclosure[here] - middle)) > 0.75 * np.pi]
        if 0 < len(off) < len(here):
            yield Hypothesis(
                "face",
                (name, *dict.fromkeys(group.references[1][int(row)] for row in off)),
                partial(with_observed, number=number, rows=off, change=partial(_opposite, column)),
                f"{group.name}, {name}: horizontal + 200 gon",
                len(here),
                rows=tuple((number, int(row)) for row in off) if len(off) < 4 else (),
                edits=_in_cells(
                    situation.network,
                    number,
                    off,
                    [group.type.components[column].name],
                    lambda angle: (angle + 0.5 * full) % full,
                ),
            )


def _middle(angles: FloatArray) -> float:
    """The angle that most of them are near to."""
    near = np.abs(wrap(angles[:, None] - angles[None, :])).sum(axis=1)
    return float(angles[int(np.argmin(near))])


def _opposite(column: int, angles: FloatArray) -> FloatArray:
    changed = angles.copy()
    changed[:, column] = _folded(angles[:, column] + np.pi)
    return changed
