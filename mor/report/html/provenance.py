"""Statements on what an adjustment rests on: what was read and used, which datum, what would make it better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mor.report.html.figures.layout import small_unit
from mor.report.html.page_data import PageData
from mor.report.words.language import Words

_NAMED = 3
"""Observations without control that are named."""
_MOST_NOTES = 200
"""Notes that are listed."""


def used_in_words(data: PageData) -> str:
    """From how many files, how many observations took part, and whether anything was left out or noted."""
    view, say = data.view, data.words
    out = view.residuals.height - view.used.height
    parts = [
        say(
            "{files:file|files} read, {count:observation|observations} adjusted, {out} kept out.",
            files=len(view.identity["inputs"]),
            count=view.used.height,
            out=out,
        )
    ]
    things = len(view.summary.get("undeterminable", []))
    if things:
        parts.append(say("{count:thing is|things are} not determined.", count=things))
    if view.notes:
        parts.append(say("{count:note|notes} under Files.", count=len(view.notes)))
    return " ".join(parts)


def datum_in_words(data: PageData) -> str:
    """The datum that coordinates and σ refer to."""
    return data.words("{datum}. Coordinates and σ refer to it.", datum=data.datum)


def epoch_in_words(data: PageData) -> str:
    """State how the result can be compared with another epoch."""
    return data.words(
        "mor compare OTHER THIS --epochs carries both into the datum of their common points and tests the movements; "
        "bare differences of coordinates of two datums are no movements."
    )


def help_in_words(data: PageData) -> str:
    """Suggest what to measure next: the least precise point, and uncontrolled observations."""
    view, say, parts = data.view, data.words, []
    if "ellipsoid_a" in data.points.columns and data.points["ellipsoid_a"].drop_nulls().len():
        worst = data.points.sort("ellipsoid_a", descending=True, nulls_last=True).row(0, named=True)
        unit, factor = small_unit(view.length, worst["ellipsoid_a"])
        parts.append(
            say(
                "Point {point} is the least precise one (semi-axis {size} {unit}): further observations to it.",
                point=worst["id"],
                size=f"{worst['ellipsoid_a'] * factor:.3g}",
                unit=unit,
            )
        )
    free = (view.reliability or {}).get("observations", [])[:_NAMED]
    if free:
        names = "; ".join(f"{row['type']} {', '.join(row['names'].values())}" for row in free)
        parts.append(say("A second observation beside what nothing controls: {names}.", names=names))
    parts.append(say("mor design adjusted.yaml --rank tells what each further observation is worth."))
    return " ".join(parts)


def listed_notes(rows: Sequence[Mapping[str, Any]], words: Words) -> dict[str, Any]:
    """The first notes with their places, in the language of the page, and how many more there are."""
    notes = [
        {
            "place": f"{row['file']}:{row['line']}" if row["line"] else row["file"],
            "message": words.told(row["message"]),
        }
        for row in rows[:_MOST_NOTES]
    ]
    return {"notes": notes, "notes_left": len(rows) - len(notes)}
