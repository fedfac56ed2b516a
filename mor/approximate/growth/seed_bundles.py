"""Begin a part where nothing is known: the best pair of frames by relative orientation (Rinner)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
import scipy.sparse

from mor.approximate.bundle import direction_bundle
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import Rule, rule
from mor.approximate.parts.sightings import Sightings
from mor.approximate.relative_orientation.outcome import RelativeOutcome
from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.approximate.relative_orientation.robust import RobustOrientation, robust_relative_orientation
from mor.approximate.remembered import remembered
from mor.arrays import FloatArray, IntArray

PAIRS_TRIED = 24
LOOKED_AT = 96
"""Pairs whose parallaxes are compared before any is oriented."""
GOOD_ENOUGH = 15.0
"""Agreeing points times the angle (radians) at which their rays meet, from which no better pair is looked for."""
GOOD_SHARE = 0.25
"""The same in parts of the most points that two frames have in common."""
DOUBTFUL, MOST = 2e-3, 0.9
"""Slack (radians) from which, and part of the pairs below which, it is said how badly rays meet."""
WINDOW = 64
"""Rays of a point among which frames are paired."""
FEWEST_COMMON = 8
_SAMPLE = 80
_REMEMBERED = 512
"""Pairs that are not oriented again: every beginning, and every change tried of a network, comes to most of them."""


class Pairs(NamedTuple):
    """Pairs of frames that see common points, those with most of them first."""

    first: IntArray
    second: IntArray
    common: IntArray
    """Number of points that both see."""


class Seed(NamedTuple):
    """A part of two frames, or why there is none."""

    part: Part | None
    reason: Rule | None
    """What the best pair lacks; ``None`` where there is a part, or no pair."""


def common_pairs(seen: Sightings) -> Pairs:
    """All pairs of frames that see common points, as far as they are worth a count.

    The rays of a point are taken ``WINDOW`` at a time, and only frames within one window are paired:
    a point that ten thousand images see does not make fifty million pairs.
    """
    frame, lengths = seen.frame, np.diff(seen.pointers)
    rank = np.arange(len(frame)) - np.repeat(seen.pointers[:-1], lengths)
    windows = -(-lengths // WINDOW)
    column = np.repeat(np.cumsum(windows) - windows, lengths) + rank // WINDOW
    shape = (seen.frames, int(windows.sum()))
    by_frame = scipy.sparse.csr_array((np.ones(len(frame), dtype=np.int32), (frame, column)), shape=shape)
    by_frame.data[:] = 1
    common = scipy.sparse.triu(by_frame @ by_frame.T, k=1).tocoo()
    order = np.argsort(-common.data, kind="stable")
    return Pairs(*(array[order].astype(np.int64) for array in (common.row, common.col, common.data)))


def seed_bundles(
    frames: Sequence[Frame], among: IntArray, pairs: Pairs, points: int, passed: int = 0
) -> Seed:
    """A part of two frames, base 1, of the pair ``among`` some (numbers of pairs) that is oriented best.

    ``passed``: so many that are better are passed over, as far as there are others.
    """
    oriented: list[tuple[float, Part]] = []
    reason: Rule | None = None
    both = among[pairs.common[among] >= FEWEST_COMMON]
    first, second = pairs.first[both], pairs.second[both]
    if len(both) == 0:
        return Seed(None, _too_few(frames, pairs, among))
    enough = min(GOOD_ENOUGH, GOOD_SHARE * int(pairs.common[both].max()))
    for tried, (i, j) in enumerate(by_parallax(frames, first, second, pairs.common[both])):
        if tried >= PAIRS_TRIED and oriented:
            break
        found = _oriented(frames, i, j, points)
        if isinstance(found, Rule):
            reason = reason or found
            continue
        oriented.append(found)
        if sum(score >= enough for score, _ in oriented) > passed:
            break
    oriented.sort(key=lambda one: -one[0])
    return Seed(oriented[min(passed, len(oriented) - 1)][1], None) if oriented else Seed(None, reason)


def _too_few(frames: Sequence[Frame], pairs: Pairs, among: IntArray) -> Rule | None:
    if len(among) == 0:
        return None
    one, other = frames[int(pairs.first[among[0]])], frames[int(pairs.second[among[0]])]
    common = int(pairs.common[among[0]])
    words = "{one} and {other} share {count} points, relative orientation needs {least}"
    return rule(words, one=one.name, other=other.name, count=common, least=FEWEST_COMMON)


def _spread(first: IntArray, second: IntArray) -> Iterator[tuple[int, int]]:
    """The pairs in their order, those of frames that were named often already put off to the end."""
    named: dict[int, int] = {}
    late: list[int] = []
    for pair, (i, j) in enumerate(zip(first, second, strict=True)):
        times = max(named.get(i, 0), named.get(j, 0))
        named[i], named[j] = named.get(i, 0) + 1, named.get(j, 0) + 1
        if times < 3:
            yield int(i), int(j)
        else:
            late.append(pair)
    for pair in late:
        yield int(first[pair]), int(second[pair])


def by_parallax(
    frames: Sequence[Frame], first: IntArray, second: IntArray, common: IntArray
) -> list[tuple[int, int]]:
    """Pairs worth an orientation, the most promising first: points times what the best turn without a base leaves.

    The pairs with most points in common are the neighbours, with the shortest bases: in a block of images hundreds of
    them are alike, and none is good. Beyond ``_SAMPLE`` points more of them do not help, so pairs are looked at all
    over those that have as many.
    """
    ample = int(np.count_nonzero(common >= _SAMPLE))
    if ample > LOOKED_AT:
        chosen = np.linspace(0, ample - 1, LOOKED_AT).astype(int)
        candidates = list(zip(first[chosen].tolist(), second[chosen].tolist(), strict=True))
    else:
        candidates = list(islice(_spread(first, second), LOOKED_AT))
    return sorted(candidates, key=lambda pair: -_parallax(frames[pair[0]], frames[pair[1]]))


def _parallax(one: Frame, other: Frame) -> float:
    """Common points times the median angle (radians) that is left when the rays are turned into each other."""
    at_one, at_other = common_rays(one, other)
    a, b = one.rays[at_one], other.rays[at_other]
    left = np.linalg.norm(b - a @ nearest_rotation(b.T @ a).T, axis=1)
    return len(at_one) * float(np.median(left))


def common_rays(one: Frame, other: Frame) -> tuple[IntArray, IntArray]:
    """Rows in two frames of the points that both see, ``_SAMPLE`` at the most."""
    _, at_one, at_other = np.intersect1d(one.points, other.points, return_indices=True)
    if len(at_one) > _SAMPLE:
        chosen = np.linspace(0, len(at_one) - 1, _SAMPLE).astype(int)
        at_one, at_other = at_one[chosen], at_other[chosen]
    return at_one, at_other


def _oriented(frames: Sequence[Frame], i: int, j: int, points: int) -> tuple[float, Part] | Rule:
    at_i, at_j = common_rays(frames[i], frames[j])
    one, other = frames[i], frames[j]
    measured = one.rays[at_i], one.sigma[at_i], other.rays[at_j], other.sigma[at_j]
    found = _with_least_slack(*measured)
    if isinstance(found, RelativeOutcome):
        words = "{one} and {other}, relative orientation: {outcome}"
        return rule(words, one=frames[i].name, other=frames[j].name, outcome=found.value)
    slack, result = found
    orientation, count = result.orientation, int(np.count_nonzero(result.agreeing))
    angle = _median_angle(
        frames[i].rays[at_i[result.agreeing]], frames[j].rays[at_j[result.agreeing]], orientation.rotation
    )
    part = empty_part(points)
    part.slack = slack
    part.poses[i] = (np.zeros(3), np.eye(3))
    part.poses[j] = (orientation.base, orientation.rotation)
    names: dict[str, str | int] = {"one": frames[i].name, "other": frames[j].name, "count": count}
    part.began = rule("relative orientation of {one} and {other}, {count} points", **names)
    if slack >= DOUBTFUL or count < MOST * len(at_i):
        part.began = rule(
            "relative orientation of {one} and {other}, {count} points (only {count} of {of} pairs of rays meet within "
            "{slack} mrad: camera constant, distortion or identities may be wrong)",
            **names,
            of=len(at_i),
            slack=f"{1e3 * slack:g}",
        )
    part.how[frames[i].name] = part.how[frames[j].name] = part.began
    return count * min(angle, 0.6), part


@remembered(_REMEMBERED)
def _with_least_slack(
    a_rays: FloatArray, a_sigma: FloatArray, b_rays: FloatArray, b_sigma: FloatArray
) -> tuple[float, RobustOrientation] | RelativeOutcome:
    """Relative orientation with the smallest slack that most points agree with.

    Where there is none, what became of the tightest. Rays that meet precisely, but behind, do not become a pair by
    looseness: they are mirrored. Of rays (n, 3) and their σ (n,) in two frames.
    """

    def oriented(slack: float) -> tuple[RobustOrientation, bool]:
        a = direction_bundle(a_rays, loosened(a_sigma, slack))
        b = direction_bundle(b_rays, loosened(b_sigma, slack))
        found = robust_relative_orientation(a, b)
        good = found.orientation.outcome is RelativeOutcome.DETERMINED
        return found, good and int(np.count_nonzero(found.agreeing)) >= max(8, 0.6 * len(a_rays))

    tightest, fits = oriented(SLACKS[0])
    if fits:
        return SLACKS[0], tightest
    best: tuple[float, RobustOrientation] | None = None
    outcome = tightest.orientation.outcome
    for slack in reversed(SLACKS[1:]):  # loosely first, then ever tighter
        result, fits = oriented(slack)
        if fits:
            best = slack, result
        elif best is not None:
            outcome = result.orientation.outcome
            break
    if outcome is RelativeOutcome.DETERMINED:
        outcome = RelativeOutcome.DOES_NOT_FIT
    return outcome if best is None or outcome is RelativeOutcome.MIRRORED else best


def _median_angle(rays_a: FloatArray, rays_b: FloatArray, rotation: FloatArray) -> float:
    cosine = np.einsum("ni,ni->n", rays_a, rays_b @ rotation)
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
