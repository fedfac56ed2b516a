"""Constancy and smoothness of trajectories: differences of neighbouring knots, observed as 0."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup, ObservationType
from mor.observations.names import names_of
from mor.observations.time.steadiness import (
    CONSTANT_ATTITUDE,
    CONSTANT_POSITION,
    SMOOTH_ATTITUDE,
    SMOOTH_POSITION,
)
from mor.project.axes import external
from mor.project.edge import UnitError
from mor.project.network.reading import Reading, table_label
from mor.project.trajectories.model import Trajectory, knot_name

_TYPES = {
    ("constancy", "position"): CONSTANT_POSITION,
    ("constancy", "attitude"): CONSTANT_ATTITUDE,
    ("smoothness", "position"): SMOOTH_POSITION,
    ("smoothness", "attitude"): SMOOTH_ATTITUDE,
}


def steadiness_groups(reading: Reading) -> list[ObservationGroup]:
    """One group for every table of trajectories and kind of difference that has a σ."""
    groups = []
    for number, table in enumerate(reading.project.trajectories):
        own = {name.rpartition("@")[0] for name in reading.table_ids.get(("trajectories", number), [])}
        trajectories = [reading.trajectories[name] for name in reading.trajectories if name in own]
        for (key, part), type_ in _TYPES.items():
            text = getattr(getattr(table, key), part)
            if text is None:
                continue
            place = reading.at("trajectories", number, key)
            try:
                sigma = reading.edge.number(text, type_.components[0].quantity)
                if sigma <= 0.0:
                    raise UnitError(f"found {text}, expected a σ above 0")
            except UnitError as error:
                reading.problems.append(place.problem(f"{key}: {part}: {error}", part))
                continue
            name = f"{key} of {part}, {table_label('trajectories', number, table)}"
            group = _group(reading, type_, name, trajectories, sigma)
            groups += [group] if group is not None else []
    return groups


def _group(
    reading: Reading, type_: ObservationType, name: str, trajectories: list[Trajectory], sigma: float
) -> ObservationGroup | None:
    """Differences of all neighbours of these trajectories; ``None`` if no stretch has enough knots."""
    count = len(type_.slots)
    rotations = type_.slots[0].kind == "rotation"
    blocks: list[IntArray] = []
    intervals: list[FloatArray] = []
    labels: list[str] = []
    for trajectory in trajectories:
        numbers = np.arange(len(trajectory.times) - count + 1)[:, None] + np.arange(count)
        numbers = numbers[trajectory.stretch[numbers[:, 0]] == trajectory.stretch[numbers[:, -1]]]
        blocks.append((trajectory.rotations if rotations else trajectory.positions)[numbers])
        intervals.append(np.diff(trajectory.times[numbers], axis=1))
        labels += [
            knot_name(trajectory.name, time) for time in trajectory.times[numbers[:, (count - 1) // 2]]
        ]
    if not labels:
        return None
    whole = np.concatenate(blocks)
    size = (len(labels), len(type_.components))
    return ObservationGroup(
        name=name,
        type=type_,
        blocks=tuple(whole.T),
        observed=np.zeros(size),
        sigma=np.full(size, sigma),
        constants=np.concatenate(intervals),
        references=(names_of(labels),),
        external=external(type_, reading.edge),
    )
