"""Levelled sights of a network: sets of directions, angles and bearings, and the lengths between positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.terrestrial.direction_sets import direction_sets, frame_verticals
from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network

UPRIGHT = 1.0 - 1e-5
"""Cosine of the tilt up to which an instrument counts as levelled (0.3 gon)."""


class Sight(NamedTuple):
    """A levelled set at one position: directions r = t + κ clockwise, vertical directions; NaN where there is none."""

    name: str
    position: int
    rotation: int
    """Rotation block that gets κ, −1 for angles and bearings."""
    oriented: bool
    """True where κ = 0 is known: bearings."""
    height: float
    points: IntArray
    heights: FloatArray
    directions: FloatArray
    verticals: FloatArray


class Lengths(NamedTuple):
    """Measured lengths, height differences or vectors between positions, with the heights of instrument and target."""

    start: IntArray
    end: IntArray
    start_height: FloatArray
    end_height: FloatArray
    start_block: IntArray
    """Height block of the instrument."""
    value: FloatArray
    """(n, m)."""
    sigma: FloatArray
    """(n,) the largest of a row."""


class Terrestrial(NamedTuple):
    """Everything terrestrial that start values can be taken from."""

    sights: tuple[Sight, ...]
    slopes: Lengths
    horizontals: Lengths
    height_differences: Lengths
    vectors: Lengths
    verticals: Lengths
    """Vertical directions between two positions, reduced to face one."""


def terrestrial(network: Network) -> Terrestrial:
    """Sights and lengths of a network."""
    sights = _sets(network)
    for group in network.groups:
        if group.type.key == "angle":
            sights += _angles(group)
        elif group.type.key == "bearing":
            sights += _bearings(group)
    return Terrestrial(
        tuple(sights),
        _lengths(network, "distance"),
        _lengths(network, "horizontal_distance"),
        _lengths(network, "height_difference"),
        _lengths(network, "vector"),
        _verticals(network),
    )


def _sets(network: Network) -> list[Sight]:
    """Sets that stand upright; a tilted one is a frame like an image, no more."""
    up = frame_verticals(network)
    heights = network.start["height"][:, 0]
    return [
        Sight(
            one.name,
            one.position,
            one.rotation,
            False,
            float(heights[one.height]),
            one.points,
            one.heights,
            one.horizontal,
            one.vertical,
        )
        for one in direction_sets(network)
        if up[one.rotation, 2] > UPRIGHT
    ]


def _angles(group: ObservationGroup) -> list[Sight]:
    """Angles at one point, those with common legs joined to one set."""
    at, back, fore = group.blocks
    sights = []
    for station in np.unique(at):
        rows = np.flatnonzero(at == station)
        remaining = {(int(back[i]), int(fore[i])): float(group.observed[i, 0]) for i in rows}
        while remaining:
            (first, second), angle = next(iter(remaining.items()))
            legs = {first: 0.0, second: angle}
            grown = True
            while grown:
                grown = False
                for (b, f), beta in remaining.items():
                    if b in legs and f not in legs:
                        legs[f], grown = legs[b] + beta, True
                    elif f in legs and b not in legs:
                        legs[b], grown = legs[f] - beta, True
            remaining = {key: beta for key, beta in remaining.items() if key[0] not in legs}
            points = np.array(list(legs), dtype=np.int64)
            none = np.full(len(points), np.nan)
            sights.append(
                Sight(
                    "angles",
                    int(station),
                    -1,
                    False,
                    0.0,
                    points,
                    np.zeros(len(points)),
                    np.array(list(legs.values())),
                    none,
                )
            )
    return sights


def _bearings(group: ObservationGroup) -> list[Sight]:
    start, start_height, end, end_height = group.blocks
    del start_height, end_height
    return [
        Sight("bearing", int(a), -1, True, 0.0, np.array([b]), np.zeros(1), np.array([t]), np.full(1, np.nan))
        for a, b, t in zip(start, end, group.observed[:, 0], strict=True)
    ]


def _lengths(network: Network, key: str) -> Lengths:
    groups = [group for group in network.groups if group.type.key == key]
    return _collected(network, groups, [group.observed for group in groups])


def _verticals(network: Network) -> Lengths:
    groups, values = [], []
    for group in network.groups:
        if group.type.key == "zenith_angle":
            second = group.constants[:, 1] == 2.0
            given = group.observed[:, 0]
            values.append(np.where(second, given - 1.5 * np.pi, 0.5 * np.pi - given)[:, None])
        elif group.type.key == "vertical_direction":
            values.append(group.observed)
        else:
            continue
        groups.append(group)
    return _collected(network, groups, values)


def _collected(network: Network, groups: list[ObservationGroup], values: list[FloatArray]) -> Lengths:
    none = np.zeros(0, dtype=np.int64)
    heights = network.start["height"][:, 0]
    width = values[0].shape[1] if values else 1
    return Lengths(
        np.concatenate([none, *(group.blocks[0] for group in groups)]),
        np.concatenate([none, *(group.blocks[2] for group in groups)]),
        np.concatenate([np.zeros(0), *(heights[group.blocks[1]] for group in groups)]),
        np.concatenate([np.zeros(0), *(heights[group.blocks[3]] for group in groups)]),
        np.concatenate([none, *(group.blocks[1] for group in groups)]),
        np.concatenate([np.zeros((0, width)), *values]),
        np.concatenate([np.zeros(0), *(np.nan_to_num(group.sigma).max(axis=1) for group in groups)]),
    )
