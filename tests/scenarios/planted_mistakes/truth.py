"""What was planted, and when a hypothesis names it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np


class NotHereError(Exception):
    """This mistake cannot be made in this project."""


class Planted(NamedTuple):
    """A mistake."""

    causes: tuple[str, ...]
    """Causes that say it, equivalent to the observations: the pixel size and the camera constant, say."""
    things: set[str]
    """Names that have to be among those of the hypothesis."""

    def is_named_by(self, hypothesis: dict[str, Any]) -> bool:
        """True where a hypothesis of ``results.json`` says this mistake."""
        return hypothesis["cause"] in self.causes and self.things <= set(hypothesis["things"])


def one_of(random: np.random.Generator, choices: Sequence[Any]) -> Any:
    """One of them; :class:`NotHereError` where there are none."""
    if not choices:
        raise NotHereError
    return choices[int(random.integers(len(choices)))]
