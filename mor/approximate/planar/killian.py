"""Shape of a plane quadrilateral from two images, no orientation known (K. Killian).

S is the crossing of the diagonals 12 and 34. From an image come the angles at the projection centre O: α1, α2
between S and 1, 2; β1, β2 between S and 3, 4; and k = cos of the angle of the two diagonal planes at OS.
Unknown are the angles φ, ψ at S between SO and S1, S3, and the distance r = OS; the second image has bars,
here an index: image "a" has r = 1, image "b" has r² = ϱ. Both see the same a1, a2, b1, b2 (sine rule) and
the same angle α of the diagonals, which gives

    cot φ_b = C1 cot φ_a + K1,      cot ψ_b = C2 cot ψ_a + K2                                       (1a), (1b)
    sin φ_b = (r/C1) sin φ_a,       sin ψ_b = (r/C2) sin ψ_a                                        (2a), (2b)
    cot φ_a cot ψ_a + k_a = ϱ/(C1 C2) (cot φ_b cot ψ_b + k_b)                                        (7)
    (1 − ϱ) cot² φ_b − 2 K1 cot φ_b + G1 − ϱ = 0,   G1 = C1² + K1²                                  (8a), (8b)

Elimination of the cotangents: with R0 = K1 K2 + k_a C1 C2 − ϱ k_b and R_i = K_i² − (1 − ϱ)(G_i − ϱ)

    √R1 √R2 = K1 K2 − (1 − ϱ) R0                                                                     (*)

squared and divided by (1 − ϱ) is the cubic (9). Its roots are always real and positive: ϱ_i = |H s|²/σ_i²
with the collineation H of the bundles, s the unit ray to S, and σ_i the singular values of H. Only for the
middle one are R1 and R2 not negative, so the cotangents are real: two solutions, one where R1 = R2 = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.vectors import cross, unit
from mor.arrays import FloatArray

REAL = 1e-5
"""Relative size below which the imaginary part of a root, or a negative R1 or R2, is taken for rounding."""
UNSQUARED = 1e-5
"""Misclosure of the unsquared (7), relative to its terms, up to which a candidate is a solution."""


class Angles(NamedTuple):
    """What one image of the quadrilateral gives."""

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


def angles_in_image(corners: FloatArray) -> Angles:
    """Angles at O from the rays (4, 3) to the corners 1, 2, 3, 4; 12 and 34 are the diagonals.

    The diagonals must cross between the corners in the image (a convex quadrilateral, rightly paired).
    """
    one, two, three, four = unit(corners)
    plane_12, plane_34 = cross(one, two), cross(three, four)
    crossing = unit(cross(plane_12, plane_34))
    if crossing @ (one + two + three + four) < 0.0:
        crossing = -crossing
    cotangents = [_cot(crossing, ray) for ray in (one, two, three, four)]
    across_one, across_three = one - (one @ crossing) * crossing, three - (three @ crossing) * crossing
    k = float(unit(across_one) @ unit(across_three))
    return Angles(np.array(cotangents[:2]), np.array(cotangents[2:]), k, crossing)


def diagonals_cross(corners: FloatArray) -> bool:
    """True if the diagonals 12 and 34 of rays (4, 3) meet between their ends, in front."""
    one, two, three, four = unit(corners)
    crossing = angles_in_image(corners).crossing
    between = [
        float(cross(crossing, first) @ cross(crossing, second)) < 0.0
        and float(crossing @ (first + second)) > 0.0
        for first, second in ((one, two), (three, four))
    ]
    return all(between)


def _cot(first: FloatArray, second: FloatArray) -> float:
    return float(first @ second) / max(float(np.linalg.norm(cross(first, second))), 1e-300)


def linking_constants(a: Angles, b: Angles) -> Linking:
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
        for cot_phi_b, cot_psi_b in _cotangents(link, float(rho)):
            candidate = _complete(link, angles_a, angles_b, float(rho), cot_phi_b, cot_psi_b)
            if candidate.misclosure < UNSQUARED and not any(_same(candidate, other) for other in found):
                found.append(candidate)
    return sorted(found, key=lambda solution: not solution.admissible)


def _cotangents(link: Linking, rho: float) -> list[tuple[float, float]]:
    if rho <= 0.0:
        return []
    roots_phi = _quadratic(1.0 - rho, link.k1, link.g1 - rho)
    roots_psi = _quadratic(1.0 - rho, link.k2, link.g2 - rho)
    return [(phi, psi) for phi in roots_phi for psi in roots_psi]


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
    link: Linking, a: Angles, b: Angles, rho: float, cot_phi_b: float, cot_psi_b: float
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
    return bool(
        np.all(near < 1e-9 * (1.0 + first.r_b)) and np.all(also < 1e-9 * (1.0 + np.abs(first.cot_psi)))
    )


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
