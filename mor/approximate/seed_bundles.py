"""Begin a part where nothing is known: the best pair of frames by relative orientation (Rinner)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse

from mor.approximate.bundle import direction_bundle
from mor.approximate.frames import SLACKS, Frame, loosened
from mor.approximate.part import Part, empty_part
from mor.approximate.relative_outcome import RelativeOutcome
from mor.approximate.relative_robust import RobustOrientation, robust_relative_orientation
from mor.geometry.arrays import FloatArray, IntArray

PAIRS_TRIED = 24
GOOD_ENOUGH = 15.0
"""Agreeing points times the angle (radians) at which their rays meet, from which no better pair is looked for."""
_SAMPLE = 80


def seed_bundles(frames: Sequence[Frame], free: Sequence[int], points: int) -> Part | None:
    """A part of two frames, base 1, or ``None`` where no pair of the ``free`` frames can be oriented."""
    best: tuple[float, Part] | None = None
    for tried, (i, j) in enumerate(_pairs(frames, free, points)):
        if tried >= PAIRS_TRIED and (best is not None or tried >= 4 * PAIRS_TRIED):
            break
        found = _oriented(frames, i, j, points)
        if found is not None and (best is None or found[0] > best[0]):
            best = found
        if best is not None and best[0] >= GOOD_ENOUGH:
            break
    return best[1] if best is not None else None


def _pairs(frames: Sequence[Frame], free: Sequence[int], points: int) -> list[tuple[int, int]]:
    """Pairs of frames by the number of their common points, at most a few for each frame: never all of them."""
    rows = np.concatenate([np.full(len(frames[n].points), k) for k, n in enumerate(free)])
    columns = np.concatenate([frames[n].points for n in free])
    seen = scipy.sparse.csr_array(
        (np.ones(len(rows), dtype=np.int32), (rows, columns)), shape=(len(free), points)
    )
    seen.data[:] = 1
    common = scipy.sparse.triu(seen @ seen.T, k=1).tocoo()
    enough = common.data >= 8
    order = np.argsort(-common.data[enough], kind="stable")
    first, second = common.row[enough][order].tolist(), common.col[enough][order].tolist()
    return [(free[i], free[j]) for i, j in _spread(first, second)]


def _spread(first: list[int], second: list[int]) -> list[tuple[int, int]]:
    """The pairs in their order, those of frames that were named often already put off to the end."""
    named: dict[int, int] = {}
    early: list[tuple[int, int]] = []
    late: list[tuple[int, int]] = []
    for i, j in zip(first, second, strict=True):
        times = max(named.get(i, 0), named.get(j, 0))
        (early if times < 3 else late).append((i, j))
        named[i], named[j] = named.get(i, 0) + 1, named.get(j, 0) + 1
    return early + late


def _oriented(frames: Sequence[Frame], i: int, j: int, points: int) -> tuple[float, Part] | None:
    _, at_i, at_j = np.intersect1d(frames[i].points, frames[j].points, return_indices=True)
    if len(at_i) > _SAMPLE:
        chosen = np.linspace(0, len(at_i) - 1, _SAMPLE).astype(int)
        at_i, at_j = at_i[chosen], at_j[chosen]
    found = _with_least_slack(frames[i], frames[j], at_i, at_j)
    if found is None:
        return None
    slack, result = found
    orientation, count = result.orientation, int(np.count_nonzero(result.agreeing))
    angle = _median_angle(
        frames[i].rays[at_i[result.agreeing]], frames[j].rays[at_j[result.agreeing]], orientation.rotation
    )
    part = empty_part(points)
    part.slack = slack
    part.poses[i] = (np.zeros(3), np.eye(3))
    part.poses[j] = (orientation.base, orientation.rotation)
    words = f"relative orientation of {frames[i].name} and {frames[j].name}, {count} points"
    part.how[frames[i].name] = part.how[frames[j].name] = words
    return count * min(angle, 0.6), part


def _with_least_slack(
    one: Frame, other: Frame, at_one: IntArray, at_other: IntArray
) -> tuple[float, RobustOrientation] | None:
    """Relative orientation with the smallest slack that most points agree with: loosely first, then ever tighter."""
    best = None
    for slack in reversed(SLACKS):
        a = direction_bundle(one.rays[at_one], loosened(one.sigma[at_one], slack))
        b = direction_bundle(other.rays[at_other], loosened(other.sigma[at_other], slack))
        result = robust_relative_orientation(a, b)
        good = result.orientation.outcome is RelativeOutcome.DETERMINED
        if good and np.count_nonzero(result.agreeing) >= max(8, 0.6 * len(at_one)):
            best = slack, result
        elif best is not None:
            break
    return best


def _median_angle(rays_a: FloatArray, rays_b: FloatArray, rotation: FloatArray) -> float:
    cosine = np.einsum("ni,ni->n", rays_a, rays_b @ rotation)
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
