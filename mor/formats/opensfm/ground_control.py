"""Ground control of OpenSfM and OpenDroneMap: ``gcp_list.txt`` and ``ground_control_points.json``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.counting import counted
from mor.formats.draft import Draft, Row, number
from mor.formats.json_text import JsonFile, Wrong, mapping
from mor.formats.json_text import number as json_number
from mor.formats.text import read_lines
from mor.formats.wgs84 import east_north_up
from mor.project.file.nodes import Document

SIGMA = "0.02"
"""σ of control, m: the files say none."""

_POLE = 90.0
SYSTEM = re.compile(r"EPSG:\s*\d+|WGS\s*84\b|\+proj=|\+init=|PROJCS|GEOGCS|PROJCRS|GEOGCRS", re.IGNORECASE)
"""The coordinate system in the first line of a gcp_list.txt."""


@dataclass
class Control:
    """Control points, their image points, and whether they are in a system that is not the block's."""

    ids: dict[str, tuple[float, float, float | None]] = field(default_factory=dict)
    rays: list[tuple[str, str, float, float]] = field(default_factory=list)
    """Image, point, px from the upper left corner."""
    own_system: bool = False

    @property
    def table(self) -> dict[str, Any]:
        """Points observed with :data:`SIGMA`."""
        rows = [
            [
                name,
                repr(x),
                repr(y),
                None if z is None else repr(z),
                SIGMA,
                SIGMA,
                None if z is None else SIGMA,
            ]
            for name, (x, y, z) in self.ids.items()
        ]
        return {
            "columns": ["id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"],
            "rows": rows,
            "group": "control",
        }


def read_control(folder: Path, whole: dict[str, Any], shots: dict[str, Any], draft: Draft) -> Control:
    """The control of a block, empty if it has none."""
    places = [folder / "gcp_list.txt", folder.parent / "gcp_list.txt"]
    listed = next(
        (p for p in places if p.is_file() and (p.parent == folder or folder.name == "opensfm")), None
    )
    described = folder / "ground_control_points.json"
    control = Control()
    if described.is_file():
        _read_json(described, whole, draft, control)
    elif listed is not None:
        _read_list(listed, whole, shots, draft, control)
    if control.ids:
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


def _read_alone(path: Path, draft: Draft) -> Control:
    """The control of a list that is not part of a block of OpenSfM, with its points in the draft."""
    control = Control()
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
    path: Path, whole: dict[str, Any], shots: dict[str, Any] | None, draft: Draft, control: Control
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
        try:
            if len(words) < 6:
                raise ValueError(f"found {len(words)} words, expected x y z u v image [name]")
            x, y, z, u, v = (number(word) for word in words[:5])
            z_or_none = z if words[2].lower() != "nan" else None
        except ValueError as error:
            draft.problem(str(error), line, str(path))
            continue
        name = words[6] if len(words) > 6 else names.setdefault((x, y, z), f"gcp {len(names) + 1}")
        x, y = (y, x) if latitude_first else (x, y)
        if geographic and abs(y) > _POLE:
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
        draft.note(
            f"{lost} image points of control not read: their images are not reconstructed", file=str(path)
        )
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
        if second > _POLE >= first:
            draft.note(f"{words[1]} is no latitude: latitude is read as the first number", line, str(path))
            return True
    return False


def _read_json(path: Path, whole: dict[str, Any], draft: Draft, control: Control) -> None:
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
    control: Control,
) -> None:
    name = str(point.get("id", "")).strip()
    if not name:
        raise Wrong("a control point has no id")
    position = mapping(point.get("position"), f"point {name!r}: position")
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
