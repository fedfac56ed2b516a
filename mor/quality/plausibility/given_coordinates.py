"""Distances, height differences and vectors against the coordinates that are given to start from.

Given coordinates may be rough, but they are alike rough: a difference of 50 times the median of all of a table is no
noise. If all observations of a table are the same multiple of what the coordinates say, their unit is another one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import BoolArray, FloatArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of, noted, sigmas

_TIMES = 50.0
_SIGMAS = 10.0
"""σ below which a difference is noise in any case."""
_AT_LEAST = 5
_FACTOR = 2.5
"""Ratio of observed to computed lengths from which on the unit is doubted."""
_ALIKE = 0.1
"""Median deviation of ln of the ratio up to which it is the same for all."""


def steps_from_given_coordinates(network: Network) -> Iterator[Problem]:
    """Yield a note for each table of lengths in another unit, and for single rows far off the given coordinates."""
    start = {kind: array for kind, array in network.start.items() if array.ndim == 2}
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        if not group.type.distances or any(slot.kind not in start for slot in group.type.slots):
            continue
        lengths = np.array([component.quantity.length == 1 for component in group.type.components])
        if group.count < _AT_LEAST or not lengths.all():
            continue
        with np.errstate(all="ignore"):
            difference = misclosures(group, start)
        used: BoolArray = np.asarray(np.isfinite(difference).all(axis=1) & group.mask.all(axis=1))
        if np.count_nonzero(used) >= _AT_LEAST:
            yield from _of_table(group, difference, sigma, used)


def _of_table(
    group: ObservationGroup, difference: FloatArray, sigma: FloatArray, used: BoolArray
) -> Iterator[Problem]:
    observed = np.linalg.norm(group.observed[used], axis=1)
    computed = np.linalg.norm(group.observed[used] - difference[used], axis=1)
    size = np.linalg.norm(difference, axis=1)
    good = (observed > 0.0) & (computed > 0.0)
    if np.count_nonzero(good) >= _AT_LEAST:
        ratios = np.log(observed[good] / computed[good])
        ratio = float(np.median(ratios))
        if abs(ratio) > np.log(_FACTOR) and float(np.median(np.abs(ratios - ratio))) < _ALIKE:
            words = (
                f"{group.type.name}: the observations are {np.exp(ratio):.3g} times what the given coordinates say; "
                "their unit?"
            )
            yield Problem(words, group.file, line_of(group, int(np.argmax(used))))
            return
    noise = np.maximum(np.median(size[used]), np.linalg.norm(np.nan_to_num(sigma), axis=1))
    beyond = used & (size > _TIMES * noise) & (size > _SIGMAS * np.linalg.norm(np.nan_to_num(sigma), axis=1))

    def said(row: int) -> str:
        names = ", ".join(
            f"{reference.name} {column[row]}"
            for reference, column in zip(group.type.references, group.references, strict=True)
        )
        return (
            f"{group.type.name} {names}: {size[row] / float(np.median(size[used])):.0f} times as far from the given "
            "coordinates as the other rows of the table; a name or a sign?"
        )

    yield from noted(group, np.flatnonzero(beyond), said)
