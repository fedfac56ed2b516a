"""What may be the cause where something is rejected, in words: never as a certainty."""

from __future__ import annotations

from typing import Any

from mor.quality.hypotheses.effort import times
from mor.quality.solved import Solved
from mor.report.layout import heading, short
from mor.report.tables.gross_errors.hypotheses import hypotheses
from mor.report.words.language import ENGLISH, Words

SENTENCES = {
    "names exchanged": "two names may be exchanged ({names})",
    "wrong name": "a point may have the name of another one ({names})",
    "wrong station": "a row may be booked at another station or image ({names})",
    "control exchanged": "the coordinates of two control points may be exchanged ({names})",
    "control unit": "the coordinates of control points may be in another unit ({names})",
    "axes exchanged": "x and y of control points may be exchanged ({names})",
    "distance offset": "all distances of an instrument may have a common offset, a prism constant say ({names})",
    "distance scale": "all distances of an instrument may have a common scale ({names})",
    "slope distance": "horizontal distances may be slope distances ({names})",
    "horizontal distance": "slope distances may be horizontal distances ({names})",
    "instrument height": "the height of an instrument may be wrong or forgotten ({names})",
    "target height": "the height of a target may be wrong or forgotten ({names})",
    "circle unit": "a circle may have been read in another unit ({names})",
    "circle sense": "a horizontal circle may count the other way ({names})",
    "elevation for zenith": "zenith angles may be elevations ({names})",
    "face": "directions may have been read in the other face ({names})",
    "image flipped": "image coordinates may count y the other way ({names})",
    "image turned": "an image may be turned by half a circle ({names})",
    "image unit": "image coordinates may be in another unit ({names})",
    "image scale": "the camera constant, or the size of the pixels, may be wrong ({names})",
    "levelling sign": "a line of levels may have the wrong sign ({names})",
    "curvature": "the curvature of the earth is not modelled",
    "sigma unit": "standard deviations may be in another unit ({names})",
}
"""What each cause says."""


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """The hypotheses, the best first, with what each does to vᵀPv and a line to try it."""
    rows, untried = hypotheses(solved), solved.found.untried
    if not rows and not untried:
        return ""
    lines = [heading(words("What may be the cause"))]
    if rows:
        lines.append(
            words(
                "Each was tried in an adjustment of its own. None is applied, and none is certain: look at the "
                "measurements before you change anything."
            )
        )
    for number, row in enumerate(rows, 1):
        lines += [f"{number}. {sentence(row, words)}", f"   {_effect(row, words)}"]
        lines.append("   " + words("to try it: {line}", line=row["line"]))
    if untried:
        lines.append(
            words(
                "{count:further cause was|further causes were} not tried: that would have taken longer than "
                "{times:adjustment|adjustments} of this size.",
                count=untried,
                times=times(solved.network.observations),
            )
        )
    return "\n".join(lines)


def first_sentence(rows: list[dict[str, Any]], words: Words = ENGLISH) -> list[str]:
    """The best hypothesis, for the verdict."""
    return [words("Possible cause, to be checked: {cause}.", cause=sentence(row, words)) for row in rows[:1]]


def to_try(rows: list[dict[str, Any]], words: Words = ENGLISH) -> list[str]:
    """Hypotheses and the lines to try them, where there is no adjustment to tell more of."""
    return [
        words(
            "Possible cause, to be checked: {cause}; to try it: {line}",
            cause=sentence(row, words),
            line=row["line"],
        )
        for row in rows
    ]


def sentence(row: dict[str, Any], words: Words = ENGLISH) -> str:
    """One hypothesis, with its amount where it has one."""
    said = words(SENTENCES[row["cause"]], names=", ".join(row["things"]))
    if row["amount"] is None:
        return said
    amount = row["amount"]
    return f"{said}: {words.listed(amount['name'])} {words.number(short(amount['value'], 6))} {amount['unit']}".rstrip()


def _effect(row: dict[str, Any], words: Words) -> str:
    before, after = row["vtpv_before"], row["vtpv_after"]
    return words(
        "vTPv {before} ({freedom_before:degree|degrees} of freedom) -> {after} ({freedom_after})",
        before="-" if before is None else words.number(short(before, 5)),
        freedom_before=row["freedom_before"],
        after=words.number(short(after, 5)),
        freedom_after=row["freedom_after"],
    )
