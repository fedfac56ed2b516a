"""What is needed to take planned observations out and put them in again without an adjustment: rows and cofactors.

With the rows a of the whitened derivatives, and Q the cofactors of all unknowns in their datum,

    Q' = Q ∓ Q aᵀ (a Q aᵀ ± 1)⁻¹ a Q,    r = 1 − a Q' aᵀ,

row by row. Rows do not change with free movements of the network, so that Q' stays in the datum.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality
from mor.quality.design.interest import Unit, observation_rows

MOST_UNKNOWNS = 300
"""Unknowns of networks small enough for this."""
MOST_UNITS = 3_000


class Switching(NamedTuple):
    """A small network, ready for observations to be switched off and on."""

    rows: FloatArray
    """(m, u) whitened derivatives of all observations, candidates last."""
    group: IntArray
    """(m,) number of the group of each; candidates count on."""
    cofactors: FloatArray
    """(u, u) Q of the unknowns, in the datum of the plan."""
    columns: IntArray
    """(points, 3) unknown of each coordinate by point block; −1 where it is fixed."""
    units: tuple[Unit, ...]
    correlated: tuple[tuple[IntArray, FloatArray], ...]
    """Rows of correlated observations, and the triangle L of their covariance matrix LLᵀ."""


def switching(quality: Quality, candidates: Sequence[ObservationGroup]) -> Switching | None:
    """Rows and cofactors of a plan; ``None`` where it is too large for them."""
    adjustment = quality.adjustment
    index = adjustment.problem.index
    if index.count > MOST_UNKNOWNS:
        return None
    rows, units, correlated, _ = observation_rows(quality, candidates)
    if len(units) > MOST_UNITS:
        return None
    T = np.eye(index.count)
    datum = quality.datum
    if datum.null.shape[1]:
        T -= datum.null @ datum.binding @ adjustment.constraint.normals.T
    Q = T @ adjustment.inverse.solve(np.ascontiguousarray(T.T))
    return Switching(
        rows.matrix(), rows.group(), 0.5 * (Q + Q.T), index.columns["point"], tuple(units), tuple(correlated)
    )
