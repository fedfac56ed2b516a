"""Tables that several reports show are worked out once for an adjustment."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

from mor.quality.solved import Solved

Table = TypeVar("Table")


def once(work: Callable[[Solved], Table]) -> Callable[[Solved], Table]:
    """Remember what the work made of an adjustment for as long as that is there; nobody may change it."""
    known: WeakKeyDictionary[Solved, Table] = WeakKeyDictionary()

    @wraps(work)
    def remembered(solved: Solved) -> Table:
        if solved not in known:
            known[solved] = work(solved)
        return known[solved]

    return remembered
