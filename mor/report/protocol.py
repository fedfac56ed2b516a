"""Tests of instruments by ISO 17123-3:2001, -4:2012 and -8:2015 and by VDI/VDE 2634 part 1: the protocol."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl
from scipy.special import chdtri, fdtri, stdtrit

from mor.errors import InputError, Message
from mor.report.language import Words
from mor.report.layout import LINE, WIDTH, fixed, heading, paragraphs, persons, short, table
from mor.report.view import View
from mor.units import ANGLE_UNITS, LENGTH_UNITS

LEVEL = 0.05
LINES, LENGTHS = 7, 5
"""Lines, and lengths in each, that VDI/VDE 2634 part 1 asks for at least."""


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
        "directions",
        60,
        (SigmaGroup("", ("horizontal",), 32),),
        "mgon",
        1e-3 * ANGLE_UNITS["gon"],
    ),
    "iso17123-4": Procedure(
        "Test of a distance meter by ISO 17123-4:2012, full procedure",
        "distance",
        21,
        (SigmaGroup("", ("distance",), 14),),
        "mm",
        1e-3,
    ),
    "iso17123-8": Procedure(
        "Test of a GNSS receiver (RTK) by ISO 17123-8:2015, full procedure",
        "coordinates",
        90,
        (SigmaGroup("position", ("x", "y"), 56), SigmaGroup("height", ("z",), 28)),
        "mm",
        1e-3,
    ),
}
"""Four series of three sets to five targets; seven points in a line, with all distances and an unknown zero offset;
three series of five sets of the coordinates of two points."""


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
        "standard deviations of observations": (
            sum(one["sigma"].n_unique() for one in rows),
            len(procedure.parts),
        ),
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
        found.append(
            Figures(part, float(np.sqrt(v @ v / part.freedom)), one["sigma"][0] * factor, None, None)
        )
    if offsets:
        sigma0, scale = summary["sigma0"], LENGTH_UNITS[view.length] / procedure.per_unit
        from_s = (
            offsets[0]["sigma"] * sigma0["ratio_of_sigmas"] * sigma0["apriori"] / sigma0["used_for_sigma"]
        )
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


def statistical_tests(
    one: list[Figures], other: list[Figures] | None, protocol: str
) -> list[StatisticalTest]:
    """Return the tests of the standards at 95 %: χ² of s, F of two tests, Student's t of the zero offset."""
    unit, count = PROCEDURES[protocol].unit, len(one)
    tests = []
    for letter, found in zip("ab", one, strict=False):
        freedom = found.part.freedom
        high = found.sigma * float(np.sqrt(chdtri(freedom, LEVEL) / freedom))
        tests.append(
            StatisticalTest(letter, "standard deviation s", found.part.name, found.s, None, high, unit)
        )
    for letter, found, compared in zip("abcd"[count:], one, other or [], strict=False):
        bound = float(fdtri(found.part.freedom, found.part.freedom, 1.0 - 0.5 * LEVEL))
        ratio, name = (found.s / compared.s) ** 2, "s² / s² of the other test"
        tests.append(StatisticalTest(letter, name, found.part.name, ratio, 1.0 / bound, bound, "1"))
    if one[0].offset is not None and one[0].sigma_offset is not None:
        limit = float(stdtrit(one[0].part.freedom, 1.0 - 0.5 * LEVEL)) * one[0].sigma_offset
        tests.append(StatisticalTest("c", "zero offset, absolute", "", abs(one[0].offset), None, limit, unit))
    return tests


def length_tests(view: View, permissible: tuple[float, float]) -> list[StatisticalTest]:
    """Return a test of each line by VDI/VDE 2634 part 1: its error that comes nearest to the permissible one, in mm.

    Lengths of one line begin at one point. ``permissible``: A in mm and K in mm/m of A + K·L. Raises
    :class:`InputError` if there are too few lines, or too few lengths in one.
    """
    checks = view.residuals.filter((pl.col("flag") == "check") & (pl.col("type") == "distance"))
    lines = [(str(name), rows) for (name,), rows in checks.group_by("from", maintain_order=True)]
    problems = [
        Message(
            f"no full procedure of vdi2634-1: found {found} lengths from {name}, expected at least {LENGTHS}"
        )
        for name, rows in lines
        if (found := rows["to"].n_unique()) < LENGTHS
    ]
    if len(lines) < LINES:
        text = f"no full procedure of vdi2634-1: found {len(lines)} lines, expected at least {LINES}"
        problems.insert(0, Message(text))
    if problems:
        raise InputError(problems)
    metres, tests = LENGTH_UNITS[view.length], []
    for name, rows in lines:
        errors = np.abs(rows["v"].to_numpy()) * metres * 1e3
        limits = permissible[0] + permissible[1] * rows["observed"].to_numpy() * metres
        worst = int(np.argmax(errors / limits))
        tests.append(
            StatisticalTest(name, "length measurement error", "", errors[worst], None, limits[worst], "mm")
        )
    return tests


def length_protocol(view: View, permissible: tuple[float, float], words: Words) -> str:
    """Return the protocol of lengths by VDI/VDE 2634 part 1, on one page."""
    tests = length_tests(view, permissible)
    a, k = (words.number(short(value)) for value in permissible)
    largest = max(
        abs(row["largest"])
        for row in view.checks
        if row["type"] == "distance" and row["component"] == "distance"
    )
    facts = [
        (words("permissible"), f"{a} mm + {k} mm/m · L"),
        (
            words("largest length measurement error"),
            f"{words.number(fixed(largest * LENGTH_UNITS[view.length] * 1e3, 4))} mm",
        ),
    ]
    title = words("Test of lengths by VDI/VDE 2634 part 1")
    return _page(view, title, facts, words("Lines: the error nearest to its limit"), tests, words)


def protocol_text(view: View, other: View | None, protocol: str, words: Words) -> str:
    """Return the protocol of a test, and of its comparison with another one, on one page."""
    procedure, found = PROCEDURES[protocol], figures(view, protocol)
    tests = statistical_tests(found, None if other is None else figures(other, protocol), protocol)

    def said(value: float | None) -> str:
        return f"{words.number(fixed(value, 3))} {procedure.unit}"

    facts: list[tuple[str, Any]] = []
    for one in found:
        freedom = words("{s}, {freedom} degrees of freedom", s=said(one.s), freedom=one.part.freedom)
        facts.append((_name("standard deviation s", one.part.name, words), freedom))
        facts.append((_name("to be tested", one.part.name, words), said(one.sigma)))
        if one.offset is not None:
            facts.append((words("zero offset"), f"{said(one.offset)}, sigma {said(one.sigma_offset)}"))
    title = words("Statistical tests, confidence level 95 %")
    return _page(view, words(procedure.title), facts, title, tests, words)


def _name(name: str, part: str, words: Words) -> str:
    return ", ".join(words(one) for one in (name, part) if one)


def _page(
    view: View,
    title: str,
    facts: list[tuple[str, Any]],
    title_of_tests: str,
    tests: list[StatisticalTest],
    words: Words,
) -> str:
    facts = [
        (words("project"), view.summary["title"] or "–"),
        *persons(view.identity, words),
        *facts,
        (words("program"), view.identity["program"]),
    ]
    width = max(len(name) for name, _ in facts)
    rows = [
        [
            f"{test.letter}) {_name(test.name, test.part, words)}",
            test.unit,
            *("-" if v is None else words.number(short(v, 4)) for v in (test.found, test.low, test.high)),
            words("accepted") if test.passed else words("rejected"),
        ]
        for test in tests
    ]
    headers = ["test", "unit", "found", "at least", "at most", "verdict"]
    signed = f"{words('place and date').ljust(len(LINE))}    {words('signature')}"
    return (
        paragraphs(
            "\n".join(
                [
                    title,
                    "=" * min(len(title), WIDTH),
                    *(f"{name.ljust(width)}  {text}" for name, text in facts),
                    "",
                    heading(title_of_tests),
                    table(headers, rows, 2, words, last_left=True),
                    "",
                    "",
                    f"{LINE}    {LINE}",
                    signed,
                ]
            )
        )
        + "\n"
    )
