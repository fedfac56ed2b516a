"""Seeded mixtures of images, stations and control with planted things that nothing determines.

Two projects come out of a seed: the sound one, whose adjustment is the truth, and the same with what was planted. With
``undetermined: leave_out`` the second must give the first's numbers, and name what was planted, no more and no less.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

C = 28.0
HEAD = """\
mor: 1
cameras:
  K: {{interior: {{c: {c}}}}}
images:
  - {{file: images.csv}}
points:
  - {{file: control.csv, fixed: [x, y, z]}}
  - {{file: points.csv}}
stations:
  - {{file: stations.csv}}
observations:
  - {{type: image, file: rays.csv, values: {{sigma: 2 um}}}}
  - {{type: directions, file: directions.csv, values: {{sigma: 1 mgon}}}}
  - {{type: distance, file: distances.csv, values: {{sigma: 2 mm}}}}
datum: {datum}
settings: {{undetermined: {undetermined}, sigma: apriori}}
"""
KINDS = ("far", "unobserved", "one ray", "poor image", "poor station", "hinged", "island")


@dataclass
class World:
    """Everything measured, as rows of tables."""

    random: np.random.Generator
    free: bool
    given: bool
    """True where start values are given."""
    points: dict[str, np.ndarray] = field(default_factory=dict)
    control: dict[str, np.ndarray] = field(default_factory=dict)
    images: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    stations: dict[str, np.ndarray] = field(default_factory=dict)
    rays: list[tuple[str, str, float, float]] = field(default_factory=list)
    directions: list[tuple[str, str, float, str]] = field(default_factory=list)
    distances: list[tuple[str, str, float]] = field(default_factory=list)

    def place(self, name: str) -> np.ndarray:
        """Coordinates of a point."""
        return self.points[name] if name in self.points else self.control[name]

    def ray(self, image: str, name: str, toward: np.ndarray | None = None) -> None:
        """An image measures a point, or a direction at infinity."""
        centre, D = self.images[image]
        star = D @ (toward if toward is not None else self.place(name) - centre)
        xy = -C * star[:2] / star[2] + 0.002 * self.random.standard_normal(2)
        self.rays.append((image, name, *map(float, xy)))

    def sight(self, station: str, name: str, horizontal_only: bool = False) -> None:
        """A levelled station of orientation zero sights a point."""
        away = self.place(name) - self.stations[station]
        horizontal = np.arctan2(away[0], away[1]) + 1.6e-5 * self.random.standard_normal()
        vertical = np.arctan2(away[2], np.hypot(*away[:2])) + 1.6e-5 * self.random.standard_normal()
        gon = 200.0 / np.pi
        second = "" if horizontal_only else repr(float(vertical * gon))
        self.directions.append((station, name, float(horizontal * gon % 400.0), second))

    def tape(self, one: str, other: str) -> None:
        """A distance between two points."""
        length = np.linalg.norm(self.place(one) - self.place(other)) + 0.002 * self.random.standard_normal()
        self.distances.append((one, other, float(length)))


def camera(centre: np.ndarray, target: np.ndarray, roll: float) -> np.ndarray:
    """D of a camera at ``centre`` that looks at ``target``."""
    back = (centre - target) / np.linalg.norm(centre - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    D = np.stack([right, np.cross(back, right), back])
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ D


def angles(D: np.ndarray) -> tuple[float, float, float]:
    """ω, φ, κ in gon of D = (Rx Ry Rz)ᵀ."""
    R, gon = D.T, 200.0 / np.pi
    return (
        float(np.arctan2(-R[1, 2], R[2, 2]) * gon),
        float(np.arcsin(R[0, 2]) * gon),
        float(np.arctan2(-R[0, 1], R[0, 0]) * gon),
    )


def sound(seed: int) -> World:
    """A mixture that its observations determine well."""
    random = np.random.default_rng(seed)
    world = World(random, free=bool(random.integers(2)), given=bool(random.integers(2)))
    count = int(random.integers(25, 60))
    for k in range(count):
        place = random.uniform([-5, -3, 0], [5, 3, 4])
        is_control = not world.free and k < 5
        (world.control if is_control else world.points)[f"P{k}"] = place
    names = [*world.control, *world.points]
    for k in range(int(random.integers(4, 9))):
        turn = 2.0 * np.pi * (k + random.uniform(-0.2, 0.2)) / 9.0
        centre = np.array([14.0 * np.sin(turn), -14.0 * np.cos(turn), random.uniform(0.0, 5.0)])
        world.images[f"I{k}"] = (centre, camera(centre, np.array([0.0, 0.0, 2.0]), random.uniform(-1.5, 1.5)))
        for name in names:
            if random.random() < 0.85:
                world.ray(f"I{k}", name)
    for k in range(int(random.integers(0, 3))):
        world.stations[f"S{k}"] = random.uniform([-12, 9, 0], [12, 13, 2])
        for name in random.choice(names, 12, replace=False):
            world.sight(f"S{k}", str(name))
    for _ in range(3):
        world.tape(*(str(name) for name in random.choice(names, 2, replace=False)))
    return world


def planted(world: World, kinds: tuple[str, ...]) -> dict[tuple[str, str], str]:
    """Plant things of these kinds; returned is (kind, name) of each, and how it was planted."""
    random, found = world.random, {}
    names = [*world.control, *world.points]
    for kind in kinds:
        if kind == "far":
            for name in (f"FAR{k}" for k in range(int(random.integers(1, 4)))):
                _far(world, name)
                found["point", name] = kind
        elif kind == "unobserved":
            world.points["LISTED"] = random.uniform(-5, 5, 3)
            found["point", "LISTED"] = kind
        elif kind == "one ray":
            for name in (f"ONCE{k}" for k in range(int(random.integers(1, 9)))):
                world.points[name] = random.uniform([-4, -3, 0], [4, 3, 4])
                world.ray(str(random.choice(list(world.images))), name)
                found["point", name] = kind
        elif kind == "poor image":
            centre = np.array([1.0, -15.0, 3.0])
            world.images["POOR"] = (centre, camera(centre, np.array([0.0, 0.0, 2.0]), 0.3))
            for name in random.choice(names, 2, replace=False):
                world.ray("POOR", str(name))
            found["image", "POOR"] = kind
        elif kind == "poor station":
            world.stations["LONELY"] = np.array([3.0, 12.0, 1.0])
            for name in random.choice(names, 2, replace=False):
                world.sight("LONELY", str(name), horizontal_only=True)
            found["station", "LONELY"] = kind
        elif kind == "hinged":
            world.points["HINGED"] = random.uniform([-4, -3, 0], [4, 3, 4])
            for name in random.choice(names, 2, replace=False):
                world.tape("HINGED", str(name))
            found["point", "HINGED"] = kind
        elif kind == "island":
            island = [f"ISLE{k}" for k in range(5)]
            for name in island:
                world.points[name] = random.uniform([20, 20, 0], [24, 24, 3])
            for k, one in enumerate(island):
                for other in island[:k]:
                    world.tape(one, other)
            found |= {("point", name): kind for name in island}
    return found


def _far(world: World, name: str) -> None:
    """A point some 10 000 km away in the view of two images of the world."""
    pairs = [(a, b) for a in world.images for b in world.images if a < b and "POOR" not in (a, b)]
    for k in world.random.permutation(len(pairs)):
        a, b = pairs[k]
        middle = -(world.images[a][1][2] + world.images[b][1][2])
        toward = middle / np.linalg.norm(middle) + 0.03 * world.random.standard_normal(3)
        if all((world.images[i][1] @ toward)[2] < -0.5 * np.linalg.norm(toward) for i in (a, b)):
            break
    world.points[name] = world.images[a][0] + 1e7 * toward
    for image in (a, b):
        world.ray(image, name, toward)


def write(folder: Path, world: World, undetermined: str) -> Path:
    """The project of a world."""
    folder.mkdir(parents=True, exist_ok=True)

    def start(name: str, place: np.ndarray) -> str:
        rough = np.random.default_rng(crc32(name.encode()))
        return ",".join(f"{x:.6f}" for x in place + 0.02 * rough.standard_normal(3)) if world.given else ",,"

    def pose(image: str) -> str:
        centre, D = world.images[image]
        turns = ",".join(f"{x:.4f}" for x in angles(D)) if world.given else ",,"
        return f"{image},K,{start(image, centre)},{turns}"

    stations = {n: f"{n},{start(n, p)},{'0.01' if world.given else ''}" for n, p in world.stations.items()}
    tables = {
        "control": [
            "id,x,y,z",
            *(f"{n},{','.join(map(repr, p.tolist()))}" for n, p in world.control.items()),
        ],
        "points": ["id,x,y,z", *(f"{n},{start(n, p)}" for n, p in world.points.items())],
        "images": ["id,camera,x,y,z,omega,phi,kappa", *map(pose, world.images)],
        "stations": ["id,x,y,z,orientation", *stations.values()],
        "rays": ["image,point,x,y", *(f"{i},{p},{x!r},{y!r}" for i, p, x, y in world.rays)],
        "directions": [
            "station,to,horizontal,vertical",
            *(f"{s},{p},{h!r},{v}" for s, p, h, v in world.directions),
        ],
        "distances": ["from,to,distance", *(f"{a},{b},{d!r}" for a, b, d in world.distances)],
    }
    text = HEAD.format(c=C, datum="free" if world.free else "fixed", undetermined=undetermined)
    for name, lines in tables.items():
        if len(lines) > 1:
            (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
        else:
            text = "\n".join(line for line in text.splitlines() if f"{name}.csv" not in line) + "\n"
    text = text.replace("stations:\nobservations", "observations")
    project = folder / "project.yaml"
    project.write_text(text)
    return project
