"""The one place that decides whether there is a compiler.

``compile_kernel`` is numba's ``njit`` with an on-disk cache where numba can be imported, and leaves the function
alone otherwise. ``available`` tells the callers whether to take a kernel or the plain numpy form of the same step.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be reordered and multiply-adds fused, so that inner products use vector registers; infinities and
# not-a-numbers keep their meaning, unlike under numba's unrestricted ``fastmath=True``.
_FAST_SUMS = {"reassoc", "contract", "nsz"}

try:
    import numba
except ImportError:
    available = False

    def compile_kernel(function: Function) -> Function:
        """Return the function as it is: there is no compiler."""
        return function

    def compile_inline(function: Function) -> Function:
        """Return the function as it is: there is no compiler."""
        return function

    @contextmanager
    def compilation_announced(announce: Callable[[], None]) -> Iterator[None]:
        """Nothing is ever compiled."""
        yield

else:
    from numba.core.event import Event, Listener, install_listener

    available = True
    if "NUMBA_SLP_VECTORIZE" not in os.environ:
        # Blocks of six by six are written out entry by entry. Packed into vector registers that takes half the time.
        numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

    def compile_kernel(function: Function) -> Function:
        """Compile on first use; keep the machine code on disk wherever a directory for it can be written."""
        try:
            compiled: Function = numba.njit(
                function, cache=True, nogil=True, fastmath=_FAST_SUMS, forceinline=True
            )
        except RuntimeError:  # numba finds no writable place for its cache
            compiled = numba.njit(function, nogil=True, fastmath=_FAST_SUMS)
        return compiled

    def compile_inline(function: Function) -> Function:
        """Compile a small function into the kernels that call it.

        A call that passes arrays costs some 50 nanoseconds, for they are counted in and out.
        """
        inlined: Function = numba.njit(function, inline="always", nogil=True, fastmath=_FAST_SUMS)
        return inlined

    class _First(Listener):
        """Listens until something is compiled that was not on disk."""

        def __init__(self, announce: Callable[[], None]) -> None:
            self._announce: Callable[[], None] | None = announce

        def on_start(self, event: Event) -> None:
            announce, self._announce = self._announce, None
            if announce is not None:
                announce()

        def on_end(self, event: Event) -> None:
            pass

    @contextmanager
    def compilation_announced(announce: Callable[[], None]) -> Iterator[None]:
        """Within, call ``announce`` once before the first kernel is compiled, which takes a while on the first run."""
        with install_listener("numba:compile", _First(announce)):
            yield
