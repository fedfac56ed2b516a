"""How many threads the dense linear algebra may use.

Threads wake up and spin for every call. On the small fronts of a sparse factorisation that costs far more
than it gains (on a busy machine a thousandfold), so they are let loose on large dense matrices only.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cache

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

# Order of a dense matrix from which on several threads are worth waking.
WORTH_THREADS = 1000


@cache
def _controller() -> ThreadpoolController:
    """Return the handle on the linear algebra libraries; looking for them takes milliseconds."""
    return ThreadpoolController()


def threads_for(order: int) -> AbstractContextManager[object]:
    """Return a context in which matrices of this order are worked on: one thread unless they are large."""
    if order >= WORTH_THREADS:
        return nullcontext()
    return one_thread()


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which linear algebra has one thread: sums come out the same, wherever they are made."""
    limit: AbstractContextManager[object] = _controller().limit(limits=1, user_api="blas")
    return limit
