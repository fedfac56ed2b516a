"""The language of a text report: its sentences and headings, and how it writes numbers.

The English text is the key; a catalogue has the other language's. What a catalogue lacks stays English.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import yaml

from mor.counting import Place
from mor.report.words.recognition import Sentences

LANGUAGES = ("en", "de")
_NAMES = frozenset({"id", "point", "place", "names"})
"""Places of a sentence that hold names of the user: 1.5 is a name there, not a number."""
_NUMBER = re.compile(r"^-?\d+\.\d+(e[-+]?\d+)?$")
_UNIT = re.compile(r"^(.*?)( \[[^\]]*\])$")


@dataclass(frozen=True)
class Words:
    """Sentences of one language. ``catalogue`` maps the English ones to its own."""

    language: str
    catalogue: Mapping[str, str] = field(default_factory=dict)
    decimal: str = "."

    def __call__(self, english: str, /, **values: object) -> str:
        """A sentence with its values; texts that are numbers get the decimal sign of the language."""
        said = {
            key: Place(value if key in _NAMES else self.number(str(value))) for key, value in values.items()
        }
        return self.catalogue.get(english, english).format(**said)

    def number(self, text: str) -> str:
        """A number as the language writes it; anything else as it is."""
        return text.replace(".", self.decimal) if _NUMBER.match(text) else text

    def header(self, english: str) -> str:
        """A heading of a column; the unit in brackets stays."""
        match = _UNIT.match(english)
        name, unit = (match[1], match[2]) if match else (english, "")
        return self.catalogue.get(name, name) + unit

    def listed(self, english: str) -> str:
        """One of the words a column may hold (free, gross …), or texts that stay."""
        return self.catalogue.get(english, english)

    def told(self, english: str) -> str:
        """A finished sentence, values and all (a mistake, a note, a reason), as the language says it."""
        if self.language == "en":
            return english
        return self.catalogue.get(english) or sentences_of(self.language).say(english)


ENGLISH = Words("en")


_SENTENCES = ("{language}.yaml", "{language}_sentences.yaml")
_ORIENTATION = (*_SENTENCES, "{language}_orientation.yaml")
_START_VALUES = (*_ORIENTATION, "{language}_start_values.yaml")
_PLANNING = (*_SENTENCES, "{language}_planning.yaml")
_PAGE = (*_SENTENCES, "{language}_page.yaml")
_TOLD = (
    *dict.fromkeys((*_START_VALUES, *_PLANNING, *_PAGE)),
    *(f"{{language}}_{name}.yaml" for name in ("messages", "formats", "help")),
)
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast where PyYAML has its C part
_DECIMALS = {"de": ","}


def words_of(language: str) -> Words:
    """Words of the text report in a language, ``en`` or ``de``. Raises ``KeyError`` for another."""
    return _of_text(language, _SENTENCES)


def words_of_orientation(language: str) -> Words:
    """Words of ``mor orient``, whose short terms are its own. Raises ``KeyError`` for another language."""
    return _of_text(language, _ORIENTATION)


def words_of_start_values(language: str) -> Words:
    """Words of ``mor approximate``. Raises ``KeyError`` for another language."""
    return _of_text(language, _START_VALUES)


def words_of_planning(language: str) -> Words:
    """Words of plans, simulations and batches. Raises ``KeyError`` for another language."""
    return _of_text(language, _PLANNING)


def _of_text(language: str, names: tuple[str, ...]) -> Words:
    return ENGLISH if language == "en" else Words(language, _catalogue(language, names), _DECIMALS[language])


def words_of_page(language: str) -> Words:
    """Words of the page, whose numbers are the same in every language. Raises ``KeyError`` for an unknown one."""
    if language in _DECIMALS:
        return Words(language, _catalogue(language, _PAGE))
    return {"en": ENGLISH}[language]


@cache
def sentences_of(language: str) -> Sentences:
    """All that is told in a language other than English: what is recognised in finished sentences."""
    return Sentences(_catalogue(language, _TOLD))


@cache
def _catalogue(language: str, names: tuple[str, ...]) -> dict[str, str]:
    """Catalogues one after the other; a later one has the last word. Read once in a process."""
    from importlib.resources import files  # English, which has none, does without loading it

    catalogue: dict[str, str] = {}
    for name in names:
        text = files("mor.report.words").joinpath(name.format(language=language)).read_text(encoding="utf-8")
        catalogue |= yaml.load(text, Loader=_LOADER)
    return catalogue
