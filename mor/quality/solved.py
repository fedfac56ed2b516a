"""A network together with what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from mor.adjustment.state import Adjustment, Outcome
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.diagnosis.self_check import REDUNDANCY_LOST
from mor.quality.diagnosis.unsettled import Movements, last_movements
from mor.quality.gross_errors.suspects import Suspects
from mor.quality.reliability.effects import Effect, effects
from mor.quality.reliability.observation_quality import ObservationQuality
from mor.quality.reliability.reliability_map import Controlled, reliability_map
from mor.quality.tests.common_to_flagged import CommonToFlagged, common_to_flagged
from mor.quality.tests.group_tests import GroupTests
from mor.quality.treatment import Treatment
from mor.quality.verdict import Verdict, verdict


class Amount(NamedTuple):
    """Value of the parameter that a mistake adds."""

    name: str
    """offset, scale, height, c, …"""
    value: float
    """Internal units."""


class PossibleCause(NamedTuple):
    """A mistake that would explain what is rejected, by a score test: not verified by an adjustment."""

    cause: str
    """Key of the cause: ``names exchanged``, ``distance offset``, …"""
    things: tuple[str, ...]
    """Names of the points, stations, images or tables it is about."""
    line: str
    """What to change in the project to try it."""
    gain: float
    """Decrease of vᵀPv to first order."""
    parameters: int
    log10_p: float
    """Decimal logarithm of the probability that chance decreases vᵀPv as much."""
    amount: Amount | None
    rows: tuple[tuple[int, int], ...] = ()
    """(group, row) of the observations that it changes, if they are few."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A network with its adjustment, and its quality where the adjustment converged."""

    network: Network
    adjustment: Adjustment
    quality: Quality | None
    treatment: Treatment | None = None
    """What was done about gross errors and weights; ``None`` where there was no solution."""
    suspects: Suspects | None = None
    """What was left out because all observations together have no solution."""
    possible_causes: tuple[PossibleCause, ...] = ()
    """Mistakes that would explain what is rejected, by score tests; the best first."""
    tested: tuple[tuple[ObservationQuality, ...], GroupTests] | None = None
    """Tests of groups that were needed before, and the quality of the observations that they are of."""

    @cached_property
    def movements(self) -> Movements | None:
        """What does not come to rest, where there is no solution; worked out once for all reports."""
        if self.adjustment.reason == REDUNDANCY_LOST:
            return None  # it did come to rest
        if self.adjustment.outcome in (Outcome.NOT_CONVERGED, Outcome.DIVERGED):
            return last_movements(self.adjustment)
        return None

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """What the suspicious observations do, worked out once for all reports."""
        return tuple(effects(self.quality)) if self.quality is not None else ()

    @cached_property
    def common(self) -> tuple[CommonToFlagged, ...]:
        """What flagged observations have in common, worked out once for all reports."""
        return common_to_flagged(self.quality, self.network) if self.quality is not None else ()

    @cached_property
    def verdict(self) -> Verdict | None:
        """The tests of the groups and what would explain those that reject, worked out once for all reports."""
        if self.quality is None:
            return None
        groups, tests = self.tested or ((), None)
        return verdict(self.quality, self.network, tests if groups is self.quality.groups else None)

    @cached_property
    def reliability_map(self) -> tuple[Controlled, ...]:
        """How well points, images, stations and sets are controlled, worked out once for all reports."""
        return tuple(reliability_map(self.quality, self.network)) if self.quality is not None else ()

    @property
    def accepted(self) -> bool:
        """True if the global test and the tests of all groups accept, or without redundancy.

        False if the result as a whole is not determined.
        """
        quality, judged = self.quality, self.verdict
        if quality is None or judged is None or not quality.global_test.accepted or judged.contradicted:
            return False
        return judged.determined is None or judged.determined.as_a_whole
