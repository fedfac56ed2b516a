"""Observed attitudes of images on the earth: ω, φ, κ in the axes of a projection; roll, pitch, yaw of navigation.

With the local axes R (rows east, north, up) at the image, turned about the vertical by the convergence γ of the
projection (from true to grid north, clockwise), an image that stands at D in object axes stands at

    D′ = D Rᵀ Γᵀ,   Γ = (cos γ, −sin γ, 0; sin γ, cos γ, 0; 0, 0, 1)

in the axes of the projection; for navigation γ = 0. The inertial system stands at B D′, with the misalignment B from
the axes of the image to its own (boresight), I where nothing is said. Body axes are forward = y*, right = x*,
down = −z* of the image,
and R_body = R_z(yaw) R_y(pitch) R_x(roll) leads from them to north, east, down (ARINC 705), so that

    yaw = atan2(D′21, D′22),   pitch = asin D′23,   roll = atan2(−D′13, D′33)

with B D′ for D′. γ is that of a given place, or that at the image itself: in the plane (E, N) of the projection grid
north keeps E as it is, so that γ = atan2(−∂E/∂n, ∂E/∂e) with the derivatives along local east e and north n.

R and γ are evaluated at the adjusted place; that R turns by 1/R_earth with every metre, and γ by about as much, stays
out of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation, rotation_from_angles
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.observations.earth.projected_bearing import Plane
from mor.units import ANGLE, Component

CONVERGENCE = Component("convergence", ANGLE)
"""Constant of a row: the direction of grid north, clockwise from true north; NaN: that at the image."""
_SLOTS = (
    Slot("point", "image", "position"),
    Slot("rotation", "image", "rotation"),
    Slot("rotation", "instrument", "boresight"),
)
Reading = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""From D′ (n, 3, 3) to its three angles (n, 3), and their derivatives (n, 3, 3) by a small rotation."""


def projected_attitude(horizon: Horizon, plane: Plane | None = None) -> ObservationType:
    """ω, φ, κ of an image in the axes of the projection: grid east, grid north, up along the normal.

    Without its ``plane`` the convergence of every row has to be given.
    """
    equation = Attitude(_cardan, horizon, True, plane)
    return _attitude("projected_attitude", ("omega", "phi", "kappa"), equation, (CONVERGENCE,))


def navigation_attitude(horizon: Horizon) -> ObservationType:
    """Roll, pitch, yaw of an image against true north and the normal of its place."""
    equation = Attitude(_navigation, horizon, False)
    return _attitude("navigation_attitude", ("roll", "pitch", "yaw"), equation, ())


def rotation_from_navigation(angles: FloatArray) -> FloatArray:
    """D′ (n, 3, 3) of roll, pitch, yaw (n, 3), radians."""
    roll, pitch, yaw = angles.T
    sr, cr, sp, cp, sy, cy = (
        np.sin(roll),
        np.cos(roll),
        np.sin(pitch),
        np.cos(pitch),
        np.sin(yaw),
        np.cos(yaw),
    )
    right = np.stack([sr * sp * sy + cr * cy, sr * sp * cy - cr * sy, -sr * cp], axis=1)
    forward = np.stack([cp * sy, cp * cy, sp], axis=1)
    up = np.stack([sr * cy - cr * sp * sy, -sr * sy - cr * sp * cy, cr * cp], axis=1)
    return np.stack([right, forward, up], axis=1)


def in_object_axes(
    type_: ObservationType, angles: FloatArray, constants: FloatArray, boresight: FloatArray
) -> FloatArray:
    """ω, φ, κ (n, 3) of images against east, north, up of observed angles (n, 3): what start values take for observed.

    ``boresight`` (n, 3, 3) is where the misalignments start. Where no convergence is given, it is that of the origin.
    """
    if isinstance(type_.equation, Attitude) and type_.equation.to_grid:
        convergence = type_.equation.convergence(np.zeros((len(angles), 3)), constants)
        attitude = rotation_from_angles(angles) @ _to_grid(convergence)
    else:
        attitude = rotation_from_navigation(angles)
    return angles_from_rotation(np.swapaxes(boresight, 1, 2) @ attitude)


@dataclass(frozen=True, eq=False)
class Attitude:
    """The equation of an attitude: how its angles are read, and against which axes."""

    read: Reading
    horizon: Horizon
    to_grid: bool
    """True if the axes are turned by the convergence."""
    plane: Plane | None = None

    def __call__(self, blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        """Angles of n images, from blocks of position, rotation and misalignment."""
        position, rotation, boresight = blocks
        axes = self.horizon.local_axes(position)
        if self.to_grid:
            axes = _to_grid(self.convergence(position, constants)) @ axes
        angles, by_boresight = self.read(boresight @ rotation @ np.swapaxes(axes, 1, 2))
        return Computed(angles, (np.zeros((len(angles), 3, 3)), by_boresight @ boresight, by_boresight))

    def convergence(self, position: FloatArray, constants: FloatArray) -> FloatArray:
        """γ (n,) as it is given, or that at positions (n, 3)."""
        given: FloatArray = constants[:, 0]
        if self.plane is None:
            return given
        east, north = self.horizon.local_axes(position)[:, :2, :2].transpose(1, 0, 2)
        _, by_foot = self.plane.at(self.horizon.foot(position).position[:, :2])
        by_east, by_north = (np.einsum("nj,nj->n", by_foot[:, 0], along) for along in (east, north))
        return np.where(np.isnan(given), np.arctan2(-by_north, by_east), given)


def _attitude(
    key: str, names: Sequence[str], equation: Attitude, constants: tuple[Component, ...]
) -> ObservationType:
    return ObservationType(
        key=key,
        components=tuple(Component(name, ANGLE) for name in names),
        references=(Reference("image", ("image",)),),
        slots=_SLOTS,
        equation=equation,
        constants=constants,
    )


def _to_grid(convergence: FloatArray) -> FloatArray:
    """Γ (n, 3, 3): from east, north, up to grid east, grid north, up."""
    result = np.zeros((len(convergence), 3, 3))
    sine, cosine = np.sin(convergence), np.cos(convergence)
    result[:, 0, 0], result[:, 0, 1], result[:, 1, 0], result[:, 1, 1] = cosine, -sine, sine, cosine
    result[:, 2, 2] = 1.0
    return result


def _cardan(D: FloatArray) -> tuple[FloatArray, FloatArray]:
    angles = angles_from_rotation(D)
    return angles, angles_by_tangent(angles)


def _navigation(D: FloatArray) -> tuple[FloatArray, FloatArray]:
    """With D ← exp(−[δ]×) D its column j moves by D_j × δ."""
    by = np.cross(np.swapaxes(D, 1, 2)[:, :, None, :], np.eye(3))  # [n, j, k, i]: D_ij by δ_k
    roll, pitch, yaw = (
        np.arctan2(-D[:, 0, 2], D[:, 2, 2]),
        np.arctan2(D[:, 1, 2], np.hypot(D[:, 1, 0], D[:, 1, 1])),
        np.arctan2(D[:, 1, 0], D[:, 1, 1]),
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # no roll, no yaw where forward is vertical
        of_roll = D[:, 0, 2] ** 2 + D[:, 2, 2] ** 2
        of_yaw = D[:, 1, 0] ** 2 + D[:, 1, 1] ** 2
        by_roll = (D[:, :1, 2] * by[:, 2, :, 2] - D[:, 2:, 2] * by[:, 2, :, 0]) / of_roll[:, None]
        by_pitch = by[:, 2, :, 1] / np.sqrt(of_yaw)[:, None]
        by_yaw = (D[:, 1, 1:2] * by[:, 0, :, 1] - D[:, 1, :1] * by[:, 1, :, 1]) / of_yaw[:, None]
    return np.stack([roll, pitch, yaw], axis=1), np.stack([by_roll, by_pitch, by_yaw], axis=1)
