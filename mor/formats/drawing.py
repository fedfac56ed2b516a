"""Drawings of results: DXF, GeoJSON, LandXML, PLY."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted
from mor.formats.content import Content, content_of, images, points
from mor.formats.draft import Written
from mor.input_files import note_input
from mor.project.axes import Edge
from mor.project.document import Document
from mor.project.network import build_network
from mor.project.schema import Axes, Units
from mor.project.tables import raw_table
from mor.types import FloatArray, IntArray

# ---- Draw a project: points with their σ if results exist, images, lines of sight.

_LINES = (
    *("distance", "horizontal_distance", "height_difference", "vector", "bearing", "azimuth", "astronomic_azimuth"),
    *("gnss_vector", "ellipsoid_arc", "ellipsoid_chord", "mean_sea_level_distance", "zenith_angle"),
    "vertical_direction",
)
"""Observations between two points, which a drawing shows as lines."""


class Drawing(NamedTuple):
    """Everything in metres, in the axes of the project or in its reference system; σ NaN if there is none."""

    title: str
    ids: list[str]
    xyz: FloatArray
    """(n, 3)."""
    sigma: FloatArray
    """(n, 3)."""
    ellipses: FloatArray
    """(n, 3) semi-axes a, b and the bearing (rad, counterclockwise from +x) of a; NaN if there is none."""
    images: list[str]
    centres: FloatArray
    """(m, 3)."""
    lines: list[tuple[str, str]]
    axes: str
    """Compass directions of x and y."""
    crs: str = ""
    """Name (URN) of the reference system on the earth that they are in, where it has one."""
    degrees: bool = False
    """True if x and y are longitude and latitude in degrees."""
    notes: tuple[Message, ...] = ()
    """What was left out, and how much."""


def drawing(document: Document, folder: Path) -> Drawing:
    """The drawing of a project; of an adjusted one (``adjusted.yaml``) with the σ of the results beside it.

    Raises :class:`InputError` if no point has coordinates.
    """
    content = content_of(document, folder)
    if content.project.world is not None:
        return _on_earth(content)
    found, photos = points(content), images(content)
    metres = content.edge.metres
    placed = np.flatnonzero(np.isfinite(found.values[:, :2]).all(axis=1))
    if not len(placed):
        words = "no point has coordinates; convert an adjusted project (results/adjusted.yaml)"
        raise InputError([Message(words, document.file)])
    ids = [found.ids[k] for k in placed.tolist()]
    xyz = np.nan_to_num(found.values[placed]) * metres
    sigma, ellipses = _precision(folder / "points.csv", ids, metres)
    oriented = np.flatnonzero(np.isfinite(photos.values[:, :3]).all(axis=1))
    return Drawing(
        content.project.title,
        ids,
        xyz,
        sigma,
        ellipses,
        [photos.ids[k] for k in oriented.tolist()],
        photos.values[oriented, :3] * metres,
        _lines(content, set(ids)),
        content.project.axes.xy,
        notes=_left_out(content, found.values, placed),
    )


def _left_out(content: Content, values: FloatArray, placed: IntArray) -> tuple[Message, ...]:
    file, notes = content.document.file, []
    missing = len(values) - len(placed)
    flat = int(np.count_nonzero(~np.isfinite(values[placed, 2]))) if len(placed) else 0
    if missing:
        notes.append(Message(f"{counted(missing, 'point')} without coordinates: left out", file))
    if flat and "z" in content.project.settings.dimensions:
        notes.append(Message(f"{counted(flat, 'point')} without a height: drawn at height 0", file))
    return tuple(notes)


def drawing_in_metres(document: Document, folder: Path) -> Drawing:
    """The drawing of a project that is not in latitude and longitude. Raises :class:`InputError`."""
    shown = drawing(document, folder)
    if shown.degrees:
        raise InputError([Message("latitude and longitude cannot be drawn in metres; geojson has them", document.file)])
    return shown


def _on_earth(content: Content) -> Drawing:
    """Points in their reference system; places of images are not known before an adjustment."""
    network = build_network(content.project, content.document, content.folder)
    world, numbers = network.world, network.things["point"].parts["position"]
    assert world is not None
    positions = network.start["point"][numbers]
    placed = np.flatnonzero(np.isfinite(positions).all(axis=1))
    ids = [network.things["point"].ids[k] for k in placed.tolist()]
    N = world.geoid_at(numbers, positions)[placed]
    xyz = world.from_object(positions[placed], N)
    degrees = world.system.kind == "geographic"
    per_unit = [np.degrees(1.0), np.degrees(1.0), world.metres] if degrees else [world.metres] * 3
    xyz = xyz[:, [1, 0, 2] if degrees else [0, 1, 2]] * per_unit
    # σ (n, 3) east, north, up by the table of results, NaN if there is none.
    path = content.folder / "places.csv"
    rows: dict[str, dict[str, str | None]] = {}
    if path.is_file():
        note_input(path)
        rows = {row["id"]: row for row in pl.read_csv(path, infer_schema=False).iter_rows(named=True)}
    columns = ("seast", "snorth", "sup")
    sigma = np.array([[_number(rows.get(name, {}).get(key)) for key in columns] for name in ids]) * world.metres
    nothing = np.full((len(ids), 3), np.nan)
    lines = _lines(content, set(ids))
    centres = np.zeros((0, 3))
    title, urn = content.project.title, world.system.urn
    notes = _left_out(content, positions, placed)
    return Drawing(title, ids, xyz, sigma, nothing, [], centres, lines, "en", urn, degrees, notes)


def _precision(path: Path, ids: list[str], metres: float) -> tuple[FloatArray, FloatArray]:
    """σ and error ellipses in plan by the table of results, NaN if there is none."""
    sigma, ellipses = np.full((len(ids), 3), np.nan), np.full((len(ids), 3), np.nan)
    if not path.is_file():
        return sigma, ellipses
    note_input(path)
    table = pl.read_csv(path, infer_schema=False)
    if not {"id", "sx", "sy", "sz", "rxy"} <= set(table.columns):
        return sigma, ellipses
    rows = {row["id"]: row for row in table.iter_rows(named=True)}
    for k, name in enumerate(ids):
        row = rows.get(name)
        if row is None:
            continue
        values = [_number(row[key]) for key in ("sx", "sy", "sz", "rxy")]
        sigma[k] = np.array(values[:3]) * metres
        ellipses[k] = _ellipse(float(sigma[k, 0]), float(sigma[k, 1]), values[3])
    return sigma, ellipses


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _ellipse(sx: float, sy: float, r: float) -> tuple[float, float, float]:
    if not np.isfinite([sx, sy, r]).all():
        return float("nan"), float("nan"), float("nan")
    values, vectors = np.linalg.eigh([[sx * sx, r * sx * sy], [r * sx * sy, sy * sy]])
    a, b = np.sqrt(np.maximum(values[::-1], 0.0))
    return float(a), float(b), float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def _lines(content: Content, known: set[str]) -> list[tuple[str, str]]:
    """Pairs of points that observations connect, each once."""
    found: dict[tuple[str, str], None] = {}
    for number, entry in enumerate(content.project.observations):
        if entry.type not in _LINES:
            continue
        place = content.place("observations", number)
        source = raw_table(entry, place)
        if source is None or place.problems:
            raise InputError(place.problems)
        if not {"from", "to"} <= set(source.columns):
            continue
        first, second = (source.columns[end].cast(pl.String).to_list() for end in ("from", "to"))
        for pair in zip(first, second, strict=True):
            if set(pair) <= known and pair[::-1] not in found:
                found[pair] = None
    return list(found)


# ---- DXF: points, names, projection centres, observed lines and error ellipses, each on a layer of its own.


def write_dxf(document: Document, folder: Path, target: Path) -> Written:
    """A drawing in metres. Raises :class:`InputError`, also where ezdxf, of the extra ``formats``, is missing."""
    try:
        from ezdxf.filemanagement import new
    except ImportError:
        words = "DXF needs the extra formats: pip install 'mor-adjustment[formats]'"
        raise InputError([Message(words, str(target))]) from None
    shown = drawing_in_metres(document, folder)
    sheet = new("R2010", setup=False)
    sheet.header["$INSUNITS"] = 6
    # Layers and their colours (AutoCAD colour index).
    for name, colour in {"points": 7, "names": 7, "images": 5, "observations": 8, "ellipses": 1}.items():
        sheet.layers.add(name, color=colour)
    space = sheet.modelspace()
    extent = float(np.ptp(shown.xyz[:, :2], axis=0).max()) or 1.0
    at = dict(zip(shown.ids, shown.xyz.tolist(), strict=True))
    for name, place in at.items():
        space.add_point(place, dxfattribs={"layer": "points"})
        _text(space, name, place, extent)
    for name, place in zip(shown.images, shown.centres.tolist(), strict=True):
        space.add_point(place, dxfattribs={"layer": "images"})
        _text(space, name, place, extent)
    for a, b in shown.lines:
        space.add_line(at[a], at[b], dxfattribs={"layer": "observations"})
    scale = _ellipses(space, shown, extent)
    text = io.StringIO()
    sheet.write(text)
    said = (
        f"error ellipses are enlarged {scale:.3g} times"
        if scale
        else "there are no results, and therefore no error ellipses"
    )
    words = f"DXF has no observed values; {said}"
    return Written({target: text.getvalue().encode()}, [*shown.notes, Message(words, str(target))])


def _text(space: object, name: str, place: list[float], extent: float) -> None:
    attributes = {"layer": "names", "height": extent / 100.0, "insert": place}
    space.add_text(name, dxfattribs=attributes)  # type: ignore[attr-defined]


def _ellipses(space: object, shown: Drawing, extent: float) -> float:
    """Draw them, enlarged so that the largest is seen; the factor, 0 without any."""
    known = np.isfinite(shown.ellipses).all(axis=1) & (shown.ellipses[:, 0] > 0.0)
    if not known.any():
        return 0.0
    # Longest semi-axis of the error ellipses as they are drawn, of the extent of the network.
    scale = 0.05 * extent / float(shown.ellipses[known, 0].max())
    for (a, b, bearing), place in zip(shown.ellipses[known].tolist(), shown.xyz[known].tolist(), strict=True):
        major = (a * scale * np.cos(bearing), a * scale * np.sin(bearing), 0.0)
        attributes = {"layer": "ellipses"}
        space.add_ellipse(place, major, max(b / a, 1e-6), dxfattribs=attributes)  # type: ignore[attr-defined]
    return scale


# ---- GeoJSON: points and projection centres as points, observed lines as lines, in the coordinates of the project.
#
# On the earth these are those of its reference system, which the member ``crs`` names, as GDAL and QGIS read it: a
# change of datum to the WGS 84 of RFC 7946 would be a guess of decimetres.


def write_geojson(document: Document, folder: Path, target: Path) -> Written:
    """A feature collection in metres. Raises :class:`InputError`."""
    shown = drawing(document, folder)
    at = dict(zip(shown.ids, shown.xyz.tolist(), strict=True))
    features = [_point(shown, k) for k in range(len(shown.ids))]
    features += [
        _feature("Point", centre, {"id": name, "kind": "image"})
        for name, centre in zip(shown.images, shown.centres.tolist(), strict=True)
    ]
    features += [
        _feature("LineString", [at[a], at[b]], {"from": a, "to": b, "kind": "observed"}) for a, b in shown.lines
    ]
    collection: dict[str, Any] = {"type": "FeatureCollection"}
    if shown.crs:
        collection["crs"] = {"type": "name", "properties": {"name": shown.crs}}
    text = json.dumps({**collection, "features": features}, ensure_ascii=False, indent=1)
    words = "coordinates are those of the project, in metres: GeoJSON's own, longitude and latitude, are not known"
    if shown.crs or shown.degrees:
        words = "coordinates are those of the reference system of the project, which the file names (crs)"
    return Written({target: (text + "\n").encode()}, [*shown.notes, Message(words, str(target))])


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _point(shown: Drawing, k: int) -> dict[str, Any]:
    properties: dict[str, Any] = {"id": shown.ids[k], "kind": "point"}
    if np.isfinite(shown.sigma[k]).all():
        properties.update(zip(("sx", "sy", "sz"), shown.sigma[k].tolist(), strict=True))
    return _feature("Point", shown.xyz[k].tolist(), properties)


# ---- LandXML 1.2: points as CgPoints, north, east and elevation.


def write_landxml(document: Document, folder: Path, target: Path) -> Written:
    """Points in metres. Raises :class:`InputError`."""
    shown = drawing_in_metres(document, folder)
    east_north = shown.xyz @ Edge(Units(), Axes(xy=shown.axes)).matrix.T
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">',
        '<Units><Metric areaUnit="squareMeter" linearUnit="meter" volumeUnit="cubicMeter" '
        'temperatureUnit="celsius" pressureUnit="HPA"/></Units>',
        f"<Project name={quoteattr(shown.title)}/>",
        "<CgPoints>",
    ]
    for name, (east, north, up) in zip(shown.ids, np.asarray(east_north).tolist(), strict=True):
        lines.append(f"<CgPoint name={quoteattr(name)}>{escape(f'{north!r} {east!r} {up!r}')}</CgPoint>")
    text = "\n".join([*lines, "</CgPoints>", "</LandXML>"]) + "\n"
    notes = [*shown.notes, Message("LandXML has points only here: no σ, no images, no observations", str(target))]
    return Written({target: text.encode()}, notes)


# ---- PLY: points of a project as vertices, with their σ where there are results.


def write_ply(document: Document, folder: Path, target: Path) -> Written:
    """ASCII PLY in metres: x y z, and sx sy sz where there are results. Raises :class:`InputError`."""
    shown = drawing_in_metres(document, folder)
    known = np.isfinite(shown.sigma).all(axis=1).any()
    names = ("x", "y", "z", *(("sx", "sy", "sz") if known else ()))
    head = ["ply", "format ascii 1.0", f"comment {_one_line(shown.title)}", f"element vertex {len(shown.ids)}"]
    head += [f"property double {name}" for name in names]
    values = np.concatenate([shown.xyz, np.nan_to_num(shown.sigma)], axis=1)[:, : len(names)]
    rows = [" ".join(map(repr, row)) for row in values.tolist()]
    text = "\n".join([*head, "end_header", *rows]) + "\n"
    notes = [*shown.notes, Message("PLY has no names of points, no images and no observations", str(target))]
    return Written({target: text.encode()}, notes)


def _one_line(text: str) -> str:
    return " ".join(text.split())
