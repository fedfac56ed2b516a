"""Domains of similar work, by place: images halved again and again across the longer side of where they are.

The halves are the tree along which boundaries are joined: what is near in place is joined first.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray

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


def without_empty(tree: Halves, used: BoolArray) -> tuple[Halves, IntArray]:
    """The tree of the domains that are used, one at least, numbered anew; the new number (count,) of each old one.

    A domain that is not used becomes part of the one it would have been joined with first.
    """
    number = np.full(len(used), -1, dtype=np.int64)

    def left(part: Halves) -> Halves | None:
        if isinstance(part, int):
            if not used[part]:
                return None
            number[part] = number.max() + 1
            return int(number[part])
        both = [left(one) for one in part]
        kept = [one for one in both if one is not None]
        if len(kept) == 1:
            members = _members(part)
            heir = kept[0]
            while not isinstance(heir, int):
                heir = heir[0]
            number[[d for d in members if number[d] < 0]] = heir
        return (kept[0], kept[1]) if len(kept) == 2 else kept[0] if kept else None

    found = left(tree)
    return (0, np.zeros_like(number)) if found is None else (found, number)


def _members(part: Halves) -> list[int]:
    return [part] if isinstance(part, int) else [*_members(part[0]), *_members(part[1])]
