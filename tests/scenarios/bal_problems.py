"""Random problems like those of BAL, and an independent solver for them.

Every image has its own focal length and two radial terms, nothing fixes the datum, 1 % of the points are far away, up
to 1 % of the image points are wrong by 20 to 200 px, and start values are off by 0.1 to 10 %.
``python -m tests.scenarios.bal_problems --count 50`` prints the rates.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.optimize

import mor
from mor.errors import NoStartValuesError
from mor.types import FloatArray, IntArray

SAME = 1e-6
"""Relative difference of two costs at the same minimum."""
CRITICAL = 3.29
"""Critical value of the test for points at infinity, level 0.001."""
_HALF = 400.0
"""Half the width of an image, px."""


class BalProblem(NamedTuple):
    """Start values and observations of a problem."""

    cameras: FloatArray
    """(m, 9) rotation vector, translation, focal length, two radial terms."""
    points: FloatArray
    """(n, 3)"""
    image: IntArray
    point: IntArray
    xy: FloatArray
    """(k, 2) image points, px."""

    @property
    def text(self) -> str:
        """The file of the problem."""
        rows = zip(self.image, self.point, self.xy, strict=True)
        lines = [f"{len(self.cameras)} {len(self.points)} {len(self.xy)}"]
        lines += [f"{i} {p} {float(x)!r} {float(y)!r}" for i, p, (x, y) in rows]
        lines += [repr(float(x)) for x in (*self.cameras.ravel(), *self.points.ravel())]
        return "\n".join(lines) + "\n"


class Minimum(NamedTuple):
    """What a solver ended with."""

    cost: float
    """Half the sum of squares, px²."""
    iterations: int
    converged: bool
    words: str = ""
    at_infinity: int = 0
    """Points that ended at infinity, because the test says nothing against it at the solution."""

    def is_as_low_as(self, other: Minimum, redundancy: int) -> bool:
        """True if the cost is the same or lower, but for what the test for points at infinity calls chance."""
        by_chance = 0.5 * CRITICAL**2 * self.at_infinity * max(2.0 * other.cost / redundancy, 1.0)
        return self.converged and self.cost <= other.cost * (1.0 + SAME) + by_chance


def bal_problem(seed: int) -> BalProblem:
    """Return the problem of a seed: images along a street that look at its points, with 0.5 px of noise."""
    random = np.random.default_rng([seed, 39])
    m, n = int(random.integers(4, 13)), int(random.integers(60, 160))
    step = random.uniform(1.0, 3.0)
    centres = np.cumsum(random.uniform(0.5, 1.5, (m, 1)), axis=0) * [step, 0.0, 0.0]
    centres += random.normal(0.0, 0.3, (m, 3))
    extent = float(np.ptp(centres[:, 0])) + 10.0
    points = np.column_stack(
        [
            random.uniform(-5.0, extent - 5.0, n),
            random.uniform(-5.0, 5.0, n),
            random.uniform(-30.0, -6.0, n),
        ]
    )
    points += [centres[0, 0], 0.0, 0.0]
    far = random.permutation(n)[: max(1, round(0.01 * n))]
    middle = centres.mean(axis=0)
    points[far] = middle + (points[far] - middle) * 10.0 ** random.uniform(1.0, 4.0, (len(far), 1))
    cameras = np.empty((m, 9))
    cameras[:, :3] = random.normal(0.0, 0.15, (m, 3))
    cameras[:, 6] = random.uniform(300.0, 900.0, m)
    cameras[:, 7] = random.uniform(-0.15, 0.05, m)
    cameras[:, 8] = random.uniform(-0.01, 0.02, m)
    cameras[:, 3:6] = -_rotated(cameras[:, :3], centres)
    image, point = (one.ravel() for one in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    xy = projected(cameras[image], points[point])[0]
    depth = (_rotated(cameras[image, :3], points[point]) + cameras[image, 3:6])[:, 2]
    seen = (np.abs(xy) < _HALF).all(axis=1) & (depth < -1.0) & (random.random(len(xy)) < 0.85)
    enough = np.bincount(point[seen], minlength=n) >= 2
    seen &= enough[point]
    image, xy = image[seen], xy[seen]
    kept, point = np.unique(point[seen], return_inverse=True)
    xy += random.normal(0.0, 0.5, xy.shape)
    wrong = random.random(len(xy)) < random.choice([0.0, 0.003, 0.01])
    xy[wrong] += random.uniform(20.0, 200.0, (int(wrong.sum()), 2)) * random.choice([-1.0, 1.0], 2)
    off = 10.0 ** random.uniform(-3.0, -1.0)
    start, points = cameras.copy(), points[kept]
    start[:, :3] += off * random.normal(0.0, 0.5, (m, 3))
    moved = centres + off * random.normal(0.0, 0.5, (m, 3)) * 10.0
    start[:, 3:6] = -_rotated(start[:, :3], moved)
    start[:, 6:] *= 1.0 + off * random.uniform(-1.0, 1.0, (m, 3))
    distance = np.linalg.norm(points - middle, axis=1)[:, None]
    return BalProblem(start, points + off * random.normal(0.0, 0.5, points.shape) * distance, image, point, xy)


def _cross(a: FloatArray) -> FloatArray:
    """(k, 3, 3) matrices of the cross products with (k, 3) vectors."""
    result = np.zeros((len(a), 3, 3))
    result[:, 2, 1], result[:, 0, 2], result[:, 1, 0] = a.T
    return result - np.swapaxes(result, 1, 2)


def _turns(w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k, 3, 3) rotations of rotation vectors, and the left Jacobians."""
    angle = np.linalg.norm(w, axis=1)[:, None, None] + 1e-12
    K = _cross(w)
    KK = K @ K
    a, b, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + a * K + b * KK, np.eye(3) + b * K + np.where(angle > 1e-3, c, 1.0 / 6.0) * KK


def _rotated(w: FloatArray, x: FloatArray) -> FloatArray:
    return np.einsum("kij,kj->ki", _turns(w)[0], x)


def projected(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return image points (k, 2), and their derivatives by the cameras (k, 2, 9) and points (k, 2, 3)."""
    R, left = _turns(cameras[:, :3])
    turned = np.einsum("kij,kj->ki", R, points)
    P = turned + cameras[:, 3:6]
    p = -P[:, :2] / P[:, 2:]
    f, k1, k2 = cameras[:, 6:].T
    r2 = np.sum(p**2, axis=1)
    radial = 1.0 + r2 * (k1 + r2 * k2)
    by_p = f[:, None, None] * (
        radial[:, None, None] * np.eye(2) + (2.0 * (k1 + 2.0 * k2 * r2))[:, None, None] * p[:, :, None] * p[:, None, :]
    )
    p_by_P = np.concatenate([np.tile(-np.eye(2), (len(p), 1, 1)), -p[:, :, None]], axis=2) / P[:, 2, None, None]
    by_P = by_p @ p_by_P
    by_camera = np.empty((len(p), 2, 9))
    by_camera[:, :, :3] = -by_P @ _cross(turned) @ left
    by_camera[:, :, 3:6] = by_P
    by_camera[:, :, 6] = radial[:, None] * p
    by_camera[:, :, 7] = (f * r2)[:, None] * p
    by_camera[:, :, 8] = (f * r2**2)[:, None] * p
    return (f * radial)[:, None] * p, by_camera, by_P @ R


def by_scipy(problem: BalProblem, evaluations: int = 2000) -> Minimum:
    """Return the minimum that the Levenberg-Marquardt method of MINPACK reaches from the start values."""
    m, n, k = len(problem.cameras), len(problem.points), len(problem.xy)

    def parts(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return x[: 9 * m].reshape(m, 9)[problem.image], x[9 * m :].reshape(n, 3)[problem.point]

    def residuals(x: FloatArray) -> FloatArray:
        return np.asarray((projected(*parts(x))[0] - problem.xy).ravel())

    def jacobian(x: FloatArray) -> FloatArray:
        counted.append(1)
        _, by_camera, by_point = projected(*parts(x))
        J = np.zeros((k, 2, 9 * m + 3 * n))
        row, axis = np.arange(k)[:, None, None], np.arange(2)[None, :, None]
        J[row, axis, 9 * problem.image[:, None, None] + np.arange(9)] = by_camera
        J[row, axis, 9 * m + 3 * problem.point[:, None, None] + np.arange(3)] = by_point
        return J.reshape(2 * k, -1)

    counted: list[int] = []
    start = np.concatenate([problem.cameras.ravel(), problem.points.ravel()])
    with np.errstate(all="ignore"):
        found = scipy.optimize.least_squares(
            residuals,
            start,
            jacobian,
            method="lm",
            x_scale="jac",
            ftol=1e-12,
            xtol=1e-12,
            max_nfev=evaluations,
        )
    return Minimum(float(found.cost), len(counted), found.status > 0)


def by_mor(problem: BalProblem, folder: Path) -> Minimum:
    """Return the minimum of the whole program, as its users run it."""
    path = folder / "problem.txt"
    path.write_text(problem.text)
    return minimum_of_mor(path)


def minimum_of_mor(path: Path) -> Minimum:
    """Return the minimum of a BAL file: that of all observations, also where suspects were left out afterwards."""
    steps: list[object] = []  # also those of adjustments that lead nowhere
    try:
        solved = mor.adjust(str(path), watch=steps.append).solved
    except (mor.InputError, NoStartValuesError) as error:
        return Minimum(np.inf, len(steps), False, str(error))
    suspects = solved.suspects
    adjustment = solved.adjustment if suspects is None else suspects.plain
    treated = [f"{thing.name} {thing.treatment}" for thing in solved.network.undeterminable]
    whole = suspects is not None or not any("left out" in one for one in treated)
    words = f"{adjustment.outcome.value} {adjustment.reason} {treated}"
    words += f" {suspects.count} left out" if suspects is not None else ""
    far = sum("at infinity" in one for one in treated)
    converged = adjustment.outcome.is_solution and whole
    return Minimum(0.5 * adjustment.normals.objective, len(steps), converged, words, far)


def main() -> None:
    """Print one line for each problem that ends worse than with scipy, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    well, iterations = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(chosen.first, chosen.first + chosen.count):
            problem = bal_problem(seed)
            own, peer = by_mor(problem, Path(folder)), by_scipy(problem)
            redundancy = 2 * len(problem.xy) - problem.cameras.size - problem.points.size + 7
            well.append(own.is_as_low_as(peer, redundancy))
            iterations.append((own.iterations, peer.iterations))
            if not well[-1]:
                print(seed, own, peer, flush=True)
    mine, theirs = np.median(iterations, axis=0)
    print(f"{sum(well)} of {len(well)} at the same minimum or lower; median of iterations {mine:.0f}, {theirs:.0f}")


if __name__ == "__main__":
    main()
