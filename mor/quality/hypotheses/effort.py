"""How much looking for causes may take: a multiple of what the adjustment itself takes, counted in its iterations.

Seconds would make the answer depend on how busy the machine is. An iteration of a changed network takes as long as one
of the adjustment; working out the start values of all images and stations as long as some thirty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mor.quality.effort import Done

SMALL = 20_000
"""Observations up to which graduated weights and many adjustments cost next to nothing."""
TIMES = 40
"""Adjustments of small networks that looking for causes may take."""
ITERATIONS = 10
"""Iterations of an adjustment that runs well."""
DAMPED = 2
"""Iterations that are as long as one whose step had to be shortened."""
START_VALUES = 30
"""Iterations that are as long as working out start values."""


@dataclass
class Effort:
    """An effort that may be made, and what has been made of it."""

    most: int
    """Iterations."""
    done: Done
    """Told what is made."""
    made: int = 0

    @property
    def is_left(self) -> bool:
        """True as long as more may be made."""
        return self.made < self.most

    def take(self, iterations: int = 1) -> None:
        """Count what is made."""
        self.made += iterations
        self.done(iterations)


def times(observations: int) -> int:
    """Adjustments that looking for causes may take: 40 of small networks, fewer of large ones, three at least."""
    return max(TIMES * SMALL // max(observations, SMALL), 3)


def allowed(observations: int, looking: Callable[[int], Done]) -> Effort:
    """The effort for a network."""
    most = times(observations) * ITERATIONS
    return Effort(most, looking(most))
