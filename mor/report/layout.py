"""Headings and tables of the text report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.report.columns import WIDTH, drawn
from mor.report.words.language import ENGLISH, Words

DIGITS = {"m": 5, "mm": 4, "cm": 4, "dm": 5, "um": 2, "km": 8, "ft": 5, "us-ft": 5, "in": 4}
ANGLE_DIGITS = {"gon": 5, "deg": 6, "rad": 8, "mrad": 5, "mgon": 3}


def heading(title: str) -> str:
    """A section heading, in the words of its language."""
    return f"{title}\n{'-' * min(len(title), WIDTH)}"


ALL = 1_000_000_000
"""Rows of a section of which nothing is left out."""
LISTED = ("status", "flag", "action", "kind")
"""Columns that hold words of the program, not names of the user."""


def table(
    headers: Sequence[str],
    rows: Sequence[Sequence[str]],
    left: int = 1,
    words: Words = ENGLISH,
    last_left: bool = False,
    margin: int = 0,
) -> str:
    """A table of texts: the first ``left`` columns, and the last where wanted, to the left, numbers to the right."""
    texts = {*range(left), *([len(headers) - 1] if last_left else [])}
    rows = [
        [
            words.listed(cell) if header in LISTED else cell if k in texts else words.number(cell)
            for k, (header, cell) in enumerate(zip(headers, row, strict=True))
        ]
        for row in rows
    ]
    return drawn([words.header(header) for header in headers], rows, texts, margin)


def fixed(value: float | None, digits: int) -> str:
    """A number with fixed decimals; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def digits_worth(value: float, sigma: float | None) -> int:
    """Significant digits of a value that its σ makes worth printing: to about a hundredth of it."""
    if sigma is None or not sigma > 0.0 or value == 0.0:
        return 10
    return int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(sigma)) + 3, 3, 10))


def sigma_decimals(sigmas: FloatArray, digits: int = 2) -> int:
    """Decimals with which nearly every one of some σ has so many digits: one number for a whole column."""
    known = np.sort(sigmas[np.isfinite(sigmas) & (sigmas > 0.0)])
    if not len(known):
        return digits
    small = known[int(0.1 * len(known))]
    return int(np.clip(digits - 1 - np.floor(np.log10(small)), 0, 9))


def short(value: float | None, digits: int = 6) -> str:
    """A number with significant digits; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def in_words(row: dict[str, Any], words: Words) -> str:
    """Return the name of an observation: its type, its point and station names, and its component."""
    names = ", ".join(f"{words.listed(key)} {name}" for key, name in row["names"].items())
    type_ = "" if next(iter(row["names"]), "") == row["type"] else f"{row['type']} "
    return f"{type_}{names}{component_of(row)}"


def component_of(row: dict[str, Any]) -> str:
    """The component after a comma; nothing if it is the type once more, as of a distance."""
    return "" if row["component"] == row["type"] else f", {row['component']}"
