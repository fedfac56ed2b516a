"""Tests of instruments by ISO 17123-3:2001, -4:2012 and -8:2015, for -5, and by VDI/VDE 2634 part 1: the protocol.

The text of ISO 17123-5 was not at hand: its arrangement, and so its degrees of freedom, are those of the template.
"""

from __future__ import annotations

from html import escape
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from scipy.special import chdtri, fdtri, stdtrit

from mor.errors import InputError, Message, nearest
from mor.report.language import Words
from mor.report.layout import LINE, aligned, fixed, heading, paragraphs, persons, short, signature, table, titled
from mor.report.verification import page_facts, page_table, plain_page
from mor.report.view import View
from mor.units import ANGLE_UNITS, LENGTH_UNITS


class SigmaGroup(NamedTuple):
    """Observations that have one standard deviation, and the degrees of freedom that remain of them."""

    name: str
    components: tuple[str, ...]
    freedom: int


class Procedure(NamedTuple):
    """A full test procedure: what is observed."""

    title: str
    type: str
    observations: int
    parts: tuple[SigmaGroup, ...]
    unit: str
    per_unit: float
    """Internal units in one of ``unit``."""


PROCEDURES = {
    "iso17123-3": Procedure(
        "Test of horizontal directions by ISO 17123-3:2001, full procedure",
        *("directions", 60, (SigmaGroup("", ("horizontal",), 32),), "mgon", 1e-3 * ANGLE_UNITS["gon"]),
    ),
    "iso17123-4": Procedure(
        "Test of a distance meter by ISO 17123-4:2012, full procedure",
        *("distance", 21, (SigmaGroup("", ("distance",), 14),), "mm", 1e-3),
    ),
    "iso17123-5": Procedure(
        "Test of the coordinates of a total station, for ISO 17123-5",
        *("local", 54, (SigmaGroup("position", ("x", "y"), 24), SigmaGroup("height", ("z",), 16)), "mm", 1e-3),
    ),
    "iso17123-8": Procedure(
        "Test of a GNSS receiver (RTK) by ISO 17123-8:2015, full procedure",
        *("coordinates", 90, (SigmaGroup("position", ("x", "y"), 56), SigmaGroup("height", ("z",), 28)), "mm", 1e-3),
    ),
}
"""Four series of three sets to five targets; seven points in a line, with all distances and an unknown zero offset;
three series of set-ups on three points, with the coordinates of the two others; three series of five sets of the
coordinates of two points."""


class Figures(NamedTuple):
    """Results of a part of a test, in the unit of its procedure."""

    part: SigmaGroup
    s: float
    """Experimental standard deviation of an observation."""
    sigma: float
    """The standard deviation to test."""
    offset: float | None
    """Zero offset of a distance meter."""
    sigma_offset: float | None
    """From s."""


def figures(view: View, protocol: str) -> list[Figures]:
    """Return the results of a test. Raises :class:`InputError` if they are not of the full procedure."""
    procedure, summary = PROCEDURES[protocol], view.summary
    used = view.used.filter(view.used["type"] == procedure.type)
    rows = [used.filter(used["component"].is_in(part.components)) for part in procedure.parts]
    offsets = [
        one["components"]["offset"]
        for one in summary["others"]
        if one["kind"] == "distance meter" and one["components"].get("offset", {}).get("status") == "free"
    ]
    wrong = {
        "redundancy": (summary["redundancy"], sum(part.freedom for part in procedure.parts)),
        "observations": (used.height, procedure.observations),
        "distance meters with a free offset": (len(offsets), int(procedure.type == "distance")),
        "standard deviations of observations": (sum(one["sigma"].n_unique() for one in rows), len(procedure.parts)),
    }
    problems = [
        Message(f"no full procedure of {protocol}: found {found} {name}, expected {expected}")
        for name, (found, expected) in wrong.items()
        if found != expected
    ]
    if problems:
        raise InputError(problems)
    found = []
    for part, one in zip(procedure.parts, rows, strict=True):
        factor = (LENGTH_UNITS | ANGLE_UNITS)[str(one["unit"][0])] / procedure.per_unit
        v = one["v"].to_numpy() * factor
        found.append(Figures(part, float(np.sqrt(v @ v / part.freedom)), one["sigma"][0] * factor, None, None))
    if offsets:
        sigma0, scale = summary["sigma0"], LENGTH_UNITS[view.length] / procedure.per_unit
        from_s = offsets[0]["sigma"] * sigma0["ratio_of_sigmas"] * sigma0["apriori"] / sigma0["used_for_sigma"]
        found[0] = found[0]._replace(offset=offsets[0]["value"] * scale, sigma_offset=from_s * scale)
    return found


class StatisticalTest(NamedTuple):
    """One statistical test, passed if the figure lies within the limits."""

    letter: str
    name: str
    part: str
    found: float
    low: float | None
    high: float
    unit: str

    @property
    def passed(self) -> bool:
        """Return True if the hypothesis is not rejected."""
        return (self.low is None or self.low <= self.found) and self.found <= self.high


def statistical_tests(one: list[Figures], other: list[Figures] | None, protocol: str) -> list[StatisticalTest]:
    """Return the tests of the standards at 95 %: χ² of s, F of two tests, Student's t of the zero offset."""
    unit, count = PROCEDURES[protocol].unit, len(one)
    tests = []
    level = 0.05
    for letter, found in zip("ab", one, strict=False):
        freedom = found.part.freedom
        high = found.sigma * float(np.sqrt(chdtri(freedom, level) / freedom))
        tests.append(StatisticalTest(letter, "standard deviation s", found.part.name, found.s, None, high, unit))
    for letter, found, compared in zip("abcd"[count:], one, other or [], strict=False):
        bound = float(fdtri(found.part.freedom, found.part.freedom, 1.0 - 0.5 * level))
        ratio, name = (found.s / compared.s) ** 2, "s² / s² of the other test"
        tests.append(StatisticalTest(letter, name, found.part.name, ratio, 1.0 / bound, bound, "1"))
    if one[0].offset is not None and one[0].sigma_offset is not None:
        limit = float(stdtrit(one[0].part.freedom, 1.0 - 0.5 * level)) * one[0].sigma_offset
        tests.append(StatisticalTest("c", "zero offset, absolute", "", abs(one[0].offset), None, limit, unit))
    return tests


def length_tests(view: View, permissible: tuple[float, float]) -> list[StatisticalTest]:
    """Return a test of each line by VDI/VDE 2634 part 1: its error that comes nearest to the permissible one, in mm.

    Lengths of one line begin at one point. ``permissible``: A in mm and K in mm/m of A + K·L. Raises
    :class:`InputError` if there are too few lines, or too few lengths in one.
    """
    checks = view.residuals.filter((pl.col("flag") == "check") & (pl.col("type") == "distance"))
    lines = [(str(name), rows) for (name,), rows in checks.group_by("from", maintain_order=True)]
    # Lines, and lengths in each, that VDI/VDE 2634 part 1 asks for at least.
    least_lines, least_lengths = 7, 5
    problems = [
        Message(f"no full procedure of vdi2634-1: found {found} lengths from {name}, expected at least {least_lengths}")
        for name, rows in lines
        if (found := rows["to"].n_unique()) < least_lengths
    ]
    if len(lines) < least_lines:
        text = f"no full procedure of vdi2634-1: found {len(lines)} lines, expected at least {least_lines}"
        problems.insert(0, Message(text))
    if problems:
        raise InputError(problems)
    metres, tests = LENGTH_UNITS[view.length], []
    for name, rows in lines:
        errors = np.abs(rows["v"].to_numpy()) * metres * 1e3
        limits = permissible[0] + permissible[1] * rows["observed"].to_numpy() * metres
        worst = int(np.argmax(errors / limits))
        tests.append(
            StatisticalTest(
                name, "length measurement error", "", float(errors[worst]), None, float(limits[worst]), "mm"
            )
        )
    return tests


# ---- The protocol as plain data, and from these a text and a page, each on one sheet.


def protocol(
    view: View, standard: str, against: View | None = None, permissible: tuple[float, float] | None = None
) -> dict[str, Any]:
    """Return the protocol of a test. ``permissible``: see :func:`length_tests`, for VDI/VDE 2634 part 1 only.

    Raises :class:`InputError` if the results are not of the full procedure, or the options do not suit the standard.
    """
    of_lengths, title_of_lengths = "vdi2634-1", "Test of lengths by VDI/VDE 2634 part 1"
    if standard != of_lengths and standard not in PROCEDURES:
        raise InputError([Message(f"unknown protocol {standard}{nearest(standard, [*PROCEDURES, of_lengths])}")])
    if (standard == of_lengths) != (permissible is not None and max(permissible) > 0.0):
        raise InputError([Message("--permissible goes with --protocol vdi2634-1, and is not zero")])
    if standard == of_lengths and against is not None:
        raise InputError([Message("--against goes with the protocols of ISO 17123")])
    parts: list[dict[str, Any]] = []
    largest = None  # length measurement error, in mm
    if permissible is not None:
        errors = [abs(float(c["largest"])) for c in view.checks if c["type"] == c["component"] == "distance"]
        largest = max(errors) * LENGTH_UNITS[view.length] * 1e3
        tests, title = length_tests(view, permissible), title_of_lengths
    else:
        found, title = figures(view, standard), PROCEDURES[standard].title
        tests = statistical_tests(found, None if against is None else figures(against, standard), standard)
        for one in found:
            of_part = {"name": one.part.name, "freedom": one.part.freedom, "unit": PROCEDURES[standard].unit}
            parts.append(of_part | {key: value for key, value in one._asdict().items() if key != "part"})
    return {
        "schema": "mor-protocol",
        "schema_version": 1,
        "standard": standard,
        "title": title,
        "project": view.summary["title"],
        "identity": view.identity,
        "parts": parts,
        "permissible": None if permissible is None else dict(zip("AK", permissible, strict=True)),
        "largest_error": largest,
        "tests": [test._asdict() | {"passed": test.passed} for test in tests],
        "passed": all(test.passed for test in tests),
    }


def _facts(data: dict[str, Any], words: Words) -> list[tuple[str, str]]:
    def said(value: float, unit: str, decimals: int = 3) -> str:
        return f"{words.number(fixed(value, decimals))} {unit}"

    facts = [(words("project"), data["project"] or "–"), *persons(data["identity"], words)]
    for one in data["parts"]:
        unit = one["unit"]
        freedom = words("{s}, {freedom} degrees of freedom", s=said(one["s"], unit), freedom=one["freedom"])
        facts.append((_name("standard deviation s", one["name"], words), freedom))
        facts.append((_name("to be tested", one["name"], words), said(one["sigma"], unit)))
        if one["offset"] is not None:
            sigma = said(one["sigma_offset"], unit)
            facts.append((words("zero offset"), f"{said(one['offset'], unit)}, sigma {sigma}"))
    if data["permissible"] is not None:
        a, k = (words.number(short(value)) for value in data["permissible"].values())
        facts.append((words("permissible"), f"{a} mm + {k} mm/m · L"))
        facts.append((words("largest length measurement error"), said(data["largest_error"], "mm", 4)))
    return [*facts, (words("program"), data["identity"]["program"])]


def _name(name: str, part: str, words: Words) -> str:
    return ", ".join(words(one) for one in (name, part) if one)


_HEADERS = ("test", "unit", "found", "at least", "at most", "verdict")


def _tests(data: dict[str, Any], words: Words) -> tuple[str, list[list[str]]]:
    rows = [
        [
            f"{test['letter']}) {_name(test['name'], test['part'], words)}",
            test["unit"],
            *(words.number(short(test[key], 4)) for key in ("found", "low", "high")),
            words("accepted") if test["passed"] else words("rejected"),
        ]
        for test in data["tests"]
    ]
    statistical = "Statistical tests, confidence level 95 %"
    return words("Lines: the error nearest to its limit" if data["permissible"] is not None else statistical), rows


def protocol_text(data: dict[str, Any], words: Words) -> str:
    """Return the protocol as text."""
    title_of_tests, rows = _tests(data, words)
    lines = [*titled(words(data["title"])), *aligned(_facts(data, words)), "", heading(title_of_tests)]
    lines += [table(_HEADERS, rows, 2, words, last_left=True), "", *signature(words)]
    return paragraphs("\n".join(lines)) + "\n"


def protocol_page(data: dict[str, Any], words: Words) -> str:
    """Return the protocol as a page without scripts."""
    title_of_tests, rows = _tests(data, words)
    marked = ((row, not test["passed"]) for row, test in zip(rows, data["tests"], strict=True))
    signed = f"{words('place and date')}, {words('signature')}"
    title = words(data["title"])
    return plain_page(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            page_facts(_facts(data, words)),
            f"<h2>{escape(title_of_tests)}</h2>",
            page_table("", map(words, _HEADERS), marked, words),
            f'<p style="margin-top:4rem">{LINE}<br>{escape(signed)}</p>',
        ],
        words,
    )
