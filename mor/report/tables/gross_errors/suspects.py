"""Observations left out because all together have no solution, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.quality.solved import Solved
from mor.report.tables.reliability import place

MOST = 10_000
"""Suspects that results.json lists; the table of residuals has all."""


def suspects(solved: Solved) -> dict[str, Any] | None:
    """Return the outcome of the adjustment of all observations, and the suspects, worst first."""
    found, quality = solved.suspects, solved.quality
    if found is None or quality is None:
        return None
    plain, groups = found.plain, solved.adjustment.problem.groups
    entries = [
        (float(found.sizes[number][row, component]), number, int(row), int(component))
        for number, (group, mask) in enumerate(zip(groups, found.masks, strict=True))
        for row, component in np.argwhere(mask & group.left_out)
    ]
    entries.sort(key=lambda entry: (-entry[0], *entry[1:]))
    last = plain.iterations[-1].sigma0 if plain.iterations else None
    return {
        "outcome": plain.outcome.value,
        "iterations": len(plain.iterations),
        "sigma0_ratio": last,
        "count": len(entries),
        "observations": [
            {**place(groups[number], row, component), "misfit": size}
            for size, number, row, component in entries[:MOST]
        ],
    }
