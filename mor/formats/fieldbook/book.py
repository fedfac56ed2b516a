"""A field book: the set-ups, sights and points that an instrument recorded, and the project made from them.

Readers translate records into calls of :class:`FieldBook`; everything that holds for every instrument is decided here:

- a station record opens a set-up; a sight belongs to the open one, or waits for the station record that follows;
- the circle may be turned between a stationing and the sights that follow it, so these are different sets;
- the instrument height holds for the set-up; a different height after the first sight opens another set-up;
- coordinates that were keyed in or uploaded are given; coordinates that the instrument computed from its readings are
  not used, and a station whose point was sighted before, or was determined by a resection, has computed coordinates;
- given coordinates that come again replace the earlier ones, as they do in the instrument.
"""

from __future__ import annotations

import cmath
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, count, islice, pairwise
from math import atan2, cos, hypot, inf, isnan, nan, pi, radians, sin, sqrt, tau
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from mor.errors import counted
from mor.formats.draft import Draft, Row, parse_number, read_lines
from mor.project.levelling import ALONE, REPEATED, SIGMA_KILOMETRE, SIGMA_SET_UP, LevelledDifference, Levelling
from mor.types import BoolArray, FloatArray

AGREES = 0.1
"""Metres within which a slope distance agrees with given coordinates, for the purpose of telling whose sight it is."""
APART, APART_IN_HEIGHT = 0.5, 3.0
"""Metres in plan and in height (a target height may be wrong) beyond which two sights are not to the same point."""
FARTHER = 1.1
"""Factor and metres by which given points may be farther apart than the sights between them: target heights, scale."""
_COMPARED, _BLOCKS = 20, 100
"""Targets with which one is compared, and groups of sights of a set-up that are compared with each other."""
SAME_PLACE = 0.01
"""Metres within which readings are to the same place."""
ROUNDED = 0.0015
"""Metres within which coordinates are the same but for rounding."""
CIRCLE_SET = 1e-4
"""Part of the full circle (2 arcmin) within which a sight reads what the circle was set to."""
GNSS = "GNSS positions (latitude, longitude); their coordinates in the system of the job are read if it has them"
COMPUTED = "coordinates that the instrument computed from its readings"
_ZERO = "coordinates that are all 0"
_PRESET = "coordinates that an instrument presets: several stations share them, or they are far from others"


Place: TypeAlias = tuple[float | None, float | None, float | None]
"""East, north and height in metres; ``None`` if there is none."""


class Sight(NamedTuple):
    """Readings to a target; angles in the unit of the book, lengths in metres, ``None`` if there is none."""

    target: str
    line: int
    horizontal: float | None = None
    zenith: float | None = None
    slope: float | None = None
    horizontal_distance: float | None = None
    height: float = 0.0
    face: int = 0
    """1 or 2, 0 where only the zenith angle tells."""
    bearing: float | None = None
    before: bool = False
    """True if the instrument recorded it before its station: the circle may have been turned in between."""
    computed: PointRecord | None = None
    """Coordinates of the target that the instrument computed from the readings; ``None`` if the book has none."""


class PointRecord(NamedTuple):
    """Coordinates of a point in metres, ``None`` if the book has none, and their line."""

    east: float | None
    north: float | None
    height: float | None
    line: int


@dataclass
class InstrumentSetUp:
    """An instrument over a point."""

    station: str
    line: int
    height: float = 0.0
    sights: list[Sight] = field(default_factory=list)
    used: bool = False
    """True once a sight followed the station record."""
    orientation: float | None = None
    """What the book adds to circle readings to get azimuths; ``None`` if it does not say it."""
    unnamed: bool = False
    """True if the book does not name the station."""
    turn: float | None = None
    """What the circle was turned by when the station was recorded, in the unit of the book; ``None`` if unknown."""


@dataclass
class FieldBook:
    """Records collected by a reader of field books."""

    draft: Draft
    angle: str = "deg"
    """deg or gon."""
    stations_follow: bool = False
    """True if sights before the first station record belong to it; otherwise their station is unknown."""
    set_ups: list[InstrumentSetUp] = field(default_factory=list)
    points: dict[str, PointRecord] = field(default_factory=dict)
    """Given coordinates of points."""
    zeros: list[tuple[str, PointRecord]] = field(default_factory=list)
    """Given coordinates that are all 0."""
    precision: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Standard deviations in plan (both coordinates together) and in height of points by GNSS."""
    computed: dict[str, PointRecord] = field(default_factory=dict)
    """Coordinates of points that the instrument computed; the points of a book without readings."""
    waiting: list[Sight] = field(default_factory=list)
    """Sights that belong to the station record that follows."""
    unlocated: set[int] = field(default_factory=set)
    """Lines of the sights whose records have no computed coordinates, in a format that may have them."""
    replaced: dict[str, tuple[PointRecord, PointRecord]] = field(default_factory=dict)
    """Given coordinates that came again, different from before: the first and the last ones."""
    levelling: Levelling = field(default_factory=Levelling)
    """Staff readings of a level."""
    unnamed_height: float = 0.0
    """Instrument height of a station that the book does not name."""
    skipped: dict[str, list[int]] = field(default_factory=dict)

    def set_up(
        self,
        station: str,
        line: int,
        height: float = 0.0,
        place: Place | None = None,
        claims: bool = False,
        resection: int = 0,
    ) -> InstrumentSetUp:
        """Open a set-up; sights that wait belong to it.

        With ``claims`` the last sights of the set-up before may belong to it as well: an instrument may record a
        resection before its station. ``place`` are the coordinates of the station record. Those of a station that two
        or more waiting points determine, or that are recorded after the line of a ``resection``, are computed.
        """
        if not station:
            return self._unnamed(line, height)
        last = self.set_ups[-1] if self.set_ups else None
        if last is not None and last.station == station and not last.used and not self.waiting:
            last.height = height or last.height
            return last
        if claims:
            self._claim(place)
        since = resection
        if len({sight.target for sight in self.waiting}) > 1:
            since = since or self.waiting[0].line
        given = self.points.get(station)
        if since and given is not None and given.line >= since:
            del self.points[station]
            self.computed_point(station, *given)
        if place is not None:
            add = self.computed_point if since and station not in self.points else self.station_point
            add(station, *place, line)
        opened = InstrumentSetUp(station, line, height, [sight._replace(before=True) for sight in self.waiting])
        self.waiting = []
        self.set_ups.append(opened)
        return opened

    def _claim(self, place: Place | None) -> None:
        """Let the last sights before a station record wait for it if they are those of its stationing.

        They are if the instrument could not compute coordinates from them, as it did at the station before, or if
        their distances fit the coordinates of the record and not those of the station before.
        """
        before = self.set_ups[-1] if self.set_ups else None
        sights = self.waiting if before is None else before.sights
        if before is not None and self.waiting:
            return
        located = any(sight.line not in self.unlocated for sight in sights)
        here = None if place is None else PointRecord(*place, 0)
        old = None
        if before is not None:
            old = self.points.get(before.station) or self.computed.get(before.station)
        first = len(sights)
        for k in range(len(sights) - 1, -1, -1):
            sight = sights[k]
            if sight.before:
                break
            if located:
                if sight.line not in self.unlocated:
                    break
                first = k
                continue
            misfit = None if here is None else self._misfit(here, sight)
            other = None if old is None else self._misfit(old, sight)
            if misfit is None:
                continue
            if misfit > 1.0 or (other is not None and other < misfit):
                break
            first = k
        if before is not None:
            self.waiting, before.sights = sights[first:], sights[:first]
        elif located and first:
            self.waiting = sights[:first]
            self._place_waiting()
            self.waiting = sights[first:]

    def _misfit(self, station: PointRecord, sight: Sight) -> float | None:
        """Misfit of a distance in plan to given coordinates, 1 at most if it agrees; ``None`` without both."""
        target = self.points.get(sight.target)
        length = sight.horizontal_distance
        if length is None and (polar := self.polar(sight)) is not None:
            length = polar[0]
        if target is None or length is None:
            return None
        (east, north), (target_east, target_north) = station[:2], target[:2]
        if east is None or north is None or target_east is None or target_north is None:
            return None
        return abs(hypot(target_east - east, target_north - north) - length) / (AGREES + 1e-3 * length)

    def instrument_height(self, height: float, line: int) -> None:
        """The height of the instrument; a different one after the first sight is that of another set-up."""
        if not self.set_ups:
            if self.waiting and self.unnamed_height and height != self.unnamed_height:
                self._place_waiting()
            else:
                self.unnamed_height = height
                return
        current = self.set_ups[-1]
        if current.unnamed and height != current.height:
            self._unnamed(line, height)
        elif not current.used:
            current.height = height
        elif height != current.height:
            self.draft.note(
                f"the instrument height at {current.station!r} changes from {current.height:g} to {height:g} m: "
                "another set-up begins",
                line,
            )
            self.set_up(current.station, line, height)

    def sight(self, sight: Sight) -> None:
        """Readings at the open set-up; without one they wait for a station record."""
        if not self.set_ups:
            if self.stations_follow:
                self.waiting.append(sight)
                return
            self._unnamed(sight.line, self.unnamed_height)
        self.set_ups[-1].sights.append(sight)
        self.set_ups[-1].used = True

    def wait(self, sight: Sight) -> None:
        """Readings that belong to the next station record."""
        self.waiting.append(sight)

    def forget_waiting(self, what: str) -> None:
        """Leave out the sights that wait: the stationing they belong to began anew."""
        for sight in self.waiting:
            self.leave_out(what, sight.line)
        self.waiting = []

    def _unnamed(self, line: int, height: float) -> InstrumentSetUp:
        name = f"station {1 + len(self.set_ups)}"
        self.draft.note(f"readings without a station before them: it is called {name}", line)
        opened = self.set_up(name, line, height)
        opened.unnamed = True
        return opened

    def backsight(self, set_up: InstrumentSetUp, sight: Sight, turned: bool = False) -> None:
        """Add the reading that the circle was set to at the backsight, unless a sight measured it.

        With ``turned`` a first sight to the backsight that reads something else was made before the circle was set.
        """
        for k, other in enumerate(set_up.sights):
            if other.target != sight.target or other.horizontal is None or sight.horizontal is None:
                continue
            if abs(self._folded(other.horizontal - self._flip(other) - sight.horizontal)) < CIRCLE_SET * self.full:
                return
            if turned and k == 0:
                set_up.sights[k] = other._replace(before=True)
                set_up.sights.insert(1, sight)
                return
        if not any(s.target == sight.target and s.horizontal is not None for s in set_up.sights):
            set_up.sights.insert(0, sight)

    def sighted(self, name: str) -> bool:
        """Return whether an earlier set-up sighted a point."""
        return any(sight.target == name for set_up in self.set_ups for sight in set_up.sights)

    def point(self, name: str, east: float | None, north: float | None, height: float | None, line: int) -> None:
        """Add given coordinates; the last ones of a point count. Coordinates that are all 0 may be none."""
        if not any((east, north, height)):
            self.zeros.append((name, PointRecord(east, north, height, line)))
            return
        old = self.points.get(name)
        if old is None:
            self.points[name] = PointRecord(east, north, height, line)
            return
        new = PointRecord(
            old.east if east is None else east,
            old.north if north is None else north,
            old.height if height is None else height,
            line,
        )
        if any(a is not None and a != b for a, b in zip(old[:3], new[:3], strict=True)):
            self.replaced[name] = (self.replaced.get(name, (old,))[0], new)
        self.points[name] = new

    def computed_point(
        self, name: str, east: float | None, north: float | None, height: float | None, line: int
    ) -> None:
        """Add coordinates that the instrument computed: they are used only if the book has no readings."""
        sights = self.set_ups[-1].sights if self.set_ups else self.waiting
        if any((east, north, height)) and sights and sights[-1].target == name:
            sights[-1] = sights[-1]._replace(computed=PointRecord(east, north, height, line))
        if any((east, north, height)):
            self.computed[name] = PointRecord(east, north, height, line)
            self.leave_out(COMPUTED, line)
        else:
            self.leave_out(_ZERO, line)

    def station_point(
        self, name: str, east: float | None, north: float | None, height: float | None, line: int
    ) -> None:
        """Add coordinates of a station record: computed if an earlier set-up sighted the point, given otherwise.

        They are computed as well if they are those of a point that was sighted: instruments offer the last ones.
        """
        known = self.points.get(name)
        if known is not None and known[:3] == (east, north, height):
            return
        if self.sighted(name) or any(
            other != name and _same_plan(place, (east, north)) for other, place in self.computed.items()
        ):
            self.computed_point(name, east, north, height, line)
        else:
            self.point(name, east, north, height, line)

    def leave_out(self, what: str, line: int) -> None:
        """A record that is not read."""
        self.skipped.setdefault(what, []).append(line)

    def finish(self, title: str) -> None:
        """Put everything into the draft."""
        draft = self.draft
        self._settle()
        self._drop_pointings()
        self._take_zeros()
        self._drop_presets()
        self._drop_contradicted()
        self._drop_zero_heights()
        self._orient()
        levelled = self._level()
        for what, lines in self.skipped.items():
            draft.note(f"not read: {what} ({counted(len(lines), 'record')}, lines {_spans(lines)})", lines[0])
        if self.replaced:
            said = [f"{name} (line {old.line}, then {new.line})" for name, (old, new) in self.replaced.items()]
            draft.note(
                f"{counted(len(self.replaced), 'point')} with other coordinates later in the book, which replace "
                f"the earlier ones: {_first_names(said)}",
                next(iter(self.replaced.values()))[1].line,
            )
        draft.put("title", title)
        draft.put("units", {"length": "m", "angle": self.angle})
        draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
        occupied = [set_up for set_up in self.set_ups if set_up.sights]
        plane = bool(occupied) and not levelled and not self.spatial()
        if plane:
            self._drop_heights()
        _put_points(self, occupied, levelled)
        if occupied:
            _put_sights(self, occupied)
            _put_curvature(self, occupied)
        if levelled:
            _put_levelling(self, levelled)
        if occupied or levelled:
            settings = {"undetermined": "leave_out"}
            if not occupied:
                settings["dimensions"] = "z"
            elif plane:
                settings["dimensions"] = "xy"
            draft.put("settings", settings)
        elif draft.data.get("points"):
            draft.note("there are no readings: the points are all there is")
        if not draft.data.get("points"):
            draft.problem(f"there is neither a point nor a reading{self._only()}")

    def level_height(self, point: str, height: float | None, line: int) -> None:
        """The height of a point in a levelling line: computed behind its readings, given at the start of a line."""
        if self.levelling.is_result(point):
            self.levelling.result(point, height)
            self.leave_out(COMPUTED, line)
            return
        reached = point in self.levelling.reached
        self.levelling.begin()
        self.levelling.record(point, height)
        if height is not None:
            (self.computed_point if reached else self.point)(point, None, None, height, line)

    def _level(self) -> list[LevelledDifference]:
        """Height differences between points."""
        rows, renamed = self.levelling.finish()
        for what, lines in ((ALONE, self.levelling.alone), (REPEATED, self.levelling.repeated)):
            for line in lines:
                self.leave_out(what, line)
        if renamed:
            names = _first_names(renamed)
            self.draft.note(
                f"{counted(len(renamed), 'name')} of turning points in several lines at different heights, which are "
                f"called NAME (2) and so on: {names}",
                rows[0].line,
            )
        for row in rows:
            if row.start == row.end:
                self.leave_out("height differences from a point to itself", row.line)
        return [row for row in rows if row.start != row.end]

    def spatial(self) -> bool:
        """Return whether a sight tells heights: by a zenith angle or a slope distance."""
        sights = [sight for set_up in self.set_ups for sight in set_up.sights]
        return any(sight.zenith is not None or sight.slope is not None for sight in sights)

    def _drop_pointings(self) -> None:
        """Leave out the zenith angles of sights without a distance if they are rough.

        A first sight of this kind sets the circle: the target is pointed at in direction only. That is so in a book
        whose later sights to these targets have other zenith angles. A later one is to another height.
        """
        turned = CIRCLE_SET * self.full
        first, later, known = list[tuple[InstrumentSetUp, int]](), list[tuple[InstrumentSetUp, int]](), list[float]()
        reached = set[str]()
        for set_up in self.set_ups:
            for k, sight in enumerate(set_up.sights):
                if sight.slope:
                    reached |= {set_up.station, sight.target}
                if sight.slope is not None or sight.zenith is None or sight.horizontal is None:
                    continue
                apart = [
                    abs((other.zenith or 0.0) - sight.zenith)
                    for other in set_up.sights[1:]
                    if other.target == sight.target and other.slope
                    if face_of(other, self.full) == face_of(sight, self.full)
                ]
                if k == 0:
                    first.append((set_up, k))
                    known += apart
                elif min(apart, default=0.0) > turned:
                    later.append((set_up, k))
        for set_up, k in [*(first if known and median(known) >= turned else []), *later]:
            sight = set_up.sights[k]
            if sight.target in reached:
                what = "zenith angles of first sights without a distance, which are rough: these sights set the circle"
                if k:
                    what = "zenith angles of sights without a distance to another height than those with one"
                self.leave_out(what, sight.line)
                set_up.sights[k] = sight._replace(zenith=None, face=face_of(sight, self.full))

    def _take_zeros(self) -> None:
        """Take coordinates that are all 0 as those of the origin if nothing else is given, or if distances fit them."""

        def is_whole(place: PointRecord) -> bool:
            return None not in (place.height, 0.0 if self.levelling.reached else place.east)

        is_origin = not self.points and len({name for name, place in self.zeros if is_whole(place)}) == 1
        for name, place in self.zeros:
            whole = is_whole(place)
            if whole and (is_origin or (name not in self.points and self._fits(name, place))):
                self.points[name] = place
            elif name not in self.points or self.points[name][:3] != place[:3]:
                self.leave_out(_ZERO, place.line)

    def _fits(self, name: str, place: PointRecord) -> bool:
        """Return whether distances from and to given points agree with coordinates of a point."""
        misfits = [
            self._misfit(end, sight._replace(target=target))
            for set_up in self.set_ups
            for sight in set_up.sights
            for end, target in ((place, sight.target), (place, set_up.station))
            if name in (set_up.station, sight.target) and name != target
        ]
        found = [misfit for misfit in misfits if misfit is not None]
        return bool(found) and max(found) <= 1.0

    def _drop_presets(self) -> None:
        """Leave out coordinates that an instrument presets: several stations share them, or they are far from others.

        Those far from others are whole metres, and 100 km away from all that are none.
        """
        plans = self._plans()
        stations = {set_up.station: 0 for set_up in self.set_ups if set_up.station in plans}
        shared = Counter(plans[name] for name in stations)
        whole = {name for name in stations if plans[name].real % 1.0 == plans[name].imag % 1.0 == 0.0}
        others = [plan for name, plan in plans.items() if name not in whole]
        for name in stations:
            far = name in whole and others and min(abs(plans[name] - other) for other in others) > 1e5
            if far or shared[plans[name]] > 1:
                self.leave_out(_PRESET, self.points.pop(name).line)

    def _drop_contradicted(self) -> None:
        """Leave out given coordinates that are farther from most others, or nearer, than the sights between them allow.

        They are of another system, as are points nearer to those than allowed that no distance confirms. All are left
        out if that concerns more than half of the points, and none if it concerns half of them, unless the others alone
        are no whole metres. Books of more than 2000 given points are taken as they are.
        """
        plans = self._plans()
        if not 2 <= len(plans) <= 2000:
            return
        places, ways = np.array(list(plans.values())), self._ways(list(plans))
        given = np.abs(places[:, None] - places)
        nearer, confirmed = self._nearer(list(plans), given)
        bad = np.isfinite(ways) & ((given > FARTHER * ways + FARTHER) | nearer)
        contradicted, excess = bad.sum(axis=1), (2 * bad - np.isfinite(ways).astype(int)).sum(axis=1)
        is_whole = (places.real % 1.0 == 0.0) & (places.imag % 1.0 == 0.0)
        left = np.ones(len(places), dtype=bool)
        while contradicted[left].any():
            worst = max(np.flatnonzero(left).tolist(), key=lambda k: (excess[k], is_whole[k]))
            left[worst] = False
            contradicted -= bad[worst]
            excess -= 2 * bad[worst] - np.isfinite(ways[worst]).astype(int)
        left &= ~nearer.any(axis=1) | (confirmed & left).any(axis=1)
        dropped = 2 * np.count_nonzero(~left)
        if dropped < len(left) or (dropped == len(left) and is_whole[~left].all()):
            for name in np.array(list(plans))[~left].tolist():
                self.leave_out(
                    "coordinates that are farther from other given ones, or nearer, than the sights between them allow",
                    self.points.pop(name).line,
                )
        elif dropped > len(left):
            for name in plans:
                self.leave_out("coordinates that the measured distances contradict", self.points.pop(name).line)

    def _plans(self) -> dict[str, complex]:
        """Given coordinates in plan, of the points that have both."""
        known = ((name, place.east, place.north) for name, place in self.points.items())
        return {name: complex(east, north) for name, east, north in known if east is not None and north is not None}

    def _nearer(self, names: Sequence[str], given: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return the pairs (n, n) that are nearer than distances in plan allow, and those that a distance confirms.

        They are nearer than the distance between them, or than two or more other points allow: the difference of the
        distances to such a point is larger.
        """
        lengths: dict[str, dict[int, float]] = {}
        number = {name: k for k, name in enumerate(names)}
        for set_up in self.set_ups:
            for sight in set_up.sights:
                polar = self.polar(sight)
                length = polar[0] if polar else sight.horizontal_distance
                for one, other in ((set_up.station, sight.target), (sight.target, set_up.station)):
                    if length and one in number:
                        lengths.setdefault(other, {})[number[one]] = length
        most = FARTHER * given + FARTHER
        direct, count, over = np.full(given.shape, np.nan), np.zeros(given.shape, int), np.zeros(given.shape, int)
        for name, known in lengths.items():
            places, found = np.array(list(known)), np.array(list(known.values()))
            block = np.ix_(places, places)
            count[block] += 1
            over[block] += np.abs(found[:, None] - found) > most[block]
            if name in number:
                direct[number[name], places] = direct[places, number[name]] = found
        confirmed = (direct <= most) & (given <= FARTHER * direct + FARTHER)
        return (direct > most) | ((over > 1) & (2 * over > count)), confirmed

    def _ways(self, names: Sequence[str]) -> FloatArray:
        """Lengths (n, n) of the shortest ways along sights between points; infinite if there is none."""
        longest: dict[tuple[str, str], float] = {}
        for set_up in self.set_ups:
            for sight in set_up.sights:
                length = sight.slope or sight.horizontal_distance
                if length:
                    key = min(set_up.station, sight.target), max(set_up.station, sight.target)
                    longest[key] = max(length, longest.get(key, 0.0))
        seen = Counter(name for key in longest for name in key)
        number = {name: k for k, name in enumerate(dict.fromkeys([*names, *(n for n in seen if seen[n] > 1)]))}
        kept = [key for key in longest if key[0] in number and key[1] in number]
        ends = [number[a] for a, _ in kept], [number[b] for _, b in kept]
        graph = coo_array(([longest[key] for key in kept], ends), shape=(len(number), len(number))).tocsr()
        ways: FloatArray = dijkstra(graph, directed=False, indices=np.arange(len(names)))[:, : len(names)]
        np.fill_diagonal(ways, np.inf)
        return ways

    def _drop_zero_heights(self) -> None:
        """Leave out the heights of given points if all are 0: instruments write it for none."""
        heights = [place.height for place in self.points.values() if place.height is not None]
        if len(heights) > 1 and not any(heights):
            for name, place in self.points.items():
                if place.height is not None:
                    self.leave_out("heights of given points that are all 0", place.line)
                    self.points[name] = place._replace(height=None)

    def _orient(self) -> None:
        """Turn circle readings into azimuths where nothing but the orientation that the book says tells the direction.

        That is at stations with given coordinates, or sighted from another one where the book says the orientation,
        that sight no point with given coordinates, or with a place from another station, and at one set-up of a part
        of the book whose given points are one, or within 1 m.
        """
        placed: dict[str, set[int]] = {}
        for k, set_up in enumerate(self.set_ups):
            placed.setdefault(set_up.station, set()).add(k)
            for sight in set_up.sights:
                if sight.slope or sight.horizontal_distance:
                    placed.setdefault(sight.target, set()).add(k)
        turned = list[InstrumentSetUp]()
        alone = [part for part in _parts(self.set_ups) if 0.0 <= self._extent(part & self.points.keys()) < 1.0]
        for k, set_up in enumerate(self.set_ups):
            targets = {sight.target for sight in set_up.sights if sight.horizontal is not None}
            part = next((part for part in alone if set_up.station in part), None)
            tied = any(name in self.points or placed.get(name, set()) - {k} for name in targets)
            given = set_up.station in self.points
            reached = not tied and set_up.orientation is not None and placed.get(set_up.station, set()) - {k}
            if (tied and part is None) or not (given or reached) or not targets:
                continue
            if set_up.orientation is None:
                set_up.orientation = self._computed_orientation(set_up)
            if set_up.orientation is None or (tied and any(other.station in (part or ()) for other in turned)):
                continue
            turned.append(set_up)
            set_up.sights = [
                sight
                if sight.horizontal is None
                else sight._replace(
                    horizontal=None, bearing=(sight.horizontal + set_up.orientation + self._flip(sight)) % self.full
                )
                for sight in set_up.sights
            ]
        if turned:
            names = _first_names([s.station for s in turned])
            self.draft.note(
                f"{counted(len(turned), 'set-up')} oriented by the azimuth of circle or backsight that the book says, "
                f"or by computed coordinates, as no known point is sighted: {names}",
                turned[0].line,
            )

    def _extent(self, names: Iterable[str]) -> float:
        """Largest distance in plan between given points; negative without any."""
        known = self._plans()
        plans = [known[name] for name in names if name in known]
        return max((abs(plan - plans[0]) for plan in plans), default=-1.0)

    def _computed_orientation(self, set_up: InstrumentSetUp) -> float | None:
        """The angle that the instrument added to circle readings to compute the targets; ``None`` if it is not one."""
        station, full = self.points[set_up.station], self.full
        turns = []
        for sight in set_up.sights:
            end, polar = sight.computed or self.computed.get(sight.target), self.polar(sight)
            if end is None or polar is None or sight.horizontal is None or None in (*end[:2], *station[:2]):
                continue
            east, north = (end.east or 0.0) - (station.east or 0.0), (end.north or 0.0) - (station.north or 0.0)
            if polar[0] > 1.0 and abs(hypot(east, north) - polar[0]) < AGREES:
                turns.append(atan2(east, north) * full / tau - sight.horizontal - self._flip(sight))
        apart = [self._folded(turn - turns[0]) for turn in turns]
        is_turned = len({sight.before for sight in set_up.sights}) > 1
        if not turns or is_turned or max(map(abs, apart)) > CIRCLE_SET * full:
            return None
        return turns[0] + sum(apart) / len(apart)

    def _folded(self, angle: float) -> float:
        """The angle within half a circle to either side."""
        return (angle + self.full / 2) % self.full - self.full / 2

    def parsed(self, angle: str) -> float:
        """An angle in gon, or as degrees, minutes and seconds."""
        return parse_number(angle) if self.angle == "gon" else sexagesimal(angle)

    def _flip(self, sight: Sight) -> float:
        """Half a circle for a reading in face two."""
        return self.full / 2 if face_of(sight, self.full) == 2 else 0.0

    def _drop_heights(self) -> None:
        """Leave out the given heights of a book whose readings tell none."""
        heights = [place.line for place in self.points.values() if place.height is not None]
        if heights:
            self.draft.note(
                f"{counted(len(heights), 'given height')} not used: no reading tells heights, so the network is in "
                "the plane",
                heights[0],
            )
        self.points = {name: place._replace(height=None) for name, place in self.points.items()}

    def _only(self) -> str:
        found = [f"{what} ({counted(len(lines), 'record')})" for what, lines in self.skipped.items()]
        return f"; it has only: {'; '.join(found)}" if found else ""

    def _settle(self) -> None:
        """Place sights that still wait, drop sights to the station itself, and tell computed from given stations."""
        self._place_waiting()
        for set_up in self.set_ups:
            for sight in set_up.sights:
                if sight.target == set_up.station:
                    self.leave_out("sights from a station to itself", sight.line)
            set_up.sights = [sight for sight in set_up.sights if sight.target != set_up.station]
            self._drop_faulty(set_up)
        self._part_set_ups()
        for set_up in self.set_ups:
            self._correct_heights(set_up)
            self._part_first_sight(set_up)
        for set_up in self.set_ups:
            self._join_circles(set_up)
        self._part_names()
        if not any(set_up.sights for set_up in self.set_ups) and not self.levelling.reached:
            self.skipped.pop(COMPUTED, None)
            self.points = {**self.computed, **self.points}

    @property
    def full(self) -> float:
        """The full circle in the unit of the book."""
        return 360.0 if self.angle == "deg" else 400.0

    def _drop_faulty(self, set_up: InstrumentSetUp) -> None:
        """Leave out impossible zenith angles, and three sights or more that a download repeated to the last digit."""
        kept: list[Sight] = []
        for sight in set_up.sights:
            if sight.zenith is not None and not 0.0 <= sight.zenith <= self.full:
                self.leave_out("sights with an impossible zenith angle", sight.line)
            elif (polar := self.polar(sight)) is not None and polar[0] < ROUNDED < (sight.slope or 0.0):
                self.leave_out("sights straight up or down, whose horizontal direction means nothing", sight.line)
            else:
                kept.append(sight)
        first: dict[Sight, int] = {}
        runs: list[list[int]] = []
        for k, sight in enumerate(kept):
            same = first.setdefault(sight._replace(line=0), k)
            if same == k:
                continue
            if runs and runs[-1][1] == k - 1 and first[kept[k - 1]._replace(line=0)] == same - 1:
                runs[-1][1] = k
            else:
                runs.append([k, k])
        copies = {k for a, b in runs if b - a >= 2 for k in range(a, b + 1)}
        for k in copies:
            self.leave_out("sights that repeat earlier ones in the same order to the last digit", kept[k].line)
        set_up.sights = [sight for k, sight in enumerate(kept) if k not in copies]

    def _part_set_ups(self) -> None:
        """Part set-ups where the instrument computed targets from other coordinates; place those without a name.

        The sights of a set-up during which the instrument was moved otherwise are left out.
        """
        whole, self.set_ups = self.set_ups, []
        taken = {set_up.station for set_up in whole}
        runs = [self._computed_from(set_up.sights) for set_up in whole]
        if not any(run.spread > 0.5 for found in runs for run in found):
            runs = [[] for _ in whole]  # the circle does not read azimuths
        placed = list[InstrumentSetUp]()
        for set_up, found in zip(whole, runs, strict=True):
            pieces = _parted(set_up, [run.first for run in found[1:]], taken)
            self.set_ups += pieces
            for piece, run in zip(pieces, found, strict=False):
                if piece.unnamed and piece.station not in self.points:
                    self._place(piece, run.axis())
                    placed.append(piece)
        for set_up in self.set_ups:
            if self._is_moved(set_up.sights):
                what = (
                    "sights of set-ups during which the instrument was moved without a record: targets sighted again "
                    "are as far from each other as before, but not from the instrument"
                )
                for sight in set_up.sights:
                    self.leave_out(what, sight.line)
                set_up.sights = []
        if placed:
            names = _first_names([s.station for s in placed])
            self.draft.note(
                f"{counted(len(placed), 'set-up')} whose station the book does not name stand where the instrument "
                f"computed its targets from: {names}",
                placed[0].line,
            )

    def _computed_from(self, sights: Sequence[Sight]) -> list[_Run]:
        """Runs of sights whose targets the instrument computed from the same coordinates, read as azimuths."""
        runs, before = list[_Run](), _Run(0)
        for k, sight in enumerate(sights):
            polar, target = self.polar(sight), sight.computed
            if polar is None or sight.horizontal is None or target is None or None in target[:2]:
                continue
            azimuth = (sight.horizontal + self._flip(sight)) * tau / self.full
            end = complex(target.east or 0.0, target.north or 0.0)
            height = nan if target.height is None else target.height - polar[1]
            one = _Run(k, [sight.target], [end], [end - polar[0] * complex(sin(azimuth), cos(azimuth))], [height])
            if runs and runs[-1].is_at(one):
                runs[-1].take(one)
            elif before.ends and before.names[0] != sight.target and before.is_at(one):
                before.take(one)
                runs.append(before)
            else:
                before = one
        return runs

    def _place(self, set_up: InstrumentSetUp, axis: tuple[float, float, float]) -> None:
        """Name a set-up after the point at given or computed coordinates, or give it those of its axis.

        Two given targets or more place it themselves.
        """
        known = [*self.points.items(), *self.computed.items()]
        east, north, height = axis
        at = [(name, p) for name, p in known if hypot((p.east or inf) - east, (p.north or inf) - north) < SAME_PLACE]
        if at:
            set_up.station, point = at[0]
            above = height - (nan if point.height is None else point.height)
            if not set_up.height and 0.0 < above < 3.0:  # metres between a point and the instrument over it
                set_up.height = round(above, 3)
        elif len({sight.target for sight in set_up.sights} & self.points.keys()) < 2:
            up = None if isnan(height) else round(height - set_up.height, 3)
            self.point(set_up.station, round(east, 3), round(north, 3), up, set_up.line)

    def _is_moved(self, sights: Sequence[Sight]) -> bool:
        """Return whether targets are sighted again that are as far from each other as before, but not from here."""
        blocks: list[_Block] = [{}]
        for sight, before in zip(sights, [None, *sights], strict=False):
            place = self._local(sight)
            if place is None:
                continue
            again = before is not None and before.target == sight.target  # in the other face
            if not again and _is_elsewhere(sight.target, place, blocks):
                blocks.append({})
            known = blocks[-1].setdefault(sight.target, [])
            if not any(abs(place[0] - other[0]) <= AGREES for other in known):
                known.append(place)
        return any(_is_away(block, one) and _is_rigid(block, one) for block, one in combinations(blocks[:_BLOCKS], 2))

    def _local(self, sight: Sight) -> tuple[complex, float] | None:
        """Place in plan, in the directions of the circle, and height of a target relative to the instrument."""
        polar = self.polar(sight)
        if polar is None or sight.horizontal is None:
            return None
        return cmath.rect(polar[0], (sight.horizontal + self._flip(sight)) * tau / self.full), polar[1]

    def _correct_heights(self, set_up: InstrumentSetUp) -> None:
        """Give a target that is sighted at the same place again the last target height, unless that is 0."""
        for k, sight in enumerate(set_up.sights):
            for later in reversed(set_up.sights[k + 1 :]):
                if later.target == sight.target and self._same_place(sight, later):
                    if later.height not in (0.0, sight.height):
                        what = (
                            "target heights that differ from those of a later sight to the same place, "
                            "which are used instead"
                        )
                        self.leave_out(what, sight.line)
                        set_up.sights[k] = sight._replace(height=later.height)
                    break

    def _same_place(self, one: Sight, other: Sight) -> bool:
        if None in (one.zenith, other.zenith, one.slope, other.slope, one.horizontal, other.horizontal):
            return False
        a, b = self.polar(one._replace(height=0.0)), self.polar(other._replace(height=0.0))
        across = self._apart(one, other) * (one.slope or 0.0)
        return (
            bool(a and b)
            and max(abs(across), *(abs(x - y) for x, y in zip(a or (), b or (), strict=True))) < SAME_PLACE
        )

    def _apart(self, one: Sight, other: Sight) -> float:
        """Angle (rad) between two circle readings, both in face one."""
        readings = [(sight.horizontal or 0.0) - self._flip(sight) for sight in (one, other)]
        return self._folded(readings[1] - readings[0]) * tau / self.full

    def _part_first_sight(self, set_up: InstrumentSetUp) -> None:
        """Make a first sight a set of its own if all later ones to its target read another circle: it was set then."""
        sights = set_up.sights
        again = [s for s in sights[1:] if s.target == sights[0].target and s.horizontal is not None]
        if not again or sights[0].horizontal is None or any(sight.before for sight in sights):
            return
        if any(abs((s.slope or -1.0) - (sights[0].slope or 1.0)) > SAME_PLACE for s in again):
            return
        turned = min(abs(self._apart(sights[0], sight)) for sight in again)
        steady = max(abs(self._apart(again[0], sight)) for sight in again)
        if turned > CIRCLE_SET * tau > steady:
            sights[0] = sights[0]._replace(before=True)

    def _part_names(self) -> None:
        """Give points of a set-up that share a name and are too far apart to be one different names.

        Directions are compared if the sets of a set-up show that the circle was not turned between them. Only points
        count that one station sights and that have no given coordinates: nothing else refers to them.
        """
        stations: dict[str, set[str]] = {}
        for set_up in self.set_ups:
            for sight in set_up.sights:
                stations.setdefault(sight.target, set()).add(set_up.station)
        occupied = {set_up.station for set_up in self.set_ups}
        parted: dict[str, int] = {}
        for set_up in self.set_ups:
            seen: dict[str, list[tuple[str, float, float]]] = {}
            elsewhere = self._elsewhere(set_up)
            for k, sight in enumerate(set_up.sights):
                name, measured = sight.target, self.polar(sight)
                alone = len(stations[name]) == 1 and name not in self.points and name not in occupied
                if not alone or measured is None:
                    continue
                known = seen.setdefault(name, [])
                same = [
                    other
                    for other, length, rise in known
                    if abs(length - measured[0]) <= APART
                    and abs(rise - measured[1]) <= APART_IN_HEIGHT
                    and k not in elsewhere
                ]
                own = same[0] if same else f"{name} ({len(known) + 1})" if known else name
                if not same:
                    known.append((own, *measured))
                    if own != name:
                        parted.setdefault(name, sight.line)
                set_up.sights[k] = sight._replace(target=own)
        if parted:
            names = _first_names(list(parted))
            self.draft.note(
                f"{counted(len(parted), 'name')} used again for points elsewhere, which are called NAME (2) and so on: "
                f"{names}",
                next(iter(parted.values())),
            )

    def _elsewhere(self, set_up: InstrumentSetUp) -> set[int]:
        """Numbers of sights that read other directions to a name than before, though the circle was not turned.

        A circle that is turned between two sets changes all directions by the same angle.
        """
        first: dict[str, Sight] = {}
        moved: dict[int, list[tuple[float, int]]] = {}
        numbers = rounds(set_up.sights, self.full)
        for k, (sight, number) in enumerate(zip(set_up.sights, numbers, strict=True)):
            if sight.horizontal is None or sight.slope is None:
                continue
            earlier = first.setdefault(sight.target, sight)
            if earlier is not sight:
                moved.setdefault(number, []).append((self._apart(earlier, sight) * sight.slope, k))
        return {
            k
            for across in moved.values()
            if max(across)[0] - min(across)[0] > APART
            for size, k in across
            if abs(size) > AGREES
        }

    def polar(self, sight: Sight) -> tuple[float, float] | None:
        """Distance in plan and height above the instrument of a target; ``None`` if they were not measured."""
        if sight.slope is None or sight.zenith is None:
            return None
        zenith = sight.zenith * (pi / 180.0 if self.angle == "deg" else pi / 200.0)
        return sight.slope * abs(sin(zenith)), sight.slope * cos(zenith) - sight.height

    def _place_waiting(self) -> None:
        if self.waiting:
            waiting, self.waiting = self.waiting, []
            self._unnamed(waiting[0].line, self.unnamed_height)
            self.set_ups[-1].sights, self.set_ups[-1].used = waiting, True

    def _join_circles(self, set_up: InstrumentSetUp) -> None:
        """Put the sights before and after a station record into one set where the readings allow it.

        An instrument turns its circle to grid north when it takes over the station it computed. Readings before that
        are azimuths already if the circle was not turned; otherwise they are turned by what they lack, if the later
        sights cannot find their orientation themselves.
        """
        early = [sight for sight in set_up.sights if sight.before and sight.horizontal is not None]
        later = [s for s in set_up.sights if not s.before and s.horizontal is not None]
        turn = self._turned(set_up, early) if set_up.turn is None else set_up.turn
        if turn is None or not early or not later:
            return
        if abs(self._folded(turn)) * 400.0 / self.full < 0.01 and set_up.turn is None:  # within 36 arcsec
            turn = 0.0
        elif set_up.turn is None:
            elsewhere = {s.target for other in self.set_ups for s in other.sights if other is not set_up}
            elsewhere |= {sight.target for sight in early} | self.points.keys()
            if any(sight.target in elsewhere for sight in later):
                return
            self.draft.note(
                f"the circle at {set_up.station!r} was turned when its station was recorded: the readings before are "
                f"turned by {turn:.4f} {self.angle}, as given coordinates tell",
                set_up.line,
            )
        set_up.sights = [
            s._replace(
                before=False,
                horizontal=(s.horizontal + turn) % self.full if s.before and s.horizontal is not None else s.horizontal,
            )
            for s in set_up.sights
        ]

    def _turned(self, set_up: InstrumentSetUp, early: Sequence[Sight]) -> float | None:
        """Angle from readings before a station record to azimuths; ``None`` if no coordinates tell it."""
        place, full = self.points.get(set_up.station) or self.computed.get(set_up.station), self.full
        turns = [
            azimuth - radians(s.horizontal * 360.0 / full) + (pi if face_of(s, full) == 2 else 0.0)
            for s in early
            if place is not None
            and s.horizontal is not None
            and (azimuth := self._azimuth(place, s.target)) is not None
        ]
        if not turns:
            return None
        return full / tau * atan2(sum(map(sin, turns)), sum(map(cos, turns)))

    def _azimuth(self, station: PointRecord, target: str) -> float | None:
        """Azimuth (rad) between given coordinates."""
        end = self.points.get(target)
        if end is None or None in end[:2] or None in station[:2]:
            return None
        return atan2((end.east or 0.0) - (station.east or 0.0), (end.north or 0.0) - (station.north or 0.0))


_Block = dict[str, list[tuple[complex, float]]]
"""Places of targets relative to an instrument; several if the readings to a target differ."""


@dataclass
class _Run:
    """Sights whose targets the instrument computed from the same coordinates."""

    first: int
    names: list[str] = field(default_factory=list)
    ends: list[complex] = field(default_factory=list)
    plans: list[complex] = field(default_factory=list)
    """Plan coordinates of the instrument, read back from each target."""
    heights: list[float] = field(default_factory=list)

    def is_at(self, other: _Run) -> bool:
        length = abs(other.ends[0] - other.plans[0])
        return abs(other.plans[0] - self.plans[0]) < AGREES + 1e-3 * length

    def take(self, other: _Run) -> None:
        self.names += other.names
        self.ends += other.ends
        self.plans += other.plans
        self.heights += other.heights

    @property
    def spread(self) -> float:
        """How far targets are from the first one, in parts of the longest sight: an error of azimuth would show."""
        longest = max(abs(end - plan) for end, plan in zip(self.ends, self.plans, strict=True))
        return max(abs(end - self.ends[0]) for end in self.ends) / longest if longest else 0.0

    def axis(self) -> tuple[float, float, float]:
        return (
            median(plan.real for plan in self.plans),
            median(plan.imag for plan in self.plans),
            median(self.heights),
        )


def _parted(set_up: InstrumentSetUp, begins: Sequence[int], taken: set[str]) -> list[InstrumentSetUp]:
    """The set-up with its sights before the first of ``begins``, and a new one for those from each of them on."""
    sights, parts = set_up.sights, [set_up]
    for first, end in pairwise([*begins, len(sights)]):
        name = next(name for n in count(2) if (name := f"station {n}") not in taken)
        taken.add(name)
        own = [sight._replace(before=False) for sight in sights[first:end]]
        parts.append(InstrumentSetUp(name, sights[first].line, set_up.height, own, unnamed=True))
    if begins:
        set_up.sights = sights[: begins[0]]
    return parts


def _is_elsewhere(name: str, place: tuple[complex, float], blocks: Sequence[_Block]) -> bool:
    """Return whether a place of a target contradicts the last of the blocks, by its distance or those to others."""
    current = blocks[-1]
    if name in current:
        return not any(_as_far(place, other) for other in current[name])
    off = [
        min(abs(abs(place[0] - here[0]) - abs(one[0] - there[0])) for here in current[target] for one in block[name])
        for block in blocks[:-1]
        if name in block
        for target, (there, *_) in islice(block.items(), _COMPARED)
        if target in current
    ]
    return 2 * sum(gap > APART for gap in off) > len(off)


def _as_far(one: tuple[complex, float], other: tuple[complex, float]) -> bool:
    return abs(abs(one[0]) - abs(other[0])) <= APART and abs(one[1] - other[1]) <= APART_IN_HEIGHT


def _is_away(block: _Block, other: _Block) -> bool:
    """Return whether most targets that two blocks share are at other distances from the instrument."""
    same = [any(_as_far(a, b) for a in block[name] for b in other[name]) for name in block if name in other]
    return 2 * sum(same) < len(same)


def _is_rigid(block: _Block, other: _Block) -> bool:
    """Return whether 3 targets or more of two blocks are as far from each other, in plan and height."""
    names, agree, contradict = set[str](), 0, 0
    for one, two in combinations([name for name in block if name in other][:_COMPARED], 2):
        (a, up_a), (b, up_b), (c, up_c), (d, up_d) = block[one][0], block[two][0], other[one][0], other[two][0]
        off, rise = abs(abs(a - b) - abs(c - d)), abs((up_a - up_b) - (up_c - up_d))
        if off <= AGREES and rise <= AGREES:
            names |= {one, two}
            agree += 1
        contradict += off > APART
    return len(names) >= 3 and agree > contradict


def _same_plan(place: PointRecord, coordinates: tuple[float | None, float | None]) -> bool:
    """Return whether a point has these coordinates in plan, but for rounding."""
    pairs = zip(place[:2], coordinates, strict=True)
    return all(a is not None and b is not None and abs(a - b) < ROUNDED for a, b in pairs)


def records(path: Path, draft: Draft) -> Iterator[tuple[int, str]]:
    """Lines of a file that are not empty, with their numbers, without the control characters of a serial line."""
    control = "".join(map(chr, (*range(9), *range(14, 32), 127)))
    for line, text in enumerate(read_lines(path, draft), start=1):
        bare = text.strip(control)
        if bare.strip():
            yield line, bare


def _put_points(book: FieldBook, occupied: Sequence[InstrumentSetUp], levelled: Sequence[LevelledDifference]) -> None:
    draft = book.draft
    measured = {set_up.station for set_up in occupied}
    measured |= {sight.target for set_up in occupied for sight in set_up.sights}
    measured |= {name for row in levelled for name in (row.start, row.end)}
    taking_part = [name for name in book.points if name in measured]
    if measured and not taking_part and book.points:
        draft.note(
            f"{counted(len(book.points), 'given point')} not used: no reading refers to them",
            next(iter(book.points.values())).line,
        )
        book.points = {}
    least = 1 if occupied else 0  # one height gives a level its datum
    control = _given_together(book, occupied, levelled) > least if measured else len(book.points) > 1
    sigma = "0.01" if control else None  # no field book has any
    stated = {name: (repr(h / sqrt(2.0)),) * 2 + (repr(v),) for name, (h, v) in book.precision.items() if h > 0.0 < v}
    flat = _flat(book, occupied, levelled)
    known = [
        Row(
            [
                name,
                *(None if v is None else repr(v) for v in place),
                *(
                    None if v is None or not control else own
                    for v, own in zip(place, stated.get(name, (sigma,) * 3), strict=True)
                ),
            ],
            line,
        )
        for name, (*place, line) in book.points.items()
    ]
    without_height = bool(occupied) and book.spatial() and not any(place.height for place in book.points.values())
    begin = next((row.cells for row in known if row.cells[0] in measured and row.cells[0] not in flat), None)
    if without_height and begin is not None:
        begin[3] = "0"  # start values need a height, whatever it is
    _put_table(book, ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), known, flat)
    bare = [row for row in known if row.cells[0] not in stated]
    if sigma and bare:
        points = counted(len(bare), "point")
        draft.note(
            f"coordinates of {points} are observed with σ = {sigma} m: the book says none for them", bare[0].line
        )
    elif known and measured and not sigma:
        draft.note(
            "coordinates of the book are start values: one point does not define the datum of a network", known[0].line
        )
    if not sigma or without_height:
        draft.put("datum", "free")
    first: dict[str, int] = {}
    for set_up in occupied:
        first.setdefault(set_up.station, set_up.line)
        for sight in set_up.sights:
            first.setdefault(sight.target, sight.line)
    for row in levelled:
        first.setdefault(row.start, row.line)
        first.setdefault(row.end, row.line)
    # Coordinates that the instrument computed from the given ones are start values.
    begun = book.computed if sigma and _PRESET not in book.skipped else {}
    others = [
        Row([name, *(None if v is None else repr(v) for v in begun.get(name, (None,) * 4)[:3])], line)
        for name, line in first.items()
        if name not in book.points
    ]
    _put_table(book, ("id", "x", "y", "z"), others, flat)
    lines = [first.get(name) or book.points[name].line for name in flat]
    if lines:
        names = _first_names(list(flat))
        draft.note(
            f"{counted(len(lines), 'point')} without a height: no reading tells it, so it is fixed at 0: {names}",
            lines[0],
        )


def _flat(
    book: FieldBook, occupied: Sequence[InstrumentSetUp], levelled: Sequence[LevelledDifference]
) -> dict[str, None]:
    """Points that no reading tells the height of and that have none, in a book with heights of others."""
    if not occupied and not levelled:
        return dict.fromkeys(name for name, place in book.points.items() if place.height is None)
    sights = [(set_up.station, sight) for set_up in occupied for sight in set_up.sights]
    high = {name for row in levelled for name in (row.start, row.end)}
    high |= {name for name, place in book.points.items() if place.height is not None}
    for station, sight in sights:
        if sight.zenith is not None or sight.slope is not None:
            high |= {station, sight.target}
    names = (name for station, sight in sights for name in (station, sight.target) if name not in high)
    return dict.fromkeys(names) if book.spatial() else {}


def _put_table(book: FieldBook, columns: Sequence[str], rows: Sequence[Row], flat: Container[str]) -> None:
    """Put points into two tables, those without heights in one of their own."""
    for fixed in (False, True):
        chosen = [row for row in rows if (row.cells[0] in flat) == fixed]
        if chosen:
            held: dict[str, Any] = {"fixed": ["z"], "values": {"z": "0"}} if fixed else {}
            book.draft.table("points", columns, chosen, **held)


def _parts(occupied: Sequence[InstrumentSetUp], levelled: Sequence[LevelledDifference] = ()) -> list[set[str]]:
    """Points of the parts of a book that sights and height differences connect."""
    parts = [{set_up.station, *(sight.target for sight in set_up.sights)} for set_up in occupied]
    joined: list[set[str]] = []
    for part in parts + [{row.start, row.end} for row in levelled]:
        apart = [other for other in joined if other.isdisjoint(part)]
        joined = [*apart, part.union(*(other for other in joined if not other.isdisjoint(part)))]
    return joined


def _given_together(
    book: FieldBook, occupied: Sequence[InstrumentSetUp], levelled: Sequence[LevelledDifference]
) -> int:
    """Return the most given points in a part of the book that sights connect; an azimuth there is worth one more."""
    oriented = {set_up.station for set_up in occupied if any(s.bearing is not None for s in set_up.sights)}
    joined = _parts(occupied, levelled)
    given = [(len(part & book.points.keys()), not part.isdisjoint(oriented)) for part in joined]
    return max((count + (count and azimuth) for count, azimuth in given), default=0)


_COLUMNS = {
    "zenith_directions": ("station", "set", "to", "horizontal", "zenith", "to_height", "face"),
    "directions": ("station", "set", "to", "horizontal", "face"),
    "zenith_angle": ("from", "to", "zenith_angle", "from_height", "to_height", "face"),
    "distance": ("from", "to", "distance", "from_height", "to_height"),
    "horizontal_distance": ("from", "to", "distance"),
    "bearing": ("from", "to", "bearing"),
}
"""Columns of the observations that sights become, by type."""


def _put_sights(book: FieldBook, occupied: Sequence[InstrumentSetUp]) -> None:
    """Stations, and the readings of each kind with their sets and faces."""
    draft = book.draft
    names = _station_names(occupied)
    stations = [Row([name, s.station, repr(s.height)], s.line) for name, s in zip(names, occupied, strict=True)]
    draft.table("stations", ("id", "point", "height"), stations)
    tables: dict[str, list[Row]] = {type_: [] for type_ in _COLUMNS}
    sets, circle = 0, book.full
    for name, set_up in zip(names, occupied, strict=True):
        numbers = rounds(set_up.sights, circle)
        sets += max(numbers, default=0)
        for sight, number in zip(set_up.sights, numbers, strict=True):
            for type_, values in _readings(set_up, name, sight, number, circle).items():
                cells = [None if v is None else str(v) for v in values]
                tables[type_].append(Row(cells, sight.line))
    # Standard deviations of readings: no field book has any.
    sigma_angle, sigma_distance, ppm = "3 arcsec", "2 mm", "2"
    for type_, rows in tables.items():
        far = "distance" in type_
        sigma = {"sigma": sigma_distance if far else sigma_angle}
        if rows:
            draft.table("observations", _COLUMNS[type_], rows, type=type_, values=sigma, ppm=ppm if far else None)
    words = f"{counted(len(occupied), 'set-up')}, {counted(sets, 'set')} of readings; σ = {sigma_angle} for angles"
    draft.note(f"{words}, {sigma_distance} and {ppm} ppm for distances: no field book says any", occupied[0].line)


def _put_levelling(book: FieldBook, levelled: Sequence[LevelledDifference]) -> None:
    """Height differences with the lengths of their sights, and those of set-ups without distances."""
    for length, sigma in ((True, SIGMA_KILOMETRE), (False, SIGMA_SET_UP)):
        rows = [
            Row([row.start, row.end, repr(row.value), repr(row.length) if length else None], row.line)
            for row in levelled
            if (row.length is not None) == length
        ]
        if rows:
            columns = ("from", "to", "dz", "length")
            book.draft.table("observations", columns, rows, type="height_difference", values={"sigma": sigma})
    words = (
        f"{counted(len(levelled), 'height difference')} in {counted(len(book.levelling.lines), 'levelling line')}; "
        f"σ = {SIGMA_KILOMETRE} for 1 km of levelling, {SIGMA_SET_UP} for a set-up without distances: no field book "
        "says any"
    )
    book.draft.note(words, levelled[0].line)


def _put_curvature(book: FieldBook, occupied: Sequence[InstrumentSetUp]) -> None:
    """Model the curvature of the earth if there are zenith angles: instruments record them as they are read."""
    sights = [sight for set_up in occupied for sight in set_up.sights if sight.zenith is not None]
    if sights:
        book.draft.put("curvature", "true")
        words = (
            "zenith angles of a field book are not corrected for the curvature of the earth: curvature: true; "
            "refraction is left out, instruments: {ts: {refraction: 0.13}} models it"
        )
        book.draft.note(words, sights[0].line)


def _readings(
    set_up: InstrumentSetUp, station: str, sight: Sight, number: int, circle: float
) -> dict[str, tuple[float | str | int | None, ...]]:
    """Rows by type that a sight becomes, in the order of the columns."""
    found: dict[str, tuple[float | str | int | None, ...]] = {}
    at = (station, None if number <= 1 else number, sight.target)
    ends, heights = (set_up.station, sight.target), (set_up.height, sight.height)
    face = face_of(sight, circle)
    if sight.horizontal is not None and sight.zenith is not None:
        found["zenith_directions"] = (*at, sight.horizontal, sight.zenith, sight.height, face)
    elif sight.horizontal is not None:
        found["directions"] = (*at, sight.horizontal, face)
    elif sight.zenith is not None:
        found["zenith_angle"] = (*ends, sight.zenith, *heights, face)
    if sight.slope is not None:
        found["distance"] = (*ends, sight.slope, *heights)
    if sight.horizontal_distance is not None:
        found["horizontal_distance"] = (*ends, sight.horizontal_distance)
    if sight.bearing is not None:
        found["bearing"] = (*ends, sight.bearing)
    return found


def _station_names(set_ups: Sequence[InstrumentSetUp]) -> list[str]:
    """The point; where an instrument stands over it again, or the name is taken, with a number."""
    seen: dict[str, int] = {}
    names = []
    for set_up in set_ups:
        seen[set_up.station] = seen.get(set_up.station, 0) + 1
        number = seen[set_up.station]
        names.append(set_up.station if number == 1 else f"{set_up.station} set-up {number}")
    return names


def face_of(sight: Sight, circle: float) -> int:
    """Face of a sight: as said, or by its zenith angle."""
    if sight.face:
        return sight.face
    return 2 if sight.zenith is not None and sight.zenith % circle > circle / 2.0 else 1


def rounds(sights: Sequence[Sight], circle: float) -> list[int]:
    """Number of the set, from 1, of each sight: a new one begins when a target is sighted again in the same face.

    A last sight back to the first target, which closes a set, belongs to it. The sights before a station record are
    sets of their own.
    """
    numbers: list[int] = []
    seen: set[tuple[str, int]] = set()
    number = 1
    for k, sight in enumerate(sights):
        key = sight.target, face_of(sight, circle)
        if k and sight.before != sights[k - 1].before:
            number, seen = number + 1, set()
        if key in seen:
            rest = {(s.target, face_of(s, circle)) for s in sights[k:]}
            if len({target for target, _ in rest}) > 1:
                number, seen = number + 1, set()
        seen.add(key)
        numbers.append(number)
    return numbers


def _first_names(names: Sequence[str]) -> str:
    """The first five names, for a note."""
    return ", ".join(names[:5]) + (", …" if len(names) > 5 else "")


def _spans(lines: Sequence[int]) -> str:
    """Line numbers with runs written together, the first twelve of these: 3, 5–9."""
    spans: list[list[int]] = []
    for line in sorted(set(lines)):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    said = [str(a) if a == b else f"{a}–{b}" for a, b in spans[:12]]
    return ", ".join(said) + (f" and more up to {lines[-1]}" if len(spans) > 12 else "")


def sexagesimal(text: str) -> float:
    """Degrees of ddd.mmss…, as instruments write degrees, minutes and seconds. Raises ``ValueError``.

    Seconds may be 60: instruments round them.
    """
    bare = text.strip()
    sign = -1.0 if bare.startswith("-") else 1.0
    whole, _, fraction = bare.lstrip("+-").partition(".")
    if not (whole + fraction).isdecimal() or not (whole + fraction).isascii() or len(bare) > 20:
        raise ValueError(f"found {text!r}, expected degrees, minutes and seconds as ddd.mmss")
    fraction = fraction.ljust(4, "0")
    minutes, seconds = int(fraction[:2]), float(f"{fraction[2:4]}.{fraction[4:] or '0'}")
    if minutes >= 60 or seconds > 60.0:
        raise ValueError(f"found {text!r}, expected less than 60 minutes and seconds in ddd.mmss")
    return sign * (int(whole or "0") + minutes / 60.0 + seconds / 3600.0)


def may_be_sexagesimal(angles: Iterable[str]) -> bool:
    """Return whether all angles may be ddd.mmss; otherwise they are gon."""
    try:
        return max(map(sexagesimal, angles), default=0.0) <= 360.0
    except ValueError:
        return False
