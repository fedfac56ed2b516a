"""What became of a space resection, as data."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.reprojection import misfits
from mor.approximate.resection.refinement import Pose, pose_design, star_of
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import angles_from_rotation

AS_GOOD = 25.0
"""Σ (v/σ)² by which another pose may be worse and still count as fitting equally well (5 σ)."""
WEAK = 0.1
"""σ of the rotation (radians), or of the position relative to the nearest point, beyond which a pose is weak."""
SAME = 1e-4
"""Rotations of three-point solutions closer than this are one."""
HALF = 0.5
"""Part of the points that must agree."""


class ResectionOutcome(Enum):
    """What became of a resection, in words."""

    DETERMINED = "one pose fits"
    AMBIGUOUS = "several poses fit equally well; a further point, or the side it was taken from, decides"
    AMBIGUOUS_AND_WEAK = (
        "several poses fit, and at least one of them is hardly determined: near the dangerous cylinder over the "
        "circle of the points, or points too close together; further points decide"
    )
    WEAK = "a pose fits but is hardly determined: points too close together or a dangerous position"
    TOO_FEW = "fewer than three points"
    INVALID = "a ray or a point is no number, or a ray is zero, or their numbers differ"
    COLLINEAR = "the points lie in one line, in the object or as seen"
    DOES_NOT_FIT = (
        "no pose fits half of the points within their precision: wrong identities or wrong interior"
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
    costs = [_objective(bundle, points, pose, agreeing) for pose, agreeing in refined]
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
    rivals = _different(pose, rivals, 8.0 * spread + 1e-6 if redundancy > 0 else SAME)
    return Resection(
        _outcome(bundle, points, agreeing, [pose, *rivals]),
        pose.position,
        pose.rotation,
        angles_from_rotation(pose.rotation),
        covariance,
        sigma0,
        misfits(bundle, star_of(points, pose)[None])[0],
        agreeing,
        tuple(rivals),
    )


def _objective(bundle: Bundle, points: FloatArray, pose: Pose, agreeing: BoolArray) -> float:
    return float(np.sum(misfits(bundle.take(agreeing), star_of(points[agreeing], pose)[None])[0] ** 2))


def _different(pose: Pose, rivals: list[Pose], tolerance: float) -> list[Pose]:
    kept: list[Pose] = []
    for rival in rivals:
        if all(np.linalg.norm(rival.rotation - other.rotation) > tolerance for other in (pose, *kept)):
            kept.append(rival)
    return kept


def _covariance(bundle: Bundle, points: FloatArray, pose: Pose) -> FloatArray:
    _, design = pose_design(bundle, points, pose)
    normal = design.T @ design
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = tolerant.eigh(normal / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, 1e-15)) @ vectors.T / np.outer(scale, scale))


def _outcome(bundle: Bundle, points: FloatArray, agreeing: BoolArray, poses: list[Pose]) -> ResectionOutcome:
    """What to say of the poses that fit, the best first."""
    if np.sum(agreeing) < max(3, HALF * len(points)):
        return ResectionOutcome.DOES_NOT_FIT
    weak = any(_is_weak(bundle.take(agreeing), points[agreeing], pose) for pose in poses)
    if len(poses) > 1:
        return ResectionOutcome.AMBIGUOUS_AND_WEAK if weak else ResectionOutcome.AMBIGUOUS
    return ResectionOutcome.WEAK if weak else ResectionOutcome.DETERMINED


def _is_weak(bundle: Bundle, points: FloatArray, pose: Pose) -> bool:
    """True where the rotation, or the position against the nearest point, is hardly determined."""
    variances = np.diag(_covariance(bundle, points, pose))
    nearest = float(np.min(np.linalg.norm(points - pose.position, axis=1)))
    position, rotation = np.sqrt(np.max(variances[:3])), np.sqrt(np.max(variances[3:]))
    return bool(rotation > WEAK or position > WEAK * nearest)
