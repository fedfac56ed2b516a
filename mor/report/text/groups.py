"""Observation groups with their estimated σ0."""

from __future__ import annotations

from typing import Any

from mor.project.file.model import Settings
from mor.quality.solved import Solved
from mor.report.layout import fixed, heading, table
from mor.report.tables.estimates import group_table, variance_components
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """One line for each group."""
    if solved.quality is None:
        return ""
    rows = [
        [
            row["name"],
            row["type"],
            str(row["observations"]),
            fixed(row["redundancy"], 3),
            fixed(row["vtpv"], 3),
            fixed(row["sigma0"], 4),
            str(row["flagged"]),
        ]
        for row in group_table(solved).to_dicts()
    ]
    headers = ["group", "type", "n", "sum r", "vTPv", "sigma0 [1]", "flagged"]
    lines = [
        heading(words("Observation groups")),
        table(headers, rows, 2, words),
        *components_in_words(
            variance_components(solved),
            group_table(solved).to_dicts(),
            solved.network.project.settings,
            words,
        ),
    ]
    return "\n".join(lines)


def components_in_words(
    data: dict[str, Any] | None, groups: list[dict[str, Any]], settings: Settings, words: Words
) -> list[str]:
    """Factors of σ where the project asks for more than the table of groups has."""
    if data is None or (
        settings.variance_components == "report" and settings.variance_method == "simplified"
    ):
        return []
    which = "Helmert's full system" if data["method"] == "helmert" else "simplified, group by group"
    how = "iterated into the weights" if data["iterated"] else "not taken into the weights"
    lines = [
        words("Variance components ({which}; {how}): factors of sigma", which=words(which), how=words(how))
    ]
    if data["method"] != settings.variance_method:
        lines.append(words("Helmert's system is too large here, or cannot tell the groups apart."))
    for row in groups:
        if row["sigma_factor"] is not None:
            factor, sigma = fixed(row["sigma_factor"], 3), fixed(row["sigma_of_factor"], 3)
            lines.append(
                words("  {group}: {factor} +- {sigma}", group=row["name"], factor=factor, sigma=sigma)
            )
    return lines
