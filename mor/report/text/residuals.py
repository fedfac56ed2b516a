"""The worst residuals first."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.text._layout import fixed, heading, short, table

SHOWN = 40


def section(solved: Solved, residuals: pl.DataFrame) -> str:
    """The observations with the largest |w|, and those that nothing controls."""
    if solved.quality is None:
        return ""
    worst = (
        residuals.with_row_index("row")
        .filter(pl.col("w").is_not_null())
        .sort([pl.col("w").abs(), pl.col("row")], descending=[True, False])
        .head(SHOWN)
    )
    parts = [
        heading(f"Worst residuals first (|w| > {solved.quality.critical:.2f} is flagged)"),
        _table(worst),
    ]
    loose = residuals.filter(pl.col("flag") == "uncontrolled")
    if loose.height:
        parts += [
            "",
            heading("Observations that nothing controls (r = 0: no test is possible)"),
            _table(loose.head(SHOWN)),
        ]
        if loose.height > SHOWN:
            parts.append(f"and {loose.height - SHOWN} more in the table of residuals")
    return "\n".join(parts)


def _table(frame: pl.DataFrame) -> str:
    rows = [
        [
            row["type"],
            " ".join(part for part in (row["at"], row["from"], row["to"]) if part),
            row["component"],
            row["unit"],
            short(row["observed"], 9),
            short(row["v"], 4),
            short(row["sigma"], 3),
            fixed(row["r"], 3),
            fixed(row["w"], 2),
            row["flag"],
        ]
        for row in frame.to_dicts()
    ]
    headers = ["type", "between", "component", "unit", "observed", "v", "sigma", "r [1]", "w [1]", "flag"]
    return table(headers, rows, left=4)
