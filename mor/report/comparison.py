"""Two ``results.json`` beside each other: which numbers differ, and by how much."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple


class Difference(NamedTuple):
    """A difference between two results."""

    place: str
    one: Any
    other: Any

    @property
    def amount(self) -> float:
        """Size of the difference; infinite if it is none of numbers."""
        if _is_number(self.one) and _is_number(self.other):
            return abs(float(self.one) - float(self.other))
        return float("inf")


def differences(one: Any, other: Any, tolerance: float) -> list[Difference]:
    """Differences between two contents of ``results.json`` beyond ``tolerance`` · max(1, |number|), largest first.

    Rows are matched by their identifiers, residuals by their place.
    """
    return sorted(_differences(one, other, tolerance, ""), key=lambda difference: -difference.amount)


def _differences(one: Any, other: Any, tolerance: float, place: str) -> Iterator[Difference]:
    if isinstance(one, dict) and isinstance(other, dict):
        # Keys that may differ between two runs that agree.
        ignored = {
            *("program", "identity", "title", "iterations", "kernels", "iteration_log", "tables", "files"),
            *("snooping", "suspicious", "robust"),
        }
        for key in [*one, *(key for key in other if key not in one)]:
            if key in ignored:
                continue
            here = f"{place}.{key}" if place else key
            if key not in one or key not in other:
                yield Difference(here, one.get(key), other.get(key))
            else:
                yield from _differences(one[key], other[key], tolerance, here)
    elif isinstance(one, list) and isinstance(other, list):
        yield from _lists(one, other, tolerance, place)
    elif _is_number(one) and _is_number(other):
        if abs(one - other) > tolerance * max(1.0, abs(one), abs(other)):
            yield Difference(place, one, other)
    elif one != other:
        yield Difference(place, one, other)


def _lists(one: list[Any], other: list[Any], tolerance: float, place: str) -> Iterator[Difference]:
    named = [_by_name(rows) for rows in (one, other)]
    if named[0] is not None and named[1] is not None:
        yield from _differences(named[0], named[1], tolerance, place)
        return
    if len(one) != len(other):
        yield Difference(f"{place} (number of rows)", len(one), len(other))
        return
    for number, (a, b) in enumerate(zip(one, other, strict=True)):
        yield from _differences(a, b, tolerance, f"{place}[{number}]")


def said_value(value: Any) -> str:
    """A value of results on one line: of a row that the other one lacks only that it is there."""
    return "there" if isinstance(value, (dict, list)) else "missing" if value is None else str(value)


def _by_name(rows: list[Any]) -> dict[str, Any] | None:
    for key in ("id", "name"):
        if rows and all(isinstance(row, dict) and key in row for row in rows):
            names = [str(row[key]) for row in rows]
            if len(set(names)) == len(names):
                return dict(zip(names, rows, strict=True))
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
