"""What the user is told about compiled kernels: that the first run takes longer, or that a large project does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

FIRST_RUN = "first run on this machine: compiling, some 20 seconds, this once"
PLAIN = (
    "the Python package numba is missing: same results, but much slower (pip install 'mor-adjustment[large]')"
)
NOT_KEPT = "what was compiled cannot be kept, each run compiles anew: {reason}"


class Say(Protocol):
    """Tells the user something, with values for the places in braces."""

    def __call__(self, words: str, /, **values: object) -> None:
        """Say it."""


@contextmanager
def compiler_announced(say: Say) -> Iterator[None]:
    """Within, say once where kernels have to be compiled, or where a large project has no compiler.

    At the end, say where what was compiled could not be kept.
    """
    from mor import compilation

    with compilation.compilation_announced(lambda: say(FIRST_RUN), lambda: say(PLAIN)):
        yield
    if reason := compilation.not_kept():
        say(NOT_KEPT, reason=reason)
