"""One point at a time by whatever it is measured with: rays, bearings, distances, vertical directions, coordinates of a
system, from wherever things are known.

Each is a surface through the point. They are adjusted together (Gauss-Newton, damped) from starts over all directions
and distances; a point is taken where one place fits, and, where nothing else is left, where several do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.parts.movement import Ties, Turn, movement
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import LocalSystem, Scene
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant

FITS = 0.01
"""Residual (radians, or parts of a distance) up to which a surface passes through a point."""
ROUGHLY = 0.1
"""The same where nothing else is left: what is known may be rough itself."""
SAME = 0.02
"""Distance of two places, in parts of the size, up to which they are one."""
SMALLEST = 1e-3
"""Least singular value of the surfaces, relative to the largest, at which they meet in a point."""
ONE_PLACE = "meeting of {count} surfaces"
SEVERAL_PLACES = "meeting of {count} surfaces: one of {of} places that fit alike"
_STEPS = 25
_ALIKE = 9.0


class Surfaces(NamedTuple):
    """What passes through a point; residuals are angles, or parts of a distance or of the size."""

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


def grow_single_points(
    part: Part, scene: Scene, ambiguous: bool = False, contradicting: bool = False
) -> bool:
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
    fits = np.inf if contradicting else ROUGHLY if ambiguous else FITS
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
            words = ONE_PLACE if len(places) == 1 else SEVERAL_PLACES
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
    for _ in range(_STEPS):
        normal = np.einsum("kni,knj->kij", rows, rows)[:, free][:, :, free]
        side = np.einsum("kni,kn->ki", rows, off)[:, free]
        normal += (damping * np.trace(normal, axis1=1, axis2=2))[:, None, None] * np.eye(int(free.sum()))
        moved = X.copy()
        moved[:, free] -= tolerant.solve(
            normal + 1e-18 / size**2 * np.eye(int(free.sum())), side[:, :, None]
        )[:, :, 0]
        tried, fresh = _residuals(surfaces, moved, size)
        better = np.sum(tried**2, axis=1) < cost
        X[better], off[better], rows[better] = moved[better], tried[better], fresh[better]
        cost = np.sum(off**2, axis=1)
        damping = np.clip(np.where(better, 0.2 * damping, 5.0 * damping), 1e-12, 1e6)
    good = np.isfinite(cost) & (np.abs(off).max(axis=1, initial=0.0) < fits)
    ahead = _ahead(surfaces, X)
    good &= ahead if np.isfinite(fits) or (good & ahead).any() else True
    places: list[FloatArray] = []
    for k in np.argsort(cost)[: np.count_nonzero(good)]:
        if not good[k] or cost[k] > max(_ALIKE * cost[np.argmin(cost)], (0.1 * fits) ** 2):
            continue
        values = tolerant.singular_values(rows[k][:, free] * size)
        if len(values) < free.sum() or values[-1] < SMALLEST * values[0]:
            continue
        if all(np.linalg.norm(X[k] - other) > SAME * size for other in places):
            places.append(X[k])
    return places


def _ahead(surfaces: Surfaces, X: FloatArray) -> BoolArray:
    """(k,) true where places (k, 3) lie before everything from which they were sighted, and not behind."""
    at, towards = surfaces.sights[:, :3], surfaces.sights[:, 3:]
    return np.asarray((np.einsum("kni,ni->kn", X[:, None, :] - at, towards) > 0.0).all(axis=1))


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
        [-up[..., 0] * up[..., 2] / flat / square, -up[..., 1] * up[..., 2] / flat / square, flat / square],
        axis=2,
    )
    residuals = np.concatenate([plane, length / radius - 1.0, cone], axis=1)
    rows = np.concatenate([by_plane, out / (length * radius)[..., None], by_cone], axis=1)
    return residuals, rows


def _starts(surfaces: Surfaces, middle: FloatArray, size: float) -> FloatArray:
    """Places (k, 3) over all directions, about the middle and about everything that is at a distance."""
    k = np.arange(24) + 0.5
    z, around = 1.0 - 2.0 * k / 24.0, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - z**2)
    directions = np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)
    starts = [middle + r * size * directions for r in (0.3, 1.0, 4.0)]
    starts += [sphere[:3] + sphere[3] * directions for sphere in surfaces.spheres[:4]]
    return np.concatenate(starts)


def _pose_of_system(
    part: Part, system: LocalSystem, fits: float
) -> tuple[FloatArray, FloatArray, LocalSystem] | None:
    """λ D (3, 3) and shift (3,) of a measured system in a part, local = λ D X + shift; ``None`` where it is open."""
    known = part.known(system.points)
    if np.isfinite(system.coordinates[known]).sum() < 7:
        return None
    none = np.zeros((0, 3))
    ties = Ties(part.points[system.points[known]], system.coordinates[known], none, none)
    found = movement(ties, Turn.ANY, part.scaled and system.scaled)
    if found is None or found.open or found.misfit > fits or found.alternatives:
        return None
    return found.scale * found.rotation, found.shift, system


def _surfaces(
    part: Part,
    scene: Scene,
    systems: list[tuple[FloatArray, FloatArray, LocalSystem] | None],
    point: int,
    size: float,
) -> Surfaces:
    sights = _rays(part, scene, point)
    planes = [*_of_rays(sights), *_of_systems(systems, point, size)]
    spheres: list[FloatArray] = []
    cones: list[FloatArray] = []
    if part.levelled:
        bearings = _bearings(part, scene, point)
        planes += _of_bearings(bearings)
        sights = [*sights, *bearings]
        cones += _of_verticals(part, scene, point)
    for other in scene.distances[1].neighbours.get(point, ()) if part.scaled else ():
        length = scene.distances[1].slope.get((other, point))
        if (
            length is not None
            and np.isfinite(part.points[other]).all()
            and (part.levelled or length[1] == 0.0)
        ):
            spheres.append(np.append(part.points[other] + [0.0, 0.0, length[1]], length[0]))
    return Surfaces(_stacked(planes, 7), _stacked(spheres, 4), _stacked(cones, 4), _stacked(sights, 6))


def _stacked(rows: list[FloatArray], width: int) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def _rays(part: Part, scene: Scene, point: int) -> list[FloatArray]:
    """(6,) of each ray of a posed frame to a point: its centre, lowered by the height of the target, and direction."""
    found = []
    seen = scene.rays_for(part)[1]
    for ray in seen.of_points(np.array([point])).tolist():
        pose = part.poses.get(int(seen.frame[ray]))
        if pose is not None:
            at = pose[0] - [0.0, 0.0, seen.height[ray]]
            found.append(np.concatenate([at, pose[1].T @ seen.rays[ray]]))
    return found


def _of_rays(rays: list[FloatArray]) -> list[FloatArray]:
    return [
        np.concatenate([normal, ray[:3], [0.0]])
        for ray in rays
        for normal in tolerant.svd(ray[None, 3:])[2][1:]
    ]


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


def _of_bearings(bearings: list[FloatArray]) -> list[FloatArray]:
    return [np.array([b[4], -b[3], 0.0, *b[:3], 0.0]) for b in bearings]


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
