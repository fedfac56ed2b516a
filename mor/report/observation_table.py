"""The residual table in long form: one row for every observation, units and all."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.geometry.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.influence import influence_on_points
from mor.quality.solved import Solved
from mor.report.outward import said, said_differences, said_sizes, said_values
from mor.report.tested_columns import TESTED, flags, tested_columns

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


def observation_table(solved: Solved) -> pl.DataFrame:
    """All observations. ``v`` = adjusted − observed; ``r`` and ``w`` are empty where there was no solution."""
    groups = solved.adjustment.problem.groups
    influence = (
        influence_on_points(solved.quality)
        if solved.quality is not None
        else tuple(np.full(group.observed.shape, np.nan) for group in groups)
    )
    parts = [_group_table(solved, number, group, influence[number]) for number, group in enumerate(groups)]
    return pl.concat(parts) if parts else pl.DataFrame(schema=SCHEMA)


def _group_table(solved: Solved, number: int, group: ObservationGroup, influence: FloatArray) -> pl.DataFrame:
    quality = solved.quality
    out = said(group)
    mask = group.mask[:, out.source]
    rows, components = np.nonzero(mask)
    nothing = np.full(group.observed.shape, np.nan)
    v = quality.groups[number].v if quality else nothing
    adjusted = said_values(group, group.observed) + said_differences(group, v)
    numbers = {
        "observed": said_values(group, group.observed),
        "adjusted": adjusted,
        "v": said_differences(group, v),
        "sigma": said_sizes(group, group.given_sigma),
        "sigma_adjusted": _sigma_adjusted(solved, number, group),
        **tested_columns(solved, number, group, influence),
    }
    names = np.array([component.name for component in group.type.components])
    units = np.array(out.external.units)
    columns: dict[str, object] = {
        "type": np.full(len(rows), group.type.key),
        "group": np.full(len(rows), group.name),
        **{key: np.array(ids, dtype=object)[rows] for key, ids in _places(group).items()},
        "component": names[components],
        "unit": units[components],
        **{key: values[rows, components] for key, values in numbers.items()},
        "flag": flags(solved, number, group)[rows, components],
    }
    frame = pl.DataFrame(
        {
            key: pl.Series(key, np.asarray(columns[key]), dtype=kind, strict=False)
            for key, kind in SCHEMA.items()
        }
    )
    return frame.with_columns(pl.col(pl.Float64).fill_nan(None))


def _places(group: ObservationGroup) -> dict[str, tuple[str, ...]]:
    """Identifiers of a group's rows as at, from, to."""
    empty = ("",) * group.count
    if len(group.references) == 3:
        at, start, end = group.references
        return {"at": at, "from": start, "to": end}
    if len(group.references) == 2:
        return {"at": empty, "from": group.references[0], "to": group.references[1]}
    return {"at": empty, "from": group.references[0], "to": empty}


def _sigma_adjusted(solved: Solved, number: int, group: ObservationGroup) -> np.ndarray:
    quality = solved.quality
    if quality is None:
        return np.full(group.observed.shape, np.nan)
    sigma = quality.sigma_factor * np.sqrt(np.maximum(quality.groups[number].q_adjusted, 0.0))
    return said_sizes(group, sigma)
