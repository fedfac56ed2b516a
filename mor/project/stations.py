"""Stations, set-ups and instruments."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from mor.model.parameters import (
    BASE,
    ECCENTRICITY,
    GNSS_FRAME,
    HEIGHT,
    IMAGE_VELOCITY,
    POINT,
    ROTATION,
    ROTATION_RATE,
    SCALE,
    TIME_OFFSET,
    BlockKind,
)
from mor.project.entities import Reading, SetUp, entities, set_name, unknown_name
from mor.project.motion import EPOCH, remember_epochs
from mor.project.points import Blocks, position_columns, positions, read_named, rotations
from mor.project.schema import Instrument, Pairs, Stations, Systems
from mor.project.tables import (
    Column,
    Rows,
    Statuses,
    TableLocation,
    component_columns,
    component_rows,
    number_column,
    settings,
)
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE

# ---- Constants of a set-up: heights, eccentricities, offsets, motions. Fixed if nothing else is said; shared by name.


def set_up_columns(reading: Reading, kind: BlockKind, shared: bool = True) -> list[Column]:
    """Columns of a constant of a set-up: its components with σ and start, and the name it is shared by."""
    columns = component_columns(kind.components, reading.edge)
    return [*columns, Column(shared_column(kind))] if shared else columns


def shared_column(kind: BlockKind) -> str:
    """Column that names a constant several frames share."""
    return f"shared_{kind.key.replace(' ', '_')}"


def heights(reading: Reading, rows: Rows, labels: list[str], fixed: Collection[str], free: Collection[str]) -> IntArray:
    """Height block of every row: none, its own, or one that it shares."""
    return _set_ups(reading, HEIGHT, rows, labels, fixed, free, np.zeros(rows.count, dtype=np.int64))


def eccentricities(
    reading: Reading, rows: Rows, labels: list[str], fixed: Collection[str], free: Collection[str], otherwise: IntArray
) -> IntArray:
    """Block of eccentricity or local offset of every row: its own, one that it shares, or another (n,)."""
    return _set_ups(reading, ECCENTRICITY, rows, labels, fixed, free, otherwise)


def motions(
    reading: Reading, rows: Rows, labels: list[str], fixed: Collection[str], free: Collection[str], moving: BoolArray
) -> tuple[IntArray, IntArray]:
    """Blocks of velocity and rate of rotation of every row, −1 where it does not count: not ``moving`` (n,)."""
    found = []
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        result = np.full(rows.count, -1, dtype=np.int64)
        here = np.flatnonzero(moving)
        if len(here):
            own = rows.take(here)
            still = np.full(len(here), reading.shop.neutral(kind.key), dtype=np.int64)
            result[here] = _set_ups(reading, kind, own, [labels[i] for i in here], fixed, free, still)
        found.append(result)
    return found[0], found[1]


def _set_ups(
    reading: Reading,
    kind: BlockKind,
    rows: Rows,
    labels: list[str],
    fixed: Collection[str],
    free: Collection[str],
    otherwise: IntArray,
) -> IntArray:
    said = _said(kind, rows, fixed, free)
    result, store = otherwise.copy(), reading.shop.store(kind.key)
    named = rows.text(shared_column(kind))
    unnamed = np.array([not name for name in named], dtype=bool)
    own = np.flatnonzero(unnamed & said.anything())
    result[own] = store.add([labels[i] for i in own], *said.rows(own).statuses())
    shared = reading.shop.things.get(shared_column(kind))
    known = {name: shared.part(name, kind.key) for name in shared.ids} if shared else {}
    together = reading.shared_set_ups.setdefault(kind.key, {})
    for i in np.flatnonzero(~unnamed).tolist():
        together[named[i]] = _with_row(kind, rows, i, said, together.get(named[i]))
    for name in dict.fromkeys(name for name in named if name):
        statuses = _Said(*together[name]).statuses()
        if name in known:
            store.put(known[name], statuses)
        else:
            known[name] = int(store.add([f"{kind.key} {name}"], *statuses)[0])
    for i in np.flatnonzero(~unnamed).tolist():
        result[i] = known[named[i]]
    numbers = {kind.key: np.array(list(known.values()), dtype=np.int64)}
    reading.shop.things[shared_column(kind)] = entities(known, numbers)
    return result


class _Said(NamedTuple):
    """Values of n rows for the components of a constant, (n, size) each; NaN where there is none."""

    given: FloatArray
    sigma: FloatArray
    start: FloatArray
    free: FloatArray
    """1 where the component is an unknown without a σ."""

    def rows(self, chosen: IntArray) -> _Said:
        return _Said(*(column[chosen] for column in self))

    def anything(self) -> BoolArray:
        """(n,) rows that say anything."""
        return np.asarray((np.isfinite(self.given) | np.isfinite(self.free)).any(axis=1))

    def statuses(self) -> Statuses:
        """Observed with a σ, free where the table says so, else fixed."""
        observed = self.sigma > 0.0
        unknown = observed | np.isfinite(self.free)
        return Statuses(
            np.nan_to_num(self.given),
            unknown,
            np.where(observed, self.sigma, np.nan),
            np.where(unknown, self.start, np.nan),
        )


def _with_row(kind: BlockKind, rows: Rows, row: int, said: _Said, before: SetUp | None) -> SetUp:
    """Merge all rows so far of one shared constant: each component once, or several times with the same value."""
    here = said.rows(np.array([row]))
    if before is None:
        return tuple(here)
    column = shared_column(kind)
    name, at = rows.text(column)[row], np.arange(rows.count) == row
    contradictions = (
        f"{column}: {name!r} has another value in a row above",
        f"{column}: {name!r} has another σ in a row above",
        f"{column}: {name!r} has another start value in a row above",
    )
    for words, one, other in zip(contradictions, before, here, strict=False):
        if (np.isfinite(one) & np.isfinite(other) & (one != other)).any():
            rows.tell_where(at, words)
    merged = _Said(*(np.where(np.isnan(one), other, one) for one, other in zip(before, here, strict=True)))
    if (np.isfinite(merged.sigma) & np.isfinite(merged.free)).any():
        words = f"{column}: {name!r} is free in one row and has a σ in another; expected one of them"
        rows.tell_where(at, words)
    return tuple(merged)


def _said(kind: BlockKind, rows: Rows, fixed: Collection[str], free: Collection[str]) -> _Said:
    """Values of the rows; σ = 0 is fixed, also in a table of free ones."""
    names = kind.names
    given = np.stack([rows.number(name) for name in names], axis=1)
    sigma = np.stack([rows.number(f"sigma_{name}") for name in names], axis=1)
    start = np.stack([rows.number(f"start_{name}") for name in names], axis=1)
    loose = np.full(given.shape, np.nan)
    for k, name in enumerate(names):
        own = f"sigma_{name}"
        rows.tell_where(sigma[:, k] < 0.0, f"{own}: found a negative σ, expected a σ ≥ 0")
        rows.tell_where(np.isfinite(sigma[:, k]) & np.isnan(given[:, k]), f"{name} has a σ but no value")
        if name in free:
            wrong = sigma[:, k] > 0.0
            rows.tell_where(wrong, f"{name} is free in this table, and has a σ; expected one of them")
            held = np.full(rows.count, name in fixed)
            rows.tell_where(held, f"{name} is free and fixed in this table; expected one of them")
            loose[sigma[:, k] != 0.0, k] = 1.0
        elif name in fixed:
            sigma[np.isfinite(given[:, k]), k] = 0.0
    return _Said(given, sigma, start, loose)


# ---- Theodolite stations and local systems of a project.


def read_stations(reading: Reading) -> None:
    """Theodolite stations: a position (usually a point), a height, a rotation with its level."""
    read_named(reading, "station", ("position", "height", "rotation"), station_columns(reading), _stations_of_table)


def station_columns(reading: Reading) -> list[Column]:
    """Return the columns that a table of stations may have."""
    return [
        Column("id", required=True),
        Column("set"),
        Column("point"),
        EPOCH,
        *component_columns((*POINT.components, *ROTATION.components), reading.edge),
        *position_columns(reading),
        *set_up_columns(reading, HEIGHT),
        number_column("orientation", ANGLE, reading.edge),
    ]


def _stations_of_table(reading: Reading, table: Stations, rows: Rows, names: list[str]) -> Blocks:
    edge = reading.edge
    remember_epochs(reading, "station", names, rows)
    oriented = np.isfinite(rows.number("orientation"))
    if oriented.any():
        kappa = -(edge.zero_azimuth + edge.sense * rows.number("orientation"))
        rows.numbers["kappa"] = np.where(oriented, kappa, rows.number("kappa"))
    position, height = _places(reading, table, rows)
    levelled = table.level == "fixed"
    if not levelled:
        for name in ROTATION.names[:2]:
            rows.numbers[name] = np.nan_to_num(rows.number(name))
    labels = [f"station {name}" for name in names]
    rotation = rotations(reading, rows, labels, table.fixed, level=levelled, oriented=oriented)
    return {"position": position, "height": height, "rotation": rotation}


def _places(reading: Reading, table: Stations, rows: Rows) -> tuple[IntArray, IntArray]:
    """Positions and heights of a table: own ones, or for a further set those of its station."""
    earlier = reading.shop.things["station"]
    is_set = np.array([bool(name) for name in rows.text("set")])
    own = rows.take(np.flatnonzero(~is_set))
    labels = [f"station {name}" for name in own.text("id")]
    position, height = np.full((2, rows.count), -1, dtype=np.int64)
    if own.count:
        position[~is_set] = positions(reading, own, labels, table.fixed)
        height[~is_set] = heights(reading, own, labels, table.fixed, table.free)
    columns = {"position": position, "height": height}.items()
    places = zip(*(np.concatenate([earlier.parts[part], column[~is_set]]) for part, column in columns), strict=True)
    known = dict(zip((*earlier.ids, *own.text("id")), places, strict=True))
    for i in np.flatnonzero(is_set).tolist():
        station = rows.text("id")[i]
        place = any(np.isfinite(rows.number(name)[i]) for name in (*POINT.names, *HEIGHT.names))
        place |= bool(rows.text(shared_column(HEIGHT))[i])
        if station not in known:
            rows.tell(i, f"{unknown_name('station', station, known)}; a set belongs to a station of a row without set")
        elif place or rows.text("point")[i]:
            rows.tell(i, f"set {rows.text('set')[i]!r} of station {station!r} has the position of its station")
        else:
            position[i], height[i] = known[station]
            reading.sets[set_name(station, rows.text("set")[i])] = (station, rows.text("set")[i])
    return position, height


def read_systems(reading: Reading) -> None:
    """Local systems: origin, rotation, scale, offset."""
    columns = [
        Column("id", required=True),
        Column("point"),
        *component_columns((*POINT.components, *ROTATION.components, *SCALE.components), reading.edge),
        *position_columns(reading),
        *set_up_columns(reading, ECCENTRICITY, shared=False),
    ]
    read_named(reading, "system", ("position", "rotation", "scale", "offset"), columns, _systems_of_table)


def _systems_of_table(reading: Reading, table: Systems, rows: Rows, names: list[str]) -> Blocks:
    labels = [f"system {name}" for name in names]
    scale = component_rows(rows, SCALE.components, table.fixed)
    scale = scale._replace(values=np.nan_to_num(scale.values, nan=1.0))
    wrong = (scale.values <= 0.0) | (scale.start <= 0.0)
    rows.tell_where(wrong[:, 0], "scale: expected a number above 0")
    none = np.zeros(len(names), dtype=np.int64)
    return {
        "position": positions(reading, rows, labels, table.fixed),
        "rotation": rotations(reading, rows, labels, table.fixed),
        "scale": reading.shop.store("scale").add(labels, *scale),
        "offset": eccentricities(reading, rows, labels, table.fixed, table.free, none),
    }


# ---- Instruments and stereo pairs of a project.


def read_instruments(reading: Reading) -> None:
    """Distance meters, refraction coefficients, frames of GNSS solutions; where antennas and inertial systems are."""
    ids, meters, refractions, frames = [], [], [], []
    along: dict[str, list[int]] = {part: [] for part in _ALONG}
    for name, instrument in reading.project.instruments.items():
        ids.append(name)
        reading.shop.begin(f"instrument {name}")
        meters.append(_instrument(reading, name, instrument, "distance meter", ("scale", "offset")))
        refractions.append(_instrument(reading, name, instrument, "refraction", ("refraction",)))
        given, place = dict(instrument.frame), reading.at("instruments", name, "frame")
        frames.append(_add(reading, name, GNSS_FRAME.key, given, place) if given else 0)
        for part, blocks in along.items():
            blocks.append(_along(reading, name, instrument, part))
    parts = {"distance meter": meters, "refraction": refractions, GNSS_FRAME.key: frames, **along}
    arrays = {part: np.array(blocks, dtype=np.int64) for part, blocks in parts.items()}
    reading.shop.things["instrument"] = entities(ids, arrays)


_ALONG = {"lever arm": ECCENTRICITY, "boresight": ROTATION, TIME_OFFSET.key: TIME_OFFSET}
"""What instruments along a trajectory have, and the kinds of its blocks."""


def _along(reading: Reading, name: str, instrument: Instrument, part: str) -> int:
    """Block of one of these, -1 where nothing is said of it."""
    key, kind = part.replace(" ", "_"), _ALONG[part]
    said = getattr(instrument, key)
    if not said:
        return -1
    given = said if isinstance(said, dict) else {key: said}
    place = reading.at("instruments", name, key) if isinstance(said, dict) else reading.at("instruments", name)
    row = settings(given, kind.components, reading.edge, place)
    return int(reading.shop.store(kind.key).add([name if kind is TIME_OFFSET else f"{part} of {name}"], *row)[0])


def _instrument(reading: Reading, name: str, instrument: Instrument, kind: str, components: tuple[str, ...]) -> int:
    given = {key: getattr(instrument, key) for key in components if getattr(instrument, key) is not None}
    if not given:
        return 0
    return _add(reading, name, kind, given, reading.at("instruments", name))


def _add(reading: Reading, name: str, kind: str, given: dict[str, Any], place: TableLocation) -> int:
    store = reading.shop.store(kind)
    row = settings(given, store.kind.components, reading.edge, place)
    scales = [values[0, store.kind.names.index("scale")] for values in (row.values, row.start) if "scale" in given]
    if any(scale <= 0.0 for scale in scales):
        place.tell("scale: expected a number above 0", "scale")
    return int(store.add([name], *row)[0])


def read_pairs(reading: Reading) -> None:
    """Relative orientations of stereo pairs: base in the leading image's system, and rotation."""
    columns = component_columns((*BASE.components, *ROTATION.components), reading.edge)
    read_named(reading, "pair", ("base", "rotation"), [Column("id", required=True), *columns], _pairs_of_table)


def _pairs_of_table(reading: Reading, table: Pairs, rows: Rows, names: list[str]) -> Blocks:
    labels = [f"pair {name}" for name in names]
    return {
        kind.key: reading.shop.store(kind.key).add(labels, *component_rows(rows, kind.components, table.fixed))
        for kind in (BASE, ROTATION)
    }
