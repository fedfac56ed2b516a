"""The curvature of the earth that a project with parallel verticals leaves out: its largest effect, against σ.

Each observation is computed with parallel verticals and on a sphere through the middle of the network. A zenith angle
over the distance s differs by s/(2R), a horizontal distance by s h/R at a height h above the middle. A height
difference is off by s²/(2R) against what does not follow the level surface: vectors, images and local systems; without
any of these nothing contradicts it, and it is not looked at.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import Problem
from mor.geometry.earth import EARTH_RADIUS, LocalSphere
from mor.observations import ObservationGroup, wrap
from mor.observations.curvature import on_sphere
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.world.sphere import median_origin
from mor.quality.plausibility.places import line_of, sigmas
from mor.units import ANGLE

NOTED = 0.3
"""In units of σ."""
_LOOKED_AT = {
    "zenith_angle": 0,
    "vertical_direction": 0,
    "zenith_directions": 1,
    "directions": 1,
    "horizontal_distance": 0,
}
"""Component of each type that the curvature changes without regard to the coordinates that are chosen."""
_STRAIGHT = ("vector", "local", "image/", "follower/", "moving")


class Effect(NamedTuple):
    """The effect of the curvature on one observation."""

    group: ObservationGroup
    row: int
    component: int
    size: float
    """Internal units."""
    in_sigma: float
    distance: float
    """Between the ends of the observation, unit of length."""


def neglected_curvature(network: Network, values: Values) -> Problem | None:
    """Return a note on the largest effect of the curvature, or None if the project models it or it is below 0.3 σ."""
    effect = largest_effect(network, values)
    if effect is None or effect.in_sigma < NOTED:
        return None
    group, row = effect.group, effect.row
    names = ", ".join(
        f"{reference.name} {names[row]}"
        for reference, names in zip(group.type.references, group.references, strict=True)
    )
    quantity = group.type.components[effect.component].quantity
    millimetres = 1000.0 * network.edge.metres
    across = abs(effect.size) * millimetres * (effect.distance if quantity == ANGLE else 1.0)
    metres = effect.distance * network.edge.metres
    words = (
        f"curvature of the earth: verticals are parallel in this project; {group.type.name} {names} over "
        f"{metres:.4g} m is off by {_two_digits(across)} mm ({_two_digits(effect.in_sigma)} sigma), more than any "
        "other; curvature: true models it"
    )
    return Problem(words, group.file, line_of(group, row))


def _two_digits(value: float) -> str:
    """Return a number with two digits, without an exponent if it is of an ordinary size."""
    return f"{float(f'{value:.2g}'):g}"


def sphere_under(network: Network, values: Values) -> LocalSphere:
    """Return the sphere that ``curvature: true`` would have at these coordinates."""
    used = np.zeros(len(values["point"]), dtype=bool)
    for group in network.groups:
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point" and slot.of != "system":
                used[blocks] = True
    metres = network.edge.metres
    return LocalSphere(EARTH_RADIUS / metres, median_origin(values["point"][used], 1.0 / metres))


def largest_effect(network: Network, values: Values) -> Effect | None:
    """Return the effect of the curvature that is largest in units of σ; None if there is none to look at."""
    if network.world is not None or network.sphere is not None:
        return None
    straight = any(group.type.key.startswith(_STRAIGHT) for group in network.groups)
    if not any(group.type.key in _LOOKED_AT for group in network.groups) and not straight:
        return None
    sphere, largest = sphere_under(network, values), None
    for group, sigma in zip(network.groups, sigmas(network), strict=True):
        found = _in_group(group, values, sphere, sigma, straight)
        if found is not None and (largest is None or found.in_sigma > largest.in_sigma):
            largest = found
    return largest


def _in_group(
    group: ObservationGroup, values: Values, sphere: LocalSphere, sigma: FloatArray, straight: bool
) -> Effect | None:
    component = _LOOKED_AT.get(
        group.type.key, 0 if group.type.key == "height_difference" and straight else -1
    )
    if component < 0 or not group.count:
        return None
    blocks = [values[slot.kind][own] for slot, own in zip(group.type.slots, group.blocks, strict=True)]
    places = [b for slot, b in zip(group.type.slots, blocks, strict=True) if slot.part == "position"]
    apart = places[1] - places[0]
    length = np.hypot(apart[:, 0], apart[:, 1])
    if group.type.key == "height_difference":
        size = length**2 / (2.0 * sphere.radius)
    else:
        curved = on_sphere(group.type, sphere).equation(blocks, group.constants).values
        size = (curved - group.type.equation(blocks, group.constants).values)[:, component]
        size = wrap(size) if group.type.wraps[component] else size
    own = replace(group, sigma=sigma).given_sigma[:, component]
    ratio = np.where(group.mask[:, component], np.abs(size) / own, np.nan)
    if not np.isfinite(ratio).any():
        return None
    row = int(np.nanargmax(np.where(np.isfinite(ratio), ratio, np.nan)))
    return Effect(group, row, component, float(size[row]), float(ratio[row]), float(length[row]))
