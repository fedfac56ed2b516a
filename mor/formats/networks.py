"""Terrestrial networks on the way to other programs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message
from mor.formats.content import Content, ContentTable
from mor.model.contract import ObservationType, coded
from mor.model.geodetic import DEFLECTIONS, GEOID
from mor.model.observation_types import PLAIN_TYPES
from mor.project.network import Network, members_of, rows_of_covariance
from mor.project.reference_system import EarthModel
from mor.project.rows import CLUSTER
from mor.project.schema import Observations
from mor.project.tables import Column, Rows, number_column, tell_rows
from mor.types import BoolArray, FloatArray
from mor.units import ANGLE, LENGTH

# ---- Terrestrial observations of a project for writers: tables in internal units, stations, readings in face one.


@dataclass(frozen=True)
class ObservationTable:
    """A table of observations in internal units."""

    entry: Observations
    rows: Rows
    values: FloatArray
    """(n, components), NaN if not observed."""
    sigma: FloatArray
    covariance: FloatArray | None
    """Over all observed values, row by row; that of an entry over those of its cluster, in the units of their σ."""
    factors: FloatArray
    """(components,) internal units per unit of the σ."""


def groups(
    content: Content, types: Collection[str], known: Mapping[str, ObservationType] = PLAIN_TYPES
) -> list[ObservationTable]:
    """All tables of some types, which stand in ``known``, with the points under the stations that they name.

    Raises :class:`InputError`, also for an observation between a point and itself and for one from an image.
    """
    chosen = [(k, entry) for k, entry in enumerate(content.project.observations) if entry.type in types]
    if not chosen or content.project.world is not None:  # on the earth, stations are resolved by SetUps
        return [
            part
            for k, entry in chosen
            for part in _by_cluster(_group(content, k, entry, known[entry.type]), content, k)
        ]
    aside = content._replace(unread={})  # reading names a second time is no use of the other columns
    points = {
        name
        for k, table in enumerate(content.project.points)
        for name in aside.rows("points", k, table, [Column("id")]).text("id")
    }
    images = {
        name
        for k, table in enumerate(content.project.images)
        for name in aside.rows("images", k, table, [Column("id")]).text("id")
    }
    under = stations(aside)
    found = [
        _between_points(_group(content, k, entry, known[entry.type]), under, points, images, content)
        for k, entry in chosen
    ]
    return [part for (k, _), group in zip(chosen, found, strict=True) for part in _by_cluster(group, content, k)]


def _between_points(
    group: ObservationTable,
    under: Mapping[str, tuple[str, float]],
    points: Collection[str],
    images: Collection[str],
    content: Content,
) -> ObservationTable:
    """A table that names points: those under its stations, whose heights are those of its rows without one."""
    type_ = PLAIN_TYPES[group.entry.type]
    texts, numbers, problems = dict(group.rows.texts), dict(group.rows.numbers), []
    columns: list[list[str]] = []
    for reference in type_.references:
        names, column = group.rows.text(reference.name), reference.name
        if reference.among[0] == "station":
            columns.append([under.get(name, (name, 0.0))[0] for name in names])
        elif "point" in reference.among:
            height = group.rows.number(f"{column}_height").copy()
            for row, name in enumerate(names):
                space, _, bare = name.rpartition(":")
                names[row] = bare = bare if space in ("point", "station", "image", "centre") else name
                if space in ("image", "centre") or (bare in images and bare not in points | under.keys()):
                    words = f"{column}: {bare!r} is an image; the format knows observations between points only"
                    problems.append(Message(words, group.rows.file, int(group.rows.lines[row])))
                elif bare in under and (space == "station" or (space != "point" and bare not in points)):
                    names[row], own = under[bare]
                    if not type_.between_marks and np.isnan(height[row]):
                        height[row] = own / content.edge.metres
            texts[column], numbers[f"{column}_height"] = coded(pl.Series(names, dtype=pl.String)), height
            columns.append(names)
    ends = np.array([[len(set(row)) < len(columns)] for row in zip(*columns, strict=True)], dtype=bool)
    tell_rows(problems, ends.ravel(), group.rows, lambda row: f"point {columns[-1][row]!r} is observed from itself")
    if problems:
        raise InputError(problems)
    return replace(group, rows=replace(group.rows, texts=texts, numbers=numbers))


def _by_cluster(group: ObservationTable, content: Content, number: int) -> Iterator[ObservationTable]:
    """A table with its matrix, where it has one: of clusters of rows each by itself."""
    entry, seen = group.entry, np.isfinite(group.values)
    if entry.covariance is None:
        yield group
        return
    place = content.place("observations", number)
    given = rows_of_covariance(entry, place)
    if given is None:
        raise InputError(place.problems)
    if CLUSTER not in group.rows.texts:
        yield replace(group, covariance=np.array(given, dtype=float))
        return
    of_row = group.rows.names(CLUSTER).numbers
    for own in members_of(of_row[np.nonzero(seen)[0]]):
        rows = np.unique(np.nonzero(seen)[0][own])
        matrix = np.array([given[k] for k in own.tolist()], dtype=float)
        yield replace(
            group, rows=group.rows.take(rows), values=group.values[rows], sigma=group.sigma[rows], covariance=matrix
        )


def _group(content: Content, number: int, entry: Observations, type_: ObservationType) -> ObservationTable:
    edge = content.edge
    components = type_.components
    columns = [Column(reference.name, required=True) for reference in type_.references]
    columns += [Column("set"), Column(CLUSTER)]
    for name, quantity in [(c.name, c.quantity) for c in components]:
        columns += [number_column(f"{p}{name}", quantity, edge) for p in ("", "sigma_")]
    columns.append(number_column("sigma", components[0].quantity, edge))
    columns += [number_column(f"{slot}_height", LENGTH, edge) for slot in ("from", "to", "station", "at")]
    columns.append(Column("face", parse=lambda text, _: float(text), factor=lambda _: 1.0))

    def squared(text: str, unit: str) -> float:
        return float(text) * edge.factor(LENGTH, unit) ** 2

    pairs = [(a, b) for i, a in enumerate(components) for b in components[i:]] if len(components) == 3 else []
    columns += [Column(f"cov_{a.name}_{b.name}", parse=squared) for a, b in pairs]
    rows = content.rows("observations", number, entry, columns)
    values = np.stack([rows.number(c.name) for c in components], axis=1)
    own = np.stack([rows.number(f"sigma_{c.name}") for c in components], axis=1)
    factors = np.array([edge.factor(c.quantity, _sigma_unit(entry, c.name)) for c in components])
    sigma = np.where(np.isnan(own), rows.number("sigma")[:, None], own) * entry.factor
    if entry.ppm:
        far = np.nan_to_num(values[:, :1]) if "distance" in entry.type else np.zeros((len(values), 1))
        sigma = np.hypot(sigma, entry.ppm * 1e-6 * far)
    return ObservationTable(entry, rows, values, sigma, _covariance(entry, type_, rows, values, sigma), factors)


def _sigma_unit(entry: Observations, name: str) -> str:
    """Unit that the σ and covariances of a component are given in."""
    if isinstance(entry.units, str):
        return entry.units
    return entry.units.get("sigma", entry.units.get(name, ""))


def _covariance(
    entry: Observations, type_: ObservationType, rows: Rows, values: FloatArray, sigma: FloatArray
) -> FloatArray | None:
    """Covariance over the observed values of a table, in the order of its rows; ``None`` if it has only σ.

    Vectors and coordinates always have one.
    """
    if entry.covariance is not None or len(values[0]) != 3:
        return None
    matrix = np.diag(np.nan_to_num(sigma.ravel() ** 2))
    names = [component.name for component in type_.components]
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        column = rows.number(f"cov_{names[i]}_{names[j]}")
        for row in np.flatnonzero(np.isfinite(column)).tolist():
            a, b = row * 3 + i, row * 3 + j
            matrix[a, b] = matrix[b, a] = column[row]
    seen = np.flatnonzero(np.isfinite(values).ravel())
    return np.asarray(matrix[np.ix_(seen, seen)])


def stations(content: Content) -> dict[str, tuple[str, float]]:
    """Point and instrument height (m) of each declared station."""
    result = {}
    for number, table in enumerate(content.project.stations):
        columns = [Column(name) for name in ("id", "point", "set", "shared_height")]
        columns += [number_column(name, LENGTH, content.edge) for name in ("height", "x", "y", "z")]
        columns += [number_column("orientation", ANGLE, content.edge)]
        rows = content.rows("stations", number, table, columns)
        heights = np.nan_to_num(rows.number("height")) * content.edge.metres
        for name, point, height in zip(rows.text("id"), rows.text("point"), heights.tolist(), strict=True):
            result[name] = (point or name, height)
    return result


def heights_of(
    group: ObservationTable, references: dict[str, str], row: int, known: dict[str, tuple[str, float]], metres: float
) -> tuple[float, float]:
    """Heights of instrument and target of a row, m; ``references`` are its names."""
    own = float(np.nan_to_num(group.rows.number("from_height")[row])) * metres
    if "station" in references:
        own = known.get(references["station"], ("", 0.0))[1]
        given = float(group.rows.number("station_height")[row]) * metres
        own = given if np.isfinite(given) else own
    return own, float(np.nan_to_num(group.rows.number("to_height")[row])) * metres


class Places(NamedTuple):
    """Points east, north, up in metres: values, σ (NaN if there is none), free or held; (n, 3) each."""

    values: FloatArray
    sigma: FloatArray
    free: BoolArray


def places(found: ContentTable, content: Content) -> Places:
    """Points of a project in metres on axes east, north, up: what is observed or held, start values of all else."""
    M, metres = content.edge.matrix, content.edge.metres
    source = np.argmax(np.abs(M), axis=1)
    statuses = found.statuses
    known = ~statuses.free | np.isfinite(statuses.sigma)
    given = np.where(known, statuses.values, found.values) * metres
    values: FloatArray = given[:, source] * M[np.arange(3), source]
    return Places(values, (statuses.sigma * metres)[:, source], statuses.free[:, source])


def tilted_stations(content: Content, what: str) -> list[Message]:
    """Tables of stations that are not exactly levelled, as mistakes of a format that knows no others."""
    return [
        content.place("stations", number).problem(f"{what} has levelled stations only")
        for number, table in enumerate(content.project.stations)
        if table.level != "fixed"
    ]


def circle_in_face_one(value: FloatArray, face: FloatArray) -> FloatArray:
    """Readings of the horizontal circle (n,), rad, as they would be in face one."""
    return np.asarray(np.where(face == 2, value - np.pi, value) % (2 * np.pi))


def zenith_in_face_one(value: FloatArray, face: FloatArray) -> FloatArray:
    """Zenith angles (n,), rad, as they would be read in face one."""
    return np.asarray(np.where(face == 2, 2 * np.pi - value, value))


# ---- A network on the earth for writers: where its points are and what is held of them, clusters of GNSS.


class EarthPoints(NamedTuple):
    """Points at their start values, in metres and radians; arrays have a row for each."""

    ids: list[str]
    geodetic: FloatArray
    """(n, 3) latitude, longitude, ellipsoidal height."""
    given: FloatArray
    """(n, 3) in the reference system and the heights of the project."""
    geoid: FloatArray
    """(n,) N, NaN if unknown."""
    deflections: FloatArray
    """(n, 2) ξ, η."""
    held: BoolArray
    """(n, 3) east, north, up: held, or observed with a σ of a micrometre."""

    @property
    def geoid_by_name(self) -> dict[str, float]:
        """Geoid heights by name, 0 where unknown."""
        return dict(zip(self.ids, np.nan_to_num(self.geoid).tolist(), strict=True))


def world_of(content: Content, what: str) -> None:
    """Raise :class:`InputError` where a project is none on the earth."""
    if content.project.world is None:
        words = f"{what} has networks on the earth: this project has no world"
        raise InputError([Message(words, content.document.file)])


def clockwise_from_north(content: Content, what: str) -> None:
    """Raise :class:`InputError` where angles of a project have other senses and zeros."""
    if content.project.axes.angles != "clockwise" or content.project.axes.bearings_from != "north":
        raise InputError([content.place("axes").problem(f"{what} has angles clockwise and azimuths from north")])


def earth_points(content: Content, network: Network, what: str) -> EarthPoints:
    """All points. Raises :class:`InputError` for those without a place, and for σ that ``what`` has not."""
    world, things = network.world, network.things["point"]
    assert world is not None
    blocks = things.parts["position"]
    object_ = network.start["point"][blocks]
    words = "has no coordinates; convert an adjusted project (adjusted.yaml)"
    problems = [
        Message(f"point {name!r} {words}", content.document.file)
        for name, place in zip(things.ids, object_, strict=True)
        if not np.isfinite(place).all()
    ]
    tables = _tables(content, world, what, problems)
    if problems:
        raise InputError(problems)
    geoid = world.geoid_at(blocks, object_)
    given = world.in_metres(world.from_object(object_, np.nan_to_num(geoid)))
    nothing = _Entry(np.full(3, np.nan), np.zeros(3, dtype=bool))
    entries = [tables.get(name, nothing) for name in things.ids]
    own = np.array([entry.given for entry in entries]).reshape(-1, 3)
    deflections = [world.of_points(f"deflection_{axis}", blocks) for axis in ("north", "east")]
    return EarthPoints(
        list(things.ids),
        world.horizon.to_geodetic(object_) * np.array([1.0, 1.0, world.metres]),
        np.where(np.isfinite(own), own, given),
        geoid * world.metres,
        np.stack(deflections, axis=1),
        np.array([entry.held for entry in entries]).reshape(-1, 3),
    )


class _Entry(NamedTuple):
    """A point as its table has it: coordinates (m, rad; NaN if there are none), what is held."""

    given: FloatArray
    held: BoolArray


def _tables(content: Content, world: EarthModel, what: str, problems: list[Message]) -> dict[str, _Entry]:
    """Points of all tables, so that coordinates are those of the project to the last digit.

    σ that do not hold a component are mistakes.
    """
    edge, known = content.edge, {}
    names, coordinates = ("sigma_east", "sigma_north", "sigma_up"), world.system.coordinates
    # Largest σ (m) that is as good as none.
    exact = 1e-6
    for number, table in enumerate(content.project.points):
        columns = [Column("id", required=True), Column(GEOID), *(Column(name) for name in DEFLECTIONS)]
        columns += [number_column(name, LENGTH, edge) for name in ("sigma", *names)]
        for name in coordinates:
            quantity = ANGLE if "tude" in name else LENGTH
            columns += [number_column(f"{begin}{name}", quantity, edge) for begin in ("", "start_")]
        rows = content.rows("points", number, table, columns)
        sigma = np.stack([rows.number(name) for name in names], axis=1)
        sigma = np.where(np.isnan(sigma), rows.number("sigma")[:, None], sigma) * edge.metres
        sigma[:] = 0.0 if table.fixed else sigma
        if (sigma > exact * (1.0 + 1e-9)).any():
            words = "coordinates or leaves them free: observe them instead (gnss_position with a covariance)"
            problems.append(content.place("points", number).problem(f"{what} holds {words}"))
        start = np.stack([rows.number(f"start_{name}") for name in coordinates], axis=1)
        plain = np.stack([rows.number(name) for name in coordinates], axis=1)
        given = world.in_metres(np.where(np.isnan(start), plain, start))
        for name, three, held in zip(rows.text("id"), given, np.isfinite(sigma), strict=True):
            known[name] = _Entry(three, held)
    return known


class SetUps:
    """Points under the stations of directions."""

    def __init__(self, content: Content, points: Collection[str]) -> None:
        self._content, self._points = content, set(points)
        self._under = {name: point for name, (point, _) in stations(content).items()}

    def point(self, station: str) -> str:
        """The point of a station. Raises :class:`InputError` if it stands on none."""
        point = self._under.get(station, station)
        if point not in self._points:
            raise InputError([Message(f"station {station!r} has no point", self._content.document.file)])
        return point


def raised(content: Content, found: list[ObservationTable]) -> bool:
    """Return True if directions have heights of instrument or target."""
    sets = [group for group in found if group.entry.type == "directions"]
    columns = [group.rows.number(f"{end}_height") for group in sets for end in ("from", "to", "station")]
    own = [height for _, height in stations(content).values()] if sets else []
    return any(np.nan_to_num(column).any() for column in columns) or any(own)


def clusters(content: Content, group: ObservationTable, what: str) -> Iterator[tuple[list[int], FloatArray]]:
    """Rows of vectors or positions that are correlated, and their (3n, 3n) covariances: m², rad of latitude, longitude.

    A table with a matrix is one cluster, every row of others one of its own. Raises :class:`InputError` for rows with
    some components only, which ``what`` has not.
    """
    assert group.covariance is not None
    geodetic = group.entry.type == "geodetic_position"
    metres = content.edge.metres
    lengths = np.array([1.0, 1.0, metres] if geodetic else [metres] * 3)
    own = group.factors if group.entry.covariance is not None else np.ones(3)
    scale = np.tile(own * lengths, len(group.covariance) // 3)
    Q = np.asarray(group.covariance * np.outer(scale, scale))
    rows = np.flatnonzero(np.isfinite(group.values).all(axis=1)).tolist()
    if 3 * len(rows) != len(Q):
        words = f"{what} has vectors and positions with all three components"
        raise InputError([Message(words, content.document.file)])
    if group.entry.covariance is not None:
        yield rows, Q
        return
    for k, row in enumerate(rows):
        yield [row], Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
