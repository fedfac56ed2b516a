"""What the user is told about compiled kernels: that the first run takes longer, or that a large project does."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

FIRST_RUN = "first run on this machine: compiling, some 20 seconds, this once"
PLAIN = "the Python package numba is missing: same results, but much slower (pip install numba)"


def compiler_announced(say: Callable[[str], None]) -> AbstractContextManager[None]:
    """Within, say once where kernels have to be compiled, or where a large project has no compiler."""
    from mor import compilation

    return compilation.compilation_announced(lambda: say(FIRST_RUN), lambda: say(PLAIN))
