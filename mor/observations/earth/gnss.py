"""GNSS vectors and positions in geocentric axes of a reference frame of their own.

The frame of a GNSS solution may lie, turn and scale a little differently from that of the points. About the origin X₀
of the object system, the middle of the network,

    X_obs = X₀ + t + m R (X − X₀),    ΔX_obs = m R ΔX,    R = R_z(r_z) R_y(r_y) R_x(r_x)

with right-handed turns of the vectors about the geocentric axes (the *position vector* convention). About the geocentre
the shift would differ, t − (m R − 1) X₀, and could hardly be told from the turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component

_MIDDLE = np.array([0.0, 0.0, 1.0])
"""Normal at the middle of the network: near enough for the derivative by heights that are all 0."""
_FRAME_SLOT = Slot("gnss frame", "instrument", "gnss frame")
_AXES = np.eye(3)
_TURNS = np.array([np.cross(axis, _AXES).T for axis in _AXES])
"""(3, 3, 3) matrices of the vector products with the axes."""


class _Turned(NamedTuple):
    """Vectors (n, 3) in the frame of the satellites."""

    values: FloatArray
    by_vector: FloatArray
    """(n, 3, 3) by the vector in geocentric axes."""
    by_frame: FloatArray
    """(n, 3, 7) by shift, turn and scale."""


def _in_frame(vector: FloatArray, frame: FloatArray) -> _Turned:
    """m R of geocentric vectors (n, 3); the shift (n, 3) in front of it is not added."""
    about = [_about(k, frame[:, 3 + k]) for k in range(3)]
    R = about[2] @ about[1] @ about[0]
    matrix = frame[:, 6:, None] * R
    values = np.einsum("nij,nj->ni", matrix, vector)
    by_frame = np.zeros((len(vector), 3, 7))
    by_frame[:, :, :3] = _AXES
    by_frame[:, :, 3] = np.einsum("nij,jk,nk->ni", matrix, _TURNS[0], vector)
    turned = np.einsum("nij,nj->ni", about[1] @ about[0], vector)
    by_frame[:, :, 4] = frame[:, 6:] * np.einsum("nij,jk,nk->ni", about[2], _TURNS[1], turned)
    by_frame[:, :, 5] = values @ _TURNS[2].T
    by_frame[:, :, 6] = values / frame[:, 6:]
    return _Turned(values, matrix, by_frame)


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """(n, 3, 3) right-handed turns about one axis."""
    K = _TURNS[axis]
    sine, versine = np.sin(angle)[:, None, None], 2.0 * (np.sin(0.5 * angle) ** 2)[:, None, None]
    result: FloatArray = _AXES + sine * K + versine * (K @ K)
    return result


def gnss_vector(horizon: Horizon) -> ObservationType:
    """Geocentric (ΔX, ΔY, ΔZ) between marks, or between antennas at heights along the normals above them."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, start_height, end, end_height, frame = blocks
        vector = end - start
        up_start = up_end = np.broadcast_to(_MIDDLE, vector.shape)
        if start_height.any() or end_height.any():  # from mark to mark nothing needs the normals
            up_start, up_end = np.split(horizon.foot(np.concatenate([start, end])).up, 2)
            vector = vector + end_height * up_end - start_height * up_start
        there = _in_frame(vector @ turn.T, frame)
        there.by_frame[:, :, :3] = 0.0  # vectors know nothing of a shift
        by_end = there.by_vector @ turn
        by_heights = [np.einsum("nij,nj->ni", by_end, up)[:, :, None] for up in (up_start, up_end)]
        return Computed(there.values, (-by_end, -by_heights[0], by_end, by_heights[1], there.by_frame))

    return ObservationType(
        key="gnss_vector",
        components=(Component("dx", LENGTH), Component("dy", LENGTH), Component("dz", LENGTH)),
        references=FROM_TO,
        slots=(*BETWEEN_SLOTS, _FRAME_SLOT),
        equation=equation,
        distances=("from", "to"),
        between_marks=True,
    )


def gnss_position(horizon: Horizon) -> ObservationType:
    """Geocentric (X, Y, Z) of a position."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, frame = blocks
        there = _in_frame(position @ turn.T, frame)
        return Computed(
            horizon.origin + frame[:, :3] + there.values, (there.by_vector @ turn, there.by_frame)
        )

    return ObservationType(
        key="gnss_position",
        components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"), _FRAME_SLOT),
        equation=equation,
    )
