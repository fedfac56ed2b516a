"""A network together with what became of it."""

from __future__ import annotations

from dataclasses import dataclass

from mor.adjustment.solve import Adjustment
from mor.project.network import Network
from mor.quality.assess import Quality
from mor.quality.treatment import Treatment


@dataclass(frozen=True)
class Solved:
    """A network with its adjustment, and its quality where the adjustment converged."""

    network: Network
    adjustment: Adjustment
    quality: Quality | None
    treatment: Treatment | None = None
    """What was done about gross errors and weights; ``None`` where there was no solution."""
