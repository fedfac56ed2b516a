"""The summary of an adjustment as plain data: the head of ``results.json`` and of every report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mor import __version__
from mor.adjustment.datum.defect import BY_CURVATURE
from mor.adjustment.state import Iteration
from mor.project.file.model import Project
from mor.project.network.entities import said_thing
from mor.quality.diagnosis.singularities import weakness
from mor.quality.reliability.reliability_map import uncontrolled_count
from mor.quality.solved import Solved
from mor.report.edge import angle_unit_of
from mor.report.tables.undeterminable import undeterminable_rows

SCHEMA = "mor-results"
SCHEMA_VERSION = 2


class Ended(NamedTuple):
    """Outcome of an adjustment."""

    outcome: str
    reason: str
    solution: bool
    observations: int
    unknowns: int
    movements: Sequence[str]
    datum: str
    iterations: Sequence[Iteration]
    kernels: bool


def summary(solved: Solved) -> dict[str, Any]:
    """Outcome, counts, σ0, global test, datum, conventions."""
    adjustment = solved.adjustment
    ended = Ended(
        adjustment.outcome.value,
        adjustment.reason,
        solved.quality is not None,
        adjustment.problem.observations,
        adjustment.problem.index.count,
        (*adjustment.defect.movements, *[BY_CURVATURE] * adjustment.defect.to_second_order),
        adjustment.problem.datum.name,
        adjustment.iterations,
        adjustment.kernels,
    )
    things = undeterminable_rows(solved)
    return summary_of(solved.network.project, ended, _undetermined(solved), things, statistics(solved))


def summary_of(
    project: Project,
    ended: Ended,
    undetermined: list[dict[str, Any]],
    undeterminable: list[dict[str, Any]],
    numbers: dict[str, Any],
) -> dict[str, Any]:
    """The same of an adjustment with its ``numbers`` as :func:`statistics` has them."""
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "program": f"mor {__version__}",
        "title": project.title,
        "units": {"length": project.units.length, "angle": angle_unit_of(project)},
        "axes": project.axes.model_dump(),
        "outcome": ended.outcome,
        "reason": ended.reason,
        "solution": ended.solution,
        "iterations": len(ended.iterations),
        "kernels": "numba" if ended.kernels else "numpy",
        "observations": ended.observations,
        "unknowns": ended.unknowns,
        "defect": len(ended.movements),
        "movements": list(ended.movements),
        "undetermined": undetermined,
        "undeterminable": undeterminable,
        "datum": ended.datum,
        **numbers,
        "iteration_log": [
            {
                "number": step.number,
                "objective": step.objective,
                "largest_change": step.largest_change,
                "damping": step.damping,
            }
            for step in ended.iterations
        ],
    }


def _undetermined(solved: Solved) -> list[dict[str, Any]]:
    return [
        {
            "unknowns": [f"{said_thing(*unknown[:2])} {unknown[2]}" for unknown in direction.unknowns],
            "amounts": list(direction.amounts),
        }
        for direction in solved.adjustment.defect.undetermined
    ]


NO_STATISTICS: dict[str, Any] = dict.fromkeys(
    ("redundancy", "redundancy_sum", "sigma0", "global_test", "flagged")
)
"""What :func:`statistics` says where there is no solution."""


def statistics(solved: Solved) -> dict[str, Any]:
    """Redundancy, σ0, global test and what the tests of single observations count."""
    quality = solved.quality
    if quality is None:
        return NO_STATISTICS
    apriori = solved.network.project.settings.sigma0
    aposteriori = apriori * quality.sigma0
    test = quality.global_test
    return {
        "redundancy": quality.redundancy,
        "redundancy_sum": quality.redundancy_sum,
        "sigma0": {
            "apriori": apriori,
            "aposteriori": aposteriori if quality.redundancy > 0 else None,
            "ratio": quality.sigma0**2 if quality.redundancy > 0 else None,
            "ratio_of_sigmas": quality.sigma0 if quality.redundancy > 0 else None,
            "used_for_sigma": apriori * quality.sigma_factor,
        },
        "global_test": {
            "statistic": test.statistic,
            "lower": test.lower,
            "upper": test.upper,
            "level": test.level,
            "accepted": test.accepted,
        },
        "hardly_determined": weakness(solved),
        "critical_w": quality.critical,
        "snooping_level": quality.levels.snooping,
        "flagged": int(sum(np.count_nonzero(flags) for flags in quality.flagged)),
        "uncontrolled": uncontrolled_count(quality),
    }
