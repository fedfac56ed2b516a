"""Report undetermined unknowns, with hints."""

from __future__ import annotations

from collections.abc import Sequence

from mor.adjustment.state import Outcome
from mor.errors import Undeterminable
from mor.quality.diagnosis.singularities import explain_singularity, turned_about, weakness
from mor.quality.diagnosis.unsettled import OF_THE_START
from mor.quality.solved import Solved
from mor.report.layout import heading, table
from mor.report.words.language import ENGLISH, Words

SHOWN = 1000
"""Things a text report lists; the table beside it has all."""
_NAMED = 5


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """Explanation of a singular system, or of directions that are hardly determined; nothing otherwise."""
    weak = weakness(solved, words)
    if weak:
        return "\n".join([heading(words("What is hardly determined")), *weak])
    if solved.adjustment.reason in OF_THE_START:
        return ""  # what is singular there is so because of where things were put
    if solved.adjustment.outcome is not Outcome.SINGULAR:
        turned = [] if solved.quality is not None else turned_about(solved, words)
        return "\n".join([heading(words("What is hardly determined")), *turned]) if turned else ""
    return "\n".join(
        [
            heading(words("What is not determined")),
            *(_named(solved, words) or explain_singularity(solved, words)),
        ]
    )


def _named(solved: Solved, words: Words) -> list[str]:
    """A line for each of very many things, which were found before the adjustment and took no part in it."""
    if solved.adjustment.defect.undetermined:
        return []
    things = [thing for thing in solved.network.undeterminable if not thing.treatment]
    return [f"{words.listed(one.kind)} {one.name}: {words.told(one.reason)}" for one in things[:SHOWN]]


def listed(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """Return the unknowns that were left out, are at infinity, or stop the adjustment."""
    things = solved.network.undeterminable
    if not things:
        return ""
    rows = [
        [
            words.listed(thing.kind),
            thing.name,
            words.listed(thing.treatment) if thing.treatment else "-",
            words.told(thing.reason),
        ]
        for thing in things[:shown]
    ]
    headers = ["thing", "id", "treatment", "reason"]
    lines = [heading(words("What nothing determines")), table(headers, rows, 4, words)]
    if len(things) > shown:
        lines.append(words("{count} more stand in undetermined.csv.", count=len(things) - shown))
    return "\n".join(lines)


def sentences_of_things(things: Sequence[Undeterminable], words: Words = ENGLISH) -> list[str]:
    """Count the undetermined unknowns, name the first, and say where all of them are listed."""
    left = [thing for thing in things if thing.treatment == "left out"]
    far = [thing for thing in things if thing.treatment == "at infinity"]
    lines = []
    if left:
        lines.append(
            words(
                "{count:thing is|things are} LEFT OUT, because nothing determines them: {names} (undetermined.csv).",
                count=len(left),
                names=_names(left, words),
            )
        )
    if far:
        lines.append(
            words("At infinity, with a direction only: {names} (undetermined.csv).", names=_names(far, words))
        )
    return lines


def _names(things: Sequence[Undeterminable], words: Words) -> str:
    listed = ", ".join(f"{words.listed(thing.kind)} {thing.name}" for thing in things[:_NAMED])
    more = len(things) - _NAMED
    return words("{names} and {count} more", names=listed, count=more) if more > 0 else listed
