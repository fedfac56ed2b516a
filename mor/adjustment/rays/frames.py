"""Frames of rays: all blocks a ray depends on but its point. Rays of one image share one frame.

Columns and values are looked up once for every frame, not once for every ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cameras import MODELS, ON_THE_SPHERE
from mor.adjustment.rays.compiled.image_rays import FrameChange, FrameValues, Layout
from mor.arrays import FloatArray, IntArray
from mor.observations import IMAGE_TYPES, ObservationGroup
from mor.observations.on_the_sphere import is_on_the_sphere, on_the_sphere
from mor.parameters.index import Index, Values

_POSITION, _ROTATION, _HEIGHT, _ECCENTRICITY, _INTERIOR = range(5)
"""Slots of image coordinates, the point left out."""
_WIDTHS = (3, 3, 1, 3)


class Pick(NamedTuple):
    """Which derivatives by the block of a slot go to which columns."""

    slot: int
    components: IntArray
    columns: IntArray


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
        picks: derivatives that are wanted.
        poses: slots of positions and of the rotations that go with them: one pair, or one for each knot.
    """

    group: int
    first: int
    blocks: IntArray
    slots: tuple[int, ...]
    model: int
    r0: FloatArray
    picks: tuple[Pick, ...] = ()
    poses: tuple[tuple[int, int], ...] = ((_POSITION, _ROTATION),)

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


def is_ray(group: ObservationGroup) -> bool:
    """True for image coordinates: two components, and the point as the last slot."""
    slot = group.type.slots[-1]
    return slot.kind == "point" and slot.of == "point" and len(group.type.components) == 2


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
        number, count = _renumbered(number * (int(block.max()) + 1) + block)
    found = np.zeros((len(blocks), count), dtype=np.int64)
    for slot, block in enumerate(blocks):
        found[slot, number] = block
    return number, found


def _renumbered(keys: IntArray) -> tuple[IntArray, int]:
    """Keys (n,) numbered from 0, ascending, and how many there are; without sorting where they are dense."""
    largest = int(keys.max())
    if largest > 8 * len(keys) + 1_000_000:
        distinct, number = np.unique(keys, return_inverse=True)
        return number.astype(np.int64), len(distinct)
    present = np.zeros(largest + 1, dtype=bool)
    present[keys] = True
    place = np.cumsum(present) - 1
    return place[keys], int(place[-1]) + 1


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
    positions, rotations = (
        [k for k, slot in enumerate(group.type.slots[:-1]) if slot.kind == kind]
        for kind in ("point", "rotation")
    )
    poses = tuple(zip(positions, rotations, strict=False))  # behind them the relative rotation of a follower
    return frame, GroupFrames(number, first, blocks, slots, model, r0, poses=poses)


def _compiled_model(
    group: ObservationGroup, rows: IntArray, frame: IntArray, frames: int
) -> tuple[int, FloatArray]:
    """Number of the compiled camera model, and its constant for each frame."""
    r0 = np.zeros(frames)
    if is_on_the_sphere(group.type):
        single = any(group.type is on_the_sphere(type_) for type_ in IMAGE_TYPES.values())
        return ON_THE_SPHERE if single else -1, r0
    for key, model in MODELS.items():
        if group.type is IMAGE_TYPES[key]:
            if group.constants.shape[1] > 2:
                constant = group.constants[rows, 2]
                r0[frame] = constant
                if not np.array_equal(r0[frame], constant):
                    return -1, r0
            return model, r0
    return -1, r0


def all_frames(
    groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index
) -> Frames:
    """Columns of the frames of all groups, and the layout of those that are compiled."""
    layout = _layout(groups, observed, index)
    picked = tuple(
        replace(group, picks=_picks(group, observed[group.group], index, layout)) for group in groups
    )
    width = max(
        (int(pick.columns.max(initial=-1)) + 1 for group in picked for pick in group.picks), default=0
    )
    width += -width % 4  # the kernels take four columns at a time
    columns = np.full((sum(group.count for group in groups), width), -1, dtype=np.int64)
    for group in picked:
        own = columns[group.first : group.first + group.count]
        for pick in group.picks:
            kind = observed[group.group].type.slots[pick.slot].kind
            own[:, pick.columns] = index.columns[kind][group.blocks[pick.slot]][:, pick.components]
    return Frames(picked, columns, layout)


def _picks(group: GroupFrames, observed: ObservationGroup, index: Index, layout: Layout) -> tuple[Pick, ...]:
    """Derivatives by all blocks that have unknowns, in the order of the layout where the group is compiled."""
    sizes = {k: index.columns[observed.type.slots[k].kind].shape[1] for k in group.slots}
    if group.model < 0:
        ends = np.cumsum(list(sizes.values()))
        return tuple(
            Pick(k, np.arange(size), np.arange(end - size, end))
            for (k, size), end in zip(sizes.items(), ends, strict=True)
        )
    starts = (layout.position, layout.rotation, layout.height, layout.eccentricity)
    picks = [
        Pick(k, np.arange(sizes[k]), starts[k] + np.arange(sizes[k])) for k in group.slots if k != _INTERIOR
    ]
    if _INTERIOR in sizes:
        known = layout.components < sizes[_INTERIOR]
        picks.append(Pick(_INTERIOR, layout.components[known], layout.interior + np.flatnonzero(known)))
    return tuple(picks)


def _layout(groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index) -> Layout:
    """Layout of the compiled derivatives."""
    compiled = [group for group in groups if group.model >= 0]
    used: set[int] = {slot for group in compiled for slot in group.slots}
    widths = [width if slot in used else 0 for slot, width in enumerate(_WIDTHS)]
    at = sum(widths)
    position, rotation, height, eccentricity = (
        sum(widths[:slot]) if width else -1 for slot, width in enumerate(widths)
    )
    free: set[int] = set()
    for group in compiled:
        kind = observed[group.group].type.slots[_INTERIOR].kind
        free |= set(np.flatnonzero((index.columns[kind][group.blocks[_INTERIOR]] >= 0).any(axis=0)).tolist())
    components = np.array(sorted(free), dtype=np.int64)
    return Layout(position, rotation, height, eccentricity, at, components)


def frame_values(
    frames: Frames, observed: tuple[ObservationGroup, ...], values: Values, tangent: FloatArray | None
) -> FrameValues:
    """Values of all frames, as the compiled linearisation takes them."""
    count = sum(group.count for group in frames.groups)
    widest = max((values[_interior_kind(observed[g.group])].shape[1] for g in _compiled(frames)), default=0)
    turned = count if tangent is not None else 0
    result = FrameValues(
        np.full(count, -1, dtype=np.int64),
        np.zeros((count, 9)),
        np.zeros((count, 3)),
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
        result.D[here] = rotation.reshape(-1, 9)
        result.eccentricity[here] = eccentricity
        result.interior[here, : interior.shape[1]] = interior
        result.r0[here] = group.r0
        if tangent is not None:
            result.tangent[here] = tangent[group.blocks[_ROTATION]]
    return result


def frame_change(
    frames: Frames,
    observed: tuple[ObservationGroup, ...],
    index: Index,
    step: FloatArray,
    tangent: FloatArray | None,
    widest: int,
) -> FrameChange:
    """Changes of the compiled frames by a step (u,) of all unknowns; ``widest`` interior components."""
    count = sum(group.count for group in frames.groups)
    result = FrameChange(*(np.zeros((count, size)) for size in (3, 3, 3, widest)))
    for group in _compiled(frames):
        here = slice(group.first, group.first + group.count)
        slots = observed[group.group].type.slots
        position, turn, height, eccentricity, interior = (
            _of_blocks(step, index.columns[slot.kind][blocks])
            for slot, blocks in zip(slots, group.blocks, strict=False)
        )
        if tangent is not None:
            turn = np.einsum("fij,fj->fi", tangent[group.blocks[_ROTATION]], turn)
        result.centre[here] = position
        result.centre[here, 2] += height[:, 0]
        result.turn[here] = turn
        result.eccentricity[here] = eccentricity
        result.interior[here, : interior.shape[1]] = interior
    return result


def _of_blocks(step: FloatArray, columns: IntArray) -> FloatArray:
    return np.where(columns >= 0, step[columns], 0.0)


def _compiled(frames: Frames) -> list[GroupFrames]:
    return [group for group in frames.groups if group.model >= 0]


def _interior_kind(group: ObservationGroup) -> str:
    return group.type.slots[_INTERIOR].kind
