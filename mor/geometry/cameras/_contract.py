"""Define a camera model: names of its interior parameters and one vectorised projection."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mor.arrays import FloatArray
from mor.units import Component


class Projection(NamedTuple):
    """Computed image coordinates of n points and their derivatives."""

    xy: FloatArray
    """(n, 2) image coordinates, image unit of the camera, x right, y up."""
    by_star: FloatArray
    """(n, 2, 3) derivatives by X*, Y*, Z*, the point in the image system."""
    by_interior: FloatArray
    """(n, 2, k) derivatives by the k interior components."""


class CameraModel(NamedTuple):
    """A camera model as a value.

    ``project(star, interior, constants, measured)`` takes the points in the image system (n, 3), the interior
    components (n, k), the constants of the camera (n, q) and the measured image coordinates (n, 2), and returns
    a :class:`Projection`. A model that corrects the *measured* coordinates (Brown) returns computed values moved
    back to the measured ones, so that computed − observed is the residual in its own corrected image.
    """

    key: str
    components: tuple[Component, ...]
    constants: tuple[Component, ...]
    project: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], Projection]
    sees_behind: bool = False
    """True if points with Z* ≥ 0 can be imaged (fisheye beyond 180 degrees)."""
    central: bool = True
    """True if images are central projections onto one plane but for distortion, which has a radial part."""
    corrects_measured: bool = False
    """True if ``project`` looks at the measured coordinates at all."""
