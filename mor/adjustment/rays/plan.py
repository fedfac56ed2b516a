"""The rays of the eliminated points, sorted by point and cut into chunks: worked out once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mor import compilation, long_arrays
from mor.adjustment.problem import Problem
from mor.adjustment.rays.compiled import sorting
from mor.adjustment.rays.compiled.sights.image_rays import Measured
from mor.adjustment.rays.frames import Frames, GroupFrames, all_frames, group_frames, is_ray
from mor.adjustment.rays.knots import along_trajectory, clock_of_rows
from mor.arrays import AnyIntArray, FloatArray, IntArray, SmallIntArray
from mor.long_arrays import kept
from mor.observations import IMAGE_TYPES, MOVING_TYPES, ObservationGroup
from mor.observations.on_the_sphere import is_on_the_sphere

POINTS_AT_A_TIME, RAYS_AT_A_TIME = 8192, 262_144
"""Points and rays of a chunk at most, so many that they share blocks."""
POINTS_OF_A_PIECE = 2048
"""Points of a piece of a chunk, so few that the Jacobians of their rays stay near."""

VERY_MANY_RAYS = 4_000_000
"""Rays beyond which their measurements are not kept twice, for which an iteration takes 2 % longer."""


class Chunk(NamedTuple):
    """Whole points and their rays."""

    points: slice
    rays: slice
    frames: IntArray
    """Frames of its rays, which name them by their place in this list."""


def pieces(chunk: Chunk, pointers: IntArray) -> Iterator[Chunk]:
    """The points of a chunk, with their rays, a few at a time; the pieces share its list of frames."""
    for first in range(chunk.points.start, chunk.points.stop, POINTS_OF_A_PIECE):
        last = min(first + POINTS_OF_A_PIECE, chunk.points.stop)
        yield Chunk(slice(first, last), slice(int(pointers[first]), int(pointers[last])), chunk.frames)


class Measurements(NamedTuple):
    """Measurements of all n rays, in their order.

    Where all come from one group and have one σ, weights are kept for one chunk only; and where they are very many,
    measurements are not kept twice, but taken from the group, chunk by chunk.
    """

    observed: FloatArray
    """(n, 2); or those of the group, in its own order."""
    weight: FloatArray
    """(n, 2) 1/σ, 0 where nothing was observed; or as many of the common one as the largest chunk has rays."""
    measured: FloatArray
    """(n, 2) measured coordinates that a camera model may correct; ``observed`` itself for most."""
    clock: FloatArray
    """(n, 3) when rays along trajectories are; (0, 3) where there are none."""
    row: SmallIntArray | None = None
    """(n,) row of each ray in its group, where the measurements are taken from there."""

    def of(self, rays: slice) -> Measured:
        """Measurements of the rays of one chunk."""
        count = rays.stop - rays.start
        weight = self.weight[:count] if len(self.weight) < len(self.observed) else self.weight[rays]
        if self.row is None:
            return Measured(self.observed[rays], weight, self.measured[rays], self.clock[rays])
        observed = np.take(self.observed, self.row[rays], axis=0)  # in a quarter of the time of an index
        return Measured(observed, weight, observed, self.clock[rays])


class RayPlan(NamedTuple):
    """Rays of the eliminated points, sorted by point, those of a point by frame."""

    points: IntArray
    """(p,) numbers of the point blocks."""
    columns: IntArray
    """(p, 3) unknowns of the eliminated points."""
    pointers: IntArray
    """(p+1,) rays of each point."""
    row: SmallIntArray
    """(n,) row of each ray in its group."""
    frame: SmallIntArray
    """(n,) frame of each ray within its chunk."""
    frames: Frames
    group_of_frame: IntArray
    """(f,) observation group of each frame."""
    measurements: Measurements
    chunks: tuple[Chunk, ...]

    @property
    def frame_of_ray(self) -> IntArray:
        """(n,) frame of each ray."""
        parts = [chunk.frames[self.frame[chunk.rays]] for chunk in self.chunks]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

    def rows_of_group(self, number: int) -> AnyIntArray:
        """Rows of a group that are rays of eliminated points."""
        if len(self.frames.groups) == 1 and self.frames.groups[0].group == number:
            return self.row
        return self.row[self.group_of_frame[self.frame_of_ray] == number] if len(self.row) else self.row

    def together(self, groups: Sequence[ObservationGroup]) -> Iterator[tuple[str, IntArray]]:
        """Blocks (2, f) of the frames that go together, and the kind of the first: with a rotation, the second."""
        for own in self.frames.groups:
            for pair in own.together:
                yield groups[own.group].type.slots[pair[0]].kind, own.blocks[list(pair)]


def plan_rays(problem: Problem, points: IntArray) -> RayPlan:
    """Sort the rays of the points (numbers of point blocks) by point and cut them into chunks."""
    index, groups = problem.index, problem.groups
    place = np.full(len(index.blocks["point"].ids) if "point" in index.blocks else 0, -1, dtype=np.int64)
    place[points] = np.arange(len(points))
    found: list[GroupFrames] = []
    parts: list[tuple[IntArray, IntArray, IntArray]] = []
    first = 0
    for number, group in enumerate(groups):
        rows = np.flatnonzero(place[group.blocks[-1]] >= 0) if is_ray(group) and len(points) else points[:0]
        if len(rows) == 0:
            continue
        frame, own = group_frames(number, first, group, index, rows)
        found.append(own)
        parts.append((rows, place[group.blocks[-1][rows]], frame + first))
        first += own.count
    none = np.zeros(0, dtype=np.int64)
    row, point, frame = (
        parts[0] if len(parts) == 1 else map(np.concatenate, zip((none,) * 3, *parts, strict=True))
    )
    pointers, order = _order(point, frame, len(points))
    row, frame = kept(row.astype(np.int32)[order]), frame[order]
    frames = all_frames(tuple(found), groups, index)
    group_of_frame = np.repeat([g.group for g in found], [g.count for g in found]).astype(np.int64)
    local, chunks = _chunks(pointers, frame, first)
    columns = index.columns["point"][points] if len(points) else np.zeros((0, 3), dtype=np.int64)
    longest = max((chunk.rays.stop - chunk.rays.start for chunk in chunks), default=0)
    measured = _measured(groups, found, frame, row, longest)
    return RayPlan(points, columns, pointers, row, local, frames, group_of_frame, measured, chunks)


def _order(point: IntArray, frame: IntArray, points: int) -> tuple[IntArray, IntArray]:
    if compilation.wanted():
        pointers, order = sorting.by_point_and_frame(point, frame, points)
        return pointers, order
    counts = np.bincount(point, minlength=points)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), np.lexsort((frame, point))


def _chunks(pointers: IntArray, frame: IntArray, frames: int) -> tuple[SmallIntArray, tuple[Chunk, ...]]:
    """Frame (n,) of each ray within its chunk, and the chunks."""
    bounds = [0]
    while bounds[-1] < len(pointers) - 1:
        last = int(np.searchsorted(pointers, pointers[bounds[-1]] + RAYS_AT_A_TIME, side="right")) - 1
        bounds.append(max(min(last, bounds[-1] + POINTS_AT_A_TIME), bounds[-1] + 1))
    first_ray = pointers[bounds]
    local = long_arrays.empty(len(frame), np.int32)
    of_chunk, found = sorting.local_numbers(frame, first_ray, frames, local)
    chunks = tuple(
        Chunk(
            slice(bounds[c], bounds[c + 1]),
            slice(int(first_ray[c]), int(first_ray[c + 1])),
            found[of_chunk[c] : of_chunk[c + 1]],
        )
        for c in range(len(bounds) - 1)
    )
    return local, chunks


def _measured(
    groups: tuple[ObservationGroup, ...],
    frames: list[GroupFrames],
    frame: IntArray,
    row: SmallIntArray,
    longest: int,
) -> Measurements:
    """Measurements in the order of the rays; ``longest`` is the number of rays of the largest chunk."""
    if len(frames) == 1:
        return _of_rows(groups[frames[0].group], row, longest)
    parts = tuple(np.empty((len(row), 2)) for _ in range(3))
    clock = np.zeros((len(row) if any(along_trajectory(groups[own.group]) for own in frames) else 0, 3))
    for own in frames:
        here = np.flatnonzero((frame >= own.first) & (frame < own.first + own.count))
        found = _of_rows(groups[own.group], row[here], len(here))
        for part, values in zip(parts, found[:3], strict=True):
            part[here] = values
        if len(found.clock):
            clock[here] = found.clock
    return Measurements(parts[0], parts[1], parts[2], clock)


def _of_rows(group: ObservationGroup, rows: SmallIntArray, longest: int) -> Measurements:
    """Measurements of some rows of a group."""
    # Nothing else looks at the measured coordinates.
    looking = (IMAGE_TYPES["brown"], IMAGE_TYPES["panorama"], MOVING_TYPES["brown"])
    inverse = group.type in looking or along_trajectory(group)
    forward = not inverse and not is_on_the_sphere(group.type)
    clock = clock_of_rows(group, rows)
    one_sigma = group.sigma.strides == (0, 8) and bool(np.isfinite(group.observed).all())
    if forward and one_sigma and longest < len(rows):
        weight = 1.0 / group.sigma[:longest]
        if len(rows) > VERY_MANY_RAYS:
            return Measurements(group.observed, weight, group.observed, clock, rows)
        observed = _taken(group.observed, rows)
        return Measurements(observed, weight, observed, clock)
    observed, weight = _taken(group.observed, rows), kept(1.0 / group.sigma[rows])
    unseen = ~np.isfinite(observed)
    if unseen.any():
        observed[unseen] = weight[unseen] = 0.0
    if forward:
        return Measurements(observed, weight, observed, clock)
    return Measurements(observed, weight, kept(np.nan_to_num(group.constants[rows, :2])), clock)


def _taken(values: FloatArray, rows: SmallIntArray) -> FloatArray:
    """Rows (n,) of values (k, 2)."""
    result: FloatArray = long_arrays.empty((len(rows), 2))
    return np.take(values, rows, axis=0, out=result)
