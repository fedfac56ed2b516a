"""Seeded networks of several epochs with known movements, as projects: theodolites, distances, levelling."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.api.pipeline import read_network, solve_network
from mor.project.document import read_yaml
from mor.quality.solution import Solved

SIGMA_S, SIGMA_H, SIGMA_A = 0.0005, 0.0003, 0.3e-3 * np.pi / 200.0
GON = np.pi / 200.0


@dataclass
class Scene:
    """True coordinates and movements of points seen from two stations over fixed pillars, at given times (years)."""

    times: list[float]
    points: dict[str, np.ndarray]
    velocity: dict[str, np.ndarray] = field(default_factory=dict)
    sine: dict[str, np.ndarray] = field(default_factory=dict)
    cosine: dict[str, np.ndarray] = field(default_factory=dict)
    steps: dict[str, tuple[float, np.ndarray]] = field(default_factory=dict)

    @property
    def pillars(self) -> dict[str, np.ndarray]:
        """Fixed places."""
        return {
            "A": np.array([0.0, 0.0, 10.0]),
            "B": np.array([60.0, -5.0, 12.0]),
            "C": np.array([30.0, 70.0, 15.0]),
        }

    def at(self, name: str, time: float) -> np.ndarray:
        """Where a point is."""
        if name in self.pillars:
            return self.pillars[name]
        zero, turn = np.zeros(3), 2.0 * np.pi * time
        place = self.points[name] + (time - self.times[0]) * self.velocity.get(name, zero)
        place = place + np.sin(turn) * self.sine.get(name, zero) + np.cos(turn) * self.cosine.get(name, zero)
        step = self.steps.get(name)
        return place + (step[1] if step is not None and time >= step[0] else 0.0)


def scene(count: int = 4, epochs: int = 5, per_year: float = 0.7, seed: int = 1) -> Scene:
    """Points in front of the pillars, without any movement yet."""
    random = np.random.default_rng(seed)
    points = {f"D{k}": random.uniform([10, 20, 8], [50, 50, 25]) for k in range(1, count + 1)}
    return Scene([2015.0 + per_year * k for k in range(epochs)], points)


def observations(truth: Scene, random: np.random.Generator, chosen: list[int] | None = None) -> str:
    """Tables of what is measured in the chosen epochs: directions, zenith angles, distances, levelling."""
    tables = []
    for number in chosen if chosen is not None else range(len(truth.times)):
        time = truth.times[number]
        names = [*truth.points]
        directions, distances, heights = [], [], []
        for station in ("A", "B", "C"):
            zero = random.uniform(0.0, 2.0 * np.pi)
            for name in [*truth.pillars, *names]:
                if name == station:
                    continue
                d = truth.at(name, time) - truth.at(station, time)
                h = np.arctan2(d[0], d[1]) - zero + SIGMA_A * random.standard_normal()
                z = np.arctan2(np.hypot(d[0], d[1]), d[2]) + SIGMA_A * random.standard_normal()
                s = np.linalg.norm(d) + SIGMA_S * random.standard_normal()
                directions.append(
                    [station, f"e{number}", name, repr(float(h % (2 * np.pi) / GON)), repr(float(z / GON))]
                )
                distances.append([station, name, repr(float(s))])
        for one, other in zip(["A", *names], [*names, "B"], strict=True):
            dz = truth.at(other, time)[2] - truth.at(one, time)[2] + SIGMA_H * random.standard_normal()
            heights.append([one, other, repr(float(dz))])
        epoch = f"epoch: {time!r}"
        tables += [
            f"  - {{type: zenith_directions, name: theodolite {number}, "
            "columns: [station, set, to, horizontal, zenith], "
            f"values: {{sigma: {float(SIGMA_A / GON)!r}, {epoch}}},\n     rows: {_rows(directions)}}}",
            f"  - {{type: distance, name: distances {number}, columns: [from, to, distance], "
            f"values: {{sigma: {SIGMA_S}, {epoch}}},\n     rows: {_rows(distances)}}}",
            f"  - {{type: height_difference, name: levelling {number}, columns: [from, to, dz], "
            f"values: {{sigma: {SIGMA_H}, {epoch}}},\n     rows: {_rows(heights)}}}",
        ]
    return "\n".join(tables)


def _rows(rows: list[list[str]]) -> str:
    return "[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]"


def project(
    truth: Scene, motions: str, random: np.random.Generator, chosen: list[int] | None = None, more: str = ""
) -> str:
    """The text of a project; ``motions`` are the entries of its section."""
    pillars = [[name, *map(repr, map(float, place))] for name, place in truth.pillars.items()]
    points = [[name, *map(repr, map(float, place.round(2)))] for name, place in truth.points.items()]
    section = f"motions:\n{motions}\n" if motions else ""
    return (
        "mor: 1\n"
        f"points:\n  - {{columns: [id, x, y, z], fixed: [x, y, z], rows: {_rows(pillars)}}}\n"
        f"  - {{columns: [id, x, y, z], rows: {_rows(points)}}}\n"
        f"{section}{more}observations:\n{observations(truth, random, chosen)}\n"
    )


def solve(text: str) -> Solved:
    """Adjust the text of a project."""
    return solve_network(read_network(read_yaml(text, "project.yaml"), Path(".")))


def values(solved: Solved, kind: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Adjusted block of a point, and its σ a priori."""
    assert solved.quality is not None
    part = "position" if kind == "point" else kind
    block = solved.network.things["point"].part(name, part)
    q = solved.quality.cofactors[kind][block]
    return solved.adjustment.values[kind][block], np.sqrt(np.diag(q))
