"""``results.json``: everything but the long residual table as plain data, in a stable order."""

from __future__ import annotations

import json
from typing import Any

import polars as pl

from mor.quality.solved import Solved
from mor.report.checks import check_rows
from mor.report.features import feature_table
from mor.report.reliability import fixed_point_rows, gross_errors
from mor.report.summary import summary
from mor.report.tables import (
    group_table,
    image_table,
    interior_rows,
    other_rows,
    pair_table,
    point_table,
    station_table,
    system_table,
)

INLINE_RESIDUALS = 10_000
"""Up to this many observations ``results.json`` repeats the residual table."""


def results(solved: Solved, residuals: pl.DataFrame, tables: dict[str, str]) -> dict[str, Any]:
    """Content of ``results.json``; ``tables`` names the files beside it."""
    inline = residuals.height <= INLINE_RESIDUALS
    return {
        **summary(solved),
        "points": point_table(solved).to_dicts(),
        "images": image_table(solved).to_dicts(),
        "cameras": interior_rows(solved),
        "stations": station_table(solved).to_dicts(),
        "systems": system_table(solved).to_dicts(),
        "pairs": pair_table(solved).to_dicts(),
        "features": feature_table(solved).to_dicts(),
        "others": other_rows(solved),
        "groups": group_table(solved).to_dicts(),
        "gross_errors": gross_errors(solved),
        "fixed_points": fixed_point_rows(solved),
        "checks": check_rows(solved),
        "tables": tables,
        "residuals": residuals.to_dicts() if inline else None,
    }


def to_json(data: dict[str, Any]) -> str:
    """JSON text: same data, same bytes."""
    return json.dumps(data, ensure_ascii=False, indent=1, allow_nan=False) + "\n"
