"""Points and poses of a project, with their coordinates on the Earth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import polars as pl

from mor.model.contract import ObservationGroup, names_of
from mor.model.earth import Ellipsoid, Horizon
from mor.model.geodetic import DEFLECTIONS, GEOID, control, earth_types, projected_attitude, projected_position
from mor.model.parameters import POINT, ROTATION
from mor.model.rotations import angles_from_rotation, rotation_from_angles
from mor.project.axes import Edge, UnitError, external
from mor.project.entities import Reading, entities, set_name, table_label
from mor.project.reference_system import (
    EarthModel,
    GridError,
    ReferenceSystem,
    ReferenceSystemError,
    deflections,
    geoid_heights,
    middle,
    reference_system,
)
from mor.project.schema import Origin, Points
from mor.project.schema import World as WorldSection
from mor.project.tables import (
    Column,
    Rows,
    Statuses,
    TableLocation,
    component_columns,
    component_rows,
    number_column,
    read_table,
    tell_rows,
)
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE, LENGTH

# ---- Places of images, stations and systems given in the reference system of the project: where they start.


def place_names(world: EarthModel) -> tuple[str, ...]:
    """Names of the coordinates of frames: ``elevation`` for the height, for ``height`` is that of the instrument."""
    return tuple(name.replace("height", "elevation") for name in world.system.coordinates)


def start_places(reading: Reading, rows: Rows, plain: Statuses) -> Statuses:
    """Start values of positions in object coordinates, of the columns of :func:`position_columns`.

    ``plain`` is what stands in x, y, z: only in a geocentric system these are places on the earth.
    """
    world = reading.world
    if world is None:  # mistakes in the points, told already
        return plain
    names = ", ".join(place_names(world))
    advice = (
        "on the earth the place of a frame is a start value: observe it (projected_position, geodetic_position, "
        "gnss_position), or put it on a point (column point)"
    )
    rows.tell_where(np.any(~np.isnan(plain.sigma) | np.isfinite(plain.start), axis=1), advice)
    given = plain.values
    if world.system.kind != "geocentric":
        words = f"x, y, z of its own are not possible on the earth; expected {names}"
        rows.tell_where(np.any(np.isfinite(given), axis=1), words)
        given = np.stack([rows.number(name) for name in place_names(world)], axis=1)
    some, whole = np.any(np.isfinite(given), axis=1), np.all(np.isfinite(given), axis=1)
    rows.tell_where(some & ~whole, f"a position on the earth needs all of {names}, or none")
    free, held = np.any(plain.free, axis=1), ~np.all(plain.free, axis=1)
    rows.tell_where(held & ~whole, "fixed or observed, but it has no coordinates")
    rows.tell_where(held & free, advice)
    places = world.to_object(given, _geoid(world, rows, given))
    nothing = np.full(places.shape, np.nan)
    return Statuses(places, plain.free, nothing, nothing)


def _geoid(world: EarthModel, rows: Rows, given: FloatArray) -> FloatArray:
    """N (n,) at places (n, 3): of the column, else of the grid; a mistake where heights need it in vain."""
    if not world.orthometric:
        return np.zeros(len(given))
    N = rows.number(GEOID)
    placed = np.isfinite(given).all(axis=1)
    missing = np.isnan(N) & placed
    if world.geoid is not None and missing.any():
        try:
            geodetic = world.system.to_geodetic(world.in_metres(given))
            N = np.where(np.isnan(N), geoid_heights(world.geoid, geodetic) / world.metres, N)
        except GridError:  # told with the points
            return N
    words = (
        "height above the geoid, but the geoid is unknown: give a column geoid, or world: {geoid: FILE} that "
        "covers this place"
    )
    rows.tell_where(np.isnan(N) & placed, words)
    return N


# ---- Positions and rotations of frames: own ones, shared ones, those of points.


def positions(reading: Reading, rows: Rows, labels: list[str], fixed: Sequence[str]) -> IntArray:
    """Position block of every row: its own, or that of the point or shared position it names."""
    shop = reading.shop
    statuses = in_dimensions(component_rows(rows, POINT.components, fixed), reading)
    if reading.project.world is not None:
        statuses = start_places(reading, rows, statuses)
    column = "position" if "position" in rows.texts else "point"
    named = rows.text(column)
    points = shop.things["point"]
    shared = shop.things.setdefault("position", entities((), {"position": np.zeros(0, dtype=np.int64)}))
    known = {name: shared.part(name, "position") for name in shared.ids}
    result = np.full(len(labels), -1, dtype=np.int64)
    new: dict[str, list[int]] = {}
    for i, name in enumerate(named):
        if name in points.numbers:
            result[i] = points.part(name, "position")
        elif name in known:
            result[i] = known[name]
        elif name:
            new.setdefault(name, []).append(i)
    own = np.flatnonzero([not name for name in named])
    inner = inwards(reading.edge, statuses)
    told = _told(reading, inner)
    block_ids = [*(labels[i] for i in own), *(f"position {name}" for name in new)]
    together = [_of_rows(inner, told, np.array(same)) for same in new.values()]
    added = shop.store("point").add(block_ids, *_stacked([inner.rows(own), *together]))
    result[own] = added[: len(own)]
    for name, block in zip(new, added[len(own) :].tolist(), strict=True):
        known[name] = block
        result[new[name]] = block
    shared_rows = np.flatnonzero([bool(name) for name in named])
    _check_shared(reading, rows, column, inner, told, shared_rows, result[shared_rows])
    shop.things["position"] = entities(known, {"position": np.array(list(known.values()), dtype=np.int64)})
    return result


def _told(reading: Reading, statuses: Statuses) -> BoolArray:
    """(n, 3) coordinates that rows fix or observe, and do not only let start somewhere."""
    if reading.project.world is not None:
        return np.zeros(statuses.free.shape, dtype=bool)  # start values are all that places on the earth have
    absent = [c not in reading.project.settings.dimensions for c in "xyz"]
    return np.asarray((~statuses.free | np.isfinite(statuses.sigma)) & ~np.array(absent))


def _of_rows(statuses: Statuses, told: BoolArray, rows: IntArray) -> Statuses:
    """Merge the rows (k,) of one position: each coordinate from the first that fixes or observes it, or has a value."""
    weight = 2 * told[rows] + np.isfinite(statuses.values[rows])
    chosen = rows[np.argmax(weight, axis=0)]
    return Statuses(*(column[chosen, np.arange(3)][None] for column in statuses))


def _stacked(parts: Sequence[Statuses]) -> Statuses:
    return Statuses(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _check_shared(
    reading: Reading, rows: Rows, column: str, statuses: Statuses, told: BoolArray, chosen: IntArray, blocks: IntArray
) -> None:
    """Tell rows (k,) that fix or observe a coordinate of their position (k,) otherwise than it is."""
    if not told[chosen].any():
        return
    whole = reading.shop.store("point").merged()
    other = (statuses.values[chosen] != whole.values[blocks]) | (statuses.free[chosen] != whole.free[blocks])
    sigma, given = statuses.sigma[chosen], whole.sigma[blocks]
    other |= (sigma != given) & ~(np.isnan(sigma) & np.isnan(given))
    wrong = np.zeros(rows.count, dtype=bool)
    wrong[chosen] = (told[chosen] & other).any(axis=1)
    names = rows.text(column)
    rows.tell_where(wrong, lambda row: f"{column}: {names[row]!r} has another value or σ in its first row")


def position_columns(reading: Reading) -> list[Column]:
    """Columns of the positions of frames besides x, y, z: on the earth those of the reference system."""
    world = reading.world
    if reading.project.world is None or world is None or world.system.kind == "geocentric":
        return []
    quantities = {name: ANGLE if name in ("latitude", "longitude") else LENGTH for name in place_names(world)}
    return [number_column(name, quantity, reading.edge) for name, quantity in {**quantities, GEOID: LENGTH}.items()]


def in_dimensions(statuses: Statuses, reading: Reading) -> Statuses:
    """Positions whose coordinates are fixed where the network has no such dimension, at 0 where none is given."""
    absent = [c not in reading.project.settings.dimensions for c in "xyz"]
    return Statuses(
        np.where(absent, np.nan_to_num(statuses.values), statuses.values),
        statuses.free & ~np.array(absent),
        np.where(absent, np.nan, statuses.sigma),
        np.where(absent, np.nan, statuses.start),
    )


def rotations(
    reading: Reading,
    rows: Rows,
    labels: list[str],
    fixed: Sequence[str],
    level: bool = False,
    oriented: BoolArray | None = None,
) -> IntArray:
    """Rotation block of every row; levelled ones have ω = φ = 0 fixed.

    ω, φ, κ refer to project axes where these are right-handed, to east, north, up where they are not, for levelled
    frames, and where κ comes from an orientation (``oriented``).
    """
    values, free, sigma, start = component_rows(rows, ROTATION.components, fixed)
    if level:
        values[:, :2] = 0.0
        free[:, :2], sigma[:, :2], start[:, :2] = False, np.nan, np.nan
    as_given = np.full(len(labels), level or not reading.edge.turned)
    as_given |= oriented if oriented is not None else False
    if np.isfinite(sigma[~as_given]).any() or not free[~as_given].all():
        rows.tell(0, "fixed or observed ω, φ, κ need axes: {xy: en}")
    result = values[~as_given].copy()
    known = np.isfinite(values[~as_given]).all(axis=1)
    result[known] = angles_from_rotation(rotation_from_angles(values[~as_given][known]) @ reading.edge.matrix.T)
    values[~as_given] = result
    return reading.shop.store("rotation").add(labels, values, free, sigma, start)


def inwards(edge: Edge, statuses: Statuses) -> Statuses:
    """Coordinates with their statuses from project axes to internal ones."""
    M = edge.matrix
    source = np.argmax(np.abs(M), axis=1)
    sign = M[np.arange(3), source]
    return Statuses(
        statuses.values[:, source] * sign,
        statuses.free[:, source],
        statuses.sigma[:, source],
        statuses.start[:, source] * sign,
    )


class NameColumn(NamedTuple):
    """Names of one table, where they were read."""

    names: pl.Series
    rows: Rows


def check_unique(what: str, names: list[str], rows: Rows, seen: list[NameColumn]) -> None:
    """Report names that occur twice; ``seen`` remembers the names of the tables before."""
    here = pl.Series(names, dtype=pl.String)
    again = (~here.is_first_distinct()).to_numpy()
    for table in seen:
        again |= here.is_in(table.names.implode()).to_numpy()
    seen.append(NameColumn(here, rows))
    rows.tell_where(again, lambda row: f"{what} {names[row]!r} is given twice ({_first(seen, names[row])})")


Blocks = Mapping[str, IntArray]
"""Blocks (n,) of the rows of a table, by part."""


def read_named(
    reading: Reading,
    space: str,
    parts: Sequence[str],
    columns: list[Column],
    read: Callable[[Reading, Any, Rows, list[str]], Blocks | None],
) -> None:
    """Read all tables of a section (``images`` of the namespace ``image``): its things with the blocks of their parts.

    ``read`` returns the blocks of the rows of one table, by their names; ``None`` if it told mistakes instead.
    """
    section = f"{space}s"
    reading.shop.things[space] = entities((), {part: np.zeros(0, dtype=np.int64) for part in parts})
    seen: list[NameColumn] = []
    for k, table in enumerate(getattr(reading.project, section)):
        reading.begin(section, k, table)
        rows = read_table(table, columns, reading.at(section, k))
        reading.watch(table.file)
        if rows is None:
            continue
        names = rows.text("id")
        if "set" in rows.texts:
            names = [set_name(*pair) for pair in zip(names, rows.text("set"), strict=True)]
        check_unique(space, names, rows, seen)
        reading.table_ids[section, k] = names
        found = read(reading, table, rows, names)
        if found is not None:
            known = reading.shop.things[space]
            blocks = {part: np.concatenate([known.parts[part], found[part]]) for part in parts}
            reading.shop.things[space] = entities((*known.ids, *names), blocks)
            reading.end(space, len(names))


def _first(seen: list[NameColumn], name: str) -> str:
    """Words for the place where a name was seen first."""
    for table in seen:
        there = (table.names == name).to_numpy()
        if there.any():
            return f"first in {table.rows.file}:{int(table.rows.lines[int(np.argmax(there))])}"
    return ""


# ---- Tables of points on the earth, as they are given: coordinates, σ, geoid heights, deflections.


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


def read_point_table(
    reading: Reading, system: ReferenceSystem, number: int, table: Points, seen: list[NameColumn]
) -> PointTable | None:
    """A table of points in a system; ``None`` if it cannot be read. Mistakes are told."""
    place = reading.at("points", number)
    edge = reading.edge
    columns = [Column("id", required=True)]
    for name in system.coordinates:
        quantity = ANGLE if name in ("latitude", "longitude") else LENGTH
        columns += [number_column(prefix + name, quantity, edge) for prefix in ("", "start_")]
    enu = ("east", "north", "up")
    columns += [number_column(f"sigma_{name}", LENGTH, edge) for name in enu]
    columns += [number_column("sigma", LENGTH, edge), number_column(GEOID, LENGTH, edge)]
    rows = read_table(table, columns + [number_column(name, ANGLE, edge) for name in DEFLECTIONS], place)
    if rows is None:
        return None
    names = rows.text("id")
    check_unique("point", names, rows, seen)
    coordinates = np.stack([rows.number(name) for name in system.coordinates], axis=1)
    start = np.stack([rows.number(f"start_{name}") for name in system.coordinates], axis=1)
    if system.kind == "geographic":
        _check_degrees(coordinates, rows)
    sigma = np.stack([rows.number(f"sigma_{name}") for name in enu], axis=1)
    sigma = np.where(np.isnan(sigma), rows.number("sigma")[:, None], sigma)
    rows.tell_where(np.any(sigma < 0.0, axis=1), "found a negative σ, expected a σ ≥ 0")
    if table.fixed and len(table.fixed) < 3:
        words = "fixed: on the earth a point is fixed in x, y, z together; give single components a σ (sigma_up)"
        place.tell(words, "fixed")
    if table.fixed:
        sigma[:] = 0.0
    words = "σ 0 holds a point in east, north and up together; a small σ holds one of them"
    rows.tell_where(np.any(sigma == 0.0, axis=1) & np.any(sigma != 0.0, axis=1), words)
    known = np.isfinite(coordinates)
    some = np.any(known, axis=1) & ~np.all(known, axis=1)
    rows.tell_where(some, f"a position on the earth needs all of {', '.join(system.coordinates)}, or none")
    lost = np.any(sigma >= 0.0, axis=1) & ~np.any(known, axis=1)
    rows.tell_where(lost, "fixed or observed, but it has no coordinates")
    deflection = np.stack([rows.number(name) for name in DEFLECTIONS], axis=1)
    return PointTable(number, names, rows, coordinates, start, sigma, rows.number(GEOID), deflection)


def _check_degrees(coordinates: FloatArray, rows: Rows) -> None:
    def words(row: int) -> str:
        latitude, longitude = np.degrees(coordinates[row, :2])
        swapped = abs(longitude) <= 90.0 and abs(latitude) <= 180.0
        hint = "; are latitude and longitude exchanged?" if swapped else ""
        return f"latitude: found {latitude:.6g}°, expected it between -90° and 90°{hint}"

    rows.tell_where(np.abs(coordinates[:, 0]) > 0.5 * np.pi, words)


# ---- Geoid heights and deflections of the vertical at the points of a project: of their columns, else of grids.

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
        words = "above the geoid, but the geoid is unknown: give a column geoid, or world: {geoid: FILE}"
        if missing.all():
            place.tell(f"heights of these points are {words}")
        else:
            table.rows.tell_where(missing, lambda row: f"height of {table.ids[row]!r} is {words}")
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
    _tell_uncovered(reading, f"the grid of deflections {said}", table, geodetic, placed & np.isnan(both).any(axis=1))
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
    """Read a grid; ``None`` if it cannot be read, which is reported once."""
    try:
        return read()
    except GridError as error:
        problem = reading.at("world").problem(f"{key}: {name}: {error}", key)
        if problem not in reading.problems:
            reading.problems.append(problem)
        return None


def _tell_uncovered(reading: Reading, grid: str, table: PointTable, geodetic: FloatArray, uncovered: BoolArray) -> None:
    """Tell points beyond the grid and where they are: that shows a wrong zone, or a wrong order."""

    def place(row: int) -> str:
        latitude, longitude = np.degrees(geodetic[row, :2])
        return f"point {table.ids[row]!r} at latitude {latitude:.4f}°, longitude {longitude:.4f}°"

    if uncovered.all() and len(uncovered) > 1:
        reading.at("points", table.number).tell(f"{grid} covers none of these points ({place(0)})")
    else:
        table.rows.tell_where(uncovered, lambda row: f"{grid} does not cover {place(row)}")


# ---- Points given in a reference system: positions, σ east, north, up, geoid heights and deflections.


def read_world(reading: Reading) -> None:
    """The world of a project with all its points. Mistakes are told, and then there is no world."""
    section = reading.project.world
    assert section is not None
    before = len(reading.problems)
    if reading.project.settings.dimensions != "xyz":
        words = "dimensions: a network on the earth is one in space; a plane or a levelling network needs no world"
        reading.at("settings").tell(words, "dimensions")
    if reading.project.axes.xy != "en":
        words = "xy: on the earth x is east and y is north; the columns of points say which is which"
        reading.at("axes").tell(words, "xy")
    system = _system(reading, section)
    tables: list[PointTable] = []
    if system is not None:
        orthometric = _orthometric(reading, section, system)
        seen: list[NameColumn] = []
        for number, table in enumerate(reading.project.points):
            found = read_point_table(reading, system, number, table, seen)
            reading.watch(table.file)
            tables += [found] if found is not None else []
    if system is None or len(reading.problems) > before:
        return
    world = _world(reading, section, system, tables, orthometric)
    if world is not None and len(reading.problems) == before:  # else what follows would be told again and again
        reading.world = world
        own = (projected_position(world.horizon), projected_attitude(world.horizon))
        of_projection = {type_.key: type_ for type_ in own if system.kind == "projected"}
        reading.types = {**earth_types(world.horizon), **of_projection}
        _add(reading, world, tables)
        place: TableLocation = reading.at("world")
        given = any(np.isfinite(world.at_points[name]).any() for name in DEFLECTIONS)
        verticals = "with the deflections given" if given else "without deflections"
        reading.notes.append(place.problem(f"{world.system.name}: verticals are normals of the ellipsoid, {verticals}"))


def _system(reading: Reading, section: WorldSection) -> ReferenceSystem | None:
    try:
        return reference_system(section.crs)
    except ReferenceSystemError as error:
        reading.at("world").tell(f"crs: {error}", "crs")
        return None


def _orthometric(reading: Reading, section: WorldSection, system: ReferenceSystem) -> bool:
    """Return True if heights are above the geoid; a height system that is left open is a mistake."""
    place = reading.at("world")
    if section.heights is None and not system.vertical and system.kind != "geocentric":
        if system.kind == "geographic" and len(system.crs.axis_info) == 3:
            return False
        place.tell(f"{system.name} does not say what heights refer to; set heights: ellipsoidal, or orthometric")
    if system.kind == "geocentric" and section.heights == "orthometric":
        place.tell("heights: geocentric coordinates have none", "heights")
    if system.vertical and section.heights == "ellipsoidal":
        place.tell(f"heights: found ellipsoidal, but those of the system are {system.vertical!r}", "heights")
    return bool(system.vertical) or section.heights == "orthometric"


def _world(
    reading: Reading, section: WorldSection, system: ReferenceSystem, tables: Sequence[PointTable], orthometric: bool
) -> EarthModel | None:
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
        reading.at("world").tell("no point has coordinates: the position of the network on the earth is unknown")
        return None
    placed = list(zip(tables, geodetic, strict=True))
    N = [geoid_of_table(reading, section, table, places, orthometric) for table, places in placed]
    deflection = np.concatenate([deflections_of_table(reading, section, *table) for table in placed])
    if section.deflections is not None:
        ids = [name for table in tables for name in table.ids]
        deflection = at_places_to_be_found(reading, ids, deflection)
    xi, eta = deflection.T
    at_points = {GEOID: np.concatenate(N), DEFLECTIONS[0]: xi, DEFLECTIONS[1]: eta}
    file = Path(reading.place.folder) / section.geoid if section.geoid else None
    horizon = middle(unit, everything[known]) if section.origin is None else _horizon(reading, unit, section.origin)
    if horizon is None:
        return None
    flat = horizon.from_geodetic(everything[known])[:, :2]
    extent = np.stack([flat.min(axis=0), flat.max(axis=0)])
    return EarthModel(system, horizon, metres, orthometric, extent, file, at_points)


def _horizon(reading: Reading, ellipsoid: Ellipsoid, origin: Origin) -> Horizon | None:
    """The object system at a given place; a place that is none is told."""
    found = []
    for name, text in (("latitude", origin.latitude), ("longitude", origin.longitude)):
        try:
            found.append(reading.edge.number(text, ANGLE))
        except UnitError as error:
            reading.at("world").tell(f"origin: {name}: {error}", "origin")
    if len(found) == 2 and abs(found[0]) > 0.5 * np.pi:
        words = f"origin: latitude: found {np.degrees(found[0]):.6g}°, expected it between -90° and 90°"
        reading.at("world").tell(words, "origin")
        return None
    return Horizon(ellipsoid, *found) if len(found) == 2 else None


def _placed(table: PointTable) -> FloatArray:
    return np.where(np.isfinite(table.start), table.start, table.coordinates)


def _check_area(reading: Reading, system: ReferenceSystem, table: PointTable, geodetic: FloatArray) -> None:
    """Tell points far outside the area of the system, and whether exchanged coordinates would lie inside.

    Latitudes and longitudes are places of the ellipsoid everywhere: there it is a note, unless they seem exchanged.
    """
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

    places = outside & ~lost & ~inside & (system.kind == "geographic")
    table.rows.tell_where(outside & ~places, words)
    tell_rows(reading.notes, places, table.rows, words)


def _add(reading: Reading, world: EarthModel, tables: Sequence[PointTable]) -> None:
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
    reading: Reading, world: EarthModel, table: PointTable, blocks: IntArray, given: FloatArray, rows: BoolArray
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


# ---- Object points of a project, and the checks that every named table shares.


def read_points(reading: Reading) -> None:
    """Object points; coordinates go into internal axes."""
    if reading.project.world is not None:
        nothing = np.zeros(0, dtype=np.int64)
        reading.shop.things["point"] = entities((), {"position": nothing, "height": nothing})
        read_world(reading)
        return
    read_named(reading, "point", ("position", "height"), point_columns(reading), _points_of_table)


def point_columns(reading: Reading) -> list[Column]:
    """Return the columns that a table of points may have; not on the earth, where the reference system says them."""
    columns = [Column("id", required=True), *component_columns(POINT.components, reading.edge)]
    return [*columns, number_column("sigma", LENGTH, reading.edge)]


def _points_of_table(reading: Reading, table: Points, rows: Rows, names: list[str]) -> Blocks:
    statuses = component_rows(rows, POINT.components, table.fixed, rows.number("sigma"))
    blocks = reading.shop.store("point").add(names, *inwards(reading.edge, in_dimensions(statuses, reading)))
    if table.group:
        reading.groups.setdefault(table.group, []).extend(blocks.tolist())
    return {"position": blocks, "height": np.zeros_like(blocks)}


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
        part: np.concatenate([known, blocks if part == "position" else nothing]) for part, known in points.parts.items()
    }
    reading.shop.things["point"] = entities((*points.ids, *names), parts)
    return blocks
