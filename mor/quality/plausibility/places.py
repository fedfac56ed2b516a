"""Where notes stand: the file and line of an observation, and how many of a kind are told one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network

MOST = 5
"""Notes of one kind about one table."""


def sigmas(network: Network) -> list[FloatArray]:
    """(n, m) standard deviations of each group; of correlated observations those of their covariance matrices."""
    found = [group.sigma.copy() for group in network.groups]
    for one in network.correlations:
        deviations = np.sqrt(np.diagonal(one.covariance))
        for number, row, component, sigma in zip(
            one.groups, one.rows, one.components, deviations, strict=True
        ):
            found[number][row, component] = sigma
    return found


def line_of(group: ObservationGroup, row: int) -> int:
    """Line of a row in its file, 0 where it comes from none."""
    return int(group.lines[row]) if len(group.lines) > row else 0


def noted(group: ObservationGroup, rows: IntArray, said: Callable[[int], str]) -> Iterator[Problem]:
    """A note for each of the first rows, and how many more there are."""
    for row in rows[:MOST].tolist():
        yield Problem(said(row), group.file, line_of(group, row))
    if len(rows) > MOST:
        yield Problem(
            f"and {len(rows) - MOST} more of this kind", group.file, line_of(group, int(rows[MOST]))
        )
