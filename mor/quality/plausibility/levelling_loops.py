"""Loops of levelled lines that do not close.

Levelled height differences are edges between points; every line beside a spanning tree of shortest ways closes a loop
with it, and points of known height close one with each other. The misclosure of a loop has the variance of its lines
together. All loops are tested with one level.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.known_points import LEVEL
from mor.quality.plausibility.places import MOST, line_of, sigmas
from mor.quality.tests.levels import sidak
from mor.quality.tests.test_statistics import critical_value

_GROUND = -1


class _Line(NamedTuple):
    start: int
    end: int
    rise: float
    variance: float
    group: ObservationGroup | None
    row: int


class _Way(NamedTuple):
    """How a point is reached from the root: line, in which sense, from where, and how many lines away."""

    line: int
    sense: float
    before: int
    steps: int


def open_loops(network: Network) -> Iterator[Problem]:
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
    """Levelled lines between marks, and heights that are known as lines from the ground."""
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
    for block in sorted(named):
        known = not free[block, 2] or np.isfinite(deviation[block, 2])
        if known and np.isfinite(value[block, 2]):
            variance = float(deviation[block, 2]) ** 2 if free[block, 2] else 0.0
            lines.append(_Line(_GROUND, block, float(value[block, 2]), variance, None, 0))
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


def _note(
    network: Network, lines: list[_Line], loop: list[tuple[int, float]], total: float, size: float
) -> Problem:
    ids = network.blocks["point"].ids
    own = [lines[k] for k, _ in loop if lines[k].group is not None]
    names = " - ".join(dict.fromkeys(ids[end] for line in own for end in (line.start, line.end)))
    places = ", ".join(str(line_of(line.group, line.row)) for line in own if line.group is not None)
    closing = own[0]
    unit = network.project.units.length
    where = f"; its lines: {places}" if len(own) > 1 and places.strip("0, ") else ""
    words = f"levelling {names}: the loop misses by {total:.4g} {unit} ({size:.0f} sigma){where}"
    file, line = (closing.group.file, line_of(closing.group, closing.row)) if closing.group else ("", 0)
    return Problem(words, file, line)
