"""Poses: COLMAP's quaternions and translations, mor's rotations and projection centres."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.formats.colmap.model import Pose
from mor.geometry.quaternions import quaternions, rotation_of_quaternion

FLIP = np.diag([1.0, -1.0, -1.0])
"""COLMAP's camera axes (right, down, forward) from mor's (right, up, backward), and back."""


def ours(pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Rotation D (3, 3), object to image axes, and projection centre (3,): x = R X + t is D = F R, X0 = −Rᵀ t."""
    R = rotation_of_quaternion(np.array(pose.quaternion))
    return FLIP @ R, -(R.T @ np.array(pose.translation))


def relative(pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Rotation D* and base b* of a stereo follower: x_B = R x_A + t is X*_B = D* (X*_A − b*), D* = F R F."""
    D = FLIP @ rotation_of_quaternion(np.array(pose.quaternion)) @ FLIP
    return D, -(D.T @ FLIP @ np.array(pose.translation))


def theirs(D: FloatArray, centre: FloatArray) -> FloatArray:
    """Quaternions and translations (n, 7) of rotations (n, 3, 3), object to image axes, and centres (n, 3)."""
    R = FLIP @ D
    translation = -np.einsum("nij,nj->ni", R, centre)
    return np.concatenate([quaternions(R), translation], axis=1)
