"""Check points, check distances and other observations that are kept out of the adjustment."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.reading import Reading
from mor.project.observations.groups import read_groups


def check_groups(
    reading: Reading, groups: list[ObservationGroup], elsewhere: Collection[str] = ()
) -> tuple[ObservationGroup, ...]:
    """Groups of the section ``checks``; ``groups`` are those that take part in the adjustment.

    A point that only checks look at cannot be checked: that is a mistake, but of those determined ``elsewhere``.
    """
    if not reading.project.checks:
        return ()
    project = reading.project.model_copy(update={"observations": reading.project.checks})
    apart = replace(reading, project=project, section="checks")
    checks = tuple(group.group for group in read_groups(apart))
    if reading.broken:
        return checks  # what is missing may be told by what could not be read
    _refuse_unobserved(reading, groups, checks, elsewhere)
    return checks


def _refuse_unobserved(
    reading: Reading,
    groups: list[ObservationGroup],
    checks: tuple[ObservationGroup, ...],
    elsewhere: Collection[str],
) -> None:
    points = reading.shop.store("point")
    seen = np.array([name in elsewhere for name in points.ids], dtype=bool)
    for group in groups:
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point":
                seen[blocks] = True
    free = np.asarray(points.all_free().any(axis=1))
    for group in checks:
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind != "point":
                continue
            for row in np.flatnonzero(free[blocks] & ~seen[blocks]):
                words = f"point {points.ids[blocks[row]]!r} is to be checked, but nothing determines it"
                line = int(group.lines[row]) if len(group.lines) else 0
                reading.problems.append(Problem(words, group.file, line))
