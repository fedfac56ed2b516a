"""Small projects with known truth, written as a user would write them, and the command line to run them with."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.cli import run


class Run(NamedTuple):
    """What the command line left behind."""

    code: int
    out: str
    err: str


def mor(*arguments: object) -> Run:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run([str(argument) for argument in arguments])
    return Run(int(code), out.getvalue(), err.getvalue())


def write(folder: Path, text: str, **files: str) -> Path:
    """A project file and the tables beside it (``points="id,x,y,z …"`` becomes points.csv)."""
    folder.mkdir(parents=True, exist_ok=True)
    project = folder / "project.yaml"
    project.write_text(text, encoding="utf-8")
    for name, content in files.items():
        (folder / f"{name}.csv").write_text(content, encoding="utf-8")
    return project


def table(header: str, rows: list[Any]) -> str:
    """CSV text of rows of anything; floats with all their digits."""
    lines = [",".join(repr(float(x)) if isinstance(x, float) else str(x) for x in row) for row in rows]
    return "\n".join([header, *lines]) + "\n"


LEVELLING = """\
mor: 1
units: {length: m}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 0, 0, 11], [C, 0, 0, 12]], fixed: [x, y]}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, B, 1.001, 0.001], [B, C, 1.002, 0.001], [C, A, -2.001, 0.001]]
"""
"""Three benchmarks in a loop: the smallest project there is. Redundancy 1, misclosure 2 mm."""


C = 20.0
"""Camera constant (mm) of the blocks below."""
OBJECT = np.array([[x, y, z] for x in (0.0, 2.0, 4.1) for y in (0.3, 3.2) for z in (-0.4, 1.9)]) + 0.2 * np.sin(
    np.arange(36.0)
).reshape(12, 3)
CENTRES = np.array([[-4.0, -6.0, 1.2], [2.0, -8.5, 3.0], [8.5, -5.0, 0.4], [6.0, -7.0, 5.5]])


def attitude(centre: np.ndarray, roll: float) -> tuple[np.ndarray, tuple[float, float, float]]:
    """D of a camera that looks at the object, and its ω, φ, κ in gon: D = (Rx Ry Rz)ᵀ, read off the matrix."""
    backwards = centre - OBJECT.mean(axis=0)
    backwards = backwards / np.linalg.norm(backwards)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right = right / np.linalg.norm(right)
    D = np.stack([right, np.cross(backwards, right), backwards])
    c, s = np.cos(roll), np.sin(roll)
    D = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ D
    R = D.T
    angles = (np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0]))
    return D, tuple(float(angle) * 200.0 / np.pi for angle in angles)  # type: ignore[return-value]


class Block(NamedTuple):
    """Rows of a block of images with known truth."""

    points: list[list[Any]]
    images: list[list[Any]]
    rays: list[list[Any]]


def block(noise: float = 0.0, seed: int = 4) -> Block:
    """Four images (names 010, no, 1e3, 12:30) of twelve points; σ of image coordinates as ``noise`` in mm."""
    random = np.random.default_rng(seed)
    points = [[f"P{i}", *map(float, xyz)] for i, xyz in enumerate(OBJECT)]
    images, rays = [], []
    for k, (name, centre) in enumerate(zip(("010", "no", "1e3", "12:30"), CENTRES, strict=True)):
        D, angles = attitude(centre, 0.4 * k)
        images.append([name, "K", *map(float, centre), *angles])
        star = (OBJECT - centre) @ D.T
        xy = -C * star[:, :2] / star[:, 2:] + noise * random.standard_normal((len(OBJECT), 2))
        rays += [[name, f"P{i}", float(x), float(y)] for i, (x, y) in enumerate(xy)]
    return Block(points, images, rays)


BLOCK = """\
mor: 1
title: a small block
cameras:
  K: {interior: {c: 20}}
points:
  - file: points.csv
images:
  - file: images.csv
observations:
  - type: image
    file: rays.csv
    values: {sigma: 2 um}
datum: free
"""


def write_block(folder: Path, text: str = BLOCK, rows: Block | None = None, **files: str) -> Path:
    """A block of images as a project with three tables."""
    rows = rows or block(noise=0.002)
    tables = {
        "points": table("id,x,y,z", rows.points),
        "images": table("id,camera,x,y,z,omega,phi,kappa", rows.images),
        "rays": table("image,point,x,y", rows.rays),
    }
    return write(folder, text, **(tables | files))
