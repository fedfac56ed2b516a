"""Interior orientations with σ and correlations."""

from __future__ import annotations

from typing import Any

from mor.parameters.kinds import INTERIORS
from mor.quality.solved import Solved
from mor.report.tables import interior_rows
from mor.report.text._layout import fixed, heading, short, table


def section(solved: Solved) -> str:
    """One part for each camera."""
    parts = [_camera(row) for row in interior_rows(solved)]
    return "\n\n".join(parts)


def _camera(row: dict[str, Any]) -> str:
    unit = row["unit"]
    quantities = {c.name: c.quantity for c in INTERIORS[row["model"]].components}
    rows = [
        [
            name,
            quantities[name].unit("m", "rad", unit),
            short(c["value"], 10),
            short(c["sigma"], 4),
            fixed(c.get("t"), 1) if name != "c" else "-",
            c["status"],
        ]
        for name, c in row["components"].items()
    ]
    title = heading(f"Camera {row['id']} (model {row['model']})")
    lines = [title, table(["component", "unit", "value", "sigma", "value/sigma", "status"], rows, left=2)]
    if row["r0"] is not None:
        lines.append(f"r0 = {row['r0']} {unit}")
    names, matrix = row["correlations"]["components"], row["correlations"]["matrix"]
    if matrix is not None and len(names) > 1:
        body = [[name, *(fixed(matrix[i][j], 3) for j in range(i + 1))] for i, name in enumerate(names)]
        padded = [line + [""] * (len(names) + 1 - len(line)) for line in body]
        lines += ["", "Correlations [1]", table(["", *names], padded)]
    return "\n".join(lines)
