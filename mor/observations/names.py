"""Names of many rows as numbers into a list of the different ones: no Python object for each row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import IntArray, SmallIntArray


@dataclass(frozen=True)
class Names:
    """One name for each of n rows. It reads like a sequence of texts; arrays are what it holds."""

    numbers: SmallIntArray
    """(n,) place of each row's name in ``known``."""
    known: Sequence[str]
    """Names the numbers point into, e.g. all points of a project; shared, never copied."""

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, row: int) -> str:
        name: str = self.known[self.numbers[row]]
        return name

    def __iter__(self) -> Iterator[str]:
        return (self.known[number] for number in self.numbers)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """(n,) texts, as numpy has them: every name takes the room of the longest."""
        used, numbers = np.unique(self.numbers, return_inverse=True)
        texts = np.array([self.known[number] for number in used], dtype=dtype or str)
        return texts[numbers]

    def take(self, rows: IntArray | slice) -> Names:
        """The names of some rows."""
        return Names(self.numbers[rows], self.known)

    def texts(self) -> pl.Series:
        """(n,) texts as a column of a table."""
        return self.column().texts()

    def column(self) -> Coded:
        """The same as places in a column of names: of all that are known, or of those that are used by few rows."""
        if len(self.known) <= _MANY * len(self.numbers):
            return Coded(_column_of(self.known), self.numbers)
        used, numbers = np.unique(self.numbers, return_inverse=True)
        return Coded(pl.Series([self.known[number] for number in used], dtype=pl.String), numbers)


class Coded(NamedTuple):
    """Texts (n,) as numbers into a column of different ones."""

    known: pl.Series
    numbers: IntArray | SmallIntArray

    def texts(self) -> pl.Series:
        """(n,) as a column."""
        return self.known.gather(self.numbers)

    def expression(self, rows: IntArray) -> pl.Expr:
        """Some rows of it, for a table of as many."""
        return pl.lit(self.known).gather(pl.lit(pl.Series(self.numbers[rows])))


_MANY = 50
"""Names for each row from which on the others are not made texts of."""
_KEPT = 4
_columns: list[tuple[Sequence[str], pl.Series]] = []
"""The lists of names asked for last, as columns: a long table is made in many pieces of the same names."""


def _column_of(known: Sequence[str]) -> pl.Series:
    for own, column in _columns:
        if own is known:
            return column
    column = pl.Series(known, dtype=pl.String)
    _columns[:] = [(known, column), *_columns[: _KEPT - 1]]
    return column


def names_of(texts: Sequence[str]) -> Names:
    """Names of rows as they stand in a short list."""
    return Names(np.arange(len(texts), dtype=np.int32), tuple(texts))


def one_name(text: str, count: int) -> Names:
    """Return one name for all rows, stored once."""
    return Names(np.broadcast_to(np.zeros(1, dtype=np.int32), (count,)), (text,))


def coded(texts: pl.Series) -> Names:
    """Names of a column of texts: each different one is kept once, in the order in which it comes first."""
    known = texts.unique(maintain_order=True)
    return Names(places(texts, known), tuple(known.to_list()))


def places(texts: pl.Series, known: pl.Series) -> SmallIntArray:
    """(n,) place of every text in a list; −1 where it is not among them, the last one where it is there twice."""
    table = pl.DataFrame({"name": known, "number": np.arange(len(known), dtype=np.int32)})
    if known.n_unique() < len(known):
        table = table.unique("name", keep="last")
    found = pl.DataFrame({"name": texts}).join(table, on="name", how="left", maintain_order="left")
    numbers: SmallIntArray = found["number"].fill_null(-1).to_numpy()
    return numbers


def places_of(names: Names, known: Sequence[str]) -> SmallIntArray:
    """(n,) place of every name in a list that has them all."""
    if names.known is known:
        return names.numbers
    there = places(pl.Series(names.known, dtype=pl.String), pl.Series(known, dtype=pl.String))
    result: SmallIntArray = there[names.numbers]
    return result
