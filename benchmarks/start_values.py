"""Success and error of the start values on seeded random scenes: prints a table.

Run as ``python benchmarks/start_values.py [scenes [first seed]]``; 1000 scenes per line take a few minutes on one core.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from mor.start.bundle import image_bundle, similarity
from mor.start.free_station import free_station_level
from mor.start.image_pair import relative_orientation, robust_relative_orientation
from mor.start.intersection import intersect
from mor.start.plane_object import shape_of_plane
from mor.start.relative_orientation import adjust_coplanarity
from mor.start.resection import Pose, adjust_pose, resect

NOISES = (0.0, 0.001, 0.005)
Trial = tuple[str, float, bool]
"""Name of the outcome, error, and whether the strict solution was returned."""


def simulators() -> ModuleType:
    """Scenes are those of the tests."""
    path = Path(__file__).parents[1] / "tests" / "approximate" / "conftest.py"
    spec = importlib.util.spec_from_file_location("scenes_of_the_tests", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


S = simulators()


def away(one: Any, base: np.ndarray, rotation: np.ndarray) -> float:
    """Error of an orientation in radians: direction of the base and rotation together."""
    turn = np.linalg.norm(one.rotation - rotation) / np.sqrt(2.0)
    return float(np.hypot(np.linalg.norm(one.base - base), turn))


def judged_orientation(found: Any, made: Any, agreeing: np.ndarray) -> Trial:
    """Compare with the truth, and with the adjustment that starts at the truth."""
    base, rotation = S.relative_truth(made.cameras)
    a, b = (image_bundle(rays, made.sigma).take(agreeing) for rays in made.rays)
    strict = adjust_coplanarity(a, b, base, rotation)
    if not found.outcome.usable:
        return found.outcome.name, np.nan, False
    every = (found, *found.alternatives)
    error = min(away(one, base, rotation) for one in every)
    return found.outcome.name, error, min(away(one, strict.base, strict.rotation) for one in every) < 1e-5


def relative(kind: str, points: int | None = None) -> Callable[[int, float], Trial]:
    """Relative orientation, all pairs right."""

    def trial(seed: int, noise: float) -> Trial:
        made = getattr(S, kind)(seed, noise, n=points)
        found = relative_orientation(*(image_bundle(rays, made.sigma) for rays in made.rays))
        return judged_orientation(found, made, np.ones(len(made.points), dtype=bool))

    return trial


def robust(kind: str, part: float) -> Callable[[int, float], Trial]:
    """Relative orientation with a part of wrong pairs."""

    def trial(seed: int, noise: float) -> Trial:
        rng = np.random.default_rng(seed + 10**6)
        made = getattr(S, kind)(seed, noise, n=int(rng.integers(20, 51)))
        wrong = rng.choice(len(made.points), max(1, int(part * len(made.points))), replace=False)
        made.rays[1][wrong, :2] = rng.uniform(-1, 1, (len(wrong), 2)) * [S.HALF_WIDTH, S.HALF_HEIGHT]
        result = robust_relative_orientation(*(image_bundle(rays, made.sigma) for rays in made.rays))
        if not np.any(result.agreeing):
            return result.orientation.outcome.name, np.nan, False
        name, error, same = judged_orientation(result.orientation, made, result.agreeing)
        # A wrong pair that fits by chance moves the strict solution a little: within its precision then.
        return name, error, same or error < 6.0 * float(np.sqrt(np.trace(result.orientation.covariance)))

    return trial


def plane_shape(images: int, points: int | None = None) -> Callable[[int, float], Trial]:
    """Shape of a plane object; error relative to its size."""

    def trial(seed: int, noise: float) -> Trial:
        made = S.plane_scene(seed, noise, n=points, images=images)
        found = shape_of_plane([image_bundle(rays, made.sigma) for rays in made.rays])
        errors, precise = [np.inf], False
        for one in (found, *found.alternatives):
            if np.all(np.isfinite(one.points)):
                fit = similarity(one.points, made.flat)
                errors.append(float(np.abs(fit.residuals).max() / np.abs(made.flat).max()))
                sigma = max(float(np.max(one.sigma_points)) * fit.scale / np.abs(made.flat).max(), 1e-12)
                precise = precise or errors[-1] < 6.0 * sigma
        return found.outcome.name, min(errors) if np.isfinite(min(errors)) else np.nan, precise

    return trial


def resection(kind: str, points: tuple[int, int], part: float = 0.0) -> Callable[[int, float], Trial]:
    """Space resection; error of the rotation in radians."""

    def trial(seed: int, noise: float) -> Trial:
        rng = np.random.default_rng(seed + 10**6)
        made = getattr(S, kind)(seed, noise, n=int(rng.integers(*points)), images=1)
        count = int(np.ceil(part * len(made.points)))
        wrong = rng.choice(len(made.points), count, replace=False)
        made.rays[0][wrong, :2] = rng.uniform(-1, 1, (count, 2)) * [S.HALF_WIDTH, S.HALF_HEIGHT]
        bundle = image_bundle(made.rays[0], made.sigma)
        found = resect(bundle, made.points)
        if not found.outcome.usable:
            return found.outcome.name, np.nan, False
        strict = adjust_pose(bundle.take(found.agreeing), made.points[found.agreeing], Pose(*made.cameras[0]))
        every = (found, *found.alternatives)
        error = min(float(np.linalg.norm(one.rotation - made.cameras[0][1])) for one in every) / np.sqrt(2)
        # Three rays near the dangerous cylinder have a minimum so flat that its place hardly counts.
        close = 1e-5 if len(made.points) > 3 else 0.1
        same = min(float(np.linalg.norm(one.rotation - strict.rotation)) for one in every) < close
        return found.outcome.name, error, same

    return trial


def intersection(seed: int, noise: float) -> Trial:
    """Intersection from two to five images; error relative to the distance of the nearest."""
    rng = np.random.default_rng(seed + 10**6)
    made = S.scene(seed, 0.0, n=8, images=int(rng.integers(2, 6)))
    rays = np.concatenate([S.image(made.points[:1], *each, noise, rng) for each in made.cameras])
    positions, rotations = (np.stack(list(part)) for part in zip(*made.cameras, strict=True))
    found = intersect(image_bundle(rays, made.sigma if noise == 0.0 else noise), positions, rotations)
    nearest = np.min(np.linalg.norm(positions - made.points[0], axis=1))
    error = float(np.linalg.norm(found.point - made.points[0]) / nearest)
    limit = 6.0 * float(np.sqrt(np.trace(found.covariance))) / nearest + 1e-12
    return found.outcome.name, error, error < limit


def stationing(seed: int, noise: float) -> Trial:
    """Free station in the plane, four points, each with direction, distance or both; σ 0, 1, 5 (mgon·π/2, mm)."""
    rng = np.random.default_rng(seed)
    points, station = rng.uniform(-100, 100, (4, 2)), rng.uniform(-100, 100, 2)
    offset = points - station
    kappa = rng.uniform(-np.pi, np.pi)
    observed = np.column_stack([np.arctan2(offset[:, 0], offset[:, 1]) + kappa, np.linalg.norm(offset, axis=1)])
    observed += np.array([noise * 1e-2, noise]) * rng.normal(size=(4, 2))
    for row in observed:
        kind = rng.integers(3)
        if kind < 2:
            row[kind] = np.nan
    sigma = max(noise, 1e-6)
    found = free_station_level(points, observed[:, 0], observed[:, 1], sigma * 1e-2, sigma)
    every = [found.position, *(position for position, _ in found.alternatives)]
    error = min(float(np.linalg.norm(position - station)) for position in every)
    return found.outcome.name, error / 100.0, bool(error < 1e-6 + 1e3 * noise)


LINES: list[tuple[str, Callable[[int, float], Trial]]] = [
    ("relative orientation, 8–50 points in space", relative("scene")),
    ("relative orientation, 8 points in space", relative("scene", 8)),
    ("relative orientation, 8–50 points in a plane", relative("plane_scene")),
    ("the same, 20–50 points in space, 5 % wrong pairs", robust("scene", 0.05)),
    ("the same, 20–50 points in a plane, 5 % wrong pairs", robust("plane_scene", 0.05)),
    ("shape of a plane, 2 images, 4 points", plane_shape(2, 4)),
    ("shape of a plane, 2 images, 8–50 points", plane_shape(2)),
    ("shape of a plane, 3 images, 8–50 points", plane_shape(3)),
    ("resection, 3 points", resection("scene", (3, 4))),
    ("resection, 8–50 points in space", resection("scene", (8, 51))),
    ("resection, 4–7 points in space", resection("scene", (4, 8))),
    ("resection, 8–50 points in a plane", resection("plane_scene", (8, 51))),
    ("resection, 12–50 points, 10 % wrong", resection("scene", (12, 51), 0.1)),
    ("intersection, 2–5 images", intersection),
    ("free station, 4 points, directions and distances mixed", stationing),
]


def main(count: int, first: int = 0) -> None:
    """Print one line of the table per method and noise; scenes that fail are listed after it."""
    print("| method | noise µm | success % | outcomes | error: median | 95 % | 99 % | largest | CPU ms |")
    print("|---|---|---|---|---|---|---|---|---|")
    failures = []
    for name, trial in LINES:
        for noise in NOISES:
            started = time.process_time()
            trials = [trial(seed, noise) for seed in range(first, first + count)]
            spent = (time.process_time() - started) / count * 1e3
            outcomes = ", ".join(f"{k.lower()} {v}" for k, v in Counter(t[0] for t in trials).most_common())
            errors = np.array([t[1] for t in trials])
            quantiles = " | ".join(f"{q:.1e}" for q in np.nanpercentile(errors, [50, 95, 99, 100]))
            share = 100.0 * np.mean([t[2] for t in trials])
            print(
                f"| {name} | {noise * 1e3:.0f} | {share:.1f} | {outcomes} | {quantiles} | {spent:.1f} |",
                flush=True,
            )
            failures += [(name, noise, seed, *t) for seed, t in enumerate(trials, first) if not t[2]]
    for failure in failures:
        print(*failure, file=sys.stderr)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:3] or ["1000"]))
