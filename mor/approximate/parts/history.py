"""What a part was when it joined another one: what was in it, what it knew of its place, and what tied the two."""

from __future__ import annotations

from typing import NamedTuple

from mor.approximate.parts.rule import Rule
from mor.arrays import IntArray


class Tie(NamedTuple):
    """The movement that carried a part into another one."""

    open: int
    """Movements that nothing determined; they stayed as they were."""
    redundancy: int
    misfit: float
    """Root mean square of the residuals, in parts of the size of what the two had in common."""
    alternatives: int
    """Other movements that fitted as well."""


class Join(NamedTuple):
    """A part, as it was when it became a part of another one."""

    number: int
    began: Rule
    into: int
    """Number of the part it joined; 0 is the object system."""
    points: IntArray
    """Blocks of the points it knew in any coordinate."""
    frames: tuple[int, ...]
    sights: tuple[int, ...]
    levelled: bool
    oriented: bool
    scaled: bool
    tie: Tie | None
    """``None`` where nothing tied the two: it stayed where it was."""
