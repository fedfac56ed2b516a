"""The parts of a PhotoModeler text export, as numbers with their lines."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines

_PHOTO_LINES = 6
_DISTORTION = 5


class Photo(NamedTuple):
    """A photo: X Y Z kappa phi omega, and c xp yp, format width and height, K1 K2 K3 P1 P2."""

    name: str
    pose: list[float]
    camera: list[float]
    line: int


class Line(NamedTuple):
    """A line of a list: its words and its number."""

    words: list[str]
    number: int


class Export(NamedTuple):
    """A whole export; lists in the order of the file."""

    title: str
    size: tuple[float, float] | None
    """Image width and height, px, where the file says them."""
    sigma: float
    """σ of image points that have none, px."""
    camera: list[float]
    photos: list[Photo]
    control: list[Line]
    objects: list[Line]
    marks: list[Line]


def read_export(path: Path, draft: Draft) -> Export:
    """The parts of an export. Raises :class:`InputError` if its head is none."""
    lines = read_lines(path, draft)
    if len(lines) < 6:
        words = "this is no PhotoModeler text export: found fewer than 6 lines"
        raise InputError([Problem(words, draft.file, max(len(lines), 1))])
    general = _numbers(
        lines, 1, 2, "tolerance, iterations and, where known, image width and height in px", draft
    )
    defaults = _numbers(lines, 2, 1, "default σ of image points, control, points, poses", draft)
    camera = _numbers(lines, 3, 5, "c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
    photos, after = _photos(lines, draft)
    for values, line in [(camera or [], 4), *((photo.camera, photo.line + 4) for photo in photos)]:
        if values and min(values[3:5]) <= 0.0:
            draft.problem(
                f"found the format {values[3]:g} x {values[4]:g} mm, expected numbers above 0", line
            )
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
    """Five numbers of the camera, and the distortion, 0 where the file has less of it."""
    return (camera + [0.0] * _DISTORTION)[: 5 + _DISTORTION]


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


def _photos(lines: list[str], draft: Draft) -> tuple[list[Photo], int]:
    """Photos of six lines each, and the index of the first line after them."""
    photos = []
    at = 5
    while at + _PHOTO_LINES <= len(lines) and lines[at].split():
        pose = _numbers(lines, at + 1, 7, "photo X Y Z kappa phi omega", draft)
        camera = _numbers(lines, at + 4, 6, "photo c xp yp, format width and height, K1 K2 K3 P1 P2", draft)
        if pose is not None and camera is not None:
            photos.append(Photo(lines[at].split()[0], pose[1:7], _padded(camera[1:]), at + 1))
        at += _PHOTO_LINES
    return photos, at


def _lists(lines: list[str], start: int, count: int) -> list[list[Line]]:
    """Lists of lines, each after one empty line."""
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
