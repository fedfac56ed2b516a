"""Metashape projects: read and written."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.colmap.model import MODELS, camera_from
from mor.formats.content import Content, ImageBlock, block, content_of, frames, interior_values, not_carried
from mor.formats.draft import (
    FLIP,
    Draft,
    Element,
    Row,
    Written,
    east_north_up,
    geocentric,
    parse_number,
    parse_xml,
    read_lines,
)
from mor.formats.recognition import TiePoints, is_project, project_tree, put_tie_points, read_tie_points
from mor.input_files import PROJECT, read_bytes
from mor.model.earth import east_north_up as horizon_axes
from mor.model.rotations import angles_by_tangent, angles_from_rotation, exponential, rotation_from_angles
from mor.project.axes import image_scale, split
from mor.project.document import Document
from mor.project.schema import Camera, Value
from mor.start.bundle import SimilarityOutcome, similarity
from mor.start.intersection import nearest_point
from mor.types import FloatArray

# ---- Sensors of Metashape as cameras, and back: frame cameras in model ``metashape``, with its own numbers.

NAMES = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")


class SensorError(ValueError):
    """A mistake in a sensor."""


def camera_of(sensor: Element) -> tuple[dict[str, Any], bool]:
    """A camera as a project file says it, and whether its interior is fixed.

    What Metashape estimated (the parameters of its covariance) is free; without that, all that is not 0. Raises
    :class:`SensorError`.
    """
    kind = sensor.attributes.get("type", "frame")
    if kind != "frame":
        raise SensorError(f"type {kind!r} has no counterpart in mor that says exactly the same (known: frame)")
    found = {c.attributes.get("class", "adjusted"): c for c in sensor.all("calibration")}
    calibration = found.get("adjusted") or found.get("initial") or next(iter(found.values()), None)
    size = next(iter((calibration.all("resolution") if calibration else []) + sensor.all("resolution")), None)
    if size is None:
        raise SensorError("found no resolution")
    width, height = (_number(size.attributes.get(key, ""), key) for key in ("width", "height"))
    if min(width, height) < 1.0:
        raise SensorError("found a resolution below 1 px")
    values = _values(calibration, sensor, width)
    held = any(
        p.attributes.get("name") == "fixed" and p.attributes.get("value") in ("true", "1")
        for p in sensor.all("property")
    )
    free = () if held else _estimated(calibration, values)
    interior = {
        name: {"free" if name in free else "fixed": repr(value)}
        for name, value in values.items()
        if value or name in free or name in ("f", "cx", "cy")
    }
    camera = {
        "model": "metashape",
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": f"{width:.0f}", "height": f"{height:.0f}"},
        "interior": interior,
    }
    return camera, not free


def _number(text: str, what: str) -> float:
    try:
        return parse_number(text)
    except ValueError as error:
        raise SensorError(f"{what}: {error}") from None


def _values(calibration: Element | None, sensor: Element, width: float) -> dict[str, float]:
    texts = {child.name: child.text.strip() for child in calibration.children} if calibration else {}
    values = {name: _number(texts[name], name) if texts.get(name) else 0.0 for name in NAMES}
    if texts.get("fx") and not texts.get("f"):
        fx, fy = _number(texts["fx"], "fx"), _number(texts.get("fy", texts["fx"]), "fy")
        values["f"], values["b1"] = fy, fx - fy
        for name, size in (("cx", "width"), ("cy", "height")):
            resolution = next(iter(calibration.all("resolution") if calibration else []), None)
            half = _number(resolution.attributes.get(size, "0"), size) / 2.0 if resolution else 0.0
            values[name] -= half if values[name] else 0.0
    if not values["f"]:
        values["f"] = _from_properties(sensor, width)
    if not 1e-6 < values["f"] < 1e9:
        raise SensorError(f"found the focal length {values['f']:g} px, expected it above 0")
    return values


def _from_properties(sensor: Element, width: float) -> float:
    """Focal length of a sensor without calibration: in mm by the size of a pixel, or the width of the image."""
    given = {p.attributes.get("name"): p.attributes.get("value", "") for p in sensor.all("property")}
    if given.get("focal_length") and given.get("pixel_width"):
        return _number(given["focal_length"], "focal_length") / (_number(given["pixel_width"], "pixel_width") or 1.0)
    return width


def _estimated(calibration: Element | None, values: dict[str, float]) -> tuple[str, ...]:
    if calibration is not None:
        for covariance in calibration.all("covariance"):
            for params in covariance.all("params"):
                return tuple(name for name in params.text.split() if name in NAMES)
    return tuple(name for name in NAMES if values[name] or name in ("f", "cx", "cy"))


# ---- Metashape's ``cameras.xml`` and ``markers.xml`` as a project: frame cameras, poses, markers with their
# projections.
#
# Camera axes are right, down, forward; a transform takes them to the chunk, that of the chunk to its
# coordinate system. Pixels count from the upper left corner of the upper left pixel (Agisoft, *Metashape User
# Manual*, appendices).

_OFF, _RIG, _UNSEEN = (
    "switched off or without a sensor",
    "of the other sensors of a rig",
    "in which no marker is measured",
)
"""Why images are not read."""
_SIGMA = {"markers": 0.005, "projections": 0.5, "cameras": 10.0, "tiepoints": 1.0}
"""σ of markers (m), their projections (px), camera positions (m), tie points (px) where the file has none: its own."""


@dataclass
class MetashapeChunk:
    """Content of a chunk."""

    cameras: dict[str, str] = field(default_factory=dict)
    """Name of each image by the number of its camera element."""
    unread: dict[str, str] = field(default_factory=dict)
    """Why images are not read, by the numbers of their camera elements."""
    markers: dict[str, str] = field(default_factory=dict)
    origin: FloatArray | None = None
    """Latitude, longitude and height about which coordinates are east, north and up."""
    markers_placed: dict[str, tuple[list[str | None], list[str | None], int]] = field(default_factory=dict)
    tie: TiePoints | None = None
    there: tuple[FloatArray, FloatArray, float] | None = None
    """Rotation, translation and scale from the chunk to the references."""
    observed: bool = False
    """True if positions or attitudes of images are observed."""
    posed: bool = False
    """True if poses are read."""


def read_metashape(path: Path) -> Document:
    """The project of a cameras.xml, a markers.xml, a .psz or .psx.

    Raises :class:`InputError` with every mistake found.
    """
    draft = Draft(str(path))
    own = is_project(path)
    root = project_tree(path) if own else parse_xml(read_bytes(path, PROJECT), draft.file)
    chunks = [root] if root.name == "chunk" else list(root.inside("chunk"))
    if not chunks:
        raise InputError([Message(f"found <{root.name}> without a <chunk>, expected Metashape's XML", draft.file, 1)])
    if len(chunks) > 1:
        draft.note(f"{len(chunks)} chunks: only the first one is read", chunks[1].line)
    chunk = chunks[0]
    if own:
        draft.note("lines are those of the doc.xml in the archives")
    draft.put("title", chunk.attributes.get("label", path.stem))
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    found = MetashapeChunk(tie=_tie_points(chunk, path, draft) if own else None)
    control = False
    with draft.at(chunk.line):
        _put_cameras(chunk, draft)
        found.origin = _origin(chunk)
        if found.origin is not None:
            said = ", ".join(
                f"{key} {v:.10g}" for key, v in zip(("latitude", "longitude", "altitude"), found.origin, strict=True)
            )
            draft.note(f"coordinates are east, north, up of the reference point: {said}", chunk.line)
        control = _read_markers(chunk, found, draft)
        control = _put_images(chunk, found, control, draft) or control
        rows = [Row([name, *place, *sigma], line) for name, (place, sigma, line) in found.markers_placed.items()]
        if rows:
            draft.table("points", ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), rows)
        _put_projections(chunk, found, draft)
        _put_tie_points(chunk, found, draft)
    if not control:
        draft.put("datum", "free")
    draft.put("settings", {"undetermined": "leave_out"})  # as Metashape, which leaves images without a pose alone
    return draft.finish()


def _section(chunk: Element, section: str, name: str) -> list[Element]:
    return [found for part in chunk.all(section) for found in part.inside(name)]


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
    values = [parse_number(word) for word in text.split()]
    if len(values) != count:
        raise ValueError(f"{what}: found {len(values)} numbers, expected {count}")
    return np.array(values)


def _transforms(chunk: Element) -> list[Element]:
    inner = [t for c in _section(chunk, "components", "component") for t in c.all("transform")]
    return chunk.all("transform") or inner[:1]


def _to_project(chunk: Element, origin: FloatArray | None) -> tuple[FloatArray, FloatArray, float] | None:
    """Rotation, translation and scale from the chunk to a local system or the horizon of an origin, else ``None``."""
    R, t, s = _similarity(chunk)
    if _system(chunk) == "local":
        return R, t, s
    if origin is None or not _transforms(chunk):
        return None
    turn = horizon_axes(*np.radians(origin[:2]))  # the transform leads to geocentric axes
    return turn @ R, turn @ (t - geocentric(origin[None])[0]), s


def _to_references(
    chunk: Element, found: MetashapeChunk, known: Mapping[str, tuple[list[str | None], list[str | None]]], draft: Draft
) -> tuple[FloatArray, FloatArray, float] | None:
    """Rotation, translation and scale from the chunk to references in a projection, for start values; else ``None``.

    Markers are intersected in the chunk, without distortions.
    """
    poses = {
        camera.attributes.get("id", ""): (_matrix(camera), camera) for camera in _section(chunk, "cameras", "camera")
    }
    rays: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for frame in _section(chunk, "frames", "frame"):
        for marker in _section(frame, "markers", "marker"):
            for location in marker.all("location"):
                T, camera = poses.get(location.attributes.get("camera_id", ""), (None, None))
                inner = draft.data["cameras"].get(camera.attributes.get("sensor_id", "")) if camera else None
                if T is None or inner is None:
                    continue
                f, cx, cy = (parse_number(next(iter(inner["interior"][name].values()))) for name in ("f", "cx", "cy"))
                size = (parse_number(inner["image"][name]) / 2.0 for name in ("width", "height"))
                x, y = (
                    parse_number(location.attributes.get(axis, "")) - half
                    for axis, half in zip("xy", size, strict=True)
                )
                ray = T[:3, :3] @ np.array([(x - cx) / f, (y - cy) / f, 1.0])
                rays.setdefault(found.markers.get(marker.attributes.get("marker_id", ""), ""), []).append(
                    (T[:3, 3], ray / np.linalg.norm(ray))
                )
    places = [
        (nearest_point(*map(np.array, zip(*rays[name], strict=True))), place)
        for name, (place, _, _) in found.markers_placed.items()
        if len(rays.get(name, ())) > 1
    ]
    places += [(T[:3, 3], known[key][0]) for key, (T, _) in poses.items() if T is not None and key in known]
    pairs = [(own, [parse_number(str(v)) for v in place]) for own, place in places if None not in place]
    if len(pairs) < 3:
        return None
    moved = similarity(*map(np.array, zip(*pairs, strict=True)))
    if moved.outcome is not SimilarityOutcome.DETERMINED:
        return None
    draft.note("poses are geocentric, references are not: the poses are fitted to them as start values", chunk.line)
    return moved.rotation, moved.translation, moved.scale


def _matrix(camera: Element) -> FloatArray | None:
    """Transform of a camera to the chunk with a rotation in it, ``None`` if it has none."""
    given = next(iter(camera.all("transform")), None)
    if given is None:
        return None
    T = _numbers(given.text, 16, f"transform of camera {camera.attributes.get('label', '')!r}").reshape(4, 4)
    if np.abs(T).max() > 1e30:
        raise ValueError(f"transform of camera {camera.attributes.get('label', '')!r}: found a number beyond 1e30")
    T[:3, :3] /= max(np.cbrt(abs(np.linalg.det(T[:3, :3]))), 1e-300)
    return T


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


def _system(chunk: Element, things: str = "") -> str:
    """Kind of the coordinate system of a chunk, or of its cameras or markers: local, projected or geographic."""
    own = [part.text for part in chunk.all(f"{things}_reference")] if things else []
    text = " ".join(own or (part.text for part in chunk.all("reference")))
    if "PROJCS" in text or "GEOCCS" in text:
        return "projected"
    return "geographic" if "GEOGCS" in text else "local"


def _origin(chunk: Element) -> FloatArray | None:
    """Latitude, longitude (degrees) and height of the first reference if all are geographic, else ``None``."""
    places = []
    for things in ("marker", "camera"):
        given = [ref for one in _section(chunk, f"{things}s", things) for ref in one.all("reference")]
        given = [ref for ref in given if all(axis in ref.attributes for axis in "xyz")]
        if given and _system(chunk, things) != "geographic":
            return None
        places += [np.array([parse_number(ref.attributes[axis]) for axis in "yxz"]) for ref in given[:1]]
    return places[0] if places else None


def _read_markers(chunk: Element, found: MetashapeChunk, draft: Draft) -> bool:
    """Markers with their reference coordinates (start values where switched off); true where some are control."""
    system, common = _system(chunk, "marker"), _accuracies(chunk, "markers")
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
            if system != "geographic" or found.origin is not None:
                place, sigma = _reference(given, common, found.origin)
                known = given.attributes.get("enabled", "true") in ("true", "1")
                sigma = sigma if known else [None] * 3
        control += any(text is not None for text in sigma)
        found.markers_placed[name] = place, sigma, marker.line
    if system == "geographic" and found.markers and found.origin is None:
        draft.note("coordinates of markers are longitude and latitude: not read; the network is free", chunk.line)
    if control:
        draft.note(f"{counted(control, 'marker')} with coordinates: observed, σ as the file says", chunk.line)
    return control >= 3


def _reference(
    given: Element, common: tuple[str, str], origin: FloatArray | None = None
) -> tuple[list[str | None], list[str | None]]:
    """Coordinates and σ; ``common`` in plan and in height where the element says none.

    Longitude, latitude and height become east, north and up about an ``origin``.
    """
    place = [given.attributes.get(axis) for axis in "xyz"]
    numbers = [0.0 if text is None else parse_number(text) for text in place]
    if origin is not None and abs(numbers[1]) > 90.0:
        raise ValueError(f"found the latitude {numbers[1]:g}, expected it between -90 and 90")
    if origin is not None:
        own = east_north_up(np.array([[numbers[1], numbers[0], numbers[2]]]), origin)[0]
        place = [None] * 3 if None in place else [repr(float(v)) for v in own]
    every = given.attributes.get("sxyz")
    plane, up = given.attributes.get("sxy") or every or common[0], every or common[1]
    sigma = [given.attributes.get(f"s{axis}") or (up if axis == "z" else plane) for axis in "xyz"]
    for text in sigma:
        if parse_number(text) < 0.0:
            raise ValueError(f"found the accuracy {text}, expected 0 or more")
    return place, [s if p is not None else None for s, p in zip(sigma, place, strict=True)]


def _accuracy(chunk: Element, things: str, default: float | None = None) -> str:
    for settings in chunk.all("settings"):
        for given in settings.all("property"):
            if (
                given.attributes.get("name") == f"accuracy_{things}"
                and parse_number(given.attributes.get("value", "")) > 0.0
            ):
                return given.attributes["value"]
    return repr(_SIGMA[things] if default is None else default)


def _accuracies(chunk: Element, things: str) -> tuple[str, str]:
    """σ of coordinates in plan and in height: one for both, or two."""
    both = float(_accuracy(chunk, things))
    return _accuracy(chunk, f"{things}_xy", both), _accuracy(chunk, f"{things}_z", both)


def _put_images(chunk: Element, found: MetashapeChunk, control: bool, draft: Draft) -> bool:
    """Images with projections of markers: poses in the chunk, or in the coordinate system of the markers.

    True if positions of three or more images are observed.
    """
    known = _positions(chunk, found.origin, draft)
    turned = _attitudes(chunk, known, draft)
    found.there = there = _to_project(chunk, found.origin)
    if there is None and (control or known):
        found.there = there = _to_references(chunk, found, known, draft)
    other = (control or bool(known)) and there is None
    seen = {
        location.attributes.get("camera_id", "")
        for frame in _section(chunk, "frames", "frame")
        for location in frame.inside("location")
    }
    seen |= {one.camera for one in found.tie.projections if len(one.points)} if found.tie else set()
    found.posed = not other
    found.observed = bool(known) or bool(turned)
    rows = []
    for camera in _section(chunk, "cameras", "camera"):
        if "id" not in camera.attributes or "sensor_id" not in camera.attributes:
            continue
        number_, sensor = camera.attributes["id"], camera.attributes["sensor_id"]
        if sensor not in draft.data["cameras"] or camera.attributes.get("enabled", "true") in ("false", "0"):
            found.unread[number_] = _OFF
            continue
        if camera.attributes.get("master_id", number_) != number_:
            found.unread[number_] = _RIG
            continue
        if seen and number_ not in seen:
            found.unread[number_] = _UNSEEN
            continue
        name = camera.attributes.get("label", "").strip() or f"camera {number_}"
        name = name if name not in found.cameras.values() else f"{name} ({number_})"
        found.cameras[number_] = name
        pose = [None, None, None, *_attitude(camera)] if other else _pose(there, camera, name)
        place, turn = _observed(pose[:3], known.get(number_)), _observed(pose[3:], turned.get(number_))
        rows.append(Row([name, sensor, *place[:3], *turn[:3], *place[3:], *turn[3:]], camera.line))
    used = {str(row.cells[1]) for row in rows}
    idle = [name for name in draft.data["cameras"] if name not in used]
    if rows and idle:
        draft.note(f"sensors {', '.join(idle)} have no image here: not read", chunk.line)
        draft.data["cameras"] = {k: v for k, v in draft.data["cameras"].items() if k in used}
    counts = Counter(found.unread.values())
    for why in (_OFF, _RIG, _UNSEEN):
        if counts[why]:
            draft.note(f"{counted(counts[why], 'image')} {why}: not read", chunk.line)
    if other:
        draft.note("poses are geocentric, references are not: the poses are not read", chunk.line)
    if rows:
        axes, angles = ("x", "y", "z"), ("omega", "phi", "kappa")
        more = [f"{what}{name}" for names in (axes, angles) for what in ("sigma_", "start_") for name in names]
        draft.table("images", ("id", "camera", *axes, *angles, *more), rows)
    return sum(row.cells[8] is not None for row in rows) >= 3


def _pose(there: tuple[FloatArray, FloatArray, float] | None, camera: Element, name: str) -> list[str | None]:
    """Position and ω, φ, κ of the transform of a camera, where it has one."""
    T = _matrix(camera)
    if T is None:
        return [None, None, None, *_attitude(camera)]
    R, t, s = there or (np.eye(3), np.zeros(3), 1.0)
    if max(np.abs(R).max(), np.abs(t).max(), abs(s)) > 1e30:
        raise ValueError(f"transform of camera {name!r}: found a number beyond 1e30")
    world, centre = R @ T[:3, :3], s * R @ T[:3, 3] + t
    numbers = [*centre, *angles_from_rotation(FLIP @ world.T)]
    return [repr(float(v)) for v in numbers] if np.isfinite(numbers).all() else [None] * 6


def _attitude(camera: Element) -> list[str | None]:
    """ω, φ, κ as start values, of yaw (clockwise from y), pitch (0 looks down, 90 ahead) and roll in degrees."""
    for given in camera.all("reference"):
        if (angles := _reference_angles(given)) is not None:
            return [repr(float(v)) for v in angles]
    return [None] * 3


def _reference_angles(given: Element) -> FloatArray | None:
    words = [given.attributes.get(name) for name in ("yaw", "pitch", "roll")]
    if None in words:
        return None
    yaw, pitch, roll = (np.radians(parse_number(str(word))) for word in words)
    turns = ([0.0, 0.0, -yaw], [pitch, 0.0, 0.0], [0.0, roll, 0.0])
    return angles_from_rotation(np.linalg.multi_dot([exponential(np.array(turn)) for turn in turns]).T)


def _attitudes(
    chunk: Element, known: Collection[str], draft: Draft
) -> dict[str, tuple[list[str | None], list[str | None]]]:
    """Observed ω, φ, κ with their σ, by the numbers of the cameras, if the settings say how accurate they are.

    The accuracy is that of a rotation about any axis, so σ of ω and κ grow with 1/cos φ; their correlation −sin φ is
    not kept. Only for images with an observed position in a local system: elsewhere yaw may refer to another north.
    """
    found: dict[str, tuple[list[str | None], list[str | None]]] = {}
    sigma = np.radians(float(_accuracy(chunk, "cameras_ypr", 0.0)))
    if not sigma or _system(chunk, "camera") != "local":
        return found
    for camera in _section(chunk, "cameras", "camera"):
        for given in camera.all("reference"):
            angles = _reference_angles(given)
            enabled = given.attributes.get("rotation_enabled", given.attributes.get("enabled", "true"))
            number = camera.attributes.get("id", "")
            # Images that look along the x axis more closely than 0.6° have no ω and κ that can be observed.
            if angles is None or number not in known or enabled not in ("true", "1") or np.cos(angles[1]) < 0.01:
                continue
            J = angles_by_tangent(angles)
            sigmas = sigma * np.sqrt((J**2).sum(axis=1))
            found[number] = ([repr(float(v)) for v in angles], [repr(float(v)) for v in sigmas])
    if found:
        words = f"attitudes of {counted(len(found), 'image')} are observed, σ = {np.degrees(sigma):g}° as the file says"
        draft.note(words, chunk.line)
    return found


def _positions(
    chunk: Element, origin: FloatArray | None, draft: Draft
) -> dict[str, tuple[list[str | None], list[str | None]]]:
    """Reference positions of cameras that are switched on, with their σ, by the numbers of the cameras."""
    found, common = {}, _accuracies(chunk, "cameras")
    for camera in _section(chunk, "cameras", "camera"):
        for given in camera.all("reference"):
            if given.attributes.get("enabled", "true") in ("true", "1") and "x" in given.attributes:
                found[camera.attributes.get("id", "")] = _reference(given, common, origin)
    if origin is None and found and _system(chunk, "camera") == "geographic":
        draft.note(f"positions of {counted(len(found), 'image')} are longitude and latitude: not read", chunk.line)
        return {}
    if found:
        said = common[0] if common[0] == common[1] else "/".join(common)
        words = f"positions of {counted(len(found), 'image')} are observed, σ as the file says, else {said} m"
        draft.note(words, chunk.line)
    return found


def _observed(pose: list[str | None], known: tuple[list[str | None], list[str | None]] | None) -> list[str | None]:
    """Position or angles, σ and start values: observed if they are known, starting where the transform has them."""
    if known is None:
        return [*pose, *[None] * 6]
    values, sigma = known
    return [*values, *sigma, *(s if v not in (None, s) else None for s, v in zip(pose, values, strict=True))]


def _put_projections(chunk: Element, found: MetashapeChunk, draft: Draft) -> None:
    rows, lost, rays = [], Counter[str](), Counter[str]()
    for frame in _section(chunk, "frames", "frame"):
        for marker in _section(frame, "markers", "marker"):
            name = found.markers.get(marker.attributes.get("marker_id", ""))
            for location in marker.all("location"):
                number = location.attributes.get("camera_id", "")
                image = found.cameras.get(number)
                if name is None or image is None:
                    lost[found.unread.get(number, "") if name is not None else ""] += 1
                    continue
                rays[image] += 1
                xy = [location.attributes.get(axis, "") for axis in "xy"]
                for text in xy:
                    parse_number(text)
                rows.append(Row([image, name, *xy], location.line))
    for why, count in lost.items():
        words = f"in images {why}" if why else "of markers or images that are not there"
        draft.note(f"{counted(count, 'projection')} {words}: not read", chunk.line)
    if lost[_RIG] and max(rays.values(), default=0) < 3 and found.tie is None and not found.observed:
        draft.problem(
            f"no image has 3 projections of markers that are read, so none can be oriented; "
            f"{counted(lost[_RIG], 'projection')} are in images {_RIG}, which are not read",
            chunk.line,
        )
    sigma = _accuracy(chunk, "projections")
    if rows:
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, type="image", units="px", values={"sigma": sigma})
    elif found.tie is None:
        draft.note("the file has no projections of markers: export the markers, too; tie points are in neither")


def _tie_points(chunk: Element, path: Path, draft: Draft) -> TiePoints | None:
    clouds = [cloud for cloud in chunk.inside("point_cloud") if cloud.all("projections")]
    if not clouds:
        draft.note("the project has no tie points: its photographs are not aligned", chunk.line)
        return None
    return read_tie_points(clouds[0], path)


def _put_tie_points(chunk: Element, found: MetashapeChunk, draft: Draft) -> None:
    if found.tie is None:
        return
    xyz = None
    if found.posed:
        R, t, s = found.there or (np.eye(3), np.zeros(3), 1.0)
        xyz = s * found.tie.xyz @ R.T + t
    sigma = _accuracy(chunk, "tiepoints")
    put_tie_points(draft, found.tie, found.cameras, found.markers.values(), xyz, sigma)


# ---- Metashape's reference pane as text: markers or cameras with coordinates, accuracies and whether they are used.
#
# A line ``# CoordinateSystem:`` may stand before the header, whose names begin with ``#Label`` (Agisoft,
# *Metashape User Manual*, "Reference pane", export and import of reference data). Estimated values and errors
# are left out.

_COLUMNS = {
    "label": "id",
    "x/easting": "x",
    "y/northing": "y",
    "z/altitude": "z",
    "accuracy_x_(m)": "sigma_x",
    "accuracy_y_(m)": "sigma_y",
    "accuracy_z_(m)": "sigma_z",
    "accuracy_(m)": "sigma",
    "accuracy": "sigma",
    "enable": "on",
    "enabled": "on",
    "yaw": "yaw",
}
_AXES = ("x", "y", "z")


def read_reference(path: Path) -> Document:
    """Points, or positions of images, that other files name. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    lines = read_lines(path, draft)
    at = next(
        (k for k, text in enumerate(lines) if (re.match(r"#?\s*label\s*[,;\t]\s*x/", text, re.IGNORECASE) is not None)),
        None,
    )
    if at is None:
        words = "found no header, expected #Label,X/Easting,Y/Northing,Z/Altitude as Metashape exports it"
        raise InputError([Message(words, draft.file, 1)])
    sign = next(sign for sign in "\t;," if sign in lines[at])
    decimal = sign != "," and any(re.search(r"\d,\d", text) for text in lines[at + 1 :])
    names = [name.strip().lower().lstrip("#").strip() for name in lines[at].split(sign)]
    named_geographic = ("x/longitude", "y/latitude")
    if any(name in named_geographic for name in names) or any("GEOGCS" in text[:80] for text in lines[: at + 1]):
        words = "the coordinates are longitude and latitude: export them in a projected or local system"
        raise InputError([Message(words, draft.file, at + 1)])
    columns = {_COLUMNS[name]: k for k, name in enumerate(names) if name in _COLUMNS}
    if "id" not in columns:
        raise InputError([Message(f"found no column Label, but {', '.join(names)}", draft.file, at + 1)])
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "deg"})
    draft.put("axes", {"xy": "en"})
    cells: list[tuple[int, list[str]]] = []
    for line, text in enumerate(lines[at + 1 :], start=at + 2):
        if text.lower().replace(" ", "").startswith(("#cameras", "#markers", "#scalebars")):
            draft.note("another table begins here: only the first one is read", line)
            break
        if text.startswith("#") or not text.replace(sign, "").strip():
            continue
        row = next(csv.reader([text], delimiter=sign))
        cells.append((line, [cell.replace(",", ".") if decimal and k else cell for k, cell in enumerate(row)]))
    _put(cells, columns, names, draft)
    if decimal:
        draft.note("numbers have decimal commas", at + 2)
    return draft.finish()


def _put(cells: list[tuple[int, list[str]]], columns: dict[str, int], names: list[str], draft: Draft) -> None:
    labels = [row[columns["id"]].strip() for _, row in cells if len(row) > columns["id"]]
    image = re.compile(r"\.(jpe?g|tiff?|png|dng|nef|cr2|arw|raw|iiq)$", re.IGNORECASE)
    cameras = "yaw" in columns or (bool(labels) and all(image.search(name) for name in labels))
    default = repr(_SIGMA["cameras" if cameras else "markers"])
    rows, off, twice = [], 0, set()
    for line, row in cells:
        given = {name: row[k].strip() for name, k in columns.items() if k < len(row)}
        name = given.get("id", "")
        with draft.at(line):
            place = _place(given)
            sigma = [_sigma(given, axis, default) if place[k] is not None else None for k, axis in enumerate(_AXES)]
            if not name and not any(place):
                continue  # the line of the total error
            if not name or name in twice:
                draft.problem(f"label {name!r} is there twice" if name else "the label is missing", line)
                continue
            twice.add(name)
            used = given.get("on", "1").lower() not in ("0", "false")
            off += not used
            if any(text is not None for text in place):
                rows.append(Row([name, *place, *(sigma if used else [None] * 3)], line))
    if off:
        draft.note(f"{counted(off, 'label')} switched off: coordinates without a σ")
    left = [name for name in names if name and name not in _COLUMNS]
    if left:
        draft.note(f"columns not read: {', '.join(left)}")
    if not {"accuracy", "accuracy_(m)", "accuracy_x_(m)"} & set(names):
        draft.note(f"σ = {default} m for all coordinates: the file says none")
    if rows:
        section = "images" if cameras else "points"
        draft.table(section, ("id", *_AXES, *(f"sigma_{axis}" for axis in _AXES)), rows)
    else:
        draft.problem("there are no coordinates")


def _place(given: dict[str, str]) -> list[str | None]:
    place: list[str | None] = [given.get(axis) or None for axis in _AXES]
    for text in place:
        if text is not None:
            parse_number(text)
    return place


def _sigma(given: dict[str, str], axis: str, default: str) -> str:
    """σ of a coordinate; one number for all, or two or three with / between them, as the pane shows them."""
    own = given.get(f"sigma_{axis}") or ""
    parts = (given.get("sigma") or "").split("/")
    text = own or (parts[0] if len(parts) == 1 else parts[min(_AXES.index(axis), len(parts) - 1)]).strip()
    if len(parts) == 2 and not own:
        text = parts[1 if axis == "z" else 0].strip()
    if not text:
        return default
    if parse_number(text) < 0.0:
        raise ValueError(f"found the accuracy {text}, expected 0 or more")
    return text


# ---- An image block as Metashape's XML: sensors, cameras, and points as markers with their projections.


def write_metashape(document: Document, folder: Path, target: Path) -> Written:
    """One XML file. Raises :class:`InputError` for cameras that Metashape cannot say, and images without a pose."""
    content = content_of(document, folder)
    problems: list[Message] = []
    sensors = []
    for number, (name, camera) in enumerate(content.project.cameras.items()):
        try:
            sensors.append(_sensor(number, name, camera, content))
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
    found = frames(content, "Metashape's XML")
    if np.isnan(found.values).any():
        words = "there are images without a pose of their own; convert an adjusted project (adjusted.yaml)"
        problems.append(Message(words, document.file))
    if problems:
        raise InputError(problems)
    names = list(content.project.cameras)
    cameras = [
        f'<camera id="{k}" sensor_id="{names.index(found.texts["camera"][k])}" label={quoteattr(name)} enabled="true">'
        f"<transform>{_transform(found.values[k])}</transform></camera>"
        for k, name in enumerate(found.ids)
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<document version="2.0.0">',
        f'<chunk label={quoteattr(content.project.title or "mor")} enabled="true">',
        "<sensors>", *sensors, "</sensors>",
        "<cameras>", *cameras, "</cameras>",
        *_markers(block(content, "Metashape's XML", found)),
        "</chunk>", "</document>",
    ]  # fmt: skip
    notes = not_carried(content, ("image",), (), "Metashape's XML")
    notes.append(Message("points are written as markers, and σ of image points are lost", str(target)))
    return Written({target: ("\n".join(lines) + "\n").encode()}, notes)


def _transform(pose: np.ndarray) -> str:
    """Camera axes (right, down, forward) to the object system, row by row."""
    T = np.eye(4)
    T[:3, :3] = rotation_from_angles(pose[3:]).T @ FLIP
    T[:3, 3] = pose[:3]
    return " ".join(repr(v) for v in T.ravel().tolist())


def _sensor(number: int, name: str, camera: Camera, content: Content) -> str:
    values, free = interior_of(camera, content)
    if camera.image is None:
        raise ValueError("it has no image: {width, height}, which Metashape needs")
    width, height = (round(split(text)[0]) for text in (camera.image.width, camera.image.height))
    size = f'<resolution width="{width}" height="{height}"/>'
    numbers = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
    params = f"<covariance><params>{' '.join(free)}</params></covariance>" if free else ""
    fixed = "false" if free else "true"
    return (
        f'<sensor id="{number}" label={quoteattr(name)} type="frame">{size}<property name="fixed" value="{fixed}"/>'
        f'<calibration type="frame" class="adjusted">{size}{numbers}{params}</calibration></sensor>'
    )


def interior_of(camera: Camera, content: Content) -> tuple[dict[str, float], list[str]]:
    """Metashape's numbers and the names of the free ones. Raises ``ValueError`` where they say something else."""
    free = [k for k, s in camera.interior.items() if isinstance(s, Value) and s.fixed is None and s.sigma != "0"]
    if camera.model == "metashape":
        scale = image_scale(camera)
        pixel = 1.0 if np.isnan(scale.pixel) else scale.pixel
        given = interior_values(camera, content.edge, scale)
        values = {name: value / (pixel if name in NAMES[:5] else 1.0) for name, value in given.items()}
        return values, free
    theirs = camera_from(1, camera, content.edge, "Metashape")
    given = dict(zip(MODELS[theirs.model].parameters, theirs.parameters, strict=True))
    if theirs.model == "OPENCV_FISHEYE" or any(given.get(f"k{k}") for k in (4, 5, 6)):
        raise ValueError("Metashape's frame camera cannot say the same")
    fy = given.get("fy", given.get("f", 0.0))
    values = {"f": fy, "cx": given["cx"] - theirs.width / 2.0, "cy": given["cy"] - theirs.height / 2.0}
    values["b1"] = given.get("fx", fy) - fy
    values.update({k: given[k] for k in ("k1", "k2", "k3") if k in given})
    values.update({"p1": given.get("p2", 0.0), "p2": given.get("p1", 0.0)} if "p1" in given else {})
    held = not free
    return values, [] if held else [k for k in values if k not in ("cx", "cy", "b1") or values[k]]


def _markers(whole: ImageBlock) -> list[str]:
    found, rays, ids = whole.points, whole.rays, whole.images.ids
    lines = ["<markers>"]
    for k, name in enumerate(found.ids):
        known = (~found.statuses.free[k] | np.isfinite(found.statuses.sigma[k])).all()
        reference = ""
        if np.isfinite(found.values[k]).all():
            sigma = np.nan_to_num(found.statuses.sigma[k]).tolist()
            numbers = found.statuses.values[k] if known else found.values[k]
            inside = [f'{axis}="{value!r}"' for axis, value in zip("xyz", numbers.tolist(), strict=True)]
            inside += [f's{axis}="{value!r}"' for axis, value in zip("xyz", sigma, strict=True)] if known else []
            reference = f'<reference {" ".join(inside)} enabled="{"true" if known else "false"}"/>'
        lines.append(f'<marker id="{k}" label={quoteattr(name)}>{reference}</marker>')
    lines += ["</markers>", '<frames><frame id="0"><markers>']
    image, point = ({name: k for k, name in enumerate(names)} for names in (ids, found.ids))
    seen: dict[int, list[str]] = {}
    for a, b, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        location = f'<location camera_id="{image[a]}" pinned="true" x="{x!r}" y="{y!r}"/>'
        seen.setdefault(point[b], []).append(location)
    lines += [f'<marker marker_id="{k}">{"".join(found_)}</marker>' for k, found_ in seen.items()]
    return [*lines, "</markers></frame></frames>"]
