"""Read PhotoModeler exports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.draft import Draft, Line, Row, parse_number, read_lines
from mor.model.rotations import rotation_from_angles
from mor.project.document import Document
from mor.types import FloatArray

# ---- Size of the images of an export that does not say it: worked out from the solution the export contains.


class ImagePoint(NamedTuple):
    """An image point: photo, point, px."""

    photo: str
    point: str
    x: float
    y: float


def image_size(
    camera: Sequence[float],
    poses: Mapping[str, Sequence[float]],
    points: Mapping[str, Sequence[float]],
    marks: Sequence[ImagePoint],
) -> tuple[int, int] | None:
    """Width and height in px, or ``None`` if the solution does not give them.

    The camera constant, the poses and the points say where in the format (mm) a point is seen, the mark where in the
    image (px): their ratio is the size of a pixel, and the format divided by it the number of pixels.

    ``camera`` is c xp yp, format width and height, K1 K2 K3 P1 P2; a pose X Y Z kappa phi omega in degrees.
    """
    known = [mark for mark in marks if mark.photo in poses and mark.point in points]
    if len(known) < 2:
        return None
    pose = np.array([poses[mark.photo] for mark in known])
    D = rotation_from_angles(np.radians(pose[:, [5, 4, 3]]))
    X = np.array([points[mark.point] for mark in known])
    star = np.einsum("nij,nj->ni", D, X - pose[:, :3])
    seen = star[:, 2] < 0.0
    if seen.sum() < 2:
        return None
    c, xp, yp, width, height, *distortion = camera
    ideal = -c * star[seen, :2] / star[seen, 2:]
    mm = _measured(ideal, np.array(distortion)) * [1.0, -1.0] + [xp, yp]
    px = np.array([[mark.x, mark.y] for mark in known])[seen]
    if not np.isfinite(mm).all():
        return None
    ratio = np.median(px / np.where(np.abs(mm) > 1e-9, mm, np.nan), axis=0)
    size = (round(float(width * ratio[0])), round(float(height * ratio[1]))) if np.all(ratio > 0) else (0, 0)
    within = (px > -1).all() and (px <= np.array(size) + 1).all()
    return size if min(size) > 0 and bool(within) else None


def _measured(corrected: FloatArray, distortion: FloatArray) -> FloatArray:
    """Measured coordinates (n, 2) whose correction (Brown) leads to the corrected ones, by iteration."""
    k1, k2, k3, p1, p2 = np.pad(distortion, (0, 5))[:5]
    xy = corrected.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(50):
            x, y = xy.T
            r2 = x * x + y * y
            radial = r2 * (k1 + r2 * (k2 + r2 * k3))
            dx = x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
            dy = y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
            xy = corrected - np.column_stack([dx, dy])
    return xy


# ---- The parts of a PhotoModeler text export, as numbers with their lines.


class PhotoRecord(NamedTuple):
    """A photo: X Y Z kappa phi omega, and c xp yp, format width and height, K1 K2 K3 P1 P2."""

    name: str
    pose: list[float]
    camera: list[float]
    line: int


class Export(NamedTuple):
    """A whole export; lists in the order of the file."""

    title: str
    size: tuple[float, float] | None
    """Image width and height, px, where the file says them."""
    sigma: float
    """σ of image points that have none, px."""
    camera: list[float]
    photos: list[PhotoRecord]
    control: list[Line]
    objects: list[Line]
    marks: list[Line]


def read_export(path: Path, draft: Draft) -> Export:
    """The parts of an export. Raises :class:`InputError` if its head is none."""
    lines = read_lines(path, draft)
    if len(lines) < 6:
        words = "this is not a PhotoModeler text export: found fewer than 6 lines"
        raise InputError([Message(words, draft.file, max(len(lines), 1))])
    general = _numbers(lines, 1, 2, "tolerance, iterations and, where known, image width and height in px", draft)
    defaults = _numbers(lines, 2, 1, "default σ of image points, control, points, poses", draft)
    camera = _numbers(lines, 3, 5, "c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
    photos, after = _photos(lines, draft)
    for values, line in [(camera or [], 4), *((photo.camera, photo.line + 4) for photo in photos)]:
        if values and min(values[3:5]) <= 0.0:
            draft.problem(f"found the format {values[3]:g} x {values[4]:g} mm, expected numbers above 0", line)
    if not photos:
        draft.problem("found no photo, expected a photo number and its file name", 6)
    if draft.problems or general is None or defaults is None or camera is None:
        draft.finish()
        raise AssertionError("problems end the reading")
    control, objects, marks = _lists(lines, after, 3)
    size = (general[2], general[3]) if len(general) >= 4 else None
    sigma = defaults[0] if defaults[0] > 0.0 else 1.0
    return Export(lines[0].strip(), size, sigma, _padded(camera), photos, control, objects, marks)


def _padded(camera: list[float]) -> list[float]:
    distortion = 5
    return (camera + [0.0] * distortion)[: 5 + distortion]


def _numbers(lines: list[str], index: int, count: int, form: str, draft: Draft) -> list[float] | None:
    words = lines[index].split()
    try:
        values = [parse_number(word) for word in words]
    except ValueError as error:
        draft.problem(str(error), index + 1)
        return None
    if len(values) < count:
        draft.problem(f"found {len(values)} numbers, expected {form}", index + 1)
        return None
    return values


def _photos(lines: list[str], draft: Draft) -> tuple[list[PhotoRecord], int]:
    """Photos of six lines each, and the index of the first line after them."""
    photos = []
    at = 5
    photo_lines = 6
    while at + photo_lines <= len(lines) and lines[at].split():
        pose = _numbers(lines, at + 1, 7, "photo X Y Z kappa phi omega", draft)
        camera = _numbers(lines, at + 4, 6, "photo c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
        if pose is not None and camera is not None:
            photos.append(PhotoRecord(lines[at].split()[0], pose[1:7], _padded(camera[1:]), at + 1))
        at += photo_lines
    return photos, at


def _lists(lines: list[str], start: int, count: int) -> list[list[Line]]:
    lists: list[list[Line]] = []
    for index in range(start, len(lines)):
        words = lines[index].split()
        if not words:
            if len(lists) == count:
                break
            lists.append([])
        elif lists:
            lists[-1].append(Line(words, index + 1))
    return lists + [[] for _ in range(count - len(lists))]


# ---- The text export of PhotoModeler as a project: metres, degrees, pixels from the upper left corner.
#
# A calibration project has its camera free (c, xh, yh and the distortion), every other one has it fixed; the
# ratio of the pixel sizes (the two sensor formats) is known in both.


def read_photomodeler(path: Path) -> Document:
    """The project of a PhotoModeler text export. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    export = read_export(path, draft)
    control = _rows(export.control, 4, 7, "id X Y Z sX sY sZ", draft)
    objects = _rows(export.objects, 4, 4, "id X Y Z", draft)
    marks = _marks(export, draft)
    if draft.problems:
        return draft.finish()
    draft.put("title", export.title)
    draft.put("units", {"length": "m", "angle": "deg"})
    control, objects = _once(control, "control point", draft), _once(objects, "point", draft)
    size = export.size or _worked_out(export, [*control, *objects], marks, draft)
    if size is None or min(size) <= 0.0:
        words = "found no image width and height (px) here, and the solution in the file does not give them; "
        draft.problem(words + "put them behind tolerance and iterations", 2)
        return draft.finish()
    used = _used(marks, {row.cells[0] for row in (*control, *objects)}, {p.name for p in export.photos}, draft)
    names = _put_cameras(export, size, draft)
    _put_photos(export.photos, names, {row.cells[0] for row in used}, draft)
    _put_points(control, objects, draft)
    if used:
        columns = ("image", "point", "x", "y", "sigma_x", "sigma_y")
        draft.table("observations", columns, used, type="image", units="px")
    return draft.finish()


def _rows(lines: list[Line], least: int, most: int, form: str, draft: Draft) -> list[Row]:
    """Names and numbers of a list; what is missing of σ stays empty."""
    rows = []
    for words, line in lines:
        if len(words) < least:
            draft.problem(f"found {len(words)} columns, expected {form}", line)
            continue
        with draft.at(line):
            for word in words[1:most]:
                parse_number(word)
            rows.append(Row([*words[:most], *[None] * (most - len(words))], line))
    return rows


def _marks(export: Export, draft: Draft) -> list[Row]:
    """Image points; a σ that is not above 0 (smart points, marks by hand) is the default of the file."""
    rows, replaced = [], 0
    for words, line in export.marks:
        if len(words) < 4:
            draft.problem(f"found {len(words)} columns, expected photo id x y sx sy", line)
            continue
        with draft.at(line):
            values = [parse_number(word) for word in words[2:6]]
            good = len(values) == 4 and min(values[2:]) > 0.0
            replaced += not good
            sigma: list[str | None] = [*words[4:6]] if good else [repr(export.sigma)] * 2
            rows.append(Row([*words[:4], *sigma], line))
    if replaced:
        words_ = f"{counted(replaced, 'image point')} without σ: σ = {export.sigma:g} px, the default of the file"
        draft.note(words_, 3)
    return rows


def _once(rows: list[Row], what: str, draft: Draft) -> list[Row]:
    """Rows of different names; one that is there again must say the same, and goes."""
    first: dict[str | None, Row] = {}
    for row in rows:
        known = first.setdefault(row.cells[0], row)
        if known is row:
            continue
        same = known.cells[:4] == row.cells[:4]
        words = f"{what} {row.cells[0]!r} is there already (line {known.line})"
        if same:
            draft.note(f"{words} and says the same", row.line)
        else:
            draft.note(f"{words} with other coordinates, which are not taken", row.line)
    return list(first.values())


def _worked_out(export: Export, points: list[Row], marks: list[Row], draft: Draft) -> tuple[float, float] | None:
    """Image size by the solution in the file."""
    seen = [ImagePoint(str(row.cells[0]), str(row.cells[1]), *map(float, map(str, row.cells[2:4]))) for row in marks]
    places = {str(row.cells[0]): [float(str(v)) for v in row.cells[1:4]] for row in points}
    size = image_size(export.camera, {photo.name: photo.pose for photo in export.photos}, places, seen)
    if size is not None:
        words = f"found no image size; {size[0]} x {size[1]} px is worked out from the solution in the file"
        draft.note(f"{words}, to some 10⁻⁴", 2)
    return size


def _used(marks: list[Row], points: set[str | None], photos: set[str], draft: Draft) -> list[Row]:
    pointless = [row for row in marks if row.cells[1] not in points]
    if pointless:
        words = f"{counted(len(pointless), 'image point')} of no point in the file not used"
        draft.note(f"{words}: the first is {pointless[0].cells[1]}", pointless[0].line)
    lost = [row for row in marks if row.cells[0] not in photos]
    if lost:
        words = f"{counted(len(lost), 'image point')} of no photo in the file not used"
        draft.note(f"{words}: the first is in {lost[0].cells[0]}", lost[0].line)
    return [row for row in marks if row.cells[1] in points and row.cells[0] in photos]


def _put_cameras(export: Export, size: tuple[float, float], draft: Draft) -> dict[str, str]:
    """One camera for all photos with the same values; a single one has the digits of the header. Camera by photo."""
    # Word in the title of a project whose camera is estimated.
    free = "calibration" in export.title.lower()
    distinct = list(dict.fromkeys(tuple(photo.camera) for photo in export.photos))
    names = {}
    cameras: dict[str, Any] = {}
    for number_, values in enumerate(distinct, start=1):
        mine = [photo for photo in export.photos if tuple(photo.camera) == values]
        names.update({photo.name: str(number_) for photo in mine})
        given = export.camera if len(distinct) == 1 else list(values)
        # One square pixel, its height; the width of pixels is expressed by b1, which also scales the
        # principal point.
        c, xp, yp, width, height, *distortion = given
        pixel = height / size[1]
        ratio = width / size[0] / pixel
        interior = {"c": c, "xh": xp / ratio - size[0] / 2.0 * pixel, "yh": height / 2.0 - yp}
        interior.update(zip(("K1", "K2", "K3", "P1", "P2"), distortion, strict=False))
        status = "free" if free else "fixed"
        cameras[str(number_)] = {
            "model": "brown",
            "unit": "mm",
            "coordinates": "corner",
            "image": {"width": f"{size[0]:g}", "height": f"{size[1]:g}", "pixel": f"{pixel!r} mm"},
            "interior": {
                **{key: {status: repr(float(value))} for key, value in interior.items()},
                "b1": {"fixed": f"{ratio - 1.0:.10g}"},
            },
        }
        draft.lines["cameras", str(number_)] = 4 if len(distinct) == 1 else mine[0].line
    if free:
        draft.note("a calibration project: c, xh, yh, K1, K2, K3, P1, P2 are free, b1 is fixed", 1)
    else:
        draft.note("no calibration project: the interior orientation is fixed; {free: …} in cameras frees it", 1)
    draft.put("cameras", cameras)
    return names


def _put_photos(photos: list[PhotoRecord], names: dict[str, str], used: set[str | None], draft: Draft) -> None:
    rows = []
    for photo in photos:
        if photo.name not in used:
            draft.note(f"photo {photo.name!r} has no image points and is left out", photo.line)
            continue
        x, y, z, kappa, phi, omega = (repr(float(value)) for value in photo.pose)
        pose: list[str | None] = [x, y, z, omega, phi, kappa] if any(photo.pose) else [None] * 6
        rows.append(Row([photo.name, names[photo.name], *pose], photo.line + 1))
    if rows:
        draft.table("images", ("id", "camera", "x", "y", "z", "omega", "phi", "kappa"), rows)


def _put_points(control: list[Row], objects: list[Row], draft: Draft) -> None:
    """Control points observed with their σ, object points free; without control the network is free.

    PhotoModeler writes a negative σ for control that was held, which 0 says here.
    """
    rows = [
        Row(
            [*row.cells[:4], *(cell if cell is not None and float(cell) > 0.0 else "0" for cell in row.cells[4:7])],
            row.line,
        )
        for row in control
    ]
    if rows:
        draft.table("points", ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), rows)
    if any(cell != "0" for row in rows for cell in row.cells[4:7]):
        words = "control points are observed where the export has them after its own adjustment, with their σ"
        draft.note(words, rows[0].line)
    known = {row.cells[0] for row in control}
    others = [row for row in objects if row.cells[0] not in known]
    if others:
        draft.table("points", ("id", "x", "y", "z"), others)
    if not control:
        draft.put("datum", "free")
