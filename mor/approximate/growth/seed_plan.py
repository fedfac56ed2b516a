"""Begin a levelled part with three stations that do not see each other, by the directions to points all three see."""

from __future__ import annotations

from functools import reduce
from itertools import combinations

import numpy as np

from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import Rule, rule
from mor.approximate.terrestrial.free_station import StationOutcome, free_station_level
from mor.approximate.terrestrial.plan_bundles import PlanShape, three_bundles
from mor.approximate.terrestrial.sights import Sight, Terrestrial
from mor.arrays import FloatArray, IntArray

FEWEST = 6
"""Points that three bundles in the plane have to share: five leave nothing over that could tell shapes apart."""
SAMPLE = 30
"""Points and stations at the most that the shape is worked out from."""
CLEARLY = 3.0
"""How many times as far the rays of another shape have to pass by for it to be out of the question."""
SIGMA = 1e-5
"""Radians; a measure for free stations, which cancels when two shapes are compared."""


def seed_plan(
    measured: Terrestrial, unknown: set[int], points: int, tried: set[int]
) -> tuple[Part | None, Rule | None]:
    """A part of the three sets that share most points, or why there is none; ``tried`` remembers sets."""
    sets = _largest_sets(measured, unknown, tried)
    chosen = _best_three(measured, sets)
    if chosen is None:
        return None, None
    tried.update(chosen)
    sights = [measured.sights[number] for number in chosen]
    common = _common(sights)
    shapes = three_bundles(np.array([_directions(sight, common) for sight in sights]))
    others = [measured.sights[number] for number in sets if number not in chosen]
    ranked = sorted((_misfit(shape, common, others), k) for k, shape in enumerate(shapes))
    names = {"one": sights[0].name, "two": sights[1].name, "three": sights[2].name}
    if not ranked or not np.isfinite(ranked[0][0]):
        return None, rule(
            "directions of {one}, {two} and {three}: no shape in plan has all points in front", **names
        )
    if len(ranked) > 1 and ranked[1][0] < CLEARLY * ranked[0][0]:
        return None, rule("directions of {one}, {two} and {three}: two shapes in plan fit alike", **names)
    return _part(chosen, sights, common, shapes[ranked[0][1]], points), None


def _largest_sets(measured: Terrestrial, unknown: set[int], tried: set[int]) -> list[int]:
    """The set of every unknown station that sees most, those with most points first."""
    largest: dict[int, tuple[int, int]] = {}
    for number, sight in enumerate(measured.sights):
        if sight.oriented or sight.position not in unknown or number in tried:
            continue
        count = int(np.isfinite(sight.directions).sum())
        if count >= 3 and (count, -number) > largest.get(sight.position, (0, 0)):
            largest[sight.position] = (count, -number)
    return [-number for _, number in sorted(largest.values(), reverse=True)][:SAMPLE]


def _best_three(measured: Terrestrial, sets: list[int]) -> tuple[int, ...] | None:
    """The three sets with most points in common, ``None`` where none share enough."""
    seen = {number: set(_seen(measured.sights[number]).tolist()) for number in sets}
    best = max(
        combinations(sets, 3), key=lambda three: len(set.intersection(*(seen[n] for n in three))), default=()
    )
    return best if best and len(set.intersection(*(seen[n] for n in best))) >= FEWEST else None


def _seen(sight: Sight) -> IntArray:
    return sight.points[np.isfinite(sight.directions)]


def _common(sights: list[Sight]) -> IntArray:
    """Points that all of them see, ``SAMPLE`` at the most."""
    common = reduce(np.intersect1d, [_seen(sight) for sight in sights])
    return np.asarray(common[np.linspace(0, len(common) - 1, min(len(common), SAMPLE)).astype(int)])


def _directions(sight: Sight, points: IntArray) -> FloatArray:
    """Directions of a set to points that it sees, the first one where it sees them several times."""
    seen = np.flatnonzero(np.isfinite(sight.directions))
    first = {int(sight.points[row]): row for row in seen[::-1].tolist()}
    return sight.directions[[first[p] for p in points.tolist()]]


def _misfit(shape: PlanShape, points: IntArray, others: list[Sight]) -> float:
    """Radians by which rays pass by, of the worst of the three stations and of others that see the points, too."""
    worst = shape.misfit
    for sight in others:
        there = np.isin(points, _seen(sight))
        if np.count_nonzero(there) < 4:
            continue
        directions = _directions(sight, points[there])
        station = free_station_level(
            shape.points[there], directions, np.full(len(directions), np.nan), SIGMA, 1.0
        )
        if station.outcome is StationOutcome.DOES_NOT_FIT:
            return float("inf")
        if station.outcome.usable:
            worst = max(worst, SIGMA * station.sigma0)
    return worst


def _part(
    chosen: tuple[int, ...], sights: list[Sight], common: IntArray, shape: PlanShape, points: int
) -> Part:
    part = empty_part(points)
    part.levelled = True
    names = {"one": sights[0].name, "two": sights[1].name, "three": sights[2].name}
    part.began = rule("directions of {one}, {two} and {three} to {count} points", **names, count=len(common))
    for number, sight, place, kappa in zip(chosen, sights, shape.stations, shape.kappas, strict=True):
        part.points[sight.position, :2] = place
        part.kappas[number] = float(kappa)
        part.how[f"point {sight.position}"] = part.began
    part.points[common, :2] = shape.points
    part.how |= {f"point {p}": part.began for p in common.tolist()}
    return part
