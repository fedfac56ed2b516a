"""The simulated camera: central projection with radial, decentring and affine distortion, and its image format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sample_projects.simulate.geometry import Array, Frame, Mask, incidence


@dataclass(frozen=True)
class Camera:
    """Interior orientation in mm, distortion as added to the ideal image coordinates, format in pixels."""

    c: float
    width: int
    height: int
    pixel: float
    xh: float = 0.0
    yh: float = 0.0
    radial: tuple[float, ...] = ()
    """A1, A2, …"""
    decentring: tuple[float, float] = (0.0, 0.0)
    """B1, B2."""
    affine: tuple[float, float] = (0.0, 0.0)
    """C1, C2."""
    r0: float = 0.0

    @property
    def half_format(self) -> Array:
        """Half width and half height in mm."""
        return np.array([self.width, self.height]) * self.pixel / 2.0

    def components(self) -> list[tuple[str, float]]:
        """Names and values of the interior orientation."""
        radial = [(f"A{k}", value) for k, value in enumerate(self.radial, start=1)]
        rest = list(zip(("B1", "B2", "C1", "C2"), (*self.decentring, *self.affine), strict=True))
        return [("c", self.c), ("xh", self.xh), ("yh", self.yh), *radial, *[pair for pair in rest if pair[1]]]


def in_axes(frame: Frame, points: Array) -> Array:
    """(n, 3) points in the axes of a frame."""
    result: Array = (points - frame.position) @ frame.D.T
    return result


def image_of(camera: Camera, star: Array) -> Array:
    """(n, 2) image coordinates in mm, origin in the centre of the image, y up, of points in camera axes."""
    ideal = -camera.c * star[:, :2] / star[:, 2:]
    x, y = ideal.T
    square = x**2 + y**2
    radial = sum(
        (a * (square**k - camera.r0 ** (2 * k)) for k, a in enumerate(camera.radial, start=1)),
        np.zeros(len(x)),
    )
    b1, b2 = camera.decentring
    c1, c2 = camera.affine
    dx = x * radial + b1 * (square + 2.0 * x**2) + 2.0 * b2 * x * y + c1 * x + c2 * y
    dy = y * radial + b2 * (square + 2.0 * y**2) + 2.0 * b1 * x * y
    return np.stack([camera.xh + x + dx, camera.yh + y + dy], axis=1)


def inside(camera: Camera, star: Array, border: float = 10.0) -> Mask:
    """(n,) true where points in camera axes are in front of the camera and inside the format, a border (px) off."""
    ahead = star[:, 2] < 0.0
    safe = np.where(ahead[:, None], star, np.array([0.0, 0.0, -1.0]))
    limit = camera.half_format - border * camera.pixel
    ideal = np.abs(camera.c * safe[:, :2] / safe[:, 2:])
    near = (ideal < 1.3 * camera.half_format).all(axis=1)  # far outside, the polynomials may fold back inside
    result: Mask = ahead & near & (np.abs(image_of(camera, safe)) < limit).all(axis=1)
    return result


def sees(camera: Camera, frame: Frame, points: Array, normals: Array, steepest: float) -> Mask:
    """(n,) true for targets inside the format and facing the camera at no more than the angle ``steepest``."""
    return inside(camera, in_axes(frame, points)) & (incidence(points, normals, frame.position) < steepest)


def pixels(camera: Camera, xy: Array) -> Array:
    """(n, 2) pixel coordinates from the upper left corner, y down, of image coordinates in mm."""
    centre = np.array([camera.width, camera.height]) / 2.0
    result: Array = centre + xy / camera.pixel * np.array([1.0, -1.0])
    return result
