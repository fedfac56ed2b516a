"""Passes over the rays of the eliminated points: by the threads of this process, or by the workers of a cluster.

A pass runs in a few lanes side by side, each with some of the chunks of rays. It is a pure function
``task(shared, rays, put, *arguments)``: ``shared`` has all that stays the same from pass to pass, ``rays`` are those of
the lane. It returns what is added up, and hands over what belongs to single points or rays with ``put(…)``, a chunk at
a time: threads write it to its place at once, from a worker it is sent home first.

How the chunks are shared out depends on the problem alone, and what the lanes found is put together in their order: the
last digit of a result does not depend on how many processors or workers there are. (Rays that are left to numpy may
differ in it from run to run: numpy adds up in an order that depends on where an array begins.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from copy import deepcopy
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from mor.linalg import compilation
from mor.machine import processors
from mor.solve.problem import Problem
from mor.solve.rays import RayPlan

Found = TypeVar("Found")

WORTH_SENDING = 1_000_000
"""Rays from which on passes are done by workers.

An adjustment passes over them some ten times. For fewer that takes threads less time than it takes workers to start,
to get their rays and to load the kernels: 553 000 rays took two threads 2.3 s, two workers of the same machine 6.2 s.
"""


class Shared(Protocol):
    """Data that passes over some rays share."""

    @property
    def problem(self) -> Problem:
        """The problem."""

    @property
    def rays(self) -> RayPlan:
        """All rays of the eliminated points."""


class RaysOfProblem(NamedTuple):
    """Rays for which there is no plan yet."""

    problem: Problem
    rays: RayPlan


Put = Callable[..., None]
Task = Callable[..., Found]


class Workers(Protocol):
    """Processes that do tasks."""

    def results(
        self, shared: object, call: Callable[..., Found], each: Sequence[object], common: object
    ) -> Iterator[Found]:
        """Yield ``call(shared, one, common)`` for all, in their order."""


_workers: ContextVar[Callable[[], Workers | None]] = ContextVar("workers", default=lambda: None)


@contextmanager
def shared_among(workers: Callable[[], Workers | None]) -> Iterator[None]:
    """Within, long passes are done by the workers that the function returns; it may start them."""
    before = _workers.set(workers)
    try:
        yield
    finally:
        _workers.reset(before)


def in_lanes(shared: Shared, numbers: int, task: Task[Found], *arguments: Any, put: Put | None = None) -> list[Found]:
    """Return the results of the task of all lanes, in their order.

    Args:
        shared: what the task needs and does not change from pass to pass; a lane has some chunks of its rays.
        numbers: how many numbers the task holds in each lane, so that lanes do not fill the memory.
        task: a pure function ``task(shared, rays, put, *arguments)``.
        arguments: what changes from pass to pass.
        put: takes what the task hands over, and may write it to arrays at places that are the chunk's own.
    """
    chunks = shared.rays.chunks
    workers = _workers.get()() if len(shared.rays.row) >= WORTH_SENDING else None
    # Each lane adds up a reduced system for itself: 240 MB in all.
    room = min(len(chunks) // 2, 30_000_000 // max(numbers, 1))
    count = 4 if room >= 4 else 2 if room >= 2 else 1  # three would leave one of two processors without work
    bounds = [len(chunks) * k // count for k in range(count + 1)]
    lanes = [(bounds[k], bounds[k + 1]) for k in range(count)]
    if workers is not None:
        common = task, arguments, compilation.wanted()
        results: list[Found] = []
        for result, handed in workers.results(shared, _done_by_worker, lanes, common):
            for some in handed:
                if put is not None:
                    put(*some)
            results.append(result)
        return results
    work = [partial(task, shared, _lane(shared, *lane), put, *arguments) for lane in lanes]
    count = min(len(lanes), processors())
    if count <= 1:
        return [one() for one in work]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(lambda one: one(), map(compilation.as_here, work)))


def _lane(shared: Shared, first: int, last: int) -> RayPlan:
    return shared.rays._replace(chunks=shared.rays.chunks[first:last])


def _done_by_worker(
    shared: Shared, lane: tuple[int, int], common: tuple[Task[Found], tuple[Any, ...], bool]
) -> tuple[Found, list[tuple[Any, ...]]]:
    task, arguments, kernels = common
    handed: list[tuple[Any, ...]] = []

    def put(*some: Any) -> None:
        handed.append(deepcopy(some))  # the next chunk overwrites the arrays of this one

    used = compilation.chosen_by_size(len(shared.rays.row)) if kernels else compilation.kernels_used(used=False)
    with used, np.errstate(all="ignore"):
        return task(shared, _lane(shared, *lane), put, *arguments), handed
