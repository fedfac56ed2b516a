"""Tables: rows in the project file, or CSV and Parquet files beside it, with declared or headed columns.

The fast way reads typed columns in one go. Only where that fails are the rows read again one by one, to say in which
line what is wrong, or to understand numbers that carry a unit.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from mor.errors import Problem, nearest
from mor.geometry.arrays import FloatArray, IntArray
from mor.project.model import Table
from mor.project.nodes import Document
from mor.project.nodes import Path as NodePath


@dataclass(frozen=True)
class Column:
    """A column a table may have. ``parse`` turns one text into an internal number; ``None`` for identifiers."""

    name: str
    parse: Callable[[str, str], float] | None = None
    factor: Callable[[str], float] | None = None
    """Internal units per given unit, for columns of plain numbers; raises ``ValueError``."""
    required: bool = False


@dataclass(frozen=True)
class Rows:
    """Columns read: identifiers as texts, numbers as floats in internal units, NaN where empty."""

    count: int
    texts: dict[str, list[str]]
    numbers: dict[str, FloatArray]
    lines: IntArray
    file: str

    def text(self, name: str, default: str = "") -> list[str]:
        """Identifiers of a column."""
        return self.texts.get(name, [default] * self.count)

    def number(self, name: str) -> FloatArray:
        """Numbers of a column, NaN where it is missing."""
        return self.numbers.get(name, np.full(self.count, np.nan))


@dataclass(frozen=True)
class Place:
    """Where a table stands in the project: its path in the document, and the folder of the project."""

    document: Document
    path: NodePath
    folder: Path

    def problem(self, message: str, key: str | None = None) -> Problem:
        """A problem at this table, or at one of its keys."""
        path = (*self.path, key) if key else self.path
        return Problem(message, self.document.file_of(path), self.document.line(path))


def read_table(table: Table, columns: Sequence[Column], place: Place, problems: list[Problem]) -> Rows | None:
    """Rows of a table; ``None`` where ``problems`` were added instead."""
    before = len(problems)
    known = {column.name: column for column in columns}
    _check_names(table, known, place, problems)
    source = _inline(table, place) if table.rows is not None else _file(table, known, place, problems)
    if source is None or len(problems) > before:
        return None
    _check_columns(source.names, table, columns, place, problems)
    if len(problems) > before:
        return None
    return _convert(source, table, known, place, problems)


@dataclass(frozen=True)
class _Source:
    """Named columns, each all texts or already numbers in the unit of the column."""

    names: list[str]
    columns: dict[str, list[str | None] | FloatArray]
    lines: IntArray
    file: str


def _check_names(table: Table, known: dict[str, Column], place: Place, problems: list[Problem]) -> None:
    named = list(table.values)
    if isinstance(table.units, dict):
        named += list(table.units)
    if isinstance(table.columns, list):
        named += [name for name in table.columns if name is not None]
    if isinstance(table.columns, dict):
        named += [name for name in table.columns.values() if name is not None]
    for name in dict.fromkeys(named):
        if name not in known:
            words = f"unknown column {name!r}{nearest(name, known)} (known here: {', '.join(known)})"
            problems.append(place.problem(words))


def _check_columns(
    names: list[str], table: Table, columns: Sequence[Column], place: Place, problems: list[Problem]
) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    problems += [place.problem(f"column {name!r} is given twice") for name in twice]
    missing = [c.name for c in columns if c.required and c.name not in names and c.name not in table.values]
    if missing:
        found = ", ".join(names) or "none"
        problems.append(place.problem(f"column {', '.join(map(repr, missing))} is missing (found: {found})"))


def _inline(table: Table, place: Place) -> _Source:
    declared = [name for name in table.columns or []]
    rows = table.rows or []
    lines = np.array(
        [place.document.line((*place.path, "rows", i)) for i in range(len(rows))], dtype=np.int64
    )
    columns: dict[str, list[str | None] | FloatArray] = {
        name: [row[k] if k < len(row) else None for row in rows] for k, name in enumerate(declared) if name
    }
    return _Source([name for name in declared if name], columns, lines, place.document.file_of(place.path))


def _file(table: Table, known: dict[str, Column], place: Place, problems: list[Problem]) -> _Source | None:
    path = place.folder / str(table.file)
    if not path.is_file():
        near = nearest(path.name, [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else [])
        problems.append(place.problem(f"file {table.file!r} does not exist{near}", "file"))
        return None
    if path.suffix == ".parquet":
        return _from_frame(pl.read_parquet(path), table, known, str(table.file), 1)
    text = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    try:
        frame = _fast(text, table, known)
    except (pl.exceptions.PolarsError, UnicodeDecodeError, ValueError):
        return _slow(text, table, place, problems)
    if frame.height == 0:
        problems.append(Problem("the table is empty", str(table.file)))
        return None
    return _from_frame(frame, table, known, str(table.file), 1 if isinstance(table.columns, list) else 2)


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
) -> _Source:
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
    return _Source(names, columns, np.arange(frame.height, dtype=np.int64) + first_line, file)


def _mark_not_a_number(
    frame: pl.DataFrame, table: Table, columns: dict[str, list[str | None] | FloatArray]
) -> None:
    """Turn columns in which somebody wrote NaN or inf back to texts: they are mistakes, an empty cell is not."""
    for name in frame.columns:
        series = frame[name]
        ours = _our_name(table, name)
        if ours in columns and series.dtype.is_float() and (series.is_nan() | series.is_infinite()).any():
            columns[ours] = [None if x is None else repr(x) for x in series.to_list()]


def _slow(text: bytes, table: Table, place: Place, problems: list[Problem]) -> _Source | None:
    """Row by row, with the line of every row."""
    file = str(table.file)
    try:
        content = text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = text[: error.start].count(b"\n") + 1
        problems.append(Problem("this is not UTF-8 text", file, line))
        return None
    delimiter = table.delimiter or ","
    rows, lines = [], []
    for number, line in enumerate(content.splitlines(), start=1):
        bare = line.split("#", 1)[0]
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
            words = f"found {len(row)} columns, expected {len(names)} ({', '.join(n or '-' for n in names)})"
            problems.append(Problem(words, file, line_number))
    columns: dict[str, list[str | None] | FloatArray] = {
        name: [(row[k] or None) if k < len(row) else None for row in rows]
        for k, name in enumerate(names)
        if name
    }
    return _Source([name for name in names if name], columns, np.array(lines, dtype=np.int64), file)


def _convert(
    source: _Source, table: Table, known: dict[str, Column], place: Place, problems: list[Problem]
) -> Rows | None:
    before = len(problems)
    count = len(source.lines)
    if count == 0:
        problems.append(place.problem("the table is empty"))
        return None
    texts: dict[str, list[str]] = {}
    numbers: dict[str, FloatArray] = {}
    for name, value in table.values.items():
        _constant(known[name], value, table, count, place, problems, texts, numbers)
    for name, cells in source.columns.items():
        column = known.get(name)
        if column is None:
            words = f"unknown column {name!r}{nearest(name, known)} (known here: {', '.join(known)})"
            problems.append(Problem(words, source.file, 1))
        elif column.parse is None:
            texts[name] = _identifiers(column, cells, source, problems)
        else:
            numbers[name] = _numbers(column, cells, table, source, place, problems)
    return None if len(problems) > before else Rows(count, texts, numbers, source.lines, source.file)


def _constant(
    column: Column,
    value: str,
    table: Table,
    count: int,
    place: Place,
    problems: list[Problem],
    texts: dict[str, list[str]],
    numbers: dict[str, FloatArray],
) -> None:
    """A column with one value in every row; a mistake in it is one mistake, in the project file."""
    if column.parse is None:
        texts[column.name] = [value] * count
        return
    try:
        numbers[column.name] = np.full(count, column.parse(value, _unit_of(table, column)))
    except ValueError as error:
        problems.append(
            Problem(
                f"{column.name}: {error}",
                place.document.file_of(place.path),
                _line_of_value(place, column.name),
            )
        )


def _line_of_value(place: Place, name: str) -> int:
    return place.document.line((*place.path, "values", name))


def _unit_of(table: Table, column: Column) -> str:
    """Unit of a column that its cells do not carry themselves; one unit for all means: for all it fits."""
    if isinstance(table.units, str):
        return table.units if _fits(column, table.units) else ""
    return table.units.get(column.name, "")


def _identifiers(
    column: Column, cells: list[str | None] | FloatArray, source: _Source, problems: list[Problem]
) -> list[str]:
    result = ["" if cell is None else str(cell).strip() for cell in cells]
    if column.required:
        for cell, line in zip(result, source.lines, strict=True):
            if not cell:
                problems.append(Problem(f"{column.name} is empty", source.file, int(line)))
    return result


def _numbers(
    column: Column,
    cells: list[str | None] | FloatArray,
    table: Table,
    source: _Source,
    place: Place,
    problems: list[Problem],
) -> FloatArray:
    unit = _unit_of(table, column)
    assert column.parse is not None
    if isinstance(cells, np.ndarray) and column.factor is not None:
        try:
            values = cells * column.factor(unit)
        except ValueError as error:
            problems.append(place.problem(f"column {column.name}: {error}", "units"))
            return cells
        missing = np.isnan(cells)
    else:
        values = np.full(len(cells), np.nan)
        for i, cell in enumerate(cells):
            if cell is None or not str(cell).strip():
                continue
            try:
                values[i] = column.parse(str(cell), unit)
            except ValueError as error:
                problems.append(Problem(f"{column.name}: {error}", source.file, int(source.lines[i])))
        missing = np.array([cell is None or not str(cell).strip() for cell in cells])
    if column.required:
        for line in source.lines[missing]:
            problems.append(Problem(f"{column.name} is empty", source.file, int(line)))
    return values


def _fits(column: Column, unit: str) -> bool:
    if column.factor is None:
        return column.parse is not None
    try:
        column.factor(unit)
    except ValueError:
        return False
    return True
