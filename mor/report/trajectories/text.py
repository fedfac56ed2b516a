"""Trajectories: how they are interpolated, their knots with σ, misalignments of inertial systems."""

from __future__ import annotations

import polars as pl

from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.layout import ANGLE_DIGITS, DIGITS, fixed, heading, table
from mor.report.trajectories.table import POSE, boresight_rows, knot_table
from mor.report.words.language import ENGLISH, Words

SHOWN = 40
"""Knots that a text report lists; the table beside it has all."""
_TIME_DIGITS = 3


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """A line for each trajectory, tables of the knots and of the misalignments."""
    trajectories = solved.network.trajectories
    if not trajectories:
        return "\n".join(_boresights(solved, words)[1:])
    lines = [heading(words("Trajectories"))]
    for name, found in trajectories.items():
        said = words("cubic interpolation") if found.cubic else words("linear interpolation")
        lines.append(
            words(
                "{name}: {said}, {count:knot|knots} from {first} s to {last} s",
                name=name,
                said=said,
                count=len(found.times),
                first=f"{found.times[0]:.12g}",
                last=f"{found.times[-1]:.12g}",
            )
        )
        stretches = int(found.stretch[-1]) + 1
        if stretches > 1:
            lines[-1] += ", " + words("{count:stretch|stretches} with gaps between them", count=stretches)
    frame = knot_table(solved)
    lines += ["", *_knots(frame.head(shown), solved, words)]
    if frame.height > shown:
        lines.append(
            words(
                "The first {shown} of {count} knots; trajectories.csv has all.",
                shown=shown,
                count=frame.height,
            )
        )
    return "\n".join([*lines, *_boresights(solved, words)])


def _knots(frame: pl.DataFrame, solved: Solved, words: Words) -> list[str]:
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    digits = {name: DIGITS[unit] if name in "xyz" else ANGLE_DIGITS[angle] for name in POSE}
    tables = []
    for names, of in ((POSE[:3], unit), (POSE[3:], angle)):
        columns = [*names, *(f"s{name}" for name in names)]
        rows = [
            [
                row["trajectory"],
                fixed(row["time"], _TIME_DIGITS),
                *(fixed(row[name], digits[name.removeprefix("s")]) for name in columns),
            ]
            for row in frame.to_dicts()
        ]
        tables += [
            table(["trajectory", "time [s]", *(f"{c} [{of}]" for c in columns)], rows, words=words),
            "",
        ]
    return tables[:-1]


def _boresights(solved: Solved, words: Words) -> list[str]:
    rows = boresight_rows(solved)
    if not rows:
        return []
    angle = angle_unit(solved)
    columns = [*POSE[3:], *(f"s{name}" for name in POSE[3:])]
    body = [[row["instrument"], *(fixed(row[name], ANGLE_DIGITS[angle]) for name in columns)] for row in rows]
    title = words("Misalignment of inertial systems (boresight):")
    return ["", title, table(["instrument", *(f"{c} [{angle}]" for c in columns)], body, words=words)]
