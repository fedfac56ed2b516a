"""Robust relative orientation of two bundles, and its assessment."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.model import rotations
from mor.model.rotations import angles_by_tangent, angles_from_rotation
from mor.start.bundle import AS_GOOD, BY_ITSELF, Bundle, cross, samples
from mor.start.killian import COLLINEAR, BundleRotation, fit_homography, fit_turn, solutions_of_homography, thickness
from mor.start.relative_orientation import (
    Coplanarity,
    LinearSolution,
    OrientationCandidate,
    RelativeOrientation,
    RelativeOutcome,
    SceneGeometry,
    adjust_coplanarity,
    auxiliary_unknowns,
    both_fronts,
    compatible_unknowns,
    coplanarity_rows,
    first_order_residuals,
    five_point_unknowns,
    four_candidates,
    homogeneous_unknowns,
    in_front,
    minima_over_directions,
    nearest_rotation,
    sigma_hold,
)
from mor.types import BoolArray, FloatArray

# ---- Judgement of adjusted relative orientations: front, fit, precision, ambiguity.

BEHIND = 0.9
"""Part of the points that must lie in front of both bundles; the rest may be wrong pairs or far points."""
SURE = 5.0
"""Standard deviations of its parallactic angle beyond which a point behind is behind, whatever the errors."""


class PairAssessment(NamedTuple):
    """Parts of the result."""

    geometry: SceneGeometry
    """A critical surface where the linear system has lost a rank, whatever comes of it."""
    singular_values: FloatArray
    adjusted: list[Coplanarity]
    """Distinct adjusted orientations, best objective first."""
    of_plane: list[tuple[FloatArray, FloatArray]]
    """(b, D*) of the orientations that carry a plane over; empty where the points are in none."""


def failed(outcome: RelativeOutcome, points: int, turn: BundleRotation | None = None) -> RelativeOrientation:
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


def result(a: Bundle, b: Bundle, judged: PairAssessment) -> RelativeOrientation:
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
    # Fewer points than that lie, to their precision, on one quadric with both centres now and then by accident.
    if found is SceneGeometry.CRITICAL_SURFACE and not harm and points < 12:
        return SceneGeometry.GENERAL
    return found


def _of_plane(a: Bundle, b: Bundle, judged: PairAssessment, chosen: Coplanarity) -> tuple[OrientationCandidate, ...]:
    def away(one: tuple[FloatArray, FloatArray]) -> float:
        return float(np.linalg.norm(one[0] - chosen.base) + np.linalg.norm(one[1] - chosen.rotation))

    return tuple(candidate(a, b, *one) for one in sorted(judged.of_plane, key=away))


def _choice(a: Bundle, b: Bundle, judged: PairAssessment) -> tuple[Coplanarity, list[Coplanarity]]:
    """Choose the solution with fewest points certainly behind a camera, then with the least sum of squares.

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
    sigma = float(np.sqrt(np.max(rotations.eigvalsh(orientation_covariance(chosen)))))
    # Standard deviations: where the adjustment came to rest in both, two minima are two, whatever one covariance says.
    rivals = [
        one
        for one, hidden in zip(fitting, behind, strict=True)
        if hidden <= min(behind)
        and one.objective <= as_good
        and _distance(one, chosen) > ((1.0 if one.converged and chosen.converged else 4.0) * sigma + 1e-6)
    ]
    return chosen, _one_each(rivals, 4.0 * sigma)


def _one_each(rivals: list[Coplanarity], tolerance: float) -> list[Coplanarity]:
    kept: list[Coplanarity] = []
    for one in rivals:
        if all(_distance(one, other) > tolerance + 1e-6 for other in kept):
            kept.append(one)
    return kept


def _distance(first: Coplanarity, second: Coplanarity) -> float:
    rotation = float(np.linalg.norm(first.rotation - second.rotation)) / np.sqrt(2.0)
    return float(np.hypot(rotation, np.linalg.norm(first.base - second.base)))


def candidate(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> OrientationCandidate:
    """Count the points in front of an orientation."""
    front = in_front(a, b, base, rotation)
    both = int(np.sum(np.all(front, axis=1)))
    return OrientationCandidate(base, rotation, int(np.sum(front[:, 0])), int(np.sum(front[:, 1])), both)


def candidates_of(a: Bundle, b: Bundle, chosen: Coplanarity) -> tuple[OrientationCandidate, ...]:
    """Return the four candidates of an adjusted orientation, that orientation first."""
    four = four_candidates(auxiliary_unknowns(chosen.base, chosen.rotation))
    ordered = sorted(four, key=lambda c: -float(c[0] @ chosen.base) - float(np.sum(c[1] * chosen.rotation)))
    return tuple(candidate(a, b, *pair) for pair in ordered)


def orientation_covariance(chosen: Coplanarity) -> FloatArray:
    """Covariance (6, 6) of b and δ from the five parameters; infinite where the normal matrix is singular."""
    scale = np.sqrt(np.maximum(np.diag(chosen.normal), 1e-300))
    values, vectors = rotations.eigh(chosen.normal / np.outer(scale, scale))
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
    of_turn = float(np.sqrt(np.max(rotations.eigvalsh(orientation_covariance(one)[3:, 3:]))))
    return behind, parallax, of_rays, of_turn


def _outcome(
    a: Bundle, b: Bundle, chosen: Coplanarity, rivals: list[Coplanarity], covariance: FloatArray
) -> RelativeOutcome:
    # σ0 beyond which rays and orientation do not belong together.
    if np.sqrt(_variance(chosen, len(a))) > 6.0:
        return RelativeOutcome.DOES_NOT_FIT
    if np.sum(_parallaxes_behind(a, b, chosen) <= SURE) < BEHIND * len(a):
        mirrored = max(
            min(c.in_front_of_a, c.in_front_of_a + c.in_front_of_b - 2 * c.in_front_of_both)
            for c in candidates_of(a, b, chosen)
        )
        return RelativeOutcome.MIRRORED if mirrored >= BEHIND * len(a) else RelativeOutcome.BEHIND
    if rivals:
        return RelativeOutcome.AMBIGUOUS
    return RelativeOutcome.DETERMINED if sigma_hold(a, b, chosen, covariance) else RelativeOutcome.WEAK


# ---- Relative orientation of two bundles: from eight or more homologous rays to one adjusted, judged result.
#
# Seeds come from Rinner's linear system, made compatible; from five-point samples where that system is weak,
# where few points make its noise large, or where its result does not fit; from Killian's quadrilateral where
# the points lie in a plane. Every seed is adjusted rigorously; the objective and the depths decide.

MINIMUM = 8
"""Homologous rays from which the linear system (5) has one solution."""


class StartOrientation(NamedTuple):
    """An orientation to start the adjustment from."""

    base: FloatArray
    rotation: FloatArray


def relative_orientation(a: Bundle, b: Bundle) -> RelativeOrientation:
    """Orientation of bundle ``b`` in ``a`` from n ≥ 8 homologous rays, without approximate values.

    All rays are believed (see ``robust_relative_orientation`` otherwise).
    Degenerate data do not raise: the outcome names them. Source: Rinner 1956, see
    :mod:`mor.start.relative_orientation`.
    """
    refusal = _refusal(a, b)
    if refusal is not None:
        return failed(refusal, len(a))
    rotation, misfit, parallax = turn_without_base(a, b)
    if misfit < 1.0:
        identical = float(np.max(np.abs(rotation - np.eye(3)))) < COLLINEAR * np.hypot(a.noise, b.noise)
        outcome = RelativeOutcome.IDENTICAL if identical else RelativeOutcome.NO_BASE
        return failed(outcome, len(a), fit_turn(a, b))
    linear = linear_system(a, b)
    geometry, seeds = _seeds(a, b, linear)
    adjusted = adjust_seeds(a, b, seeds)
    if geometry is SceneGeometry.PLANE:
        # The plane is a strong constraint that the adjustment lets go of: what it says itself stays in the
        # race.
        adjusted += [adjust_coplanarity(a, b, *seed, iterations=1) for seed in seeds]
    # Up to so many points the five-point seeds are tried as well, whatever the linear system gives.
    elif len(a) <= 15 or _doubtful(a, b, adjusted, geometry):
        adjusted = distinct(adjusted + adjust_seeds(a, b, five_point_seeds(a, b)))
    # Parallaxes of fewer σ than that: the least of all minima is looked for over all directions of the base.
    if parallax < 15.0:
        minima = minima_over_directions(a, b, rotation)
        everywhere = [best_of_four(a, b, auxiliary_unknowns(*one)) for one in minima]
        adjusted = distinct(adjusted + adjust_seeds(a, b, everywhere))
    of_plane = [(seed.base, seed.rotation) for seed in seeds] if geometry is SceneGeometry.PLANE else []
    return result(a, b, PairAssessment(geometry, linear.singular_values, adjusted, of_plane))


def linear_system(a: Bundle, b: Bundle) -> LinearSolution:
    """Rinner's linear system (5) with rows in units of σ: solved, reweighted with its own solution,
    solved again.

    The rays are scaled to length one first; ik and singular values belong to unit rays.
    """
    first = homogeneous_unknowns(coplanarity_rows(a.directions, b.directions))
    rows = coplanarity_rows(a.directions, b.directions)
    slope_a = np.einsum("nij,ni->nj", _unit_axes(a), b.directions @ first.ik.T)
    slope_b = np.einsum("nij,ni->nj", _unit_axes(b), a.directions @ first.ik)
    variance = np.sum(slope_a**2, axis=1) + np.sum(slope_b**2, axis=1)
    floor = 1e-4 * float(np.mean(variance)) + 1e-300
    return homogeneous_unknowns(rows / np.sqrt(variance + floor)[:, None])


def _unit_axes(bundle: Bundle) -> FloatArray:
    return np.asarray(bundle.whitened_axes / np.linalg.norm(bundle.rays, axis=1)[:, None, None])


def turn_without_base(a: Bundle, b: Bundle) -> tuple[FloatArray, float, float]:
    """Rotation D* (3, 3) that turns the directions of ``a`` into those of ``b``, and whether it explains them.

    Σ (v/σ)² over its limit: below 1 nothing speaks for a base; and the root mean square of what the turn leaves, in σ.
    """
    rotation = nearest_rotation(b.directions.T @ a.directions)
    offset = b.directions - a.directions @ rotation.T
    sigma = np.hypot(a.sigma / np.linalg.norm(a.rays, axis=1), b.sigma / np.linalg.norm(b.rays, axis=1))
    normalised = float(np.sum(np.sum(offset**2, axis=1) / sigma**2))
    redundancy = 2 * len(a) - 3
    limit = redundancy + 5.0 * np.sqrt(2.0 * redundancy)
    return rotation, normalised / limit, float(np.sqrt(normalised / redundancy))


def _refusal(a: Bundle, b: Bundle) -> RelativeOutcome | None:
    if len(a) != len(b):
        return RelativeOutcome.INVALID
    for bundle in (a, b):
        if not np.all(np.isfinite(bundle.rays)) or np.any(np.linalg.norm(bundle.rays, axis=1) == 0.0):
            return RelativeOutcome.INVALID
    if len(a) < MINIMUM:
        return RelativeOutcome.TOO_FEW
    if min(thickness(a) / a.noise, thickness(b) / b.noise) < COLLINEAR:
        return RelativeOutcome.COLLINEAR
    return None


def _seeds(a: Bundle, b: Bundle, linear: LinearSolution) -> tuple[SceneGeometry, list[StartOrientation]]:
    homography = fit_homography(a, b)
    redundancy = homography.redundancy
    if homography.objective <= redundancy + 5.0 * np.sqrt(2.0 * redundancy):
        planes = solutions_of_homography(homography.matrix, a.rays, b.rays)
        return SceneGeometry.PLANE, [
            StartOrientation(plane.base / np.linalg.norm(plane.base), plane.rotation)
            for plane in planes
            if np.linalg.norm(plane.base) > 0.0
        ]
    critical = float(np.sum(linear.singular_values[7:] ** 2)) < chdtri(2 * (len(a) - 7), BY_ITSELF)
    geometry = SceneGeometry.CRITICAL_SURFACE if critical else SceneGeometry.GENERAL
    corrected = compatible_unknowns(linear.ik, linear.normal).ik
    return geometry, [best_of_four(a, b, ik) for ik in (corrected, linear.ik)]


def best_of_four(a: Bundle, b: Bundle, ik: FloatArray) -> StartOrientation:
    """Return the candidate of ``ik`` (3, 3), of four, with most points in front of both bundles."""
    return facing(a, b, ik)[0]


def facing(a: Bundle, b: Bundle, ik: FloatArray) -> tuple[StartOrientation, BoolArray]:
    """The best of the four candidates of ``ik`` (3, 3), and which points (n,) it has in front of both bundles."""
    candidates = [StartOrientation(*candidate) for candidate in four_candidates(ik)]
    first, opposite = (both_fronts(a, b, *one) for one in candidates[:2])
    fronts = [np.all(front, axis=1) for front in (first[0], opposite[0], opposite[1], first[1])]
    best = int(np.argmax([np.count_nonzero(front) for front in fronts]))
    return candidates[best], fronts[best]


def five_point_seeds(a: Bundle, b: Bundle) -> list[StartOrientation]:
    """Return the best orientations among those of fixed pseudo-random five-point samples."""
    chosen = next(samples(len(a), 5, 30, 30, np.random.default_rng(len(a))))
    unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
    # Best five-point seeds that are adjusted.
    return [best_of_four(a, b, ik) for ik in apart(a, b, unknowns, 6)]


def apart(a: Bundle, b: Bundle, unknowns: FloatArray, most: int) -> list[FloatArray]:
    """Return the ``most`` auxiliary unknowns (k, 3, 3) that fit best and differ from one another."""
    if not len(unknowns):
        return []
    misfits = np.minimum(first_order_residuals(a, b, unknowns), 1e6)
    order = np.argsort(np.sum(misfits**2, axis=1))
    kept: list[FloatArray] = []
    for index in order:
        if len(kept) == most:
            break
        if all(_apart(unknowns[index], other, 0.02) for other in kept):
            kept.append(unknowns[index])
    return kept


def _apart(first: FloatArray, second: FloatArray, tolerance: float) -> bool:
    """True where two sets of auxiliary unknowns, whose signs are free, differ."""
    return min(float(np.linalg.norm(first - second)), float(np.linalg.norm(first + second))) > tolerance


def adjust_seeds(a: Bundle, b: Bundle, seeds: list[StartOrientation]) -> list[Coplanarity]:
    """Adjust every seed and turn it the way that most points lie in front; distinct results, best objective first.

    Seeds that are far behind the best after a few steps are given up.
    """
    begun = [adjust_coplanarity(a, b, *seed, iterations=8) for seed in seeds]
    # A seed is given up if after its first steps Σ (v/σ)² exceeds that of the best, plus n, so many times.
    promising = 20.0 * (min((one.objective for one in begun), default=0.0) + len(a))
    finished = [
        one if one.converged else adjust_coplanarity(a, b, one.base, one.rotation)
        for one in distinct(begun)
        if one.objective <= promising
    ]
    return distinct([_facing(a, b, one) for one in finished])


def _facing(a: Bundle, b: Bundle, adjusted: Coplanarity) -> Coplanarity:
    # On its way the adjustment can pass to the twisted orientation, which fits alike with the points behind.
    best = best_of_four(a, b, auxiliary_unknowns(adjusted.base, adjusted.rotation))
    if float(best.base @ adjusted.base) > 0.0 and float(np.sum(best.rotation * adjusted.rotation)) > 2.99:
        return adjusted
    return adjust_coplanarity(a, b, *best)


def distinct(adjusted: list[Coplanarity]) -> list[Coplanarity]:
    """Sort by objective and leave out those that other seeds reached too."""
    kept: list[Coplanarity] = []
    for one in sorted(adjusted, key=lambda orientation: orientation.objective):
        ik = auxiliary_unknowns(one.base, one.rotation)
        if all(_apart(ik, auxiliary_unknowns(other.base, other.rotation), 1e-4) for other in kept):
            kept.append(one)
    return kept


def _doubtful(a: Bundle, b: Bundle, adjusted: list[Coplanarity], geometry: SceneGeometry) -> bool:
    best = adjusted[0]
    redundancy = len(a) - 5
    fits = best.objective < redundancy + 4.0 * np.sqrt(2.0 * redundancy)
    front = np.all(in_front(a, b, best.base, best.rotation))
    return geometry is SceneGeometry.CRITICAL_SURFACE or not best.converged or not fits or not bool(front)


# ---- Relative orientation against a few per cent of wrong pairs: sampling, then adjustment of what agrees.
#
# Samples of five pairs give compatible unknowns (also for plane scenes); each is judged by the truncated sum of
# squared residuals of all pairs (M. A. Fischler, R. C. Bolles 1981; truncation after P. Torr, A. Zisserman
# 2000). The best set of agreeing pairs is adjusted and drawn again until it stands. The seed is fixed: same
# input, same result.

TRUNCATION = 5.0
"""Residual v/σ at which a pair stops counting while samples are compared."""
AGREES = 4.0
"""Residual v/σ up to which a pair agrees with an adjusted orientation."""


class RobustOrientation(NamedTuple):
    """A relative orientation and the pairs it rests on."""

    orientation: RelativeOrientation
    """Of the agreeing pairs; its residuals and front flags belong to these, in their order."""
    agreeing: BoolArray
    """(n,) the pairs that were used."""
    residuals: FloatArray
    """(n,) v/σ of all pairs; not a number where nothing was found."""
    samples: int
    """Number of samples drawn; 0 if all pairs agreed at once."""


def robust_relative_orientation(a: Bundle, b: Bundle) -> RobustOrientation:
    """Orientation of ``b`` in ``a`` from n ≥ 8 homologous rays, some of which may be wrong pairs.

    If all agree this is ``relative_orientation`` itself. Wrong pairs that lie on
    the right plane through the base cannot be seen, except by their depth. Outcomes are data, as there.
    """
    everything = relative_orientation(a, b)
    believable = everything.outcome not in (
        RelativeOutcome.DOES_NOT_FIT,
        RelativeOutcome.BEHIND,
        RelativeOutcome.MIRRORED,
    )
    small = bool(np.all(np.abs(np.nan_to_num(everything.residuals)) < AGREES))
    agree = small and bool(np.all(everything.front))
    if believable and (agree or not everything.outcome.usable):
        return RobustOrientation(everything, np.ones(len(a), dtype=bool), everything.residuals, 0)
    ik, samples = _sampled(a, b, np.random.default_rng(1956))
    if ik is None:
        return _nothing(everything, len(a), samples)
    found = _settled(a, b, ik)
    # Part of the pairs that must agree for an orientation to be believed.
    if found is None or np.sum(found) < max(MINIMUM, 0.5 * len(a)):
        return _nothing(everything, len(a), samples)
    orientation = relative_orientation(a.take(found), b.take(found))
    for _ in range(10):
        if not orientation.outcome.usable:
            return RobustOrientation(orientation, found, np.full(len(a), np.nan), samples)
        now = _agreeing(a, b, orientation.base, orientation.rotation)
        if np.array_equal(now, found) or np.sum(now) < MINIMUM:
            break
        found, orientation = now, relative_orientation(a.take(now), b.take(now))
    unknowns = auxiliary_unknowns(orientation.base, orientation.rotation)
    residuals = first_order_residuals(a, b, unknowns[None])[0]
    meeting = residuals < AGREES
    if np.sum(found) < BEHIND * np.sum(meeting):
        # Many rays meet, but behind a frame: no wrong pairs, but a mirrored or reversed bundle.
        whole = relative_orientation(a.take(meeting), b.take(meeting))
        if not whole.outcome.usable:
            return RobustOrientation(whole, np.zeros(len(a), dtype=bool), residuals, samples)
    return RobustOrientation(_doubted(a.take(found), b.take(found), orientation), found, residuals, samples)


def _doubted(a: Bundle, b: Bundle, orientation: RelativeOrientation) -> RelativeOrientation:
    """Ambiguous, if all but a few pairs lie in a plane that leaves several orientations.

    A wrong pair that happens to fit one of them would decide between them otherwise.
    """
    few = max(2, 0.05 * len(a))
    plane = _plane_part(a, b, int(few))
    if orientation.outcome is not RelativeOutcome.DETERMINED or not 0 < np.sum(~plane) <= few:
        return orientation
    of_plane = relative_orientation(a.take(plane), b.take(plane))
    if of_plane.outcome is not RelativeOutcome.AMBIGUOUS:
        return orientation
    every = [candidate(a, b, of_plane.base, of_plane.rotation), *of_plane.alternatives]
    # Distance of two rotations beyond which they are different ones.
    others = tuple(one for one in every if float(np.linalg.norm(one.rotation - orientation.rotation)) > 0.01)
    return orientation._replace(outcome=RelativeOutcome.AMBIGUOUS, geometry=SceneGeometry.PLANE, alternatives=others)


def _plane_part(a: Bundle, b: Bundle, few: int) -> BoolArray:
    kept = np.ones(len(a), dtype=bool)
    for _ in range(few + 1):
        homography = fit_homography(a.take(kept), b.take(kept))
        if np.all(homography.residuals < AGREES):
            return kept
        kept[np.flatnonzero(kept)[int(np.argmax(homography.residuals))]] = False
    return np.zeros(len(a), dtype=bool)


def _agreeing(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> BoolArray:
    unknowns = auxiliary_unknowns(base, rotation)
    front = np.all(in_front(a, b, base, rotation), axis=1)
    return np.asarray((first_order_residuals(a, b, unknowns[None])[0] < AGREES) & front)


def _nothing(everything: RelativeOrientation, points: int, samples: int) -> RobustOrientation:
    kept = everything if not everything.outcome.usable else failed(RelativeOutcome.DOES_NOT_FIT, points)
    return RobustOrientation(kept, np.zeros(points, dtype=bool), np.full(points, np.nan), samples)


def _sampled(a: Bundle, b: Bundle, generator: np.random.Generator) -> tuple[FloatArray | None, int]:
    """Best unknowns over samples, drawn until one free of wrong pairs is all but certain."""
    best, best_cost = None, np.inf
    drawn = 0
    for chosen in samples(len(a), 5, 1000, 25, generator):
        drawn += len(chosen)
        unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
        if len(unknowns):
            residuals = first_order_residuals(a, b, unknowns)
            costs = np.sum(np.minimum(residuals, TRUNCATION) ** 2, axis=1)
            # Best unknowns of a batch whose depths are looked at.
            for index in np.argsort(costs)[:12]:
                if costs[index] >= best_cost:
                    break
                counted = _counted(a, b, unknowns[index], residuals[index])
                cost = float(np.sum(counted**2))
                if cost < best_cost:
                    best, best_cost = unknowns[index], cost
                    agreeing = float(np.mean(counted < TRUNCATION))
        # A sample free of wrong pairs may still be too noisy: three are asked for, but for a probability of 1e-4.
        if best is not None and drawn / 3.0 >= np.log(1e-4) / np.log(1.0 - min(max(agreeing, 1e-3), 1.0 - 1e-6) ** 5):
            break
    return best, drawn


def _counted(a: Bundle, b: Bundle, ik: FloatArray, residuals: FloatArray) -> FloatArray:
    """Residuals truncated, those of points behind too: a plane bears unknowns that fit with half of it behind."""
    _, front = facing(a, b, ik)
    return np.asarray(np.where(front, np.minimum(residuals, TRUNCATION), TRUNCATION))


def _settled(a: Bundle, b: Bundle, ik: FloatArray) -> BoolArray | None:
    """Pairs that agree with the orientation adjusted to themselves, starting from the unknowns of a sample."""
    agreeing: BoolArray = first_order_residuals(a, b, ik[None])[0] < 2.0 * TRUNCATION
    base, rotation = best_of_four(a.take(agreeing), b.take(agreeing), ik)
    for _ in range(10):
        if np.sum(agreeing) < MINIMUM:
            return None
        chosen_a, chosen_b = a.take(agreeing), b.take(agreeing)
        adjusted = adjust_coplanarity(chosen_a, chosen_b, base, rotation)
        unknowns = auxiliary_unknowns(adjusted.base, adjusted.rotation)
        base, rotation = best_of_four(chosen_a, chosen_b, unknowns)
        now = _agreeing(a, b, base, rotation)
        if np.array_equal(now, agreeing) or np.sum(now) < MINIMUM:
            break
        agreeing = now
    return agreeing


# ---- All orientations that two bundles leave open: of five to seven homologous points, of a plane, of weak pairs.
#
# What decides between them is a third bundle, or control. With five points there are up to ten exact
# orientations, with six or seven as many as fit within their errors; from eight on those that
# ``relative_orientation`` cannot tell apart.

FEWEST = 5
"""Homologous rays from which an orientation is one of a finite number."""


def fitting_orientations(a: Bundle, b: Bundle) -> list[StartOrientation]:
    """Orientations (b, D*) of bundle ``b`` in ``a`` that fit n ≥ 5 homologous rays, the best first.

    Distinct ones, with all points in front of both bundles (from eight points on: but for a few).
    """
    if len(a) < FEWEST:
        return []
    if len(a) >= MINIMUM:
        found = robust_relative_orientation(a, b).orientation
        if not found.outcome.usable:
            return []
        candidates = [StartOrientation(found.base, found.rotation)]
        return candidates + [StartOrientation(one.base, one.rotation) for one in found.alternatives]
    # Samples of five: all of seven points.
    chosen = np.array(list(combinations(range(len(a)), FEWEST))[:21])
    unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
    # Solutions of samples that are adjusted, the best that differ.
    adjusted = adjust_seeds(a, b, [best_of_four(a, b, ik) for ik in apart(a, b, unknowns, 12)])
    # Probability that a right orientation fits worse.
    limit = float(chdtri(max(len(a) - FEWEST, 0.1), 1e-4))
    fitting = [StartOrientation(one.base, one.rotation) for one in adjusted if one.objective <= limit]
    return [seed for seed in fitting if bool(np.all(in_front(a, b, *seed)))]
