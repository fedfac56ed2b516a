"""Image coordinates of an image that is read out row by row while the camera moves: a rolling shutter.

Each image has one motion: a steady velocity v and a steady rate of rotation ω, both in its own axes. Its pose X0, D is
that of the middle row; a point in row ρ of H is seen at the time

    t = T · (ρ/H − 1/2)        and        X*(t) = exp(−[ω t]×) (D (X − X0) − v t) + r0*

with the readout time T from the first row to the last. ρ is the *observed* row: that is the row in which the point was
exposed, distortion and residual included, so t is known before anything is computed. Columns likewise, where the
shutter runs across. At T = 0 this is the frame image, digit by digit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.geometry.frames import by_rotation, into_frame
from mor.geometry.motion import by_time, moved, right_jacobian
from mor.observations._contract import Computed, ObservationType, Slot
from mor.observations.image import COMPONENTS, FRAME_SLOTS, MEASURED, POINT_SLOT, REFERENCES, WRITTEN
from mor.parameters.kinds import interior_key
from mor.units import NUMBER, Component

MOTION_SLOTS = (
    Slot("velocity", "image", "velocity"),
    Slot("rotation rate", "image", "rotation rate"),
    Slot("readout", "image", "readout"),
)
PHASE = (
    Component("phase by x", NUMBER),
    Component("phase by y", NUMBER),
    Component("phase at 0", NUMBER),
)
"""Last constants of a row: what of the readout has passed at measured x, y, from −1/2 at its begin to 1/2."""


def moving_image_coordinates(model: CameraModel) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model and a rolling shutter.

    Slots: position, rotation, height, eccentricity, velocity, rotation rate, readout time, interior orientation, point.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, velocity, rate, readout, interior, point = blocks
        measured, phase = constants[:, :2], phases(constants)
        time = readout[:, 0] * phase
        frame = into_frame(position, rotation, height, point)
        found = moved(frame.lever, velocity, rate, time)
        projection = model.project(found.star + eccentricity, interior, constants[:, 2:-3], measured)
        by_shifted = projection.by_star @ found.turn
        by_position = -by_shifted @ rotation
        turned = right_jacobian(-rate * time[:, None]) * time[:, None, None]
        passed = phase[:, None] * by_time(found, velocity, rate)
        return Computed(
            projection.xy,
            (
                by_position,
                by_rotation(by_shifted, frame.lever),
                by_position[:, :, 2:],
                projection.by_star,
                -time[:, None, None] * by_shifted,
                by_rotation(by_shifted, found.shifted) @ turned,
                np.einsum("nij,nj->ni", projection.by_star, passed)[:, :, None],
                projection.by_interior,
                -by_position,
            ),
        )

    return ObservationType(
        key=f"{MOVING}/{model.key}",
        written=WRITTEN,
        components=COMPONENTS,
        references=REFERENCES,
        slots=(*FRAME_SLOTS, *MOTION_SLOTS, Slot(interior_key(model.key), "image", "interior"), POINT_SLOT),
        equation=equation,
        constants=(*MEASURED, *model.constants, *PHASE),
    )


def phases(constants: FloatArray) -> FloatArray:
    """(n,) part of the readout that has passed at the measured coordinates, less 1/2."""
    by_x, by_y, at_zero = constants[:, -3:].T
    passed: FloatArray = by_x * constants[:, 0] + by_y * constants[:, 1] + at_zero
    return passed


MOVING = "moving"
"""What the keys of these types begin with."""
MOVING_TYPES = {model.key: moving_image_coordinates(model) for model in CAMERA_MODELS.values()}
