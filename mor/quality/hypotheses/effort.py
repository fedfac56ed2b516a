"""How much looking for causes may take: an allowance of its own, of which every trial takes what it takes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mor import allowance
from mor.allowance import ITERATIONS, LEAST, Allowance, of_iteration
from mor.quality.effort import Done

SMALL: Final = 20_000
"""Observations up to which graduated weights and many adjustments cost next to nothing."""
ADJUSTMENTS = 3
"""Adjustments of large networks that looking for causes may take."""


def times(observations: int) -> int:
    """Adjustments that looking for causes may take: dozens of small networks, three of large ones."""
    return allowance.allowed(observations, ADJUSTMENTS, LEAST) // (ITERATIONS * of_iteration(observations))


def allowed(observations: int, looking: Callable[[int], Done], spent: int = 0) -> Allowance:
    """The allowance for a network, less what was ``spent`` on a solution, but a quarter of it at most."""
    most = allowance.allowed(observations, ADJUSTMENTS, max(LEAST - spent, LEAST - LEAST // 4))
    return Allowance(most, looking(most))
