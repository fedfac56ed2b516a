"""Classes of a histogram of test values, as many for a gross error of a million σ as for none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray

WIDTH = 0.25
OUTERMOST = 10.0
"""|w| that has a place of its own; larger ones stand in the outermost classes. N(0, 1) has none at all there."""


class Bins(NamedTuple):
    """Edges of the classes, the test values with those beyond the edges moved into the last class, their number."""

    edges: FloatArray
    w: FloatArray
    beyond: int

    @property
    def limit(self) -> float:
        """The last edge."""
        return -float(self.edges[0])


def normal_bins(w: FloatArray, critical: float) -> Bins:
    """Classes for test values (n,), wide enough for the critical value and for |w| up to :data:`OUTERMOST`."""
    largest = float(np.abs(w).max(initial=1.0))
    limit = max(min(float(np.ceil(largest * 2.0) / 2.0), OUTERMOST), float(np.ceil(critical + 0.5)))
    edges = np.linspace(-limit, limit, round(2.0 * limit / WIDTH) + 1)
    inside = limit - 0.5 * WIDTH
    return Bins(edges, np.clip(w, -inside, inside), int(np.count_nonzero(np.abs(w) > limit)))
