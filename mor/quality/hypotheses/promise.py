"""What changes of whole groups promise, before any of them is adjusted: how the start values of the project fit them.

Start values are rough, so that no observation fits to its σ. But with the right change most come nearer by orders of
magnitude: Σ ln max(s, 1) − ln |dl'/dl| tells it, s = |v|/σ, over the observations whose start values are all given.
A change of what fits already is less likely than one of what does not, unless the start values are what is changed:
coordinates that were given twice, as observed ones and as start values, fit themselves in any unit. Nothing is decided
but what is tried first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import FloatArray
from mor.project.network.build import Network
from mor.quality.hypotheses.hypothesis import Hypothesis
from mor.quality.hypotheses.situation import Situation

_FITS = 2.0
"""ln of how much less likely it is that an observation is wrong where it fits."""


def promises(situation: Situation, hypotheses: Sequence[Hypothesis]) -> FloatArray:
    """(k,) what hypotheses promise; 0 where start values and residuals say nothing of it."""
    network = situation.network
    now = _misfit(network)
    promised = []
    for hypothesis in hypotheses:
        changed = hypothesis.change(network)
        own = hypothesis.stretch - _FITS * _fitting(situation, changed)
        follow = changed.start is not network.start  # start values that were observed fit in any unit
        promised.append(now - _misfit(changed) + (0.0 if follow else own))
    return np.array(promised)


def _fitting(situation: Situation, changed: Network) -> int:
    """How many observations fit, and are changed."""
    count = 0
    groups = zip(situation.network.groups, changed.groups, situation.misfitting, strict=False)
    for old, new, bad in groups:
        if old is not new:
            count += int(np.count_nonzero(old.mask & (old.observed != new.observed) & ~bad))
    return count


def _misfit(network: Network) -> float:
    """Σ ln max(s, 1) over the observations that the given start values are enough for."""
    return sum(_of_group(network, number) for number in range(len(network.groups)))


def _of_group(network: Network, number: int) -> float:
    group = network.groups[number]
    if not group.count or any(slot.kind not in network.start for slot in group.type.slots):
        return 0.0
    with np.errstate(all="ignore"):
        sizes: FloatArray = np.abs(misclosures(group, network.start)) / group.given_sigma
    return float(np.sum(np.log(np.maximum(sizes[np.isfinite(sizes)], 1.0))))
