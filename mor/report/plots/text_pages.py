"""A text on pages of paper, as PDF: what is left where no browser prints the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mor.report.plots.sheet import style
from mor.report.words.language import ENGLISH, Words

PAPERS = {"A4": (8.27, 11.69), "Letter": (8.5, 11.0)}
"""Inches."""
_MARGIN = 0.75
_LINE = 0.142
"""Height of a line, inches."""
_SIZE = 7.2
"""Points: 100 signs of DejaVu Sans Mono are 6.0 inches."""


def write_text_pages(text: str, head: str, target: Path, paper: str, words: Words = ENGLISH) -> None:
    """Write a text as PDF, ``head`` and the number above and below each page: same text, same bytes.

    A heading (a line with a line of dashes below it) never stands last on a page. Raises :class:`mor.errors.InputError`
    where matplotlib is missing.
    """
    with style():
        from matplotlib.backends.backend_pdf import PdfPages
        from matplotlib.figure import Figure

        width, height = PAPERS[paper]
        lines = int((height - 2 * _MARGIN - 2 * _LINE) / _LINE)
        pages = paged(text.split("\n"), lines)
        metadata = {"CreationDate": None, "ModDate": None, "Creator": "mor", "Producer": "mor"}
        with PdfPages(target, metadata=metadata) as document:
            for number, page in enumerate(pages, 1):
                figure = Figure(figsize=(width, height))
                top, left = 1 - _MARGIN / height, _MARGIN / width
                small: dict[str, Any] = {"fontsize": _SIZE, "color": "#444444"}
                figure.text(left, top + _LINE / height, head, **small)
                below = f"{words('page')} {number} / {len(pages)}"
                figure.text(1 - left, 0.55 * _MARGIN / height, below, ha="right", **small)
                for k, line in enumerate(page):
                    y = top - (k + 1.5) * _LINE / height
                    figure.text(left, y, line, fontsize=_SIZE, family="DejaVu Sans Mono")
                document.savefig(figure)


def paged(lines: list[str], most: int) -> list[list[str]]:
    """Lines cut into pages of at most so many; a heading goes with at least three lines of what it heads."""
    pages, first = [], 0
    while first < len(lines):
        last = min(first + most, len(lines))
        if last < len(lines):
            for k in range(max(last - 5, first + 1), last):
                is_heading = set(lines[k + 1]) == {"-"} if k + 1 < len(lines) else False
                if is_heading and lines[k].strip():
                    last = k
                    break
        pages.append(lines[first:last])
        first = last
    return pages
