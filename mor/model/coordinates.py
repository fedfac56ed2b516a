"""Observed coordinates, heights, parameters and projection centres."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.model.contract import POSITIONS, Computed, ObservationType, Reference, Slot
from mor.model.parameters import KINDS, BlockKind
from mor.model.ports import DOME_PORT
from mor.model.rotations import angles_by_tangent, angles_from_rotation, by_rotation
from mor.types import FloatArray
from mor.units import ANGLE, LENGTH, Component

# ---- Observed coordinates of a position, one, two or all three, with covariances where they are correlated (MOR 2).


def coordinate_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(X, Y, Z)."""
    position = blocks[0]
    return Computed(position.copy(), (np.broadcast_to(np.eye(3), (len(position), 3, 3)),))


COORDINATES = ObservationType(
    key="coordinates",
    components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
    references=(Reference("point", POSITIONS),),
    slots=(Slot("point", "point", "position"),),
    equation=coordinate_equation,
    in_object_axes=True,
)


# ---- Coordinates in a local system: planes, lines, right angles, transferred coordinates (MOR 1.5).


def local_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(X̄, Ȳ, Z̄) = λ D (X − X0) + r̄.

    The offset r̄ in local axes is zero for a transferred system; for a plane its third component is the distance of
    the plane from X0, which keeps the parametrisation regular for every attitude.
    """
    origin, rotation, scale, offset, point = blocks
    turned = np.einsum("nij,nj->ni", rotation, point - origin)
    to_point = scale[:, :, None] * rotation
    identity = np.broadcast_to(np.eye(3), rotation.shape)
    return Computed(
        scale * turned + offset,
        (-to_point, by_rotation(identity * scale[:, :, None], turned), turned[:, :, None], identity, to_point),
    )


LOCAL = ObservationType(
    key="local",
    components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
    references=(Reference("system", ("system",)), Reference("point", POSITIONS)),
    slots=(
        Slot("point", "system", "position"),
        Slot("rotation", "system", "rotation"),
        Slot("scale", "system", "scale"),
        Slot("eccentricity", "system", "offset"),
        Slot("point", "point", "position"),
    ),
    equation=local_equation,
)


# ---- Observed level of a frame: its tilt in instrument axes, the first two components of D e_Z (MOR 2).


def level_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(D13, D23): zero for a levelled frame; invariant under a turn about the vertical."""
    (rotation,) = blocks
    vertical = rotation[:, :, 2]
    axes = np.broadcast_to(np.eye(3)[:2], (len(vertical), 2, 3))
    return Computed(vertical[:, :2].copy(), (by_rotation(axes, vertical),))


LEVEL = ObservationType(
    key="level",
    components=(Component("tilt_x", ANGLE), Component("tilt_y", ANGLE)),
    references=(Reference("frame", ("station", "image", "system")),),
    slots=(Slot("rotation", "frame", "rotation"),),
    equation=level_equation,
)


# ---- Observed parameters and observed differences of parameters, for every kind of block (MOR 2).


def _read(kind: BlockKind, block: FloatArray) -> tuple[FloatArray, FloatArray]:
    if kind.is_rotation:
        angles = angles_from_rotation(block)
        return angles, angles_by_tangent(angles)
    return block, np.broadcast_to(np.eye(kind.size), (len(block), kind.size, kind.size))


def observed_parameter(kind: BlockKind) -> ObservationType:
    """The components of a block themselves: prior knowledge, control points, calibration, GNSS and INS."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        values, jacobian = _read(kind, blocks[0])
        return Computed(values, (jacobian,))

    return ObservationType(
        key=f"observed/{kind.key}",
        written="parameter",
        components=kind.components,
        references=(Reference("of", (kind.key,)),),
        slots=(Slot(kind.key, "of", "itself"),),
        equation=equation,
        in_object_axes=kind.in_object_axes,
    )


def observed_difference(kind: BlockKind) -> ObservationType:
    """Second block minus first, component by component: Δc, Δr0*, ΔX0, Δω*, ΔbX* and so on."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        first, by_first = _read(kind, blocks[0])
        second, by_second = _read(kind, blocks[1])
        return Computed(second - first, (-by_first, by_second))

    return ObservationType(
        key=f"difference/{kind.key}",
        written="difference",
        components=kind.components,
        references=(Reference("from", (kind.key,)), Reference("to", (kind.key,))),
        slots=(Slot(kind.key, "from", "itself"), Slot(kind.key, "to", "itself")),
        equation=equation,
        in_object_axes=kind.in_object_axes,
    )


OBSERVED_PARAMETERS = {kind.key: observed_parameter(kind) for kind in KINDS.values()}
OBSERVED_DIFFERENCES = {kind.key: observed_difference(kind) for kind in KINDS.values()}


# ---- Observations to the projection centre of an image, which may lie beside the point the camera is turned about.
#
# An image named as a position is its rotation centre, X0 + h e_Z. The point that is imaged at X* = 0 is
#
#     X_p = X0 + h e_Z + Dᵀ (b* − r0*)
#
# with the eccentricity r0* from the projection centre to the rotation centre, and for a stereo follower, with
# the frame of its leading image, its base b* (else 0). Every type that takes positions gets a twin that takes
# projection centres.


def to_projection_centres(type_: ObservationType) -> ObservationType:
    """The twin of a type whose positions may be projection centres.

    Its slots are those of the type, then for each end rotation, eccentricity and base (neutral where the end is not
    a projection centre), and the height where the type itself knows none.
    """
    ends = [reference.name for reference in type_.references if reference.among == POSITIONS]
    at = {end: _slot_of(type_, end, "position") for end in ends}
    low = [end for end in ends if _slot_of(type_, end, "height") < 0]
    arm = (("rotation", "rotation"), ("eccentricity", "eccentricity"), ("base", "base"))
    extra = [Slot(kind, end, part) for end in ends for kind, part in arm]
    extra += [Slot("height", end, "height") for end in low]

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        own, arms = list(blocks[: len(type_.slots)]), blocks[len(type_.slots) :]
        heights = dict(zip(low, arms[3 * len(ends) :], strict=True))
        frames = {end: arms[3 * k : 3 * k + 3] for k, end in enumerate(ends)}
        for end, (D, eccentricity, base) in frames.items():
            own[at[end]] = own[at[end]] + np.einsum("nji,nj->ni", D, base - eccentricity)
            if end in heights:
                own[at[end]][:, 2] += heights[end][:, 0]
        computed = type_.equation(own, constants)
        further: list[FloatArray] = []
        for end, (D, eccentricity, base) in frames.items():
            by_star = computed.jacobians[at[end]] @ np.swapaxes(D, 1, 2)
            further += [-by_rotation(by_star, base - eccentricity), -by_star, by_star]
        further += [computed.jacobians[at[end]][:, :, 2:] for end in low]
        return Computed(computed.values, (*computed.jacobians, *further))

    return type_._replace(
        key=f"{type_.key}/projection centre",
        written=type_.name,
        slots=(*type_.slots, *extra),
        equation=equation,
        flat=to_projection_centres(type_.flat) if type_.flat is not None else None,
    )


def _slot_of(type_: ObservationType, end: str, part: str) -> int:
    return next((k for k, slot in enumerate(type_.slots) if (slot.of, slot.part) == (end, part)), -1)


def takes_positions(type_: ObservationType) -> bool:
    """True for types with a reference that may be any position."""
    return any(reference.among == POSITIONS for reference in type_.references)


# ---- Rays to points at infinity: a direction instead of a point. Shifts and scale do not change them at all.
#
# A point whose rays are parallel to their precision has a direction and no distance. Its coordinates would
# grow without limit and take the datum along. The direction u = Dᵀ e_Z, D a rotation of two free turns, is
# the limit itself: seen from a frame it is X* = D_frame · u, wherever the frame stands (MOR eq. 1 with X →
# ∞).

AT_INFINITY = " at infinity"
"""What the keys of these types end with."""
TURNED_AXIS: FloatArray = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""∂u/∂δ in the axes of D: −[e_Z]×."""


@cache
def at_infinity(type_: ObservationType) -> ObservationType:
    """Return the observation type for a point at infinity, which is a direction; lengths of the set-up vanish.

    Slots: those of ``type_`` that are no lengths, and a rotation instead of the point.
    """
    target = target_slot(type_)
    # Kinds of blocks that are nothing beside an infinite distance, also per second, and their sizes.
    lengths = {"height": 1, "eccentricity": 3, "base": 3, "image velocity": 3}
    kept = tuple(k for k, slot in enumerate(type_.slots) if slot.kind not in lengths and slot.kind != "point")

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        D = blocks[-1]
        near = {k: _without_lengths(type_.slots[k], b) for k, b in zip(kept, blocks[:-1], strict=True)}
        near[target] = D[:, 2, :]
        nothing = [np.zeros((len(D), lengths.get(slot.kind, 3))) for slot in type_.slots]
        filled = [near.get(k, zero) for k, zero in enumerate(nothing)]
        computed = type_.equation(filled, constants)
        by_turn = computed.jacobians[target] @ np.swapaxes(D, 1, 2) @ TURNED_AXIS
        by_kept = (_without_lengths(type_.slots[k], computed.jacobians[k]) for k in kept)
        return Computed(computed.values, (*by_kept, by_turn))

    return type_._replace(
        key=type_.key + AT_INFINITY,
        written=type_.name,
        slots=(*(type_.slots[k] for k in kept), Slot("rotation", type_.slots[target].of, "direction")),
        equation=equation,
        distances=None,
    )


def _without_lengths(slot: Slot, array: FloatArray) -> FloatArray:
    """A block (n, size), or the derivatives (n, m, size) by it, with the components that are lengths at 0."""
    if not slot.kind.startswith("interior/"):
        return array
    lengths = [component.quantity == LENGTH for component in KINDS[slot.kind].components]
    return np.where(lengths, 0.0, array) if any(lengths) else array


def target_slot(type_: ObservationType) -> int:
    """Number of the slot of the point that is sighted."""
    return max(k for k, slot in enumerate(type_.slots) if slot.kind == "point")


def can_be_at_infinity(type_: ObservationType) -> bool:
    """True for rays: two angles or image coordinates from a frame with an attitude to a point.

    Not where the place of the frame turns the axes: without it there is no vertical. Nor through a dome, which bends
    rays by its eccentricity in relation to its radius, both lengths.
    """
    positions = sum(slot.kind == "point" for slot in type_.slots)
    frames = positions == 2 and any(slot.part == "rotation" for slot in type_.slots)
    lengths = any(component.quantity == LENGTH for component in type_.components)
    sighted = any(slot.kind == "point" for slot in type_.slots)
    two = len(type_.components) == 2 and not type_.about_local_vertical
    through_dome = any(slot.kind.endswith(DOME_PORT.key) for slot in type_.slots)
    return frames and sighted and two and not lengths and not through_dome
