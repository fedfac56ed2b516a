"""Who sees what: how many sights there are, and what keeps the others from being made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.quality.design.sighted import REASONS, Sighted
from mor.report.layout import heading, table
from mor.report.words.language import Words

_NAMED = 12


def visible_rows(sighted: Sequence[Sighted]) -> list[dict[str, Any]]:
    """Return the sights of each group of planned observations as plain data."""
    return [
        {
            "group": one.name,
            "section": one.section,
            **dict(zip(REASONS, one.counts, strict=True)),
            "seen_from_nowhere": list(one.unseen),
            "seen_once": list(one.once),
        }
        for one in sighted
    ]


def visible_section(sighted: Sequence[Sighted], words: Words) -> str:
    """A line for each group, the targets that nothing sees, and those that are seen only once."""
    if not sighted:
        return ""
    rows = [[one.name, str(sum(one.counts)), *map(str, one.counts)] for one in sighted]
    headers = ["group", "sights", "seen", "out of range", "off format", "slanting", "hidden"]
    lines = [
        heading(words("Who sees what")),
        table(headers, rows, 1, words),
        words(
            "A sight counts where it fails first: range; format, or steepness; incidence; surfaces in its way."
        ),
    ]
    for one in sighted:
        for names, said in (
            (one.unseen, "{id}: {count:target is|targets are} seen from nowhere: {names}."),
            (one.once, "{id}: {count:target is|targets are} seen from one place only: {names}."),
        ):
            if names:
                lines.append(words(said, id=one.name, count=len(names), names=_listed(names, words)))
    return "\n".join(lines)


def _listed(names: Sequence[str], words: Words) -> str:
    said = ", ".join(names[:_NAMED])
    more = len(names) - _NAMED
    return words("{names} and {count} more", names=said, count=more) if more > 0 else said
