"""How a value was obtained, as a sentence with its names and numbers, which a report may say in another language."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mor.counting import Place


class Rule(NamedTuple):
    """An English sentence with places, and what stands in them: names of things ("image I1") and numbers."""

    words: str
    values: Mapping[str, str | int | float]

    def __str__(self) -> str:
        return self.words.format(**{name: Place(value) for name, value in self.values.items()})


def rule(words: str, /, **values: str | int | float) -> Rule:
    """A rule, its values by the names of their places."""
    return Rule(words, values)
