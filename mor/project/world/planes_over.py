"""Projections over all places of a network, where some are found beyond what was known of them when it was read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.observations import ObservationGroup
from mor.observations.earth.attitude import Attitude
from mor.observations.earth.projected_bearing import InPlane
from mor.project.network.build import Network
from mor.project.world.plane import PlaneError, plane_of
from mor.project.world.reference_system import reference_system
from mor.project.world.world import World


def with_planes_over(network: Network, places: Mapping[str, FloatArray]) -> Network:
    """The network with projections over all of its places, where some lie beyond what was known of them before.

    Raises :class:`InputError`.
    """
    world = network.world
    if world is None:
        return network
    try:
        of_all = {
            name: tuple(_over(world, group, places["point"]) for group in getattr(network, name))
            for name in ("groups", "checks", "candidates")
        }
    except PlaneError as error:
        raise InputError([Problem(f"projection: {error}", network.file)]) from None
    return replace(network, **of_all)  # type: ignore[arg-type]


def _over(world: World, group: ObservationGroup, points: FloatArray) -> ObservationGroup:
    equation = group.type.equation
    if not isinstance(equation, InPlane | Attitude) or equation.plane is None:
        return group
    plane = equation.plane
    ends = [
        points[blocks]
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point"
    ]
    there = np.concatenate(ends)
    feet = world.horizon.foot(there[np.isfinite(there).all(axis=1)]).position[:, :2]
    if plane.holds(feet).all():
        return group
    both = np.concatenate([world.extent, feet])
    system = world.system if plane.crs is None else reference_system(plane.crs)
    wider = plane_of(system, world, plane.crs, np.stack([both.min(axis=0), both.max(axis=0)]))
    return replace(group, type=group.type._replace(equation=replace(equation, plane=wider)))
