"""The worst residuals first."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.layout import fixed, heading, short, table
from mor.report.tables.observations import observation_table
from mor.report.tables.worst import uncontrolled_residuals, worst_residuals
from mor.report.words.language import ENGLISH, Words

SHOWN = 40


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """The observations with the largest |w|, and those that hardly anything controls."""
    if solved.quality is None:
        return ""
    limit, least = fixed(solved.quality.critical, 2), f"{solved.quality.levels.least_redundancy:g}"
    parts = [
        heading(words("Worst residuals first (|w| > {limit} is flagged)", limit=limit)),
        rows_of(worst_residuals(solved, SHOWN), words),
    ]
    loose, count = uncontrolled_residuals(solved, SHOWN)
    if count:
        parts += [
            "",
            heading(words("Observations that hardly anything controls (r < {limit})", limit=least)),
            rows_of(loose, words),
        ]
        if count > SHOWN:
            parts.append(words("and {count} more in the table of residuals", count=count - SHOWN))
    return "\n".join(parts)


def listed(solved: Solved, words: Words = ENGLISH) -> str:
    """All observations in the order of the input, those that were kept out among them."""
    if solved.quality is None:
        return ""
    return "\n".join([heading(words("All observations")), rows_of(observation_table(solved), words)])


_ROUND_OFF = 1e-9
"""Residuals below this share of their σ are round-off, which differs from machine to machine."""


def _without_round_off(v: float | None, sigma: float | None) -> float | None:
    return 0.0 if v is not None and sigma and abs(v) < _ROUND_OFF * sigma else v


def rows_of(frame: pl.DataFrame, words: Words) -> str:
    """Rows of the table of residuals."""
    rows = [
        [
            row["type"],
            " ".join(part for part in (row["at"], row["from"], row["to"]) if part),
            row["component"],
            row["unit"],
            short(row["observed"], 9),
            short(_without_round_off(row["v"], row["sigma"]), 4),
            short(row["sigma"], 3),
            fixed(row["r"], 3),
            fixed(row["w"], 2),
            row["flag"],
        ]
        for row in frame.to_dicts()
    ]
    headers = ["type", "between", "component", "unit", "observed", "v", "sigma", "r [1]", "w [1]", "flag"]
    return table(headers, rows, 4, words)
