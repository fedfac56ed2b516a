"""Rotations, stored as matrices D that take object axes to the axes of a frame.

D = (Rx(ω) Ry(φ) Rz(κ))ᵀ. A rotation is updated by a small rotation vector δ in the axes of the frame,
D ← exp(−[δ]×) D, which has no gimbal lock; ω, φ, κ are for reading and reporting only.
All functions are vectorised over leading dimensions.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant

GIMBAL = 1e-9
"""cos φ below which ω and κ can no longer be told apart."""


def rotation_from_angles(angles: FloatArray) -> FloatArray:
    """Rotation matrices D (n, 3, 3) of the angles ω, φ, κ (n, 3) in radians (MOR eq. 1)."""
    angles = np.asarray(angles, dtype=float)
    so, sp, sk = np.moveaxis(np.sin(angles), -1, 0)
    co, cp, ck = np.moveaxis(np.cos(angles), -1, 0)
    D = np.empty((*angles.shape[:-1], 3, 3))
    D[..., 0, 0], D[..., 0, 1], D[..., 0, 2] = cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck
    D[..., 1, 0], D[..., 1, 1], D[..., 1, 2] = -cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk
    D[..., 2, 0], D[..., 2, 1], D[..., 2, 2] = sp, -so * cp, co * cp
    return D


def angles_from_rotation(D: FloatArray) -> FloatArray:
    """Angles ω, φ, κ (n, 3) in radians of rotation matrices (n, 3, 3); κ = 0 where φ = ±100 gon."""
    D = np.asarray(D, dtype=float)
    cos_phi = np.hypot(D[..., 0, 0], D[..., 1, 0])
    phi = np.arctan2(D[..., 2, 0], cos_phi)
    locked = cos_phi < GIMBAL
    omega = np.where(locked, np.arctan2(D[..., 1, 2], D[..., 1, 1]), np.arctan2(-D[..., 2, 1], D[..., 2, 2]))
    kappa = np.where(locked, 0.0, np.arctan2(-D[..., 1, 0], D[..., 0, 0]))
    return np.stack([omega, phi, kappa], axis=-1)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Matrices [q]× (n, 3, 3) with [q]× a = q × a."""
    vector = np.asarray(vector, dtype=float)
    matrix = np.zeros((*vector.shape[:-1], 3, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def exponential(vector: FloatArray) -> FloatArray:
    """exp([δ]×) (n, 3, 3) of rotation vectors (n, 3), by Rodrigues' formula, exact also for δ → 0."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = cross_matrix(vector)
    sine = np.sinc(angle / np.pi)  # sin(a) / a
    cosine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2  # (1 - cos a) / a²
    rotation: FloatArray = np.eye(3) + sine * cross + cosine * (cross @ cross)
    return rotation


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation (3, 3) nearest to a matrix: largest trace of the product with its transpose (W. Kabsch 1976)."""
    left, _, right = tolerant.svd(matrix)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    nearest: FloatArray = (left * proper) @ right
    return nearest


def rotate(D: FloatArray, delta: FloatArray) -> FloatArray:
    """Updated rotations exp(−[δ]×) D, orthonormalised by one Newton step of the polar decomposition."""
    updated = exponential(-np.asarray(delta, dtype=float)) @ D
    excess = updated @ np.swapaxes(updated, -1, -2) - np.eye(3)
    return updated - 0.5 * excess @ updated


def tangent_of_angles(angles: FloatArray) -> FloatArray:
    """dδ/d(ω, φ, κ) (n, 3, 3): the small rotation vector that changes of the three angles amount to."""
    angles = np.asarray(angles, dtype=float)
    _, sp, sk = np.moveaxis(np.sin(angles), -1, 0)
    _, cp, ck = np.moveaxis(np.cos(angles), -1, 0)
    E = np.zeros((*angles.shape[:-1], 3, 3))
    E[..., 0, 0], E[..., 0, 1] = cp * ck, sk
    E[..., 1, 0], E[..., 1, 1] = -cp * sk, ck
    E[..., 2, 0], E[..., 2, 2] = sp, 1.0
    return E


def angles_by_tangent(angles: FloatArray) -> FloatArray:
    """d(ω, φ, κ)/dδ (n, 3, 3), the inverse of :func:`tangent_of_angles`; infinite at φ = ±100 gon."""
    angles = np.asarray(angles, dtype=float)
    _, sp, sk = np.moveaxis(np.sin(angles), -1, 0)
    _, cp, ck = np.moveaxis(np.cos(angles), -1, 0)
    with np.errstate(divide="ignore"):
        secant = 1.0 / np.where(np.abs(cp) < GIMBAL, 0.0, cp)
    E = np.zeros((*angles.shape[:-1], 3, 3))
    with np.errstate(invalid="ignore"):
        E[..., 0, 0], E[..., 0, 1] = ck * secant, -sk * secant
        E[..., 2, 0], E[..., 2, 1] = -ck * sp * secant, sk * sp * secant
    E[..., 1, 0], E[..., 1, 1] = sk, ck
    E[..., 2, 2] = 1.0
    return E
