"""Observations that have no value or no derivative at a place: a bearing between two points that coincide there."""

from __future__ import annotations

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.arrays import IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Index, Values

_PIECE = 100_000
"""Observations that are looked at together."""


def undefined_rows(group: ObservationGroup, index: Index, values: Values) -> IntArray:
    """Rows of a group whose misclosure or derivatives, or their weighted squares, are no numbers at ``values``."""
    tangent = rotation_tangents(index, values)
    found = [np.zeros(0, dtype=np.int64)]
    with np.errstate(all="ignore"):
        for first in range(0, group.count, _PIECE):
            piece = slice(first, first + _PIECE)
            rows = linearise(group, index, values, tangent, piece)
            weight = np.where(group.mask[piece], group.sigma[piece], 1.0) ** -2
            sums = weight * (rows.misclosure**2 + (rows.jacobian**2).sum(axis=2))
            good = np.isfinite(sums).all(axis=1)
            found.append(first + np.flatnonzero(~good))
    return np.concatenate(found)
