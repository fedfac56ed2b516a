"""Join a part to the object system through what both know, or make it the object system where there is none yet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.growth.frames import Frame
from mor.approximate.growth.part import Part
from mor.approximate.similarity import Similarity, SimilarityOutcome, congruence, similarity
from mor.approximate.terrestrial.sights import Lengths
from mor.arrays import BoolArray, FloatArray, IntArray

FEWEST_POSITIONS = 8
"""Given positions from which a part that is still growing may be tied to them."""
TURN = 0.01
"""σ of the turn (radians) up to which given positions tie a part while it is still growing."""


def join(system: Part, part: Part, frames: Sequence[Frame]) -> bool:
    """Carry a part into the object system and take over what it knows; true where that was possible."""
    spread_positions(part, frames)
    spread_positions(system, frames)
    found = _level_similarity(system, part) if part.levelled else _spatial_similarity(system, part)
    if found is None:
        return False
    part.transform(found)
    take_over(system, part)
    system.place_sigma = max(system.place_sigma, _disagreement(system, part, frames))
    return True


def _disagreement(system: Part, part: Part, frames: Sequence[Frame]) -> float:
    """Root mean square difference of a coordinate between given positions of frames and those of the joined part."""
    off = [
        system.points[frames[number].position] - part.points[frames[number].position]
        for number in part.poses
        if system.fixed[frames[number].position]
    ]
    return float(np.sqrt(np.mean(np.square(off)))) if off else 0.0


def tied_by_positions(system: Part, part: Part, frames: Sequence[Frame]) -> bool:
    """True where given positions of most of the frames of a part determine its place and its turns well."""
    blocks = np.array(sorted({frames[number].position for number in part.poses}), dtype=np.int64)
    given = blocks[system.fixed[blocks]]
    if 2 * len(given) < len(blocks) or len(given) < FEWEST_POSITIONS:
        return False
    spread_positions(part, frames)
    source, target = part.points[given], system.points[given]
    found = (congruence if part.scaled else similarity)(source, target)
    if found.outcome is not SimilarityOutcome.DETERMINED:
        return False
    spread = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    return bool(found.sigma0 < TURN * np.hypot(spread[1], spread[2]))


def take_over(system: Part, part: Part) -> None:
    """Add to the object system what a part in the same system knows besides."""
    fresh = np.isnan(system.points) & np.isfinite(part.points)
    system.points[fresh] = part.points[fresh]
    for number, pose in part.poses.items():
        system.poses.setdefault(number, pose)
    for number, kappa in part.kappas.items():
        system.kappas.setdefault(number, kappa)
    for name, words in part.how.items():
        system.how.setdefault(name, words)
    system.slack = max(system.slack, part.slack)


def spread_positions(part: Part, frames: Sequence[Frame]) -> None:
    """Positions of posed frames as points of the part: X0 = O − h e_Z + Dᵀ r0*."""
    for number, (centre, rotation) in part.poses.items():
        block = frames[number].position
        missing = np.isnan(part.points[block])
        offset = frames[number].offset
        place = centre - np.array([0.0, 0.0, offset[0]]) + rotation.T @ offset[1:]
        part.points[block, missing] = place[missing]


def _spatial_similarity(system: Part, part: Part) -> Similarity | None:
    common = np.isfinite(system.points).all(axis=1) & np.isfinite(part.points).all(axis=1)
    if np.count_nonzero(common) < 3:
        return None
    source, target = part.points[common], system.points[common]
    found = (congruence if part.scaled else similarity)(source, target)
    return _without_outliers(found, source, target, part.scaled)


def _without_outliers(
    found: Similarity, source: FloatArray, target: FloatArray, scaled: bool
) -> Similarity | None:
    """The similarity again without points that do not fit at all, as long as most do."""
    if found.outcome is not SimilarityOutcome.DETERMINED:
        return None
    off = np.linalg.norm(found.residuals, axis=1)
    good = off <= 5.0 * max(float(np.median(off)), 1e-12)
    if good.all() or np.count_nonzero(good) < max(4, 0.7 * len(off)):
        return found
    again = (congruence if scaled else similarity)(source[good], target[good])
    return again if again.outcome is SimilarityOutcome.DETERMINED else found


def _level_similarity(system: Part, part: Part) -> Similarity | None:
    """A turn about the vertical, a shift, and a scale where the part has none."""
    common = np.isfinite(system.points[:, :2]).all(axis=1) & np.isfinite(part.points[:, :2]).all(axis=1)
    if np.count_nonzero(common) < 2:
        return None
    source, target = part.points[common, :2], system.points[common, :2]
    flat = (congruence if part.scaled else similarity)(source, target)
    if flat.outcome is not SimilarityOutcome.DETERMINED:
        return None
    both = np.isfinite(system.points[:, 2]) & np.isfinite(part.points[:, 2])
    shift = np.median(system.points[both, 2] - flat.scale * part.points[both, 2]) if both.any() else 0.0
    if not both.any():
        part.points[:, 2] = np.nan
    rotation = np.eye(3)
    rotation[:2, :2] = flat.rotation
    translation = np.array([*flat.translation, shift])
    return Similarity(flat.outcome, flat.scale, rotation, translation, flat.residuals, flat.sigma0)


def scale_by_lengths(part: Part, lengths: Sequence[Lengths], flat: Sequence[bool]) -> bool:
    """Bring a part without scale to the length unit by the median ratio of measured to present distances."""
    ratios: list[FloatArray] = []
    for given, is_flat in zip(lengths, flat, strict=True):
        ends = _both_known(part, given.start, given.end)
        if not ends.any():
            continue
        difference = part.points[given.end[ends]] - part.points[given.start[ends]]
        if is_flat:
            difference = difference[:, :2]
        present = np.linalg.norm(difference, axis=1)
        ratios.append(given.value[ends, 0] / np.where(present > 0.0, present, np.nan))
    together = np.concatenate(ratios) if ratios else np.zeros(0)
    together = together[np.isfinite(together)]
    if len(together) == 0:
        return False
    part.transform(
        Similarity(
            SimilarityOutcome.DETERMINED,
            float(np.median(together)),
            np.eye(3),
            np.zeros(3),
            np.zeros((0, 3)),
            0.0,
        )
    )
    part.scaled = True
    return True


def _both_known(part: Part, start: IntArray, end: IntArray) -> BoolArray:
    known = np.asarray(np.isfinite(part.points).all(axis=1))
    return known[start] & known[end]
