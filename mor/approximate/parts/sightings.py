"""All rays of all frames in flat arrays, findable by frame and by point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Sightings:
    """Rays, frame after frame."""

    frame: IntArray
    """(n,)"""
    point: IntArray
    """(n,)"""
    rays: FloatArray
    """(n, 3) in the axes of the frame."""
    sigma: FloatArray
    height: FloatArray
    order: IntArray
    """(n,) rays sorted by point."""
    pointers: IntArray
    """(points+1,) the rays of point p are ``order[pointers[p]:pointers[p+1]]``."""
    frames: int

    def of_points(self, points: IntArray) -> IntArray:
        """Numbers of all rays to some points."""
        starts, lengths = self.pointers[points], self.pointers[points + 1] - self.pointers[points]
        total = int(lengths.sum())
        offsets = np.repeat(starts - np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths)
        return self.order[offsets + np.arange(total)]


def sightings(frames: Sequence[Frame], points: int) -> Sightings:
    """Flat arrays of the rays of frames to ``points`` point blocks."""
    none = np.zeros(0, dtype=np.int64)
    point = np.concatenate([none, *(frame.points for frame in frames)])
    order = np.argsort(point, kind="stable")
    counts = np.bincount(point, minlength=points)
    return Sightings(
        np.repeat(np.arange(len(frames)), [len(frame.points) for frame in frames]),
        point,
        np.concatenate([np.zeros((0, 3)), *(frame.rays for frame in frames)]),
        np.concatenate([np.zeros(0), *(frame.sigma for frame in frames)]),
        np.concatenate([np.zeros(0), *(frame.heights for frame in frames)]),
        order,
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        len(frames),
    )
