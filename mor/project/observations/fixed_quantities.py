"""What is observed of one thing alone, and is fixed there: it would be counted with r = 1, and says nothing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mor.arrays import BoolArray
from mor.errors import Problem
from mor.geometry.rotations import rotation_from_angles, tangent_of_angles
from mor.observations import PLAIN_TYPES, ObservationGroup
from mor.project.network.reading import Reading
from mor.project.tables.columns import MOST_TOLD

_ANYWHERE = 0.5
"""Stands for a value that is not known yet: what an equation depends on, it depends on at nearly every place."""


def refuse_fixed(reading: Reading, groups: Iterable[ObservationGroup]) -> None:
    """Tell observed coordinates and levels that depend on nothing but fixed components.

    Between two things it is another matter: a distance between fixed points checks both.
    """
    for group in groups:
        if group.type.name not in PLAIN_TYPES or len(group.type.references) > 1:
            continue
        constant = group.mask & ~_depends(reading, group)
        for row in np.flatnonzero(constant.any(axis=1))[:MOST_TOLD].tolist():
            transform = group.external.transform if group.external is not None else np.eye(constant.shape[1])
            said = np.flatnonzero(constant[row] @ np.abs(transform))
            names = ", ".join(group.type.components[k].name for k in said)
            of = f"{group.type.references[0].name} {group.references[0][row]!r}"
            words = (
                f"{names} of {of}: fixed there, to observe it says nothing; make it free where it is declared, "
                "or give it its value and σ there"
            )
            line = int(group.lines[row]) if len(group.lines) > row else 0
            reading.problems.append(Problem(words, group.file or reading.document.file, line))


def _depends(reading: Reading, group: ObservationGroup) -> BoolArray:
    """(n, m) true for components that some unknown changes."""
    places, tangents, free = [], [], []
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        store = reading.shop.store(slot.kind)
        values = np.nan_to_num(store.all_values()[blocks], nan=_ANYWHERE)
        free.append(store.all_free()[blocks])
        if store.kind.is_rotation:
            about_axes = np.isin(blocks, list(store.about_axes))[:, None, None]
            places.append(rotation_from_angles(values))
            tangents.append(np.where(about_axes, np.eye(3), tangent_of_angles(values)))
        else:
            places.append(values)
            tangents.append(np.eye(values.shape[1]))
    depends = np.zeros(group.observed.shape, dtype=bool)
    jacobians = group.type.equation(places, group.constants).jacobians
    for jacobian, tangent, unknown in zip(jacobians, tangents, free, strict=True):
        depends |= ((jacobian @ tangent != 0.0) & unknown[:, None, :]).any(axis=2)
    return depends
