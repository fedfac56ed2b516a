"""What no adjustment can be computed with: σ beyond all numbers, nothing free, a datum without coordinates."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mor.arrays import LARGEST
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.edge import SMALLEST_SIGMA
from mor.project.network.reading import Reading
from mor.project.tables.columns import MOST_TOLD


def check_feasible(reading: Reading, groups: Iterable[ObservationGroup], carries_datum: bool) -> None:
    """Tell what cannot be adjusted; ``carries_datum`` is false where the datum names no coordinates."""
    groups = list(groups)
    if not groups:
        reading.problems.append(reading.at("observations").problem("there are no observations"))
    elif not reading.shop.store("point").ids:
        reading.problems.append(
            reading.at("points").problem("there are no points, and nothing that has a place")
        )
    for group in groups:
        _check_sigma(reading, group)
    if groups and not any(store.all_free().any() for store in reading.shop.stores.values() if store.ids):
        words = "there is nothing to adjust: every coordinate and every parameter is fixed, or not estimated"
        reading.problems.append(reading.at("points").problem(words))
    if not carries_datum:
        none = "" if reading.shop.things["point"].ids else ": there are no points"
        reading.problems.append(reading.at("datum").problem(f"datum: names no coordinates{none}"))


def _check_sigma(reading: Reading, group: ObservationGroup) -> None:
    """Squares of σ, and of residuals over σ, must be numbers."""
    wrong = group.mask & ~((group.sigma >= SMALLEST_SIGMA) & (group.sigma <= LARGEST))
    for row in np.flatnonzero(wrong.any(axis=1))[:MOST_TOLD].tolist():
        found = group.sigma[row][wrong[row]][0]
        words = f"{group.name}: found σ = {found:g}, expected one from {SMALLEST_SIGMA:g} to {LARGEST:g}"
        line = int(group.lines[row]) if len(group.lines) > row else 0
        reading.problems.append(Problem(words, group.file or reading.document.file, line))
