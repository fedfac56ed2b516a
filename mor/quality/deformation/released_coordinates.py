"""Fixed coordinates given free again: what the S-transformation out of a datum of fixed points starts from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.adjustment.datum.defect import network_components
from mor.arrays import BoolArray
from mor.project.network.build import Network
from mor.quality.solved import Solved


def released(solved: Solved) -> Network:
    """The network with every fixed coordinate free that an observation looks at; the same one where there is none.

    Coordinates that are none of the dimensions of the network stay.
    """
    network = solved.network
    _, fixed = network_components(solved.adjustment.problem, solved.adjustment.values)
    fixed &= np.array([axis in network.project.settings.dimensions for axis in "xyz"])
    if not fixed.any():
        return network
    points = network.blocks["point"]
    free: BoolArray = points.free | fixed
    return replace(network, blocks={**network.blocks, "point": points._replace(free=free)})


def strained(before: Solved, after: Solved) -> bool:
    """True where the fixed coordinates forced the observations, so that releasing them changes the residuals."""
    one, other = (solved.adjustment.normals.objective for solved in (before, after))
    return one - other > 1e-6 * max(one, 1.0)
