"""The terms of reports: found by any of their names, or nearest to what was asked."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import yaml

from mor.errors import InputError, Problem, nearest

_UNIT = re.compile(r" \[[^\]]*\]$")


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
        Term(
            tuple(entry["names"]),
            entry["de"],
            said[entry["names"][0]]["text"],
            said[entry["names"][0]].get("do", ""),
        )
        for entry in entries
    )


def find(wanted: str, language: str = "en") -> list[Term]:
    """Terms of that name, upper or lower case, English or German, with or without a unit in brackets.

    Raises :class:`InputError` for an unknown one, with the nearest known name.
    """
    everything = terms(language)
    wanted = _UNIT.sub("", wanted)
    for key in (str, str.lower):
        found = [t for t in everything if key(wanted) in {key(n) for n in (*t.names, t.german)}]
        if found:
            return found
    part = wanted.lower()
    found = [t for t in everything if len(part) > 3 and any(part in n.lower() for n in (*t.names, t.german))]
    if found:
        return found
    known = [name for term in everything for name in (*term.names, term.german)]
    words = f"unknown term {wanted!r}{nearest(wanted, known)}; mor explain lists them all"
    raise InputError([Problem(words)])


def _read(name: str) -> Any:
    return yaml.safe_load(files("mor.report.words").joinpath(name).read_text(encoding="utf-8"))
