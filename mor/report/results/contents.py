"""Content of a project before it is adjusted."""

from __future__ import annotations

import numpy as np

from mor.parameters.index import index_unknowns
from mor.project.network.build import Network
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

THINGS = {
    "camera": "{count:camera|cameras}",
    "image": "{count:image|images}",
    "point": "{count:point|points}",
    "station": "{count:station|stations}",
    "system": "{count:system|systems}",
    "pair": "{count:pair|pairs}",
    "instrument": "{count:instrument|instruments}",
}


def contents(network: Network, words: Words = ENGLISH) -> str:
    """Counts of things, observations and unknowns; what has no start value."""
    lines = [network.project.title] if network.project.title else []
    counts = {name: len(network.things[name].ids) for name in THINGS}
    lines += [_row(words(THINGS[name], count=count)) for name, count in counts.items() if count]
    lines.append(words("observations"))
    for group in network.groups:
        lines.append(f"{int(np.count_nonzero(group.mask)):8d} {group.type.name} ({group.name})")
    observations = sum(int(np.count_nonzero(group.mask)) for group in network.groups)
    total = _row(words("{count:observation|observations}", count=observations))
    unknowns = words("{count:unknown|unknowns}", count=index_unknowns(network.blocks).count)
    lines.append(f"{total}, {unknowns}, {words('datum')}: {datum_name(network.datum.name, words)}")
    missing = sum(
        int(np.count_nonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
        for values in network.start.values()
    )
    if missing:
        lines.append(_row(words("{count:block|blocks} without start values", count=missing)))
    return "\n".join(lines)


def _row(said: str) -> str:
    """A line of the list: the counts stand one below the other."""
    number, _, words = said.partition(" ")
    return f"{number:>8s} {words}"
