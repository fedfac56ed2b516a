"""Standard deviations in another unit: those that no instrument has, and those a thousand times off the residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import BoolArray, FloatArray
from mor.diagnose.edits import KeyEdit, table_of
from mor.diagnose.hypothesis import Hypothesis, with_group
from mor.diagnose.situation import Situation
from mor.observations import ObservationGroup
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.plausibility.standard_deviations import beyond_any_instrument
from mor.quality.solved import Amount

_FACTORS = (1e3, 1e-3, 1e6, 1e-6)
_NEAR = 4.0
"""Factor within which residuals that are too large agree with a unit; those too small have no other reason."""
_AT_LEAST = 5
_FACTOR_OF_UNITS = 1e3


def sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Groups whose σ nobody has; without any, those whose residuals are near to the factor between two units.

    As long as a σ is one that nobody has, residuals in units of others say nothing.
    """
    groups = [
        (number, group, int(np.count_nonzero(group.mask & ~group.left_out)))
        for number, group in enumerate(situation.network.groups)
    ]
    groups = [one for one in groups if one[2] >= _AT_LEAST]
    found = []
    for number, group, count in groups:
        beyond = beyond_any_instrument(situation.network, group)
        if beyond:  # what too small a σ says of how likely residuals are counts for nothing
            told = count if beyond < 0 else 0
            found.append(_hypothesis(situation, number, group.name, _FACTOR_OF_UNITS**beyond, told))
    return found or [h for number, group, count in groups for h in _near_to_units(situation, number, count)]


def scored_sigma_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the tables whose σ is wrong by the factor that score tests name."""
    found = []
    for one in situation.scored:
        for number, group in enumerate(situation.network.groups):
            if one.cause == "sigma of a table" and one.things == (group.name,) and one.amount is not None:
                count = int(np.count_nonzero(group.mask & ~group.left_out))
                plain = _hypothesis(situation, number, group.name, float(f"{one.amount.value:.3g}"), count)
                found.append(
                    replace(
                        plain, cause="sigma of a table", parameters=1, amount=partial(_the_same, one.amount)
                    )
                )
    return found


def _the_same(amount: Amount, _values: Values) -> Amount:
    return amount


def _near_to_units(situation: Situation, number: int, count: int) -> Iterator[Hypothesis]:
    group = situation.network.groups[number]
    used = group.mask & ~group.left_out
    scales = list(_scales(situation, number, group, used))
    for factor in _FACTORS:
        near = _NEAR if factor > 1.0 else np.sqrt(_FACTOR_OF_UNITS)
        if any(1.0 / near < scale / factor < near for scale in scales):
            yield _hypothesis(situation, number, group.name, factor, count)


def _scales(situation: Situation, number: int, group: ObservationGroup, used: BoolArray) -> Iterator[float]:
    """Factors of σ by the median where most observations fit, and in the adjustment of all of them.

    Of the latter also √(Ω/Σ r), with the residuals and redundancy numbers of the group (W. Förstner 1979): the median
    of sights so precise that all else follows them is next to nothing.
    """
    yield _median(situation.sizes[number][used])
    if situation.solution is None:
        return
    sizes = np.abs(misclosures(group, situation.solution.values) / group.given_sigma)
    yield _median(sizes[used])
    if situation.redundancy_of_solution is not None:
        numbers = situation.redundancy_of_solution[number]
        known = used & np.isfinite(numbers)
        freedom = float(np.sum(numbers[known]))
        yield float(np.sqrt(np.sum(sizes[known] ** 2) / freedom)) if freedom > 0.0 else np.nan


def _median(sizes: FloatArray) -> float:
    return float(np.median(sizes)) / 0.6745


def _hypothesis(situation: Situation, number: int, name: str, factor: float, count: int) -> Hypothesis:
    def change(network: Network) -> Network:
        group = network.groups[number]
        return with_group(network, number, replace(group, sigma=group.sigma * factor))

    line, at = f"observations, {name}: factor: {factor:g}", table_of(situation.network, number)
    return Hypothesis(
        "sigma unit",
        (name,),
        change,
        line,
        len(_FACTORS),
        stretch=-count * float(np.log(factor)),
        edits=()
        if at is None
        else (KeyEdit((*at, "factor"), lambda old, _: f"{float(old or 1) * factor:g}"),),
    )
