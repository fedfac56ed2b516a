"""The worst observations, found in arrays: only their rows become rows of a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.quality.in_chunks import in_pieces
from mor.quality.reliability.reliability_map import uncontrolled
from mor.quality.solved import Solved
from mor.quality.tests.test_statistics import comparable, least_alike
from mor.report.layout import component_of
from mor.report.tables.assessed_observations import AssessedGroups
from mor.report.tables.observations import SCHEMA, table_of


def worst_residuals(solved: Solved, count: int) -> pl.DataFrame:
    """The rows of the table of residuals with the largest |w|, the worst first, equal ones in their order."""
    tested, parts = AssessedGroups(solved), []
    for number, rows in enumerate(_among_the_largest(solved, count)):
        if len(rows):
            parts.append(table_of(tested.rows(number, rows)))
    if not parts:
        return pl.DataFrame(schema=SCHEMA)
    table = pl.concat(parts).filter(pl.col("w").is_not_null())
    order = np.argsort(-comparable(np.abs(table["w"].to_numpy())), kind="stable")
    return table[order[:count]]


def _among_the_largest(solved: Solved, count: int) -> list[IntArray]:
    """Rows of each group that may be among the largest."""
    found = [_sizes(solved, number, count) for number in range(len(solved.adjustment.problem.groups))]
    largest = np.sort(np.concatenate([np.zeros(0), *(top for _, top in found)]))[-count:]
    limit = max(least_alike(float(largest[0])), 0.0) if len(largest) else 0.0
    return [np.flatnonzero(size >= limit) for size, _ in found]


def _sizes(solved: Solved, number: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Largest |w| (n,) of each row of a group, −1 where there is none, and the largest of all."""
    quality, group = solved.quality, solved.adjustment.problem.groups[number]
    if quality is None:
        return np.full(group.count, -1.0), np.zeros(0)
    tests = quality.reliability[number]
    tops = [np.zeros(0)]

    def of_rows(rows: slice) -> FloatArray:
        size: FloatArray = np.nan_to_num(np.abs(tests.at(rows).test), nan=-1.0)
        tops.append(_top(size.ravel(), count))
        tops[:] = [_top(np.concatenate(tops), count)]
        return np.asarray(size.max(axis=1))

    return in_pieces((group.count,), of_rows), tops[0]


def _top(sizes: FloatArray, count: int) -> FloatArray:
    """The largest sizes, at most so many."""
    return np.partition(sizes, len(sizes) - count)[len(sizes) - count :] if len(sizes) > count else sizes


def between(row: dict[str, Any]) -> str:
    """A row of the table of residuals in a sentence: type, between what, component."""
    names = " - ".join(name for name in (row["at"], row["from"], row["to"]) if name)
    return f"{row['type']} {names}{component_of(row)}"


def uncontrolled_residuals(solved: Solved, count: int) -> tuple[pl.DataFrame, int]:
    """The first rows of observations that hardly anything controls, and how many there are of them.

    Those that are flagged all the same are not among them.
    """
    if solved.quality is None:
        return pl.DataFrame(schema=SCHEMA), 0
    tested, parts, number = AssessedGroups(solved), [], 0
    for k, flagged in enumerate(solved.quality.flagged):
        loose = uncontrolled(solved.quality, k) & ~flagged
        rows = np.flatnonzero(loose.any(axis=1))[:count]
        number += int(np.count_nonzero(loose))
        if len(rows):
            parts.append(table_of(tested.rows(k, rows)).filter(pl.col("flag") == "uncontrolled"))
    return (pl.concat(parts).head(count) if parts else pl.DataFrame(schema=SCHEMA)), number
