"""The terms of reports: found by any of their names, or nearest to what was asked."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import yaml

from mor.errors import InputError, Problem, nearest


@dataclass(frozen=True)
class Term:
    """A term: its names (the first is its title), the German one, what it means, what to do."""

    names: tuple[str, ...]
    german: str
    text: str
    advice: str


def terms() -> tuple[Term, ...]:
    """All terms, in the order of the file."""
    data = yaml.safe_load(files("mor.report.words").joinpath("terms.yaml").read_text(encoding="utf-8"))
    return tuple(
        Term(tuple(entry["names"]), entry["de"], entry["text"], entry.get("do", "")) for entry in data
    )


def find(wanted: str) -> list[Term]:
    """Terms of that name, upper or lower case, English or German. Raises :class:`InputError` for an unknown one."""
    everything = terms()
    for key in (str, str.lower):
        found = [t for t in everything if key(wanted) in {key(n) for n in (*t.names, t.german)}]
        if found:
            return found
    found = [t for t in everything if len(wanted) > 3 and wanted.lower() in t.german.lower()]
    if found:
        return found
    known = [name for term in everything for name in (*term.names, term.german)]
    words = f"unknown term {wanted!r}{nearest(wanted, known)}; mor explain lists them all"
    raise InputError([Problem(words)])
