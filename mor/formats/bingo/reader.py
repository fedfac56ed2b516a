"""BINGO: ``image.dat`` and ``geoin.dat`` of a folder as a project, with the start values of ``itera.dat``.

Written from programs that read and write these files. The σ classes are described nowhere there, so none are read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.bingo.files import GROUND, IMAGES, ORIENTATIONS
from mor.formats.bingo.orientations import Orientations, agreeing, read_orientations
from mor.formats.draft import Draft, Row, number
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

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
        raise InputError([Problem(words, str(folder))])
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
                number(word)
            if kind == "CAPA" and number(values[0]) <= 0.0:
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
                    number(word)
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
