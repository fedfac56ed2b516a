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


class Turn(NamedTuple):
    """A rotation by a vector ψ, and how it changes with it."""

    matrix: FloatArray
    """(n, 3, 3) exp([ψ]×)."""
    jacobian: FloatArray
    """(n, 3, 3) its right Jacobian."""


def turn_by(vector: FloatArray) -> Turn:
    """exp([ψ]×) of rotation vectors ψ (n, 3), and J with exp([ψ + dψ]×) = exp([ψ]×) exp([J dψ]×), exact for ψ → 0.

    exp([ψ]×) = 1 + sin θ/θ [ψ]× + (1 − cos θ)/θ² [ψ]×²
    J         = 1 − (1 − cos θ)/θ² [ψ]× + (θ − sin θ)/θ³ [ψ]×²        (G. S. Chirikjian, 2012)
    """
    cross, squared, square = _powers(vector)
    angle = np.sqrt(square)
    small = angle < _SERIES
    safe = np.where(small, 1.0, angle)
    sine = np.sinc(angle / np.pi)
    cosine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    series = (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0
    third = np.where(small, series, (1.0 - sine) / (safe * safe))
    across = cosine[:, None, None] * cross
    matrix, jacobian = sine[:, None, None] * cross, third[:, None, None] * squared
    matrix += cosine[:, None, None] * squared
    jacobian -= across
    for one in (matrix, jacobian):
        one.reshape(-1, 9)[:, ::4] += 1.0
    return Turn(matrix, jacobian)


def right_jacobian(vector: FloatArray) -> FloatArray:
    """J (n, 3, 3) of :func:`turn_by` for rotation vectors ψ (n, 3)."""
    return turn_by(vector).jacobian


def inverse_right_jacobian(vector: FloatArray) -> FloatArray:
    """J⁻¹ (n, 3, 3) for rotation vectors ψ (n, 3) shorter than 2π, exact for ψ → 0.

    J⁻¹ = 1 + ½ [ψ]× + (1 − θ/2 cot θ/2)/θ² [ψ]×² (G. S. Chirikjian, 2012).
    """
    cross, squared, square = _powers(vector)
    small = square < _SERIES**2
    half = 0.5 * np.sqrt(np.where(small, 1.0, square))
    series = (1.0 + square / 60.0 * (1.0 + square / 42.0)) / 12.0
    share = np.where(small, series, 0.25 * (1.0 - half / np.tan(half)) / (half * half))
    inverse = share[:, None, None] * squared
    inverse += 0.5 * cross
    inverse.reshape(-1, 9)[:, ::4] += 1.0
    return inverse


def _powers(vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """[ψ]× (n, 3, 3), [ψ]×² (n, 3, 3) = ψψᵀ − θ² 1, and θ² (n,) of vectors ψ (n, 3)."""
    square = np.einsum("ni,ni->n", vector, vector)
    squared = vector[:, :, None] * vector[:, None, :]
    squared.reshape(-1, 9)[:, ::4] -= square[:, None]
    return cross_matrix(vector), squared, square


_SERIES = 0.05
"""Angle below which the series have all digits, and the closed forms lose some."""
