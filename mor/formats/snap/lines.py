"""Lines of SNAP's files, and the words on them.

Source: the help of SNAP, *Station coordinate file format*, *Observation file format*, *The #data command*.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines


class Line(NamedTuple):
    """Words of a line, continued ones put together, and its number; no words where it is empty."""

    words: list[str]
    number: int


def lines_of(path: Path, draft: Draft) -> list[Line]:
    """Lines without comments (!), with those that ``&`` continues in one. Raises :class:`InputError`."""
    if not path.is_file():
        raise InputError([Problem("this file does not exist", str(path))])
    result: list[Line] = []
    words: list[str] = []
    first = 0
    for line, text in enumerate(read_lines(path, draft), start=1):
        given, comment = _without_comment(text).split(), "!" in text
        if comment and not given and not words:
            continue
        first = first or line
        words += given
        if words and words[-1] == "&":
            words.pop()
            continue
        result.append(Line(words, first))
        words, first = [], 0
    return [*result, Line(words, first)] if words else result


def _without_comment(text: str) -> str:
    """A comment begins with an exclamation mark at the beginning of a word."""
    for k, letter in enumerate(text):
        if letter == "!" and (k == 0 or text[k - 1].isspace()):
            return text[:k]
    return text


class Words:
    """Words of a line, taken one after the other."""

    def __init__(self, words: list[str]) -> None:
        self._words, self._at = words, 0

    def __bool__(self) -> bool:
        return self._at < len(self._words)

    def peek(self) -> str:
        """The next word; nothing at the end."""
        return self._words[self._at] if self else ""

    def take(self, what: str) -> str:
        """The next word. Raises ``ValueError`` at the end of the line."""
        if not self:
            raise ValueError(f"the line ends where {what} is expected")
        self._at += 1
        return self._words[self._at - 1]

    def number(self, what: str) -> float:
        """The next word as a number. Raises ``ValueError``."""
        return number(self.take(what))

    def skip(self, word: str) -> bool:
        """Pass over a word where it is the next one; True if it was."""
        if self.peek().lower() != word:
            return False
        self._at += 1
        return True


def angle(words: Words, form: str, hemispheres: str = "") -> float:
    """Degrees of an angle in the form ``dms``, ``hp`` (d.mmss) or ``deg``; of a place with its hemisphere.

    ``hemispheres`` are the letters of the positive and the negative one; plain degrees may go without. Raises
    ``ValueError``.
    """
    text = words.take("an angle")
    negative, value = text.startswith("-"), abs(number(text))
    if form == "dms":
        value = _sexagesimal(value, words.number("minutes of an angle"), words.number("seconds of an angle"))
    elif form == "hp":
        whole, _, rest = text.lstrip("+-").partition(".")
        rest = rest.ljust(4, "0")
        seconds = float(f"{rest[2:4]}.{rest[4:] or '0'}")
        value = _sexagesimal(float(whole or 0), float(rest[:2]), seconds)
    if hemispheres and words.peek().upper() in tuple(hemispheres):
        if negative:
            raise ValueError(f"found {text!r} with a hemisphere, expected no sign before it")
        negative = words.take("a hemisphere").upper() == hemispheres[1]
    elif hemispheres and form != "deg":
        raise ValueError(f"found {words.peek()!r}, expected {hemispheres[0]} or {hemispheres[1]}")
    return -value if negative else value


def _sexagesimal(degrees: float, minutes: float, seconds: float) -> float:
    if not (0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0) or degrees != int(degrees):
        raise ValueError(
            f"found the angle {degrees:g} {minutes:g} {seconds:g}, expected degrees, minutes, seconds"
        )
    return degrees + minutes / 60.0 + seconds / 3600.0
