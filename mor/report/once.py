"""Tables that several reports show are worked out once for an adjustment, whichever of them comes first."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import TypeVar
from weakref import WeakKeyDictionary

from mor.quality.solved import Solved

Table = TypeVar("Table")


def once(work: Callable[[Solved], Table]) -> Callable[[Solved], Table]:
    """Remember what the work made of an adjustment for as long as that is there; nobody may change it.

    Reports are made side by side: who comes second waits for the first. No such work may ask for itself.
    """
    known: WeakKeyDictionary[Solved, Table] = WeakKeyDictionary()
    working = Lock()

    @wraps(work)
    def remembered(solved: Solved) -> Table:
        with working:
            if solved not in known:
                known[solved] = work(solved)
            return known[solved]

    return remembered
