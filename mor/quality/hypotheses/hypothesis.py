"""What a hypothesis is: a change of the project that would make its observations agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mor.arrays import IntArray
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.effort import Done


class Amount(NamedTuple):
    """What an additional unknown of a hypothesis came out as."""

    name: str
    """offset, scale, height or c."""
    value: float
    """Internal units."""


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that may have been made, as the change of the network that undoes it."""

    cause: str
    """Key of the cause: ``names exchanged``, ``distance offset`` …"""
    things: tuple[str, ...]
    """Names of what it is about, those of points and instruments or of tables."""
    change: Callable[[Network], Network]
    line: str
    """What to write in the project to try it."""
    candidates: int = 1
    """How many of its kind were looked through."""
    parameters: int = 0
    """Additional unknowns."""
    stretch: float = 0.0
    """Σ ln |dl'/dl| of changed observations, less Σ ln (σ'/σ): densities change with the unit, as far as controlled."""
    rows: tuple[tuple[int, int], ...] = ()
    """(group, row) of the few observations it changes; none where it changes many."""
    anew: Mapping[str, IntArray] = field(default_factory=dict)
    """Blocks of each kind that begin from the given start values again; where none are given, from all else."""
    afresh: bool = False
    """True where missing start values are worth being worked out anew."""
    amount: Callable[[Values], Amount] | None = None
    """What its additional unknown is at a solution."""

    def amount_at(self, values: Values) -> Amount | None:
        """Its additional unknown at a solution; nothing where it has none."""
        return None if self.amount is None else self.amount(values)


class Fit(NamedTuple):
    """How well a network fits its observations."""

    values: Values
    omega: float
    """vᵀPv."""
    freedom: int
    length: float
    """Description length: see :mod:`mor.quality.gross_errors.description_length`."""
    scale: float
    """Factor of all σ by the median of the residuals."""


class Offered(NamedTuple):
    """A hypothesis that explains the observations much better than they are without it."""

    hypothesis: Hypothesis
    before: float
    """vᵀPv of the plain adjustment, or of its last iteration; not finite where there was none."""
    freedom_before: int
    after: float
    """vᵀPv with the change."""
    freedom_after: int
    gain: float
    """By how much the description of the observations becomes shorter, in units of χ²."""
    amount: Amount | None


class Causes(NamedTuple):
    """What was found."""

    offered: tuple[Offered, ...] = ()
    """The best first; none where none is good enough."""
    untried: int = 0
    """Hypotheses that were not tried because looking for causes would have taken too long."""


NOTHING_FOUND = Causes()


Looking = Callable[[int], Done]
"""Told how many iterations the hypotheses may take; what it returns is told each of them."""


def ignore_looking(_: int) -> Done:
    """Nobody watches."""
    return lambda _: None
