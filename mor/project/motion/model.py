"""Which points move, and how: blocks behind a point at a time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

from mor.project.motion.times import decimal_year

AT = "@"
"""Between the name of a point and the time from which coordinates of its own hold."""


@dataclass
class MovingPoint:
    """A point that moves: its coordinates by stretches of time, and what moves it all the time."""

    name: str
    steps: list[tuple[float, int]]
    """Times from which on other coordinates hold, ascending, and their blocks; before the first the point's own."""
    block: int
    """Its own block: before all steps, or in its first epoch."""
    own_epochs: bool = False
    """True if every epoch has coordinates of its own."""
    by_epoch: dict[int, int] = field(default_factory=dict)
    """Block of each epoch of those."""
    motions: dict[str, int] = field(default_factory=dict)
    """Block of each kind of movement it has."""
    epochs: set[int] = field(default_factory=set)
    """Epochs in which it was observed."""

    def at(self, epoch: int, time: float) -> int:
        """Block of its coordinates at an epoch. Raises ``KeyError`` where it has none of its own there."""
        if self.own_epochs:
            return self.by_epoch[epoch]
        number = bisect_right([step for step, _ in self.steps], time)
        return self.steps[number - 1][1] if number else self.block


@dataclass
class Motion:
    """Everything about time in a project."""

    labels: list[str] = field(default_factory=list)
    """Epochs as they were first written."""
    times: list[float] = field(default_factory=list)
    """The same in years."""
    reference: float = 0.0
    """t0, in years."""
    points: dict[int, MovingPoint] = field(default_factory=dict)
    """Moving points by their own blocks."""
    stands_for: dict[int, int] = field(default_factory=dict)
    """Point whose coordinates at some time a block has, by that block."""
    epoch_of: dict[str, dict[str, int]] = field(default_factory=dict)
    """Epoch of the images and stations that have one, by namespace and name."""
    tables: list[tuple[str, list[str]]] = field(default_factory=list)
    """Model of each declared table, and the points in it."""

    def epoch(self, text: str) -> int:
        """Number of the epoch behind a text, the same for texts of one time. Raises ``ValueError``."""
        time = decimal_year(text)
        if time not in self.times:
            self.labels.append(text)
            self.times.append(time)
        return self.times.index(time)

    def label_of(self, space: str, name: str) -> str:
        """Epoch of an image or a station as it was written; nothing if it has none."""
        epoch = self.epoch_of.get(space, {}).get(name)
        return "" if epoch is None else self.labels[epoch]

    @property
    def in_order(self) -> list[int]:
        """Numbers of the epochs, the first in time first."""
        return sorted(range(len(self.times)), key=self.times.__getitem__)
