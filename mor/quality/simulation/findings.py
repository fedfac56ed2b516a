"""What a Monte Carlo simulation finds, against what theory says, with the limits that chance leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri

from mor.arrays import FloatArray
from mor.quality.simulation.monte_carlo import CONFIDENCE, Tally, Truth

LEVEL = 0.001
"""Of each finding: chance alone puts one in a thousand outside its limits."""


class Finding(NamedTuple):
    """One figure: what theory says, what was found, and between which limits chance leaves it."""

    name: str
    expected: float
    found: float
    lower: float
    upper: float

    @property
    def agrees(self) -> bool:
        """True where chance explains the difference."""
        return bool(self.lower <= self.found <= self.upper)


def findings(truth: Truth, tally: Tally) -> list[Finding]:
    """All figures of a simulation; none but the share of solutions where nothing was solved."""
    runs, n = float(tally.runs), float(tally.solved)
    found = [Finding("solutions", 1.0, n / runs, 1.0, 1.0)]
    if n < 2.0:
        return found
    z = -float(ndtri(0.5 * LEVEL))
    quality = truth.quality
    f = quality.redundancy
    if f > 0:
        s = z * float(np.sqrt(2.0 / (f * n)))
        found.append(Finding("variance", 1.0, float(tally.omega) / (f * n), 1.0 - s, 1.0 + s))
        found.append(_share("global", quality.levels.overall, float(tally.rejected), n, z))
        found.append(_mean("flagged", quality.levels.snooping, tally.flagged, n, z, _tests(truth)))
    if len(truth.points):
        found.append(_mean("coverage", CONFIDENCE, tally.coverage, n, z, len(truth.points)))
        found += _of_points(tally, n)
        if f > 0:
            after = float(tally.covered_after.mean()) / n
            spread = _spread(tally.coverage, n) * z
            found.append(
                Finding("coverage after", CONFIDENCE, after, CONFIDENCE - spread, CONFIDENCE + spread)
            )
    found += _of_unknowns(truth, tally, n)
    if float(tally.planted) > 0.0:
        found.append(_share("power", quality.levels.power, float(tally.found), float(tally.planted), z))
    return found


def _share(name: str, p: float, count: float, n: float, z: float) -> Finding:
    half = z * float(np.sqrt(p * (1.0 - p) / n)) + 0.5 / n
    return Finding(name, p, count / n, max(p - half, 0.0), min(p + half, 1.0))


def _tests(truth: Truth) -> int:
    return int(sum(np.count_nonzero(mask) for mask in truth.testable))


def _mean(name: str, p: float, sums: FloatArray, n: float, z: float, each: int) -> Finding:
    """A share that each run has a value of, of so many cases ``each``.

    Its spread between the runs says how far chance moves their mean; where few runs have seen no case of something
    rare, that is no less than for independent cases.
    """
    cases = n * max(each, 1)
    spread = max(_spread(sums, n), float(np.sqrt(p * (1.0 - p) / cases)))
    half = z * spread + 0.5 / cases
    return Finding(name, p, float(sums[0]) / n, max(p - half, 0.0), min(p + half, 1.0))


def _spread(sums: FloatArray, n: float) -> float:
    variance = max(float(sums[1]) / n - (float(sums[0]) / n) ** 2, 0.0)
    return float(np.sqrt(variance / (n - 1.0)))


def _of_points(tally: Tally, n: float) -> list[Finding]:
    """The points that are covered least and most often, with limits for all points together (Šidák)."""
    level = -np.expm1(np.log1p(-LEVEL) / len(tally.covered))
    half = -float(ndtri(0.5 * level)) * float(np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / n)) + 1.0 / n
    limits = max(CONFIDENCE - half, 0.0), min(CONFIDENCE + half, 1.0)
    share = tally.covered / n
    return [
        Finding("coverage least", CONFIDENCE, float(share.min()), *limits),
        Finding("coverage most", CONFIDENCE, float(share.max()), *limits),
    ]


def _of_unknowns(truth: Truth, tally: Tally, n: float) -> list[Finding]:
    """Largest bias of an unknown, in σ of its mean; smallest and largest of the σ found by the σ said."""
    used = truth.sigma > 0.0
    count = int(np.count_nonzero(used))
    if count == 0:
        return []
    level = -np.expm1(np.log1p(-LEVEL) / count)
    bias = np.abs(tally.correction[used]) / np.sqrt(n)
    ratio = np.sqrt(tally.square[used] / n)
    low, high = (float(np.sqrt(chdtri(n, p) / n)) for p in (1.0 - 0.5 * level, 0.5 * level))
    return [
        Finding("bias", 0.0, float(bias.max()), 0.0, -float(ndtri(0.5 * level))),
        Finding("sigma least", 1.0, float(ratio.min()), low, high),
        Finding("sigma most", 1.0, float(ratio.max()), low, high),
    ]
