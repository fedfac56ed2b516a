"""Image rays as arrays: frames, knots, and the plan of tie points to eliminate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mor import long_arrays
from mor.linalg import compilation
from mor.long_arrays import kept
from mor.model.contract import ObservationGroup
from mor.model.images import (
    IMAGE_TYPES,
    MOVING_TYPES,
    PHASE,
    ROW,
    is_on_the_sphere,
    line_scanner,
    on_the_sphere,
    shutter_on_trajectory,
)
from mor.model.motion import path_of
from mor.model.parameters import Index, Values
from mor.model.trajectory import CUBIC, LINEAR, is_along, on_trajectory
from mor.solve import clique_kernels
from mor.solve.problem import Problem
from mor.solve.ray_kernels import (
    ALONG,
    CROSSING,
    MODELS,
    MOVING,
    ON_THE_SPHERE,
    PANORAMA,
    FrameChange,
    FrameValues,
    Layout,
    Paths,
    RayMeasurements,
)
from mor.types import AnyIntArray, FloatArray, IntArray, SmallIntArray

# ---- Rays along trajectories: which have a compiled form, and what that takes of their knots.
#
# Knot 0 stands where images have a pose of their own; the further ones are parts of a frame besides.

FURTHER = tuple((f"rotation of knot {k}", f"position of knot {k}") for k in range(1, CUBIC))
"""Parts of a frame besides knot 0, knot by knot, in the order in which they stand in a block of the reduced system."""
KNOT_PARTS = tuple(part for knot in FURTHER for part in knot)


class CompiledAlong(NamedTuple):
    """Arguments of the kernels for the f frames of a group along trajectories."""

    model: int
    r0: FloatArray
    """(f,)"""
    clock: FloatArray
    """(f, 3) phases of a rolling shutter, zero for others."""
    weights: FloatArray
    """(f, k, k) of the knots, as polynomials of the time since knot 0."""


def knot_parts(knots: int) -> tuple[str, ...]:
    """Names of the slots of knots, positions before rotations."""
    further = FURTHER[: knots - 1]
    return ("position", *(part for _, part in further), "rotation", *(part for part, _ in further))


def along_trajectory(group: ObservationGroup) -> bool:
    """True for image coordinates along trajectories that have a compiled form."""
    return _form(group) is not None


def _form(group: ObservationGroup) -> tuple[int, int, int] | None:
    """Compiled model, knots, and how many constants there are between the measured ones and the time."""
    if not is_along(group.type):
        return None
    for key, model in MODELS.items():
        own = len(IMAGE_TYPES[key].constants) - 2
        for knots in (LINEAR, CUBIC):
            if group.type is line_scanner(key, knots):
                return model + CROSSING, knots, own + len(ROW)
            if group.type is on_trajectory(IMAGE_TYPES[key], knots):
                return model + ALONG, knots, own
            if group.type is shutter_on_trajectory(key, knots):
                return model + ALONG + MOVING, knots, own + len(PHASE)
    return None


def compiled_along(group: ObservationGroup, rows: AnyIntArray, frame: AnyIntArray, frames: int) -> CompiledAlong | None:
    """Return the arguments of the kernels for a group; ``None`` without a compiled form for it."""
    form = _form(group)
    if form is None:
        return None
    model, knots, own = form
    read_out = ALONG + MOVING <= model < CROSSING
    of_time = len(ROW) if model >= CROSSING else len(PHASE) if read_out else 0
    phase = range(own - 1, own + 2) if read_out else ()
    has_r0 = own > of_time
    chosen = [*([2] if has_r0 else []), *phase, *range(own + 3, group.constants.shape[1])]
    constants = group.constants[np.ix_(rows, chosen)]
    found = np.zeros((frames, len(chosen)))
    found[frame] = constants
    if not np.array_equal(found[frame], constants):
        return None
    r0 = found[:, 0] if has_r0 else np.zeros(frames)
    weights = found[:, -knots * knots :].reshape(frames, knots, knots)
    clock = found[:, has_r0 : has_r0 + len(PHASE)] if read_out else np.zeros((frames, 3))
    return CompiledAlong(model, np.ascontiguousarray(r0), clock, weights)


def clock_of_rows(group: ObservationGroup, rows: AnyIntArray) -> FloatArray:
    """(n, 3) time since knot 0, observed row and seconds by rows; (0, 3) where rays are along no trajectory."""
    form = _form(group)
    if form is None:
        return np.zeros((0, 3))
    model, _, own = form
    clock = np.zeros((len(rows), 3))
    clock[:, 0] = group.constants[rows, own + 2]
    if model >= CROSSING:
        clock[:, 1:] = group.constants[rows, own : own + 2]
    return clock


def no_paths(frames: int, by_angles: bool) -> Paths:
    """Room for the paths of so many frames; ``by_angles`` where some rotations move by angles."""
    further = len(FURTHER)
    return Paths(
        np.zeros(frames, dtype=np.int64),
        np.zeros((frames, CUBIC, CUBIC)),
        np.zeros((frames, further, 3)),
        np.zeros((frames, further, 3)),
        np.zeros((frames, further, 3, 3)),
        np.zeros((frames if by_angles else 0, further, 3, 3)),
    )


def set_paths(
    paths: Paths,
    here: slice,
    weights: FloatArray,
    part: Mapping[str, FloatArray],
    tangents: Sequence[FloatArray] | None,
) -> None:
    """Set the paths of the frames ``here`` from the values of their parts, and tangents of their further rotations."""
    knots = weights.shape[1]
    names = knot_parts(knots)
    positions, rotations = (np.stack([part[name] for name in some], axis=1) for some in (names[:knots], names[knots:]))
    path = path_of(positions, rotations, weights)
    paths.knots[here] = knots
    paths.weights[here, :knots, :knots] = weights
    apart = positions[:, 1:] - positions[:, :1]
    paths.reach[here, : knots - 1] = np.einsum("fij,fkj->fki", path.first, apart)
    paths.turns[here, : knots - 1] = path.turns
    paths.inverse[here, : knots - 1] = path.inverse
    for k, tangent in enumerate(tangents or ()):
        paths.tangent[here, k] = tangent


def knot_change(knots: int, part: Mapping[str, FloatArray], tangents: Sequence[FloatArray] | None) -> FloatArray:
    """(f, 3, 2, 3) changes of the further knots from those of their parts: positions, then small rotations."""
    change = np.zeros((len(part["position"]), len(FURTHER), 2, 3))
    for k, (rotation, position) in enumerate(FURTHER[: knots - 1]):
        change[:, k, 0] = part[position]
        change[:, k, 0, 2] += part["height"][:, 0]
        turn = part[rotation]
        change[:, k, 1] = turn if tangents is None else np.einsum("fij,fj->fi", tangents[k], turn)
    return change


# ---- Frames of rays: all blocks a ray depends on but its point. Rays of one image share one frame.
#
# Columns and values are looked up once for every frame, not once for every ray.

_MOTION = ("velocity", "rate", "readout")
"""Slots of the motion of a rolling shutter in their order."""
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
    """Columns of the derivatives by the block of a slot."""

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
    together: tuple[tuple[int, int], ...] = ((0, 1),)

    @property
    def count(self) -> int:
        """Number of frames f."""
        return int(self.blocks.shape[1])

    @property
    def parts(self) -> dict[str, int]:
        """Slots of a compiled group by what they are: pose, motion of a rolling shutter, interior orientation."""
        pose = ("position", "rotation") if self.model < ALONG else knot_parts(self.weights.shape[1])
        of_own = MOVING <= self.model < ALONG
        read_out = of_own or ALONG + MOVING <= self.model < CROSSING
        motion = _MOTION if of_own else _MOTION[2:] if read_out else ()
        names = (*pose, "height", "eccentricity", *motion, "interior")
        return {name: slot for slot, name in enumerate(names)}


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


def numbered(blocks: list[IntArray]) -> tuple[SmallIntArray, IntArray]:
    """Number the distinct columns of blocks (slots, n): numbers (n,) and the distinct ones (slots, f)."""
    n = len(blocks[0])
    number = np.zeros(n, dtype=np.int32)
    count = min(n, 1)
    for block in blocks:
        representative = np.zeros(count, dtype=block.dtype)
        representative[number] = block
        if np.array_equal(representative[number], block):
            continue
        number, count = _renumbered(number * np.int64(int(block.max()) + 1) + block)
    found = np.zeros((len(blocks), count), dtype=np.int64)
    for slot, block in enumerate(blocks):
        found[slot, number] = block
    return number, found


def _renumbered(keys: IntArray) -> tuple[SmallIntArray, int]:
    """Keys (n,) numbered from 0, ascending, and how many there are; without sorting where they are dense."""
    largest = int(keys.max())
    if largest > 8 * len(keys) + 1_000_000:
        distinct, number = np.unique(keys, return_inverse=True)
        return number.astype(np.int32), len(distinct)
    present = np.zeros(largest + 1, dtype=bool)
    present[keys] = True
    place = np.cumsum(present, dtype=np.int32) - np.int32(1)
    return place[keys], int(place[-1]) + 1


def group_frames(
    number: int, first: int, group: ObservationGroup, index: Index, rows: AnyIntArray
) -> tuple[SmallIntArray, GroupFrames]:
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
    group: ObservationGroup, rows: AnyIntArray, frame: AnyIntArray, frames: int
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


def all_frames(groups: tuple[GroupFrames, ...], observed: tuple[ObservationGroup, ...], index: Index) -> Frames:
    """Columns of the frames of all groups, and the layout of those that are compiled."""
    layout = _layout(groups, observed, index)
    picked = tuple(replace(group, picks=_picks(group, observed[group.group], index, layout)) for group in groups)
    width = max((int(pick.columns.max(initial=-1)) + 1 for group in picked for pick in group.picks), default=0)
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
    starts = {**layout._asdict(), **dict(zip(KNOT_PARTS, layout.knots.ravel().tolist(), strict=False))}
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
    group: GroupFrames, observed: tuple[ObservationGroup, ...], of_blocks: Callable[[str, IntArray], FloatArray]
) -> dict[str, FloatArray]:
    """Return the parts of the blocks (f,) of each slot of a compiled group, by the role of the slot."""
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


# ---- The rays of the eliminated points, sorted by point and cut into chunks: worked out once.

POINTS_AT_A_TIME, RAYS_AT_A_TIME = 2048, 262_144
"""Points and rays of a chunk at most, so few that the Jacobians of their rays stay near."""

VERY_MANY_RAYS = 4_000_000
"""Rays beyond which their measurements are not kept twice, for which an iteration takes 2 % longer."""


class Chunk(NamedTuple):
    """Whole points and their rays."""

    points: slice
    rays: slice
    frames: IntArray
    """Frames of its rays, which name them by their place in this list."""


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

    def of(self, rays: slice) -> RayMeasurements:
        """Measurements of the rays of one chunk."""
        count = rays.stop - rays.start
        weight = self.weight[:count] if len(self.weight) < len(self.observed) else self.weight[rays]
        if self.row is None:
            return RayMeasurements(self.observed[rays], weight, self.measured[rays], self.clock[rays])
        observed = np.take(self.observed, self.row[rays], axis=0)  # in a quarter of the time of an index
        return RayMeasurements(observed, weight, observed, self.clock[rays])


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
        groups = {own.group for own in self.frames.groups}
        if groups <= {number}:
            return self.row
        return self.row[self.group_of_frame[self.frame_of_ray] == number] if number in groups else self.row[:0]

    def together(self, groups: Sequence[ObservationGroup]) -> Iterator[tuple[str, IntArray]]:
        """Blocks (2, f) of the frames that go together, and the kind of the first: with a rotation, the second."""
        for own in self.frames.groups:
            for pair in own.together:
                yield groups[own.group].type.slots[pair[0]].kind, own.blocks[list(pair)]


def plan_rays(problem: Problem, points: IntArray) -> RayPlan:
    """Sort the rays of the points (numbers of point blocks) by point and cut them into chunks."""
    index, groups = problem.index, problem.groups
    place = np.full(len(index.blocks["point"].ids) if "point" in index.blocks else 0, -1, dtype=np.int32)
    place[points] = np.arange(len(points))
    found: list[GroupFrames] = []
    parts: list[tuple[SmallIntArray, SmallIntArray, SmallIntArray]] = []
    first = 0
    for number, group in enumerate(groups):
        if not is_ray(group) or not len(points):
            continue
        rows = np.flatnonzero(place[group.blocks[-1]] >= 0).astype(np.int32)
        if len(rows) == 0:
            continue
        frame, own = group_frames(number, first, group, index, rows)
        found.append(own)
        parts.append((rows, place[group.blocks[-1][rows]], frame + np.int32(first)))
        first += own.count
    none = np.zeros(0, dtype=np.int32)
    row, point, frame = parts[0] if len(parts) == 1 else map(np.concatenate, zip((none,) * 3, *parts, strict=True))
    pointers, order = _order(point, frame, len(points))
    row, frame = kept(row[order]), frame[order]
    frames = all_frames(tuple(found), groups, index)
    group_of_frame = np.repeat([g.group for g in found], [g.count for g in found]).astype(np.int64)
    local, chunks = _chunks(pointers, frame, first)
    columns = index.columns["point"][points] if len(points) else np.zeros((0, 3), dtype=np.int64)
    longest = max((chunk.rays.stop - chunk.rays.start for chunk in chunks), default=0)
    measured = _measured(groups, found, frame, row, longest)
    return RayPlan(points, columns, pointers, row, local, frames, group_of_frame, measured, chunks)


def _order(point: SmallIntArray, frame: SmallIntArray, points: int) -> tuple[IntArray, IntArray]:
    if compilation.wanted():
        pointers, order = clique_kernels.by_point_and_frame(point, frame, points)
        return pointers, order
    counts = np.bincount(point, minlength=points)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), np.lexsort((frame, point))


def _chunks(pointers: IntArray, frame: SmallIntArray, frames: int) -> tuple[SmallIntArray, tuple[Chunk, ...]]:
    bounds = [0]
    while bounds[-1] < len(pointers) - 1:
        last = int(np.searchsorted(pointers, pointers[bounds[-1]] + RAYS_AT_A_TIME, side="right")) - 1
        bounds.append(max(min(last, bounds[-1] + POINTS_AT_A_TIME), bounds[-1] + 1))
    first_ray = pointers[bounds]
    local = long_arrays.empty(len(frame), np.int32)
    of_chunk, found = clique_kernels.local_numbers(frame, first_ray, frames, local)
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
    frame: SmallIntArray,
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
    result: FloatArray = long_arrays.empty((len(rows), 2))
    return np.take(values, rows, axis=0, out=result)
