"""Frames of rays: all blocks a ray depends on but its point. Rays of one image share one frame.

Columns and values are looked up once for every frame, not once for every ray.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.sights.cameras import (
    ALONG,
    CROSSING,
    MODELS,
    MOVING,
    ON_THE_SPHERE,
    PANORAMA,
)
from mor.adjustment.rays.compiled.sights.image_rays import FrameChange, FrameValues, Layout
from mor.adjustment.rays.knots import (
    FURTHER,
    KNOT_PARTS,
    compiled_along,
    knot_change,
    knot_parts,
    knot_starts,
    no_paths,
    set_paths,
)
from mor.arrays import FloatArray, IntArray
from mor.observations import IMAGE_TYPES, MOVING_TYPES, ObservationGroup
from mor.observations.on_the_sphere import is_on_the_sphere, on_the_sphere
from mor.parameters.index import Index, Values

_POSITION, _ROTATION = range(2)
_POSE = ("position", "rotation", "height", "eccentricity")
_MOTION = ("velocity", "rate", "readout")
"""Slots of image coordinates in their order: pose, motion of a rolling shutter, interior orientation and point."""
_WIDTHS = {
    "readout": 1,
    **dict.fromkeys(KNOT_PARTS, 3),
    "velocity": 3,
    "rate": 3,
    "rotation": 3,
    "position": 3,
    "height": 1,
    "eccentricity": 3,
}
"""Columns of the compiled derivatives, before those by the interior orientation.

Velocity, rate, rotation and position of an image stand in one block of the reduced system, in this order, and so do
rotation and position of a knot. Knot 0 of a trajectory is where images have their own pose."""


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
        clock: (f, 3) phases of a rolling shutter, zero for others.
        weights: (f, k, k) of the k knots of a pose as polynomials of time, (f, 0, 0) where it is not between knots.
        picks: derivatives that are wanted.
        together: pairs of slots whose blocks go together, a rotation the second: the position of an image or of each
            knot, the motion of a rolling shutter.
    """

    group: int
    first: int
    blocks: IntArray
    slots: tuple[int, ...]
    model: int
    r0: FloatArray
    clock: FloatArray
    weights: FloatArray
    picks: tuple[Pick, ...] = ()
    together: tuple[tuple[int, int], ...] = ((_POSITION, _ROTATION),)

    @property
    def count(self) -> int:
        """Number of frames f."""
        return int(self.blocks.shape[1])

    @property
    def parts(self) -> dict[str, int]:
        """Slots of a compiled group by what they are."""
        pose = _POSE[:2] if self.model < ALONG else knot_parts(self.weights.shape[1])
        of_own = MOVING <= self.model < ALONG
        read_out = of_own or ALONG + MOVING <= self.model < CROSSING
        motion = _MOTION if of_own else _MOTION[2:] if read_out else ()
        names = (*pose, *_POSE[2:], *motion)
        return {name: slot for slot, name in enumerate((*names, "interior"))}


class Frames(NamedTuple):
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
    compiled = _compiled_model(group, rows, frame, blocks.shape[1])
    return frame, GroupFrames(number, first, blocks, slots, *compiled, together=_together(group))


def _together(group: ObservationGroup) -> tuple[tuple[int, int], ...]:
    """Pairs of slots: positions with the rotations that go with them, and what moves an image with its rotation."""
    of_kind = {
        kind: [k for k, slot in enumerate(group.type.slots[:-1]) if slot.kind == kind]
        for kind in ("point", "rotation", "image velocity", "rotation rate")
    }
    rotations = of_kind.pop("rotation")
    # behind the rotations that go with positions there is the relative rotation of a follower
    return tuple(pair for slots in of_kind.values() for pair in zip(slots, rotations, strict=False))


def _compiled_model(
    group: ObservationGroup, rows: IntArray, frame: IntArray, frames: int
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Number of the compiled camera model, its constant for each frame, the clock, and the weights of knots."""
    r0, clock, none = np.zeros(frames), np.zeros((frames, 3)), np.zeros((frames, 0, 0))
    along = compiled_along(group, rows, frame, frames)
    if along is not None:
        return along.model, along.r0, along.clock, along.weights
    if is_on_the_sphere(group.type):
        single = any(group.type is on_the_sphere(type_) for type_ in IMAGE_TYPES.values())
        return ON_THE_SPHERE if single else -1, r0, clock, none
    if group.type is IMAGE_TYPES["panorama"]:
        return PANORAMA, r0, clock, none
    for key, model in MODELS.items():
        moving = group.type is MOVING_TYPES[key]
        if not moving and group.type is not IMAGE_TYPES[key]:
            continue
        constants = group.constants[rows, 2:]
        found = np.zeros((frames, constants.shape[1]))
        found[frame] = constants
        if not np.array_equal(found[frame], constants):
            break
        if moving:
            clock, found = np.ascontiguousarray(found[:, -3:]), found[:, :-3]
        r0 = np.ascontiguousarray(found[:, 0]) if found.shape[1] else r0
        return model + MOVING if moving else model, r0, clock, none
    return -1, r0, clock, none


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
    starts = {**layout._asdict(), **knot_starts(layout.knots)}
    picks = [
        Pick(slot, np.arange(sizes[slot]), starts[part] + np.arange(sizes[slot]))
        for part, slot in group.parts.items()
        if slot in sizes and part in _WIDTHS
    ]
    interior = group.parts["interior"]
    if interior in sizes:
        known = layout.components < sizes[interior]
        picks.append(Pick(interior, layout.components[known], layout.interior + np.flatnonzero(known)))
    return tuple(picks)


def _layout(groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index) -> Layout:
    """Layout of the compiled derivatives."""
    compiled = [group for group in groups if group.model >= 0]
    used = {part for group in compiled for part, slot in group.parts.items() if slot in group.slots}
    at, starts = 0, dict.fromkeys(_WIDTHS, -1)
    for part in (part for part in _WIDTHS if part in used):
        starts[part] = at
        at += _WIDTHS[part]
    of_motion = sum(_WIDTHS[part] for part in used if part in (*_MOTION, *KNOT_PARTS))
    knots = np.array([[starts.pop(part) for part in knot] for knot in FURTHER], dtype=np.int64)
    if (knots < 0).all():
        knots = knots[:0]
    free: set[int] = set()
    for group in compiled:
        kind, blocks = _interior_kind(observed[group.group]), group.blocks[group.parts["interior"]]
        free |= set(np.flatnonzero((index.columns[kind][blocks] >= 0).any(axis=0)).tolist())
    components = np.array(sorted(free), dtype=np.int64)
    return Layout(of_motion, **starts, interior=at, components=components, knots=knots)


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
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros(count),
        np.zeros((count, 3)),
        no_paths(count if _any_along(frames) else 0, tangent is not None),
    )
    for group in _compiled(frames):
        here = slice(group.first, group.first + group.count)
        part = _parts(group, observed, lambda kind, blocks: values[kind][blocks])
        result.model[here] = group.model
        result.centre[here] = part["position"]
        result.centre[here, 2] += part["height"][:, 0]
        result.D[here] = part["rotation"].reshape(-1, 9)
        result.eccentricity[here] = part["eccentricity"]
        result.interior[here, : part["interior"].shape[1]] = part["interior"]
        result.r0[here] = group.r0
        if tangent is not None:
            result.tangent[here] = tangent[group.blocks[group.parts["rotation"]]]
        if group.model >= ALONG:
            turning = _of_further(group, tangent)
            set_paths(result.paths, here, group.weights, part, turning)
        if "velocity" in part:
            result.velocity[here], result.rate[here] = part["velocity"], part["rate"]
        if "readout" in part:
            result.readout[here], result.clock[here] = part["readout"][:, 0], group.clock
    return result


def _parts(
    group: GroupFrames,
    observed: tuple[ObservationGroup, ...],
    of_blocks: Callable[[str, IntArray], FloatArray],
) -> dict[str, FloatArray]:
    """What is asked of the blocks (f,) of each slot of a compiled group, by what the slot is."""
    slots = observed[group.group].type.slots
    return {part: of_blocks(slots[slot].kind, group.blocks[slot]) for part, slot in group.parts.items()}


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
    shapes = ((count, 3), (count, 3), (count, 3), (count, widest), (count, 3), (count, 3), (count,))
    of_knots = (count if _any_along(frames) else 0, len(FURTHER), 2, 3)
    result = FrameChange(*(np.zeros(shape) for shape in (*shapes, of_knots)))
    for group in _compiled(frames):
        here = slice(group.first, group.first + group.count)
        part = _parts(group, observed, lambda kind, blocks: _of_blocks(step, index.columns[kind][blocks]))
        turn = part["rotation"]
        if tangent is not None:
            turn = np.einsum("fij,fj->fi", tangent[group.blocks[group.parts["rotation"]]], turn)
        result.centre[here] = part["position"]
        result.centre[here, 2] += part["height"][:, 0]
        result.turn[here] = turn
        result.eccentricity[here] = part["eccentricity"]
        result.interior[here, : part["interior"].shape[1]] = part["interior"]
        if "velocity" in part:
            result.velocity[here], result.rate[here] = part["velocity"], part["rate"]
        if "readout" in part:
            result.readout[here] = part["readout"][:, 0]
        if group.model >= ALONG:
            result.knots[here] = knot_change(group.weights.shape[1], part, _of_further(group, tangent))
    return result


def _any_along(frames: Frames) -> bool:
    return any(group.model >= ALONG for group in frames.groups)


def _of_further(group: GroupFrames, tangent: FloatArray | None) -> list[FloatArray] | None:
    """Tangents (f, 3, 3) of the rotations of the further knots of a group."""
    if tangent is None:
        return None
    slots = [group.parts[turn] for turn, _ in FURTHER[: group.weights.shape[1] - 1]]
    return [tangent[group.blocks[slot]] for slot in slots]


def _of_blocks(step: FloatArray, columns: IntArray) -> FloatArray:
    return np.where(columns >= 0, step[columns], 0.0)


def _compiled(frames: Frames) -> list[GroupFrames]:
    return [group for group in frames.groups if group.model >= 0]


def _interior_kind(group: ObservationGroup) -> str:
    return group.type.slots[-2].kind
