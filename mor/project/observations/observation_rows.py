"""What the readers of image coordinates and of all other types share: a group as read, names, σ."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.observations.names import Names
from mor.project.file.model import Observations
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Rows

CLUSTER = "cluster"
"""Column of the names of rows that are correlated among themselves."""


@dataclass(frozen=True)
class Group:
    """A group as read, and what its correlations refer to."""

    group: ObservationGroup
    entry: int
    """Number of the observation entry in the project."""
    rows: IntArray
    """Rows of the entry's table."""
    transform: FloatArray
    """(m, m) from the components as given to internal ones."""
    factors: FloatArray
    """(m,) internal units per unit of the σ as given."""
    covariances: FloatArray | None = None
    """(n, m, m) covariances given row by row, internal units but project axes."""
    clusters: Names | None = None
    """Names of the rows that are correlated among themselves; ``None`` if a matrix is over the whole table."""
    epochs: IntArray | None = None
    """(n,) number of the epoch of each row, −1 where it has none."""


def own_or_common(own: FloatArray, common: FloatArray) -> FloatArray:
    """What a row says for a component, or else for all of them."""
    return np.where(np.isnan(own), common, own)


def sigma_is_good(group: ObservationGroup, rows: Rows, chosen: IntArray, problems: list[Problem]) -> bool:
    """False if an observation has no σ > 0; every such row is told, once for all where none has any."""
    bad = group.mask & ~(group.sigma > 0.0)
    if bad.any() and np.isnan(group.sigma[group.mask]).all():
        matrix = "; or covariances" if len(group.type.components) == 3 else ""
        words = f"no σ: give a column sigma, or values: {{sigma: …}} for all rows{matrix}"
        problems.append(Problem(words, rows.file, int(rows.lines[chosen[0]])))
        return False
    wrong = replace(rows, lines=rows.lines[chosen])
    tell_rows(
        problems, np.asarray(bad.any(axis=1)), wrong, lambda row: _wrong_sigma(group.sigma[row][bad[row]][0])
    )
    return not bad.any()


def _wrong_sigma(value: float) -> str:
    if np.isnan(value):
        return "no σ in this row"
    if value == 0.0:
        return "found σ = 0, expected σ > 0 (what is exactly known is fixed, not observed)"
    return "found a negative σ, expected σ > 0"


def group_name(entry: Observations, number: int) -> str:
    """Name of a group in reports."""
    return entry.name or entry.file or f"{entry.type} {number + 1}"
