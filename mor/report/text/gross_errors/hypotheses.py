"""Possible causes of a rejection and the results of a diagnosis, in words."""

from __future__ import annotations

from typing import Any

from mor.quality.solved import Solved
from mor.report.layout import heading, short
from mor.report.tables.gross_errors.hypotheses import possible_causes
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
    "levelling sign": "levelling lines may have the wrong sign ({names})",
    "table unit": "all lengths of a table may be in another unit ({names})",
    "vector sign": "vectors may have the wrong sign ({names})",
    "antenna height": "the antenna height at a point may be wrong or missing ({names})",
    "control moved": "a control point may have wrong coordinates, or have moved ({names})",
    "pixel origin": "the principal point, or the origin of the pixels, may be wrong ({names})",
    "camera of images": "images may be of another camera or focal length ({names})",
    "curvature": "the curvature of the earth is not modelled",
    "set-ups exchanged": "the places of two instruments may be exchanged ({names})",
    "images exchanged": "the names of two images may be exchanged ({names})",
    "orientation changed": "the horizontal circle may have been turned during a set of directions ({names})",
    "sigma of a table": "the standard deviations of a table may be wrong by one factor ({names})",
    "sigma unit": "standard deviations may be in another unit ({names})",
}
"""What each cause says."""


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """The possible causes, the best first, with a line to try each of them."""
    rows = possible_causes(solved)
    return scored(rows, words, words(NOT_VERIFIED)) if rows else ""


def scored(rows: list[dict[str, Any]], words: Words = ENGLISH, note: str = "") -> str:
    """Possible causes by score tests, the best first."""
    lines = [
        heading(words("Possible causes")),
        note or words("These are score tests at the solution, not verified."),
    ]
    for number, row in enumerate(rows, 1):
        lines += [f"{number}. {sentence(row, words)}", f"   {decrease(row, words)}"]
        lines.append("   " + words("to try it: {line}", line=row["line"]))
    return "\n".join(lines)


NOT_VERIFIED = (
    "These are score tests at the solution, not verified: run mor diagnose. "
    "Look at the measurements before you change anything."
)


def first_sentence(rows: list[dict[str, Any]], words: Words = ENGLISH) -> list[str]:
    """The best possible cause, for the verdict."""
    return [
        words("Possible cause, not verified (run mor diagnose): {cause}.", cause=sentence(row, words))
        for row in rows[:1]
    ]


def decrease(row: dict[str, Any], words: Words = ENGLISH) -> str:
    """State how a possible cause would reduce vᵀPv."""
    return words("vTPv would decrease by {gain}", gain=words.number(short(row["vtpv_decrease"], 4)))


def diagnosed(data: dict[str, Any], words: Words = ENGLISH) -> str:
    """The result of a diagnosis: what is offered, and a table of what was tried."""
    before = data["vtpv_before"]
    lines = [
        words(
            "vTPv {before} ({freedom:degree|degrees} of freedom) without a change",
            before="-" if before is None else words.number(short(before, 5)),
            freedom=data["freedom_before"],
        )
    ]
    if not data["offered"]:
        lines.append(words("No hypothesis explains the observations better than chance."))
    for number, row in enumerate(data["offered"], 1):
        lines.append(f"{number}. {sentence(row, words)}")
        lines.append("   " + _effect(row, words))
        lines.append("   " + words("to try it: {line}", line=row["line"]))
        lines += _diff(row.get("diff"), words)
    if data["offered"]:
        lines.append(words("None is applied. Look at the measurements before you change anything."))
    if data["untried"]:
        lines.append(
            words(
                "{count:hypothesis was|hypotheses were} not tried because the time was over; "
                "--limit allows more.",
                count=data["untried"],
            )
        )
    return "\n".join(lines)


DIFF = 24
"""Lines of a diff that are printed; results as JSON have all of them."""


def _diff(diff: str | None, words: Words) -> list[str]:
    """The edit of the project, indented."""
    lines = (diff or "").splitlines()
    said = [f"     {line}" for line in lines[:DIFF]]
    if len(lines) > DIFF:
        said.append("     " + words("and {count:line|lines} more (--json has all)", count=len(lines) - DIFF))
    return said


def tried(data: dict[str, Any], words: Words = ENGLISH) -> str:
    """Table of all hypotheses that were adjusted, in their order."""
    head = (words("hypothesis"), "vTPv", words("freedom"), words("gain"))
    rows = [
        (
            f"{words.listed(row['cause'])} ({', '.join(row['things'])})",
            "-" if row["vtpv_after"] is None else words.number(short(row["vtpv_after"], 5)),
            "-" if row["freedom_after"] is None else str(row["freedom_after"]),
            "-" if row["gain"] is None else words.number(short(row["gain"], 4)),
        )
        for row in data["tried"]
    ]
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(4)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(line[k].rjust(widths[k]) for k in (1, 2, 3))])
        for line in (head, *rows)
    )


def sentence(row: dict[str, Any], words: Words = ENGLISH) -> str:
    """One hypothesis, with its amount where it has one."""
    said = words(SENTENCES[row["cause"]], names=", ".join(row["things"]))
    if row["amount"] is None:
        return said
    amount = row["amount"]
    return f"{said}: {words.listed(amount['name'])} {words.number(short(amount['value'], 6))} {amount['unit']}".rstrip()


def _effect(row: dict[str, Any], words: Words) -> str:
    return words(
        "vTPv {after} ({freedom:degree|degrees} of freedom)",
        after=words.number(short(row["vtpv_after"], 5)),
        freedom=row["freedom_after"],
    )
