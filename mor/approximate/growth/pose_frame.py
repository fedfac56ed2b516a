"""The pose of one frame from the points known so far: like its neighbour if that fits, else in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.bundle import Bundle, direction_bundle
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.remembered import remembered
from mor.approximate.reprojection import misfits
from mor.approximate.resection.outcome import Resection, ResectionOutcome
from mor.approximate.resection.refinement import Observed, Pose, adjust_pose, star_of
from mor.approximate.resection.space_resection import AGREES, resect
from mor.arrays import BoolArray, FloatArray, IntArray

NEIGHBOUR = 10
"""Known points from which the pose of a neighbour is tried as a start."""
CONTROLLED = 6
"""Known points from which some may be left out of a resection at once."""
_REMEMBERED = 1024
_SAMPLE = 60
"""Points of a frame a resection uses at the most."""
_EXACT = 1e-6
"""σ of a position that is given as exact, in parts of the distance to the points."""


def pose_frame(part: Part, frame: Frame, number: int, slacks: Sequence[float] = SLACKS) -> bool:
    """Add the pose of a frame to the part; true where the points it sees allow one, with one of some slacks."""
    known, targets = _known_points(part, frame)
    if len(known) >= NEIGHBOUR and _like_a_neighbour(part, frame, number, known, targets):
        return True
    usable = [s for s in slacks if s >= part.slack]
    # Of few points none is to be left out as long as a looser fit has them all: four fit many a wrong pose.
    least = [len(known)] * len(usable) if len(known) < CONTROLLED else []
    least += [least_agreeing(len(known))] * len(usable)
    for slack, enough in zip([*usable, *usable][-len(least) :], least, strict=True):
        rays, sigma = frame.rays[known], loosened(frame.sigma[known], slack)
        bundle, result = direction_bundle(rays, sigma), _resected(rays, sigma, targets)
        agreeing = int(np.count_nonzero(result.agreeing))
        if result.outcome in (ResectionOutcome.DETERMINED, ResectionOutcome.WEAK) and agreeing >= enough:
            pose = Pose(result.position, result.rotation)
            pose = _tied(part, frame, bundle.take(result.agreeing), targets[result.agreeing], pose)
            _enter(part, frame, number, pose, agreeing, len(known))
            return True
    return False


def least_agreeing(known: int) -> int:
    """How many of so many known points must agree with a pose."""
    return max(4, int(np.ceil(0.6 * known)))


@remembered(_REMEMBERED)
def _resected(rays: FloatArray, sigma: FloatArray, targets: FloatArray) -> Resection:
    return resect(direction_bundle(rays, sigma), targets)


def _known_points(part: Part, frame: Frame) -> tuple[IntArray, FloatArray]:
    """Rays of a frame to known points, not more than it takes, and where these are."""
    known = np.flatnonzero(part.known(frame.points))
    if len(known) > _SAMPLE:
        known = known[np.linspace(0, len(known) - 1, _SAMPLE).astype(int)]
    targets = part.points[frame.points[known]]
    targets[:, 2] += frame.heights[known]
    return known, targets


def _enter(part: Part, frame: Frame, number: int, pose: Pose, agreeing: int, of: int) -> None:
    part.poses[number] = (pose.position, pose.rotation)
    part.how[frame.name] = rule("resection from {count} of {of} points", count=agreeing, of=of)


def _like_a_neighbour(part: Part, frame: Frame, number: int, known: IntArray, targets: FloatArray) -> bool:
    """Pose by adjustment alone, begun at the pose of the frame that shares most points; true where it fits.

    Aerial images and image sequences go this way; a closed form with sampling takes ten times as long.
    """
    neighbours = part.seen_by[frame.points[known]]
    neighbours = neighbours[neighbours >= 0]
    if len(neighbours) == 0:
        return False
    start = Pose(*part.poses[int(np.bincount(neighbours).argmax())])
    bundle = direction_bundle(frame.rays[known], loosened(frame.sigma[known], max(part.slack, SLACKS[1])))
    pose = adjust_pose(bundle, targets, start, 15, observed_centre(part, frame, start, targets))
    pose = _tied(part, frame, bundle, targets, pose)
    agreeing = misfits(bundle, star_of(targets, pose)[None])[0] < AGREES
    if np.count_nonzero(agreeing) < 0.8 * len(known):
        return False
    _enter(part, frame, number, pose, int(np.count_nonzero(agreeing)), len(known))
    return True


def _tied(part: Part, frame: Frame, bundle: Bundle, targets: FloatArray, pose: Pose) -> Pose:
    """The pose that also agrees with a given position, so that nothing drifts away from it."""
    observed = observed_centre(part, frame, pose, targets)
    return pose if observed is None else adjust_pose(bundle, targets, pose, 15, observed)


def observed_centre(part: Part, frame: Frame, pose: Pose, targets: FloatArray) -> Observed | None:
    """Projection centre that a given position says at this attitude, and its σ."""
    known, place, sigma = observed_centres(part, [frame], pose.rotation[None], targets)
    return Observed(place[0], sigma[0]) if known[0] else None


def observed_centres(
    part: Part, frames: Sequence[Frame], turns: FloatArray, targets: FloatArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Of frames with rotations D (n, 3, 3) which have a given position, the centre it says (n, 3), and its σ (n, 3).

    O = X0 + h e_Z − Dᵀ r0*. What is given as exact is held by some part of the distance to the targets (m, 3).
    """
    position = np.array([frame.position for frame in frames], dtype=np.int64)
    known = part.fixed[position] & np.array([frame.stands for frame in frames])
    offset = np.array([frame.offset for frame in frames])
    place = part.points[position] - (turns.transpose(0, 2, 1) @ offset[:, 1:, None])[:, :, 0]
    place[:, 2] += offset[:, 0]
    away = np.maximum(np.abs(targets.min(axis=0) - place), np.abs(targets.max(axis=0) - place))
    exact = _EXACT * away.max(axis=1, keepdims=True)
    own = part.sigma[position]
    return known, place, np.maximum(np.where(np.isfinite(own), own, part.place_sigma), exact)
