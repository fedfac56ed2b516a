"""How often tests of groups reject error-free measurements: ``python -m tools.group_test_levels --count 1000``.

The observations of every sample project are drawn anew, normally distributed about its adjusted ones. ``--of linear``
takes the residuals of the linear model, v = −R ε, ``--of adjusted`` adjusts and assesses each of them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
from mor.quality.assessment import Quality, assess  # noqa: E402
from mor.quality.external_reliability import WhitenedRows, whitened_rows  # noqa: E402
from mor.quality.group_tests import GroupTests, Moments, group_tests, log_tail, moments, rows_of_test  # noqa: E402  # noqa: E402
from mor.quality.solution import Solved  # noqa: E402
from mor.solve.iterate import (  # noqa: E402
    Adjustment,
    adjust,
)
from mor.types import BoolArray  # noqa: E402
from sample_projects.expected import solve_sample  # noqa: E402
from sample_projects.simulate import SCENES  # noqa: E402

AT_A_TIME = 250


def rejections(solved: Solved, count: int, seed: int = 0) -> BoolArray:
    """(count, tests) what each test of a project says of error-free measurements, in the linear model."""
    quality = solved.quality
    assert quality is not None
    problem, found = quality.adjustment.problem, group_tests(quality, solved.network)
    everything = whitened_rows(quality, [group.mask & ~group.left_out for group in problem.groups])
    places = [_places(found.rows(test, problem), everything) for test in found.tests]
    known = _moments(quality, found)
    random, parts = np.random.default_rng(seed), []
    for first in range(0, count, AT_A_TIME):
        noise = random.standard_normal((everything.design.shape[0], min(AT_A_TIME, count - first)))
        v2 = everything.residuals_of(noise) ** 2
        omega = [v2[place].sum(axis=0) for place in places]
        tails = [log_tail(one, of) for one, of in zip(omega, known, strict=True)]
        parts.append(np.stack(tails, axis=1) < np.log(found.level_of_each))
    return np.concatenate(parts)


def _moments(quality: Quality, found: GroupTests) -> list[Moments]:
    """Moments of each test, worked out for all of them."""
    return [
        moments(rows_of_test(quality, found.partitions[test.partition], test.number), test.redundancy)
        for test in found.tests
    ]


def _places(rows: list[BoolArray], everything: WhitenedRows) -> BoolArray:
    """(N,) the observations of a test among all."""
    inside = [own[place >= 0] for own, place in zip(rows, everything.places, strict=True)]
    return np.concatenate([np.zeros(0, dtype=bool), *inside])


def measured_anew(adjustment: Adjustment, seed: int) -> Adjustment:
    """The adjustment of the same project, with other errors."""
    from mor.solve.problem import misclosures

    random, problem = np.random.default_rng(seed), adjustment.problem
    groups = []
    for group in problem.groups:
        true = group.observed - misclosures(group, adjustment.values)
        groups.append(replace(group, observed=true + group.sigma * random.standard_normal(true.shape)))
    for cluster in adjustment.plan.clusters:
        noise = np.linalg.solve(cluster.whitening, random.standard_normal(len(cluster.rows)))
        for number, row, component, error in zip(cluster.groups, cluster.rows, cluster.components, noise, strict=True):
            own = problem.groups[number], adjustment.values, np.array([row])
            true = own[0].observed[row, component] - misclosures(*own)[0, component]
            groups[number].observed[row, component] = true + error
    return adjust(replace(problem, groups=tuple(groups)), adjustment.values)


def adjusted_rejections(solved: Solved, count: int, seed: int = 0) -> list[bool]:
    """(count,) true where any test of groups rejects, each of the adjustments made and assessed."""
    found = []
    for k in range(count):
        quality = assess(measured_anew(solved.adjustment, seed + k))
        found.append(bool(group_tests(quality, solved.network).rejected))
    return found


def main() -> None:
    """Print the rates of all samples."""
    parser = argparse.ArgumentParser(prog="python -m tools.group_test_levels", description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--of", choices=["linear", "adjusted"], default="linear")
    parser.add_argument("samples", nargs="*", default=list(SCENES))
    arguments = parser.parse_args()
    for name in arguments.samples:
        solved = solve_sample(name)
        if arguments.of == "linear":
            said = rejections(solved, arguments.count)
            each = said.mean(axis=0)
            words = f"{said.shape[1]} tests, of each {each.mean():.5f}, the most {each.max():.5f}"
            print(f"{name:16} {said.any(axis=1).mean():.4f}  {words}", flush=True)
        else:
            print(f"{name:16} {np.mean(adjusted_rejections(solved, arguments.count)):.4f}", flush=True)


if __name__ == "__main__":
    main()
