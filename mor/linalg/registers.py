"""Four numbers side by side, as a vector register holds them: what the inner loops of kernels are written in.

Of loops over single numbers the compiler makes such operations where it sees that it may, and where it thinks that it
should; for blocks of six by six, and for rows of a few numbers, it often does not, or works on several rows whose
numbers lie far apart. Written in fours a loop is what it looks like, is shorter, and is compiled sooner.

In a kernel a four is a value that is added and multiplied, by numbers too; here, without a compiler, it is an array.
Places count the numbers of a flat array from its beginning, and are not looked at: there is no counting from the end.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, Generic, ParamSpec, TypeAlias, TypeVar

import numpy as np

from mor.types import FloatArray

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

Four: TypeAlias = FloatArray
"""Four numbers."""


class Operation(Generic[Parameters, Result]):
    """A function that is a few instructions in a kernel, written out in ``registers_in_numba``."""

    def __init__(self, function: Callable[Parameters, Result]) -> None:
        self.py_func = function
        update_wrapper(self, function)

    def __call__(self, *args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        """Do the same in Python."""
        return self.py_func(*args, **kwargs)

    @property
    def in_numba(self) -> Any:
        """Return the form of the function for Numba."""
        from mor.linalg import numba_registers as registers_in_numba

        return getattr(registers_in_numba, self.py_func.__name__)


@Operation
def four(array: FloatArray, place: int) -> Four:
    """Return the four numbers of an array from a place on."""
    return array[place : place + 4].copy()


@Operation
def same(number: float) -> Four:
    """Return a number four times."""
    return np.full(4, number)


@Operation
def each(array: FloatArray, place: int) -> Four:
    """Return the number of an array at a place four times."""
    return np.full(4, array[place])


@Operation
def put(array: FloatArray, place: int, numbers: Four) -> None:
    """Store four numbers in an array from a place on."""
    array[place : place + 4] = numbers


@Operation
def total(numbers: Four) -> float:
    """Return the sum of the four."""
    return float((numbers[0] + numbers[1]) + (numbers[2] + numbers[3]))


@Operation
def fetch(array: FloatArray, place: int) -> None:
    """Have the number of an array at a place, and what stands beside it, brought into the cache meanwhile."""
