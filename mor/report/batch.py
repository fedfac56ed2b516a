"""The table of a batch of projects."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple
from xml.etree import ElementTree

from mor.errors import escaped
from mor.report.identity import schema_of
from mor.report.language import Words
from mor.report.layout import cells, table

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

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; color: #1a1a1a; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: right; padding: .3rem .7rem; border-bottom: 1px solid #ddd; vertical-align: top; }
th:first-child, td:first-child, th:nth-child(2), td:nth-child(2), td:last-child { text-align: left; }
tr.fails td:nth-child(2) { color: #a40000; font-weight: 600; }
td:last-child { color: #555; }
@media (prefers-color-scheme: dark) {
  body { background: #16181a; color: #e6e6e6; }
  th, td { border-color: #3a3d40; }
  tr.fails td:nth-child(2) { color: #ff8a80; }
  td:last-child { color: #aaa; }
  a { color: #8ab4f8; }
}
"""


def batch_page(rows: Sequence[BatchRow], words: Words) -> str:
    """One page with the table; each project leads to its report."""
    headers = ("project", "verdict", "n", "redundancy", "sigma0 [1]", "flagged", "uncontrolled", "differences")
    heads = "".join(f"<th>{escape(words.header(name))}</th>" for name in headers)
    lines = "\n".join(_line(row, words) for row in rows)
    said = escape(summary(rows, words))
    return (
        f'<!doctype html>\n<html lang="{words.language}">\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<title>{said}</title>\n<style>{_STYLE}</style>\n'
        f"<h1>{said}</h1>\n<table>\n<tr>{heads}<th></th></tr>\n{lines}\n</table>\n</html>\n"
    )


def _line(row: BatchRow, words: Words) -> str:
    file = "report.txt" if row.observations is not None else "log.txt"
    name = escape(escaped(row.name))
    numbers = cells(row._asdict(), "observations redundancy sigma0:.4g flagged uncontrolled", dash="")
    parts = [
        f'<a href="{escape(row.name, quote=True)}/{file}">{name}</a>',
        escape(words.listed(row.status)),
        *map(words.number, numbers),
        "" if row.differences in (None, -1) else str(row.differences),
        escape(escaped(reason(row, words))),
    ]
    kind = ' class="fails"' if row.fails else ""
    return f"<tr{kind}>{''.join(f'<td>{part}</td>' for part in parts)}</tr>"


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
