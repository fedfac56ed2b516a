"""Seeds of a network: the first images and stations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
import scipy.sparse

from mor.start.bundle import direction_bundle, evenly
from mor.start.free_station import PlanShape, StationOutcome, free_station_level, three_bundles
from mor.start.image_pair import FEWEST as FITTING_FEWEST
from mor.start.image_pair import (
    MINIMUM,
    RobustOrientation,
    StartOrientation,
    fitting_orientations,
    robust_relative_orientation,
)
from mor.start.part import SLACKS, Frame, Part, Phrase, Sightings, empty_part, loosened, misses, rule
from mor.start.relative_orientation import RelativeOutcome, nearest_rotation
from mor.start.scene import Scene
from mor.start.sights import Terrestrial
from mor.types import FloatArray, IntArray

# ---- Begin a part where nothing is known: the best pair of frames by relative orientation (Rinner).

WINDOW = 64
"""Rays of a point among which frames are paired."""
_SAMPLE = 80
"""Common points of two frames beyond which more of them do not help."""


class FramePairs(NamedTuple):
    """Pairs of frames that see common points, those with most of them first."""

    first: IntArray
    second: IntArray
    common: IntArray
    """Number of points that both see."""


def common_pairs(seen: Sightings) -> FramePairs:
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
    return FramePairs(*(array[order].astype(np.int64) for array in (common.row, common.col, common.data)))


def seed_bundles(
    frames: Sequence[Frame], among: IntArray, pairs: FramePairs, points: int, passed: int = 0
) -> tuple[Part | None, Phrase | None]:
    """A part of two frames, base 1, of the pair ``among`` some (numbers of pairs) that is oriented best.

    If there is none, what the best pair lacks.

    ``passed``: so many that are better are passed over, as far as there are others.
    """
    oriented: list[tuple[float, Part]] = []
    reason: Phrase | None = None
    both = among[pairs.common[among] >= MINIMUM]
    first, second = pairs.first[both], pairs.second[both]
    if len(both) == 0:
        return None, _too_few(frames, pairs, among)
    # Agreeing points times the angle (radians) at which their rays meet, from which no better pair is looked for.
    # The same in parts of the most points that two frames have in common.
    enough = min(15.0, 0.25 * int(pairs.common[both].max()))
    for tried, (i, j) in enumerate(by_parallax(frames, first, second, pairs.common[both])):
        if tried >= 24 and oriented:
            break
        found = _oriented(frames, i, j, points)
        if isinstance(found, Phrase):
            reason = reason or found
            continue
        oriented.append(found)
        if sum(score >= enough for score, _ in oriented) > passed:
            break
    oriented.sort(key=lambda one: -one[0])
    return (oriented[min(passed, len(oriented) - 1)][1], None) if oriented else (None, reason)


def _too_few(frames: Sequence[Frame], pairs: FramePairs, among: IntArray) -> Phrase | None:
    if len(among) == 0:
        return None
    one, other = frames[int(pairs.first[among[0]])], frames[int(pairs.second[among[0]])]
    common = int(pairs.common[among[0]])
    words = "{one} and {other} share {count} points, relative orientation needs {least}"
    return rule(words, one=one.name, other=other.name, count=common, least=MINIMUM)


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


def by_parallax(frames: Sequence[Frame], first: IntArray, second: IntArray, common: IntArray) -> list[tuple[int, int]]:
    """Pairs worth an orientation, the most promising first: points times what the best turn without a base leaves.

    The pairs with most points in common are the neighbours, with the shortest bases: in a block of images hundreds of
    them are alike, and none is good. Beyond ``_SAMPLE`` points more of them do not help, so pairs are looked at all
    over those that have as many.
    """
    ample = int(np.count_nonzero(common >= _SAMPLE))
    if ample > 96:
        chosen = evenly(np.arange(ample), 96)
        candidates = list(zip(first[chosen].tolist(), second[chosen].tolist(), strict=True))
    else:
        candidates = list(islice(_spread(first, second), 96))
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
    return evenly(at_one, _SAMPLE), evenly(at_other, _SAMPLE)


def _oriented(frames: Sequence[Frame], i: int, j: int, points: int) -> tuple[float, Part] | Phrase:
    at_i, at_j = common_rays(frames[i], frames[j])
    one, other = frames[i], frames[j]
    measured = one.rays[at_i], one.sigma[at_i], other.rays[at_j], other.sigma[at_j]
    found = _with_least_slack(*measured)
    if isinstance(found, RelativeOutcome):
        words = "{one} and {other}, relative orientation: {outcome}"
        return rule(words, one=frames[i].name, other=frames[j].name, outcome=found.value)
    slack, result = found
    orientation, count = result.orientation, int(np.count_nonzero(result.agreeing))
    rays_a = frames[i].rays[at_i[result.agreeing]]
    rays_b = frames[j].rays[at_j[result.agreeing]]
    cosine = np.einsum("ni,ni->n", rays_a, rays_b @ orientation.rotation)
    angle = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
    names: dict[str, str | int] = {"one": frames[i].name, "other": frames[j].name, "count": count}
    began = rule("relative orientation of {one} and {other}, {count} points", **names)
    # Slack (radians) from which, and part of the pairs below which, it is said how badly rays meet.
    if slack >= 2e-3 or count < 0.9 * len(at_i):
        began = rule(
            "relative orientation of {one} and {other}, {count} points (only {count} of {of} pairs of rays meet within "
            "{slack} mrad: camera constant, distortion or identities may be wrong)",
            **names,
            of=len(at_i),
            slack=f"{1e3 * slack:g}",
        )
    part = _of_two(frames, (i, j), StartOrientation(orientation.base, orientation.rotation), slack, began, points)
    return count * min(angle, 0.6), part


def _of_two(
    frames: Sequence[Frame], pair: tuple[int, int], found: StartOrientation, slack: float, began: Phrase, points: int
) -> Part:
    part = empty_part(points)
    part.slack, part.began = slack, began
    part.poses[pair[0]], part.poses[pair[1]] = (np.zeros(3), np.eye(3)), (found.base, found.rotation)
    part.how |= {frames[number].name: began for number in pair}
    return part


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


# ---- Begin a part where no pair of frames is oriented beyond doubt: a third frame tells which of the orientations
# holds.
#
# Five to seven common points, points in a plane and weak pairs leave several orientations, or one of which σ does not
# hold. Each is tried: the part that grows from it is judged by the rays that agree with it.


Grow = Callable[[Part, int], object]
"""Grows a part by a number of frames."""


def seed_doubtful(scene: Scene, among: IntArray, pairs: FramePairs, grow: Grow) -> Part | None:
    """A part of the pair ``among`` some whose best orientation the most rays of further frames agree with.

    Where no further frame can be posed, a pair of which a single orientation fits begins it, weak as it may be, and at
    the very last the one of several that fits best; five points control nothing.
    """
    both = among[pairs.common[among] >= FITTING_FEWEST]
    frames = scene.bare[0]
    best: tuple[float, Part | None] = (0.0, None)
    several: list[tuple[float, Part]] = []
    ordered = by_parallax(frames, pairs.first[both], pairs.second[both], pairs.common[both])
    for i, j in ordered[:8]:
        judged: list[tuple[float, Part]] = []
        for part in _candidates(scene, i, j):
            # Frames by which a part is grown before it is judged.
            grow(part, 4)
            judged.append((support(part, scene.rays_for(part)[0]), part))
        judged.sort(key=lambda one: -one[0])
        controlled = len(common_rays(frames[i], frames[j])[0]) > FITTING_FEWEST
        if judged and (len(judged[0][1].poses) > 2 or (controlled and len(judged) == 1)):
            best = max(best, judged[0], key=lambda one: one[0])
        elif judged and controlled:
            several = max(several, judged, key=lambda one: one[0][0] if one else 0.0)
    if best[1] is not None or not several:
        return best[1]
    return several[scene.choices.take(len(several))][1]


def _candidates(scene: Scene, i: int, j: int) -> list[Part]:
    """Parts of two frames, one for each orientation that fits, with the smallest slack with which any does."""
    one, other = scene.bare[0][i], scene.bare[0][j]
    at_i, at_j = common_rays(one, other)
    for slack in SLACKS[:-1]:
        a = direction_bundle(one.rays[at_i], loosened(one.sigma[at_i], slack))
        b = direction_bundle(other.rays[at_j], loosened(other.sigma[at_j], slack))
        found = fitting_orientations(a, b)
        if found:
            words = (
                "relative orientation of {one} and {other}, {count} points, one of {of} that "
                "fit, chosen because most rays agree with it"
            )
            began = rule(words, one=one.name, other=other.name, count=len(at_i), of=len(found))
            return [_of_two(scene.frames, (i, j), seed, slack, began, scene.points) for seed in found]
    return []


def support(part: Part, frames: Sequence[Frame]) -> float:
    """Return the support of a part by rays of posed frames: Σ max(0, 25 − (v/σ)²) over those to known points."""
    total = 0.0
    for number, (centre, D) in part.poses.items():
        frame = frames[number]
        known, off = misses(part, frame, centre, D)
        off = off / loosened(frame.sigma[known], part.slack)
        # σ from which on a ray speaks for nothing.
        total += float(np.sum(np.maximum(5.0**2 - off**2, 0.0)))
    return total


# ---- Begin a levelled part where nothing is known: one station at the origin, its circle zero along +Y.
#
# Bearings bring north with them; alone they have no set that sees much, and begin with the two points of one of them.


def seed_levelled(
    measured: Terrestrial, unknown: set[int], points: int, tried: set[int], with_distances: bool
) -> Part | None:
    """A levelled part around the set that sees most; ``tried`` remembers where a part was begun already.

    A station ``with_distances`` of its own has its scale. Of one without, the distance to another station that it
    sights is taken as one. Sets that have to find their orientation come before bearings.
    """
    lengths = (measured.slopes, measured.horizontals)
    reach = {frozenset(ends) for one in lengths for ends in zip(one.start.tolist(), one.end.tolist(), strict=True)}
    bearings = [end for one in measured.sights if one.oriented for end in (one.position, *one.points.tolist())]
    meeting, stations = Counter(bearings), {one.position for one in measured.sights}
    alone = not tried and len(measured.sights) == 1
    best, rank, base = -1, (False, 0), 0
    for number, sight in enumerate(measured.sights):
        here, told = sight.position, np.flatnonzero(np.isfinite(sight.directions)).tolist()
        if number in tried or here not in unknown or not told:
            continue
        sighted = sight.points.tolist()
        reached = {sighted[k] for k in told if frozenset((here, sighted[k])) in reach}
        others = [k for k in told if sighted[k] in stations and sighted[k] != here]
        if sight.oriented:
            # Bearings that meet at the end with fewer of them; one that nothing else meets does not make a network.
            count, others = min(meeting[here], meeting[sighted[0]]), told
            usable = bool(reached) if with_distances else count > 1
        else:
            # The only set of a network may sight a single point.
            count = len(reached if with_distances else told)
            usable = len(told) > (not alone) and bool(reached if with_distances else others)
        if usable and (not sight.oriented, count) > rank:
            best, rank, base = number, (not sight.oriented, count), others[0] if others else 0
    if best < 0:
        return None
    tried.add(best)
    sight = measured.sights[best]
    part = empty_part(points)
    part.levelled, part.oriented, part.scaled = True, sight.oriented, with_distances
    part.points[sight.position] = 0.0
    part.kappas[best] = 0.0
    part.began = rule("origin of a local system at {one}", one=sight.name)
    part.how[f"point {sight.position}"] = part.began
    if not with_distances:
        point, direction = int(sight.points[base]), sight.directions[base]
        part.points[point, :2] = [np.sin(direction), np.cos(direction)]
        part.how[f"point {point}"] = rule("base of length one")
    return part


# ---- Begin a levelled part with three stations that do not see each other, by the directions to points all three see.


def seed_plan(
    measured: Terrestrial, unknown: set[int], points: int, tried: set[int]
) -> tuple[Part | None, Phrase | None]:
    """A part of the three sets that share most points, or why there is none; ``tried`` remembers sets."""
    # The set of every unknown station that sees most, with what it read first to each point.
    largest: dict[int, tuple[int, dict[int, float]]] = {}
    for number, sight in enumerate(measured.sights):
        told = np.flatnonzero(np.isfinite(sight.directions))[::-1]
        seen = dict(zip(sight.points[told].tolist(), sight.directions[told].tolist(), strict=True))
        asked = not sight.oriented and sight.position in unknown and number not in tried
        if asked and len(seen) > max(2, len(largest.get(sight.position, (0, {}))[1])):
            largest[sight.position] = number, seen
    sets = dict(sorted(largest.values(), key=lambda one: (-len(one[1]), one[0]))[:30])
    shared = {(i, j, k): sets[i].keys() & sets[j].keys() & sets[k].keys() for i, j, k in combinations(sets, 3)}
    # Five points leave nothing over that could tell shapes apart.
    enough = [three for three, points_of_all in shared.items() if len(points_of_all) >= 6]
    if not enough:
        return None, None
    chosen = max(enough, key=lambda three: len(shared[three]))
    tried.update(chosen)
    sights = [measured.sights[number] for number in chosen]
    common = evenly(np.array(sorted(shared[chosen]), dtype=np.int64), 30)
    shapes = three_bundles(np.array([[sets[number][p] for p in common.tolist()] for number in chosen]))
    others = [seen for number, seen in sets.items() if number not in chosen]
    ranked = sorted((_misfit(shape, common, others), k) for k, shape in enumerate(shapes))
    names = {"one": sights[0].name, "two": sights[1].name, "three": sights[2].name}
    if not ranked or not np.isfinite(ranked[0][0]):
        return None, rule(
            "directions of {one}, {two} and {three}: no solution in plan has all points in front", **names
        )
    # How many times as far the rays of another shape have to pass by for it to be out of the question.
    if len(ranked) > 1 and ranked[1][0] < 3.0 * ranked[0][0]:
        return None, rule("directions of {one}, {two} and {three}: two solutions in plan fit equally well", **names)
    shape = shapes[ranked[0][1]]
    part = empty_part(points)
    part.levelled = True
    part.began = rule("directions of {one}, {two} and {three} to {count} points", **names, count=len(common))
    for number, sight, place, kappa in zip(chosen, sights, shape.stations, shape.kappas, strict=True):
        part.points[sight.position, :2] = place
        part.kappas[number] = float(kappa)
        part.how[f"point {sight.position}"] = part.began
    part.points[common, :2] = shape.points
    part.how |= {f"point {p}": part.began for p in common.tolist()}
    return part, None


def _misfit(shape: PlanShape, points: IntArray, others: list[dict[int, float]]) -> float:
    """Radians by which rays pass by, of the worst of the three stations and of others that see the points, too."""
    worst, sigma = shape.misfit, 1e-5  # radians; any, for it cancels when two shapes are compared
    for seen in others:
        there = np.isin(points, list(seen))
        if np.count_nonzero(there) < 4:
            continue
        directions = np.array([seen[p] for p in points[there].tolist()])
        station = free_station_level(shape.points[there], directions, np.full(len(directions), np.nan), sigma, 1.0)
        if station.outcome is StationOutcome.DOES_NOT_FIT:
            return float("inf")
        if station.outcome.usable:
            worst = max(worst, sigma * station.sigma0)
    return worst
