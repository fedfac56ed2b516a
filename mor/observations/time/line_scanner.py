"""Image coordinates of a line scanner: one line across the flight at a time, one row of the image for each.

The line lies at y = a in the axes of the camera (a = 0, or the offset of a forward or backward line). A point is seen
at the time t at which it crosses the line,

    y(X*(t)) = a        X*(t) = D(t) (X − X0(t)) + r0*

found by Newton's method from the time of the observed row; the row of that time is what is computed, and beside it the
coordinate x(X*(t)) along the line. So the residual along the flight is one of rows, as it was measured, and that across
is taken in the line that the point crosses, not in the one it was observed in. The derivatives are those of the
crossing: dt = −∂y/∂p dp / ẏ.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, Projection
from mor.geometry.frames import InFrame, by_rotation, into_frame
from mor.geometry.trajectory import Pose
from mor.observations._contract import Computed, ObservationType, Slot
from mor.observations.image import COMPONENTS, FRAME_SLOTS, MEASURED, POINT_SLOT, REFERENCES, WRITTEN
from mor.observations.time.trajectory import by_knots, clock_constants, knot_slots, knots_of
from mor.parameters.kinds import interior_key
from mor.units import IMAGE, TIME, Component

ROW = (Component("measured y of the row", IMAGE), Component("seconds by y", TIME))
"""Constants of a row before those of its clock: where it was observed, and how the time of a row depends on y."""
SCANNER = "line scanner"


@cache
def line_scanner(model_key: str, knots: int) -> ObservationType:
    """x (across) and y (row) of a point in an image of a line scanner with a camera of this model.

    Slots: knots, height, eccentricity, interior orientation, point. Constants: measured x, the y of the line, those of
    the model, the observed row and its rate, the clock at the observed row.
    """
    model, clock = CAMERA_MODELS[model_key], 1 + knots * knots

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        height, eccentricity, interior, point = blocks[2 * knots :]
        path = knots_of(blocks, constants[:, -clock:], knots)
        measured, own = constants[:, :2], constants[:, 2 : -clock - len(ROW)]
        row, rate = constants[:, -clock - 2], constants[:, -clock - 1]

        def at(time: FloatArray) -> _Seen:
            pose = path.pose(time)
            frame = into_frame(pose.position, pose.rotation, height, point, eccentricity=eccentricity)
            projection = model.project(frame.star, interior, own, measured)
            drift = np.cross(frame.lever, pose.rate) - np.einsum("nij,nj->ni", pose.rotation, pose.velocity)
            return _Seen(pose, frame, projection, np.einsum("nij,nj->ni", projection.by_star, drift))

        time, seen = path.time, at(path.time)
        for _ in range(_ROUNDS):
            step = (measured[:, 1] - seen.projection.xy[:, 1]) / seen.drift[:, 1]
            if not np.abs(step).max(initial=0.0) > _STILL * np.abs(rate * interior[:, 0]).max(initial=0.0):
                break
            time = time + step
            seen = at(time)
        by_star = seen.projection.by_star
        by_position = -by_star @ seen.pose.rotation
        fixed_time = (
            *by_knots(seen.pose, by_position, by_rotation(by_star, seen.frame.lever)),
            by_position[:, :, 2:],
            by_star,
            seen.projection.by_interior,
            -by_position,
        )
        # what the last Newton step would still change is taken along to first order
        left = seen.projection.xy - measured[:, :2]
        across = _crossed(left[:, :, None], seen.drift, rate)[:, :, 0]
        passed = (time - path.time) / rate
        values = np.stack([measured[:, 0] + across[:, 0], row + passed + across[:, 1]], axis=1)
        crossed = _crossed(np.concatenate(fixed_time, axis=2), seen.drift, rate)
        ends = np.cumsum([one.shape[2] for one in fixed_time])
        return Computed(values, tuple(np.split(crossed, ends[:-1], axis=2)))

    return ObservationType(
        key=f"{SCANNER} {knots}/{model.key}",
        written=WRITTEN,
        components=COMPONENTS,
        references=REFERENCES,
        slots=(
            *knot_slots(knots, "image"),
            *FRAME_SLOTS[2:],
            Slot(interior_key(model.key), "image", "interior"),
            POINT_SLOT,
        ),
        equation=equation,
        constants=(*MEASURED, *model.constants, *ROW, *clock_constants(knots)),
    )


class _Seen(NamedTuple):
    """Points as they are seen at one time each."""

    pose: Pose
    frame: InFrame
    projection: Projection
    drift: FloatArray
    """(n, 2) velocity in the image."""


def _crossed(change: FloatArray, drift: FloatArray, rate: FloatArray) -> FloatArray:
    """Changes (n, 2, k) of x and of the row (in y) where those at a fixed time are ``change``: dt = −dy / ẏ."""
    time = -change[:, 1] / drift[:, 1, None]
    return np.stack([change[:, 0] + drift[:, 0, None] * time, time / rate[:, None]], axis=1)


_ROUNDS = 10
"""Steps by which a point comes to its line, a few where it crosses it."""
_STILL = 1e-12
"""Part of the time in which the camera scans its own camera constant by which a crossing may still move."""
