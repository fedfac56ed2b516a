"""A camera that is read out row by row while it flies: where a point is seen, and when."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sample_projects.simulate.camera import Camera, image_of
from sample_projects.simulate.geometry import Array, Frame

_ROUNDS = 12


class Flight(NamedTuple):
    """The pose of an image in the moment of its middle row, and how it moves, in its own axes."""

    frame: Frame
    velocity: Array
    """(3,) metres per second."""
    rate: Array
    """(3,) radians per second: by rate · t the camera has turned about its axes t seconds later."""

    def at(self, time: float) -> Frame:
        """The pose at a time after the middle row."""
        place = self.frame.position + time * self.frame.D.T @ self.velocity
        return Frame(place, turned(self.rate * time).T @ self.frame.D)


def turned(vector: Array) -> Array:
    """(3, 3) the rotation of a body by a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result: Array = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return result


def seen_by_row(camera: Camera, flight: Flight, point: Array, readout: float) -> Array:
    """(2,) image coordinates, mm, y up: the row a point is in when that row, counted from the top, is exposed.

    Row and time are found in turn; the image moves by some rows in a readout, so each round gains three digits.
    """
    time = 0.0
    xy = np.zeros(2)
    for _ in range(_ROUNDS):
        frame = flight.at(time)
        xy = image_of(camera, (frame.D @ (point - frame.position))[None])[0]
        time = readout * float(-xy[1] / (camera.height * camera.pixel))
    return xy
