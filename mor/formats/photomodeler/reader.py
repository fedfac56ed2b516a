"""The text export of PhotoModeler as a project: metres, degrees, pixels from the upper left corner.

A calibration project has its camera free (c, xh, yh and the distortion), every other one has it fixed; the ratio of the
pixel sizes (the two sensor formats) is known in both.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mor.counting import counted
from mor.formats.draft import Draft, Row, number
from mor.formats.photomodeler.export import Export, Line, Photo, read_export
from mor.formats.photomodeler.image_size import Seen, image_size
from mor.project.file.nodes import Document

_DISTORTION = ("K1", "K2", "K3", "P1", "P2")
_CALIBRATION = "calibration"
"""Word in the title of a project whose camera is estimated."""


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
    used = _used(
        marks, {row.cells[0] for row in (*control, *objects)}, {p.name for p in export.photos}, draft
    )
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
        try:
            for word in words[1:most]:
                number(word)
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        rows.append(Row([*words[:most], *[None] * (most - len(words))], line))
    return rows


def _marks(export: Export, draft: Draft) -> list[Row]:
    """Image points; a σ that is not above 0 (smart points, marks by hand) is the default of the file."""
    rows, replaced = [], 0
    for words, line in export.marks:
        if len(words) < 4:
            draft.problem(f"found {len(words)} columns, expected photo id x y sx sy", line)
            continue
        try:
            values = [number(word) for word in words[2:6]]
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        good = len(values) == 4 and min(values[2:]) > 0.0
        replaced += not good
        sigma: list[str | None] = [*words[4:6]] if good else [repr(export.sigma)] * 2
        rows.append(Row([*words[:4], *sigma], line))
    if replaced:
        words_ = (
            f"{counted(replaced, 'image point')} without σ: σ = {export.sigma:g} px, the default of the file"
        )
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


def _worked_out(
    export: Export, points: list[Row], marks: list[Row], draft: Draft
) -> tuple[float, float] | None:
    """Image size by the solution in the file."""
    seen = [
        Seen(str(row.cells[0]), str(row.cells[1]), *map(float, map(str, row.cells[2:4]))) for row in marks
    ]
    places = {str(row.cells[0]): [float(str(v)) for v in row.cells[1:4]] for row in points}
    size = image_size(export.camera, {photo.name: photo.pose for photo in export.photos}, places, seen)
    if size is not None:
        words = f"found no image size; {size[0]} x {size[1]} px is worked out from the solution in the file"
        draft.note(f"{words}, to some 10⁻⁴", 2)
    return size


def _used(marks: list[Row], points: set[str | None], photos: set[str], draft: Draft) -> list[Row]:
    """Image points of points and photos that are there; the others are counted."""
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
    free = _CALIBRATION in export.title.lower()
    distinct = list(dict.fromkeys(tuple(photo.camera) for photo in export.photos))
    names = {}
    cameras: dict[str, Any] = {}
    for number_, values in enumerate(distinct, start=1):
        mine = [photo for photo in export.photos if tuple(photo.camera) == values]
        names.update({photo.name: str(number_) for photo in mine})
        given = export.camera if len(distinct) == 1 else list(values)
        cameras[str(number_)] = _camera(given, size, free)
        draft.lines["cameras", str(number_)] = 4 if len(distinct) == 1 else mine[0].line
    if free:
        draft.note("a calibration project: c, xh, yh, K1, K2, K3, P1, P2 are free, b1 is fixed", 1)
    else:
        draft.note(
            "no calibration project: the interior orientation is fixed; {free: …} in cameras frees it", 1
        )
    draft.put("cameras", cameras)
    return names


def _camera(values: list[float], size: tuple[float, float], free: bool) -> dict[str, Any]:
    """One square pixel, its height; the width of pixels is expressed by b1, which also scales the principal point."""
    c, xp, yp, width, height, *distortion = values
    pixel = height / size[1]
    ratio = width / size[0] / pixel
    interior = {"c": c, "xh": xp / ratio - size[0] / 2.0 * pixel, "yh": height / 2.0 - yp}
    interior.update(zip(_DISTORTION, distortion, strict=False))
    status = "free" if free else "fixed"
    return {
        "model": "brown",
        "unit": "mm",
        "coordinates": "corner",
        "image": {"width": f"{size[0]:g}", "height": f"{size[1]:g}", "pixel": f"{pixel!r} mm"},
        "interior": {
            **{key: {status: repr(float(value))} for key, value in interior.items()},
            "b1": {"fixed": f"{ratio - 1.0:.10g}"},
        },
    }


def _put_photos(photos: list[Photo], names: dict[str, str], used: set[str | None], draft: Draft) -> None:
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
    rows = [Row([*row.cells[:4], *(_sigma(cell) for cell in row.cells[4:7])], row.line) for row in control]
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


def _sigma(cell: str | None) -> str:
    return cell if cell is not None and float(cell) > 0.0 else "0"
