"""Metashape's ``cameras.xml`` and ``markers.xml`` as a project: frame cameras, poses, markers with their projections.

Camera axes are right, down, forward; a transform takes them to the chunk, that of the chunk to its coordinate system.
Pixels count from the upper left corner of the upper left pixel (Agisoft, *Metashape User Manual*, appendices).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.formats.metashape.projects import is_project, project_tree
from mor.formats.metashape.sensors import SensorError, camera_of
from mor.formats.metashape.tie_points import TiePoints, put_tie_points, read_tie_points
from mor.formats.xml import Element, parse_xml
from mor.geometry.rotations import angles_from_rotation, exponential
from mor.input_files import PROJECT, read_bytes
from mor.project.file.nodes import Document

_FLIP = np.diag([1.0, -1.0, -1.0])
SIGMA_MARKER, SIGMA_PROJECTION, SIGMA_CAMERA, SIGMA_TIE_POINT = 0.005, 0.5, 10.0, 1.0
"""σ of markers (m), their projections (px), camera positions (m), tie points (px) where the file has none: its own."""


@dataclass
class Chunk:
    """Content of a chunk."""

    cameras: dict[str, str] = field(default_factory=dict)
    """Name of each image by the number of its camera element."""
    markers: dict[str, str] = field(default_factory=dict)
    markers_placed: dict[str, tuple[list[str | None], list[str | None], int]] = field(default_factory=dict)
    tie: TiePoints | None = None
    posed: bool = False
    """True if poses are read."""


def read_metashape(path: Path) -> Document:
    """The project of a cameras.xml, a markers.xml, a .psz or .psx.

    Raises :class:`InputError` with every mistake found.
    """
    draft = Draft(str(path))
    own = is_project(path)
    root = project_tree(path) if own else parse_xml(read_bytes(path, PROJECT), draft.file)
    chunks = [root] if root.name == "chunk" else list(_inside(root, "chunk"))
    if not chunks:
        raise InputError(
            [Problem(f"found <{root.name}> without a <chunk>, expected Metashape's XML", draft.file, 1)]
        )
    if len(chunks) > 1:
        draft.note(f"{len(chunks)} chunks: only the first one is read", chunks[1].line)
    chunk = chunks[0]
    if own:
        draft.note("lines are those of the doc.xml in the archives")
    draft.put("title", chunk.attributes.get("label", path.stem))
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    found = Chunk(tie=_tie_points(chunk, path, draft) if own else None)
    control = False
    try:
        _put_cameras(chunk, draft)
        control = _read_markers(chunk, found, draft)
        control = _put_images(chunk, found, control, draft) or control
        _put_markers(found, draft)
        _put_projections(chunk, found, draft)
        _put_tie_points(chunk, found, draft)
    except ValueError as error:
        draft.problem(str(error), chunk.line)
    if not control:
        draft.put("datum", "free")
    return draft.finish()


def _inside(element: Element, name: str) -> Iterator[Element]:
    """Elements of a name at any depth, those in groups as well."""
    for child in element.children:
        if child.name == name:
            yield child
        else:
            yield from _inside(child, name)


def _section(chunk: Element, section: str, name: str) -> list[Element]:
    return [found for part in chunk.all(section) for found in _inside(part, name)]


def _put_cameras(chunk: Element, draft: Draft) -> None:
    cameras: dict[str, Any] = {}
    for sensor in _section(chunk, "sensors", "sensor"):
        name = sensor.attributes.get("id", str(len(cameras)))
        try:
            cameras[name], fixed = camera_of(sensor)
        except SensorError as error:
            draft.problem(f"sensor {name}: {error}", sensor.line)
            continue
        draft.lines["cameras", name] = sensor.line
        if fixed:
            draft.note(f"camera {name} is fixed, as the file says", sensor.line)
    if not cameras and not draft.problems:
        draft.problem("found no sensors", chunk.line)
    draft.put("cameras", cameras)


def _numbers(text: str, count: int, what: str) -> FloatArray:
    values = [number(word) for word in text.split()]
    if len(values) != count:
        raise ValueError(f"{what}: found {len(values)} numbers, expected {count}")
    return np.array(values)


def _similarity(chunk: Element) -> tuple[FloatArray, FloatArray, float]:
    """Rotation, translation and scale from the chunk to its coordinate system."""
    R, t, s = np.eye(3), np.zeros(3), 1.0
    for part in _transforms(chunk):
        for child in part.children:
            if child.name == "rotation":
                R = _numbers(child.text, 9, "rotation").reshape(3, 3)
            elif child.name == "translation":
                t = _numbers(child.text, 3, "translation")
            elif child.name == "scale":
                s = float(_numbers(child.text, 1, "scale")[0])
    return R, t, s


def _transforms(chunk: Element) -> list[Element]:
    return (
        chunk.all("transform")
        or [t for c in _section(chunk, "components", "component") for t in c.all("transform")][:1]
    )


def _system(chunk: Element) -> str:
    """Kind of the coordinate system: local, projected or geographic."""
    text = " ".join(part.text for part in chunk.all("reference")).strip()
    if text.startswith("GEOGCS"):
        return "geographic"
    return "projected" if text.startswith(("PROJCS", "COMPD_CS", "GEOCCS")) else "local"


def _read_markers(chunk: Element, found: Chunk, draft: Draft) -> bool:
    """Markers with their reference coordinates (start values where switched off); true where some are control."""
    system = _system(chunk)
    control = 0
    for marker in _section(chunk, "markers", "marker"):
        if "id" not in marker.attributes:
            continue
        number_ = marker.attributes["id"]
        name = marker.attributes.get("label", "").strip() or f"marker {number_}"
        name = name if name not in found.markers.values() else f"{name} ({number_})"
        found.markers[number_] = name
        place: list[str | None] = [None] * 3
        sigma: list[str | None] = [None] * 3
        for given in marker.all("reference"):
            if system != "geographic":
                place, sigma = _reference(given, _accuracy(chunk, "accuracy_markers", SIGMA_MARKER))
                known = given.attributes.get("enabled", "true") in ("true", "1")
                sigma = sigma if known else [None] * 3
        control += any(text is not None for text in sigma)
        found.markers_placed[name] = place, sigma, marker.line
    if system == "geographic" and found.markers:
        draft.note(
            "coordinates of markers are longitude and latitude: not read; the network is free", chunk.line
        )
    if control:
        draft.note(f"{counted(control, 'marker')} with coordinates: observed, σ as the file says", chunk.line)
    return control >= 3


def _reference(given: Element, common: str) -> tuple[list[str | None], list[str | None]]:
    """Coordinates and σ; ``common`` where the element says none."""
    place = [given.attributes.get(axis) for axis in "xyz"]
    for text in place:
        if text is not None:
            number(text)
    every = given.attributes.get("sxyz") or common
    plane = given.attributes.get("sxy") or every
    sigma = [given.attributes.get(f"s{axis}") or (every if axis == "z" else plane) for axis in "xyz"]
    for text in sigma:
        if number(text) < 0.0:
            raise ValueError(f"found the accuracy {text}, expected 0 or more")
    return place, [s if p is not None else None for s, p in zip(sigma, place, strict=True)]


def _accuracy(chunk: Element, name: str, default: float) -> str:
    for settings in chunk.all("settings"):
        for given in settings.all("property"):
            if given.attributes.get("name") == name and number(given.attributes.get("value", "")) > 0.0:
                return given.attributes["value"]
    return repr(default)


def _put_images(chunk: Element, found: Chunk, control: bool, draft: Draft) -> bool:
    """Images with projections of markers: poses in the chunk, or in its coordinate system where that is local.

    True if positions of three or more images are observed.
    """
    system = _system(chunk)
    known = _positions(chunk, draft) if system != "geographic" else {}
    other = (control or bool(known)) and system != "local"
    seen = {
        location.attributes.get("camera_id", "")
        for frame in _section(chunk, "frames", "frame")
        for location in _inside(frame, "location")
    }
    seen |= {one.camera for one in found.tie.projections if len(one.points)} if found.tie else set()
    found.posed = not other
    rows, off, unseen = [], 0, 0
    for camera in _section(chunk, "cameras", "camera"):
        if "id" not in camera.attributes or "sensor_id" not in camera.attributes:
            continue
        number_, sensor = camera.attributes["id"], camera.attributes["sensor_id"]
        if sensor not in draft.data["cameras"] or camera.attributes.get("enabled", "true") in ("false", "0"):
            off += 1
            continue
        if seen and number_ not in seen:
            unseen += 1
            continue
        name = camera.attributes.get("label", "").strip() or f"camera {number_}"
        name = name if name not in found.cameras.values() else f"{name} ({number_})"
        found.cameras[number_] = name
        pose = [None, None, None, *_attitude(camera)] if other else _pose(chunk, camera, name, system)
        rows.append(Row([name, sensor, *_observed(pose, known.get(number_))], camera.line))
    used = {str(row.cells[1]) for row in rows}
    idle = [name for name in draft.data["cameras"] if name not in used]
    if rows and idle:
        draft.note(f"sensors {', '.join(idle)} have no image here: not read", chunk.line)
        draft.data["cameras"] = {k: v for k, v in draft.data["cameras"].items() if k in used}
    for count, why in ((off, "switched off or without a sensor"), (unseen, "in which no marker is measured")):
        if count:
            draft.note(f"{counted(count, 'image')} {why}: not read", chunk.line)
    if other:
        draft.note("poses are geocentric, references are not: the poses are not read", chunk.line)
    if rows:
        axes = ("x", "y", "z")
        columns = ("id", "camera", *axes, "omega", "phi", "kappa")
        more = (*(f"sigma_{axis}" for axis in axes), *(f"start_{axis}" for axis in axes))
        draft.table("images", (*columns, *more), rows)
    return sum(row.cells[8] is not None for row in rows) >= 3


def _pose(chunk: Element, camera: Element, name: str, system: str) -> list[str | None]:
    """Position and ω, φ, κ of the transform of a camera, where it has one."""
    given = next(iter(camera.all("transform")), None)
    if given is None:
        return [None, None, None, *_attitude(camera)]
    R, t, s = _similarity(chunk)
    T = _numbers(given.text, 16, f"transform of camera {name!r}").reshape(4, 4)
    if max(np.abs(T).max(), np.abs(R).max(), np.abs(t).max(), abs(s)) > 1e30:
        raise ValueError(f"transform of camera {name!r}: found a number beyond 1e30")
    scaled = T[:3, :3] / max(np.cbrt(abs(np.linalg.det(T[:3, :3]))), 1e-300)
    world, centre = (R @ scaled, s * R @ T[:3, 3] + t) if system == "local" else (scaled, T[:3, 3])
    numbers = [*centre, *angles_from_rotation(_FLIP @ world.T)]
    return [repr(float(v)) for v in numbers] if np.isfinite(numbers).all() else [None] * 6


def _attitude(camera: Element) -> list[str | None]:
    """ω, φ, κ as start values, of yaw (clockwise from y), pitch (0 looks down, 90 ahead) and roll in degrees."""
    for given in camera.all("reference"):
        words = [given.attributes.get(name) for name in ("yaw", "pitch", "roll")]
        if None not in words:
            yaw, pitch, roll = (np.radians(number(str(word))) for word in words)
            turns = ([0.0, 0.0, -yaw], [pitch, 0.0, 0.0], [0.0, roll, 0.0])
            to_object = np.linalg.multi_dot([exponential(np.array(turn)) for turn in turns])
            return [repr(float(v)) for v in angles_from_rotation(to_object.T)]
    return [None] * 3


def _positions(chunk: Element, draft: Draft) -> dict[str, tuple[list[str | None], list[str | None]]]:
    """Reference positions of cameras that are switched on, with their σ, by the numbers of the cameras."""
    found = {}
    common = _accuracy(chunk, "accuracy_cameras", SIGMA_CAMERA)
    for camera in _section(chunk, "cameras", "camera"):
        for given in camera.all("reference"):
            if given.attributes.get("enabled", "true") in ("true", "1") and "x" in given.attributes:
                found[camera.attributes.get("id", "")] = _reference(given, common)
    if found:
        words = (
            f"positions of {counted(len(found), 'image')} are observed, σ as the file says, else {common} m"
        )
        draft.note(words, chunk.line)
    return found


def _observed(
    pose: list[str | None], known: tuple[list[str | None], list[str | None]] | None
) -> list[str | None]:
    """Pose, σ and start values of the position: observed where it is known, starting where the transform has it."""
    if known is None:
        return [*pose, *[None] * 6]
    place, sigma = known
    return [
        *place,
        *pose[3:],
        *sigma,
        *(s if p is not None else None for s, p in zip(pose[:3], place, strict=True)),
    ]


def _put_markers(found: Chunk, draft: Draft) -> None:
    rows = [Row([name, *place, *sigma], line) for name, (place, sigma, line) in found.markers_placed.items()]
    if rows:
        draft.table("points", ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), rows)


def _put_projections(chunk: Element, found: Chunk, draft: Draft) -> None:
    rows, lost = [], 0
    for frame in _section(chunk, "frames", "frame"):
        for marker in _section(frame, "markers", "marker"):
            name = found.markers.get(marker.attributes.get("marker_id", ""))
            for location in marker.all("location"):
                image = found.cameras.get(location.attributes.get("camera_id", ""))
                if name is None or image is None:
                    lost += 1
                    continue
                xy = [location.attributes.get(axis, "") for axis in "xy"]
                for text in xy:
                    number(text)
                rows.append(Row([image, name, *xy], location.line))
    if lost:
        draft.note(
            f"{counted(lost, 'projection')} of markers or images that are not there: not read", chunk.line
        )
    sigma = _accuracy(chunk, "accuracy_projections", SIGMA_PROJECTION)
    if rows:
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, type="image", units="px", values={"sigma": sigma})
    elif found.tie is None:
        draft.note(
            "the file has no projections of markers: export the markers, too; tie points are in neither"
        )


def _tie_points(chunk: Element, path: Path, draft: Draft) -> TiePoints | None:
    clouds = [cloud for cloud in _inside(chunk, "point_cloud") if cloud.all("projections")]
    if not clouds:
        draft.note("the project has no tie points: its photographs are not aligned", chunk.line)
        return None
    return read_tie_points(clouds[0], path)


def _put_tie_points(chunk: Element, found: Chunk, draft: Draft) -> None:
    if found.tie is None:
        return
    xyz = None
    if found.posed:
        R, t, s = _similarity(chunk)
        xyz = s * found.tie.xyz @ R.T + t if _system(chunk) == "local" else found.tie.xyz
    sigma = _accuracy(chunk, "accuracy_tiepoints", SIGMA_TIE_POINT)
    put_tie_points(draft, found.tie, found.cameras, found.markers.values(), xyz, sigma)
