"""A network without some of its things, or with some of its points at infinity: the rest stays as it was read.

Blocks keep their numbers. Those left out are held at any value, and no observation refers to them any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Undeterminable
from mor.observations import (
    AT_INFINITY,
    FREE_TURNS,
    PERFECT_SET_UP,
    ObservationGroup,
    at_infinity,
    some_rows,
    target_slot,
)
from mor.parameters.index import Blocks, Values
from mor.project.network.build import Network
from mor.project.observations.correlations import Correlation

Marked: TypeAlias = Mapping[str, BoolArray]
"""(n,) blocks of each kind that are meant."""


def nothing_marked(network: Network) -> dict[str, BoolArray]:
    """No block of any kind."""
    return {kind: np.zeros(len(blocks.ids), dtype=bool) for kind, blocks in network.blocks.items()}


def touches(group: ObservationGroup, marked: Marked) -> BoolArray:
    """(n,) rows of a group that refer to a marked block."""
    touched = np.zeros(group.count, dtype=bool)
    for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
        touched |= marked[slot.kind][numbers]
    return touched


def rows_of_points(network: Network) -> IntArray:
    """(points,) rows of observations that refer to each point block."""
    rows = np.zeros(len(network.blocks["point"].ids), dtype=np.int64)
    for group in network.groups:
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point":
                rows += np.bincount(numbers, minlength=len(rows))
    return rows


def without_blocks(network: Network, marked: Marked, things: Sequence[Undeterminable]) -> Network:
    """The network without some blocks and all observations that refer to them; ``things`` says what they are."""
    kept = [~touches(group, marked) for group in network.groups]
    blocks = {
        kind: table._replace(free=table.free & ~marked[kind][:, None])
        for kind, table in network.blocks.items()
    }
    checks = (some_rows(group, np.flatnonzero(~touches(group, marked))) for group in network.checks)
    return replace(
        network,
        blocks=blocks,
        start={kind: _filled(values, marked[kind]) for kind, values in network.start.items()},
        groups=tuple(_taken(group, rows) for group, rows in zip(network.groups, kept, strict=True)),
        checks=tuple(group for group in checks if group.count),
        correlations=_remaining(network.correlations, kept),
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_absent(network, marked),
    )


def with_blocks_held(network: Network, marked: Marked, things: Sequence[Undeterminable]) -> Network:
    """The network with some blocks held where they are, of which no observation that counts says anything.

    Their observations stay, for they are told. ``things`` says what they are.
    """
    if not things:
        return network
    blocks = {
        kind: table._replace(free=table.free & ~marked[kind][:, None])
        for kind, table in network.blocks.items()
    }
    return replace(
        network,
        blocks=blocks,
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_absent(network, marked),
    )


def with_points_at_infinity(
    network: Network,
    start: Values,
    points: IntArray,
    directions: FloatArray,
    things: Sequence[Undeterminable],
) -> tuple[Network, dict[str, FloatArray]]:
    """The network with the rays to ``points`` (k,) as rays to directions, and its start values.

    ``directions`` (k, 3, 3) are rotations D whose third rows are the directions.
    """
    first = len(network.blocks["rotation"].ids) if "rotation" in network.blocks else 0
    number = np.full(len(network.blocks["point"].ids), -1, dtype=np.int64)
    number[points] = first + np.arange(len(points))
    far = {**nothing_marked(network), "point": number >= 0}
    kept = [~touches(group, far) for group in network.groups]
    near = [_taken(group, rows) for group, rows in zip(network.groups, kept, strict=True)]
    others = [
        _seen_far(some_rows(group, np.flatnonzero(~rows)), number)
        for group, rows in zip(network.groups, kept, strict=True)
        if not rows.all()
    ]
    point = network.blocks["point"]
    blocks = {
        **network.blocks,
        "point": point._replace(free=point.free & (number < 0)[:, None]),
        "rotation": _with_directions(network.blocks["rotation"], [f"point {point.ids[p]}" for p in points]),
    }
    empty = np.full((len(points), 3), np.nan)
    reduced = replace(
        network,
        blocks=blocks,
        start=_with_rotations(network.start, directions),
        groups=(*near, *others),
        correlations=_remaining(network.correlations, kept),
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_with_rotations_there(_absent(network, {"point": number >= 0}), len(points)),
        directions={int(p): first + k for k, p in enumerate(points)},
        observed=_with_rotations(network.observed, empty),
        sigma=_with_rotations(network.sigma, empty),
    )
    return reduced, _with_rotations(start, directions)


def _with_rotations(values: Values, more: FloatArray) -> dict[str, FloatArray]:
    return {**values, "rotation": np.concatenate([values["rotation"], more])}


def _with_rotations_there(absent: Mapping[str, BoolArray], more: int) -> dict[str, BoolArray]:
    """Marks of what is absent, with those of so many rotations more, which are not."""
    if "rotation" not in absent:
        return dict(absent)
    return {**absent, "rotation": np.concatenate([absent["rotation"], np.zeros(more, dtype=bool)])}


def _absent(network: Network, marked: Marked) -> dict[str, BoolArray]:
    return {
        kind: network.absent[kind] | blocks if kind in network.absent else blocks
        for kind, blocks in {**network.absent, **marked}.items()
    }


def _seen_far(group: ObservationGroup, number: IntArray) -> ObservationGroup:
    """Rows to far points as rows to their directions, whose block numbers are ``number`` (points,)."""
    type_ = at_infinity(group.type)
    own = dict(zip(group.type.slots, group.blocks, strict=True))
    return replace(
        group,
        name=group.name + AT_INFINITY,
        type=type_,
        blocks=(*(own[slot] for slot in type_.slots[:-1]), number[group.blocks[target_slot(group.type)]]),
        ppm=0.0,
        centring=PERFECT_SET_UP,
    )


def _with_directions(blocks: Blocks, ids: Sequence[str]) -> Blocks:
    count, more = len(blocks.ids), len(ids)
    about = np.zeros(count, dtype=bool) if blocks.about_axes is None else blocks.about_axes
    own = np.broadcast_to(np.arange(count, count + more)[:, None], (more, 3))
    apart = blocks.difference
    return blocks._replace(
        difference=None if apart is None else np.concatenate([apart, np.zeros((more, 3))]),
        ids=(*blocks.ids, *ids),
        free=np.concatenate([blocks.free, np.broadcast_to(np.array(FREE_TURNS), (more, 3))]),
        owner=np.concatenate([blocks.owner, own]),
        about_axes=np.concatenate([about, np.ones(more, dtype=bool)]),
    )


def _taken(group: ObservationGroup, rows: BoolArray) -> ObservationGroup:
    return group if rows.all() else some_rows(group, np.flatnonzero(rows))


def _filled(values: FloatArray, marked: BoolArray) -> FloatArray:
    """Values with any number where a block is left out and has none."""
    unknown = marked & ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if not unknown.any():
        return values
    filled = values.copy()
    filled[unknown] = np.eye(3) if values.ndim == 3 else 0.0
    return filled


def _remaining(correlations: Sequence[Correlation], kept: Sequence[BoolArray]) -> tuple[Correlation, ...]:
    """Clusters of the rows that are kept, renumbered: of the others their covariance is left out."""
    if all(rows.all() for rows in kept):
        return tuple(correlations)
    renumbered = [np.cumsum(rows) - 1 for rows in kept]
    result = []
    for cluster in correlations:
        stays = np.array([kept[g][r] for g, r in zip(cluster.groups, cluster.rows, strict=True)], dtype=bool)
        if not stays.any():
            continue
        groups, rows = cluster.groups[stays], cluster.rows[stays]
        rows = np.array([renumbered[g][r] for g, r in zip(groups, rows, strict=True)], dtype=np.int64)
        part = cluster.covariance[np.ix_(stays, stays)]
        result.append(Correlation(groups, rows, cluster.components[stays], part))
    return tuple(result)
