"""Plain data as JSON."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any


def to_json(data: dict[str, Any]) -> str:
    """JSON text: same data, same bytes."""
    return _text(data) + "\n"


def _rows(parts: Iterable[Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    empty = True
    for rows in parts:
        for row in rows:
            yield ("[" if empty else ",") + "\n" + textwrap.indent(_text(row), "  ")
            empty = False
    yield "[]" if empty else "\n ]"


def _text(data: Any) -> str:
    return json.dumps(data, ensure_ascii=False, indent=1, allow_nan=False)
