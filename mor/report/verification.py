"""The report of ``mor verify``: plain data, and from these a text and a page."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup, escape
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from mor.errors import escaped
from mor.report.identity import EPOCH, schema_of
from mor.report.language import Words
from mor.report.layout import aligned, cells, short, table


class ReferenceCheck(NamedTuple):
    """Numbers of one kind against their reference values; the one that comes nearest to its limit stands for all."""

    group: str
    name: str
    quantity: str
    source: str
    place: str
    """Which of the numbers is given here, or why the check could not be carried out."""
    numbers: int
    """Numbers that were compared."""
    reference: float
    found: float
    """NaN if there is no result."""
    limit: float
    """Largest difference that is allowed, in the unit of the number."""

    @property
    def difference(self) -> float:
        """Found − reference."""
        return self.found - self.reference

    @property
    def share(self) -> float:
        """Difference in units of the limit; infinite if there is no result."""
        if not math.isfinite(self.found):
            return math.inf
        size = abs(self.difference)
        return size / self.limit if self.limit > 0.0 else math.inf if size > 0.0 else 0.0

    @property
    def passed(self) -> bool:
        """True if the difference is within its limit."""
        return self.share <= 1.0


def verification_data(checks: Iterable[ReferenceCheck]) -> dict[str, Any]:
    """The checks as plain data, with program, libraries, machine and time (UTC, or ``SOURCE_DATE_EPOCH``)."""
    rows = [
        {
            **{key: _finite(value) for key, value in one._asdict().items()},
            "difference": _finite(one.difference),
            "share_of_limit": _finite(one.share),
            "passed": one.passed,
        }
        for one in checks
    ]
    given = os.environ.get(EPOCH)
    now = datetime.fromtimestamp(float(given), UTC) if given else datetime.now(UTC)
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    libraries = ("numpy", "scipy", "polars", "pydantic", "numba", "pyproj")
    return {
        **schema_of("mor-verification", 1),
        "date": now.isoformat(timespec="seconds"),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "libraries": {name: found for name in libraries if (found := _version(name))},
        "linear_algebra": sorted(
            {
                " ".join(str(one[key]) for key in ("internal_api", "version", "architecture") if one.get(key))
                for one in threadpool_info()
                if one["user_api"] == "blas"
            }
        ),
        "system": platform.platform(),
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "processors": os.cpu_count(),
        "count": len(rows),
        "compared": sum(row["numbers"] for row in rows),
        "failed": sum(not row["passed"] for row in rows),
        "checks": rows,
    }


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


# ---- Text and page.


def verdict(data: dict[str, Any], words: Words) -> str:
    """In one sentence: whether all checks have passed."""
    if not data["failed"]:
        said = "All {count} checks passed; {compared} numbers were compared."
        return words(said, count=data["count"], compared=data["compared"])
    return words("{failed} of {count} checks FAILED.", failed=data["failed"], count=data["count"])


def _head(data: dict[str, Any], words: Words) -> list[tuple[str, str]]:
    libraries = [f"{name} {number}" for name, number in data["libraries"].items()]
    return [
        (words("program"), f"{data['program']}, {data['python']}"),
        (words("libraries"), ", ".join([*libraries, *data["linear_algebra"]])),
        (words("machine"), f"{data['processor']} ({data['processors']}), {data['system']}"),
        (words("date"), data["date"]),
    ]


def _groups(data: dict[str, Any], words: Words) -> list[list[str]]:
    rows = []
    for name, members in groupby(data["checks"], key=lambda row: row["group"]):
        checks = list(members)
        shares = [row["share_of_limit"] for row in checks]
        failed = sum(not row["passed"] for row in checks)
        largest = None if None in shares else max(shares)
        numbers = (len(checks), sum(row["numbers"] for row in checks), failed)
        rows.append([words.listed(name), *map(str, numbers), short(largest, 2)])
    return rows


_GROUP_HEADERS = ("kind of check", "count", "numbers", "failed", "largest share of the limit")
_HEADERS = ("quantity", "numbers", "reference", "found", "difference", "limit", "where", "result")


def _row(row: dict[str, Any], words: Words) -> list[str]:
    said = cells(row, "numbers reference:.12g found:.12g difference:.2g limit:.2g place")
    return [words.listed(row["quantity"]), *said, words("passed") if row["passed"] else words("FAILED")]


def verification_text(data: dict[str, Any], words: Words, everything: bool = True) -> str:
    """The report as text: a summary, and all checks or those that failed."""
    lines = [words("Verification of this installation"), "", *aligned(_head(data, words)), ""]
    lines += [table(_GROUP_HEADERS, _groups(data, words), 1, words), ""]
    shown = [row for row in data["checks"] if everything or not row["passed"]]
    for (name, source), rows in groupby(shown, key=lambda row: (row["name"], row["source"])):
        lines += [f"{words.listed(name)}: {words.listed(source)}"]
        for row in rows:
            quantity, count, *numbers, place, result = _row(row, words)
            said = (
                f"{words(label)} {words.number(number)}" for label, number in zip(_HEADERS[2:6], numbers, strict=True)
            )
            lines += [f"  {result}  {quantity} ({count}): {', '.join(said)}{f' ({place})' if place else ''}"]
        lines += [""]
    return "\n".join(escaped(line) for text in [*lines, verdict(data, words)] for line in text.split("\n")) + "\n"


_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 2rem auto; max-width: 85rem; padding: 0 1rem; color: #1a1a1a; }
table { border-collapse: collapse; width: 100%; margin: 0 0 1.5rem; }
th, td { text-align: right; padding: .2rem .6rem; border-bottom: 1px solid #ddd; vertical-align: top; }
th:first-child, td:first-child, .checks td:nth-child(n+7), .batch td:last-child { text-align: left; }
.batch th:nth-child(2), .batch td:nth-child(2) { text-align: left; }
tr.fails td { color: #a40000; font-weight: 600; }
@media (prefers-color-scheme: dark) {
  body { background: #16181a; color: #e6e6e6; }
  th, td { border-color: #3a3d40; }
  tr.fails td { color: #ff8a80; }
  a { color: #8ab4f8; }
}
"""


def verification_page(data: dict[str, Any], words: Words) -> str:
    """The report as one page without scripts."""
    parts = [
        f"<h1>{escape(words('Verification of this installation'))}</h1>",
        f"<p><strong>{escape(verdict(data, words))}</strong></p>",
        page_facts(_head(data, words)),
        page_table("", map(words, _GROUP_HEADERS), ((row, int(row[3]) > 0) for row in _groups(data, words)), words),
    ]
    for group, members in groupby(data["checks"], key=lambda row: row["group"]):
        parts.append(f"<h2>{escape(words.listed(group))}</h2>")
        for (name, source), rows in groupby(members, key=lambda row: (row["name"], row["source"])):
            title = f"<b>{escape(words.listed(name))}</b>: {escape(words.listed(source))}"
            cells = ((_row(row, words), not row["passed"]) for row in rows)
            parts += [f"<p>{title}</p>", page_table("checks", map(words, _HEADERS), cells, words)]
    return plain_page(verdict(data, words), parts, words)


def plain_page(title: str, parts: Iterable[str], words: Words) -> str:
    """A page of HTML parts."""
    head = (
        f'<!doctype html>\n<html lang="{words.language}">\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<title>{escape(title)}</title>\n<style>{_STYLE}</style>'
    )
    return "\n".join([head, *parts, "</html>\n"])


def page_facts(facts: Iterable[tuple[str, str]]) -> str:
    """Names and texts as a table."""
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(escaped(text))}</td></tr>" for name, text in facts)
    return "\n".join(["<table>", *rows, "</table>"])


def page_table(kind: str, headers: Iterable[str], rows: Iterable[tuple[list[str], bool]], words: Words) -> str:
    """Rows of texts, or of HTML, as a table, those that failed marked."""
    heads = "".join(f"<th>{escape(name)}</th>" for name in headers)

    def said(cell: str) -> str:
        return cell if isinstance(cell, Markup) else escape(escaped(words.number(cell)))

    lines = (
        f"<tr{' class=fails' if failed else ''}>" + "".join(f"<td>{said(cell)}</td>" for cell in cells) + "</tr>"
        for cells, failed in rows
    )
    return f'<table class="{kind}">\n<tr>{heads}</tr>\n' + "\n".join(lines) + "\n</table>"
