"""How much of what a change gives another unit, or another σ, is controlled: that part alone tells the unit.

What nothing else determines fits in any unit: a coordinate that is observed once is as good in feet as in metres. With
σ multiplied by k, −2 ln of how likely the observations are, whatever the unknowns, changes by 2 Σ r d ln k, since ln
det of the normal equations falls by 2 Σ (1 − r) d ln k; and other numbers with the same σ are the same numbers with
another one. Between the two ends, r is taken as the mean of both.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray
from mor.project.network.build import Network
from mor.quality.hypotheses.situation import Situation, redundancy_numbers


def controlled_part(situation: Situation, changed: Network, after: Adjustment) -> float:
    """Mean redundancy number of the changed observations, where most fit without the change and with it; 1 of none."""
    masks = changed_observations(situation.network, changed)
    parts = [_mean(situation.redundancy_numbers, masks), _mean(redundancy_numbers(after), masks)]
    known = [part for part in parts if np.isfinite(part)]
    return float(np.mean(known)) if known else 1.0


def changed_observations(old: Network, new: Network) -> list[BoolArray]:
    """(n, m) observations of every group that have another value or σ than before."""
    pairs = zip(old.groups, new.groups, strict=True)
    return [a.mask & ((a.observed != b.observed) | (a.sigma != b.sigma)) for a, b in pairs]


def _mean(numbers: tuple[FloatArray, ...] | None, masks: list[BoolArray]) -> float:
    if numbers is None:
        return np.nan
    chosen = np.concatenate([r[mask] for r, mask in zip(numbers, masks, strict=False)])
    return float(np.nanmean(chosen)) if np.isfinite(chosen).any() else np.nan
