"""Files of Pix4D's folder ``params``: which there are, and what stands in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines

CAMERAS = "calibrated_camera_parameters.txt"
EXTERNAL = "calibrated_external_camera_parameters.txt"
MARKS = "tp_pix4d.txt"
CONTROL = "measured_gcps_position.txt"
OFFSET = "offset.xyz"
_ENDS = (EXTERNAL, CAMERAS, MARKS, CONTROL, OFFSET)
_BLOCK = (3, 3, 3, 3, 2, 3, 3, 3, 3)
"""Numbers in the lines behind the name of an image: K, radial and tangential distortion, position, rotation."""

Result = TypeVar("Result")


class Photo(NamedTuple):
    """An image of the calibrated camera parameters."""

    name: str
    size: tuple[float, float]
    camera: tuple[float, ...]
    """f, cx, cy (px from the upper left corner), R1, R2, R3, T1, T2."""
    position: FloatArray
    rotation: FloatArray
    """(3, 3) from the object to axes right, down, forward."""
    line: int


@dataclass(frozen=True)
class Named:
    """Numbers behind a name, and the line they stand in."""

    name: str
    values: tuple[float, ...]
    line: int


def files_of(path: Path) -> dict[str, Path]:
    """Parameter files by their kind, of a project folder, of its folder ``params`` or beside one of them.

    Raises :class:`InputError` if there is none, or several projects.
    """
    folder = path if path.is_dir() else path.parent
    for inner in ("1_initial/params", "params"):
        folder = folder / inner if path.is_dir() and (folder / inner).is_dir() else folder
    names = sorted(file.name for file in folder.iterdir()) if folder.is_dir() else []
    kinds = {name: kind_of(name) for name in names}
    stems = {name.removesuffix(kind) for name, kind in kinds.items() if kind and kind != OFFSET}
    if not path.is_dir() and kind_of(path.name):
        stems = {path.name.removesuffix(kind_of(path.name))}
    if len(stems) != 1:
        words = f"found parameters of {len(stems)} projects, expected one"
        words += f" ({', '.join(sorted(stems))}): name one of the files" if stems else f": …_{CAMERAS}"
        raise InputError([Problem(words, str(path))])
    (stem,) = stems
    return {kind: folder / name for name, kind in kinds.items() if kind and name == stem + kind}


def kind_of(name: str) -> str:
    """Return the kind of parameter file that a name means, or an empty text."""
    return next((end for end in _ENDS if name == end or name.endswith(f"_{end}")), "")


def _told(make: Callable[[], Result], line: int, file: str, draft: Draft) -> Result | None:
    try:
        return make()
    except ValueError as error:
        draft.problem(str(error), line, file)
        return None


def _numbers(words: list[str], count: int, what: str) -> tuple[float, ...]:
    values = tuple(number(word) for word in words)
    if len(values) != count:
        raise ValueError(f"found {len(values)} numbers, expected {count}: {what}")
    return values


def read_cameras(path: Path, draft: Draft) -> list[Photo]:
    """Images with K, distortion, position and rotation: ten lines each behind the first empty line."""
    lines = [(k, text.split()) for k, text in enumerate(read_lines(path, draft), start=1)]
    head = next((k for k, words in lines if not words), 0)
    body = [(k, words) for k, words in lines if words and k > head]
    if not head or not body:
        form = (
            "an empty line behind the description, then name, K, distortion, position, rotation of each image"
        )
        draft.problem(f"found no images, expected {form}", 1, str(path))
        return []
    photos = []
    at = 0
    while at < len(body):
        block = body[at : at + 1 + len(_BLOCK)]
        photo = _told(lambda block=block: _photo(block), block[0][0], str(path), draft)  # type: ignore[misc]
        if photo is None:
            break
        photos.append(photo)
        at += len(block)
    return photos


def _photo(block: list[tuple[int, list[str]]]) -> Photo:
    line, head = block[0]
    if len(head) < 3 or len(block) < 1 + len(_BLOCK):
        raise ValueError(
            f"found {' '.join(head)!r}, expected name, width, height and {len(_BLOCK)} lines behind it"
        )
    size = _numbers(head[-2:], 2, "width, height")
    rows = []
    for (k, words), count in zip(block[1:], _BLOCK, strict=True):
        try:
            rows.append(_numbers(words, count, "K (3 × 3), R1 R2 R3, T1 T2, position, rotation (3 × 3)"))
        except ValueError as error:
            raise ValueError(f"image {head[0]}: line {k}: {error}") from None
    K, R = np.array(rows[:3]), np.array(rows[6:9])
    if K[0, 0] <= 0.0 or abs(K[0, 0] - K[1, 1]) > 1e-9 * K[0, 0] or K[0, 1] or min(size) < 1.0:
        raise ValueError(f"image {head[0]}: expected K = (f 0 cx, 0 f cy, 0 0 1) with f above 0, and a size")
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise ValueError(f"image {head[0]}: the last three lines are no rotation")
    camera = (K[0, 0], K[0, 2], K[1, 2], *rows[3], *rows[4])
    name = " ".join(head[:-2])
    return Photo(name, (size[0], size[1]), tuple(map(float, camera)), np.array(rows[5]), R, line)


def read_named(path: Path, count: int, what: str, draft: Draft, most: int = 0) -> list[Named]:
    """Lines of a name and ``count`` numbers (up to ``most``), between blanks, tabs or commas; a head is left out."""
    found = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = [word.strip() for word in text.split(",")] if "," in text else text.split()
        words = words if not words or words[-1] else words[:-1]
        if not words or words[0].startswith("#") or (line == 1 and _is_head(words[1:])):
            continue
        wanted = count if len(words) - 1 <= count else max(count, min(len(words) - 1, most))
        made = _told(lambda w=words, n=wanted: _numbers(w[1:], n, what), line, str(path), draft)  # type: ignore[misc]
        if made is not None:
            found.append(Named(words[0], made, line))
    return found


def _is_head(words: list[str]) -> bool:
    return bool(words) and all(word[:1].isalpha() for word in words if word)


def read_marks(path: Path, draft: Draft) -> list[tuple[str, Named]]:
    """Image and image point (x, y in px): the name of an image, lines of point, x, y, scale, then −99."""
    found = []
    image = ""
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0] == "-99":
            image = "" if words else image
        elif len(words) == 1 or not image:
            image = text.strip()
        else:
            made = _told(lambda w=words: _numbers(w[1:3], 2, "point x y scale"), line, str(path), draft)  # type: ignore[misc]
            if made is not None:
                found.append((image, Named(words[0], made, line)))
    return found
