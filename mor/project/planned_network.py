"""Planned observations on trajectories and on the Earth, for networks that are built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from mor.errors import InputError, Message
from mor.model.cameras import CAMERA_MODELS, CameraModel
from mor.model.contract import ObservationGroup
from mor.model.geodetic import Attitude, InPlane
from mor.model.images import PHASE, READOUT_SLOT, ROW, SCANNER, is_read_out_along, phases
from mor.model.motion import TrajectoryPoses, pose_at
from mor.model.rotations import into_frame
from mor.model.trajectory import knot_count
from mor.project.earth import MEANT, PlaneError, needs_convergence, needs_place, plane_of
from mor.project.entities import Entities, RowTimes, Trajectory
from mor.project.network import Network
from mor.project.reference_system import EarthModel, reference_system
from mor.project.trajectories import TRAJECTORY, row_times
from mor.types import FloatArray, IntArray

# ---- Line scanners whose place is given beforehand: the row of each point, where none has been measured.
#
# A point is scanned when it crosses the line of the camera, y(X*(t)) = a: the first time after the first line
# of the image at which it does so ahead of the camera, as far as the stretch of the trajectory, or the table
# of the times of its lines, goes. The crossing is bracketed between times a quarter of an interval of knots
# apart, and halved.


def is_scanned(group: ObservationGroup) -> bool:
    """True for image coordinates of a line scanner."""
    return group.type.key.startswith(SCANNER)


def rescanned(network: Network, group: ObservationGroup, place: Mapping[str, FloatArray]) -> ObservationGroup:
    """Image coordinates of a line scanner with the rows in which their points are scanned at a place.

    Raises :class:`InputError` for points that do not cross the line of their image.
    """
    image = group.references[0]
    times = np.full(group.count, np.nan)
    knots, constants = np.array(group.blocks[: 2 * knot_count(group.type)]), group.constants.copy()
    for number in np.unique(image.numbers).tolist():
        mine = np.flatnonzero(image.numbers == number)
        name = image.known[number]
        flown = network.things["image"].part(name, TRAJECTORY)
        trajectory, lines = list(network.trajectories.values())[flown], network.lines[name]
        sight = _Sight(group, place, trajectory, mine)
        times[mine] = _crossings(sight, lines)
        rows = _rows_at(lines, times[mine])
        scale = network.scales[network.things["camera"].ids[network.things["image"].part(name, "camera")]]
        y = (scale.centre[1] - rows) * scale.pixel
        timed, rate, _ = row_times(lines, rows)
        clock = trajectory.clock(np.nan_to_num(timed, nan=float(trajectory.times[0])))
        own = np.concatenate([y[:, None], -rate[:, None] / scale.pixel, clock.constants], axis=1)
        constants[mine, -own.shape[1] :] = own
        knots[:, mine] = trajectory.blocks(clock)
    _tell_lost(group, times)
    return replace(group, constants=constants, blocks=(*knots, *group.blocks[len(knots) :]))


def _rows_at(lines: RowTimes, times: FloatArray) -> FloatArray:
    """Rows (n,) that are scanned at ``times``; of a steady rate before and behind the lines as well."""
    if lines.steady:
        step = np.diff(lines.times)[0] / np.diff(lines.rows)[0]
        return np.asarray(lines.rows[0] + (times - lines.times[0]) / step)
    return np.interp(times, lines.times, lines.rows)


class _Sight:
    """Places of n points, rows ``mine`` of a group, beside the line of their camera."""

    def __init__(
        self, group: ObservationGroup, place: Mapping[str, FloatArray], trajectory: Trajectory, mine: IntArray
    ) -> None:
        order = knot_count(group.type)
        slots = list(group.blocks_by_slot)[2 * order :]
        self.height, self.eccentricity, self.interior, self.point = (
            place[slot.kind][blocks[mine]] for slot, blocks in slots
        )
        self.place, self.trajectory = place, trajectory
        self.constants = group.constants[mine, : -len(ROW) - 1 - order**2]
        self.model: CameraModel = CAMERA_MODELS[group.type.key.partition("/")[2]]

    def aside(self, pose: TrajectoryPoses, rows: IntArray) -> FloatArray:
        """(n,) y of points less that of the line, seen from a pose each; NaN behind the camera."""
        frame = into_frame(
            pose.position, pose.rotation, self.height[rows], self.point[rows], eccentricity=self.eccentricity[rows]
        )
        measured, own = self.constants[rows, :2], self.constants[rows, 2:]
        with np.errstate(all="ignore"):
            y = self.model.project(frame.star, self.interior[rows], own, measured).xy[:, 1]
        ahead = self.model.sees_behind | (frame.star[:, 2] < 0.0)
        return np.where(ahead, y - measured[:, 1], np.nan)

    def poses(self, times: FloatArray) -> TrajectoryPoses:
        clock, flown = self.trajectory.clock(times), self.trajectory
        weights = clock.constants[:, 1:].reshape(len(times), flown.order, flown.order)
        positions, rotations = flown.positions[clock.knots], flown.rotations[clock.knots]
        return pose_at(
            self.place["point"][positions], self.place["rotation"][rotations], weights, clock.constants[:, 0]
        )


def _crossings(sight: _Sight, lines: RowTimes) -> FloatArray:
    """First times (n,) at which points cross the line of their camera; NaN if they do not."""
    trajectory = sight.trajectory
    begin = float(lines.times[0])
    before = max(int(np.searchsorted(trajectory.times, begin, side="right")) - 1, 0)
    stretch = trajectory.times[trajectory.stretch == trajectory.stretch[before]]
    end = float(stretch[-1]) if lines.steady else min(float(stretch[-1]), float(lines.times[-1]))
    # Parts of an interval between knots at whose ends the side of the line is tested on which a point lies.
    parts = 4
    steps = np.arange(parts * (len(stretch) - 1) + 1) / parts
    times = np.interp(steps, np.arange(len(stretch)), stretch)
    ends = np.concatenate([[begin], times[(times > begin) & (times < end)], [end] if end > begin else []])
    found = np.full(len(sight.point), np.nan)
    if len(ends) < 2:
        return found
    poses = sight.poses(ends)
    # Points whose crossings are looked for together.
    at_a_time = 256
    for first in range(0, len(found), at_a_time):
        rows = np.arange(first, min(first + at_a_time, len(found)))
        # The poses (k,) again and again, ``count`` times; of them what a sight needs.
        count = len(rows)
        position, rotation = np.tile(poses.position, (count, 1)), np.tile(poses.rotation, (count, 1, 1))
        every = replace(poses, position=position, rotation=rotation)
        side = sight.aside(every, np.repeat(rows, len(ends))).reshape(len(rows), len(ends))
        crosses = side[:, :-1] * side[:, 1:] <= 0.0  # false where either is NaN
        rows, at = rows[crosses.any(axis=1)], np.argmax(crosses, axis=1)[crosses.any(axis=1)]
        if len(rows):
            found[rows] = _halved(sight, rows, ends[at], ends[at + 1])
    return found


def _halved(sight: _Sight, rows: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
    before = np.sign(sight.aside(sight.poses(low), rows))
    # Of such a part; what is left is far below the last digit of a time.
    for _ in range(40):
        middle = 0.5 * (low + high)
        same = np.sign(sight.aside(sight.poses(middle), rows)) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray(high)


def _tell_lost(group: ObservationGroup, times: FloatArray) -> None:
    """Raise :class:`InputError` for rows without a time."""
    lost = np.flatnonzero(np.isnan(times))
    image, point = group.references
    words = "point {0!r} does not cross the line of image {1!r} where it is planned"
    told = [group.message(k, words.format(point[k], image[k])) for k in lost[:10].tolist()]
    if told:
        raise InputError(told)


# ---- Poses of images on a trajectory, from the knots.


class ImagePoses(NamedTuple):
    """Poses of n images on trajectories that have k knots for each."""

    images: IntArray
    """(n,)"""
    positions: IntArray
    """(n, k) point blocks of the knots."""
    rotations: IntArray
    """(n, k) rotation blocks of the knots."""
    pose: TrajectoryPoses


class Flights(Protocol):
    """Trajectory and time of each image, of a network or of a project that is being read."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Trajectories by name."""

    @property
    def image_times(self) -> Mapping[str, float]:
        """Time of each image by name."""


def image_poses(network: Network, values: Mapping[str, FloatArray]) -> list[ImagePoses]:
    """Poses of the images on trajectories at values of the knots, by trajectory; of no images nothing."""
    return poses_of(network.things["image"], network, values)


def poses_of(images: Entities, flights: Flights, values: Mapping[str, FloatArray]) -> list[ImagePoses]:
    """Poses of the ``images`` that are on trajectories at values of the knots, by trajectory."""
    found = []
    for number, trajectory in enumerate(flights.trajectories.values()):
        mine = np.flatnonzero(images.parts[TRAJECTORY] == number)
        if not len(mine):
            continue
        clock = trajectory.clock(np.array([flights.image_times[images.ids[i]] for i in mine]))
        positions, rotations = trajectory.positions[clock.knots], trajectory.rotations[clock.knots]
        weights = clock.constants[:, 1:].reshape(len(mine), trajectory.order, trajectory.order)
        pose = pose_at(values["point"][positions], values["rotation"][rotations], weights, clock.constants[:, 0])
        found.append(ImagePoses(mine, positions, rotations, pose))
    return found


def with_image_poses(network: Network, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Values in which the images on trajectories have the poses of their times."""
    return with_poses_of(network.things["image"], network, values)


def with_poses_of(images: Entities, flights: Flights, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Values in which the ``images`` on trajectories have the poses of their times."""
    result, parts = dict(values), images.parts
    for found in poses_of(images, flights, values):
        for kind, part, own in (
            ("point", "position", found.pose.position),
            ("rotation", "rotation", found.pose.rotation),
        ):
            if result[kind] is values[kind]:
                result[kind] = values[kind].copy()
            result[kind][parts[part][found.images]] = own
    return result


# ---- Rolling shutters on trajectories: which knots a row depends on follows from its time, by the readout time.


def read_out_at(network: Network, group: ObservationGroup, place: Mapping[str, FloatArray]) -> ObservationGroup:
    """The group with the knots about the times of its measured rows, by the readout time at a place.

    Any group but image coordinates of rolling shutters on trajectories, and one that has them already, comes back as it
    is.
    """
    if not is_read_out_along(group.type):
        return group
    image, slots = group.references[0], group.type.slots
    count = 2 * knot_count(group.type)
    knots, constants = np.array(group.blocks[:count]), group.constants.copy()
    clock_at = [constant.name for constant in group.type.constants].index("time since knot")
    readout = place[READOUT_SLOT.kind][group.blocks[slots.index(READOUT_SLOT)], 0]
    later = readout * phases(constants[:, :2], constants[:, clock_at - len(PHASE) : clock_at])
    times = np.array([network.image_times.get(name, np.nan) for name in image.known])
    flown = np.array([network.things["image"].numbers[name] for name in image.known])
    flown = network.things["image"].parts[TRAJECTORY][flown]
    for number, trajectory in enumerate(network.trajectories.values()):
        mine = np.flatnonzero(flown[image.numbers] == number)
        clock = trajectory.clock(times[image.numbers[mine]], later[mine])
        width = clock.constants.shape[1]
        if len(mine):
            constants[mine, clock_at : clock_at + width] = clock.constants
            knots[:, mine] = trajectory.blocks(clock)
    if all(np.array_equal(*pair) for pair in zip(knots, group.blocks[:count], strict=True)):
        return group
    return replace(group, constants=constants, blocks=(*knots, *group.blocks[count:]))


# ---- Projections over all places of a network, where some are found beyond what was known of them when it was read.


def with_planes_over(network: Network, places: Mapping[str, FloatArray]) -> Network:
    """The network with projections over all of its places, where some lie beyond what was known of them before.

    Raises :class:`InputError`.
    """
    world = network.world
    if world is None:
        return network
    try:
        of_all = {
            name: tuple(_over(world, group, places["point"]) for group in getattr(network, name))
            for name in ("groups", "checks", "candidates")
        }
    except PlaneError as error:
        raise InputError([Message(f"projection: {error}", network.file)]) from None
    return replace(network, **of_all)  # type: ignore[arg-type]


def _over(world: EarthModel, group: ObservationGroup, points: FloatArray) -> ObservationGroup:
    equation = group.type.equation
    if not isinstance(equation, InPlane | Attitude) or equation.plane is None:
        return group
    plane = equation.plane
    ends = [points[blocks] for slot, blocks in group.blocks_by_slot if slot.kind == "point"]
    there = np.concatenate(ends)
    feet = world.horizon.foot(there[np.isfinite(there).all(axis=1)]).position[:, :2]
    if plane.holds(feet).all():
        return group
    both = np.concatenate([world.extent, feet])
    system = world.system if plane.crs is None else reference_system(plane.crs)
    wider = plane_of(system, world, plane.crs, np.stack([both.min(axis=0), both.max(axis=0)]))
    return replace(group, type=group.type._replace(equation=replace(equation, plane=wider)))


# ---- Networks on the earth whose place is given beforehand: what their observations must know, and simulated control.


def known_at_place(network: Network, place: Mapping[str, FloatArray]) -> Network:
    """The network with projections linearised at the place, where nothing may have been observed yet.

    Raises :class:`InputError` if a height above the geoid is meant, and nothing says where that is.
    """
    world = network.world
    if world is None:
        return network
    of_all = {
        name: tuple(_known(network, world, group, place["point"]) for group in getattr(network, name))
        for name in ("groups", "checks", "candidates")
    }
    return with_planes_over(replace(network, **of_all), place)  # type: ignore[arg-type]


def _known(network: Network, world: EarthModel, group: ObservationGroup, points: FloatArray) -> ObservationGroup:
    if needs_convergence(group.type):
        there = world.from_object(points[group.blocks[0]], np.zeros(group.count))
        return replace(group, constants=world.convergence(there[:, :2])[:, None])
    if not needs_place(group.type):
        return group
    position = points[group.blocks[0]]
    N = np.zeros(group.count)
    if world.orthometric:
        before = group.constants
        N = world.horizon.foot(before[:, :3]).height - before[:, 9]  # as it was given, or of the grid
        N = np.where(np.isfinite(before).all(axis=1), N, world.geoid_at(group.blocks[0], position))
        lost = np.isnan(N)
        if lost.any():
            row = int(np.argmax(lost))
            name = group.references[0][row]
            raise InputError([Message(f"{name!r}: {MEANT}", group.file or network.file, group.line(row))])
    said = world.from_object(position, N)
    return replace(group, constants=np.concatenate([position, world.grid(position).reshape(-1, 4), said], axis=1))


def with_control_moved(network: Network) -> Network:
    """The network with what was observed of control points in the coordinates they are given with.

    A shift that is observed beside the given place, in east, north, up, is the same as that place shifted by it.
    """
    world = network.world
    if world is None:
        return network
    groups = tuple(_moved(group, world) if group.type.key == "control" else group for group in network.groups)
    return replace(network, groups=groups)


def _moved(group: ObservationGroup, world: EarthModel) -> ObservationGroup:
    axes = world.horizon.local_axes(group.constants)
    shift = np.einsum("nij,ni->nj", axes, np.nan_to_num(group.observed))
    return replace(group, constants=group.constants + shift, observed=np.where(group.mask, 0.0, np.nan))
