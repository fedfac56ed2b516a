"""Observations on the earth, as start values take them: in the object system, as if verticals were parallel.

Over 10 km heights are wrong by some metres then, over 100 km by a few hundred: near enough to begin from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations import OBSERVED_PARAMETERS, PLAIN_TYPES, ObservationGroup, some_rows
from mor.observations.earth.attitude import in_object_axes
from mor.project.network.build import Network

_NEUTRAL = 0
"""Block of the height that nothing has."""


def to_plane(network: Network) -> Network:
    """The network with plain observations in place of those that need the ellipsoid or the sphere."""
    if network.sphere is not None:
        return replace(network, groups=tuple(_flat(group) for group in network.groups))
    if network.world is None:
        return network
    horizon = network.world.horizon
    groups = tuple(
        _attitudes(group, network.start["rotation"])
        if group.type.key in _ATTITUDES
        else _PLAIN[group.type.key](group, horizon)
        if group.type.key in _PLAIN
        else group
        for group in network.groups
    )
    return replace(network, groups=groups)


def _flat(group: ObservationGroup) -> ObservationGroup:
    return group if group.type.flat is None else replace(group, type=group.type.flat)


def _vectors(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    kept = some_rows(group, np.flatnonzero(group.mask.all(axis=1)))
    observed = kept.observed @ horizon.axes.T
    return replace(kept, type=PLAIN_TYPES["vector"], observed=observed, blocks=kept.blocks[:-1])


def _geocentric(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    kept = some_rows(group, np.flatnonzero(group.mask.all(axis=1)))
    observed = horizon.from_geocentric(kept.observed)
    return replace(kept, type=PLAIN_TYPES["coordinates"], observed=observed, blocks=kept.blocks[:-1])


def _geodetic(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    kept = some_rows(group, np.flatnonzero(group.mask.all(axis=1)))
    sigma = np.where(kept.type.wraps, kept.sigma * horizon.ellipsoid.a, kept.sigma)
    observed = horizon.from_geodetic(kept.observed)
    return replace(kept, type=PLAIN_TYPES["coordinates"], observed=observed, sigma=sigma)


def _projected(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    return replace(group, type=PLAIN_TYPES["coordinates"], observed=group.constants[:, :3])


def _control(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    observed = np.where(group.mask, group.constants[:, :3], np.nan)
    return replace(group, type=PLAIN_TYPES["coordinates"], observed=observed)


def _heights(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    geoid = group.constants[:, :1] if group.type.constants else 0.0
    nothing = np.full((group.count, 2), np.nan)
    observed, sigma = (np.hstack([nothing, column]) for column in (group.observed + geoid, group.sigma))
    return replace(group, type=PLAIN_TYPES["coordinates"], observed=observed, sigma=sigma)


def _differences(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    rise = group.constants[:, 1:] - group.constants[:, :1] if group.type.constants else 0.0
    return replace(group, type=PLAIN_TYPES["height_difference"], observed=group.observed + rise)


def _bearings(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    return replace(group, type=PLAIN_TYPES["bearing"])


def _level_bearings(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    start, end = group.blocks
    flat = np.full(group.count, _NEUTRAL, dtype=np.int64)
    return replace(group, type=PLAIN_TYPES["bearing"], blocks=(start, flat, end, flat))


def _distances(group: ObservationGroup, horizon: Horizon) -> ObservationGroup:
    start, end, meter = group.blocks
    flat = np.full(group.count, _NEUTRAL, dtype=np.int64)
    return replace(group, type=PLAIN_TYPES["horizontal_distance"], blocks=(start, flat, end, flat, meter))


def _attitudes(group: ObservationGroup, rotations: FloatArray) -> ObservationGroup:
    kept = some_rows(group, np.flatnonzero(group.mask.all(axis=1)))
    _, image, boresight = kept.blocks
    observed = in_object_axes(kept.type, kept.observed, kept.constants, rotations[boresight])
    return replace(kept, type=OBSERVED_PARAMETERS["rotation"], observed=observed, blocks=(image,))


_PLAIN: dict[str, Callable[[ObservationGroup, Horizon], ObservationGroup]] = {
    "gnss_vector": _vectors,
    "gnss_position": _geocentric,
    "geodetic_position": _geodetic,
    "projected_position": _projected,
    "control": _control,
    "ellipsoidal_height": _heights,
    "orthometric_height": _heights,
    "height_difference": _differences,
    "ellipsoidal_height_difference": _differences,
    "azimuth": _bearings,
    "astronomic_azimuth": _bearings,
    "projected_bearing": _level_bearings,
    "ellipsoid_arc": _distances,
    "ellipsoid_chord": _distances,
    "mean_sea_level_distance": _distances,
    "height_reduced_distance": _distances,
}
_ATTITUDES = ("projected_attitude", "navigation_attitude")
