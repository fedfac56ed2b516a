"""Poses of images on a trajectory, from the knots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry.trajectory import Pose, pose_at
from mor.project.network.build import Network
from mor.project.network.entities import Entities
from mor.project.trajectories.images import TRAJECTORY
from mor.project.trajectories.model import Trajectory


class ImagePoses(NamedTuple):
    """Poses of n images on trajectories that have k knots for each."""

    images: IntArray
    """(n,)"""
    positions: IntArray
    """(n, k) point blocks of the knots."""
    rotations: IntArray
    """(n, k) rotation blocks of the knots."""
    pose: Pose


class Flights(Protocol):
    """Trajectory and time of each image, of a network or of a project that is being read."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Trajectories by name."""

    @property
    def image_times(self) -> Mapping[str, float]:
        """Times of the images on them."""


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
        times = np.array([flights.image_times[images.ids[i]] for i in mine])
        clock = trajectory.clock(times)
        positions, rotations = trajectory.positions[clock.knots], trajectory.rotations[clock.knots]
        weights = clock.constants[:, 1:].reshape(len(mine), trajectory.order, trajectory.order)
        pose = pose_at(
            values["point"][positions], values["rotation"][rotations], weights, clock.constants[:, 0]
        )
        found.append(ImagePoses(mine, positions, rotations, pose))
    return found


def with_image_poses(network: Network, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Values in which the images on trajectories have the poses of their times."""
    return with_poses_of(network.things["image"], network, values)


def with_poses_of(
    images: Entities, flights: Flights, values: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
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
