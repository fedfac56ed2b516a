"""Passes over the rays on all processors: the chunks run in a few lanes side by side.

How the chunks are shared out depends on the problem alone, and what the lanes found is put together in their order: the
last digit of a result does not depend on how many processors there are. (Rays that are left to numpy may differ in it
from run to run: numpy adds up in an order that depends on where an array begins.)
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

from mor.adjustment.rays.plan import RayPlan
from mor.compilation import as_here
from mor.machine import processors

Found = TypeVar("Found")

MOST_LANES = 4
NUMBERS_OF_ALL_LANES = 30_000_000
"""Room (240 MB) for the reduced systems that the lanes add up each for itself."""


def in_lanes(rays: RayPlan, numbers: int, work: Callable[[RayPlan], Found]) -> list[Found]:
    """What the work finds in each lane, in their order.

    Args:
        rays: all rays; a lane is the same with some of its chunks.
        numbers: how many numbers the work holds in each lane, so that lanes do not fill the memory.
        work: a pass over the chunks, which may write to arrays at places that are its own.
    """
    lanes = _lanes(rays, numbers)
    workers = min(len(lanes), processors())
    if workers <= 1:
        return [work(lane) for lane in lanes]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda one: one(), [as_here(partial(work, lane)) for lane in lanes]))


def _lanes(rays: RayPlan, numbers: int) -> list[RayPlan]:
    chunks = rays.chunks
    count = max(min(MOST_LANES, len(chunks) // 2, NUMBERS_OF_ALL_LANES // max(numbers, 1)), 1)
    bounds = [len(chunks) * k // count for k in range(count + 1)]
    return [rays._replace(chunks=chunks[bounds[k] : bounds[k + 1]]) for k in range(count)]
