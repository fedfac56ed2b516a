"""Which of several answers that fit alike is taken whenever one is asked for, and how well start values agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup, some_rows, wrap

ROWS = 20_000
"""Rows of a group by which start values are judged; observations of a network up to which trying again costs little."""
AGREES = float(np.log1p(5.0**2))
"""Mean of log(1 + (v/σ)²) of a group up to which start values agree with it: 5 σ."""
SOUND = float(np.log1p(2.0**2))
"""The same of adjusted ones, and of those that need not be adjusted before they are judged: 2 σ."""
BETTER = 0.1
"""Mean of log(1 + (v/σ)²) by which start values must agree better to be taken for others."""
SMALLER = 1e-6
"""Part of v'Pv from which on one minimum lies below another."""
SECOND_TRIES = 4
"""Other answers that are tried beside start values that agree, where such ones fitted alike."""

Found = TypeVar("Found")


class Question(NamedTuple):
    """A question with several answers."""

    answers: int
    taken: int
    alike: bool
    """True where the answers fit alike; false where the first one is the best, and may be wrong all the same."""


@dataclass
class Choices:
    """The answers to take, in the order in which they are asked for: the first one where nothing else is ``wanted``."""

    wanted: tuple[int, ...] = ()
    asked: list[Question] = field(default_factory=list)

    def take(self, count: int, alike: bool = True) -> int:
        """The number of the answer to take of ``count``, the likeliest first."""
        if count <= 1:
            return 0
        place = len(self.asked)
        taken = min(self.wanted[place], count - 1) if place < len(self.wanted) else 0
        self.asked.append(Question(count, taken, alike))
        return taken

    def others(self) -> list[tuple[int, ...]]:
        """What else to want, one other answer each: where answers fit alike first, the next likely ones first."""
        before = tuple(question.taken for question in self.asked)
        found = [
            (other, not question.alike, place)
            for place, question in enumerate(self.asked)
            for other in range(question.answers)
            if other != question.taken
        ]
        return [_trimmed((*before[:place], other)) for other, _, place in sorted(found)]

    @property
    def open(self) -> bool:
        """True where answers fitted alike."""
        return any(question.alike for question in self.asked)


def _trimmed(wanted: tuple[int, ...]) -> tuple[int, ...]:
    """Without the likeliest answers at its end, which are taken anyhow."""
    while wanted and not wanted[-1]:
        wanted = wanted[:-1]
    return wanted


class Judgement(NamedTuple):
    """How good start values are."""

    missing: int
    """Things that have none."""
    fit: float
    """Mean of log(1 + (v/σ)²) over all observations that they reach."""
    worst: float
    """The largest of a group."""
    squares: float = np.inf
    """v'Pv, where they were adjusted and that came to an end."""
    before: float = np.inf
    """``fit`` before they were adjusted."""

    @property
    def agrees(self) -> bool:
        """True where nothing better is to be looked for."""
        return not self.missing and self.worst <= (SOUND if np.isfinite(self.squares) else AGREES)

    def beats(self, other: Judgement) -> bool:
        """True where these are clearly better, or end at a smaller v'Pv.

        Gross errors can draw good ones and bad ones to one end, from where nothing tells what is wrong: the good ones
        fit most observations as they stand.
        """
        if np.isfinite(self.squares) and np.isfinite(other.squares):
            if abs(self.squares - other.squares) <= SMALLER * other.squares:
                return self.before + BETTER < other.before
            return self.squares < other.squares
        return (self.missing, self.fit + BETTER * (self.missing == other.missing)) < (
            other.missing,
            other.fit,
        )


def likeliest(
    attempt: Callable[[Choices], Found],
    judged: Callable[[Found], Judgement],
    most: Callable[[], int],
) -> tuple[Found, Choices]:
    """What the choices lead to that agree best: one answer after another is changed, as long as that helps.

    ``most``: attempts beside the first one, at the most; asked only where that one does not agree.
    """
    choices = Choices()
    best = attempt(choices)
    if not choices.asked:
        return best, choices
    judgement = judged(best)
    tried, left = {choices.wanted}, _tries(choices, judgement, most)
    while left > 0:
        wanted = _next(choices, tried, judgement.agrees)
        if wanted is None:
            break
        tried.add(wanted)
        other = Choices(wanted)
        found = attempt(other)
        of_it = judged(found)
        left -= 1
        if of_it.beats(judgement):
            left = min(left, SECOND_TRIES) if of_it.agrees else left
            best, choices, judgement = found, other, of_it
    return best, choices


def _tries(choices: Choices, judgement: Judgement, most: Callable[[], int]) -> int:
    """How many other answers are worth a try: those that fit alike may all agree, and one of them best.

    Where something is missing and the rest agrees, what is missing may not be measured at all.
    """
    if judgement.missing and judgement.worst <= AGREES:
        return min(most(), SECOND_TRIES)
    if not judgement.agrees:
        return most()
    return SECOND_TRIES if choices.open and np.isfinite(judgement.squares) else 0


def _next(choices: Choices, tried: set[tuple[int, ...]], alike: bool) -> tuple[int, ...] | None:
    """What to want next; where ``alike`` only another answer to a question of such."""
    for wanted in choices.others():
        place = len(wanted) - 1
        if wanted not in tried and (not alike or (place >= 0 and choices.asked[place].alike)):
            return wanted
    return None


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
