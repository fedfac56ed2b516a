"""A cache for pure functions of arrays.

The growth of parts starts again and again from the same state. If wrong names or start values keep parts from fitting
together, nine of ten calls repeat earlier ones.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

Given = ParamSpec("Given")
Found = TypeVar("Found")


def remembered(most: int) -> Callable[[Callable[Given, Found]], Callable[Given, Found]]:
    """Decorate a pure function of arrays and hashable values; keep its last ``most`` results.

    Callers share the results and must not change them.
    """

    def decorate(function: Callable[Given, Found]) -> Callable[Given, Found]:
        known: OrderedDict[Hashable, Found] = OrderedDict()

        @wraps(function)
        def cached(*args: Given.args, **kwargs: Given.kwargs) -> Found:
            key = tuple(_hashable(value) for value in (*args, *sorted(kwargs.items())))
            if key not in known:
                known[key] = function(*args, **kwargs)
                if len(known) > most:
                    known.popitem(last=False)
            known.move_to_end(key)
            return known[key]

        return cached

    return decorate


def _hashable(value: object) -> Hashable:
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    return value
