"""Tables that several reports show are worked out once for an adjustment, whichever of them comes first."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from mor.quality.solved import Solved

Table = TypeVar("Table")


_REMEMBERED: list[WeakKeyDictionary[Solved, Any]] = []


def once(work: Callable[[Solved], Table]) -> Callable[[Solved], Table]:
    """Remember what the work made of an adjustment for as long as that is there; nobody may change it.

    Reports are made side by side: who comes second waits for the first. No such work may ask for itself.
    """
    known: WeakKeyDictionary[Solved, Table] = WeakKeyDictionary()
    _REMEMBERED.append(known)
    working = Lock()

    @wraps(work)
    def remembered(solved: Solved) -> Table:
        with working:
            if solved not in known:
                known[solved] = work(solved)
            return known[solved]

    return remembered


def forget(solved: Solved) -> None:
    """Give back the room of all tables of an adjustment; who asks for one again has it worked out again."""
    for known in _REMEMBERED:
        known.pop(solved, None)
