"""Which of several measurements of one thing agree, where all together do not: the worst are left out one by one.

A wrong identity among four arcs or a dozen directions draws what follows from all of them away, and with it whatever
hangs on that later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray

CANDIDATES = 6
"""Measurements of which each is left out on trial: those that fit worst."""


class Fit(NamedTuple):
    """How well some measurements agree."""

    sigma0: float
    """Infinite where they lead to nothing."""
    sizes: FloatArray
    """(k,) how far each is off, in any unit; empty where they lead to nothing."""


def agreeing(count: int, fit: Callable[[IntArray], Fit], limit: float, least: int) -> IntArray:
    """Rows (k,) of ``count`` measurements that agree to ``limit``; all of them where no ``least`` of them do.

    ``fit``: how well some rows agree. A third of all may be left out: of the rest more would have to be wrong alike.
    """
    rows: IntArray = np.arange(count)
    found = fit(rows)
    most = count // 3
    while not found.sigma0 <= limit:
        if len(rows) <= max(least, count - most):
            return np.arange(count)
        worst = np.argsort(-found.sizes, kind="stable")[:CANDIDATES]
        tried = [np.delete(rows, k) for k in (worst if len(worst) else range(len(rows)))]
        fits = [fit(one) for one in tried]
        best = int(np.argmin([one.sigma0 for one in fits]))
        rows, found = tried[best], fits[best]
    return rows
