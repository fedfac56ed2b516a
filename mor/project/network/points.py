"""Object points of a project, and the checks that every named table shares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import IntArray
from mor.parameters.kinds import POINT
from mor.project.file.model import Points
from mor.project.network.entities import entities
from mor.project.network.poses import Seen, check_unique, in_dimensions, inwards
from mor.project.network.reading import Reading
from mor.project.tables.statuses import Statuses, component_columns, component_rows, number_column
from mor.project.tables.tables import Column, Place, read_table
from mor.units import LENGTH


def read_points(reading: Reading) -> None:
    """Object points; coordinates go into internal axes."""
    if reading.project.world is not None:
        _read_on_earth(reading)
        return
    ids: list[str] = []
    numbers: list[IntArray] = []
    seen: list[Seen] = []
    for k, table in enumerate(reading.project.points):
        reading.begin("points", k, table)
        found = _read_points_table(reading, table, reading.at("points", k), seen)
        reading.watch(table.file)
        if found is None:
            continue
        names, blocks = found
        ids += names
        reading.end("point", len(names))
        numbers.append(blocks)
        if table.group:
            reading.groups.setdefault(table.group, []).extend(blocks.tolist())
    position = np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int64)
    reading.shop.things["point"] = entities(ids, {"position": position, "height": np.zeros_like(position)})


def _read_on_earth(reading: Reading) -> None:
    from mor.project.world.points import read_world  # most projects need nothing of it

    nothing = np.zeros(0, dtype=np.int64)
    reading.shop.things["point"] = entities((), {"position": nothing, "height": nothing})
    read_world(reading)


def point_columns(reading: Reading) -> list[Column]:
    """Return the columns that a table of points may have; not on the earth, where the reference system says them."""
    columns = [Column("id", required=True), *component_columns(POINT.components, reading.edge)]
    return [*columns, number_column("sigma", LENGTH, reading.edge)]


def _read_points_table(
    reading: Reading, table: Points, place: Place, seen: list[Seen]
) -> tuple[list[str], IntArray] | None:
    rows = read_table(table, point_columns(reading), place, reading.problems)
    if rows is None:
        return None
    names = rows.text("id")
    check_unique("point", names, rows, seen, reading.problems)
    statuses = component_rows(rows, POINT.components, table.fixed, reading.problems, rows.number("sigma"))
    return names, _add(reading, names, statuses)


def _add(reading: Reading, names: Sequence[str], statuses: Statuses) -> IntArray:
    statuses = in_dimensions(statuses, reading)
    return reading.shop.store("point").add(names, *inwards(reading.edge, statuses))


def add_free_points(reading: Reading, names: Sequence[str]) -> None:
    """Add points of which nothing is known."""
    nothing = np.full((len(names), 3), np.nan)
    free = np.ones(nothing.shape, dtype=bool)
    statuses = in_dimensions(Statuses(nothing, free, nothing.copy(), nothing.copy()), reading)
    add_points(reading, names, inwards(reading.edge, statuses))


def add_points(reading: Reading, names: Sequence[str], statuses: Statuses) -> IntArray:
    """Add points that no table has, internal axes; returned are their blocks."""
    points, tables = reading.shop.things["point"], reading.tables.setdefault("point", [])
    if tables and not tables[-1][0]:
        tables[-1] = ("", tables[-1][1] + len(names))
    else:
        tables.append(("", len(names)))
    blocks = reading.shop.store("point").add(names, *statuses)
    nothing = np.zeros_like(blocks)
    parts = {
        part: np.concatenate([known, blocks if part == "position" else nothing])
        for part, known in points.parts.items()
    }
    reading.shop.things["point"] = entities((*points.ids, *names), parts)
    return blocks
