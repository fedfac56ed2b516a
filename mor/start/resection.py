"""Space resection."""

from __future__ import annotations

from enum import Enum
from math import comb
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.rotations import angles_from_rotation, cross_matrix, rotate
from mor.start.bundle import AS_GOOD, Bundle, misfits, reproject, samples, unit
from mor.start.relative_orientation import nearest_rotation
from mor.types import BoolArray, FloatArray, IntArray

# ---- Refinement of a resection: Gauss–Newton with small rotations about the axes of the frame.


class Pose(NamedTuple):
    """Position and attitude of a frame."""

    position: FloatArray
    """(3,)"""
    rotation: FloatArray
    """(3, 3) D."""


def star_of(points: FloatArray, pose: Pose) -> FloatArray:
    """Points (n, 3) in the axes of a frame."""
    return np.asarray((points - pose.position) @ pose.rotation.T)


def pose_design(bundle: Bundle, points: FloatArray, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Residuals (2n,) in units of σ and their derivatives (2n, 6) by X0 and δ, D ← exp(−[δ]×) D."""
    star = star_of(points, pose)
    computed = reproject(bundle, star)
    by_position = -computed.by_star @ pose.rotation
    by_rotation = computed.by_star @ cross_matrix(star)
    return computed.residuals.ravel(), np.concatenate([by_position, by_rotation], axis=2).reshape(-1, 6)


def adjust_pose(bundle: Bundle, points: FloatArray, pose: Pose, iterations: int = 40) -> Pose:
    """Least-squares pose from n ≥ 3 points (n, 3), starting at ``pose``; steps are damped only where they must be."""
    damping = 0.0
    residuals, design = pose_design(bundle, points, pose)
    for _ in range(iterations):
        normal = design.T @ design
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        damped = normal / np.outer(scale, scale) + damping * np.eye(6)
        step = -rotations.lstsq(damped, design.T @ residuals / scale, rcond=1e-15) / scale
        moved = Pose(pose.position + step[:3], rotate(pose.rotation, step[3:]))
        new_residuals, new_design = pose_design(bundle, points, moved)
        before, after = float(residuals @ residuals), float(new_residuals @ new_residuals)
        range_ = float(np.max(np.abs(points - pose.position)))
        small = max(float(np.max(np.abs(step[:3]))) / range_, float(np.max(np.abs(step[3:])))) < 1e-10
        if after <= before:
            pose, residuals, design = moved, new_residuals, new_design
            damping = damping / 10.0 if damping > 1e-10 else 0.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if small or damping > 1e8 or 0.0 <= before - after <= 1e-13 * before:
            break
    return pose


# ---- What became of a space resection, as data.


class ResectionOutcome(Enum):
    """Outcome of a resection."""

    DETERMINED = "one pose fits"
    AMBIGUOUS = (
        "several poses fit equally well; another point, or the side from which the "
        "image was taken, decides between them"
    )
    AMBIGUOUS_AND_WEAK = (
        "several poses fit, and at least one of them is poorly determined: near the critical cylinder over the "
        "circle of the points, or points too close together; more points decide between them"
    )
    WEAK = "a pose fits but is poorly determined: points too close together, or a critical configuration"
    TOO_FEW = "fewer than three points"
    INVALID = "a ray or a point is not a number, a ray is zero, or there are not as many rays as points"
    COLLINEAR = "the points are collinear, in the object or in the image"
    DOES_NOT_FIT = (
        "no pose fits half of the points within their precision: wrong "
        "identities or wrong interior orientation orientation"
    )

    @property
    def usable(self) -> bool:
        """True if the pose, or one of several, can serve as a start value."""
        return self in (
            ResectionOutcome.DETERMINED,
            ResectionOutcome.AMBIGUOUS,
            ResectionOutcome.AMBIGUOUS_AND_WEAK,
            ResectionOutcome.WEAK,
        )


class Resection(NamedTuple):
    """A frame in the object system: X* = D (X − X0)."""

    outcome: ResectionOutcome
    position: FloatArray
    """(3,) X0."""
    rotation: FloatArray
    """(3, 3) D."""
    angles: FloatArray
    """(3,) ω, φ, κ in radians."""
    covariance: FloatArray
    """(6, 6) of X0 and the small rotation δ for the a-priori σ of the rays."""
    sigma0: float
    """Of the agreeing points; not a number without redundancy."""
    residuals: FloatArray
    """(n,) length of v/σ of every point; infinite behind the camera."""
    agreeing: BoolArray
    """(n,) the points that the pose rests on."""
    alternatives: tuple[Pose, ...]
    """Other poses that fit about as well."""


def failed_resection(outcome: ResectionOutcome, points: int) -> Resection:
    """Return a result without a pose."""
    nothing = np.full(3, np.nan)
    return Resection(
        outcome,
        nothing,
        np.full((3, 3), np.nan),
        nothing,
        np.full((6, 6), np.nan),
        float("nan"),
        np.full(points, np.nan),
        np.zeros(points, dtype=bool),
        (),
    )


def judged(bundle: Bundle, points: FloatArray, refined: list[tuple[Pose, BoolArray]]) -> Resection:
    """Choose the pose that most points agree with, then the one of least Σ (v/σ)²; name what is not decided."""
    if not refined:
        return failed_resection(ResectionOutcome.DOES_NOT_FIT, len(points))
    costs = [
        float(np.sum(misfits(bundle.take(agreeing), star_of(points[agreeing], pose)[None])[0] ** 2))
        for pose, agreeing in refined
    ]
    order = sorted(range(len(refined)), key=lambda i: (-int(np.sum(refined[i][1])), costs[i]))
    pose, agreeing = refined[order[0]]
    redundancy = 2 * int(np.sum(agreeing)) - 6
    sigma0 = float(np.sqrt(costs[order[0]] / redundancy)) if redundancy > 0 else float("nan")
    excess = AS_GOOD * max(1.0, costs[order[0]] / redundancy if redundancy > 0 else 0.0)
    rivals = []
    for index in order[1:]:
        as_good = costs[index] <= costs[order[0]] + excess
        if np.sum(refined[index][1]) == np.sum(agreeing) and as_good:
            rivals.append(refined[index][0])
    covariance = _covariance(bundle.take(agreeing), points[agreeing], pose)
    spread = float(np.sqrt(np.max(np.diag(covariance)[3:])))
    # Without redundancy every pose fits exactly: two close to one another, near the dangerous cylinder, are two.
    # Rotations of three-point solutions closer than this are one.
    tolerance = 8.0 * spread + 1e-6 if redundancy > 0 else 1e-4
    kept: list[Pose] = []
    for rival in rivals:
        if all(np.linalg.norm(rival.rotation - other.rotation) > tolerance for other in (pose, *kept)):
            kept.append(rival)
    return Resection(
        _outcome(bundle, points, agreeing, [pose, *kept]),
        pose.position,
        pose.rotation,
        angles_from_rotation(pose.rotation),
        covariance,
        sigma0,
        misfits(bundle, star_of(points, pose)[None])[0],
        agreeing,
        tuple(kept),
    )


def _covariance(bundle: Bundle, points: FloatArray, pose: Pose) -> FloatArray:
    _, design = pose_design(bundle, points, pose)
    normal = design.T @ design
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = rotations.eigh(normal / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, 1e-15)) @ vectors.T / np.outer(scale, scale))


def _outcome(bundle: Bundle, points: FloatArray, agreeing: BoolArray, poses: list[Pose]) -> ResectionOutcome:
    """Return the outcome for the poses that fit, the best first."""
    # Part of the points that must agree.
    if np.sum(agreeing) < max(3, 0.5 * len(points)):
        return ResectionOutcome.DOES_NOT_FIT
    weak = any(_is_weak(bundle.take(agreeing), points[agreeing], pose) for pose in poses)
    if len(poses) > 1:
        return ResectionOutcome.AMBIGUOUS_AND_WEAK if weak else ResectionOutcome.AMBIGUOUS
    return ResectionOutcome.WEAK if weak else ResectionOutcome.DETERMINED


def _is_weak(bundle: Bundle, points: FloatArray, pose: Pose) -> bool:
    variances = np.diag(_covariance(bundle, points, pose))
    nearest = float(np.min(np.linalg.norm(points - pose.position, axis=1)))
    position, rotation = np.sqrt(np.max(variances[:3])), np.sqrt(np.max(variances[3:]))
    # Radians, and parts of the distance to the nearest point.
    return bool(rotation > 0.1 or position > 0.1 * nearest)


# ---- Space resection from three points: all real solutions (J. A. Grunert 1841).
#
# Unknown are the distances s1, s2, s3 from the projection centre to the points. With the sides a = P2P3, b =
# P1P3, c = P1P2 and the angles α, β, γ of the rays that face them, three cosine laws
#
#     s2² + s3² − 2 s2 s3 cos α = a²,   s1² + s3² − 2 s1 s3 cos β = b²,   s1² + s2² − 2 s1 s2 cos γ = c²
#
# become with s2 = u s1, s3 = v s1 a quartic in v (in the form of R. M. Haralick et al., IJCV 13 (1994)
# 331–356). u follows from the third law, so that no difference of angles is divided by; every solution is
# refined on the three laws themselves.


class ThreePointSolutions(NamedTuple):
    """Solutions of many samples."""

    sample: IntArray
    """(m,) the sample that a solution belongs to."""
    positions: FloatArray
    """(m, 3) projection centres."""
    rotations: FloatArray
    """(m, 3, 3) D."""


def resect_three_points(points: FloatArray, rays: FloatArray, nearly: bool = False) -> ThreePointSolutions:
    """All resections with positive distances of s samples of three points (s, 3, 3) by their rays (s, 3, 3).

    Up to four per sample. Collinear points, or two equal ones, leave none or senseless ones; on the dangerous
    cylinder (through the points, upright on their plane) two of them fall together. ``nearly``: also the real part of
    those that errors of the rays have just made complex, which is where the rays fit best.
    """
    # Relative imaginary part up to which a root of the quartic is tried (double roots part into pairs), and misclosure
    # of the cosine laws, relative to the largest side squared, up to which it may stay as it is.
    imaginary, misclosure = (0.15, 1e-2) if nearly else (1e-3, 0.0)
    directions = unit(rays)
    sides = np.stack([_side(points, 1, 2), _side(points, 0, 2), _side(points, 0, 1)], axis=1)
    cosines = np.stack([_cosine(directions, 1, 2), _cosine(directions, 0, 2), _cosine(directions, 0, 1)], axis=1)
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
    roots = rotations.eigvals(companion)
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
    # Misclosure of the cosine laws, relative to the largest side squared, of a solution.
    holds = fit_refined < 1e-9 * np.max(np.maximum(sides[sample], np.abs(refined)), axis=1) ** 2
    keep = holds | (fit < misclosure * np.max(sides[sample], axis=1) ** 2)
    return _without_repeats(sample[keep], np.where(holds[:, None], refined, distances)[keep])


def _laws(s: FloatArray, sides: FloatArray, cosines: FloatArray) -> FloatArray:
    others = np.stack([s[:, 1] * s[:, 2], s[:, 0] * s[:, 2], s[:, 0] * s[:, 1]], axis=1)
    squares = np.sum(s**2, axis=1, keepdims=True) - s**2
    return np.asarray(squares - 2.0 * others * cosines - sides**2)


def _refined(s: FloatArray, sides: FloatArray, cosines: FloatArray) -> FloatArray:
    for _ in range(4):
        jacobian = np.zeros((len(s), 3, 3))
        for law, (i, j) in enumerate(((1, 2), (0, 2), (0, 1))):
            jacobian[:, law, i] = 2.0 * (s[:, i] - s[:, j] * cosines[:, law])
            jacobian[:, law, j] = 2.0 * (s[:, j] - s[:, i] * cosines[:, law])
        misclosure = _laws(s, sides, cosines)
        size = np.linalg.norm(jacobian, axis=(1, 2)) ** 3
        regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * size
        step = np.zeros_like(s)
        step[regular] = rotations.solve(jacobian[regular], misclosure[regular][:, :, None])[:, :, 0]
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


# ---- Space resection: position and attitude of a bundle from known points, without approximate values.
#
# Samples of three points (all of them, where they are few) give all positions that three rays allow. The best are
# refined by Gauss–Newton on the measured coordinates with small rotations about the axes of the frame, and the points
# that agree are drawn again until they stand. Ambiguous, mirrored, weak or wrong data are named, never guessed.

TRUNCATION = 12.0
"""Residual v/σ at which a point stops counting while samples are compared."""
AGREES = 4.5
"""Length of the residual v/σ (two coordinates) up to which a point agrees."""


def resect(bundle: Bundle, points: FloatArray) -> Resection:
    """Frame of ``bundle`` from n ≥ 3 known points (n, 3), some of which may be wrong if n ≥ 6.

    Three points leave up to four solutions, all returned; more points decide where they can. Degenerate data do not
    raise: see :class:`ResectionOutcome`.
    """
    points = np.asarray(points, dtype=float)
    refusal = _refusal(bundle, points)
    if refusal is not None:
        return failed_resection(refusal, len(points))
    # The best poses of samples, of which so many are drawn as it takes for one without a wrong point
    # (RANSAC).
    generator = np.random.default_rng(1841)
    poses: list[Pose] = []
    costs: list[FloatArray] = []
    drawn = 0
    # Coordinates of a map are large beside the object: differences from the centre keep the digits.
    centre = points.mean(axis=0)
    # All of few triples at once, else ten before it is asked whether more are needed.
    batch = 80 if comb(len(points), 3) <= 80 else 10
    for triples in samples(len(points), 3, 80, batch, generator):
        found = resect_three_points(points[triples] - centre, bundle.rays[triples], nearly=True)
        fresh = [Pose(p + centre, d) for p, d in zip(found.positions, found.rotations, strict=True)]
        poses, drawn = [*poses, *fresh], drawn + len(triples)
        costs.append(_truncated(bundle, points, fresh))
        # Of the points that agree, each counts the less the worse it does.
        share = 1.0 - min(float(own.min(initial=np.inf)) for own in costs) / (len(points) * TRUNCATION**2)
        # Probability, at the share of points that agree with the best sample, that all samples had a wrong point.
        if share > 0.0 and (1.0 - share**3) ** drawn < 1e-6:
            break
    seeds = _apart([poses[index] for index in np.argsort(np.concatenate(costs), kind="stable")])
    refined = [_settled(bundle, points, pose) for pose in seeds]
    return judged(bundle, points, [one for one in refined if one is not None])


def _refusal(bundle: Bundle, points: FloatArray) -> ResectionOutcome | None:
    if len(bundle) != len(points) or not np.all(np.isfinite(points)) or not np.all(np.isfinite(bundle.rays)):
        return ResectionOutcome.INVALID
    if len(points) < 3:
        return ResectionOutcome.TOO_FEW
    if np.any(np.linalg.norm(bundle.rays, axis=1) == 0.0):
        return ResectionOutcome.INVALID
    extensions = rotations.singular_values(points - points.mean(axis=0))
    thin = rotations.singular_values(bundle.directions)[2] / np.sqrt(len(points))
    # Width of a field of points, relative to its length, below which it is a line.
    if extensions[1] <= 1e-6 * extensions[0] or thin < 3.0 * bundle.noise:
        return ResectionOutcome.COLLINEAR
    return None


def _truncated(bundle: Bundle, points: FloatArray, poses: list[Pose]) -> FloatArray:
    """(m,) sums of the squared residuals of all points, truncated, of m poses."""
    if not poses:
        return np.zeros(0)
    positions = np.stack([pose.position for pose in poses])
    rotations = np.stack([pose.rotation for pose in poses])
    star = np.einsum("mij,mnj->mni", rotations, points - positions[:, None])
    return np.asarray(np.sum(np.minimum(misfits(bundle, star), TRUNCATION) ** 2, axis=1))


def _apart(poses: list[Pose]) -> list[Pose]:
    kept: list[Pose] = []
    for pose in poses:
        if all(np.linalg.norm(pose.rotation - other.rotation) > 0.02 for other in kept):
            kept.append(pose)
        # Best solutions that are refined.
        if len(kept) == 6:
            break
    return kept


def _settled(bundle: Bundle, points: FloatArray, pose: Pose) -> tuple[Pose, BoolArray] | None:
    agreeing = _agreeing(bundle, points, pose, 2.0 * TRUNCATION)
    for _ in range(10):
        if np.sum(agreeing) < min(len(points), 4):
            return None
        pose = adjust_pose(bundle.take(agreeing), points[agreeing], pose)
        now = _agreeing(bundle, points, pose, AGREES)
        if np.array_equal(now, agreeing) or np.sum(now) < min(len(points), 4):
            break
        agreeing = now
    return pose, agreeing


def _agreeing(bundle: Bundle, points: FloatArray, pose: Pose, limit: float) -> BoolArray:
    return np.asarray(misfits(bundle, star_of(points, pose)[None])[0] < limit)
