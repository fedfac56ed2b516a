"""Judgement of adjusted relative orientations: front, fit, precision, ambiguity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import Turn
from mor.approximate.relative_orientation.coplanarity import Coplanarity, in_front
from mor.approximate.relative_orientation.nonlinearity import sigma_hold
from mor.approximate.relative_orientation.outcome import (
    Candidate,
    RelativeOrientation,
    RelativeOutcome,
    SceneGeometry,
)
from mor.approximate.relative_orientation.rinner import auxiliary_unknowns, four_candidates
from mor.approximate.vectors import cross
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation

AS_GOOD = 25.0
"""Σ (v/σ)² by which another orientation may be worse and still count as fitting equally well (5 σ)."""
BY_ITSELF = 2.9e-7
"""Probability that a right orientation fits worse than is allowed by itself (5 σ)."""
APART = 4.0
"""Standard deviations beyond which two orientations are different ones."""
MINIMA_APART = 1.0
"""The same where the adjustment came to rest in both: two minima are two, and the covariance of one knows of one."""
WRONG = 6.0
"""σ0 beyond which rays and orientation do not belong together."""
BEHIND = 0.9
"""Part of the points that must lie in front of both bundles; the rest may be wrong pairs or far points."""
SURE = 5.0
"""Standard deviations of its parallactic angle beyond which a point behind is behind, whatever the errors."""
ACCIDENT = 12
"""Fewer points than that lie, to their precision, on one quadric with both centres now and then by accident."""


class Judged(NamedTuple):
    """What the result is made of."""

    geometry: SceneGeometry
    """A critical surface where the linear system has lost a rank, whatever comes of it."""
    singular_values: FloatArray
    adjusted: list[Coplanarity]
    """Distinct adjusted orientations, best objective first."""
    of_plane: list[tuple[FloatArray, FloatArray]]
    """(b, D*) of the orientations that carry a plane over; empty where the points are in none."""


def failed(outcome: RelativeOutcome, points: int, turn: Turn | None = None) -> RelativeOrientation:
    """Return a result without an orientation; of a pure rotation ``turn`` is known."""
    nothing, covariance = np.full(3, np.nan), np.full((6, 6), np.nan)
    attitude = np.full((3, 3), np.nan) if turn is None else turn.rotation
    angles = nothing if turn is None else angles_from_rotation(turn.rotation)
    if turn is not None:
        covariance[3:, 3:] = turn.covariance
    return RelativeOrientation(
        outcome=outcome,
        geometry=SceneGeometry.UNKNOWN,
        points=points,
        base=nothing,
        rotation=attitude,
        angles=angles,
        covariance=covariance,
        sigma_base=nothing,
        sigma_angles=nothing if turn is None else _sigma_angles(angles, turn.covariance),
        sigma0=float("nan") if turn is None else float(np.sqrt(turn.objective / (2 * points - 3))),
        residuals=np.full(points, np.nan),
        front=np.zeros((points, 2), dtype=bool),
        candidates=(),
        alternatives=(),
        unknowns=np.full((3, 3), np.nan),
        singular_values=np.full(9, np.nan),
    )


def result(a: Bundle, b: Bundle, judged: Judged) -> RelativeOrientation:
    """Choose among the adjusted orientations, first by fit, then by the points in front, and judge the choice."""
    if not judged.adjusted:
        return failed(RelativeOutcome.NO_BASE, len(a))
    chosen, rivals = _choice(a, b, judged)
    opposite = chosen._replace(base=-chosen.base)
    rivals += [] if _is_contradicted(a, b, opposite) else [opposite]
    covariance = orientation_covariance(chosen)
    angles = angles_from_rotation(chosen.rotation)
    outcome = _outcome(a, b, chosen, rivals, covariance)
    covariance = _along_base(covariance, chosen.base)
    return RelativeOrientation(
        outcome=outcome,
        geometry=_geometry(judged.geometry, outcome, len(a)),
        points=len(a),
        base=chosen.base,
        rotation=chosen.rotation,
        angles=angles,
        covariance=covariance,
        sigma_base=np.sqrt(np.diag(covariance)[:3]),
        sigma_angles=_sigma_angles(angles, covariance[3:, 3:]),
        sigma0=float(np.sqrt(_variance(chosen, len(a)))),
        residuals=chosen.residuals,
        front=in_front(a, b, chosen.base, chosen.rotation),
        candidates=candidates_of(a, b, chosen),
        alternatives=tuple(candidate(a, b, one.base, one.rotation) for one in rivals),
        unknowns=auxiliary_unknowns(chosen.base, chosen.rotation),
        singular_values=judged.singular_values,
        plane_orientations=_of_plane(a, b, judged, chosen),
    )


def _geometry(found: SceneGeometry, outcome: RelativeOutcome, points: int) -> SceneGeometry:
    """A critical surface is one where it does harm, or where the points are too many for an accident."""
    harm = outcome in (RelativeOutcome.WEAK, RelativeOutcome.AMBIGUOUS)
    if found is SceneGeometry.CRITICAL_SURFACE and not harm and points < ACCIDENT:
        return SceneGeometry.GENERAL
    return found


def _of_plane(a: Bundle, b: Bundle, judged: Judged, chosen: Coplanarity) -> tuple[Candidate, ...]:
    def away(one: tuple[FloatArray, FloatArray]) -> float:
        return float(np.linalg.norm(one[0] - chosen.base) + np.linalg.norm(one[1] - chosen.rotation))

    return tuple(candidate(a, b, *one) for one in sorted(judged.of_plane, key=away))


def _choice(a: Bundle, b: Bundle, judged: Judged) -> tuple[Coplanarity, list[Coplanarity]]:
    """Of all that fit the one with fewest points behind beyond doubt, then of the least sum of squares; its rivals.

    A point behind within its errors could be far away in front: its parallax counts with the residuals.

    The orientations of a plane fit its collineation equally well, whatever their objectives are: each measures the
    errors across its own base only, and these are different parts of the same errors. There each is judged by itself.
    """
    adjusted = judged.adjusted
    redundancy = len(a) - 5
    variance = max(1.0, adjusted[0].objective / redundancy)
    excess = AS_GOOD * variance
    limit = max(adjusted[0].objective + excess, variance * float(chdtri(redundancy, BY_ITSELF)))
    fitting = [one for one in adjusted if one.objective <= limit]
    parallaxes = [_parallaxes_behind(a, b, one) for one in fitting]
    behind = [int(np.sum(one > SURE)) for one in parallaxes]
    in_all = [one.objective + float(np.sum(own**2)) for one, own in zip(fitting, parallaxes, strict=True)]
    chosen = fitting[min(range(len(fitting)), key=lambda k: (behind[k], in_all[k]))]
    as_good = limit if judged.geometry is SceneGeometry.PLANE else chosen.objective + excess
    sigma = float(np.sqrt(np.max(tolerant.eigvalsh(orientation_covariance(chosen)))))
    rivals = [
        one
        for one, hidden in zip(fitting, behind, strict=True)
        if hidden <= min(behind)
        and one.objective <= as_good
        and _distance(one, chosen) > _tolerance(one, chosen, sigma)
    ]
    return chosen, _one_each(rivals, APART * sigma)


def _tolerance(one: Coplanarity, other: Coplanarity, sigma: float) -> float:
    """Distance up to which two orientations are the same."""
    return (MINIMA_APART if one.converged and other.converged else APART) * sigma + 1e-6


def _one_each(rivals: list[Coplanarity], tolerance: float) -> list[Coplanarity]:
    kept: list[Coplanarity] = []
    for one in rivals:
        if all(_distance(one, other) > tolerance + 1e-6 for other in kept):
            kept.append(one)
    return kept


def _distance(first: Coplanarity, second: Coplanarity) -> float:
    rotation = float(np.linalg.norm(first.rotation - second.rotation)) / np.sqrt(2.0)
    return float(np.hypot(rotation, np.linalg.norm(first.base - second.base)))


def candidate(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> Candidate:
    """Count the points in front of an orientation."""
    front = in_front(a, b, base, rotation)
    both = int(np.sum(np.all(front, axis=1)))
    return Candidate(base, rotation, int(np.sum(front[:, 0])), int(np.sum(front[:, 1])), both)


def candidates_of(a: Bundle, b: Bundle, chosen: Coplanarity) -> tuple[Candidate, ...]:
    """Return the four candidates of an adjusted orientation, that orientation first."""
    four = four_candidates(auxiliary_unknowns(chosen.base, chosen.rotation))
    ordered = sorted(four, key=lambda c: -float(c[0] @ chosen.base) - float(np.sum(c[1] * chosen.rotation)))
    return tuple(candidate(a, b, *pair) for pair in ordered)


def orientation_covariance(chosen: Coplanarity) -> FloatArray:
    """Covariance (6, 6) of b and δ from the five parameters; infinite where the normal matrix is singular."""
    scale = np.sqrt(np.maximum(np.diag(chosen.normal), 1e-300))
    values, vectors = tolerant.eigh(chosen.normal / np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-14)) @ vectors.T / np.outer(scale, scale)
    spread = np.zeros((6, 5))
    spread[:3, :2], spread[3:, 2:] = chosen.base_axes, np.eye(3)
    return np.asarray(spread @ inverse @ spread.T)


def _along_base(covariance: FloatArray, base: FloatArray) -> FloatArray:
    """The covariance (6, 6) with what second order adds along the base, whose length of one leaves no first.

    With ξ the turns of the base it changes by −b |ξ|²/2, and E |ξ|⁴ = (tr C)² + 2 tr C². A component of ±1 had no σ
    else.
    """
    of_base = covariance[:3, :3]
    fourth = np.trace(of_base) ** 2 + 2.0 * np.sum(of_base**2)
    result = covariance.copy()
    result[:3, :3] += 0.25 * fourth * np.outer(base, base)
    return result


def _sigma_angles(angles: FloatArray, covariance: FloatArray) -> FloatArray:
    jacobian = angles_by_tangent(angles)
    if not np.all(np.isfinite(jacobian)):
        return np.full(3, np.inf)
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian)))


def _variance(one: Coplanarity, points: int) -> float:
    return one.objective / (points - 5)


def _parallaxes_behind(a: Bundle, b: Bundle, one: Coplanarity) -> FloatArray:
    """(n,) parallax in σ of the points behind, 0 of those in front: what it takes to make their rays parallel.

    σ are those of the rays and of the attitude.
    """
    behind, parallax, of_rays, of_turn = _parallaxes(a, b, one)
    return np.where(behind, parallax / np.hypot(of_rays, of_turn), 0.0)


def _is_contradicted(a: Bundle, b: Bundle, one: Coplanarity) -> bool:
    """True where a point is behind beyond doubt, or all that are behind together.

    Their rays err each for itself, and the attitude for all of them alike: the mean of n parallaxes has the variance
    σ²/n of the rays, and the whole one of the attitude.
    """
    behind, parallax, of_rays, of_turn = _parallaxes(a, b, one)
    if not behind.any():
        return False
    alone = parallax[behind] / np.hypot(of_rays[behind], of_turn)
    of_mean = np.sqrt(np.mean(of_rays[behind] ** 2) / np.count_nonzero(behind))
    return bool(max(alone.max(), parallax[behind].mean() / np.hypot(of_mean, of_turn)) > SURE)


def _parallaxes(a: Bundle, b: Bundle, one: Coplanarity) -> tuple[BoolArray, FloatArray, FloatArray, float]:
    """(n,) which points are behind, parallaxes and what the rays err in them (radians), and the attitude in all."""
    behind = ~np.all(in_front(a, b, one.base, one.rotation), axis=1)
    parallax = np.linalg.norm(cross(a.directions, b.directions @ one.rotation), axis=1)
    of_rays = np.hypot(a.sigma / np.linalg.norm(a.rays, axis=1), b.sigma / np.linalg.norm(b.rays, axis=1))
    of_turn = float(np.sqrt(np.max(tolerant.eigvalsh(orientation_covariance(one)[3:, 3:]))))
    return behind, parallax, of_rays, of_turn


def _outcome(
    a: Bundle, b: Bundle, chosen: Coplanarity, rivals: list[Coplanarity], covariance: FloatArray
) -> RelativeOutcome:
    if np.sqrt(_variance(chosen, len(a))) > WRONG:
        return RelativeOutcome.DOES_NOT_FIT
    if np.sum(_parallaxes_behind(a, b, chosen) <= SURE) < BEHIND * len(a):
        mirrored = max(_same_but_behind(c) for c in candidates_of(a, b, chosen))
        return RelativeOutcome.MIRRORED if mirrored >= BEHIND * len(a) else RelativeOutcome.BEHIND
    if rivals:
        return RelativeOutcome.AMBIGUOUS
    return RelativeOutcome.DETERMINED if sigma_hold(a, b, chosen, covariance) else RelativeOutcome.WEAK


def _same_but_behind(c: Candidate) -> int:
    return min(c.in_front_of_a, c.in_front_of_a + c.in_front_of_b - 2 * c.in_front_of_both)
