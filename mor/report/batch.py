"""The table of a batch of projects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

from markupsafe import Markup, escape

from mor.errors import escaped
from mor.report.identity import schema_of
from mor.report.language import Words
from mor.report.layout import cells, table
from mor.report.verification import page_table, plain_page

# ---- The table of a batch, one row per project, as text and as plain data.


class BatchRow(NamedTuple):
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


def batch_data(rows: Sequence[BatchRow]) -> dict[str, Any]:
    """The table as plain data; no times, so that the same input gives the same bytes."""
    projects = [
        {**{key: value for key, value in row._asdict().items() if key != "seconds"}, "fails": row.fails} for row in rows
    ]
    return {
        **schema_of("mor-batch", 1),
        "count": len(rows),
        "failed": sum(row.fails for row in rows),
        "projects": projects,
    }


def batch_text(rows: Sequence[BatchRow], words: Words) -> str:
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


def reason(row: BatchRow, words: Words) -> str:
    """Why a project fails, in a few words; empty if there is nothing to say."""
    parts = [words.told(row.reason)] if row.reason else []
    if row.differences:
        parts.append(words.listed(row.first))
    return "; ".join(parts)


def summary(rows: Sequence[BatchRow], words: Words) -> str:
    """Count the projects, and those that fail."""
    bad = sum(row.fails for row in rows)
    if not bad:
        return words("{count:project|projects}, none fails.", count=len(rows))
    return words("{count:project|projects}, {failed} FAIL.", count=len(rows), failed=bad)


def _cells(row: BatchRow, compared: bool, words: Words) -> list[str]:
    more = [("–" if row.differences in (None, -1) else str(row.differences))] if compared else []
    numbers = cells(row._asdict(), "observations redundancy sigma0:.4g flagged uncontrolled")
    return [row.name, words.listed(row.status), *numbers, *more, words("FAILS") if row.fails else ""]


# ---- The table of a batch as a page, and as JUnit XML for CI.


def batch_page(rows: Sequence[BatchRow], words: Words) -> str:
    """One page with the table; each project leads to its report."""
    headers = ("project", "verdict", "n", "redundancy", "sigma0 [1]", "flagged", "uncontrolled", "differences", "")
    lines = page_table("batch", map(words.header, headers), ((_line(row, words), row.fails) for row in rows), words)
    title = summary(rows, words)
    return plain_page(title, [f"<h1>{escape(title)}</h1>", lines], words)


def _line(row: BatchRow, words: Words) -> list[str]:
    file = "report.txt" if row.observations is not None else "log.txt"
    numbers = cells(row._asdict(), "observations redundancy sigma0:.4g flagged uncontrolled", dash="")
    return [
        Markup('<a href="{}/{}">{}</a>').format(row.name, file, escaped(row.name)),
        words.listed(row.status),
        *map(words.number, numbers),
        "" if row.differences in (None, -1) else str(row.differences),
        reason(row, words),
    ]


def junit_xml(rows: Sequence[BatchRow], words: Words) -> str:
    """JUnit XML: a test case for each project; a failure where it fails, an error where it crashed."""
    errors = [row for row in rows if row.fails and row.code in (None, 70)]
    failures = [row for row in rows if row.fails and row not in errors]
    suite = ElementTree.Element(
        "testsuite",
        name="mor batch",
        tests=str(len(rows)),
        failures=str(len(failures)),
        errors=str(len(errors)),
        time=f"{sum(row.seconds for row in rows):.3f}",
    )
    for row in rows:
        folder, _, name = row.name.rpartition("/")
        case = ElementTree.SubElement(
            suite, "testcase", classname=escaped(folder or "mor"), name=escaped(name), time=f"{row.seconds:.3f}"
        )
        if row.fails:
            kind = "error" if row in errors else "failure"
            message = escaped("; ".join(part for part in (words.listed(row.status), reason(row, words)) if part))
            ElementTree.SubElement(case, kind, message=message, type=row.status)
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"
