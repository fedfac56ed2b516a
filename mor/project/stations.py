"""Theodolite stations and local systems of a project."""

from __future__ import annotations

import numpy as np

from mor.geometry.arrays import IntArray
from mor.parameters.kinds import HEIGHT, POINT, ROTATION, SCALE
from mor.project.entities import entities
from mor.project.model import Stations, Systems
from mor.project.poses import check_unique, heights, positions, rotations
from mor.project.reading import Reading
from mor.project.statuses import component_columns, component_rows, number_column
from mor.project.tables import Column, Place, read_table
from mor.units import ANGLE


def read_stations(reading: Reading) -> None:
    """Theodolite stations: a position (usually a point), a height, a rotation with its level."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "height": [], "rotation": []}
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.stations):
        _read_stations_table(reading, table, reading.at("stations", k), ids, collected, lines)
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["station"] = entities(
        ids, {part: np.concatenate(arrays or none) for part, arrays in collected.items()}
    )


def _read_stations_table(
    reading: Reading,
    table: Stations,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    lines: dict[str, tuple[str, int]],
) -> None:
    edge = reading.edge
    columns = [
        Column("id", required=True),
        Column("point"),
        *component_columns((*POINT.components, *ROTATION.components, *HEIGHT.components), edge),
        number_column("orientation", ANGLE, edge),
    ]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    check_unique("station", names, rows, lines, reading.problems)
    labels = [f"station {name}" for name in names]
    if "orientation" in rows.numbers:
        rows.numbers["kappa"] = -(edge.zero_azimuth + edge.sense * rows.numbers["orientation"])
    collected["position"].append(positions(reading, rows, labels, table.fixed))
    collected["height"].append(heights(reading, rows, labels, table.fixed))
    levelled = table.level == "fixed"
    if not levelled:
        for name in ROTATION.names[:2]:
            rows.numbers.setdefault(name, np.zeros(rows.count))
    collected["rotation"].append(rotations(reading, rows, labels, table.fixed, level=levelled))
    reading.table_ids["stations", int(place.path[-1])] = names
    ids += names


def read_systems(reading: Reading) -> None:
    """Local systems: origin, rotation, scale."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "rotation": [], "scale": [], "offset": []}
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.systems):
        _read_systems_table(reading, table, reading.at("systems", k), ids, collected, lines)
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
    lines: dict[str, tuple[str, int]],
) -> None:
    kinds = (*POINT.components, *ROTATION.components, *SCALE.components)
    columns = [Column("id", required=True), Column("point"), *component_columns(kinds, reading.edge)]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    check_unique("system", names, rows, lines, reading.problems)
    labels = [f"system {name}" for name in names]
    scale = component_rows(rows, SCALE.components, table.fixed, reading.problems)
    scale = scale._replace(values=np.nan_to_num(scale.values, nan=1.0))
    collected["position"].append(positions(reading, rows, labels, table.fixed))
    collected["rotation"].append(rotations(reading, rows, labels, table.fixed))
    collected["scale"].append(reading.shop.store("scale").add(labels, *scale))
    collected["offset"].append(np.zeros(len(names), dtype=np.int64))
    ids += names
