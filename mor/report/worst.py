"""The worst observations, found in arrays: only their rows become rows of a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.geometry.arrays import FloatArray, IntArray
from mor.quality.pieces import in_pieces
from mor.quality.reliability import without_test
from mor.quality.solved import Solved
from mor.quality.tests import comparable, least_alike, normalised_residuals
from mor.report.assessed_rows import AssessedGroups
from mor.report.observation_table import SCHEMA, table_of


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
    sizes = [_sizes(solved, number) for number in range(len(solved.adjustment.problem.groups))]
    limit = _limit(sizes, count)
    return [np.flatnonzero((size >= limit).any(axis=1)) for size in sizes]


def _sizes(solved: Solved, number: int) -> FloatArray:
    """|w| (n, m) of a group, −1 where there is none."""
    quality, group = solved.quality, solved.adjustment.problem.groups[number]
    if quality is None:
        return np.full(group.observed.shape, -1.0)
    one, tests, out = quality.groups[number], quality.reliability[number], group.left_out

    def of_rows(rows: slice) -> FloatArray:
        w = normalised_residuals(one.at(rows))
        if group.excluded is not None:
            w = np.where(out[rows], tests.at(rows).test, w)
        size: FloatArray = np.nan_to_num(np.abs(w), nan=-1.0)
        return size

    return in_pieces(group.observed.shape, of_rows)


def _limit(sizes: list[FloatArray], count: int) -> float:
    """The size from which on an observation may be among the largest."""
    largest = np.zeros(0)
    for size in sizes:
        flat = size.ravel()
        if len(flat) > count:
            flat = np.partition(flat, len(flat) - count)[len(flat) - count :]
        largest = np.sort(np.concatenate([largest, flat]))[-count:]
    return max(least_alike(float(largest[0])), 0.0) if len(largest) else 0.0


def between(row: dict[str, Any]) -> str:
    """A row of the table of residuals in a sentence: type, between what, component."""
    names = " - ".join(name for name in (row["at"], row["from"], row["to"]) if name)
    return f"{row['type']} {names}{component_of(row)}"


def component_of(row: dict[str, Any]) -> str:
    """The component after a comma; nothing where it is the type once more, as of a distance."""
    return "" if row["component"] == row["type"] else f", {row['component']}"


def uncontrolled_residuals(solved: Solved, count: int) -> tuple[pl.DataFrame, int]:
    """The first rows of observations that nothing controls, and how many there are of them."""
    if solved.quality is None:
        return pl.DataFrame(schema=SCHEMA), 0
    tested, parts, number = AssessedGroups(solved), [], 0
    groups = zip(
        solved.quality.reliability,
        tested.solved.adjustment.problem.groups,
        strict=True,
    )
    for k, (tests, group) in enumerate(groups):
        loose = without_test(tests) & ~group.left_out
        rows = np.flatnonzero(loose.any(axis=1))[:count]
        number += int(np.count_nonzero(loose))
        if len(rows):
            parts.append(table_of(tested.rows(k, rows)).filter(pl.col("flag") == "uncontrolled"))
    return (pl.concat(parts).head(count) if parts else pl.DataFrame(schema=SCHEMA)), number
