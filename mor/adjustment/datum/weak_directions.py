"""Turns of the whole network that the observations determine, but hardly.

Tilts observed as ω and φ are angles about axes of the object. Where a free network is turned about its plumb line by θ,
they change by θ times themselves; tilts of the size of their σ so determine the turn with a σ of a radian. That is
neither null nor an answer: coordinates turned by it stand as far from the reference as chance wants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import network_components, similarities
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray
from mor.parameters.index import Values

NOTHING_KNOWN = float(np.pi / np.sqrt(3.0))
"""σ (rad) of an angle of which nothing is known: of one evenly spread over the circle."""
_RIGID = 1e-2
"""Part of a direction that may be other than a movement of the whole network."""


class WeakTurn(NamedTuple):
    """A turn of the whole network."""

    axis: FloatArray
    """(3,) unit vector."""
    sigma: float
    """Standard deviation (rad, for σ0 = 1)."""


def weak_turns(weak: FloatArray, problem: Problem, values: Values) -> tuple[WeakTurn, ...]:
    """Those of the weak directions (u, w), scaled to one σ, that turn the whole network, the weakest first."""
    if weak.shape[1] == 0:
        return ()
    used, _ = network_components(problem, values)
    if not used.any():
        return ()
    columns = problem.index.columns["point"][used]
    centre = values["point"][used.any(axis=1)].mean(axis=0)
    generators = similarities(values["point"], centre)[used]
    lengths = np.linalg.norm(generators, axis=0)
    lengths[lengths == 0.0] = 1.0
    turns, point = [], np.nonzero(used)[0]
    for direction in weak[columns].T:
        movement = np.linalg.lstsq(generators / lengths, direction, rcond=1e-9)[0] / lengths
        moved = generators @ movement
        rest, whole = (np.sqrt(np.bincount(point, one**2)) for one in (direction - moved, moved))
        # Of each point by itself: a far one that moves alone outweighs all others that do not.
        rigid = float(np.mean((rest <= _RIGID * whole)[np.unique(point)])) > 0.5
        size = float(np.linalg.norm(movement[3:6]))
        if size > 0.0 and rigid:
            turns.append(WeakTurn(movement[3:6] / size, size))
    return tuple(sorted(turns, key=lambda turn: -turn.sigma))
