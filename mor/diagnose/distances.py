"""Distances of one instrument: a common offset, a common scale, slope for horizontal."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from mor.arrays import FloatArray
from mor.diagnose.edits import key, table_key
from mor.diagnose.hypothesis import Hypothesis, with_group, with_observed, with_unknown
from mor.diagnose.situation import Situation
from mor.observations import PLAIN_TYPES, is_image_point
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.solved import Amount

DISTANCE, HORIZONTAL_DISTANCE = PLAIN_TYPES["distance"], PLAIN_TYPES["horizontal_distance"]
_AT_LEAST = 3
"""Distances that a common error shows in."""
_COMPONENTS = {"scale": 0, "offset": 1}


def distance_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Hypotheses about every group of distances, and about those that share an instrument."""
    network = situation.network
    numbers = [k for k, g in enumerate(network.groups) if g.type in (DISTANCE, HORIZONTAL_DISTANCE)]
    sets: list[tuple[str, tuple[int, ...]]] = [
        (network.groups[k].name, (k,)) for k in numbers if network.groups[k].count >= _AT_LEAST
    ]
    if len(numbers) > 1:
        sets.append((", ".join(network.groups[k].name for k in numbers), tuple(numbers)))
    found = []
    for label, chosen in sets:
        names = [name for name in _COMPONENTS if not _is_free(network, chosen, name)]
        found += [_common(network, label, chosen, name, len(sets)) for name in names]
    return found + [_other_kind(network, k) for k in numbers]


LENGTHS = {
    "mm for m": 0.001,
    "m for mm": 1000.0,
    "ft for m": 0.3048,
    "m for ft": 1.0 / 0.3048,
    "cm for m": 0.01,
    "m for cm": 100.0,
}


def table_unit_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the hypotheses that all lengths of a table are in another unit, those that score tests name first."""
    network, found = situation.network, []
    scored = [one.things for one in situation.scored if one.cause == "table unit"]
    for number, group in enumerate(network.groups):
        lengths = np.array([c.quantity.length == 1 for c in group.type.components])
        if (
            not lengths.any()
            or not group.type.distances
            or group.count < _AT_LEAST
            or is_image_point(group.type)
        ):
            continue
        count = int(np.count_nonzero(group.mask[:, lengths]))
        for words, factor in LENGTHS.items():
            unit = words.split()[0]
            factors = np.where(lengths, factor, 1.0)
            names = [c.name for c, own in zip(group.type.components, lengths, strict=True) if own]
            found.append(
                Hypothesis(
                    "table unit",
                    (group.name, words),
                    partial(_scaled, number=number, factors=factors),
                    f"observations, {group.name}: units: {unit}",
                    len(LENGTHS),
                    stretch=count * float(np.log(factor)),
                    afresh=True,
                    edits=table_key(
                        network, number, "units", f"{{{', '.join(f'{n}: {unit}' for n in names)}}}"
                    ),
                )
            )
    return sorted(found, key=lambda one: one.things not in scored)


def _scaled(network: Network, number: int, factors: FloatArray) -> Network:
    rows = np.arange(network.groups[number].count)
    return with_observed(network, number, rows, lambda observed: observed * factors)


def _is_free(network: Network, chosen: tuple[int, ...], name: str) -> bool:
    free = network.blocks["distance meter"].free[:, _COMPONENTS[name]]
    return any(bool(free[network.groups[k].blocks[-1]].any()) for k in chosen)


def _common(network: Network, label: str, chosen: tuple[int, ...], name: str, sets: int) -> Hypothesis:
    component = _COMPONENTS[name]
    number = len(network.blocks["distance meter"].ids)
    meter = int(network.groups[chosen[0]].blocks[-1][0])

    def change(changed: Network) -> Network:
        free = changed.blocks["distance meter"].free[meter].copy()
        free[component] = True
        value = changed.start["distance meter"][meter]
        changed, own = with_unknown(changed, "distance meter", value, free)
        for k in chosen:
            group = changed.groups[k]
            blocks = (*group.blocks[:-1], np.full(group.count, own))
            changed = with_group(changed, k, replace(group, blocks=blocks))
        return changed

    def amount(values: Values) -> Amount:
        return Amount(name, float(values["distance meter"][number, component]))

    given = {"offset": "{free: 0}", "scale": "{free: 1}"}[name]
    line = f"instruments: {{edm: {{{name}: {given}}}}}; observations, {label}: instrument: edm"
    tables = [edit for k in chosen for edit in table_key(network, k, "instrument", "edm")]
    edits = (key(("instruments", "edm", name), given), *tables) if len(tables) == len(chosen) else ()
    return Hypothesis(
        f"distance {name}", (label,), change, line, sets, parameters=1, edits=edits, amount=amount
    )


def _other_kind(network: Network, number: int) -> Hypothesis:
    group = network.groups[number]
    other = DISTANCE if group.type == HORIZONTAL_DISTANCE else HORIZONTAL_DISTANCE
    cause = "slope distance" if other == DISTANCE else "horizontal distance"
    return Hypothesis(
        cause,
        (group.name,),
        lambda changed: with_group(changed, number, replace(changed.groups[number], type=other)),
        f"observations, {group.name}: type: {other.key}",
        edits=table_key(network, number, "type", other.key),
    )
