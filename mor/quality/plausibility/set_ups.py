"""Heights of instruments and targets that nobody can reach, and vertical circles read in the other convention."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import BoolArray
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
    beyond = beyond_reach(network)
    if not beyond.any():
        return
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
                if abs(height) > _HIGHEST / network.edge.metres:
                    return f"{of} {column[row]}: the height is {height:.6g} {unit}, more than {_HIGHEST:g} m; its unit?"
                return (
                    f"{of} {column[row]}: the height is {height:.6g} {unit}, more than {_TIMES:g} times the median of "
                    "all heights; its unit?"
                )

            if fresh.any():
                yield from noted(group, np.sort(rows[fresh]), words)


def beyond_reach(network: Network) -> BoolArray:
    """Return which height blocks (n,) are beyond 5 m or 50 times the median of all heights."""
    if "height" not in network.blocks:
        return np.zeros(0, dtype=bool)
    size = np.abs(np.nan_to_num(network.start["height"][:, 0]))
    median = usual_height(network)
    return np.asarray((size > _HIGHEST / network.edge.metres) | ((median > 0.0) & (size > _TIMES * median)))


def usual_height(network: Network) -> float:
    """Return the median of all heights that are not 0, or 0 if there are fewer than three."""
    size = np.abs(np.nan_to_num(network.start["height"][:, 0]))
    given = size[size > 0.0]
    return float(np.median(given)) if len(given) >= _AT_LEAST else 0.0


def vertical_convention(network: Network) -> Iterator[Problem]:
    """Yield a note for each table whose zenith angles all look like elevations, or the other way round."""
    for group in network.groups:
        for component, of in enumerate(group.type.components):
            if of.name in ("zenith", "zenith_angle"):
                count, line = _all_near(group, component, 0.0)
                if count:
                    said = (
                        f"{group.type.name}: all {count} zenith angles are near 0 or a half circle; are they "
                        "elevations?"
                    )
                    yield Problem(said, group.file, line)
            elif of.name in ("vertical", "vertical_angle", "vertical_direction"):
                count, line = _all_near(group, component, 0.5 * np.pi)
                if count:
                    said = (
                        f"{group.type.name}: all {count} elevations are near a quarter of a circle; are they zenith "
                        "angles?"
                    )
                    yield Problem(said, group.file, line)


def _all_near(group: ObservationGroup, component: int, suspicious: float) -> tuple[int, int]:
    """Number of angles if all are near one value in either face, else 0; and the line of the first."""
    here = np.flatnonzero(group.mask[:, component])
    if len(here) < _AT_LEAST:
        return 0, 0
    near = np.abs(wrap(2.0 * (group.observed[here, component] - suspicious))) / 2.0 < _NEAR
    return (len(here), line_of(group, int(here[0]))) if near.all() else (0, 0)
