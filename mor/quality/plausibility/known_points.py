"""Observations between places that are known, against what follows from their coordinates.

Where everything an observation refers to is fixed, or observed itself with a σ, observed − computed is a misclosure
with the variance σ² + J Σ Jᵀ of the observation and the known values. A set of horizontal directions has its
orientation besides, taken as the median of the misclosures of its known targets. All misclosures together are tested
with one level.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.arrays import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup, some_rows, wrap
from mor.project.network.build import Network
from mor.quality.plausibility.places import noted, sigmas
from mor.quality.tests.levels import sidak
from mor.quality.tests.test_statistics import critical_value

LEVEL = 0.001
"""Of all misclosures of a kind together: a note is something to go and look at."""


class Misclosures(NamedTuple):
    """Of some rows of a group, (k, m) each; NaN where something is not known."""

    rows: IntArray
    size: FloatArray
    sigma: FloatArray


def contradicting_known_points(network: Network) -> Iterator[Problem]:
    """Observations that known coordinates contradict."""
    pairs = zip(network.groups, sigmas(network), strict=True)
    found = [(group, _misclosures(network, group, sigma)) for group, sigma in pairs]
    tests = sum(int(np.isfinite(one.size).sum()) for _, one in found)
    if tests == 0:
        return
    critical = critical_value(sidak(LEVEL, tests))
    for group, one in found:
        with np.errstate(invalid="ignore"):
            beyond = np.abs(one.size) > critical * one.sigma
        bad = np.flatnonzero(beyond.any(axis=1))
        place = {int(one.rows[k]): int(k) for k in bad}

        def said(row: int, group=group, one=one, place=place) -> str:  # type: ignore[no-untyped-def]
            k = place[row]
            component = int(np.nanargmax(np.abs(one.size[k] / one.sigma[k])))
            return _sentence(
                group, row, component, float(one.size[k, component]), float(one.sigma[k, component])
            )

        yield from noted(group, one.rows[bad], said)


def _sentence(group: ObservationGroup, row: int, component: int, size: float, sigma: float) -> str:
    names = ", ".join(
        f"{reference.name} {names[row]}"
        for reference, names in zip(group.type.references, group.references, strict=True)
    )
    factor, unit = 1.0, ""
    if group.external is not None:
        outside = int(np.argmax(np.abs(group.external.transform[component])))
        factor, unit = float(group.external.factors[outside]), group.external.units[outside]
    return (
        f"{group.type.name} {names}, {group.type.components[component].name}: {size / factor:.4g} {unit} beside what "
        f"known coordinates say ({abs(size) / sigma:.0f} sigma)"
    )


def _misclosures(network: Network, group: ObservationGroup, sigma: FloatArray) -> Misclosures:
    nothing = Misclosures(
        np.zeros(0, dtype=np.int64), *(np.zeros((0, group.observed.shape[1])) for _ in range(2))
    )
    if not group.count or group.type.key.startswith(
        ("observed/", "difference/", "image/", "follower/", "moving/", "level")
    ):
        return nothing
    turning = _turning_slot(group)
    known = np.ones(group.count, dtype=bool)
    for k, (slot, blocks) in enumerate(zip(group.type.slots, group.blocks, strict=True)):
        known &= _known(network, slot.kind, turning == k)[blocks]
    rows = np.flatnonzero(known)
    if not len(rows):
        return nothing
    some = some_rows(group, rows)
    values = {kind: np.where(np.isfinite(array), array, 0.0) for kind, array in network.start.items()}
    here = [values[slot.kind][own] for slot, own in zip(some.type.slots, some.blocks, strict=True)]
    if turning >= 0:
        here[turning] = np.broadcast_to(np.eye(3), here[turning].shape)
    computed = some.type.equation(here, some.constants)
    size = some.observed - computed.values
    size[:, group.type.wraps] = wrap(size[:, group.type.wraps])
    variance = sigma[rows] ** 2
    for k, (slot, own) in enumerate(zip(some.type.slots, some.blocks, strict=True)):
        if k != turning and slot.kind in network.sigma:
            given = np.where(network.blocks[slot.kind].free, np.nan_to_num(network.sigma[slot.kind]), 0.0)
            if given.shape[1] == computed.jacobians[k].shape[2]:
                variance = variance + np.einsum("nmk,nk->nm", computed.jacobians[k] ** 2, given[own] ** 2)
    if turning >= 0:
        size = _oriented(some.blocks[turning], size)
    return Misclosures(rows, size, np.sqrt(variance))


def _known(network: Network, kind: str, turning: bool) -> BoolArray:
    """(n,) blocks of a kind all of whose components are fixed, or observed with a σ."""
    blocks = network.blocks[kind]
    if turning:  # a levelled set is known but for its orientation
        return np.asarray(~blocks.free[:, :2].any(axis=1))
    given = (
        np.isfinite(network.sigma[kind]) if kind in network.sigma else np.zeros(blocks.free.shape, dtype=bool)
    )
    start = network.start[kind]
    present = np.isfinite(start.reshape(len(start), -1)).all(axis=1)
    return np.asarray((~blocks.free | given).all(axis=1) & present)


def _turning_slot(group: ObservationGroup) -> int:
    """The slot of the rotation of a set of directions, −1 for all else."""
    if group.type.references[0].name != "station":
        return -1
    return next((k for k, slot in enumerate(group.type.slots) if slot.kind == "rotation"), -1)


def _oriented(frames: AnyIntArray, size: FloatArray) -> FloatArray:
    """Misclosures with the orientation of their set taken out; NaN where a set has fewer than three known targets."""
    turned = size.copy()
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        if len(here) < 3:
            turned[here, 0] = np.nan
            continue
        first = size[here[0], 0]
        apart = wrap(size[here, 0] - first)
        turned[here, 0] = wrap(apart - np.nanmedian(apart))
    return turned
