"""Columns and paragraphs of text that fit a page: 100 signs wide, whatever names and headings are in them."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Sequence

from mor.escapes import escaped

WIDTH = 100
_GAPS = ("  ", " ")
"""What stands between columns: the second where the first is too wide."""
_OF_UNIT = "\u2007["
"""A unit that stays with its quantity; figure spaces stand in no report."""
_NARROWEST = 12
"""Signs down to which a column of texts is narrowed before the table is cut into blocks."""


def drawn(
    headers: Sequence[str], rows: Sequence[Sequence[str]], left: Collection[int], margin: int = 0
) -> str:
    """Columns with a line under their headers; those of ``left`` hold texts, the others numbers.

    Columns are as wide as their widest cell and two wider than their header. Where that is too wide for a page, headers
    are broken at their blanks, but for the one before a unit; then texts are; then the columns are cut into blocks that
    all begin with the first one. ``margin``: blanks that every line begins with.
    """
    cells = [[escaped(cell.strip()) for cell in row] for row in (headers, *rows)]
    widest = [max((len(row[k]) for row in cells[1:]), default=0) for k in range(len(headers))]
    widths = [max(width, len(header) + 2) for width, header in zip(widest, cells[0], strict=True)]
    gap = _GAPS[0]
    page = WIDTH - margin
    if _total(widths) > page:
        cells[0] = [header.replace(" [", _OF_UNIT) for header in cells[0]]
        heads = [max(map(len, header.split(" "))) for header in cells[0]]
        widths = [max(pair) for pair in zip(widest, heads, strict=True)]
        gap = next((gap for gap in _GAPS if _total(widths, gap) <= page), gap)
        widths = _narrowed(widths, left, page) if gap == _GAPS[0] else widths
    text = "\n\n".join(
        _block(
            [[row[k] for k in block] for row in cells], [widths[k] for k in block], _within(block, left), gap
        )
        for block in _blocks(widths, gap, page)
    ).replace(_OF_UNIT, " [")
    return textwrap.indent(text, " " * margin)


def _total(widths: Sequence[int], gap: str = _GAPS[0]) -> int:
    return sum(widths) + len(gap) * (len(widths) - 1)


def _narrowed(widths: list[int], left: Collection[int], page: int) -> list[int]:
    """Widths with the columns of texts made narrower, the widest first, as far as the page wants it."""
    widths = list(widths)
    texts = [k for k in range(len(widths)) if k in left]
    while texts and _total(widths) > page:
        widest = max(texts, key=lambda k: widths[k])
        if widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    return widths


def _blocks(widths: Sequence[int], gap: str, page: int) -> list[list[int]]:
    """Numbers of the columns of each block; the first column stands in all of them."""
    blocks = [[0]]
    for k in range(1, len(widths)):
        if len(blocks[-1]) > 1 and _total([widths[i] for i in (*blocks[-1], k)], gap) > page:
            blocks.append([0])
        blocks[-1].append(k)
    return blocks


def _within(block: Sequence[int], left: Collection[int]) -> set[int]:
    return {place for place, k in enumerate(block) if k in left}


def _block(cells: Sequence[Sequence[str]], widths: Sequence[int], left: Collection[int], gap: str) -> str:
    lines = []
    for number, row in enumerate(cells):
        parts = [_broken(cell, width) for cell, width in zip(row, widths, strict=True)]
        height = max(map(len, parts))
        for part in parts:
            missing = [""] * (height - len(part))
            part[:] = [*missing, *part] if number == 0 else [*part, *missing]
        for line in zip(*parts, strict=True):
            lines.append(_line(line, widths, left, gap))
        if number == 0:
            lines.append(gap.join("-" * width for width in widths))
    return "\n".join(lines)


def _broken(cell: str, width: int) -> list[str]:
    return textwrap.wrap(cell, width, break_on_hyphens=False) if len(cell) > width else [cell]


def _line(cells: Sequence[str], widths: Sequence[int], left: Collection[int], gap: str) -> str:
    placed = [
        cell.ljust(width) if k in left else cell.rjust(width)
        for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]
    return gap.join(placed).rstrip()


_TIED = "\u2007=\u2007"
"""An equals sign that stays with what is on both of its sides."""
_LEAD = re.compile(r"\S.{0,38}?\s{2,}(?=\S)")
_MARK = re.compile(r"\s*(\d+\. )?")


def paragraphs(text: str) -> str:
    """Lines that are too long broken at blanks; the further ones stand below where their text began."""
    return "\n".join(_paragraph(line) for line in text.split("\n"))


def _paragraph(line: str) -> str:
    if len(line) <= WIDTH:
        return line
    lead = _LEAD.match(line)
    mark = _MARK.match(line)
    indent = lead.end() if lead else (mark.end() if mark else 0) + 2
    return textwrap.fill(
        line.replace(" = ", _TIED),
        WIDTH,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
        drop_whitespace=True,
    ).replace(_TIED, " = ")
