"""Compatible auxiliary unknowns from five homologous points: every real solution, no approximation.

Five equations (5) leave a four-dimensional space ik = x E1 + y E2 + z E3 + E4. The conditions of Rinner,
written as polynomials, det E = 0 and 2 E Eᵀ E − tr(E Eᵀ) E = 0, are ten cubics in x, y, z. Elimination of
the ten cubic monomials leaves the multiplication by x as a 10 × 10 matrix whose eigenvectors carry the
solutions (the Gröbner basis form of H. Stewénius, C. Engels, D. Nistér, ISPRS J. 60 (2006) 284–294, of the
relation that E. Kruppa found in 1913: ten solutions, here with multiplicities and complex pairs).

It also bears plane scenes, where the eight-point system loses rank.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant

QUADRATIC = list(combinations_with_replacement(range(4), 2))
CUBIC = list(combinations_with_replacement(range(4), 3))
# Cubic monomials proper first, then the basis of the quotient ring: x² xy y² xz yz z² x y z 1. The digits
# name the variables, 3 stands for the constant 1.
PROPER = ["000", "001", "011", "111", "002", "012", "112", "022", "122", "222"]
REST = ["003", "013", "113", "023", "123", "223", "033", "133", "233", "333"]
ORDER = [CUBIC.index((int(m[0]), int(m[1]), int(m[2]))) for m in PROPER + REST]
TIMES_X_CUBIC = {0: 0, 1: 1, 2: 2, 3: 4, 4: 5, 5: 7}
TIMES_X_BASIS = {6: 0, 7: 1, 8: 3, 9: 6}
REAL = 1e-4
"""Imaginary part, relative, up to which an eigenvalue counts as real (double roots split into pairs)."""


def _product_tables() -> tuple[FloatArray, FloatArray]:
    linear = np.zeros((4, 4, 10))
    for i in range(4):
        for j in range(4):
            linear[i, j, QUADRATIC.index((min(i, j), max(i, j)))] = 1.0
    quadratic = np.zeros((10, 4, 20))
    for row, monomial in enumerate(QUADRATIC):
        for j in range(4):
            first, second, third = sorted((*monomial, j))
            quadratic[row, j, CUBIC.index((first, second, third))] = 1.0
    return linear, quadratic


LINEAR_TIMES_LINEAR, QUADRATIC_TIMES_LINEAR = _product_tables()


def _mixing() -> FloatArray:
    # A fixed rotation of the null space: keeps "E4 with coefficient one" away from special positions.
    return np.asarray(np.linalg.qr(np.random.default_rng(5).normal(size=(4, 4)))[0])


MIXING = _mixing()


def null_spaces(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """Four matrices (s, 4, 3, 3) that span the solutions of (5) for s samples of five rays (s, 5, 3)."""
    rows = np.einsum("spi,spk->spik", rays_a, rays_b).reshape(len(rays_a), 5, 9)
    basis = tolerant.svd(rows, full_matrices=True)[2][:, 5:]
    return np.asarray(np.einsum("ab,sbm->sam", MIXING, basis).reshape(len(rays_a), 4, 3, 3))


def cubic_conditions(basis: FloatArray) -> FloatArray:
    """Coefficients (s, 10, 20) of the ten cubics in x, y, z for bases (s, 4, 3, 3)."""
    E = np.moveaxis(basis, 1, -1)
    product = np.einsum("sija,skjb,abq->sikq", E, E, LINEAR_TIMES_LINEAR, optimize=True)
    trace = np.einsum("siiq->sq", product)
    product = 2.0 * product - np.eye(3)[None, :, :, None] * trace[:, None, None, :]
    nine = np.einsum("sijq,sjkb,qbc->sikc", product, E, QUADRATIC_TIMES_LINEAR, optimize=True)
    minors = np.stack([_minor(E, k) for k in range(3)], axis=1)
    determinant = np.einsum("skq,skb,qbc->sc", minors, E[:, 0], QUADRATIC_TIMES_LINEAR, optimize=True)
    return np.concatenate([nine.reshape(len(E), 9, 20), determinant[:, None]], axis=1)[:, :, ORDER]


def _minor(E: FloatArray, k: int) -> FloatArray:
    i, j = (k + 1) % 3, (k + 2) % 3
    return np.asarray(
        np.einsum("sa,sb,abq->sq", E[:, 1, i], E[:, 2, j], LINEAR_TIMES_LINEAR)
        - np.einsum("sa,sb,abq->sq", E[:, 1, j], E[:, 2, i], LINEAR_TIMES_LINEAR)
    )


def five_point_unknowns(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """All real compatible ik (m, 3, 3), at the norm Σ ik² = 2, of s samples of five rays (s, 5, 3).

    Samples without a finite solution contribute none; degenerate samples may contribute spurious matrices,
    which the caller's residuals sort out.
    """
    basis = null_spaces(rays_a, rays_b)
    conditions = cubic_conditions(basis)
    sound = tolerant.singular_values(conditions[:, :, :10])[:, -1] > 1e-13
    basis, conditions = basis[sound], conditions[sound]
    if not len(basis):
        return np.zeros((0, 3, 3))
    reduced = -tolerant.solve(conditions[:, :, :10], conditions[:, :, 10:])
    action = np.zeros((len(basis), 10, 10))
    for row, cubic in TIMES_X_CUBIC.items():
        action[:, row] = reduced[:, cubic]
    for row, column in TIMES_X_BASIS.items():
        action[:, row, column] = 1.0
    values, vectors = tolerant.eig(action)
    last = vectors[:, 9, :]
    real = (np.abs(values.imag) <= REAL * (1.0 + np.abs(values))) & (np.abs(last) > 1e-12)
    weights = vectors[:, 6:10, :] / np.where(real, last, 1.0)[:, None, :]
    ik = np.einsum("sae,saij->seij", weights.real, basis)[real]
    norm = np.linalg.norm(ik, axis=(1, 2), keepdims=True)
    return np.asarray(ik * (np.sqrt(2.0) / norm))
