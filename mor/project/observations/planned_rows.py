"""Observations that are planned and not measured: tables in which the values are missing, row by row or throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mor.project.network.reading import Reading
from mor.project.tables.columns import Column, Rows


def without_required(columns: Sequence[Column], measured: Sequence[str]) -> list[Column]:
    """The columns of a table, those of what is ``measured`` no longer required."""
    return [column._replace(required=column.required and column.name not in measured) for column in columns]


def planned_rows(rows: Rows, measured: Sequence[str], reading: Reading, name: str) -> Rows:
    """The rows with 0 in place of measured values that are missing; ``name`` of a table that misses some is noted.

    Where a row has no value at all, it is planned to observe what other rows of the table have; all components of the
    type where no row has any.
    """
    given = {key: rows.number(key) for key in measured}
    known = [key for key, values in given.items() if np.isfinite(values).any()]
    empty = ~np.any([np.isfinite(values) for values in given.values()], axis=0)
    if not empty.any():
        return rows
    reading.unmeasured.append(name)
    filled = {key: np.where(empty, 0.0, given[key]) for key in known or measured}
    return replace(rows, numbers={**rows.numbers, **filled})
