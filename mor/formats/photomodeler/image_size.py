"""Size of the images of an export that does not say it: worked out from the solution the export contains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.rotations import rotation_from_angles

_ROUNDS = 50


class Seen(NamedTuple):
    """An image point: photo, point, px."""

    photo: str
    point: str
    x: float
    y: float


def image_size(
    camera: Sequence[float],
    poses: Mapping[str, Sequence[float]],
    points: Mapping[str, Sequence[float]],
    marks: Sequence[Seen],
) -> tuple[int, int] | None:
    """Width and height in px, or ``None`` if the solution does not give them.

    The camera constant, the poses and the points say where in the format (mm) a point is seen, the mark where in the
    image (px): their ratio is the size of a pixel, and the format divided by it the number of pixels.

    ``camera`` is c xp yp, format width and height, K1 K2 K3 P1 P2; a pose X Y Z kappa phi omega in degrees.
    """
    known = [mark for mark in marks if mark.photo in poses and mark.point in points]
    if len(known) < 2:
        return None
    pose = np.array([poses[mark.photo] for mark in known])
    D = rotation_from_angles(np.radians(pose[:, [5, 4, 3]]))
    X = np.array([points[mark.point] for mark in known])
    star = np.einsum("nij,nj->ni", D, X - pose[:, :3])
    seen = star[:, 2] < 0.0
    if seen.sum() < 2:
        return None
    c, xp, yp, width, height, *distortion = camera
    ideal = -c * star[seen, :2] / star[seen, 2:]
    mm = _measured(ideal, np.array(distortion)) * [1.0, -1.0] + [xp, yp]
    px = np.array([[mark.x, mark.y] for mark in known])[seen]
    if not np.isfinite(mm).all():
        return None
    ratio = np.median(px / np.where(np.abs(mm) > 1e-9, mm, np.nan), axis=0)
    size = (round(float(width * ratio[0])), round(float(height * ratio[1]))) if np.all(ratio > 0) else (0, 0)
    within = (px > -1).all() and (px <= np.array(size) + 1).all()
    return size if min(size) > 0 and bool(within) else None


def _measured(corrected: FloatArray, distortion: FloatArray) -> FloatArray:
    """Measured coordinates (n, 2) whose correction (Brown) leads to the corrected ones, by iteration."""
    k1, k2, k3, p1, p2 = np.pad(distortion, (0, 5))[:5]
    xy = corrected.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_ROUNDS):
            x, y = xy.T
            r2 = x * x + y * y
            radial = r2 * (k1 + r2 * (k2 + r2 * k3))
            dx = x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
            dy = y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
            xy = corrected - np.column_stack([dx, dy])
    return xy
