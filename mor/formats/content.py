"""What is in a project, for writers: its tables as arrays in the project's length unit, radians and pixels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.geometry.cameras import CAMERA_MODELS
from mor.parameters.kinds import POINT, ROTATION
from mor.project.edge import Edge, ImageScale, image_scale
from mor.project.file.model import Camera, Observations, Project
from mor.project.file.model_instruments import Value
from mor.project.file.nodes import Document
from mor.project.file.table import Table
from mor.project.file.validation import validate
from mor.project.tables.statuses import Statuses, component_columns, component_rows, number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.units import LENGTH, Component, Quantity

PIXELS = Quantity()
"""Image coordinates are read as plain numbers; their unit is that of the camera or the table."""


class Things(NamedTuple):
    """Points or images: names, other texts by column, and their components."""

    ids: list[str]
    texts: dict[str, list[str]]
    statuses: Statuses

    @property
    def values(self) -> FloatArray:
        """(n, size) start values where there are any, values otherwise."""
        start: FloatArray = np.where(np.isnan(self.statuses.start), self.statuses.values, self.statuses.start)
        return start

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
    project: Project
    edge: Edge
    folder: Path

    def place(self, *path: str | int) -> Place:
        """A place in the document."""
        return Place(self.document, path, self.folder)

    def rows(self, section: str, number: int, table: Table, columns: list[Column]) -> Rows:
        """Rows of a table. Raises :class:`InputError`."""
        problems: list[Problem] = []
        found = read_table(table, columns, self.place(section, number), problems)
        if problems or found is None:
            raise InputError(problems)
        return found


def content_of(document: Document, folder: Path) -> Content:
    """The content of a document whose tables are found from ``folder``. Raises :class:`InputError`."""
    project = validate(document)
    return Content(document, project, Edge(project.units, project.axes), folder)


def points(content: Content) -> Things:
    """All points with x, y, z in the axes and the unit of the project. Raises :class:`InputError`."""
    if content.project.world is not None:
        words = "networks on the earth are written as dynadjust, dynaml, snap, sinex, geojson, dxf and landxml only"
        raise InputError([content.place("world").problem(words)])
    parts = []
    columns = [Column("id", required=True), *component_columns(POINT.components, content.edge)]
    columns.append(number_column("sigma", LENGTH, content.edge))
    for k, table in enumerate(content.project.points):
        rows = content.rows("points", k, table, columns)
        found: list[Problem] = []
        statuses = component_rows(rows, POINT.components, table.fixed, found, rows.number("sigma"))
        parts.append(Things(rows.text("id"), {}, statuses))
    return _joined(parts, len(POINT.components), ())


_IMAGE_TEXTS = ("camera", "position", "leader", "pair", "shared_height", "shared_eccentricity")
_SET_UP = ("height", "rx", "ry", "rz")


def images(content: Content) -> Things:
    """All images with x, y, z, ω, φ, κ; heights and eccentricities are mistakes here: few formats know them."""
    components: tuple[Component, ...] = (*POINT.components, *ROTATION.components)
    parts = []
    for k, table in enumerate(content.project.images):
        columns = [Column("id", required=True), *(Column(name) for name in _IMAGE_TEXTS)]
        columns += component_columns(components, content.edge)
        for name in _SET_UP:
            columns += [number_column(f"{p}{name}", LENGTH, content.edge) for p in ("", "sigma_", "start_")]
        rows = content.rows("images", k, table, columns)
        found: list[Problem] = []
        statuses = component_rows(rows, components, table.fixed, found)
        parts.append(Things(rows.text("id"), {name: rows.text(name) for name in _IMAGE_TEXTS}, statuses))
    return _joined(parts, len(components), _IMAGE_TEXTS)


def _joined(parts: list[Things], size: int, texts: tuple[str, ...]) -> Things:
    statuses = Statuses(
        *(np.concatenate([np.zeros((0, size)), *(part.statuses[k] for part in parts)]) for k in range(4))
    )
    ids = [name for part in parts for name in part.ids]
    joined = {name: [text for part in parts for text in part.texts[name]] for name in texts}
    return Things(ids, joined, statuses._replace(free=statuses.free.astype(bool)))


def image_points(content: Content, cameras: dict[str, str], corner: bool = True) -> ImagePoints:
    """All image points; ``cameras`` has the camera of each image. Raises :class:`InputError` for those without size.

    ``corner``: coordinates from the upper left corner, y down; else from the image centre, y up.
    """
    scales = {
        name: image_scale(camera, content.project.units) for name, camera in content.project.cameras.items()
    }
    parts = [
        _image_points(entry, rows, cameras, scales, place, corner)
        for entry, rows, place in image_tables(content)
    ]
    return ImagePoints(
        [name for part in parts for name in part.images],
        [name for part in parts for name in part.points],
        np.concatenate([np.zeros((0, 2)), *(part.xy for part in parts)]),
        np.concatenate([np.zeros((0, 2)), *(part.sigma for part in parts)]),
    )


def image_tables(content: Content) -> Iterator[tuple[Observations, Rows, Place]]:
    """Tables of image points with their rows: image, point, x, y, and σ. Raises :class:`InputError`."""
    names = ("x", "y", "sigma", "sigma_x", "sigma_y")
    columns = [Column("image", required=True), Column("point", required=True)]
    columns += [Column(name, parse=lambda text, _: float(text), factor=lambda _: 1.0) for name in names]
    for k, entry in enumerate(content.project.observations):
        if entry.type == "image":
            plain = _plain_values(entry)
            yield plain, content.rows("observations", k, plain, columns), content.place("observations", k)


def given_points(entry: Observations, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Coordinates of a table of image points as they stand there, and their σ; (n, 2) both."""
    given = np.stack([rows.number("x"), rows.number("y")], axis=1)
    own = np.stack([rows.number("sigma_x"), rows.number("sigma_y")], axis=1)
    return given, np.where(np.isnan(own), rows.number("sigma")[:, None], own) * entry.factor


def _plain_values(entry: Observations) -> Observations:
    from mor.project.observations.image_groups import units_of_values

    return units_of_values(entry)


def _image_points(
    entry: Observations,
    rows: Rows,
    cameras: dict[str, str],
    scales: dict[str, ImageScale],
    place: Place,
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
            words = f"camera {name!r} has no image: {{width, height}}, which this needs"
            raise InputError([place.problem(words)])
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
    turned: FloatArray = xy * flip + centre if corner else (xy - centre) * flip
    return turned


def not_carried(
    content: Content, types: tuple[str, ...], sections: tuple[str, ...], what: str
) -> list[Problem]:
    """What of a project a format has no place for: observations of other types, whole sections."""
    project, file = content.project, content.document.file
    notes = []
    for entry in project.observations:
        if entry.type not in types:
            notes.append(f"observations {entry.name or entry.type} ({entry.type})")
    for section in ("stations", "systems", "features", "instruments", "pairs", "checks"):
        found = getattr(project, section)
        if found and section not in sections:
            notes.append(counted(len(found), f"entry of {section}", f"entries of {section}"))
    return [Problem(f"{what} has no place for: {', '.join(notes)}", file)] if notes else []


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
