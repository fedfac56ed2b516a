"""Texts of the user as they are shown: what would move the cursor, hide letters or break a line is spelled out."""

from __future__ import annotations

import re

_UNSEEN = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff\ufff9-\ufffb]"
)
"""Control characters but the line feed, marks of the direction of writing, line separators, halves of surrogates."""
LONGEST = 500
"""Letters of a line that a terminal is given."""


def escaped(text: str) -> str:
    """The text with ``\\x1b`` and the like in the place of characters that are no letters; lines stay lines."""
    return _UNSEEN.sub(_spelled, text) if not text.isascii() or not text.isprintable() else text


def shortened(line: str, longest: int = LONGEST) -> str:
    """A line that fits the terminal, or another width; what is left out of its middle is marked."""
    tail = longest // 5
    return line if len(line) <= longest else f"{line[: longest - tail]} … {line[3 - tail :]}"


def _spelled(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
