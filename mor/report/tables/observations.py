"""The residual table in long form: one row for every observation, units and all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.observations.names import Names, one_name
from mor.quality.solved import Solved
from mor.report.edge import said, said_differences, said_sizes, said_values
from mor.report.tables.assessed_observations import AssessedGroups, AssessedRows
from mor.report.tables.tested_columns import FLAGS, TESTED, flags, tested_columns

SCHEMA = {
    "type": pl.String,
    "group": pl.String,
    "at": pl.String,
    "from": pl.String,
    "to": pl.String,
    "component": pl.String,
    "unit": pl.String,
    "observed": pl.Float64,
    "adjusted": pl.Float64,
    "v": pl.Float64,
    "sigma": pl.Float64,
    "sigma_adjusted": pl.Float64,
    **TESTED,
}


SHOWN = (
    *("type", "group", "at", "from", "to", "component", "unit", "observed", "adjusted", "v", "sigma"),
    *("r", "w", "error", "nabla", "external", "influence", "flag"),
)
"""Columns that pages and pictures are drawn from."""


def observation_table(solved: Solved, columns: Sequence[str] = tuple(SCHEMA)) -> pl.DataFrame:
    """All observations. ``v`` = adjusted − observed; ``r`` and ``w`` are empty where there was no solution."""
    parts = [table_of(rows).select(columns) for rows in AssessedGroups(solved).pieces()]
    return pl.concat(parts) if parts else pl.DataFrame(schema={name: SCHEMA[name] for name in columns})


def table_of(rows: AssessedRows) -> pl.DataFrame:
    """Rows of the table for some rows of a group, one for each component that was observed."""
    group, one = rows.group, rows.one
    out = said(group)
    mask = group.mask[:, out.source]
    row, component = np.nonzero(mask)
    observed = said_values(group, group.observed)
    numbers = {
        "observed": observed,
        "adjusted": observed + said_differences(group, one.v),
        "v": said_differences(group, one.v),
        "sigma": said_sizes(group, group.given_sigma),
        "sigma_adjusted": said_sizes(group, _sigma_adjusted(rows)),
        **tested_columns(rows),
    }
    whole = bool(mask.all())
    columns = {
        **{key: names.texts().gather(row) for key, names in named_places(group).items()},
        "component": pl.Series([c.name for c in group.type.components]).gather(component),
        "unit": pl.Series(out.external.units).gather(component),
        "flag": pl.Series(FLAGS).gather(flags(rows)[mask]),
        **{key: values.ravel() if whole else values[mask] for key, values in numbers.items()},
    }
    said_of_all = {"type": group.type.name, "group": group.name, "at": ""}
    literals = [pl.lit(text).alias(key) for key, text in said_of_all.items() if key not in columns]
    return (
        pl.DataFrame(columns).with_columns(*literals, pl.col(pl.Float64).fill_nan(None)).select(list(SCHEMA))
    )


def named_places(group: ObservationGroup) -> dict[str, Names]:
    """Identifiers of a group's rows as at, from, to; nothing for at where the type has none."""
    if len(group.references) == 3:
        return dict(zip(("at", "from", "to"), group.references, strict=True))
    nobody = one_name("", group.count)
    return dict(zip(("from", "to"), (*group.references, nobody), strict=False))


def _sigma_adjusted(rows: AssessedRows) -> FloatArray:
    factor = rows.whole.sigma_factor if rows.whole is not None else np.nan
    sigma: FloatArray = factor * np.sqrt(np.maximum(rows.one.q_adjusted, 0.0))
    return sigma
