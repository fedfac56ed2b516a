"""Which of several answers that fit alike is taken whenever one is asked for, and how well start values agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup, some_rows, wrap

ROWS = 20_000
"""Rows of a group by which start values are judged; observations of a network up to which trying again costs little."""
AGREES = float(np.log1p(5.0**2))
"""Mean of log(1 + (v/σ)²) of a group up to which start values agree with it: 5 σ."""


@dataclass
class Choices:
    """The answers to take, in the order in which they are asked for: the first one where nothing else is ``wanted``."""

    wanted: tuple[int, ...] = ()
    among: list[int] = field(default_factory=list)
    """How many there were, each time."""

    def take(self, count: int) -> int:
        """The number of the answer to take of ``count`` that fit alike, the likeliest first."""
        place = len(self.among)
        if count > 1:
            self.among.append(count)
        return min(self.wanted[place], count - 1) if count > 1 and place < len(self.wanted) else 0

    def others(self, most: int) -> list[tuple[int, ...]]:
        """What else to want: one other answer each, of the first questions first; ``most`` of them."""
        found = [
            (*(0,) * place, other) for place, count in enumerate(self.among) for other in range(1, count)
        ]
        return found[:most]


def disagreement(groups: Sequence[ObservationGroup], start: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Mean of log(1 + (v/σ)²) over what can be computed, and the largest of a group; few wrong ones weigh little."""
    found = [_of_group(group, start) for group in groups]
    total, count = sum(one[0] for one in found), sum(one[1] for one in found)
    return total / max(count, 1), max((one[0] / one[1] for one in found if one[1]), default=0.0)


def _of_group(group: ObservationGroup, start: Mapping[str, FloatArray]) -> tuple[float, int]:
    """Sum of log(1 + (v/σ)²) over the observations of a group, and how many there are."""
    if group.count > ROWS:
        group = some_rows(group, np.linspace(0, group.count - 1, ROWS).astype(np.int64))
    blocks = [start[slot.kind][at] for slot, at in zip(group.type.slots, group.blocks, strict=True)]
    with np.errstate(all="ignore"):
        off = group.observed - group.type.equation(blocks, group.constants).values
        off = np.where(group.type.wraps, wrap(off), off) / group.sigma
    told = np.isfinite(off) & group.mask
    sizes = np.minimum(np.abs(off[told]), 1e100)
    return float(np.log1p(np.square(sizes)).sum()), int(np.count_nonzero(told))
