"""Simulated blocks and networks of any size: the truth, and what is observed of it.

An image block is 80 % forward and 60 % side overlap, of which each image sees a random part, or cameras all around an
object that look at its middle. A geodetic grid is directions and distances to the neighbours, with long ties between
points drawn at random. A mixed scene is an aerial block with distances and bearings among its points.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from mor.model.rotations import angles_from_rotation, rotation_from_angles
from mor.types import FloatArray, IntArray

SIGMA_IMAGE = 0.003
"""mm."""
SIGMA_CENTRE = 0.05
"""m, of the projection centres from satellites."""
SIGMA_DISTANCE, SIGMA_BEARING, SIGMA_HEIGHT = 0.003, 3e-6, 0.002
"""m, rad, m of a geodetic network."""
INTERIOR = np.array([100.0, 0.02, -0.03, 2e-6, -1e-10, 0.0, 1e-6, -1e-6, 1e-5, -1e-5])
"""c, xh, yh, A1, A2, A3, B1, B2, C1, C2 of the camera, r0 = 0."""
START_INTERIOR = np.array([100.0, *np.zeros(9)])
"""The same to start with."""


@dataclass(frozen=True)
class Block:
    """An image block with one camera: the truth, what was observed, and where to start.

    Attributes:
        centre, angles: (i, 3) poses; interior: (10,); point: (p, 3).
        image, of_point: (n,) what each image point belongs to; xy: (n, 2) as measured, mm.
        observed_centre: (i, 3) with σ = SIGMA_CENTRE.
        start_centre, start_angles, start_point: where to start; the interior starts without distortion.
    """

    centre: FloatArray
    angles: FloatArray
    point: FloatArray
    image: IntArray
    of_point: IntArray
    xy: FloatArray
    observed_centre: FloatArray
    start_centre: FloatArray
    start_angles: FloatArray
    start_point: FloatArray

    @property
    def start_interior(self) -> FloatArray:
        """(10,) interior orientation to start with."""
        return START_INTERIOR


def project(q: FloatArray) -> FloatArray:
    """Image coordinates (n, 2) of points (n, 3) in the image system, with the distortion of the camera."""
    c, xh, yh, a1, a2, a3, b1, b2, c1, c2 = INTERIOR
    x, y = -c * q[:, 0] / q[:, 2], -c * q[:, 1] / q[:, 2]
    r2 = x * x + y * y
    radial = a1 * r2 + a2 * r2**2 + a3 * r2**3
    return np.column_stack(
        [
            xh + x + x * radial + b1 * (r2 + 2 * x * x) + 2 * b2 * x * y + c1 * x + c2 * y,
            yh + y + y * radial + b2 * (r2 + 2 * y * y) + 2 * b1 * x * y,
        ]
    )


def aerial(strips: int, images_in_strip: int, seed: int = 1, seen: float = 0.468) -> Block:
    """An aerial block: c = 100 mm, image 90 × 70 mm, 1000 m above ground; each image shows a part of its points."""
    rng = np.random.default_rng(seed)
    along, across = 180.0, 280.0
    centre = np.array([[i * along, j * across, 1000.0] for j in range(strips) for i in range(images_in_strip)])
    centre = centre + rng.normal(0.0, 5.0, centre.shape)
    angles = rng.normal(0.0, 0.02, centre.shape)
    width, height = images_in_strip * along + 600.0, strips * across + 500.0
    count = 239 * len(centre)
    point = np.column_stack(
        [
            rng.uniform(-300, width - 300, count),
            rng.uniform(-250, height - 250, count),
            rng.uniform(0, 80, count),
        ]
    )
    point = point[np.argsort(point[:, 0])]
    D = rotation_from_angles(angles)
    found: list[tuple[IntArray, IntArray, FloatArray]] = []
    for k, X0 in enumerate(centre):
        low, high = np.searchsorted(point[:, 0], [X0[0] - 550.0, X0[0] + 550.0])
        # the polynomial of the distortion folds points far outside the picture back into it
        rows = low + np.flatnonzero(np.abs(point[low:high, 1] - X0[1]) < 450.0)
        xy = project((point[rows] - X0) @ D[k].T)
        inside = (np.abs(xy[:, 0]) < 45.0) & (np.abs(xy[:, 1]) < 35.0) & (rng.random(len(xy)) < seen)
        rows = rows[inside]
        found.append((np.full(len(rows), k), rows, xy[inside]))
    return _observed(rng, centre, angles, point, found)


def convergent(images: int, points: int, rays: int, seed: int = 1) -> Block:
    """Cameras all around an object of 100 m that look at its middle; every point is seen by ``rays`` of them."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 2.0 * np.pi, images)
    centre = np.column_stack([300 * np.cos(turn), 300 * np.sin(turn), rng.uniform(-80, 120, images)])
    D = np.stack([_looking_at_the_origin(X0, rng.uniform(-np.pi, np.pi)) for X0 in centre])
    point = rng.uniform(-50.0, 50.0, (points, 3))
    chosen = np.argsort(rng.random((points, images)), axis=1)[:, :rays]
    image = chosen.ravel()
    of_point = np.repeat(np.arange(points), rays)
    q = np.einsum("nij,nj->ni", D[image], point[of_point] - centre[image])
    order = np.argsort(image, kind="stable")
    found = [(image[order], of_point[order], project(q)[order])]
    return _observed(rng, centre, angles_from_rotation(D), point, found)


def _looking_at_the_origin(X0: FloatArray, roll: float) -> FloatArray:
    z = X0 / np.linalg.norm(X0)  # the camera looks along −z
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    turned = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])
    looking: FloatArray = turned @ np.stack([x, y, z])
    return looking


def _observed(
    rng: np.random.Generator,
    centre: FloatArray,
    angles: FloatArray,
    point: FloatArray,
    found: list[tuple[IntArray, IntArray, FloatArray]],
) -> Block:
    image, of_point, xy = (np.concatenate(parts) for parts in zip(*found, strict=True))
    often = np.bincount(of_point, minlength=len(point)) >= 2
    number = np.cumsum(often) - 1
    kept = often[of_point]
    image, of_point, xy, point = image[kept], number[of_point[kept]], xy[kept], point[often]
    return Block(
        centre,
        angles,
        point,
        image.astype(np.int64),
        of_point.astype(np.int64),
        xy + rng.normal(0.0, SIGMA_IMAGE, xy.shape),
        centre + rng.normal(0.0, SIGMA_CENTRE, centre.shape),
        centre + rng.normal(0.0, 0.1, centre.shape),
        angles + rng.normal(0.0, 1e-4, angles.shape),
        point + rng.normal(0.0, 0.1, point.shape),
    )


@dataclass(frozen=True)
class Grid:
    """A geodetic network: points (p, 3), sights (n,) from and to, with the measurements of each."""

    point: FloatArray
    start: FloatArray
    one: IntArray
    other: IntArray
    distance: FloatArray
    bearing: FloatArray
    height_difference: FloatArray
    control: IntArray


def grid(side: int, ties: int, seed: int = 1) -> Grid:
    """side² points some 100 m apart, sights to right and upper neighbours, and long sights at random."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(side) * 100.0, np.arange(side) * 100.0)
    point = np.column_stack([x.ravel(), y.ravel(), rng.uniform(0.0, 30.0, side * side)])
    point[:, :2] += rng.normal(0.0, 10.0, (side * side, 2))
    number = np.arange(side * side).reshape(side, side)
    right = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    upper = np.stack([number[:-1].ravel(), number[1:].ravel()])
    far = rng.choice(side * side, (2, ties))
    one, other = np.concatenate([right, upper, far[:, far[0] != far[1]]], axis=1)
    d = point[other] - point[one]
    n = len(one)
    return Grid(
        point,
        point + rng.normal(0.0, 0.05, point.shape),
        one,
        other,
        np.linalg.norm(d, axis=1) + rng.normal(0.0, SIGMA_DISTANCE, n),
        np.mod(np.arctan2(d[:, 0], d[:, 1]) + rng.normal(0.0, SIGMA_BEARING, n), 2.0 * np.pi),
        d[:, 2] + rng.normal(0.0, SIGMA_HEIGHT, n),
        np.array([0, side - 1, side * side - 1]),
    )


@dataclass(frozen=True)
class Mixed:
    """An image block, and sights of a tacheometer between its points: distances and bearings."""

    block: Block
    one: IntArray
    other: IntArray
    distance: FloatArray
    bearing: FloatArray


def mixed(strips: int, images_in_strip: int, sights: int, seed: int = 1) -> Mixed:
    """An aerial block with sights between points that lie some 200 m from each other."""
    block = aerial(strips, images_in_strip, seed)
    rng = np.random.default_rng(seed + 1)
    one = rng.integers(0, len(block.point), sights)
    other = np.clip(one + rng.integers(1, 200, sights), 0, len(block.point) - 1)  # neighbours in x
    one, other = one[one != other], other[one != other]
    d = block.point[other] - block.point[one]
    return Mixed(
        block,
        one,
        other,
        np.linalg.norm(d, axis=1) + rng.normal(0.0, SIGMA_DISTANCE, len(one)),
        np.mod(np.arctan2(d[:, 0], d[:, 1]) + rng.normal(0.0, SIGMA_BEARING, len(one)), 2.0 * np.pi),
    )


Scene = Block | Grid | Mixed


def make(name: str, sizes: tuple[int, ...]) -> Scene:
    """The scene of a generator of this file."""
    return {"aerial": aerial, "convergent": convergent, "grid": grid, "mixed": mixed}[name](*sizes)


def keep(scene: Scene, path: Path) -> None:
    """Write a scene to a file of arrays."""
    block = scene.block if isinstance(scene, Mixed) else None
    parts = {"block." + f.name: getattr(block, f.name) for f in fields(Block)} if block is not None else {}
    own = {f.name: getattr(scene, f.name) for f in fields(scene) if f.name != "block"}
    np.savez(path, **parts, **own)


def kept(path: Path) -> Scene:
    """A scene that was written by :func:`keep`."""
    with np.load(path) as arrays:
        names = {name: arrays[name] for name in arrays.files}
    parts = {name[6:]: names.pop(name) for name in list(names) if name.startswith("block.")}
    if parts:
        return Mixed(Block(**parts), **names)
    return Block(**names) if "image" in names else Grid(**names)
