"""The frame kernel: object points in the axes of an image, a theodolite or a local system.

    X* = D (X + t e_Z − X0 − h e_Z) + r0*                                    (MOR eqs. 1, 5, 6)

with the height h of the rotation centre above the position X0 (tripod target, station mark), the height t of
the sighted target above its point, and the eccentricity r0* from the projection centre to the rotation centre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray


class InFrame(NamedTuple):
    """n points in the axes of their frames."""

    star: FloatArray
    """(n, 3) coordinates X*, Y*, Z*."""
    lever: FloatArray
    """(n, 3) D (X − X0), the vector from the rotation centre; differs from ``star`` by r0*."""
    D: FloatArray
    """(n, 3, 3) the rotations."""


def into_frame(
    position: FloatArray,
    D: FloatArray,
    height: FloatArray,
    point: FloatArray,
    target_height: FloatArray | None = None,
    eccentricity: FloatArray | None = None,
) -> InFrame:
    """Points (n, 3) in frames given by position (n, 3), rotation (n, 3, 3) and height (n, 1)."""
    difference = point - position
    difference[:, 2] -= height[:, 0]
    if target_height is not None:
        difference[:, 2] += target_height[:, 0]
    lever = np.einsum("nij,nj->ni", D, difference)
    return InFrame(lever if eccentricity is None else lever + eccentricity, lever, D)


def by_point(by_star: FloatArray, frame: InFrame) -> FloatArray:
    """Chain (n, m, 3) derivatives by X* on to the object point: ∂X*/∂X = D."""
    return by_star @ frame.D


def by_rotation(by_star: FloatArray, lever: FloatArray) -> FloatArray:
    """Chain (n, m, 3) derivatives by X* on to the small rotation: ∂X*/∂δ = [D (X − X0)]×."""
    a, q = by_star, lever[:, None, :]
    result = np.empty_like(a)
    result[..., 0] = a[..., 1] * q[..., 2] - a[..., 2] * q[..., 1]
    result[..., 1] = a[..., 2] * q[..., 0] - a[..., 0] * q[..., 2]
    result[..., 2] = a[..., 0] * q[..., 1] - a[..., 1] * q[..., 0]
    return result


def follow(star: FloatArray, D: FloatArray, base: FloatArray) -> InFrame:
    """Points in the system of a stereo follower, X_B* = D* (X_A* − b*) (MOR eq. 4)."""
    followed = np.einsum("nij,nj->ni", D, star - base)
    return InFrame(followed, followed, D)
