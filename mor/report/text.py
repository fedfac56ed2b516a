"""The text report and the summary on the screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.errors import escaped
from mor.quality.singularity import weakness
from mor.quality.solution import Solved
from mor.report import layout, text_findings, text_tables
from mor.report import verdict as words_of_reliability
from mor.report.estimates import group_table, interior_rows, point_summary
from mor.report.identity import RunIdentity, identity_of, note_rows
from mor.report.language import ENGLISH, Words, datum_name
from mor.report.layout import ALL, cells, fixed, in_words, paragraphs, short, table
from mor.report.observations import check_rows, gross_errors, place, possible_causes, suspects
from mor.report.summary import summary
from mor.report.text_findings import (
    emptied,
    first_sentence,
    named,
    sentences,
    sentences_of_things,
    undetermined_section,
)
from mor.report.verdict import contradictions, ill_determined, in_common, reliability_rows, verdict_rows
from mor.solve.iterate import STANDS_STILL, Outcome

# ---- Head of the report: the verdict first, then counts, σ0, global test and datum.

NAMED = 3
"""Observations that nothing controls, and parts that nothing ties, that are named one by one."""


def section(solved: Solved, words: Words = ENGLISH, persons: Sequence[tuple[str, str]] = ()) -> str:
    """Verdict and key figures, with ``persons``: who, for whom and when."""
    data = summary(solved)
    title = data["title"] or words("Adjustment")
    rows = [*counts(data, words), ("iterations", str(data["iterations"]))]
    if solved.quality is not None:
        test, sigma0 = data["global_test"], data["sigma0"]
        which = "a posteriori" if solved.quality.sigma_factor != 1.0 else "a priori"
        datum = datum_name(solved.adjustment.problem.datum.name, words)
        rows += [
            redundancy(data, words),
            ("sigma0 a priori", words.number(short(sigma0["apriori"]))),
            ("sigma0 a posteriori", words.number(short(sigma0["aposteriori"], 7))),
            ("vTPv", f"{words.number(fixed(test['statistic'], 3))}, {_limits(test, words)}"),
            (
                "standard deviations",
                words("with sigma0 {which}, in the datum: {datum}", which=words(which), datum=datum),
            ),
            ("units", words("lengths {length}, angles {angle}", **data["units"])),
            ("residuals", words("v = adjusted - observed")),
        ]
    said = [*persons, *((words(name), value) for name, value in rows)]
    return "\n".join([*layout.titled(title), "", *verdict(solved, words), "", *layout.aligned(said)])


def counts(data: dict[str, Any], words: Words) -> list[tuple[str, str]]:
    """Names and texts of the counts and the datum of a summary."""
    movements = ", ".join(words.listed(name) for name in data["movements"])
    return [
        ("observations n", str(data["observations"])),
        ("unknowns u", str(data["unknowns"])),
        ("datum defect d", f"{data['defect']}" + (f" ({movements})" if movements else "")),
        ("datum", datum_name(data["datum"], words)),
    ]


def redundancy(data: dict[str, Any], words: Words) -> tuple[str, str]:
    """Name and text of the redundancy of a summary."""
    total = f"{data['redundancy_sum']:.6f}"
    said = words("{redundancy} (sum of redundancy numbers {total})", redundancy=data["redundancy"], total=total)
    return "redundancy n - u + d", said


def verdict(solved: Solved, words: Words = ENGLISH) -> list[str]:
    """Return the verdict in words."""
    adjustment, quality = solved.adjustment, solved.quality
    if quality is None:
        reason = f", {words.told(adjustment.reason)}" if adjustment.reason else ""
        outcome = words.listed(adjustment.outcome.value) + reason
        cause = first_sentence(possible_causes(solved), words)
        said = words("NO SOLUTION: {outcome}.", outcome=outcome)
        return [said, *_untied(solved, words), *_advice(solved, words), *cause]
    lines = sentences(suspects(solved), words)
    lines += [words("Converged after {count:iteration|iterations}.", count=len(adjustment.iterations))]
    test = quality.global_test
    if test.redundancy == 0:
        lines.append(words("Nothing is controlled: the redundancy is 0, there is no test."))
    elif test.accepted:
        lines.append(words("Global test accepted at the level {level}.", level=f"{test.level:g}"))
    else:
        size = words("larger") if test.statistic > test.upper else words("smaller")
        sentence = (
            "Global test REJECTED at the level {level}: residuals are {size} than the a-priori sigmas say (sigma0 "
            "ratio {ratio})."
        )
        lines.append(words(sentence, level=f"{test.level:g}", size=size, ratio=fixed(quality.sigma0, 3)))
    lines += ill_determined(verdict_rows(solved), solved.network.project.units.length, words)
    lines += contradictions(verdict_rows(solved), words)
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    lines.append(
        words("{count:observation|observations} with |w| > {limit}.", count=flagged, limit=fixed(quality.critical, 2))
        if flagged
        else words("No observation is flagged.")
    )
    lines += first_sentence(possible_causes(solved), words)
    lines += in_common(gross_errors(solved).get("in_common", []), words)
    lines += sentences_of_things(solved.network.undeterminable, words)
    lines += _uncontrolled(solved, words) if test.redundancy else []
    return [*lines, *emptied(group_table(solved).to_dicts(), words)]


def _uncontrolled(solved: Solved, words: Words) -> list[str]:
    """Observations that hardly anything controls: no test speaks of them. A few are named."""
    data = reliability_rows(solved)
    if data is None or not data["uncontrolled"]:
        return []
    count, limit = data["uncontrolled"], f"{data['least_redundancy']:g}"
    sentence = (
        "Accepted, {count:observation|observations} uncontrolled (r < {limit})"
        if solved.accepted
        else "{count:observation is|observations are} uncontrolled (r < {limit})"
    )
    judged = words(sentence, count=count, limit=limit)
    if count > NAMED:
        return [f"{judged}."]
    return [f"{judged}: {'; '.join(in_words(row, words) for row in data['observations'])}."]


def _untied(solved: Solved, words: Words) -> list[str]:
    parts = solved.network.untied
    if not parts:
        return []
    lines = [f"{words.told(part.message)}." for part in parts[:NAMED]]
    if len(parts) > NAMED:
        lines.append(words("{count} more parts have an arbitrary position.", count=len(parts) - NAMED))
    return [*lines, words("Start values or coordinates of two points of a part would tie it.")]


def _advice(solved: Solved, words: Words) -> list[str]:
    count = len(solved.adjustment.iterations)
    if weakness(solved):
        return [
            words(
                "After {count:iteration|iterations} the network still moves along poorly determined directions. "
                "Fix or observe what moves.",
                count=count,
            )
        ]
    if solved.adjustment.reason == STANDS_STILL:
        return [
            words("More iterations would not help: look at the observations that fit worst, and at the start values.")
        ]
    if solved.adjustment.outcome is Outcome.NOT_CONVERGED and not solved.adjustment.reason:
        return [
            words(
                "{count:iteration was|iterations were} not enough. settings: {{max_iterations: …}} allows more; "
                "better start values need fewer.",
                count=count,
            )
        ]
    things = solved.network.undeterminable
    if any(not thing.treatment for thing in things):
        return [
            words(
                "settings: {{undetermined: leave_out}} adjusts the rest without undetermined objects "
                "({names}; undetermined.csv lists them).",
                names=named(things, words),
            )
        ]
    if solved.adjustment.outcome is Outcome.DIVERGED:
        return [words("Check the start values and look for gross errors: points mixed up, wrong units, wrong signs.")]
    return []


def _limits(test: dict[str, float], words: Words) -> str:
    said = "accepted between {lower} and {upper} (chi-squared, level {level})"
    return words(said, lower=fixed(test["lower"], 3), upper=fixed(test["upper"], 3), level=f"{test['level']:g}")


# ---- The summary on the terminal: accepted or not, what is worst, how good points and cameras are, on one screen.

WIDTH = 100


def screen(solved: Solved, words: Words = ENGLISH, verbose: bool = False) -> str:
    """Return the outcome for the terminal, with a table of groups if ``verbose``.

    Control characters in names are escaped.
    """
    return escaped(_screen(solved, words, verbose))


def _screen(solved: Solved, words: Words, verbose: bool) -> str:
    """At most 15 lines, of 100 columns but for the verdict; without a solution the report's words on the reason."""
    # Lines of the summary; notes and the place of the results bring them to 20.
    most_lines = 15
    if solved.quality is None:
        said = [*verdict(solved, words), *undetermined_section(solved, words).splitlines()]
        return "\n".join(_fewer([line for line in said if line], most_lines, words))
    data = summary(solved)
    counts = words(
        "n = {n}, u = {u}, d = {d}, redundancy {redundancy}; sigma0 a posteriori {after}, a priori {before}",
        n=data["observations"],
        u=data["unknowns"],
        d=data["defect"],
        redundancy=data["redundancy"],
        after=short(data["sigma0"]["aposteriori"], 5),
        before=short(data["sigma0"]["apriori"], 5),
    )
    lines = [
        counts,
        words("Datum: {datum}", datum=datum_name(data["datum"], words)),
        *_worst(solved, words),
        *_points(solved, words),
        *_cameras(solved, words),
        *[
            words(
                "Check {id}, {component}: rms {rms} {unit}, largest {largest} {unit} ({count})",
                id=row["group"],
                component=row["component"],
                rms=short(row["rms"], 3),
                largest=short(row["largest"], 3),
                unit=row["unit"],
                count=row["count"],
            )
            for row in check_rows(solved)[:2]
        ],
    ]
    head = "\n".join(verdict(solved, words)).split("\n")
    if verbose:
        return "\n".join([*head, *map(_cut, [*lines, *_groups(solved, words)])])
    return "\n".join([*_fewer(head, most_lines - len(lines), words), *map(_cut, lines)])


def _fewer(lines: list[str], most: int, words: Words) -> list[str]:
    if len(lines) <= most:
        return lines
    return [*lines[: most - 1], words("… and {count} more lines in the report", count=len(lines) - most + 1)]


def _cut(line: str) -> str:
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…"


def _worst(solved: Solved, words: Words) -> list[str]:
    quality = solved.quality
    if quality is None:
        return []
    lines = []
    for effect in solved.effects[:3]:
        group, row, component = effect.entry
        line = words(
            "Worst: {place}: |w| = {w}, r = {r}",
            place=in_words(place(solved.adjustment.problem.groups[group], row, component), words),
            w=fixed(abs(effect.test), 2),
            r=fixed(effect.r, 2),
        )
        flagged = quality.flagged[group][row, component]
        lines.append(f"{line} ({words.listed('flagged')})" if flagged else line)
    return lines


def _points(solved: Solved, words: Words) -> list[str]:
    found = point_summary(solved)
    if found.weakest is None:
        return []
    unit, rms = solved.network.project.units.length, zip("XYZ", found.rms, strict=True)
    numbers = ", ".join(f"{name} {words.number(short(value, 3))}" for name, value in rms if value != 0.0)
    return [
        words(
            "Points: sigma (rms) {numbers} {unit}; weakest {id}: longest semi-axis {axis} {unit}",
            numbers=numbers,
            id=found.weakest["id"],
            axis=short(found.weakest["ellipsoid_a"], 3),
            unit=unit,
        )
    ]


def _cameras(solved: Solved, words: Words) -> list[str]:
    lines = []
    for row in interior_rows(solved)[:2]:
        name, constant = next(iter(row["components"].items()))
        value = words.number(short(constant["value"], 7))
        sigma = f" ± {words.number(short(constant['sigma'], 2))}" if constant["sigma"] else ""
        fixed_words = "" if constant["sigma"] else f" ({words.listed('fixed')})"
        lines.append(f"{words('Camera {id}', id=row['id'])}: {name} = {value}{sigma} {row['unit']}{fixed_words}")
    return lines


def _groups(solved: Solved, words: Words) -> list[str]:
    groups, most = group_table(solved).to_dicts(), 40
    columns = "observations redundancy:.1f sigma0:.3f largest_w:.2f flagged"
    rows = [[row["name"][:36], *cells(row, columns)] for row in groups[:most]]
    headers = ["group", "n", "sum r", "sigma0 [1]", "largest |w| [1]", "flagged"]
    lines = ["", *table(headers, rows, words=words).splitlines()]
    if len(groups) > most:
        lines.append(words("and {count:more group|more groups} in report.txt", count=len(groups) - most))
    return lines


# ---- The text report: one file for each section, put together in one order.


def text_report(
    solved: Solved,
    words: Words = ENGLISH,
    of: RunIdentity = RunIdentity(),  # noqa: B008 - frozen
    full: bool = False,
) -> str:
    """The whole report in a language, ``of`` what was read; ``full`` with nothing left to the tables beside it.

    Sections without content are left out. No line is longer than :data:`mor.report.layout.WIDTH`, but for single
    words that are.
    """
    about = identity_of(solved.network.project, of)
    shown: dict[str, int] = {"shown": ALL} if full else {}
    sections = [
        section(solved, words, layout.persons(about, words)),
        text_findings.undetermined_section(solved, words),
        text_findings.listed(solved, words, **shown),
        text_findings.unsettled_section(solved, words, **shown),
        text_findings.suspect_section(solved, words, **shown),
        text_findings.hypothesis_section(solved, words),
        text_tables.motion_section(solved, words, **shown),
        text_tables.check_section(solved, words),
        words_of_reliability.section(solved, words, **shown),
        words_of_reliability.section_of_reliability(solved, words, **({"weakest": ALL, "named": ALL} if full else {})),
        text_findings.reliability_section(solved, words, **shown),
        text_tables.group_section(solved, words),
        text_tables.camera_section(solved, words),
        text_tables.image_section(solved, words),
        text_tables.trajectory_section(solved, words, **shown),
        text_tables.station_section(solved, words),
        text_tables.feature_section(solved, words),
        text_tables.section_of_others(solved, words),
        text_tables.place_section(solved, words, **shown),
        text_tables.point_section(solved, words, full),
        text_tables.ellipse_section(solved, words) if full else "",
        text_tables.relative(solved, words, neighbours=full),
        text_tables.residual_section(solved, words),
        text_tables.listed_residuals(solved, words) if full else "",
        layout.section(about, words, note_rows(solved.network.notes, of.folder), **shown),
    ]
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"
