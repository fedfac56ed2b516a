"""The adjustment problem: unknowns, observation groups, correlations, datum; complete before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.adjustment.equations import Equations
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Index, Values


class Cluster(NamedTuple):
    """Correlated observations: entry numbers (k,) and their covariance matrix (k, k)."""

    entries: IntArray
    covariance: FloatArray


class Datum(NamedTuple):
    """Which components carry the datum where observations leave it open, and what they refer to.

    ``mask[kind]`` (n, size) is true for the components whose total corrections from ``reference[kind]`` the inner
    constraints bind. ``free`` is false where the user wants no free network: then a defect is an error.
    """

    name: str
    free: bool
    mask: Mapping[str, BoolArray]
    reference: Values
    movements: Values | None = None
    """Coordinates at which the movements of the inner constraints are taken; ``None``: the adjusted ones."""


@dataclass(frozen=True)
class Problem:
    """Everything the solver needs. Entry (i, c) of group g has the number ``offsets[g] + i·m + c``."""

    index: Index
    groups: tuple[ObservationGroup, ...]
    clusters: tuple[Cluster, ...]
    datum: Datum

    @cached_property
    def equations(self) -> Equations:
        """The equations of the groups."""
        return Equations(self.groups)

    @property
    def offsets(self) -> IntArray:
        """(g+1,) first entry number of each group."""
        return np.concatenate([[0], np.cumsum([group.observed.size for group in self.groups])]).astype(
            np.int64
        )

    @property
    def observations(self) -> int:
        """Number of observations n; excluded ones do not count."""
        return int(sum(np.count_nonzero(group.mask & ~group.left_out) for group in self.groups))
