"""AICON files: read and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.content import (
    Content,
    ContentTable,
    ImagePoints,
    block,
    content_of,
    frames,
    interior_values,
    not_carried,
    placed_points,
    points,
    rays_of_points,
)
from mor.formats.draft import Draft, Row, Written
from mor.formats.networks import groups
from mor.formats.recognition import FileLine, enough, numbers, read_words, stem_of
from mor.project.axes import image_scale, split
from mor.project.document import Document
from mor.project.schema import Camera, Datum
from mor.types import BoolArray, FloatArray
from mor.units import IMAGE

# ---- AICON 3D Studio flat files (``.ior .eor .obc .phc .scale``) as a project: millimetres, radians, camera model
# of MOR.
#
# The files do not say which interior parameters were estimated, nor with which σ the image coordinates entered (the
# σ columns of the ``.phc`` file are the precision of target measurement): what is assumed instead is told in notes.

_FREE = ("c", "xh", "yh", "A1", "A2", "B1", "B2")


def read_aicon(path: Path) -> Document:
    """The project of a folder, stem or file of AICON. Raises :class:`InputError` with every mistake found."""
    stem = stem_of(path)
    draft = Draft(str(path))
    draft.put("title", stem.name)
    draft.put("units", {"length": "mm", "angle": "rad"})
    cameras = _put_cameras(read_words(stem, ".ior", draft), draft)
    lines = read_words(stem, ".eor", draft)
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
            draft.problem(f"camera {camera!r} of image {name!r} is not in the .ior file", line.line, line.file)
        oriented: list[str | None] = [None] * 6 if state == "1" else [*pose]
        rows.append(Row([name, camera, *oriented], line.line))
    if rows:
        columns = ("id", "camera", "x", "y", "z", "omega", "phi", "kappa")
        draft.table("images", columns, rows, lines[0].file)
    images = {str(row.cells[0]) for row in rows}
    points = _put_points(read_words(stem, ".obc", draft), draft)
    _put_rays(read_words(stem, ".phc", draft), images, points, draft)
    _put_scales(read_words(stem, ".scale", draft), points, draft)
    return draft.finish()


def _put_cameras(lines: list[FileLine], draft: Draft) -> set[str]:
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


def _camera(block: list[FileLine]) -> dict[str, Any]:
    _, _, c, xh, yh, a1, a2, r0 = block[0].words[:8]
    (a3,), (b1, b2), (c1, c2) = (line.words[:n] for line, n in zip(block[1:4], (1, 2, 2), strict=True))
    width, _, columns, rows = block[4].words[:4]
    known = ("xh", "yh", "A1", "A2", "A3", "B1", "B2", "C1", "C2")
    values = dict(zip(known, (xh, yh, a1, a2, a3, b1, b2, c1, c2), strict=True))
    interior = {"c": repr(abs(float(c))), **values}
    return {
        "model": "mor",
        "unit": "mm",
        "image": {"width": columns, "height": rows, "pixel": f"{float(width) / float(columns)!r} mm"},
        "r0": r0,
        "interior": {key: {"free" if key in _FREE else "fixed": text} for key, text in interior.items()},
    }


def _put_points(lines: list[FileLine], draft: Draft) -> set[str]:
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


def _put_rays(lines: list[FileLine], images: set[str], points: set[str], draft: Draft) -> None:
    rows = []
    lost: dict[str, int] = {}
    file = lines[0].file if lines else ""
    for line in lines:
        if not enough(line, 11, "image point x y sx sy vx vy method status internal", draft):
            continue
        image, point, x, y = line.words[:4]
        if line.words[9] == "0" or not numbers(line, slice(2, 4), draft):
            continue
        unknown = f"image {image!r}" if image not in images else f"point {point!r}" if point not in points else ""
        if unknown:
            lost[unknown] = lost.get(unknown, 0) + 1
        else:
            rows.append(Row([image, point, x, y], line.line))
    draft.notes += [
        Message(f"{counted(count, 'ray')} not used: {name} is switched off or does not exist", file)
        for name, count in lost.items()
    ]
    # A-priori σ of image coordinates, mm.
    sigma = "0.0005"
    if rows:
        draft.note(f"σ = {sigma} mm for all image coordinates", file=file)
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, file, type="image", units="mm", values={"sigma": sigma})


def _put_scales(lines: list[FileLine], points: set[str], draft: Draft) -> None:
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
            draft.note(f"scale bar {first}-{second} not used: its points are not active", line.line, line.file)
    if rows:
        columns = ("from", "to", "distance", "sigma")
        draft.table("observations", columns, rows, lines[0].file, type="distance")


# ---- An image block as AICON 3D Studio's flat files: millimetres, radians, image coordinates in mm.


def write_aicon(document: Document, folder: Path, target: Path) -> Written:
    """The five files. Raises :class:`InputError` for cameras, names and poses that they cannot say."""
    content = content_of(document, folder)
    found = frames(content, "AICON's files")
    problems: list[Message] = []
    cameras, pixels = [], {}
    for name, camera in content.project.cameras.items():
        try:
            lines, pixels[name] = camera_lines(name, camera, content)
            cameras += lines
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
    names = (*content.project.cameras, *found.ids, *points(content).ids)
    problems += [
        Message(f"{name!r}: names in AICON's files have no blanks, # or quotes", document.file)
        for name in names
        if set(name) & set(" \t#'\"")
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(Message("AICON's files have no stereo rigs, heights and eccentricities", document.file))
    if not content.edge.right_handed:
        problems.append(content.place("axes").problem("AICON's files have right-handed axes"))
    if problems:
        raise InputError(problems)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    whole = block(content, "AICON's files", found, corner=False)
    places, without = placed_points(content, whole.points, "AICON's files")
    rays, gone = rays_of_points(content, whole.rays, places, "AICON's files")
    lengths = content.edge.metres * 1e3
    scales, lost = _scales(content, set(places.ids), lengths)
    files = {
        ".ior": cameras,
        ".eor": _images(found, lengths),
        ".obc": _points(places, rays, content, lengths),
        ".phc": _rays(rays, np.array([pixels[used[name]] for name in rays.images])),
        ".scale": scales,
    }
    stem = target.with_suffix("") if target.suffix in files else target
    notes = [*without, *gone, *not_carried(content, ("image", "distance"), (), "AICON's files")]
    partly = int((_known(places).any(axis=1) & ~_known(places).all(axis=1)).sum())
    for count, what in ((partly, "point with control in some components only"), (lost, "distance with heights")):
        if count:
            notes.append(Message(f"{counted(count, what)}: as if there were none", str(stem)))
    told = (
        "the files do not say which interior parameters are free, and no σ of image coordinates for the adjustment: "
        "those of the project stand in the columns of target measurement (.phc)"
    )
    notes.append(Message(told, str(stem)))
    texts = {stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()}
    return Written(texts, notes)


def camera_lines(name: str, camera: Camera, content: Content) -> tuple[list[str], float]:
    """Five lines, and the size of a pixel in mm. Raises ``ValueError``."""
    if camera.model != "mor" or camera.image_variant or camera.eccentricity:
        raise ValueError("AICON has model mor, without image-variant parameters and eccentricities")
    scale = image_scale(camera)
    if np.isnan(scale.size) or camera.image is None:
        raise ValueError("AICON's files need image: {width, height, pixel} with the size of a pixel in mm")
    per = scale.size / scale.pixel
    given = interior_values(camera, content.edge, scale)
    powers = {"A1": -2, "A2": -4, "A3": -6, "B1": -1, "B2": -1, "C1": 0, "C2": 0}
    value = {key: v * per ** powers.get(key, 1) for key, v in given.items()}
    r0 = content.edge.number(camera.r0 or "0", IMAGE, "", scale) * per
    size = [round(split(text)[0]) for text in (camera.image.width, camera.image.height)]

    def words(*keys: str) -> str:
        return " ".join(repr(value.get(key, 0.0)) for key in keys)

    first = f"{name} -999 {-value['c']!r} {words('xh', 'yh', 'A1', 'A2')} {r0!r}"
    sensor = " ".join(repr(scale.size * count) for count in size)
    last = f"{sensor} {size[0]} {size[1]}"
    return [first, words("A3"), words("B1", "B2"), words("C1", "C2"), last], scale.size


def _images(found: ContentTable, lengths: float) -> list[str]:
    """Poses; state 1 is an image without one."""
    lines = []
    for name, camera, pose in zip(found.ids, found.texts["camera"], found.values, strict=True):
        oriented = bool(np.isfinite(pose).all())
        numbers = [*(pose[:3] * lengths), *pose[3:]] if oriented else [0.0] * 6
        lines.append(f"{name} {camera} {_words(numbers)} 0 307 {3 if oriented else 1}")
    return lines


def _points(places: ContentTable, rays: ImagePoints, content: Content, lengths: float) -> list[str]:
    """Points: new ones, and known ones with their σ (0: fixed); flagged where they carry the datum."""
    count = Counter(rays.points)
    datum = content.project.datum
    chosen = {str(name) for name in datum.free} if isinstance(datum, Datum) and isinstance(datum.free, list) else set()
    lines = []
    for k, name in enumerate(places.ids):
        sigma, known = np.nan_to_num(places.statuses.sigma[k]), bool(_known(places)[k].all())
        numbers = places.statuses.values[k] if known else places.values[k]
        every = [*(np.nan_to_num(numbers) * lengths), *(sigma * lengths if known else np.zeros(3))]
        lines.append(f"{name} {_words(every)} {count[name]} 1 {int(not known)} {int(name in chosen)}")
    return lines


def _rays(rays: ImagePoints, pixel: FloatArray) -> list[str]:
    xy, sigma = rays.xy * pixel[:, None], np.nan_to_num(rays.sigma) * pixel[:, None]
    return [
        f"{image} {point} {_words([*xy[k], *sigma[k]])} 0 0 1 1 1"
        for k, (image, point) in enumerate(zip(rays.images, rays.points, strict=True))
    ]


def _scales(content: Content, points_: set[str], lengths: float) -> tuple[list[str], int]:
    """Distances between points as scale bars, and how many are not such."""
    lines: list[str] = []
    lost = 0
    for group in groups(content, ("distance",)):
        heights = sum(np.nan_to_num(group.rows.number(f"{end}_height")) != 0.0 for end in ("from", "to"))
        for row, (a, b) in enumerate(zip(group.rows.text("from"), group.rows.text("to"), strict=True)):
            if heights[row] or not {a, b} <= points_:
                lost += 1
                continue
            numbers = _words([group.values[row, 0] * lengths, group.sigma[row, 0] * lengths])
            lines.append(f'{len(lines)} "distance {len(lines) + 1}" {a} {b} {numbers} 1')
    return lines, lost


def _known(places: ContentTable) -> BoolArray:
    """(n, 3) true where a coordinate is fixed or observed."""
    return places.fixed | np.isfinite(places.statuses.sigma)


def _words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in numbers)
