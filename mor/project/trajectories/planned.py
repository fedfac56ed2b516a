"""Line scanners whose place is given beforehand: the row of each point, where none has been measured.

A point is scanned when it crosses the line of the camera, y(X*(t)) = a: the first time after the first line of the
image at which it does so ahead of the camera, as far as the stretch of the trajectory, or the table of the times of its
lines, goes. The crossing is bracketed between times a quarter of an interval of knots apart, and halved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import InputError, Problem
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.geometry.frames import into_frame
from mor.geometry.trajectory import Pose, pose_at
from mor.observations import ObservationGroup
from mor.observations.time.line_scanner import ROW, SCANNER
from mor.observations.time.trajectory import knot_count
from mor.project.network.build import Network
from mor.project.trajectories.images import TRAJECTORY
from mor.project.trajectories.model import Lines, Trajectory
from mor.project.trajectories.scanners import row_times

_PARTS = 4
"""Of an interval between knots, at whose ends it is asked on which side of the line a point lies."""
_HALVINGS = 40
"""Of such a part; what is left is far below the last digit of a time."""
_AT_A_TIME = 256
"""Points whose crossings are looked for together."""
_MOST_TOLD = 10


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
        trajectory, lines = _flown(network, name), network.lines[name]
        sight = _Sight(group, place, trajectory, mine)
        times[mine] = _crossings(sight, lines)
        rows = _rows_at(lines, times[mine])
        scale = network.scales[_camera(network, name)]
        y = (scale.centre[1] - rows) * scale.pixel
        timed, rate, _ = row_times(lines, rows)
        clock = trajectory.clock(np.nan_to_num(timed, nan=float(trajectory.times[0])))
        own = np.concatenate([y[:, None], -rate[:, None] / scale.pixel, clock.constants], axis=1)
        constants[mine, -own.shape[1] :] = own
        knots[:, mine] = trajectory.blocks(clock)
    _tell_lost(group, times)
    return replace(group, constants=constants, blocks=(*knots, *group.blocks[len(knots) :]))


def _flown(network: Network, image: str) -> Trajectory:
    number = network.things["image"].part(image, TRAJECTORY)
    return list(network.trajectories.values())[number]


def _camera(network: Network, image: str) -> str:
    return network.things["camera"].ids[network.things["image"].part(image, "camera")]


def _rows_at(lines: Lines, times: FloatArray) -> FloatArray:
    """Rows (n,) that are scanned at ``times``; of a steady rate before and behind the lines as well."""
    if lines.steady:
        step = np.diff(lines.times)[0] / np.diff(lines.rows)[0]
        return np.asarray(lines.rows[0] + (times - lines.times[0]) / step)
    return np.interp(times, lines.times, lines.rows)


class _Sight:
    """Where n points, rows ``mine`` of a group, lie beside the line of their camera."""

    def __init__(
        self, group: ObservationGroup, place: Mapping[str, FloatArray], trajectory: Trajectory, mine: IntArray
    ) -> None:
        order = knot_count(group.type)
        slots = list(zip(group.type.slots, group.blocks, strict=True))[2 * order :]
        self.height, self.eccentricity, self.interior, self.point = (
            place[slot.kind][blocks[mine]] for slot, blocks in slots
        )
        self.place, self.trajectory = place, trajectory
        self.constants = group.constants[mine, : -len(ROW) - 1 - order**2]
        self.model: CameraModel = CAMERA_MODELS[group.type.key.partition("/")[2]]

    def aside(self, pose: Pose, rows: IntArray) -> FloatArray:
        """(n,) y of points less that of the line, seen from a pose each; NaN behind the camera."""
        frame = into_frame(
            pose.position,
            pose.rotation,
            self.height[rows],
            self.point[rows],
            eccentricity=self.eccentricity[rows],
        )
        measured, own = self.constants[rows, :2], self.constants[rows, 2:]
        with np.errstate(all="ignore"):
            y = self.model.project(frame.star, self.interior[rows], own, measured).xy[:, 1]
        ahead = self.model.sees_behind | (frame.star[:, 2] < 0.0)
        return np.where(ahead, y - measured[:, 1], np.nan)

    def poses(self, times: FloatArray) -> Pose:
        """The poses at ``times`` (n,)."""
        clock, flown = self.trajectory.clock(times), self.trajectory
        weights = clock.constants[:, 1:].reshape(len(times), flown.order, flown.order)
        positions, rotations = flown.positions[clock.knots], flown.rotations[clock.knots]
        return pose_at(
            self.place["point"][positions],
            self.place["rotation"][rotations],
            weights,
            clock.constants[:, 0],
        )


def _crossings(sight: _Sight, lines: Lines) -> FloatArray:
    """Times (n,) at which points cross the line of their camera for the first time, NaN if they do not."""
    ends = _ends(sight.trajectory, lines)
    found = np.full(len(sight.point), np.nan)
    if len(ends) < 2:
        return found
    poses = sight.poses(ends)
    for first in range(0, len(found), _AT_A_TIME):
        rows = np.arange(first, min(first + _AT_A_TIME, len(found)))
        every = _repeated(poses, len(rows))
        side = sight.aside(every, np.repeat(rows, len(ends))).reshape(len(rows), len(ends))
        crosses = side[:, :-1] * side[:, 1:] <= 0.0  # false where either is NaN
        rows, at = rows[crosses.any(axis=1)], np.argmax(crosses, axis=1)[crosses.any(axis=1)]
        if len(rows):
            found[rows] = _halved(sight, rows, ends[at], ends[at + 1])
    return found


def _halved(sight: _Sight, rows: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
    before = np.sign(sight.aside(sight.poses(low), rows))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = np.sign(sight.aside(sight.poses(middle), rows)) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray(high)


def _repeated(pose: Pose, count: int) -> Pose:
    """The poses (k,) again and again, ``count`` times; of them what a sight needs."""
    position, rotation = np.tile(pose.position, (count, 1)), np.tile(pose.rotation, (count, 1, 1))
    return replace(pose, position=position, rotation=rotation)


def _ends(trajectory: Trajectory, lines: Lines) -> FloatArray:
    """Ascending times from the first line on, parts of intervals of knots apart, to the end of the stretch."""
    begin = float(lines.times[0])
    before = max(int(np.searchsorted(trajectory.times, begin, side="right")) - 1, 0)
    stretch = trajectory.times[trajectory.stretch == trajectory.stretch[before]]
    end = float(stretch[-1]) if lines.steady else min(float(stretch[-1]), float(lines.times[-1]))
    steps = np.arange(_PARTS * (len(stretch) - 1) + 1) / _PARTS
    times = np.interp(steps, np.arange(len(stretch)), stretch)
    return np.concatenate([[begin], times[(times > begin) & (times < end)], [end] if end > begin else []])


def _tell_lost(group: ObservationGroup, times: FloatArray) -> None:
    """Raise :class:`InputError` for rows without a time."""
    lost = np.flatnonzero(np.isnan(times))
    image, point = group.references
    words = "point {0!r} does not cross the line of image {1!r} where it is planned"
    told = [
        Problem(words.format(point[k], image[k]), group.file, int(group.lines[k]))
        for k in lost[:_MOST_TOLD].tolist()
    ]
    if told:
        raise InputError(told)
