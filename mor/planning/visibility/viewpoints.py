"""Where sights begin, and what an image has on its format."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.geometry.rotations import rotation_from_angles
from mor.parameters.kinds import INTERIORS
from mor.planning.visibility.local_axes import upwards
from mor.project.edge import ImageScale, split
from mor.project.network.reading import Reading
from mor.project.trajectories.poses import with_poses_of
from mor.units import IMAGE

_ROUNDS = 60
"""Steps in which the measured coordinates of models that correct these come to rest."""
_SETTLED = 1e-9
"""Part of the format by which they may still move then."""
_ON_THE_WAY = 16
"""Directions between the axis of a camera and a sight at which the image has to move outwards."""


class Start:
    """Start values of a project that is being read: what is where, internal axes."""

    def __init__(self, reading: Reading) -> None:
        given: dict[str, FloatArray] = {}
        for kind, store in reading.shop.stores.items():
            found = store.start_values(store.all_values())
            given[kind] = rotation_from_angles(found) if store.kind.is_rotation else found
        self.values = with_poses_of(reading.shop.things["image"], reading, given)

    def of(self, kind: str, block: int) -> FloatArray:
        """Values of one block."""
        return np.asarray(self.values[kind][block], dtype=np.float64)


class Image(NamedTuple):
    """An image: X* = D (X − X0) + r, followed by X* → D* (X* − b*) in a follower."""

    centre: FloatArray
    """(3,) projection centre."""
    D: FloatArray
    """(3, 3) rotation into the axes of the image."""
    model: CameraModel
    interior: FloatArray
    """(k,) interior orientation."""
    constants: FloatArray
    """(q,) constants of the model."""
    low: FloatArray
    """(2,) lower left corner of the format, camera unit."""
    high: FloatArray

    def shows(self, X: FloatArray, border: float) -> BoolArray:
        """(n,) true where points (n, 3) are on the format, ``border`` from its edges.

        Distortion can bring back what is far outside: between the axis and the point the image has to move outwards
        all the way.
        """
        star = (X - self.centre) @ self.D.T
        front = np.full(len(X), self.model.sees_behind) | (star[:, 2] < 0.0)
        seen = np.zeros(len(X), dtype=bool)
        k = np.flatnonzero(front)
        with np.errstate(all="ignore"):
            xy = self._image(star[k])
            inside = np.all((xy >= self.low + border) & (xy <= self.high - border), axis=1)
            k = k[np.asarray(inside)]
            seen[k] = self._outwards(star[k])
        return seen

    def _image(self, star: FloatArray) -> FloatArray:
        """(n, 2) image coordinates of points in the axes of the image; NaN if there are none."""
        interior = np.broadcast_to(self.interior, (len(star), len(self.interior)))
        constants = np.broadcast_to(self.constants, (len(star), len(self.constants)))
        measured = np.zeros((len(star), 2))
        found = self.model.project(star, interior, constants, measured).xy
        if not self.model.corrects_measured:
            return found
        for _ in range(_ROUNDS):
            measured, found = found, self.model.project(star, interior, constants, found).xy
            moved = np.abs(found - measured)
            if not (moved > 0.0).any():
                break
        settled = np.all(moved <= _SETTLED * (self.high - self.low), axis=1)
        return np.where(np.asarray(settled)[:, None], found, np.nan)

    def _outwards(self, star: FloatArray) -> BoolArray:
        aside = np.linalg.norm(star[:, :2], axis=1)
        across = star[:, :2] / np.maximum(aside, 1e-300)[:, None]
        whole = np.arctan2(aside, -star[:, 2])
        good = np.ones(len(star), dtype=bool)
        middle = self._image(np.array([[0.0, 0.0, -1.0]]))
        before = np.zeros(len(star))
        for step in range(1, _ON_THE_WAY + 1):
            angle = whole * step / _ON_THE_WAY
            direction = np.concatenate([np.sin(angle)[:, None] * across, -np.cos(angle)[:, None]], axis=1)
            radius = np.linalg.norm(self._image(direction) - middle, axis=1)
            good &= (radius > before) | (aside == 0.0)
            before = radius
        return good


def image(reading: Reading, start: Start, number: int) -> Image:
    """An image of the project; NaN if it has no place."""
    images = reading.shop.things["image"]
    part = {name: int(blocks[number]) for name, blocks in images.parts.items()}
    name = reading.shop.things["camera"].ids[part["camera"]]
    camera, scale = reading.project.cameras[name], reading.scales[name]
    model = CAMERA_MODELS[camera.model]
    D = start.of("rotation", part["rotation"])
    r = start.of("eccentricity", part["eccentricity"])
    centre = start.of("point", part["position"]).copy()
    centre[2] += start.of("height", part["height"])[0]
    if part["relative rotation"] >= 0:
        centre += D.T @ (start.of("base", part["base"]) - r)
        D = start.of("rotation", part["relative rotation"]) @ D
    else:
        centre -= D.T @ r
    r0 = reading.edge.number(camera.r0 or "0", IMAGE, "", scale)
    low, high = image_format(scale, camera.image.width, camera.image.height) if camera.image else _NO_FORMAT
    interior = start.of(INTERIORS[camera.model].key, part["interior"])
    return Image(centre, D, model, interior, np.full(len(model.constants), r0), low, high)


_NO_FORMAT = np.full(2, np.nan), np.full(2, np.nan)


def image_format(scale: ImageScale, width: str, height: str) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner (2,) of a format in the coordinates inside, camera unit."""
    pixel = scale.pixel if np.isfinite(scale.pixel) else 1.0
    size = np.array([split(width)[0], split(height)[0]]) * pixel
    if scale.corner and scale.centre == (0.0, 0.0):  # origin inside: the upper left corner itself
        return np.array([0.0, -size[1]]), np.array([size[0], 0.0])
    return -0.5 * size, 0.5 * size


def instruments(reading: Reading, start: Start, space: str, numbers: IntArray, height: float) -> FloatArray:
    """(k, 3) where sights of stations begin, or those of systems, or of points at a ``height`` above them."""
    parts = reading.shop.things[space].parts
    found = start.values["point"][parts["position"][numbers]].copy()
    if space == "station":
        return np.asarray(found + start.values["height"][parts["height"][numbers]] * upwards(reading, found))
    return np.asarray(found + height * upwards(reading, found)) if space == "point" else found
