"""Which point the suspicious observations move, and where to: what a gross error means for the result."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.geometry.arrays import FloatArray
from mor.quality.assess import Quality
from mor.quality.influence import Entry, movements

MOST = 200
"""Observations that are explained at most."""
AT_LEAST = 10
"""Observations that are explained where none is flagged."""


class Effect(NamedTuple):
    """What an observation does to the point it moves most."""

    entry: Entry
    test: float
    r: float
    error: float
    """Estimated gross error."""
    smallest: float
    """Smallest detectable one."""
    point: int
    """Point block that moves most among those the observation names, −1 where it names no free point."""
    movement: FloatArray
    """(3,) its movement by the estimated error, in the datum of the adjustment, internal axes."""


def effects(quality: Quality) -> list[Effect]:
    """Effects of the flagged observations, the worst first; of the worst few where none is flagged."""
    entries = _chosen(quality)
    errors = np.array([quality.reliability[e.group].error[e.row, e.component] for e in entries])
    moved = movements(quality, entries, errors) if entries else np.zeros((0, 0))
    return [_effect(quality, entry, moved[:, k]) for k, entry in enumerate(entries)]


def _chosen(quality: Quality) -> list[Entry]:
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    wanted = min(flagged, MOST) or AT_LEAST
    best: list[tuple[float, Entry]] = []
    for number, (one, group) in enumerate(
        zip(quality.reliability, quality.adjustment.problem.groups, strict=True)
    ):
        size = np.where(group.left_out, 0.0, np.nan_to_num(np.abs(one.test)))
        order = np.argsort(-size.ravel(), kind="stable")[:wanted]
        for place in order[size.ravel()[order] > 0.0]:
            row, component = divmod(int(place), size.shape[1])
            best.append((float(size[row, component]), Entry(number, row, component)))
    best.sort(key=lambda pair: (-pair[0], pair[1]))
    return [entry for _, entry in best[:wanted]]


def _effect(quality: Quality, entry: Entry, moved: FloatArray) -> Effect:
    problem, tests = quality.adjustment.problem, quality.reliability[entry.group]
    group = problem.groups[entry.group]
    columns = problem.index.columns["point"]
    place = (entry.row, entry.component)
    largest, point, movement = -1.0, -1, np.zeros(3)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind != "point":
            continue
        own = columns[blocks[entry.row]]
        if slot.of == "image" or not (own >= 0).any():
            continue
        displacement = np.where(own >= 0, moved[own], 0.0)
        if np.linalg.norm(displacement) > largest:
            largest, point, movement = (
                float(np.linalg.norm(displacement)),
                int(blocks[entry.row]),
                displacement,
            )
    return Effect(
        entry,
        float(tests.test[place]),
        float(quality.groups[entry.group].r[place]),
        float(tests.error[place]),
        float(tests.smallest[place]),
        point,
        movement,
    )
