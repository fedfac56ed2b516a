"""The protocol of start values: how each was obtained, or what is missing for it."""

from __future__ import annotations

from mor.approximate.growth.strategy import Approximation
from mor.project.network.build import Network


def protocol(network: Network, approximation: Approximation) -> str:
    """One line for everything that had no start value."""
    if not approximation.how and not approximation.missing:
        return "all start values are given\n"
    lines = []
    for kind, known in (("image", "image"), ("station", "station"), ("point", "point")):
        for name in network.things[known].ids:
            words = approximation.how.get(f"{kind} {name}")
            if words is not None:
                lines.append(f"{kind} {name}: {words}")
    lines += [f"REPLACED start value of {words}" for words in approximation.replaced]
    lines += [f"MISSING {words}" for words in (*approximation.remarks, *approximation.missing)]
    return "\n".join(lines) + "\n"
