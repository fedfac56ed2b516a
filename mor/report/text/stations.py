"""Theodolite stations, local systems and stereo pairs."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.layout import ANGLE_DIGITS, DIGITS, fixed, heading, short, table
from mor.report.tables.estimates import pair_table, station_table, system_table
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One table for each kind that occurs."""
    parts = [
        _frames(
            words,
            solved,
            "Theodolite stations",
            station_table(solved),
            ("x", "y", "z", "orientation", "height"),
        ),
        _frames(
            words,
            solved,
            "Local systems",
            system_table(solved),
            ("x", "y", "z", "omega", "phi", "kappa", "scale"),
        ),
        _frames(
            words, solved, "Stereo pairs", pair_table(solved), ("bx", "by", "bz", "omega", "phi", "kappa")
        ),
    ]
    return "\n\n".join(part for part in parts if part)


def _frames(words: Words, solved: Solved, title: str, frame: pl.DataFrame, names: tuple[str, ...]) -> str:
    if frame.height == 0:
        return ""
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    angles = {"omega", "phi", "kappa", "orientation"}
    headers, rows = ["id"], [[str(name)] for name in frame["id"]]
    for name in names:
        for column in (name, f"s{name}"):
            if column not in frame.columns:
                continue
            unit_here = angle if name in angles else "1" if name == "scale" else unit
            headers.append(f"{column} [{unit_here}]")
            for row, value in zip(rows, frame[column], strict=True):
                row.append(
                    short(value, 9)
                    if name == "scale"
                    else fixed(value, ANGLE_DIGITS[angle] if name in angles else DIGITS[unit])
                )
    return f"{heading(words(title))}\n{table(headers, rows, words=words)}"
