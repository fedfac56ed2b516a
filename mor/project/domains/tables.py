"""Tables of a project as they lie: columns by the names the program knows, a part of the rows at a time.

Parquet is read a part at a time; a CSV file is read as a whole, for where its rows begin nobody knows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import polars as pl

from mor.arrays import SmallIntArray
from mor.errors import InputError, Problem
from mor.input_files import check_regular, note_file
from mor.project.file.table import Table
from mor.project.tables.columns import Column, Place
from mor.project.tables.sources import from_file, from_rows
from mor.project.tables.texts import our_name

ROWS_AT_A_TIME = 2_000_000
Rows: TypeAlias = Callable[[str, int], Iterator[pl.DataFrame]]
"""What reads a table, by its section and number, a part at a time."""


def pieces(table: Table, place: Place) -> Iterator[pl.DataFrame]:
    """The rows of a table, in their order. Raises :class:`InputError`."""
    if (
        table.file is not None
        and table.file.endswith(".parquet")
        and place.document.frame(table.file) is None
    ):
        yield from _of_parquet(table, place)
        return
    problems: list[Problem] = []
    known = {name: Column(name) for name in _TEXTS}
    source = (
        from_rows(table, place, problems)
        if table.rows is not None
        else from_file(table, known, place, problems)
    )
    if problems or source is None:
        raise InputError(problems)
    yield _with_values(pl.DataFrame(source.columns), table)


class Lines(NamedTuple):
    """Where the rows of a table stand."""

    file: str
    numbers: SmallIntArray | None
    """(n,) lines; nothing where a row counts as a line, from 1."""

    def of(self, row: int) -> int:
        """Line of a row."""
        return row + 1 if self.numbers is None else int(self.numbers[row])


def lines_of(table: Table, place: Place) -> Lines:
    """File and lines of the rows of a table in a file."""
    path = place.folder / str(table.file)
    if str(table.file).endswith(".parquet") or place.document.frame(str(table.file)) is not None:
        return Lines(str(path), None)
    source = from_file(table, {name: Column(name) for name in _TEXTS}, place, [])
    return Lines(str(path), None if source is None else source.lines)


def hashed(names: pl.Series) -> pl.Series:
    """(n,) numbers that are the same for the same names."""
    return names.hash()


_TEXTS = ("id", "image", "point", "camera")
"""Columns that are names, even where they look like numbers."""


def _of_parquet(table: Table, place: Place) -> Iterator[pl.DataFrame]:
    path = place.folder / str(table.file)
    check_regular(path)
    note_file(path)
    try:
        lazy = pl.scan_parquet(path)
        names = lazy.collect_schema().names()
        count = lazy.select(pl.len()).collect().item()
        ours = {name: our_name(table, name) for name in names}
        chosen = lazy.select(pl.col(name).alias(known) for name, known in ours.items() if known is not None)
        for first in range(0, max(count, 1), ROWS_AT_A_TIME):
            yield _with_values(chosen.slice(first, ROWS_AT_A_TIME).collect(), table)
    except pl.exceptions.PolarsError as error:
        raise InputError(
            [Problem(f"this file cannot be read: {str(error).splitlines()[0]}", str(path))]
        ) from None


def _with_values(frame: pl.DataFrame, table: Table) -> pl.DataFrame:
    """With the names that are the same in every row; names without blanks around them."""
    named = [pl.lit(table.values[name]).alias(name) for name in _TEXTS if name in table.values]
    frame = frame.with_columns(named)
    texts = [name for name in _TEXTS if name in frame.columns]
    return frame.with_columns(pl.col(texts).cast(pl.String).str.strip_chars()) if texts else frame
