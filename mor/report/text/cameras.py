"""Interior orientations with σ and correlations."""

from __future__ import annotations

from typing import Any

from mor.parameters.kinds import INTERIORS
from mor.quality.solved import Solved
from mor.report.layout import digits_worth, fixed, heading, short, table
from mor.report.tables.estimates import interior_rows
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One part for each camera."""
    parts = [_camera(row, words) for row in interior_rows(solved)]
    return "\n\n".join(parts)


def _camera(row: dict[str, Any], words: Words) -> str:
    unit = row["unit"]
    quantities = {c.name: c.quantity for c in INTERIORS[row["model"]].components}
    rows = [
        [
            name,
            quantities[name].unit("m", "rad", unit),
            short(c["value"], digits_worth(c["value"], c["sigma"])),
            short(c["sigma"], 4),
            fixed(c.get("t"), 1) if name != "c" else "-",
            c["status"],
        ]
        for name, c in row["components"].items()
    ]
    title = heading(words("Camera {id} (model {model})", id=row["id"], model=row["model"]))
    lines = [title, table(["component", "unit", "value", "sigma", "value/sigma", "status"], rows, 2, words)]
    if row["r0"] is not None:
        lines.append(f"r0 = {words.number(format(row['r0'], '.6g'))} {unit}")
    names, matrix = row["correlations"]["components"], row["correlations"]["matrix"]
    if matrix is not None and len(names) > 1:
        body = [[name, *(fixed(matrix[i][j], 3) for j in range(i + 1))] for i, name in enumerate(names)]
        padded = [line + [""] * (len(names) + 1 - len(line)) for line in body]
        lines += ["", words("Correlations [1]"), table(["", *names], padded, words=words)]
    return "\n".join(lines)
