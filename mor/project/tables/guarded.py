"""Names in CSV files, written so that no spreadsheet runs them as a formula and no reader takes them for a comment.

A name that begins with =, +, -, @ or a tab (and is no number) would be run when the table is opened in a spreadsheet;
one that begins with # would be a comment. An apostrophe is put before them, and taken away on reading. What begins with
apostrophes before one of these signs gets another one, so that every name comes back as it was.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from io import BytesIO
from typing import IO

import polars as pl

_SIGNS = "[=+@\t#-]"
_UNSAFE = re.compile(f"'*{_SIGNS}")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_COMMENT = r"\s#"
_AFTER_A_BLANK = re.compile(_COMMENT)


def is_unsafe(name: str) -> bool:
    """True for a name that needs an apostrophe, or quotes around it, in a CSV file."""
    begins = _UNSAFE.match(name) is not None and _NUMBER.fullmatch(name) is None
    return begins or _AFTER_A_BLANK.search(name) is not None


def any_unsafe(names: Iterable[str]) -> bool:
    """Return True if one of the names needs to be guarded."""
    return any(map(is_unsafe, names))


def guarded(name: str) -> str:
    """A name as it is written."""
    return f"'{name}" if _UNSAFE.match(name) and not _NUMBER.fullmatch(name) else name


def plain(name: str) -> str:
    """A name behind what is written."""
    return name[1:] if re.match(f"'+{_SIGNS}", name) else name


def plain_column(cells: pl.Series) -> pl.Series:
    """Names behind a column of texts."""
    return cells.str.replace(f"^'('*{_SIGNS})", "$1")


def csv_lines(frame: pl.DataFrame, header: bool = True) -> memoryview:
    """A table as CSV, as :func:`write_csv` writes it."""
    lines = BytesIO()
    write_csv(frame, lines, header)
    return lines.getbuffer()


def write_csv(frame: pl.DataFrame, file: IO[bytes], header: bool = True) -> None:
    """Write a table, names guarded; all texts in quotes where one of them would look like a comment otherwise."""
    texts, hidden = pl.col(pl.String), False
    if _any(frame.select(texts.str.contains(rf"^'*{_SIGNS}|{_COMMENT}").any())):
        frame = frame.with_columns(_guarded(texts))
        hidden = _any(frame.select(texts.str.contains(_COMMENT).any()))
    frame.write_csv(file, include_header=header, quote_style="non_numeric" if hidden else "necessary")


def _any(told: pl.DataFrame) -> bool:
    """Return True if one of the columns, all of one row, says so."""
    return any(map(any, told.rows()))


def _guarded(cells: pl.Expr) -> pl.Expr:
    """Names of columns as they are written."""
    begins = cells.str.contains(f"^'*{_SIGNS}") & ~cells.str.contains(f"^(?:{_NUMBER.pattern})$")
    return pl.when(begins).then(cells.str.replace("^", "'")).otherwise(cells)
