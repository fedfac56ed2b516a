"""Tables in spreadsheets (.xlsx, .xls, .ods), read by python-calamine."""

from __future__ import annotations

from datetime import date, datetime, time
from pathlib import Path

import polars as pl

from mor.errors import InputError, Problem, nearest
from mor.input_files import TABLE, check_regular, check_size, note_file

_ENDINGS = {".xlsx", ".xlsm", ".xls", ".ods"}


def is_spreadsheet(path: Path) -> bool:
    """Return True for a file whose name ends like that of a spreadsheet."""
    return path.suffix.lower() in _ENDINGS


def read_spreadsheet(path: Path, sheet: str | None = None) -> pl.DataFrame:
    """Return the cells of a sheet as texts; its first row that is not empty has the names of the columns.

    ``sheet`` is needed if several sheets hold something. Raises :class:`InputError` if the file cannot be read, if the
    sheet is missing or not named, and if python-calamine (extra ``formats``) is not installed.
    """
    try:
        import python_calamine
    except ImportError:
        words = "spreadsheets need the extra formats: pip install 'mor-adjustment[formats]'"
        raise InputError([Problem(words, str(path))]) from None
    check_regular(path)
    check_size(path.stat().st_size, path, TABLE)
    note_file(path)
    try:
        book = python_calamine.CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    except (python_calamine.CalamineError, OSError) as error:
        raise InputError([Problem(f"this file cannot be read: {error}", str(path))]) from None
    filled = [name for name, rows in sheets.items() if rows]
    if sheet is not None and sheet not in sheets:
        words = f"found no sheet {sheet!r}{nearest(sheet, sheets)} (sheets: {', '.join(sheets)})"
        raise InputError([Problem(words, str(path))])
    if sheet is None and len(filled) != 1:
        words = (
            f"found {len(filled)} sheets with content ({', '.join(filled)}), expected one; say sheet: NAME"
        )
        raise InputError([Problem(words, str(path))])
    rows = [
        [_text(cell) for cell in row] for row in sheets[sheet or filled[0]] if any(cell != "" for cell in row)
    ]
    if not rows:
        raise InputError([Problem("the table is empty", str(path))])
    header = [name or f"column{k + 1}" for k, name in enumerate(rows[0])]
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise InputError([Problem(f"column {', '.join(map(repr, twice))} is given twice", str(path))])
    columns = {name: [row[k] or None for row in rows[1:]] for k, name in enumerate(header)}
    return pl.DataFrame(columns, schema=dict.fromkeys(header, pl.String))


def _text(cell: object) -> str:
    """Text of a cell: spreadsheets keep whole numbers, and names made of digits, as floating-point numbers."""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return str(cell).strip()
