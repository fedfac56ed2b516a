"""Sets of directions: what a set with an orientation of its own needs to say anything."""

from __future__ import annotations

import numpy as np

from mor.errors import Problem
from mor.project.observation_rows import Group
from mor.project.reading import Reading

_DIRECTIONS = ("directions", "zenith_directions")


def check_direction_sets(reading: Reading, groups: list[Group]) -> None:
    """Report sets whose orientation is unknown and that have fewer than two horizontal targets.

    Sets are counted by their rotation, over all observation groups. A single direction only determines its own
    orientation: it looks like an observation and is none.
    """
    targets: dict[int, set[int]] = {}
    places: dict[int, tuple[str, str, int]] = {}
    for group in (g.group for g in groups if g.group.type.key in _DIRECTIONS):
        rotations, points = group.blocks[1], group.blocks[3]
        for i in range(group.count):
            number = int(rotations[i])
            places.setdefault(number, (group.references[0][i], group.file, int(group.lines[i])))
            seen = targets.setdefault(number, set())
            if np.isfinite(group.observed[i, 0]):
                seen.add(int(points[i]))
    store = reading.shop.store("rotation")
    free, sigma, ids = store.all_free(), store.all_sigma(), store.ids
    observed_elsewhere = _observed_rotations(reading)
    for number, seen in targets.items():
        loose = free[number, 2] and np.isnan(sigma[number, 2])
        if loose and len(seen) < 2 and ids[number] not in observed_elsewhere:
            name, file, line = places[number]
            reading.problems.append(Problem(_words(name, len(seen)), file, line))


def _observed_rotations(reading: Reading) -> set[str]:
    """Stations of which a component is observed, or tied to another one's, in groups of parameters."""
    names: set[str] = set()
    for entry in reading.project.observations:
        if entry.type in ("parameter", "difference"):
            columns = entry.columns if isinstance(entry.columns, list) else []
            for row in entry.rows or []:
                names |= {cell for name, cell in zip(columns, row, strict=False) if cell and name in _BLOCKS}
            if entry.file is not None:
                return {*reading.shop.store("rotation").ids}
    return names


_BLOCKS = ("of", "from", "to")


def _words(name: str, count: int) -> str:
    if count == 0:
        return (
            f"station {name!r} has no horizontal direction, and nothing else that orients its circle; "
            "zenith angles alone are of type zenith_angle, vertical directions of type vertical_direction"
        )
    return (
        f"the set of directions at {name!r} has a single horizontal target; its unknown orientation needs two or more "
        "(or fix or observe the orientation, or give the sight as a bearing)"
    )
