"""Instruments, heights, eccentricities and image-variant interiors that were estimated."""

from __future__ import annotations

from mor.parameters.kinds import KINDS
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.layout import heading, short, table
from mor.report.parameters import other_rows
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One line for each component."""
    units = solved.network.project.units
    image_unit = next((scale.unit for scale in solved.network.scales.values()), "mm")
    rows = []
    for other in other_rows(solved):
        quantities = {c.name: c.quantity for c in KINDS[other["kind"]].components}
        for name, component in other["components"].items():
            unit = quantities[name].unit(units.length, angle_unit(solved), image_unit)
            rows.append(
                [
                    other["kind"],
                    other["id"],
                    name,
                    unit,
                    short(component["value"], 9),
                    short(component["sigma"], 4),
                ]
            )
    if not rows:
        return ""
    headers = ["kind", "block", "component", "unit", "value", "sigma"]
    return f"{heading(words('Other parameters'))}\n{table(headers, rows, 4, words)}"
