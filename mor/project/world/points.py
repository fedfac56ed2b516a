"""Points given in a reference system: positions, σ east, north, up, geoid heights and deflections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.earth import Ellipsoid
from mor.observations import ObservationGroup
from mor.observations.earth import (
    DEFLECTIONS,
    GEOID,
    control,
    earth_types,
    projected_attitude,
    projected_position,
)
from mor.observations.names import names_of
from mor.project.axes import external
from mor.project.file.earth import World as WorldSection
from mor.project.file.model import Points
from mor.project.network.entities import entities
from mor.project.network.poses import Seen, check_unique
from mor.project.network.reading import Reading, table_label
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.project.world.geoid import GeoidError, geoid_heights
from mor.project.world.reference_system import ReferenceSystem, ReferenceSystemError, reference_system
from mor.project.world.world import World, middle
from mor.units import ANGLE, LENGTH

ENU = ("east", "north", "up")


@dataclass(frozen=True)
class _Table:
    """One table of points as it was read."""

    number: int
    ids: list[str]
    rows: Rows
    coordinates: FloatArray
    """(n, 3) in the system; lengths and radians."""
    start: FloatArray
    """(n, 3) start values that differ from them, NaN where they do not."""
    sigma: FloatArray
    """(n, 3) east, north, up; NaN where free, 0 where fixed."""
    geoid: FloatArray
    deflection: FloatArray
    """(n, 2) ξ, η."""


def read_world(reading: Reading) -> None:
    """The world of a project with all its points. Mistakes are told, and then there is no world."""
    section = reading.project.world
    assert section is not None
    before = len(reading.problems)
    if reading.project.settings.dimensions != "xyz":
        words = "dimensions: a network on the earth is one in space; a plane or a levelling network needs no world"
        reading.problems.append(reading.at("settings").problem(words, "dimensions"))
    if reading.project.axes.xy != "en":
        words = "xy: on the earth x is east and y is north; the columns of points say which is which"
        reading.problems.append(reading.at("axes").problem(words, "xy"))
    system = _system(reading, section)
    tables: list[_Table] = []
    if system is not None:
        orthometric = _orthometric(reading, section, system)
        seen: list[Seen] = []
        for number, table in enumerate(reading.project.points):
            found = _read_table(reading, system, number, table, seen)
            reading.watch(table.file)
            tables += [found] if found is not None else []
    if system is None or len(reading.problems) > before:
        return
    world = _world(reading, section, system, tables, orthometric)
    if (
        world is not None and len(reading.problems) == before
    ):  # else what follows would be told again and again
        reading.world = world
        own = (projected_position(world.horizon), projected_attitude(world.horizon))
        of_projection = {type_.key: type_ for type_ in own if system.kind == "projected"}
        reading.types = {**earth_types(world.horizon), **of_projection}
        _add(reading, world, tables)
        _note(reading, world)


def _system(reading: Reading, section: WorldSection) -> ReferenceSystem | None:
    try:
        return reference_system(section.crs)
    except ReferenceSystemError as error:
        reading.problems.append(reading.at("world").problem(f"crs: {error}", "crs"))
        return None


def _orthometric(reading: Reading, section: WorldSection, system: ReferenceSystem) -> bool:
    """True where heights are above the geoid; a height system that is left open is a mistake."""
    place = reading.at("world")
    if section.heights is None and not system.vertical and system.kind != "geocentric":
        if system.kind == "geographic" and len(system.crs.axis_info) == 3:
            return False
        words = f"{system.name} does not say what heights are above; heights: ellipsoidal, or orthometric"
        reading.problems.append(place.problem(words))
    if system.kind == "geocentric" and section.heights == "orthometric":
        reading.problems.append(place.problem("heights: geocentric coordinates have none", "heights"))
    if system.vertical and section.heights == "ellipsoidal":
        words = f"heights: found ellipsoidal, but those of the system are {system.vertical!r}"
        reading.problems.append(place.problem(words, "heights"))
    return bool(system.vertical) or section.heights == "orthometric"


def _columns(reading: Reading, system: ReferenceSystem) -> list[Column]:
    edge = reading.edge
    columns = [Column("id", required=True)]
    for name in system.coordinates:
        quantity = ANGLE if name in ("latitude", "longitude") else LENGTH
        columns += [number_column(prefix + name, quantity, edge) for prefix in ("", "start_")]
    columns += [number_column(f"sigma_{name}", LENGTH, edge) for name in ENU]
    columns += [number_column("sigma", LENGTH, edge), number_column(GEOID, LENGTH, edge)]
    return columns + [number_column(name, ANGLE, edge) for name in DEFLECTIONS]


def _read_table(
    reading: Reading, system: ReferenceSystem, number: int, table: Points, seen: list[Seen]
) -> _Table | None:
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
    return _Table(number, names, rows, coordinates, start, sigma, rows.number(GEOID), deflection)


def _check_degrees(reading: Reading, coordinates: FloatArray, rows: Rows) -> None:
    def words(row: int) -> str:
        latitude, longitude = np.degrees(coordinates[row, :2])
        swapped = abs(longitude) <= 90.0 and abs(latitude) <= 180.0
        hint = "; are latitude and longitude exchanged?" if swapped else ""
        return f"latitude: found {latitude:.6g}°, expected it between -90° and 90°{hint}"

    tell_rows(reading.problems, np.abs(coordinates[:, 0]) > 0.5 * np.pi, rows, words)


def _world(
    reading: Reading,
    section: WorldSection,
    system: ReferenceSystem,
    tables: Sequence[_Table],
    orthometric: bool,
) -> World | None:
    """The world with geoid heights and deflections of all points; the object system in the middle of the known ones."""
    metres = reading.edge.metres
    unit = Ellipsoid(system.ellipsoid.a / metres, system.ellipsoid.f)
    scale = np.array([1.0 if name in ("latitude", "longitude") else metres for name in system.coordinates])
    geodetic = [system.to_geodetic(_placed(table) * scale) for table in tables]
    for table, places in zip(tables, geodetic, strict=True):
        places[:, 2] /= metres
        _check_area(reading, system, table, places)
    everything = np.concatenate([*geodetic, np.zeros((0, 3))])
    known = np.isfinite(everything).all(axis=1)
    if not known.any():
        words = "no point has coordinates: nothing says where on the earth the network lies"
        reading.problems.append(reading.at("world").problem(words))
        return None
    N = [
        _geoid(reading, section, table, places, orthometric)
        for table, places in zip(tables, geodetic, strict=True)
    ]
    xi, eta = (np.concatenate([table.deflection[:, k] for table in tables]) for k in range(2))
    at_points = {GEOID: np.concatenate(N), DEFLECTIONS[0]: xi, DEFLECTIONS[1]: eta}
    file = Path(reading.place.folder) / section.geoid if section.geoid else None
    return World(system, middle(unit, everything[known]), metres, orthometric, file, at_points)


def _placed(table: _Table) -> FloatArray:
    return np.where(np.isfinite(table.start), table.start, table.coordinates)


def _check_area(reading: Reading, system: ReferenceSystem, table: _Table, geodetic: FloatArray) -> None:
    """Tell points far outside the area of the system, and whether exchanged coordinates would lie inside."""
    known = np.isfinite(geodetic).all(axis=1)
    lost = np.isfinite(table.coordinates).all(axis=1) & ~known
    outside = lost | (known & system.outside(np.nan_to_num(geodetic)))
    if not outside.any():
        return
    exchanged = system.to_geodetic(
        table.coordinates[:, [1, 0, 2]] * reading.edge.metres ** (system.kind == "projected")
    )
    inside = np.isfinite(exchanged).all(axis=1) & ~system.outside(np.nan_to_num(exchanged))
    one, two = system.coordinates[:2]

    def words(row: int) -> str:
        hint = f"; with {one} and {two} exchanged it would lie inside" if inside[row] else ""
        return f"point {table.ids[row]!r} lies outside the area that {system.name} is made for{hint}"

    tell_rows(reading.problems, outside, table.rows, words)


def _geoid(
    reading: Reading, section: WorldSection, table: _Table, geodetic: FloatArray, orthometric: bool
) -> FloatArray:
    """N (n,) of the points of a table: of its column, else of the grid; told where heights need it in vain."""
    N = table.geoid.copy()
    missing = np.isnan(N) & np.all(np.isfinite(geodetic), axis=1)
    place = reading.at("points", table.number)
    if section.geoid is not None and np.isnan(N).any():
        found = _geoid_of_grid(reading, section.geoid, geodetic)
        if found is None:
            return N
        N = np.where(np.isnan(N), found / reading.edge.metres, N)
        _tell_uncovered(reading, section.geoid, table, geodetic, missing & np.isnan(N))
    elif orthometric and missing.any():
        words = "above the geoid, and nothing says where that is: a column geoid, or world: {geoid: FILE}"
        if missing.all():
            reading.problems.append(place.problem(f"heights of these points are {words}"))
        else:
            tell_rows(
                reading.problems, missing, table.rows, lambda row: f"height of {table.ids[row]!r} is {words}"
            )
    return N


def _tell_uncovered(
    reading: Reading, geoid: str, table: _Table, geodetic: FloatArray, uncovered: BoolArray
) -> None:
    """Tell points beyond the grid and where they are: that shows a wrong zone, or a wrong order."""

    def place(row: int) -> str:
        latitude, longitude = np.degrees(geodetic[row, :2])
        return f"point {table.ids[row]!r} at latitude {latitude:.4f}°, longitude {longitude:.4f}°"

    if uncovered.all() and len(uncovered) > 1:
        words = f"the geoid {geoid} covers none of these points ({place(0)})"
        reading.problems.append(reading.at("points", table.number).problem(words))
    else:
        tell_rows(
            reading.problems,
            uncovered,
            table.rows,
            lambda row: f"the geoid {geoid} does not cover {place(row)}",
        )


def _geoid_of_grid(reading: Reading, name: str, geodetic: FloatArray) -> FloatArray | None:
    """N (n,), m; ``None`` where the grid cannot be read, which is told once."""
    try:
        return geoid_heights(Path(reading.place.folder) / name, geodetic)
    except GeoidError as error:
        problem = reading.at("world").problem(f"geoid: {name}: {error}", "geoid")
        if problem not in reading.problems:
            reading.problems.append(problem)
        return None


def _add(reading: Reading, world: World, tables: Sequence[_Table]) -> None:
    """The points as blocks in object coordinates; what is observed with σ becomes groups of control."""
    ids: list[str] = []
    numbers: list[IntArray] = []
    first = 0
    for table in tables:
        reading.begin("points", table.number, reading.project.points[table.number])
        N = world.at_points[GEOID][first : first + len(table.ids)]
        first += len(table.ids)
        given = world.to_object(table.coordinates, N)
        position = world.to_object(_placed(table), N)
        fixed = np.asarray((table.sigma == 0.0).all(axis=1))
        free = np.broadcast_to(~fixed[:, None], position.shape).copy()
        values = np.where(fixed[:, None], given, position)
        blocks = reading.shop.store("point").add(table.ids, values, free, np.full(position.shape, np.nan))
        ids += table.ids
        numbers.append(blocks)
        reading.end("point", len(table.ids))
        group = reading.project.points[table.number].group
        if group:
            reading.groups.setdefault(group, []).extend(blocks.tolist())
        observed = np.isfinite(table.sigma).any(axis=1) & ~fixed
        if observed.any():
            reading.control.append(_control(reading, world, table, blocks, given, observed))
    place = np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int64)
    reading.shop.things["point"] = entities(ids, {"position": place, "height": np.zeros_like(place)})


def _control(
    reading: Reading, world: World, table: _Table, blocks: IntArray, given: FloatArray, rows: BoolArray
) -> ObservationGroup:
    type_ = control(world.horizon)
    sigma = table.sigma[rows]
    return ObservationGroup(
        name=table_label("points", table.number, reading.project.points[table.number]),
        type=type_,
        blocks=(blocks[rows],),
        observed=np.where(np.isfinite(sigma), 0.0, np.nan),
        sigma=sigma,
        constants=given[rows],
        references=(names_of([table.ids[row] for row in np.flatnonzero(rows)]),),
        external=external(type_, reading.edge),
        lines=table.rows.lines[rows],
        file=table.rows.file,
    )


def _note(reading: Reading, world: World) -> None:
    place: Place = reading.at("world")
    given = any(np.isfinite(world.at_points[name]).any() for name in DEFLECTIONS)
    verticals = "with the deflections given" if given else "without deflections"
    words = f"{world.system.name}: verticals are normals of the ellipsoid, {verticals}"
    reading.notes.append(place.problem(words))
