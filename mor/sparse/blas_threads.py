"""Number of threads of dense linear algebra.

Threads wake up and spin for every call. On the small fronts of a sparse factorisation that costs far more
than it gains (on a busy machine a thousandfold), so they are let loose on large fronts only, each by itself.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cache
from itertools import groupby

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from mor.arrays import IntArray

# Order of a dense matrix from which on several threads are worth waking. One thread factorises it in a tenth of a
# second; where another program has the second processor, two take ten times as long.
WORTH_THREADS = 2000


@cache
def _controller() -> ThreadpoolController:
    """Return the handle on the linear algebra libraries; looking for them takes milliseconds."""
    return ThreadpoolController()


def threads_for(order: int) -> AbstractContextManager[object]:
    """Return a context in which matrices of this order are worked on: one thread unless they are large."""
    if order >= WORTH_THREADS:
        return nullcontext()
    return one_thread()


def alike(orders: IntArray) -> list[tuple[int, range]]:
    """Runs of neighbouring fronts (f,), all of them large or none: the largest order of each run, and its places.

    A limit on threads takes as long as a small front.
    """
    runs, first = [], 0
    for _, run in groupby(orders.tolist(), key=lambda order: order >= WORTH_THREADS):
        own = list(run)
        runs.append((max(own), range(first, first + len(own))))
        first += len(own)
    return runs


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which linear algebra has one thread: sums come out the same, wherever they are made."""
    limit: AbstractContextManager[object] = _controller().limit(limits=1, user_api="blas")
    return limit
