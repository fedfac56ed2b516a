"""Languages of reports and messages: catalogues, terms."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from string import Formatter
from typing import Any, NamedTuple

import yaml

from mor.errors import InputError, Message, Placeholder, nearest

# ---- Sentences with values in them, said in another language: mistakes, notes, reasons, help.
#
# What is wrong is found far below the reports, by code that knows no language and says it in English, values and all.
# The catalogue has the sentence as it stands in the source, with places for the values:
#
#     "unknown camera {}{} (known: {})": "unbekannte Kamera {}{} (bekannt: {})"
#
# A finished sentence is recognised by its fixed words, its values are taken out of it and put into that of
# the other language. Values that are clauses of their own (a suggestion, a counted thing) are recognised in
# turn. Names in quotes stay as they are, and so do the values of places that the other language marks with
# ``{:n}``: names of columns, keys and formats. A single word only changes where it marks its place with
# ``{:w}``.


class _TemplatePart(NamedTuple):
    """Fixed words, and the place for a value behind them (``None``: none)."""

    fixed: str
    place: str | None
    words: str = ""


def parts(template: str) -> list[_TemplatePart]:
    """A template taken apart; places without a name are counted: {} {} is {0} {1}. Raises ``ValueError``."""
    found, count = [], 0
    for fixed, name, words, way in Formatter().parse(template):
        if name == "":
            name, count = str(count), count + 1
        found.append(_TemplatePart(fixed, name if name is None or not way else f"{name}!{way}", words or ""))
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
        return sum(len(re.findall(r"[^\W\d_]", text)) for text in self.fixed)

    @cached_property
    def _places(self) -> list[str]:
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
    # A name in quotes, whatever is in it, or as little as can be.
    value = r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|.*?"""
    return rf"\S+ (?:{re.escape(one)}|{re.escape(many)})" if bar else value


class Sentences:
    """All sentences of a language."""

    def __init__(self, catalogue: Mapping[str, str]):
        self.catalogue = catalogue
        with_places = (Sentence(*entry) for entry in catalogue.items() if "{" in entry[0])
        self._sentences = sorted(with_places, key=lambda one: (-one.letters, -sum(map(len, one.fixed))))

    def say(self, text: str) -> str:
        """The text in the other language; as it is where nothing is known of it."""
        # Clauses within clauses.
        return self._said(text, 6)

    def candidates(self, text: str) -> Iterator[tuple[Sentence, dict[str, str]]]:
        """The sentences that a text may be, with its values, the likeliest first."""
        for sentence in self._sentences:
            values = sentence.values(text)
            if values is not None:
                yield sentence, values

    def _said(self, text: str, depth: int) -> str:
        if text in self.catalogue and "{" not in text:
            return self.catalogue[text]
        for sentence, values in self.candidates(text) if depth else ():
            said = self._filled(sentence, values, depth - 1)
            # Letters of *and*, *or*, *of*, which alone are no sentence.
            if sentence.letters > 3 or (said != text and self._all_known(sentence, values, depth - 1)):
                return said
        return text

    def _all_known(self, sentence: Sentence, values: Mapping[str, str], depth: int) -> bool:
        """True if both sides of an *and*, *or*, *of* are known or single words; a colon needs one of them only."""
        clauses = [value for value in values.values() if " " in value and value[0] not in "'\""]
        return not sentence.letters or all(self._said(value, depth) != value for value in clauses)

    def _filled(self, sentence: Sentence, values: Mapping[str, str], depth: int) -> str:
        written = []
        # Marks a place whose single word is looked up, too: {:w}.
        word = "w"
        for part in parts(sentence.other):
            written.append(part.fixed)
            if part.place is None:
                continue
            value = values[part.place]
            # Marks a place whose value stays as it is: {:n}.
            if part.words == "n":
                written.append(value)
            elif "|" in part.words:
                written.append(format(Placeholder(value.split(" ", 1)[0]), part.words))
            elif part.words == word or " " in value:
                written.append(self._said(value, depth))
            else:
                written.append(value)
        return "".join(written)


# ---- The language of a text report: its sentences and headings, and how it writes numbers.
#
# The English text is the key; a catalogue has the other language's. What a catalogue lacks stays English.

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
        said = {key: Placeholder(value if key in _NAMES else self.number(str(value))) for key, value in values.items()}
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


def words_of(language: str, of: str = "report") -> Words:
    """Words of a kind of text (report, page, planning, …) in a language, ``en`` or ``de``; ``KeyError`` for others.

    Numbers of the page are the same in every language.
    """
    if language == "en":
        return ENGLISH
    decimal = {"de": ","}[language]
    return Words(language, _catalogue(language, of), "." if of == "page" else decimal)


@cache
def sentences_of(language: str) -> Sentences:
    """All that is told in a language other than English: what is recognised in finished sentences."""
    return Sentences(_catalogue(language, "messages"))


@cache
def _catalogue(language: str, of: str) -> dict[str, str]:
    catalogue: dict[str, str] = {}
    # Catalogues of each kind of text besides those of the report; a short term may mean something else in another.
    catalogues = {
        "report": (),
        "orientation": ("orientation",),
        "start values": ("orientation", "start_values"),
        "planning": ("planning",),
        "page": ("page",),
        "messages": ("orientation", "start_values", "planning", "page", "messages", "formats", "help"),
    }
    for name in ("", "_sentences", *(f"_{name}" for name in catalogues[of])):
        text = files("mor.report").joinpath("words", f"{language}{name}.yaml").read_text(encoding="utf-8")
        catalogue |= yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return catalogue


# ---- The name of a datum in the language of a report.


def datum_name(name: str, words: Words) -> str:
    """A datum as a network calls it (``fixed``, ``free, inner constraints over …``, ``minimal, …``), in other words."""
    kind, _, rest = name.partition(", ")
    carried = rest.removeprefix("inner constraints over ")
    carried_by = re.compile(r"(.+?) of (\d+) (?:named point or group|named points or groups)(?: and |$)")
    if kind == "free" and (found := carried_by.findall(carried)):
        said = [
            words(
                "{components} of {count:named point or group|named points or groups}",
                components=components,
                count=count,
            )
            for components, count in found
        ]
        return words("free, inner constraints over {parts}", parts=f" {words('and')} ".join(said))
    held_axes = re.compile(r"(?:^|, )([xyz]{1,3}) of ")
    if kind == "minimal":
        pieces = held_axes.split(rest)[1:]
        said = [
            words("{components} of {names}", components=components, names=names)
            for components, names in zip(pieces[::2], pieces[1::2], strict=True)
        ]
        return words("minimal, {parts}", parts=", ".join(said))
    return words.listed(name)


# ---- The terms of reports: found by any of their names, or nearest to what was asked.


class Term(NamedTuple):
    """A term: its names (the first is its title), the German one, what it means, what to do."""

    names: tuple[str, ...]
    german: str
    text: str
    advice: str


@cache
def terms(language: str = "en") -> tuple[Term, ...]:
    """All terms, in the order of the file, explained in a language (en, de)."""
    entries = _read("terms.yaml")
    said = {entry["names"][0]: entry for entry in entries} if language == "en" else _read("de_terms.yaml")
    return tuple(
        Term(tuple(entry["names"]), entry["de"], said[entry["names"][0]]["text"], said[entry["names"][0]].get("do", ""))
        for entry in entries
    )


def find(wanted: str, language: str = "en") -> list[Term]:
    """Terms of that name, upper or lower case, English or German, with or without a unit in brackets.

    Raises :class:`InputError` for an unknown one, with the nearest known name.
    """
    everything = terms(language)
    wanted = re.sub(r" \[[^\]]*\]$", "", wanted)
    for key in (str, str.lower):
        found = [t for t in everything if key(wanted) in {key(n) for n in (*t.names, t.german)}]
        if found:
            return found
    part = wanted.lower()
    found = [t for t in everything if len(part) > 3 and any(part in n.lower() for n in (*t.names, t.german))]
    if found:
        return found
    known = [name for term in everything for name in (*term.names, term.german)]
    raise InputError([Message(f"unknown term {wanted!r}{nearest(wanted, known)}; mor explain lists them all")])


def _read(name: str) -> Any:
    return yaml.safe_load(files("mor.report").joinpath("words", name).read_text(encoding="utf-8"))
