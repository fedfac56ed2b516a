"""A frame that moves while it looks: steady velocity and steady rotation, in the axes it has at time 0.

    X*(t) = exp(−[ω t]×) (D (X − X0) − v t) + r0*

with the pose X0, D at time 0, the velocity v and the rate of rotation ω in the axes of the frame: the frame is at
X0 + t Dᵀv, its rotation is exp(−[ω t]×) D.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.rotations import cross_matrix, exponential


class Moved(NamedTuple):
    """n points in the axes of their moving frames, eccentricity left out."""

    star: FloatArray
    """(n, 3) exp(−[ω t]×) (D (X − X0) − v t)."""
    shifted: FloatArray
    """(n, 3) D (X − X0) − v t."""
    turn: FloatArray
    """(n, 3, 3) exp(−[ω t]×), exactly the unit matrix at t = 0."""


def moved(lever: FloatArray, velocity: FloatArray, rate: FloatArray, time: FloatArray) -> Moved:
    """Points D (X − X0) (n, 3) of the frames at time 0, in their axes at ``time`` (n,)."""
    shifted = lever - velocity * time[:, None]
    turn = exponential(-rate * time[:, None])
    return Moved(np.einsum("nij,nj->ni", turn, shifted), shifted, turn)


def by_time(found: Moved, velocity: FloatArray, rate: FloatArray) -> FloatArray:
    """∂X*/∂t (n, 3) = −ω × X*(t) − exp(−[ω t]×) v, eccentricity left out of X*."""
    passed: FloatArray = -np.cross(rate, found.star) - np.einsum("nij,nj->ni", found.turn, velocity)
    return passed


def right_jacobian(vector: FloatArray) -> FloatArray:
    """J (n, 3, 3) with exp([ψ + dψ]×) = exp([ψ]×) exp([J dψ]×) for rotation vectors ψ (n, 3), exact for ψ → 0.

    J = 1 − (1 − cos θ)/θ² [ψ]× + (θ − sin θ)/θ³ [ψ]×² (G. S. Chirikjian, 2012).
    """
    angle = np.linalg.norm(vector, axis=-1)
    cosine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = angle < _SERIES
    safe = np.where(small, 1.0, angle)
    square = angle * angle
    series = (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0
    third = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    cross = cross_matrix(vector)
    jacobian: FloatArray = np.eye(3) - cosine[:, None, None] * cross + third[:, None, None] * (cross @ cross)
    return jacobian


_SERIES = 0.05
"""Angle below which the series has all digits, and the closed form loses some."""
