"""Angles of more than a full circle: no instrument shows one, so a table of such is in another unit.

Readings in gon or degrees that are declared as radians are found so; the other way round they only look small.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of
from mor.units import ANGLE

_FULL = 2.0 * np.pi * (1.0 + 1e-9)
"""A full circle, and what is rounded when one is written."""


def beyond_a_circle(network: Network) -> Iterator[Problem]:
    """Components of tables most of whose angles are larger than a full circle, with the first row."""
    for group in network.groups:
        if not group.type.key.startswith(("observed/", "difference/")):
            for component, of in enumerate(group.type.components):
                if of.quantity == ANGLE:
                    yield from _component(group, component)


def _component(group: ObservationGroup, component: int) -> Iterator[Problem]:
    here = group.mask[:, component]
    beyond = here & (np.abs(group.observed[:, component]) > _FULL)
    if 2 * np.count_nonzero(beyond) > np.count_nonzero(here):
        name, of = group.type.components[component].name, np.count_nonzero(here)
        said = (
            f"{group.type.name}, {name}: {np.count_nonzero(beyond)} of {of} angles are larger than a full circle; "
            "their unit?"
        )
        yield Problem(said, group.file, line_of(group, int(np.argmax(beyond))))
