"""The table of a batch, one row per project, as text and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from mor import __version__
from mor.report.layout import short, table
from mor.report.words.language import Words

SCHEMA = "mor-batch"
SCHEMA_VERSION = 1


class Row(NamedTuple):
    """Outcome of one project."""

    name: str
    status: str
    """accepted, flagged, rejected, not converged, singular, input, crashed, …"""
    code: int | None
    """Exit code of its adjustment; nothing if its process died."""
    reason: str
    """Why there is no solution; empty if there is one."""
    seconds: float
    observations: int | None = None
    unknowns: int | None = None
    redundancy: int | None = None
    sigma0: float | None = None
    """σ0 a posteriori / a priori."""
    flagged: int | None = None
    uncontrolled: int | None = None
    differences: int | None = None
    """Numbers that differ from those kept, −1 where there is nothing to compare; nothing if nobody asked."""
    first: str = ""
    """The largest of them."""

    @property
    def fails(self) -> bool:
        """True if its exit code is not 0, where it died, or where it differs from what was kept."""
        return self.code != 0 or bool(self.differences)


def batch_data(rows: Sequence[Row]) -> dict[str, Any]:
    """The table as plain data; no times, so that the same input gives the same bytes."""
    projects = []
    for row in rows:
        one = {**row._asdict(), "fails": row.fails}
        del one["seconds"]
        projects.append(one)
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "program": f"mor {__version__}",
        "count": len(rows),
        "failed": sum(row.fails for row in rows),
        "projects": projects,
    }


def batch_text(rows: Sequence[Row], words: Words) -> str:
    """The table as text, those that fail marked; then why."""
    compared = any(row.differences is not None for row in rows)
    headers = ["project", "verdict", "n", "redundancy", "sigma0 [1]", "flagged", "uncontrolled"]
    lines = [
        table(
            [*headers, *(["differences"] if compared else []), "result"],
            [_cells(row, compared, words) for row in rows],
            2,
            words,
            last_left=True,
        ),
        "",
        *(f"{row.name}: {why}" for row in rows if (why := reason(row, words))),
        summary(rows, words),
    ]
    return "\n".join(lines) + "\n"


def reason(row: Row, words: Words) -> str:
    """Why a project fails, in a few words; empty if there is nothing to say."""
    parts = [words.told(row.reason)] if row.reason else []
    if row.differences:
        parts.append(words.listed(row.first))
    return "; ".join(parts)


def summary(rows: Sequence[Row], words: Words) -> str:
    """Count the projects, and those that fail."""
    bad = sum(row.fails for row in rows)
    if not bad:
        return words("{count:project|projects}, none fails.", count=len(rows))
    return words("{count:project|projects}, {failed} FAIL.", count=len(rows), failed=bad)


def _cells(row: Row, compared: bool, words: Words) -> list[str]:
    numbers = (row.observations, row.redundancy)
    more = [("–" if row.differences in (None, -1) else str(row.differences))] if compared else []
    return [
        row.name,
        words.listed(row.status),
        *("-" if value is None else str(value) for value in numbers),
        "-" if row.sigma0 is None else short(row.sigma0, 4),
        *("-" if value is None else str(value) for value in (row.flagged, row.uncontrolled)),
        *more,
        words("FAILS") if row.fails else "",
    ]
