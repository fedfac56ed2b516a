"""Bodies that the observations leave loose even where all else is known: found without solving anything.

The normal matrix of one body (a point, an image with its pose) with all others held is a block on the diagonal of the
whole one. Where it is singular, so is the whole: a null vector of it is one of the system.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.index import Values, move

_FEW = 4
"""Observations for each unknown of a body up to which its normal matrix is worked out."""
_BESIDE = 1e-3
"""Radians, and part of the extent of the network, by which values are moved: is their place singular alone?"""
_ROWS = 50_000
"""Rows of a group that are linearised at a time."""


def beside(problem: Problem, values: Values) -> Values:
    """Values a little beside others (seeded): what is singular at both is so in general, not by chance of its place."""
    random = np.random.default_rng(1763)
    points = values["point"] if "point" in values else np.zeros((1, 3))
    extent = float(np.ptp(points, axis=0).max(initial=0.0)) or 1.0
    scale = np.zeros(problem.index.count)
    for number, kind in enumerate(problem.index.unknown_kind):
        size = _BESIDE * extent if kind in ("point", "base") else _BESIDE if kind == "rotation" else 0.0
        scale[problem.index.kind_of == number] = size
    return move(problem.index, values, scale * random.standard_normal(problem.index.count))


class LocalDefects(NamedTuple):
    """Bodies (n,) that are loose, and how many rows refer to each."""

    loose: BoolArray
    rows: IntArray
    too_few: BoolArray
    """Loose ones with fewer observations than unknowns."""


class _Bodies(NamedTuple):
    """Bodies of the unknowns (u,), −1 for none, and the number of each within its body."""

    body: IntArray
    place: IntArray
    sizes: IntArray


def local_defects(
    problem: Problem, values: Values, bodies: Mapping[str, IntArray], count: int
) -> LocalDefects:
    """Loose ones among ``count`` bodies; ``bodies[kind]`` (n,) are those of the blocks, −1 for none."""
    bodies = {kind: body for kind, body in bodies.items() if (body >= 0).any()}
    of = _bodies(problem, bodies, count)
    rows, entries = _counts(problem, bodies, count)
    too_few = (of.sizes > 0) & (entries < of.sizes)
    doubtful = (
        (of.sizes > 0) & ~too_few & (entries <= _FEW * of.sizes) & ~_by_rays_only(problem, bodies, count)
    )
    loose = too_few.copy()
    loose[doubtful] = _singular(_normals(problem, values, bodies, of, doubtful), of.sizes[doubtful])
    return LocalDefects(loose, rows, too_few)


def _bodies(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> _Bodies:
    index = problem.index
    body = np.full(index.count, -1, dtype=np.int64)
    for number, kind in enumerate(index.unknown_kind):
        mine = index.kind_of == number
        if kind in bodies:
            body[mine] = bodies[kind][index.block_of[mine]]
    sizes = np.bincount(body[body >= 0], minlength=count)
    place = np.zeros(index.count, dtype=np.int64)
    order = np.argsort(body, kind="stable")
    order = order[body[order] >= 0]
    starts = np.cumsum(sizes) - sizes
    place[order] = np.arange(len(order)) - starts[body[order]]
    return _Bodies(body, place, sizes)


def _counts(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> tuple[IntArray, IntArray]:
    """Rows and observed components (bodies,) that refer to each body."""
    rows, entries = np.zeros((2, count), dtype=np.int64)
    for group in problem.groups:
        observed = np.count_nonzero(group.mask & ~group.left_out, axis=1)
        earlier: list[IntArray] = []
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind not in bodies:
                continue
            mine = bodies[slot.kind][numbers]
            fresh = mine >= 0
            for other in earlier:
                fresh &= other != mine
            rows += np.bincount(mine[fresh], minlength=count)
            weighted = np.bincount(mine[fresh], weights=observed[fresh], minlength=count)
            entries += weighted.astype(np.int64)
            earlier.append(mine)
    return rows, entries


def _by_rays_only(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> BoolArray:
    """(bodies,) true where nothing but rays to it refers to a body: two of them determine it, or are parallel."""
    other = np.zeros(count, dtype=bool)
    for group in problem.groups:
        ray = len(group.type.components) == 2 and group.type.slots[-1].of == "point"
        for k, (slot, numbers) in enumerate(zip(group.type.slots, group.blocks, strict=True)):
            if slot.kind in bodies and not (ray and k == len(group.type.slots) - 1 and slot.kind == "point"):
                mine = bodies[slot.kind][numbers]
                other[mine[mine >= 0]] = True
    return ~other


def _normals(
    problem: Problem, values: Values, bodies: Mapping[str, IntArray], of: _Bodies, wanted: BoolArray
) -> FloatArray:
    """(k, w, w) normal matrices of the wanted bodies."""
    width, count = int(of.sizes[wanted].max(initial=0)), int(np.count_nonzero(wanted))
    flat = np.zeros(count * width * width)
    tangent = rotation_tangents(problem.index, values)
    number = np.where(wanted, np.cumsum(wanted) - 1, -1)
    body_of = np.append(np.where(of.body >= 0, number[of.body], -1), -1)
    place_of = np.append(of.place, 0)
    for group in problem.groups if width else ():
        touched = np.zeros(group.count, dtype=bool)
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in bodies:
                mine = bodies[slot.kind][numbers]
                touched |= (mine >= 0) & wanted[mine]
        rows = np.flatnonzero(touched)
        for start in range(0, len(rows), _ROWS):
            part = rows[start : start + _ROWS]
            found = linearise(group, problem.index, values, tangent, part)
            jacobian = found.jacobian / np.where(group.mask[part], group.sigma[part], 1.0)[:, :, None]
            _add(flat, width, jacobian, body_of[found.columns], place_of[found.columns])
    return np.nan_to_num(flat.reshape(count, width, width))


def _add(flat: FloatArray, width: int, jacobian: FloatArray, body: IntArray, place: IntArray) -> None:
    """Add the products of columns (n, K) that belong to one body."""
    for i in range(body.shape[1]):
        for k in range(body.shape[1]):
            same = (body[:, i] >= 0) & (body[:, i] == body[:, k])
            if same.any():
                products = np.sum(jacobian[same, :, i] * jacobian[same, :, k], axis=1)
                cells = (body[same, i] * width + place[same, i]) * width + place[same, k]
                np.add.at(flat, cells, products)


def _singular(normals: FloatArray, sizes: IntArray) -> BoolArray:
    """(n,) true where a matrix of that size, scaled to unit diagonal, is singular to round-off."""
    width = normals.shape[1]
    diagonal = np.diagonal(normals, axis1=1, axis2=2)
    inside = np.arange(width) < sizes[:, None]
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    scaled = normals * scale[:, :, None] * scale[:, None, :]
    scaled[:, np.arange(width), np.arange(width)] = np.where(inside, (diagonal > 0.0).astype(float), 1.0)
    smallest = np.linalg.eigvalsh(scaled)[:, 0] if width else np.ones(len(sizes))
    return np.asarray(smallest < 1e-14 * max(width, 1))
