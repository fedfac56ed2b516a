"""Variants of a plan side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mor.quality.design.requirements import Judged
from mor.quality.plausibility.images import count_outside_the_format
from mor.quality.solved import Solved
from mor.report.design.content import requirement_row
from mor.report.layout import DIGITS, fixed, heading, short, table
from mor.report.tables.estimates import point_table
from mor.report.words.language import Words

_NAMED = 8
Named = tuple[str, Solved, Sequence[Judged]]


def variant_row(name: str, solved: Solved, judged: Sequence[Judged]) -> dict[str, Any]:
    """Return counts, mean σ of the free points, and requirements of a variant."""
    quality = solved.quality
    row: dict[str, Any] = {
        "name": name,
        "outcome": solved.adjustment.outcome.value,
        "reason": solved.adjustment.reason,
        "observations": solved.adjustment.problem.observations,
        "redundancy": quality.redundancy if quality is not None else None,
        "fulfilled": quality is not None and all(one.met for one in judged),
        "require": [requirement_row(one, solved) for one in judged],
        "left_out": [[thing.kind, thing.name] for thing in solved.network.undeterminable],
        "outside_format": count_outside_the_format(solved.network),
        "smallest_r": None,
        **dict.fromkeys(("rms_sx", "rms_sy", "rms_sz")),
    }
    if quality is None:
        return row
    known = [float(np.nanmin(one.r)) for one in quality.groups if np.isfinite(one.r).any()]
    row["smallest_r"] = min(known) if known else None
    points = point_table(solved)
    free = points.filter(points["status"].is_in(["free", "partly fixed"]))
    for axis in "xyz":
        sigma = free[f"s{axis}"].drop_nulls().to_numpy()
        row[f"rms_s{axis}"] = float(np.sqrt(np.mean(sigma**2))) if len(sigma) else None
    return row


def variant_text(rows: Sequence[dict[str, Any]], unit: str, words: Words) -> str:
    """One line for each variant, the plan itself first."""
    digits = DIGITS[unit] + 1
    cells = [
        [
            words.listed(row["name"]) if row is rows[0] else row["name"],
            str(row["observations"]),
            "-" if row["redundancy"] is None else str(row["redundancy"]),
            *(fixed(row[f"rms_s{axis}"], digits) for axis in "xyz"),
            short(row["smallest_r"], 3),
            _reached(row, words),
        ]
        for row in rows
    ]
    headers = ["variant", "n", "redundancy", *(f"rms s{a} [{unit}]" for a in "XYZ"), "smallest r", "required"]
    lines = [heading(words("Variants")), table(headers, cells, 1, words, last_left=True)]
    for row in rows:
        if row["left_out"]:
            told = [f"{words.listed(kind)} {name}" for kind, name in row["left_out"]]
            names = ", ".join(told[:_NAMED])
            if len(told) > _NAMED:
                names = words("{names} and {count} more", names=names, count=len(told) - _NAMED)
            said = "{id}: nothing determines {names} any more; left out."
            lines.append(words(said, id=row["name"], names=names))
        if row["outside_format"]:
            said = "{id}: {count:image point lies|image points lie} outside the format of the camera."
            lines.append(words(said, id=row["name"], count=row["outside_format"]))
        if row["redundancy"] is None:
            lines.append(
                words("{id}: no solution: {reason}.", id=row["name"], reason=words.told(row["reason"]))
            )
    return "\n".join(lines)


def _reached(row: dict[str, Any], words: Words) -> str:
    if row["redundancy"] is None:
        return words("no solution")
    wanted = row["require"]
    failing = sum(not one["met"] for one in wanted)
    if not wanted:
        return "-"
    return words("reached") if not failing else words("{count} of {all} fail", count=failing, all=len(wanted))
