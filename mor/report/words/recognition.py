"""Sentences with values in them, said in another language: mistakes, notes, reasons, help.

What is wrong is found far below the reports, by code that knows no language and says it in English, values and all.
The catalogue has the sentence as it stands in the source, with places for the values:

    "unknown camera {}{} (known: {})": "unbekannte Kamera {}{} (bekannt: {})"

A finished sentence is recognised by its fixed words, its values are taken out of it and put into that of the other
language. Values that are clauses of their own (a suggestion, a counted thing) are recognised in turn. Names in
quotes stay as they are, and so do the values of places that the other language marks with ``{:n}``: names of columns,
keys and formats. A single word only changes where it marks its place with ``{:w}``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import NamedTuple

from mor.counting import Place

_LETTER = re.compile(r"[^\W\d_]")
_VALUE = r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|.*?"""
"""A name in quotes, whatever is in it, or as little as can be."""
WORD = "w"
"""Marks a place whose single word is looked up, too: {:w}."""
NAMES = "n"
"""Marks a place whose value stays as it is: {:n}."""
_CONJUNCTION = 3
"""Letters of *and*, *or*, *of*, which alone are no sentence."""
_DEEPEST = 6
"""Clauses within clauses."""


class _Part(NamedTuple):
    """Fixed words, and the place for a value behind them (``None``: none)."""

    fixed: str
    place: str | None
    words: str = ""


def parts(template: str) -> list[_Part]:
    """A template taken apart; places without a name are counted: {} {} is {0} {1}. Raises ``ValueError``."""
    found, count = [], 0
    for fixed, name, words, way in Formatter().parse(template):
        if name == "":
            name, count = str(count), count + 1
        found.append(_Part(fixed, name if name is None or not way else f"{name}!{way}", words or ""))
    return found


@dataclass(frozen=True)
class Sentence:
    """A sentence of the catalogue, in both languages."""

    english: str
    other: str

    @cached_property
    def fixed(self) -> list[str]:
        """Fixed parts of this sentence, longest first."""
        return sorted((part.fixed for part in parts(self.english) if part.fixed), key=len, reverse=True)

    @cached_property
    def letters(self) -> int:
        """Fixed letters: of two sentences that fit, the one that says more is meant."""
        return sum(len(_LETTER.findall(text)) for text in self.fixed)

    @cached_property
    def _places(self) -> list[str]:
        """Places of the English sentence, each once."""
        return list(dict.fromkeys(part.place for part in parts(self.english) if part.place is not None))

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        seen: set[str] = set()
        written = []
        for part in parts(self.english):
            written.append(re.escape(part.fixed))
            if part.place is None:
                continue
            known = part.place in seen
            written.append(f"\\{self._places.index(part.place) + 1}" if known else f"({_shape(part.words)})")
            seen.add(part.place)
        return re.compile("".join(written), re.DOTALL)

    def values(self, text: str) -> dict[str, str] | None:
        """Values that make the English sentence this text; ``None`` if it is another one."""
        if not all(words in text for words in self.fixed):
            return None
        match = self._pattern.fullmatch(text)
        return match and dict(zip(self._places, match.groups(), strict=True))


def _shape(words: str) -> str:
    """Pattern of a placeholder: a number before one of two nouns, a quoted name, or any text."""
    one, bar, many = words.partition("|")
    return rf"\S+ (?:{re.escape(one)}|{re.escape(many)})" if bar else _VALUE


class Sentences:
    """All sentences of a language."""

    def __init__(self, catalogue: Mapping[str, str]):
        self.catalogue = catalogue
        with_places = (Sentence(*entry) for entry in catalogue.items() if "{" in entry[0])
        self._sentences = sorted(with_places, key=lambda one: (-one.letters, -sum(map(len, one.fixed))))

    def say(self, text: str) -> str:
        """The text in the other language; as it is where nothing is known of it."""
        return self._said(text, _DEEPEST)

    def recognised(self, text: str) -> Sentence | None:
        """The sentence that a text with values is taken for."""
        return next((sentence for sentence, _ in self._candidates(text)), None)

    def _candidates(self, text: str) -> Iterator[tuple[Sentence, dict[str, str]]]:
        for sentence in self._sentences:
            values = sentence.values(text)
            if values is not None:
                yield sentence, values

    def _said(self, text: str, depth: int) -> str:
        if text in self.catalogue and "{" not in text:
            return self.catalogue[text]
        for sentence, values in self._candidates(text) if depth else ():
            said = self._filled(sentence, values, depth - 1)
            if sentence.letters > _CONJUNCTION or (
                said != text and self._all_known(sentence, values, depth - 1)
            ):
                return said
        return text

    def _all_known(self, sentence: Sentence, values: Mapping[str, str], depth: int) -> bool:
        """Whether both sides of an *and*, *or*, *of* are known or single words; a colon needs one of them only."""
        clauses = [value for value in values.values() if " " in value and value[0] not in "'\""]
        return not sentence.letters or all(self._said(value, depth) != value for value in clauses)

    def _filled(self, sentence: Sentence, values: Mapping[str, str], depth: int) -> str:
        written = []
        for part in parts(sentence.other):
            written.append(part.fixed)
            if part.place is None:
                continue
            value = values[part.place]
            if part.words == NAMES:
                written.append(value)
            elif "|" in part.words:
                written.append(format(Place(value.split(" ", 1)[0]), part.words))
            elif part.words == WORD or " " in value:
                written.append(self._said(value, depth))
            else:
                written.append(value)
        return "".join(written)
