"""All rays of all frames in flat arrays, findable by frame and by point; targets above their points.

Heights act along the vertical and in the length unit. A part without either uses the rays to one height above every
point, the one that most rays go to: there a point stands for its target. As soon as it has both, its points come down.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.arrays import BoolArray, FloatArray, IntArray


class Sightings(NamedTuple):
    """Rays, point after point, those of a point in the order of their frames."""

    frame: IntArray
    """(n,)"""
    point: IntArray
    """(n,)"""
    rays: FloatArray
    """(n, 3) in the axes of the frame."""
    sigma: FloatArray
    height: FloatArray
    pointers: IntArray
    """(points+1,) the rays of point p are those from ``pointers[p]`` to ``pointers[p+1]``."""
    frames: int

    def of_points(self, points: IntArray) -> IntArray:
        """Numbers of all rays to some points."""
        starts, lengths = self.pointers[points], self.pointers[points + 1] - self.pointers[points]
        total = int(lengths.sum())
        offsets = np.repeat(starts - np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths)
        return np.asarray(offsets + np.arange(total))


def sightings(frames: Sequence[Frame], points: int) -> Sightings:
    """Flat arrays of the rays of frames to ``points`` point blocks."""
    none = np.zeros(0, dtype=np.int64)
    point = np.concatenate([none, *(frame.points for frame in frames)])
    order = np.argsort(point, kind="stable")
    counts = np.bincount(point, minlength=points)
    return Sightings(
        np.repeat(np.arange(len(frames)), [len(frame.points) for frame in frames])[order],
        point[order],
        np.concatenate([np.zeros((0, 3)), *(frame.rays for frame in frames)])[order],
        np.concatenate([np.zeros(0), *(frame.sigma for frame in frames)])[order],
        np.concatenate([np.zeros(0), *(frame.heights for frame in frames)])[order],
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        len(frames),
    )


def target_heights(frames: Sequence[Frame], points: int, marks: IntArray) -> FloatArray:
    """(points,) height above each point that most rays go to; 0 for ``marks``, which are measured themselves."""
    point = np.concatenate([np.zeros(0, dtype=np.int64), *(frame.points for frame in frames)])
    height = np.concatenate([np.zeros(0), *(frame.heights for frame in frames)])
    found = np.zeros(points)
    if not height.any():
        return found
    order = np.lexsort((height, point))
    point, height = point[order], height[order]
    fresh = np.append(True, (np.diff(point) != 0) | (np.diff(height) != 0.0))
    first = np.flatnonzero(fresh)
    count = np.diff(np.append(first, len(point)))
    for k in np.argsort(count, kind="stable").tolist():
        found[point[first[k]]] = height[first[k]]
    found[marks] = 0.0
    return found


def bare_frames(frames: Sequence[Frame], heights: FloatArray) -> tuple[Frame, ...]:
    """The frames with the rays to the targets at ``heights`` (points,) alone, as if these were the points."""
    return tuple(_bare(frame, frame.heights == heights[frame.points]) for frame in frames)


def _bare(frame: Frame, kept: BoolArray) -> Frame:
    return frame._replace(
        points=frame.points[kept],
        heights=np.zeros(int(kept.sum())),
        rays=frame.rays[kept],
        sigma=frame.sigma[kept],
    )
