"""Points given in a reference system: positions, σ east, north, up, geoid heights and deflections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.earth import Ellipsoid, Horizon
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
from mor.project.edge import UnitError
from mor.project.file.earth import Origin
from mor.project.file.earth import World as WorldSection
from mor.project.network.entities import entities
from mor.project.network.poses import Seen
from mor.project.network.reading import Reading, table_label
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Place
from mor.project.world.gravity_field import at_places_to_be_found, deflections_of_table, geoid_of_table
from mor.project.world.point_tables import PointTable, read_point_table
from mor.project.world.reference_system import ReferenceSystem, ReferenceSystemError, reference_system
from mor.project.world.world import World, middle
from mor.units import ANGLE


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
    tables: list[PointTable] = []
    if system is not None:
        orthometric = _orthometric(reading, section, system)
        seen: list[Seen] = []
        for number, table in enumerate(reading.project.points):
            found = read_point_table(reading, system, number, table, seen)
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
    """Return True if heights are above the geoid; a height system that is left open is a mistake."""
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


def _world(
    reading: Reading,
    section: WorldSection,
    system: ReferenceSystem,
    tables: Sequence[PointTable],
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
    placed = list(zip(tables, geodetic, strict=True))
    N = [geoid_of_table(reading, section, table, places, orthometric) for table, places in placed]
    deflection = np.concatenate([deflections_of_table(reading, section, *table) for table in placed])
    if section.deflections is not None:
        ids = [name for table in tables for name in table.ids]
        deflection = at_places_to_be_found(reading, ids, deflection)
    xi, eta = deflection.T
    at_points = {GEOID: np.concatenate(N), DEFLECTIONS[0]: xi, DEFLECTIONS[1]: eta}
    file = Path(reading.place.folder) / section.geoid if section.geoid else None
    horizon = (
        middle(unit, everything[known]) if section.origin is None else _horizon(reading, unit, section.origin)
    )
    if horizon is None:
        return None
    flat = horizon.from_geodetic(everything[known])[:, :2]
    extent = np.stack([flat.min(axis=0), flat.max(axis=0)])
    return World(system, horizon, metres, orthometric, extent, file, at_points)


def _horizon(reading: Reading, ellipsoid: Ellipsoid, origin: Origin) -> Horizon | None:
    """The object system at a given place; a place that is none is told."""
    found = []
    for name, text in (("latitude", origin.latitude), ("longitude", origin.longitude)):
        try:
            found.append(reading.edge.number(text, ANGLE))
        except UnitError as error:
            reading.problems.append(reading.at("world").problem(f"origin: {name}: {error}", "origin"))
    if len(found) == 2 and abs(found[0]) > 0.5 * np.pi:
        words = f"origin: latitude: found {np.degrees(found[0]):.6g}°, expected it between -90° and 90°"
        reading.problems.append(reading.at("world").problem(words, "origin"))
        return None
    return Horizon(ellipsoid, *found) if len(found) == 2 else None


def _placed(table: PointTable) -> FloatArray:
    return np.where(np.isfinite(table.start), table.start, table.coordinates)


def _check_area(reading: Reading, system: ReferenceSystem, table: PointTable, geodetic: FloatArray) -> None:
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


def _add(reading: Reading, world: World, tables: Sequence[PointTable]) -> None:
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
    reading: Reading, world: World, table: PointTable, blocks: IntArray, given: FloatArray, rows: BoolArray
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
