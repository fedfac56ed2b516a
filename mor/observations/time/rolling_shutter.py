"""Image coordinates of an image that is read out row by row while the camera moves: a rolling shutter.

Each image has one motion: a steady velocity v and a steady rate of rotation ω, both in its own axes. Its pose X0, D is
that of the middle row; a point in row ρ of H is seen at the time

    t = T · (ρ/H − 1/2)        and        X*(t) = exp(−[ω t]×) (D (X − X0) − v t) + r0*

with the readout time T from the first row to the last. ρ is the row in which shutter and moving point meet, which
is the row that is computed: it is found by Newton's method from the observed row, some hundredths of a row beside it.
(With the observed row itself in its place the residuals come out too small, by the drift during the readout over the
height of the image, and T with a bias.) Columns likewise, where the shutter runs across. At T = 0 this is the frame
image, digit by digit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel, Projection
from mor.geometry.frames import by_rotation, into_frame
from mor.geometry.motion import Moved, by_time, moved, right_jacobian
from mor.observations._contract import Computed, ObservationGroup, ObservationType, Slot
from mor.observations.image import (
    COMPONENTS,
    FRAME_SLOTS,
    IMAGE_TYPES,
    MEASURED,
    POINT_SLOT,
    REFERENCES,
    WRITTEN,
)
from mor.parameters.kinds import interior_key
from mor.units import NUMBER, Component

READOUT_SLOT = Slot("readout", "image", "readout")
MOTION_SLOTS = (
    Slot("image velocity", "image", "image velocity"),
    Slot("rotation rate", "image", "rotation rate"),
    READOUT_SLOT,
)
PHASE = (
    Component("phase by x", NUMBER),
    Component("phase by y", NUMBER),
    Component("phase at 0", NUMBER),
)
"""Last constants of a row: what of the readout has passed at x, y, from −1/2 at its begin to 1/2."""


def moving_image_coordinates(model: CameraModel) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model and a rolling shutter.

    Slots: position, rotation, height, eccentricity, velocity, rotation rate, readout time, interior orientation, point.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, velocity, rate, readout, interior, point = blocks
        measured, own, clock = constants[:, :2], constants[:, 2:-3], constants[:, -3:]
        frame = into_frame(position, rotation, height, point)

        def at(phase: FloatArray) -> tuple[Moved, Projection, FloatArray]:
            found = moved(frame.lever, velocity, rate, readout[:, 0] * phase)
            projection = model.project(found.star + eccentricity, interior, own, measured)
            return found, projection, by_time(found, velocity, rate)

        meeting = meet(at, measured, clock, readout)
        phase, found, projection = meeting.phase, meeting.at, meeting.projection
        time = readout[:, 0] * phase
        by_shifted = projection.by_star @ found.turn
        by_position = -by_shifted @ rotation
        turned = right_jacobian(-rate * time[:, None]) * time[:, None, None]
        jacobians = (
            by_position,
            by_rotation(by_shifted, frame.lever),
            by_position[:, :, 2:],
            projection.by_star,
            -time[:, None, None] * by_shifted,
            by_rotation(by_shifted, found.shifted) @ turned,
            (phase[:, None] * meeting.drift)[:, :, None],
            projection.by_interior,
            -by_position,
        )
        return Computed(meeting.values, tuple(meeting.changed(one) for one in jacobians))

    return ObservationType(
        key=f"{MOVING}/{model.key}",
        written=WRITTEN,
        components=COMPONENTS,
        references=REFERENCES,
        slots=(*FRAME_SLOTS, *MOTION_SLOTS, Slot(interior_key(model.key), "image", "interior"), POINT_SLOT),
        equation=equation,
        constants=(*MEASURED, *model.constants, *PHASE),
    )


At = TypeVar("At")
"""How things are at one time."""


class Meeting(NamedTuple, Generic[At]):
    """Points where they and the shutter meet."""

    phase: FloatArray
    """(n,) part of the readout that has passed, less 1/2."""
    at: At
    projection: Projection
    drift: FloatArray
    """(n, 2) velocity in the image."""
    clock: FloatArray
    """(n, 3) phases by x, by y, and at 0."""
    readout: FloatArray
    """(n, 1) time from the first row to the last."""
    slip: FloatArray
    """(n,) 1 − T ∂ρ/∂t: how fast the shutter and the point meet; 1 where nothing moves along the readout."""
    xy: FloatArray
    """(n, 2) where the shutter is at this time; the point is beside it by next to nothing."""

    @property
    def values(self) -> FloatArray:
        """(n, 2) image coordinates where the two meet."""
        return self.projection.xy + self.further(self.projection.xy - self.xy)

    def changed(self, change: FloatArray) -> FloatArray:
        """Changes (n, 2) or (n, 2, k) of the image point at a fixed time, where shutter and point meet again."""
        return change + self.further(change)

    def further(self, change: FloatArray) -> FloatArray:
        """How much further the point drifts: a change δ moves its row, and the time by T g·δ / slip; 0 at T = 0."""
        one = (1,) * (change.ndim - 2)
        passed = np.einsum("nj,nj...->n...", self.clock[:, :2], change)
        time = self.readout.reshape(-1, *one) * passed / self.slip.reshape(-1, *one)
        further: FloatArray = self.drift.reshape(-1, 2, *one) * time[:, None]
        return further


def meet(
    at: Callable[[FloatArray], tuple[At, Projection, FloatArray]],
    measured: FloatArray,
    clock: FloatArray,
    readout: FloatArray,
) -> Meeting[At]:
    """Return the image points at which the shutter passes, by Newton's method from ``measured`` (n, 2).

    ``at`` says what there is when parts (n,) of the readout have passed: how things are, where the points are seen,
    and ∂X*/∂t (n, 3).
    """

    def seen(xy: FloatArray) -> Meeting[At]:
        """Return the projection at the moment when the shutter passes xy."""
        phase = phases(xy, clock)
        found, projection, by_time = at(phase)
        drift = np.einsum("nij,nj->ni", projection.by_star, by_time)
        slip = 1.0 - readout[:, 0] * np.einsum("nj,nj->n", clock[:, :2], drift)
        return Meeting(phase, found, projection, drift, clock, readout, slip, xy)

    found = seen(measured)
    before = np.full(len(measured), np.inf)
    for number in range(_ROUNDS):
        step = found.changed(found.projection.xy - found.xy)
        size = np.abs(step).max(axis=1, initial=0.0)
        nears = size < 0.5 * before if number >= _DOUBTFUL else np.ones(len(size), dtype=bool)
        if not size[nears].max(initial=0.0) > _STILL * np.abs(found.xy).max(initial=0.0):
            break
        found, before = seen(found.xy + step), size
    return found


def phases(xy: FloatArray, clock: FloatArray) -> FloatArray:
    """(n,) part of the readout that has passed at image coordinates (n, 2), less 1/2; ``clock`` (n, 3)."""
    passed: FloatArray = clock[:, 0] * xy[:, 0] + clock[:, 1] * xy[:, 1] + clock[:, 2]
    return passed


def read_out_at_once(group: ObservationGroup) -> ObservationGroup:
    """A group of such image coordinates as if the images had been frames; any other group as it is."""
    form, _, key = group.type.key.partition("/")
    if form != MOVING:
        return group
    frame = IMAGE_TYPES[key]
    pairs = zip(group.type.slots, group.blocks, strict=True)
    blocks = tuple(numbers for slot, numbers in pairs if slot in frame.slots)
    return replace(group, type=frame, blocks=blocks, constants=group.constants[:, : len(frame.constants)])


_ROUNDS = 20
_DOUBTFUL = 4
"""Rounds after which a point whose step does not halve will never meet the shutter, and others do not wait for it."""
_STILL = 1e-13
"""Part of the image coordinates by which a point may still move when it has met the shutter."""
MOVING = "moving"
"""What the keys of these types begin with."""
MOVING_TYPES = {model.key: moving_image_coordinates(model) for model in CAMERA_MODELS.values()}
