"""Where the rows of a table come from: the project file, CSV or Parquet, with declared or headed columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from mor.errors import InputError, Problem, nearest
from mor.input_files import TABLE, check_regular, check_size, is_folder, limit, note_file, read_bytes
from mor.project.file.table import Table
from mor.project.tables.columns import Column, Place, Source
from mor.project.tables.spreadsheets import is_spreadsheet, read_spreadsheet
from mor.project.tables.texts import COLUMNS, from_text, our_name, too_many_columns, wrong_length

_SMALLEST_CELL = 8
"""Bytes of a number, or of the reference to a text, in memory."""


def from_rows(table: Table, place: Place, problems: list[Problem]) -> Source:
    """Rows that stand in the project file itself."""
    declared = list(table.columns or [])
    rows = table.rows or []
    file = place.document.file_of(place.path)
    lines = np.array(
        [place.document.line((*place.path, "rows", i)) for i in range(len(rows))], dtype=np.int32
    )
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(declared):
            problems.append(Problem(wrong_length(len(row), declared), file, int(line)))
    columns = {
        name: pl.Series(name, [row[k] if k < len(row) else None for row in rows], dtype=pl.String)
        for k, name in enumerate(declared)
        if name
    }
    return Source([name for name in declared if name], columns, lines, file)


def from_file(table: Table, known: dict[str, Column], place: Place, problems: list[Problem]) -> Source | None:
    """Rows of a file beside the project; ``None`` if ``problems`` were added instead."""
    frame = place.document.frame(str(table.file))
    if frame is not None:
        return _from_frame(frame, table, place.document.file_of(place.path))
    path = place.folder / str(table.file)
    try:
        check_regular(path)
    except InputError as error:
        problems += [place.problem(f"file {table.file!r} {_words(error, path)}", "file")]
        return None
    try:
        if path.suffix == ".parquet":
            return _from_frame(_read_parquet(path), table, str(path))
        if is_spreadsheet(path):
            return _from_frame(read_spreadsheet(path, table.sheet), table, str(path))
        return from_text(read_bytes(path), table, known, str(path), problems)
    except InputError as error:
        problems += error.problems
    except pl.exceptions.PolarsError as error:
        problems.append(Problem(f"this file cannot be read: {str(error).splitlines()[0]}", str(path)))
    return None


def _words(error: InputError, path: Path) -> str:
    """What is wrong with a path, after its name, and the nearest file there is."""
    others = [other.name for other in path.parent.iterdir()] if is_folder(path.parent) else []
    near = nearest(path.name, others) if path.name not in others else ""
    said = "; ".join(problem.message for problem in error.problems)
    return said.removeprefix("this file ").removeprefix("this ") + near


def _read_parquet(path: Path) -> pl.DataFrame:
    """A Parquet file, the size of which is known from its description before it is unpacked."""
    lazy = pl.scan_parquet(path)
    columns = len(lazy.collect_schema())
    if columns > limit(COLUMNS):
        raise InputError([Problem(too_many_columns(columns), str(path))])
    rows = lazy.select(pl.len()).collect().item()
    check_size(rows * columns * _SMALLEST_CELL, path, TABLE)
    note_file(path)
    return lazy.collect()


def _from_frame(frame: pl.DataFrame, table: Table, file: str) -> Source:
    """Columns of a Parquet file or a data frame: texts and numbers as they are; a row counts as a line, from 1."""
    columns = {}
    for name in frame.columns:
        ours = our_name(table, name)
        if ours is not None:
            columns[ours] = frame[name]
    return Source(list(columns), columns, np.arange(1, frame.height + 1, dtype=np.int32), file)
