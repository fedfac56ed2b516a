"""Simulated image blocks as project folders, seeded: small blocks for tests of the engine."""

from __future__ import annotations

from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.cli import run
from mor.model.rotations import rotation_from_angles
from mor.types import FloatArray


class Ended(NamedTuple):
    """How a command ended."""

    exit_code: int
    stderr: str


def command(*arguments: object) -> Ended:
    """``mor`` with these arguments."""
    told = StringIO()
    with redirect_stderr(told):
        code = run([str(argument) for argument in arguments])
    return Ended(int(code), told.getvalue())


SIGMA = 0.005
C = 100.0


class Kind(NamedTuple):
    """What a block is to have."""

    strips: int = 3
    images: int = 6
    points: int = 600
    gnss: bool = True
    control: int = 0
    sights: int = 0
    """Distances and height differences between points, some of them across the whole block."""
    convergent: bool = False
    eccentric: bool = False
    """An observed eccentricity, which all images of the camera have."""
    datum: str = "fixed"
    table: str = "parquet"


def write_block(folder: Path, kind: Kind, seed: int = 1) -> Path:
    """Write a block; returns its project file."""
    random = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    centre, angles, point = _convergent(kind, random) if kind.convergent else _aerial(kind, random)
    image, of_point, xy = _rays(centre, angles, point, kind, random)
    often = np.bincount(of_point, minlength=len(point)) >= 3
    kept = often[of_point]
    image, of_point, xy = image[kept], of_point[kept], xy[kept]
    near = point + random.normal(0.0, 0.3, point.shape)
    files = {
        "images": {
            "id": [f"I{k}" for k in range(len(centre))],
            "camera": ["K"] * len(centre),
            **dict(zip("xyz", (centre + random.normal(0.0, 0.05, centre.shape)).T, strict=True)),
            **({f"sigma_{a}": np.full(len(centre), 0.05) for a in "xyz"} if kind.gnss else {}),
            **dict(zip(("omega", "phi", "kappa"), (angles + random.normal(0, 1e-3, angles.shape)).T, strict=True)),
        },
        "rays": {
            "image": [f"I{k}" for k in image],
            "point": [f"P{k}" for k in of_point],
            **dict(zip("xy", xy.T, strict=True)),
        },
    }
    used = np.flatnonzero(often)
    control = random.choice(used, kind.control, replace=False)
    free = np.setdiff1d(used, control)
    files["points"] = {"id": [f"P{k}" for k in free], **dict(zip("xyz", near[free].T, strict=True))}
    entries = [f"  - {{type: image, file: rays.{kind.table}, values: {{sigma: '{SIGMA}'}}}}\n"]
    points = [f"  - {{file: points.{kind.table}}}\n"]
    if kind.control:
        known = point[control] + random.normal(0.0, 0.02, (kind.control, 3))
        files["control"] = {"id": [f"P{k}" for k in control], **dict(zip("xyz", known.T, strict=True))}
        points.append(
            f"  - {{file: control.{kind.table}, values: {{sigma_x: '0.02', sigma_y: '0.02', sigma_z: '0.02'}}}}\n"
        )
    if kind.sights:
        entries += _sights(files, point, used, kind, random)
    for name, columns in files.items():
        frame = pl.DataFrame(columns)
        path = folder / f"{name}.{kind.table}"
        frame.write_parquet(path) if kind.table == "parquet" else frame.write_csv(path)
    path = folder / "project.yaml"
    eccentricity = "eccentricity: {rz: {observed: 0, sigma: 0.02}}, " if kind.eccentric else ""
    path.write_text(
        "mor: 1\ntitle: Block\nunits: {length: m, angle: rad}\n"
        "cameras:\n"
        f"  K: {{{eccentricity}r0: 0, "
        "interior: {c: {free: 100.01}, xh: {free: 0}, yh: {free: 0}, A1: {free: 0}}}\n"
        f"images: [{{file: images.{kind.table}}}]\npoints:\n{''.join(points)}observations:\n{''.join(entries)}"
        f"datum: {kind.datum}\n",
        encoding="utf-8",
    )
    return path


def _aerial(kind: Kind, random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    along, across = np.meshgrid(np.arange(kind.images) * 180.0, np.arange(kind.strips) * 280.0)
    centre = np.column_stack([along.ravel(), across.ravel(), np.full(along.size, 1000.0)])
    centre = centre + random.normal(0.0, 5.0, centre.shape)
    low, high = centre.min(axis=0) - 200.0, centre.max(axis=0) + 200.0
    point = random.uniform(low, high, (kind.points, 3))
    point[:, 2] = random.uniform(0.0, 150.0, kind.points)
    return centre, random.normal(0.0, 0.02, centre.shape), point


def _convergent(kind: Kind, random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    count = kind.strips * kind.images
    turn = np.arange(count) * 2.0 * np.pi / count
    centre = np.column_stack([300.0 * np.cos(turn), 300.0 * np.sin(turn), random.uniform(100.0, 250.0, count)])
    centre[:, 2] += 300.0
    # The object lies below all cameras: each tilts towards it, ω and φ from the direction to the middle.
    down = -centre / np.linalg.norm(centre, axis=1)[:, None]
    omega = np.arctan2(down[:, 1], -down[:, 2])
    phi = np.arcsin(np.clip(-down[:, 0], -1.0, 1.0))
    angles = np.column_stack([omega, phi, random.uniform(-1.0, 1.0, count)])
    return centre, angles, random.uniform(-60.0, 60.0, (kind.points, 3))


def _rays(
    centre: FloatArray, angles: FloatArray, point: FloatArray, kind: Kind, random: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    D = rotation_from_angles(angles)
    image, of_point, xy = [], [], []
    for k in range(len(centre)):
        q = (point - centre[k]) @ D[k].T
        x = -C * q[:, :2] / q[:, 2:]
        seen = (q[:, 2] < 0) & (np.abs(x[:, 0]) < 45.0) & (np.abs(x[:, 1]) < 35.0)
        rows = np.flatnonzero(seen & (random.random(len(point)) < (0.4 if kind.convergent else 1.0)))
        image.append(np.full(len(rows), k))
        of_point.append(rows)
        xy.append(x[rows] + random.normal(0.0, SIGMA, (len(rows), 2)))
    return np.concatenate(image), np.concatenate(of_point), np.concatenate(xy)


def _sights(files: dict, point: FloatArray, used: np.ndarray, kind: Kind, random: np.random.Generator) -> list[str]:
    """Tables of distances and height differences; a third of them goes anywhere."""
    order = used[np.argsort(point[used, 0])]
    first = random.choice(len(order), kind.sights, replace=False)
    step = np.where(np.arange(kind.sights) % 3 == 0, len(order) // 2, 5)
    one, other = order[first], order[(first + step) % len(order)]
    names = {"from": [f"P{k}" for k in one], "to": [f"P{k}" for k in other]}
    d = point[other] - point[one]
    files["distances"] = {**names, "distance": np.linalg.norm(d, axis=1) + random.normal(0.0, 0.01, len(d))}
    files["heights"] = {**names, "dz": d[:, 2] + random.normal(0.0, 0.01, len(d))}
    return [
        f"  - {{type: {name}, file: {file}.{kind.table}, values: {{sigma: '0.01'}}}}\n"
        for name, file in (("distance", "distances"), ("height_difference", "heights"))
    ]
