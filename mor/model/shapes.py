"""Circles, spheres, cylinders, cones and tori: distances of points from them, and relations between features.

The axis of a shape is the z axis of a local system, x̄ = D (X − X0) + r̄. With ρ = √(x̄² + ȳ²), radius r, minor radius
q and semi-angle α the distances are

    circle    ρ − r and z̄               sphere   √(ρ² + z̄²) − r
    cylinder  ρ − r                     torus    √((ρ − r)² + z̄²) − q
    cone      ρ cos α − z̄ sin α

Each is the orthogonal distance, negative inside (A. B. Forbes, Least-squares best-fit geometric elements, NPL Report
DITC 140/89, 1989). r of a cone is 0, so that its apex is the origin; that of a circle, sphere and cylinder its radius.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.model.contract import POSITIONS, Computed, Equation, ObservationType, Reference, Slot
from mor.model.coordinates import TURNED_AXIS
from mor.model.rotations import by_rotation, cross_matrix
from mor.types import FloatArray
from mor.units import ANGLE, LENGTH, Component, Quantity

_Distances = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Local coordinates (n, 3), shape (n, 3) → distances (n, m), derivatives (n, m, 3) by both."""


def _circle(local: FloatArray, shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    rho, by_rho = _from_axis(local)
    along = np.broadcast_to([0.0, 0.0, 1.0], local.shape)
    by_shape = np.zeros((len(local), 2, 3))
    by_shape[:, 0, 0] = -1.0
    return (np.stack([rho - shape[:, 0], local[:, 2]], axis=1), np.stack([by_rho, along], axis=1), by_shape)


def _sphere(local: FloatArray, shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    length = np.linalg.norm(local, axis=1)
    by_shape = np.broadcast_to([-1.0, 0.0, 0.0], local.shape)
    return _one(length - shape[:, 0], local / _above_zero(length)[:, None], by_shape)


def _cone(local: FloatArray, shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The cylinder is the cone of semi-angle 0 with a radius at z̄ = 0."""
    rho, by_rho = _from_axis(local)
    away, along = rho - shape[:, 0], local[:, 2]
    cosine, sine = np.cos(shape[:, 2]), np.sin(shape[:, 2])
    by_local = cosine[:, None] * by_rho
    by_local[:, 2] = -sine
    by_shape = np.stack([-cosine, np.zeros_like(rho), -away * sine - along * cosine], axis=1)
    return _one(away * cosine - along * sine, by_local, by_shape)


def _torus(local: FloatArray, shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    rho, by_rho = _from_axis(local)
    away, along = rho - shape[:, 0], local[:, 2]
    length = np.hypot(away, along)
    across, up = away / _above_zero(length), along / _above_zero(length)
    by_local = across[:, None] * by_rho
    by_local[:, 2] = up
    by_shape = np.stack([-across, -np.ones_like(rho), np.zeros_like(rho)], axis=1)
    return _one(length - shape[:, 1], by_local, by_shape)


def _from_axis(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ρ (n,) and its derivatives (n, 3)."""
    rho = np.hypot(local[:, 0], local[:, 1])
    by_local = local / _above_zero(rho)[:, None]
    by_local[:, 2] = 0.0
    return rho, by_local


def _above_zero(length: FloatArray) -> FloatArray:
    return np.maximum(length, np.finfo(float).tiny ** 0.5)


def _one(distance: FloatArray, by_local: FloatArray, by_shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return distance[:, None], by_local[:, None, :], by_shape[:, None, :]


def _shape_type(key: str, distances: _Distances, components: tuple[str, ...] = ("distance",)) -> ObservationType:
    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        origin, rotation, offset, shape, point = blocks
        turned = np.einsum("nij,nj->ni", rotation, point - origin)
        values, by_local, by_shape = distances(turned + offset, shape)
        by_point = by_local @ rotation
        return Computed(values, (-by_point, by_rotation(by_local, turned), by_local, by_shape, by_point))

    return ObservationType(
        key=key,
        components=tuple(Component(name, LENGTH) for name in components),
        references=(Reference("system", ("system",)), Reference("point", POSITIONS)),
        slots=(
            Slot("point", "system", "position"),
            Slot("rotation", "system", "rotation"),
            Slot("eccentricity", "system", "offset"),
            Slot("shape", "system", "shape"),
            Slot("point", "point", "position"),
        ),
        equation=equation,
    )


SHAPE_TYPES = {
    type_.key: type_
    for type_ in (
        _shape_type("circle", _circle, ("radial", "axial")),
        _shape_type("sphere", _sphere),
        _shape_type("cylinder", _cone),
        _shape_type("cone", _cone),
        _shape_type("torus", _torus),
    )
}
"""Types of ``features``; each observes the distances of points from a shape as zero."""


# ---- Relations between features A and B, each with a local system x̄ = D (X − X0) + r̄ whose z axis is its axis or
# normal.
#
# Exactly: B takes blocks of A. B is perpendicular to A if D_B = E D_A and E has one free turn, that about the axis of
# A, which is the y axis of B. As observations: the axis of B, D_A D_Bᵀ e_Z, and the origin of B,
# D_A (X_B − X0_A) + r̄_A with X_B = X0_B − D_Bᵀ r̄_B, in the local system of A. E is the identity for other features.

PERPENDICULAR: FloatArray = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""E at angle 0: the z axis of B is the x axis of A."""
PERPENDICULAR_TURNS = (False, True, False)
"""Free turns of E about the axes of B."""


def to_perpendicular(type_: ObservationType) -> ObservationType:
    """Return the type of a shape whose rotation is E D_A; its last slot is E."""
    place = next(k for k, slot in enumerate(type_.slots) if slot.part == "rotation")

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        own, turn = list(blocks[:-1]), blocks[-1]
        own[place] = turn @ own[place]
        computed = type_.equation(own, constants)
        jacobians = list(computed.jacobians)
        by_turn = jacobians[place]
        jacobians[place] = by_turn @ turn
        return Computed(computed.values, (*jacobians, by_turn))

    return type_._replace(
        key=f"{type_.key}/perpendicular",
        written=type_.name,
        slots=(*type_.slots, Slot("rotation", "system", "turn")),
        equation=equation,
    )


PERPENDICULAR_TYPES = {key: to_perpendicular(type_) for key, type_ in SHAPE_TYPES.items() if key != "sphere"}
"""By the type of the shape."""


def _axis(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    first, turn, second, other = blocks
    D, E = turn @ first, other @ second
    relative = D @ np.swapaxes(E, 1, 2)
    values = relative[:, :, 2]
    by_first = by_rotation(np.broadcast_to(np.eye(3), D.shape), values)
    by_second = relative @ TURNED_AXIS
    return Computed(values.copy(), (by_first @ turn, by_first, by_second @ other, by_second))


def _origin(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    origin, first, turn, offset, place, second, other, own = blocks
    D, E = turn @ first, other @ second
    relative = D @ np.swapaxes(E, 1, 2)
    turned = np.einsum("nij,nj->ni", D, place - origin) - np.einsum("nij,nj->ni", relative, own)
    identity = np.broadcast_to(np.eye(3), D.shape)
    by_first, by_second = by_rotation(identity, turned), relative @ cross_matrix(own)
    return Computed(
        turned + offset, (-D, by_first @ turn, by_first, identity, D, by_second @ other, by_second, -relative)
    )


_ROTATIONS = (("rotation", "rotation"), ("rotation", "turn"))


def _relation(
    key: str, quantity: Quantity, names: tuple[str, ...], slots: tuple[tuple[str, str], ...], equation: Equation
) -> ObservationType:
    between = (Reference("from", ("feature",)), Reference("to", ("feature",)))
    return ObservationType(
        key=key,
        components=tuple(Component(name, quantity) for name in names),
        references=between,
        slots=tuple(Slot(kind, end.name, part) for end in between for kind, part in slots),
        equation=equation,
    )


RELATION_TYPES = {
    type_.key: type_
    for type_ in (
        _relation("axis", ANGLE, ("tilt_x", "tilt_y", "tilt_z"), _ROTATIONS, _axis),
        _relation(
            "axis_offset",
            LENGTH,
            ("x", "y", "z"),
            (("point", "position"), *_ROTATIONS, ("eccentricity", "offset")),
            _origin,
        ),
    )
}
"""Types that observe a feature in the local system of another one."""
