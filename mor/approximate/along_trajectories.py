"""Start values along trajectories: knots from satellites and inertial systems, then points from rays of known poses.

What is on a trajectory has its pose from the knots; a point that has no coordinates is where its rays come nearest to
each other. They need not meet within their σ: the knots start where a GNSS/INS says, some pixels beside the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.approximate.intersection import nearest_point
from mor.approximate.undistort import ideal_rays
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.geometry.rotations import rotation_from_angles
from mor.observations import ObservationGroup, is_image_point
from mor.observations.time.line_scanner import ROW, SCANNER
from mor.observations.time.navigation import ATTITUDE, POSITION
from mor.observations.time.trajectory import Knots, is_along, knots_of
from mor.project.network.build import Network
from mor.project.trajectories.knots import between_rows
from mor.project.trajectories.poses import with_image_poses

_LEAST_ANGLE = 1e-3
"""Radians between two rays of a point, from which on it starts at their intersection."""


def along_trajectories(network: Network) -> Network:
    """The network with start values for knots, images on trajectories and points that these see."""
    if not network.trajectories:
        return network
    start = dict(network.start)
    _start_knots(network, start)
    start = with_image_poses(network, start)
    _intersect(network, start)
    return replace(network, start=start)


def without_trajectories(network: Network) -> Network:
    """The network without the observations of trajectories; what these tell of start values is there already."""
    if not network.trajectories:
        return network
    groups = tuple(group for group in network.groups if not is_along(group.type))
    return replace(network, groups=groups)


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


def _intersect(network: Network, start: dict[str, FloatArray]) -> None:
    """Points without coordinates, from the rays of images on trajectories whose poses are known."""
    missing: BoolArray = np.asarray(~np.isfinite(start["point"]).all(axis=1))
    pieces = [
        _rays(group, start) for group in network.groups if is_along(group.type) and is_image_point(group.type)
    ]
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
    """Where rays (n, 3) come nearest to each other; ``None`` where they are parallel, or meet behind a camera."""
    if len(rays) < 2 or np.linalg.norm(np.cross(rays[0], rays), axis=1).max() < _LEAST_ANGLE:
        return None
    point = nearest_point(centres, rays)
    ahead = np.einsum("nj,nj->n", point - centres, rays) > 0.0
    return point if ahead.all() and np.isfinite(point).all() else None


def _rays(
    group: ObservationGroup, start: Mapping[str, FloatArray]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Point block, projection centre and direction of every completely measured row, in object axes."""
    blocks = [start[slot.kind][numbers] for slot, numbers in zip(group.type.slots, group.blocks, strict=True)]
    knots = sum(slot.kind == "rotation" and "knot" in slot.part for slot in group.type.slots)
    clock = 1 + knots * knots
    path: Knots = knots_of(blocks, group.constants[:, -clock:], knots)
    height, eccentricity, interior = (*blocks[2 * knots : 2 * knots + 2], blocks[-2])
    with np.errstate(invalid="ignore"):
        pose = path.pose(path.time)
    model = CAMERA_MODELS[group.type.key.partition("/")[2]]
    scans = group.type.key.startswith(SCANNER)
    measured = group.constants[:, :2] if scans else group.observed
    own = group.constants[:, 2 : -clock - (len(ROW) if scans else 0)]
    ray = ideal_rays(model, interior, own, measured)
    good = np.asarray(group.mask.all(axis=1))
    centre = pose.position + np.pad(height, ((0, 0), (2, 0)))
    centre -= np.einsum("nji,nj->ni", pose.rotation, eccentricity)
    direction = np.einsum("nji,nj->ni", pose.rotation, ray)
    return group.blocks[-1][good].astype(np.int64), centre[good], direction[good]
