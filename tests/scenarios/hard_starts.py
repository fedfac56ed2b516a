"""Small networks on which Gauss-Newton alternates, creeps or runs away, and scipy's solution from the same start.

Observations contradict each other, cameras stand close to the line of their points, only some components are fixed, and
start values are off by 10 to 60 % of the extent. ``python -m tests.scenarios.hard_starts --count 500``
prints the rates.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.optimize

from mor.model.parameters import Values, move
from mor.model.rotations import rotate
from mor.solve.iterate import Adjustment, Outcome, adjust
from mor.solve.problem import Problem
from mor.types import FloatArray
from tests.scenarios.scenes import Scene, looking_at
from tools.far_start_trials import _dense, _turned

SAME = 1e-9
"""Relative difference of two sums of squares at the same minimum."""


class HardStart(NamedTuple):
    """A problem and the start values it is adjusted from."""

    kind: str
    problem: Problem
    start: dict[str, FloatArray]


def _trilateration(random: np.random.Generator) -> tuple[Scene, float]:
    """Distances in the plane that are too short or too long, between fixed stations and new points."""
    scene, count = Scene(), int(random.integers(3, 7))
    names = []
    for k, xy in enumerate(random.uniform(0.0, 100.0, (count + 3, 2))):
        free = (k >= 3, k >= 3, False)
        names.append(scene.add("point", f"N{k}", [*xy, 0.0], free=free))
    wrong = random.choice([0.0, 0.1, 0.6])
    for i in range(len(names)):
        for j in range(i):
            if i >= 3 and random.random() < 0.8:
                d = float(np.linalg.norm(scene.truth["point"][names[i]] - scene.truth["point"][names[j]]))
                d *= 1.0 + wrong * random.uniform(-1.0, 1.0)
                scene.observe("horizontal_distance", names[i], None, names[j], None, sigma=0.01, observed=d)
    return scene, 100.0


def _bearings(random: np.random.Generator) -> tuple[Scene, float]:
    """Directions and distances in the plane with one fixed point and one more fixed coordinate; some are wrong."""
    scene, count = Scene(), int(random.integers(5, 9))
    names = []
    for k, xy in enumerate(random.uniform(0.0, 100.0, (count, 2))):
        free = (k > 0, k > 1, False)
        names.append(scene.add("point", f"N{k}", [*xy, 0.0], free=free))
    wrong = float(random.choice([0.0, 0.05, 0.5]))
    for i, name in enumerate(names):
        scene.add("rotation", name, [0.0, 0.0, random.uniform(-3.0, 3.0)], free=(False, False, True))
        for j in random.permutation(count)[:6]:
            if i != j:
                sigma = (1e-4, 1e-4)
                scene.observe("directions", name, name, None, names[j], sigma=sigma, only=(0,))
                if random.random() < 0.5:
                    d = float(np.linalg.norm(scene.truth["point"][names[j]] - scene.truth["point"][name]))
                    d *= 1.0 + wrong * random.uniform(-1.0, 1.0)
                    scene.observe("horizontal_distance", name, None, names[j], None, sigma=0.01, observed=d)
    return scene, 100.0


def _resection(random: np.random.Generator) -> tuple[Scene, float]:
    """One image of given points that lie close to a line or a plane, its camera constant perhaps unknown."""
    scene, count = Scene(), int(random.integers(5, 10))
    flat = random.choice([1.0, 0.1, 0.02], 2)
    places = random.uniform(-1.0, 1.0, (count, 3)) * [1.0, *flat]
    points = [scene.add("point", f"P{k}", xyz, free=False) for k, xyz in enumerate(places)]
    unknown = bool(random.random() < 0.5)
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=(unknown, *[False] * 9))
    place = random.standard_normal(3)
    place *= random.uniform(2.5, 5.0) / np.linalg.norm(place)
    scene.add("point", "I", place)
    scene.add("rotation", "I", looking_at(place, random.uniform(-0.2, 0.2, 3), roll=random.uniform(-3, 3)))
    sigma = float(random.choice([1e-3, 0.05, 0.3]))
    for point in points:
        scene.observe("image/mor", "I", "I", None, None, "camera", point, sigma=sigma)
    return scene, 2.0


def _block(random: np.random.Generator) -> tuple[Scene, float]:
    """A few images of points of which single coordinates are fixed; some image points are wrong."""
    scene, count = Scene(), int(random.integers(8, 15))
    places = random.uniform(-1.0, 1.0, (count, 3))
    fixed = [(True, True, True), (True, True, False), (True, False, True)]
    points = [
        scene.add("point", f"P{k}", xyz, free=~np.array(fixed[k] if k < 3 else (False,) * 3))
        for k, xyz in enumerate(places)
    ]
    unknown = bool(random.random() < 0.5)
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=([unknown] * 3 + [False] * 7))
    wrong = float(random.choice([0.0, 0.02, 0.1]))
    for k in range(int(random.integers(3, 6))):
        place = random.standard_normal(3)
        place *= random.uniform(2.5, 5.0) / np.linalg.norm(place)
        scene.add("point", f"I{k}", place)
        turn = looking_at(place, random.uniform(-0.2, 0.2, 3), roll=random.uniform(-3, 3))
        scene.add("rotation", f"I{k}", turn)
        for point in points:
            sigma = 1e-3 if random.random() >= wrong else 0.5
            scene.observe("image/mor", f"I{k}", f"I{k}", None, None, "camera", point, sigma=sigma)
    return scene, 2.0


def _stations(random: np.random.Generator) -> tuple[Scene, float]:
    """Total stations in space whose distances are too short or too long; some coordinates are fixed."""
    scene = Scene()
    places = random.uniform([-60, -60, -15], [60, 60, 15], (int(random.integers(6, 12)), 3))
    fixed = [(True, True, True), (True, False, True), (False, False, True)]
    points = [
        scene.add("point", f"P{k}", xyz, free=~np.array(fixed[k] if k < 3 else (False,) * 3))
        for k, xyz in enumerate(places)
    ]
    wrong = float(random.choice([0.0, 0.05, 0.5]))
    for k in range(int(random.integers(2, 4))):
        station = scene.add("point", f"S{k}", random.uniform([-90, -90, -4], [90, 90, 4]))
        scene.add("rotation", station, [0.0, 0.0, random.uniform(-3, 3)], free=(False, False, True))
        for point, xyz in zip(points, places, strict=True):
            names = (station, station, None, point)
            scene.observe("zenith_directions", *names, sigma=(1e-4, 1e-4), constants=(6_371_000.0, 1.0))
            d = float(np.linalg.norm(xyz - scene.truth["point"][station])) * (1.0 + wrong * random.uniform(-1, 1))
            scene.observe("distance", station, None, point, None, sigma=0.01, observed=d)
    return scene, 100.0


KINDS: dict[str, Callable[[np.random.Generator], tuple[Scene, float]]] = {
    "trilateration": _trilateration,
    "directions": _bearings,
    "resection": _resection,
    "images": _block,
    "stations": _stations,
}


def hard_start(seed: int) -> HardStart:
    """The network of a seed; seeds run through the kinds."""
    random = np.random.default_rng([seed, 38])
    kind = list(KINDS)[seed % len(KINDS)]
    scene, extent = KINDS[kind](random)
    problem = scene.problem(random)
    off, start = random.uniform(0.1, 0.6), scene.values()
    columns = problem.index.columns
    free = columns["point"] >= 0
    start["point"] += 0.5 * off * extent * random.uniform(-1.0, 1.0, free.shape) * free
    if "rotation" in start:
        free = columns["rotation"] >= 0
        start["rotation"] = rotate(start["rotation"], off * random.uniform(-1.0, 1.0, free.shape) * free)
    if "interior/mor" in start:
        free = columns["interior/mor"] >= 0
        scale = np.array([20.0, 1.0, 1.0, *[0.0] * 7])
        start["interior/mor"] += off * scale * random.uniform(-0.5, 0.5, free.shape) * free
    return HardStart(kind, problem, start)


def by_scipy(problem: Problem, start: Values, evaluations: int = 2000) -> tuple[bool, float]:
    """Whether MINPACK converges from the start values, and its sum of squares."""

    def residuals(x: FloatArray) -> FloatArray:
        return _dense(problem, move(problem.index, start, x))[0]

    def jacobian(x: FloatArray) -> FloatArray:
        return _dense(problem, move(problem.index, start, x))[1] @ _turned(problem, x)

    begin = np.zeros(problem.index.count)
    tight = {"ftol": 1e-14, "xtol": 1e-14, "gtol": 1e-14, "max_nfev": evaluations}
    with np.errstate(all="ignore"):
        found = scipy.optimize.least_squares(residuals, begin, jacobian, method="lm", x_scale="jac", **tight)
        J = jacobian(found.x)
    size = np.linalg.norm(J, axis=0)
    J = J / np.where(size > 0.0, size, 1.0)
    inside = np.linalg.svd(J, compute_uv=False)[-1] > 1e-7
    # A minimum: the Gauss-Newton step there is nothing beside sigma, and every unknown is determined.
    step = np.linalg.lstsq(J, found.fun, rcond=None)[0]
    return bool(found.status > 0 and inside and np.linalg.norm(J @ step) < 1e-3), 2.0 * float(found.cost)


def ends_well(found: Adjustment, expected: float) -> bool:
    """True where an adjustment has converged to a sum of squares that is not larger."""
    return found.outcome is Outcome.CONVERGED and found.normals.objective <= expected * (1.0 + SAME) + 1e-9


def main() -> None:
    """Print one line for each case that does not end well, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    tally = {kind: [0, 0, 0, 0] for kind in KINDS}
    iterations = []
    for seed in range(chosen.first, chosen.first + chosen.count):
        case = hard_start(seed)
        peer, expected = by_scipy(case.problem, case.start)
        with np.errstate(all="ignore"):
            found = adjust(case.problem, case.start)
        converged = found.outcome is Outcome.CONVERGED
        well = ends_well(found, expected)
        iterations.append(len(found.iterations))
        row = tally[case.kind]
        row[0] += 1
        row[1] += peer
        row[2] += peer and well
        row[3] += converged
        if peer and not well:
            words = f"{found.outcome.value} {found.reason}, {len(found.iterations)} iterations"
            print(f"{seed} {case.kind}: {words}, {found.normals.objective:.9g} for {expected:.9g}", flush=True)
    print("| kind | cases | scipy converges | mor converges there, not higher | mor converges |")
    print("|---|---|---|---|---|")
    for kind, row in tally.items():
        print("|", kind, "|", " | ".join(map(str, row)), "|")
    print("iterations: median", np.median(iterations), "most", max(iterations))


if __name__ == "__main__":
    main()
