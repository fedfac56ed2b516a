"""Standard deviations in another unit: residuals of a whole group that are a thousand times too large, or too small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.project.network.build import Network
from mor.quality.hypotheses.changes import with_group
from mor.quality.hypotheses.hypothesis import Hypothesis
from mor.quality.hypotheses.situation import Situation

_FACTORS = (1e3, 1e-3, 1e6, 1e-6)
_NEAR = 4.0
"""Factor within which the residuals of a group agree with a unit."""
_AT_LEAST = 5


def sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Groups whose residuals, in units of their σ, are near to the factor between two units."""
    found = []
    for number, group in enumerate(situation.network.groups):
        size = situation.sizes[number][group.mask & ~group.left_out]
        if size.size < _AT_LEAST:
            continue
        scale = float(np.median(size)) / 0.6745
        for factor in _FACTORS:
            if 1.0 / _NEAR < scale / factor < _NEAR:
                found.append(_hypothesis(number, group.name, factor, size.size))
    return found


def _hypothesis(number: int, name: str, factor: float, count: int) -> Hypothesis:
    def change(network: Network) -> Network:
        group = network.groups[number]
        return with_group(network, number, replace(group, sigma=group.sigma * factor))

    line = f"observations, {name}: factor: {factor:g}"
    return Hypothesis(
        "sigma unit", (name,), change, line, len(_FACTORS), stretch=-count * float(np.log(factor))
    )
