"""Domains of similar work, by place: images halved again and again across the longer side of where they are.

The halves are the tree along which boundaries are joined: what is near in place is joined first.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from mor.arrays import FloatArray, IntArray

Halves: TypeAlias = "int | tuple[Halves, Halves]"


def halved(places: FloatArray, work: FloatArray, count: int) -> tuple[IntArray, Halves]:
    """Domain (n,) of images at places (n, 3) with so much work (n,), and the tree of the ``count`` domains."""
    domain = np.zeros(len(places), dtype=np.int64)

    def divide(members: IntArray, first: int, parts: int) -> Halves:
        if parts == 1:
            domain[members] = first
            return first
        along = int(np.argmax(np.ptp(places[members], axis=0))) if len(members) else 0
        order = members[np.argsort(places[members, along], kind="stable")]
        done = np.cumsum(work[order])
        left = parts // 2
        cut = int(np.searchsorted(done, done[-1] * left / parts)) if len(done) else 0
        return divide(order[:cut], first, left), divide(order[cut:], first + left, parts - left)

    return domain, divide(np.arange(len(places)), 0, count)
