"""How much may be done that may be in vain: counted in work, never in seconds, so that the same input gives the same.

Where nothing fits there is always something else to try: other start values, weights that find gross errors, possible
causes, each of them with adjustments of its own. An allowance is as much as all of that may take. What is done within
one is counted where it is done, by :func:`spend`; beyond it :class:`SpentError` ends it.

A unit is what an observation takes in an iteration in plain numpy, two or three microseconds. Answers that are
remembered from before cost what they cost the first time: what a process did earlier decides nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from mor.compilation import WORTH_COMPILING

LEAST = 4_200_000
"""Units that any network may take: some seconds, in which the smallest are adjusted more than two hundred times."""
ITERATION = 2_000
"""Units of an iteration, besides those of its observations."""
COMPILED = 5
"""Observations that are as much work as one, where kernels are compiled."""
ITERATIONS = 10
"""Iterations of an adjustment that runs well."""

Found = TypeVar("Found")


class SpentError(Exception):
    """More is to be done than may be."""


@dataclass(eq=False)
class Allowance:
    """Work that may be done, and what has been done of it."""

    most: float = float("inf")
    """Units."""
    done: Callable[[int], None] = lambda _: None
    """Told what is done."""
    spent: int = 0
    answered: set[Hashable] = field(default_factory=set)
    """Questions that were paid for, whose answers are remembered."""

    @property
    def is_left(self) -> bool:
        """True as long as more may be done."""
        return self.spent < self.most

    def spend(self, work: int, most: float) -> None:
        """Count some work, up to ``most`` in all.

        Raises:
            SpentError: it would be more; all is spent then, however much it would have been.
        """
        taken = int(min(work, max(most - self.spent, 0)))
        self.spent += taken
        self.done(taken)
        if taken < work:
            raise SpentError


class _Account(NamedTuple):
    """An allowance that is spent at the moment, how much of it may be, and the one it is part of."""

    allowance: Allowance
    most: float
    whole: _Account | None


_account: ContextVar[_Account | None] = ContextVar("account", default=None)


@contextmanager
def within(allowance: Allowance, most: float | None = None) -> Iterator[None]:
    """Within, work is counted, and ended by :class:`SpentError` where it is more than the allowance, or ``most``.

    An allowance within another one is part of it; within itself the innermost ``most`` holds.
    """
    whole = _account.get()
    if whole is not None and whole.allowance is allowance:
        whole = whole.whole
    before = _account.set(_Account(allowance, allowance.most if most is None else most, whole))
    try:
        yield
    finally:
        _account.reset(before)


def counted_in(allowance: Allowance) -> AbstractContextManager[None]:
    """Within, work is counted and not ended."""
    return within(allowance, float("inf"))


@contextmanager
def uncounted() -> Iterator[None]:
    """Within, nothing is counted: what is done by others, here or in other processes, is told as a whole."""
    before = _account.set(None)
    try:
        yield
    finally:
        _account.reset(before)


def _accounts() -> Iterator[_Account]:
    """The allowance that is spent at the moment, and those that it is part of."""
    account = _account.get()
    while account is not None:
        yield account
        account = account.whole


def spend(work: int) -> None:
    """Tell that some work is done now. Raises :class:`SpentError` within an allowance that it is too much for."""
    for account in _accounts():
        account.allowance.spend(work, account.most)


def answer(
    question: Hashable, known: tuple[Found, int] | None, work_out: Callable[[], Found]
) -> tuple[Found, int]:
    """A remembered answer with the work it took, or what is worked out now; paid once of each allowance.

    Raises :class:`SpentError` in both cases where it took more than there is.
    """
    payers = [account for account in _accounts() if question not in account.allowance.answered]
    if known is None:
        left = min((account.most - account.allowance.spent for account in payers), default=float("inf"))
        own = Allowance(left)
        before = _account.set(_Account(own, left, None))
        try:
            known = work_out(), own.spent
        except SpentError:
            for account in payers:
                account.allowance.spend(own.spent, account.most)
            raise
        finally:
            _account.reset(before)
    for account in payers:
        account.allowance.spend(known[1], account.most)
        account.allowance.answered.add(question)
    return known


def of_iteration(observations: int, times: float = 1.0) -> int:
    """Units of an iteration of a network of so many observations, each ``times`` the work of one that is plain."""
    return ITERATION + int(observations * times) // (COMPILED if observations >= WORTH_COMPILING else 1)


def allowed(observations: int, adjustments: int, least: int = LEAST, times: float = 1.0) -> int:
    """Units for a network of so many observations: those of some adjustments, and what any network may take."""
    return max(least, adjustments * ITERATIONS * of_iteration(observations, times))
