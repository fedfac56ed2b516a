"""Plain data as JSON."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any


def to_json(data: dict[str, Any]) -> str:
    """JSON text: same data, same bytes."""
    return _text(data) + "\n"


def json_in_pieces(
    data: Mapping[str, Any], long: Mapping[str, Iterable[Sequence[Mapping[str, Any]]]]
) -> Iterator[str]:
    """The same text a piece at a time, lists of ``long`` keys from parts of their rows, which are never all there."""
    yield "{"
    for number, (key, value) in enumerate(data.items()):
        yield "," * (number > 0) + f"\n {_text(key)}: "
        if key in long:
            yield from _rows(long[key])
        else:
            yield textwrap.indent(_text(value), " ").lstrip()
    yield "\n}\n"


def _rows(parts: Iterable[Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    empty = True
    for rows in parts:
        for row in rows:
            yield ("[" if empty else ",") + "\n" + textwrap.indent(_text(row), "  ")
            empty = False
    yield "[]" if empty else "\n ]"


def _text(data: Any) -> str:
    return json.dumps(data, ensure_ascii=False, indent=1, allow_nan=False)
