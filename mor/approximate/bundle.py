"""A bundle of rays in one frame, and how precisely each was measured.

Images and theodolites give the same thing: directions in a frame. They differ in where the measuring error
lies, in the image plane or across the ray. Both are a *measuring plane*: h·q = h·p for the ray p, with two
axes in it. For an image the plane is z = −c and the axes are x and y; for a theodolite it touches the unit
sphere at p.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mor.approximate.vectors import tangent_axes, unit
from mor.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Bundle:
    """Rays of one frame, towards the object: a point in front lies at a positive multiple of its ray."""

    rays: FloatArray
    """(n, 3) the rays p in the axes of the frame; of an image (x, y, −c)."""
    normals: FloatArray
    """(n, 3) h, normal to the measuring plane of each ray."""
    axes: FloatArray
    """(n, 3, 2) the two measured coordinates in the measuring plane, orthonormal."""
    sigma: FloatArray
    """(n,) standard deviation of a coordinate in the measuring plane, in the unit of the rays."""

    def __len__(self) -> int:
        return len(self.rays)

    def take(self, chosen: IntArray | BoolArray) -> Bundle:
        """Return the bundle of the chosen rays (indices or a mask)."""
        return Bundle(self.rays[chosen], self.normals[chosen], self.axes[chosen], self.sigma[chosen])

    @cached_property
    def whitened_axes(self) -> FloatArray:
        """(n, 3, 2) axes times σ: displacements of the rays per unit-variance measuring error."""
        return self.axes * self.sigma[:, None, None]

    @cached_property
    def lengths(self) -> FloatArray:
        """(n,) of the rays."""
        return np.asarray(np.linalg.norm(self.rays, axis=1))

    @cached_property
    def directions(self) -> FloatArray:
        """(n, 3) unit vectors."""
        return unit(self.rays)

    @property
    def noise(self) -> float:
        """Mean angular standard deviation of a ray in radians."""
        return float(np.mean(self.sigma / self.lengths))


def image_bundle(rays: FloatArray, sigma: float | FloatArray) -> Bundle:
    """Bundle of an image: rays (n, 3) as (x, y, −c), ``sigma`` of x and y in the image unit (scalar or (n,)).

    Each ray may carry a c of its own. Raises ``ValueError`` for shapes or σ ≤ 0 that make no bundle.
    """
    rays, spread = _checked(rays, sigma)
    normals = np.zeros_like(rays)
    normals[:, 2] = 1.0
    axes = np.zeros((len(rays), 3, 2))
    axes[:, 0, 0] = axes[:, 1, 1] = 1.0
    return Bundle(rays, normals, axes, spread)


def direction_bundle(rays: FloatArray, sigma: float | FloatArray) -> Bundle:
    """Bundle of directions of a theodolite: rays (n, 3) of any length, ``sigma`` across the ray in radians.

    Raises ``ValueError`` for shapes or σ ≤ 0 that make no bundle.
    """
    rays, spread = _checked(rays, sigma)
    directions = unit(rays)
    return Bundle(directions, directions, tangent_axes(directions), spread)


def _checked(rays: FloatArray, sigma: float | FloatArray) -> tuple[FloatArray, FloatArray]:
    rays = np.array(rays, dtype=float)
    if rays.ndim != 2 or rays.shape[1] != 3:
        raise ValueError(f"rays must have the shape (n, 3), not {rays.shape}")
    spread = np.array(np.broadcast_to(np.asarray(sigma, dtype=float), (len(rays),)))
    if not np.all(spread > 0.0):
        raise ValueError("the standard deviation of a ray must be positive")
    return rays, spread
