"""Relative orientation of two images: Rinner's solution, five points, coplanarity."""

from __future__ import annotations

from enum import Enum
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.rotations import cross_matrix, exponential, rotate
from mor.start.bundle import Bundle, cross, principal_rows, sphere, tangent_axes, unit
from mor.types import BoolArray, FloatArray

# ---- What became of a relative orientation, as data.


class RelativeOutcome(Enum):
    """Outcome of a relative orientation."""

    DETERMINED = "one orientation fits, with all points in front of both bundles"
    AMBIGUOUS = (
        "several orientations fit equally well; another image, a distance or a known attitude decides between them"
    )
    WEAK = (
        "the orientation fits, but so weakly that its standard deviations do not hold: use a longer base or better "
        "distributed points"
    )
    TOO_FEW = "fewer than eight homologous points"
    INVALID = "a ray is zero or not a number, or the bundles differ in length"
    COLLINEAR = "the points are collinear in one or both of the bundles"
    IDENTICAL = "the two bundles are identical: the same image twice"
    NO_BASE = "no base: the second bundle is the first one turned; its attitude is known, the base is open"
    BEHIND = "no orientation has the points in front of both bundles: wrong pairs, or a camera looking away"
    MIRRORED = "one bundle is mirrored: with its coordinates reversed the points would lie in front of both"
    DOES_NOT_FIT = "the rays do not meet within their precision: wrong pairs, a wrong focal length or a mirrored image"

    @property
    def usable(self) -> bool:
        """True if the orientation can serve as a start value."""
        return self in (RelativeOutcome.DETERMINED, RelativeOutcome.WEAK, RelativeOutcome.AMBIGUOUS)


class SceneGeometry(Enum):
    """Shape of the points, as far as it matters to the linear system (5)."""

    GENERAL = "points in general position"
    PLANE = "all points in one plane: the linear system loses three ranks; solved as a plane object"
    CRITICAL_SURFACE = (
        "points and both centres on a ruled quadric (critical surface) or nearly so: the linear system loses "
        "rank; solved with the compatibility conditions"
    )
    UNKNOWN = "not examined"


class OrientationCandidate(NamedTuple):
    """One of the four orientations that fulfil the coplanarity conditions alike."""

    base: FloatArray
    """(3,) unit vector in A."""
    rotation: FloatArray
    """(3, 3) D*."""
    in_front_of_a: int
    in_front_of_b: int
    in_front_of_both: int


class RelativeOrientation(NamedTuple):
    """Frame B in frame A: X_B = D* (X_A − b), |b| = 1."""

    outcome: RelativeOutcome
    geometry: SceneGeometry
    points: int
    base: FloatArray
    """(3,)"""
    rotation: FloatArray
    """(3, 3) D*."""
    angles: FloatArray
    """(3,) ω*, φ*, κ* in radians."""
    covariance: FloatArray
    """(6, 6) of b and the small rotation δ, for the a-priori σ of the rays; along b of second order."""
    sigma_base: FloatArray
    """(3,)"""
    sigma_angles: FloatArray
    """(3,) of ω*, φ*, κ* in radians; infinite at φ* = ±100 gon."""
    sigma0: float
    """√(Σ (v/σ)² / (n − 5)): 1 where the rays are as good as their σ."""
    residuals: FloatArray
    """(n,) residual coplanarity: signed length of the corrections of a pair, in units of σ."""
    front: BoolArray
    """(n, 2) the point is in front of A, of B."""
    candidates: tuple[OrientationCandidate, ...]
    """The four candidates, the chosen one first."""
    alternatives: tuple[OrientationCandidate, ...]
    """Other orientations that fit about as well, if the outcome is ambiguous."""
    unknowns: FloatArray
    """(3, 3) Rinner's ik of the adjusted orientation."""
    singular_values: FloatArray
    """(9,) of the linear system in units of σ, descending; the last belongs to the solution."""
    plane_orientations: tuple[OrientationCandidate, ...] = ()
    """Of points in one plane: the two orientations that carry it over, the one nearest to the result first."""

    @property
    def words(self) -> str:
        """Outcome in words, with what is special about the points."""
        general = self.geometry in (SceneGeometry.GENERAL, SceneGeometry.UNKNOWN)
        return self.outcome.value if general else f"{self.outcome.value} ({self.geometry.value})"


# ---- Relative orientation of two bundles without approximate values (K. Rinner, ÖZfV 44 (1956), 4–9).
#
# Homologous rays p' (frame A) and p'' (frame B) and the base b lie in one plane (4):
#
#     (p', p'', b) = 0     ⇒     p'ᵀ (ik) p'' = 0                                                        (5)
#
# with nine auxiliary unknowns ik = (e_i', e_k'', b) = e_i' · n_k, n_k = e_k'' × b                       (6)–(8)
#
# where e_k'' are the axes of B seen from A: the rows of D*, so that X_B = D* (X_A − b). All triads are
# right-handed and the third image coordinate is −c; the f of the paper points the other way. In the words of
# today (ik) = −[b]× D*ᵀ is the essential matrix: singular values 1, 1, 0 at the norm (14).


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
    return LinearSolution(right[8].reshape(3, 3) * np.sqrt(2.0), rows.T @ rows, values)


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
    left, _, right = rotations.svd(matrix)
    left = left.copy()
    left[..., :, 2] *= np.where(np.linalg.det(left @ right) < 0.0, -1.0, 1.0)[..., None]
    return np.asarray(left @ right)


# ---- The conditions among Rinner's auxiliary unknowns, and the corrections they give to the ik (Nr. 4).
#
# Nine unknowns and five parameters leave four conditions. The paper takes det(ik) = 0 (13), Σ ik² = 2 (14)
# and two of
#
#     |n_k|² + λ_k² = 1,  k = 1, 2, 3                                                                  (16)
#
# with λ_k² the square sum of column k of the adjoint. That set loses a rank exactly in the normal case (base
# along an axis of B): it is the diagonal of the matrix equation that the orthonormality of the e_k'' amounts
# to,
#
#     (ik)ᵀ(ik) + adjᵀ adj = 1        (n_k · n_l + λ_k λ_l = δ_kl)                                      (16*)
#
# and the diagonal alone does not see the shear of the two axes across the base. With (13) and all six of
# (16*) the rank is four for every orientation. (14), and (15) to first order, follow from (16*).


class Compatible(NamedTuple):
    """Auxiliary unknowns that fulfil all conditions."""

    ik: FloatArray
    """(3, 3)"""
    corrections: FloatArray
    """(3, 3) ik minus the unknowns they came from."""
    misclosure: float
    """Largest remaining misclosure of (13) and (16*)."""


def printed_conditions(ik: FloatArray) -> FloatArray:
    """Misclosures (6,) of (13), (14), (15) and the three (16), as the paper prints them."""
    cofactors = adjoint(ik)
    columns = np.sum(ik**2, axis=0) + np.sum(cofactors**2, axis=0) - 1.0
    return np.array([np.linalg.det(ik), np.sum(ik**2) - 2.0, np.sum(cofactors**2) - 1.0, *columns])


def conditions(ik: FloatArray) -> FloatArray:
    """Misclosures (7,) of (13) and the six of (16*)."""
    cofactors = adjoint(ik)
    matrix = ik.T @ ik + cofactors.T @ cofactors - np.eye(3)
    return np.concatenate([[np.linalg.det(ik)], matrix[np.triu_indices(3)]])


def conditions_by_unknowns(ik: FloatArray) -> FloatArray:
    """Derivatives (7, 9) of :func:`conditions` by the ik, row by row (13a), (16) differentiated."""
    changes = np.eye(9).reshape(9, 3, 3)
    cofactors = adjoint(ik)
    columns = [ik[:, k] for k in range(3)]
    moved = np.empty((9, 3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        moved[:, :, k] = cross(changes[:, :, i], columns[j]) + cross(columns[i], changes[:, :, j])
    half = np.einsum("mi,nmj->nij", ik, changes) + np.einsum("mi,nmj->nij", cofactors, moved)
    symmetric = half + np.swapaxes(half, 1, 2)
    upper = np.triu_indices(3)
    return np.vstack([cofactors.reshape(1, 9), symmetric[:, upper[0], upper[1]].T])


def compatible_unknowns(ik: FloatArray, normal: FloatArray) -> Compatible:
    """Corrections dik of least (dik)ᵀ N (dik) that make ``ik`` (3, 3) compatible; N the ``normal`` (9, 9)
    of (5).

    Gauss–Newton on the conditions; each step solves the least-squares problem with linearised conditions. The
    unit matrix as ``normal`` gives the nearest compatible unknowns.
    """
    weight = normal / max(np.trace(normal) / 9.0, np.finfo(float).tiny)
    start = ik.ravel()
    current = start
    for _ in range(20):
        current, change = _step(current, start, weight)
        if change < 1e-15:
            break
    matrix = current.reshape(3, 3)
    return Compatible(matrix, matrix - ik, float(np.max(np.abs(conditions(matrix)))))


def _step(current: FloatArray, start: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    matrix = current.reshape(3, 3)
    left, values, right = rotations.svd(conditions_by_unknowns(matrix))
    rows = right[:4]  # so many of the conditions are independent
    target = -(left[:, :4].T @ conditions(matrix)) / values[:4]
    system = np.zeros((13, 13))
    system[:9, :9], system[:9, 9:], system[9:, :9] = weight, rows.T, rows
    side = np.concatenate([weight @ (start - current), target])
    step = rotations.lstsq(system, side, rcond=None)[:9]
    length = float(np.linalg.norm(step))
    return current + step * min(1.0, 0.5 / max(length, 1e-300)), length


# ---- Rigorous adjustment of a relative orientation: image coordinates observed, one condition per point.
#
# Gauss–Helmert with the condition g = p'ᵀ (ik) p'' = p' · (u × b) = 0, u = D*ᵀ p'', and five parameters: two
# of the unit base b across itself, three of the small rotation δ of D* ← exp(−[δ]×) D*. The compatibility
# conditions hold by the choice of the parameters, which is the same adjustment as Rinner's n + 4 equations in
# ik (Nr. 4).
#
#     ∂g/∂δ = D* (u × (b × p')),    ∂g/∂b = p' × u,    ∂g/∂p' = u × b,    ∂g/∂p'' = D* (b × p')
#
# Conditions are linearised at the adjusted observations, so the result is the strict minimum of Σ (v/σ)².


class CoplanarityResiduals(NamedTuple):
    """Adjusted observations of given parameters."""

    residuals: FloatArray
    """(n,) signed length of the four corrections v/σ of a point."""
    corrections: FloatArray
    """(n, 4) v/σ: two measured coordinates in A, two in B."""
    rays_a: FloatArray
    rays_b: FloatArray
    """(n, 3) adjusted rays."""
    spread: FloatArray
    """(n,) standard deviation of the condition g."""


class Coplanarity(NamedTuple):
    """An adjusted relative orientation."""

    base: FloatArray
    """(3,) unit vector in A."""
    rotation: FloatArray
    """(3, 3) D*."""
    residuals: FloatArray
    """(n,) signed lengths of v/σ."""
    objective: float
    """Σ (v/σ)²."""
    normal: FloatArray
    """(5, 5) of the two base parameters (along ``base_axes``) and δ."""
    base_axes: FloatArray
    """(3, 2) the directions across the base that its two parameters run along."""
    converged: bool


def misfit(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> CoplanarityResiduals:
    """Smallest corrections to the rays of ``a`` and ``b`` (n each) that make them meet."""
    ik = auxiliary_unknowns(base, rotation)
    axes_a, axes_b = a.whitened_axes, b.whitened_axes
    corrections = np.zeros((len(a), 4))
    rays_a, rays_b = a.rays, b.rays
    # Iterations for the adjusted observations of given parameters; they gain six digits each at image noise.
    for _ in range(4):
        slopes = np.concatenate(
            [np.einsum("nij,ni->nj", axes_a, rays_b @ ik.T), np.einsum("nij,ni->nj", axes_b, rays_a @ ik)], axis=1
        )
        spread = np.sqrt(np.maximum(np.sum(slopes**2, axis=1), 1e-300))
        condition = np.einsum("ni,ni->n", rays_a @ ik, rays_b)
        residuals = (condition - np.sum(slopes * corrections, axis=1)) / spread
        corrections = -slopes * (residuals / spread)[:, None]
        rays_a = a.rays + np.einsum("nij,nj->ni", axes_a, corrections[:, :2])
        rays_b = b.rays + np.einsum("nij,nj->ni", axes_b, corrections[:, 2:])
    return CoplanarityResiduals(residuals, corrections, rays_a, rays_b, spread)


def first_order_residuals(a: Bundle, b: Bundle, ik: FloatArray) -> FloatArray:
    """Residuals v/σ (m, n) to first order for many sets of ik (m, 3, 3); positive, not iterated."""
    from_b = np.einsum("mij,nj->mni", ik, b.rays)
    from_a = np.einsum("mij,ni->mnj", ik, a.rays)
    condition = np.abs(np.einsum("mni,ni->mn", from_b, a.rays))
    variance = np.sum(np.einsum("nij,mni->mnj", a.whitened_axes, from_b) ** 2, axis=2)
    variance += np.sum(np.einsum("nij,mni->mnj", b.whitened_axes, from_a) ** 2, axis=2)
    return np.asarray(condition / np.sqrt(np.maximum(variance, 1e-300)))


def adjust_coplanarity(
    a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray, iterations: int = 50
) -> Coplanarity:
    """Adjust ``base`` (3,) and ``rotation`` (3, 3) to n ≥ 5 homologous rays, with Levenberg–Marquardt steps.

    Converged when a step no longer changes the parameters by more than rounding, or the objective stands
    still.
    """
    state = misfit(a, b, base, rotation)
    objective = float(state.residuals @ state.residuals)
    damping, converged = 0.0, False
    axes = tangent_axes(base)
    normal = np.zeros((5, 5))
    for _ in range(iterations):
        axes = tangent_axes(base)
        rows = design(state, base, rotation, axes)
        normal = rows.T @ rows
        step = _coplanarity_step(normal, rows.T @ state.residuals, damping)
        moved_base = base + axes @ step[:2]
        moved_base = moved_base / np.linalg.norm(moved_base)
        moved_rotation = rotate(rotation, step[2:])
        moved = misfit(a, b, moved_base, moved_rotation)
        reached = float(moved.residuals @ moved.residuals)
        small = float(np.max(np.abs(step))) < 1e-9
        if reached <= objective:
            still = objective - reached <= 1e-13 * objective
            base, rotation, state, objective = moved_base, moved_rotation, moved, reached
            damping = damping / 10.0 if damping > 1e-10 else 0.0
            converged = (small or still) and damping < 1e-6
        else:
            converged = small
            damping = max(damping * 10.0, 1e-5)
        if converged or damping > 1e10:
            break
    return Coplanarity(base, rotation, state.residuals, objective, normal, axes, converged)


def turned_by(base: FloatArray, rotation: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orientation with the base turned by the angle |step[:3]| towards it, and the rotation by δ = step[3:]."""
    axis = cross(base, step[:3])
    return exponential(axis) @ base, rotate(rotation, step[3:])


def design(state: CoplanarityResiduals, base: FloatArray, rotation: FloatArray, axes: FloatArray) -> FloatArray:
    """Derivatives (n, k + 3) of the residuals by k movements ``axes`` (3, k) of the base, and by δ."""
    turned = state.rays_b @ rotation
    across = cross(base, state.rays_a)
    by_base = cross(state.rays_a, turned) @ axes
    by_rotation = cross(turned, across) @ rotation.T
    return np.asarray(np.concatenate([by_base, by_rotation], axis=1) / state.spread[:, None])


def _coplanarity_step(normal: FloatArray, side: FloatArray, damping: float) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale) + damping * np.eye(5)
    step = -rotations.lstsq(scaled, side / scale, rcond=1e-15) / scale
    return np.asarray(step * min(1.0, 0.5 / max(float(np.linalg.norm(step)), 1e-300)))


def in_front(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> BoolArray:
    """Return (n, 2): is the intersection in front of A, of B? Rays parallel within their noise count as they point."""
    return both_fronts(a, b, base, rotation)[0]


def both_fronts(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return the points in front (n, 2) with this base, and with the opposite one."""
    turned = b.rays @ rotation
    normal = cross(a.rays, turned)
    depths = np.stack([np.einsum("ni,ni->n", cross(base, rays), normal) for rays in (turned, a.rays)], axis=1)
    noise = np.hypot(a.sigma / a.lengths, b.sigma / b.lengths)
    # Rays whose angle is below so many σ are parallel: in front if they point to the same side.
    parallel = np.linalg.norm(normal, axis=1) < 3.0 * noise * (a.lengths * b.lengths)
    same_side = np.einsum("ni,ni->n", a.rays, turned) > 0.0
    ahead, behind = (
        np.where(parallel[:, None], same_side[:, None], towards) for towards in (depths > 0.0, depths < 0.0)
    )
    return ahead, behind


# ---- Compatible auxiliary unknowns from five homologous points: every real solution, no approximation.
#
# Five equations (5) leave a four-dimensional space ik = x E1 + y E2 + z E3 + E4. The conditions of Rinner,
# written as polynomials, det E = 0 and 2 E Eᵀ E − tr(E Eᵀ) E = 0, are ten cubics in x, y, z. Elimination of
# the ten cubic monomials leaves the multiplication by x as a 10 × 10 matrix whose eigenvectors carry the
# solutions (the Gröbner basis form of H. Stewénius, C. Engels, D. Nistér, ISPRS J. 60 (2006) 284–294, of the
# relation that E. Kruppa found in 1913: ten solutions, here with multiplicities and complex pairs).
#
# It also bears plane scenes, where the eight-point system loses rank.


class _Products(NamedTuple):
    """Products of linear polynomials, of quadratic with linear ones, and the order of the cubic monomials."""

    of_linear: FloatArray
    of_quadratic: FloatArray
    order: list[int]


def _product_tables() -> _Products:
    """Tables of products of polynomials in x, y, z.

    First the cubic monomials proper, then the basis of the quotient ring: x² xy y² xz yz z² x y z 1. The digits
    name the variables, 3 stands for the constant 1.
    """
    squares = list(combinations_with_replacement(range(4), 2))
    cubes = list(combinations_with_replacement(range(4), 3))
    linear = np.zeros((4, 4, 10))
    for i, j in product(range(4), repeat=2):
        linear[i, j, squares.index((min(i, j), max(i, j)))] = 1.0
    quadratic = np.zeros((10, 4, 20))
    for row, monomial in enumerate(squares):
        for j in range(4):
            first, second, third = sorted((*monomial, j))
            quadratic[row, j, cubes.index((first, second, third))] = 1.0
    proper = "000 001 011 111 002 012 112 022 122 222"
    rest = "003 013 113 023 123 223 033 133 233 333"
    order = [cubes.index((int(m[0]), int(m[1]), int(m[2]))) for m in f"{proper} {rest}".split()]
    return _Products(linear, quadratic, order)


_PRODUCTS = _product_tables()


def null_spaces(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """Four matrices (s, 4, 3, 3) that span the solutions of (5) for s samples of five rays (s, 5, 3)."""
    rows = np.einsum("spi,spk->spik", rays_a, rays_b).reshape(len(rays_a), 5, 9)
    basis = rotations.svd(rows, full_matrices=True)[2][:, 5:]
    # A fixed rotation of the null space keeps "E4 with coefficient one" away from special positions.
    mixing = np.linalg.qr(np.random.default_rng(5).normal(size=(4, 4)))[0]
    return np.asarray(np.einsum("ab,sbm->sam", mixing, basis).reshape(len(rays_a), 4, 3, 3))


def cubic_conditions(basis: FloatArray) -> FloatArray:
    """Coefficients (s, 10, 20) of the ten cubics in x, y, z for bases (s, 4, 3, 3)."""
    E = np.moveaxis(basis, 1, -1)
    product = np.einsum("sija,skjb,abq->sikq", E, E, _PRODUCTS.of_linear, optimize=True)
    trace = np.einsum("siiq->sq", product)
    product = 2.0 * product - np.eye(3)[None, :, :, None] * trace[:, None, None, :]
    nine = np.einsum("sijq,sjkb,qbc->sikc", product, E, _PRODUCTS.of_quadratic, optimize=True)
    minors = np.stack([_minor(E, k) for k in range(3)], axis=1)
    determinant = np.einsum("skq,skb,qbc->sc", minors, E[:, 0], _PRODUCTS.of_quadratic, optimize=True)
    return np.concatenate([nine.reshape(len(E), 9, 20), determinant[:, None]], axis=1)[:, :, _PRODUCTS.order]


def _minor(E: FloatArray, k: int) -> FloatArray:
    i, j = (k + 1) % 3, (k + 2) % 3
    return np.asarray(
        np.einsum("sa,sb,abq->sq", E[:, 1, i], E[:, 2, j], _PRODUCTS.of_linear)
        - np.einsum("sa,sb,abq->sq", E[:, 1, j], E[:, 2, i], _PRODUCTS.of_linear)
    )


def five_point_unknowns(rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """All real compatible ik (m, 3, 3), at the norm Σ ik² = 2, of s samples of five rays (s, 5, 3).

    Samples without a finite solution contribute none; degenerate samples may contribute spurious matrices,
    which the caller's residuals sort out.
    """
    basis = null_spaces(rays_a, rays_b)
    conditions = cubic_conditions(basis)
    sound = rotations.singular_values(conditions[:, :, :10])[:, -1] > 1e-13
    basis, conditions = basis[sound], conditions[sound]
    if not len(basis):
        return np.zeros((0, 3, 3))
    reduced = -rotations.solve(conditions[:, :, :10], conditions[:, :, 10:])
    action = np.zeros((len(basis), 10, 10))
    # x times x² xy y² xz yz z² is a proper cubic monomial, x times x y z 1 is in the basis.
    action[:, :6] = reduced[:, [0, 1, 2, 4, 5, 7]]
    action[:, [6, 7, 8, 9], [0, 1, 3, 6]] = 1.0
    values, vectors = rotations.eig(action)
    last = vectors[:, 9, :]
    # Imaginary part, relative, up to which an eigenvalue counts as real (double roots split into pairs).
    real = (np.abs(values.imag) <= 1e-4 * (1.0 + np.abs(values))) & (np.abs(last) > 1e-12)
    weights = vectors[:, 6:10, :] / np.where(real, last, 1.0)[:, None, :]
    ik = np.einsum("sae,saij->seij", weights.real, basis)[real]
    norm = np.linalg.norm(ik, axis=(1, 2), keepdims=True)
    return np.asarray(ik * (np.sqrt(2.0) / norm))


# ---- Orientations for every direction of the base, where parallaxes are small beside their errors.
#
# The errors of the linear system are squared errors of the rays: where a base is so short that parallaxes are
# few σ, it can lead to another minimum than the least. Then, however, the second bundle is all but the first
# one turned. About that turn the coplanarity is linear in the rest δ of the rotation: for a base b, with u =
# D*ᵀ p'' in the axes of A,
#
#     g + g_δ · δ = 0,      g = b · (p' × u),      g_δ = u × (b × p')
#
# so for each of many directions of b the best δ and Σ (v/σ)² follow at once, and the minima of that map are all there
# are.


def minima_over_directions(a: Bundle, b: Bundle, turn: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Orientations (b, D*) at the minima of the map, best first; ``turn`` (3, 3) is D* of no base."""
    # Over half a sphere, 0.25 rad from one to the next: the opposite direction has the same map.
    bases = sphere(200)[:100]
    objectives, rests = _map(a, b, turn, bases)
    # Angle in radians within which a minimum of the map is to be the least.
    near = np.abs(bases @ bases.T) > np.cos(0.45)
    least = objectives <= np.min(np.where(near, objectives[None], np.inf), axis=1)
    # Best minima that are given on.
    order = [k for k in np.argsort(objectives) if least[k]][:6]
    return [(bases[k], turn @ exponential(-rests[k])) for k in order]


def _map(a: Bundle, b: Bundle, turn: FloatArray, bases: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Σ (v/σ)² (m,) and the rotations δ (m, 3), in the axes of A, that reach it."""
    rays, turned = a.rays, b.rays @ turn
    crossed, moment = cross(turned[None], bases[:, None]), cross(bases[:, None], rays[None])
    slope_a = np.einsum("mni,nij->mnj", crossed, a.whitened_axes)
    slope_b = np.einsum("mni,nij->mnj", moment, np.einsum("ki,nkj->nij", turn, b.whitened_axes))
    spread = np.sqrt(np.sum(slope_a**2, axis=2) + np.sum(slope_b**2, axis=2))
    spread = np.maximum(spread, 1e-3 * np.max(spread, axis=1, keepdims=True))  # a ray along the base says nothing
    condition = bases @ cross(rays, turned).T / spread
    rows = cross(turned[None], moment) / spread[:, :, None]
    normal, side = np.swapaxes(rows, 1, 2) @ rows, np.einsum("mni,mn->mi", rows, condition)
    scale = np.trace(normal, axis1=1, axis2=2)
    rest = -rotations.solve(normal + 1e-12 * scale[:, None, None] * np.eye(3), side[:, :, None])[:, :, 0]
    return np.sum(condition**2, axis=1) + np.einsum("mi,mi->m", side, rest), rest


# ---- Do the standard deviations of an orientation hold? Σ (v/σ)² some σ away, compared with what they promise.
#
# σ come from the linear terms of the estimate at the solution. An error of k σ costs k² of Σ (v/σ)², if they
# are all; where the quadratic ones are not small beside them, Σ (v/σ)² rises otherwise. So the base is turned
# by three and by five σ, either way along both axes of its error ellipse, all else is adjusted again, and the
# rise is compared with 9 and 25 (the profile of the objective: D. M. Bates, D. G. Watts, Nonlinear regression
# analysis, 1988, chapter 6).

FAR = (3.0, 5.0)
"""Standard deviations by which the base is turned."""
PROMISED = 0.64
"""Part of the promised rise that must be there: what σ say is five σ are at least four."""


def sigma_hold(a: Bundle, b: Bundle, chosen: Coplanarity, covariance: FloatArray) -> bool:
    """True if Σ (v/σ)² rises as ``covariance`` (6, 6) of b and δ promises, in all directions of the base."""
    values, axes = rotations.eigh(covariance[:3, :3])
    if not max(FAR) * np.sqrt(values[2]) < 0.5 * np.pi:
        return False
    for k, far, sign in product((2, 1), FAR, (1.0, -1.0)):
        axis, sigma = axes[:, k], float(np.sqrt(max(values[k], 1e-300)))
        rest = covariance[3:, :3] @ axis / sigma**2
        step = sign * far * sigma * np.concatenate([axis, rest])
        least = _least(a, b, turned_by(chosen.base, chosen.rotation, step), axis)
        if least - chosen.objective < PROMISED * far**2:
            return False
    return True


def _least(a: Bundle, b: Bundle, start: tuple[FloatArray, FloatArray], axis: FloatArray) -> float:
    """Least Σ (v/σ)² with the base held towards ``axis`` (3,): it moves across it only, and the rotation is free."""
    base, rotation = start
    state = misfit(a, b, base, rotation)
    objective = float(state.residuals @ state.residuals)
    # Most steps of the other four parameters; they halt where one promises less than a half.
    for _ in range(4):
        across = unit(cross(base, axis))
        rows = design(state, base, rotation, across[:, None])
        step = -rotations.lstsq(rows, state.residuals, rcond=1e-12)
        if -float(state.residuals @ (rows @ step)) < 0.5:
            break
        moved = turned_by(base, rotation, np.concatenate([step[0] * across, step[1:]]))
        tried = misfit(a, b, *moved)
        gain = objective - float(tried.residuals @ tried.residuals)
        if gain <= 0.0:
            break
        (base, rotation), state, objective = moved, tried, objective - gain
    return objective
