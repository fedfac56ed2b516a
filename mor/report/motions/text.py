"""Movements of points: what moves them, with tests, and how far each has moved from its first to its last epoch."""

from __future__ import annotations

from typing import Any, NamedTuple

import polars as pl

from mor.quality.solved import Solved
from mor.report.html.figures.layout import small_unit
from mor.report.layout import fixed, heading, short, table
from mor.report.motions.table import PER, found_movements, motion_table, movement_rows
from mor.report.words.language import ENGLISH, Words

SHOWN = 200
"""Rows of each table that a text report lists; the tables beside it have all."""
_LEAST_P = 1e-4


class Listed(NamedTuple):
    """A table as texts."""

    headers: list[str]
    rows: list[list[str]]
    left: int
    """Columns of texts at the beginning."""
    left_out: str
    """Words for the rows that stand elsewhere."""


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """Return the motion models of the points and the estimated movements as text."""
    if found_movements(solved) is None:
        return ""
    lines = [heading(words("Movements of points")), *statements(solved, words)]
    for part in (listed_parameters(solved, words, shown), listed_movements(solved, words, shown)):
        if part.rows:
            lines += ["", table(part.headers, part.rows, part.left, words, last_left=True)]
            lines += [part.left_out] if part.left_out else []
    return "\n".join(lines)


def statements(solved: Solved, words: Words) -> list[str]:
    """Return the tests and their results as text."""
    found, motion = found_movements(solved), solved.network.motion
    assert found is not None
    order, parameters, between = motion.in_order, found.parameters, found.between
    lines = [
        words(
            "{count:epoch|epochs} from {first} to {last}; coordinates of points with a velocity or an oscillation are "
            "those of {reference}.",
            count=len(order),
            first=motion.labels[order[0]],
            last=motion.labels[order[-1]],
            reference=f"{motion.reference:.4f}",
        )
    ]
    if parameters.names:
        lines.append(
            words(
                "{count:test|tests} of velocities, oscillations and steps; all together reject by mistake with "
                "{overall}, each with {level} (Sidak): {moved} significant.",
                count=len(parameters.names),
                overall=f"{solved.network.project.settings.global_level:g}",
                level=f"{found.level:.2g}",
                moved=int(parameters.significant.sum()),
            )
        )
    if between.names:
        lines.append(
            words(
                "{count:test|tests} of movements since the first epoch of each point, each with {level}: {moved} "
                "significant.",
                count=len(between.names),
                level=f"{found.level_between:.2g}",
                moved=int(between.significant.sum()),
            )
        )
    if found.unlisted:
        lines.append(
            words(
                "Movements of {count:point|points} with coordinates of each epoch are not worked out here; "
                "mor compare --between does so for two epochs.",
                count=found.unlisted,
            )
        )
    return lines


def listed_parameters(solved: Solved, words: Words, shown: int) -> Listed:
    """A line for each velocity and step, two for an annual oscillation."""
    frame = motion_table(solved)
    headers = [
        "point",
        "parameter",
        "unit",
        "X",
        "Y",
        "Z",
        "sX",
        "sY",
        "sZ",
        "test [1]",
        "p",
        "nabla",
        "verdict",
    ]
    if frame.height == 0:
        return Listed(headers, [], 3, "")
    said, factor = _unit(solved, frame)
    rows = []
    for row in _most_first(frame, shown):
        waves = row["parameter"] == "annual oscillation"
        name = words("annual" if waves else row["parameter"])
        name = words("step at {time}", time=row["time"]) if row["time"] else name
        unit = f"{said}{PER[row['parameter']]}"
        nabla = "-" if row["smallest"] is None else short(row["smallest"] * factor, 3)
        tests = [fixed(row["test"], 2), _p(row["p"]), nabla, words("moves") if row["moved"] else ""]
        rows.append([row["point"], f"{name} sin" if waves else name, unit, *_cells(row, "", factor), *tests])
        if waves:
            rows.append([row["point"], f"{name} cos", unit, *_cells(row, "cos_", factor), "", "", "", ""])
    return Listed(headers, rows, 3, _left_out(frame.height, shown, "motions", words))


def listed_movements(solved: Solved, words: Words, shown: int) -> Listed:
    """A line for each point: its movement from its first to its last epoch."""
    frame = movement_rows(solved)
    if frame.height == 0:
        return Listed([], [], 3, "")
    last = frame.group_by("point", maintain_order=True).last()
    said, factor = _unit(solved, last)
    rows = []
    for row in _most_first(last, shown):
        tests = [fixed(row["test"], 2), _p(row["p"]), words("moved") if row["moved"] else ""]
        rows.append([row["point"], row["from"], row["to"], *_cells(row, "", factor), *tests])
    units = [f"{name} [{said}]" for name in ("dX", "dY", "dZ", "sdX", "sdY", "sdZ")]
    headers = ["point", "from", "to", *units, "test [1]", "p", "verdict"]
    return Listed(headers, rows, 3, _left_out(last.height, shown, "movements", words))


def _left_out(count: int, shown: int, name: str, words: Words) -> str:
    if count <= shown:
        return ""
    return words("{count:more row is|more rows are} in the table {name}.", count=count - shown, name=name)


def _most_first(frame: pl.DataFrame, shown: int) -> list[dict[str, Any]]:
    """Rows as they stand; of many, the most significant ones."""
    if frame.height <= shown:
        return frame.to_dicts()
    return frame.sort("p", nulls_last=True, maintain_order=True).head(shown).to_dicts()


def _unit(solved: Solved, frame: pl.DataFrame) -> tuple[str, float]:
    """Unit that movements are said in, and how many of it are in one of the project."""
    sizes = [float(frame[name].abs().max() or 0.0) for name in ("x", "y", "z")]  # type: ignore[arg-type]
    said, factor = small_unit(solved.network.project.units.length, max(sizes) or 1.0)
    return said.replace("µ", "u"), factor


def _cells(row: dict[str, Any], part: str, factor: float) -> list[str]:
    values = [row[f"{s}{part}{axis.lower()}"] for s in ("", "s") for axis in "XYZ"]
    return ["-" if value is None else fixed(value * factor, 3) for value in values]


def _p(value: float | None) -> str:
    return "-" if value is None else "<0.0001" if value < _LEAST_P else fixed(value, 4)
