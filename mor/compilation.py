"""The one place that decides whether there is a compiler, and whether a project is worth it.

``compile_kernel`` is numba's ``njit`` with an on-disk cache. numba is imported, and a kernel compiled, when one is
called for the first time where compiled kernels are wanted: importing numba and reading the kernels from disk takes
longer than a small project takes in plain numpy. Elsewhere, and where there is no numba, a kernel is the Python
function it is written as. ``wanted`` tells the callers whether to take a kernel or the plain numpy form of a step.

A project decides once, by its size (:func:`chosen_by_size`): all of its steps are compiled, or none, so that
it gives the same bytes whether or not there is machine code of an earlier run.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from functools import cache, cached_property, update_wrapper
from importlib.util import find_spec
from threading import Lock, Thread
from typing import Any, Generic, ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# Sums may be reordered and multiply-adds fused, so that inner products use vector registers; infinities and
# not-a-numbers keep their meaning, unlike under numba's unrestricted ``fastmath=True``.
_FAST_SUMS = {"reassoc", "contract", "nsz"}

WORTH_COMPILING = 6_000
"""Observations of a project from which on compiled kernels save more than they cost, being on disk already.

Importing numba and reading the kernels takes some 0.25 s. Plain numpy lost 0.4, which it took before, in aerial blocks
at 6 000 observations, in close range blocks, whose points have many rays, at 12 000, in geodetic networks at 15 000
(docs/dependencies.md).
"""

available = find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
"""True where there is a compiler."""

_one_at_a_time = Lock()
_loading = Lock()
_plainly: ContextVar[bool] = ContextVar("plainly", default=False)
_announce: ContextVar[Callable[[], None]] = ContextVar("announce", default=lambda: None)
_miss: ContextVar[Callable[[], None]] = ContextVar("miss", default=lambda: None)


def wanted() -> bool:
    """True where kernels are to be taken, not the plain numpy form of the same step."""
    return available and not _plainly.get()


def is_small() -> bool:
    """True within a project that is not worth compiling (:func:`chosen_by_size`)."""
    return _plainly.get()


@contextmanager
def chosen_by_size(observations: int) -> Iterator[None]:
    """Within, kernels are compiled if a project of so many observations is worth it, and nothing is elsewhere."""
    before = _plainly.set(observations < WORTH_COMPILING)
    if not available and not _plainly.get():
        _miss.get()()
    try:
        yield
    finally:
        _plainly.reset(before)


def as_here(work: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """The same work to be done by another thread, which takes kernels or plain numpy as the one that asks for it."""
    context = copy_context()

    def carried(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        return context.run(work, *args, **kwargs)

    return carried


@contextmanager
def compilation_announced(announce: Callable[[], None], miss: Callable[[], None]) -> Iterator[None]:
    """Within, call ``announce`` once before the first kernel is compiled, which takes a while on the first run.

    Or call ``miss`` once where a project is worth compiling and there is no compiler.
    """
    compiling, missing = _announce.set(_once(announce)), _miss.set(_once(miss))
    try:
        yield
    finally:
        _announce.reset(compiling)
        _miss.reset(missing)


def _once(say: Callable[[], None]) -> Callable[[], None]:
    left = [say]
    return lambda: left.pop()() if left else None


class Kernel(Generic[Parameters, Result]):
    """A function that is compiled when it is first called where kernels are wanted."""

    def __init__(self, function: Callable[Parameters, Result], **options: Any) -> None:
        self.py_func = function
        self._options = {"nogil": True, "fastmath": _FAST_SUMS, **options}
        update_wrapper(self, function)

    def __call__(self, *args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        """Call the machine code where kernels are wanted, the Python function elsewhere."""
        function = self.compiled if wanted() else self.py_func
        return function(*args, **kwargs)

    @cached_property
    def compiled(self) -> Callable[Parameters, Result]:
        """The function as numba calls it, with machine code of an earlier run where it is there."""
        numba = _numba()
        from mor.kernel_cache import KernelCache

        with _one_at_a_time:
            compiled = numba.njit(self.py_func, **self._options)
            compiled._cache = KernelCache(self.py_func, self._options)
            kept: Callable[Parameters, Result] = self.__dict__.setdefault("compiled", compiled)
        return kept

    @property
    def targetoptions(self) -> dict[str, Any]:
        """What numba asks a function for that another kernel calls: whether it is inlined."""
        return self._options

    @property
    def _numba_type_(self) -> Any:
        """What numba takes a kernel for that another one calls."""
        return self.compiled._numba_type_  # type: ignore[attr-defined]


def compile_kernel(function: Callable[Parameters, Result]) -> Kernel[Parameters, Result]:
    """Compile on first use, and keep the machine code on disk.

    What a kernel calls becomes part of its own machine code. Else the system linker of the process decides which of two
    copies of it is called, the one that stands in the caller or that of another kernel: one in the run that compiles,
    the other in those that read the machine code from disk, and the two differ in the last digit.
    """
    return Kernel(function, forceinline=True)


def compile_inline(function: Callable[Parameters, Result]) -> Kernel[Parameters, Result]:
    """Compile a small function into the kernels that call it.

    A call that passes arrays costs some 50 nanoseconds, for they are counted in and out.
    """
    return Kernel(function, inline="always")


def not_kept() -> str:
    """Why machine code of this run could not be kept on disk; empty where it could."""
    module = sys.modules.get("mor.kernel_cache")
    return module.not_kept[0] if module is not None and module.not_kept else ""


def load_ahead() -> None:
    """Import the compiler in a thread of its own, for a project that looks as if it were worth it.

    That takes 0.2 s, in which the caller reads tables: most of that is done outside of the interpreter.
    """
    if available:
        Thread(target=_numba, name="compiler").start()


def _numba() -> Any:
    """The compiler, imported and set up when it is asked for first; who asks meanwhile waits."""
    with _loading:
        return _loaded()


@cache
def _loaded() -> Any:
    import numba
    from numba.core.event import Event, Listener, register

    if "NUMBA_SLP_VECTORIZE" not in os.environ:
        # Blocks of six by six are written out entry by entry. Packed into vector registers that takes half the time.
        numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

    class Announcer(Listener):
        """Tells once when something is compiled that was not on disk."""

        def on_start(self, event: Event) -> None:
            _announce.get()()

        def on_end(self, event: Event) -> None:
            pass

    register("numba:compile", Announcer())  # type: ignore[no-untyped-call]
    return numba
