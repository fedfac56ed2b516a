"""Rays: two whitened observations each, from a frame to a point, linearised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.geometry.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Rays:
    """A chunk of rays, sorted by point; a chunk holds whole points.

    Attributes:
        residual: (n, 2) computed − observed, divided by σ.
        by_point: (n, 2, 3) Jacobian by the coordinates of the point, divided by σ.
        by_others: (n, 2, K) Jacobian by all other unknowns, divided by σ.
        columns: (n, K) number of each of these unknowns in the reduced system, -1 where it is fixed. No
            number twice in a row.
        point_pointers: (p+1,) the rays of point i are ``point_pointers[i]:point_pointers[i+1]``.

    Raises:
        ValueError: the shapes do not agree, or the points do not cover the rays.
    """

    residual: FloatArray
    by_point: FloatArray
    by_others: FloatArray
    columns: IntArray
    point_pointers: IntArray

    def __post_init__(self) -> None:
        n, width = self.columns.shape
        shapes = (self.residual.shape, self.by_point.shape, self.by_others.shape)
        if shapes != ((n, 2), (n, 2, 3), (n, 2, width)):
            raise ValueError(f"shapes of the rays do not agree: {n} rows of {width} columns, but {shapes}")
        pointers = self.point_pointers
        if pointers[0] != 0 or pointers[-1] != n or (np.diff(pointers) < 0).any():
            raise ValueError(f"the point pointers do not ascend from 0 to the number of rays, {n}")

    @property
    def rays(self) -> int:
        """Number of rays n."""
        return int(self.columns.shape[0])

    @property
    def points(self) -> int:
        """Number of points p."""
        return self.point_pointers.size - 1
