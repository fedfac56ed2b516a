"""Rays along trajectories: which have a compiled form, and what that takes of their knots.

Knot 0 stands where images have a pose of their own; the further ones are parts of a frame besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.sights.cameras import ALONG, CROSSING, MODELS, MOVING
from mor.adjustment.rays.compiled.sights.image_rays import Paths
from mor.arrays import AnyIntArray, FloatArray, IntArray
from mor.geometry.trajectory import path_of
from mor.observations import IMAGE_TYPES, ObservationGroup
from mor.observations.time.line_scanner import ROW, line_scanner
from mor.observations.time.rolling_shutter import PHASE
from mor.observations.time.shutter_on_trajectory import shutter_on_trajectory
from mor.observations.time.trajectory import CUBIC, LINEAR, is_along, on_trajectory

FURTHER = tuple((f"rotation of knot {k}", f"position of knot {k}") for k in range(1, CUBIC))
"""Parts of a frame besides knot 0, knot by knot, in the order in which they stand in a block of the reduced system."""
KNOT_PARTS = tuple(part for knot in FURTHER for part in knot)


class CompiledAlong(NamedTuple):
    """What the kernels take of the f frames of a group along trajectories."""

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


def knot_starts(columns: IntArray) -> dict[str, int]:
    """First columns of the parts of further knots, from those of a layout (3, 2) or (0, 2)."""
    return dict(zip(KNOT_PARTS, columns.ravel().tolist(), strict=False))


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


def compiled_along(
    group: ObservationGroup, rows: IntArray, frame: IntArray, frames: int
) -> CompiledAlong | None:
    """What kernels take of a group; ``None`` where it has no compiled form, or a frame not one r0 and its weights."""
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
    positions, rotations = (
        np.stack([part[name] for name in some], axis=1) for some in (names[:knots], names[knots:])
    )
    path = path_of(positions, rotations, weights)
    paths.knots[here] = knots
    paths.weights[here, :knots, :knots] = weights
    apart = positions[:, 1:] - positions[:, :1]
    paths.reach[here, : knots - 1] = np.einsum("fij,fkj->fki", path.first, apart)
    paths.turns[here, : knots - 1] = path.turns
    paths.inverse[here, : knots - 1] = path.inverse
    for k, tangent in enumerate(tangents or ()):
        paths.tangent[here, k] = tangent


def knot_change(
    knots: int, part: Mapping[str, FloatArray], tangents: Sequence[FloatArray] | None
) -> FloatArray:
    """(f, 3, 2, 3) changes of the further knots from those of their parts: positions, then small rotations."""
    change = np.zeros((len(part["position"]), len(FURTHER), 2, 3))
    for k, (rotation, position) in enumerate(FURTHER[: knots - 1]):
        change[:, k, 0] = part[position]
        change[:, k, 0, 2] += part["height"][:, 0]
        turn = part[rotation]
        change[:, k, 1] = turn if tangents is None else np.einsum("fij,fj->fi", tangents[k], turn)
    return change
