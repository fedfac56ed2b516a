"""Two images of a plane object: homography and Killian's solution."""

from __future__ import annotations

from enum import Enum
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.model import rotations
from mor.model.rotations import cross_matrix, rotate
from mor.start.bundle import BY_ITSELF, Bundle, cross, principal_rows, tangent_axes, unit
from mor.start.relative_orientation import nearest_rotation
from mor.types import BoolArray, FloatArray, IntArray

# ---- The collineation between two bundles that see a plane: p'' ~ H p' (four points and more).
#
# For a plane n · X = d in frame A and X_B = D* (X_A − b): H ~ D* (1 − b nᵀ/d). H is given its middle singular
# value as scale and the sign that keeps the points in front of both frames; then H = D* (1 − b nᵀ/d) exactly.


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


def fit_homography(a: Bundle, b: Bundle) -> Homography:
    """Adjust H to n ≥ 4 homologous rays; errors of both bundles, 2 conditions per point, linear start.

    Four points of which no three are collinear fix H exactly (redundancy 0).
    """
    matrix = linear_homography(a, b)
    residuals = np.zeros(2 * len(a))
    corrections = np.zeros((len(a), 4))
    for _ in range(10):
        design, residuals, corrections = _conditions(a, b, matrix, corrections)
        scale = matrix.ravel() / np.linalg.norm(matrix)
        # The scale of H is no unknown: H → 0 would satisfy every condition.
        step = rotations.lstsq(design - np.outer(design @ scale, scale), -residuals, rcond=1e-12)
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
    """Covariance of the elements of H at norm one; their common scale, which is no unknown, is held."""
    scale = matrix.ravel() / np.linalg.norm(matrix)
    rows = design - np.outer(design @ scale, scale)
    normal = rows.T @ rows
    held = normal + np.trace(normal) * np.outer(scale, scale)
    return np.asarray(rotations.pinv(held, rcond=1e-17, hermitian=True), dtype=np.float64)


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
    quadratic = spread[..., 1, 1] * one**2 - 2.0 * spread[..., 0, 1] * one * other + spread[..., 0, 0] * other**2
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
    values, axes = rotations.eigh(covariance)
    along = np.einsum("nji,nj->ni", axes, residuals.reshape(-1, 2))
    # Redundancy of a coordinate below which the fit follows it, whatever it is.
    return np.asarray(np.sum(along**2 / np.maximum(values, 1e-6), axis=1))


class BundleRotation(NamedTuple):
    """The rotation between two bundles from one centre."""

    rotation: FloatArray
    """(3, 3) D*."""
    objective: float
    """Σ (v/σ)² of the same conditions as those of the collineation, which has five more unknowns."""
    covariance: FloatArray
    """(3, 3) of a small rotation δ of D*, for the a-priori σ of the rays."""


def fit_turn(a: Bundle, b: Bundle) -> BundleRotation:
    """Adjust H = D*, a pure rotation, to n ≥ 2 homologous rays: what is left when there is no base."""
    rotation = nearest_rotation(b.directions.T @ a.directions)
    corrections = np.zeros((len(a), 4))
    normal = np.eye(3)
    for _ in range(10):
        design, residuals, corrections = _conditions(a, b, rotation, corrections)
        rows = design @ -np.stack([(cross_matrix(axis) @ rotation).ravel() for axis in np.eye(3)], axis=1)
        normal = rows.T @ rows
        step = rotations.lstsq(rows, -residuals, rcond=None)
        rotation = rotate(rotation, np.asarray(step, dtype=np.float64))
        if float(np.max(np.abs(step))) < 1e-13:
            break
    residuals = _conditions(a, b, rotation, corrections)[1]
    covariance = np.asarray(rotations.pinv(normal, hermitian=True), dtype=np.float64)
    return BundleRotation(rotation, float(residuals @ residuals), covariance)


def significance_of_gaps(homography: Homography) -> float:
    """The smaller of ln(σ1/σ2) and ln(σ2/σ3) of the singular values of H, in units of its standard deviation.

    Where two singular values are equal both centres lie on one normal of the plane.
    """
    left, values, right = rotations.svd(homography.matrix)
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
    matrix = rotations.solve(turn_b, solution @ turn_a)
    return np.asarray(matrix / np.linalg.norm(matrix))


def scaled_homography(matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> tuple[FloatArray, bool]:
    """H with middle singular value 1 and p''· H p' > 0 for most points; and whether for all of them.

    Where the middle one is round-off the largest one is held in the range of numbers.
    """
    largest, middle, _ = rotations.singular_values(matrix)
    scaled = matrix / max(middle, _ROUND_OFF * largest)
    signs = np.einsum("ni,ni->n", rays_a @ scaled.T, rays_b)
    if np.sum(signs > 0.0) * 2 < len(signs):
        scaled, signs = -scaled, -signs
    return scaled, bool(np.all(signs > 0.0))


def _whitening(directions: FloatArray) -> FloatArray:
    # Narrow bundles: bring the spread of the rays across their mean to the size of the mean (regular matrix).
    values, axes = rotations.eigh(directions.T @ directions / len(directions))
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
    root = rotations.cholesky(_regular(slopes @ np.swapaxes(slopes, 1, 2)))
    whiten = rotations.inv(root)
    residuals = np.einsum("njl,nl->nj", whiten, condition)
    rows = np.einsum("nij,nk->njik", across, rays_a).reshape(-1, 2, 9)
    design = (whiten @ rows).reshape(-1, 9)
    adjusted = -np.einsum("njl,njk,nk->nl", slopes, whiten, residuals)
    return design, residuals.ravel(), adjusted


# ---- Shape of a plane quadrilateral from two images, no orientation known (K. Killian).
#
# S is the crossing of the diagonals 12 and 34. From an image come the angles at the projection centre O: α1, α2
# between S and 1, 2; β1, β2 between S and 3, 4; and k = cos of the angle of the two diagonal planes at OS.
# Unknown are the angles φ, ψ at S between SO and S1, S3, and the distance r = OS; the second image has bars,
# here an index: image "a" has r = 1, image "b" has r² = ϱ. Both see the same a1, a2, b1, b2 (sine rule) and
# the same angle α of the diagonals, which gives
#
#     cot φ_b = C1 cot φ_a + K1,      cot ψ_b = C2 cot ψ_a + K2                                       (1a), (1b)
#     sin φ_b = (r/C1) sin φ_a,       sin ψ_b = (r/C2) sin ψ_a                                        (2a), (2b)
#     cot φ_a cot ψ_a + k_a = ϱ/(C1 C2) (cot φ_b cot ψ_b + k_b)                                        (7)
#     (1 − ϱ) cot² φ_b − 2 K1 cot φ_b + G1 − ϱ = 0,   G1 = C1² + K1²                                  (8a), (8b)
#
# Elimination of the cotangents: with R0 = K1 K2 + k_a C1 C2 − ϱ k_b and R_i = K_i² − (1 − ϱ)(G_i − ϱ)
#
#     √R1 √R2 = K1 K2 − (1 − ϱ) R0                                                                     (*)
#
# squared and divided by (1 − ϱ) is the cubic (9). Its roots are always real and positive: ϱ_i = |H s|²/σ_i²
# with the collineation H of the bundles, s the unit ray to S, and σ_i the singular values of H. Only for the
# middle one are R1 and R2 not negative, so the cotangents are real: two solutions, one where R1 = R2 = 0.

REAL = 1e-5
"""Relative size below which the imaginary part of a root, or a negative R1 or R2, is taken for rounding."""


class QuadrilateralAngles(NamedTuple):
    """Angles of one image of the quadrilateral."""

    cot_first: FloatArray
    """(2,) cot α1, cot α2 of the diagonal 12."""
    cot_second: FloatArray
    """(2,) cot β1, cot β2 of the diagonal 34."""
    k: float
    """cos of the angle between the planes OS1 and OS3."""
    crossing: FloatArray
    """(3,) unit ray to S."""


class Linking(NamedTuple):
    """Constants that link the two images, (1'a), (1'b)."""

    c1: float
    k1: float
    c2: float
    k2: float
    k_a: float
    k_b: float

    @property
    def g1(self) -> float:
        """G1 = C1² + K1²."""
        return self.c1**2 + self.k1**2

    @property
    def g2(self) -> float:
        """G2 = C2² + K2²."""
        return self.c2**2 + self.k2**2


class Quadrilateral(NamedTuple):
    """One solution, in units of r = OS of image a."""

    r_b: float
    """Distance of S from the second projection centre."""
    cot_phi: FloatArray
    """(2,) cot φ in image a, b."""
    cot_psi: FloatArray
    """(2,) cot ψ in image a, b."""
    cos_alpha: float
    """Cosine of the angle α of the half diagonals S1 and S3 (5)."""
    halves: FloatArray
    """(4,) a1, a2, b1, b2: distances of the corners 1 to 4 from S; a2, b2 on the far side of S."""
    misclosure: float
    """Relative misclosure of the unsquared equation (7)."""
    admissible: bool
    """True if all four corners lie in front of both images."""


def angles_in_image(corners: FloatArray) -> QuadrilateralAngles:
    """Angles at O from the rays (4, 3) to the corners 1, 2, 3, 4; 12 and 34 are the diagonals.

    The diagonals must cross between the corners in the image (a convex quadrilateral, rightly paired).
    """
    one, two, three, four = unit(corners)
    plane_12, plane_34 = cross(one, two), cross(three, four)
    crossing = unit(cross(plane_12, plane_34))
    if crossing @ (one + two + three + four) < 0.0:
        crossing = -crossing
    across = cross(crossing, np.stack([one, two, three, four]))
    cotangents = [
        float(crossing @ ray) / max(float(np.linalg.norm(beside)), 1e-300)
        for ray, beside in zip((one, two, three, four), across, strict=True)
    ]
    across_one, across_three = one - (one @ crossing) * crossing, three - (three @ crossing) * crossing
    k = float(unit(across_one) @ unit(across_three))
    return QuadrilateralAngles(np.array(cotangents[:2]), np.array(cotangents[2:]), k, crossing)


def diagonals_cross(corners: FloatArray) -> bool:
    """True if the diagonals 12 and 34 of rays (4, 3) meet between their ends, in front."""
    one, two, three, four = unit(corners)
    crossing = angles_in_image(corners).crossing
    between = [
        float(cross(crossing, first) @ cross(crossing, second)) < 0.0 and float(crossing @ (first + second)) > 0.0
        for first, second in ((one, two), (three, four))
    ]
    return all(between)


def linking_constants(a: QuadrilateralAngles, b: QuadrilateralAngles) -> Linking:
    """C1, K1 from the diagonal 12, C2, K2 from 34 (1'a), (1'b)."""
    c1, k1 = _constants(a.cot_first, b.cot_first)
    c2, k2 = _constants(a.cot_second, b.cot_second)
    return Linking(c1, k1, c2, k2, a.k, b.k)


def _constants(cot_a: FloatArray, cot_b: FloatArray) -> tuple[float, float]:
    total = cot_a[0] + cot_a[1]
    return float((cot_b[0] + cot_b[1]) / total), float((cot_a[0] * cot_b[1] - cot_b[0] * cot_a[1]) / total)


def cubic(link: Linking) -> FloatArray:
    """Coefficients (4,) of (9), highest power of ϱ first, with the sign of the errata in the coefficient of ϱ."""
    square, total = link.k_b**2 - 1.0, link.g1 + link.g2
    h, product = link.k1 * link.k2 + link.k_a * link.c1 * link.c2, link.g1 * link.g2
    k12, k_b = link.k1 * link.k2, link.k_b
    return np.array(
        [
            square,
            total - square - 2.0 * h * k_b,
            link.k1**2 + link.k2**2 + 2.0 * h * k_b - 2.0 * k12 * k_b - total - (product - h**2),
            product - h**2 + 2.0 * k12 * h - link.k1**2 * link.g2 - link.k2**2 * link.g1,
        ]
    )


def cubic_roots(link: Linking) -> FloatArray:
    """All real roots ϱ of (9), ascending; nearly double roots are kept although rounding may part them."""
    roots = np.roots(cubic(link))
    real = roots[np.abs(roots.imag) <= REAL * (1.0 + np.abs(roots))].real
    return np.asarray(np.sort(real))


def solve_quadrilateral(corners_a: FloatArray, corners_b: FloatArray) -> list[Quadrilateral]:
    """All solutions for the rays (4, 3) to the corners in two images; diagonals 12 and 34.

    Every real root of the cubic is put back, with both signs of the roots in (8a) and (8b), into the
    unsquared (7) and (2a), (2b). Admissible solutions come first. The list is empty where the corners make
    no quadrilateral.
    """
    if not diagonals_cross(corners_a) or not diagonals_cross(corners_b):
        return []
    angles_a, angles_b = angles_in_image(corners_a), angles_in_image(corners_b)
    link = linking_constants(angles_a, angles_b)
    if not np.all(np.isfinite(link)) or link.c1 <= 0.0 or link.c2 <= 0.0:
        return []
    found: list[Quadrilateral] = []
    for rho in cubic_roots(link):
        if rho <= 0.0:
            continue
        roots_phi = _quadratic(1.0 - rho, link.k1, link.g1 - rho)
        roots_psi = _quadratic(1.0 - rho, link.k2, link.g2 - rho)
        for cot_phi_b, cot_psi_b in product(roots_phi, roots_psi):
            candidate = _complete(link, angles_a, angles_b, float(rho), cot_phi_b, cot_psi_b)
            # Misclosure of the unsquared (7), relative to its terms, up to which a candidate is a solution.
            if candidate.misclosure < 1e-5 and not any(_same(candidate, other) for other in found):
                found.append(candidate)
    return sorted(found, key=lambda solution: not solution.admissible)


def _quadratic(leading: float, half: float, constant: float) -> list[float]:
    """Real roots of leading x² − 2 half x + constant = 0, also for a vanishing leading coefficient."""
    discriminant = half**2 - leading * constant
    if discriminant < -REAL * (half**2 + abs(leading * constant)):
        return []
    larger = half + np.copysign(np.sqrt(max(discriminant, 0.0)), half)
    roots = []
    if larger != 0.0:
        roots.append(constant / larger)
    if abs(leading) > 1e-14 * abs(larger):
        roots.append(larger / leading)
    elif larger == 0.0:
        roots.append(0.0)
    return roots


def _complete(
    link: Linking, a: QuadrilateralAngles, b: QuadrilateralAngles, rho: float, cot_phi_b: float, cot_psi_b: float
) -> Quadrilateral:
    cot_phi_a, cot_psi_a = (cot_phi_b - link.k1) / link.c1, (cot_psi_b - link.k2) / link.c2
    factor = rho / (link.c1 * link.c2)
    left, right = cot_phi_a * cot_psi_a + link.k_a, factor * (cot_phi_b * cot_psi_b + link.k_b)
    terms = 1.0 + abs(cot_phi_a * cot_psi_a) + factor * (1.0 + abs(cot_phi_b * cot_psi_b))
    sine_phi, sine_psi = 1.0 / np.hypot(1.0, cot_phi_a), 1.0 / np.hypot(1.0, cot_psi_a)
    roots = [
        abs(np.sqrt(rho) / c * sine * np.hypot(1.0, cot) - 1.0)
        for c, sine, cot in ((link.c1, sine_phi, cot_phi_b), (link.c2, sine_psi, cot_psi_b))
    ]
    halves = np.concatenate([_halves(a.cot_first, cot_phi_a), _halves(a.cot_second, cot_psi_a)])
    in_b = np.concatenate([_halves(b.cot_first, cot_phi_b), _halves(b.cot_second, cot_psi_b)])
    return Quadrilateral(
        r_b=float(np.sqrt(rho)),
        cot_phi=np.array([cot_phi_a, cot_phi_b]),
        cot_psi=np.array([cot_psi_a, cot_psi_b]),
        cos_alpha=float(sine_phi * sine_psi * left),
        halves=halves,
        misclosure=float(max(abs(left - right) / terms, *roots)),
        admissible=bool(np.all(halves > 0.0) and np.all(in_b > 0.0)),
    )


def _halves(cot: FloatArray, cot_at_crossing: float) -> FloatArray:
    """a1 = sin α1 / sin(φ + α1), a2 = sin α2 / sin(φ − α2) for r = 1; negative for a corner behind O."""
    with np.errstate(divide="ignore"):
        sine = 1.0 / np.hypot(1.0, cot_at_crossing)
        return np.asarray(1.0 / (sine * np.array([cot[0] + cot_at_crossing, cot[1] - cot_at_crossing])))


def _same(first: Quadrilateral, second: Quadrilateral) -> bool:
    near = np.abs(np.array([first.r_b - second.r_b, *(first.cot_phi - second.cot_phi)]))
    also = np.abs(first.cot_psi - second.cot_psi)
    return bool(np.all(near < 1e-9 * (1.0 + first.r_b)) and np.all(also < 1e-9 * (1.0 + np.abs(first.cot_psi))))


def corners_in_frame(corners: FloatArray, solution: Quadrilateral, image: int) -> FloatArray:
    """Corners (4, 3) in the frame of image 0 or 1, from the rays (4, 3) of that image."""
    angles = angles_in_image(corners)
    r = (1.0, solution.r_b)[image]
    phi, psi = solution.cot_phi[image], solution.cot_psi[image]
    rays = unit(corners)
    cot = np.concatenate([angles.cot_first, angles.cot_second])
    at_crossing = np.array([phi, -phi, psi, -psi])
    # O1 = sin φ / sin(φ + α1), and with φ, α as cotangents: √(1 + cot² α) / (cot α + cot φ).
    return np.asarray(rays * (r * np.hypot(1.0, cot) / (cot + at_crossing))[:, None])


# ---- Two images of a plane object: from four or more rays to the orientation and the plane, by Killian's
# quadrilateral.
#
# With more than four points all of them fix the collineation of the bundles; a quadrilateral inside the field
# of the points is then carried over by it, so that every point has its share in the shape.

COLLINEAR = 3.0
"""A field of points thinner than so many σ of a ray is a line."""


class PlaneOutcome(Enum):
    """Outcome of the orientation of two images of a plane object."""

    UNIQUE = "one solution is visible"
    AMBIGUOUS = "several shapes fit both images; another image, a known angle or a length ratio decides between them"
    TOO_FEW = "fewer than four points"
    INVALID = "a ray is zero or not a number"
    COLLINEAR = "three of four points, or all points, are collinear"
    WEAK = (
        "one solution is visible, but so weakly determined that its standard deviations do not hold: use a longer "
        "base, more points or another image"
    )
    NO_BASE = "no base: the second image is the first one turned, to its precision; the shape of the plane is open"
    BASE_ALONG_NORMAL = (
        "critical configuration: both projection centres lie on one normal of the "
        "plane, or the measurements cannot exclude it; "
        "the two solutions coincide and errors of the image coordinates enter with their square root"
    )
    NOT_VISIBLE = (
        "no solution has all points in front of both images: mirrored coordinates, mismatched points, or a shape that "
        "the measurements leave open"
    )
    NOT_PLANE = "the points do not lie in one plane, or identities are mismatched"

    @property
    def usable(self) -> bool:
        """True if the solution, or one of several, can serve as a start value."""
        return self in (PlaneOutcome.UNIQUE, PlaneOutcome.AMBIGUOUS, PlaneOutcome.WEAK, PlaneOutcome.BASE_ALONG_NORMAL)


class PlaneOrientation(NamedTuple):
    """Plane and second frame in the first one; unit of length: the distance of the plane from A, n · X = 1."""

    normal: FloatArray
    """(3,) unit normal n in A, pointing from A to the plane."""
    base: FloatArray
    """(3,) b; its length is in units of the distance of the plane."""
    rotation: FloatArray
    """(3, 3) D*."""
    front: int
    """Number of points in front of both images."""


class PlaneSolutions(NamedTuple):
    """All orientations of a plane object, visible ones first; without a base the rotation alone."""

    outcome: PlaneOutcome
    solutions: list[PlaneOrientation]
    homography: Homography | None


def planar_orientations(a: Bundle, b: Bundle) -> PlaneSolutions:
    """All solutions for n ≥ 4 homologous rays of a plane object; degenerate cases named in the outcome."""
    if len(a) < 4:
        return PlaneSolutions(PlaneOutcome.TOO_FEW, [], None)
    if not _valid(a) or not _valid(b):
        return PlaneSolutions(PlaneOutcome.INVALID, [], None)
    if _thin(a) or _thin(b) or (len(a) == 4 and (_three_in_line(a) or _three_in_line(b))):
        return PlaneSolutions(PlaneOutcome.COLLINEAR, [], None)
    homography = fit_homography(a, b)
    if homography.objective > misfit_limit(homography.redundancy):
        return PlaneSolutions(PlaneOutcome.NOT_PLANE, [], homography)
    turn = fit_turn(a, b)
    variance = max(1.0, homography.objective / max(homography.redundancy, 1))
    # Unknowns that a collineation has and a rotation has not.
    if turn.objective - homography.objective < variance * float(chdtri(5, BY_ITSELF)):
        standing = PlaneOrientation(np.full(3, np.nan), np.zeros(3), turn.rotation, 0)
        return PlaneSolutions(PlaneOutcome.NO_BASE, [standing], homography)
    solutions = solutions_of_homography(homography.matrix, a.rays, b.rays)
    # Standard deviations by which singular values of the collineation differ where the dangerous locus is excluded.
    along = significance_of_gaps(homography) < 5.0
    if along and not any(one.front == len(a) for one in solutions):
        solutions = [along_normal(homography.matrix, a.rays, b.rays)]
    return PlaneSolutions(_outcome(homography, solutions, along, len(a)), solutions, homography)


def misfit_limit(redundancy: int) -> float:
    """Value of Σ (v/σ)² beyond which the model does not hold: expectation plus five standard deviations, σ doubled."""
    return float(4.0 * (redundancy + 5.0 * np.sqrt(2.0 * redundancy) + 1.0))


def solutions_of_homography(matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> list[PlaneOrientation]:
    """Orientations from a collineation H (3, 3) by Killian's cubic, those that see all the rays (n, 3) first."""
    corners = corners_within(rays_a)
    image = corners @ matrix.T
    found = []
    for solution in solve_quadrilateral(corners, image):
        in_a, in_b = corners_in_frame(corners, solution, 0), corners_in_frame(image, solution, 1)
        found.append(_orientation(in_a, in_b, rays_a, rays_b))
    return sorted(found, key=lambda orientation: -orientation.front)


def _orientation(in_a: FloatArray, in_b: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> PlaneOrientation:
    centre_a, centre_b = in_a.mean(axis=0), in_b.mean(axis=0)
    rotation = nearest_rotation((in_b - centre_b).T @ (in_a - centre_a))
    normal = principal_rows(in_a - centre_a)[1][2]
    distance = float(normal @ centre_a)
    if distance < 0.0:
        normal, distance = -normal, -distance
    base = (centre_a - rotation.T @ centre_b) / distance
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def corners_within(rays: FloatArray) -> FloatArray:
    """Quadrilateral (4, 3) of rays inside the field of the rays (n, 3), convex; 12 and 34 are its diagonals.

    Of the hull of the field the four corners of largest area; of a triangle a
    trapezoid.
    """
    directions = unit(rays)
    # Coordinates (n, 2) that keep straight lines straight: the rays cut by a plane they all reach.
    axis = unit(directions.sum(axis=0))
    if float(np.min(directions @ axis)) < 0.1:
        axis = _facing_axis(directions)
    across = rotations.svd(axis[None, :])[2][1:]
    flat = np.asarray((directions @ across.T) / np.maximum(directions @ axis, 1e-6)[:, None])
    hull = convex_hull(flat)
    if len(hull) == 3:
        one, two, three = directions[hull]
        return np.stack([one, unit(two + three), two, unit(one + three)])
    best, chosen = -1.0, ((0, 0), (0, 0))
    for i in range(len(hull)):
        for j in range(i + 2, len(hull)):
            line = flat[hull[j]] - flat[hull[i]]
            offset = flat[hull] - flat[hull[i]]
            side = line[0] * offset[:, 1] - line[1] * offset[:, 0]
            low, high = int(np.argmin(side)), int(np.argmax(side))
            area = side[high] - side[low] if side[low] < 0.0 < side[high] else -1.0
            if area > best:
                best, chosen = float(area), ((int(hull[i]), int(hull[j])), (int(hull[high]), int(hull[low])))
    first, second = chosen
    return np.asarray(directions[[first[0], first[1], second[0], second[1]]])


def _facing_axis(directions: FloatArray) -> FloatArray:
    """Direction (3,) that the rays (n, 3) are least far from: they fill less than a half-space if it is a plane.

    Largest t with p · a ≥ t, |a_i| ≤ 1, a linear programme.
    """
    from scipy.optimize import linprog  # slow to import, and only very wide fields come here

    bound = np.column_stack([-directions, np.ones(len(directions))])
    limits = [(-1.0, 1.0)] * 3 + [(None, None)]
    found = linprog([0.0, 0.0, 0.0, -1.0], A_ub=bound, b_ub=np.zeros(len(directions)), bounds=limits)
    if found.x is None:  # never: zero is feasible
        return unit(directions.sum(axis=0))
    return unit(np.asarray(found.x[:3], dtype=float))


def convex_hull(points: FloatArray) -> IntArray:
    """Indices of the convex hull of points (n, 2), counter-clockwise (A. M. Andrew's chains)."""
    order = np.lexsort((points[:, 1], points[:, 0]))
    chains: list[list[int]] = []
    for sequence in (order, order[::-1]):
        chain: list[int] = []
        for index in sequence:
            while len(chain) > 1 and _turn(points[chain[-2]], points[chain[-1]], points[index]) <= 0.0:
                chain.pop()
            chain.append(int(index))
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1], dtype=np.int64)


def _turn(first: FloatArray, second: FloatArray, third: FloatArray) -> float:
    one, two = second - first, third - first
    return float(one[0] * two[1] - one[1] * two[0])


def _valid(bundle: Bundle) -> bool:
    return bool(np.all(np.isfinite(bundle.rays)) and np.all(np.linalg.norm(bundle.rays, axis=1) > 0.0))


def _thin(bundle: Bundle) -> bool:
    return thickness(bundle) < COLLINEAR * bundle.noise


def thickness(bundle: Bundle) -> float:
    """Root mean square distance (radians) of the rays from the plane that fits them best: 0 for a line of points."""
    values = rotations.singular_values(bundle.directions)
    return float(values[2] / np.sqrt(len(bundle)))


def _three_in_line(bundle: Bundle) -> bool:
    directions = bundle.directions
    return any(
        thickness(bundle.take(np.delete(np.arange(4), k))) < COLLINEAR * bundle.noise for k in range(len(directions))
    )


def along_normal(matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> PlaneOrientation:
    """Both centres on one normal n, H = D* (1 − β n nᵀ): n belongs to the singular value that stands alone."""
    _, values, right = rotations.svd(matrix)
    alone = 2 if values[0] / values[1] < values[1] / values[2] else 0
    pair = float(np.sqrt(np.prod(np.delete(values, alone))))
    normal = right[alone] * np.where(np.sum(rays_a @ right[alone]) < 0.0, -1.0, 1.0)
    distance_b = float(values[alone]) / pair * float(np.sign(np.linalg.det(matrix)))
    base = (1.0 - distance_b) * normal
    rotation = nearest_rotation(matrix @ (np.eye(3) + np.outer(normal, normal) * (1.0 / distance_b - 1.0)))
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def under_normal(matrix: FloatArray, normal: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> PlaneOrientation:
    """Orientation from a collineation H (3, 3) of a plane whose unit ``normal`` in A is known: H t = D* t across it."""
    across = tangent_axes(normal)
    carried = matrix @ across
    scale = float(np.linalg.norm(carried) / np.sqrt(2.0))
    both = np.column_stack([across, normal])
    image = np.column_stack([carried, np.cross(carried[:, 0], carried[:, 1]) / scale])
    rotation = nearest_rotation(image @ both.T * np.linalg.det(both))
    base = normal - rotation.T @ matrix @ normal / scale
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def _in_front(
    normal: FloatArray, base: FloatArray, rotation: FloatArray, rays_a: FloatArray, rays_b: FloatArray
) -> int:
    side_of_b = np.sign(1.0 - float(normal @ base))
    return int(np.sum((rays_a @ normal > 0.0) & ((rays_b @ (rotation @ normal)) * side_of_b > 0.0)))


def _outcome(homography: Homography, solutions: list[PlaneOrientation], along: bool, points: int) -> PlaneOutcome:
    visible = sum(solution.front == points for solution in solutions)
    if not homography.same_side or visible == 0:
        return PlaneOutcome.NOT_VISIBLE
    if along:
        return PlaneOutcome.BASE_ALONG_NORMAL
    return PlaneOutcome.UNIQUE if visible == 1 else PlaneOutcome.AMBIGUOUS
