"""Start values of local systems and features from the points that were measured in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.approximate.parts.movement import Ties, Turn, movement
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.parameters.index import Blocks
from mor.project.network.build import Network


class _Measured(NamedTuple):
    """What was measured in one system, from all tables."""

    origin: int
    rotation: int
    scale: int
    offset: int
    points: IntArray
    local: FloatArray
    """(n, 3) NaN where not observed."""


def fill_systems(network: Network, start: dict[str, FloatArray]) -> None:
    """Fill in origin, attitude, scale and offset of the systems that lack them, (X̄, Ȳ, Z̄) = λ D (X − X0) + r̄.

    Of planes, lines and right angles whose points had no coordinates when the project was read, all are made anew.
    """
    for one in _systems(network):
        anew = _is_feature(network.blocks["rotation"], one) and bool(
            np.isnan(network.start["point"][one.points]).any()
        )
        known = np.isfinite(start["point"][one.points]).all(axis=1)
        lacking = (
            np.isnan(start["rotation"][one.rotation]).any() or np.isnan(start["point"][one.origin]).any()
        )
        if (lacking or anew) and np.isfinite(one.local[known]).any():
            one = one._replace(points=one.points[known], local=one.local[known])
            _fill(network, start, one, anew)


def _systems(network: Network) -> Iterator[_Measured]:
    groups = [group for group in network.groups if group.type.key == "local" and group.count]
    if not groups:
        return
    blocks = [np.concatenate([group.blocks[slot] for group in groups]).astype(np.int64) for slot in range(5)]
    local = np.concatenate([group.observed for group in groups])
    for rotation in np.unique(blocks[1]):
        rows = np.flatnonzero(blocks[1] == rotation)
        origin, _, scale, offset = (int(blocks[slot][rows[0]]) for slot in range(4))
        yield _Measured(origin, int(rotation), scale, offset, blocks[4][rows], local[rows])


def _is_feature(blocks: Blocks, one: _Measured) -> bool:
    return blocks.about_axes is not None and bool(blocks.about_axes[one.rotation])


def _fill(network: Network, start: dict[str, FloatArray], one: _Measured, anew: bool) -> None:
    points = start["point"][one.points]
    free = bool(network.blocks["scale"].free[one.scale, 0])
    scale = 1.0 if free else float(start["scale"][one.scale, 0])
    D = start["rotation"][one.rotation]
    if anew or np.isnan(D).any():
        none = np.zeros((0, 3))
        found = movement(Ties(scale * points, one.local, none, none), Turn.ANY, not free)
        if found is None:
            return
        scale, D = scale * found.scale, found.rotation
        start["rotation"][one.rotation] = D
        if free:
            start["scale"][one.scale, 0] = scale
    # Mean of what shift and offset have to make up for; a component that was not observed asks for nothing.
    seen = np.isfinite(one.local)
    away = np.where(seen, one.local - scale * points @ D.T, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    _put_origin(network, start, one, anew, scale * D, away, np.asarray(seen.any(axis=0)), points.mean(axis=0))


def _put_origin(
    network: Network,
    start: dict[str, FloatArray],
    one: _Measured,
    anew: bool,
    turned: FloatArray,
    away: FloatArray,
    seen: BoolArray,
    centre: FloatArray,
) -> None:
    """Origin and offset with r̄ − λ D X0 = ``away`` in the components that were observed."""
    origin, offset = start["point"][one.origin], start["eccentricity"][one.offset]
    missing = np.isnan(origin) | anew
    origin[missing] = centre[missing]
    gap = away - (np.nan_to_num(offset) - turned @ origin)
    gap[~seen] = 0.0
    if missing.any() and not anew:
        origin[missing] -= tolerant.lstsq(turned[np.ix_(seen, missing)], gap[seen], rcond=None)
        return
    loose = network.blocks["eccentricity"].free[one.offset]
    offset[loose] += gap[loose]
