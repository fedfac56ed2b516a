"""The worst residuals first."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.text._layout import fixed, heading, short, table
from mor.report.words.language import ENGLISH, Words

SHOWN = 40


def section(solved: Solved, residuals: pl.DataFrame, words: Words = ENGLISH) -> str:
    """The observations with the largest |w|, and those that nothing controls."""
    if solved.quality is None:
        return ""
    worst = (
        residuals.with_row_index("row")
        .filter(pl.col("w").is_not_null())
        .sort([pl.col("w").abs().round(6), pl.col("row")], descending=[True, False])
        .head(SHOWN)
    )
    parts = [
        heading(
            words("Worst residuals first (|w| > {limit} is flagged)", limit=fixed(solved.quality.critical, 2))
        ),
        _table(worst, words),
    ]
    loose = residuals.filter(pl.col("flag") == "uncontrolled")
    if loose.height:
        parts += [
            "",
            heading(words("Observations that nothing controls (r = 0: no test is possible)")),
            _table(loose.head(SHOWN), words),
        ]
        if loose.height > SHOWN:
            parts.append(words("and {count} more in the table of residuals", count=loose.height - SHOWN))
    return "\n".join(parts)


def _table(frame: pl.DataFrame, words: Words) -> str:
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
    return table(headers, rows, 4, words)
