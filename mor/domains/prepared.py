"""Domains that are ready to be adjusted: planned, with numbers for what several of them have."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.adjustment.domains.adjust import Sizes
from mor.adjustment.domains.domain import Key
from mor.adjustment.domains.tree import Boundaries, Engine
from mor.domains.preparing import Begun, Divided, Head, number_outer, prepare
from mor.errors import NoStartValuesError, mistakes_in
from mor.errors import Problem as Mistake
from mor.project.domains.parts import Parts
from mor.project.file.model import Project
from mor.project.file.nodes import Document


class Prepared(NamedTuple):
    """Domains that are ready to be adjusted."""

    project: Project
    parts: Parts
    heads: tuple[Head, ...]
    boundaries: Boundaries
    sizes: Sizes
    document: Document
    source: Path
    """Folder of the project."""
    keys: tuple[Key, ...]
    """Names of the outer unknowns by their numbers."""

    @property
    def notes(self) -> tuple[Mistake, ...]:
        """What was assumed on reading."""
        return (*(note for head in self.heads for note in head.notes), *self.parts.notes)

    @property
    def largest_boundary(self) -> int:
        """Most outer unknowns of a domain."""
        return max(len(numbers) for numbers in self.boundaries.numbers)


def prepared(engine: Engine, found: Divided, done: Callable[[int], None] = lambda domains: None) -> Prepared:
    """Read and plan all domains, and number what several of them have; their tables are gone then.

    ``done`` hears how many more are read. Raises :class:`NoStartValuesError` where points cannot be intersected.
    """
    engine.store.save("divided", found)
    ground = found.parts.ground
    divided = [d for d in range(found.parts.count) if d != ground]
    begun: list[Begun] = []
    for task in [engine.submit(prepare, d) for d in divided]:
        begun.append(engine.result(task))
        done(1)
    _check_started(begun, found.document.file)
    if ground >= 0:
        places = {name: place for one in begun for name, place in one.found.items()}
        begun.append(engine.result(engine.submit(prepare, ground, places)))
        _check_started(begun, found.document.file)
    heads = [one.head for one in begun if one.head is not None]
    shutil.rmtree(found.parts.folder)
    return numbered(engine, found, heads)


def _check_started(begun: Sequence[Begun], file: str) -> None:
    """Raise :class:`NoStartValuesError` with all points that have no start values."""
    missing = [thing for one in begun for thing in one.missing]
    if missing:
        words = "domains leave nothing out, and put no point at infinity: that is done on one machine"
        with mistakes_in(file):
            raise NoStartValuesError(missing, (), (words,))


def numbered(engine: Engine, found: Divided, heads: Sequence[Head]) -> Prepared:
    """Planned domains with numbers for what several of them have."""
    number_of: dict[Key, int] = {}
    numbers = tuple(
        np.array([number_of.setdefault(key, len(number_of)) for key in head.keys], dtype=np.int64)
        for head in heads
    )
    boundaries = Boundaries(found.parts.tree, numbers, len(number_of))
    tasks = [engine.submit(number_outer, d, numbers[d], first) for d, first in enumerate(boundaries.firsts())]
    for task in tasks:
        engine.result(task)
    unknowns = sum(head.inner for head in heads) + len(number_of)
    sizes = Sizes(sum(head.observations for head in heads), unknowns)
    return Prepared(
        found.project,
        found.parts,
        tuple(heads),
        boundaries,
        sizes,
        found.document,
        found.source,
        tuple(number_of),
    )
