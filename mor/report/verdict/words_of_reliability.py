"""The reliability map in words: uncontrolled observations, the weakest points, images, stations and sets."""

from __future__ import annotations

from typing import Any

from mor.quality.solved import Solved
from mor.report.layout import heading, in_words, short, table
from mor.report.verdict.reliability_map import reliability_rows
from mor.report.words.language import ENGLISH, Words

NAMED = 10
"""Uncontrolled observations that are spoken of one by one."""
POINTS = 4
"""Points that are named."""
WEAKEST = 4
"""Points, images, stations and sets, each, that the table has."""
_KINDS = {"points": "point", "images": "image", "stations": "station", "sets": "set"}
_HEADERS = ("weakest", "id", "observation", "n", "smallest r [1]", "nabla", "unit")


def section(solved: Solved, words: Words = ENGLISH, weakest: int = WEAKEST, named: int = NAMED) -> str:
    """So many uncontrolled observations, then so many weakest of each kind."""
    unit = solved.network.project.units.length
    return section_of(reliability_rows(solved), unit, words, weakest, named)


def section_of(
    data: dict[str, Any] | None, unit: str, words: Words, weakest: int = WEAKEST, named: int = NAMED
) -> str:
    """The same of a map (:func:`mor.report.verdict.reliability_map.reliability_rows`), with the unit of lengths."""
    if data is None:
        return ""
    lines = [heading(words("Reliability")), *uncontrolled_in_words(data, words, named)]
    rows = [
        [words(kind), *_cells(row, words)]
        for key, kind in _KINDS.items()
        for row in sorted(data[key], key=lambda row: float(row["smallest_r"]))[:weakest]
    ]
    if rows:
        headers = [*_HEADERS, f"shift at most [{unit}]"]
        lines.append(table(headers, rows, 3, words, margin=2))
    return "\n".join(lines)


def _cells(row: dict[str, Any], words: Words) -> list[str]:
    numbers = [str(row["observations"]), short(round(row["smallest_r"], 7), 2), short(row["nabla"], 3)]
    weakest = row["weakest"]
    return [row["id"], in_words(weakest, words), *numbers, weakest["unit"], short(row["shift"], 3)]


def uncontrolled_in_words(data: dict[str, Any], words: Words, named: int = NAMED) -> list[str]:
    """One line on each of the first uncontrolled observations, and how many there are."""
    if not data["uncontrolled"]:
        return [words("No observation is uncontrolled (r < {limit}).", limit=f"{data['least_redundancy']:g}")]
    lines = [
        words(
            "{count:observation is|observations are} uncontrolled (r < {limit}): an error there would hardly show.",
            count=data["uncontrolled"],
            limit=f"{data['least_redundancy']:g}",
        )
    ]
    lines += [f"  {uncontrolled_sentence(row, words)}" for row in data["observations"][:named]]
    left = data["uncontrolled"] - len(data["observations"][:named])
    if left > 0:
        lines.append(words("  and {count} more", count=left))
    return lines


def uncontrolled_sentence(row: dict[str, Any], words: Words) -> str:
    """An uncontrolled observation: what rests on it, and what would control it."""
    said = words("{place}: r = {r}", place=in_words(row, words), r=short(round(row["r"], 7), 2))
    if row["carries"]:
        names = ", ".join(row["carries"][:POINTS])
        left = len(row["carries"]) - POINTS
        if left > 0:
            names = words("{names} and {count} more", names=names, count=left)
        said += words("; carries {names}", names=names)
    cure = row["cure"]
    if cure is None:
        return said
    if cure["again"]:
        return said + words("; measured once more it would have r = {r}", r=short(cure["r"], 2))
    place = in_words({**cure, "component": cure["type"]}, words)
    return said + words(
        "; with a further observation, {place}, it would have r = {r}", place=place, r=short(cure["r"], 2)
    )
