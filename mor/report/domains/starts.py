"""The tables of the adjusted project: each domain writes the rows of its own points and images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from mor.project.tables.guarded import csv_lines
from mor.report.results.adjusted.start_columns import Placed
from mor.report.results.adjusted.start_tables import start_tables
from mor.report.results.folder import Writer

SPACES = {"points": "point", "images": "image"}
"""Sections of things that are divided."""
_ROWS_AT_A_TIME = 500_000


class Start(NamedTuple):
    """A table of start values of a domain."""

    section: str
    table: int
    """Its number in the project."""
    keys: dict[str, Any]
    columns: tuple[tuple[str, pl.DataType], ...]


def start_parts(
    placed: Placed, numbers: Mapping[str, Sequence[int]], foreign: Mapping[str, frozenset[str]]
) -> list[tuple[Start, pl.DataFrame]]:
    """The tables of points and images of a domain without those that another domain counts.

    ``numbers`` are those of its tables in the project, by section; ``foreign`` names by ``point``, ``image``.
    """
    tables = start_tables(placed)
    found = []
    for section, space in SPACES.items():
        names = pl.Series("id", sorted(foreign[space]), dtype=pl.String)
        for number, (frame, keys) in zip(numbers[section], tables[section], strict=True):
            own = frame.filter(~pl.col("id").is_in(names.implode()))
            found.append((Start(section, number, keys, tuple(own.schema.items())), own))
    return found


def place_of(section: str, table: int) -> str:
    """Folder of the parts of a table."""
    return f"start-{section}-{table}"


def joined_starts(
    starts: Sequence[Start], folder: Path
) -> tuple[dict[str, list[tuple[pl.DataFrame, dict[str, Any]]]], dict[str, list[Writer]]]:
    """Tables by section, without rows, with their keys; and what writes each of them from the parts in a folder."""
    tables: dict[str, list[tuple[pl.DataFrame, dict[str, Any]]]] = {section: [] for section in SPACES}
    writers: dict[str, list[Writer]] = {section: [] for section in SPACES}
    for section, table in sorted({(one.section, one.table) for one in starts}):
        mine = [one for one in starts if (one.section, one.table) == (section, table)]
        schema = _together([one.columns for one in mine])
        tables[section].append((pl.DataFrame(schema=schema), mine[0].keys))
        writers[section].append(parts_writer(folder / place_of(section, table), schema))
    return tables, writers


def _together(columns: Sequence[tuple[tuple[str, pl.DataType], ...]]) -> dict[str, pl.DataType]:
    """All columns, in the order that those domains have which have most of them."""
    found: dict[str, pl.DataType] = {}
    for one in sorted(columns, key=len, reverse=True):
        for name, kind in one:
            if name not in found or found[name] == pl.Null:
                found[name] = kind
    return found


def parts_writer(parts: Path, schema: Mapping[str, pl.DataType]) -> Writer:
    """What writes the parts in a folder as one CSV file with these columns."""

    def write(path: Path) -> None:
        with path.open("wb") as whole:
            whole.write(bytes(csv_lines(pl.DataFrame(schema=schema))))
            for file in sorted(parts.glob("*.parquet")):
                frame = pl.read_parquet(file)
                missing = [
                    pl.lit(None, kind).alias(name) for name, kind in schema.items() if name not in frame
                ]
                frame = frame.with_columns(missing).select(list(schema))
                for first in range(0, frame.height, _ROWS_AT_A_TIME):
                    whole.write(csv_lines(frame[first : first + _ROWS_AT_A_TIME], header=False))

    return write
