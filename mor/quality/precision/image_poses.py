"""Images on a trajectory in the result: their poses and cofactors, from those of the knots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.parameters.index import tangents
from mor.project.trajectories.poses import ImagePoses, image_poses, with_image_poses
from mor.quality.assess import Quality
from mor.quality.precision.covariance import joint_cofactors
from mor.quality.solved import Solved

_KNOTS_AT_A_TIME = 32
"""Knots whose columns of the inverse are worked out together."""


def with_poses(solved: Solved) -> Solved:
    """The result in which images on trajectories have the poses of their times, and how precise these are."""
    network = solved.network
    if not network.image_times:
        return solved
    adjustment = solved.adjustment._replace(values=with_image_poses(network, solved.adjustment.values))
    if solved.quality is None:
        return replace(solved, adjustment=adjustment)
    parts = network.things["image"].parts
    cofactors = dict(solved.quality.cofactors)
    for kind in ("point", "rotation"):
        cofactors[kind] = cofactors[kind].copy()
    for found in image_poses(network, adjustment.values):
        for piece, position, rotation in _of_poses(solved.quality, found):
            images = found.images[piece]
            cofactors["point"][parts["position"][images]] = position
            cofactors["rotation"][parts["rotation"][images]] = rotation
    quality = replace(solved.quality, adjustment=adjustment, cofactors=cofactors)
    return replace(solved, adjustment=adjustment, quality=quality)


def _of_poses(quality: Quality, found: ImagePoses) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Some images after the other, (m,) of ``found``: cofactors (m, 3, 3) of positions and of small rotations."""
    index, values = quality.adjustment.problem.index, quality.adjustment.values
    tangent = tangents(index.blocks["rotation"], values["rotation"])
    for piece in _pieces(found.positions):
        positions, rotations = found.positions[piece], found.rotations[piece]
        columns = np.concatenate(
            [index.columns["point"][positions], index.columns["rotation"][rotations]], axis=1
        ).reshape(len(piece), -1)
        known, where = np.unique(columns, return_inverse=True)
        whole = joint_cofactors(quality, known)
        where = where.reshape(columns.shape)
        q = whole[where[:, :, None], where[:, None, :]]
        count = positions.shape[1]
        by_rotations = found.pose.by_rotations[piece]
        if tangent is not None:
            by_rotations = by_rotations @ tangent[rotations]
        design = np.zeros((len(piece), 6, 6 * count))
        for k in range(count):
            design[:, :3, 3 * k : 3 * k + 3] = found.pose.weights[piece, k, None, None] * np.eye(3)
            design[:, 3:, 3 * (count + k) : 3 * (count + k + 1)] = by_rotations[:, k]
        own = design @ q @ np.swapaxes(design, 1, 2)
        yield piece, own[:, :3, :3], own[:, 3:, 3:]


def _pieces(knots: IntArray) -> Iterator[IntArray]:
    """Rows (m,) of knots (n, k) in the order of their first knots, so many that they have few different knots."""
    order = np.argsort(knots[:, 0], kind="stable")
    number = np.cumsum(np.diff(knots[order, 0], prepend=-1) > 0) // _KNOTS_AT_A_TIME
    for k in np.unique(number):
        yield order[number == k]
