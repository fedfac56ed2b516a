"""Observed parameters and observed differences of parameters, for every kind of block (MOR 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.parameters.kinds import KINDS, BlockKind


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
