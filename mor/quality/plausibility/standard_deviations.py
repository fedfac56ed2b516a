"""Standard deviations that no instrument has: against the circle, the length or the image they belong to.

No angle is read to 1e-9 of a radian (0.06 µgon), no length to 1e-9 of itself, no image coordinate to 1e-7 of the image;
and nobody measures a direction to a tenth of a radian, a distance to its own size, an image to a tenth of its width.
A σ beyond that is in another unit, or was meant for something else. A single row of many that is given a large σ so as
not to count is not noted.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of, sigmas
from mor.units import ANGLE

_SMALLEST = {"angle": 1e-9, "length": 1e-9, "image": 1e-7}
_LARGEST = {"angle": 0.1, "length": 1.0, "image": 0.1}


def implausible_sigmas(network: Network) -> Iterator[Problem]:
    """Components of tables most of whose σ are implausible, with the first row."""
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        if not group.count or group.type.key.startswith(("observed/", "difference/")):
            continue
        for component in range(group.observed.shape[1]):
            yield from _component(group, sigma, component)


def beyond_any_instrument(network: Network, group: ObservationGroup) -> int:
    """1 where most σ of all components of a group are too small for any instrument, −1 where too large, else 0."""
    if not group.count or group.type.key.startswith(("observed/", "difference/")):
        return 0
    number = next(k for k, own in enumerate(network.groups) if own is group)
    sigma = sigmas(network)[number]
    signs = {_beyond(group, sigma, component)[0] for component in range(group.observed.shape[1])}
    return signs.pop() if len(signs) == 1 else 0


def _component(group: ObservationGroup, sigma: FloatArray, component: int) -> Iterator[Problem]:
    sign, row = _beyond(group, sigma, component)
    if sign:
        words = "smaller" if sign > 0 else "larger"
        name = group.type.components[component].name
        said = f"{group.type.name}, {name}: the standard deviation is {words} than that of any instrument; its unit?"
        yield Problem(said, group.file, line_of(group, row))


def _beyond(group: ObservationGroup, sigma: FloatArray, component: int) -> tuple[int, int]:
    """1 where most σ of a component are too small, −1 where too large, else 0; and the first such row."""
    kind = _kind(group, component)
    here = group.mask[:, component]
    if not kind or not here.any():
        return 0, 0
    own, sizes = sigma[here, component], _sizes(group, component, kind, here)
    for sign, beyond in ((1, own < _SMALLEST[kind] * sizes), (-1, own > _LARGEST[kind] * sizes)):
        if 2 * np.count_nonzero(beyond) > len(beyond):
            return sign, int(np.flatnonzero(here)[np.argmax(beyond)])
    return 0, 0


def _kind(group: ObservationGroup, component: int) -> str:
    quantity = group.type.components[component].quantity
    if quantity.image == 1:
        return "image"
    if quantity == ANGLE:
        return "angle"
    return "length" if quantity.length == 1 and group.type.distances and not group.type.between_marks else ""


def _sizes(group: ObservationGroup, component: int, kind: str, here: BoolArray) -> FloatArray:
    """What a σ is compared with, for each row: 1 rad, the length itself, the widest image coordinate; NaN for 0."""
    observed = group.observed[here, component]
    if kind == "angle":
        return np.ones(len(observed))
    if kind == "length":
        return np.where(observed == 0.0, np.nan, np.abs(observed))
    widest = float(np.fmax.reduce(np.abs(group.observed), axis=None))
    return np.full(len(observed), widest if widest > 0.0 else np.nan)
