"""Iterations, and σ with r, of the kernel alone: arrays in, arrays out, in this process."""

from __future__ import annotations

import resource
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scenes
from measure import Seconds, now, resident, since
from problems import as_problem

from mor.linalg import compilation
from mor.quality.assessment import Quality, assess
from mor.quality.precision import datum_transformation, parameter_cofactors
from mor.quality.redundancy import observation_quality
from mor.solve.iterate import Adjustment, adjust
from mor.solve.normals import build_normals
from mor.solve.problem import Problem
from mor.types import FloatArray, IntArray

compilation.elsewhere = compilation.available

_SMALL: dict[type, tuple[str, tuple[int, ...]]] = {
    scenes.Block: ("aerial", (2, 3)),
    scenes.Grid: ("grid", (5, 3)),
    scenes.Mixed: ("mixed", (2, 3, 10)),
}
"""A small scene of each sort, so that kernels are compiled and loaded before anything is timed."""
_SMALL_NUMBER = 300_000
"""Problems with fewer observations are timed twice, and the better time counts."""


def time_kernel(scene: scenes.Scene) -> dict[str, Any]:
    """Time everything; keys end in the unit. Seconds come as [CPU, wall]."""
    small, sizes = _SMALL[type(scene)]
    assess(adjust(*as_problem(scenes.make(small, sizes))))
    problem, start = as_problem(scene)
    peak = dgemm_gflops()
    before = resident()
    times = 2 if problem.observations < _SMALL_NUMBER else 1
    adjustment, solve, iteration = min((timed_adjustment(problem, start) for _ in range(times)), key=_of_iteration)
    normals = fastest(lambda: build_normals(adjustment.plan, adjustment.values), 2)
    sigma_and_r = fastest(lambda: sigma_and_redundancy(adjustment), times)
    begin = now()
    quality = assess(adjustment)
    result = {
        **sizes_of(problem, scene),
        "outcome": adjustment.outcome.value,
        "iterations": len(adjustment.iterations),
        "solve_s": solve,
        "iteration_s": iteration,
        "normals_s": normals,
        "sigma_and_r_s": sigma_and_r,
        "assess_s": since(begin),
        "sigma_and_r_in_iterations": sigma_and_r.cpu / iteration.cpu,
        "dgemm_gflops": peak,
        **outcome_of(quality),
    }
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    result["peak_bytes"], result["data_bytes"] = most, before
    if isinstance(scene, scenes.Block):
        flops = normals_flops(scene.of_point)
        result["normals_of_dgemm"] = flops / normals.cpu / 1e9 / peak
        result["bytes_per_image_point"] = (most - before) / len(scene.image)
    return result


def timed_adjustment(problem: Problem, start: Mapping[str, FloatArray]) -> tuple[Adjustment, Seconds, Seconds]:
    """The adjustment, the time of all of it and of its fastest iteration.

    From the end of one iteration to the end of the next: step, new values, normal equations and objective there,
    factorisation. The last one may skip the normal equations and does not count.
    """
    marks: list[Seconds] = []
    begin = now()
    adjustment = adjust(problem, start, watch=lambda _: marks.append(now()))
    whole = since(begin)
    steps = np.diff(np.array([begin, *marks]), axis=0)
    full = steps[1:-1] if len(steps) > 2 else steps
    return adjustment, whole, Seconds(*full.min(axis=0).tolist())


def _of_iteration(timed: tuple[Adjustment, Seconds, Seconds]) -> float:
    return timed[2].cpu


def sigma_and_redundancy(adjustment: Adjustment) -> None:
    """σ of every parameter and the redundancy number of every observation: selected inverse and one pass."""
    cofactors = adjustment.inverse.selected()
    datum = datum_transformation(adjustment)
    _, of_eliminated = observation_quality(adjustment, cofactors, datum)
    for kind in adjustment.problem.index.columns:
        parameter_cofactors(adjustment, cofactors, of_eliminated, datum, kind)


def fastest(work: Callable[[], object], times: int) -> Seconds:
    """The fastest of some repetitions."""
    all_times = []
    for _ in range(times):
        begin = now()
        work()
        all_times.append(since(begin))
    return min(all_times)


def sizes_of(problem: Problem, scene: scenes.Scene) -> dict[str, int]:
    """Numbers of observations, unknowns and image points."""
    block = scene.block if isinstance(scene, scenes.Mixed) else scene
    image_points = len(block.image) if isinstance(block, scenes.Block) else 0
    return {
        "observations": problem.observations,
        "unknowns": problem.index.count,
        "image_points": image_points,
    }


def outcome_of(quality: Quality) -> dict[str, float]:
    """Reference values for peers, and the check of all redundancy numbers."""
    result = {
        "objective": quality.omega,
        "sigma0": quality.sigma0,
        "redundancy": quality.redundancy,
        "redundancy_check": quality.redundancy_sum - quality.redundancy,
    }
    for kind, q in quality.cofactors.items():
        if kind.startswith("interior"):
            result["sigma_c"] = float(np.sqrt(q[0, 0, 0]))
    return result


def dgemm_gflops(order: int = 1500) -> float:
    """Speed of a matrix product on this machine, by CPU time, in 1e9 flop/s."""
    matrix = np.random.default_rng(1).standard_normal((order, order))
    return 2.0 * order**3 / fastest(lambda: matrix @ matrix, 4).cpu / 1e9


def normals_flops(of_point: IntArray) -> float:
    """Estimated operations of one pass from rays to the reduced system, poses of 6 and one interior of 10 unknowns.

    Of each ray: derivatives 200, their products (16 × 17 / 2 + 16 + 16 × 3 + 9) · 4, elimination 16 · 15, pose with
    interior 360; of each pair of rays of a point 6 × 6 × 3 · 2; of each point 360.
    """
    rays = np.bincount(of_point).astype(float)
    products = 4 * (16 * 17 // 2 + 16 + 48 + 9)
    return float(np.sum(rays * (200 + products + 240 + 360) + rays * (rays + 1) / 2 * 216 + 360))
