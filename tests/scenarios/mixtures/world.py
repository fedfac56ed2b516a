"""A random world with everything measured in it: true points, frames and observations, with tags of what it is made of.

What is simulated here shares no code with the program: projections and angles are written out once more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator

from mor.types import FloatArray

C = 30.0
"""Camera constant of the simulated cameras, mm; the format is 36 × 24 mm."""
HALF = np.array([18.0, 12.0])
Row = tuple[str, str, *tuple[float, ...]]


@dataclass
class Point:
    """True coordinates, and for each of them ``None`` (free), 0 (fixed) or the σ of its observation."""

    xyz: FloatArray
    sigma: list[float | None] = field(default_factory=lambda: [None, None, None])
    rough: FloatArray | None = None
    """Start value that the project has, where it has one."""


@dataclass
class Image:
    """A camera: projection centre and attitude D, where it stands, whom it follows."""

    centre: FloatArray
    D: FloatArray
    over: str = ""
    height: float = 0.0
    leader: str = ""
    observed: float | None = None
    """σ of an observed position."""
    held: bool = False
    """True where the pose is given and fixed."""
    turned: float | None = None
    """σ (rad) of an observed attitude."""


@dataclass
class Station:
    """A theodolite over a point: level is ``fixed``, ``free`` or a σ; D from object to instrument axes."""

    over: str
    height: float
    level: str
    D: FloatArray


@dataclass
class World:
    """Everything true and everything measured."""

    seed: int
    size: float
    points: dict[str, Point] = field(default_factory=dict)
    images: dict[str, Image] = field(default_factory=dict)
    stations: dict[str, Station] = field(default_factory=dict)
    base: FloatArray | None = None
    """Base of the stereo rig in the axes of its leaders, and the attitude of followers in them."""
    turn: FloatArray | None = None
    base_sigma: float | None = None
    """``None`` free, 0 fixed."""
    systems: dict[str, tuple[FloatArray, FloatArray, float, bool]] = field(default_factory=dict)
    """Origin, D, scale, whether the scale is free."""
    system_held: tuple[str, ...] = ()
    """Components of the systems with a fixed scale that are fixed too."""
    planes: dict[str, list[str]] = field(default_factory=dict)
    rays: list[Row] = field(default_factory=list)
    directions: list[Row] = field(default_factory=list)
    """Station, target, horizontal, zenith (NaN where not read), target height."""
    distances: list[Row] = field(default_factory=list)
    """From, to, distance, height of the target."""
    level_lines: list[Row] = field(default_factory=list)
    vectors: list[Row] = field(default_factory=list)
    local: list[Row] = field(default_factory=list)
    bearings: list[Row] = field(default_factory=list)
    tables: list[dict[str, Any]] = field(default_factory=list)
    """Observations of further types, as the project has them."""
    free: bool = True
    tags: set[str] = field(default_factory=set)

    @property
    def kind_of_feature(self) -> str:
        """What the points of ``planes`` are said to be on, loosely enough to be true of both."""
        return "line" if self.seed % 2 else "plane"

    @property
    def sigma_length(self) -> float:
        """σ of lengths."""
        return 1e-4 * self.size


def rotation(vector: FloatArray) -> FloatArray:
    """Rotation by a vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle else np.array([1.0, 0.0, 0.0])
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def looking(from_: FloatArray, at: FloatArray, roll: float) -> FloatArray:
    """Attitude of a camera that looks at a place along its −z."""
    back = from_ - at
    back = back / np.linalg.norm(back)
    side = np.cross([0.0, 0.0, 1.0] if abs(back[2]) < 0.95 else [0.0, 1.0, 0.0], back)
    side /= np.linalg.norm(side)
    return rotation(np.array([0.0, 0.0, roll])) @ np.stack([side, np.cross(back, side), back])


def about_z(angle: float) -> FloatArray:
    """D of a levelled instrument whose directions are r = t + angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def photograph(world: World, name: str, draw: Generator, kept: float, wanted: int) -> None:
    """Image coordinates (mm) of the points in the format; some are not measured."""
    image = world.images[name]
    names = [p for p in world.points if p.startswith("P")]
    star = (np.array([world.points[p].xyz for p in names]) - image.centre) @ image.D.T
    xy = -C * star[:, :2] / star[:, 2:]
    seen = (star[:, 2] < 0.0) & (np.abs(xy) < HALF).all(axis=1) & (draw.random(len(names)) < kept)
    for i in draw.permutation(np.flatnonzero(seen))[:wanted]:
        x, y = xy[i] + 0.002 * draw.standard_normal(2)
        world.rays.append((name, names[i], float(x), float(y)))


def sight(world: World, name: str, to: str, draw: Generator, zenith: bool, far: bool, above: float = 0.0) -> None:
    """Directions (rad) of a station to a point, and a distance where ``far`` is wanted."""
    station = world.stations[name]
    up = np.array([0.0, 0.0, 1.0])
    away = world.points[to].xyz + above * up - world.points[station.over].xyz - station.height * up
    x, y, z = station.D @ away
    horizontal = np.arctan2(x, y) + 1e-5 * draw.standard_normal()
    angle = np.arctan2(np.hypot(x, y), z) + 1e-5 * draw.standard_normal()
    world.directions.append((name, to, float(horizontal), float(angle) if zenith else np.nan, above))
    if far:
        length = float(np.linalg.norm(away) + world.sigma_length * draw.standard_normal())
        world.distances.append((name, to, length, above))
