"""Mistakes planted into mixtures of everything: worlds as ``tests.scenarios.mixtures`` makes them, seeded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.scenarios.mixtures.world import World
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted, one_of

Random = np.random.Generator


def _frame(rows: list, random: Random, least: int = 5) -> str:
    names = sorted({row[0] for row in rows})
    return str(one_of(random, [name for name in names if sum(row[0] == name for row in rows) >= least]))


def _exchange(rows: list, frame: str, random: Random) -> set[str]:
    here = [k for k, row in enumerate(rows) if row[0] == frame and row[1].startswith("P")]
    if len(here) < 2:
        raise NotHereError
    i, k = (int(n) for n in random.choice(here, 2, replace=False))
    rows[i], rows[k] = (rows[i][0], rows[k][1], *rows[i][2:]), (rows[k][0], rows[i][1], *rows[k][2:])
    if rows[i][1] == rows[k][1]:
        raise NotHereError
    return {frame, rows[i][1], rows[k][1]}


def names_in_image(world: World, random: Random) -> Planted:
    return Planted(("names exchanged",), _exchange(world.rays, _frame(world.rays, random), random))


def names_at_station(world: World, random: Random) -> Planted:
    return Planted(("names exchanged",), _exchange(world.directions, _frame(world.directions, random), random))


def set_ups(world: World, random: Random) -> Planted:
    names = sorted(world.stations)
    if len(names) < 2:
        raise NotHereError
    one, other = (str(name) for name in random.choice(names, 2, replace=False))
    a, b = world.stations[one], world.stations[other]
    if {(row[0], row[1]) for row in world.directions} & {(one, b.over), (other, a.over)}:
        raise NotHereError  # an instrument would see itself
    a.over, b.over = b.over, a.over
    return Planted(("set-ups exchanged",), {one, other})


def _circle(world: World, random: Random) -> tuple[list[int], set[str]]:
    if not world.directions:
        raise NotHereError
    alone = len({row[0] for row in world.directions}) == 1  # then the station and the table are the same
    if random.random() < 0.5 or alone:
        return list(range(len(world.directions))), set()
    frame = _frame(world.directions, random, 3)
    return [k for k, row in enumerate(world.directions) if row[0] == frame], {frame}


def sense(world: World, random: Random) -> Planted:
    rows, things = _circle(world, random)
    for k in rows:
        a, b, horizontal, *rest = world.directions[k]
        world.directions[k] = (a, b, -horizontal % (2.0 * np.pi), *rest)
    return Planted(("circle sense",), things)


def elevations(world: World, random: Random) -> Planted:
    rows, things = _circle(world, random)
    if all(np.isnan(world.directions[k][3]) for k in rows):
        raise NotHereError
    for k in rows:
        a, b, horizontal, zenith, *rest = world.directions[k]
        world.directions[k] = (a, b, horizontal, (0.5 * np.pi - zenith) % (2.0 * np.pi), *rest)
    return Planted(("elevation for zenith",), things)


def face(world: World, random: Random) -> Planted:
    frame = _frame(world.directions, random, 6)
    here = [k for k, row in enumerate(world.directions) if row[0] == frame]
    for k in random.choice(here, int(random.integers(1, 3)), replace=False):
        a, b, horizontal, *rest = world.directions[k]
        world.directions[k] = (a, b, (horizontal + np.pi) % (2.0 * np.pi), *rest)
    return Planted(("face",), {frame})


def levelling(world: World, random: Random) -> Planted:
    k = int(one_of(random, range(len(world.level_lines))))
    a, b, dz = world.level_lines[k]
    world.level_lines[k] = (a, b, -dz)
    return Planted(("levelling sign",), {a, b})


def vectors(world: World, random: Random) -> Planted:
    k = int(one_of(random, range(len(world.vectors))))
    a, b, *d = world.vectors[k]
    world.vectors[k] = (b, a, *d)
    return Planted(("vector sign",), {a, b})


def antenna(world: World, random: Random) -> Planted:
    name = str(one_of(random, sorted({row[1] for row in world.vectors})))
    by = 0.03 * world.size * float(random.uniform(0.5, 1.5))
    world.vectors = [(a, b, dx, dy, dz + by * (b == name)) for a, b, dx, dy, dz in world.vectors]
    return Planted(("antenna height", "vector sign"), {name})


def offset(world: World, random: Random) -> Planted:
    if len(world.distances) < 4:
        raise NotHereError
    by = 0.02 * world.size * float(random.choice([-1.0, 1.0]))
    world.distances = [(a, b, d + by, *rest) for a, b, d, *rest in world.distances]
    return Planted(("distance offset",), set())


def feet(world: World, random: Random) -> Planted:
    if len(world.distances) < 4:
        raise NotHereError
    world.distances = [(a, b, d / 0.3048, *rest) for a, b, d, *rest in world.distances]
    return Planted(("table unit", "distance scale"), set())


def instrument_height(world: World, random: Random) -> Planted:
    name = str(one_of(random, sorted(world.stations)))
    world.stations[name].height += float(random.choice([-1.0, 1.0])) * 0.05 * world.size
    return Planted(("instrument height",), {name})


def focal_length(world: World, random: Random) -> Planted:
    if not world.images:
        raise NotHereError
    factor = float(random.uniform(1.1, 1.4) ** random.choice([-1, 1]))
    world.rays = [(i, p, factor * x, factor * y) for i, p, x, y in world.rays]
    return Planted(("image scale", "image unit"), {"c"})


def flipped(world: World, random: Random) -> Planted:
    if not world.images:
        raise NotHereError
    world.rays = [(i, p, x, -y) for i, p, x, y in world.rays]
    mirrored = not (world.directions or world.level_lines or world.vectors or world.local or world.bearings)
    # images of a mirrored object: without anything else the axes of the control may as well be exchanged
    return Planted(("image flipped", "axes exchanged"), set()) if mirrored else Planted(("image flipped",), {"c"})


def control_moved(world: World, random: Random) -> Planted:
    name = str(one_of(random, sorted(n for n, p in world.points.items() if all(s is not None for s in p.sigma))))
    by = np.zeros(3)
    by[int(random.integers(3))] = 0.05 * world.size
    for key, point in list(world.points.items()):
        if key == name:
            point.xyz = point.xyz + by
    return Planted(("control moved",), {name})


KINDS: dict[str, Callable[[World, Random], Planted]] = {
    function.__name__: function
    for function in (
        names_in_image,
        names_at_station,
        set_ups,
        sense,
        elevations,
        face,
        levelling,
        vectors,
        antenna,
        offset,
        feet,
        instrument_height,
        focal_length,
        flipped,
        control_moved,
    )
}
