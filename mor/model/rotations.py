"""Rotations, quaternions, rotated frames, and the dense linear algebra that they share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mor.types import FloatArray

# ---- Functions of numpy.linalg that return NaN for a matrix they cannot decompose, instead of raising.
#
# Start values and diagnosis work on stacks of candidates: a singular matrix, or one with infinities, belongs
# to a candidate that is none. With NumPy a single one ends the whole stack. Comparisons with NaN are false,
# so that a caller passes such a candidate over. Arguments and results are those of NumPy; matrices (..., m,
# n) may be stacked.


def solve(matrix: NDArray[Any], right: NDArray[Any]) -> FloatArray:
    """Return x of matrix · x = right; (n, k) right-hand sides, or (n,) of a single matrix."""
    if right.ndim == 1:
        return np.asarray(solve(matrix, right[:, None])[..., 0])
    return np.asarray(_each(np.linalg.solve, matrix, right))


def inv(matrix: NDArray[Any]) -> FloatArray:
    """Return inverses (..., n, n)."""
    return np.asarray(_each(np.linalg.inv, matrix))


def cholesky(matrix: NDArray[Any]) -> FloatArray:
    """Return lower triangles L (..., n, n) of L Lᵀ."""
    return np.asarray(_each(np.linalg.cholesky, matrix))


def pinv(matrix: NDArray[Any], rcond: float = 1e-15, hermitian: bool = False) -> FloatArray:
    """Return pseudo-inverses (..., n, m)."""
    return np.asarray(_each(lambda one: np.linalg.pinv(one, rcond, hermitian), matrix))


def eigh(matrix: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (..., n), ascending, and eigenvectors (..., n, n) of symmetric matrices."""
    return tuple(_each(np.linalg.eigh, matrix))


def eigvalsh(matrix: NDArray[Any]) -> FloatArray:
    """Return eigenvalues (..., n) of symmetric matrices, ascending."""
    return np.asarray(_each(np.linalg.eigvalsh, matrix))


def eig(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return eigenvalues (..., n) and eigenvectors (..., n, n)."""
    return tuple(_each(np.linalg.eig, matrix))


def eigvals(matrix: NDArray[Any]) -> NDArray[Any]:
    """Return eigenvalues (..., n)."""
    return np.asarray(_each(np.linalg.eigvals, matrix))


def svd(matrix: NDArray[Any], full_matrices: bool = True) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return U, singular values, descending, and Vᵀ."""
    return tuple(_each(lambda one: np.linalg.svd(one, full_matrices), matrix))


def singular_values(matrix: NDArray[Any]) -> FloatArray:
    """Return singular values (..., min(m, n)), descending."""
    return np.asarray(_each(lambda one: np.linalg.svd(one, compute_uv=False), matrix))


def lstsq(matrix: NDArray[Any], right: NDArray[Any], rcond: float | None = None) -> FloatArray:
    """Return the least-squares solution (n,) or (n, k) of one system matrix · x = right."""
    if np.isfinite(matrix).all() and np.isfinite(right).all():
        try:
            return np.asarray(np.linalg.lstsq(matrix, right, rcond=rcond)[0], dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
    return np.full((matrix.shape[1], *right.shape[1:]), np.nan)


def _each(operation: Callable[..., Any], *stacks: NDArray[Any]) -> Any:
    """Apply an operation to stacks of matrices, member by member if NumPy refuses them together.

    Matrices that are not finite never reach LAPACK, which writes of them to standard output.
    """
    bad = ~np.isfinite(stacks[0]).all(axis=(-2, -1))
    if not bad.any():
        try:
            return operation(*stacks)
        except np.linalg.LinAlgError:
            if operation in (np.linalg.solve, np.linalg.inv):
                bad = np.linalg.slogdet(stacks[0])[0] == 0.0
    usable = np.where(bad[..., None, None], np.eye(*stacks[0].shape[-2:]), stacks[0]), *stacks[1:]
    try:  # all others at once, with unit matrices instead of the bad ones
        found = operation(*usable)
    except np.linalg.LinAlgError:
        found = _one_by_one(operation, *usable)
    several = found if isinstance(found, tuple) else (found,)
    marked = [np.where(bad.reshape(bad.shape + (1,) * (part.ndim - bad.ndim)), np.nan, part) for part in several]
    return tuple(marked) if isinstance(found, tuple) else marked[0]


def _one_by_one(operation: Callable[..., Any], *stacks: NDArray[Any]) -> Any:
    count = np.broadcast_shapes(*(stack.shape[:-2] for stack in stacks))
    members = [np.broadcast_to(stack, (*count, *stack.shape[-2:])).reshape(-1, *stack.shape[-2:]) for stack in stacks]
    like = operation(*(np.eye(*stack.shape[-2:]) for stack in stacks))
    several = isinstance(like, tuple)
    found: list[list[NDArray[Any]]] = []
    for one in zip(*members, strict=True):
        try:
            result = operation(*one)
        except np.linalg.LinAlgError:
            result = tuple(np.full_like(part, np.nan) for part in like) if several else np.full_like(like, np.nan)
        found.append(list(result) if several else [result])
    parts = [np.stack(part).reshape(*count, *part[0].shape) for part in zip(*found, strict=True)]
    return tuple(parts) if several else parts[0]


# ---- Rotations, stored as matrices D that take object axes to the axes of a frame.
#
# D = (Rx(ω) Ry(φ) Rz(κ))ᵀ. A rotation is updated by a small rotation vector δ in the axes of the frame,
# D ← exp(−[δ]×) D, which has no gimbal lock; ω, φ, κ are for reading and reporting only.
# All functions are vectorised over leading dimensions.

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
    return np.asarray(np.eye(3) + sine * cross + cosine * (cross @ cross))


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation (3, 3) nearest to a matrix: largest trace of the product with its transpose (W. Kabsch 1976)."""
    left, _, right = svd(matrix)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return np.asarray((left * proper) @ right)


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


# ---- Rotations as quaternions (w, x, y, z): what other programs keep attitudes in.


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
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


# ---- The frame kernel: object points in the axes of an image, a theodolite or a local system.
#
#     X* = D (X + t e_Z − X0 − h e_Z) + r0*                                    (MOR eqs. 1, 5, 6)
#
# with the height h of the rotation centre above the position X0 (tripod target, station mark), the height t of
# the sighted target above its point, and the eccentricity r0* from the projection centre to the rotation centre.


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
