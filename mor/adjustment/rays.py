"""Rays: two whitened observations each, from a frame to a point, linearised."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    residual: FloatArray
    by_point: FloatArray
    by_others: FloatArray
    columns: IntArray
    point_pointers: IntArray

    @property
    def rays(self) -> int:
        """Number of rays n."""
        return int(self.columns.shape[0])

    @property
    def points(self) -> int:
        """Number of points p."""
        return self.point_pointers.size - 1
