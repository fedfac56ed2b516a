"""The rays of the eliminated points, sorted by point, linearised chunk by chunk and forgotten."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mor.adjustment.eliminable import is_ray
from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.problem import Problem
from mor.adjustment.rays import Rays
from mor.geometry.arrays import FloatArray, IntArray
from mor.parameters.index import Values

RAYS_AT_A_TIME = 8192
"""Rays of a chunk, about: small enough for the Jacobians to stay in the cache."""


@dataclass(frozen=True)
class RayPlan:
    """Rays of the eliminated points."""

    columns: IntArray
    """(p, 3) unknowns of the eliminated points."""
    pointers: IntArray
    """(p+1,) rays of each point."""
    group: IntArray
    """(n,) observation group of each ray."""
    row: IntArray
    """(n,) row in its group."""
    chunks: tuple[tuple[int, int], ...]
    """Ranges of points, whole points each."""


class RayChunk(NamedTuple):
    """One chunk, linearised."""

    points: slice
    """Its eliminated points."""
    group: IntArray
    row: IntArray
    rays: Rays


def plan_rays(problem: Problem, points: IntArray) -> RayPlan:
    """Sort the rays of the points (numbers of point blocks) by point and cut them into chunks."""
    blocks = problem.index.blocks.get("point")
    place = np.full(len(blocks.ids) if blocks else 0, -1, dtype=np.int64)
    place[points] = np.arange(len(points))
    parts = [
        (np.full(group.count, number), np.arange(group.count), place[group.blocks[-1]])
        for number, group in enumerate(problem.groups)
        if is_ray(group)
    ]
    none = np.zeros(0, dtype=np.int64)
    group, row, point = (
        np.concatenate([none, *arrays]) for arrays in (zip(*parts, strict=True) if parts else [()] * 3)
    )
    mine = point >= 0
    order = np.flatnonzero(mine)[np.argsort(point[mine], kind="stable")]
    pointers = np.concatenate([[0], np.cumsum(np.bincount(point[mine], minlength=len(points)))]).astype(
        np.int64
    )
    columns = problem.index.columns["point"][points] if blocks else np.zeros((0, 3), dtype=np.int64)
    return RayPlan(columns, pointers, group[order], row[order], _chunks(pointers))


def _chunks(pointers: IntArray) -> tuple[tuple[int, int], ...]:
    chunks, first = [], 0
    while first < len(pointers) - 1:
        last = int(np.searchsorted(pointers, pointers[first] + RAYS_AT_A_TIME, side="right")) - 1
        last = max(last, first + 1)
        chunks.append((first, last))
        first = last
    return tuple(chunks)


def ray_chunks(problem: Problem, plan: RayPlan, reduced: IntArray, values: Values) -> Iterator[RayChunk]:
    """All chunks, linearised at the values; ``reduced`` (u,) numbers the unknowns of the reduced system."""
    tangent = rotation_tangents(problem.index, values)
    for first, last in plan.chunks:
        part = slice(int(plan.pointers[first]), int(plan.pointers[last]))
        group, row = plan.group[part], plan.row[part]
        rays = _linearised(problem, group, row, reduced, values, tangent)
        pointers = plan.pointers[first : last + 1] - plan.pointers[first]
        yield RayChunk(slice(first, last), group, row, Rays(*rays, pointers))


def _linearised(
    problem: Problem,
    group: IntArray,
    row: IntArray,
    reduced: IntArray,
    values: Values,
    tangent: FloatArray | None,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Whitened residuals and Jacobians of rays that may belong to several groups."""
    numbers = np.unique(group)
    parts = []
    for number in numbers:
        here = slice(None) if len(numbers) == 1 else np.flatnonzero(group == number)
        observations = problem.groups[number]
        rows = row[here]
        part = linearise(observations, problem.index, values, tangent, rows)
        weight = np.where(observations.mask[rows], 1.0 / observations.sigma[rows], 0.0)
        columns = np.where(part.columns[:, :-3] >= 0, reduced[part.columns[:, :-3]], -1)
        jacobian = part.jacobian * weight[:, :, None]
        parts.append((here, -part.misclosure * weight, jacobian[:, :, -3:], jacobian[:, :, :-3], columns))
    if len(parts) == 1:
        _, residual, by_point, by_others, columns = parts[0]
        return residual, np.ascontiguousarray(by_point), np.ascontiguousarray(by_others), columns
    return _merged(parts, len(row))


def _merged(parts: list[tuple[IntArray | slice, FloatArray, FloatArray, FloatArray, IntArray]], count: int):  # type: ignore[no-untyped-def]
    width = max(part[4].shape[1] for part in parts)
    residual, by_point = np.zeros((count, 2)), np.zeros((count, 2, 3))
    by_others, columns = np.zeros((count, 2, width)), np.full((count, width), -1, dtype=np.int64)
    for here, v, at_point, at_others, own in parts:
        residual[here], by_point[here] = v, at_point
        by_others[here, :, : own.shape[1]] = at_others
        columns[here, : own.shape[1]] = own
    return residual, by_point, by_others, columns


def ray_objective(problem: Problem, plan: RayPlan, values: Values) -> float:
    """Σ (v/σ)² of the rays."""
    total = 0.0
    for first, last in plan.chunks:
        part = slice(int(plan.pointers[first]), int(plan.pointers[last]))
        group, row = plan.group[part], plan.row[part]
        for number in np.unique(group):
            rows = row[group == number]
            observations = problem.groups[number]
            scaled = misclosures(observations, values, rows) / observations.sigma[rows]
            total += (
                float(np.nansum(scaled**2)) if np.isfinite(scaled[observations.mask[rows]]).all() else np.inf
            )
    return total
