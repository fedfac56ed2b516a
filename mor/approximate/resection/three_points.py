"""Space resection from three points: all real solutions (J. A. Grunert 1841).

Unknown are the distances s1, s2, s3 from the projection centre to the points. With the sides a = P2P3, b =
P1P3, c = P1P2 and the angles α, β, γ of the rays that face them, three cosine laws

    s2² + s3² − 2 s2 s3 cos α = a²,   s1² + s3² − 2 s1 s3 cos β = b²,   s1² + s2² − 2 s1 s2 cos γ = c²

become with s2 = u s1, s3 = v s1 a quartic in v (in the form of R. M. Haralick et al., IJCV 13 (1994)
331–356). u follows from the third law, so that no difference of angles is divided by; every solution is
refined on the three laws themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.approximate.vectors import unit
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

REAL = 1e-3
"""Relative imaginary part up to which a root of the quartic is tried (double roots part into pairs)."""
NEARLY_REAL = 0.15
"""The same where measuring errors, not rounding, may have parted a double root."""
NEARLY_HOLDS = 1e-2
"""Misclosure of the cosine laws, relative to the largest side squared, of the real part of such a root."""
HOLDS = 1e-9
"""Misclosure of the cosine laws, relative to the largest side squared, of a solution."""
REFINEMENTS = 4


class ThreePointSolutions(NamedTuple):
    """Solutions of many samples."""

    sample: IntArray
    """(m,) the sample that a solution belongs to."""
    positions: FloatArray
    """(m, 3) projection centres."""
    rotations: FloatArray
    """(m, 3, 3) D."""


def resect_three_points(points: FloatArray, rays: FloatArray) -> ThreePointSolutions:
    """All resections with positive distances of s samples of three points (s, 3, 3) by their rays (s, 3, 3).

    Up to four per sample. Collinear points, or two equal ones, leave none or senseless ones; on the dangerous
    cylinder (through the points, upright on their plane) two of them fall together.
    """
    return _resected(points, rays, REAL, 0.0)


def nearly_resect_three_points(points: FloatArray, rays: FloatArray) -> ThreePointSolutions:
    """All resections, and the real part of those that errors of the rays have just made complex.

    Near the dangerous cylinder that is the place where the rays fit best, a start for an adjustment.
    """
    return _resected(points, rays, NEARLY_REAL, NEARLY_HOLDS)


def _resected(
    points: FloatArray, rays: FloatArray, imaginary: float, misclosure: float
) -> ThreePointSolutions:
    directions = unit(rays)
    sides = np.stack([_side(points, 1, 2), _side(points, 0, 2), _side(points, 0, 1)], axis=1)
    cosines = np.stack(
        [_cosine(directions, 1, 2), _cosine(directions, 0, 2), _cosine(directions, 0, 1)], axis=1
    )
    sound = np.all(sides > 0.0, axis=1)
    sample, distances = _distances(np.where(sound[:, None], sides, 1.0), cosines, imaginary, misclosure)
    keep = sound[sample] & np.all(distances > 0.0, axis=1)
    sample, distances = sample[keep], distances[keep]
    placed = directions[sample] * distances[:, :, None]
    rotations, positions = _frames(points[sample], placed)
    return ThreePointSolutions(sample, positions, rotations)


def _side(points: FloatArray, i: int, j: int) -> FloatArray:
    return np.asarray(np.linalg.norm(points[:, i] - points[:, j], axis=1))


def _cosine(directions: FloatArray, i: int, j: int) -> FloatArray:
    return np.asarray(np.einsum("si,si->s", directions[:, i], directions[:, j]))


def quartic(sides: FloatArray, cosines: FloatArray) -> FloatArray:
    """Coefficients (s, 5) of the quartic in v = s3/s1, highest power first; columns a, b, c and α, β, γ."""
    a2, b2, c2 = (sides**2).T
    ca, cb, cg = cosines.T
    p, q = (a2 - c2) / b2, (a2 + c2) / b2
    return np.stack(
        [
            (p - 1.0) ** 2 - 4.0 * c2 / b2 * ca**2,
            4.0 * (p * (1.0 - p) * cb - (1.0 - q) * ca * cg + 2.0 * c2 / b2 * ca**2 * cb),
            2.0
            * (
                p**2
                - 1.0
                + 2.0 * p**2 * cb**2
                + 2.0 * (b2 - c2) / b2 * ca**2
                - 4.0 * q * ca * cb * cg
                + 2.0 * (b2 - a2) / b2 * cg**2
            ),
            4.0 * (-p * (1.0 + p) * cb + 2.0 * a2 / b2 * cg**2 * cb - (1.0 - q) * ca * cg),
            (1.0 + p) ** 2 - 4.0 * a2 / b2 * cg**2,
        ],
        axis=1,
    )


def _roots(coefficients: FloatArray) -> FloatArray:
    """Complex roots (s, 4); the reversed polynomial is used where its leading coefficient is the larger."""
    flip = np.abs(coefficients[:, 0]) < np.abs(coefficients[:, -1])
    ordered = np.where(flip[:, None], coefficients[:, ::-1], coefficients)
    leading = np.where(ordered[:, :1] == 0.0, 1e-300, ordered[:, :1])
    companion = np.zeros((len(coefficients), 4, 4))
    companion[:, 0, :] = -ordered[:, 1:] / leading
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    companion[~np.all(np.isfinite(companion), axis=(1, 2))] = 0.0
    roots = tolerant.eigvals(companion)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(flip[:, None], 1.0 / roots, roots))


def _distances(
    sides: FloatArray, cosines: FloatArray, imaginary: float, misclosure: float
) -> tuple[IntArray, FloatArray]:
    roots = _roots(quartic(sides, cosines))
    real = np.isfinite(roots) & (np.abs(roots.imag) <= imaginary * (1.0 + np.abs(roots))) & (roots.real > 0.0)
    sample, which = np.nonzero(real)
    v = roots.real[sample, which]
    _, b, c = sides[sample].T
    _, cb, cg = cosines[sample].T
    s1 = b / np.sqrt(np.maximum(1.0 + v**2 - 2.0 * v * cb, 1e-300))
    under_root = np.sqrt(np.maximum(cg**2 - 1.0 + (c / s1) ** 2, 0.0))
    both = [np.stack([s1, (cg + sign * under_root) * s1, v * s1], axis=1) for sign in (1.0, -1.0)]
    sample, distances = np.concatenate([sample, sample]), np.concatenate(both)
    fit = np.max(np.abs(_laws(distances, sides[sample], cosines[sample])), axis=1)
    near = fit < 0.05 * np.max(sides[sample], axis=1) ** 2
    sample, distances, fit = sample[near], distances[near], fit[near]
    refined = _refined(distances, sides[sample], cosines[sample])
    fit_refined = np.max(np.abs(_laws(refined, sides[sample], cosines[sample])), axis=1)
    holds = fit_refined < HOLDS * np.max(np.maximum(sides[sample], np.abs(refined)), axis=1) ** 2
    keep = holds | (fit < misclosure * np.max(sides[sample], axis=1) ** 2)
    return _without_repeats(sample[keep], np.where(holds[:, None], refined, distances)[keep])


def _laws(s: FloatArray, sides: FloatArray, cosines: FloatArray) -> FloatArray:
    others = np.stack([s[:, 1] * s[:, 2], s[:, 0] * s[:, 2], s[:, 0] * s[:, 1]], axis=1)
    squares = np.sum(s**2, axis=1, keepdims=True) - s**2
    return np.asarray(squares - 2.0 * others * cosines - sides**2)


def _refined(s: FloatArray, sides: FloatArray, cosines: FloatArray) -> FloatArray:
    for _ in range(REFINEMENTS):
        jacobian = np.zeros((len(s), 3, 3))
        for law, (i, j) in enumerate(((1, 2), (0, 2), (0, 1))):
            jacobian[:, law, i] = 2.0 * (s[:, i] - s[:, j] * cosines[:, law])
            jacobian[:, law, j] = 2.0 * (s[:, j] - s[:, i] * cosines[:, law])
        misclosure = _laws(s, sides, cosines)
        size = np.linalg.norm(jacobian, axis=(1, 2)) ** 3
        regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * size
        step = np.zeros_like(s)
        step[regular] = tolerant.solve(jacobian[regular], misclosure[regular][:, :, None])[:, :, 0]
        limit = 0.1 * np.linalg.norm(s, axis=1, keepdims=True)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        s = s - step * np.minimum(1.0, limit / np.maximum(length, 1e-300))
    return s


def _without_repeats(sample: IntArray, distances: FloatArray) -> tuple[IntArray, FloatArray]:
    order = np.lexsort((distances[:, 2], distances[:, 0], sample))
    sample, distances = sample[order], distances[order]
    keep = np.ones(len(sample), dtype=bool)
    for back in range(1, min(8, len(sample))):
        same = sample[back:] == sample[:-back]
        close = np.max(np.abs(distances[back:] - distances[:-back]), axis=1)
        keep[back:] &= ~(same & (close < 1e-7 * np.max(distances[back:], axis=1)))
    return sample[keep], distances[keep]


def _frames(points: FloatArray, placed: FloatArray) -> tuple[FloatArray, FloatArray]:
    centre, centre_placed = points.mean(axis=1), placed.mean(axis=1)
    covariance = np.einsum("sni,snj->sij", placed - centre_placed[:, None], points - centre[:, None])
    rotations = nearest_rotation(covariance)
    positions = centre - np.einsum("sji,sj->si", rotations, centre_placed)
    return rotations, positions
