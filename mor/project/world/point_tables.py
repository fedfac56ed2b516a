"""Tables of points on the earth, as they are given: coordinates, σ, geoid heights, deflections."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.observations.earth import DEFLECTIONS, GEOID
from mor.project.file.model import Points
from mor.project.network.poses import Seen, check_unique
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, Rows, read_table
from mor.project.world.reference_system import ReferenceSystem
from mor.units import ANGLE, LENGTH

ENU = ("east", "north", "up")


class PointTable(NamedTuple):
    """One table of points as it was read."""

    number: int
    ids: list[str]
    rows: Rows
    coordinates: FloatArray
    """(n, 3) in the system; lengths and radians."""
    start: FloatArray
    """(n, 3) start values that differ from them, NaN if they do not."""
    sigma: FloatArray
    """(n, 3) east, north, up; NaN if free, 0 where fixed."""
    geoid: FloatArray
    deflection: FloatArray
    """(n, 2) ξ, η."""


def _columns(reading: Reading, system: ReferenceSystem) -> list[Column]:
    edge = reading.edge
    columns = [Column("id", required=True)]
    for name in system.coordinates:
        quantity = ANGLE if name in ("latitude", "longitude") else LENGTH
        columns += [number_column(prefix + name, quantity, edge) for prefix in ("", "start_")]
    columns += [number_column(f"sigma_{name}", LENGTH, edge) for name in ENU]
    columns += [number_column("sigma", LENGTH, edge), number_column(GEOID, LENGTH, edge)]
    return columns + [number_column(name, ANGLE, edge) for name in DEFLECTIONS]


def read_point_table(
    reading: Reading, system: ReferenceSystem, number: int, table: Points, seen: list[Seen]
) -> PointTable | None:
    """A table of points in a system; ``None`` if it cannot be read. Mistakes are told."""
    place = reading.at("points", number)
    rows = read_table(table, _columns(reading, system), place, reading.problems)
    if rows is None:
        return None
    names = rows.text("id")
    check_unique("point", names, rows, seen, reading.problems)
    coordinates = np.stack([rows.number(name) for name in system.coordinates], axis=1)
    start = np.stack([rows.number(f"start_{name}") for name in system.coordinates], axis=1)
    if system.kind == "geographic":
        _check_degrees(reading, coordinates, rows)
    sigma = np.stack([rows.number(f"sigma_{name}") for name in ENU], axis=1)
    sigma = np.where(np.isnan(sigma), rows.number("sigma")[:, None], sigma)
    tell_rows(reading.problems, np.any(sigma < 0.0, axis=1), rows, "found a negative σ, expected a σ ≥ 0")
    if table.fixed and len(table.fixed) < 3:
        words = (
            "fixed: on the earth a point is fixed in x, y, z together; give single components a σ (sigma_up)"
        )
        reading.problems.append(place.problem(words, "fixed"))
    if table.fixed:
        sigma[:] = 0.0
    words = "σ 0 holds a point in east, north and up together; a small σ holds one of them"
    tell_rows(reading.problems, np.any(sigma == 0.0, axis=1) & np.any(sigma != 0.0, axis=1), rows, words)
    known = np.isfinite(coordinates)
    some = np.any(known, axis=1) & ~np.all(known, axis=1)
    words = f"a position on the earth needs all of {', '.join(system.coordinates)}, or none"
    tell_rows(reading.problems, some, rows, words)
    lost = np.any(sigma >= 0.0, axis=1) & ~np.any(known, axis=1)
    tell_rows(reading.problems, lost, rows, "fixed or observed, but it has no coordinates")
    deflection = np.stack([rows.number(name) for name in DEFLECTIONS], axis=1)
    return PointTable(number, names, rows, coordinates, start, sigma, rows.number(GEOID), deflection)


def _check_degrees(reading: Reading, coordinates: FloatArray, rows: Rows) -> None:
    def words(row: int) -> str:
        latitude, longitude = np.degrees(coordinates[row, :2])
        swapped = abs(longitude) <= 90.0 and abs(latitude) <= 180.0
        hint = "; are latitude and longitude exchanged?" if swapped else ""
        return f"latitude: found {latitude:.6g}°, expected it between -90° and 90°{hint}"

    tell_rows(reading.problems, np.abs(coordinates[:, 0]) > 0.5 * np.pi, rows, words)
