"""The content of a COLMAP model, as text or binary files (COLMAP documentation, "Output Format")."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray

NO_POINT = -1
"""Point of an image point that belongs to none."""
CAMERA_SENSOR = 0


class ColmapCamera(NamedTuple):
    """A camera: parameters in px, counted from the upper left corner of the upper left pixel."""

    id: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]
    line: int = 0


class Pose(NamedTuple):
    """A movement x' = R(q) x + t; q = (w, x, y, z)."""

    quaternion: tuple[float, float, float, float]
    translation: tuple[float, float, float]


class ColmapImage(NamedTuple):
    """An image: its pose (camera from world) and image points."""

    id: int
    pose: Pose
    camera: int
    name: str
    xy: FloatArray
    """(n, 2), px."""
    points: IntArray
    """(n,) numbers of the object points, −1 where there is none."""
    line: int = 0


class Sensor(NamedTuple):
    """A camera of a rig, with its pose from that of the reference camera where it is known."""

    camera: int
    pose: Pose | None


class Rig(NamedTuple):
    """Cameras fixed to each other; the first is the reference."""

    id: int
    sensors: tuple[Sensor, ...]


class Frame(NamedTuple):
    """Images a rig took at one time."""

    id: int
    rig: int
    images: tuple[int, ...]
    pose: Pose


@dataclass(frozen=True)
class ColmapModel:
    """A whole model."""

    cameras: list[ColmapCamera]
    images: list[ColmapImage]
    point_ids: IntArray
    point_xyz: FloatArray
    rigs: list[Rig] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)


def empty_points() -> tuple[FloatArray, IntArray]:
    """Image points of an image that has none."""
    return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
