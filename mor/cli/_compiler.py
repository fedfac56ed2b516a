"""What the user is told about compiled kernels: that the first run takes longer, or that all will without them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

FIRST_RUN = "first run on this machine: compiling, some 20 seconds, this once"
PLAIN = "the Python package numba is missing: same results, but much slower (pip install numba)"


@contextmanager
def compiler_announced(say: Callable[[str], None]) -> Iterator[None]:
    """Within, say once where kernels have to be compiled, or at once where there is no compiler."""
    from mor import compilation

    if not compilation.available:
        say(PLAIN)
    with compilation.compilation_announced(lambda: say(FIRST_RUN)):
        yield
