"""Which epoch an observation, an image or a station belongs to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import IntArray
from mor.errors import Problem
from mor.observations import Reference
from mor.observations.names import Names
from mor.project.motion.model import Motion
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Column, Rows

EPOCH = Column("epoch")
NONE = -1
"""Epoch of a row, an image or a station that has none."""


def epochs_of_rows(reading: Reading, rows: Rows) -> IntArray:
    """(n,) number of the epoch that each row of a table gives; −1 where it gives none. Each mistake is told once."""
    if "epoch" not in rows.texts:
        return np.full(rows.count, NONE, dtype=np.int64)
    names = rows.names("epoch")
    numbers = np.full(len(names.known), NONE, dtype=np.int64)
    for k, text in enumerate(names.known):
        if not text:
            continue
        try:
            numbers[k] = reading.motion.epoch(text)
        except ValueError as error:
            row = int(np.argmax(names.numbers == k))
            reading.problems.append(Problem(f"epoch: {error}", rows.file, int(rows.lines[row])))
    return numbers[names.numbers]


def remember_epochs(reading: Reading, space: str, names: list[str], rows: Rows) -> None:
    """Keep the epochs of images or stations for the observations that refer to them."""
    epochs = epochs_of_rows(reading, rows)
    known = reading.motion.epoch_of.setdefault(space, {})
    known |= {name: epoch for name, epoch in zip(names, epochs.tolist(), strict=True) if epoch != NONE}


def row_epochs(
    reading: Reading, rows: Rows, references: tuple[Reference, ...], names: tuple[Names, ...]
) -> IntArray:
    """(n,) epoch of every row: its own, or that of its image or station; −1 where nothing says any.

    Where two of them differ, that is a mistake, which is told.
    """
    epochs = epochs_of_rows(reading, rows)
    if not any(reading.motion.epoch_of.values()):
        return epochs
    for reference, named in zip(references, names, strict=True):
        of_name = np.array([_epoch_of(reading, reference, name) for name in named.known], dtype=np.int64)
        found = of_name[named.numbers] if len(of_name) else epochs
        differ = (found != NONE) & (epochs != NONE) & (found != epochs)
        tell_rows(reading.problems, differ, rows, _Differing(reading.motion, named, found, epochs).words)
        epochs = np.where(epochs == NONE, found, epochs)
    return epochs


class _Differing(NamedTuple):
    """Rows that give another epoch than their image or station has."""

    motion: Motion
    names: Names
    found: IntArray
    given: IntArray

    def words(self, row: int) -> str:
        """What is wrong with a row."""
        own, other = (self.motion.labels[int(epochs[row])] for epochs in (self.found, self.given))
        return f"{self.names[row]} is of epoch {own}, this row of {other}"


def _epoch_of(reading: Reading, reference: Reference, name: str) -> int:
    for space in reference.among:
        bare = name.removeprefix(f"{space}:").removeprefix("centre:" if space == "image" else "\0")
        if space in reading.motion.epoch_of and bare in reading.motion.epoch_of[space]:
            return reading.motion.epoch_of[space][bare]
        things = reading.shop.things.get(space)
        if things is not None and bare in things.numbers:
            return NONE
    return NONE
