"""What a project contains, before anything is adjusted."""

from __future__ import annotations

import numpy as np

from mor.counting import counted
from mor.parameters.index import index_unknowns
from mor.project.network.build import Network

THINGS = ("camera", "image", "point", "station", "system", "pair", "instrument")


def contents(network: Network) -> str:
    """Counts of things, observations and unknowns; what has no start value."""
    lines = [network.project.title] if network.project.title else []
    lines += [_row(len(network.things[name].ids), name) for name in THINGS if network.things[name].ids]
    lines.append("observations")
    for group in network.groups:
        lines.append(f"{int(np.count_nonzero(group.mask)):8d} {group.type.name} ({group.name})")
    observations = sum(int(np.count_nonzero(group.mask)) for group in network.groups)
    unknowns = index_unknowns(network.blocks).count
    total = _row(observations, "observation")
    lines.append(f"{total}, {counted(unknowns, 'unknown')}, datum: {network.datum.name}")
    missing = sum(
        int(np.count_nonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
        for values in network.start.values()
    )
    if missing:
        lines.append(_row(missing, "block without start values", "blocks without start values"))
    return "\n".join(lines)


def _row(count: int, one: str, many: str = "") -> str:
    """A line of the list: the counts stand one below the other."""
    number, _, words = counted(count, one, many).partition(" ")
    return f"{number:>8s} {words}"
