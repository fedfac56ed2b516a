"""What is surveyed: objects of many sizes and forms, in units and at origins of their own."""

from __future__ import annotations

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.survey import LENGTHS, Mark, Survey

KINDS = {
    "machine": (0.2, 2.0, ("mm", "mm", "um", "m", "cm")),
    "building": (8.0, 60.0, ("m", "m", "ft", "cm")),
    "room": (4.0, 15.0, ("m", "mm")),
    "facade": (5.0, 40.0, ("m", "ft")),
    "site": (80.0, 500.0, ("m", "ft")),
    "valley": (1000.0, 6000.0, ("m", "km")),
}
ORIGINS = (
    (0.0, 0.0, 0.0),
    (1000.0, 2000.0, 100.0),
    (-300.0, 50.0, -800.0),
    (3500000.0, 5400000.0, 450.0),
    (-200.0, -100.0, -5.0),
)


def scene(seed: int) -> Survey:
    """A survey with its object points and nothing measured."""
    draw = np.random.default_rng([seed, 77])
    kind = str(draw.choice(list(KINDS)))
    low, high, units = KINDS[kind]
    size = float(np.exp(draw.uniform(np.log(low), np.log(high))))
    length = str(draw.choice(units))
    place = int(draw.integers(len(ORIGINS)))
    origin = np.array(ORIGINS[place if kind in ("building", "site", "valley") else min(place, 2)])
    if kind in ("machine", "room"):
        origin = origin * size / 1000.0
    precise = float(10.0 ** draw.uniform(-5.0, -4.0))
    survey = Survey(
        seed, draw, size, length, str(draw.choice(["gon", "deg", "rad", "mrad"])), origin,
        precise * size, float(draw.uniform(3e-6, 2e-5)),
    )  # fmt: skip
    survey.tags |= {kind, f"in {length}", "far origin" if np.abs(origin).max() > 100.0 * size else "origin"}
    _points(survey, kind)
    return survey


def _points(survey: Survey, kind: str) -> None:
    draw, count = survey.draw, int(survey.draw.integers(16, 70))
    by = draw.choice(["both", "images", "stations"], count, p=[0.65, 0.25, 0.1])
    for k in range(count):
        xyz = survey.size * _place(survey, kind)
        survey.marks[f"{k + 1:03d}" if survey.seed % 2 else f"{'PRT'[k % 3]}{k}"] = Mark(
            xyz, str(by[k]), float(draw.uniform(0.35, 1.0))
        )


def _place(survey: Survey, kind: str) -> FloatArray:
    u, v, w = survey.draw.uniform(-0.5, 0.5, 3)
    if kind == "facade":
        return np.array([u, 0.04 * survey.draw.choice([0.0, 0.0, w]), 0.6 * v])
    if kind == "room":
        wall = int(survey.draw.integers(6))
        side = 0.5 if wall % 2 else -0.5
        x, y, z = np.insert([u, v], wall // 2, side)
        return np.array([x, 0.8 * y, 0.4 * z])
    if kind == "valley":
        return np.array([u, 0.7 * v, 0.3 * v * v + 0.05 * w])
    if kind == "site":
        return np.array([u, v, 0.1 * w])
    return np.array([u, 0.7 * v, 0.5 * w])


def write_points(survey: Survey) -> None:
    """The table of points: what is given of them, and start values."""
    for name, mark in survey.marks.items():
        xyz = survey.origin + mark.xyz
        cells: dict[str, object] = {"id": name}
        for axis, value in zip("xyz", xyz, strict=True):
            sigma = mark.control.get(axis)
            rough = value + mark.rough * survey.draw.standard_normal() if mark.rough else None
            cells[axis] = survey.start(value, rough) if sigma is None else _observed(survey, value, sigma)
            cells[f"sigma_{axis}"] = "" if sigma is None else survey.in_length(sigma)
        survey.row("points", "points", {}, **cells)  # type: ignore[arg-type]


def _observed(survey: Survey, value: float, sigma: float) -> float:
    return survey.in_length(value + sigma * survey.draw.standard_normal())


__all__ = ["KINDS", "LENGTHS", "scene", "write_points"]
