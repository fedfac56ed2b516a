"""Levelling in a field book: staff readings become height differences between two points.

A set-up has one or several readings back to one point and forward to another. The height difference is the mean of the
readings back less the mean of those forward. A reading to another point, the height that the instrument computes, or a
new line ends the set-up. Intermediate sights have the mean of the readings back of their set-up.

Instruments number turning points anew in every line. A name that lies inside two lines, or a number that lies inside a
line and ends another, is therefore one point only if the recorded heights agree, in lines that meet at one height:
others may begin at 0. Heights of points whose names are no numbers are compared above a point that both lines have and
one of them ends at. Names as BM 3 or TBM-A are those of benchmarks, which are one point each.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import fmean
from typing import NamedTuple

SIGMA_KILOMETRE, SIGMA_SET_UP = "1 mm", "0.3 mm"
"""Standard deviations of a height difference over 1 km, and of one set-up without distances: no field book has any."""
SAME_HEIGHT = 0.01
"""Metres within which recorded heights of a point agree: levelling lines close better than that."""
ALONE = "staff readings without a counterpart"
REPEATED = "staff readings that were repeated"


class StaffReading(NamedTuple):
    """A staff reading and the distance to the staff in metres, ``None`` if it was not measured."""

    point: str
    value: float
    distance: float | None
    line: int


class LevelledDifference(NamedTuple):
    """A height difference and the length of its sights in metres, ``None`` if a distance is missing."""

    start: str
    end: str
    value: float
    length: float | None
    line: int

    def with_names(self, names: Mapping[str, str]) -> LevelledDifference:
        """Return the height difference between points of other names."""
        return self._replace(start=names.get(self.start, self.start), end=names.get(self.end, self.end))


@dataclass
class LevellingLine:
    """Height differences of a line in their order, and the heights that the instrument computed."""

    differences: list[LevelledDifference] = field(default_factory=list)
    sides: list[LevelledDifference] = field(default_factory=list)
    """Intermediate sights."""
    heights: dict[str, float] = field(default_factory=dict)

    def all_differences(self) -> list[LevelledDifference]:
        """Height differences, those of intermediate sights behind the others."""
        return [*self.differences, *self.sides]

    def inside(self) -> set[str]:
        """Names of points of the line that are neither its first nor its last."""
        return {name for row in self.all_differences() for name in (row.start, row.end)} - self.ends()

    def ends(self) -> set[str]:
        """First and last point."""
        return {self.differences[0].start, self.differences[-1].end} if self.differences else set()


@dataclass
class Levelling:
    """Lines of levelling, and the set-up that is open."""

    lines: list[LevellingLine] = field(default_factory=list)
    back: list[StaffReading] = field(default_factory=list)
    fore: list[StaffReading] = field(default_factory=list)
    between: list[StaffReading] = field(default_factory=list)
    last_back: list[StaffReading] = field(default_factory=list)
    """Readings back of the set-up before."""
    reached: set[str] = field(default_factory=set)
    """Points with readings."""
    current: str = ""
    """Last point that was sighted forward or between."""
    alone: list[int] = field(default_factory=list)
    """Lines of readings without a counterpart."""
    repeated: list[int] = field(default_factory=list)
    """Lines of readings of set-ups that were measured again."""

    def begin(self) -> None:
        """Begin a line."""
        self.close()
        self.last_back, self.current = [], ""
        if not self.lines or self.lines[-1].differences or self.lines[-1].sides:
            self.lines.append(LevellingLine())

    def sight_back(self, reading: StaffReading) -> None:
        """Add a reading back; without a name it is to the point sighted forward before."""
        if self.between and not self.fore:  # the instrument moved after intermediate sights
            self.close()
        named = reading if reading.point else reading._replace(point=self.current or f"line {reading.line}")
        self._add(named, self.back, self.fore)

    def sight_forward(self, reading: StaffReading) -> None:
        """Add a reading forward; a turning point may have no name."""
        if not reading.point:
            reading = reading._replace(point=self.fore[-1].point if self.fore else f"turning point {reading.line}")
        self._add(reading, self.fore, self.back)
        self.current = reading.point

    def sight_between(self, reading: StaffReading) -> None:
        """Add an intermediate sight: of the open set-up, or of the one before."""
        if self.back or not self.last_back:
            self.between.append(reading)
        else:
            self._line().sides.append(_difference(self.last_back, [reading]))
        self.reached.add(reading.point)
        self.current = reading.point

    def _add(self, reading: StaffReading, same: list[StaffReading], other: list[StaffReading]) -> None:
        if same and same[-1].point != reading.point:
            # The other staff may be read first: its readings since the last one of this kind begin the new set-up.
            later = [r for r in other if r.line > same[-1].line and r.point != reading.point]
            if later and len(later) < len(other):
                other[:] = [r for r in other if r not in later]
            else:
                later = []
            self.close()
            other.extend(later)
        same.append(reading)
        self.reached.add(reading.point)

    def is_result(self, point: str) -> bool:
        """Return whether a height of the point is computed from the readings before it."""
        return not point or point == self.current

    def result(self, point: str, height: float | None) -> None:
        """End the set-up at the height that the instrument computed, unless it is that of an intermediate sight."""
        name = point or self.current
        if self.fore or not self.between:
            self.close()
        self.record(name, height)

    def record(self, point: str, height: float | None) -> None:
        """Record the height of a point that the book has in the open line."""
        if height is not None:
            self._line().heights[point] = height

    def close_at(self, last: str, benchmark: str, known: float | None, computed: float | None) -> None:
        """End the line: its last point is a benchmark if it is a number with the height that is known."""
        self.close()
        rows = self._line().differences
        is_same = known is not None and computed is not None and abs(computed - known) <= SAME_HEIGHT
        if rows and rows[-1].end == last and last.isdecimal() and is_same:
            rows[-1] = rows[-1]._replace(end=benchmark)

    def repeat(self) -> None:
        """Forget the readings of the open set-up: it is measured again."""
        self.repeated += [r.line for r in (*self.back, *self.fore, *self.between)]
        self.current = self.back[0].point if self.back else self.current
        self.back, self.fore, self.between = [], [], []

    def close(self) -> None:
        """End the set-up."""
        if self.back and self.fore:
            self._line().differences.append(_difference(self.back, self.fore))
        elif not (self.back and self.between):
            self.alone += [r.line for r in (*self.back, *self.fore)]
        if self.back:
            self._line().sides += [_difference(self.back, [reading]) for reading in self.between]
            self.last_back = list(self.back)
        else:
            self.alone += [r.line for r in self.between]
        self.back.clear()
        self.fore.clear()
        self.between.clear()

    def _line(self) -> LevellingLine:
        if not self.lines:
            self.lines.append(LevellingLine())
        return self.lines[-1]

    def finish(self) -> tuple[list[LevelledDifference], list[str]]:
        """Height differences of all lines, and the names that were used again for other points."""
        self.close()
        names, renamed = self.names_of_lines()
        found = [
            row.with_names(own) for line, own in zip(self.lines, names, strict=True) for row in line.all_differences()
        ]
        return found, renamed

    def names_of_lines(self) -> tuple[list[dict[str, str]], list[str]]:
        """Return for each line its points that are others than those of an earlier line, and their old names."""
        ends = set[str]().union(*(line.ends() for line in self.lines))
        systems, shifts = self._height_systems(), self._shifts()
        known: dict[str, list[list[tuple[int, float | None]]]] = {}
        renamed: list[str] = []
        found: list[dict[str, str]] = []
        benchmark = re.compile(r"t?bm(?:[^a-z]|[a-z]?\d*$)|bench ?mark", re.IGNORECASE)
        for here, line in enumerate(self.lines):
            names = {}
            for name in sorted(line.inside()):
                if benchmark.match(name):
                    continue
                height = line.heights.get(name)
                final: list[tuple[int, float | None]] = [
                    (its, other.heights[name])
                    for its, other in enumerate(self.lines)
                    if name in other.ends() and name in other.heights
                ]
                if name in ends and not (name.isdecimal() and height is not None and final):
                    continue
                places = known.setdefault(name, [final] if final else [])
                same = [
                    k
                    for k, place in enumerate(places)
                    for there, other in place
                    if height is not None and other is not None
                    if (systems[here] == systems[there] and abs(height - other) <= SAME_HEIGHT)
                    or (not name.isdecimal() and _is_level(height, shifts[here], other, shifts[there]))
                ]
                if not same:
                    places.append([(here, height)])
                number = 1 + (same[0] if same else len(places) - 1)
                if number > 1:
                    names[name] = f"{name} ({number})"
                    renamed.append(name)
            found.append(names)
        return found, list(dict.fromkeys(renamed))

    def _shifts(self) -> list[tuple[int, float]]:
        """Return for each line a number that lines have in common if points tie them, and its zero height there.

        The points are the ends of one of two lines that the other one has, too, and whose names are no numbers.
        """
        shifts = [(k, 0.0) for k in range(len(self.lines))]
        for k, line in enumerate(self.lines):
            for other, earlier in enumerate(self.lines[:k]):
                common = line.heights.keys() & earlier.heights.keys() & (line.ends() | earlier.ends())
                steps = [earlier.heights[name] - line.heights[name] for name in common if not name.isdecimal()]
                if not steps or max(steps) - min(steps) > SAME_HEIGHT or shifts[k][0] == shifts[other][0]:
                    continue
                old, step = shifts[k], shifts[other][1] + fmean(steps) - shifts[k][1]
                shifts = [(shifts[other][0], zero + step) if its == old[0] else (its, zero) for its, zero in shifts]
        return shifts

    def _height_systems(self) -> list[int]:
        """Return a number for each line: lines that meet at one height have one, for others may begin at 0."""
        systems = list(range(len(self.lines)))
        met: dict[str, list[tuple[int, float]]] = {}
        for k, line in enumerate(self.lines):
            for name in line.ends() & line.heights.keys():
                for other, height in met.setdefault(name, []):
                    if abs(height - line.heights[name]) <= SAME_HEIGHT:
                        systems = [systems[other] if its == systems[k] else its for its in systems]
                met[name].append((k, line.heights[name]))
        return systems


def _is_level(height: float, shift: tuple[int, float], other: float, its_shift: tuple[int, float]) -> bool:
    """Return whether heights in two lines that points tie are the same."""
    return shift[0] == its_shift[0] and abs(height + shift[1] - other - its_shift[1]) <= SAME_HEIGHT


def _difference(back: list[StaffReading], fore: list[StaffReading]) -> LevelledDifference:
    distances = [[r.distance for r in side if r.distance] for side in (back, fore)]
    complete = all(len(d) == len(side) for d, side in zip(distances, (back, fore), strict=True))
    length = sum(fmean(d) for d in distances) if complete else None
    value = fmean(r.value for r in back) - fmean(r.value for r in fore)
    return LevelledDifference(back[0].point, fore[0].point, value, length, back[0].line)
