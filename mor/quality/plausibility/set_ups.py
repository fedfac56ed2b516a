"""Heights of instruments and targets that nobody can reach, and vertical circles read in the other convention."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup, wrap
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of, noted

_HIGHEST = 5.0
"""Height of an instrument or a target in metres that is beyond a tripod and a pole."""
_TIMES = 50.0
"""Times the median of all heights that a height may have."""
_AT_LEAST = 3
_NEAR = 0.5
"""Radians from the vertical, or from the horizon, within which all readings of a table are suspicious."""


def implausible_heights(network: Network) -> Iterator[Problem]:
    """Yield a note for each height of an instrument or target beyond 5 m or 50 times the median of all heights."""
    if "height" not in network.blocks or not len(network.start["height"]):
        return
    size = np.abs(np.nan_to_num(network.start["height"][:, 0]))
    given = size[size > 0.0]
    if not len(given):
        return
    median = float(np.median(given)) if len(given) >= _AT_LEAST else np.inf
    beyond = (size > _HIGHEST / network.edge.metres) | (size > _TIMES * median)
    said: set[int] = set()
    for group in network.groups:
        if not group.type.distances or group.type.between_marks:
            continue
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            names = [reference.name for reference in group.type.references]
            if slot.kind != "height" or slot.of not in names:
                continue
            own = np.asarray(blocks)
            wrong, first = np.unique(own[beyond[own]], return_index=True)
            rows = np.flatnonzero(beyond[own])[first]
            fresh = np.array([int(block) not in said for block in wrong], dtype=bool)
            said.update(int(block) for block in wrong)
            column = group.references[names.index(slot.of)]

            def words(row: int, own=own, column=column, of=slot.of) -> str:  # type: ignore[no-untyped-def]
                height = float(network.start["height"][own[row], 0])
                unit = network.project.units.length
                reason = (
                    f"more than {_HIGHEST:g} m"
                    if abs(height) > _HIGHEST / network.edge.metres
                    else f"more than {_TIMES:g} times the median of all heights"
                )
                return f"{of} {column[row]}: the height is {height:.6g} {unit}, {reason}; its unit?"

            if fresh.any():
                yield from noted(group, np.sort(rows[fresh]), words)


def vertical_convention(network: Network) -> Iterator[Problem]:
    """Yield a note for each table whose zenith angles all look like elevations, or the other way round."""
    for group in network.groups:
        for component, of in enumerate(group.type.components):
            if of.name in ("zenith", "zenith_angle"):
                yield from _convention(group, component, 0.0, "zenith angles", "elevations", "the zenith")
            elif of.name in ("vertical", "vertical_angle", "vertical_direction"):
                yield from _convention(
                    group, component, 0.5 * np.pi, "elevations", "zenith angles", "the horizon"
                )


def _convention(
    group: ObservationGroup, component: int, suspicious: float, said: str, meant: str, origin: str
) -> Iterator[Problem]:
    here = np.flatnonzero(group.mask[:, component])
    if len(here) < _AT_LEAST:
        return
    angles = group.observed[here, component]
    near = np.abs(wrap(2.0 * (angles - suspicious))) / 2.0 < _NEAR  # the same in the other face
    if near.all():
        where = "0 or a half circle" if suspicious == 0.0 else "a quarter of a circle"
        words = (
            f"{group.type.name}, {group.type.components[component].name}: all {len(here)} readings are near {where} "
            f"from {origin}; are they {meant} and not {said}?"
        )
        yield Problem(words, group.file, line_of(group, int(here[0])))
