"""The tables of a project as arrays in its length unit, radians and pixels, for writers of foreign formats."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted
from mor.model.cameras import CAMERA_MODELS
from mor.model.images import IMAGE_TYPES
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import POINT, ROTATION
from mor.project.axes import Edge, ImageScale, image_scale
from mor.project.document import Document
from mor.project.entities import Reading, ignore_table, workshop
from mor.project.images import image_columns
from mor.project.observations import observation_columns
from mor.project.points import point_columns
from mor.project.schema import Camera, Observations, ProjectFile, TableEntry, Value, validate
from mor.project.stations import station_columns
from mor.project.tables import (
    Column,
    Rows,
    Statuses,
    TableLocation,
    component_columns,
    component_rows,
    number_column,
    read_table,
)
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import LENGTH, Component


class ContentTable(NamedTuple):
    """Points or images: names, other texts by column, and their components."""

    ids: list[str]
    texts: dict[str, list[str]]
    statuses: Statuses

    @property
    def values(self) -> FloatArray:
        """(n, size) start values where there are any, values otherwise."""
        return np.asarray(np.where(np.isnan(self.statuses.start), self.statuses.values, self.statuses.start))

    @property
    def fixed(self) -> BoolArray:
        """(n, size) true where a component is held."""
        return ~self.statuses.free

    def __len__(self) -> int:
        return len(self.ids)


class ImagePoints(NamedTuple):
    """Image points: names, px from the upper left corner of the upper left pixel (y down), σ in px; (n,), (n, 2)."""

    images: list[str]
    points: list[str]
    xy: FloatArray
    sigma: FloatArray


class Content(NamedTuple):
    """A project that is to be written in another format."""

    document: Document
    project: ProjectFile
    edge: Edge
    folder: Path
    unread: dict[str, int]
    """What the adjustment reads and no writer has asked for, and how many values there are of it."""

    def place(self, *path: str | int) -> TableLocation:
        """A place in the document."""
        return TableLocation(self.document, path, self.folder)

    def rows(self, section: str, number: int, table: TableEntry, columns: list[Column]) -> Rows:
        """Rows of a table with these columns, and all others that the adjustment reads: those are counted.

        Raises :class:`InputError`, also for names that no text file can hold.
        """
        place = self.place(section, number)
        own = {column.name for column in columns}
        others = [column for column in self._known_columns(section, table) if column.name not in own]
        optional = [column._replace(required=False) for column in others]
        found = read_table(table, [*columns, *optional], place)
        if found is not None:
            for name, cells in found.texts.items():
                refuse_control_characters(name, cells.texts(), found)
        if place.problems or found is None:
            raise InputError(place.problems)
        for column in optional:
            count = _given(found, column.name)
            if count:
                key = f"column {column.name} of {section}"
                self.unread[key] = self.unread.get(key, 0) + count
        return found

    def _known_columns(self, section: str, table: TableEntry) -> list[Column]:
        """Columns that the adjustment reads of a table; none on the earth, where the reference system says them."""
        if self.project.world is not None:
            return []
        reading = Reading(self.project, self.place(), self.edge, workshop(), ignore_table)
        if section == "points":
            return point_columns(reading)
        if section == "images":
            return image_columns(reading)
        if section == "stations":
            return station_columns(reading)
        if isinstance(table, Observations) and table.type in ("image", *PLAIN_TYPES):
            type_ = IMAGE_TYPES["mor"] if table.type == "image" else PLAIN_TYPES[table.type]
            return observation_columns(type_, reading)
        return []


def refuse_control_characters(name: str, cells: pl.Series, rows: Rows) -> None:
    """Tell names with characters that XML forbids and text files break lines at."""
    # Characters that end a line, or that XML 1.0 has no place for.
    control = "[\\x00-\\x1f\\x7f-\\x9f\\x{2028}\\x{2029}\\x{fffe}\\x{ffff}]"
    odd = cells.str.contains(control).fill_null(False).to_numpy()

    def words(row: int) -> str:
        return f"{name}: found {cells[row]!r}, expected a name without control characters; rename it"

    rows.tell_where(odd, words)


def _given(rows: Rows, name: str) -> int:
    if name in rows.numbers:
        return int(np.count_nonzero(np.nan_to_num(rows.numbers[name])))
    return int((rows.series(name) != "").sum())


def content_of(document: Document, folder: Path) -> Content:
    """The content of a document whose tables are found from ``folder``. Raises :class:`InputError`."""
    project = validate(document)
    control_in_title = "[\x00-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]"
    title = " ".join(re.sub(control_in_title, " ", project.title).split())
    names = [*project.cameras, *project.instruments, *(table.group or "" for table in project.points)]
    odd = next((name for name in names if re.search(control_in_title, name)), None)
    if odd is not None:
        words = f"found the name {odd!r}, expected one without control characters; rename it"
        raise InputError([Message(words, document.file)])
    project = project.model_copy(update={"title": title})
    return Content(document, project, Edge(project.units, project.axes), folder, {})


def points(content: Content) -> ContentTable:
    """All points with x, y, z in the axes and the unit of the project. Raises :class:`InputError`."""
    if content.project.world is not None:
        words = "networks on the earth are written as dynadjust, dynaml, snap, sinex, geojson, dxf and landxml only"
        raise InputError([content.place("world").problem(words)])
    parts = []
    columns = [Column("id", required=True), *component_columns(POINT.components, content.edge)]
    columns.append(number_column("sigma", LENGTH, content.edge))
    for k, table in enumerate(content.project.points):
        rows = content.rows("points", k, table, columns)
        statuses = component_rows(rows, POINT.components, table.fixed, rows.number("sigma"))
        parts.append(ContentTable(rows.text("id"), {}, statuses))
    return _joined(parts, len(POINT.components), ())


def images(content: Content) -> ContentTable:
    """All images with x, y, z, ω, φ, κ. Raises :class:`InputError`."""
    components: tuple[Component, ...] = (*POINT.components, *ROTATION.components)
    parts = []
    image_texts = ("camera", "position", "leader", "pair", "shared_height", "shared_eccentricity")
    for k, table in enumerate(content.project.images):
        columns = [Column("id", required=True), *(Column(name) for name in image_texts)]
        columns += component_columns(components, content.edge)
        rows = content.rows("images", k, table, columns)
        statuses = component_rows(rows, components, table.fixed)
        parts.append(ContentTable(rows.text("id"), {name: rows.text(name) for name in image_texts}, statuses))
    return _joined(parts, len(components), image_texts)


def _joined(parts: list[ContentTable], size: int, texts: tuple[str, ...]) -> ContentTable:
    statuses = Statuses(
        *(np.concatenate([np.zeros((0, size)), *(part.statuses[k] for part in parts)]) for k in range(4))
    )
    ids = [name for part in parts for name in part.ids]
    joined = {name: [text for part in parts for text in part.texts[name]] for name in texts}
    return ContentTable(ids, joined, statuses._replace(free=statuses.free.astype(bool)))


def image_points(content: Content, cameras: dict[str, str], corner: bool = True) -> ImagePoints:
    """All image points; ``cameras`` has the camera of each image. Raises :class:`InputError` for those without size.

    ``corner``: coordinates from the upper left corner, y down; else from the image centre, y up.
    """
    scales = {name: image_scale(camera) for name, camera in content.project.cameras.items()}
    parts = [_image_points(entry, rows, cameras, scales, place, corner) for entry, rows, place in image_tables(content)]
    return ImagePoints(
        [name for part in parts for name in part.images],
        [name for part in parts for name in part.points],
        np.concatenate([np.zeros((0, 2)), *(part.xy for part in parts)]),
        np.concatenate([np.zeros((0, 2)), *(part.sigma for part in parts)]),
    )


def image_tables(content: Content) -> Iterator[tuple[Observations, Rows, TableLocation]]:
    """Tables of image points with their rows: image, point, x, y, and σ. Raises :class:`InputError`."""
    names = ("x", "y", "sigma", "sigma_x", "sigma_y")
    columns = [Column("image", required=True), Column("point", required=True)]
    columns += [Column(name, parse=lambda text, _: float(text), factor=lambda _: 1.0) for name in names]
    for k, entry in enumerate(content.project.observations):
        if entry.type == "image":
            from mor.project.observations import units_of_values

            plain = units_of_values(entry)
            rows = content.rows("observations", k, plain, columns)
            whole = np.isfinite(rows.number("x")) & np.isfinite(rows.number("y"))
            if not whole.all():
                key = "image points with one coordinate only"
                content.unread[key] = content.unread.get(key, 0) + int(np.count_nonzero(~whole))
                rows = rows.take(np.flatnonzero(whole))
            yield plain, rows, content.place("observations", k)


def given_points(entry: Observations, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Coordinates of a table of image points as they stand there, and their σ; (n, 2) both."""
    given = np.stack([rows.number("x"), rows.number("y")], axis=1)
    own = np.stack([rows.number("sigma_x"), rows.number("sigma_y")], axis=1)
    return given, np.where(np.isnan(own), rows.number("sigma")[:, None], own) * entry.factor


def _image_points(
    entry: Observations,
    rows: Rows,
    cameras: dict[str, str],
    scales: dict[str, ImageScale],
    place: TableLocation,
    corner: bool,
) -> ImagePoints:
    image, point = rows.text("image"), rows.text("point")
    unknown = [name for name in dict.fromkeys(image) if name not in cameras]
    if unknown:
        raise InputError([place.problem(f"image {unknown[0]!r} is not among the images")])
    given, sigma = given_points(entry, rows)
    used = np.array([cameras[name] for name in image])
    for name in set(used.tolist()):
        scale, mine = scales[name], used == name
        pixel = 1.0 if scale.unit == "px" else scale.pixel
        if np.isnan(pixel) or (corner and np.isnan(scale.centre[0])):
            raise InputError([place.problem(f"camera {name!r} has no image: {{width, height}}, which this needs")])
        units = [unit_of(entry, column, scale) for column in ("x", "sigma")]
        given[mine] = _pixels(given[mine] * scale.factor(units[0]) / pixel, scale, corner)
        sigma[mine] *= scale.factor(units[1]) / pixel
    return ImagePoints(image, point, given, sigma)


def unit_of(entry: Observations, name: str, scale: ImageScale) -> str:
    """Unit of a column of a table of image points."""
    given = entry.units if isinstance(entry.units, str) else entry.units.get(name, "")
    return given or scale.coordinate_unit


def _pixels(xy: FloatArray, scale: ImageScale, corner: bool) -> FloatArray:
    if scale.corner == corner:
        return xy
    flip, centre = np.array([1.0, -1.0]), np.array(scale.centre)
    return np.asarray(xy * flip + centre if corner else (xy - centre) * flip)


class ImageBlock(NamedTuple):
    """An image block that is to be written: images with their projection centres, points, image points."""

    images: ContentTable
    points: ContentTable
    rays: ImagePoints


def block(content: Content, what: str, found: ContentTable, corner: bool = True) -> ImageBlock:
    """Return the image block of a project with the images ``found`` (:func:`frames`).

    Points that only image points name are among the points. Raises :class:`InputError` if there is no image point.
    """
    places = points(content)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    rays = image_points(content, used, corner)
    if not rays.images:
        raise InputError([Message(f"{what} has image blocks; this project has no image points", content.document.file)])
    return ImageBlock(found, with_undeclared(content, places, rays.points), rays)


def frames(content: Content, what: str) -> ContentTable:
    """Return the images of a project for a format of frame images. Raises :class:`InputError` for others."""
    found = images(content)
    problems = [
        content.place("cameras", name).problem(f"camera {name!r} {words}, which {what} cannot hold")
        for name, camera in content.project.cameras.items()
        for words in _not_a_frame(camera)
    ]
    raised = [name for name in ("height", "rx", "ry", "rz") if content.unread.get(f"column {name} of images")]
    shared = any("".join(found.texts[key]) for key in ("shared_height", "shared_eccentricity"))
    if raised or shared:
        words = f"images have heights or eccentricities, which {what} cannot hold"
        problems.append(Message(words, content.document.file))
    if problems:
        raise InputError(problems)
    return found


def _not_a_frame(camera: Camera) -> list[str]:
    found = []
    if camera.line_time is not None or camera.line is not None:
        found.append("is a line scanner")
    if camera.eccentricity:
        found.append("has an eccentricity")
    return found


def with_undeclared(content: Content, places: ContentTable, named: Iterable[str]) -> ContentTable:
    """Return the points with those that only observations name.

    Raises :class:`InputError` if the project does not allow them.
    """
    known = set(places.ids)
    more = [name for name in dict.fromkeys(named) if name not in known]
    if not more:
        return places
    if content.project.settings.undeclared_points != "free":
        raise InputError([Message(f"point {more[0]!r} is not among the points", content.document.file)])
    nothing = np.full((len(more), 3), np.nan)
    theirs = Statuses(nothing, np.ones(nothing.shape, dtype=bool), nothing, nothing)
    both = Statuses(*(np.concatenate(pair) for pair in zip(places.statuses, theirs, strict=True)))
    return ContentTable([*places.ids, *more], places.texts, both._replace(free=both.free.astype(bool)))


def placed_points(content: Content, places: ContentTable, what: str) -> tuple[ContentTable, list[Message]]:
    """Return the points that have all coordinates, and a note on those that are left out."""
    placed = np.isfinite(places.values).all(axis=1)
    missing = int(np.count_nonzero(~placed))
    if not missing:
        return places, []
    chosen = np.flatnonzero(placed)
    kept = ContentTable([places.ids[k] for k in chosen.tolist()], places.texts, places.statuses.rows(chosen))
    words = (
        f"{counted(missing, 'point')} without coordinates: left out of {what}; "
        "convert an adjusted project (adjusted.yaml)"
    )
    return kept, [Message(words, content.document.file)]


def some_rays(rays: ImagePoints, chosen: IntArray) -> ImagePoints:
    """Return some of the image points."""
    rows = chosen.tolist()
    return ImagePoints(
        [rays.images[k] for k in rows], [rays.points[k] for k in rows], rays.xy[chosen], rays.sigma[chosen]
    )


def rays_of_points(
    content: Content, rays: ImagePoints, places: ContentTable, what: str
) -> tuple[ImagePoints, list[Message]]:
    """Return the image points of these points, and a note on the others."""
    known = set(places.ids)
    chosen = np.flatnonzero([name in known for name in rays.points])
    lost = len(rays.points) - len(chosen)
    if not lost:
        return rays, []
    if not len(chosen):
        words = (
            f"{what}: no image point belongs to a point with coordinates; convert an adjusted project (adjusted.yaml)"
        )
        raise InputError([Message(words, content.document.file)])
    words = f"{counted(lost, 'image point')} of points without coordinates: left out of {what}"
    return some_rays(rays, chosen), [Message(words, content.document.file)]


def not_carried(content: Content, types: tuple[str, ...], sections: tuple[str, ...], what: str) -> list[Message]:
    """Return counted notes on observations, sections and columns that a format cannot hold."""
    project, file = content.project, content.document.file
    notes = []
    for entry in project.observations:
        if entry.type not in types:
            notes.append(f"observations {entry.name or entry.type} ({entry.type})")
    of_others = ("stations", "systems", "features", "instruments", "pairs", "checks", "trajectories", "line_times")
    for section in of_others:
        found = getattr(project, section)
        if found and section not in sections:
            notes.append(counted(len(found), f"entry of {section}", f"entries of {section}"))
    if "image" in types:
        for key, name in (("readout", "rolling shutter"), ("image_variant", "image-variant interior orientation")):
            count = sum(bool(getattr(camera, key)) for camera in project.cameras.values())
            notes += [f"{name} of {counted(count, 'camera')}"] if count else []
    if project.curvature:
        notes.append("curvature (coordinates are plan coordinates and heights above a sphere)")
    notes += [f"{key} ({counted(count, 'value')})" for key, count in content.unread.items()]
    return [Message(f"{what} cannot store: {', '.join(notes)}", file)] if notes else []


def interior_values(camera: Camera, edge: Edge, scale: ImageScale) -> dict[str, float]:
    """Components of the interior orientation that are given, in the unit of the camera, as they start.

    Raises ``ValueError`` where the first component (c or fx) is missing.
    """
    known = {component.name: component for component in CAMERA_MODELS[camera.model].components}
    values = {}
    for name, setting in camera.interior.items():
        text = setting
        if isinstance(setting, Value):
            text = setting.start or setting.free or setting.fixed or setting.observed or "0"
        values[name] = edge.number(str(text), known[name].quantity, "", scale)
    first = CAMERA_MODELS[camera.model].components[0].name
    if first not in values:
        raise ValueError(f"it has no {first}")
    return values
