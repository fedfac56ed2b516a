"""How well the rays of a network meet at given values, before anything is adjusted."""

from __future__ import annotations

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import IntArray
from mor.observations import can_be_at_infinity, target_slot
from mor.parameters.index import Values
from mor.project.network.build import Network

_SAMPLE = 20_000
"""Rays of a group that tell how well the values fit."""
_NORMAL = 1.4826
"""σ of normally distributed errors over the median of their sizes."""


def misfit(network: Network, values: Values, but: IntArray) -> float:
    """How far rays pass by their points in units of σ, 1 at least: the median, made equal to σ for normal errors.

    Rays to the points ``but`` (k,) have no say, for their places are in question.
    """
    if len(but) == 0:
        return 1.0
    apart = np.zeros(len(network.blocks["point"].ids), dtype=bool)
    apart[but] = True
    sizes = [np.zeros(0)]
    for group in network.groups:
        if can_be_at_infinity(group.type):
            rows = np.flatnonzero(~apart[group.blocks[target_slot(group.type)]])
            rows = rows[:: max(1, len(rows) // _SAMPLE)]
            sizes.append((misclosures(group, values, rows) / group.sigma[rows]).ravel())
    sample = np.abs(np.concatenate(sizes))
    sample = sample[np.isfinite(sample)]
    return max(1.0, _NORMAL * float(np.median(sample))) if len(sample) else 1.0
