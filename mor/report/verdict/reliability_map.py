"""The reliability map as plain data: what is weakest, what it carries, what would cure it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.arrays import BoolArray, IntArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality
from mor.quality.reliability.carried_points import carried_points, most_at_a_time
from mor.quality.reliability.further_observation import Further, best_further
from mor.quality.reliability.influence_on_unknowns import Entry
from mor.quality.reliability.reliability_map import Controlled, detectable, uncontrolled
from mor.quality.solved import Solved
from mor.report.edge import said, said_sizes
from mor.report.tables.reliability import place
from mor.report.tables.shared import once

MOST = 1_000
"""Points, images, stations or sets that are listed; of more the weakest."""
NAMED = 200
"""Uncontrolled observations that are listed with what they carry."""
CURED = 12
"""Weak spots for which a further observation is looked for."""
KINDS = {"point": "points", "image": "images", "station": "stations", "set": "sets"}


@once
def reliability_rows(solved: Solved) -> dict[str, Any] | None:
    """Uncontrolled observations, and the map; nothing without redundancy."""
    quality = solved.quality
    if quality is None or quality.redundancy == 0:
        return None
    count, entries = _uncontrolled(quality)
    rows: dict[str, Any] = {
        "least_redundancy": quality.levels.least_redundancy,
        "uncontrolled": count,
        "observations": _observations(solved, quality, entries),
    }
    found = {one.of: one for one in solved.reliability_map}
    unknown = unknown_coordinates(solved)
    rows["points_barely_determined"] = int(
        np.count_nonzero(barely_determined(unknown, found["point"].observations))
    )
    for kind, key in KINDS.items():
        rows[key] = _things(solved, found[kind]) if kind in found else []
    return rows


def unknown_coordinates(solved: Solved) -> IntArray:
    """(p,) number of unknown coordinates of each point."""
    blocks = solved.network.things["point"].parts["position"]
    return np.asarray(np.count_nonzero(solved.adjustment.problem.index.columns["point"][blocks] >= 0, axis=1))


def barely_determined(unknown: IntArray, observations: IntArray) -> BoolArray:
    """Points with at most one observation more than they have unknown coordinates, of whatever kind."""
    return (observations > 0) & (unknown > 0) & (observations <= unknown + 1)


def _uncontrolled(quality: Quality) -> tuple[int, list[Entry]]:
    """Number of uncontrolled observations, and those with the smallest redundancy numbers."""
    found = []
    for number, one in enumerate(quality.groups):
        rows, components = np.nonzero(uncontrolled(quality, number))
        if len(rows):
            used, inverse = np.unique(rows, return_inverse=True)
            r = np.round(one.at(used).r[inverse, components], 7)
            found.append(np.stack([r, np.full(len(rows), number), rows, components]))
    if not found:
        return 0, []
    r, *entries = np.concatenate(found, axis=1)
    first = np.lexsort((*reversed(entries), r))[:NAMED]
    named = np.stack(entries, axis=1)[first].astype(np.int64).tolist()
    return len(r), [Entry(*entry) for entry in named]


def _observations(solved: Solved, quality: Quality, entries: list[Entry]) -> list[dict[str, Any]]:
    told = entries[: most_at_a_time(quality)]
    carried = carried_points(quality, told)
    cures = best_further(quality, [(entry, _targets(solved, entry)) for entry in entries[:CURED]])
    names = solved.network.blocks["point"].ids
    nabla = detectable(quality, np.array(entries, dtype=np.int64).reshape(-1, 3)).tolist()
    rows = []
    for k, entry in enumerate(entries):
        rows.append(
            {
                **_weakest(quality, entry, nabla[k]),
                "carries": [names[block] for block in carried[k]] if k < len(told) else None,
                "cure": _cure(solved, cures[k]) if k < CURED else None,
            }
        )
    return rows


def _weakest(quality: Quality, entry: Entry, nabla: float) -> dict[str, Any]:
    """An observation with its r and ∇, which comes in internal units, in the units of the project."""
    group = quality.adjustment.problem.groups[entry.group]
    r = float(quality.groups[entry.group].at(np.array([entry.row])).r[0, entry.component])
    return {
        **place(group, entry.row, entry.component),
        "r": r,
        "nabla": _said_size(group, entry.component, nabla) if np.isfinite(nabla) else None,
    }


def _said_size(group: ObservationGroup, component: int, size: float) -> float:
    internal = np.zeros((1, group.observed.shape[1]))
    internal[0, component] = size
    outside = int(np.flatnonzero(said(group).source == component)[0])
    return float(said_sizes(group, internal)[0, outside])


def _targets(solved: Solved, entry: Entry) -> list[int]:
    """Free point blocks that an observation refers to, but for those of frames."""
    problem = solved.adjustment.problem
    group, columns = problem.groups[entry.group], problem.index.columns["point"]
    blocks = [
        int(own[entry.row])
        for slot, own in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point" and slot.of not in ("image", "station", "system")
    ]
    return [block for block in dict.fromkeys(blocks) if (columns[block] >= 0).any()]


def _cure(solved: Solved, further: Further) -> dict[str, Any]:
    group = solved.adjustment.problem.groups[further.group]
    again = further.target < 0
    names = {
        reference.name: own[further.row]
        for reference, own in zip(group.type.references, group.references, strict=True)
    }
    if not again:
        last = group.type.references[-1].name
        names[last] = solved.network.blocks["point"].ids[further.target]
    return {"again": again, "type": group.type.name, "group": group.name, "names": names, "r": further.r}


def _things(solved: Solved, one: Controlled) -> list[dict[str, Any]]:
    """Rows of one kind: all in order, or the weakest of many."""
    few = len(one.names) <= MOST
    return thing_rows(solved, one, np.flatnonzero(np.isfinite(one.smallest_r)) if few else one.worst(MOST))


def thing_rows(solved: Solved, one: Controlled, numbers: IntArray) -> list[dict[str, Any]]:
    """Some things (k,) of one kind."""
    assert solved.quality is not None
    nabla = detectable(solved.quality, one.weakest[numbers])
    groups = solved.adjustment.problem.groups
    rows = []
    for k, size in zip(numbers.tolist(), nabla.tolist(), strict=True):
        entry = one.entry(k)
        group = groups[entry.group]
        rows.append(
            {
                "id": one.names[k],
                "observations": int(one.observations[k]),
                "smallest_r": float(one.smallest_r[k]),
                "weakest": place(group, entry.row, entry.component),
                "nabla": _said_size(group, entry.component, size) if np.isfinite(size) else None,
                "shift": float(one.shift[k]) if np.isfinite(one.shift[k]) else None,
            }
        )
    return rows
