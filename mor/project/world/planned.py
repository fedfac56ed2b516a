"""Networks on the earth whose place is given beforehand: what their observations must know, and simulated control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.project.world.observed import MEANT, needs_convergence, needs_place
from mor.project.world.planes_over import with_planes_over
from mor.project.world.world import World


def known_at_place(network: Network, place: Mapping[str, FloatArray]) -> Network:
    """The network with projections linearised at the place, where nothing may have been observed yet.

    Raises :class:`InputError` if a height above the geoid is meant, and nothing says where that is.
    """
    world = network.world
    if world is None:
        return network
    of_all = {
        name: tuple(_known(network, world, group, place["point"]) for group in getattr(network, name))
        for name in ("groups", "checks", "candidates")
    }
    return with_planes_over(replace(network, **of_all), place)  # type: ignore[arg-type]


def _known(network: Network, world: World, group: ObservationGroup, points: FloatArray) -> ObservationGroup:
    if needs_convergence(group.type):
        there = world.from_object(points[group.blocks[0]], np.zeros(group.count))
        return replace(group, constants=world.convergence(there[:, :2])[:, None])
    if not needs_place(group.type):
        return group
    position = points[group.blocks[0]]
    N = np.zeros(group.count)
    if world.orthometric:
        before = group.constants
        N = world.horizon.foot(before[:, :3]).height - before[:, 9]  # as it was given, or of the grid
        N = np.where(np.isfinite(before).all(axis=1), N, world.geoid_at(group.blocks[0], position))
        lost = np.isnan(N)
        if lost.any():
            row = int(np.argmax(lost))
            names, line = group.references[0].texts(), int(group.lines[row]) if len(group.lines) else 0
            words = f"{names[row]!r}: {MEANT}"
            raise InputError([Problem(words, group.file or network.file, line)])
    said = world.from_object(position, N)
    grid = world.grid(position).reshape(-1, 4)
    return replace(group, constants=np.concatenate([position, grid, said], axis=1))


def with_control_moved(network: Network) -> Network:
    """The network with what was observed of control points in the coordinates they are given with.

    A shift that is observed beside the given place, in east, north, up, is the same as that place shifted by it.
    """
    world = network.world
    if world is None:
        return network
    groups = tuple(_moved(group, world) if group.type.key == "control" else group for group in network.groups)
    return replace(network, groups=groups)


def _moved(group: ObservationGroup, world: World) -> ObservationGroup:
    axes = world.horizon.local_axes(group.constants)
    shift = np.einsum("nij,ni->nj", axes, np.nan_to_num(group.observed))
    return replace(
        group,
        constants=group.constants + shift,
        observed=np.where(group.mask, 0.0, np.nan),
    )
