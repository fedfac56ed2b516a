"""Points that only observations name: free where a project asks for it; those that may be slips are told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mor.counting import counted
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.points import add_free_points
from mor.project.network.reading import Reading
from mor.project.tables.columns import MOST_TOLD
from mor.project.tables.tables import Rows


def declare(reading: Reading, rows: Rows, column: str, spaces: Sequence[str]) -> None:
    """Make free points of the names of a column that no thing of these namespaces has, where the project wants that.

    Not of names with a prefix (``image:B1``): those say what they name.
    """
    if not may_declare(reading):
        return
    taken = [reading.shop.things[space].numbers for space in spaces]
    names = (name for name in rows.names(column).known if not any(name in there for there in taken))
    new = [name for name in dict.fromkeys(names) if name and ":" not in name]
    if not new:
        return
    cells = rows.text(column)
    first = {name: row for row, name in reversed(list(enumerate(cells)))}
    for name in new:
        reading.undeclared[name] = (rows.file, int(rows.lines[first[name]]))
    add_free_points(reading, new)


def may_declare(reading: Reading) -> bool:
    """Return True if the project wants free points for names that nothing has."""
    wanted = reading.project.settings.undeclared_points == "free"
    return wanted and reading.section == "observations" and "point" not in reading.broken


def check_undeclared(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Note how many points only observations name, and each that differs from a declared one by a single character.

    Of those, one that a single row names is a mistake: it says nothing but its own place, and looks like a slip.
    """
    if not reading.undeclared:
        return
    points = reading.shop.things["point"]
    rows = _rows_of_points(groups, len(reading.shop.store("point").ids))
    declared = [name for name in points.ids if name not in reading.undeclared]
    found = [
        Slip(name, near, int(rows[points.part(name, "position")]), *reading.undeclared[name])
        for name, near in alike(reading.undeclared, declared).items()
    ]
    mistakes, notes = told(found, len(reading.undeclared))
    reading.problems.extend(mistakes)
    reading.notes.extend(notes)


class Slip(NamedTuple):
    """A point that only observations name, and a declared one that a single character tells from it."""

    name: str
    near: str
    rows: int
    """Rows that name it."""
    file: str
    line: int
    """Where the first of them stands."""


def told(slips: Sequence[Slip], count: int) -> tuple[list[Problem], list[Problem]]:
    """What is a mistake, and what is noted of ``count`` points that only observations name."""
    mistakes, notes = [], []
    for one in slips:
        if one.rows == 1:
            words = (
                f"point {one.name!r} is named by this row only, and no table of points has it; "
                f"did you mean {one.near!r}? If not, declare it among the points"
            )
            mistakes.append(Problem(words, one.file, one.line))
        else:
            words = f"point {one.name!r} is in no table of points and therefore free; {one.near!r} is"
            notes.append(Problem(words, one.file, one.line))
    if len(notes) > MOST_TOLD:
        notes[MOST_TOLD:] = [Problem(f"{len(notes) - MOST_TOLD} more points like these")]
    many = counted(count, "point")
    return mistakes, [Problem(f"{many} that only observations name: free (undeclared_points: free)"), *notes]


def _rows_of_points(groups: Sequence[ObservationGroup], count: int) -> np.ndarray:
    """(points,) number of rows that name each point block."""
    rows = np.zeros(count, dtype=np.int64)
    for group in groups:
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point":
                rows += np.bincount(blocks, minlength=count)
    return rows


def alike(names: Iterable[str], declared: Iterable[str]) -> dict[str, str]:
    """Of each name a declared one from which at most one character, or the case of letters, tells it apart."""
    known: dict[str, str] = {}
    for name in declared:
        for rest in _without_one(name):
            known.setdefault(rest, name)
    found = (
        (name, next((known[rest] for rest in _without_one(name) if rest in known), "")) for name in names
    )
    return {name: near for name, near in found if near}


def _without_one(name: str) -> list[str]:
    """A name without regard to case, and all that is left of it without one character.

    Two names share one of these where one character was changed, left out or put in, or two were swapped.
    """
    plain = name.casefold()
    return [plain, *(plain[:k] + plain[k + 1 :] for k in range(len(plain)) if len(plain) > 1)]
