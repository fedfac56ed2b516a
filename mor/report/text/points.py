"""Points with σ, error ellipsoids and rays."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.quality.solved import Solved
from mor.report.layout import DIGITS, fixed, heading, table
from mor.report.tables.estimates import point_table
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

SHOWN = 2000
"""Points a text report lists; the full table stands beside it."""


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """One line for each point."""
    frame = point_table(solved)
    if frame.height == 0:
        return ""
    unit = solved.network.project.units.length
    d = DIGITS[unit]
    datum = datum_name(solved.adjustment.problem.datum.name, words)
    lines = [
        heading(words("Points (datum: {datum})", datum=datum)),
        listed(frame.head(shown), unit, words),
    ]
    if frame.height > shown:
        lines.append(
            words("{count:more point is|more points are} in the table of points.", count=frame.height - shown)
        )
    if solved.quality is not None:
        free = frame.select("sx", "sy", "sz").filter(frame["status"].is_in(["free", "partly fixed"]))
        if free.height:
            rms = [float(np.sqrt(np.nanmean(free[f"s{n}"].to_numpy() ** 2))) for n in "xyz"]
            lines.append(
                words("Root mean square sigma [{unit}]: ", unit=unit)
                + ", ".join(
                    f"{n.upper()} {words.number(fixed(value, d))}"
                    for n, value in zip("xyz", rms, strict=True)
                )
            )
    return "\n".join(lines)


def listed(frame: pl.DataFrame, unit: str, words: Words) -> str:
    """The rows of a table of points, lengths in a unit."""
    d = DIGITS[unit]
    rows = []
    for row in frame.to_dicts():
        coordinates = [fixed(row[name], d) for name in ("x", "y", "z", "sx", "sy", "sz", "ellipsoid_a")]
        rows.append([row["id"], *coordinates, str(row["rays"]), str(row["others"]), row["status"]])
    names = ("X", "Y", "Z", "sX", "sY", "sZ", "ellipsoid a")
    headers = ["point", *(f"{name} [{unit}]" for name in names), "rays", "others", "status"]
    return table(headers, rows, words=words)
