"""Where the rows of a table come from: the project file, CSV or Parquet, with declared or headed columns."""

from __future__ import annotations

import gzip
import zlib

import numpy as np
import polars as pl

from mor.errors import Problem, nearest
from mor.project.file.model import Table
from mor.project.tables.columns import Column, Place, Source
from mor.project.tables.texts import from_text, our_name, wrong_length


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
    """Rows of a file beside the project; ``None`` where ``problems`` were added instead."""
    path = place.folder / str(table.file)
    if not path.is_file():
        near = nearest(path.name, [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else [])
        problems.append(place.problem(f"file {table.file!r} does not exist{near}", "file"))
        return None
    try:
        if path.suffix == ".parquet":
            return _from_parquet(pl.read_parquet(path), table, str(path))
        text = path.read_bytes()
        if path.suffix == ".gz":
            text = gzip.decompress(text)
    except (OSError, EOFError, zlib.error, pl.exceptions.PolarsError) as error:
        problems.append(Problem(f"this file cannot be read: {str(error).splitlines()[0]}", str(path)))
        return None
    return from_text(text, table, known, str(path), problems)


def _from_parquet(frame: pl.DataFrame, table: Table, file: str) -> Source:
    """Columns of a Parquet file: texts and numbers as they are; a row counts as a line, from 1."""
    columns = {}
    for name in frame.columns:
        ours = our_name(table, name)
        if ours is not None:
            columns[ours] = frame[name]
    return Source(list(columns), columns, np.arange(1, frame.height + 1, dtype=np.int32), file)
