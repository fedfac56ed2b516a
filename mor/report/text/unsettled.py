"""The report where there is no solution: the iterations, what does not come to rest, what fits worst."""

from __future__ import annotations

from mor.quality.solved import Solved
from mor.report.layout import fixed, heading, short, table
from mor.report.results.failure import moving_rows, worst_misfits
from mor.report.words.language import ENGLISH, Words

SHOWN = 40


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """Iterations, movements and misfits; nothing if there is a solution."""
    if solved.quality is not None:
        return ""
    parts = [
        _iterations(solved, words),
        _moving(solved, words),
        _worst(solved, words, shown),
        _warning(words),
    ]
    return "\n\n".join(part for part in parts if part)


def _iterations(solved: Solved, words: Words) -> str:
    rows = [
        [
            str(step.number),
            short(step.objective, 7),
            short(step.sigma0, 5),
            short(step.largest_change, 3),
            short(step.damping, 3),
        ]
        for step in solved.adjustment.iterations
    ]
    if not rows:
        return ""
    headers = ["no.", "vTPv [1]", "sigma0 ratio [1]", "largest change [sigma]", "damping"]
    return "\n".join([heading(words("Iterations")), table(headers, rows, words=words)])


def _moving(solved: Solved, words: Words) -> str:
    rows = [
        [
            f"{words.listed(row['of'])} {row['id']}",
            row["component"],
            row["unit"],
            words.listed(row["way"]),
            " ".join(words.number(short(step, 3)) for step in row["steps"]),
        ]
        for row in moving_rows(solved)
    ]
    if not rows:
        return ""
    headers = ["unknown", "component", "unit", "way", "last steps"]
    return "\n".join([heading(words("What does not come to rest")), table(headers, rows, 4, words)])


def _worst(solved: Solved, words: Words, shown: int) -> str:
    rows = [
        [
            row["type"],
            " ".join(part for part in (row["at"], row["from"], row["to"]) if part),
            row["component"],
            row["unit"],
            short(row["observed"], 9),
            short(row["v"], 4),
            short(row["sigma"], 3),
            fixed(row["misfit"], 1),
        ]
        for row in worst_misfits(solved, shown).to_dicts()
    ]
    if not rows:
        return ""
    headers = ["type", "between", "component", "unit", "observed", "v", "sigma", "|v|/sigma"]
    title = heading(words("What fits worst at the last values (no solution: v is no residual of one)"))
    return "\n".join([title, table(headers, rows, 4, words)])


def _warning(words: Words) -> str:
    return heading(words("NOT A SOLUTION: all values below are those of the last iteration"))
