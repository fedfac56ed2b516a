"""Lines of the table of residuals as CSV, statistics with the digits that mean something."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from mor.arrays import FloatArray, IntArray
from mor.compilation import wanted
from mor.project.tables.guarded import any_unsafe, csv_lines
from mor.quality.solved import Solved
from mor.report.tables.assessed_observations import AssessedRows
from mor.report.tables.observations import SCHEMA, Cells, cells_of, table_of
from mor.report.tables.tested_columns import TESTED

DIGITS = 7
"""Significant digits of statistics in the long table as text; Parquet has all digits."""
_PROBABILITIES = ["p", "p_t", "p_joint"]
_STATISTICS = [
    "sigma_adjusted",
    *(name for name, kind in TESTED.items() if kind == pl.Float64 and name not in _PROBABILITIES),
]
"""Single precision has seven digits, and is written twice as fast; probabilities need the exponents of double."""
_TEXTS = [name for name, kind in SCHEMA.items() if kind == pl.String]
_NUMBERS = [name for name, kind in SCHEMA.items() if kind == pl.Float64]
_IS_SINGLE = np.array([name in _STATISTICS for name in _NUMBERS])
_LONGEST = 25
"""Signs of a number and a comma."""
WORTH_COMPILING = 100_000
"""Observations from which on kernels write the lines. Read from disk they pay from some 15 000 on, but compiling them,
the first time, takes three seconds."""
Lines = tuple[int, memoryview]
"""A number of rows, and their lines."""


def lines_of(solved: Solved) -> Callable[[AssessedRows], Lines]:
    """What makes lines of some rows of an adjustment."""
    names = [name for things in solved.network.things.values() for name in things.ids]
    unsafe = any_unsafe([*names, *(group.name for group in solved.adjustment.problem.groups)])
    if not unsafe and wanted() and solved.network.observations >= WORTH_COMPILING:
        return lambda rows: compiled_lines(cells_of(rows))
    return lambda rows: plain_lines(table_of(rows), unsafe)


def plain_lines(table: pl.DataFrame, unsafe: bool) -> Lines:
    """The lines of a piece of the table; names are guarded where some are unsafe."""
    lines = BytesIO()
    shorter = table.with_columns(
        pl.col(_STATISTICS).cast(pl.Float32), pl.col(_PROBABILITIES).round_sig_figs(DIGITS)
    )
    if unsafe:
        return table.height, csv_lines(shorter, header=False)
    shorter.write_csv(lines, include_header=False)
    return table.height, lines.getbuffer()


def compiled_lines(cells: Cells) -> Lines:
    """The same bytes in less time, where no name needs a guard; line breaks are in none."""
    from mor.report.tables.lines.compiled.lines import write_lines
    from mor.report.tables.lines.compiled.numbers import BEYOND

    texts = [cells.texts[name] for name in _TEXTS]
    names = [_names(text.known) for text in texts]
    places = np.stack([text.numbers for text in texts]).astype(np.int32, copy=False)
    doubles = np.stack([_double(cells, name) for name in _NUMBERS if name not in _STATISTICS])
    singles = np.array([cells.numbers[name] for name in _STATISTICS], dtype=np.float32)
    longest = sum(int(np.diff(one.ends).max()) for one in names) + _LONGEST * len(_NUMBERS)
    text = np.empty(places.shape[1] * longest + BEYOND, dtype=np.uint8)
    size = write_lines(
        text,
        tuple(one.signs for one in names),
        tuple(one.ends for one in names),
        places,
        list(SCHEMA).index(_NUMBERS[0]),
        doubles.view(np.uint64),
        singles.view(np.uint32),
        _IS_SINGLE,
    )
    return places.shape[1], text[:size].data


def _double(cells: Cells, name: str) -> FloatArray:
    numbers = cells.numbers[name]
    if name not in _PROBABILITIES:
        return numbers
    rounded: FloatArray = pl.Series(numbers, nan_to_null=True).round_sig_figs(DIGITS).to_numpy()
    return rounded


class _Names(NamedTuple):
    """Texts as they stand in a CSV file."""

    signs: NDArray[np.uint8]
    """(bytes,) of all of them, each with one behind it."""
    ends: IntArray
    """(texts + 1,) places of these, −1 before the first text."""


_KEPT = 16
_names_of: list[tuple[pl.Series, _Names]] = []
"""The lists of texts asked for last: a long table is made in many pieces of the same ones."""


def _names(known: pl.Series) -> _Names:
    for own, names in _names_of:
        if own is known:
            return names
    lines = BytesIO()
    known.to_frame().write_csv(lines, include_header=False)
    signs = np.frombuffer(lines.getvalue(), dtype=np.uint8)
    names = _Names(signs, np.concatenate(([-1], np.flatnonzero(signs == ord("\n")))))
    _names_of[:] = [(known, names), *_names_of[: _KEPT - 1]]
    return names
