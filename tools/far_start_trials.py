"""``python -m tools.far_start_trials --count 40``: how often disturbed start values lead to the solution.

Coordinates are off by up to a part of the extent of the points in each axis, attitudes by up to so many gon; no
observation is wrong. Beside what the program does stands the Levenberg-Marquardt method of scipy (MINPACK), on the
same equations with the same derivatives and weights. The solution is that which the truth leads to: vᵀPv within a
thousandth, nothing left out.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
import scipy.optimize

from mor.model.parameters import Values, move, moves_by_angles
from mor.solve.iterate import Outcome, adjust
from mor.solve.problem import Problem, linearise, rotation_tangents
from mor.types import FloatArray
from tests.scenarios.gross_error_scenes import KINDS, Spoiled, disturbed, spoiled
from tools.gross_error_trials import adjusted

GON = np.pi / 200.0
SAME = 1e-3
SEED = 1_000_000


def reaches(scene: Spoiled, part: float, angle: float, seed: int) -> bool:
    """True where the adjustment from disturbed start values reaches the solution with all observations."""
    found, suspects, _ = adjusted(scene, part, angle, seed)
    return found.outcome is Outcome.CONVERGED and suspects is None and _same(scene, found.normals.objective)


def minpack_reaches(scene: Spoiled, part: float, angle: float, seed: int, evaluations: int) -> bool:
    """The same for the Levenberg-Marquardt method of scipy."""
    start = disturbed(scene, np.random.default_rng(seed), part, angle)
    problem = scene.problem

    def residuals(x: FloatArray) -> FloatArray:
        return _dense(problem, move(problem.index, start, x))[0]

    def jacobian(x: FloatArray) -> FloatArray:
        values = move(problem.index, start, x)
        return _dense(problem, values)[1] @ _turned(problem, x)

    begin = np.zeros(problem.index.count)
    found = scipy.optimize.least_squares(residuals, begin, jacobian, method="lm", x_scale="jac", max_nfev=evaluations)
    return _same(scene, 2.0 * float(found.cost))


def _same(scene: Spoiled, objective: float) -> bool:
    return abs(objective / adjust(scene.problem, scene.truth).normals.objective - 1.0) < SAME


def _dense(problem: Problem, values: Values) -> tuple[FloatArray, FloatArray]:
    """Residuals (n,) computed − observed in units of σ, and their Jacobian (n, u)."""
    tangent = rotation_tangents(problem.index, values)
    residuals, rows = [], []
    for group in problem.groups:
        found = linearise(group, problem.index, values, tangent, slice(None))
        n, m, k = found.jacobian.shape
        weight = np.where(group.mask, 1.0 / group.sigma, 0.0)
        full = np.zeros((n * m, problem.index.count + 1))
        place = np.repeat(np.where(found.columns >= 0, found.columns, problem.index.count), m, axis=0)
        values_of = (weight[:, :, None] * found.jacobian).reshape(n * m, k)
        np.add.at(full, (np.arange(n * m)[:, None], place), values_of)
        rows.append(full[:, :-1])
        residuals.append(-(weight * found.misclosure).ravel())
    return np.concatenate(residuals), np.concatenate(rows)


def _turned(problem: Problem, x: FloatArray) -> FloatArray:
    """∂δ/∂x (u, u): what a change of a rotation vector x turns by where the rotation has got to."""
    result = np.eye(len(x))
    columns = problem.index.columns.get("rotation")
    if columns is None:
        return result
    vectors = ~moves_by_angles(problem.index.blocks["rotation"]) & (columns >= 0).all(axis=1)
    for own in columns[vectors]:
        a, b, c = x[own]
        cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        angle = max(float(np.linalg.norm(x[own])), 1e-9)
        first, second = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
        result[np.ix_(own, own)] = np.eye(3) - first * cross + second * cross @ cross
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="scenes of each kind")
    parser.add_argument("--peers", type=int, default=10, help="of these by scipy as well")
    parser.add_argument("--evaluations", type=int, default=200, help="of scipy at most")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| scene | off by | reached | scipy |")
    print("|---|---|---|---|")
    for part, angle in ((0.2, 20.0), (0.4, 40.0)):
        for kind in KINDS:
            scenes = [(seed, spoiled(seed, kind, 0.0)) for seed in range(chosen.count)]
            reached = sum(reaches(scene, part, angle * GON, SEED + seed) for seed, scene in scenes)
            peer = sum(
                minpack_reaches(scene, part, angle * GON, SEED + seed, chosen.evaluations)
                for seed, scene in scenes[: chosen.peers]
            )
            peers = min(chosen.peers, chosen.count)
            line = f"| {kind} | {part:.0%}, {angle:.0f} gon | {reached}/{chosen.count} | {peer}/{peers} |"
            print(line, flush=True)


if __name__ == "__main__":
    main()
