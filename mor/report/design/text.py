"""The text report of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.escapes import escaped
from mor.quality.design.requirements import Judged
from mor.quality.plausibility.images import count_outside_the_format
from mor.quality.solved import Solved
from mor.report.columns import WIDTH, paragraphs
from mor.report.design.content import group_rows, requirement_row
from mor.report.identity import Identity, identity_of
from mor.report.layout import DIGITS, fixed, heading, short, table
from mor.report.results.summary import summary
from mor.report.tables.estimates import image_table
from mor.report.text import cameras, features, identity, others, points, stations, undetermined
from mor.report.verdict import words_of_reliability
from mor.report.words.datum import datum_name
from mor.report.words.language import Words

WHAT = {
    "x": "sigma of x",
    "y": "sigma of y",
    "z": "sigma of z",
    "xy": "sigma of x and of y",
    "xyz": "sigma of x, y and z",
    "ellipsoid": "longest semi-axis of the error ellipsoid",
    "r": "redundancy number r",
    "external": "external reliability",
}


def design_text(
    solved: Solved, judged: Sequence[Judged], words: Words, of: Identity, more: Sequence[str] = ()
) -> str:
    """The report of a plan: the verdict on what is required first, ``more`` sections, then what can be expected."""
    about = identity_of(solved.network.project, of)
    sections = [
        head(solved, judged, words, identity.persons(about, words)),
        requirement_section(solved, judged, words),
        *more,
        undetermined.section(solved, words),
        undetermined.listed(solved, words),
    ]
    if solved.quality is not None:
        sections += [
            words_of_reliability.section(solved, words),
            _groups(solved, words),
            cameras.section(solved, words),
            _images(solved, words),
            stations.section(solved, words),
            features.section(solved, words),
            others.section(solved, words),
            points.section(solved, words),
        ]
    sections.append(identity.section(about, words))
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"


def verdict(solved: Solved, judged: Sequence[Judged], words: Words) -> list[str]:
    """State whether the plan can be adjusted and meets its requirements, and its visibility limits."""
    outside = count_outside_the_format(solved.network)
    said = "{count:planned image point lies|planned image points lie} outside the format of the camera."
    return [*_verdict(solved, judged, words), *([words(said, count=outside)] if outside else [])]


def _verdict(solved: Solved, judged: Sequence[Judged], words: Words) -> list[str]:
    if solved.quality is None:
        reason = words.told(solved.adjustment.reason)
        return [words("THE PLAN HAS NO SOLUTION: {reason}.", reason=reason)]
    failing = [one for one in judged if not one.met]
    if not judged:
        return [words("Nothing is required of it (require: … in the project file).")]
    if not failing:
        return [words("It reaches all that is required ({count}).", count=len(judged))]
    return [words("IT DOES NOT REACH {count} of {all} requirements.", count=len(failing), all=len(judged))]


def head(
    solved: Solved, judged: Sequence[Judged], words: Words, persons: Sequence[tuple[str, str]] = ()
) -> str:
    """Return title, verdict and key figures."""
    data = summary(solved)
    title = data["title"] or words("Adjustment")
    plan = words("PLAN: nothing of this is measured; σ are those expected, a priori.")
    lines = [title, "=" * min(len(title), WIDTH), "", plan, *verdict(solved, judged, words), ""]
    movements = ", ".join(words.listed(name) for name in data["movements"])
    rows = [
        ("observations n", str(data["observations"])),
        ("unknowns u", str(data["unknowns"])),
        ("datum defect d", f"{data['defect']}" + (f" ({movements})" if movements else "")),
        ("datum", datum_name(data["datum"], words)),
    ]
    if solved.quality is not None:
        redundancy = words(
            "{redundancy} (sum of redundancy numbers {total})",
            redundancy=data["redundancy"],
            total=f"{data['redundancy_sum']:.6f}",
        )
        rows.append(("redundancy n - u + d", redundancy))
    rows.append(("units", words("lengths {length}, angles {angle}", **data["units"])))
    said = [*persons, *((words(name), value) for name, value in rows)]
    width = max(len(name) for name, _ in said)
    lines += [f"{name.ljust(width)}  {value}" for name, value in said]
    return "\n".join(lines)


def requirement_section(solved: Solved, judged: Sequence[Judged], words: Words) -> str:
    """Each requirement with its limit, the worst value, and where that is."""
    if not judged:
        return ""
    rows = [requirement_row(one, solved) for one in judged]
    return "\n".join([heading(words("What is required")), *(_sentence(row, words) for row in rows)])


def _sentence(row: dict[str, Any], words: Words) -> str:
    """A requirement in a line: the verdict, the limit, the worst, where it is, how many fail."""
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    limit, worst = (
        words.number("∞" if value is None else short(value, 4)) + unit
        for value in (row["limit"], row["worst"])
    )
    return words(
        "{verdict}: {what}, {id}: {sign} {limit}; worst {worst} ({place}); {failing} of {count} fail",
        verdict=words("reached") if row["met"] else words("NOT REACHED"),
        what=words(WHAT[row["of"]]),
        id=", ".join(row["pattern"]),
        sign="≥" if row["of"] == "r" else "≤",
        limit=limit,
        worst=worst,
        place=row["where"],
        failing=row["failing"],
        count=row["count"],
    )


def _groups(solved: Solved, words: Words) -> str:
    rows = [
        [
            row["name"],
            row["type"],
            str(row["observations"]),
            fixed(row["redundancy"], 2),
            fixed(row["smallest_r"], 4),
            short(row["nabla"], 3),
            row["unit"],
            short(row["largest_external"], 3),
        ]
        for row in group_rows(solved)
    ]
    headers = ["group", "type", "n", "sum r", "smallest r [1]", "nabla", "unit", "external [1]"]
    return "\n".join([heading(words("Planned observations")), table(headers, rows, 2, words)])


def _images(solved: Solved, words: Words) -> str:
    frame = image_table(solved)
    if frame.height == 0:
        return ""
    unit = solved.network.project.units.length
    d = DIGITS[unit]
    rows = [
        [
            row["id"],
            row["camera"],
            *(fixed(row[name], d) for name in ("x", "y", "z", "sx", "sy", "sz")),
            str(row["points"]),
        ]
        for row in frame.to_dicts()
    ]
    headers = ["image", "camera", *(f"{name} [{unit}]" for name in ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0"))]
    return "\n".join([heading(words("Images")), table([*headers, "points"], rows, 2, words)])
