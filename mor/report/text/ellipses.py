"""Error ellipses of points and of pairs of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mor.project.file.model import Project
from mor.quality.precision.ellipses import confidence_factor
from mor.quality.solved import Solved
from mor.report.edge import angle_unit, angle_unit_of
from mor.report.layout import DIGITS, fixed, heading, table
from mor.report.tables.ellipses import (
    chosen_pairs,
    ellipse_table,
    free_points,
    neighbouring_pairs,
    relative_rows,
)
from mor.report.words.language import ENGLISH, Words

NEIGHBOURS = 2000
"""Points of which a full report pairs each with its nearest."""


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One line for each point with unknowns: the ellipse in plan; in three dimensions also the ellipsoid."""
    dimensions = solved.network.project.settings.dimensions
    if len(free_points(solved)) == 0 or dimensions == "z":
        return ""
    rows = ellipse_table(solved).to_dicts()
    lines = [
        heading(words("Error ellipses")),
        _explained(solved, words),
        plan(rows, solved.network.project, words),
    ]
    if dimensions == "xyz":
        lines += ["", _space(solved, rows, words)]
    return "\n".join(lines)


def plan(rows: Sequence[Mapping[str, Any]], project: Project, words: Words) -> str:
    """The ellipses in plan of points: ``id``, ``a``, ``b`` and ``azimuth``."""
    length, angle = project.units.length, angle_unit_of(project)
    headers = ["point", f"a [{length}]", f"b [{length}]", f"azimuth of a [{angle}]"]
    d = DIGITS[length]
    cells = [[row["id"], fixed(row["a"], d), fixed(row["b"], d), fixed(row["azimuth"], 1)] for row in rows]
    return table(headers, cells, words=words)


def _space(solved: Solved, rows: list[dict[str, Any]], words: Words) -> str:
    length, angle = solved.network.project.units.length, angle_unit(solved)
    headers = [
        "point",
        *("axis 1", "azimuth 1", "elevation 1"),
        *("axis 2", "azimuth 2", "elevation 2"),
        *("axis 3", "azimuth 3", "elevation 3"),
    ]
    d = DIGITS[length]
    cells = [
        [
            row["id"],
            *(
                fixed(row[f"{name}{k}"], digits)
                for k in (1, 2, 3)
                for name, digits in (("axis", d), ("azimuth", 1), ("elevation", 1))
            ),
        ]
        for row in rows
    ]
    units = words(
        "Ellipsoids: axes in {length}, azimuths and elevations in {angle}.", length=length, angle=angle
    )
    return f"{units}\n{table(headers, cells, words=words)}"


def relative(solved: Solved, words: Words = ENGLISH, neighbours: bool = False) -> str:
    """One line for each pair of points asked for; where none is, for ``neighbours`` if wanted."""
    pairs = chosen_pairs(solved)
    neighbours = neighbours and len(pairs) == 0
    rows = relative_rows(solved, neighbouring_pairs(solved, NEIGHBOURS) if neighbours else pairs)
    if not rows:
        return ""
    length, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[length]
    headers = [
        *("from", "to", f"distance [{length}]", f"sdistance [{length}]"),
        *(f"a [{length}]", f"b [{length}]", f"azimuth [{angle}]", f"sdz [{length}]"),
    ]
    lines = [
        [
            row["from"],
            row["to"],
            *(fixed(row[name], d) for name in ("distance", "sdistance", "a", "b")),
            fixed(row["azimuth"], 1),
            fixed(row["sdz"], d),
        ]
        for row in rows
    ]
    title = words("Distances and relative error ellipses")
    which = words("Every point with its nearest neighbour.") if neighbours else ""
    said = [heading(title), which, table(headers, lines, 2, words)]
    return "\n".join(line for line in said if line)


def _explained(solved: Solved, words: Words) -> str:
    quality = solved.quality
    assert quality is not None
    estimated = solved.network.project.settings.sigma == "aposteriori" and quality.redundancy > 0
    redundancy = float(quality.redundancy) if estimated else None
    factors = [f"{confidence_factor(k, redundancy):.2f}" for k in (2, 3)]
    return words(
        "Semi-axes at 1 sigma; times {plan} the ellipse holds the point with 95 %, times {space} the ellipsoid.",
        plan=words.number(factors[0]),
        space=words.number(factors[1]),
    )
