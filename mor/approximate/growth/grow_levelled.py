"""Grow a levelled part: orientations, polar points, sections of bearings and arcs, free stations, heights."""

from __future__ import annotations

import numpy as np

from mor.approximate.choices import Choices
from mor.approximate.parts.distances import Distances
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import Rule, rule
from mor.approximate.terrestrial.agreement import Fit, agreeing
from mor.approximate.terrestrial.bearings_and_arcs import (
    Section,
    SectionOutcome,
    arc_section,
    bearing_section,
    misclosures_of_arcs,
    misclosures_of_bearings,
)
from mor.approximate.terrestrial.free_station import FreeStation, StationOutcome, free_station_level
from mor.approximate.terrestrial.polar import orient
from mor.approximate.terrestrial.sights import Sight, Terrestrial
from mor.arrays import BoolArray, FloatArray, IntArray

SIGMA_DIRECTION = 1e-3
"""Radians a direction may be off for the purpose of start values."""
SECTION_FITS = 1e-2
"""Radians, or part of its length, that a bearing or an arc may be off, as heights and scale are not yet known well."""
CONTRADICTS = 0.45
"""Radians that half of the directions of a set must not be off the others by."""
RISES = 0.1, -0.1, 0.5, -0.5
"""Rises of sights in parts of their lengths, where nothing tells them: one for all, whichever leads to the best."""
SMALLEST_SECTION = 0.05
"""Radians at which two bearings must meet."""


def grow_levelled(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    """Add what follows from what is known; true where anything was added."""
    grown = False
    while True:
        added = _orient(part, measured)
        added |= _vectors(part, measured) if part.oriented and part.scaled else False
        added |= _polar(part, measured, distances)
        added |= _polar_backwards(part, measured, distances)
        added |= _sections(part, measured)
        added |= _free_stations(part, measured, distances)
        added |= _heights(part, measured, distances)
        # Arcs last: they ask for many distances at every point that is not known yet.
        if not added and not grow_arcs(part, distances):
            return grown
        grown = True


def _level_known(part: Part, block: int) -> bool:
    return bool(np.isfinite(part.points[block, :2]).all())


def _place(part: Part, block: int, xy: FloatArray, how: Rule) -> None:
    part.points[block, :2] = np.where(np.isfinite(part.points[block, :2]), part.points[block, :2], xy)
    part.how[f"point {block}"] = how


def _orient(part: Part, measured: Terrestrial) -> bool:
    added = False
    for number, sight in enumerate(measured.sights):
        if number in part.kappas or not _level_known(part, sight.position):
            continue
        if sight.oriented:
            if part.oriented:
                part.kappas[number] = 0.0
                added = True
            continue
        usable = np.isfinite(part.points[sight.points, :2]).all(axis=1) & np.isfinite(sight.directions)
        if not usable.any():
            continue
        here = part.points[sight.position, :2]
        result = orient(here, part.points[sight.points[usable], :2], sight.directions[usable])
        if np.median(np.abs(result.residuals)) < CONTRADICTS:
            part.kappas[number] = result.kappa
            added = True
    return added


def _unknown_sights(part: Part, sight: Sight) -> list[tuple[int, float]]:
    """Sighted points that are not known in plan, and the directions to them."""
    unknown = np.isnan(part.points[sight.points, :2]).any(axis=1) & np.isfinite(sight.directions)
    return list(zip(sight.points[unknown].tolist(), sight.directions[unknown].tolist(), strict=True))


def _polar(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    added = False
    for number, kappa in list(part.kappas.items()):
        sight = measured.sights[number]
        for point, direction in _unknown_sights(part, sight) if _level_known(part, sight.position) else ():
            length = distances.between(part, sight.position, int(point))
            if np.isfinite(length):
                t = direction - kappa
                xy = part.points[sight.position, :2] + length * np.array([np.sin(t), np.cos(t)])
                _place(part, int(point), xy, rule("polar from {one}", one=sight.name))
                added = True
    return added


def place_as_if_level(part: Part, measured: Terrestrial, distances: Distances, choices: Choices) -> bool:
    """Points of which a direction and a slope distance tell all but the height: nearly as high as what sights them.

    Nothing tells how steep the sight is; but the adjustment comes from there, and nothing else is known of them. It
    would not from a level sight, whose length says nothing of heights.
    """
    if not (part.levelled and part.scaled):
        return False
    found = [
        (sight, point, direction - kappa, *distances.slope[sight.position, point])
        for number, kappa in part.kappas.items()
        if _level_known(part, (sight := measured.sights[number]).position)
        for point, direction in _unknown_sights(part, sight)
        if (sight.position, point) in distances.slope
    ]
    slope = RISES[choices.take(len(RISES))] if found else 0.0
    for sight, point, t, length, rise in found:
        here = part.points[sight.position]
        if np.isnan(part.points[point, 2]):
            part.points[point, 2] = here[2] + rise + slope * length
        xy = here[:2] + length * np.array([np.sin(t), np.cos(t)])
        _place(part, point, xy, rule("polar from {one}, as if at its height", one=sight.name))
    return bool(found)


def _polar_backwards(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    """Where a bearing and a distance to a known point were observed."""
    added = False
    for sight in measured.sights if part.oriented else ():
        if not sight.oriented or _level_known(part, sight.position):
            continue
        point, t = int(sight.points[0]), float(sight.directions[0])
        length = distances.between(part, sight.position, point) if _level_known(part, point) else np.nan
        if np.isfinite(length):
            xy = part.points[point, :2] - length * np.array([np.sin(t), np.cos(t)])
            _place(part, sight.position, xy, rule("polar from {one}", one=sight.name))
            added = True
    return added


def _sections(part: Part, measured: Terrestrial) -> bool:
    """Unknown points from bearings of oriented sets."""
    bearings: dict[int, list[tuple[FloatArray, float]]] = {}
    for number, kappa in part.kappas.items():
        sight = measured.sights[number]
        for point, direction in _unknown_sights(part, sight) if _level_known(part, sight.position) else ():
            bearings.setdefault(point, []).append((part.points[sight.position, :2], direction - kappa))
    added = False
    for point, found in bearings.items():
        if len(found) < 2 or not _meet_well([t for _, t in found]):
            continue
        section, count = _bearings_that_agree(
            np.array([xy for xy, _ in found]), np.array([t for _, t in found])
        )
        if section.outcome is SectionOutcome.DETERMINED:
            _place(part, point, section.points[0], rule("intersection of {count} bearings", count=count))
            added = True
    return added


def grow_arcs(part: Part, distances: Distances) -> bool:
    """Unknown points from three or more distances."""
    added = False
    known: BoolArray = np.asarray(np.isfinite(part.points[:, :2]).all(axis=1))
    for point, neighbours in distances.neighbours.items():
        if known[point] or np.count_nonzero(known[list(neighbours)]) < 3:
            continue
        centres, lengths = known_arcs(part, distances, point, neighbours)
        if len(lengths) < 3:
            continue
        section, count = _arcs_that_agree(np.array(centres), np.array(lengths))
        if section.outcome is SectionOutcome.DETERMINED:
            _place(part, point, section.points[0], rule("section of {count} arcs", count=count))
            known[point] = added = True
    return added


def _bearings_that_agree(stations: FloatArray, bearings: FloatArray) -> tuple[Section, int]:
    """The section of those bearings that agree, and how many these are."""

    def fit(rows: IntArray) -> Fit:
        section = bearing_section(stations[rows], bearings[rows])
        if section.outcome is not SectionOutcome.DETERMINED:
            return Fit(np.inf, np.zeros(0))
        return Fit(
            section.sigma0, np.abs(misclosures_of_bearings(stations[rows], bearings[rows], section.point))
        )

    rows = agreeing(len(bearings), fit, SECTION_FITS, least=3)
    return bearing_section(stations[rows], bearings[rows]), len(rows)


def _arcs_that_agree(stations: FloatArray, lengths: FloatArray) -> tuple[Section, int]:
    """The section of those arcs that agree, and how many these are."""

    def fit(rows: IntArray) -> Fit:
        section = arc_section(stations[rows], lengths[rows])
        if section.outcome is not SectionOutcome.DETERMINED:
            return Fit(np.inf, np.zeros(0))
        return Fit(section.sigma0, np.abs(misclosures_of_arcs(stations[rows], lengths[rows], section.point)))

    rows = agreeing(len(lengths), fit, SECTION_FITS * float(np.median(lengths)), least=3)
    return arc_section(stations[rows], lengths[rows]), len(rows)


def known_arcs(
    part: Part, distances: Distances, point: int, neighbours: set[int]
) -> tuple[list[FloatArray], list[float]]:
    """Known positions around a point, and the horizontal distances from them."""
    centres, lengths = [], []
    for other in sorted(neighbours):
        length = distances.between(part, other, point) if _level_known(part, other) else np.nan
        if np.isfinite(length):
            centres.append(part.points[other, :2])
            lengths.append(length)
    return centres, lengths


def _meet_well(bearings: list[float]) -> bool:
    differences = np.subtract.outer(bearings, bearings)
    return bool(np.abs(np.sin(differences)).max() > SMALLEST_SECTION)


def _free_stations(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    added = False
    for number, sight in enumerate(measured.sights):
        if number in part.kappas or _level_known(part, sight.position) or sight.oriented:
            continue
        station = _free_station(part, sight, distances)
        if station is not None:
            _place(part, sight.position, station[0], rule("free stationing of {one}", one=sight.name))
            part.kappas[number] = station[1]
            added = True
    return added


def _free_station(part: Part, sight: Sight, distances: Distances) -> tuple[FloatArray, float] | None:
    known = np.isfinite(part.points[sight.points, :2]).all(axis=1)
    points = sight.points[known]
    if len(points) < 2:
        return None
    lengths = np.array([distances.between(part, sight.position, int(point)) for point in points])
    size = np.ptp(part.points[points, :2], axis=0).max()
    result = _station_that_agrees(part.points[points, :2], sight.directions[known], lengths, 1e-3 * size)
    if result.outcome is StationOutcome.DETERMINED and np.isfinite(result.kappa):
        return result.position, result.kappa
    return None


def _station_that_agrees(
    points: FloatArray, directions: FloatArray, lengths: FloatArray, sigma: float
) -> FreeStation:
    """The free station by those sights that agree; ``sigma`` of the lengths."""

    def station(rows: IntArray) -> FreeStation:
        return free_station_level(points[rows], directions[rows], lengths[rows], SIGMA_DIRECTION, sigma)

    def fit(rows: IntArray) -> Fit:
        found = station(rows)
        scaled = np.nan_to_num(np.abs(found.residuals) / [SIGMA_DIRECTION, sigma])
        return Fit(float(np.nan_to_num(found.sigma0, nan=np.inf)), scaled.max(axis=1, initial=0.0))

    least = 5 if np.isnan(lengths).all() else 4
    if len(points) < least:
        return station(np.arange(len(points)))
    return station(agreeing(len(points), fit, SECTION_FITS / SIGMA_DIRECTION, least - 1))


def _vectors(part: Part, measured: Terrestrial) -> bool:
    """Points at the other end of vectors from known ones, the nearest to what is known first."""
    v = measured.vectors
    if v.value.shape[1] != 3:
        return False
    added = False
    full = v.value.copy()
    full[:, 2] += v.start_height - v.end_height
    start, end = np.concatenate([v.start, v.end]), np.concatenate([v.end, v.start])
    full = np.concatenate([full, -full])
    while True:
        fresh = np.isnan(part.points[end]) & np.isfinite(part.points[start] + full)
        rows = np.flatnonzero(fresh.any(axis=1))
        if len(rows) == 0:
            return added
        rows = rows[np.sort(np.unique(end[rows], return_index=True)[1])]
        candidates = part.points[start[rows]] + full[rows]
        part.points[end[rows]] = np.where(fresh[rows], candidates, part.points[end[rows]])
        part.how |= {f"point {point}": rule("vector") for point in end[rows].tolist()}
        added = True


def begin_heights(part: Part, measured: Terrestrial) -> bool:
    """A levelling network of which no height is known begins with the height 0 of its first point."""
    h = measured.height_differences
    ends = np.unique(np.concatenate([h.start, h.end]))
    if len(ends) == 0 or not np.isnan(part.points[:, 2]).all():
        return False
    part.points[h.start[0], 2] = 0.0
    part.how[f"point {h.start[0]}"] = rule("height 0: no height is given")
    return True


def stand_level_with_sights(part: Part, measured: Terrestrial) -> bool:
    """Stations of known plan begin as high as the middle of what they sight, where nothing else says how high.

    Horizontal directions alone tell it where the vertical is looked for, too, and then only beside everything else.
    """
    added = False
    for sight in measured.sights:
        heights = part.points[sight.points, 2]
        told = np.isfinite(heights) & np.isfinite(sight.directions)
        here = part.points[sight.position]
        if np.isfinite(here[:2]).all() and np.isnan(here[2]) and told.any():
            here[2] = np.median(heights[told]) - sight.height * part.scaled
            part.how[f"point {sight.position}"] = rule("as high as what is sighted from it")
            added = True
    return added


def _heights(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    """Heights from height differences, and from vertical directions over known horizontal distances."""
    h = measured.height_differences
    added = False
    if part.scaled:
        added |= _carry_heights(part, h.start, h.end, h.value[:, 0] + h.start_height - h.end_height)
    a, b = distances.ends.T
    plan = np.linalg.norm(part.points[b, :2] - part.points[a, :2], axis=1)
    added |= _carry_heights(part, a, b, plan * distances.tangents + distances.rises)
    if distances.slope:
        added |= _heights_by_slopes(part, distances)
    return added


def _heights_by_slopes(part: Part, distances: Distances) -> bool:
    """Height differences from slope distances and vertical directions, where the plan is not known."""
    a, b = distances.ends.T
    open_ = np.flatnonzero(np.isfinite(part.points[a, 2]) != np.isfinite(part.points[b, 2]))
    rows = [k for k in open_.tolist() if (int(a[k]), int(b[k])) in distances.slope]
    lengths = np.array([distances.slope[int(a[k]), int(b[k])][0] for k in rows])
    sines = np.sin(np.arctan(distances.tangents[rows]))
    return _carry_heights(part, a[rows], b[rows], lengths * sines + distances.rises[rows])


def _carry_heights(part: Part, start: IntArray, end: IntArray, dz: FloatArray) -> bool:
    """Heights over known differences, one step forwards and backwards; true where any was carried.

    Of several that a point gets the middle one is taken, for one of them may be of a wrong sight.
    """
    z = part.points[:, 2]
    to, found = np.concatenate([end, start]), np.concatenate([z[start] + dz, z[end] - dz])
    fresh = np.isnan(z[to]) & np.isfinite(found)
    order = np.lexsort((found[fresh], to[fresh]))
    points, first, counts = np.unique(to[fresh][order], return_index=True, return_counts=True)
    z[points] = found[fresh][order][first + (counts - 1) // 2]
    for point in points.tolist():
        part.how.setdefault(f"point {point}", rule("height transfer"))
    return bool(len(points))
