"""Frames of rays: all blocks a ray depends on but its point. Rays of one image share one frame.

Columns and values are looked up once for every frame, not once for every ray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.adjustment.compiled.cameras import MODELS
from mor.adjustment.compiled.image_rays import FrameValues, Layout
from mor.geometry.arrays import FloatArray, IntArray
from mor.observations import IMAGE_TYPES, ObservationGroup
from mor.parameters.index import Index, Values

_POSITION, _ROTATION, _HEIGHT, _ECCENTRICITY, _INTERIOR = range(5)
"""Slots of image coordinates, the point left out."""
_WIDTHS = (3, 3, 1, 3)


@dataclass(frozen=True)
class GroupFrames:
    """Frames of one observation group.

    Attributes:
        group: number of the group.
        first: number of its first frame among those of all groups.
        blocks: (slots − 1, f) block numbers.
        slots: slots that have unknowns in some frame, the point left out.
        model: number of the compiled camera model, −1 where the equations in numpy are taken.
        r0: (f,) constant of the camera model.
    """

    group: int
    first: int
    blocks: IntArray
    slots: tuple[int, ...]
    model: int
    r0: FloatArray

    @property
    def count(self) -> int:
        """Number of frames f."""
        return int(self.blocks.shape[1])


@dataclass(frozen=True)
class Frames:
    """Frames of all rays.

    Attributes:
        groups: one entry for each group of rays.
        columns: (f, K) unknowns of each frame, −1 where fixed or where there is nothing.
        layout: where the compiled linearisation puts its derivatives.
    """

    groups: tuple[GroupFrames, ...]
    columns: IntArray
    layout: Layout


def numbered(blocks: list[IntArray]) -> tuple[IntArray, IntArray]:
    """Number the distinct columns of blocks (slots, n): numbers (n,) and the distinct ones (slots, f)."""
    n = len(blocks[0])
    number = np.zeros(n, dtype=np.int64)
    count = min(n, 1)
    for block in blocks:
        representative = np.zeros(count, dtype=np.int64)
        representative[number] = block
        if np.array_equal(representative[number], block):
            continue
        keys = number * (int(block.max(initial=0)) + 1) + block
        distinct, number = np.unique(keys, return_inverse=True)
        count = len(distinct)
    found = np.zeros((len(blocks), count), dtype=np.int64)
    for slot, block in enumerate(blocks):
        found[slot, number] = block
    return number, found


def group_frames(
    number: int, first: int, group: ObservationGroup, index: Index, rows: IntArray
) -> tuple[IntArray, GroupFrames]:
    """Frame of each of the rows (n,), counted from 0, and the frames of a group."""
    frame, blocks = numbered([block[rows] for block in group.blocks[:-1]])
    slots = tuple(
        k
        for k, (slot, used) in enumerate(zip(group.type.slots[:-1], blocks, strict=True))
        if (index.columns[slot.kind][used] >= 0).any()
    )
    model, r0 = _compiled_model(group, rows, frame, blocks.shape[1])
    return frame, GroupFrames(number, first, blocks, slots, model, r0)


def _compiled_model(
    group: ObservationGroup, rows: IntArray, frame: IntArray, frames: int
) -> tuple[int, FloatArray]:
    """Number of the compiled camera model, and its constant for each frame."""
    r0 = np.zeros(frames)
    for key, model in MODELS.items():
        if group.type is IMAGE_TYPES[key]:
            if group.constants.shape[1] > 2:
                constant = group.constants[rows, 2]
                r0[frame] = constant
                if not np.array_equal(r0[frame], constant):
                    return -1, r0
            return model, r0
    return -1, r0


def all_frames(groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index) -> Frames:
    """Columns of the frames of all groups, and the layout of those that are compiled."""
    layout, width = _layout(groups, observed, index)
    parts = []
    for group in groups:
        kinds = [slot.kind for slot in observed[group.group].type.slots]
        if group.model < 0:
            parts.append([index.columns[kinds[k]][group.blocks[k]] for k in group.slots])
            continue
        starts = (layout.position, layout.rotation, layout.height, layout.eccentricity)
        wanted = [
            index.columns[kinds[k]][group.blocks[k]] for k, start in enumerate(starts) if start >= 0
        ]
        interior = index.columns[kinds[_INTERIOR]][group.blocks[_INTERIOR]]
        known = layout.components < interior.shape[1]
        chosen = np.where(known, layout.components, 0)
        wanted.append(np.where(known, interior[:, chosen], -1))
        parts.append(wanted)
    widest = max([width, *(sum(part.shape[1] for part in wanted) for wanted in parts)], default=0)
    count = sum(group.count for group in groups)
    columns = np.full((count, widest), -1, dtype=np.int64)
    for group, wanted in zip(groups, parts, strict=True):
        if wanted:
            together = np.concatenate(wanted, axis=1)
            columns[group.first : group.first + group.count, : together.shape[1]] = together
    return Frames(groups, columns, layout)


def _layout(
    groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index
) -> tuple[Layout, int]:
    """Layout of the compiled derivatives, and how many columns it has."""
    compiled = [group for group in groups if group.model >= 0]
    used: set[int] = {slot for group in compiled for slot in group.slots}
    at, starts = 0, [-1, -1, -1, -1]
    for slot, width in enumerate(_WIDTHS):
        if slot in used:
            starts[slot] = at
            at += width
    free: set[int] = set()
    for group in compiled:
        kind = observed[group.group].type.slots[_INTERIOR].kind
        free |= set(np.flatnonzero((index.columns[kind][group.blocks[_INTERIOR]] >= 0).any(axis=0)).tolist())
    components = np.array(sorted(free), dtype=np.int64)
    return Layout(*starts, at, components), at + len(components)


def frame_values(
    frames: Frames, observed: tuple[ObservationGroup, ...], values: Values, tangent: FloatArray | None
) -> FrameValues:
    """Values of all frames, as the compiled linearisation takes them."""
    count = sum(group.count for group in frames.groups)
    widest = max((values[_interior_kind(observed[g.group])].shape[1] for g in _compiled(frames)), default=0)
    turned = count if tangent is not None else 0
    result = FrameValues(
        np.full(count, -1, dtype=np.int64),
        np.zeros((count, 3)),
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
        np.zeros((count, widest)),
        np.zeros(count),
        np.zeros((turned, 3, 3)),
    )
    for group in _compiled(frames):
        here = slice(group.first, group.first + group.count)
        kinds = [slot.kind for slot in observed[group.group].type.slots]
        position, rotation, height, eccentricity, interior = (
            values[kind][blocks] for kind, blocks in zip(kinds, group.blocks, strict=False)
        )
        result.model[here] = group.model
        result.centre[here] = position
        result.centre[here, 2] += height[:, 0]
        result.D[here] = rotation
        result.eccentricity[here] = eccentricity
        result.interior[here, : interior.shape[1]] = interior
        result.r0[here] = group.r0
        if tangent is not None:
            result.tangent[here] = tangent[group.blocks[_ROTATION]]
    return result


def chosen_frames(values: FrameValues, frames: IntArray) -> FrameValues:
    """Values of some frames."""
    tangent = values.tangent[frames] if len(values.tangent) else values.tangent
    return FrameValues(*(array[frames] for array in values[:-1]), tangent)


def _compiled(frames: Frames) -> list[GroupFrames]:
    return [group for group in frames.groups if group.model >= 0]


def _interior_kind(group: ObservationGroup) -> str:
    return group.type.slots[_INTERIOR].kind


__all__ = ["Frames", "GroupFrames", "all_frames", "chosen_frames", "frame_values", "group_frames", "numbered"]
