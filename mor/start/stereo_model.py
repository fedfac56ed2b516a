"""The model of two oriented images."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from mor.model import rotations as tolerant
from mor.model.rotations import cross_matrix, rotate
from mor.start.bundle import AS_GOOD, Bundle, reproject, tangent_axes
from mor.start.image_pair import PairAssessment, RobustOrientation, candidate, linear_system, result
from mor.start.intersection import IntersectionOutcome, intersect
from mor.start.relative_orientation import (
    RelativeOrientation,
    RelativeOutcome,
    SceneGeometry,
    adjust_coplanarity,
    auxiliary_unknowns,
    compatible_unknowns,
    printed_conditions,
)
from mor.types import BoolArray, FloatArray, IntArray

# ---- Rinner's auxiliary unknowns: linear, made compatible, adjusted; with the conditions and the corrections.

CONDITIONS = ("(13)", "(14)", "(15)", "(16) 1", "(16) 2", "(16) 3")
"""Numbers in the paper, in the order of :func:`printed_conditions`."""


class Auxiliary(NamedTuple):
    """The nine ik (3, 3) and the misclosures (6,) of the conditions.

    The linear ones are no numbers where the points lie in a plane.
    """

    linear: FloatArray
    corrections: FloatArray
    compatible: FloatArray
    adjusted: FloatArray
    sigma: FloatArray
    """(3, 3) of the adjusted ones."""
    misclosures: FloatArray
    """Of the linear ik."""
    remaining: FloatArray
    """Of the adjusted ik."""


def auxiliary_of(a: Bundle, b: Bundle, found: RelativeOrientation) -> Auxiliary:
    """All three for the homologous rays that ``found`` rests on."""
    nothing = np.full((3, 3), np.nan)
    linear = corrections = compatible = nothing
    misclosures = np.full(len(CONDITIONS), np.nan)
    if found.geometry is not SceneGeometry.PLANE:
        system = linear_system(a, b)
        sign = 1.0 if float(np.sum(system.ik * found.unknowns)) >= 0.0 else -1.0
        linear = sign * system.ik
        compatible, corrections, _ = compatible_unknowns(linear, system.normal)
        misclosures = printed_conditions(linear)
    # Standard deviation of ik = −[b]× D*ᵀ, by b and δ: D* ← exp(−[δ]×) D*.
    columns = [auxiliary_unknowns(axis, found.rotation).ravel() for axis in np.eye(3)]
    columns += [auxiliary_unknowns(found.base, -cross_matrix(axis) @ found.rotation).ravel() for axis in np.eye(3)]
    rows = np.stack(columns, axis=1)
    return Auxiliary(
        linear,
        corrections,
        compatible,
        found.unknowns,
        np.sqrt(np.maximum(np.diag(rows @ found.covariance @ rows.T), 0.0)).reshape(3, 3),
        misclosures,
        printed_conditions(found.unknowns),
    )


# ---- The model of a chain of images: pairs joined by scale from common points, then all of it adjusted together.
#
# Every pair is oriented by itself (Rinner); the base of each further one is stretched until the points it has
# in common with the one before lie equally far from the image that both share. What follows is the bundle
# adjustment of the free model: the first image held, the first base of length one, points eliminated. Its σ
# are those of every result.


class Chain(NamedTuple):
    """Frames in the axes of the first image, the first base as unit."""

    positions: FloatArray
    """(m, 3)"""
    rotations: FloatArray
    """(m, 3, 3)"""
    common: IntArray
    """(m − 2,) points that carried the scale from each pair to the next; 0 ends the chain there.

    −1 where images stand in one place: there is no scale to carry yet, or it is carried past them.
    """
    unit: int
    """The image whose distance from the first one is the unit of length."""


class StereoModel(NamedTuple):
    """The adjusted model."""

    positions: FloatArray
    """(m, 3)"""
    rotations: FloatArray
    """(m, 3, 3)"""
    points: FloatArray
    """(n, 3); not a number where ``reasons`` says why."""
    frame_covariance: FloatArray
    """(m, 6, 6) of X0 and δ, for the a-priori σ of the rays."""
    point_covariance: FloatArray
    """(n, 3, 3)"""
    reasons: tuple[IntersectionOutcome, ...]
    """(n,) what became of each point."""
    sigma0: float
    redundancy: int


class _Normals(NamedTuple):
    frames: FloatArray
    """(f, f) with the points eliminated."""
    side: FloatArray
    """(f,)"""
    inverse: FloatArray
    """(n, 3, 3) of the points' own blocks."""
    reach: FloatArray
    """(n, 3, f) inverse times the mixed blocks."""
    offset: FloatArray
    """(n, 3) inverse times the points' own sides."""
    objective: float


def chain(pairs: Sequence[RelativeOrientation], bundles: Sequence[Bundle], seen: BoolArray) -> Chain:
    """Chain of m − 1 oriented pairs of neighbouring images; ``seen`` (m, n) the rays that count.

    Images of a pair without a base stand in one place, turned; one pair at least has a base.
    """
    positions, rotations, common = [np.zeros(3)], [np.eye(3)], []
    length = 1.0
    based = [k for k, pair in enumerate(pairs) if np.all(np.isfinite(pair.base))]
    for k, pair in enumerate(pairs):
        passed = -1
        if k in based[1:]:
            ratios = _ratios(pairs, bundles, seen, (based[based.index(k) - 1], k))
            passed = len(ratios)
            length *= float(np.median(ratios)) if passed else float("nan")
        common.append(passed)
        positions.append(positions[k] + length * rotations[k].T @ np.nan_to_num(pair.base))
        rotations.append(pair.rotation @ rotations[k])
    return Chain(np.stack(positions), np.stack(rotations), np.array(common[1:], dtype=np.int64), based[0] + 1)


def _ratios(
    pairs: Sequence[RelativeOrientation], bundles: Sequence[Bundle], seen: BoolArray, which: tuple[int, int]
) -> FloatArray:
    """Distances of common points from the place that two pairs share: in the unit of the one, by those of the other."""
    one, other = which
    shared = np.flatnonzero(seen[one] & seen[one + 1] & seen[other] & seen[other + 1])
    before = _ranges(pairs[one], bundles[one].take(shared), bundles[one + 1].take(shared))[1]
    after = _ranges(pairs[other], bundles[other].take(shared), bundles[other + 1].take(shared))[0]
    ratios = before / after
    return np.asarray(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def _ranges(pair: RelativeOrientation, a: Bundle, b: Bundle) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) of the intersected points from both centres, the base as unit."""
    first, second = a.directions, b.directions @ pair.rotation
    normal = np.cross(first, second)
    size = np.sum(normal**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        from_a = np.sum(np.cross(pair.base, second) * normal, axis=1) / size
        from_b = np.sum(np.cross(pair.base, first) * normal, axis=1) / size
    return np.asarray(from_a), np.asarray(from_b)


def adjust_model(bundles: Sequence[Bundle], seen: BoolArray, start: Chain) -> StereoModel:
    """Bundle adjustment of the chain ``start`` and of every point that its rays, ``seen`` (m, n), determine."""
    points, reasons = _intersected(bundles, seen, start)
    used = seen & np.isfinite(points[:, 0])
    index = np.flatnonzero(np.any(used, axis=0))
    positions, rotations, chosen = start.positions, start.rotations, points[index]
    there, rays = used[:, index], [bundle.take(index) for bundle in bundles]
    damping, normals = 0.0, _normals(rays, there, (positions, rotations, chosen), start.unit)
    for _ in range(30):
        scale = np.sqrt(np.maximum(np.diag(normals.frames), 1e-300))
        scaled = normals.frames / np.outer(scale, scale) + damping * np.eye(len(scale))
        step = -tolerant.solve(scaled, normals.side / scale) / scale
        moved = _moved(positions, rotations, step, start.unit)
        shifted = chosen - normals.offset - normals.reach @ step
        tried = _normals(rays, there, (*moved, shifted), start.unit)
        gain = normals.objective - tried.objective
        if gain >= 0.0:
            positions, rotations, chosen, normals = *moved, shifted, tried
            damping = 0.0 if damping < 1e-8 else damping / 10.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if abs(gain) <= 1e-13 * normals.objective or float(np.max(np.abs(step))) < 1e-13 or damping > 1e6:
            break
    points[index] = chosen
    return _model(start._replace(positions=positions, rotations=rotations), points, index, normals, used, reasons)


def _intersected(
    bundles: Sequence[Bundle], seen: BoolArray, start: Chain
) -> tuple[FloatArray, tuple[IntersectionOutcome, ...]]:
    points, reasons = np.full((seen.shape[1], 3), np.nan), []
    for column in range(seen.shape[1]):
        images = np.flatnonzero(seen[:, column])
        rays = [bundles[int(k)].take(np.array([column])) for k in images]
        reason = IntersectionOutcome.TOO_FEW
        if len(images) > 1:
            joined = Bundle(*(np.concatenate(parts) for parts in zip(*map(_parts, rays), strict=True)))
            found = intersect(joined, start.positions[images], start.rotations[images])
            reason = found.outcome
            # Of more than two images the chain is no adjustment yet: its rays need not meet to their precision.
            if reason.usable or (len(images) > 2 and reason is IntersectionOutcome.DOES_NOT_MEET):
                points[column], reason = found.point, IntersectionOutcome.DETERMINED
        reasons.append(reason)
    return points, tuple(reasons)


def _parts(bundle: Bundle) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    return bundle.rays, bundle.normals, bundle.axes, bundle.sigma


def _basis(positions: FloatArray, unit: int) -> FloatArray:
    """(6m, f) how the unknowns move the frames: not the first, the one in unit distance not along its base."""
    basis = np.delete(np.eye(6 * len(positions))[:, 6:], 6 * unit - 6, axis=1)
    axes = tangent_axes(positions[unit] / np.linalg.norm(positions[unit]))
    basis[6 * unit : 6 * unit + 3, 6 * unit - 6 : 6 * unit - 4] = axes
    return basis


def _moved(positions: FloatArray, rotations: FloatArray, step: FloatArray, unit: int) -> tuple[FloatArray, FloatArray]:
    change = (_basis(positions, unit) @ step).reshape(-1, 6)
    moved = positions + change[:, :3]
    moved[unit] /= np.linalg.norm(moved[unit])
    return moved, rotate(rotations, change[:, 3:])


def _normals(
    bundles: Sequence[Bundle], used: BoolArray, state: tuple[FloatArray, FloatArray, FloatArray], unit: int
) -> _Normals:
    positions, rotations, points = state
    basis, count = _basis(positions, unit), len(points)
    unknowns = basis.shape[1]
    own, mixed, own_side = np.zeros((count, 3, 3)), np.zeros((count, 3, unknowns)), np.zeros((count, 3))
    frames, side, objective = np.zeros((unknowns, unknowns)), np.zeros(unknowns), 0.0
    for k, bundle in enumerate(bundles):
        seen = np.flatnonzero(used[k])
        star = (points[seen] - positions[k]) @ rotations[k].T
        computed = reproject(bundle.take(seen), star)
        by_point = computed.by_star @ rotations[k]
        by_frame = np.concatenate([-by_point, computed.by_star @ cross_matrix(star)], axis=2)
        by_unknown = by_frame @ basis[6 * k : 6 * k + 6]
        own[seen] += np.einsum("nki,nkj->nij", by_point, by_point)
        mixed[seen] += np.einsum("nki,nkj->nij", by_point, by_unknown)
        own_side[seen] += np.einsum("nki,nk->ni", by_point, computed.residuals)
        frames += np.einsum("nki,nkj->ij", by_unknown, by_unknown)
        side += np.einsum("nki,nk->i", by_unknown, computed.residuals)
        objective += float(np.sum(computed.residuals**2))
    # Make (n, 3, 3) blocks of points that ran away from all rays invertible: such a step is refused.
    trace = np.einsum("nii->n", own)
    own += np.asarray(np.where(trace > 0.0, 1e-15 * trace, 1.0)[:, None, None] * np.eye(3))
    inverse = tolerant.inv(own).astype(np.float64)
    reach, offset = inverse @ mixed, np.einsum("nij,nj->ni", inverse, own_side)
    reduced = frames - np.einsum("nki,nkj->ij", mixed, reach)
    return _Normals(reduced, side - np.einsum("nki,nk->i", mixed, offset), inverse, reach, offset, objective)


def _model(
    adjusted: Chain,
    points: FloatArray,
    index: IntArray,
    normals: _Normals,
    used: BoolArray,
    reasons: tuple[IntersectionOutcome, ...],
) -> StereoModel:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normals.frames), 1e-300))
    unknowns = tolerant.inv(normals.frames * np.outer(scale, scale)) * np.outer(scale, scale)
    basis = _basis(adjusted.positions, adjusted.unit)
    frames = basis @ unknowns @ basis.T
    blocks = np.stack([frames[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(len(adjusted.positions))])
    covariance = np.full((len(points), 3, 3), np.nan)
    covariance[index] = normals.inverse + normals.reach @ unknowns @ np.swapaxes(normals.reach, 1, 2)
    redundancy = 2 * int(np.sum(used)) - 3 * len(index) - len(scale)
    sigma0 = float(np.sqrt(normals.objective / redundancy)) if redundancy > 0 else float("nan")
    positions, rotations = adjusted.positions, adjusted.rotations
    return StereoModel(positions, rotations, points, blocks, covariance, reasons, sigma0, redundancy)


# ---- Which of several orientations of a pair a chain of images has: that with which all of them fit together.
#
# Two images of a plane, or of a few points, can leave several orientations. With a further image each of them makes
# another model, and the least-squares fit of the models decides.


class Joined(NamedTuple):
    """Pairs with the orientations that the model has."""

    pairs: list[RobustOrientation]
    chain: Chain | None
    model: StereoModel | None
    """Nothing where no scale passes from one pair to the next."""
    rivals: int
    """Other combinations of orientations that fit as well."""


def joined(pairs: Sequence[RobustOrientation], images: Sequence[Bundle], used: BoolArray) -> Joined:
    """Chain of m images in the combination of orientations of its pairs that fits best; ``used`` (m, n) the rays."""
    options = [[pair] for pair in pairs]
    if len(pairs) > 1:
        options = [_orientations(pair, *_rays(k, pair, images)) for k, pair in enumerate(pairs)]
    # Combinations of the orientations of all pairs that are tried.
    tried = [_tried(list(chosen), images, used) for chosen in islice(product(*options), 32)]
    order = sorted(tried, key=_misfit)
    model = order[0].model
    if model is None:
        return order[0]
    lost, least = _misfit(order[0])
    limit = least + AS_GOOD * max(1.0, float(np.nan_to_num(model.sigma0)) ** 2)
    # Up to this difference of positions and attitudes two models are one; the first base has length one.
    same_within = 1e-5
    same = [one for one in order if _away(one.model, model) < same_within]
    rivals = [one for one in order if _away(one.model, model) >= same_within and _misfit(one) <= (lost, limit)]
    # From another combination the adjustment can come to the same model: the pairs are those that began nearest to it.
    return min(same, key=lambda one: _away(one.chain, model))._replace(rivals=len(rivals))


def _away(one: Chain | StereoModel | None, model: StereoModel) -> float:
    if one is None:
        return np.inf
    of_positions = np.max(np.abs(one.positions - model.positions))
    return float(max(of_positions, np.max(np.abs(one.rotations - model.rotations))))


def _rays(k: int, pair: RobustOrientation, images: Sequence[Bundle]) -> tuple[Bundle, Bundle]:
    both = np.all(np.isfinite(images[k].rays) & np.isfinite(images[k + 1].rays), axis=1)
    index = np.flatnonzero(both)[pair.agreeing]
    return images[k].take(index), images[k + 1].take(index)


def _orientations(pair: RobustOrientation, a: Bundle, b: Bundle) -> list[RobustOrientation]:
    """The pair as it was judged, and with each of its alternatives in the first place."""
    found = pair.orientation
    options = [pair]
    if found.outcome is not RelativeOutcome.AMBIGUOUS:
        return options
    of_plane = [(one.base, one.rotation) for one in found.plane_orientations]
    for k, one in enumerate(found.alternatives):
        adjusted = adjust_coplanarity(a, b, one.base, one.rotation, iterations=1)
        other = result(a, b, PairAssessment(found.geometry, found.singular_values, [adjusted], of_plane))
        rest = found.alternatives[:k] + found.alternatives[k + 1 :]
        others = (candidate(a, b, found.base, found.rotation), *rest)
        residuals = pair.residuals.copy()
        residuals[pair.agreeing] = other.residuals
        turned = other._replace(outcome=found.outcome, alternatives=others)
        options.append(pair._replace(orientation=turned, residuals=residuals))
    return options


def _tried(pairs: list[RobustOrientation], images: Sequence[Bundle], used: BoolArray) -> Joined:
    linked = chain([pair.orientation for pair in pairs], images, used)
    model = adjust_model(images, used, linked) if np.all(linked.common != 0) else None
    if model is not None and not np.isfinite(model.frame_covariance).all():
        model = None  # no point lies in front of its images, or too few do
    return Joined(pairs, linked, model, 0)


def _misfit(one: Joined) -> tuple[int, float]:
    """Points without a place, and Σ (v/σ)² of the others."""
    if one.model is None:
        return 10**9, np.inf
    lost = int(np.sum(np.isnan(one.model.points[:, 0])))
    return lost, float(np.nan_to_num(one.model.sigma0) ** 2 * one.model.redundancy)
