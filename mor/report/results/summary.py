"""The summary of an adjustment as plain data: the head of ``results.json`` and of every report."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor import __version__
from mor.project.network.entities import said_thing
from mor.quality.diagnosis.singularities import weakness
from mor.quality.reliability.reliability_map import uncontrolled_count
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.tables.undeterminable import undeterminable_rows

SCHEMA = "mor-results"
SCHEMA_VERSION = 2


def summary(solved: Solved) -> dict[str, Any]:
    """Outcome, counts, σ0, global test, datum, conventions."""
    adjustment, project = solved.adjustment, solved.network.project
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "program": f"mor {__version__}",
        "title": project.title,
        "units": {"length": project.units.length, "angle": angle_unit(solved)},
        "axes": project.axes.model_dump(),
        "outcome": adjustment.outcome.value,
        "reason": adjustment.reason,
        "solution": solved.quality is not None,
        "iterations": len(adjustment.iterations),
        "observations": adjustment.problem.observations,
        "unknowns": adjustment.problem.index.count,
        "defect": int(adjustment.defect.datum.shape[1]),
        "movements": list(adjustment.defect.movements),
        "undetermined": _undetermined(solved),
        "undeterminable": undeterminable_rows(solved),
        "datum": adjustment.problem.datum.name,
        **_statistics(solved),
        "iteration_log": [
            {
                "number": step.number,
                "objective": step.objective,
                "largest_change": step.largest_change,
                "damping": step.damping,
            }
            for step in adjustment.iterations
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


def _statistics(solved: Solved) -> dict[str, Any]:
    quality = solved.quality
    if quality is None:
        return {
            "redundancy": None,
            "redundancy_sum": None,
            "sigma0": None,
            "global_test": None,
            "flagged": None,
        }
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
