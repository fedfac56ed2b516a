"""Tables as files: CSV or Parquet, the long one piece by piece."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from io import BytesIO
from pathlib import Path
from typing import Literal, TypeVar

import polars as pl
from polars.io.plugins import register_io_source

from mor.machine import processors
from mor.project.tables.guarded import any_unsafe, csv_lines, write_csv
from mor.quality.solved import Solved
from mor.report.results.folder import Writer
from mor.report.tables.assessed_observations import AssessedGroups, AssessedRows
from mor.report.tables.observations import SCHEMA, table_of
from mor.report.tables.tested_columns import TESTED

Made = TypeVar("Made")
Format = Literal["csv", "parquet"]
Done = Callable[[int], None]
"""Told how many more rows are written."""

DIGITS = 7
"""Significant digits of statistics in the long table as text; Parquet has all digits."""
_ROWS_TOGETHER = 250_000
"""Rows of one row group of a Parquet file."""
_LEVEL = 1
"""Of compression by zstd. Measured numbers have nothing to compress: others take half as long again for 0.2 % less."""
_PROBABILITIES = ["p", "p_t", "p_joint"]
_STATISTICS = [
    "sigma_adjusted",
    *(name for name, kind in TESTED.items() if kind == pl.Float64 and name not in _PROBABILITIES),
]
"""Single precision has seven digits, and is written twice as fast; probabilities need the exponents of double."""


def table_writer(frame: pl.DataFrame | str, kind: Format = "csv") -> Writer:
    """Writer of a table that is there as a whole, or as its text."""

    def write(path: Path) -> None:
        if isinstance(frame, str):
            path.write_text(frame, encoding="utf-8")
        elif kind == "parquet":
            frame.write_parquet(path, compression_level=_LEVEL, row_group_size=_ROWS_TOGETHER)
        else:
            with path.open("wb") as file:
                write_csv(frame, file)

    return write


def residual_writer(solved: Solved, kind: Format, done: Done) -> Writer:
    """Writer of the whole table of residuals, which is never in memory as a whole."""
    tested = AssessedGroups(solved)
    unsafe = _has_unsafe_names(solved)

    def csv(path: Path) -> None:
        with path.open("wb") as file:
            file.write((",".join(SCHEMA) + "\n").encode())
            for height, text in _ahead(tested.pieces(), lambda rows: _csv_lines(table_of(rows), unsafe)):
                file.write(text)
                done(height)

    def pieces() -> Iterator[pl.DataFrame]:
        for piece in _ahead(tested.pieces(), table_of):
            yield piece
            done(piece.height)

    def parquet(path: Path) -> None:
        def source(
            columns: list[str] | None, predicate: pl.Expr | None, rows: int | None, batch: int | None
        ) -> Iterator[pl.DataFrame]:
            return pieces()

        whole = register_io_source(source, schema=SCHEMA)
        whole.sink_parquet(path, compression_level=_LEVEL, row_group_size=_ROWS_TOGETHER)

    return parquet if kind == "parquet" else csv


def _has_unsafe_names(solved: Solved) -> bool:
    names = (name for things in solved.network.things.values() for name in things.ids)
    return any_unsafe(names) or any_unsafe(group.name for group in solved.adjustment.problem.groups)


def _csv_lines(table: pl.DataFrame, unsafe: bool) -> tuple[int, memoryview]:
    """Number of rows of a piece of the long table, and their lines; names are guarded where some are unsafe."""
    lines = BytesIO()
    shorter = table.with_columns(
        pl.col(_STATISTICS).cast(pl.Float32), pl.col(_PROBABILITIES).round_sig_figs(DIGITS)
    )
    if unsafe:
        return table.height, csv_lines(shorter, header=False)
    shorter.write_csv(lines, include_header=False)
    return table.height, lines.getbuffer()


def _ahead(pieces: Iterator[AssessedRows], make: Callable[[AssessedRows], Made]) -> Iterator[Made]:
    """Results of ``work`` in order; as many pieces as there are processors are worked on at a time."""
    workers = processors()
    waiting: deque[Future[Made]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for piece in pieces:
            waiting.append(pool.submit(make, piece))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
