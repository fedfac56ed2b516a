"""Plausibility checks of the input."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import bdtrc

from mor.errors import Message
from mor.model.contract import ObservationGroup, some_rows, wrap
from mor.model.curvature import on_sphere
from mor.model.earth import EARTH_RADIUS, LocalSphere
from mor.model.parameters import Values
from mor.model.shapes import SHAPE_TYPES
from mor.project.axes import split
from mor.project.earth import median_origin
from mor.project.network import Network
from mor.quality.redundancy import OF_IMAGES
from mor.quality.test_statistics import LEVEL, critical_value, sidak
from mor.solve.problem import misclosures
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.units import ANGLE

# ---- Where notes stand: the file and line of an observation, and how many of a kind are told one by one.

MOST = 5
"""Notes of one kind about one table."""


def sigmas(network: Network) -> list[FloatArray]:
    """(n, m) standard deviations of each group; of correlated observations those of their covariance matrices."""
    found = [group.sigma.copy() for group in network.groups]
    for one in network.correlations:
        deviations = np.sqrt(np.diagonal(one.covariance))
        for number, row, component, sigma in zip(one.groups, one.rows, one.components, deviations, strict=True):
            found[number][row, component] = sigma
    return found


def noted(group: ObservationGroup, rows: IntArray, said: Callable[[int], str]) -> Iterator[Message]:
    """A note for each of the first rows, and how many more there are."""
    for row in rows[:MOST].tolist():
        yield group.message(row, said(row))
    if len(rows) > MOST:
        yield group.message(int(rows[MOST]), f"and {len(rows) - MOST} more of this kind")


# ---- Angles of more than a full circle: no instrument shows one, so a table of such is in another unit.
#
# Readings in gon or degrees that are declared as radians are found so; the other way round they only look small.


def beyond_a_circle(network: Network) -> Iterator[Message]:
    """Components of tables most of whose angles are larger than a full circle, with the first row."""
    for group in network.groups:
        if not group.type.key.startswith(("observed/", "difference/")):
            for component, of in enumerate(group.type.components):
                if of.quantity == ANGLE:
                    yield from _component(group, component)


def _component(group: ObservationGroup, component: int) -> Iterator[Message]:
    here = group.mask[:, component]
    # A full circle, and what is rounded when one is written.
    beyond = here & (np.abs(group.observed[:, component]) > 2.0 * np.pi * (1.0 + 1e-9))
    if 2 * np.count_nonzero(beyond) > np.count_nonzero(here):
        name, of = group.type.components[component].name, np.count_nonzero(here)
        said = (
            f"{group.type.name}, {name}: {np.count_nonzero(beyond)} of {of} angles are larger than a full circle; "
            "check their unit"
        )
        yield group.message(int(np.argmax(beyond)), said)


# ---- Distances, height differences and vectors against the coordinates that are given to start from.
#
# Given coordinates may be rough, but they are alike rough: a difference of 50 times the median of all of a
# table is no noise. If all observations of a table are the same multiple of what the coordinates say, their
# unit is another one.

_TIMES = 50.0
_AT_LEAST = 5


def steps_from_given_coordinates(network: Network) -> Iterator[Message]:
    """Yield a note for each table of lengths in another unit, and for single rows far off the given coordinates."""
    start = {kind: array for kind, array in network.start.items() if array.ndim == 2}
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        if not group.type.distances or any(slot.kind not in start for slot in group.type.slots):
            continue
        lengths = np.array([component.quantity.length == 1 for component in group.type.components])
        if group.count < _AT_LEAST or not lengths.all():
            continue
        with np.errstate(all="ignore"):
            difference = misclosures(group, start)
        used: BoolArray = np.asarray(np.isfinite(difference).all(axis=1) & group.mask.all(axis=1))
        if np.count_nonzero(used) >= _AT_LEAST:
            yield from _of_table(group, difference, sigma, used)


def _of_table(group: ObservationGroup, difference: FloatArray, sigma: FloatArray, used: BoolArray) -> Iterator[Message]:
    observed = np.linalg.norm(group.observed[used], axis=1)
    computed = np.linalg.norm(group.observed[used] - difference[used], axis=1)
    size = np.linalg.norm(difference, axis=1)
    good = (observed > 0.0) & (computed > 0.0)
    if np.count_nonzero(good) >= _AT_LEAST:
        ratios = np.log(observed[good] / computed[good])
        ratio = float(np.median(ratios))
        # The unit is doubted from a ratio of 2.5 on that is the same for all, within 10 % in the median.
        if abs(ratio) > np.log(2.5) and float(np.median(np.abs(ratios - ratio))) < 0.1:
            words = (
                f"{group.type.name}: the observations are {np.exp(ratio):.3g} times as large as computed from the "
                "given coordinates; check their unit"
            )
            yield group.message(int(np.argmax(used)), words)
            return
    of_row = np.linalg.norm(np.nan_to_num(sigma), axis=1)
    noise = np.maximum(np.median(size[used]), of_row)
    beyond = used & (size > _TIMES * noise) & (size > 10.0 * of_row)  # below 10 σ a difference is noise in any case

    def said(row: int) -> str:
        names = group.said_names(row)
        return (
            f"{group.type.name} {names}: {size[row] / (np.median(size[used]) or noise[row]):.0f} times as far from "
            "the given coordinates as the other rows of the table; check names and signs"
        )

    yield from noted(group, np.flatnonzero(beyond), said)


# ---- Rays that cannot be right: outside the format of their image, or of a point that the image has already.


def rays(network: Network) -> list[ObservationGroup]:
    """Groups of image coordinates."""
    return [group for group in network.groups if group.type.key in OF_IMAGES and group.count]


def outside_the_format(network: Network) -> Iterator[Message]:
    """Image coordinates more than a pixel beyond the edge of the format that their camera gives."""
    for group, out in _outside(network):
        yield from noted(group, np.flatnonzero(out), _ray(group, "{}, outside the format of the camera"))


def count_outside_the_format(network: Network) -> int:
    """Number of image points beyond the format of their camera."""
    return sum(int(np.count_nonzero(out)) for _, out in _outside(network))


def _outside(network: Network) -> Iterator[tuple[ObservationGroup, BoolArray]]:
    """Groups of image coordinates, and which of their rows (n,) are outside the format."""
    images, half = network.things["image"], _half_formats(network)
    for group in rays(network):
        names = group.references[0]
        camera = np.full(len(names.known), -1)
        used = np.unique(names.numbers)
        camera[used] = [images.part(names.known[k], "camera") for k in used]
        with np.errstate(invalid="ignore"):
            out = (np.abs(group.observed) > half[camera[names.numbers]]).any(axis=1)
        yield group, np.asarray(out)


def _ray(group: ObservationGroup, words: str):  # type: ignore[no-untyped-def]
    image, point = group.references
    return lambda row: words.format(f"image {image[row]}, point {point[row]}")


def _half_formats(network: Network) -> FloatArray:
    """(cameras, 2) half of the format and a pixel, from the origin, in camera units; infinite where none is given."""
    ids = network.things["camera"].ids
    half = np.full((len(ids), 2), np.inf)
    for k, name in enumerate(ids):
        given, scale = network.project.cameras[name].image, network.scales[name]
        if given is None:
            continue
        size = np.array([split(text)[0] for text in (given.width, given.height)])
        pixel = scale.pixel if np.isfinite(scale.pixel) else 1.0
        beside = np.abs(0.5 * size - np.array(scale.centre)) if scale.corner else np.zeros(2)
        half[k] = (0.5 * size + beside + 1.0) * pixel
    return half


def beyond_a_field_of_view(network: Network) -> Iterator[Message]:
    """Cameras half of whose image points are more than 71° from the axis, or less than 0.06°, with the first row."""
    for group in rays(network):
        slot = next((k for k, slot in enumerate(group.type.slots) if slot.part == "interior"), None)
        if slot is None:
            continue
        blocks = group.blocks[slot]
        with np.errstate(all="ignore"):
            constant = np.abs(network.start[group.type.slots[slot].kind][blocks, 0])
            ratio = np.linalg.norm(group.observed, axis=1) / constant
        for block in np.unique(blocks).tolist():
            own = np.flatnonzero((blocks == block) & np.isfinite(ratio))
            usual = float(np.median(ratio[own])) if len(own) >= _AT_LEAST else 1.0
            # A telescope of 10 m with an image of 60 mm has 2e-3, a fisheye with a full sphere 2.
            if not 1e-3 < usual < 3.0:
                words = (
                    f"image: the points of a camera are, in the median, {usual:.3g} times the camera constant from the "
                    "origin; check their unit"
                )
                yield group.message(int(own[0]), words)


def measured_twice(network: Network) -> Iterator[Message]:
    """Points that an image has twice in one table: the second row, and where the first one stands."""
    for group in rays(network):
        image, point = (names.numbers.astype(np.int64) for names in group.references)
        key = image * (int(point.max(initial=0)) + 1) + point
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        if not same.any():
            continue
        before = dict(zip(order[1:][same].tolist(), order[:-1][same].tolist(), strict=True))
        yield from noted(group, np.sort(order[1:][same]), _again(group, before))


def _again(group: ObservationGroup, before: dict[int, int]):  # type: ignore[no-untyped-def]
    image, point = group.references

    def said(row: int) -> str:
        line = group.line(before[row])
        return f"image {image[row]} has point {point[row]} twice" + (f", in line {line}, too" if line else "")

    return said


# ---- Observations between places that are known, against what follows from their coordinates.
#
# Where everything an observation refers to is fixed, or observed itself with a σ, observed − computed is a
# misclosure with the variance σ² + J Σ Jᵀ of the observation and the known values. A set of horizontal
# directions has its orientation besides, taken as the median of the misclosures of its known targets. All
# misclosures of a kind together are tested with one level.


class Misclosures(NamedTuple):
    """Misclosures of some rows of a group, (k, m) each; NaN where a value is unknown."""

    rows: IntArray
    size: FloatArray
    sigma: FloatArray


def contradicting_known_points(network: Network) -> Iterator[Message]:
    """Observations that known coordinates contradict."""
    pairs = zip(network.groups, sigmas(network), strict=True)
    found = [(group, _misclosures(network, group, sigma)) for group, sigma in pairs]
    tests = sum(int(np.isfinite(one.size).sum()) for _, one in found)
    if tests == 0:
        return
    critical = critical_value(sidak(LEVEL, tests))
    for group, one in found:
        with np.errstate(invalid="ignore"):
            beyond = np.abs(one.size) > critical * one.sigma
        bad = np.flatnonzero(beyond.any(axis=1))
        place = {int(one.rows[k]): int(k) for k in bad}

        def said(row: int, group=group, one=one, place=place) -> str:  # type: ignore[no-untyped-def]
            k = place[row]
            component = int(np.nanargmax(np.abs(one.size[k] / one.sigma[k])))
            return _sentence(group, row, component, float(one.size[k, component]), float(one.sigma[k, component]))

        yield from noted(group, one.rows[bad], said)


def _sentence(group: ObservationGroup, row: int, component: int, size: float, sigma: float) -> str:
    names = group.said_names(row)
    factor, unit = 1.0, ""
    if group.external is not None:
        outside = int(np.argmax(np.abs(group.external.transform[component])))
        factor, unit = float(group.external.factors[outside]), group.external.units[outside]
    return (
        f"{group.type.name} {names}, {group.type.components[component].name}: {size / factor:.4g} {unit} off the known "
        f"coordinates ({abs(size) / sigma:.0f} sigma)"
    )


def _misclosures(network: Network, group: ObservationGroup, sigma: FloatArray) -> Misclosures:
    nothing = Misclosures(np.zeros(0, dtype=np.int64), *(np.zeros((0, group.observed.shape[1])) for _ in range(2)))
    if not group.count or group.type.key.startswith(
        ("observed/", "difference/", "image/", "follower/", "moving/", "level")
    ):
        return nothing
    turning = _turning_slot(group)
    known = np.ones(group.count, dtype=bool)
    for k, (slot, blocks) in enumerate(group.blocks_by_slot):
        known &= _known(network, slot.kind, turning == k)[blocks]
    rows = np.flatnonzero(known)
    if not len(rows):
        return nothing
    some = some_rows(group, rows)
    values = {kind: np.where(np.isfinite(array), array, 0.0) for kind, array in network.start.items()}
    here = [values[slot.kind][own] for slot, own in some.blocks_by_slot]
    if turning >= 0:
        here[turning] = np.broadcast_to(np.eye(3), here[turning].shape)
    computed = some.type.equation(here, some.constants)
    size = some.observed - computed.values
    size[:, group.type.wraps] = wrap(size[:, group.type.wraps])
    variance = sigma[rows] ** 2
    for k, (slot, own) in enumerate(some.blocks_by_slot):
        if k != turning and slot.kind in network.sigma:
            given = np.where(network.blocks[slot.kind].free, np.nan_to_num(network.sigma[slot.kind]), 0.0)
            if given.shape[1] == computed.jacobians[k].shape[2]:
                variance = variance + np.einsum("nmk,nk->nm", computed.jacobians[k] ** 2, given[own] ** 2)
    if turning >= 0:
        size = _oriented(some.blocks[turning], size)
    return Misclosures(rows, size, np.sqrt(variance))


def _known(network: Network, kind: str, turning: bool) -> BoolArray:
    """(n,) blocks of a kind all of whose components are fixed, or observed with a σ."""
    blocks = network.blocks[kind]
    if turning:  # a levelled set is known but for its orientation
        return np.asarray(~blocks.free[:, :2].any(axis=1))
    given = np.isfinite(network.sigma[kind]) if kind in network.sigma else np.zeros(blocks.free.shape, dtype=bool)
    start = network.start[kind]
    present = np.isfinite(start.reshape(len(start), -1)).all(axis=1)
    return np.asarray((~blocks.free | given).all(axis=1) & present)


def _turning_slot(group: ObservationGroup) -> int:
    """The slot of the rotation of a set of directions, −1 for all else."""
    if group.type.references[0].name != "station":
        return -1
    return next((k for k, slot in enumerate(group.type.slots) if slot.kind == "rotation"), -1)


def _oriented(frames: AnyIntArray, size: FloatArray) -> FloatArray:
    """Misclosures with the orientation of their set taken out; NaN where a set has fewer than three known targets."""
    turned = size.copy()
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        if len(here) < 3:
            turned[here, 0] = np.nan
            continue
        first = size[here[0], 0]
        apart = wrap(size[here, 0] - first)
        turned[here, 0] = wrap(apart - np.nanmedian(apart))
    return turned


# ---- Loops of levelled lines that do not close.
#
# Levelled height differences are edges between points; every line beside a spanning tree of shortest ways
# closes a loop with it, and points of known height close one with each other. The misclosure of a loop has
# the variance of its lines together. All loops are tested with one level.


class _Line(NamedTuple):
    start: int
    end: int
    rise: float
    variance: float
    group: ObservationGroup | None
    row: int


class _Way(NamedTuple):
    """Path from the root to a point: line, sense, previous point, and number of lines."""

    line: int
    sense: float
    before: int
    steps: int


def open_loops(network: Network) -> Iterator[Message]:
    """Loops whose misclosure is beyond chance, the worst first, with the line that closes them."""
    lines = _lines(network)
    ways, chords = _spanning_trees(lines)
    loops = [loop for chord in chords if len(loop := _loop(lines, ways, chord)) > 1 or lines[chord].group]
    if not loops:
        return
    critical, found = critical_value(sidak(LEVEL, len(loops))), []
    for loop in loops:
        total = sum(sense * lines[k].rise for k, sense in loop)
        sigma = float(np.sqrt(sum(lines[k].variance for k, _ in loop)))
        if abs(total) > critical * sigma:
            found.append((abs(total) / sigma, total, loop))
    for size, total, loop in sorted(found, key=lambda one: -one[0])[:MOST]:
        yield _note(network, lines, loop, total, size)


def _lines(network: Network) -> list[_Line]:
    lines, named = [], set()
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        if group.type.key != "height_difference":
            continue
        places = [k for k, slot in enumerate(group.type.slots) if slot.part == "position"]
        heights = [group.blocks[k] for k, slot in enumerate(group.type.slots) if slot.part == "height"]
        start, end = (group.blocks[k] for k in places)
        plain = np.all([own == 0 for own in heights], axis=0) if heights else np.ones(group.count, dtype=bool)
        for row in np.flatnonzero(plain & group.mask[:, 0]).tolist():
            rise, variance = float(group.observed[row, 0]), float(sigma[row, 0]) ** 2
            lines.append(_Line(int(start[row]), int(end[row]), rise, variance, group, row))
            named |= {int(start[row]), int(end[row])}
    free = network.blocks["point"].free
    deviation, value = network.sigma["point"], network.start["point"]
    ground = -1  # where lines to known heights begin
    for block in sorted(named):
        known = not free[block, 2] or np.isfinite(deviation[block, 2])
        if known and np.isfinite(value[block, 2]):
            variance = float(deviation[block, 2]) ** 2 if free[block, 2] else 0.0
            lines.append(_Line(ground, block, float(value[block, 2]), variance, None, 0))
    return lines


def _spanning_trees(lines: list[_Line]) -> tuple[dict[int, _Way], list[int]]:
    """Ways from a root of each connected part, breadth first; and the lines that are in none of them."""
    meeting = defaultdict(list)
    for k, line in enumerate(lines):
        meeting[line.start].append((k, 1.0, line.end))
        meeting[line.end].append((k, -1.0, line.start))
    ways: dict[int, _Way] = {}
    used = set()
    for root in sorted(meeting):
        if root in ways:
            continue
        ways[root] = _Way(-1, 0.0, root, 0)
        waiting = deque([root])
        while waiting:
            place = waiting.popleft()
            for k, sense, there in meeting[place]:
                if there not in ways:
                    ways[there] = _Way(k, sense, place, ways[place].steps + 1)
                    used.add(k)
                    waiting.append(there)
    return ways, [k for k in range(len(lines)) if k not in used]


def _loop(lines: list[_Line], ways: dict[int, _Way], chord: int) -> list[tuple[int, float]]:
    """Lines and senses of the loop that a line closes: along it, and back through the tree."""
    loop = [(chord, 1.0)]
    here, there = lines[chord].end, lines[chord].start
    while here != there:
        if ways[here].steps >= ways[there].steps:
            loop.append((ways[here].line, -ways[here].sense))
            here = ways[here].before
        else:
            loop.append((ways[there].line, ways[there].sense))
            there = ways[there].before
    return loop


def _note(network: Network, lines: list[_Line], loop: list[tuple[int, float]], total: float, size: float) -> Message:
    ids = network.blocks["point"].ids
    own = [lines[k] for k, _ in loop if lines[k].group is not None]
    names = " - ".join(dict.fromkeys(ids[end] for line in own for end in (line.start, line.end)))
    places = ", ".join(str(line.group.line(line.row)) for line in own if line.group is not None)
    closing = own[0]
    unit = network.project.units.length
    where = f"; its lines: {places}" if len(own) > 1 and places.strip("0, ") else ""
    words = f"levelling {names}: the loop has a misclosure of {total:.4g} {unit} ({size:.0f} sigma){where}"
    file, line = (closing.group.file, closing.group.line(closing.row)) if closing.group else ("", 0)
    return Message(words, file, line)


# ---- Observations that stand in a project twice with the same value: measured twice, or exported twice?
#
# Two measurements of the same quantity, rounded to multiples of u, are equal with the probability
#
#     p = u / (2 √π σ),
#
# because their difference has the density 1/(2 √π σ) at 0. Of n repeated rows, k are equal by chance with at
# most the binomial probability of k or more with the mean of these p (W. Hoeffding, Ann. Math. Statist. 27,
# 1956). u is taken from the values: the smallest difference between two of them. If values are rounded to
# several σ, p is 1 and nothing is said.


def repeated_rows(network: Network) -> Iterator[Message]:
    """Yield one note for each table that repeats rows of another one, or of itself, to the last digit."""
    by_type: dict[str, list[int]] = defaultdict(list)
    for number, group in enumerate(network.groups):
        if group.count and group.file and len(group.lines):
            by_type[group.type.key].append(number)
    deviations = sigmas(network)
    for numbers in by_type.values():
        yield from _of_one_type(network, numbers, deviations)


def _of_one_type(network: Network, numbers: list[int], deviations: list[FloatArray]) -> Iterator[Message]:
    groups = [network.groups[number] for number in numbers]
    if len(groups) == 1 and groups[0].type.key in OF_IMAGES:
        return  # points that an image has twice in one table are noted one by one
    owner = np.repeat(np.arange(len(groups)), [group.count for group in groups])
    row = np.concatenate([np.arange(group.count) for group in groups])
    order, again = _pairs(groups)
    if not again.any():
        return
    first, second = order[:-1][again], order[1:][again]
    sigma = np.concatenate([deviations[number] for number in numbers])
    observed = np.concatenate([group.observed for group in groups])
    equal = _same(observed, first, second) & _same(sigma, first, second)
    zero = ~(np.nan_to_num(observed[first]) != 0.0).any(axis=1)
    start = np.concatenate([[0], np.cumsum(~again)])
    times = np.bincount(start)[start[:-1][again]]  # m values have m(m − 1)/2 pairs, of which m − 1 are looked at
    chance = np.minimum(1.0, 0.5 * times * _chances(observed, sigma, first))
    for one in range(len(groups)):
        for other in range(len(groups)):
            here = (owner[first] == one) & (owner[second] == other) & ~zero
            found = np.flatnonzero(here & equal)
            if len(found) == 0 or (one == other and groups[one].type.key in OF_IMAGES):
                continue
            whole = (
                one != other
                and len(found) == groups[other].count
                and bool((np.diff(row[first[found]][np.argsort(row[second[found]])]) > 0).all())
            )
            probability = float(bdtrc(len(found) - 1, np.count_nonzero(here), min(1.0, float(chance[here].mean()))))
            # Chance does not arrange all rows of a table in the order of another one: less makes these noted.
            if probability > (0.05 if whole else 1e-3):
                continue
            yield _note_on_repeated_rows(groups[one], groups[other], row[first[found]], row[second[found]])


def _pairs(groups: list[ObservationGroup]) -> tuple[IntArray, np.ndarray]:
    """Rows in an order in which those of the same quantity are neighbours, and (n − 1,) true where two are."""
    slots = [k for k, slot in enumerate(groups[0].type.slots) if slot.kind != "rotation"]
    columns = [np.concatenate([group.blocks[k] for group in groups]) for k in slots]
    constants = np.concatenate([group.constants for group in groups])
    columns += list(constants.T) if groups[0].type.key not in OF_IMAGES else []
    observed = np.concatenate([group.observed for group in groups])
    order = np.lexsort([*observed.T, *columns[::-1]])  # of one quantity, equal values are neighbours
    again = np.ones(max(len(order) - 1, 0), dtype=bool)
    for column in columns:
        sorted_ = column[order]
        again &= (sorted_[1:] == sorted_[:-1]) | ((sorted_[1:] != sorted_[1:]) & (sorted_[:-1] != sorted_[:-1]))
    return order, again


def _same(values: FloatArray, first: IntArray, second: IntArray) -> np.ndarray:
    one, other = values[first], values[second]
    return np.asarray(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1))


def _chances(observed: FloatArray, sigma: FloatArray, rows: IntArray) -> FloatArray:
    """(n,) probability p that a second measurement of each row has the same value."""
    result = np.ones(len(rows))
    for component in range(observed.shape[1]):
        values = np.unique(observed[np.isfinite(observed[:, component]), component])
        gaps = np.diff(values)
        gaps = gaps[gaps > 1e-12 * np.abs(values).max(initial=0.0)]  # less is the round-off of a conversion
        if len(gaps) == 0:
            continue
        own = sigma[rows, component]
        with np.errstate(divide="ignore", invalid="ignore"):
            p = gaps.min() / (2.0 * np.sqrt(np.pi) * own)
        result *= np.where(np.isfinite(p) & np.isfinite(observed[rows, component]), np.minimum(p, 1.0), 1.0)
    return result


def _note_on_repeated_rows(
    one: ObservationGroup, other: ObservationGroup, first: IntArray, second: IntArray
) -> Message:
    where = one.line(int(first[0])), other.line(int(second[0]))
    observations = int(np.count_nonzero(other.mask[second]))
    return Message(
        f"{len(second)} of {other.count} rows repeat rows of {one.file} with the same value and sigma (line "
        f"{where[1]} repeats line {where[0]}). If they were exported twice, remove them: they add "
        f"{observations} to the redundancy and make standard deviations too small",
        other.file,
        where[1],
    )


# ---- Heights of instruments and targets that nobody can reach, and vertical circles read in the other convention.

_HIGHEST = 5.0
"""Height of an instrument or a target in metres that is beyond a tripod and a pole."""
_FEWEST_SET_UPS = 3


def implausible_heights(network: Network) -> Iterator[Message]:
    """Yield a note for each height of an instrument or target beyond 5 m or 50 times the median of all heights."""
    beyond = beyond_reach(network)
    if not beyond.any():
        return
    said: set[int] = set()
    for group in network.groups:
        if not group.type.distances or group.type.between_marks:
            continue
        for slot, blocks in group.blocks_by_slot:
            names = [reference.name for reference in group.type.references]
            if slot.kind != "height" or slot.of not in names:
                continue
            own = np.asarray(blocks)
            wrong, first = np.unique(own[beyond[own]], return_index=True)
            rows = np.flatnonzero(beyond[own])[first]
            fresh = np.array([int(block) not in said for block in wrong], dtype=bool)
            said.update(int(block) for block in wrong)
            column = group.references[names.index(slot.of)]

            def words(row: int, own=own, column=column, of=slot.of) -> str:  # type: ignore[no-untyped-def]
                height = float(network.start["height"][own[row], 0])
                unit = network.project.units.length
                if abs(height) > _HIGHEST / network.edge.metres:
                    return (
                        f"{of} {column[row]}: the height is {height:.6g} {unit}, more than "
                        f"{_HIGHEST:g} m; check its unit"
                    )
                return (
                    f"{of} {column[row]}: the height is {height:.6g} {unit}, more than {_TIMES:g} times the median of "
                    "all heights; check its unit"
                )

            if fresh.any():
                yield from noted(group, np.sort(rows[fresh]), words)


def beyond_reach(network: Network) -> BoolArray:
    """Return which height blocks (n,) are beyond 5 m or 50 times the median of all heights."""
    if "height" not in network.blocks:
        return np.zeros(0, dtype=bool)
    size = np.abs(np.nan_to_num(network.start["height"][:, 0]))
    median = usual_height(network)
    return np.asarray((size > _HIGHEST / network.edge.metres) | ((median > 0.0) & (size > _TIMES * median)))


def usual_height(network: Network) -> float:
    """Return the median of all heights that are not 0, or 0 if there are fewer than three."""
    size = np.abs(np.nan_to_num(network.start["height"][:, 0]))
    given = size[size > 0.0]
    return float(np.median(given)) if len(given) >= _FEWEST_SET_UPS else 0.0


def vertical_convention(network: Network) -> Iterator[Message]:
    """Yield a note for each table whose zenith angles all look like elevations, or the other way round."""
    for group in network.groups:
        for component, of in enumerate(group.type.components):
            here = np.flatnonzero(group.mask[:, component])
            if of.name in ("zenith", "zenith_angle") and _all_near(group, component, 0.0):
                said = (
                    f"{group.type.name}: all {len(here)} zenith angles are near 0 or a half circle; are they "
                    "elevations?"
                )
            elif of.name in ("vertical", "vertical_angle", "vertical_direction") and _all_near(
                group, component, 0.5 * np.pi
            ):
                said = (
                    f"{group.type.name}: all {len(here)} elevations are near a quarter of a circle; are they zenith "
                    "angles?"
                )
            else:
                continue
            yield group.message(int(here[0]), said)


def look_like_elevations(group: ObservationGroup) -> bool:
    """Return True if all zenith angles of a table are near 0 or a half circle."""
    components = enumerate(group.type.components)
    return any(of.name in ("zenith", "zenith_angle") and _all_near(group, k, 0.0) for k, of in components)


def _all_near(group: ObservationGroup, component: int, suspicious: float) -> bool:
    """Return True if all readings of a table are within half a radian of a suspicious one, or opposite to it."""
    observed = group.observed[group.mask[:, component], component]
    near = np.abs(wrap(2.0 * (observed - suspicious))) / 2.0 < 0.5
    return len(observed) >= _FEWEST_SET_UPS and bool(near.all())


# ---- Standard deviations that no instrument has: against the circle, the length or the image they belong to.
#
# No angle is read to 1e-9 of a radian (0.06 µgon), no length to 1e-9 of itself, no image coordinate to 1e-7
# of the image; and nobody measures a direction to a tenth of a radian, a distance to its own size, an image
# to a tenth of its width. A σ beyond that is in another unit, or was meant for something else. A single row
# of many that is given a large σ so as not to count is not noted.


def implausible_sigmas(network: Network) -> Iterator[Message]:
    """Components of tables most of whose σ are implausible, with the first row."""
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        if not group.count or group.type.key.startswith(("observed/", "difference/")):
            continue
        for component in range(group.observed.shape[1]):
            sign, row = _beyond(group, sigma, component)
            if sign:
                words = "smaller" if sign > 0 else "larger"
                name = group.type.components[component].name
                said = (
                    f"{group.type.name}, {name}: the standard deviation is {words} than that "
                    f"of any instrument; check its unit"
                )
                yield group.message(row, said)


def beyond_any_instrument(network: Network, group: ObservationGroup) -> int:
    """1 where most σ of all components of a group are too small for any instrument, −1 where too large, else 0."""
    if not group.count or group.type.key.startswith(("observed/", "difference/")):
        return 0
    number = next(k for k, own in enumerate(network.groups) if own is group)
    sigma = sigmas(network)[number]
    signs = {_beyond(group, sigma, component)[0] for component in range(group.observed.shape[1])}
    return signs.pop() if len(signs) == 1 else 0


def _beyond(group: ObservationGroup, sigma: FloatArray, component: int) -> tuple[int, int]:
    """1 where most σ of a component are too small, −1 where too large, else 0; and the first such row."""
    kind = _kind(group, component)
    here = group.mask[:, component]
    if not kind or not here.any():
        return 0, 0
    own, sizes = sigma[here, component], _sizes(group, component, kind, here)
    smallest, largest = {"angle": (1e-9, 0.1), "length": (1e-9, 1.0), "image": (1e-7, 0.1)}[kind]
    for sign, beyond in ((1, own < smallest * sizes), (-1, own > largest * sizes)):
        if 2 * np.count_nonzero(beyond) > len(beyond):
            return sign, int(np.flatnonzero(here)[np.argmax(beyond)])
    return 0, 0


def _kind(group: ObservationGroup, component: int) -> str:
    quantity = group.type.components[component].quantity
    if quantity.image == 1:
        return "image"
    if quantity == ANGLE:
        return "angle"
    return "length" if quantity.length == 1 and group.type.distances and not group.type.between_marks else ""


def _sizes(group: ObservationGroup, component: int, kind: str, here: BoolArray) -> FloatArray:
    """Return the size with which σ of each row is compared: 1 rad, length, widest image coordinate; NaN for 0."""
    observed = group.observed[here, component]
    if kind == "angle":
        return np.ones(len(observed))
    if kind == "length":
        return np.where(observed == 0.0, np.nan, np.abs(observed))
    widest = float(np.fmax.reduce(np.abs(group.observed), axis=None))
    return np.full(len(observed), widest if widest > 0.0 else np.nan)


# ---- Images whose given start pose none of their points supports: turned away from all of them, or far beside.
#
# A start pose is rough. But where points with given coordinates are measured in an image, its pose puts some of them
# before the camera and somewhere near their measured places. One that has not a single one of at least three
# within the width of what the camera measures is no rough value of this image.


def unsupported_poses(network: Network) -> Iterator[Message]:
    """Images with a given pose, and three given points at least, that all lie behind the camera or far beside."""
    for group in rays(network):
        if any(slot.part == "base" for slot in group.type.slots):
            continue
        image = group.references[0].numbers
        rows = np.flatnonzero(~_settled(network, group)[image])
        usable = _usable(network, group, rows)
        rows = rows[usable]
        count = np.bincount(image[rows], minlength=int(image.max()) + 1)
        good = np.bincount(image[rows[_support(network, group, rows)]], minlength=len(count))
        for k in np.flatnonzero((count >= 3) & (good == 0)).tolist():
            row = int(np.flatnonzero(image == k)[0])
            words = (
                f"image {group.references[0].known[k]}: its start pose shows none of its {count[k]} points that have "
                "start coordinates"
            )
            yield group.message(row, words)


def _settled(network: Network, group: ObservationGroup) -> BoolArray:
    """(images,) that already some of their rays support: one is enough, so that hardly any needs all of them."""
    image = group.references[0].numbers
    images = int(image.max()) + 1
    # Rays for each image, in the mean, that are looked at before all of those that nothing supports yet.
    some = np.arange(0, group.count, max(1, group.count // (16 * images)))
    some = some[_usable(network, group, some)]
    settled: BoolArray = np.zeros(images, dtype=bool)
    settled[image[some[_support(network, group, some)]]] = True
    return settled


def _usable(network: Network, group: ObservationGroup, rows: IntArray) -> BoolArray:
    """(k,) rays for which all start values are given."""
    usable: BoolArray = np.ones(len(rows), dtype=bool)
    for slot, own in group.blocks_by_slot:
        start = network.start[slot.kind]
        given = np.asarray(np.isfinite(start.reshape(len(start), -1)).all(axis=1), dtype=bool)
        usable = usable & given[own[rows]]
    return usable


def _support(network: Network, group: ObservationGroup, rows: IntArray) -> BoolArray:
    """(k,) rays, with all their start values, that point before the camera and near the place they were measured at."""
    if not len(rows):
        return np.zeros(0, dtype=bool)
    some = some_rows(group, rows)
    blocks = [network.start[slot.kind][own] for slot, own in some.blocks_by_slot]
    slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
    sight = blocks[-1] - blocks[slots["image", "position"]]
    axis = blocks[slots["image", "rotation"]][:, 2]
    along: FloatArray = np.einsum("nj,nj->n", axis, sight)
    with np.errstate(all="ignore"):
        computed = some.type.equation(blocks, some.constants).values
        width = np.fmax.reduce(np.fmax.reduce(group.observed) - np.fmin.reduce(group.observed))
        far = np.fmax.reduce(np.abs(computed - some.observed), axis=1)
    return np.asarray((along < 0.0) & (far < width))


# ---- The curvature of the earth that a project with parallel verticals leaves out: its largest effect, against σ.
#
# Each observation is computed with parallel verticals and on a sphere through the middle of the network. A
# zenith angle over the distance s differs by s/(2R), a horizontal distance by s h/R at a height h above the
# middle. A height difference is off by s²/(2R) against what does not follow the level surface: vectors,
# images and local systems; without any of these nothing contradicts it, and it is not looked at.

NOTED = 0.3
"""In units of σ."""
_LOOKED_AT = {
    "zenith_angle": 0,
    "vertical_direction": 0,
    "zenith_directions": 1,
    "directions": 1,
    "horizontal_distance": 0,
}
"""Component of each type that the curvature changes without regard to the coordinates that are chosen."""


class CurvatureEffect(NamedTuple):
    """The effect of the curvature on one observation."""

    group: ObservationGroup
    row: int
    component: int
    size: float
    """Internal units."""
    in_sigma: float
    distance: float
    """Between the ends of the observation, unit of length."""


def neglected_curvature(network: Network, values: Values) -> Message | None:
    """Return a note on the largest effect of the curvature, or None if the project models it or it is below 0.3 σ."""
    effect = largest_effect(network, values)
    if effect is None or effect.in_sigma < NOTED:
        return None
    group, row = effect.group, effect.row
    names = group.said_names(row)
    quantity = group.type.components[effect.component].quantity
    millimetres = 1000.0 * network.edge.metres
    across = abs(effect.size) * millimetres * (effect.distance if quantity == ANGLE else 1.0)
    metres = effect.distance * network.edge.metres
    words = (
        f"curvature of the earth: verticals are parallel in this project; {group.type.name} {names} over "
        f"{metres:.4g} m is off by {_two_digits(across)} mm ({_two_digits(effect.in_sigma)} sigma), more than any "
        "other; curvature: true models it"
    )
    return group.message(row, words)


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def sphere_under(network: Network, values: Values) -> LocalSphere:
    """Return the sphere that ``curvature: true`` would have at these coordinates."""
    used = np.zeros(len(values["point"]), dtype=bool)
    for group in network.groups:
        for slot, blocks in group.blocks_by_slot:
            if slot.kind == "point" and slot.of != "system":
                used[blocks] = True
    metres = network.edge.metres
    return LocalSphere(EARTH_RADIUS / metres, median_origin(values["point"][used], 1.0 / metres))


def largest_effect(network: Network, values: Values) -> CurvatureEffect | None:
    """Return the effect of the curvature that is largest in units of σ; None if there is none to look at."""
    if network.world is not None or network.sphere is not None:
        return None
    straight = any(
        group.type.key.startswith(("vector", "local", *SHAPE_TYPES, "image/", "follower/", "moving"))
        for group in network.groups
    )
    if not any(group.type.key in _LOOKED_AT for group in network.groups) and not straight:
        return None
    sphere, largest = sphere_under(network, values), None
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        found = _in_group(group, values, sphere, sigma, straight)
        if found is not None and (largest is None or found.in_sigma > largest.in_sigma):
            largest = found
    return largest


def _in_group(
    group: ObservationGroup, values: Values, sphere: LocalSphere, sigma: FloatArray, straight: bool
) -> CurvatureEffect | None:
    component = _LOOKED_AT.get(group.type.key, 0 if group.type.key == "height_difference" and straight else -1)
    if component < 0 or not group.count:
        return None
    blocks = [values[slot.kind][own] for slot, own in group.blocks_by_slot]
    places = [b for slot, b in zip(group.type.slots, blocks, strict=True) if slot.part == "position"]
    apart = places[1] - places[0]
    length = np.hypot(apart[:, 0], apart[:, 1])
    if group.type.key == "height_difference":
        size = length**2 / (2.0 * sphere.radius)
    else:
        curved = on_sphere(group.type, sphere).equation(blocks, group.constants).values
        size = (curved - group.type.equation(blocks, group.constants).values)[:, component]
        size = wrap(size) if group.type.wraps[component] else size
    own = replace(group, sigma=sigma).given_sigma[:, component]
    ratio = np.where(group.mask[:, component], np.abs(size) / own, np.nan)
    if not np.isfinite(ratio).any():
        return None
    row = int(np.nanargmax(np.where(np.isfinite(ratio), ratio, np.nan)))
    return CurvatureEffect(group, row, component, float(size[row]), float(ratio[row]), float(length[row]))


# ---- Everything there is to look at before an adjustment.


def implausible(network: Network) -> tuple[Message, ...]:
    """Notes on observations that cannot be right, or contradict what is known; each with its file and line."""
    checks = (
        outside_the_format,
        measured_twice,
        repeated_rows,
        implausible_sigmas,
        beyond_a_circle,
        beyond_a_field_of_view,
        implausible_heights,
        vertical_convention,
        steps_from_given_coordinates,
        contradicting_known_points,
        open_loops,
        unsupported_poses,
    )
    return tuple(note for check in checks for note in check(network))
