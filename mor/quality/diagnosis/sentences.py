"""How sentences are said: an English text with places, and what stands there. A report says it in its language."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from mor.counting import Place


class Say(Protocol):
    """Says an English sentence with its values, in the language of the reader."""

    def __call__(self, english: str, /, **values: object) -> str:
        """The sentence."""
        ...


def english(text: str, /, **values: object) -> str:
    """The sentence as it stands."""
    return text.format(**{name: Place(value) for name, value in values.items()})


def enumerated(names: Sequence[str], most: int, say: Say) -> str:
    """The first names, and how many there are more."""
    listed = ", ".join(names[:most])
    return say("{names} and {count} more", names=listed, count=len(names) - most) if names[most:] else listed
