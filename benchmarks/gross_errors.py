"""``python benchmarks/gross_errors.py aerial-500``: what the robust way takes beside the plain adjustment.

In every image the names of some rows are exchanged in turn: so many of them are wrong. Times are CPU seconds, those of
the adjustment without wrong rows after one that has compiled what there is to compile.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import cases
import numpy as np
import scenes
from problems import as_problem

from mor.linalg.compilation import chosen_by_size
from mor.quality.outliers import without_suspects
from mor.solve.iterate import adjust
from mor.solve.problem import Problem
from mor.types import BoolArray

Result = TypeVar("Result")


def exchanged(problem: Problem, part: float, seed: int) -> tuple[Problem, BoolArray]:
    """The problem with a part of the rows of each image observed for each other, and which these are (n,)."""
    rays = problem.groups[0]
    rng, observed, wrong = np.random.default_rng(seed), rays.observed.copy(), np.zeros(rays.count, dtype=bool)
    order = np.argsort(rays.blocks[0], kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(rays.blocks[0][order])) + 1):
        chosen = rng.choice(rows, max(2, round(part * len(rows))), replace=False)
        observed[chosen] = observed[np.roll(chosen, 1)]
        wrong[chosen] = True
    return replace(problem, groups=(replace(rays, observed=observed), *problem.groups[1:])), wrong


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return the result of the work and its CPU seconds."""
    begun = time.process_time()
    return work(), time.process_time() - begun


def main() -> None:
    """Print a row of a table for each part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", choices=[name for name, case in cases.CASES.items() if case.scene == "aerial"])
    parser.add_argument("--parts", type=float, nargs="+", default=[0.01, 0.03, 0.1])
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    case = cases.CASES[arguments.case]
    problem, start = as_problem(scenes.make(case.scene, case.sizes))
    print("| block | rays | wrong | plain way, CPU s | iterations | found | others named | robust way, CPU s | ratio |")
    with chosen_by_size(problem.observations):
        adjust(problem, start)
        _, usual = timed(lambda: adjust(problem, start))
        for part in arguments.parts:
            spoiled, wrong = exchanged(problem, part, arguments.seed)
            plain, first = timed(lambda spoiled=spoiled: adjust(spoiled, start))
            (found, suspects, _), then = timed(lambda plain=plain: without_suspects(plain))
            named = np.zeros(len(wrong), dtype=bool) if suspects is None else suspects.masks[0].any(axis=1)
            right, others = np.count_nonzero(named & wrong), np.count_nonzero(named & ~wrong)
            cells = (
                arguments.case,
                len(wrong),
                f"{part:.0%}",
                f"{first:.1f}",
                len(plain.iterations),
                f"{right} of {np.count_nonzero(wrong)}",
                others,
                f"{then:.1f}, {found.outcome.name.lower()}",
                f"{(first + then) / usual:.0f}",
            )
            print("|", " | ".join(map(str, cells)), "|", flush=True)


if __name__ == "__main__":
    main()
