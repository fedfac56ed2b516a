"""Single situations of measuring, each with known truth: what stands alone here is mixed elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise

import numpy as np
from numpy.random import Generator

from tests.scenarios.mixtures.project_file import GON
from tests.scenarios.mixtures.world import (
    Image,
    Point,
    Station,
    World,
    about_z,
    looking,
    photograph,
    rotation,
    sight,
)

SIGMA_ANGLE = 1e-5


def situation(name: str, seed: int) -> World:
    """A world of one situation."""
    draw = np.random.default_rng([seed, *name.encode()])
    world = World(seed, float(10.0 ** draw.uniform(0.5, 2.0)), tags={name})
    SITUATIONS[name](world, draw)
    return world


def _object(world: World, draw: Generator, count: int = 24) -> None:
    for i in range(count):
        world.points[f"P{i}"] = Point(world.size * np.array([1.0, 0.7, 0.5]) * draw.uniform(-0.5, 0.5, 3))


def _images(world: World, draw: Generator, count: int) -> None:
    for i in range(count):
        angle = 2.0 * np.pi * (i + draw.uniform(0.0, 0.6)) / (2.0 * count)
        place = world.size * draw.uniform(1.3, 1.9) * np.array([np.cos(angle), np.sin(angle), draw.uniform(0.0, 0.5)])
        at = 0.1 * world.size * draw.standard_normal(3)
        world.images[f"I{i}"] = Image(place, looking(place, at, float(draw.uniform(-0.3, 0.3))))
        photograph(world, f"I{i}", draw, 1.0, 40)


def _control(world: World, draw: Generator, patterns: list[str], sigma: float = 0.0) -> None:
    names = [str(p) for p in draw.permutation([p for p in world.points if p.startswith("P")])]
    for p, pattern in zip(names, patterns, strict=False):
        world.points[p].sigma = [sigma if axis in pattern else None for axis in "xyz"]
    world.free = False


def _bar(world: World, draw: Generator) -> None:
    a, b = (str(p) for p in draw.choice([p for p in world.points if p.startswith("P")], 2, replace=False))
    length = float(np.linalg.norm(world.points[a].xyz - world.points[b].xyz))
    world.distances.append((a, b, length + world.sigma_length * float(draw.standard_normal()), 0.0))


def _stations(world: World, draw: Generator, count: int, seen: float = 1.0, far: bool = False) -> None:
    for i in range(count):
        angle = 2.0 * np.pi * (i + draw.uniform(0.0, 0.7)) / count
        place = world.size * draw.uniform(0.8, 1.3) * np.array([np.cos(angle), np.sin(angle), draw.uniform(-0.1, 0.1)])
        world.points[f"N{i}"] = Point(place)
        world.stations[f"S{i}"] = Station(f"N{i}", 0.0, "fixed", about_z(float(draw.uniform(-3.0, 3.0))))
        for p in [p for p in world.points if p.startswith("P")]:
            if draw.random() < seen:
                sight(world, f"S{i}", p, draw, True, far)


def partial_heights(world: World, draw: Generator) -> None:
    """A system in which only z̄ of points is measured, beside images with control."""
    _partial(world, draw, (False, False, True))
    world.system_held = ("x", "y", "kappa")


def partial_plan(world: World, draw: Generator) -> None:
    """A system in which only x̄ and ȳ are measured."""
    _partial(world, draw, (True, True, False))
    world.system_held = ("z",)


def _partial(world: World, draw: Generator, seen: tuple[bool, bool, bool]) -> None:
    _object(world, draw)
    _images(world, draw, 4)
    _control(world, draw, ["xyz"] * 4)
    origin, D = 0.3 * world.size * draw.standard_normal(3), rotation(draw.standard_normal(3))
    world.systems["L"] = (origin, D, 1.0, False)
    for p in list(world.points)[:12]:
        xyz = D @ (world.points[p].xyz - origin) + world.sigma_length * draw.standard_normal(3)
        world.local.append(("L", p, *np.where(seen, xyz, np.nan).tolist()))


def boresight(world: World, draw: Generator) -> None:
    """Leaders (a platform) are known by GNSS and INS; the camera that follows them is not, nor any point."""
    _object(world, draw, 30)
    world.base, world.turn = (
        0.02 * world.size * draw.standard_normal(3),
        rotation(0.05 * draw.standard_normal(3)),
    )
    for i in range(7):
        place = world.size * np.array([*draw.uniform(-0.6, 0.6, 2), draw.uniform(1.3, 1.7)])
        D = looking(place, 0.1 * world.size * draw.standard_normal(3), float(draw.choice([0.0, 1.57, 3.0])))
        world.images[f"I{i}"] = Image(place, D, observed=1e-4 * world.size, turned=1e-4)
        world.images[f"F{i}"] = Image(place + D.T @ world.base, world.turn @ D, leader=f"I{i}")
        photograph(world, f"F{i}", draw, 1.0, 40)
    world.free = False


def rig_of_known_leaders(world: World, draw: Generator) -> None:
    """A rig whose leaders see control; followers see the same."""
    _object(world, draw, 30)
    world.base, world.turn = world.size * np.array([0.3, 0.02, 0.0]), rotation(np.array([0.0, 0.1, 0.02]))
    for i in range(4):
        place = world.size * np.array([draw.uniform(-0.4, 0.4), -draw.uniform(1.4, 1.9), draw.uniform(0.0, 0.4)])
        D = looking(place, 0.05 * world.size * draw.standard_normal(3), 0.1)
        world.images[f"I{i}"] = Image(place, D, held=True)
        world.images[f"F{i}"] = Image(place + D.T @ world.base, world.turn @ D, leader=f"I{i}")
        photograph(world, f"I{i}", draw, 1.0, 40)
        photograph(world, f"F{i}", draw, 1.0, 40)
    world.free = False


def one_image_held(world: World, draw: Generator) -> None:
    """One image is fixed, a bar has the scale; nothing else is known."""
    _object(world, draw)
    _images(world, draw, int(draw.integers(2, 6)))
    world.images["I0"].held = True
    _bar(world, draw)
    world.free = False


def theodolites_and_a_bar(world: World, draw: Generator) -> None:
    """Directions and zenith angles of stations that do not see each other, one bar."""
    _object(world, draw)
    _stations(world, draw, int(draw.integers(2, 5)))
    _bar(world, draw)


def rough_coordinates(world: World, draw: Generator) -> None:
    """All object points have start values that are wrong by up to a tenth of the object; images have none."""
    _object(world, draw)
    _images(world, draw, 4)
    _control(world, draw, ["xyz"] * 3)
    for point in world.points.values():
        if point.sigma[0] is None:
            point.rough = point.xyz + 0.03 * world.size * draw.standard_normal(3)


def gross_coordinates(world: World, draw: Generator) -> None:
    """Three object points have start values of another place; the others good ones."""
    _object(world, draw)
    _images(world, draw, 4)
    _control(world, draw, ["xyz"] * 3)
    for k, point in enumerate(p for p in world.points.values() if p.sigma[0] is None):
        away = world.size * draw.uniform(0.5, 2.0, 3) if k < 3 else np.zeros(3)
        point.rough = point.xyz + away + 1e-4 * world.size * draw.standard_normal(3)


def _plan(world: World, draw: Generator, count: int) -> list[str]:
    """Points of a plane network: heights are fixed at 0."""
    for i in range(count):
        k = 1.0 * np.array([i % 4, i // 4]) + draw.uniform(-0.3, 0.3, 2)
        world.points[f"P{i}"] = Point(np.append(world.size * k, 0.0), [None, None, 0.0])
    return list(world.points)


def _near(world: World, reach: float) -> list[tuple[str, str]]:
    return [
        (a, b)
        for a, b in combinations(world.points, 2)
        if np.linalg.norm(world.points[a].xyz - world.points[b].xyz) < reach * world.size
    ]


def _azimuth(world: World, a: str, b: str) -> float:
    d = world.points[b].xyz - world.points[a].xyz
    return float(np.arctan2(d[0], d[1]))


def _zenith(world: World, a: str, b: str) -> float:
    d = world.points[b].xyz - world.points[a].xyz
    return float(np.arccos(d[2] / np.linalg.norm(d)))


def bearings_only(world: World, draw: Generator) -> None:
    """A plane network of bearings, none of a pair in both senses; two fixed points."""
    _plan(world, draw, 10)
    rows = [
        [a, b, f"{GON * (_azimuth(world, a, b) + SIGMA_ANGLE * draw.standard_normal()):.8f}"]
        for a, b in _near(world, 1.9)
    ]
    world.tables.append(_table("bearing", ["from", "to", "bearing"], rows, GON * SIGMA_ANGLE))
    _control(world, draw, ["xyz", "xyz"])
    _fix_heights(world)


def free_bearings(world: World, draw: Generator) -> None:
    """A plane network of bearings, each observed at one of its ends, and one distance; no known point."""
    bearings_only(world, draw)
    for point in world.points.values():
        point.sigma = [None, None, 0.0]
    world.free = True
    _distances(world, draw, [("P3", "P7")])


def free_traverse_of_bearings(world: World, draw: Generator) -> None:
    """A traverse of bearings, slope distances and zenith angles, as in a cave: no known point, sights either way."""
    place = np.zeros(3)
    for i in range(10):
        world.points[f"P{i}"] = Point(place)
        place = place + world.size * draw.uniform([0.2, -0.4, -0.2], [0.6, 0.4, 0.1])
    chain = [*pairwise(world.points), ("P0", "P4"), ("P3", "P9")]
    pairs = [(b, a) if draw.random() < 0.5 else (a, b) for a, b in chain]
    for key, angle in (("bearing", _azimuth), ("zenith_angle", _zenith)):
        rows = [[a, b, f"{GON * (angle(world, a, b) + SIGMA_ANGLE * draw.standard_normal()):.8f}"] for a, b in pairs]
        world.tables.append(_table(key, ["from", "to", key], rows, GON * SIGMA_ANGLE))
    _distances(world, draw, pairs)


def angles_only(world: World, draw: Generator) -> None:
    """A plane network of angles at every point, two fixed points."""
    _plan(world, draw, 10)
    near: dict[str, list[str]] = {p: [] for p in world.points}
    for a, b in _near(world, 1.9):
        near[a].append(b)
        near[b].append(a)
    rows = []
    for at, legs in near.items():
        for back, fore in pairwise(legs):
            beta = _azimuth(world, at, fore) - _azimuth(world, at, back) + SIGMA_ANGLE * draw.standard_normal()
            rows.append([at, back, fore, f"{GON * float(beta % (2.0 * np.pi)):.8f}"])
    world.tables.append(_table("angle", ["at", "from", "to", "angle"], rows, GON * SIGMA_ANGLE))
    _control(world, draw, ["xyz", "xyz"])
    _fix_heights(world)


def directions_without_mutual_sight(world: World, draw: Generator) -> None:
    """Sets of horizontal directions of four stations around points in plan, none to another station; one distance."""
    targets = _plan(world, draw, 9)
    for i in range(4):
        angle = 0.5 * np.pi * (i + draw.uniform(-0.4, 0.4))
        place = world.size * (np.array([1.5, 1.0]) + draw.uniform(3.0, 5.0) * np.array([np.cos(angle), np.sin(angle)]))
        world.points[f"N{i}"] = Point(np.append(place, 0.0), [None, None, 0.0])
        world.stations[f"S{i}"] = Station(f"N{i}", 0.0, "fixed", about_z(float(draw.uniform(-3.0, 3.0))))
        for p in targets:
            sight(world, f"S{i}", p, draw, False, False)
    _distances(world, draw, [("P0", "P5")])


def _fix_heights(world: World) -> None:
    for point in world.points.values():
        point.sigma[2] = 0.0


def _table(key: str, columns: list[str], rows: list[list[str]], sigma: float) -> dict[str, object]:
    return {"type": key, "columns": columns, "rows": rows, "values": {"sigma": f"{sigma:.9f}"}}


def _distances(world: World, draw: Generator, pairs: list[tuple[str, str]]) -> None:
    for a, b in pairs:
        length = float(np.linalg.norm(world.points[a].xyz - world.points[b].xyz))
        world.distances.append((a, b, length + world.sigma_length * float(draw.standard_normal()), 0.0))


def trilateration_from_known(world: World, draw: Generator) -> None:
    """Distances in plan, three points known."""
    _plan(world, draw, 12)
    _distances(world, draw, _near(world, 1.9))
    _control(world, draw, ["xyz"] * 3)
    _fix_heights(world)


def free_trilateration_in_plan(world: World, draw: Generator) -> None:
    """Distances in plan, nothing known but the heights."""
    _plan(world, draw, 12)
    _distances(world, draw, _near(world, 1.9))


def multilateration(world: World, draw: Generator) -> None:
    """Distances in space from stations to targets, four and more stations known."""
    _object(world, draw, 12)
    anchors = list(world.points)[:5]
    for p in anchors:
        world.points[p].xyz = 1.5 * world.points[p].xyz
        world.points[p].sigma = [0.0] * 3
    _distances(world, draw, [(a, p) for a in anchors for p in world.points if p not in anchors])
    world.free = False


def free_multilateration(world: World, draw: Generator) -> None:
    """Distances in space between most pairs of points, nothing known."""
    _object(world, draw, 10)
    _distances(world, draw, [pair for pair in combinations(world.points, 2) if draw.random() < 0.8])


def free_tracker_multilateration(world: World, draw: Generator) -> None:
    """Distances from six places to many targets: none among the places, none among the targets."""
    _object(world, draw, 20)
    for i in range(6):
        world.points[f"N{i}"] = Point(1.3 * world.size * draw.uniform(-1.0, 1.0, 3))
    _distances(world, draw, [(f"N{i}", p) for i in range(6) for p in world.points if p.startswith("P")])


def azimuth_and_angles(world: World, draw: Generator) -> None:
    """Angles, one azimuth and one distance: a traverse of triangles; one fixed point."""
    angles_only(world, draw)
    for point in world.points.values():
        point.sigma = [None, None, 0.0]
    world.points["P0"].sigma = [0.0, 0.0, 0.0]
    rows = [["P0", "P1", f"{GON * _azimuth(world, 'P0', 'P1'):.8f}"]]
    world.tables.append(_table("bearing", ["from", "to", "bearing"], rows, GON * SIGMA_ANGLE))
    _distances(world, draw, [("P0", "P1")])


def _strip(world: World, draw: Generator, count: int, forward: float) -> None:
    """Vertical images of a strip with a forward overlap; the base is (1 − overlap) of the picture."""
    height = world.size
    reach = 36.0 / 30.0 * height
    base = (1.0 - forward) * reach
    for i in range(count * 30):
        xyz = [
            draw.uniform(-0.3 * reach, count * base),
            draw.uniform(-0.3, 0.3) * reach,
            0.1 * height * draw.random(),
        ]
        world.points[f"P{i}"] = Point(np.array(xyz))
    for i in range(count):
        place = np.array(
            [i * base, 0.02 * height * draw.standard_normal(), height * (1.0 + 0.02 * draw.standard_normal())]
        )
        D = rotation(0.03 * draw.standard_normal(3)) @ np.eye(3)
        world.images[f"I{i}"] = Image(place, D)
        photograph(world, f"I{i}", draw, 1.0, 60)


def two_ray_strip(world: World, draw: Generator) -> None:
    """Tie points of two rays only, between neighbours; control at both ends: each pair's scale hangs on control."""
    _strip(world, draw, 3, 0.6)
    _only_two_rays(world)
    _control_of_seen(world, draw, 8)


def strip_with_gnss(world: World, draw: Generator) -> None:
    """A strip of pairs without points seen three times; GNSS positions carry the scale."""
    _strip(world, draw, 6, 0.6)
    _only_two_rays(world)
    for image in world.images.values():
        image.observed = 1e-4 * world.size
    _control_of_seen(world, draw, 3)


def _only_two_rays(world: World) -> None:
    """Of every point the rays of two neighbouring images."""
    rays: dict[str, list[int]] = {}
    for image, p, *_ in world.rays:
        rays.setdefault(p, []).append(int(image[1:]))
    keep = {}
    for k, (p, numbers) in enumerate(rays.items()):
        ordered = sorted(numbers)
        pairs = [pair for pair in pairwise(ordered) if pair[1] - pair[0] == 1]
        if pairs:
            keep[p] = pairs[k % len(pairs)]
    world.rays = [ray for ray in world.rays if int(ray[0][1:]) in keep.get(ray[1], ())]
    world.points = {p: point for p, point in world.points.items() if p in keep}


def _control_of_seen(world: World, draw: Generator, count: int) -> None:
    names = draw.permutation(list(world.points))[:count]
    for p in names:
        world.points[str(p)].sigma = [0.0, 0.0, 0.0]
    world.free = False


def spatial_from_plan(world: World, draw: Generator) -> None:
    """Total stations over points whose plan coordinates are known; one height."""
    _object(world, draw, 15)
    _stations(world, draw, 3, 0.9, far=True)
    for k, p in enumerate(list(world.points)):
        if p.startswith("N"):
            world.points[p].sigma = [0.0, 0.0, 0.0 if k == 15 else None]
    world.free = False


def sights_to_cameras(world: World, draw: Generator) -> None:
    """A total station sights the projection centres of the images and nothing else."""
    _object(world, draw)
    _images(world, draw, 5)
    world.points["N0"] = Point(world.size * np.array([0.2, 1.0, 0.1]), [0.0, 0.0, 0.0])
    world.points["N1"] = Point(world.size * np.array([2.5, 2.0, 0.3]), [0.0, 0.0, 0.0])
    world.stations["S0"] = Station("N0", 0.0, "fixed", about_z(float(draw.uniform(-3.0, 3.0))))
    sight(world, "S0", "N1", draw, True, True)
    for name, image in world.images.items():
        world.points[f"centre:{name}"] = Point(image.centre)
        sight(world, "S0", f"centre:{name}", draw, True, True)
        del world.points[f"centre:{name}"]
    world.free = False


SITUATIONS: dict[str, Callable[[World, Generator], None]] = {
    function.__name__.replace("_", " "): function
    for function in (
        partial_heights, partial_plan, boresight, rig_of_known_leaders, one_image_held, theodolites_and_a_bar,
        rough_coordinates, gross_coordinates, bearings_only, free_bearings, free_traverse_of_bearings, angles_only,
        directions_without_mutual_sight,
        trilateration_from_known,
        free_trilateration_in_plan, multilateration, free_multilateration, free_tracker_multilateration,
        azimuth_and_angles, two_ray_strip, strip_with_gnss, spatial_from_plan, sights_to_cameras,
    )
}  # fmt: skip
