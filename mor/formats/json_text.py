"""JSON with places: plain data, and the line in which a name stands."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

from mor.errors import InputError, Problem
from mor.formats.text import decoded
from mor.input_files import TABLE, read_bytes


class JsonFile:
    """The content of a JSON file. Raises :class:`InputError` if it is none, or has a key twice."""

    def __init__(self, path: Path):
        self.file = str(path)
        self.text = decoded(read_bytes(path, TABLE))[0]
        try:
            self.data: Any = json.loads(
                self.text, object_pairs_hook=self._once, parse_constant=self._constant
            )
        except json.JSONDecodeError as error:
            raise self._refused(f"this is not valid JSON: {error.msg}", error.lineno) from None
        except (RecursionError, ValueError) as error:
            words = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
            raise self._refused(f"this is not usable JSON: {words}", 0) from None

    def _refused(self, words: str, line: int) -> InputError:
        return InputError([Problem(words, self.file, line)])

    def _once(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        data = dict(pairs)
        if len(data) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise self._refused(f"key {twice!r} is given twice", self.line(twice))
        return data

    def _constant(self, name: str) -> NoReturn:
        raise self._refused(
            f"found {name}, expected a finite number", self.text[: self.text.find(name)].count("\n") + 1
        )

    def line(self, name: object) -> int:
        """The line in which a name stands between quotes for the first time, 0 where it does not."""
        at = self.text.find(json.dumps(str(name)))
        at = at if at >= 0 else self.text.find(json.dumps(str(name), ensure_ascii=False))
        return self.text.count("\n", 0, at) + 1 if at >= 0 else 0


class Wrong(ValueError):  # noqa: N818 - what is wrong with a value, not a failure
    """A value is not what was expected; the words say how."""


def mapping(value: Any, what: str) -> dict[str, Any]:
    """A mapping. Raises :class:`Wrong`."""
    if not isinstance(value, dict):
        raise Wrong(f"{what}: found {_said(value)}, expected a mapping")
    return value


def number(value: Any, what: str) -> float:
    """A finite number. Raises :class:`Wrong`."""
    try:
        result = (
            float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else float("nan")
        )
    except OverflowError:
        result = float("nan")
    if not isfinite(result) or abs(result) > 1e30:
        raise Wrong(f"{what}: found {_said(value)}, expected a number")
    return result


def numbers(value: Any, count: int, what: str) -> list[float]:
    """A list of so many finite numbers. Raises :class:`Wrong`."""
    if not isinstance(value, list) or len(value) != count:
        raise Wrong(f"{what}: found {_said(value)}, expected a list of {count} numbers")
    return [number(item, what) for item in value]


def _said(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"
