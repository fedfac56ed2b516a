"""What a random mixture is made of: each ingredient draws its part of the world and leaves a tag."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from mor.types import FloatArray
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

FAR = ((0.0, 0.0, 0.0), (4000.0, 3000.0, 200.0), (450000.0, 5300000.0, 300.0))


def mixture(seed: int) -> World:
    """A world of a seed: points, images, stations, and what ties them together."""
    draw = np.random.default_rng(seed)
    world = World(seed, float(10.0 ** draw.uniform(0.3, 2.0)))
    _object(world, draw)
    stations = 0 if draw.random() < 0.25 else int(draw.choice([1, 2, 3, 4, 6, 10], p=[0.3, 0.25, 0.2, 0.1, 0.1, 0.05]))
    images = int(_images(draw))
    if draw.random() < 0.08 and stations > 1:
        images = 0
    _stations(world, draw, stations)
    _take_images(world, draw, images)
    _leave_out_what_is_hardly_seen(world)
    for share, ingredient in (
        (0.20, _systems), (0.15, _planes), (0.20, _levelling), (0.12, _vectors), (0.08, _bearings),
    ):  # fmt: skip
        if draw.random() < share:
            ingredient(world, draw)
    _datum(world, draw)
    return world


def _images(draw: Generator) -> float:
    low, high = ((2, 9), (9, 21), (21, 61))[int(draw.choice(3, p=[0.7, 0.2, 0.1]))]
    return float(draw.integers(low, high))


def _object(world: World, draw: Generator) -> None:
    kind = str(draw.choice(["box", "facade", "terrain"], p=[0.5, 0.25, 0.25]))
    proportions = {"box": draw.uniform(0.3, 1.0, 3), "facade": [1.0, 0.08, 0.6], "terrain": [1.0, 1.0, 0.12]}[kind]
    world.tags.add(f"object {kind}")
    count = int(draw.integers(14, 60))
    for i in range(count):
        xyz = world.size * np.asarray(proportions) * draw.uniform(-0.5, 0.5, 3)
        world.points[f"P{i}"] = Point(xyz)


def _around(world: World, draw: Generator, near: float, far: float, high: float) -> FloatArray:
    """A place around the object; in front of it for a facade."""
    angle = draw.uniform(0.0, 2.0 * np.pi)
    if "object facade" in world.tags:
        angle = draw.uniform(-2.4, -0.7)
    reach = world.size * draw.uniform(near, far)
    return np.array([reach * np.cos(angle), reach * np.sin(angle), world.size * high * draw.uniform(-0.3, 1.0)])


def _stations(world: World, draw: Generator, count: int) -> None:
    for i in range(count):
        over, name = f"N{i}", f"S{i}"
        place = _around(world, draw, 0.8, 1.6, 0.2)
        world.points[over] = Point(place)
        kind = str(draw.choice(["total", "zenith", "horizontal", "tilted", "level σ"], p=[0.4, 0.28, 0.08, 0.12, 0.12]))
        world.tags.add(f"station {kind}")
        D = about_z(float(draw.uniform(-np.pi, np.pi)))
        level = "fixed"
        if kind == "tilted":
            D, level = rotation(0.1 * draw.standard_normal(3)) @ D, "free"
        elif kind == "level σ":
            D, level = rotation(np.append(3e-5 * draw.standard_normal(2), 0.0)) @ D, "2 mgon"
        height = 0.0 if draw.random() < 0.3 else round(0.05 * world.size * draw.uniform(0.3, 1.0), 4)
        world.stations[name] = Station(over, height, level, D)
        far = kind == "total" or (kind in ("tilted", "level σ") and draw.random() < 0.5)
        if far:
            world.tags.add("distances")
        objects = [p for p in world.points if p.startswith("P")]
        objects = [p for p in objects if draw.random() < draw.choice([0.4, 0.9])]
        for p in objects:
            sight(world, name, p, draw, kind != "horizontal", far and draw.random() < 0.8)
    for name, station in world.stations.items():
        for other in world.stations.values():
            if other is not station and draw.random() < 0.6:
                kind = not any(r[0] == name and np.isnan(r[3]) for r in world.directions)
                measured = any(r[0] == name for r in world.distances)
                sight(
                    world,
                    name,
                    other.over,
                    draw,
                    kind,
                    measured,
                    above=float(draw.choice([0.0, other.height])),
                )
    world.tags.add(f"stations {'0' if not count else '1' if count == 1 else '2+'}")


def _take_images(world: World, draw: Generator, count: int) -> None:
    world.tags.add(
        "images 0" if not count else "images 2-8" if count < 9 else "images 9-20" if count < 21 else "images 21+"
    )
    rig = count >= 4 and draw.random() < 0.15
    tripods = count and draw.random() < 0.2
    turned = count and draw.random() < 0.12
    located = draw.random() < 0.1
    kept = float(draw.choice([0.7, 0.9, 1.0]))
    if rig:
        _rig(world, draw)
    number = 0
    while number < count:
        name = f"I{number}"
        place = _around(world, draw, 1.0, 2.0, 0.8)
        if "object terrain" in world.tags:
            place = world.size * np.array([*draw.uniform(-0.5, 0.5, 2), draw.uniform(1.0, 1.6)])
        at = world.size * 0.12 * draw.uniform(-1.0, 1.0, 3)
        image = Image(place, looking(place, at, float(draw.choice([0.0, 1.57, -1.57]) + 0.1 * draw.standard_normal())))
        if located:
            image.observed = 0.01 * world.size
            image.centre = image.centre.copy()
            world.tags.add("observed positions of images")
        if tripods and draw.random() < 0.5:
            _on_tripod(world, draw, image, number)
        world.images[name] = image
        photograph(world, name, draw, kept, 40)
        number += 1
        if rig and number < count and draw.random() < 0.8:
            assert world.base is not None
            assert world.turn is not None
            follower = Image(image.centre + image.D.T @ world.base, world.turn @ image.D, leader=name)
            world.images[f"I{number}"] = follower
            photograph(world, f"I{number}", draw, kept, 40)
            number += 1
        elif turned and number < count and image.over and draw.random() < 0.7:
            again = Image(image.centre, rotation(0.25 * draw.standard_normal(3)) @ image.D, image.over, image.height)
            world.tags.add("several images from one tripod")
            world.images[f"I{number}"] = again
            photograph(world, f"I{number}", draw, kept, 40)
            number += 1


def _rig(world: World, draw: Generator) -> None:
    world.base = world.size * np.array([draw.uniform(0.2, 0.5), 0.0, 0.0]) + 0.01 * world.size * draw.standard_normal(3)
    world.turn = rotation(np.array([0.0, draw.uniform(0.0, 0.2), 0.0]) + 0.03 * draw.standard_normal(3))
    status = str(draw.choice(["free", "observed", "fixed"]))
    world.base_sigma = {"free": None, "observed": world.sigma_length, "fixed": 0.0}[status]
    world.tags.add(f"rig, base {status}")


def _on_tripod(world: World, draw: Generator, image: Image, number: int) -> None:
    """The camera stands over a station point, or over a point of its own."""
    height = round(0.05 * world.size * draw.uniform(0.5, 1.0), 4)
    up = np.array([0.0, 0.0, height])
    stations = list(world.stations.values())
    if stations and draw.random() < 0.5:
        over = stations[int(draw.integers(len(stations)))].over
        image.centre = world.points[over].xyz + up
        image.D = looking(image.centre, 0.1 * world.size * draw.uniform(-1.0, 1.0, 3), 0.1)
        world.tags.add("tripod over a station point")
    else:
        over = f"T{number}"
        world.points[over] = Point(image.centre - up)
        world.tags.add("tripod over a point of its own")
        for name in world.stations:
            if draw.random() < 0.5:
                zenith = not any(r[0] == name and np.isnan(r[3]) for r in world.directions)
                sight(world, name, over, draw, zenith, any(r[0] == name for r in world.distances))
    image.over, image.height, image.observed = over, height, None


def _leave_out_what_is_hardly_seen(world: World) -> None:
    """Object points seen from one place only, and frames that see too little to be tied."""
    for _ in range(3):
        frames: dict[str, set[str]] = {p: set() for p in world.points}
        sights = dict.fromkeys([*world.images, *world.stations], 0)
        for frame, p, *_ in (*world.rays, *world.directions):
            leader = world.images[frame].leader if frame in world.images else ""
            frames[p].add(frame)
            sights[frame] += 1
            sights[leader or frame] += 1
        poor = {p for p in world.points if p.startswith("P") and len(frames[p]) < 2}
        blind = {frame for frame, count in sights.items() if count < 6}
        keep = [row for row in world.rays if row[0] not in blind and row[1] not in poor]
        world.rays = keep
        for name in ("directions", "distances"):
            rows = [row for row in getattr(world, name) if row[0] not in blind and row[1] not in poor]
            setattr(world, name, rows)
        leaders = {image.leader for name, image in world.images.items() if name not in blind}
        world.images = {n: image for n, image in world.images.items() if n not in blind or n in leaders}
        world.stations = {n: station for n, station in world.stations.items() if n not in blind}
        used = {row[1] for row in (*world.rays, *world.directions)}
        used |= {station.over for station in world.stations.values()}
        used |= {image.over for image in world.images.values()}
        world.points = {p: point for p, point in world.points.items() if p in used}


def _some(world: World, draw: Generator, count: int) -> list[str]:
    """Object points that most frames see."""
    seen = {p: 0 for p in world.points if p.startswith("P")}
    for _, p, *_ in (*world.rays, *world.directions):
        if p in seen:
            seen[p] += 1
    often = [p for p in seen if seen[p] > 2] or list(seen)
    return [str(p) for p in draw.permutation(often)[:count]]


def _systems(world: World, draw: Generator) -> None:
    for k in range(int(draw.integers(1, 3))):
        origin = world.size * draw.uniform(-0.5, 0.5, 3)
        D, scaled = rotation(draw.standard_normal(3) * 1.5), draw.random() < 0.6
        scale = 1.0 if scaled else float(draw.uniform(0.5, 2.0))
        world.systems[f"L{k}"] = (origin, D, scale, not scaled)
        world.tags.add(f"system, scale {'1' if scaled else 'free'}")
        for p in _some(world, draw, int(draw.integers(5, 12))):
            xyz = scale * D @ (world.points[p].xyz - origin) + world.sigma_length * draw.standard_normal(3)
            world.local.append((f"L{k}", p, *map(float, xyz)))


def _planes(world: World, draw: Generator) -> None:
    names = _some(world, draw, 40)
    normal = draw.standard_normal(3)
    normal /= np.linalg.norm(normal)
    height = np.array([world.points[p].xyz @ normal for p in names])
    near = np.argsort(np.abs(height - np.median(height)))[:6]
    if len(near) < 5:
        return
    world.planes["wall"] = [names[i] for i in near]
    world.tags.add(f"feature {world.kind_of_feature}")


def _levelling(world: World, draw: Generator) -> None:
    names = _some(world, draw, int(draw.integers(3, 7)))
    names += [p for p in world.points if p[0] in "NT" and draw.random() < 0.5]
    line = []
    for k, p in enumerate(names):
        line.append(p)
        if draw.random() < 0.4:
            world.points[f"B{k}"] = Point(world.points[p].xyz + 0.2 * world.size * draw.standard_normal(3))
            line.append(f"B{k}")
    world.tags.add("levelling")
    for a, b in zip(line, [*line[1:], line[0]], strict=True):
        dz = world.points[b].xyz[2] - world.points[a].xyz[2] + world.sigma_length * draw.standard_normal()
        world.level_lines.append((a, b, float(dz)))
    for p in line:
        if p.startswith("B"):
            world.points[p].sigma = [0.0, 0.0, None]


def _vectors(world: World, draw: Generator) -> None:
    names = [*_some(world, draw, 3), *(p for p in world.points if p[0] in "NT" and draw.random() < 0.6)]
    world.points["G0"] = Point(world.size * draw.standard_normal(3))
    world.tags.add("GNSS vectors")
    for p in [*names, *names[:1]]:
        d = world.points[p].xyz - world.points["G0"].xyz + world.sigma_length * draw.standard_normal(3)
        world.vectors.append(("G0", p, *map(float, d)))


def _bearings(world: World, draw: Generator) -> None:
    a, b = _some(world, draw, 2)
    d = world.points[b].xyz - world.points[a].xyz
    world.bearings.append((a, b, float(np.arctan2(d[0], d[1]) + 1e-4 * draw.standard_normal())))
    world.tags.add("bearing")


def _datum(world: World, draw: Generator) -> None:
    kind = str(draw.choice(["free", "full control", "2 full, 1 height", "3 plan, 3 height"], p=[0.4, 0.36, 0.12, 0.12]))
    world.tags.add(f"datum {kind}")
    if kind == "free":
        if draw.random() < 0.6 and world.images:
            for a, b in [_some(world, draw, 2) for _ in range(int(draw.integers(1, 4)))]:
                length = np.linalg.norm(world.points[a].xyz - world.points[b].xyz)
                world.distances.append((a, b, float(length + world.sigma_length * draw.standard_normal()), 0.0))
            world.tags.add("bars")
        return
    world.free = False
    far = int(draw.integers(len(FAR)))
    world.tags.add(f"control {('near', '4 km away', '5000 km away')[far]}")
    _shift(world, np.array(FAR[far]))
    sigma = float(draw.choice([0.0, world.sigma_length]))
    names = _some(world, draw, 6)
    patterns = {
        "full control": ["xyz"] * int(draw.integers(3, 6)),
        "2 full, 1 height": ["xyz", "xyz", "z"],
        "3 plan, 3 height": ["xy", "xy", "xy", "z", "z", "z"],
    }[kind]
    for p, pattern in zip(names, patterns, strict=False):
        point = world.points[p]
        point.sigma = [sigma if axis in pattern else None for axis in "xyz"]


def _shift(world: World, by: FloatArray) -> None:
    for point in world.points.values():
        point.xyz = point.xyz + by
    for image in world.images.values():
        image.centre = image.centre + by
    world.systems = {n: (o + by, D, s, free) for n, (o, D, s, free) in world.systems.items()}


def wrong_identities(world: World, share: float) -> None:
    """Exchange the names of two points in an image or at a station, until a share of all sights is wrong."""
    draw = np.random.default_rng(world.seed + 1)
    for rows in (world.rays, world.directions):
        for _ in range(round(0.5 * share * len(rows))):
            i = int(draw.integers(len(rows)))
            others = [
                k for k, row in enumerate(rows) if row[0] == rows[i][0] and k != i and row[1][0] == rows[i][1][0] == "P"
            ]
            if others:
                k = int(draw.choice(others))
                rows[i], rows[k] = (
                    (*rows[i][:1], rows[k][1], *rows[i][2:]),
                    (*rows[k][:1], rows[i][1], *rows[k][2:]),
                )
