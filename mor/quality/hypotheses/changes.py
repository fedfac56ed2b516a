"""Changes of a network, and nothing else: other observed values, other names, another unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network


def with_group(network: Network, number: int, group: ObservationGroup) -> Network:
    """The network with another group in the place of one."""
    groups = list(network.groups)
    groups[number] = group
    return replace(network, groups=tuple(groups))


def with_observed(
    network: Network, number: int, rows: IntArray, change: Callable[[FloatArray], FloatArray]
) -> Network:
    """The network with the observed values (k, m) of some rows of a group changed; their faces are told anew.

    Of image coordinates the measured ones, before distortion, are changed as well.
    """
    group = network.groups[number]
    observed, constants = group.observed.copy(), group.constants.copy()
    observed[rows] = change(observed[rows])
    names = [constant.name for constant in group.type.constants]
    if group.type.tell_face is not None:
        constants[rows, names.index("face")] = group.type.tell_face(observed[rows, -1])
    if "measured x" in names:
        first = names.index("measured x")
        constants[rows, first : first + 2] = change(constants[rows, first : first + 2])
    return with_group(network, number, replace(group, observed=observed, constants=constants))


def with_blocks(
    network: Network, number: int, rows: Sequence[int], blocks: Mapping[int, Sequence[int]]
) -> Network:
    """The network with other blocks in some slots (by number) of some rows of a group."""
    group = network.groups[number]
    changed = list(group.blocks)
    for slot, values in blocks.items():
        own = changed[slot].copy()
        own[list(rows)] = values
        changed[slot] = own
    return with_group(network, number, replace(group, blocks=tuple(changed)))


def with_unknown(network: Network, kind: str, value: FloatArray, free: BoolArray) -> tuple[Network, int]:
    """The network with one more block of a kind, whose components are ``free`` (size,), and its number."""
    blocks, number = network.blocks[kind], len(network.blocks[kind].ids)
    more = np.full((1, len(value)), number, dtype=np.int64)
    nothing = np.full((1, len(value)), np.nan)
    longer = blocks._replace(
        ids=(*blocks.ids, "hypothesis"),
        free=np.concatenate([blocks.free, free[None]]),
        owner=np.concatenate([blocks.owner, more]),
        difference=None
        if blocks.difference is None
        else np.concatenate([blocks.difference, 0.0 * value[None]]),
    )
    return replace(
        network,
        blocks={**network.blocks, kind: longer},
        start={**network.start, kind: np.concatenate([network.start[kind], value[None]])},
        observed={**network.observed, kind: np.concatenate([network.observed[kind], nothing])},
        sigma={**network.sigma, kind: np.concatenate([network.sigma[kind], nothing])},
    ), number


def with_points(network: Network, points: IntArray, change: Callable[[FloatArray], FloatArray]) -> Network:
    """The network with the given coordinates (k, 3) of some points changed, observed ones as well as start values."""
    start = network.start["point"].copy()
    start[points] = change(start[points])
    network = replace(network, start={**network.start, "point": start})
    for number, group in enumerate(network.groups):
        if group.type.key not in ("observed/point", "coordinates"):
            continue
        place = np.full(len(start), -1)
        place[points] = np.arange(len(points))
        rows = np.flatnonzero(place[group.blocks[0]] >= 0)
        if len(rows) == 0:
            continue
        observed, sigma = group.observed.copy(), group.sigma.copy()
        whole = np.full((len(points), 3), np.nan)
        whole[place[group.blocks[0][rows]]] = observed[rows]
        moved = change(whole)[place[group.blocks[0][rows]]]
        same = np.isfinite(moved) == np.isfinite(observed[rows])
        if not same.all():
            continue  # what was observed of it is not the same components
        observed[rows] = moved
        network = with_group(network, number, replace(group, observed=observed, sigma=sigma))
    return network
