"""Geoid heights and deflections of the vertical at the points of a project: of their columns, else of grids."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.project.file.earth import World as WorldSection
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.world.grids import GridError, deflections, geoid_heights
from mor.project.world.point_tables import PointTable

_Values = TypeVar("_Values")


def geoid_of_table(
    reading: Reading, section: WorldSection, table: PointTable, geodetic: FloatArray, orthometric: bool
) -> FloatArray:
    """N (n,) of the points of a table: of its column, else of the grid; told where heights need it in vain."""
    N = table.geoid.copy()
    missing = np.isnan(N) & np.all(np.isfinite(geodetic), axis=1)
    place = reading.at("points", table.number)
    file = section.geoid
    if file is not None and np.isnan(N).any():
        path = Path(reading.place.folder) / file
        found = _of_grid(reading, "geoid", file, lambda: geoid_heights(path, geodetic))
        if found is None:
            return N
        N = np.where(np.isnan(N), found / reading.edge.metres, N)
        _tell_uncovered(reading, f"the geoid {file}", table, geodetic, missing & np.isnan(N))
    elif orthometric and missing.any():
        words = "above the geoid, and nothing says where that is: a column geoid, or world: {geoid: FILE}"
        if missing.all():
            reading.problems.append(place.problem(f"heights of these points are {words}"))
        else:
            tell_rows(
                reading.problems, missing, table.rows, lambda row: f"height of {table.ids[row]!r} is {words}"
            )
    return N


def deflections_of_table(
    reading: Reading, section: WorldSection, table: PointTable, geodetic: FloatArray
) -> FloatArray:
    """ξ, η (n, 2) of the points of a table: of its columns, else of the grids; NaN if neither has them."""
    given = section.deflections
    if given is None or not np.isnan(table.deflection).any():
        return table.deflection
    names = [given] if isinstance(given, str) else [given.north, given.east]
    paths = tuple(Path(reading.place.folder) / name for name in names)
    said = ", ".join(names)
    found = _of_grid(reading, "deflections", said, lambda: deflections(paths, geodetic))
    if found is None:
        return table.deflection
    both = np.where(np.isnan(table.deflection), found, table.deflection)
    placed = np.all(np.isfinite(geodetic), axis=1)
    _tell_uncovered(
        reading, f"the grid of deflections {said}", table, geodetic, placed & np.isnan(both).any(axis=1)
    )
    return both


def at_places_to_be_found(reading: Reading, ids: list[str], deflection: FloatArray) -> FloatArray:
    """ξ, η (n, 2) of all points; where grids are given, those of points without a place are their mean elsewhere.

    That is said in a note: at which place a grid is to be read is known only after the adjustment.
    """
    unknown = np.isnan(deflection).any(axis=1)
    if not unknown.any() or unknown.all():
        return deflection
    mean = np.mean(deflection[~unknown], axis=0)
    arcsec = np.degrees(mean) * 3600.0
    words = (
        f"points without coordinates, like {ids[int(np.argmax(unknown))]!r}, have the mean deflection of all others, "
        f"{arcsec[0]:.2f}″ north and {arcsec[1]:.2f}″ east"
    )
    reading.notes.append(reading.at("world").problem(words, "deflections"))
    return np.where(np.isnan(deflection), mean, deflection)


def _of_grid(reading: Reading, key: str, name: str, read: Callable[[], _Values]) -> _Values | None:
    """What a grid has; ``None`` if it cannot be read, which is told once."""
    try:
        return read()
    except GridError as error:
        problem = reading.at("world").problem(f"{key}: {name}: {error}", key)
        if problem not in reading.problems:
            reading.problems.append(problem)
        return None


def _tell_uncovered(
    reading: Reading, grid: str, table: PointTable, geodetic: FloatArray, uncovered: BoolArray
) -> None:
    """Tell points beyond the grid and where they are: that shows a wrong zone, or a wrong order."""

    def place(row: int) -> str:
        latitude, longitude = np.degrees(geodetic[row, :2])
        return f"point {table.ids[row]!r} at latitude {latitude:.4f}°, longitude {longitude:.4f}°"

    if uncovered.all() and len(uncovered) > 1:
        words = f"{grid} covers none of these points ({place(0)})"
        reading.problems.append(reading.at("points", table.number).problem(words))
    else:
        tell_rows(reading.problems, uncovered, table.rows, lambda row: f"{grid} does not cover {place(row)}")
