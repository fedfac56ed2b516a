"""Some observations of one group with all that is known of their quality: what tables are made of, piece by piece."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup, some_rows
from mor.quality.assess import Quality
from mor.quality.reliability.detectable_errors import Reliability
from mor.quality.reliability.observation_quality import ObservationQuality
from mor.quality.solved import Solved
from mor.quality.tests.test_statistics import normalised_residuals

PIECE = 8_192
"""Rows of a group that are looked at together: bounds the memory, whatever the size of the problem."""


class AssessedRows(NamedTuple):
    """Rows of a group, all arrays (k, m) in internal units; without a solution there is no quality."""

    group: ObservationGroup
    is_check: bool
    """True if the group was kept out to check the adjustment by."""
    whole: Quality | None
    one: ObservationQuality
    tests: Reliability
    test: FloatArray
    """Test values w_B, those of ``tests``."""
    w: FloatArray

    @property
    def flagged(self) -> BoolArray:
        """Observations whose test value exceeds the critical value; excluded ones are not among them."""
        if self.whole is None:
            return np.zeros(self.group.observed.shape, dtype=bool)
        beyond: BoolArray = np.abs(self.test) > self.whole.critical
        return beyond & ~self.group.left_out

    @property
    def uncontrolled(self) -> BoolArray:
        """Observations that hardly anything controls: their redundancy number is below the least one."""
        if self.whole is None:
            return np.zeros(self.group.observed.shape, dtype=bool)
        loose: BoolArray = np.nan_to_num(self.one.r, nan=1.0) < self.whole.levels.least_redundancy
        return loose & ~self.group.left_out


class AssessedGroups(NamedTuple):
    """All groups of an adjustment, ready to be cut into pieces."""

    solved: Solved

    def pieces(self) -> Iterator[AssessedRows]:
        """All observations in their order, so many at a time."""
        for number, group in enumerate(self.solved.adjustment.problem.groups):
            for start in range(0, group.count, PIECE):
                yield self.rows(number, slice(start, start + PIECE))

    def rows(self, number: int, rows: IntArray | slice) -> AssessedRows:
        """Some rows of a group."""
        quality, groups = self.solved.quality, self.solved.adjustment.problem.groups
        group = some_rows(groups[number], rows)
        is_check = number >= len(groups) - len(self.solved.network.checks)
        if quality is None:
            nothing = np.full(group.observed.shape, np.nan)
            none = np.zeros(nothing.shape, dtype=bool)
            no_joint = np.full(group.count, np.nan), np.zeros(group.count, dtype=np.int8)
            v = -misclosures(group, self.solved.adjustment.values)
            one = ObservationQuality(v, nothing, nothing, *no_joint, nothing, none)
            return AssessedRows(group, is_check, None, one, Reliability(one, np.nan), nothing, nothing)
        one, tests = quality.groups[number].at(rows), quality.reliability[number].at(rows)
        return AssessedRows(group, is_check, quality, one, tests, tests.test, normalised_residuals(one))
