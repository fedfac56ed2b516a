"""Random blocks and networks with gross errors of every kind, their truth known: what a robust adjustment must bear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mor.model.rotations import rotate
from mor.solve.problem import Problem
from mor.types import BoolArray, FloatArray
from tests.scenarios.scenes import Scene, looking_at

GON = np.pi / 200.0


class Spoiled(NamedTuple):
    """A problem with gross errors, its truth, and where they are."""

    kind: str
    problem: Problem
    truth: dict[str, FloatArray]
    wrong: tuple[BoolArray, ...]
    """(n, m) of each group: what was spoiled."""
    points: list[str]
    angles: tuple[str, ...]


def close_range(random: np.random.Generator) -> tuple[Scene, list[str], bool]:
    """Images from all sides around a cloud of points; free, some with scale bars."""
    scene, extent = Scene(), 5.0
    places = random.uniform(-extent / 2, extent / 2, (int(random.integers(20, 45)), 3))
    points = [scene.add("point", f"P{i}", xyz) for i, xyz in enumerate(places)]
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=False)
    for k in range(int(random.integers(6, 12))):
        place = random.standard_normal(3) * [1.0, 1.0, 0.5]
        place *= random.uniform(1.6, 2.5) * extent / np.linalg.norm(place)
        _image(scene, f"I{k}", place, random.uniform(-0.5, 0.5, 3), points, random, 0.85)
    for _ in range(int(random.integers(0, 4))):
        one, other = random.choice(len(points), 2, replace=False)
        scene.observe("distance", points[one], None, points[other], None, sigma=1e-4)
    return scene, points, True


def aerial(random: np.random.Generator) -> tuple[Scene, list[str], bool]:
    """A block of overlapping vertical images, with a few control points."""
    scene, rows, columns = Scene(), int(random.integers(2, 4)), int(random.integers(4, 7))
    places = random.uniform([-60, -60, -20], [(columns - 1) * 70 + 60, (rows - 1) * 80 + 60, 20], (110, 3))
    seen = _seen(places, rows, columns)
    places = places[seen >= 3]
    corners = [np.argmin(np.abs(places[:, :2] - corner).sum(axis=1)) for corner in _corners(places)]
    points = [
        scene.add("point", f"P{i}", xyz, free=i not in corners or (False, False, False)) for i, xyz in enumerate(places)
    ]
    for i in corners:
        scene.free["point"][f"P{i}"] = np.zeros(3, dtype=bool)
    scene.add("interior/mor", "camera", [100.0, *[0.0] * 9], free=False)
    for r in range(rows):
        for c in range(columns):
            at = np.array([c * 70.0, r * 80.0, 160.0]) + 3.0 * random.standard_normal(3)
            here = [p for p, xyz in zip(points, places, strict=True) if np.abs(xyz[:2] - at[:2]).max() < 105.0]
            target = at - [0.0, 0.0, 160.0] + 6.0 * random.standard_normal(3)
            _image(scene, f"I{r}{c}", at, target, here, random, 1.0)
    return scene, points, False


def _seen(places: FloatArray, rows: int, columns: int) -> FloatArray:
    """(n,) of how many images of an aerial block a point lies well inside."""
    at = np.array([[70.0 * c, 80.0 * r] for r in range(rows) for c in range(columns)])
    inside = np.abs(places[:, None, :2] - at).max(axis=2) < 95.0
    count: FloatArray = inside.sum(axis=1).astype(float)
    return count


def _corners(places: FloatArray) -> list[tuple[float, float]]:
    low, high = places.min(axis=0), places.max(axis=0)
    middle = 0.5 * (low + high)
    return [
        (low[0], low[1]),
        (high[0], low[1]),
        (low[0], high[1]),
        (high[0], high[1]),
        (middle[0], middle[1]),
    ]


def plane(random: np.random.Generator) -> tuple[Scene, list[str], bool]:
    """Directions and distances between points in the plane, free."""
    scene, count = Scene(), int(random.integers(8, 16))
    places = random.uniform(0.0, 1000.0, (count, 2))
    names = [scene.add("point", f"N{i}", [*xy, 0.0], free=(True, True, False)) for i, xy in enumerate(places)]
    for i, start in enumerate(names):
        scene.add("rotation", start, [0.0, 0.0, random.uniform(-3.0, 3.0)], free=(False, False, True))
        near = np.argsort(np.linalg.norm(places - places[i], axis=1))[1:8]
        for j in near:
            scene.observe("directions", start, start, None, names[j], sigma=(1e-5, 1e-5), only=(0,))
            scene.observe("horizontal_distance", start, None, names[j], None, sigma=3e-3)
    return scene, names, True


def space(random: np.random.Generator) -> tuple[Scene, list[str], bool]:
    """Total stations in space: directions, zenith angles and slope distances to points around; free."""
    scene = Scene()
    points = [
        scene.add("point", f"P{i}", xyz)
        for i, xyz in enumerate(random.uniform([-60, -60, -15], [60, 60, 15], (int(random.integers(12, 25)), 3)))
    ]
    for k in range(int(random.integers(5, 8))):
        station = scene.add("point", f"S{k}", random.uniform([-90, -90, -4], [90, 90, 4]))
        scene.add("rotation", station, [0.0, 0.0, random.uniform(-3, 3)], free=(False, False, True))
        _sights(scene, station, points, random)
    return scene, points, True


def mixture(random: np.random.Generator) -> tuple[Scene, list[str], bool]:
    """Images, levelled total stations and height differences of one object; free."""
    scene, points, _ = close_range(random)
    for k in range(3):
        turn = 2.0 * np.pi * (k + random.uniform(0.0, 0.5)) / 3.0
        station = scene.add("point", f"S{k}", [9.0 * np.cos(turn), 9.0 * np.sin(turn), random.uniform(-1, 1)])
        scene.add("rotation", station, [0.0, 0.0, random.uniform(-3, 3)], free=(False, False, True))
        _sights(scene, station, points[: len(points) // 2], random)
    for one, other in pairwise(points[:7]):
        scene.observe("height_difference", one, None, other, None, sigma=5e-4)
    return scene, points, True


KINDS: dict[str, Callable[[np.random.Generator], tuple[Scene, list[str], bool]]] = {
    "close range": close_range,
    "aerial": aerial,
    "plane": plane,
    "space": space,
    "mixture": mixture,
}


def _image(
    scene: Scene,
    name: str,
    place: FloatArray,
    target: FloatArray,
    points: list[str],
    random: np.random.Generator,
    seen: float,
) -> None:
    scene.add("point", name, place)
    scene.add("rotation", name, looking_at(place, target + 1e-3, roll=random.uniform(-3, 3)))
    for point in points:
        if random.random() < seen:
            scene.observe("image/mor", name, name, None, None, "camera", point, sigma=1e-3)


def _sights(scene: Scene, station: str, points: list[str], random: np.random.Generator) -> None:
    for point in points:
        if random.random() < 0.9:
            names = (station, station, None, point)
            scene.observe("zenith_directions", *names, sigma=(2e-5, 3e-5), constants=(6_371_000.0, 1.0))
            scene.observe("distance", station, None, point, None, sigma=1e-3)


def spoiled(seed: int, kind: str, part: float) -> Spoiled:
    """A scene of a kind in which a part of all rows (one at least) is wrong."""
    random = np.random.default_rng([seed, int(1e6 * part), list(KINDS).index(kind)])
    scene, points, free = KINDS[kind](random)
    problem = scene.problem(random, points if free else None)
    groups, wrong = list(problem.groups), []
    counts = [group.count for group in groups]
    total = max(1, round(part * sum(counts))) if part else 0
    chosen = np.sort(random.choice(sum(counts), total, replace=False))
    first = 0
    for number, group in enumerate(groups):
        rows = chosen[(chosen >= first) & (chosen < first + group.count)] - first
        first += group.count
        before = group.observed.copy()
        groups[number] = group = _spoil(group, rows, random)
        with np.errstate(invalid="ignore"):
            wrong.append(np.abs(group.observed - before) > 1e-12 * np.abs(before))
    angles = tuple(scene.truth.get("rotation", {}))
    return Spoiled(kind, replace(problem, groups=tuple(groups)), scene.values(), tuple(wrong), points, angles)


def _spoil(group, rows, random):  # type: ignore[no-untyped-def]
    observed = group.observed.copy()
    for row in rows:
        if "image" in group.type.key and random.random() < 0.5:
            same = np.flatnonzero(group.blocks[0] == group.blocks[0][row])
            other = int(random.choice(same))
            observed[[row, other]] = observed[[other, row]]  # two names exchanged in one image
            continue
        largest = np.pi if group.type.wraps.any() else 0.5 * np.abs(observed[row]).max(initial=0.1)
        seen = np.flatnonzero(np.isfinite(observed[row]))
        which = seen if random.random() < 0.3 else random.choice(seen, 1)
        for component in which:
            sigma = group.sigma[row, component]
            size = np.exp(random.uniform(np.log(5.0), np.log(max(largest / sigma, 10.0))))
            observed[row, component] += random.choice([-1.0, 1.0]) * size * sigma
    return replace(group, observed=observed)


def names_exchanged(seed: int, kind: str) -> Spoiled:
    """A scene without other gross errors in which two names of one image are exchanged."""
    scene = spoiled(seed, kind, 0.0)
    random = np.random.default_rng([seed, 7])
    groups = list(scene.problem.groups)
    number = next(k for k, group in enumerate(groups) if "image" in group.type.key)
    group = groups[number]
    row = int(random.integers(group.count))
    same = np.flatnonzero(group.blocks[0] == group.blocks[0][row])
    other = int(random.choice(same[same != row]))
    observed = group.observed.copy()
    observed[[row, other]] = observed[[other, row]]
    groups[number] = replace(group, observed=observed)
    return scene._replace(problem=replace(scene.problem, groups=tuple(groups)))


def disturbed(scene: Spoiled, random: np.random.Generator, part: float, angle: float) -> dict[str, FloatArray]:
    """Start values: coordinates off by up to ``part`` of the extent of the points, attitudes by up to ``angle``."""
    values = {kind: array.copy() for kind, array in scene.truth.items()}
    index = scene.problem.index
    size = part * float(np.ptp(values["point"][: len(scene.points)], axis=0).max())
    free = index.columns["point"] >= 0
    values["point"] += size * random.uniform(-1.0, 1.0, free.shape) * free
    if "rotation" in values:
        free = index.columns["rotation"] >= 0
        values["rotation"] = rotate(values["rotation"], angle * random.uniform(-1.0, 1.0, free.shape) * free)
    return values
