"""Standard deviations in another unit: those that no instrument has, and those a thousand times off the residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import BoolArray, FloatArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.hypotheses.changes import with_group
from mor.quality.hypotheses.hypothesis import Hypothesis
from mor.quality.hypotheses.situation import Situation
from mor.quality.plausibility.standard_deviations import beyond_any_instrument

_FACTORS = (1e3, 1e-3, 1e6, 1e-6)
_NEAR = 4.0
"""Factor within which residuals that are too large agree with a unit; those too small have no other reason."""
_AT_LEAST = 5
_FACTOR_OF_UNITS = 1e3


def sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Groups whose σ nobody has, or whose residuals in units of their σ are near to the factor between two units."""
    return [
        h
        for number, group in enumerate(situation.network.groups)
        for h in _of_group(situation, number, group)
    ]


def _of_group(situation: Situation, number: int, group: ObservationGroup) -> Iterator[Hypothesis]:
    used = group.mask & ~group.left_out
    count = int(np.count_nonzero(used))
    if count < _AT_LEAST:
        return
    beyond = beyond_any_instrument(situation.network, group)
    if beyond:
        # What such a σ says of how likely residuals are counts for nothing.
        yield _hypothesis(number, group.name, _FACTOR_OF_UNITS**beyond, 0)
    scales = [_scale(sizes, used) for sizes in _sizes(situation, number, group)]
    for factor in _FACTORS:
        near = _NEAR if factor > 1.0 else np.sqrt(_FACTOR_OF_UNITS)
        if any(1.0 / near < scale / factor < _NEAR for scale in scales) and not beyond:
            yield _hypothesis(number, group.name, factor, count)


def _sizes(situation: Situation, number: int, group: ObservationGroup) -> Iterator[FloatArray]:
    """|v|/σ where most observations fit, and of the adjustment of all of them."""
    yield situation.sizes[number]
    if situation.solution is not None:
        yield np.abs(misclosures(group, situation.solution.values) / group.given_sigma)


def _scale(sizes: FloatArray, used: BoolArray) -> float:
    return float(np.median(sizes[used])) / 0.6745


def _hypothesis(number: int, name: str, factor: float, count: int) -> Hypothesis:
    def change(network: Network) -> Network:
        group = network.groups[number]
        return with_group(network, number, replace(group, sigma=group.sigma * factor))

    line = f"observations, {name}: factor: {factor:g}"
    return Hypothesis(
        "sigma unit", (name,), change, line, len(_FACTORS), stretch=-count * float(np.log(factor))
    )
