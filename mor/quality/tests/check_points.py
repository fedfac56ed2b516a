"""Check points and check distances: what observations that were kept out say of the result.

Deviations are adjusted − known. Of points: mean, root mean square, largest deviation for each axis. Of distances: the
largest length measurement error in the manner of VDI/VDE 2634, the largest |adjusted − calibrated| length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality


@dataclass(frozen=True)
class CheckOutcome:
    """One group of checks; arrays by component (m,), NaN where a component was not known."""

    group: int
    count: FloatArray
    mean: FloatArray
    rms: FloatArray
    largest: FloatArray
    """Deviation that is largest in size, with its sign."""
    exceeding: FloatArray
    """Number of deviations beyond the critical value of their test, σ of the known value and of the result together."""


def check_outcome(quality: Quality, number: int) -> CheckOutcome:
    """Deviations of a group that was kept out."""
    group: ObservationGroup = quality.adjustment.problem.groups[number]
    v = np.where(group.left_out, quality.groups[number].v, np.nan)
    test = np.where(group.left_out, quality.reliability[number].test, np.nan)
    count = np.isfinite(v).sum(axis=0)
    some = np.maximum(count, 1)
    known = np.where(count > 0, 1.0, np.nan)
    filled = np.nan_to_num(v)
    worst = np.argmax(np.abs(filled), axis=0) if len(v) else np.zeros(v.shape[1], dtype=np.int64)
    largest = filled[worst, np.arange(v.shape[1])] if len(v) else np.zeros(v.shape[1])
    return CheckOutcome(
        number,
        count.astype(float),
        filled.sum(axis=0) / some * known,
        np.sqrt((filled**2).sum(axis=0) / some) * known,
        largest * known,
        (np.abs(np.nan_to_num(test)) > quality.critical).sum(axis=0).astype(float),
    )
