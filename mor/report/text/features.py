"""Planes, lines and right angles."""

from __future__ import annotations

from mor.quality.solved import Solved
from mor.report.layout import DIGITS, fixed, heading, table
from mor.report.tables.features import feature_table
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One line for each plane and line."""
    frame = feature_table(solved)
    if frame.height == 0 or solved.quality is None:
        return ""
    unit = solved.network.project.units.length
    d = DIGITS[unit]
    rows = [
        [
            f"{words.listed(row['type'])} {row['id']}"
            + (f", {words.listed(row['part'])}" if row["part"] else ""),
            *(fixed(row[name], 7) for name in ("dx", "dy", "dz")),
            *(fixed(row[name], d) for name in ("distance", "x", "y", "z")),
            str(row["points"]),
            fixed(row["rms"], d),
        ]
        for row in frame.to_dicts()
    ]
    lengths = [f"{name} [{unit}]" for name in ("distance", "X", "Y", "Z")]
    headers = ["feature", *(f"{n} [1]" for n in ("dX", "dY", "dZ")), *lengths, "points", f"rms [{unit}]"]
    note = words("d: normal of a plane, direction of a line; X Y Z: mean of the points on it")
    return f"{heading(words('Planes and lines'))}\n{table(headers, rows, words=words)}\n{note}"
