"""The rays of the eliminated points, linearised chunk by chunk and forgotten.

Image coordinates of the usual cameras are linearised by a compiled kernel; every other type of ray, and all of them
where there is no compiler, by its own equation in numpy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.adjustment.linearise import rotation_tangents
from mor.adjustment.problem import Problem
from mor.adjustment.rays.compiled import image_passes
from mor.adjustment.rays.compiled.image_passes import ImageRays
from mor.adjustment.rays.compiled.sights import image_rays, moving_rays, path_rays
from mor.adjustment.rays.compiled.sights.cameras import ALONG, MOVING
from mor.adjustment.rays.compiled.sights.image_rays import FrameChange, FrameValues, Measured
from mor.adjustment.rays.frames import GroupFrames, frame_change, frame_values
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.plan import Chunk, RayPlan, pieces
from mor.adjustment.rays.point_elimination import (
    accumulate,
    accumulate_images,
    back_substitute,
)
from mor.adjustment.rays.reduced_system import ReducedSystem
from mor.arrays import FloatArray, IntArray, SmallIntArray
from mor.observations import Computed
from mor.parameters.index import Values


class RayChunk(NamedTuple):
    """A chunk or a piece of one, linearised."""

    points: slice
    """Its eliminated points."""
    group: IntArray
    row: SmallIntArray
    weight: FloatArray
    """(n, 2) 1/σ, 0 where not observed."""
    rays: Rays


_Work = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class _Place:
    """Where the rays are linearised."""

    problem: Problem
    plan: RayPlan
    values: Values

    @cached_property
    def tangent(self) -> FloatArray | None:
        """Tangents of the rotations that move by angles."""
        return rotation_tangents(self.problem.index, self.values)

    @cached_property
    def frames(self) -> FrameValues:
        """What kernels take of the frames."""
        return frame_values(self.plan.frames, self.problem.groups, self.values, self.tangent)


def ray_chunks(problem: Problem, plan: RayPlan, reduced: IntArray, values: Values) -> Iterator[RayChunk]:
    """All chunks in pieces, linearised at the values; ``reduced`` (u,) numbers the unknowns of the reduced system.

    The arrays of a piece are overwritten by the next one: fresh memory costs a tenth of the whole pass.
    """
    place = _Place(problem, plan, values)
    columns = _reduced_columns(plan, reduced)
    parts = [tuple(pieces(chunk, plan.pointers)) for chunk in plan.chunks]
    work = _workspace(plan, list(chain(*parts)))
    for chunk, divided in zip(plan.chunks, parts, strict=True):
        of_frames = columns[chunk.frames]
        for piece in divided:
            yield _ray_chunk(place, piece, of_frames, work)


class EliminatedChunk(NamedTuple):
    """One chunk whose points are eliminated."""

    points: slice
    gradient: FloatArray
    """(p, 3) −Σ aᵀ residual of the points."""
    squares: float
    """Sum of the squared residuals."""


def eliminate_chunks(
    problem: Problem, plan: RayPlan, reduced: IntArray, values: Values, system: ReducedSystem, damping: float
) -> Iterator[EliminatedChunk]:
    """Linearise all chunks and eliminate their points; what they leave is added to the system, in place."""
    place = _Place(problem, plan, values)
    columns = _reduced_columns(plan, reduced)
    work: _Work | None = None
    for chunk in plan.chunks:
        of_frames = columns[chunk.frames]
        if _all_compiled(place, chunk):
            noted, squares = accumulate_images(of_frames, _image_rays(place, chunk), system, damping)
        else:
            work = work or _workspace(plan, plan.chunks)
            linearised = _ray_chunk(place, chunk, of_frames, work).rays
            noted = accumulate(linearised, system, damping)
            squares = float(np.vdot(linearised.residual, linearised.residual))
        yield EliminatedChunk(chunk.points, noted.gradient, squares)


def point_steps(
    problem: Problem, plan: RayPlan, values: Values, step: FloatArray, damping: float
) -> Iterator[tuple[slice, FloatArray]]:
    """The steps (p, 3) with which the points of each chunk follow a step (u,) of all other unknowns."""
    place = _Place(problem, plan, values)
    change: FrameChange | None = None
    work: _Work | None = None
    for chunk in plan.chunks:
        if _all_compiled(place, chunk):
            steps = np.empty((chunk.points.stop - chunk.points.start, 3))
            rays = _image_rays(place, chunk)
            change = change or frame_change(
                plan.frames,
                problem.groups,
                problem.index,
                step,
                place.tangent,
                place.frames.interior.shape[1],
            )
            image_passes.solve_image_points(rays, rays.paths, change, damping, steps)
        else:
            work = work or _workspace(plan, plan.chunks)
            linearised = _ray_chunk(place, chunk, plan.frames.columns[chunk.frames], work).rays
            steps = back_substitute(linearised, step, damping)
        yield chunk.points, steps


def ray_residuals(problem: Problem, plan: RayPlan, values: Values) -> Iterator[tuple[Chunk, FloatArray]]:
    """Residuals (n, 2) of the rays of every chunk, computed − observed, divided by σ; 0 where not observed."""
    place = _Place(problem, plan, values)
    for chunk in plan.chunks:
        residual = np.empty((chunk.rays.stop - chunk.rays.start, 2))
        frame = chunk.frames[plan.frame[chunk.rays]]
        measured = _measured(plan, chunk)
        if _fits(place, chunk):
            points = values["point"][plan.points[chunk.points]]
            arrays = place.frames, frame, _pointers(plan, chunk), points, measured, residual
            image_rays.residuals(*arrays)
            if _any_moving(place, chunk):
                moving_rays.moving_residuals(*arrays)
            if _any_along(place, chunk):
                path_rays.residuals_along(*arrays)
        for group, here in _left_to_numpy(place, chunk, frame):
            rows = plan.row[chunk.rays][here]
            computed = problem.equations.computed_values(group.group, values, rows)
            residual[here] = (computed - measured.observed[here]) * measured.weight[here]
        yield chunk, np.where(measured.weight > 0.0, residual, 0.0)


def ray_objective(problem: Problem, plan: RayPlan, values: Values) -> float:
    """Σ (v/σ)² of the rays; infinite where an equation cannot be evaluated."""
    total = sum(float(np.vdot(residual, residual)) for _, residual in ray_residuals(problem, plan, values))
    return total if np.isfinite(total) else np.inf


def _reduced_columns(plan: RayPlan, reduced: IntArray) -> IntArray:
    columns = plan.frames.columns
    return np.where(columns >= 0, reduced[columns], -1) if columns.size else columns


def _workspace(plan: RayPlan, chunks: Sequence[Chunk]) -> _Work:
    """Room for the residuals and Jacobians of the largest of the chunks."""
    n = max((chunk.rays.stop - chunk.rays.start for chunk in chunks), default=0)
    return np.empty((n, 2)), np.empty((n, 2, 3)), np.empty((n, 2, plan.frames.columns.shape[1]))


def _ray_chunk(place: _Place, chunk: Chunk, columns: IntArray, work: _Work) -> RayChunk:
    plan = place.plan
    local = plan.frame[chunk.rays].astype(np.int64)
    frame = chunk.frames[local]
    n, width = len(local), columns.shape[1]
    residual, by_point, by_others = (array[:n] for array in work)
    measured, pointers = _measured(plan, chunk), _pointers(plan, chunk)
    if _fits(place, chunk):
        points = np.take(
            place.values["point"], plan.points[chunk.points], axis=0
        )  # a third of the time of an index
        arrays = place.frames, plan.frames.layout, frame, pointers, points, measured
        image_rays.linearise(*arrays, residual, by_point, by_others)
        if _any_moving(place, chunk):
            moving_rays.linearise_moving(*arrays, residual, by_point, by_others)
        if _any_along(place, chunk):
            path_rays.linearise_along(*arrays, residual, by_point, by_others)
    for group, here in _left_to_numpy(place, chunk, frame):
        weight = measured.weight[here]
        computed = place.problem.equations.computed(group.group, place.values, plan.row[chunk.rays][here])
        by_others[here] = _by_frame(place, group, frame[here], computed, width) * weight[:, :, None]
        by_point[here] = computed.jacobians[-1] * weight[:, :, None]
        residual[here] = (computed.values - measured.observed[here]) * weight
        seen = weight > 0.0
        if not seen.all():
            for array in (residual, by_point, by_others):
                array[here] = np.where(seen.reshape(*seen.shape, *(1,) * (array.ndim - 2)), array[here], 0.0)
    rays = Rays(residual, by_point, by_others, columns, pointers, local)
    group_of_ray = plan.group_of_frame[frame]
    return RayChunk(chunk.points, group_of_ray, plan.row[chunk.rays], measured.weight, rays)


def _image_rays(place: _Place, chunk: Chunk) -> ImageRays:
    plan = place.plan
    points = np.take(
        place.values["point"], plan.points[chunk.points], axis=0
    )  # a third of the time of an index
    local, pointers, layout = plan.frame[chunk.rays], _pointers(plan, chunk), plan.frames.layout
    return ImageRays(place.frames, layout, chunk.frames, local, pointers, points, _measured(plan, chunk))


def _fits(place: _Place, chunk: Chunk) -> bool:
    """True where some rays of the chunk have a compiled form."""
    return compilation.wanted() and bool((place.frames.model[chunk.frames] >= 0).any())


def _all_compiled(place: _Place, chunk: Chunk) -> bool:
    """True where all rays of the chunk have a compiled form."""
    return compilation.wanted() and bool((place.frames.model[chunk.frames] >= 0).all())


def _any_moving(place: _Place, chunk: Chunk) -> bool:
    """True where some rays of the chunk are of a rolling shutter."""
    model = place.frames.model[chunk.frames]
    return bool(((model >= MOVING) & (model < ALONG)).any())


def _any_along(place: _Place, chunk: Chunk) -> bool:
    """True where some rays of the chunk are along a trajectory."""
    return bool((place.frames.model[chunk.frames] >= ALONG).any())


def _left_to_numpy(place: _Place, chunk: Chunk, frame: IntArray) -> Iterator[tuple[GroupFrames, IntArray]]:
    """Rays of a chunk that have no compiled form, group by group."""
    plain = [g for g in place.plan.frames.groups if g.model < 0 or not compilation.wanted()]
    if not plain:
        return
    group_of_ray = place.plan.group_of_frame[frame]
    for group in plain:
        here = np.flatnonzero(group_of_ray == group.group)
        if len(here):
            yield group, here


def _by_frame(
    place: _Place, group: GroupFrames, frame: IntArray, computed: Computed, width: int
) -> FloatArray:
    """Jacobian (n, 2, K) by the unknowns of the frames."""
    result = np.zeros((len(frame), 2, width))
    slots = place.problem.groups[group.group].type.slots
    for pick in group.picks:
        jacobian = computed.jacobians[pick.slot]
        if slots[pick.slot].kind == "rotation" and place.tangent is not None:
            jacobian = jacobian @ place.tangent[group.blocks[pick.slot][frame - group.first]]
        result[:, :, pick.columns] = jacobian[:, :, pick.components]
    return result


def _measured(plan: RayPlan, chunk: Chunk) -> Measured:
    return plan.measurements.of(chunk.rays)


def _pointers(plan: RayPlan, chunk: Chunk) -> IntArray:
    pointers: IntArray = plan.pointers[chunk.points.start : chunk.points.stop + 1] - chunk.rays.start
    return pointers
