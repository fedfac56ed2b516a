"""Theodolite stations and local systems of a project."""

from __future__ import annotations

import numpy as np

from mor.arrays import IntArray
from mor.errors import Problem
from mor.parameters.kinds import ECCENTRICITY, HEIGHT, POINT, ROTATION, SCALE
from mor.project.file.model import Stations, Systems
from mor.project.motion.epochs import EPOCH, remember_epochs
from mor.project.network.entities import entities, unknown_name
from mor.project.network.poses import Seen, check_unique, position_columns, positions, rotations
from mor.project.network.reading import Reading
from mor.project.network.set_ups import eccentricities, heights, set_up_columns, shared_column
from mor.project.observations.orientations import set_name
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import component_columns, component_rows, number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.units import ANGLE


def read_stations(reading: Reading) -> None:
    """Theodolite stations: a position (usually a point), a height, a rotation with its level."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "height": [], "rotation": []}
    seen: list[Seen] = []
    for k, table in enumerate(reading.project.stations):
        reading.begin("stations", k, table)
        _read_stations_table(reading, table, reading.at("stations", k), ids, collected, seen)
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["station"] = entities(
        ids, {part: np.concatenate(arrays or none) for part, arrays in collected.items()}
    )


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


def _read_stations_table(
    reading: Reading,
    table: Stations,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    seen: list[Seen],
) -> None:
    edge = reading.edge
    rows = read_table(table, station_columns(reading), place, reading.problems)
    if rows is None:
        return
    names = [set_name(*pair) for pair in zip(rows.text("id"), rows.text("set"), strict=True)]
    check_unique("station", names, rows, seen, reading.problems)
    remember_epochs(reading, "station", names, rows)
    oriented = np.isfinite(rows.number("orientation"))
    if oriented.any():
        kappa = -(edge.zero_azimuth + edge.sense * rows.number("orientation"))
        rows.numbers["kappa"] = np.where(oriented, kappa, rows.number("kappa"))
    position, height = _places(reading, table, rows, ids, collected)
    collected["position"].append(position)
    collected["height"].append(height)
    levelled = table.level == "fixed"
    if not levelled:
        for name in ROTATION.names[:2]:
            rows.numbers[name] = np.nan_to_num(rows.number(name))
    labels = [f"station {name}" for name in names]
    collected["rotation"].append(
        rotations(reading, rows, labels, table.fixed, level=levelled, oriented=oriented)
    )
    reading.table_ids["stations", int(place.path[-1])] = names
    ids += names


def _places(
    reading: Reading, table: Stations, rows: Rows, ids: list[str], collected: dict[str, list[IntArray]]
) -> tuple[IntArray, IntArray]:
    """Positions and heights of a table: own ones, or for a further set those of its station."""
    is_set = np.array([bool(name) for name in rows.text("set")])
    own = rows.take(np.flatnonzero(~is_set))
    labels = [f"station {name}" for name in own.text("id")]
    position, height = np.full((2, rows.count), -1, dtype=np.int64)
    if own.count:
        position[~is_set] = positions(reading, own, labels, table.fixed)
        height[~is_set] = heights(reading, own, labels, table.fixed, table.free)
    earlier = [
        (*collected[part], column[~is_set]) for part, column in (("position", position), ("height", height))
    ]
    places = zip(*(np.concatenate(arrays) for arrays in earlier), strict=True)
    known = dict(zip((*ids, *own.text("id")), places, strict=True))
    for i in np.flatnonzero(is_set):
        station = rows.text("id")[i]
        place = any(np.isfinite(rows.number(name)[i]) for name in (*POINT.names, *HEIGHT.names))
        place |= bool(rows.text(shared_column(HEIGHT))[i])
        if station not in known:
            words = (
                f"{unknown_name('station', station, known)}; a set belongs to a station of a row without set"
            )
            reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
        elif place or rows.text("point")[i]:
            words = f"set {rows.text('set')[i]!r} of station {station!r} stands where its station stands"
            reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
        else:
            position[i], height[i] = known[station]
            reading.sets[set_name(station, rows.text("set")[i])] = (station, rows.text("set")[i])
    return position, height


def read_systems(reading: Reading) -> None:
    """Local systems: origin, rotation, scale, offset."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "rotation": [], "scale": [], "offset": []}
    seen: list[Seen] = []
    for k, table in enumerate(reading.project.systems):
        reading.begin("systems", k, table)
        _read_systems_table(reading, table, reading.at("systems", k), ids, collected, seen)
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["system"] = entities(
        ids, {part: np.concatenate(arrays or none) for part, arrays in collected.items()}
    )


def _read_systems_table(
    reading: Reading,
    table: Systems,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    seen: list[Seen],
) -> None:
    kinds = (*POINT.components, *ROTATION.components, *SCALE.components)
    columns = [
        Column("id", required=True),
        Column("point"),
        *component_columns(kinds, reading.edge),
        *position_columns(reading),
        *set_up_columns(reading, ECCENTRICITY, shared=False),
    ]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    check_unique("system", names, rows, seen, reading.problems)
    labels = [f"system {name}" for name in names]
    scale = component_rows(rows, SCALE.components, table.fixed, reading.problems)
    scale = scale._replace(values=np.nan_to_num(scale.values, nan=1.0))
    wrong = (scale.values <= 0.0) | (scale.start <= 0.0)
    tell_rows(reading.problems, wrong[:, 0], rows, "scale: expected a number above 0")
    collected["position"].append(positions(reading, rows, labels, table.fixed))
    collected["rotation"].append(rotations(reading, rows, labels, table.fixed))
    collected["scale"].append(reading.shop.store("scale").add(labels, *scale))
    none = np.zeros(len(names), dtype=np.int64)
    collected["offset"].append(eccentricities(reading, rows, labels, table.fixed, table.free, none))
    ids += names
    reading.end("system", len(names))
