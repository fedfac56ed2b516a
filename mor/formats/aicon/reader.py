"""AICON 3D Studio flat files (``.ior .eor .obc .phc .scale``) as a project: millimetres, radians, camera model of MOR.

The files do not say which interior parameters were estimated, nor with which σ the image coordinates entered (the
σ columns of the ``.phc`` file are the precision of target measurement): what is assumed instead is told in notes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mor.counting import counted
from mor.errors import Problem
from mor.formats.aicon.files import Words, enough, numbers, read_words, stem_of
from mor.formats.draft import Draft, Row
from mor.project.file.nodes import Document

SIGMA = "0.0005"
"""A-priori σ of image coordinates, mm."""
_FREE = ("c", "xh", "yh", "A1", "A2", "B1", "B2")
_INTERIOR = ("xh", "yh", "A1", "A2", "A3", "B1", "B2", "C1", "C2")


def read_aicon(path: Path) -> Document:
    """The project of a folder, stem or file of AICON. Raises :class:`InputError` with every mistake found."""
    stem = stem_of(path)
    draft = Draft(str(path))
    draft.put("title", stem.name)
    draft.put("units", {"length": "mm", "angle": "rad"})
    cameras = _put_cameras(read_words(stem, ".ior", draft), draft)
    images = _put_images(read_words(stem, ".eor", draft), cameras, draft)
    points = _put_points(read_words(stem, ".obc", draft), draft)
    _put_rays(read_words(stem, ".phc", draft), images, points, draft)
    _put_scales(read_words(stem, ".scale", draft), points, draft)
    return draft.finish()


def _put_cameras(lines: list[Words], draft: Draft) -> set[str]:
    """Five lines each: identifier … c xh yh A1 A2 r0 / A3 / B1 B2 / C1 C2 / sensor and image size."""
    cameras: dict[str, Any] = {}
    sizes = (8, 1, 2, 2, 4)
    for first in range(0, len(lines), 5):
        block = lines[first : first + 5]
        if len(block) < 5 or any(len(line.words) < size for line, size in zip(block, sizes, strict=True)):
            form = "5 lines: id, internal, c xh yh A1 A2 r0 / A3 / B1 B2 / C1 C2 / sensor size, image size"
            draft.problem(f"a camera needs {form}", block[0].line, block[0].file)
            continue
        good = [numbers(line, slice(2 if k == 0 else 0, None), draft) for k, line in enumerate(block)]
        if not all(good):
            continue
        name = block[0].words[0]
        cameras[name] = _camera(block)
        draft.lines["cameras", name] = block[0].line
        draft.files["cameras", name] = block[0].file
        words = f"camera {name}: {', '.join(_FREE)} are free, all other interior parameters are fixed"
        draft.note(words, block[0].line, block[0].file)
    draft.put("cameras", cameras)
    return set(cameras)


def _camera(block: list[Words]) -> dict[str, Any]:
    _, _, c, xh, yh, a1, a2, r0 = block[0].words[:8]
    (a3,), (b1, b2), (c1, c2) = (line.words[:n] for line, n in zip(block[1:4], (1, 2, 2), strict=True))
    width, _, columns, rows = block[4].words[:4]
    values = dict(zip(_INTERIOR, (xh, yh, a1, a2, a3, b1, b2, c1, c2), strict=True))
    interior = {"c": repr(abs(float(c))), **values}
    return {
        "model": "mor",
        "unit": "mm",
        "image": {"width": columns, "height": rows, "pixel": f"{float(width) / float(columns)!r} mm"},
        "r0": r0,
        "interior": {key: {"free" if key in _FREE else "fixed": text} for key, text in interior.items()},
    }


def _put_images(lines: list[Words], cameras: set[str], draft: Draft) -> set[str]:
    rows = []
    form = "image camera X Y Z omega phi kappa rotation-order status state"
    for line in lines:
        if not enough(line, 11, form, draft) or not numbers(line, slice(2, 8), draft):
            continue
        name, camera, *pose = line.words[:8]
        order, status, state = line.words[8:11]
        if status == "0":
            draft.note(f"image {name!r} is switched off", line.line, line.file)
            continue
        if order != "0":
            words = f"rotation order {order} of image {name!r}: only 0 (omega, phi, kappa) is understood"
            draft.problem(words, line.line, line.file)
        if camera not in cameras:
            draft.problem(
                f"camera {camera!r} of image {name!r} is not in the .ior file", line.line, line.file
            )
        oriented: list[str | None] = [None] * 6 if state == "1" else [*pose]
        rows.append(Row([name, camera, *oriented], line.line))
    if rows:
        columns = ("id", "camera", "x", "y", "z", "omega", "phi", "kappa")
        draft.table("images", columns, rows, lines[0].file)
    return {str(row.cells[0]) for row in rows}


def _put_points(lines: list[Words], draft: Draft) -> set[str]:
    """Active points, new or known, and the datum: flagged points where they suffice, all points otherwise."""
    new, known, datum = [], [], []
    for line in lines:
        if not enough(line, 11, "id X Y Z sX sY sZ rays active new datum", draft):
            continue
        name, *values = line.words[:7]
        _, active, unknown, flag = line.words[7:11]
        if active != "0" and numbers(line, slice(1, 7), draft):
            if unknown != "0":
                new.append(Row([name, *values[:3]], line.line))
            else:
                known.append(Row([name, *values], line.line))
            datum += [name] if flag != "0" else []
    if new:
        draft.table("points", ("id", "x", "y", "z"), new, lines[0].file)
    if known:
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("points", columns, known, lines[0].file)
    if len(datum) >= 3:
        draft.put("datum", {"free": datum})
    elif new and len(known) < 3:
        draft.put("datum", "free")
        if datum:
            words = f"{counted(len(datum), 'datum point')} cannot carry a datum; all points carry it"
            draft.note(words, file=lines[0].file)
    return {str(row.cells[0]) for row in (*new, *known)}


def _put_rays(lines: list[Words], images: set[str], points: set[str], draft: Draft) -> None:
    rows = []
    lost: dict[str, int] = {}
    file = lines[0].file if lines else ""
    for line in lines:
        if not enough(line, 11, "image point x y sx sy vx vy method status internal", draft):
            continue
        image, point, x, y = line.words[:4]
        if line.words[9] == "0" or not numbers(line, slice(2, 4), draft):
            continue
        unknown = (
            f"image {image!r}" if image not in images else f"point {point!r}" if point not in points else ""
        )
        if unknown:
            lost[unknown] = lost.get(unknown, 0) + 1
        else:
            rows.append(Row([image, point, x, y], line.line))
    draft.notes += [
        Problem(f"{counted(count, 'ray')} not used: {name} is switched off or does not exist", file)
        for name, count in lost.items()
    ]
    if rows:
        draft.note(f"σ = {SIGMA} mm for all image coordinates", file=file)
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, file, type="image", units="mm", values={"sigma": SIGMA})


def _put_scales(lines: list[Words], points: set[str], draft: Draft) -> None:
    rows = []
    for line in lines:
        if not enough(line, 7, 'index "name" point point length σ active', draft):
            continue
        first, second, length, sigma, active = line.words[-5:]
        if active == "0" or not numbers(line, slice(-3, -1), draft):
            continue
        if first in points and second in points:
            rows.append(Row([first, second, length, sigma], line.line))
        else:
            draft.note(
                f"scale bar {first}-{second} not used: its points are not active", line.line, line.file
            )
    if rows:
        columns = ("from", "to", "distance", "sigma")
        draft.table("observations", columns, rows, lines[0].file, type="distance")
