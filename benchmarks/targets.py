"""The figures that are aimed at, judged by what a run measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

Cases = dict[str, dict[str, Any]]

_ITERATION = {"aerial-500": 3.0, "aerial-2000": 3.0, "convergent-500": 4.0}
"""How many times faster than Ceres with analytic derivatives an iteration shall be, by CPU time."""


class Figure(NamedTuple):
    """One figure: what, the aim in words, what came out, and whether it was reached."""

    what: str
    aim: str
    measured: str
    reached: bool


def judged(cases: Cases) -> Iterator[Figure]:
    """Every figure this run has a measurement for."""
    for name, one in cases.items():
        kernel, commands, ceres = one["kernel"], one.get("commands", {}), one.get("ceres")
        if ceres and name in _ITERATION:
            ratio, least = ceres["iteration_cpu"] / kernel["iteration_s"][0], _ITERATION[name]
            aim = f"≥ {least:g} times faster than Ceres, analytic"
            yield Figure(f"iteration, {name}", aim, f"{ratio:.2f}", ratio >= least)
        if kernel["image_points"]:
            count = kernel["sigma_and_r_in_iterations"]
            yield Figure(f"σ and r, {name}", "≤ 1.5 iterations", f"{count:.2f}", count <= 1.5)
        if name == "aerial-500" and ceres and "parquet" in commands:
            ratio = ceres["fastest_solve_wall"] / commands["parquet"]["wall"]
            yield Figure(f"command, {name}", "≥ 0.8 of Ceres' bare solve, wall", f"{ratio:.2f}", ratio >= 0.8)
        if name == "block-115" and "csv, first run" in commands:
            first, usual = commands["csv, first run"]["wall"], commands["csv, numpy"]["wall"]
            aim = "first run ≤ 6 s and ≤ 1.5 times that with NumPy, wall"
            yield Figure(name, aim, f"{first:.2f} s, {first / usual:.2f}", first <= min(6.0, 1.5 * usual))
        worst = max(abs(done["redundancy_check"]) for done in (kernel, *commands.values()))
        yield Figure(f"Σ r, {name}", "n − u + d to 1e-6", f"{worst:.0e}", worst < 1e-6)
