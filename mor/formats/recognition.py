"""Recognise the format of a file by its structure."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import shlex
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted
from mor.formats.catalogue import FORMATS
from mor.formats.draft import (
    Draft,
    Element,
    JsonFile,
    Row,
    Wrong,
    east_north_up,
    json_number,
    mapping,
    parse_number,
    parse_xml,
    read_lines,
    usable,
)
from mor.input_files import PROJECT, TABLE, check_size, decoded, is_folder, read_bytes, read_text, standard_input
from mor.project.document import Document
from mor.project.recognition import has_two_names
from mor.types import FloatArray, IntArray

# ---- The flat files of one AICON project: found by a folder, a stem or one of them; lines of words without comments.

REQUIRED = (".ior", ".eor", ".obc", ".phc")


class FileLine(NamedTuple):
    """Words of a line, its number and its file."""

    words: list[str]
    line: int
    file: str


def stem_of(path: Path) -> Path:
    """Return the common beginning of all file names. Raises :class:`InputError` if a folder holds none or several."""
    if path.is_dir():
        stems = sorted({_bare(file) for file in path.iterdir() if _bare(file).suffix == ".ior"})
        if not stems:
            projects = sorted(file.name for file in path.glob("*.yaml"))
            hint = f"; did you mean {path.name}/{projects[0]}?" if projects else ""
            words = f"this is a folder, expected a project file, or one .ior file in it{hint}"
            raise InputError([Message(words, str(path))])
        if len(stems) > 1:
            names = ", ".join(stem.name for stem in stems)
            words = f"found {len(stems)} .ior files ({names}) in this folder, expected one"
            raise InputError([Message(words, str(path))])
        return stems[0].with_suffix("")
    bare = _bare(path)
    suffixes = (*REQUIRED, ".scale")
    return bare.with_suffix("") if bare.suffix in suffixes else bare


def is_stem(path: Path) -> bool:
    """True for what the names of the files begin with, itself no file."""
    names = (f"{path.name}.ior", f"{path.name}.ior.gz")
    return not path.exists() and any((path.parent / name).is_file() for name in names)


def _bare(path: Path) -> Path:
    return path.with_suffix("") if path.suffix == ".gz" else path


def read_words(stem: Path, suffix: str, draft: Draft) -> list[FileLine]:
    """Lines of one file, plain or gzipped; a missing file is a mistake where the format needs it."""
    for name in (f"{stem.name}{suffix}", f"{stem.name}{suffix}.gz"):
        path = stem.parent / name
        if not path.is_file():
            continue
        lines = enumerate(read_text(path, errors="replace").split("\n"), start=1)
        return [FileLine(_split(bare), i, str(path)) for i, line in lines if (bare := line.split("#")[0]).strip()]
    if suffix in REQUIRED:
        draft.problem("this file does not exist, plain or as .gz", file=str(stem.parent / f"{stem.name}{suffix}"))
    return []


def _split(line: str) -> list[str]:
    if '"' not in line:
        return line.split()
    try:
        return shlex.split(line)
    except ValueError:
        return line.split()


def numbers(line: FileLine, chosen: slice, draft: Draft) -> bool:
    """Return True if the chosen words are numbers; a mistake is reported otherwise."""
    try:
        for word in line.words[chosen]:
            parse_number(word)
    except ValueError as error:
        draft.problem(str(error), line.line, line.file)
        return False
    return True


def enough(line: FileLine, count: int, form: str, draft: Draft) -> bool:
    """Return True if a line has at least ``count`` words; a mistake is reported otherwise."""
    if len(line.words) >= count:
        return True
    draft.problem(f"found {len(line.words)} columns, expected {form}", line.line, line.file)
    return False


# ---- Names and columns of the files of a JAG3D network, and their observation types.
#
# JAG3D asks for the kind of a file when it is imported; here its name tells. Lengths are m, angles gon, y is east and
# x north. Source: JAG3D, *Datenimport* (wiki), and the classes that read its flat files.

OBSERVATIONS = {
    "leveling": "height_difference",
    "directions": "directions",
    "horizontal_distances": "horizontal_distance",
    "slope_distances": "distance",
    "zenith_angles": "zenith_angle",
}
"""Types by the beginning of a name."""
POINTS = ("reference", "stochastic", "datum", "new")
"""Fixed, observed, free with and without the datum."""
POINT_FILE = re.compile(rf"({'|'.join(POINTS)})_points?_([123])d.*\.txt$", re.IGNORECASE)
OBSERVATION_FILE = re.compile(rf"({'|'.join(OBSERVATIONS)}).*\.txt$", re.IGNORECASE)
AXES = {"1": ("z",), "2": ("x", "y"), "3": ("x", "y", "z")}
"""Coordinates of a project (x east) in the order of the columns, by dimension."""


# ---- Tie points of Metashape's projects: PLY files of points, and of projections, one for each camera.
#
# Source: DBAT, which reads them of ``.psz``, and programs that read and write those of ``.psx``: ``doc.xml``
# names the files in ``<points>`` and ``<projections camera_id>``; points have ``x y z id`` in the system of
# the chunk, projections ``x y id`` in pixels, further properties (colours, sizes of key points) among them.

ARCHIVE = "archive"
"""Attribute of a point cloud: the archive its files are in."""
UNREADABLE = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError, ValueError)
"""What a damaged archive raises."""
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types of properties as numpy calls them."""


class Projections(NamedTuple):
    """Projections of a camera: numbers of its points (n,), pixels (n, 2)."""

    camera: str
    points: IntArray
    xy: FloatArray


class TiePoints(NamedTuple):
    """Points: numbers (n,), chunk coordinates (n, 3); projections by camera."""

    numbers: IntArray
    xyz: FloatArray
    projections: list[Projections]


def read_tie_points(cloud: Element, path: Path) -> TiePoints:
    """The tie points that a point cloud names. Raises :class:`InputError`."""
    archive = Path(cloud.attributes.get(ARCHIVE, str(path)))
    try:
        with zipfile.ZipFile(archive) as files:
            named = [*cloud.all("points"), *cloud.all("projections")]
            check_size(sum(_size(files, one, archive) for one in named), archive, TABLE)
            points = [_vertices(files, one, archive, "xyz") for one in cloud.all("points")]
            seen = [
                (one.attributes.get("camera_id", ""), _vertices(files, one, archive, "xy"))
                for one in cloud.all("projections")
            ]
    except UNREADABLE as error:
        raise InputError([Message(f"this archive cannot be read: {error}", str(archive))]) from None
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *(_column(one, "id") for one in points)])
    xyz = np.concatenate([np.zeros((0, 3)), *(_coordinates(one, "xyz") for one in points)])
    projections = [Projections(camera, _column(one, "id"), _coordinates(one, "xy")) for camera, one in seen]
    numbers_, first = np.unique(numbers, return_index=True)
    if not usable(xyz) or not all(usable(one.xy) for one in projections):
        raise InputError([Message("a coordinate of a tie point is not a number up to 1e30", str(archive))])
    return TiePoints(numbers_, xyz[first], projections)


def _size(files: zipfile.ZipFile, named: Element, archive: Path) -> int:
    """Bytes of a file that an element names. Raises :class:`InputError` if it is not there."""
    name = named.attributes.get("path", "")
    try:
        return files.getinfo(name).file_size
    except KeyError:
        words = f"found no file {name!r} in this archive, which <{named.name}> names"
        raise InputError([Message(words, str(archive))]) from None


def _vertices(files: zipfile.ZipFile, named: Element, archive: Path, axes: str) -> np.ndarray:
    name = named.attributes.get("path", "")
    try:
        return _ply(files.read(name), (*axes, "id"))
    except ValueError as error:
        raise InputError([Message(f"{name}: {error}", str(archive))]) from None


def _ply(content: bytes, needed: tuple[str, ...]) -> np.ndarray:
    """Vertices of a binary PLY file. Raises ``ValueError``."""
    # Bytes that the head of a PLY file may have.
    longest_head = 1 << 14
    end = re.search(rb"\nend_header\r?\n", content[:longest_head])
    if not content.startswith(b"ply") or end is None:
        raise ValueError("found no head of a PLY file")
    lines = [line.split() for line in content[: end.start()].decode("ascii", "replace").splitlines()]
    said = next((words[1] for words in lines if words[:1] == ["format"] and len(words) > 1), "")
    orders = {"binary_little_endian": "<", "binary_big_endian": ">"}
    if said not in orders:
        raise ValueError(f"found the format {said!r}, expected {' or '.join(orders)}")
    elements = [words for words in lines if words[:1] == ["element"]]
    properties = [words[1:] for words in lines if words[:1] == ["property"]]
    if len(elements) != 1 or len(elements[0]) != 3 or elements[0][1] != "vertex" or not elements[0][2].isdecimal():
        raise ValueError("expected vertices and nothing else")
    if not properties or not all(len(words) == 2 and words[0] in _TYPES for words in properties):
        raise ValueError("found a property that is not a plain number")
    names = [words[1] for words in properties]
    if len(set(names)) < len(names):
        raise ValueError("found a property twice")
    form = np.dtype([(name, orders[said] + _TYPES[type_]) for type_, name in properties])
    count = int(elements[0][2])
    if count * form.itemsize != len(content) - end.end():
        raise ValueError(f"found {len(content) - end.end()} bytes of vertices, expected {count} · {form.itemsize}")
    missing = [name for name in needed if name not in names]
    if missing:
        raise ValueError(f"found no property {missing[0]}")
    return np.frombuffer(content, form, count, end.end())


def _column(vertices: np.ndarray, name: str) -> IntArray:
    """Whole numbers of a property; what is no whole number belongs to nothing (−1)."""
    values = vertices[name]
    if values.dtype.kind == "f":
        values = np.where(np.isfinite(values) & (np.abs(values) < 1e15), values, -1)
    return np.asarray(values.astype(np.int64))


def _coordinates(vertices: np.ndarray, names: str) -> FloatArray:
    """Coordinates (n, size); what is no number is told later."""
    with np.errstate(invalid="ignore"):
        return np.stack([vertices[name].astype(float) for name in names], axis=1)


def put_tie_points(
    draft: Draft, tie: TiePoints, images: dict[str, str], markers: Collection[str], xyz: FloatArray | None, sigma: str
) -> None:
    """Points that are seen in two images or more, and their projections, as tables.

    ``images``: names by camera; ``xyz``: start values in the system of the poses, where those are read.
    """
    seen = [one for one in tie.projections if one.camera in images]
    names = pl.Series([images[one.camera] for one in seen], dtype=pl.String)
    owner = np.repeat(np.arange(len(seen)), [len(one.points) for one in seen])
    points = np.concatenate([np.zeros(0, dtype=np.int64), *(one.points for one in seen)])
    xy = np.concatenate([np.zeros((0, 2)), *(one.xy for one in seen)])
    place = np.searchsorted(tie.numbers, points).clip(0, max(len(tie.numbers) - 1, 0))
    known = tie.numbers[place] == points if len(tie.numbers) else np.zeros(len(points), dtype=bool)
    pairs = np.unique(np.stack([place[known], owner[known]], axis=1), axis=0)
    enough = np.bincount(pairs[:, 0], minlength=len(tie.numbers)) >= 2
    kept = known & (enough[place] if len(enough) else known)
    if len(points) > int(kept.sum()):
        count = counted(len(points) - int(kept.sum()), "projection")
        draft.note(f"{count} of tie points without coordinates, or in one image only: not read")
    if not kept.any():
        return
    # What names of tie points begin with: the first that no marker begins with.
    beginnings = ("tie", "tie_point_", "tie_point_of_metashape_")
    begin = next(word for word in beginnings if not any(name.startswith(word) for name in markers))
    ids = pl.Series(tie.numbers).cast(pl.String)
    table = {"id": (begin + ids).filter(pl.Series(enough))}
    if xyz is not None:
        table |= {axis: pl.Series(xyz[enough, k]) for k, axis in enumerate("xyz")}
    draft.frame("points", "tie points", pl.DataFrame(table))
    rays = {"image": names.gather(owner[kept]), "point": begin + ids.gather(place[kept])}
    rays |= {"x": pl.Series(xy[kept, 0]), "y": pl.Series(xy[kept, 1])}
    draft.frame(
        "observations",
        "projections of tie points",
        pl.DataFrame(rays),
        type="image",
        units="px",
        values={"sigma": sigma},
    )
    draft.note(f"{counted(int(enough.sum()), 'tie point')}, σ = {sigma} px for their projections")


# ---- Metashape's own projects: ``.psz``, an archive, and ``.psx``, a file beside a folder of archives, as one XML
# tree.
#
# Source: projects of PhotoScan 1.1 and 1.2; for ``.psx`` programs that read them (``name.files/project.zip``,
# ``0/chunk.zip``, ``0/0/frame.zip``, ``0/0/point_cloud/point_cloud.zip``, each with a ``doc.xml``).


def is_project(path: Path) -> bool:
    """True for a name that Metashape gives its projects."""
    return path.suffix.lower() in (".psz", ".psx")


def project_tree(path: Path) -> Element:
    """Root of a project with its chunks and frames in place. Raises :class:`InputError`."""
    content = read_bytes(path, PROJECT)
    if path.suffix.lower() == ".psz":
        return parse_xml(_document(content, path), str(path))
    root = parse_xml(content, str(path))
    place = root.attributes.get("path", "").replace("{projectname}", path.stem).replace("\\", "/")
    if not place:
        words = f"found <{root.name}> without path=, expected a .psx of Metashape"
        raise InputError([Message(words, str(path), root.line)])
    return _archive(path.parent / place, ("chunk", "frame", "point_cloud"))


def _archive(path: Path, inner: tuple[str, ...]) -> Element:
    """The document of an archive, with those that its elements name by ``path`` in their place."""
    root = parse_xml(_document(read_bytes(path, PROJECT), path), str(path))
    if inner:
        _fill(root, path.parent, inner)
    return root


def _fill(element: Element, folder: Path, inner: tuple[str, ...]) -> None:
    for k, child in enumerate(element.children):
        place = child.attributes.get("path", "").replace("\\", "/")
        if child.name == inner[0] and place.endswith(".zip"):
            found = _archive(folder / place, inner[1:])
            child.attributes.update(found.attributes, **{ARCHIVE: str(folder / place)})
            element.children[k] = Element(child.name, child.attributes, child.line, found.children, found.text)
        else:
            _fill(child, folder, inner)


def _document(content: bytes, path: Path) -> bytes:
    """``doc.xml`` of an archive, up to the limit of what is read."""
    document = "doc.xml"
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            check_size(archive.getinfo(document).file_size, path, PROJECT)
            return archive.read(document)
    except KeyError:
        words = f"found no {document} in this archive, expected a project of Metashape"
    except UNREADABLE as error:
        words = f"this archive cannot be read: {error}"
    raise InputError([Message(words, str(path))])


# ---- Ground control of OpenSfM and OpenDroneMap: ``gcp_list.txt`` and ``ground_control_points.json``.

SIGMA = "0.02"
"""σ of control, m: the files say none."""

SYSTEM = re.compile(r"EPSG:\s*\d+|WGS\s*84\b|\+proj=|\+init=|PROJCS|GEOGCS|PROJCRS|GEOGCRS", re.IGNORECASE)
"""The coordinate system in the first line of a gcp_list.txt."""


@dataclass
class ControlMeasurements:
    """Control points, their image points, and whether they are in a system that is not the block's."""

    ids: dict[str, tuple[float | None, float | None, float | None]] = field(default_factory=dict)
    """Coordinates by name; a point that is only measured in images has none."""
    rays: list[tuple[str, str, float, float]] = field(default_factory=list)
    """Image, point, px from the upper left corner."""
    own_system: bool = False

    @property
    def has_coordinates(self) -> bool:
        """True if a point has coordinates."""
        return any(x is not None for x, _, _ in self.ids.values())

    @property
    def table(self) -> dict[str, Any]:
        """Points observed with :data:`SIGMA`."""
        rows = [
            [
                name,
                *(None if value is None else repr(value) for value in place),
                *(None if value is None else SIGMA for value in place),
            ]
            for name, place in self.ids.items()
        ]
        return {"columns": ["id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"], "rows": rows, "group": "control"}


def read_control(folder: Path, whole: dict[str, Any], shots: dict[str, Any], draft: Draft) -> ControlMeasurements:
    """The control of a block, empty if it has none."""
    places = [folder / "gcp_list.txt", folder.parent / "gcp_list.txt"]
    listed = next((p for p in places if p.is_file() and (p.parent == folder or folder.name == "opensfm")), None)
    described = folder / "ground_control_points.json"
    control = ControlMeasurements()
    if described.is_file():
        _read_json(described, whole, draft, control)
    elif listed is not None:
        _read_list(listed, whole, shots, draft, control)
    names = {name: f"gcp {name}" for name in control.ids if name in (whole.get("points") or {})}
    control.ids = {names.get(name, name): place for name, place in control.ids.items()}
    control.rays = [(image, names.get(point, point), u, v) for image, point, u, v in control.rays]
    for name, new in names.items():
        draft.note(f"control point {name} is {new} here, because a reconstructed point has this name, too")
    if control.has_coordinates:
        draft.note(f"control points are observed with σ = {SIGMA} m: the files say none")
    return control


def read_gcp_list(path: Path) -> Document:
    """The control points of a ``gcp_list.txt``; its image points need the cameras of a block.

    Longitude and latitude become east, north, up of the first point. Raises :class:`InputError` with every mistake
    found.
    """
    draft = Draft(str(path))
    control = _read_alone(path, draft)
    images = {image for image, *_ in control.rays}
    draft.note(
        f"{counted(len(control.rays), 'image point')} of {counted(len(images), 'image')} not read: the file has no "
        "cameras; convert it together with the block that has the images"
    )
    return draft.finish()


def read_gcp_list_of_block(path: Path) -> Document:
    """The control points of a ``gcp_list.txt`` and their image points, in images without cameras.

    Raises :class:`InputError` with every mistake found.
    """
    draft = Draft(str(path))
    control = _read_alone(path, draft)
    names = dict.fromkeys(image for image, *_ in control.rays)
    if names:
        draft.table("images", ("id",), [Row([name], 1) for name in names])
        rows = [Row([image, point, repr(u), repr(v)], 1) for image, point, u, v in control.rays]
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, type="image", units="px", values={"sigma": "1"})
        draft.note("image points of control are observed with σ = 1 px: the file says none")
    return draft.finish()


def _read_alone(path: Path, draft: Draft) -> ControlMeasurements:
    """The control of a list that is not part of a block of OpenSfM, with its points in the draft."""
    control = ControlMeasurements()
    whole: dict[str, Any] = {}
    _read_list(path, whole, None, draft, control)
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    if "reference_lla" in whole:
        words = ", ".join(f"{key} {value}" for key, value in whole["reference_lla"].items())
        draft.note(f"coordinates are east, north, up of the reference point: {words}")
    if control.ids:
        draft.data["points"] = [control.table]
        draft.note(f"control points are observed with σ = {SIGMA} m: the files say none")
    elif not draft.problems:
        draft.problem("there are no control points")
    return control


def _read_list(
    path: Path, whole: dict[str, Any], shots: dict[str, Any] | None, draft: Draft, control: ControlMeasurements
) -> None:
    """A line with the system, then x y z u v image and a name; pixels count from the centre of the upper left one.

    Without ``shots`` image points of all images are read, and ``whole`` gets the first point as its reference.
    """
    lines = read_lines(path, draft)
    system = lines[0].strip() if lines else ""
    if shots is None and not SYSTEM.match(system):
        said = f"found {system[:60]!r}, expected the coordinate system, as EPSG:32632 or WGS84 UTM 32N"
        draft.problem(said, 1, str(path))
        return
    geographic = system.upper() in ("WGS84", "EPSG:4326") or any(
        word in system.lower() for word in ("longlat", "latlong")
    )
    latitude_first = geographic and _latitude_first(lines[1:], path, draft)
    names: dict[tuple[float, ...], str] = {}
    lost = 0
    for line, text in enumerate(lines[1:], start=2):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        with draft.at(line, str(path)):
            if len(words) < 6:
                raise ValueError(f"found {len(words)} words, expected x y z u v image [name]")
            x, y, z, u, v = (parse_number(word) for word in words[:5])
            z_or_none = z if words[2].lower() != "nan" else None
            name = words[6] if len(words) > 6 else names.setdefault((x, y, z), f"gcp {len(names) + 1}")
            x, y = (y, x) if latitude_first else (x, y)
            if geographic and abs(y) > 90.0:
                draft.problem(f"found the latitude {y:g}, expected it between -90 and 90", line, str(path))
                continue
            if geographic and shots is None:
                first = {"latitude": y, "longitude": x, "altitude": 0.0 if z_or_none is None else z}
                whole.setdefault("reference_lla", first)
            place = _local(y, x, z, whole) if geographic else np.array([x, y, z])
            if place is None:
                draft.problem("longitude, latitude need reference_lla in the reconstruction", line, str(path))
                continue
            control.ids[name] = (float(place[0]), float(place[1]), None if z_or_none is None else float(place[2]))
            known = shots is None or words[5] in shots
            lost += not known
            if known:
                control.rays.append((words[5], name, u + 0.5, v + 0.5))
    if lost:
        draft.note(f"{lost} image points of control not read: their images are not reconstructed", file=str(path))
    if control.ids and not geographic:
        control.own_system = True
        said = f"coordinates are those of {system!r}, taken as plane"
        more = "" if shots is None else "; the poses of the block, in another system, are not read"
        draft.note(f"{said}{more}", 1, str(path))


def _latitude_first(lines: list[str], path: Path, draft: Draft) -> bool:
    """Return True if the order of the columns must be latitude, longitude: some second number is no latitude."""
    for line, text in enumerate(lines, start=2):
        words = text.split()
        try:
            first, second = (abs(float(word)) for word in words[:2])
        except ValueError:
            continue
        if second > 90.0 >= first:
            draft.note(f"{words[1]} is not a latitude: latitude is read as the first number", line, str(path))
            return True
    return False


def _read_json(path: Path, whole: dict[str, Any], draft: Draft, control: ControlMeasurements) -> None:
    file = JsonFile(path)
    sizes = {
        name: (float(shot["width"]), float(shot["height"]))
        for name, shot in (whole.get("cameras") or {}).items()
        if isinstance(shot, dict)
        and isinstance(shot.get("width"), (int, float))
        and isinstance(shot.get("height"), (int, float))
    }
    shots = whole.get("shots") or {}
    points = file.data.get("points") if isinstance(file.data, dict) else None
    for point in points if isinstance(points, list) else []:
        try:
            _json_point(mapping(point, "points"), whole, sizes, shots, control)
        except Wrong as error:
            name = point.get("id") if isinstance(point, dict) else ""
            draft.problem(str(error), file.line(name), str(path))


def _json_point(
    point: dict[str, Any],
    whole: dict[str, Any],
    sizes: dict[str, tuple[float, float]],
    shots: dict[str, Any],
    control: ControlMeasurements,
) -> None:
    name = str(point.get("id", "")).strip()
    if not name:
        raise Wrong("a control point has no id")
    control.ids[name] = (None, None, None)
    if point.get("position") is not None:
        position = mapping(point["position"], f"point {name!r}: position")
        lat, lon = (json_number(position.get(key), f"point {name!r}: {key}") for key in ("latitude", "longitude"))
        has_height = bool(position.get("has_altitude", "altitude" in position))
        height = json_number(position.get("altitude", 0.0), f"point {name!r}: altitude")
        place = _local(lat, lon, height, whole)
        if place is None:
            raise Wrong(f"point {name!r}: latitude, longitude need reference_lla in the reconstruction")
        control.ids[name] = (float(place[0]), float(place[1]), float(place[2]) if has_height else None)
    seen = point.get("observations")
    for one in seen if isinstance(seen, list) else []:
        shot = str(mapping(one, f"point {name!r}: observations").get("shot_id"))
        if isinstance(shots.get(shot), dict) and shots[shot].get("camera") in sizes:
            width, height = sizes[shots[shot]["camera"]]
            at = one.get("projection")
            if not isinstance(at, list) or len(at) != 2:
                raise Wrong(f"point {name!r}: found no projection of two numbers in {shot!r}")
            x, y = (json_number(value, f"point {name!r}: projection") for value in at)
            side = max(width, height)
            control.rays.append((shot, name, x * side + width / 2.0, y * side + height / 2.0))


def _local(latitude: float, longitude: float, height: float, whole: dict[str, Any]) -> FloatArray | None:
    """East, north, up about the reference point of a block, of degrees on WGS84; ``None`` if it has none."""
    reference = whole.get("reference_lla")
    if not isinstance(reference, dict):
        return None
    lat0, lon0, h0 = (json_number(reference.get(k, 0.0), k) for k in ("latitude", "longitude", "altitude"))
    place = east_north_up(np.array([[latitude, longitude, height]]), np.array([lat0, lon0, h0]))
    return np.asarray(place[0])


# ---- Pix4D's camera file ``…_calibrated_internal_camera_parameters.cam``: cameras alone, in millimetres.
#
# Source: files of the program as readers of others show them; the same camera in pixels stands in the
# calibrated camera parameters of their projects.

HEAD = "Pix4D camera calibration file"
_NEEDED = ("F", "Px", "Py")


@dataclass
class _Camera:
    """A block of a file: its name there, the size of the sensor (mm), values by key."""

    name: str
    line: int
    size: tuple[float, float] | None = None
    values: dict[str, float] = field(default_factory=dict)


def read_camera_file(path: Path) -> Document:
    """A project with the cameras of a file and nothing else. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "deg"})
    found: list[_Camera] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        with draft.at(line):
            _read(text.strip(), line, found)
    if not found:
        raise InputError([Message(f"expected {HEAD!r} in the first line", str(path), 1)])
    cameras: dict[str, Any] = {}
    for camera in found:
        missing = [key for key in _NEEDED if key not in camera.values]
        if missing or camera.size is None:
            what = missing[0] if missing else "the size of the sensor behind #Focal Length"
            draft.problem(f"camera {camera.name}: {what} is missing", camera.line)
        elif camera.name in cameras:
            draft.problem(f"camera {camera.name} is there twice", camera.line)
        else:
            cameras[camera.name] = _camera(camera.values, camera.size)
            draft.lines["cameras", camera.name] = camera.line
    draft.put("cameras", cameras)
    draft.note(
        "the size of the image in pixels is not in this file: for image points in px add image: {width, height, pixel}"
    )
    draft.note("the file does not say which camera parameters were estimated: all are free")
    return draft.finish()


def _read(text: str, line: int, found: list[_Camera]) -> None:
    """A line of a file. Raises ``ValueError`` with words."""
    if text.startswith(HEAD):
        found.append(_Camera(text.removeprefix(HEAD).strip() or str(len(found)), line))
        return
    if not text:
        return
    if not found:
        raise ValueError(f"found {text[:30]!r}, expected {HEAD!r} in the first line")
    sensor_size = re.compile(r"sensor width of\s+([\d.]+)\s*x\s*([\d.]+)\s*mm", re.IGNORECASE)
    if text.startswith("#"):
        size = sensor_size.search(text)
        if size:
            width, height = parse_number(size[1]), parse_number(size[2])
            if min(width, height) <= 0.0:
                raise ValueError("found a sensor without a size")
            found[-1].size = width, height
        return
    words = text.split()
    keys = (*_NEEDED, "K1", "K2", "K3", "T1", "T2")
    if len(words) != 2 or words[0] not in keys:
        raise ValueError(f"found {text[:30]!r}, expected one of {', '.join(keys)} and a number")
    if words[0] in found[-1].values:
        raise ValueError(f"{words[0]} is there twice")
    found[-1].values[words[0]] = parse_number(words[1])


def _camera(values: dict[str, float], size: tuple[float, float]) -> dict[str, Any]:
    """Convert a camera to the model ``metashape``, whose principal point counts from the image centre."""
    given = {"f": values["F"], "cx": values["Px"] - size[0] / 2.0, "cy": values["Py"] - size[1] / 2.0}
    given |= {f"k{k}": values.get(f"K{k}", 0.0) for k in (1, 2, 3)}
    given |= {"p1": values.get("T2", 0.0), "p2": values.get("T1", 0.0)}
    interior = {key: {"free": repr(value)} for key, value in given.items()}
    return {"model": "metashape", "unit": "mm", "interior": interior}


# ---- Files of Pix4D's folder ``params``: which there are, and what stands in each.

CAMERAS = "calibrated_camera_parameters.txt"
EXTERNAL = "calibrated_external_camera_parameters.txt"
MARKS = "tp_pix4d.txt"
CONTROL = "measured_gcps_position.txt"
OFFSET = "offset.xyz"
_BLOCK = (3, 3, 3, 3, 2, 3, 3, 3, 3)
"""Numbers in the lines behind the name of an image: K, radial and tangential distortion, position, rotation."""

Result = TypeVar("Result")


class CalibratedImage(NamedTuple):
    """An image of the calibrated camera parameters."""

    name: str
    size: tuple[float, float]
    camera: tuple[float, ...]
    """f, cx, cy (px from the upper left corner), R1, R2, R3, T1, T2."""
    position: FloatArray
    rotation: FloatArray
    """(3, 3) from the object to axes right, down, forward."""
    line: int


@dataclass(frozen=True)
class NamedValues:
    """Numbers behind a name, and the line they stand in."""

    name: str
    values: tuple[float, ...]
    line: int


def files_of(path: Path) -> dict[str, Path]:
    """Parameter files by their kind, of a project folder, of its folder ``params`` or beside one of them.

    Raises :class:`InputError` if there is none, or several projects.
    """
    folder = path if path.is_dir() else path.parent
    for inner in ("1_initial/params", "params"):
        folder = folder / inner if path.is_dir() and (folder / inner).is_dir() else folder
    names = sorted(file.name for file in folder.iterdir()) if folder.is_dir() else []
    kinds = {name: kind_of(name) for name in names}
    stems = {name.removesuffix(kind) for name, kind in kinds.items() if kind and kind != OFFSET}
    if not path.is_dir() and kind_of(path.name):
        stems = {path.name.removesuffix(kind_of(path.name))}
    if len(stems) != 1:
        words = f"found parameters of {len(stems)} projects, expected one"
        words += f" ({', '.join(sorted(stems))}): name one of the files" if stems else f": …_{CAMERAS}"
        raise InputError([Message(words, str(path))])
    (stem,) = stems
    return {kind: folder / name for name, kind in kinds.items() if kind and name == stem + kind}


def kind_of(name: str) -> str:
    """Return the kind of parameter file that a name means, or an empty text."""
    ends = (EXTERNAL, CAMERAS, MARKS, CONTROL, OFFSET)
    return next((end for end in ends if name == end or name.endswith(f"_{end}")), "")


def _told(make: Callable[[], Result], line: int, file: str, draft: Draft) -> Result | None:
    try:
        return make()
    except ValueError as error:
        draft.problem(str(error), line, file)
        return None


def _numbers(words: list[str], count: int, what: str) -> tuple[float, ...]:
    values = tuple(parse_number(word) for word in words)
    if len(values) != count:
        raise ValueError(f"found {len(values)} numbers, expected {count}: {what}")
    return values


def read_cameras(path: Path, draft: Draft) -> list[CalibratedImage]:
    """Images with K, distortion, position and rotation: ten lines each behind the first empty line."""
    lines = [(k, text.split()) for k, text in enumerate(read_lines(path, draft), start=1)]
    head = next((k for k, words in lines if not words), 0)
    body = [(k, words) for k, words in lines if words and k > head]
    if not head or not body:
        form = "an empty line behind the description, then name, K, distortion, position, rotation of each image"
        draft.problem(f"found no images, expected {form}", 1, str(path))
        return []
    photos = []
    at = 0
    while at < len(body):
        block = body[at : at + 1 + len(_BLOCK)]
        photo = _told(lambda block=block: _photo(block), block[0][0], str(path), draft)  # type: ignore[misc]
        if photo is None:
            break
        photos.append(photo)
        at += len(block)
    return photos


def _photo(block: list[tuple[int, list[str]]]) -> CalibratedImage:
    line, head = block[0]
    if len(head) < 3 or len(block) < 1 + len(_BLOCK):
        raise ValueError(f"found {' '.join(head)!r}, expected name, width, height and {len(_BLOCK)} lines behind it")
    size = _numbers(head[-2:], 2, "width, height")
    rows = []
    for (k, words), count in zip(block[1:], _BLOCK, strict=True):
        try:
            rows.append(_numbers(words, count, "K (3 × 3), R1 R2 R3, T1 T2, position, rotation (3 × 3)"))
        except ValueError as error:
            raise ValueError(f"image {head[0]}: line {k}: {error}") from None
    K, R = np.array(rows[:3]), np.array(rows[6:9])
    if K[0, 0] <= 0.0 or abs(K[0, 0] - K[1, 1]) > 1e-9 * K[0, 0] or K[0, 1] or min(size) < 1.0:
        raise ValueError(f"image {head[0]}: expected K = (f 0 cx, 0 f cy, 0 0 1) with f above 0, and a size")
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise ValueError(f"image {head[0]}: the last three lines are not a rotation matrix")
    camera = (K[0, 0], K[0, 2], K[1, 2], *rows[3], *rows[4])
    name = " ".join(head[:-2])
    return CalibratedImage(name, (size[0], size[1]), tuple(map(float, camera)), np.array(rows[5]), R, line)


def read_named(path: Path, count: int, what: str, draft: Draft, most: int = 0) -> list[NamedValues]:
    """Lines of a name and ``count`` numbers (up to ``most``), between blanks, tabs or commas; a head is left out."""
    found = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = [word.strip() for word in text.split(",")] if "," in text else text.split()
        words = words if not words or words[-1] else words[:-1]
        if not words or words[0].startswith("#") or (line == 1 and _is_head(words[1:])):
            continue
        wanted = count if len(words) - 1 <= count else max(count, min(len(words) - 1, most))
        made = _told(lambda w=words, n=wanted: _numbers(w[1:], n, what), line, str(path), draft)  # type: ignore[misc]
        if made is not None:
            found.append(NamedValues(words[0], made, line))
    return found


def _is_head(words: list[str]) -> bool:
    return bool(words) and all(word[:1].isalpha() for word in words if word)


def read_marks(path: Path, draft: Draft) -> list[tuple[str, NamedValues]]:
    """Image and image point (x, y in px): the name of an image, lines of point, x, y, scale, then −99."""
    found = []
    image = ""
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0] == "-99":
            image = "" if words else image
        elif len(words) == 1 or not image:
            image = text.strip()
        else:
            made = _told(lambda w=words: _numbers(w[1:3], 2, "point x y scale"), line, str(path), draft)  # type: ignore[misc]
            if made is not None:
                found.append((image, NamedValues(words[0], made, line)))
    return found


# ---- Recognise the format of a file or folder by its structure: XML root, magic numbers, records, and last its suffix.
#
# Every format has a rule that returns the reason why an input may have it. Two formats with equally good
# reasons are told apart by the suffix, or not at all: nothing is guessed.

_RECOGNITION_HEAD = 1 << 16
"""Bytes at the beginning of a file that tell its format."""
_ROOT = re.compile(
    r"\ufeff?\s*(?:(?:<\?.*?\?>|<!--.*?-->|<!DOCTYPE(?:[^\[>]|\[.*?\])*>)\s*)*<(?:[\w.-]+:)?([A-Za-z_][\w.-]*)",
    re.DOTALL,
)
COLMAP_FILES = ("cameras", "images", "points3D")


@dataclass(frozen=True)
class Sample:
    """The beginning of a file, or the names in a folder."""

    path: Path
    head: bytes = b""
    names: frozenset[str] = frozenset()

    @cached_property
    def text(self) -> str:
        """The beginning as text."""
        return decoded(self.head)[0]

    @cached_property
    def lines(self) -> list[list[str]]:
        """Words of the first lines; the last one, which may be cut off, is left out."""
        lines = self.text.split("\n")
        return [line.split() for line in (lines[:-1] if len(self.head) == _RECOGNITION_HEAD else lines)]

    @cached_property
    def root(self) -> str:
        """Name of the root element of an XML file without namespace; empty for other files.

        Declaration, comments, processing instructions and document type before it are skipped.
        """
        found = _ROOT.match(self.text)
        return found[1] if found else ""

    @cached_property
    def records(self) -> list[str]:
        """The first lines that are not empty, without the control characters of a serial line."""
        lines = self.text.split("\n")
        lines = lines[:-1] if len(self.head) == _RECOGNITION_HEAD and len(lines) > 1 else lines
        # Lines that tell a format of records.
        enough_lines = 40
        return [bare for line in lines if (bare := line.strip("\0\1\2\3\4\x1a\r")).strip()][:enough_lines]

    @cached_property
    def kind(self) -> str:
        """xml, json or text."""
        return "xml" if self.root else "json" if self.text.lstrip()[:1] in ("{", "[") and '":' in self.text else "text"

    @cached_property
    def binary(self) -> str:
        """Kind of a file that is no text, by its first bytes; empty for text."""
        known = (words for begins, words in _BINARY if re.match(begins, self.head, re.DOTALL))
        wide = self.head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        strange = sum(byte < 32 and byte not in b"\t\n\v\f\r\x1a" for byte in self.head)
        return next(known, "a binary file of an unknown kind" if strange * 50 > len(self.head) and not wide else "")


class FormatCandidate(NamedTuple):
    """A format that an input may have, and why."""

    key: str
    reason: str
    certain: bool = False
    """True for an XML root, a magic number or the files of a folder; False for lines that look like its records."""


def format_of(path: Path) -> str | None:
    """Key of the format of a file or folder; ``None`` for mor's own files and if nothing or too much tells."""
    if is_stem(path):
        return "aicon"
    suffix = path.suffix.lower()
    # Suffixes of mor's own files.
    own = (".yaml", ".yml", ".csv", ".parquet")
    if suffix in own and suffix != ".csv":
        return None
    sample = _sample(path)
    # Formats whose files may be named like tables.
    in_tables = ("metashape-reference", "sdr")
    if suffix == ".csv":
        return next((c.key for c in candidates(sample) if c.key in in_tables), None)
    found = candidates(sample)
    by_suffix = not found and sample.head and not sample.binary and not _not_read(sample)
    return found[0].key if len(found) == 1 else _by_suffix(path) if by_suffix else None


def candidates(sample: Sample) -> list[FormatCandidate]:
    """Formats whose rules hold: the certain ones if there are any, and of several those of the suffix."""
    found = [FormatCandidate(rule.key, reason, rule.certain) for rule in _RULES if (reason := rule.reason(sample))]
    found = [c for k, c in enumerate(found) if c.key not in [other.key for other in found[:k]]]
    found = [c for c in found if c.certain] or found
    by_suffix = [c for c in found if sample.path.suffix.lower() in FORMATS[c.key].suffixes]
    return by_suffix if len(found) > 1 and by_suffix else found


def explain_unknown(path: Path) -> str:
    """Say what a file looks like, and which formats it is nearest to, if none or several of them can be meant."""
    sample = _sample(path)
    found = candidates(sample)
    if len(found) > 1:
        said = "; ".join(f"{c.key}: {c.reason}" for c in found)
        return f"this file may have several formats ({said}); --from tells which"
    if words := _not_read(sample):
        return words
    kind = sample.binary
    advice = "--from tells the format, mor new begins a project from tables (CSV, Parquet, spreadsheets)"
    if kind:
        return f"this is {kind}, in no format that is read; {advice}"
    if not sample.text.strip():
        return "this file is empty"
    if sample.text.lstrip().startswith("<?xml") and not sample.root:
        return "this begins as XML, but its first element cannot be read: the file is damaged"
    said = "; ".join(f"{c.key} ({c.reason})" for c in _nearest(sample))
    return f"this is {_looks(sample)}, in no format that is read; the nearest are {said}; {advice}"


def _not_read(sample: Sample) -> str:
    """Say what a file is if its format is known and not read; empty otherwise."""
    lines = sample.records[:3]
    return next((words for pattern, words in _NOT_READ if any(map(pattern.search, lines))), "")


_NOT_READ = (
    (
        re.compile(r"^00..SC V"),
        "this is a Trimble DC file (Survey Controller), which is not read; export the job as JobXML (.jxl)",
    ),
    (re.compile(r"For R[45]\|"), "this is a Zeiss Elta file (R4, R5), which is not read; export the job as M5"),
    (
        re.compile(r"^\s*<pix4dmapper\b"),
        "this is a project file of Pix4Dmapper, which is not read; give the folder params that Pix4D writes beside it: "
        "mor adjust PROJECT/1_initial/params",
    ),
    (re.compile(r"RINEX VERSION / TYPE"), "this is a RINEX file; GNSS receivers' raw data are not read"),
    (
        re.compile(r"^LOCAL GEODETIC DATUM:"),
        "this is a list of stations of the Bernese GNSS Software without observations; mor new reads it as a table",
    ),
)
"""Formats that are known and not read."""
_BINARY = (
    (b"%PDF", "a PDF document"),
    (
        b"\x89PNG|\xff\xd8\xff|II\\*\0|MM\0\\*|GIF8|BM.{4}\0\0\0\0|RIFF.{4}WEBP|.{4}ftyp(?:heic|mif1|avif)|8BPS",
        "an image",
    ),
    (b"PK\3\4.*?(?:xl/|opendocument\\.spreadsheet)", "a spreadsheet"),
    (b"PK\3\4.*?(?:word/|opendocument\\.text)", "a text document"),
    (b"PK[\3\5]", "a ZIP archive"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet or document of Microsoft Office"),
    (b"\x1f\x8b|7z\xbc\xaf|Rar!|BZh|\xfd7zXZ|\\(\xb5/\xfd", "a compressed file"),
    (
        b"SQLite format 3\0.*(?:two_view_geometries|inlier_matches)",
        "a database of COLMAP without poses, whose model is to be exported",
    ),
    (b"SQLite format 3\0", "an SQLite database"),
    (b"PAR1", "a Parquet table"),
    (b"\x89HDF|CDF[\1\2\5]", "a file of scientific arrays (HDF5, NetCDF)"),
    (b"LASF", "a point cloud (LAS, LAZ)"),
    (b"AC10\\d\\d\0", "an AutoCAD drawing"),
    (b"\x7fELF|MZ.*?\0|\xca\xfe\xba\xbe", "a program"),
)
"""First bytes of files that are no text, and what they are."""


def _looks(sample: Sample) -> str:
    """Return words for the form of a text: XML, JSON, a table or lines that begin alike."""
    if sample.root:
        return f"XML with the root element <{sample.root}>"
    if sample.kind == "json":
        return "JSON"
    first, parted = sample.records[0].strip(), ""
    rows = [re.split(r"[;\s]+", line.strip(" ;")) for line in sample.records]
    for sign, name in ((";", "semicolons"), ("\t", "tabs"), (",", "commas")):
        counts = {line.count(sign) for line in sample.records[:5]}
        if not parted and len(counts) == 1 and min(counts) and len(sample.records) > 1:
            parted = f"a table of {min(counts) + 1} columns between {name}"
            rows = [line.strip().split(sign) for line in sample.records]
    if has_two_names(rows):
        return f"a table of {len(rows[0])} columns without a header, like observations of JAG3D (from, to, values)"
    if (
        {len(row) for row in rows} == {len(rows[0])}
        and len(rows[0]) > 1
        and all(_recognition_numbers(r[1:]) for r in rows)
    ):
        return f"a table of {len(rows[0])} columns without a header, like a list of points (name, coordinates)"
    if parted:
        return parted
    # Letters of an unknown file that its message repeats.
    shown = 40
    return f"text that begins with {first[:shown]!r}"


def _nearest(sample: Sample) -> list[FormatCandidate]:
    """The three formats that a text comes nearest to: by its lines, its root element or its suffix, and what lacks."""
    scored: dict[str, tuple[float, FormatCandidate]] = {}
    for rule in _RULES:
        if FORMATS[rule.key].read is None or rule.kind != sample.kind:
            continue
        pattern = re.compile(_SIMILAR.get(rule.key, "$"), re.IGNORECASE)
        score = sum(pattern.match(line) is not None for line in sample.records) / max(len(sample.records), 1)
        if sample.root:
            score = SequenceMatcher(None, sample.root.lower(), rule.expected.lower()).ratio()
        score += 0.5 * (sample.path.suffix.lower() in FORMATS[rule.key].suffixes)
        scored.setdefault(rule.key, (score, FormatCandidate(rule.key, f"expected {rule.expected}")))
    usual = [key for key in _SIMILAR if key in scored] or list(scored)
    return [scored[key][1] for key in sorted(usual, key=lambda key: -scored[key][0])[:3]]


def _sample(path: Path) -> Sample:
    given = standard_input(path)
    if given is not None:
        return Sample(path, given[:_RECOGNITION_HEAD])
    if is_folder(path):
        return Sample(path, names=frozenset(_names(path)))
    try:
        if not path.is_file():
            return Sample(path)
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            head = file.read(_RECOGNITION_HEAD)
            return Sample(path, head + (file.read(1 << 20) if head.startswith(b"SQLite") else b""))  # its tables
    except (OSError, EOFError, ValueError, zlib.error):
        return Sample(path)


def _names(folder: Path) -> Iterator[str]:
    try:
        yield from (entry.name for entry in folder.iterdir())
    except OSError:
        return


def _by_suffix(path: Path) -> str | None:
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    last = suffixes[-1] if suffixes else ""
    found = [key for key, known in FORMATS.items() if last in known.suffixes and known.read is not None]
    # Suffixes that many programs use: they are no reason for a format.
    vague = (".txt", ".dat", ".out", ".raw", ".job", ".obs", ".xml", ".json", ".gz")
    return found[0] if len(found) == 1 and last not in vague else None


def _recognition_numbers(words: list[str]) -> int:
    try:
        for word in words:
            float(word)
    except ValueError:
        return 0
    return len(words)


def _colmap(sample: Sample) -> bool:
    if not sample.names and (sample.path.stem not in COLMAP_FILES or sample.path.suffix not in (".bin", ".txt")):
        return False
    names = sample.names or set(_names(sample.path.parent))
    counts = [sum(f"{name}{end}" in names for name in COLMAP_FILES) for end in (".bin", ".txt")]
    return max(counts) > 1  # the reader says which one is missing


def _opensfm(sample: Sample) -> bool:
    if sample.names:
        return "reconstruction.json" in sample.names or (
            "opensfm" in sample.names and (sample.path / "opensfm" / "reconstruction.json").is_file()
        )
    return sample.text.lstrip()[:1] in ("[", "{") and '"shots"' in sample.text + '"shots"' * (
        '"projection_type"' in sample.text
    )


def _pix4d(sample: Sample) -> bool:
    if not sample.names:
        return kind_of(sample.path.name) not in ("", OFFSET)
    inner = any((sample.path / name).is_dir() for name in ("1_initial/params", "params"))
    return inner or any(kind_of(name) == CAMERAS for name in sample.names)


def _jag3d(sample: Sample) -> bool:
    return any(POINT_FILE.match(name) for name in sample.names) and any(
        OBSERVATION_FILE.match(name) for name in sample.names
    )


def _comp3d(sample: Sample) -> bool:
    """A project of Comp3D, or a file of its suffixes whose lines are a code, names and numbers."""
    suffix = sample.path.suffix.lower()
    if suffix == ".comp":
        return '"root_OBS_file"' in sample.text or '"COMP3D_VERSION"' in sample.text
    lines = [words for line in sample.records if (words := line.partition("*")[0].split())]
    form = r"-?\d{1,2}|@.*"
    return (
        suffix in (".obs", ".cor")
        and bool(lines)
        and all(re.fullmatch(form, words[0]) and (len(words) > 1 or words[0][0] == "@") for words in lines)
    )


def _alicevision(sample: Sample) -> bool:
    head = sample.text.lstrip()[:1] == "{" and '"version"' in sample.text
    return head and any(f'"{name}"' in sample.text for name in ("featuresFolders", "viewId", "intrinsicId"))


def _photomodeler(sample: Sample) -> bool:
    """Tolerance and iterations, nine σ, then the camera: lines 2, 3 and 4."""
    counts = [_recognition_numbers(words) for words in sample.lines[1:4]]
    return len(counts) == 3 and counts[0] in (2, 3, 4) and counts[1] >= 6 and counts[2] >= 5


def _idx(sample: Sample) -> bool:
    head = re.match(r"\s*HEADER\b", sample.text) is not None and "UNITS" in sample.text
    return head or re.search(r"^\s*(?:SLOPE|POINTS)\(.*\)\s*$", sample.text, re.MULTILINE | re.IGNORECASE) is not None


def _sections(sample: Sample) -> bool:
    """A section that a network has, in brackets: an INI file has others."""
    return not sample.root and _SECTION.search(sample.text) is not None


_SECTION = re.compile(
    r"^\s*\[\s*(?:project|coordinates|datum|sigma0|\w*(?:distance|bearing|angle|direction|difference)s)\b",
    re.MULTILINE | re.IGNORECASE,
)


def _bal(sample: Sample) -> bool:
    lines = [words for words in sample.lines[:4] if words]
    if len(lines) < 2 or len(lines[0]) != 3 or not all(word.isdecimal() for word in lines[0]):
        return False
    return all(len(words) == 4 and _recognition_numbers(words) == 4 for words in lines[1:2])


_STARNET = re.compile(
    r"\s*(?:\.[A-Za-z0-9]+|#|'|(?:C|E|B|A|D|V|DV|M|BM|L|SS|DB|DN|DM|DE|TB|T|TE|G[0-4]|PH?)(?:\s|$))", re.IGNORECASE
)
_STARNET_NAMES = re.compile(
    r"\s*(?:(?:B|A|D|V|DV|M|BM|L|SS|G1)\s+(?:(\S+[-,:;|_~^+=]\S+)|(\S))|DB\s+\S|TB\s+\S|C\s+\S+(?:\s+-?[\d.]+){2})",
    re.I,
)
"""Lines with names: joined by a sign (1), else those of no STAR*NET file (2)."""


PROJECT_FILE = re.compile(r"\s*(?:\*STAR\*NET \d.*\s+|#.*\s+)*\[Adjustment\]")
"""Head of a project file of STAR*NET."""


def _dynadjust(sample: Sample) -> bool:
    """A file of stations or measurements, or a project that names them."""
    return sample.text.startswith("!#=DNA") or re.search(r"^stn-msr-file\b", sample.text, re.MULTILINE) is not None


def _starnet(sample: Sample) -> bool:
    lines = [line for line in sample.text.split("\n")[:60] if line.strip()]
    fitting = sum(_STARNET.match(line) is not None for line in lines)
    named = [match for line in lines if (match := _STARNET_NAMES.match(line))]
    apart = sum(match[2] is not None for match in named)
    return PROJECT_FILE.match(sample.text) is not None or (
        fitting >= 0.8 * len(lines) and len(named) - apart >= 2 and 4 * apart <= len(named)
    )


def _snap(sample: Sample) -> bool:
    """A data file has a title and #data; a command file names its files."""
    lines = [words for words in sample.lines if words]
    data = any(words[0].lower() == "#data" for words in lines[1:])
    return data or {"coordinate_file", "data_file"} <= {words[0].lower() for words in lines}


def _geodimeter(sample: Sample) -> bool:
    fitting = sum(re.match(r"\s*\d{1,3}\s*=", line) is not None for line in sample.records)
    return fitting > 0 and fitting >= 0.8 * len(sample.records)


def _aicon(sample: Sample) -> bool:
    return any(name.endswith((".ior", ".ior.gz")) for name in sample.names)


def _reference_pane(sample: Sample) -> bool:
    lines = sample.text.split("\n")[:6]
    return any(re.match(r"#?\s*label\s*[,;\t]\s*x/", line, re.IGNORECASE) for line in lines)


def _gcp(sample: Sample) -> bool:
    """A coordinate system, then x y z u v and an image a line; or the name that OpenDroneMap asks for."""
    if sample.path.name.lower() == "gcp_list.txt":
        return True
    lines = [line for line in sample.records if not line.startswith("#")]
    if len(lines) < 2 or not SYSTEM.match(lines[0].strip()):
        return False
    words = [line.split() for line in lines[1:4]]
    return all(len(row) >= 6 and _recognition_numbers(row[:5]) == 5 for row in words)


_SIMILAR = {
    "starnet": _STARNET.pattern,
    "gsi": r"\s*\*?\d{2}\S{4}[+-]|\*?\d{6}",
    "sdr": r"[01]\d[A-Z]{2}",
    "m5": r"For\b|(?:[^|]*\|){3}",
    "rw5": r"[A-Z]{2},[A-Z]{2}|--",
    "nikon": r"[A-Z]{2},[^,]*,",
    "fbk": r"(?:UNITS?|NEZ?|STN|PRISM|BS|AD|F[12]) ",
    "sokkia-scr": r"A,|\w+,E[ae],",
    "topcon": r"(?:TopSURV|GTS-7|JOB|UNITS|STN|BKB|[BFS]S|[SH]D|HV|XYZ)\s",
    "geodimeter": r"\s*\d{1,3}\s*=",
    "idx": r"\s*(?:[A-Z_]+\s+|\d+,).*;|HEADER|DATABASE|THEODOLITE",
    "snap": r"\s*(?:#?data|coordinate|title|[a-z_]+_file|[a-z_]+_error)",
    "sinex": r"[%+*-][A-Z=/_]{3}",
    "dynadjust": r"!#=|[A-Z]\s.*[A-Z]{3} (?:LLH|XYZ|UTM)",
    "gcp": r"\s*(?:[-+\d.]+\s+){5}\S+",
    "bal": r"\s*(?:[-+\d.]+[\s,]+){2,}[-+\d.]+\s*$",
    "photomodeler": r"\s*(?:[-+\d.]+[\s,]+){4,}[-+\d.]+\s*$",
    "pix4d-cam": r"(?:F|Px|Py|K\d|T\d) [-\d.]",
    "bundler": r"# Bundle",
    "metashape-reference": r"#|[^,]*,(?:[-\d.]*,){3}",
    "textbook": r"\s*\[",
    "jag3d-script": r"(?:CREATE|INSERT|SET) ",
}
"""How lines of each format of text begin, less strict than its rule, the usual formats first: for unknown files."""


class _Rule(NamedTuple):
    key: str
    reason: Callable[[Sample], str]
    certain: bool
    expected: str
    kind: str = "text"
    """text, json, xml, or files for rules on names."""


def _root(key: str, name: str, words: str = "") -> _Rule:
    """A rule for the root element of an XML file, which has certain words in it."""

    def reason(sample: Sample) -> str:
        return f"its root element is <{name}>" if sample.root == name and words in sample.text else ""

    return _Rule(key, reason, True, f"the root element <{name}>", "xml")


def _records(key: str, pattern: re.Pattern[str], least: int, form: str) -> _Rule:
    """A rule for so many lines, or all there are, that look like a record."""

    def reason(sample: Sample) -> str:
        if sample.root or not sample.records:
            return ""
        count = sum(pattern.match(line) is not None for line in sample.records)
        return f"lines look like {form}" if count >= min(least, len(sample.records)) else ""

    return _Rule(key, reason, False, form if least == 1 else f"{least} lines or more like {form}")


def _if(key: str, holds: Callable[[Sample], bool], said: str, certain: bool = True, kind: str = "text") -> _Rule:
    return _Rule(key, lambda sample: said if holds(sample) else "", certain, said, kind)


_RULES: tuple[_Rule, ...] = (
    _if("colmap", _colmap, "the files of a COLMAP model", kind="files"),
    _if("jag3d", _jag3d, "the file names of a JAG3D project", kind="files"),
    _if("pix4d", _pix4d, "the file names of Pix4Dmapper", kind="files"),
    _if("alicevision", _alicevision, "JSON with views and intrinsics", kind="json"),
    _if("opensfm", _opensfm, "a reconstruction with shots", kind="json"),
    _if("aicon", _aicon, "the file names of AICON 3D Studio", kind="files"),
    _root("dbat", "document", "dbat_script_version"),
    _if("metashape", lambda sample: is_project(sample.path) and bool(sample.head), "a Metashape project", kind="files"),
    _root("metashape", "document", "<chunk"),
    _root("metashape", "chunk", "<chunk"),
    _if("metashape-reference", _reference_pane, "the columns of a reference pane"),
    _root("jobxml", "JOBFile"),
    _root("landxml", "LandXML"),
    _root("gkf", "gama-local"),
    _if("dynadjust", _dynadjust, "the head !#=DNA"),
    _root("dynaml", "DnaXmlFormat"),
    _if("comp3d", _comp3d, "codes, names and numbers of Comp3D"),
    _if("sinex", lambda sample: sample.text.startswith("%=SNX"), "the head %=SNX"),
    _if("jag3d-script", lambda s: '"PointApriori"' in s.text and "TABLE" in s.text, "tables of JAG3D"),
    _if("textbook", _sections, "sections as in [Coordinates]", certain=False),
    _if("gcp", _gcp, "a coordinate system, then x y z u v and an image a line", certain=False),
    _if("bal", _bal, "three counts, then four numbers a line", certain=False),
    _if("snap", _snap, "the commands of SNAP"),
    _records(
        "gsi",
        re.compile(r"\s*\*?\d{2}[\d.]{4}[+-][^_\s]+(?:\s+\d{2}\S{4}[+-]|\s*$)"),
        1,
        "blocks of words as in 110001+00000001",
    ),
    _records("sdr", re.compile(r"00..SDR|SDL\d+,\d"), 1, "the head of an SDR33 file or an SDL level"),
    _records("m5", re.compile(r"For M5\|Adr"), 1, "records For M5|Adr"),
    _records(
        "m5",
        re.compile(r"\s*\d+\s+\S.*\s(?:R[bfz]|L[rvz])\s+-?\d+\.\d+\s+(?:HD|E)\s+\d"),
        2,
        "staff readings Rb and Rf",
    ),
    _records(
        "rw5",
        re.compile(r"JB,NM|MO,AD\d,UN|(?:OC|BK|SS|TR|FS|BD|BR|FD|FR),OP|SP,PN|GPS,PN|LS,H[IR]"),
        1,
        "the records JB, MO, OC",
    ),
    _records("nikon", re.compile(r"\s*[01]\s*,\s*[0-3]\s*,\s*[MFN][DGM]\s*,"), 2, "records 1,0,MD of a DTM-300"),
    _records(
        "nikon",
        re.compile(r"CO,.*\bRAW data|(?:SS|F[12]),[^,]*,-?[\d.]+,-?[\d.]*,-?[\d.]+,", re.IGNORECASE),
        1,
        "comma-separated records CO, ST, SS",
    ),
    _records("sokkia-scr", re.compile(r"A,SET\d"), 1, "the head of a SET file"),
    _records(
        "fbk",
        re.compile(
            r"UNITS? (?:METER|(?:US)?FOOT)|(?:AD|F[12]|FC[12]) VA |STN [^\s,]+(?:\s|$)|PRISM [\d.]|NEZ? \S+ [\d.]"
        ),
        2,
        "the commands UNIT, STN, F1 VA",
    ),
    _records(
        "topcon",
        re.compile(
            r"TopSURV|(?=.{8}\S)(?:JOB|UNITS|STN|BKB|XYZ|[BFS]S|[SH]D|HV) {3,}[^,]+,|(?:STN|[BFS]S|[SH]D|HV) +[^\s,]+,"
        ),
        2,
        "the records STN, JOB, UNITS",
    ),
    _records("topcon", re.compile(r"_'[^_]*_\("), 1, "stations and sights of a GTS-6 file"),
    _records("pix4d-cam", re.compile(HEAD), 1, "the head of a camera file"),
    _records("bundler", re.compile(r"# Bundle file"), 1, "the head of a bundle file"),
    _if("idx", _idx, "the sections of an IDX file", certain=False),
    _if("geodimeter", _geodimeter, "a label and a value a line", certain=False),
    _if("starnet", _starnet, "the codes and names of STAR*NET", certain=False),
    _if("photomodeler", _photomodeler, "the head of a PhotoModeler export", certain=False),
)
"""What tells each format."""
