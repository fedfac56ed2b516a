"""Rotations as quaternions (w, x, y, z): what other programs keep attitudes in."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray


def rotation_of_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z) of any length but 0."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternions(R: FloatArray) -> FloatArray:
    """Quaternions (n, 4), w first and not negative, of rotation matrices (n, 3, 3) (Shepperd 1978)."""
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    squares = np.empty((len(R), 4))
    squares[:, 0] = 1.0 + diagonal.sum(axis=-1)
    squares[:, 1:] = 1.0 + 2.0 * diagonal - diagonal.sum(axis=-1)[:, None]
    skew = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1)
    result = np.empty_like(squares)
    largest = np.argmax(squares, axis=1)
    for k in np.unique(largest).tolist():
        mine = largest == k
        row = np.empty((int(mine.sum()), 4))
        row[:, k] = squares[mine, k]
        for j in range(1, 4):
            if k == 0:
                row[:, j] = skew[mine, j - 1]
            elif j != k:
                row[:, j] = R[mine, k - 1, j - 1] + R[mine, j - 1, k - 1]
        if k:
            row[:, 0] = skew[mine, k - 1]
        result[mine] = row
    result *= np.where(result[:, :1] < 0.0, -1.0, 1.0)
    unit: FloatArray = result / np.linalg.norm(result, axis=1, keepdims=True)
    return unit
