"""Rigid motion and trajectories: poses between knots, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.model.rotations import cross_matrix, exponential, quaternions
from mor.types import BoolArray, FloatArray, IntArray

# ---- A frame that moves while it looks: steady velocity and steady rotation, in the axes it has at time 0.
#
#     X*(t) = exp(−[ω t]×) (D (X − X0) − v t) + r0*
#
# with the pose X0, D at time 0, the velocity v and the rate of rotation ω in the axes of the frame: the frame is at
# X0 + t Dᵀv, its rotation is exp(−[ω t]×) D.


class MovedPoints(NamedTuple):
    """n points in the axes of their moving frames, eccentricity left out."""

    star: FloatArray
    """(n, 3) exp(−[ω t]×) (D (X − X0) − v t)."""
    shifted: FloatArray
    """(n, 3) D (X − X0) − v t."""
    turn: FloatArray
    """(n, 3, 3) exp(−[ω t]×), exactly the unit matrix at t = 0."""


def moved(lever: FloatArray, velocity: FloatArray, rate: FloatArray, time: FloatArray) -> MovedPoints:
    """Points D (X − X0) (n, 3) of the frames at time 0, in their axes at ``time`` (n,)."""
    shifted = lever - velocity * time[:, None]
    turn = exponential(-rate * time[:, None])
    return MovedPoints(np.einsum("nij,nj->ni", turn, shifted), shifted, turn)


def by_time(found: MovedPoints, velocity: FloatArray, rate: FloatArray) -> FloatArray:
    """∂X*/∂t (n, 3) = −ω × X*(t) − exp(−[ω t]×) v, eccentricity left out of X*."""
    return np.asarray(-np.cross(rate, found.star) - np.einsum("nij,nj->ni", found.turn, velocity))


class RotationVector(NamedTuple):
    """A rotation by a vector ψ, and how it changes with it."""

    matrix: FloatArray
    """(n, 3, 3) exp([ψ]×)."""
    jacobian: FloatArray
    """(n, 3, 3) its right Jacobian."""


def turn_by(vector: FloatArray) -> RotationVector:
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
    return RotationVector(matrix, jacobian)


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
    square = np.einsum("ni,ni->n", vector, vector)
    squared = vector[:, :, None] * vector[:, None, :]
    squared.reshape(-1, 9)[:, ::4] -= square[:, None]
    return cross_matrix(vector), squared, square


_SERIES = 0.05
"""Angle below which the series have all digits, and the closed forms lose some."""


# ---- Poses between the knots of a trajectory, and how they depend on the knots and on time.
#
#     X0(t) = Σ w_k(t) X_k            D(t) = exp(−[θ(t)]×) D_0,   θ(t) = Σ w_k(t) θ_k,   exp(−[θ_k]×) D_0 = D_k
#
# with the weights w_k of interpolation, which add up to 1, and the small rotations θ_k of the knots against
# knot 0, the one before t. The weights are polynomials of the time since that knot; two knots make linear,
# four cubic interpolation. With two knots θ(t) is the turn at a steady rate.


@dataclass(frozen=True)
class TrajectoryPoses:
    """n poses on trajectories, each from its k knots."""

    position: FloatArray
    """(n, 3) X0."""
    rotation: FloatArray
    """(n, 3, 3) D."""
    weights: FloatArray
    """(n, k) ∂X0/∂X_k."""
    velocity: FloatArray
    """(n, 3) ∂X0/∂t."""
    rate: FloatArray
    """(n, 3) ω: from t to t + dt the pose turns by exp(−[ω dt]×)."""
    turned: FloatArray
    """(n, 3, 3) exp(−[θ]×)."""
    jacobian: FloatArray
    """(n, 3, 3) right Jacobian of θ."""
    inverse: FloatArray
    """(n, k − 1, 3, 3) inverses of the right Jacobians of θ_k."""

    @cached_property
    def by_rotations(self) -> FloatArray:
        """(n, k, 3, 3) small rotation of D by those of the knots."""
        w = self.weights
        found = np.empty((*w.shape, 3, 3))
        found[:, 1:] = w[:, 1:, None, None] * (self.jacobian[:, None] @ self.inverse)
        back = np.einsum("nk,nkji->nij", w[:, 1:], self.inverse)  # left Jacobians are the right ones transposed
        found[:, 0] = self.turned - self.jacobian @ back
        return found


class Path(NamedTuple):
    """The k knots on which the poses of n rows depend."""

    positions: FloatArray
    """(n, k, 3) X_k."""
    first: FloatArray
    """(n, 3, 3) D_0."""
    turns: FloatArray
    """(n, k − 1, 3) θ_k of the other knots."""
    inverse: FloatArray
    """(n, k − 1, 3, 3) inverses of the right Jacobians of these."""
    weights: FloatArray
    """(n, k, d) coefficients of the weights as polynomials of the time since knot 0, the constant first."""

    @property
    def _leaves(self) -> BoolArray:
        """(n,) false where all knots are at one place: then the velocity is 0, and not what rounding leaves of it."""
        return np.asarray((self.positions != self.positions[:, :1]).any(axis=(1, 2)))

    def at(self, time: FloatArray) -> TrajectoryPoses:
        """Poses at ``time`` (n,) since knot 0."""
        # Polynomials (n, k, d), the constant first, at times (n,): values (n, k) and derivatives (n, k).
        coefficients = self.weights
        since = time[:, None]
        value, slope = coefficients[:, :, -1], np.zeros(coefficients.shape[:2])
        for power in range(coefficients.shape[2] - 2, -1, -1):
            slope = slope * since + value
            value = value * since + coefficients[:, :, power]
        w, dw = value, slope
        theta, turning = (np.einsum("nk,nkj->nj", of_knots[:, 1:], self.turns) for of_knots in (w, dw))
        back = turn_by(theta)
        turned = np.swapaxes(back.matrix, 1, 2)
        return TrajectoryPoses(
            position=np.einsum("nk,nkj->nj", w, self.positions),
            rotation=turned @ self.first,
            weights=w,
            velocity=np.einsum("nk,nkj->nj", dw, self.positions) * self._leaves[:, None],
            rate=np.einsum("nij,nj->ni", back.jacobian, turning),
            turned=turned,
            jacobian=back.jacobian,
            inverse=self.inverse,
        )


def path_of(positions: FloatArray, rotations: FloatArray, weights: FloatArray) -> Path:
    """Paths between knots ``positions`` (n, k, 3) and ``rotations`` (n, k, 3, 3), with the weights (n, k, d)."""
    turns = small_rotations(rotations[:, :1], rotations[:, 1:])
    inverse = inverse_right_jacobian(turns.reshape(-1, 3)).reshape(*turns.shape, 3)
    return Path(positions, rotations[:, 0], turns, inverse, weights)


def pose_at(positions: FloatArray, rotations: FloatArray, weights: FloatArray, time: FloatArray) -> TrajectoryPoses:
    """Poses at ``time`` (n,) since knot 0, of what :func:`path_of` takes."""
    return path_of(positions, rotations, weights).at(time)


def small_rotations(before: FloatArray, after: FloatArray) -> FloatArray:
    """θ (…, 3) with exp(−[θ]×) D = D′ for rotations D and D′ (…, 3, 3), no longer than π; 0 where they are equal."""
    between = after @ np.swapaxes(before, -1, -2)
    q = quaternions(np.reshape(between, (-1, 3, 3)))
    length = np.linalg.norm(q[:, 1:], axis=1)
    whole = 2.0 * np.arctan2(length, q[:, 0])
    factor = np.where(length > 0.0, whole / np.where(length > 0.0, length, 1.0), 2.0)
    factor *= (before != after).any(axis=(-1, -2)).ravel()
    return np.asarray(-factor[:, None] * q[:, 1:]).reshape(*between.shape[:-2], 3)


def by_ends(turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """∂θ/∂δ and ∂θ/∂δ′ (n, 3, 3) of turns θ (n, 3) from D to D′ by the small rotations of both."""
    inverse = inverse_right_jacobian(turn)
    return -np.swapaxes(inverse, 1, 2), inverse


def linear_weights(interval: FloatArray) -> FloatArray:
    """(n, 2, 2) weights of the knots before and after, ``interval`` (n,) apart."""
    weights = np.zeros((len(interval), 2, 2))
    weights[:, 0, 0] = 1.0
    weights[:, 0, 1], weights[:, 1, 1] = -1.0 / interval, 1.0 / interval
    return weights


def cubic_weights(times: FloatArray, place: IntArray) -> FloatArray:
    """(n, 4, 4) weights of four knots at ascending ``times`` (n, 4) within the interval that begins at ``place`` (n,).

    In the interval the curve is the cubic that has at both knots the position and the slope of the parabola through
    the knot and its two neighbours; at an end, of the parabola through the three last knots. For knots at a regular
    spacing this is cubic convolution (R. G. Keys, 1981), exact for parabolas at any spacing. Knots in the order of
    ``times``; the time counts from the knot at ``place``.
    """
    n = len(times)
    left, right = np.arange(n), place
    h = times[left, right + 1] - times[left, right]
    at_left, at_right = _slopes(times, right), _slopes(times, right + 1)
    values = np.zeros((n, 2, 4))
    values[left, 0, right], values[left, 1, right + 1] = 1.0, 1.0
    difference = (values[:, 1] - values[:, 0]) / h[:, None]
    weights = np.zeros((n, 4, 4))
    weights[:, :, 0], weights[:, :, 1] = values[:, 0], at_left
    weights[:, :, 2] = (3.0 * difference - 2.0 * at_left - at_right) / h[:, None]
    weights[:, :, 3] = (at_left + at_right - 2.0 * difference) / h[:, None] ** 2
    return weights


def _slopes(times: FloatArray, at: IntArray) -> FloatArray:
    """(n, 4) weights of the knots in the slope at knot ``at`` (n,): of the parabola through it and its neighbours."""
    rows = np.arange(len(times))
    first = np.clip(at - 1, 0, 1)
    three = first[:, None] + np.arange(3)
    t = times[rows[:, None], three]
    x = times[rows, at]
    slopes = np.zeros((len(times), 4))
    for k in range(3):
        a, b = (t[:, j] for j in range(3) if j != k)
        slopes[rows, three[:, k]] = (2.0 * x - a - b) / ((t[:, k] - a) * (t[:, k] - b))
    return slopes
