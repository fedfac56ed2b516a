"""Tables of homologous image points, read and turned into bundles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from mor.approximate.bundle import Bundle, image_bundle
from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.input_files import read_bytes


@dataclass(frozen=True)
class Measured:
    """Homologous image points: identifiers and coordinates (n, images, 2), NaN where not measured."""

    ids: tuple[str, ...]
    coordinates: FloatArray


def read_homologous(path: Path) -> Measured:
    """Table with the columns id, x1, y1, x2, y2, … Raises :class:`InputError` with every mistake found."""
    try:
        frame = pl.read_csv(read_bytes(path), infer_schema=False)
    except pl.exceptions.PolarsError as error:
        raise InputError([Problem(f"not a table: {str(error).splitlines()[0]}", str(path))]) from None
    images = 0
    while {f"x{images + 1}", f"y{images + 1}"} <= set(frame.columns):
        images += 1
    if "id" not in frame.columns or images < 2:
        found = ", ".join(frame.columns)
        raise InputError([Problem(f"expected the columns id, x1, y1, x2, y2, found {found}", str(path), 1)])
    _check_names(frame["id"].to_list(), path)
    names = [f"{axis}{image}" for image in range(1, images + 1) for axis in "xy"]
    return Measured(
        tuple(frame["id"].to_list()), _numbers(frame, names, path).reshape(frame.height, images, 2)
    )


def _check_names(ids: list[str | None], path: Path) -> None:
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
    if problems:
        raise InputError(problems)


def _numbers(frame: pl.DataFrame, names: list[str], path: Path) -> FloatArray:
    problems = []
    result = np.full((frame.height, len(names)), np.nan)
    for k, name in enumerate(names):
        for i, cell in enumerate(frame[name].to_list()):
            if cell is None or not cell.strip():
                continue
            try:
                result[i, k] = float(cell)
            except ValueError:
                result[i, k] = np.nan
            if not np.isfinite(result[i, k]):
                problems.append(Problem(f"{name}: found {cell!r}, expected a number", str(path), i + 2))
    if problems:
        raise InputError(problems)
    return result


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
