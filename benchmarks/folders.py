"""Simulated blocks and networks as project folders, for the whole command from the tables to the results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scenes import (
    INTERIOR,
    SIGMA_BEARING,
    SIGMA_CENTRE,
    SIGMA_DISTANCE,
    SIGMA_HEIGHT,
    SIGMA_IMAGE,
    START_INTERIOR,
    Block,
    Grid,
    Mixed,
    Scene,
)

from mor.types import FloatArray, IntArray

_Column = pl.Series | NDArray[Any]
_SIGMA = {"distance": SIGMA_DISTANCE, "bearing": SIGMA_BEARING, "height_difference": SIGMA_HEIGHT}
_INTERIOR = ("c", "xh", "yh", "A1", "A2", "A3", "B1", "B2", "C1", "C2")


def write_project(scene: Scene, folder: Path, kind: str = "csv") -> Path:
    """Write an image block, a network, or both in one; returns the project file."""
    if isinstance(scene, Block):
        return write_block(scene, folder, kind)
    if isinstance(scene, Grid):
        return write_grid(scene, folder)
    return write_mixed(scene, folder, kind)


def write_mixed(scene: Mixed, folder: Path, kind: str = "csv") -> Path:
    """Write an image block with distances and bearings between its points. Returns the project file."""
    folder.mkdir(parents=True, exist_ok=True)
    sights = _write_sights(folder, scene.one, scene.other, {"distance": scene.distance, "bearing": scene.bearing})
    return write_block(scene.block, folder, kind, sights)


def write_block(
    block: Block,
    folder: Path,
    kind: str = "csv",
    more: str = "",
    started: bool = True,
    positions: bool = True,
) -> Path:
    """Write an image block; ``kind`` is csv or parquet, ``more`` further observations. Returns the project file.

    With start values unless ``started`` is false. Without ``positions`` those of the images are not measured: a free
    network with a calibrated camera.
    """
    folder.mkdir(parents=True, exist_ok=True)
    images = images_of_block(block.observed_centre, block.start_centre, block.start_angles, started, positions)
    points: dict[str, _Column] = {"id": names("P", np.arange(len(block.point)))}
    if started:
        points |= {axis: block.start_point[:, k] for k, axis in enumerate("xyz")}
    rays: dict[str, _Column] = {
        "image": names("I", block.image),
        "point": names("P", block.of_point),
        "x": block.xy[:, 0],
        "y": block.xy[:, 1],
    }
    for name, frame in (("images", images), ("points", pl.DataFrame(points)), ("rays", pl.DataFrame(rays))):
        path = folder / f"{name}.{kind}"
        frame.write_parquet(path) if kind == "parquet" else frame.write_csv(path)
    return project_of_block(folder, len(block.centre), kind, more, positions)


def images_of_block(
    observed_centre: FloatArray,
    start_centre: FloatArray,
    start_angles: FloatArray,
    started: bool = True,
    positions: bool = True,
) -> pl.DataFrame:
    """The table of images, with start values and with the positions measured, or without."""
    images: dict[str, _Column] = {
        "id": names("I", np.arange(len(start_centre))),
        "camera": np.full(len(start_centre), "K"),
    }
    for k, axis in enumerate("xyz"):
        if positions:
            images |= {
                axis: observed_centre[:, k],
                f"sigma_{axis}": np.full(len(start_centre), SIGMA_CENTRE),
            }
        if started:
            images |= {f"start_{axis}": start_centre[:, k]}
    if started:
        images |= {name: start_angles[:, k] for k, name in enumerate(("omega", "phi", "kappa"))}
    return pl.DataFrame(images)


def project_of_block(folder: Path, images: int, kind: str, more: str = "", positions: bool = True) -> Path:
    """Write the project file of a block whose tables are there; returns it."""
    interior = ", ".join(
        f"{name}: {{free: {value:.6g}}}" if positions else f"{name}: {true:.6g}"
        for name, value, true in zip(_INTERIOR, START_INTERIOR, INTERIOR, strict=True)
    )
    text = f"""mor: 1
title: Simulated block of {images} images
units: {{length: m, angle: rad}}
cameras:
  K: {{r0: 0, interior: {{{interior}}}}}
images: [{{file: images.{kind}}}]
points: [{{file: points.{kind}}}]
observations:
  - {{type: image, file: rays.{kind}, values: {{sigma: "{SIGMA_IMAGE}"}}}}
{more}datum: {"fixed" if positions else "free"}
"""
    return _project(folder, text)


def write_grid(grid: Grid, folder: Path) -> Path:
    """Write a geodetic network: distances, bearings and height differences. Returns the project file."""
    folder.mkdir(parents=True, exist_ok=True)
    control = np.isin(np.arange(len(grid.point)), grid.control)
    for name, chosen, xyz in (("control", control, grid.point), ("points", ~control, grid.start)):
        numbers = np.flatnonzero(chosen)
        columns: dict[str, _Column] = {
            "id": names("P", numbers),
            **{a: xyz[numbers, k] for k, a in enumerate("xyz")},
        }
        pl.DataFrame(columns).write_csv(folder / f"{name}.csv")
    measured = {
        "distance": grid.distance,
        "bearing": grid.bearing,
        "height_difference": grid.height_difference,
    }
    sights = _write_sights(folder, grid.one, grid.other, measured)
    text = f"""mor: 1
title: Simulated network of {len(grid.point)} points
units: {{length: m, angle: rad}}
points:
  - {{file: control.csv, fixed: [x, y, z]}}
  - {{file: points.csv}}
observations:
{sights}datum: fixed
"""
    return _project(folder, text)


def _write_sights(folder: Path, one: IntArray, other: IntArray, measured: dict[str, FloatArray]) -> str:
    """Write a table for each type of observations between two points; returns their lines of the project file."""
    ends = {"from": names("P", one), "to": names("P", other)}
    lines = []
    for name, values in measured.items():
        column = "dz" if name == "height_difference" else name
        pl.DataFrame({**ends, column: values}).write_csv(folder / f"{name}.csv")
        lines.append(f'  - {{type: {name}, file: {name}.csv, values: {{sigma: "{_SIGMA[name]}"}}}}\n')
    return "".join(lines)


def names(letter: str, numbers: IntArray) -> pl.Series:
    """Names of so many things: a letter and a number."""
    return pl.select(pl.lit(letter) + pl.Series(numbers).cast(pl.String)).to_series()


def _project(folder: Path, text: str) -> Path:
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    return path
