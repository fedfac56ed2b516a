"""Relative and planar orientation of many random scenes: what is called determined, error over σ of what is told.

Run ``python -m tests.scenarios.orientations --count 10000 [--first 0] [--of relative|planar]`` from the root: prints
tables of the outcomes. The suite runs a few seeds of it.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections import Counter, defaultdict
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

from mor.model.rotations import angles_from_rotation, exponential
from mor.start.bundle import image_bundle
from mor.start.image_pair import relative_orientation
from mor.start.plane_object import (
    Length,
    PlaneShape,
    corners,
    covariance_in,
    derived,
    inner_constraints,
    on_level_plane,
    placed_covariance,
    scale_from_length,
    shape_of_plane,
    sides_and_angles,
)

BEYOND = 5.0
"""An error of more σ than that, of something called determined or unique, is wrong."""

RELATIVE = ("8 points", "9 to 50 points", "plane", "short base", "short base, plane", "one centre")
PLANAR = (
    "4 points",
    "5 to 30 points",
    "3 images",
    "points off it",
    "short base",
    "one centre",
    "one normal",
)


def simulators() -> ModuleType:
    """Scenes are those of the other tests."""
    path = Path(__file__).parents[1] / "approximate" / "conftest.py"
    spec = importlib.util.spec_from_file_location("scenes_of_orientations", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


S = simulators()


class Trial(NamedTuple):
    """One scene."""

    kind: str
    outcome: str
    errors: dict[str, np.ndarray]
    """Of what is called determined: errors over σ, by what they are errors of."""


def relative(seed: int) -> Trial:
    """Two images of points in space or in a plane, from any base, a short one, or from one centre."""
    rng = np.random.default_rng(seed + 10**7)
    kind = str(rng.choice(RELATIVE))
    noise = float(rng.choice([0.001, 0.002, 0.005]))
    count = {"8 points": 8}.get(kind, int(rng.integers(9, 51)))
    made = (S.plane_scene if "plane" in kind else S.scene)(seed, noise, n=count)
    if "short base" in kind or kind == "one centre":
        position, rotation = made.cameras[0]
        length = 10.0 ** rng.uniform(-3, -1) if "short base" in kind else 0.0
        moved = position + length * S.unit(rng.normal(size=3)), exponential(rng.normal(0, 0.05, 3)) @ rotation
        made.cameras[1] = moved
        made.rays[1] = S.image(made.points, *moved, noise, rng)
    found = relative_orientation(*(image_bundle(rays, noise) for rays in made.rays))
    if found.outcome.name != "DETERMINED":
        return Trial(kind, found.outcome.name, {})
    base, rotation = S.relative_truth(made.cameras)
    wrapped = np.mod(found.angles - angles_from_rotation(rotation) + np.pi, 2 * np.pi) - np.pi
    errors = {"base": (found.base - base) / found.sigma_base}
    if abs(np.cos(found.angles[1])) > 0.1:  # there omega and kappa are two angles
        errors["angles"] = wrapped / found.sigma_angles
    return Trial(kind, found.outcome.name, errors)


def planar(seed: int) -> Trial:
    """Images of a plane object: four points or more, points off it, a short base, one centre, one normal."""
    rng = np.random.default_rng(seed + 10**7)
    kind = str(rng.choice(PLANAR))
    noise = float(rng.choice([0.001, 0.002, 0.005]))
    count = 4 if kind == "4 points" else int(rng.integers(8 if kind == "points off it" else 5, 31))
    images = 3 if kind == "3 images" else 2
    made = S.plane_scene(seed, 0.0, n=count, images=images)
    points, cameras = made.points, list(made.cameras)
    if kind in ("one centre", "short base"):
        length = 10.0 ** rng.uniform(-3, -0.5) if kind == "short base" else 0.0
        position = cameras[0][0] + length * S.unit(rng.normal(size=3))
        cameras[1] = position, exponential(rng.normal(0, 0.1, 3)) @ cameras[0][1]
    if kind == "one normal":
        foot = points.mean(axis=0) + 0.5 * rng.normal() * (points[1] - points[0])
        side = np.sign((cameras[0][0] - foot) @ made.normal)
        heights = side * rng.uniform(2.0, 3.0), side * rng.uniform(3.5, 6.0)
        cameras = [_towards(foot + h * made.normal, points.mean(axis=0), rng) for h in heights]
    off = 3 if kind == "points off it" else 0
    if off:
        points = np.vstack([points, points[:off] + rng.uniform(0.05, 0.3, (off, 1)) * _side(cameras, made)])
    rays = [S.image(points, *camera, noise, rng) for camera in cameras]
    shape = shape_of_plane([image_bundle(one, noise) for one in rays])
    if shape.outcome.name != "UNIQUE":
        return Trial(kind, shape.outcome.name, {})
    found = np.flatnonzero(~shape.in_plane & ~shape.left_out)
    errors = _errors_of_shape(shape, made, points, cameras, found)
    missed = np.setdiff1d(np.arange(count, count + off), found)
    if len(missed):
        bundles = [image_bundle(one, noise) for one in rays]
        errors["heights told to be none"] = _missed(bundles, made, points, cameras, count, missed)
    return Trial(kind, "UNIQUE", errors)


def _missed(bundles, made, points, cameras, count: int, missed: np.ndarray) -> np.ndarray:
    """Heights over their σ of points off the plane that were not told from it: by how many σ a height of 0 is wrong."""
    off = np.arange(len(points)) >= count
    named = shape_of_plane(bundles, off)
    if named.adjusted is None:
        return np.full(len(missed), np.inf)
    heights = (points[missed] - made.points[0]) @ _side(cameras, made)
    scale = scale_from_length(named, 0, 1, float(np.linalg.norm(made.flat[1] - made.flat[0])))
    return heights / (scale * _sigma_heights(named)[missed])


def _sigma_heights(shape: PlaneShape) -> np.ndarray:
    adjusted = shape.adjusted
    assert adjusted is not None
    covariance = covariance_in(adjusted, inner_constraints(adjusted, shape.in_plane))
    return np.sqrt(np.diag(covariance)[6 * len(shape.positions) :].reshape(-1, 3)[:, 2])


def _towards(position: np.ndarray, target: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return position, S.looking(position, target, rng.uniform(-np.pi, np.pi))


def _side(cameras: list, made: object) -> np.ndarray:
    """The normal, towards the first camera."""
    return made.normal * np.sign((cameras[0][0] - made.points[0]) @ made.normal)


def _errors_of_shape(shape, made, points, cameras, off: np.ndarray) -> dict[str, np.ndarray]:
    flat = np.vstack([made.flat, made.flat[: len(points) - len(made.flat)]])
    length = float(np.linalg.norm(flat[1] - flat[0]))
    placed = on_level_plane(shape, 0, 1, scale_from_length(shape, 0, 1, length))
    covariance = placed_covariance(shape, placed, Length(0, 1, length, 0.0))
    round_it = corners(shape)
    found = derived(shape, placed, covariance, round_it, np.full(len(cameras), S.C))
    polygon = sides_and_angles(flat[round_it])
    up = _side(cameras, made)
    heights = (points[off] - made.points[0]) @ up
    flying = [(position - made.points[0]) @ up for position, _ in cameras]
    truth = np.concatenate([polygon.sides, polygon.angles, heights, flying])
    sigma = np.sqrt(np.diag(found.covariance))[: len(truth)]
    errors = found.values[: len(truth)] - truth
    k, known = len(round_it), sigma > 1e-9 * length
    names = np.repeat(["sides", "angles", "heights", "flying heights"], [k, k, len(off), len(flying)])
    return {str(name): (errors / np.where(known, sigma, 1.0))[known & (names == name)] for name in dict.fromkeys(names)}


def table(trials: list[Trial]) -> list[str]:
    """Markdown lines: one for each kind of scene, and one for all."""
    names = list(dict.fromkeys(name for trial in trials for name in trial.errors))
    head = [
        "scenes",
        "number",
        "outcomes",
        f"wrong beyond {BEYOND:.0f} σ",
        *(f"{n}: error/σ, rms" for n in names),
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    kinds: dict[str, list[Trial]] = defaultdict(list)
    for trial in trials:
        kinds[trial.kind].append(trial)
    for kind, some in [*sorted(kinds.items()), ("all", trials)]:
        outcomes = Counter(trial.outcome for trial in some).most_common()
        cells = [
            kind,
            str(len(some)),
            ", ".join(f"{k.lower()} {v}" for k, v in outcomes),
            str(len(wrong(some))),
        ]
        for name in names:
            values = [trial.errors[name] for trial in some if name in trial.errors]
            cells.append(f"{np.sqrt(np.mean(np.concatenate(values) ** 2)):.3f}" if values else "")
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def wrong(trials: list[Trial]) -> list[int]:
    """Positions of those that are called determined and are not."""
    return [
        k
        for k, trial in enumerate(trials)
        if any(np.any(~(np.abs(values) <= BEYOND)) for values in trial.errors.values())
    ]


def main() -> None:
    """Print the tables, and the seeds that were wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--of", choices=["relative", "planar"])
    chosen = parser.parse_args()
    for name, trial in (("relative", relative), ("planar", planar)):
        if chosen.of in (None, name):
            trials = [trial(seed) for seed in range(chosen.first, chosen.first + chosen.count)]
            print(f"\n{name}\n", *table(trials), sep="\n", flush=True)
            for k in wrong(trials):
                worst = max(float(np.max(np.abs(values))) for values in trials[k].errors.values() if len(values))
                print(f"seed {chosen.first + k}: {trials[k].kind}, {worst:.1f} σ", flush=True)


if __name__ == "__main__":
    main()
