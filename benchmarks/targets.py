"""The figures that were aimed at, judged by what a run measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

Cases = dict[str, dict[str, Any]]

_ITERATION, _TIMES_FASTER = ("aerial-500", "aerial-2000", "convergent-500"), 4.5
"""Cases, and how many times faster than Ceres, analytic, an iteration shall be, by CPU time."""
_MOST_ITERATIONS, _COVARIANCE = 1.0, 400.0
_GRID_WALL, _BLOCK_WALL, _FIRST_WALL = 5.0, 2.0, 30.0
_MOST_MEMORY, _BYTES, _COST_RATIO = 24 * 2**30, 300.0, 1.5
_REDUNDANCY = 1e-6


class Figure(NamedTuple):
    """One figure: what, the aim in words, what came out, and whether it was reached."""

    what: str
    aim: str
    measured: str
    reached: bool


def judged(cases: Cases) -> Iterator[Figure]:
    """Every figure this run has a measurement for."""
    yield from _iterations(cases)
    yield from _deviations(cases)
    yield from _commands(cases)
    checks = [abs(one["kernel"]["redundancy_check"]) for one in cases.values()]
    checks += [abs(done["redundancy_check"]) for one in cases.values() for done in one.get("commands", {}).values()]
    if checks:
        worst = max(checks)
        yield Figure("Σ r = n − u + d", "to 1e-6 in every case", f"{worst:.0e}", worst < _REDUNDANCY)


def _iterations(cases: Cases) -> Iterator[Figure]:
    for name in _ITERATION:
        if "ceres" in cases.get(name, {}):
            ratio = cases[name]["ceres"]["iteration_cpu"] / cases[name]["kernel"]["iteration_s"][0]
            words = f"≥ {_TIMES_FASTER} times faster than Ceres, analytic"
            yield Figure(f"iteration, {name}", words, f"{ratio:.2f}", ratio >= _TIMES_FASTER)


def _deviations(cases: Cases) -> Iterator[Figure]:
    for name, one in cases.items():
        if one["kernel"]["image_points"]:
            count = one["kernel"]["sigma_and_r_in_iterations"]
            yield Figure(f"σ and r, {name}", "≤ 1 iteration", f"{count:.2f}", count <= _MOST_ITERATIONS)
        theirs = one.get("ceres", {}).get("covariance_cpu")
        if theirs is not None:
            ratio = theirs / one["kernel"]["sigma_and_r_s"][0]
            words = "≥ 400 times faster than ceres::Covariance"
            yield Figure(f"σ and r, {name}", words, f"{ratio:.0f}", ratio >= _COVARIANCE)


def _commands(cases: Cases) -> Iterator[Figure]:
    one = cases.get("aerial-500", {})
    if "commands" in one and "ceres" in one:
        solve = one["ceres"]["fastest_solve_wall"]
        for kind, done in one["commands"].items():
            words = f"less wall time than Ceres' solve, {solve:.2f} s"
            yield Figure(f"command, aerial-500, {kind}", words, _clocks(done), done["wall"] < solve)
    yield from _large(cases)
    for kind, done in cases.get("grid-10000-200", {}).get("commands", {}).items():
        yield _within(f"command, grid-10000-200, {kind}", done, _GRID_WALL)
    for kind, done in cases.get("block-115", {}).get("commands", {}).items():
        yield _within(f"command, block-115, {kind}", done, _FIRST_WALL if "first" in kind else _BLOCK_WALL)


def _within(name: str, done: dict[str, Any], limit: float) -> Figure:
    return Figure(name, f"≤ {limit:.0f} s", _clocks(done), done["wall"] <= limit)


def _clocks(done: dict[str, Any]) -> str:
    return f"{done['wall']:.2f} s (CPU {done['cpu']:.2f} s)"


def _large(cases: Cases) -> Iterator[Figure]:
    large, usual = cases.get("aerial-10000", {}), cases.get("aerial-500", {})
    for kind, done in large.get("commands", {}).items():
        points = large["kernel"]["image_points"]
        peak, each = done["peak_bytes"], (done["peak_bytes"] - done["table_bytes"]) / points
        name = f"command, aerial-10000, {kind}"
        yield Figure(name, "within 24 GiB", f"{peak / 2**30:.1f} GiB", peak <= _MOST_MEMORY)
        yield Figure(name, "≤ 300 bytes per image point beyond the tables", f"{each:.0f}", each <= _BYTES)
        same = usual.get("commands", {}).get(kind)
        if same is not None:
            ratio = done["cpu"] / points / (same["cpu"] / usual["kernel"]["image_points"])
            words = "CPU per image point within 1.5 of aerial-500"
            yield Figure(name, words, f"{ratio:.2f}", ratio <= _COST_RATIO)
