"""The summary on the terminal: accepted or not, what is worst, how good points and cameras are, on one screen."""

from __future__ import annotations

import numpy as np

from mor.escapes import escaped
from mor.quality.solved import Solved
from mor.report.layout import fixed, in_words, short, table
from mor.report.results.summary import summary
from mor.report.tables.checks import check_rows
from mor.report.tables.estimates import group_table, interior_rows, point_table
from mor.report.tables.reliability import place
from mor.report.text.head import verdict
from mor.report.text.undetermined import section as undetermined
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

WIDTH = 100
LINES = 24
"""Lines that a screen has at least."""
WORST, CAMERAS, CHECKS, GROUPS = 3, 2, 2, 6
"""Observations, cameras, checks and groups that are shown."""


def screen(solved: Solved, words: Words = ENGLISH) -> str:
    """Return the outcome for the terminal; control characters in names are escaped."""
    return escaped(_screen(solved, words))


def _screen(solved: Solved, words: Words) -> str:
    """At most 24 lines, of 100 columns but for the verdict; without a solution the report's words on the reason."""
    if solved.quality is None:
        said = [*verdict(solved, words), *undetermined(solved, words).splitlines()]
        told = [line for line in said if line]
        if len(told) > LINES:
            rest = words("… and {count} more lines in the report", count=len(told) - LINES + 1)
            told = [*told[: LINES - 1], rest]
        return "\n".join(told)
    lines = [
        *_figures(solved, words),
        *_worst(solved, words),
        *_points(solved, words),
        *_cameras(solved, words),
        *_checks(solved, words),
        *_groups(solved, words),
    ]
    return "\n".join([*verdict(solved, words), *map(_cut, lines)])


def _cut(line: str) -> str:
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…"


def _figures(solved: Solved, words: Words) -> list[str]:
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
    return [counts, words("Datum: {datum}", datum=datum_name(data["datum"], words))]


def _worst(solved: Solved, words: Words) -> list[str]:
    """The observations with the largest test values."""
    quality = solved.quality
    if quality is None:
        return []
    lines = []
    for effect in solved.effects[:WORST]:
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
    frame = point_table(solved)
    if frame.height == 0:
        return []
    free = frame.select("id", "sx", "sy", "sz", "ellipsoid_a").filter(
        frame["status"].is_in(["free", "partly fixed"])
    )
    if free.height == 0:
        return []
    unit = solved.network.project.units.length
    rms = [float(np.sqrt(np.nanmean(free[f"s{name}"].cast(float).to_numpy() ** 2))) for name in "xyz"]
    numbers = ", ".join(
        f"{name.upper()} {words.number(short(value, 3))}"
        for name, value in zip("xyz", rms, strict=True)
        if value != 0.0
    )
    worst = free.row(free["ellipsoid_a"].arg_max() or 0, named=True)
    return [
        words(
            "Points: sigma (rms) {numbers} {unit}; weakest {id}: longest semi-axis {axis} {unit}",
            numbers=numbers,
            id=worst["id"],
            axis=short(worst["ellipsoid_a"], 3),
            unit=unit,
        )
    ]


def _cameras(solved: Solved, words: Words) -> list[str]:
    lines = []
    for row in interior_rows(solved)[:CAMERAS]:
        name, constant = next(iter(row["components"].items()))
        value = words.number(short(constant["value"], 7))
        sigma = f" ± {words.number(short(constant['sigma'], 2))}" if constant["sigma"] else ""
        fixed_words = "" if constant["sigma"] else f" ({words.listed('fixed')})"
        lines.append(
            f"{words('Camera {id}', id=row['id'])}: {name} = {value}{sigma} {row['unit']}{fixed_words}"
        )
    return lines


def _checks(solved: Solved, words: Words) -> list[str]:
    return [
        words(
            "Check {id}, {component}: rms {rms} {unit}, largest {largest} {unit} ({count})",
            id=row["group"],
            component=row["component"],
            rms=short(row["rms"], 3),
            largest=short(row["largest"], 3),
            unit=row["unit"],
            count=row["count"],
        )
        for row in check_rows(solved)[:CHECKS]
    ]


def _groups(solved: Solved, words: Words) -> list[str]:
    groups = group_table(solved).to_dicts()
    rows = [
        [
            row["name"][:36],
            str(row["observations"]),
            fixed(row["redundancy"], 1),
            fixed(row["sigma0"], 3),
            fixed(row["largest_w"], 2),
            str(row["flagged"]),
        ]
        for row in groups[:GROUPS]
    ]
    headers = ["group", "n", "sum r", "sigma0 [1]", "largest |w| [1]", "flagged"]
    lines = ["", *table(headers, rows, words=words).splitlines()]
    if len(groups) > GROUPS:
        lines.append(words("and {count:more group|more groups} in report.txt", count=len(groups) - GROUPS))
    return lines
