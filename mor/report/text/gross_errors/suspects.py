"""Report observations left out because all together have no acceptable solution."""

from __future__ import annotations

from typing import Any

from mor.adjustment.state import Outcome
from mor.quality.solved import Solved
from mor.report.layout import heading, in_words, short, table
from mor.report.tables.gross_errors.suspects import suspects
from mor.report.words.language import ENGLISH, Words

SHOWN = 200


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """The suspects, the worst first; nothing if there are none."""
    data = suspects(solved)
    if data is None:
        return ""
    rows = [
        [in_words(row, words), words.number(short(row["misfit"], 4))] for row in data["observations"][:shown]
    ]
    lines = [
        heading(words("Left out: suspects of gross errors")),
        words(
            "Found with weights that fall to zero (graduated, to 3 sigma). This report is the plain adjustment of all "
            "other observations; data snooping (--snoop) begins from here and puts back what fits."
        ),
        table(["observation", "|v| [sigma]"], rows, 1, words),
    ]
    if data["count"] > len(rows):
        lines.append(words("and {count} more in the table of residuals", count=data["count"] - len(rows)))
    return "\n".join(lines)


def sentences(data: dict[str, Any] | None, words: Words = ENGLISH) -> list[str]:
    """The verdict on them; first of all that not all observations have been adjusted."""
    if data is None:
        return []
    place = "; ".join(in_words(row, words) for row in data["observations"][:2])
    if data["outcome"] == Outcome.CONVERGED.value:
        return [
            words(
                "LANDS where half of all residuals are beyond 3 sigma, with all observations (sigma0 ratio {ratio} "
                "after {count:iteration|iterations}).",
                ratio=words.number(short(data["sigma0_ratio"], 4)),
                count=data["iterations"],
            ),
            words(
                "Without {count:suspect|suspects} the others fit; what follows is that adjustment. The worst: {place}.",
                count=data["count"],
                place=place,
            ),
        ]
    return [
        words(
            "DOES NOT CONVERGE with all observations ({outcome} after {count:iteration|iterations}).",
            outcome=words.listed(data["outcome"]),
            count=data["iterations"],
        ),
        words(
            "Without {count:suspect|suspects} it does; what follows is that adjustment. The worst: {place}.",
            count=data["count"],
            place=place,
        ),
    ]
