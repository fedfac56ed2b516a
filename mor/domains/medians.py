"""Medians of what is spread over domains: exact, in two rounds, of which the second looks between two bounds.

Each part tells every t-th of its sorted values. A part of which m such values lie below x has m·t values below x at
most, and (m − 1)·t + 1 at least; so bounds of the median are known, and few values lie between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray

_MOST = 4096
"""Values that a part tells in the first round."""


class Sampled(NamedTuple):
    """Some of the sorted values of a part."""

    values: FloatArray
    stride: int
    size: int
    """Number of all."""


class Between(NamedTuple):
    """What a part has between two bounds."""

    below: int
    values: FloatArray


def sampled(values: FloatArray) -> Sampled:
    """Some of sorted values (n,)."""
    stride = max(-(-len(values) // _MOST), 1)
    return Sampled(values[::stride], stride, len(values))


def bounds(parts: Sequence[Sampled]) -> tuple[float, float]:
    """Two values between which the median of all lies."""
    count = sum(part.size for part in parts)
    told = np.unique(np.concatenate([part.values for part in parts]))
    below, up_to = np.zeros(len(told), dtype=np.int64), np.zeros(len(told), dtype=np.int64)
    for part in parts:
        below += np.minimum(np.searchsorted(part.values, told, "left") * part.stride, part.size)
        seen = np.searchsorted(part.values, told, "right")
        up_to += np.where(seen > 0, (seen - 1) * part.stride + 1, 0)
    low = told[below <= (count - 1) // 2]
    high = told[up_to > count // 2]
    return (low[-1] if len(low) else -np.inf), (high[0] if len(high) else np.inf)


def between(values: FloatArray, low: float, high: float) -> Between:
    """What of sorted values (n,) lies between two bounds, these included."""
    first, last = np.searchsorted(values, low, "left"), np.searchsorted(values, high, "right")
    return Between(int(first), values[first:last])


def median(parts: Sequence[Between], count: int) -> float:
    """The median of ``count`` values, of which the parts have told those about it."""
    values = np.sort(np.concatenate([part.values for part in parts]))
    below = sum(part.below for part in parts)
    return float(np.mean(values[[(count - 1) // 2 - below, count // 2 - below]]))
