"""The residual table in long form: one row for every observation, units and all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.observations.names import Coded, Names, one_name
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
    """All observations. ``v`` = adjusted − observed; ``r`` and ``w`` are empty if there was no solution."""
    parts = [table_of(rows, columns) for rows in AssessedGroups(solved).pieces()]
    return pl.concat(parts) if parts else pl.DataFrame(schema={name: SCHEMA[name] for name in columns})


def table_of(rows: AssessedRows, wanted: Sequence[str] = tuple(SCHEMA)) -> pl.DataFrame:
    """Rows of the table for some rows of a group, one for each component that was observed; of it some columns."""
    group = rows.group
    out = said(group)
    mask = group.mask[:, out.source]
    row, component = np.nonzero(mask)
    whole = bool(mask.all())
    number_of = {key: make() for key, make in _numbers(rows).items() if key in wanted}
    texts = {
        key: names.column().expression(row) for key, names in named_places(group).items() if key in wanted
    }
    texts["component"] = _among([of.name for of in group.type.components]).expression(component)
    texts["unit"] = _among(out.external.units).expression(component)
    texts["flag"] = Coded(pl.Series(FLAGS), flags(rows)[mask]).expression(np.arange(len(row)))
    said_of_all = {"type": group.type.name, "group": group.name, "at": ""}
    texts = {**{key: pl.lit(text) for key, text in said_of_all.items()}, **texts}
    numbers = {key: values.ravel() if whole else values[mask] for key, values in number_of.items()}
    columns = [text.alias(key) for key, text in texts.items()]
    return pl.DataFrame(numbers, nan_to_null=True).with_columns(columns).select(wanted)


def _among(names: Sequence[str]) -> Coded:
    return Coded(pl.Series(names, dtype=pl.String), np.arange(len(names)))


def _numbers(rows: AssessedRows) -> dict[str, Callable[[], FloatArray]]:
    """Functions that compute each numeric column, (k, m), in the units and axes of the project."""
    group, one = rows.group, rows.one
    observed = said_values(group, group.observed)
    return {
        "observed": lambda: observed,
        "adjusted": lambda: observed + said_differences(group, one.v),
        "v": lambda: said_differences(group, one.v),
        "sigma": lambda: said_sizes(group, group.given_sigma),
        "sigma_adjusted": lambda: said_sizes(group, _sigma_adjusted(rows)),
        **tested_columns(rows),
    }


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
