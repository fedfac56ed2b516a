"""Observation groups with their estimated σ0."""

from __future__ import annotations

from mor.quality.solved import Solved
from mor.report.tables import group_table
from mor.report.text._layout import fixed, heading, table
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One line for each group."""
    if solved.quality is None:
        return ""
    rows = [
        [
            row["name"],
            row["type"],
            str(row["observations"]),
            fixed(row["redundancy"], 3),
            fixed(row["omega"], 3),
            fixed(row["sigma0"], 4),
            str(row["flagged"]),
        ]
        for row in group_table(solved).to_dicts()
    ]
    headers = ["group", "type", "n", "sum r", "vTPv", "sigma0 [1]", "flagged"]
    return f"{heading(words('Observation groups'))}\n{table(headers, rows, 2, words)}"
