"""Image coordinates that are read out row by row along a trajectory: a rolling shutter that moves as the flight does.

A point in row ρ of H is seen at t + T (ρ/H − 1/2), with the time t of the image, that of its middle row, and the
readout time T; the pose is that of the trajectory then. As with motions of images (``rolling_shutter``) the row is the
one in which shutter and moving point meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, Projection
from mor.geometry.frames import InFrame, by_rotation, into_frame
from mor.geometry.trajectory import Pose
from mor.observations._contract import Computed, ObservationType, Slot
from mor.observations.image import COMPONENTS, FRAME_SLOTS, MEASURED, POINT_SLOT, REFERENCES, WRITTEN
from mor.observations.time.rolling_shutter import MOVING, PHASE, READOUT_SLOT, meet
from mor.observations.time.trajectory import (
    ON_TRAJECTORY,
    by_knots,
    clock_constants,
    is_along,
    knot_slots,
    knots_of,
)
from mor.parameters.kinds import interior_key


@cache
def shutter_on_trajectory(model_key: str, knots: int) -> ObservationType:
    """x, y of a point in an image on a trajectory taken with a camera of this model and a rolling shutter.

    Slots: knots, height, eccentricity, readout time, interior orientation, point. Constants: those of a rolling
    shutter, then those of the clock at the middle row.
    """
    model, of_knots = CAMERA_MODELS[model_key], 1 + knots * knots

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        height, eccentricity, readout, interior, point = blocks[2 * knots :]
        path = knots_of(blocks, constants[:, -of_knots:], knots)
        measured, own = constants[:, :2], constants[:, 2 : -of_knots - len(PHASE)]
        clock = constants[:, -of_knots - len(PHASE) : -of_knots]

        def at(phase: FloatArray) -> tuple[tuple[Pose, InFrame], Projection, FloatArray]:
            pose = path.pose(path.time + readout[:, 0] * phase)
            frame = into_frame(pose.position, pose.rotation, height, point, eccentricity=eccentricity)
            projection = model.project(frame.star, interior, own, measured)
            by_time = np.cross(frame.lever, pose.rate) - np.einsum("nij,nj->ni", pose.rotation, pose.velocity)
            return (pose, frame), projection, by_time

        meeting = meet(at, measured, clock, readout)
        pose, frame = meeting.at
        by_star = meeting.projection.by_star
        by_position = -by_star @ pose.rotation
        jacobians = (
            *by_knots(pose, by_position, by_rotation(by_star, frame.lever)),
            by_position[:, :, 2:],
            by_star,
            (meeting.phase[:, None] * meeting.drift)[:, :, None],
            meeting.projection.by_interior,
            -by_position,
        )
        return Computed(meeting.values, tuple(meeting.changed(one) for one in jacobians))

    return ObservationType(
        key=f"{ON_TRAJECTORY} {knots} {MOVING}/{model.key}",
        written=WRITTEN,
        components=COMPONENTS,
        references=REFERENCES,
        slots=(
            *knot_slots(knots, "image"),
            *FRAME_SLOTS[2:],
            READOUT_SLOT,
            Slot(interior_key(model.key), "image", "interior"),
            POINT_SLOT,
        ),
        equation=equation,
        constants=(*MEASURED, *model.constants, *PHASE, *clock_constants(knots)),
    )


def is_read_out_along(type_: ObservationType) -> bool:
    """True for image coordinates of rolling shutters on trajectories."""
    return is_along(type_) and READOUT_SLOT in type_.slots
