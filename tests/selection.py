"""The parameters of a test that belong to the default run, and those that are slow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest


def slow_after(count: int, parameters: Iterable[object]) -> list[object]:
    """Return the parameters of a test, all but the first ``count`` of them marked slow."""
    listed = list(parameters)
    return [*listed[:count], *(slow(value) for value in listed[count:])]


def slow_but(chosen: Iterable[object], parameters: Iterable[object]) -> list[object]:
    """Return the parameters of a test, all but the ``chosen`` ones marked slow."""
    kept = list(chosen)
    return [value if value in kept else slow(value) for value in parameters]


def slow(value: object) -> object:
    """Return one parameter, or one tuple of parameters, marked slow."""
    values: Sequence[object] = value if isinstance(value, tuple) else (value,)
    return pytest.param(*values, marks=pytest.mark.slow)
