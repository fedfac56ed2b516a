"""Tables of homologous image points, read and turned into bundles."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.approximate.bundle import Bundle, image_bundle
from mor.arrays import FloatArray
from mor.errors import InputError, Problem, nearest
from mor.input_files import read_bytes


class Measured(NamedTuple):
    """Homologous image points: identifiers and coordinates (n, images, 2), NaN if not measured."""

    ids: tuple[str, ...]
    coordinates: FloatArray
    file: str = ""


def read_homologous(path: Path) -> Measured:
    """Table with the columns id, x1, y1, x2, y2, … Raises :class:`InputError` with every mistake found."""
    try:
        frame = pl.read_csv(read_bytes(path), infer_schema=False)
    except pl.exceptions.PolarsError as error:
        raise InputError([Problem(f"not a table: {str(error).splitlines()[0]}", str(path))]) from None
    names = _columns(frame.columns, path)
    ids = frame["id"].to_list()
    numbers, wrong = _numbers(frame, names, path)
    problems = [*_checked_names(ids, path), *wrong]
    if problems:
        raise InputError(sorted(problems, key=lambda problem: problem.line))
    return Measured(tuple(ids), numbers.reshape(frame.height, -1, 2), str(path))


def _columns(found: list[str], path: Path) -> list[str]:
    """The columns of coordinates; others may stand beside them, but none that is half of an image."""
    images = 0
    while {f"x{images + 1}", f"y{images + 1}"} <= set(found):
        images += 1
    expected = [f"{axis}{image}" for image in range(1, images + 1) for axis in "xy"]
    halves = [name for name in found if re.fullmatch(r"[xyXY]\d+", name) and name not in expected]
    if "id" not in found or images < 2 or halves:
        said = f"expected the columns id, x1, y1, x2, y2 …, x and y of every image, found {', '.join(found)}"
        raise InputError([Problem(said, str(path), 1)])
    return expected


def _checked_names(ids: list[str | None], path: Path) -> list[Problem]:
    """Every row has a name of its own."""
    first: dict[str, int] = {}
    problems = []
    for line, name in enumerate(ids, start=2):
        if name is None or not name.strip():
            problems.append(Problem("id is empty", str(path), line))
        elif name in first:
            problems.append(
                Problem(f"id {name!r} is given twice (first in line {first[name]})", str(path), line)
            )
        else:
            first[name] = line
    return problems


def _numbers(frame: pl.DataFrame, names: list[str], path: Path) -> tuple[FloatArray, list[Problem]]:
    """Coordinates (n, k), not a number where a cell is empty; and what is no number, or stands without its mate."""
    problems = []
    result = np.full((frame.height, len(names)), np.nan)
    given = np.zeros(result.shape, dtype=bool)
    for k, name in enumerate(names):
        for i, cell in enumerate(frame[name].to_list()):
            if cell is None or not cell.strip():
                continue
            given[i, k] = True
            try:
                result[i, k] = float(cell)
            except ValueError:
                result[i, k] = np.nan
            if not np.isfinite(result[i, k]):
                problems.append(Problem(f"{name}: found {cell!r}, expected a number", str(path), i + 2))
    for i, k in np.argwhere(given[:, ::2] != given[:, 1::2]):
        empty, other = (names[2 * k + 1], names[2 * k])[:: 1 if given[i, 2 * k] else -1]
        problems.append(Problem(f"{empty} is empty, and {other} is not", str(path), int(i) + 2))
    return result, problems


def check_names(measured: Measured, names: tuple[str, ...]) -> None:
    """Raise :class:`InputError` for names of points that the table does not have."""
    problems = [
        Problem(f"point {name!r} does not exist{nearest(name, measured.ids)}", measured.file)
        for name in names
        if name not in measured.ids
    ]
    if problems:
        raise InputError(problems)


def bundles(measured: Measured, constants: FloatArray, sigma: float) -> list[Bundle]:
    """One bundle for each image, with its camera constant; image coordinates relative to the principal point."""
    rays = np.concatenate(
        [
            measured.coordinates,
            np.broadcast_to(-constants[None, :, None], (*measured.coordinates.shape[:2], 1)),
        ],
        axis=2,
    )
    rays[np.isnan(measured.coordinates).any(axis=2)] = np.nan
    return [image_bundle(rays[:, image], sigma) for image in range(rays.shape[1])]
