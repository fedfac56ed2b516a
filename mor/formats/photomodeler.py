"""The text export of PhotoModeler as a project: metres, degrees, pixels from the upper left corner.

The export does not say which camera parameters were estimated: c, xh, yh and the distortion are taken as free, the
ratio of the pixel sizes (the two sensor formats) as known.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.input_files import read_text
from mor.project.file.nodes import Document

_PHOTO_LINES = 6
_DISTORTION = ("K1", "K2", "K3", "P1", "P2")


def read_photomodeler(path: Path) -> Document:
    """The project of a PhotoModeler text export. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    lines = read_text(path, errors="replace").split("\n")
    if len(lines) < 5:
        raise InputError(
            [Problem("this is no PhotoModeler text export: found fewer than 5 lines", draft.file)]
        )
    general = _numbers(lines, 1, 4, "tolerance, iterations, image width and height in px", draft)
    camera = _numbers(lines, 3, 10, "c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
    photos, after = _photos(lines, draft)
    if general is None or camera is None or not photos:
        if not photos:
            draft.problem("found no photo, expected a photo number and its file name", 6)
        return draft.finish()
    draft.put("title", lines[0].strip())
    draft.put("units", {"length": "m", "angle": "deg"})
    size = (general[2], general[3])
    names = _put_cameras(photos, camera, size, draft)
    _put_photos(photos, names, draft)
    control, objects, rays = _sections(lines, after, 3)
    _put_points(_rows(control, 7, "id X Y Z sX sY sZ", draft), _rows(objects, 4, "id X Y Z", draft), draft)
    rows = _rows(rays, 6, "photo id x y sx sy", draft)
    if rows:
        draft.table(
            "observations", ("image", "point", "x", "y", "sigma_x", "sigma_y"), rows, type="image", units="px"
        )
    return draft.finish()


Lines = list[tuple[int, list[str]]]


def _numbers(lines: list[str], index: int, count: int, form: str, draft: Draft) -> list[float] | None:
    words = lines[index].split()
    try:
        values = [number(word) for word in words]
    except ValueError as error:
        draft.problem(str(error), index + 1)
        return None
    if len(values) < count:
        draft.problem(f"found {len(values)} numbers, expected {form}", index + 1)
        return None
    return values


def _photos(lines: list[str], draft: Draft) -> tuple[list[tuple[int, str, list[float], list[float]]], int]:
    """Line, name, pose (7) and camera (11) of each photo, with the index of the first line after them."""
    photos = []
    at = 5
    while at + _PHOTO_LINES <= len(lines) and len(lines[at].split()) >= 2:
        pose = _numbers(lines, at + 1, 7, "photo X Y Z kappa phi omega", draft)
        camera = _numbers(lines, at + 4, 11, "photo c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
        if pose is not None and camera is not None:
            photos.append((at + 1, lines[at].split()[0], pose, camera))
        at += _PHOTO_LINES
    return photos, at


def _put_cameras(
    photos: list[tuple[int, str, list[float], list[float]]],
    header: list[float],
    size: tuple[float, float],
    draft: Draft,
) -> dict[str, str]:
    """One camera for all photos with the same values; a single one has the digits of the header. Camera by photo."""
    distinct = list(dict.fromkeys(tuple(camera[1:]) for *_, camera in photos))
    names = {}
    cameras: dict[str, Any] = {}
    for number_, values in enumerate(distinct, start=1):
        mine = [(line, name) for line, name, _, camera in photos if tuple(camera[1:]) == values]
        names.update({name: str(number_) for _, name in mine})
        cameras[str(number_)] = _camera(header if len(distinct) == 1 else list(values), size)
        draft.lines["cameras", str(number_)] = 4 if len(distinct) == 1 else mine[0][0]
    draft.note(
        "c, xh, yh, K1, K2, K3, P1, P2 of every camera are free, the ratio of its pixel sizes is fixed", 4
    )
    draft.put("cameras", cameras)
    return names


def _camera(values: list[float], size: tuple[float, float]) -> dict[str, Any]:
    """One square pixel, its height; the width of pixels is expressed by b1, which also scales the principal point."""
    c, xp, yp, width, height, *distortion = values
    pixel = height / size[1]
    ratio = width / size[0] / pixel
    interior = {"c": c, "xh": xp / ratio - size[0] / 2.0 * pixel, "yh": height / 2.0 - yp}
    interior.update(zip(_DISTORTION, distortion, strict=False))
    return {
        "model": "brown",
        "unit": "mm",
        "coordinates": "corner",
        "image": {"width": f"{size[0]:g}", "height": f"{size[1]:g}", "pixel": f"{pixel!r} mm"},
        "interior": {
            **{key: {"free": repr(float(value))} for key, value in interior.items()},
            "b1": {"fixed": f"{ratio - 1.0:.10g}"},
        },
    }


def _put_photos(
    photos: list[tuple[int, str, list[float], list[float]]], names: dict[str, str], draft: Draft
) -> None:
    rows = []
    for line, name, pose, _ in photos:
        _, x, y, z, kappa, phi, omega = (repr(float(value)) for value in pose[:7])
        rows.append(Row([name, names[name], x, y, z, omega, phi, kappa], line + 1))
    draft.table("images", ("id", "camera", "x", "y", "z", "omega", "phi", "kappa"), rows)


def _sections(lines: list[str], start: int, count: int) -> list[Lines]:
    """Groups of lines, each after one empty line."""
    sections: list[Lines] = []
    for index in range(start, len(lines)):
        words = lines[index].split()
        if not words:
            if len(sections) == count:
                break
            sections.append([])
        elif sections:
            sections[-1].append((index + 1, words))
    return sections + [[] for _ in range(count - len(sections))]


def _rows(section: Lines, count: int, form: str, draft: Draft) -> list[Row]:
    rows = []
    for line, words in section:
        if len(words) < count:
            draft.problem(f"found {len(words)} columns, expected {form}", line)
            continue
        try:
            for word in words[2 if form.startswith("photo") else 1 : count]:
                number(word)
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        rows.append(Row([*words[:count]], line))
    return rows


def _put_points(control: list[Row], objects: list[Row], draft: Draft) -> None:
    """Control points observed with their σ (0: fixed), object points free; without control the network is free."""
    known = {row.cells[0] for row in control}
    if control:
        draft.table("points", ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), control)
    others = [row for row in objects if row.cells[0] not in known]
    if others:
        draft.table("points", ("id", "x", "y", "z"), others)
    if not control:
        draft.put("datum", "free")
