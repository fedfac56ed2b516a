"""Check points and check distances."""

from __future__ import annotations

from typing import Any

from mor.quality.solved import Solved
from mor.report.layout import heading, short, table
from mor.report.tables.checks import check_rows, largest_length_error
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """Deviations of what was kept out, by group and component."""
    return section_of(check_rows(solved), solved.network.project.units.length, words)


def section_of(checks: list[dict[str, Any]], unit: str, words: Words) -> str:
    """The same of checks as :func:`mor.report.tables.checks.check_rows` has them, and a unit of lengths."""
    rows = [
        [
            row["group"],
            row["component"],
            row["unit"],
            str(row["count"]),
            *(short(row[key], 4) for key in ("mean", "rms", "largest")),
            str(row["exceeding"]),
        ]
        for row in checks
    ]
    if not rows:
        return ""
    headers = ["checks", "component", "unit", "n", "mean", "rms", "largest", "beyond test"]
    lines = [
        heading(words("Checks, kept out of the adjustment (adjusted - known)")),
        table(headers, rows, 3, words),
    ]
    error = largest_length_error(checks)
    if error is not None:
        lines.append(
            words(
                "Largest length measurement error (in the manner of VDI/VDE 2634): {error} {unit}",
                error=short(error, 4),
                unit=unit,
            )
        )
    return "\n".join(lines)
