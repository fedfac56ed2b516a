"""The test of a distance meter by the full procedure of ISO 17123-4:2012: the protocol.

Seven points in a line, all 21 distances between them: six coordinates and the zero offset are unknown, and 14 degrees
of freedom remain.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, stdtrit

from mor.errors import InputError, Message
from mor.report.language import Words
from mor.report.layout import LINE, WIDTH, fixed, heading, paragraphs, persons, short, table
from mor.report.view import View
from mor.units import LENGTH_UNITS

POINTS, FREEDOM, LEVEL = 7, 14, 0.05


class Line(NamedTuple):
    """Results of one test line. Lengths in metres."""

    s: float
    """Experimental standard deviation of a distance."""
    sigma: float
    """The standard deviation to test."""
    offset: float
    sigma_offset: float
    """From s."""


def line_of(view: View) -> Line:
    """Return the results of a test line. Raises :class:`InputError` if they are not of the full procedure."""
    summary = view.summary
    meters = [one["components"].get("offset") for one in summary["others"] if one["kind"] == "distance meter"]
    sigmas = view.used["sigma"].unique().to_list()
    wrong = {
        "redundancy": (summary["redundancy"], FREEDOM),
        "observations": (view.residuals.height, POINTS * (POINTS - 1) // 2),
        "distance meters with a free offset": (
            sum(o is not None and o["status"] == "free" for o in meters),
            1,
        ),
        "standard deviations of observations": (len(sigmas), 1),
    }
    problems = [
        Message(f"no full procedure of ISO 17123-4: found {found} {name}, expected {expected}")
        for name, (found, expected) in wrong.items()
        if found != expected
    ]
    if problems or set(view.used["type"]) != {"distance"}:
        raise InputError(problems or [Message("no full procedure of ISO 17123-4: expected distances only")])
    sigma0, offset = summary["sigma0"], next(o for o in meters if o is not None)
    metre = LENGTH_UNITS[view.length]
    sigma = float(sigmas[0]) * LENGTH_UNITS[str(view.used["unit"][0])]
    used = sigma0["used_for_sigma"] / sigma0["apriori"]
    ratio = sigma0["ratio_of_sigmas"]
    return Line(ratio * sigma, sigma, offset["value"] * metre, offset["sigma"] * metre * ratio / used)


class StatisticalTest(NamedTuple):
    """One statistical test of the standard, passed if found lies within the limits."""

    name: str
    found: float
    low: float | None
    high: float
    unit: str

    @property
    def passed(self) -> bool:
        """Return True if the hypothesis is not rejected."""
        return (self.low is None or self.low <= self.found) and self.found <= self.high


def statistical_tests(line: Line, other: Line | None) -> list[StatisticalTest]:
    """Return the tests of ISO 17123-4:2012 at 95 %: χ² of s, F of two lines, Student's t of the offset."""
    high = line.sigma * np.sqrt(chdtri(FREEDOM, LEVEL) / FREEDOM)
    tests = [StatisticalTest("a) standard deviation s", 1e3 * line.s, None, 1e3 * float(high), "mm")]
    if other is not None:
        bound = float(fdtri(FREEDOM, FREEDOM, 1.0 - 0.5 * LEVEL))
        tests.append(
            StatisticalTest("b) s² / s² of the other test", (line.s / other.s) ** 2, 1.0 / bound, bound, "1")
        )
    t = float(stdtrit(FREEDOM, 1.0 - 0.5 * LEVEL))
    return [
        *tests,
        StatisticalTest(
            "c) zero offset, absolute", 1e3 * abs(line.offset), None, 1e3 * t * line.sigma_offset, "mm"
        ),
    ]


def protocol_text(view: View, other: View | None, words: Words) -> str:
    """Return the protocol of a test line, and of its comparison with another one, on one page."""
    line = line_of(view)
    tests = statistical_tests(line, None if other is None else line_of(other))
    title = words("Test of a distance meter by ISO 17123-4:2012, full procedure")

    def mm(value: float) -> str:
        return words.number(fixed(1e3 * value, 3)) + " mm"

    facts: list[tuple[str, Any]] = [
        (words("project"), view.summary["title"] or "–"),
        *persons(view.identity, words),
        (
            words("standard deviation s"),
            words("{s}, {freedom} degrees of freedom", s=mm(line.s), freedom=FREEDOM),
        ),
        (words("to be tested"), mm(line.sigma)),
        (words("zero offset"), f"{mm(line.offset)}, sigma {mm(line.sigma_offset)}"),
        (words("program"), view.identity["program"]),
    ]
    width = max(len(name) for name, _ in facts)
    rows = [
        [
            words(test.name),
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
                    heading(words("Statistical tests, confidence level 95 %")),
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
