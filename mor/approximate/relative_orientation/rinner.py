"""Relative orientation of two bundles without approximate values (K. Rinner, ÖZfV 44 (1956), 4–9).

Homologous rays p' (frame A) and p'' (frame B) and the base b lie in one plane (4):

    (p', p'', b) = 0     ⇒     p'ᵀ (ik) p'' = 0                                                        (5)

with nine auxiliary unknowns ik = (e_i', e_k'', b) = e_i' · n_k, n_k = e_k'' × b                       (6)–(8)

where e_k'' are the axes of B seen from A: the rows of D*, so that X_B = D* (X_A − b). All triads are
right-handed and the third image coordinate is −c; the f of the paper points the other way. In the words of
today (ik) = −[b]× D*ᵀ is the essential matrix: singular values 1, 1, 0 at the norm (14).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.vectors import cross, principal_rows, unit
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix

NORM = np.sqrt(2.0)
"""(14): Σ ik² = 2."""


class LinearSolution(NamedTuple):
    """Auxiliary unknowns from (5) alone."""

    ik: FloatArray
    """(3, 3) at the norm (14)."""
    normal: FloatArray
    """(9, 9) AᵀA of the system, ik row by row."""
    singular_values: FloatArray
    """(9,) of the system, descending; rows missing to nine count as zero."""


class Basis(NamedTuple):
    """The base in three ways (10a): λ_k b = n_i × n_j."""

    base: FloatArray
    """(3,) unit vector in A, from the longest of the three; its sign is free."""
    cosines: FloatArray
    """(3,) λ_k = cos(b, e_k'') with the signs that (9) gives for this ``base``."""
    three: FloatArray
    """(3, 3) rows: the base from each of the three products, turned to the side of ``base``."""


def coplanarity_rows(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """Coefficients (n, 9) of the ik, row by row, in (5)."""
    return np.asarray(np.einsum("ni,nk->nik", rays_a, rays_b).reshape(len(rays_a), 9))


def homogeneous_unknowns(rows: FloatArray) -> LinearSolution:
    """Solve (5) with n ≥ 8 ``rows`` (n, 9) as a homogeneous system: the right singular vector of the least value."""
    values, right = principal_rows(rows)
    return LinearSolution(right[8].reshape(3, 3) * NORM, rows.T @ rows, values)


def adjoint(ik: FloatArray) -> FloatArray:
    """Matrix of the cofactors (…, 3, 3): its columns are n2 × n3, n3 × n1, n1 × n2."""
    first, second, third = ik[..., :, 0], ik[..., :, 1], ik[..., :, 2]
    return np.stack([cross(second, third), cross(third, first), cross(first, second)], axis=-1)


def base_in_three_ways(ik: FloatArray) -> Basis:
    """Base from the adjoint (9), (10a). The signs of the λ come from the products, not from the roots (10b)."""
    products = adjoint(ik).T
    lengths = np.linalg.norm(products, axis=1)
    base = products[np.argmax(lengths)] / np.max(lengths)
    cosines = products @ base
    return Basis(base, cosines, unit(products) * np.where(cosines < 0.0, -1.0, 1.0)[:, None])


def triad(ik: FloatArray, base: FloatArray) -> FloatArray:
    """Rotation D* from (11a), (12a): e_k'' = b × n_k + λ_k b are its rows.

    Exactly orthonormal where the ik are compatible; otherwise brought to the nearest rotation.
    """
    axes = cross(base, ik.T) + np.outer(adjoint(ik).T @ base, base)
    return nearest_rotation(axes)


def four_candidates(ik: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return (b, D*) for both signs of b and of the ik.

    Two triads, twisted about the base by 200 gon, with two bases each: that of (−ik, −b) is that of (ik, b).
    """
    base = base_in_three_ways(ik).base
    first, second = triad(ik, base), triad(-ik, base)
    return [(base, first), (-base, second), (base, second), (-base, first)]


def auxiliary_unknowns(base: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return ik (3, 3) of an orientation, (6): columns n_k = e_k'' × b."""
    return np.asarray(-cross_matrix(base) @ rotation.T)


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Rotation (…, 3, 3) nearest to a matrix (orthogonal polar factor with determinant +1)."""
    left, _, right = tolerant.svd(matrix)
    left = left.copy()
    left[..., :, 2] *= np.where(np.linalg.det(left @ right) < 0.0, -1.0, 1.0)[..., None]
    return np.asarray(left @ right)
