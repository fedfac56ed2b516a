"""Where the rows of a table come from: the project file, CSV or Parquet, with declared or headed columns.

The fast way reads typed columns in one go. Only where that fails are the rows read again one by one, to say in which
line what is wrong, or to understand numbers that carry a unit.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from mor.errors import Problem, nearest
from mor.geometry.arrays import FloatArray, IntArray
from mor.project.columns import Column, Place
from mor.project.model import Table

_COMMENT = re.compile(r"(^|\s)#.*$")
"""A comment begins at a # that stands first or after a space: point A#1 is a point."""


@dataclass(frozen=True)
class Source:
    """Named columns, each all texts or already numbers in the unit of the column."""

    names: list[str]
    columns: dict[str, list[str | None] | FloatArray]
    lines: IntArray
    file: str


def _wrong_length(found: int, names: Sequence[str | None]) -> str:
    return f"found {found} columns, expected {len(names)} ({', '.join(name or '-' for name in names)})"


def from_rows(table: Table, place: Place, problems: list[Problem]) -> Source:
    """Rows that stand in the project file itself."""
    declared = list(table.columns or [])
    rows = table.rows or []
    file = place.document.file_of(place.path)
    lines = np.array(
        [place.document.line((*place.path, "rows", i)) for i in range(len(rows))], dtype=np.int64
    )
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(declared):
            problems.append(Problem(_wrong_length(len(row), declared), file, int(line)))
    columns: dict[str, list[str | None] | FloatArray] = {
        name: [row[k] if k < len(row) else None for row in rows] for k, name in enumerate(declared) if name
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
            return _from_frame(pl.read_parquet(path), table, known, str(path), 1)
        text = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    except (OSError, EOFError, zlib.error, pl.exceptions.PolarsError) as error:
        problems.append(Problem(f"this file cannot be read: {str(error).splitlines()[0]}", str(path)))
        return None
    try:
        frame = _fast(text, table, known)
    except (pl.exceptions.PolarsError, UnicodeDecodeError, ValueError):
        return _slow(text, str(path), table, problems)
    if frame.height == 0:
        problems.append(Problem("the table is empty", str(path)))
        return None
    return _from_frame(frame, table, known, str(path), 1 if isinstance(table.columns, list) else 2)


def _our_name(table: Table, name: str) -> str | None:
    return table.columns.get(name, name) if isinstance(table.columns, dict) else name


def _fast(text: bytes, table: Table, known: dict[str, Column]) -> pl.DataFrame:
    """Typed columns in one go. Raises where the file is not perfectly regular."""
    if b"#" in text or b"\n\n" in text or b"\r\n\r\n" in text:
        raise ValueError("comments or empty lines: line numbers must be counted")
    declared = isinstance(table.columns, list)
    separator = table.delimiter or ","
    first = text.split(b"\n", 1)[0].decode("utf-8-sig").strip("\r")
    header = (
        [name or f"skip {k}" for k, name in enumerate(table.columns or [])]
        if declared
        else next(csv.reader([first], delimiter=separator), [])
    )
    lines = text.count(b"\n") + (not text.endswith(b"\n"))
    if text.count(separator.encode()) != lines * (len(header) - 1):
        raise ValueError("rows of different length, or separators in quotes")
    kinds: dict[str, type[pl.DataType]] = {}
    for name in header:
        column = known.get(_our_name(table, name) or "")
        kinds[name] = pl.Float64 if column is not None and column.factor is not None else pl.String
    return pl.read_csv(
        io.BytesIO(text),
        has_header=not declared,
        new_columns=None if not declared else header,
        schema=kinds,
        separator=separator,
    )


def _from_frame(
    frame: pl.DataFrame, table: Table, known: dict[str, Column], file: str, first_line: int
) -> Source:
    names, columns = [], {}
    for name in frame.columns:
        ours = _our_name(table, name)
        if ours is None or (isinstance(table.columns, list) and name.startswith("skip ")):
            continue
        series = frame[name]
        column = known.get(ours)
        numeric = column is not None and column.factor is not None and series.dtype.is_numeric()
        names.append(ours)
        columns[ours] = (
            series.cast(pl.Float64).fill_null(float("nan")).to_numpy()
            if numeric
            else series.cast(pl.String).to_list()
        )
    _mark_not_a_number(frame, table, columns)
    return Source(names, columns, np.arange(frame.height, dtype=np.int64) + first_line, file)


def _mark_not_a_number(
    frame: pl.DataFrame, table: Table, columns: dict[str, list[str | None] | FloatArray]
) -> None:
    """Turn columns in which somebody wrote NaN or inf back to texts: they are mistakes, an empty cell is not."""
    for name in frame.columns:
        series = frame[name]
        ours = _our_name(table, name)
        if ours in columns and series.dtype.is_float() and (series.is_nan() | series.is_infinite()).any():
            columns[ours] = [None if x is None else repr(x) for x in series.to_list()]


def _slow(text: bytes, file: str, table: Table, problems: list[Problem]) -> Source | None:
    """Row by row, with the line of every row."""
    try:
        content = text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = text[: error.start].count(b"\n") + 1
        problems.append(Problem("this is not UTF-8 text", file, line))
        return None
    delimiter = table.delimiter or ","
    rows, lines = [], []
    for number, whole in enumerate(content.splitlines(), start=1):
        bare = _COMMENT.sub("", whole)
        if not bare.strip():
            continue
        cells = bare.split() if delimiter == " " else next(csv.reader([bare], delimiter=delimiter))
        rows.append([cell.strip() for cell in cells])
        lines.append(number)
    if isinstance(table.columns, list):
        names: list[str | None] = list(table.columns)
    elif rows:
        names = [_our_name(table, name) for name in rows.pop(0)]
        lines.pop(0)
    else:
        names = []
    if not rows:
        problems.append(Problem("the table is empty", file))
        return None
    for row, line_number in zip(rows, lines, strict=True):
        if len(row) != len(names):
            problems.append(Problem(_wrong_length(len(row), names), file, line_number))
    columns: dict[str, list[str | None] | FloatArray] = {
        name: [(row[k] or None) if k < len(row) else None for row in rows]
        for k, name in enumerate(names)
        if name
    }
    return Source([name for name in names if name], columns, np.array(lines, dtype=np.int64), file)
