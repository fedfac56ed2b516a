"""Checks as plain data, in project axes and units."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.quality.solved import Solved
from mor.quality.tests.check_points import check_outcome
from mor.report.edge import said, said_differences, said_numbers, said_sizes


def check_rows(solved: Solved) -> list[dict[str, Any]]:
    """One entry for each component of each group of checks."""
    quality = solved.quality
    if quality is None or not solved.network.checks:
        return []
    rows = []
    groups = solved.adjustment.problem.groups
    for number in range(len(groups) - len(solved.network.checks), len(groups)):
        group, outcome = groups[number], check_outcome(quality, number)
        values = {
            "count": said_numbers(group, outcome.count[None])[0],
            "mean": said_differences(group, outcome.mean[None])[0],
            "rms": said_sizes(group, outcome.rms[None])[0],
            "largest": said_differences(group, outcome.largest[None])[0],
            "exceeding": said_numbers(group, outcome.exceeding[None])[0],
        }
        for k, component in enumerate(group.type.components):
            if values["count"][k] > 0:
                numbers = {key: float(array[k]) for key, array in values.items()}
                rows.append(
                    {
                        "group": group.name,
                        "type": group.type.name,
                        "component": component.name,
                        "unit": said(group).external.units[k],
                        **numbers,
                        "count": int(values["count"][k]),
                        "exceeding": int(values["exceeding"][k]),
                    }
                )
    return rows


def largest_length_error(rows: list[dict[str, Any]]) -> float | None:
    """Largest length measurement error of all check distances among the checks, project unit (VDI/VDE 2634)."""
    errors = [abs(row["largest"]) for row in rows if "distance" in row["type"]]
    return float(np.max(errors)) if errors else None
