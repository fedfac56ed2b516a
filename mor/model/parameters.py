"""Kinds of parameter blocks, and the place of each block in the vector of unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.model.cameras import CAMERA_MODELS
from mor.model.rotations import angles_from_rotation, rotate, rotation_from_angles, tangent_of_angles
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.units import ANGLE, LENGTH, NUMBER, SPEED, TIME, TURN_RATE, Component

# ---- The kinds of parameter blocks. A position is a point, whatever stands there; an attitude is a rotation.


class BlockKind(NamedTuple):
    """A kind of parameter block: its key and its components, in the order of their columns."""

    key: str
    components: tuple[Component, ...]

    @property
    def size(self) -> int:
        """Number of components, and of columns where all are free."""
        return len(self.components)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components."""
        return tuple(component.name for component in self.components)

    @property
    def is_rotation(self) -> bool:
        """True for attitudes, which are stored as matrices and updated by small rotations."""
        return self.key == "rotation"

    @property
    def in_object_axes(self) -> bool:
        """True for positions and movements of points, whose components are along the axes of the object system."""
        return self.key in ("point", "velocity", "sine", "cosine")


POINT = BlockKind("point", (Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)))
ROTATION = BlockKind("rotation", (Component("omega", ANGLE), Component("phi", ANGLE), Component("kappa", ANGLE)))
ECCENTRICITY = BlockKind("eccentricity", (Component("rx", LENGTH), Component("ry", LENGTH), Component("rz", LENGTH)))
BASE = BlockKind("base", (Component("bx", LENGTH), Component("by", LENGTH), Component("bz", LENGTH)))
HEIGHT = BlockKind("height", (Component("height", LENGTH),))
READOUT = BlockKind("readout", (Component("readout", TIME),))
"""Time from the first to the last row (or column) of an image."""
IMAGE_VELOCITY = BlockKind("image velocity", tuple(Component(f"v{axis}", SPEED) for axis in "xyz"))
ROTATION_RATE = BlockKind("rotation rate", tuple(Component(f"rate_{axis}", TURN_RATE) for axis in "xyz"))
"""How an image moves while it is read out, in its own axes."""
SCALE = BlockKind("scale", (Component("scale", NUMBER, default=1.0),))
DISTANCE_METER = BlockKind("distance meter", (Component("scale", NUMBER, default=1.0), Component("offset", LENGTH)))
GNSS_FRAME = BlockKind(
    "gnss frame",
    (
        *(Component(f"shift_{axis}", LENGTH) for axis in "xyz"),
        *(Component(f"turn_{axis}", ANGLE) for axis in "xyz"),
        Component("scale", NUMBER, default=1.0),
    ),
)
"""Where the frame of a GNSS solution lies in that of the points, in geocentric axes."""
POSITION_SHIFT = BlockKind(
    "position shift",
    (*(Component(f"shift_{axis}", LENGTH) for axis in "xyz"), *(Component(f"drift_{axis}", SPEED) for axis in "xyz")),
)
"""By what the positions of satellites along a trajectory are off, and how that grows."""
ATTITUDE_SHIFT = BlockKind(
    "attitude shift",
    (
        *(Component(f"turn_{axis}", ANGLE) for axis in "xyz"),
        *(Component(f"turn_drift_{axis}", TURN_RATE) for axis in "xyz"),
    ),
)
"""By what the attitudes of an inertial system are off, about its axes, and how that grows."""
TIME_OFFSET = BlockKind("time offset", (Component("time_offset", TIME),))
"""What is to be added to the times of an instrument."""
SHAPE = BlockKind(
    "shape", (Component("radius", LENGTH), Component("minor_radius", LENGTH), Component("semi_angle", ANGLE))
)
"""Size of a circle, sphere, cylinder, cone or torus; components that a shape does not have are fixed at 0."""
VELOCITY = BlockKind("velocity", tuple(Component(f"v{axis}", LENGTH) for axis in "xyz"))
"""Movement of a point in a year."""
SINE = BlockKind("sine", tuple(Component(f"sin_{axis}", LENGTH) for axis in "xyz"))
COSINE = BlockKind("cosine", tuple(Component(f"cos_{axis}", LENGTH) for axis in "xyz"))
"""Annual oscillation of a point: s sin 2πt + c cos 2πt, t in years."""
MOTIONS = (VELOCITY, SINE, COSINE)
"""What moves points in the course of time."""


def interior_key(model: str) -> str:
    """Key of the interior orientation block of a camera model."""
    return f"interior/{model}"


INTERIORS = {model.key: BlockKind(interior_key(model.key), model.components) for model in CAMERA_MODELS.values()}

KINDS = {
    kind.key: kind
    for kind in (
        *INTERIORS.values(),
        DISTANCE_METER,
        BlockKind("refraction", (Component("refraction", NUMBER),)),
        GNSS_FRAME,
        POSITION_SHIFT,
        ATTITUDE_SHIFT,
        TIME_OFFSET,
        READOUT,
        SCALE,
        HEIGHT,
        IMAGE_VELOCITY,
        ROTATION_RATE,
        ECCENTRICITY,
        BASE,
        SHAPE,
        *MOTIONS,
        ROTATION,
        POINT,
    )
}
"""All kinds; the order is the order of their columns."""


# ---- From blocks to columns: which component of which block is which unknown, and how a step moves it.

Values: TypeAlias = Mapping[str, FloatArray]
"""Values of all blocks by kind: (n, size), rotations (n, 3, 3)."""


def all_known(values: Values) -> bool:
    """Return True if no value is missing: NaN stands for one that is."""
    return all(bool(np.isfinite(array).all()) for array in values.values())


class Blocks(NamedTuple):
    """All blocks of one kind."""

    kind: BlockKind
    ids: tuple[str, ...]
    free: BoolArray
    """(n, size) true where the component is estimated."""
    owner: IntArray
    """(n, size) the block whose component this one is: itself, or another one it shares the component with."""
    about_axes: BoolArray | None = None
    """(n,) rotations whose free and fixed components are turns about the axes of the frame, not ω, φ, κ."""
    difference: FloatArray | None = None
    """(n, size) by which a shared component differs from that of its owner; ``None``: by nothing."""


@dataclass(frozen=True)
class Index:
    """Columns of all blocks. ``columns[kind]`` is (n, size), −1 where a component is fixed."""

    blocks: Mapping[str, Blocks]
    columns: Mapping[str, IntArray]
    unknown_kind: tuple[str, ...]
    """Kind keys, in the order in which ``kind_of`` numbers them."""
    kind_of: AnyIntArray
    block_of: AnyIntArray
    component_of: AnyIntArray

    @property
    def count(self) -> int:
        """Number of unknowns u."""
        return len(self.kind_of)

    def label(self, column: int) -> tuple[str, str, str]:
        """Kind, block identifier and component name of an unknown."""
        blocks = self.blocks[self.unknown_kind[self.kind_of[column]]]
        return (blocks.kind.key, blocks.ids[self.block_of[column]], blocks.kind.names[self.component_of[column]])


def index_unknowns(blocks: Mapping[str, Blocks]) -> Index:
    """Number the free components: kind by kind, block by block, shared components once."""
    columns: dict[str, IntArray] = {}
    kind_of, block_of, component_of = [], [], []
    count = 0
    keys = tuple(key for key in KINDS if key in blocks)
    for number, key in enumerate(keys):
        table = blocks[key]
        own = table.owner == np.arange(len(table.ids))[:, None]
        mask = table.free & own
        numbered = np.full(mask.shape, -1, dtype=np.int64)
        numbered[mask] = count + np.arange(np.count_nonzero(mask))
        columns[key] = numbered[table.owner, np.arange(table.kind.size)]
        where = np.nonzero(mask)
        kind_of.append(np.full(len(where[0]), number, dtype=np.int8))
        block_of.append(where[0].astype(np.int32))
        component_of.append(where[1].astype(np.int8))
        count += len(where[0])
    none = [np.zeros(0, dtype=np.int8)]
    return Index(
        dict(blocks),
        columns,
        keys,
        np.concatenate(kind_of or none),
        np.concatenate(block_of or none),
        np.concatenate(component_of or none),
    )


def moves_by_angles(blocks: Blocks) -> BoolArray:
    """(n,) rotations that move by ω, φ, κ, not by vectors: some of the angles are fixed, or shared one by one."""
    partly = blocks.free.any(axis=1) & ~blocks.free.all(axis=1)
    if blocks.about_axes is not None:
        partly &= ~blocks.about_axes
    # (n,) true for rotations tied to others in some angles, or with differences; equal attitudes turn as one.
    foreign = blocks.owner != np.arange(len(blocks.owner))[:, None]
    tied = foreign.any(axis=1)
    equal = foreign.all(axis=1) & (blocks.owner == blocks.owner[:, :1]).all(axis=1)
    if blocks.difference is not None:
        equal &= (blocks.difference == 0.0).all(axis=1)
    share = tied & ~equal
    share[blocks.owner[share].ravel()] = True
    share[equal] |= share[blocks.owner[equal, 0]]
    return np.asarray(partly | np.asarray(share))


def with_shared_components(blocks: Mapping[str, Blocks], values: Values) -> dict[str, FloatArray]:
    """Values in which every shared component is that of its owner, plus the difference between the two.

    An owner whose value is missing (NaN) takes it from one that shares it.
    """
    result = dict(values)
    for key, table in blocks.items():
        place, component = np.nonzero(table.owner != np.arange(len(table.ids))[:, None])
        if len(place) == 0:
            continue
        whole = angles_from_rotation(values[key]) if table.kind.is_rotation else values[key].copy()
        owner = table.owner[place, component]
        apart = 0.0 if table.difference is None else table.difference[place, component]
        told = whole[place, component] - apart
        take = np.isnan(whole[owner, component]) & np.isfinite(told)
        whole[owner[take], component[take]] = told[take]
        whole[place, component] = whole[owner, component] + apart
        if table.kind.is_rotation:
            turned = np.unique(np.concatenate([place, owner]))
            result[key] = values[key].copy()
            result[key][turned] = rotation_from_angles(whole[turned])
        else:
            result[key] = whole
    return result


def move(index: Index, values: Values, step: FloatArray) -> dict[str, FloatArray]:
    """Values after a step (u,): added to plain components, applied as small rotations to attitudes."""
    moved: dict[str, FloatArray] = {}
    for key, columns in index.columns.items():
        delta = np.where(columns >= 0, step[columns], 0.0) if len(step) else np.zeros(columns.shape)
        moved[key] = (
            _move_rotations(index.blocks[key], values[key], delta)
            if index.blocks[key].kind.is_rotation
            else values[key] + delta
        )
    return moved


def _move_rotations(blocks: Blocks, D: FloatArray, delta: FloatArray) -> FloatArray:
    by_angles = moves_by_angles(blocks)
    moved = D.copy()
    turned = (delta != 0.0).any(axis=1)
    whole = turned & ~by_angles
    moved[whole] = rotate(D[whole], delta[whole])
    part = turned & by_angles
    moved[part] = rotation_from_angles(angles_from_rotation(D[part]) + delta[part])
    return moved


def tangents(blocks: Blocks, D: FloatArray) -> FloatArray | None:
    """dδ/d(columns) (n, 3, 3) of rotations, or ``None`` if every rotation moves by its vector."""
    by_angles = moves_by_angles(blocks)
    if not by_angles.any():
        return None
    result = np.broadcast_to(np.eye(3), D.shape).copy()
    result[by_angles] = tangent_of_angles(angles_from_rotation(D[by_angles]))
    return result
