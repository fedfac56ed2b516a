"""Points in the plane from two or more bearings (forward section) or distances (arc section)."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant


class SectionOutcome(Enum):
    """What became of a section in the plane, in words."""

    DETERMINED = "determined"
    AMBIGUOUS = "two points fit: on either side of the line of the stations"
    TOO_FEW = "fewer than two bearings or distances"
    INVALID = "a value is no number or a distance not positive"
    SAME_PLACE = "the stations coincide"
    PARALLEL = "the bearings are parallel, or all but: they meet at no determined distance"
    BEHIND = "the bearings meet behind a station: a bearing is reversed or wrong"
    TOUCHING = (
        "the arcs touch, or all but: the point lies on the line of the stations and is badly determined"
    )
    APART = "the arcs do not meet: a distance is wrong, or the scale"


class Section(NamedTuple):
    """Points that fit, the best first."""

    outcome: SectionOutcome
    points: FloatArray
    """(k, 2), k = 0, 1 or 2."""
    sigma0: float
    """√ of the mean square misclosure: angular (radians) of bearings, length of distances; NaN without redundancy."""

    @property
    def point(self) -> FloatArray:
        """(2,) the first point; not a number where there is none."""
        return self.points[0] if len(self.points) else np.full(2, np.nan)


SMALLEST_ANGLE = 1e-4
"""Angle in radians below which bearings are parallel and arcs touch."""
REFINEMENTS = 20


def bearing_section(stations: FloatArray, bearings: FloatArray) -> Section:
    """Point from n ≥ 2 bearings (n,) at ``stations`` (n, 2); more than two by least squares of the angles."""
    stations, t = np.asarray(stations, dtype=float), np.asarray(bearings, dtype=float)
    if len(t) < 2:
        return _none(SectionOutcome.TOO_FEW)
    if not np.all(np.isfinite(stations)) or not np.all(np.isfinite(t)):
        return _none(SectionOutcome.INVALID)
    if not np.any(np.ptp(stations, axis=0) > 0.0):
        return _none(SectionOutcome.SAME_PLACE)
    if float(np.max(np.abs(np.sin(t[:, None] - t[None, :])))) < SMALLEST_ANGLE:
        return _none(SectionOutcome.PARALLEL)
    along = np.stack([np.sin(t), np.cos(t)], axis=1)
    across = np.stack([np.cos(t), -np.sin(t)], axis=1)
    centre = stations.mean(axis=0)
    offset = np.einsum("ni,ni->n", across, stations - centre)
    point = centre + tolerant.lstsq(across, offset, rcond=None)
    for _ in range(REFINEMENTS if len(t) > 2 else 0):
        ranges = np.maximum(np.linalg.norm(point - stations, axis=1), 1e-12)
        step = tolerant.lstsq(
            across / ranges[:, None], -np.einsum("ni,ni->n", across, point - stations) / ranges, rcond=None
        )
        point = point + step
        if float(np.max(np.abs(step))) < 1e-14 * float(np.max(ranges)):
            break
    if np.any(np.einsum("ni,ni->n", along, point - stations) < 0.0):
        return Section(SectionOutcome.BEHIND, point[None], float("nan"))
    difference = misclosures_of_bearings(stations, t, point)
    sigma0 = float(np.sqrt(difference @ difference / (len(t) - 2))) if len(t) > 2 else float("nan")
    return Section(SectionOutcome.DETERMINED, point[None], sigma0)


def arc_section(stations: FloatArray, distances: FloatArray) -> Section:
    """Points from n ≥ 2 horizontal distances (n,) at ``stations`` (n, 2).

    Two distances leave two points, the one to the left of the line from the first to the second station
    first. More decide by least squares, unless the stations lie in one line.
    """
    stations, d = np.asarray(stations, dtype=float), np.asarray(distances, dtype=float)
    if len(d) < 2:
        return _none(SectionOutcome.TOO_FEW)
    if not np.all(np.isfinite(stations)) or not np.all(d > 0.0) or not np.all(np.isfinite(d)):
        return _none(SectionOutcome.INVALID)
    separations = np.linalg.norm(stations[:, None] - stations[None, :], axis=2)
    if not np.max(separations) > 0.0:
        return _none(SectionOutcome.SAME_PLACE)
    first, second = _best_pair(separations, d)
    if first == second:
        return _none(SectionOutcome.APART)
    section = _two_arcs(stations[first], d[first], stations[second], d[second])
    return section if len(d) == 2 else _many_arcs(stations, d, section)


def _best_pair(separations: FloatArray, d: FloatArray) -> tuple[int, int]:
    """Stations whose arcs cut at the best angle: |sin| of the angle at the point largest."""
    cosine = (d[:, None] ** 2 + d[None, :] ** 2 - separations**2) / (2.0 * np.outer(d, d))
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    sine[separations == 0.0] = -1.0
    best = np.triu(sine + 1.0, 1)
    if len(d) > 2 and np.max(np.triu(sine, 1)) <= 0.0:
        return 0, 0
    i, j = np.unravel_index(int(np.argmax(best)), best.shape)
    return int(i), int(j)


def _two_arcs(first: FloatArray, d1: float, second: FloatArray, d2: float) -> Section:
    base = second - first
    length = float(np.linalg.norm(base))
    along = (length**2 + d1**2 - d2**2) / (2.0 * length)
    square = d1**2 - along**2
    direction = base / length
    left = np.array([-direction[1], direction[0]])
    foot = first + along * direction
    if abs(square) < (SMALLEST_ANGLE * d1) ** 2:
        return Section(SectionOutcome.TOUCHING, foot[None], float("nan"))
    if square < 0.0:
        return _none(SectionOutcome.APART)
    height = float(np.sqrt(square))
    return Section(
        SectionOutcome.AMBIGUOUS, np.stack([foot + height * left, foot - height * left]), float("nan")
    )


def _many_arcs(stations: FloatArray, d: FloatArray, section: Section) -> Section:
    if not len(section.points):
        return section
    refined = [_refined_arc(stations, d, point) for point in section.points]
    misfits = np.array([float(np.sum(misclosures_of_arcs(stations, d, point) ** 2)) for point in refined])
    order = np.argsort(misfits, kind="stable")
    sigma0 = float(np.sqrt(misfits[order[0]] / (len(d) - 2)))
    values = tolerant.singular_values(stations - stations.mean(axis=0))
    in_line = values[1] < 1e-6 * values[0]
    points = np.stack([refined[index] for index in order])
    if section.outcome is SectionOutcome.AMBIGUOUS and not in_line:
        return Section(SectionOutcome.DETERMINED, points[:1], sigma0)
    return Section(section.outcome, points, sigma0)


def misclosures_of_arcs(stations: FloatArray, d: FloatArray, point: FloatArray) -> FloatArray:
    """(n,) computed less measured horizontal distances."""
    return np.asarray(np.linalg.norm(point - stations, axis=1) - d)


def misclosures_of_bearings(stations: FloatArray, bearings: FloatArray, point: FloatArray) -> FloatArray:
    """(n,) computed less measured bearings."""
    return np.asarray(np.angle(np.exp(1j * (np.arctan2(*(point - stations).T) - bearings))))


def _refined_arc(stations: FloatArray, d: FloatArray, point: FloatArray) -> FloatArray:
    for _ in range(REFINEMENTS):
        offset = point - stations
        ranges = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
        step = -tolerant.lstsq(offset / ranges[:, None], ranges - d, rcond=1e-9)
        point = point + step
        if float(np.max(np.abs(step))) < 1e-14 * float(np.max(ranges)):
            break
    return point


def _none(outcome: SectionOutcome) -> Section:
    return Section(outcome, np.zeros((0, 2)), float("nan"))
