"""Grow a network of levelled stations: polar points, trilateration, single points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.start.bundle import sphere
from mor.start.free_station import (
    FitQuality,
    FreeStation,
    PointDistances,
    StationOutcome,
    agreeing,
    core_of,
    free_station_level,
    shape_of_distances,
)
from mor.start.movement import FreeRotation, Ties, movement
from mor.start.part import Distances, Part, Phrase, empty_part, rule
from mor.start.scene import LocalSystem, Scene
from mor.start.sights import Choices, DirectionSet, Terrestrial, orient
from mor.types import BoolArray, FloatArray, IntArray

# ---- Grow a levelled part: orientations, polar points, sections of bearings and arcs, free stations, heights.

SIGMA_DIRECTION = 1e-3
"""Radians a direction may be off for the purpose of start values."""


def grow_levelled(part: Part, measured: Terrestrial, distances: Distances) -> bool:
    """Add what follows from what is known; true where anything was added."""
    grown = False
    while True:
        added = _orient(part, measured)
        added |= _vectors(part, measured) if part.oriented and part.scaled else False
        added |= _polar(part, measured, distances)
        added |= _sections(part, measured)
        added |= _free_stations(part, measured, distances)
        added |= _heights(part, measured, distances)
        # Arcs last: they ask for many distances at every point that is not known yet.
        if not added and not grow_arcs(part, distances):
            return grown
        grown = True


def _level_known(part: Part, block: int) -> bool:
    return bool(np.isfinite(part.points[block, :2]).all())


def _place(part: Part, block: int, xy: FloatArray, how: Phrase) -> None:
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
        # Radians that half of the directions of a set must not be off the others by.
        if np.median(np.abs(result.residuals)) < 0.45:
            part.kappas[number] = result.kappa
            added = True
    return added


def _unknown_sights(part: Part, sight: DirectionSet) -> list[tuple[int, float]]:
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
    # In parts of the lengths, one for all sights, whichever leads to the best.
    slope = (0.1, -0.1, 0.5, -0.5)[choices.take(4)] if found else 0.0
    for sight, point, t, length, rise in found:
        here = part.points[sight.position]
        if np.isnan(part.points[point, 2]):
            part.points[point, 2] = here[2] + rise + slope * length
        xy = here[:2] + length * np.array([np.sin(t), np.cos(t)])
        _place(part, point, xy, rule("polar from {one}, as if at its height", one=sight.name))
    return bool(found)


def _sections(part: Part, measured: Terrestrial) -> bool:
    """Unknown points from bearings of oriented sets."""
    bearings: dict[int, list[tuple[FloatArray, float]]] = {}
    for number, kappa in part.kappas.items():
        sight = measured.sights[number]
        for point, direction in _unknown_sights(part, sight) if _level_known(part, sight.position) else ():
            bearings.setdefault(point, []).append((part.points[sight.position, :2], direction - kappa))
    added = False
    for point, found in bearings.items():
        if len(found) < 2:
            continue
        stations, t = np.array([xy for xy, _ in found]), np.array([t for _, t in found])
        section = station_that_agrees(stations, t + np.pi, np.full(len(t), np.nan), 1.0, oriented=True)
        if section.outcome is StationOutcome.DETERMINED:
            count = len(section.residuals)
            _place(part, point, section.position, rule("intersection of {count} bearings", count=count))
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
        sigma = SIGMA_DIRECTION * float(np.median(lengths))
        section = station_that_agrees(np.array(centres), np.full(len(lengths), np.nan), np.array(lengths), sigma)
        if section.outcome is StationOutcome.DETERMINED:
            count = len(section.residuals)
            _place(part, point, section.position, rule("section of {count} arcs", count=count))
            known[point] = added = True
    return added


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


def _free_station(part: Part, sight: DirectionSet, distances: Distances) -> tuple[FloatArray, float] | None:
    known = np.isfinite(part.points[sight.points, :2]).all(axis=1)
    points = sight.points[known]
    if len(points) < 2:
        return None
    lengths = np.array([distances.between(part, sight.position, int(point)) for point in points])
    size = np.ptp(part.points[points, :2], axis=0).max()
    result = station_that_agrees(part.points[points, :2], sight.directions[known], lengths, 1e-3 * size)
    if result.outcome is StationOutcome.DETERMINED and np.isfinite(result.kappa):
        return result.position, result.kappa
    return None


def station_that_agrees(
    points: FloatArray, directions: FloatArray, lengths: FloatArray, sigma: float, oriented: bool = False
) -> FreeStation:
    """Return the free station by those of the directions and lengths (n,) that agree; ``sigma`` that of lengths."""

    def station(rows: IntArray) -> FreeStation:
        return free_station_level(points[rows], directions[rows], lengths[rows], SIGMA_DIRECTION, sigma, oriented)

    def fit(rows: IntArray) -> FitQuality:
        found = station(rows)
        scaled = np.nan_to_num(np.abs(found.residuals) / [SIGMA_DIRECTION, sigma])
        return FitQuality(float(np.nan_to_num(found.sigma0, nan=np.inf)), scaled.max(axis=1, initial=0.0))

    least = 5 if np.isnan(lengths).all() and not oriented else 4
    if len(points) < least:
        return station(np.arange(len(points)))
    # A bearing or an arc may be off by 0.01 (radians, or part of its length): heights and scale are not yet known well.
    return station(agreeing(len(points), fit, 1e-2 / SIGMA_DIRECTION, least - 1))


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
    """Stations of known plan begin as high as the middle of what they sight, where nothing else says how high."""
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


# ---- One point at a time by whatever it is measured with: rays, bearings, distances, vertical directions,
# coordinates of a system, from wherever things are known.
#
# Each is a surface through the point. They are adjusted together (Gauss-Newton, damped) from starts over all
# directions and distances; a point is taken where one place fits, and, where nothing else is left, where
# several do.


class Surfaces(NamedTuple):
    """Surfaces through a point; residuals are angles, or relative to a distance or to the size."""

    planes: FloatArray
    """(n, 7) normal, place, and the length residuals count in; 0 where that is the distance from the place."""
    spheres: FloatArray
    """(m, 4) centre and radius."""
    cones: FloatArray
    """(k, 4) apex and vertical direction."""
    sights: FloatArray = np.zeros((0, 6))
    """(s, 6) places from which it was sighted, and unit vectors in which it lies from there."""

    @property
    def equations(self) -> int:
        """Number of equations."""
        return len(self.planes) + len(self.spheres) + len(self.cones)


def grow_single_points(part: Part, scene: Scene, ambiguous: bool = False, contradicting: bool = False) -> bool:
    """Add points that several kinds of observations tell together; true where anything was added.

    ``ambiguous``: also one that has several places that fit alike, the nearest to what is known of them.
    ``contradicting``: also where surfaces pass by each other, nearest to all of them.
    """
    here: BoolArray = np.isfinite(part.points)
    asked: BoolArray = np.asarray(here.any(axis=1))
    asked[scene.with_surfaces] = True
    missing = [p for p in np.flatnonzero(asked & ~here.all(axis=1)).tolist() if p not in part.placed]
    known = part.points[np.isfinite(part.points).all(axis=1)]
    if not missing or len(known) < 2:
        return False
    size, middle = float(np.linalg.norm(np.ptp(known, axis=0))), known.mean(axis=0)
    if not size:
        return False
    # Residual (radians, or parts of a distance) up to which a surface passes through a point.
    # The same where nothing else is left: what is known may be rough itself.
    fits = np.inf if contradicting else 0.1 if ambiguous else 0.01
    systems = [_pose_of_system(part, one, fits) for one in scene.partial_systems]
    added = False
    for point in missing:
        surfaces = _surfaces(part, scene, systems, point, size)
        if surfaces.equations + np.isfinite(part.points[point]).sum() < 3:
            continue
        places = meeting_places(surfaces, part.points[point], middle, size, fits)
        if len(places) == 1 or (ambiguous and places):
            part.points[point] = places[scene.choices.take(len(places))]
            part.placed.add(point)
            words = "meeting of {count} surfaces"
            if len(places) > 1:
                words = "meeting of {count} surfaces: one of {of} positions that fit equally well"
            part.how[f"point {point}"] = rule(words, count=surfaces.equations, of=len(places))
            added = True
            if ambiguous and len(places) > 1:
                return True
    return added


def meeting_places(
    surfaces: Surfaces, known: FloatArray, middle: FloatArray, size: float, fits: float
) -> list[FloatArray]:
    """Places (3,) where all surfaces meet, the best first; coordinates that are ``known`` (3,) stay."""
    free = np.isnan(known)
    X = np.where(free, _starts(surfaces, middle, size), known)
    damping = np.full(len(X), 1e-3)
    off, rows = _residuals(surfaces, X, size)
    cost = np.sum(off**2, axis=1)
    for _ in range(25):
        normal = np.einsum("kni,knj->kij", rows, rows)[:, free][:, :, free]
        side = np.einsum("kni,kn->ki", rows, off)[:, free]
        normal += (damping * np.trace(normal, axis1=1, axis2=2))[:, None, None] * np.eye(int(free.sum()))
        moved = X.copy()
        moved[:, free] -= rotations.solve(normal + 1e-18 / size**2 * np.eye(int(free.sum())), side[:, :, None])[:, :, 0]
        tried, fresh = _residuals(surfaces, moved, size)
        better = np.sum(tried**2, axis=1) < cost
        X[better], off[better], rows[better] = moved[better], tried[better], fresh[better]
        cost = np.sum(off**2, axis=1)
        damping = np.clip(np.where(better, 0.2 * damping, 5.0 * damping), 1e-12, 1e6)
    good = np.isfinite(cost) & (np.abs(off).max(axis=1, initial=0.0) < fits)
    # (k,) true where places (k, 3) lie before everything from which they were sighted, and not behind.
    at, towards = surfaces.sights[:, :3], surfaces.sights[:, 3:]
    ahead = np.asarray((np.einsum("kni,ni->kn", X[:, None, :] - at, towards) > 0.0).all(axis=1))
    good &= ahead if np.isfinite(fits) or (good & ahead).any() else True
    good &= cost <= max(9.0 * np.fmin.reduce(cost), (0.1 * fits) ** 2)
    best = np.argsort(cost)
    best = best[good[best]]
    values = rotations.singular_values(rows[best][:, :, free] * size)
    if values.shape[1] < free.sum():
        return []
    # Least singular value of the surfaces, relative to the largest, at which they meet in a point.
    apart = X[best[values[:, -1] >= 1e-3 * values[:, 0]]]
    places: list[FloatArray] = []
    while len(apart):
        places.append(apart[0])
        # Distance of two places, in parts of the size, up to which they are one.
        apart = apart[np.linalg.norm(apart - apart[0], axis=1) > 0.02 * size]
    return places


def _residuals(surfaces: Surfaces, X: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Residuals (k, n) of all surfaces at places (k, 3), and their derivatives (k, n, 3)."""
    normal, at, unit = surfaces.planes[:, :3], surfaces.planes[:, 3:6], surfaces.planes[:, 6]
    away = X[:, None, :] - at
    reach = np.where(unit > 0.0, unit, np.maximum(np.linalg.norm(away, axis=2), 1e-9 * size))
    plane = np.einsum("kni,ni->kn", away, normal) / reach
    by_plane = normal / reach[:, :, None] - np.where(unit > 0.0, 0.0, plane / reach**2)[:, :, None] * away
    out = X[:, None, :] - surfaces.spheres[:, :3]
    length = np.maximum(np.linalg.norm(out, axis=2), 1e-9 * size)
    radius = surfaces.spheres[:, 3]
    up = X[:, None, :] - surfaces.cones[:, :3]
    flat = np.maximum(np.hypot(up[..., 0], up[..., 1]), 1e-9 * size)
    square = flat**2 + up[..., 2] ** 2
    cone = np.arctan2(up[..., 2], flat) - surfaces.cones[:, 3]
    by_cone = np.stack(
        [-up[..., 0] * up[..., 2] / flat / square, -up[..., 1] * up[..., 2] / flat / square, flat / square], axis=2
    )
    residuals = np.concatenate([plane, length / radius - 1.0, cone], axis=1)
    rows = np.concatenate([by_plane, out / (length * radius)[..., None], by_cone], axis=1)
    return residuals, rows


def _starts(surfaces: Surfaces, middle: FloatArray, size: float) -> FloatArray:
    """Places (k, 3) over all directions, about the middle and about everything that is at a distance."""
    directions = sphere(24)
    starts = [middle + r * size * directions for r in (0.3, 1.0, 4.0)]
    starts += [sphere[:3] + sphere[3] * directions for sphere in surfaces.spheres[:4]]
    return np.concatenate(starts)


def _pose_of_system(part: Part, system: LocalSystem, fits: float) -> tuple[FloatArray, FloatArray, LocalSystem] | None:
    """λ D (3, 3) and shift (3,) of a measured system in a part, local = λ D X + shift; ``None`` where it is open."""
    known = part.known(system.points)
    if np.isfinite(system.coordinates[known]).sum() < 7:
        return None
    none = np.zeros((0, 3))
    ties = Ties(part.points[system.points[known]], system.coordinates[known], none, none)
    found = movement(ties, FreeRotation.ANY, part.scaled and system.scaled)
    if found is None or found.open or found.misfit > fits or found.alternatives:
        return None
    return found.scale * found.rotation, found.shift, system


def _surfaces(
    part: Part, scene: Scene, systems: list[tuple[FloatArray, FloatArray, LocalSystem] | None], point: int, size: float
) -> Surfaces:
    sights = []
    seen = scene.rays_for(part)[1]
    for ray in seen.of_points(np.array([point])).tolist():
        pose = part.poses.get(int(seen.frame[ray]))
        if pose is not None:
            at = pose[0] - [0.0, 0.0, seen.height[ray]]
            sights.append(np.concatenate([at, pose[1].T @ seen.rays[ray]]))
    planes = [
        *(np.concatenate([normal, ray[:3], [0.0]]) for ray in sights for normal in rotations.svd(ray[None, 3:])[2][1:]),
        *_of_systems(systems, point, size),
    ]
    spheres: list[FloatArray] = []
    cones: list[FloatArray] = []
    if part.levelled:
        bearings = _bearings(part, scene, point)
        planes += [np.array([b[4], -b[3], 0.0, *b[:3], 0.0]) for b in bearings]
        sights = [*sights, *bearings]
        cones += _of_verticals(part, scene, point)
    for other in scene.distances[1].neighbours.get(point, ()) if part.scaled else ():
        length = scene.distances[1].slope.get((other, point))
        if length is not None and np.isfinite(part.points[other]).all() and (part.levelled or length[1] == 0.0):
            spheres.append(np.append(part.points[other] + [0.0, 0.0, length[1]], length[0]))
    return Surfaces(_stacked(planes, 7), _stacked(spheres, 4), _stacked(cones, 4), _stacked(sights, 6))


def _stacked(rows: list[FloatArray], width: int) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def _bearings(part: Part, scene: Scene, point: int) -> list[FloatArray]:
    """(6,) of each horizontal direction of an oriented set to a point: its place and direction in plan."""
    found = []
    for number in scene.sights_to.get(point, ()):
        sight, kappa = scene.terrestrial.sights[number], part.kappas.get(number)
        place = part.points[sight.position]
        for k in np.flatnonzero(sight.points == point) if kappa is not None else ():
            t = sight.directions[k] - (kappa or 0.0)
            if np.isfinite(t) and np.isnan(sight.verticals[k]) and np.isfinite(place[:2]).all():
                found.append(np.array([*np.nan_to_num(place), np.sin(t), np.cos(t), 0.0]))
    return found


def _of_verticals(part: Part, scene: Scene, point: int) -> list[FloatArray]:
    """Cones about the vertical; of an instrument that is posed the ray to the point has it already."""
    distances, seen = scene.distances[int(part.scaled)], scene.rays_for(part)[1]
    posed = {int(seen.frame[ray]) for ray in seen.of_points(np.array([point]))} & set(part.poses)
    rays = {scene.frames[number].position for number in posed if number >= scene.image_count}
    found = []
    for other, here, value, rise in distances.verticals_at(point):
        if np.isfinite(part.points[other]).all() and not (here and other in rays):
            apex = part.points[other] + [0.0, 0.0, rise if here else -rise]
            found.append(np.append(apex, value if here else -value))
    return found


def _of_systems(
    systems: list[tuple[FloatArray, FloatArray, LocalSystem] | None], point: int, size: float
) -> list[FloatArray]:
    found = []
    for one in systems:
        if one is None:
            continue
        turned, shift, system = one
        for k in np.flatnonzero(system.points == point):
            for axis in np.flatnonzero(np.isfinite(system.coordinates[k])):
                row = turned[axis]
                length = float(np.linalg.norm(row))
                normal = row / length
                away = (system.coordinates[k, axis] - shift[axis]) / length
                found.append(np.concatenate([normal, away * normal, [size]]))
    return found


# ---- Parts of distances alone: they begin with a shape in plan or in space, and grow from point to point.
#
# Distances cannot tell a shape from its mirrored one: such a part is not ``handed`` until it has joined another.


def seed_distances(scene: Scene, system: Part, known: BoolArray, tried: set[tuple[int, ...]]) -> Part | None:
    """A part of points of which one at least is not ``known`` (points,) in any part; ``tried`` remembers all tries."""
    if known[list(scene.distances[1].neighbours)].all():
        return None
    for dimension, lengths in ((2, _in_plan(scene, system)), (3, _in_space(scene))):
        # Points, at the most, of which a shape is looked for; the others grow from it.
        for links, most in (*((dimension + 1, size) for size in (40, 20, 10)), (dimension, dimension + 1)):
            core = core_of(lengths, links, most)
            key = (dimension, *core.tolist())
            if len(core) <= dimension or key in tried or known[core].all():
                continue
            tried.add(key)
            shape = shape_of_distances(lengths.among(core), dimension)
            if shape is None:
                continue
            part = empty_part(scene.points)
            part.scaled, part.handed, part.levelled = True, False, dimension == 2
            part.points[core, :dimension] = shape
            part.began = rule("distances between {count} points", count=len(core))
            part.how |= {f"point {p}": part.began for p in core.tolist()}
            return part
    return None


def _in_plan(scene: Scene, system: Part) -> PointDistances:
    distances = scene.distances[1]
    rows = [
        (a, b, distances.between(system, a, b)) for a, others in distances.neighbours.items() for b in others if a < b
    ]
    return _lengths(scene, [row for row in rows if np.isfinite(row[2])])


def _in_space(scene: Scene) -> PointDistances:
    slopes = scene.distances[1].slope.items()
    return _lengths(scene, [(a, b, length) for (a, b), (length, rise) in slopes if a < b and rise == 0.0])


def _lengths(scene: Scene, rows: list[tuple[int, int, float]]) -> PointDistances:
    start, end = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
    value = np.array([row[2] for row in rows])
    sigma = np.array([scene.distances[1].sigma.get((a, b), 0.0) for a, b, _ in rows])
    return PointDistances(scene.points, start, end, value, sigma)
