"""Image points: frame cameras, rolling shutters and line scanners, and residuals on the sphere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from mor.model.cameras import CAMERA_MODELS, CameraModel, Projection
from mor.model.contract import Computed, Equation, ObservationGroup, ObservationType, Reference, Slot
from mor.model.motion import MovedPoints, TrajectoryPoses, by_time, moved, right_jacobian
from mor.model.parameters import interior_key
from mor.model.rotations import InFrame, by_point, by_rotation, follow, into_frame
from mor.model.trajectory import ON_TRAJECTORY, by_knots, clock_constants, is_along, knot_slots, knots_of
from mor.types import FloatArray
from mor.units import IMAGE, NUMBER, TIME, Component

# ---- Image coordinates of a central projection, of a single image and of a stereo follower (MOR 1.1).

FRAME_SLOTS = (
    Slot("point", "image", "position"),
    Slot("rotation", "image", "rotation"),
    Slot("height", "image", "height"),
    Slot("eccentricity", "image", "eccentricity"),
)
FOLLOWER_SLOTS = (Slot("rotation", "image", "relative rotation"), Slot("base", "image", "base"))


def _of_images(
    key: str, model: CameraModel, slots: tuple[Slot, ...], equation: Equation, constants: tuple[Component, ...] = ()
) -> ObservationType:
    """A type with ``slots`` before interior orientation and point, and ``constants`` behind those of the model."""
    return ObservationType(
        key=f"{key}/{model.key}",
        written="image",
        components=(Component("x", IMAGE), Component("y", IMAGE)),
        references=(Reference("image", ("image",)), Reference("point", ("point",))),
        slots=(*slots, Slot(interior_key(model.key), "image", "interior"), Slot("point", "point", "position")),
        equation=equation,
        constants=(Component("measured x", IMAGE), Component("measured y", IMAGE), *model.constants, *constants),
    )


def image_coordinates(model: CameraModel, pair: tuple[Slot, ...] = ()) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model (MOR eqs. 1, 2, 5).

    Slots: position, rotation, height, eccentricity, interior orientation, point. With the slots of a ``pair``, relative
    rotation and base before the interior orientation, the frame is that of a leading image (MOR eqs. 3, 4).
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, *relative, interior, point = blocks
        frame = into_frame(position, rotation, height, point, eccentricity=eccentricity)
        own = follow(frame.star, *relative) if relative else frame
        projection = model.project(own.star, interior, constants[:, 2:], constants[:, :2])
        by_star, by_pair = projection.by_star, list[FloatArray]()
        if relative:
            by_star = projection.by_star @ relative[0]
            by_pair = [by_rotation(projection.by_star, own.lever), -by_star]
        return Computed(
            projection.xy, (*_by_frame(by_star, frame), *by_pair, projection.by_interior, by_point(by_star, frame))
        )

    return _of_images("follower" if pair else "image", model, (*FRAME_SLOTS, *pair), equation)


def is_image_point(type_: ObservationType) -> bool:
    """True for image coordinates, of single images and of stereo followers, at infinity too."""
    return type_.written == "image"


def _by_frame(by_star: FloatArray, frame: InFrame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    by_position = -by_point(by_star, frame)
    return by_position, by_rotation(by_star, frame.lever), by_position[:, :, 2:], by_star


IMAGE_TYPES = {model.key: image_coordinates(model) for model in CAMERA_MODELS.values()}
FOLLOWER_TYPES = {model.key: image_coordinates(model, FOLLOWER_SLOTS) for model in CAMERA_MODELS.values()}


# ---- Image coordinates of an image that is read out row by row while the camera moves: a rolling shutter.
#
# Each image has one motion: a steady velocity v and a steady rate of rotation ω, both in its own axes. Its
# pose X0, D is that of the middle row; a point in row ρ of H is seen at the time
#
#     t = T · (ρ/H − 1/2)        and        X*(t) = exp(−[ω t]×) (D (X − X0) − v t) + r0*
#
# with the readout time T from the first row to the last. ρ is the row in which shutter and moving point meet,
# which is the row that is computed: it is found by Newton's method from the observed row, some hundredths of
# a row beside it. (With the observed row itself in its place the residuals come out too small, by the drift
# during the readout over the height of the image, and T with a bias.) Columns likewise, where the shutter
# runs across. At T = 0 this is the frame image, digit by digit.

READOUT_SLOT = Slot("readout", "image", "readout")
MOTION_SLOTS = (
    Slot("image velocity", "image", "image velocity"),
    Slot("rotation rate", "image", "rotation rate"),
    READOUT_SLOT,
)
PHASE = (Component("phase by x", NUMBER), Component("phase by y", NUMBER), Component("phase at 0", NUMBER))
"""Last constants of a row: what of the readout has passed at x, y, from −1/2 at its begin to 1/2."""


def moving_image_coordinates(model: CameraModel) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model and a rolling shutter.

    Slots: position, rotation, height, eccentricity, velocity, rotation rate, readout time, interior orientation, point.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, velocity, rate, readout, interior, point = blocks
        measured, own, clock = constants[:, :2], constants[:, 2:-3], constants[:, -3:]
        frame = into_frame(position, rotation, height, point)

        def at(phase: FloatArray) -> tuple[MovedPoints, Projection, FloatArray]:
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

    return _of_images(MOVING, model, (*FRAME_SLOTS, *MOTION_SLOTS), equation, PHASE)


At = TypeVar("At")
"""How things are at one time."""


class ShutterCrossings(NamedTuple, Generic[At]):
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
        """Return the further drift of the point: a change δ moves its row, and the time by T g·δ / slip; 0 at T = 0."""
        one = (1,) * (change.ndim - 2)
        passed = np.einsum("nj,nj...->n...", self.clock[:, :2], change)
        time = self.readout.reshape(-1, *one) * passed / self.slip.reshape(-1, *one)
        return np.asarray(self.drift.reshape(-1, 2, *one) * time[:, None])


def meet(
    at: Callable[[FloatArray], tuple[At, Projection, FloatArray]],
    measured: FloatArray,
    clock: FloatArray,
    readout: FloatArray,
) -> ShutterCrossings[At]:
    """Return the image points at which the shutter passes, by Newton's method from ``measured`` (n, 2).

    ``at`` says what there is when parts (n,) of the readout have passed: how things are, where the points are seen,
    and ∂X*/∂t (n, 3).
    """

    def seen(xy: FloatArray) -> ShutterCrossings[At]:
        phase = phases(xy, clock)
        found, projection, by_time = at(phase)
        drift = np.einsum("nij,nj->ni", projection.by_star, by_time)
        slip = 1.0 - readout[:, 0] * np.einsum("nj,nj->n", clock[:, :2], drift)
        return ShutterCrossings(phase, found, projection, drift, clock, readout, slip, xy)

    found = seen(measured)
    before = np.full(len(measured), np.inf)
    # Rounds after which a point whose step does not halve will never meet the shutter, and others do not wait for it.
    doubtful = 4
    for number in range(20):
        step = found.changed(found.projection.xy - found.xy)
        size = np.abs(step).max(axis=1, initial=0.0)
        nears = size < 0.5 * before if number >= doubtful else np.ones(len(size), dtype=bool)
        # Part of the image coordinates by which a point may still move when it has met the shutter.
        if not _largest(size[nears]) > 1e-13 * _largest(np.abs(found.xy)):
            break
        found, before = seen(found.xy + step), size
    return found


def _largest(sizes: FloatArray) -> float:
    return float(np.fmax.reduce(sizes, axis=None, initial=0.0))  # of what is known: NaN does not count


def phases(xy: FloatArray, clock: FloatArray) -> FloatArray:
    """(n,) part of the readout that has passed at image coordinates (n, 2), less 1/2; ``clock`` (n, 3)."""
    return np.asarray(clock[:, 0] * xy[:, 0] + clock[:, 1] * xy[:, 1] + clock[:, 2])


def read_out_at_once(group: ObservationGroup) -> ObservationGroup:
    """A group of such image coordinates as if the images had been frames; any other group as it is."""
    form, _, key = group.type.key.partition("/")
    if form != MOVING:
        return group
    frame = IMAGE_TYPES[key]
    blocks = tuple(numbers for slot, numbers in group.blocks_by_slot if slot in frame.slots)
    return replace(group, type=frame, blocks=blocks, constants=group.constants[:, : len(frame.constants)])


MOVING = "moving"
"""What the keys of these types begin with."""
MOVING_TYPES = {model.key: moving_image_coordinates(model) for model in CAMERA_MODELS.values()}


# ---- Image coordinates of a line scanner: one line across the flight at a time, one row of the image for each.
#
# The line lies at y = a in the axes of the camera (a = 0, or the offset of a forward or backward line). A
# point is seen at the time t at which it crosses the line,
#
#     y(X*(t)) = a        X*(t) = D(t) (X − X0(t)) + r0*
#
# found by Newton's method from the time of the observed row; the row of that time is what is computed, and
# beside it the coordinate x(X*(t)) along the line. So the residual along the flight is one of rows, as it was
# measured, and that across is taken in the line that the point crosses, not in the one it was observed in.
# The derivatives are those of the crossing: dt = −∂y/∂p dp / ẏ.

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

        def at(time: FloatArray) -> _TimedPoints:
            pose = path.pose(time)
            frame = into_frame(pose.position, pose.rotation, height, point, eccentricity=eccentricity)
            projection = model.project(frame.star, interior, own, measured)
            drift = np.cross(frame.lever, pose.rate) - np.einsum("nij,nj->ni", pose.rotation, pose.velocity)
            return _TimedPoints(pose, frame, projection, np.einsum("nij,nj->ni", projection.by_star, drift))

        time, seen = path.time, at(path.time)
        # Steps by which a point comes to its line, a few where it crosses it.
        for _ in range(10):
            step = (measured[:, 1] - seen.projection.xy[:, 1]) / seen.drift[:, 1]
            # Part of the time in which the camera scans its own camera constant by which a crossing may still move.
            if not _largest(np.abs(step)) > 1e-12 * _largest(np.abs(rate * interior[:, 0])):
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

    slots = (*knot_slots(knots, "image"), *FRAME_SLOTS[2:])
    return _of_images(f"{SCANNER} {knots}", model, slots, equation, (*ROW, *clock_constants(knots)))


class _TimedPoints(NamedTuple):
    """Points as they are seen at one time each."""

    pose: TrajectoryPoses
    frame: InFrame
    projection: Projection
    drift: FloatArray
    """(n, 2) velocity in the image."""


def _crossed(change: FloatArray, drift: FloatArray, rate: FloatArray) -> FloatArray:
    """Changes (n, 2, k) of x and of the row (in y) where those at a fixed time are ``change``: dt = −dy / ẏ."""
    time = -change[:, 1] / drift[:, 1, None]
    return np.stack([change[:, 0] + drift[:, 0, None] * time, time / rate[:, None]], axis=1)


# ---- Image coordinates that are read out row by row along a trajectory: a rolling shutter that moves as the flight
# does.
#
# A point in row ρ of H is seen at t + T (ρ/H − 1/2), with the time t of the image, that of its middle row,
# and the readout time T; the pose is that of the trajectory then. As with motions of images
# (``rolling_shutter``) the row is the one in which shutter and moving point meet.


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

        def at(phase: FloatArray) -> tuple[tuple[TrajectoryPoses, InFrame], Projection, FloatArray]:
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

    slots = (*knot_slots(knots, "image"), *FRAME_SLOTS[2:], READOUT_SLOT)
    key = f"{ON_TRAJECTORY} {knots} {MOVING}"
    return _of_images(key, model, slots, equation, (*PHASE, *clock_constants(knots)))


def is_read_out_along(type_: ObservationType) -> bool:
    """True for image coordinates of rolling shutters on trajectories."""
    return is_along(type_) and READOUT_SLOT in type_.slots


# ---- Image rays as directions: what a camera sees, as a theodolite in its place would have it.
#
# Coordinates x = −c X*/Z* run away where a point comes near the plane of the camera, and come back on the other side:
# from bad start values least squares climbs over that ridge, or comes to rest behind it. The direction d = X*/|X*| of
# the point is as smooth as it is bounded. Computed − observed is the arc θ from the measured ray u to d, in two axes
# across d,
#
#     y = −θ Eᵀ u / sin θ,   cos θ = u · d,
#
# the logarithmic map of the sphere. The axes E(d) come along with d, and the Jacobian is taken for Eᵀ ∂d:
# then Jᵀy is exactly the gradient of ½ θ², and JᵀJ is never less than its curvature, which is 1 along the arc
# and θ cot θ ≤ 1 across it (H. Karcher 1977). So a Gauss-Newton step does not overshoot on the sphere,
# however far off the ray is. The interior orientation is taken as it is.

_KEY = "on the sphere "


@cache
def on_the_sphere(type_: ObservationType) -> ObservationType | None:
    """Return the type with the same slots and directions instead of image coordinates.

    ``None`` of points that are at infinity, or move, and of images on a trajectory. What is read out row by row is
    taken for a frame.
    """
    form, _, key = type_.key.partition("/")
    if key not in CAMERA_MODELS or type_.still is not None or form not in ("image", "follower", MOVING):
        return None
    if form == MOVING:
        return on_the_sphere(IMAGE_TYPES[key])
    # Constants of a row: the measured ray u, of unit length.
    measured = tuple(Component(f"ray {c}", NUMBER) for c in "xyz")
    model = CAMERA_MODELS[key]._replace(project=_arcs, constants=measured)
    found = image_coordinates(model, FOLLOWER_SLOTS if form == "follower" else ())
    return found._replace(key=_KEY + type_.key)


def is_on_the_sphere(type_: ObservationType) -> bool:
    """True for types that :func:`on_the_sphere` has made."""
    return type_.key.startswith(_KEY)


def stereographic(rays: FloatArray) -> FloatArray:
    """Return (n, 2) coordinates of unit rays (n, 3), used instead of the measured ones: 0 along the camera axis."""
    return np.asarray(rays[:, :2] / np.maximum(1.0 - rays[:, 2:], 1e-300))


def image_scale(model: CameraModel, rays: FloatArray, interior: FloatArray, constants: FloatArray) -> FloatArray:
    """(n,) image units per radian at unit rays (n, 3), in the mean; ``constants`` as image rows have them."""
    projection = model.project(rays, interior, constants[:, 2:], constants[:, :2])
    across = np.swapaxes(_axes_across(rays), 1, 2)
    return np.asarray(np.sqrt(np.abs(np.linalg.det(projection.by_star @ across))))


def _arcs(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """The arcs (n, 2) from the measured rays, and their derivatives in axes that come along."""
    length = np.linalg.norm(star, axis=1)
    length[length == 0.0] = 1.0
    direction = star / length[:, None]
    axes = _axes_across(direction)
    across = np.einsum("nki,ni->nk", axes, constants)
    sine = np.linalg.norm(across, axis=1)
    arc = np.arctan2(sine, np.einsum("ni,ni->n", constants, direction))
    stretch = np.where(sine > 0.0, arc / np.where(sine > 0.0, sine, 1.0), 1.0)
    by_interior = np.zeros((len(star), 2, interior.shape[1]))
    return Projection(-stretch[:, None] * across, axes / length[:, None, None], by_interior)


def _axes_across(direction: FloatArray) -> FloatArray:
    """Two orthonormal axes (n, 2, 3) across unit vectors (n, 3), without a case (T. Duff et al. 2017)."""
    x, y, z = direction.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes = np.empty((len(direction), 2, 3))
    axes[:, 0] = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    axes[:, 1] = np.stack([b, sign + y * y * a, -y], axis=1)
    return axes
