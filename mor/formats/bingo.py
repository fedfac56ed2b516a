"""BINGO projects: read and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.content import (
    Content,
    Things,
    content_of,
    frames,
    given_points,
    image_tables,
    interior_values,
    not_carried,
    points,
    unit_of,
    with_undeclared,
)
from mor.formats.draft import Draft, Row, Written, parse_number, read_lines
from mor.formats.recognition import GROUND, IMAGES, ORIENTATIONS, bingo_angles, rotation_from_bingo
from mor.model.cameras import CAMERA_MODELS
from mor.model.rotations import angles_from_rotation, rotation_from_angles
from mor.project.axes import image_scale
from mor.project.document import Document
from mor.project.schema import Camera
from mor.start.bundle import ideal_rays
from mor.types import BoolArray, FloatArray
from mor.units import LENGTH_UNITS

# ------------------------------------------------------------
# Start values of ``itera.dat``: orientations of images and coordinates of points.
# ------------------------------------------------------------

_WIDEST = 0.1
"""Largest median angle (rad) between rays and what they see; beyond it orientations are in other axes or angles."""


@dataclass
class Orientations:
    """Poses (x, y, z in m, ω, φ, κ in gon) of images and places of points, as texts, by name."""

    poses: dict[str, list[str | None]] = field(default_factory=dict)
    points: dict[str, list[str | None]] = field(default_factory=dict)
    file: str = ""


def read_orientations(path: Path, draft: Draft) -> Orientations:
    """``ORIA image X Y Z φ ω κ camera`` (gon, φ primary) and ``CORD point X Y Z``; other records are counted."""
    known = Orientations(file=str(path))
    other: dict[str, list[int]] = {}
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or text.startswith(("*", "#")):
            continue
        kind = words[0].upper()
        count = {"ORIA": 6, "CORD": 3}.get(kind)
        if count is None:
            other.setdefault(kind[:8], []).append(line)
            continue
        try:
            if len(words) < 2 + count:
                raise ValueError(f"found {len(words)} words, expected {kind}, a name and {count} numbers")
            values = [parse_number(word) for word in words[2 : 2 + count]]
        except ValueError as error:
            draft.problem(str(error), line, str(path))
            continue
        if kind == "ORIA":
            known.poses[words[1]] = _pose(values)
        else:
            known.points[words[1]] = [repr(value) for value in values]
    for kind, lines in other.items():
        draft.note(f"{counted(len(lines), 'record')} {kind} not read", lines[0], str(path))
    return known


def _pose(values: Sequence[float]) -> list[str | None]:
    D = rotation_from_bingo(np.array([values[3:]]) * np.pi / 200.0)
    angles = angles_from_rotation(D)[0] * 200.0 / np.pi
    return [*(repr(value) for value in values[:3]), *(repr(value) for value in angles.tolist())]


def agreeing(
    known: Orientations,
    images: Mapping[str, Row],
    rays: Sequence[Row],
    cameras: Mapping[str, Sequence[float]],
    control: Mapping[str, Sequence[float]],
    draft: Draft,
) -> Orientations:
    """The start values where rays see their points, else nothing and a note that says so."""
    places = {**{n: [float(str(v)) for v in p] for n, p in known.points.items()}, **control}
    angles = _angles(known, images, rays, cameras, places)
    if not len(angles):
        return known
    if float(np.median(angles)) < _WIDEST:
        return known
    words = "orientations and image points contradict each other: orientations and points are computed again"
    draft.note(words, file=known.file)
    return Orientations(file=known.file)


def _angles(
    known: Orientations,
    images: Mapping[str, Row],
    rays: Sequence[Row],
    cameras: Mapping[str, Sequence[float]],
    places: Mapping[str, Sequence[float]],
) -> FloatArray:
    """Angles (n,), rad, between rays and directions to their points, where both are known."""
    seen: list[list[float]] = []
    for row in rays:
        image, point, x, y = (str(cell) for cell in row.cells)
        pose, camera = known.poses.get(image), cameras.get(str(images[image].cells[1]))
        if pose is not None and camera is not None and point in places:
            c, xh, yh = camera
            seen.append([float(x) - xh, float(y) - yh, -c, *places[point], *map(float, map(str, pose))])
    if not seen:
        return np.zeros(0)
    table = np.array(seen)
    angles = table[:, 9:] * np.pi / 200.0
    star = np.einsum("nij,nj->ni", rotation_from_angles(angles), table[:, 3:6] - table[:, 6:9])
    sine = np.linalg.norm(np.cross(table[:, :3], star), axis=1)
    between: FloatArray = np.arctan2(sine, np.einsum("ni,ni->n", table[:, :3], star))
    return between


# ------------------------------------------------------------
# BINGO: ``image.dat`` and ``geoin.dat`` of a folder as a project, with the start values of ``itera.dat``.
#
# Written from programs that read and write these files. The σ classes are described nowhere there, so none are read.
# ------------------------------------------------------------

SIGMA_IMAGE, SIGMA_CONTROL = "0.003", "0.02"
"""σ of image coordinates (mm) and of control (m): the records that are read have none."""
POSE = ("x", "y", "z", "omega", "phi", "kappa")


@dataclass
class Ground:
    """Content of ``geoin.dat``."""

    cameras: dict[str, tuple[list[str], int]] = field(default_factory=dict)
    """c, xh, yh by name, and the line."""
    control: list[Row] = field(default_factory=list)
    checks: list[Row] = field(default_factory=list)


def read_bingo(path: Path) -> Document:
    """The project of a folder of BINGO. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    folder = path if path.is_dir() else path.parent
    files = {file.name.lower(): file for file in sorted(folder.iterdir())}
    missing = [name for name in (IMAGES, GROUND) if name not in files]
    if missing:
        words = f"found no {' and no '.join(missing)} in this folder"
        raise InputError([Message(words, str(folder))])
    draft.put("title", folder.resolve().name)
    draft.put("units", {"length": "m", "angle": "gon"})
    ground = _read_ground(files[GROUND], draft)
    _put_cameras(ground, str(files[GROUND]), draft)
    images, rays = _read_images(files[IMAGES], ground, draft)
    known = Orientations()
    if ORIENTATIONS in files:
        known = read_orientations(files[ORIENTATIONS], draft)
        constants = {name: tuple(map(float, values)) for name, (values, _) in ground.cameras.items()}
        known = agreeing(known, images, rays, constants, _places(ground), draft)
    _put_images(files[IMAGES], images, rays, known, draft)
    _put_points(ground, rays, known, str(files[GROUND]), str(files[IMAGES]), draft)
    return draft.finish()


def _places(ground: Ground) -> dict[str, list[float]]:
    """Coordinates of control and check points."""
    return {
        str(row.cells[0]): [float(str(v)) for v in row.cells[1:4]]
        for row in (*ground.control, *ground.checks)
    }


def _read_ground(path: Path, draft: Draft) -> Ground:
    """``CAPA camera … c x0 y0``, ``CONT`` and ``CHCK point E N H``; other records are counted."""
    ground = Ground()
    other: dict[str, list[int]] = {}
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0] in ("*", "C") or text.startswith(("*", "#")):
            continue
        kind = words[0].upper()
        if kind not in ("CAPA", "CONT", "CHCK"):
            other.setdefault(kind[:8], []).append(line)
            continue
        least, form = (6, "CAPA camera type c x0 y0") if kind == "CAPA" else (5, f"{kind} point E N H")
        values = words[least - 3 : least]
        try:
            if len(words) < least:
                raise ValueError(f"found {len(words)} words, expected {form}")
            for word in values:
                parse_number(word)
            if kind == "CAPA" and parse_number(values[0]) <= 0.0:
                raise ValueError(f"found the camera constant {values[0]}, expected a number above 0")
        except ValueError as error:
            draft.problem(str(error), line, str(path))
            continue
        if kind == "CAPA":
            ground.cameras[words[1]] = values, line
        else:
            rows = ground.control if kind == "CONT" else ground.checks
            rows.append(Row([words[1], *values], line))
    for kind, lines in other.items():
        draft.note(f"{counted(len(lines), 'record')} {kind} not read", lines[0], str(path))
    if not ground.cameras:
        draft.problem("found no CAPA with a camera constant", 1, str(path))
    return ground


def _put_cameras(ground: Ground, file: str, draft: Draft) -> None:
    cameras: dict[str, Any] = {}
    for name, ((c, x, y), line) in ground.cameras.items():
        interior = {"c": {"fixed": c}, "xh": {"fixed": x}, "yh": {"fixed": y}}
        cameras[name] = {"model": "mor", "unit": "mm", "interior": interior}
        draft.lines["cameras", name] = line
        draft.files["cameras", name] = file
    draft.put("cameras", cameras)
    if cameras:
        draft.note("the interior orientation is fixed; additional parameters are not read", file=file)


def _read_images(path: Path, ground: Ground, draft: Draft) -> tuple[dict[str, Row], list[Row]]:
    """Blocks of an image with its camera, lines of point, x, y, and −99: images by name, image points."""
    images: dict[str, Row] = {}
    rays: list[Row] = []
    image = ""
    single = next(iter(ground.cameras), "")
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0].startswith(("#", "*")):
            continue
        if words[0] == "-99":
            image = ""
        elif not image:
            image = words[0]
            given = words[1] if len(words) > 1 else ""
            camera = given if given in ground.cameras else single
            if given != camera and len(ground.cameras) > 1:
                draft.problem(f"camera {given!r} of image {image!r} is in no CAPA", line, str(path))
            if image in images:
                draft.problem(f"image {image!r} is there already", line, str(path))
            images[image] = Row([image, camera], line)
        else:
            try:
                if len(words) < 3:
                    raise ValueError(f"found {len(words)} words, expected point x y")
                for word in words[1:3]:
                    parse_number(word)
            except ValueError as error:
                draft.problem(str(error), line, str(path))
                continue
            rays.append(Row([image, *words[:3]], line))
    if not rays and not draft.problems:
        draft.problem("found no image points", 1, str(path))
    return images, rays


def _put_images(
    path: Path, images: dict[str, Row], rays: list[Row], known: Orientations, draft: Draft
) -> None:
    if not rays or draft.problems:
        return
    columns = ("id", "camera", *POSE)
    rows = [Row([*row.cells, *known.poses.get(name, [None] * 6)], row.line) for name, row in images.items()]
    draft.table("images", columns, rows, str(path))
    draft.note(f"σ = {SIGMA_IMAGE} mm for all image coordinates", file=str(path))
    names = ("image", "point", "x", "y")
    values = {"sigma": SIGMA_IMAGE}
    draft.table("observations", names, rays, str(path), type="image", units="mm", values=values)


def _put_points(
    ground: Ground, rays: list[Row], start: Orientations, file: str, images: str, draft: Draft
) -> None:
    columns = ("id", "x", "y", "z")
    seen: dict[str, int] = {}
    for row in rays:
        seen.setdefault(str(row.cells[1]), row.line)
    if ground.control:
        values = {"sigma": SIGMA_CONTROL}
        draft.table("points", columns, ground.control, file, values=values, group="control")
        draft.note(f"control points are observed with σ = {SIGMA_CONTROL} m", ground.control[0].line, file)
    else:
        draft.put("datum", "free")
    known = {row.cells[0] for row in ground.control}
    others = [
        Row([name, *start.points.get(name, [None] * 3)], line)
        for name, line in seen.items()
        if name not in known
    ]
    if others:
        draft.table("points", columns, others, images)
    checks = [row for row in ground.checks if row.cells[0] in seen or row.cells[0] in known]
    if checks:
        values = {"sigma": SIGMA_CONTROL}
        names = ("point", "x", "y", "z")
        draft.table("checks", names, checks, file, type="coordinates", name="check points", values=values)
    if len(checks) < len(ground.checks):
        lost = len(ground.checks) - len(checks)
        draft.note(f"{counted(lost, 'check point')} in no image not used", ground.checks[0].line, file)


# ------------------------------------------------------------
# Image coordinates as programs of aerial triangulation take them: millimetres, without distortion.
# ------------------------------------------------------------

_PLAIN = ("c", "xh", "yh")


class RefinedCamera(NamedTuple):
    """A camera that has nothing but these, mm."""

    c: float
    xh: float
    yh: float
    corrected: bool
    """True if coordinates were freed of distortion."""


class RefinedPoints(NamedTuple):
    """Image points: names, mm from the image centre (y up), σ in mm; (n,), (n, 2)."""

    images: list[str]
    points: list[str]
    xy: FloatArray
    sigma: FloatArray


def refined(
    content: Content, used: dict[str, str], what: str
) -> tuple[dict[str, RefinedCamera], RefinedPoints]:
    """Cameras, and image points freed of what their interior orientations have besides c, xh, yh, as they start.

    ``used`` has the camera of each image. Raises :class:`InputError` for cameras without c, xh, yh or a size in mm,
    and for image points whose distortion cannot be taken away; ``what`` cannot say them.
    """
    problems: list[Message] = []
    cameras: dict[str, RefinedCamera] = {}
    for name, camera in content.project.cameras.items():
        try:
            cameras[name] = _camera(content, camera)
        except ValueError as error:
            words = f"camera {name}: {what} has c, xh and yh in mm: {error}"
            problems.append(content.place("cameras", name).problem(words))
    if problems:
        raise InputError(problems)
    found = _points(content, used, cameras)
    if not found.images:
        words = f"{what} has image blocks; this project has no image points"
        raise InputError([Message(words, content.document.file)])
    return cameras, found


def _millimetres(content: Content, camera: Camera) -> float:
    """Millimetres of a unit of the camera. Raises ``ValueError``."""
    scale = image_scale(camera, content.project.units)
    per = LENGTH_UNITS[scale.unit] / LENGTH_UNITS["mm"] if scale.unit in LENGTH_UNITS else scale.size
    if np.isnan(per):
        raise ValueError("it has no image: {width, height, pixel} with the size of a pixel in mm")
    return float(per)


def _camera(content: Content, camera: Camera) -> RefinedCamera:
    model = CAMERA_MODELS[camera.model]
    if tuple(component.name for component in model.components[:3]) != _PLAIN or not model.central:
        raise ValueError(f"model {camera.model} has others")
    if camera.image_variant or camera.eccentricity:
        raise ValueError("it has image-variant parameters or an eccentricity")
    per = _millimetres(content, camera)
    values = interior_values(camera, content.edge, image_scale(camera, content.project.units))
    distorted = any(value for name, value in values.items() if name not in _PLAIN)
    c, xh, yh = (values.get(name, 0.0) * per for name in _PLAIN)
    return RefinedCamera(c, xh, yh, distorted)


def _points(content: Content, used: dict[str, str], cameras: dict[str, RefinedCamera]) -> RefinedPoints:
    images: list[str] = []
    points: list[str] = []
    xys, sigmas = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for entry, rows, place in image_tables(content):
        image = rows.text("image")
        unknown = next((name for name in image if name not in used), None)
        if unknown is not None:
            raise InputError([place.problem(f"image {unknown!r} is not among the images")])
        given, sigma = given_points(entry, rows)
        names = np.array([used[name] for name in image])
        for name in dict.fromkeys(names.tolist()):
            camera, mine = content.project.cameras[name], names == name
            scale, per = (
                image_scale(camera, content.project.units),
                _millimetres(content, camera),
            )
            inside = scale.inwards(given[mine], unit_of(entry, "x", scale))
            if cameras[name].corrected:
                inside = _freed(content, camera, inside)
            if not np.isfinite(inside).all():
                words = f"camera {name}: the distortion of image points cannot be taken away"
                raise InputError([place.problem(words)])
            given[mine] = inside * per
            sigma[mine] *= scale.factor(unit_of(entry, "sigma", scale)) * per
        images += image
        points += rows.text("point")
        xys.append(given)
        sigmas.append(sigma)
    return RefinedPoints(images, points, np.concatenate(xys), np.concatenate(sigmas))


def _freed(content: Content, camera: Camera, xy: FloatArray) -> FloatArray:
    """Coordinates (n, 2) without distortion, in the unit of the camera; NaN if there is no ray."""
    model = CAMERA_MODELS[camera.model]
    scale = image_scale(camera, content.project.units)
    values = interior_values(camera, content.edge, scale)
    interior = np.array([values.get(component.name, 0.0) for component in model.components])
    constants = np.array(
        [
            content.edge.number(getattr(camera, constant.name) or "0", constant.quantity, "", scale)
            for constant in model.constants
        ]
    )
    every, all_constants = (np.tile(row, (len(xy), 1)) for row in (interior, constants))
    rays = ideal_rays(model, interior[None], np.zeros(len(xy), dtype=np.int64), all_constants, xy)
    back = model.project(rays, every, all_constants, xy).xy
    ideal: FloatArray = interior[1:3] - interior[0] * rays[:, :2] / rays[:, 2:]
    wrong = np.abs(back - xy).max(axis=1) > 1e-6 * interior[0]
    ideal[wrong] = np.nan
    return ideal


# ------------------------------------------------------------
# An image block as BINGO's files: metres, gon, image coordinates in mm without distortion.
# ------------------------------------------------------------


def write_bingo(document: Document, folder: Path, target: Path) -> Written:
    """``image.dat``, ``geoin.dat``, ``itera.dat`` in a folder. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    found, places = frames(content, "BINGO"), points(content)
    _refuse(content, found, places)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    cameras, rays = refined(content, used, "BINGO")
    places = with_undeclared(content, places, rays.points)
    known = known_points(places)
    metres = content.edge.metres
    files = {
        IMAGES: image_lines(found, rays),
        GROUND: [*_cameras(cameras), *_control(places, known, metres)],
        ORIENTATIONS: [*_orientations(found, metres), *_starts(places, known, metres)],
    }
    notes = not_carried(content, ("image",), (), "BINGO")
    notes += [Message(words, str(target)) for words in told(content, places, cameras, "BINGO")]
    texts = {target / name: "\n".join([*lines, ""]).encode() for name, lines in files.items()}
    return Written(texts, notes)


def _refuse(content: Content, found: Things, places: Things) -> None:
    file = content.document.file
    names = (*content.project.cameras, *found.ids, *places.ids)
    problems = [
        Message(f"{name!r}: names in BINGO's files have no blanks, and do not begin with #, * or -99", file)
        for name in names
        if not name or set(name) & set(" \t") or name[0] in "#*" or name == "-99"
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(Message("BINGO's files have no stereo rigs, heights and eccentricities", file))
    if not content.edge.right_handed:
        problems.append(content.place("axes").problem("BINGO's files have right-handed axes"))
    if problems:
        raise InputError(problems)


def told(content: Content, places: Things, cameras: dict[str, RefinedCamera], what: str) -> list[str]:
    """Notes about information that the files cannot hold."""
    some = places.fixed | np.isfinite(places.statuses.sigma)
    partly = int((some.any(axis=1) & ~some.all(axis=1)).sum())
    words = [f"{what}'s files have no σ and do not say which interior parameters are free"]
    if partly:
        words.append(
            f"{counted(partly, 'point')} with control in some components only: as if there were none"
        )
    corrected = [name for name, camera in cameras.items() if camera.corrected]
    if corrected:
        words.append(
            f"image points of {', '.join(corrected)} are written without their distortion as it starts"
        )
    return words


def known_points(places: Things) -> BoolArray:
    """(n,) true where all coordinates are fixed or observed."""
    return np.asarray((places.fixed | np.isfinite(places.statuses.sigma)).all(axis=1))


def image_lines(found: Things, rays: RefinedPoints) -> list[str]:
    """A block of each image: its name and camera, image points, −99."""
    by_image: dict[str, list[str]] = {name: [] for name in found.ids}
    for image, point, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        by_image[image].append(f"{point} {x!r} {y!r}")
    lines = []
    for name, camera in zip(found.ids, found.texts["camera"], strict=True):
        lines += [f"{name} {camera}", *by_image[name], "-99"]
    return lines


def _cameras(cameras: dict[str, RefinedCamera]) -> list[str]:
    return [f"CAPA {name} 0 {float(k.c)!r} {float(k.xh)!r} {float(k.yh)!r}" for name, k in cameras.items()]


def _control(places: Things, known: BoolArray, metres: float) -> list[str]:
    values = (places.statuses.values * metres).tolist()
    return [
        f"CONT {name} {x!r} {y!r} {z!r}"
        for name, (x, y, z), held in zip(places.ids, values, known, strict=True)
        if held
    ]


def _orientations(found: Things, metres: float) -> list[str]:
    lines = []
    angles = bingo_angles(rotation_from_angles(np.nan_to_num(found.values[:, 3:]))) * 200.0 / np.pi
    for name, camera, pose, three in zip(
        found.ids, found.texts["camera"], found.values, angles.tolist(), strict=True
    ):
        if np.isfinite(pose).all():
            numbers = [*(pose[:3] * metres).tolist(), *three]
            lines.append(f"ORIA {name} {' '.join(map(repr, numbers))} {camera}")
    return lines


def _starts(places: Things, known: BoolArray, metres: float) -> list[str]:
    return [
        f"CORD {name} {' '.join(map(repr, place))}"
        for name, place, held in zip(places.ids, (places.values * metres).tolist(), known, strict=True)
        if not held and bool(np.isfinite(place).all())
    ]
