"""The collineation between two bundles that see a plane: p'' ~ H p' (four points and more).

For a plane n · X = d in frame A and X_B = D* (X_A − b): H ~ D* (1 − b nᵀ/d). H is given its middle singular
value as scale and the sign that keeps the points in front of both frames; then H = D* (1 − b nᵀ/d) exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.approximate.vectors import cross, principal_rows, tangent_axes, unit
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix, rotate

UNCONTROLLED = 1e-6
"""Redundancy of a coordinate below which the fit follows it, whatever it is."""

_ROUND_OFF = 1e-14
"""Part of the largest below which what a collineation makes of a direction is nothing but round-off."""


class Homography(NamedTuple):
    """A collineation of two bundles."""

    matrix: FloatArray
    """(3, 3) H, middle singular value 1."""
    residuals: FloatArray
    """(n,) length of the four corrections v/σ of a point."""
    objective: float
    """Σ (v/σ)², to be compared with ``redundancy``."""
    redundancy: int
    same_side: bool
    """True if every ray of B is a positive multiple of H times its ray of A."""
    covariance: FloatArray
    """(9, 9) of the elements of H, row by row, up to their common scale; for the a-priori σ of the rays."""


def fit_homography(a: Bundle, b: Bundle, iterations: int = 10) -> Homography:
    """Adjust H to n ≥ 4 homologous rays; errors of both bundles, 2 conditions per point, linear start.

    Four points of which no three are collinear fix H exactly (redundancy 0).
    """
    matrix = linear_homography(a, b)
    residuals = np.zeros(2 * len(a))
    corrections = np.zeros((len(a), 4))
    for _ in range(iterations):
        design, residuals, corrections = _conditions(a, b, matrix, corrections)
        scale = matrix.ravel() / np.linalg.norm(matrix)
        # The scale of H is no unknown: H → 0 would satisfy every condition.
        step = tolerant.lstsq(design - np.outer(design @ scale, scale), -residuals, rcond=1e-12)
        matrix = matrix + step.reshape(3, 3)
        matrix = matrix / np.linalg.norm(matrix)
        if float(np.max(np.abs(step))) < 1e-13:
            break
    design, residuals, _ = _conditions(a, b, matrix, corrections)
    scaled, same_side = scaled_homography(matrix, a.rays, b.rays)
    lengths = np.linalg.norm(residuals.reshape(-1, 2), axis=1)
    covariance = _covariance(design, matrix) * float(np.sum(scaled**2))
    return Homography(scaled, lengths, float(residuals @ residuals), 2 * len(a) - 8, same_side, covariance)


def _covariance(design: FloatArray, matrix: FloatArray) -> FloatArray:
    """Of the elements of H at norm one; their common scale, which is no unknown, is held."""
    scale = matrix.ravel() / np.linalg.norm(matrix)
    rows = design - np.outer(design @ scale, scale)
    normal = rows.T @ rows
    held = normal + np.trace(normal) * np.outer(scale, scale)
    return np.asarray(tolerant.pinv(held, rcond=1e-17, hermitian=True), dtype=np.float64)


def misfits(a: Bundle, b: Bundle, matrices: FloatArray) -> FloatArray:
    """Σ (v/σ)² (m, n) of the smallest corrections to each pair of rays that ``matrices`` (m, 3, 3) carry over.

    To first order; infinite where a matrix carries a ray nowhere.
    """
    across = tangent_axes(b.rays)
    image = np.einsum("mij,nj->mni", matrices, a.rays)
    factor = np.einsum("mni,ni->mn", image, b.rays) / np.einsum("ni,ni->n", b.rays, b.rays)
    by_a = np.einsum("nij,mik,nkl->mnjl", across, matrices, a.whitened_axes, optimize=True)
    by_b = np.einsum("nij,nil->njl", across, b.whitened_axes)
    spread = by_a @ np.swapaxes(by_a, 2, 3) + factor[:, :, None, None] ** 2 * (by_b @ np.swapaxes(by_b, 1, 2))
    one, other = np.moveaxis(np.einsum("nij,mni->mnj", across, image), 2, 0)
    quadratic = (
        spread[..., 1, 1] * one**2 - 2.0 * spread[..., 0, 1] * one * other + spread[..., 0, 0] * other**2
    )
    size = spread[..., 0, 0] * spread[..., 1, 1] - spread[..., 0, 1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(size > 0.0, quadratic / size, np.inf))


def homographies_of_four(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """Collineations (m, 3, 3), of any scale, of four rays each (m, 4, 3); singular where three are in one plane.

    The first three rays are the axes, the fourth gives their lengths; by adjugates, so that nothing is divided.
    """
    lengths_a = np.einsum("mij,mj->mi", adjugate(rays_a[:, :3]), rays_a[:, 3])
    lengths_b = np.einsum("mij,mj->mi", adjugate(rays_b[:, :3]), rays_b[:, 3])
    factors = lengths_b * np.roll(lengths_a, 1, axis=1) * np.roll(lengths_a, 2, axis=1)
    return np.asarray(np.einsum("mki,mk,mkj->mij", rays_b[:, :3], factors, adjugate(rays_a[:, :3])))


def adjugate(rows: FloatArray) -> FloatArray:
    """det · inverse (m, 3, 3) of the matrices whose columns are ``rows`` (m, 3, 3)."""
    one, two, three = np.moveaxis(rows, 1, 0)
    return np.stack([cross(two, three), cross(three, one), cross(one, two)], axis=1)


def significance_of_points(a: Bundle, b: Bundle, homography: Homography, fitted: BoolArray) -> FloatArray:
    """Σ (v/σ)² (n,) that each pair of rays adds to a fit: χ² of two where it belongs to it.

    ``fitted`` (n,) are the pairs that ``homography`` rests on; of them it is what the fit loses without the pair. The
    errors of the collineation itself count.
    """
    corrections = np.zeros((len(a), 4))
    for _ in range(3):
        design, residuals, corrections = _conditions(a, b, homography.matrix, corrections)
    rows = design.reshape(-1, 2, 9)
    of_fit = rows @ homography.covariance @ np.swapaxes(rows, 1, 2)
    covariance = np.eye(2) + np.where(fitted, -1.0, 1.0)[:, None, None] * of_fit
    values, axes = tolerant.eigh(covariance)
    along = np.einsum("nji,nj->ni", axes, residuals.reshape(-1, 2))
    return np.asarray(np.sum(along**2 / np.maximum(values, UNCONTROLLED), axis=1))


class Turn(NamedTuple):
    """The rotation between two bundles from one centre."""

    rotation: FloatArray
    """(3, 3) D*."""
    objective: float
    """Σ (v/σ)² of the same conditions as those of the collineation, which has five more unknowns."""
    covariance: FloatArray
    """(3, 3) of a small rotation δ of D*, for the a-priori σ of the rays."""


def fit_turn(a: Bundle, b: Bundle, iterations: int = 10) -> Turn:
    """Adjust H = D*, a pure rotation, to n ≥ 2 homologous rays: what is left when there is no base."""
    rotation = nearest_rotation(b.directions.T @ a.directions)
    corrections = np.zeros((len(a), 4))
    normal = np.eye(3)
    for _ in range(iterations):
        design, residuals, corrections = _conditions(a, b, rotation, corrections)
        rows = design @ -np.stack([(cross_matrix(axis) @ rotation).ravel() for axis in np.eye(3)], axis=1)
        normal = rows.T @ rows
        step = tolerant.lstsq(rows, -residuals, rcond=None)
        rotation = rotate(rotation, np.asarray(step, dtype=np.float64))
        if float(np.max(np.abs(step))) < 1e-13:
            break
    residuals = _conditions(a, b, rotation, corrections)[1]
    covariance = np.asarray(tolerant.pinv(normal, hermitian=True), dtype=np.float64)
    return Turn(rotation, float(residuals @ residuals), covariance)


def significance_of_gaps(homography: Homography) -> float:
    """The smaller of ln(σ1/σ2) and ln(σ2/σ3) of the singular values of H, in units of its standard deviation.

    Where two singular values are equal both centres lie on one normal of the plane.
    """
    left, values, right = tolerant.svd(homography.matrix)
    slopes = [np.outer(left[:, k], right[k]).ravel() / values[k] for k in range(3)]
    gaps: list[float] = []
    for k in (0, 1):
        slope = slopes[k] - slopes[k + 1]
        sigma = np.sqrt(max(float(slope @ homography.covariance @ slope), 1e-300))
        gaps.append(float(np.log(values[k] / values[k + 1])) / sigma)
    return float(min(gaps))


def linear_homography(a: Bundle, b: Bundle) -> FloatArray:
    """H (3, 3) at norm one from the homogeneous system Tᵀ H p' = 0, T the two axes across p''."""
    start, target = unit(a.rays), unit(b.rays)
    turn_a, turn_b = _whitening(start), _whitening(target)
    start, target = unit(start @ turn_a.T), unit(target @ turn_b.T)
    rows = np.einsum("nij,nk->njik", tangent_axes(target), start).reshape(-1, 9)
    solution = principal_rows(rows)[1][8].reshape(3, 3)
    matrix = tolerant.solve(turn_b, solution @ turn_a)
    return np.asarray(matrix / np.linalg.norm(matrix))


def scaled_homography(matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> tuple[FloatArray, bool]:
    """H with middle singular value 1 and p''· H p' > 0 for most points; and whether for all of them.

    Where the middle one is round-off the largest one is held in the range of numbers.
    """
    largest, middle, _ = tolerant.singular_values(matrix)
    scaled = matrix / max(middle, _ROUND_OFF * largest)
    signs = np.einsum("ni,ni->n", rays_a @ scaled.T, rays_b)
    if np.sum(signs > 0.0) * 2 < len(signs):
        scaled, signs = -scaled, -signs
    return scaled, bool(np.all(signs > 0.0))


def _whitening(directions: FloatArray) -> FloatArray:
    # Narrow bundles: bring the spread of the rays across their mean to the size of the mean (regular matrix).
    values, axes = tolerant.eigh(directions.T @ directions / len(directions))
    return np.asarray(axes.T / np.sqrt(np.maximum(values, 1e-6 * values[2]))[:, None])


def _regular(spread: FloatArray) -> FloatArray:
    """Matrices (n, 2, 2) that can be inverted: what a collineation carries nowhere keeps a spread of round-off."""
    trace = spread[:, 0, 0] + spread[:, 1, 1]
    nowhere = spread[:, 0, 0] * spread[:, 1, 1] - spread[:, 0, 1] ** 2 <= _ROUND_OFF * trace**2
    return spread + np.where(nowhere, _ROUND_OFF * trace, 0.0)[:, None, None] * np.eye(2)


def _conditions(
    a: Bundle, b: Bundle, matrix: FloatArray, corrections: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rays_a = a.rays + np.einsum("nij,nj->ni", a.whitened_axes, corrections[:, :2])
    rays_b = b.rays + np.einsum("nij,nj->ni", b.whitened_axes, corrections[:, 2:])
    across = tangent_axes(rays_b)
    image = rays_a @ matrix.T
    factor = np.einsum("ni,ni->n", image, rays_b) / np.einsum("ni,ni->n", rays_b, rays_b)
    by_a = np.einsum("nij,ik,nkl->njl", across, matrix, a.whitened_axes)
    by_b = -factor[:, None, None] * np.einsum("nij,nil->njl", across, b.whitened_axes)
    slopes = np.concatenate([by_a, by_b], axis=2)
    condition = np.einsum("nij,ni->nj", across, image) - np.einsum("njl,nl->nj", slopes, corrections)
    root = tolerant.cholesky(_regular(slopes @ np.swapaxes(slopes, 1, 2)))
    whiten = tolerant.inv(root)
    residuals = np.einsum("njl,nl->nj", whiten, condition)
    rows = np.einsum("nij,nk->njik", across, rays_a).reshape(-1, 2, 9)
    design = (whiten @ rows).reshape(-1, 9)
    adjusted = -np.einsum("njl,njk,nk->nl", slopes, whiten, residuals)
    return design, residuals.ravel(), adjusted
