"""Small rotations for kernels: rotation vectors ψ act by vector products, also where they turn by much.

exp([ψ]×) q = q + sin|ψ|/|ψ| ψ×q + (1 − cos|ψ|)/|ψ|² ψ×(ψ×q)
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import NamedTuple

from mor.compilation import compile_kernel

Vector = tuple[float, float, float]

_SERIES = 0.0025
"""Square of the angle below which the series have all digits."""


class Turn(NamedTuple):
    """A small rotation vector ψ, and the factors of ψ× and ψ×ψ× in exp([ψ]×), and of the last in its right Jacobian."""

    psi: Vector
    sine: float
    cosine: float
    third: float


@compile_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compile_kernel
def small_turn(x: float, y: float, z: float) -> Turn:
    """Return the rotation by a vector."""
    square = x * x + y * y + z * z
    if square < _SERIES:
        sine = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
        cosine = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
        third = (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))) / 6.0
    else:
        angle = sqrt(square)
        sine, cosine = sin(angle) / angle, (1.0 - cos(angle)) / square
        third = (1.0 - sine) / square
    return Turn((x, y, z), sine, cosine, third)


@compile_kernel
def polynomial(q: Vector, once: Vector, first: float, second: float, twice: Vector) -> Vector:
    """Return q + first · once + second · twice."""
    return (
        q[0] + first * once[0] + second * twice[0],
        q[1] + first * once[1] + second * twice[1],
        q[2] + first * once[2] + second * twice[2],
    )


@compile_kernel
def turned(turn: Turn, q: Vector) -> Vector:
    """Return exp([ψ]×) q."""
    once = cross(turn.psi, q)
    return polynomial(q, once, turn.sine, turn.cosine, cross(turn.psi, once))


@compile_kernel
def turned_back(turn: Turn, row: Vector) -> Vector:
    """Return the row times exp([ψ]×)."""
    once = cross(row, turn.psi)
    return polynomial(row, once, turn.sine, turn.cosine, cross(once, turn.psi))


@compile_kernel
def by_psi(turn: Turn, q: Vector) -> Vector:
    """Return J(−ψ) q with the right Jacobian J."""
    once = cross(turn.psi, q)
    return polynomial(q, once, turn.cosine, turn.third, cross(turn.psi, once))


@compile_kernel
def row_by_psi(turn: Turn, row: Vector) -> Vector:
    """Return the row times J(−ψ)."""
    once = cross(row, turn.psi)
    return polynomial(row, once, turn.cosine, turn.third, cross(once, turn.psi))
