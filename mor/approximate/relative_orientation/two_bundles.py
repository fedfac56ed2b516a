"""Relative orientation of two bundles: from eight or more homologous rays to one adjusted, judged result.

Seeds come from Rinner's linear system, made compatible; from five-point samples where that system is weak,
where few points make its noise large, or where its result does not fit; from Killian's quadrilateral where
the points lie in a plane. Every seed is adjusted rigorously; the objective and the depths decide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import fit_homography, fit_turn
from mor.approximate.planar.two_images import COLLINEAR, solutions_of_homography, thickness
from mor.approximate.relative_orientation.assessment import Judged, failed, result
from mor.approximate.relative_orientation.base_directions import minima_over_directions
from mor.approximate.relative_orientation.compatibility import compatible_unknowns
from mor.approximate.relative_orientation.coplanarity import (
    Coplanarity,
    adjust_coplanarity,
    both_fronts,
    first_order_residuals,
    in_front,
)
from mor.approximate.relative_orientation.five_points import five_point_unknowns
from mor.approximate.relative_orientation.outcome import RelativeOrientation, RelativeOutcome, SceneGeometry
from mor.approximate.relative_orientation.rinner import (
    LinearSolution,
    auxiliary_unknowns,
    coplanarity_rows,
    four_candidates,
    homogeneous_unknowns,
    nearest_rotation,
)
from mor.arrays import BoolArray, FloatArray

MINIMUM = 8
FEW = 15
"""Up to so many points the five-point seeds are tried as well, whatever the linear system gives."""
SAMPLES = 30
"""Five-point samples for seeds."""
SEEDS = 6
"""Best five-point seeds that are adjusted."""
FIRST_STEPS = 8
FAR_BEHIND = 20.0
"""A seed is given up if after its first steps Σ (v/σ)² exceeds that of the best, plus n, so many times."""
SMALL = 15.0
"""Parallaxes of fewer σ than that: the least of all minima is looked for over all directions of the base."""
LOST = 2.9e-7
"""Probability that points on a critical surface show a rank of the linear system by their errors alone (5 σ)."""


class Seed(NamedTuple):
    """An orientation to start the adjustment from."""

    base: FloatArray
    rotation: FloatArray


def relative_orientation(a: Bundle, b: Bundle) -> RelativeOrientation:
    """Orientation of bundle ``b`` in ``a`` from n ≥ 8 homologous rays, without approximate values.

    All rays are believed (see ``robust.robust_relative_orientation`` otherwise).
    Degenerate data do not raise: the outcome names them. Source: Rinner 1956, see
    :mod:`mor.approximate.relative_orientation.rinner`.
    """
    refusal = _refusal(a, b)
    if refusal is not None:
        return failed(refusal, len(a))
    turned = turn_without_base(a, b)
    if turned.misfit < 1.0:
        identical = float(np.max(np.abs(turned.rotation - np.eye(3)))) < COLLINEAR * np.hypot(
            a.noise, b.noise
        )
        outcome = RelativeOutcome.IDENTICAL if identical else RelativeOutcome.NO_BASE
        return failed(outcome, len(a), fit_turn(a, b))
    linear = linear_system(a, b)
    geometry, seeds = _seeds(a, b, linear)
    adjusted = adjust_seeds(a, b, seeds)
    if geometry is SceneGeometry.PLANE:
        # The plane is a strong constraint that the adjustment lets go of: what it says itself stays in the
        # race.
        adjusted += [adjust_coplanarity(a, b, *seed, iterations=1) for seed in seeds]
    elif len(a) <= FEW or _doubtful(a, b, adjusted, geometry):
        adjusted = distinct(adjusted + adjust_seeds(a, b, five_point_seeds(a, b)))
    if turned.parallax < SMALL:
        minima = minima_over_directions(a, b, turned.rotation)
        everywhere = [best_of_four(a, b, auxiliary_unknowns(*one)) for one in minima]
        adjusted = distinct(adjusted + adjust_seeds(a, b, everywhere))
    of_plane = [(seed.base, seed.rotation) for seed in seeds] if geometry is SceneGeometry.PLANE else []
    return result(a, b, Judged(geometry, linear.singular_values, adjusted, of_plane))


def linear_system(a: Bundle, b: Bundle) -> LinearSolution:
    """Rinner's linear system (5) with rows in units of σ: solved, weighted anew with its own solution,
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


class Turned(NamedTuple):
    """The attitude that fits best when there is no base."""

    rotation: FloatArray
    misfit: float
    """Σ (v/σ)² over its limit: below 1 nothing speaks for a base."""
    parallax: float
    """Root mean square of what the turn leaves, in σ."""


def turn_without_base(a: Bundle, b: Bundle) -> Turned:
    """Rotation D* that turns the directions of ``a`` into those of ``b``, and whether it explains them."""
    rotation = nearest_rotation(b.directions.T @ a.directions)
    offset = b.directions - a.directions @ rotation.T
    sigma = np.hypot(
        a.sigma / np.linalg.norm(a.rays, axis=1),
        b.sigma / np.linalg.norm(b.rays, axis=1),
    )
    normalised = float(np.sum(np.sum(offset**2, axis=1) / sigma**2))
    redundancy = 2 * len(a) - 3
    limit = redundancy + 5.0 * np.sqrt(2.0 * redundancy)
    return Turned(rotation, normalised / limit, float(np.sqrt(normalised / redundancy)))


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


def _seeds(a: Bundle, b: Bundle, linear: LinearSolution) -> tuple[SceneGeometry, list[Seed]]:
    homography = fit_homography(a, b)
    redundancy = homography.redundancy
    if homography.objective <= redundancy + 5.0 * np.sqrt(2.0 * redundancy):
        planes = solutions_of_homography(homography.matrix, a.rays, b.rays)
        return SceneGeometry.PLANE, [
            Seed(plane.base / np.linalg.norm(plane.base), plane.rotation)
            for plane in planes
            if np.linalg.norm(plane.base) > 0.0
        ]
    critical = float(np.sum(linear.singular_values[7:] ** 2)) < chdtri(2 * (len(a) - 7), LOST)
    geometry = SceneGeometry.CRITICAL_SURFACE if critical else SceneGeometry.GENERAL
    corrected = compatible_unknowns(linear.ik, linear.normal).ik
    return geometry, [best_of_four(a, b, ik) for ik in (corrected, linear.ik)]


def best_of_four(a: Bundle, b: Bundle, ik: FloatArray) -> Seed:
    """Of the four candidates of ``ik`` (3, 3) the one with most points in front of both bundles."""
    return facing(a, b, ik)[0]


def facing(a: Bundle, b: Bundle, ik: FloatArray) -> tuple[Seed, BoolArray]:
    """The best of the four candidates of ``ik`` (3, 3), and which points (n,) it has in front of both bundles."""
    candidates = [Seed(*candidate) for candidate in four_candidates(ik)]
    first, opposite = (both_fronts(a, b, *one) for one in candidates[:2])
    fronts = [np.all(front, axis=1) for front in (first[0], opposite[0], opposite[1], first[1])]
    best = int(np.argmax([np.count_nonzero(front) for front in fronts]))
    return candidates[best], fronts[best]


def five_point_seeds(a: Bundle, b: Bundle) -> list[Seed]:
    """Return the best orientations among those of fixed pseudo-random five-point samples."""
    generator = np.random.default_rng(len(a))
    chosen = np.stack([generator.permutation(len(a))[:5] for _ in range(SAMPLES)])
    unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
    return [best_of_four(a, b, ik) for ik in apart(a, b, unknowns, SEEDS)]


def apart(a: Bundle, b: Bundle, unknowns: FloatArray, most: int) -> list[FloatArray]:
    """Of auxiliary unknowns (k, 3, 3) the ``most`` that fit best and differ from one another."""
    if not len(unknowns):
        return []
    misfits = np.minimum(first_order_residuals(a, b, unknowns), 1e6)
    order = np.argsort(np.sum(misfits**2, axis=1))
    kept: list[FloatArray] = []
    for index in order:
        if len(kept) == most:
            break
        if all(_apart(unknowns[index], other) for other in kept):
            kept.append(unknowns[index])
    return kept


def _apart(first: FloatArray, second: FloatArray) -> bool:
    return min(float(np.linalg.norm(first - second)), float(np.linalg.norm(first + second))) > 0.02


def adjust_seeds(a: Bundle, b: Bundle, seeds: list[Seed]) -> list[Coplanarity]:
    """Adjust every seed and turn it the way that most points lie in front; distinct results, best objective first.

    Seeds that are far behind the best after a few steps are given up.
    """
    begun = [adjust_coplanarity(a, b, *seed, iterations=FIRST_STEPS) for seed in seeds]
    promising = FAR_BEHIND * (min((one.objective for one in begun), default=0.0) + len(a))
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
        if all(_differs(ik, auxiliary_unknowns(other.base, other.rotation)) for other in kept):
            kept.append(one)
    return kept


def _differs(first: FloatArray, second: FloatArray) -> bool:
    return min(float(np.linalg.norm(first - second)), float(np.linalg.norm(first + second))) > 1e-4


def _doubtful(a: Bundle, b: Bundle, adjusted: list[Coplanarity], geometry: SceneGeometry) -> bool:
    best = adjusted[0]
    redundancy = len(a) - 5
    fits = best.objective < redundancy + 4.0 * np.sqrt(2.0 * redundancy)
    front = np.all(in_front(a, b, best.base, best.rotation))
    return geometry is SceneGeometry.CRITICAL_SURFACE or not best.converged or not fits or not bool(front)
