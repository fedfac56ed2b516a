"""Tables: rows in the project file, or files beside it, turned into identifiers and numbers in internal units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from mor.arrays import LARGEST, BoolArray, FloatArray
from mor.errors import Problem, nearest
from mor.project.edge import beyond
from mor.project.file.table import Table
from mor.project.tables.columns import Column, Place, Rows, Source, tell_rows
from mor.project.tables.sources import from_file, from_rows

__all__ = ["Column", "Place", "Rows", "read_table"]


def read_table(table: Table, columns: Sequence[Column], place: Place, problems: list[Problem]) -> Rows | None:
    """Rows of a table; ``None`` if ``problems`` were added instead."""
    before = len(problems)
    known = {column.name: column for column in columns}
    _check_names(table, known, place, problems)
    _check_common_unit(table, known, place, problems)
    source = (
        from_rows(table, place, problems)
        if table.rows is not None
        else from_file(table, known, place, problems)
    )
    if source is None or len(problems) > before:
        return None
    _check_columns(source.names, table, columns, place, problems)
    if len(problems) > before:
        return None
    return _convert(source, table, known, place, problems)


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


def _check_common_unit(table: Table, known: dict[str, Column], place: Place, problems: list[Problem]) -> None:
    """One unit for all columns must fit one of them at least."""
    if isinstance(table.units, str) and not any(_fits(column, table.units) for column in known.values()):
        numbers = ", ".join(column.name for column in known.values() if column.parse is not None)
        problems.append(place.problem(f"unit {table.units!r} fits none of the columns ({numbers})", "units"))


def _check_columns(
    names: list[str], table: Table, columns: Sequence[Column], place: Place, problems: list[Problem]
) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    problems += [place.problem(f"column {name!r} is given twice") for name in twice]
    missing = [c.name for c in columns if c.required and c.name not in names and c.name not in table.values]
    if missing:
        found = ", ".join(names) or "none"
        hint = next(
            (f"; is {sign!r} the delimiter?" for sign in ";\t| " if sign in found.replace(", ", "")), ""
        )
        problems.append(
            place.problem(f"column {', '.join(map(repr, missing))} is missing (found: {found}){hint}")
        )


def _convert(
    source: Source, table: Table, known: dict[str, Column], place: Place, problems: list[Problem]
) -> Rows | None:
    before = len(problems)
    count = len(source.lines)
    if count == 0:
        problems.append(place.problem("the table is empty"))
        return None
    texts: dict[str, pl.Series] = {}
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
            if table.decimal == "," and cells.dtype == pl.String:
                cells = cells.str.replace(",", ".", literal=True)
            numbers[name] = _numbers(column, cells, table, source, place, problems)
    return None if len(problems) > before else Rows(count, texts, numbers, source.lines, source.file)


def _constant(
    column: Column,
    value: str,
    table: Table,
    count: int,
    place: Place,
    problems: list[Problem],
    texts: dict[str, pl.Series],
    numbers: dict[str, FloatArray],
) -> None:
    """A column with one value in every row; a mistake in it is one mistake, in the project file."""
    if column.parse is None:
        texts[column.name] = pl.repeat(value, count, dtype=pl.String, eager=True)
        return
    at = Place(place.document, (*place.path, "values", column.name), place.folder)
    try:
        number = column.parse(value, _unit_of(table, column))
    except ValueError as error:
        problems.append(at.problem(f"{column.name}: {error}"))
        return
    if column.name.startswith("sigma") and number < 0.0:
        problems.append(at.problem(f"{column.name}: found {value}, expected a σ ≥ 0"))
    numbers[column.name] = np.full(count, number)


def _unit_of(table: Table, column: Column) -> str:
    """Unit of a column that its cells do not carry themselves; one unit for all means: for all it fits."""
    if isinstance(table.units, str):
        return table.units if _fits(column, table.units) else ""
    return table.units.get(column.name, "")


def _identifiers(column: Column, cells: pl.Series, source: Source, problems: list[Problem]) -> pl.Series:
    result = cells.cast(pl.String).str.strip_chars().fill_null("")
    if column.required:
        tell_rows(problems, (result == "").to_numpy(), source, f"{column.name} is empty")
    broken = result.str.contains("[\n\r\\x00]").to_numpy()
    tell_rows(
        problems, broken, source, lambda row: f"found {result[row]!r}, expected a name without line breaks"
    )
    return result


def _numbers(
    column: Column, cells: pl.Series, table: Table, source: Source, place: Place, problems: list[Problem]
) -> FloatArray:
    unit = _unit_of(table, column)
    assert column.parse is not None
    if not cells.dtype.is_numeric():
        cells = cells.cast(pl.String).str.strip_chars().replace("", None)
    missing = cells.is_null().to_numpy()
    if column.required:
        tell_rows(problems, missing, source, f"{column.name} is empty")
    factor = _factor(column, unit)
    if factor is None and column.factor is not None:
        _, words = _parsed(column, "1", unit)
        if words or cells.dtype.is_numeric():
            problems.append(place.problem(f"column {column.name}: {words}", "units"))
            return np.zeros(len(cells))
    plain = (
        cells.cast(pl.Float64, strict=False)
        if factor is not None
        else pl.repeat(None, len(cells), eager=True)
    )
    values = plain.cast(pl.Float64).fill_null(np.nan).to_numpy() * (1.0 if factor is None else factor)
    others = ~(np.abs(values) <= LARGEST) & ~missing
    if others.any():
        values = np.array(values)
        _one_by_one(column, cells, unit, values, others, source, problems)
    return values


def _factor(column: Column, unit: str) -> float | None:
    """Internal units per unit of plain numbers; ``None`` if they must be read one by one."""
    try:
        return column.factor(unit) if column.factor is not None else None
    except ValueError:
        return None


def _one_by_one(
    column: Column,
    cells: pl.Series,
    unit: str,
    values: FloatArray,
    others: BoolArray,
    source: Source,
    problems: list[Problem],
) -> None:
    """Cells that are more than plain numbers, put into ``values``: with a unit of their own, angles d-m-s, mistakes."""
    wrong = np.zeros(len(others), dtype=bool)
    for row in np.flatnonzero(others).tolist():
        values[row], words = _parsed(column, str(cells[row]), unit)
        wrong[row] = bool(words)
    tell_rows(
        problems, wrong, source, lambda row: f"{column.name}: {_parsed(column, str(cells[row]), unit)[1]}"
    )


def _parsed(column: Column, text: str, unit: str) -> tuple[float, str]:
    """Number behind a text, and what is wrong with it."""
    assert column.parse is not None
    try:
        value = column.parse(text, unit)
    except ValueError as error:
        return np.nan, str(error)
    return (value, "") if abs(value) <= LARGEST else (np.nan, beyond(text, value))


def _fits(column: Column, unit: str) -> bool:
    if column.factor is None:
        return column.parse is not None
    try:
        column.factor(unit)
    except ValueError:
        return False
    return True
