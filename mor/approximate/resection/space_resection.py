"""Space resection: position and attitude of a bundle from known points, without approximate values.

Samples of three points (all of them, where they are few) give all positions that three rays allow; a plane
object adds the solution of its collineation. The best are refined by Gauss–Newton on the measured
coordinates with small rotations about the axes of the frame, and the points that agree are drawn anew until
they stand. Ambiguous, mirrored, weak or wrong data are named, never guessed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.reprojection import misfits
from mor.approximate.resection.outcome import Resection, ResectionOutcome, failed_resection, judged
from mor.approximate.resection.plane_object import is_plane, object_plane, resect_plane
from mor.approximate.resection.refinement import Pose, adjust_pose, star_of
from mor.approximate.resection.three_points import nearly_resect_three_points
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant

SAMPLES = 80
"""Three-point samples at the most; all triples are taken where they are not more."""
BATCH = 10
"""Samples that are drawn before it is asked whether more are needed."""
MISSED = 1e-6
"""Probability, at the share of points that agree with the best sample, that all samples had a wrong point."""
SEEDS = 6
"""Best solutions that are refined."""
TRUNCATION = 12.0
"""Residual v/σ at which a point stops counting while samples are compared."""
AGREES = 4.5
"""Length of the residual v/σ (two coordinates) up to which a point agrees."""
ROUNDS = 10
LINE = 1e-6
"""Width of a field of points, relative to its length, below which it is a line."""


def resect(bundle: Bundle, points: FloatArray, seed: int = 1841) -> Resection:
    """Frame of ``bundle`` from n ≥ 3 known points (n, 3), some of which may be wrong if n ≥ 6.

    Three points leave up to four solutions, all returned; more points decide where they can. The fixed
    ``seed`` draws the samples. Degenerate data do not raise: see :class:`ResectionOutcome`.
    """
    points = np.asarray(points, dtype=float)
    refusal = _refusal(bundle, points)
    if refusal is not None:
        return failed_resection(refusal, len(points))
    seeds = _seeds(bundle, points, np.random.default_rng(seed))
    refined = [_settled(bundle, points, pose) for pose in seeds]
    return judged(bundle, points, [one for one in refined if one is not None])


def _refusal(bundle: Bundle, points: FloatArray) -> ResectionOutcome | None:
    if len(bundle) != len(points) or not np.all(np.isfinite(points)) or not np.all(np.isfinite(bundle.rays)):
        return ResectionOutcome.INVALID
    if len(points) < 3:
        return ResectionOutcome.TOO_FEW
    if np.any(np.linalg.norm(bundle.rays, axis=1) == 0.0):
        return ResectionOutcome.INVALID
    extensions = object_plane(points).extensions
    thin = tolerant.singular_values(bundle.directions)[2] / np.sqrt(len(points))
    if extensions[1] <= LINE * extensions[0] or thin < 3.0 * bundle.noise:
        return ResectionOutcome.COLLINEAR
    return None


def _triples(count: int, generator: np.random.Generator) -> Iterator[IntArray]:
    """Samples (k, 3) of so many points, as long as more are asked for: all of them, where they are few."""
    if comb(count, 3) <= SAMPLES:
        yield np.array(list(combinations(range(count), 3)), dtype=np.int64)
        return
    for _ in range(0, SAMPLES, BATCH):
        yield np.stack([generator.permutation(count)[:3] for _ in range(BATCH)]).astype(np.int64)


def _seeds(bundle: Bundle, points: FloatArray, generator: np.random.Generator) -> list[Pose]:
    """The best poses of samples, of which so many are drawn as it takes for one without a wrong point (RANSAC)."""
    planar = resect_plane(bundle, points) if len(points) >= 4 and is_plane(object_plane(points)) else None
    poses, drawn = [] if planar is None else [Pose(*planar)], 0
    costs = [_truncated(bundle, points, poses)]
    # Coordinates of a map are large beside the object: differences from the centre keep the digits.
    centre = points.mean(axis=0)
    for triples in _triples(len(points), generator):
        found = nearly_resect_three_points(points[triples] - centre, bundle.rays[triples])
        fresh = [Pose(p + centre, d) for p, d in zip(found.positions, found.rotations, strict=True)]
        poses, drawn = [*poses, *fresh], drawn + len(triples)
        costs.append(_truncated(bundle, points, fresh))
        # Of the points that agree, each counts the less the worse it does.
        share = 1.0 - min(float(own.min(initial=np.inf)) for own in costs) / (len(points) * TRUNCATION**2)
        if share > 0.0 and (1.0 - share**3) ** drawn < MISSED:
            break
    return _apart([poses[index] for index in np.argsort(np.concatenate(costs), kind="stable")])


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
        if len(kept) == SEEDS:
            break
    return kept


def _settled(bundle: Bundle, points: FloatArray, pose: Pose) -> tuple[Pose, BoolArray] | None:
    """Refined pose and the points that agree with it."""
    agreeing = _agreeing(bundle, points, pose, 2.0 * TRUNCATION)
    for _ in range(ROUNDS):
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
