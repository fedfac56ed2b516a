"""Rays: two whitened observations each, from a frame to a point, linearised."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mor.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Rays:
    """A chunk of rays, sorted by point; a chunk holds whole points.

    Attributes:
        residual: (n, 2) computed − observed, divided by σ.
        by_point: (n, 2, 3) Jacobian by the coordinates of the point, divided by σ.
        by_others: (n, 2, K) Jacobian by all other unknowns, divided by σ.
        columns: (f, K) number of each of these unknowns in the reduced system, -1 where it is fixed, for every
            frame. No number twice in a row.
        point_pointers: (p+1,) the rays of point i are ``point_pointers[i]:point_pointers[i+1]``.
        frame_of_ray: (n,) frame of each ray; where it is left out, every ray has a frame of its own, f = n.

    Raises:
        ValueError: the shapes do not agree, or the points do not cover the rays.
    """

    residual: FloatArray
    by_point: FloatArray
    by_others: FloatArray
    columns: IntArray
    point_pointers: IntArray
    frame_of_ray: IntArray | None = None

    def __post_init__(self) -> None:
        n, width = self.frame.size, self.columns.shape[1]
        shapes = (self.residual.shape, self.by_point.shape, self.by_others.shape)
        if shapes != ((n, 2), (n, 2, 3), (n, 2, width)):
            raise ValueError(f"shapes of the rays do not agree: {n} rows of {width} columns, but {shapes}")
        pointers = self.point_pointers
        if pointers[0] != 0 or pointers[-1] != n or (np.diff(pointers) < 0).any():
            raise ValueError(f"the point pointers do not ascend from 0 to the number of rays, {n}")
        if n and (self.frame.min() < 0 or self.frame.max() >= len(self.columns)):
            raise ValueError(f"rays name frames beyond the {len(self.columns)} that have columns")

    @cached_property
    def frame(self) -> IntArray:
        """(n,) frame of each ray."""
        return np.arange(len(self.columns)) if self.frame_of_ray is None else self.frame_of_ray

    @property
    def columns_of_rays(self) -> IntArray:
        """(n, K) columns, ray by ray."""
        return self.columns if self.frame_of_ray is None else self.columns[self.frame_of_ray]

    @property
    def rays(self) -> int:
        """Number of rays n."""
        return int(self.residual.shape[0])

    @property
    def points(self) -> int:
        """Number of points p."""
        return self.point_pointers.size - 1
