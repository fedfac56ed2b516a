"""Approximate trajectories."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.errors import UndeterminedObject
from mor.model import rotations
from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import ObservationGroup
from mor.model.images import PHASE, ROW, SCANNER, is_image_point, is_read_out_along
from mor.model.motion import linear_weights, pose_at
from mor.model.rotations import cross_matrix, exponential, rotation_from_angles
from mor.model.trajectory import ATTITUDE, POSITION, Knots, is_along, knot_count, knots_of
from mor.project.network import Network
from mor.project.planned_network import with_image_poses
from mor.project.trajectories import between_rows
from mor.start.bundle import ideal_rays
from mor.start.intersection import nearest_point
from mor.types import BoolArray, FloatArray, IntArray

# ---- Trajectories nobody has observed, from rays to points that are known: as if the flight had been straight and
# steady.
#
#     X0(t) = X_m + V (t − t_m)        D(t) = D
#
# Where attitudes are known, X_m and V follow from linear equations: points lie on their rays. Where positions
# are known, D is the rotation that fits best to the directions of the points (Kabsch 1976). Where neither is,
# the camera is taken to look down: in plan the points are then at X_m + V t + s R(κ) (x, y), which is linear
# in X_m, V, s cos κ and s sin κ; D and V are improved from there, with attitudes near the level. The
# adjustment bends the flight to what it was.

_LEAST_SINGULAR = 1e-6
"""Part of the largest singular value, columns of one size, at which equations leave something open."""
_FITS = 0.1
"""Radians (rms) by which rays may pass their points."""


class TimedRays(NamedTuple):
    """n points that are known, as they are seen from a flight."""

    time: FloatArray
    """(n,)"""
    ray: FloatArray
    """(n, 3) unit, in the axes of the camera, scene at z < 0."""
    point: FloatArray
    """(n, 3)"""


class Flight(NamedTuple):
    """A straight and steady flight; what was known stays as it was."""

    middle: float
    place: FloatArray
    velocity: FloatArray
    rotation: FloatArray

    def positions(self, times: FloatArray) -> FloatArray:
        """X0 (n, 3) at times (n,)."""
        places: FloatArray = self.place + (times - self.middle)[:, None] * self.velocity
        return places


def positions_of(sights: TimedRays, rotations: FloatArray) -> Flight | None:
    """The flight whose attitudes (n, 3, 3) at the sights are known; ``None`` where these leave it open."""
    middle = float(sights.time.mean())
    across = cross_matrix(np.einsum("nji,nj->ni", rotations, sights.ray))
    since = (sights.time - middle)[:, None, None]
    design = np.concatenate([across, across * since], axis=2).reshape(-1, 6)
    nearby = sights.point - sights.point.mean(axis=0)
    found = _solved(design, np.einsum("nij,nj->ni", across, nearby).ravel())
    if found is None:
        return None
    return Flight(middle, found[:3] + sights.point.mean(axis=0), found[3:], rotations[0])


def attitude_of(sights: TimedRays, positions: FloatArray) -> FloatArray | None:
    """The one rotation (3, 3) of a flight whose positions (n, 3) at the sights are known; ``None`` where it is open."""
    away = sights.point - positions
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    u, size, vt = rotations.svd(sights.ray.T @ away)
    if not size[1] > _LEAST_SINGULAR * size[0]:
        return None
    D: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return D if _rms(sights.ray - away @ D.T) < _FITS else None


def level_flight(sights: TimedRays) -> Flight | None:
    """The flight of a camera that looks down, more or less; ``None`` where the points leave it open or do not fit."""
    start = _in_plan(sights)
    return None if start is None else _tilted(sights, start)


def _in_plan(sights: TimedRays) -> Flight | None:
    """A level flight; the height above each point is that above all of them, and what it lies higher or lower."""
    down = -sights.ray[:, 2]
    if len(down) < 3 or not (down > 0.0).all():
        return None
    middle, centre = float(sights.time.mean()), sights.point.mean(axis=0)
    one, since = np.ones(len(down)), sights.time - middle
    nothing, relative = np.zeros(len(down)), sights.point - centre
    right, height = relative[:, :2].T.ravel(), np.inf
    found = None
    for _ in range(3):
        x, y = sights.ray[:, :2].T / down * (1.0 - relative[:, 2] / height)
        east = np.stack([one, nothing, since, nothing, x, -y], axis=1)
        north = np.stack([nothing, one, nothing, since, y, x], axis=1)
        found = _solved(np.concatenate([east, north]), right)
        if found is None:
            return None
        height = float(np.hypot(*found[4:]))
    cosine, sine = found[4:] / height  # type: ignore[index]
    D = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    place = centre + np.array([*found[:2], height])  # type: ignore[index]
    return Flight(middle, place, np.array([*found[2:4], 0.0]), D)  # type: ignore[index]


def _tilted(sights: TimedRays, flight: Flight) -> Flight | None:
    """Gauss and Newton's method: the rays pass their points as near as may be, tilts and climb are near 0."""
    # σ in radians of a ray, for a flight sways, and of tilts; that of the climb is a part of the speed.
    sway, tilting = 0.01, 0.05
    level, climb = flight.rotation, 0.05 * max(float(np.linalg.norm(flight.velocity)), 1e-9)
    tilt, left = np.zeros(3), np.inf
    place, velocity = flight.place, flight.velocity
    for _ in range(8):
        D = exponential(-tilt[None])[0] @ level
        since = sights.time - flight.middle
        q = (sights.point - place - since[:, None] * velocity) @ D.T
        depth = -q[:, 2]
        if not (depth > 0.0).all():
            return None
        wrong = q[:, :2] / depth[:, None] + sights.ray[:, :2] / sights.ray[:, 2:]
        by_q = np.zeros((len(q), 2, 3))
        by_q[:, 0, 0] = by_q[:, 1, 1] = 1.0 / depth
        by_q[:, :, 2] = q[:, :2] / depth[:, None] ** 2
        by_place = -by_q @ D
        design = np.concatenate([by_place, by_place * since[:, None, None], by_q @ cross_matrix(q)], axis=2)
        known = np.zeros((3, 9))
        known[0, 6], known[1, 7], known[2, 5] = 1.0 / tilting, 1.0 / tilting, 1.0 / climb
        rows = np.concatenate([design.reshape(-1, 9) / sway, known])
        misses = np.concatenate([-wrong.ravel() / sway, -tilt[:2] / tilting, [-velocity[2] / climb]])
        step = _solved(rows, misses)
        if step is None:
            return None
        place, velocity, tilt = place + step[:3], velocity + step[3:6], tilt + step[6:]
        left = _rms(wrong)
    found = Flight(flight.middle, place, velocity, exponential(-tilt[None])[0] @ level)
    return found if left < _FITS else None


def _solved(design: FloatArray, right: FloatArray) -> FloatArray | None:
    """Least squares; ``None`` where something is left open."""
    size = np.linalg.norm(design, axis=0)
    if not (np.isfinite(design).all() and (size > 0.0).all()):
        return None
    values = rotations.singular_values(design / size)
    if len(design) < len(size) or not values[-1] > _LEAST_SINGULAR * values[0]:
        return None
    solution: FloatArray = rotations.lstsq(design / size, right, rcond=_LEAST_SINGULAR) / size
    return solution


def _rms(wrong: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(wrong * wrong, axis=1))))


# ---- Start values along trajectories: knots from satellites and inertial systems, then points from rays of known
# poses.
#
# Where nothing has observed the positions or the attitudes of a stretch, they are those of a straight flight
# that fits to the points known there (above): first the stretch with most of them, then with
# the points that it gives the others.
#
# What is on a trajectory has its pose from the knots; a point that has no coordinates is where its rays come
# nearest to each other. They need not meet within their σ: the knots start where a GNSS/INS says, some pixels
# beside the truth.


def along_trajectories(network: Network) -> Network:
    """The network with start values for knots, images on trajectories and points that these see."""
    if not network.trajectories:
        return network
    start = dict(network.start)
    _start_knots(network, start)
    seen = [
        _seen(network, group, start) for group in network.groups if is_along(group.type) and is_image_point(group.type)
    ]
    open_ = _stretches_without_poses(network, start)
    while True:
        start = with_image_poses(network, start)
        _intersect(seen, start)
        started = _start_next_stretch(open_, seen, start)
        if started is None:
            break
        del open_[started]
    return replace(network, start=start)


def without_trajectories(network: Network) -> Network:
    """The network without the observations of trajectories; what these tell of start values is there already."""
    if not network.trajectories:
        return network
    groups = tuple(group for group in network.groups if not is_along(group.type))
    return replace(network, groups=groups)


def seen_along_trajectories(
    network: Network, missing: tuple[UndeterminedObject, ...]
) -> tuple[UndeterminedObject, ...]:
    """Name what has no start value, and the rays to a point from trajectories whose start values are missing."""
    reason = "seen from trajectories without start values at that time"
    rows: Counter[str] = Counter()
    for group in network.groups:
        if is_along(group.type) and is_image_point(group.type):
            rows.update(group.references[-1])
    return tuple(
        one._replace(reason=reason, observations=rows[one.name])
        if one.kind == "point" and not one.observations and rows[one.name]
        else one
        for one in missing
    )


def _start_knots(network: Network, start: dict[str, FloatArray]) -> None:
    """Knots without values, between what satellites and inertial systems have observed; lever arms are left out."""
    kinds = (("point", POSITION, slice(0, 3)), ("rotation", ATTITUDE, slice(3, 6)))
    for name, trajectory in network.trajectories.items():
        for kind, written, part in kinds:
            blocks = trajectory.positions if kind == "point" else trajectory.rotations
            missing = ~np.isfinite(start[kind][blocks].reshape(len(blocks), -1)).all(axis=1)
            if not missing.any():
                continue
            times, values = _observed(network, name, written)
            if len(times) < 2:
                continue
            rows = np.full((len(times), 6), np.nan)
            rows[:, part] = values
            found = between_rows(times, rows, trajectory.times[missing])[:, part]
            array = start[kind].copy()
            array[blocks[missing]] = found if kind == "point" else rotation_from_angles(found)
            start[kind] = array


def _observed(network: Network, name: str, written: str) -> tuple[FloatArray, FloatArray]:
    """Ascending times, and completely observed positions or attitudes (n, 3) of a trajectory at them."""
    times, values = [np.zeros(0)], [np.zeros((0, 3))]
    trajectory = network.trajectories[name]
    for group in network.groups:
        if group.type.name != written:
            continue
        first = np.searchsorted(trajectory.positions, group.blocks[0])
        whole: BoolArray = np.asarray(group.mask.all(axis=1))
        mine = whole & np.isin(group.blocks[0], trajectory.positions)
        since = group.constants[:, 1]
        times.append(trajectory.times[first[mine]] + since[mine])
        values.append(group.observed[mine])
    found, once = np.unique(np.concatenate(times), return_index=True)
    return found, np.concatenate(values)[once]


class _Stretch(NamedTuple):
    """Knots of one stretch of a trajectory, some of which have no start values."""

    times: FloatArray
    """(k,)"""
    positions: IntArray
    """(k,) point blocks."""
    rotations: IntArray
    """(k,) rotation blocks."""


class _SeenAlong(NamedTuple):
    """Completely measured image coordinates (n,) of images on trajectories."""

    group: ObservationGroup
    rows: IntArray
    """(n,) of the group."""
    first: IntArray
    """(n,) point block of the knot before."""
    time: FloatArray
    """(n,)"""
    ray: FloatArray
    """(n, 3) in the axes of the camera."""
    point: IntArray
    """(n,) point block."""


def _seen(network: Network, group: ObservationGroup, start: Mapping[str, FloatArray]) -> _SeenAlong:
    rows = np.flatnonzero(group.mask.all(axis=1))
    clock = _clock(group)
    scans = group.type.key.startswith(SCANNER)
    measured = (group.constants[:, :2] if scans else group.observed)[rows]
    of_time = len(ROW) if scans else len(PHASE) if is_read_out_along(group.type) else 0
    own = group.constants[rows, 2 : -clock - of_time]
    model = CAMERA_MODELS[group.type.key.partition("/")[2]]
    interior = start[group.type.slots[-2].kind]
    times = np.full(len(start["point"]), np.nan)
    for trajectory in network.trajectories.values():
        times[trajectory.positions] = trajectory.times
    first = group.blocks[0][rows].astype(np.int64)
    time = times[first] + group.constants[rows, -clock]
    ray = ideal_rays(model, interior, group.blocks[-2][rows], own, measured)
    return _SeenAlong(group, rows, first, time, ray, group.blocks[-1][rows].astype(np.int64))


def _clock(group: ObservationGroup) -> int:
    return 1 + knot_count(group.type) ** 2


def _stretches_without_poses(network: Network, start: Mapping[str, FloatArray]) -> list[_Stretch]:
    found = []
    for trajectory in network.trajectories.values():
        for number in np.unique(trajectory.stretch).tolist():
            here = trajectory.stretch == number
            one = _Stretch(trajectory.times[here], trajectory.positions[here], trajectory.rotations[here])
            if not (_known(start["point"][one.positions]) and _known(start["rotation"][one.rotations])):
                found.append(one)
    return found


def _known(values: FloatArray) -> bool:
    return bool(np.isfinite(values).all())


def _start_next_stretch(open_: list[_Stretch], seen: list[_SeenAlong], start: dict[str, FloatArray]) -> int | None:
    """Start the knots of the stretch that has most rays to known points, and can be started; return its number."""
    sights = [_sights_of(one, seen, start) for one in open_]
    for place in sorted(range(len(open_)), key=lambda k: -len(sights[k].time)):
        stretch, own = open_[place], sights[place]
        found = _straight(stretch, own, start) if len(own.time) else None
        if found is None:
            continue
        for kind, blocks, values in zip(
            ("point", "rotation"), (stretch.positions, stretch.rotations), found, strict=True
        ):
            array = start[kind].copy()
            given = np.isfinite(array[blocks]).all(axis=tuple(range(1, array.ndim)))
            array[blocks[~given]] = values[~given]
            start[kind] = array
        return place
    return None


def _sights_of(stretch: _Stretch, seen: list[_SeenAlong], start: Mapping[str, FloatArray]) -> TimedRays:
    parts = [TimedRays(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))]
    for own in seen:
        points = start["point"][own.point]
        mine = np.isin(own.first, stretch.positions) & np.isfinite(points).all(axis=1)
        parts.append(TimedRays(own.time[mine], own.ray[mine], points[mine]))
    return TimedRays(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _straight(
    stretch: _Stretch, sights: TimedRays, start: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray] | None:
    """Positions (k, 3) and rotations (k, 3, 3) of the knots of a straight flight."""
    positions, rotations = start["point"][stretch.positions], start["rotation"][stretch.rotations]
    before = np.clip(np.searchsorted(stretch.times, sights.time, side="right") - 1, 0, len(positions) - 2)
    interval = stretch.times[before + 1] - stretch.times[before]
    two, since = before[:, None] + np.arange(2), sights.time - stretch.times[before]
    if _known(positions):
        unit = np.broadcast_to(np.eye(3), (len(two), 2, 3, 3))
        at = pose_at(positions[two], unit, linear_weights(interval), since).position
        D = attitude_of(sights, at)
        return None if D is None else (positions, np.broadcast_to(D, rotations.shape))
    if _known(rotations):
        at = pose_at(np.zeros((len(two), 2, 3)), rotations[two], linear_weights(interval), since).rotation
        flight = positions_of(sights, at)
        return None if flight is None else (flight.positions(stretch.times), rotations)
    flight = level_flight(sights)
    if flight is None:
        return None
    return flight.positions(stretch.times), np.broadcast_to(flight.rotation, rotations.shape)


def _intersect(seen: list[_SeenAlong], start: dict[str, FloatArray]) -> None:
    """Points without coordinates, from the rays of images on trajectories whose poses are known."""
    missing: BoolArray = np.asarray(~np.isfinite(start["point"]).all(axis=1))
    pieces = [_rays(own, start) for own in seen]
    if not pieces or not missing.any():
        return
    point, centre, ray = (np.concatenate(part) for part in zip(*pieces, strict=True))
    wanted = missing[point] & np.isfinite(centre).all(axis=1) & np.isfinite(ray).all(axis=1)
    point, centre, ray = point[wanted], centre[wanted], ray[wanted]
    order = np.argsort(point, kind="stable")
    cuts = np.flatnonzero(np.diff(point[order])) + 1
    places = start["point"].copy()
    for rows in np.split(order, cuts) if len(order) else ():
        found = _met(centre[rows], ray[rows])
        if found is not None:
            places[point[rows[0]]] = found
    start["point"] = places


def _met(centres: FloatArray, rays: FloatArray) -> FloatArray | None:
    """Return the nearest point of rays (n, 3); ``None`` if they are parallel or meet behind a camera."""
    # Radians between two rays of a point, from which on it starts at their intersection.
    if len(rays) < 2 or np.linalg.norm(np.cross(rays[0], rays), axis=1).max() < 1e-3:
        return None
    point = nearest_point(centres, rays)
    ahead = np.einsum("nj,nj->n", point - centres, rays) > 0.0
    return point if ahead.all() and np.isfinite(point).all() else None


def _rays(seen: _SeenAlong, start: Mapping[str, FloatArray]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Point block, projection centre and direction of every row, in object axes."""
    group, rows = seen.group, seen.rows
    pairs = zip(group.type.slots, group.blocks, strict=True)
    blocks = [start[slot.kind][numbers[rows]] for slot, numbers in pairs]
    clock = _clock(group)
    knots = int(np.sqrt(clock - 1))
    path: Knots = knots_of(blocks, group.constants[rows, -clock:], knots)
    height, eccentricity = blocks[2 * knots : 2 * knots + 2]
    with np.errstate(invalid="ignore"):
        pose = path.pose(path.time)
    centre = pose.position + np.pad(height, ((0, 0), (2, 0)))
    centre -= np.einsum("nji,nj->ni", pose.rotation, eccentricity)
    return seen.point, centre, np.einsum("nji,nj->ni", pose.rotation, seen.ray)


# ---- Points that move, as start values take them: where they are once, for they have not moved far.


def standing_still(network: Network) -> Network:
    """The network with one place for every point, whatever the time; movements are left to the adjustment."""
    if not network.motion.points:
        return network
    stays = _stays(network)
    later = np.array(sorted(network.motion.stands_for), dtype=np.int64)
    start = network.start["point"].copy()
    start[later] = np.nan_to_num(start[later])
    points = network.blocks["point"]
    free = points.free.copy()
    free[later] = False
    blocks = {**network.blocks, "point": points._replace(free=free)}
    groups = tuple(_still(group, stays) for group in network.groups)
    return replace(network, groups=groups, blocks=blocks, start={**network.start, "point": start})


def at_all_times(network: Network, start: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Start values with those of a point at every time of which nothing is known."""
    if not network.motion.stands_for:
        return dict(start)
    points = start["point"].copy()
    later = np.array(sorted(network.motion.stands_for), dtype=np.int64)
    points[later] = network.start["point"][later]
    own = points[_stays(network)[later]]
    points[later] = np.where(np.isnan(points[later]), own, points[later])
    return {**start, "point": points}


def _stays(network: Network) -> IntArray:
    stays = np.arange(len(network.blocks["point"].ids))
    for later, block in network.motion.stands_for.items():
        stays[later] = block
    return stays


def _still(group: ObservationGroup, stays: IntArray) -> ObservationGroup:
    plain = group.type.still or group.type
    constants, blocks = group.constants[:, : len(plain.constants)], group.blocks[: len(plain.slots)]
    placed = tuple(
        stays[numbers] if slot.kind == "point" else numbers for slot, numbers in zip(plain.slots, blocks, strict=True)
    )
    return replace(group, type=plain, blocks=placed, constants=constants)
