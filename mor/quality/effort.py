"""How much work the statistics of an adjustment are: whoever watches can tell how long they take."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from mor.adjustment.state import Adjustment
from mor.sparse.selected_inverse import operations

Done: TypeAlias = Callable[[int], None]
"""Told how much more is done, in rays; from several threads."""

OPERATIONS_PER_RAY = 30_000
"""Operations of the dense matrices of the selected inverse in the time that the quality of one ray takes."""


def effort(adjustment: Adjustment) -> int:
    """What :func:`mor.quality.assess.assess` tells its watcher in all."""
    of_inverse = float(operations(adjustment.plan.elimination).sum())
    return len(adjustment.plan.rays.row) + int(of_inverse / OPERATIONS_PER_RAY)


def of_operations(done: Done) -> Callable[[float], None]:
    """A watcher that is told operations of the selected inverse, and tells them on."""
    told = 0
    whole = 0.0

    def more(count: float) -> None:
        nonlocal told, whole
        whole += count
        done(int(whole / OPERATIONS_PER_RAY) - told)
        told = int(whole / OPERATIONS_PER_RAY)

    return more
