"""Tests of instruments by the full procedures of ISO 17123-3:2001 and ISO 17123-4:2012: the protocol."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, stdtrit

from mor.errors import InputError, Message
from mor.report.language import Words
from mor.report.layout import LINE, WIDTH, fixed, heading, paragraphs, persons, short, table
from mor.report.view import View
from mor.units import ANGLE_UNITS, LENGTH_UNITS

LEVEL = 0.05


class Procedure(NamedTuple):
    """A full test procedure: what is observed, and the degrees of freedom that remain."""

    title: str
    type: str
    observations: int
    freedom: int
    unit: str
    per_unit: float
    """Internal units in one of ``unit``."""


PROCEDURES = {
    "iso17123-3": Procedure(
        "Test of horizontal directions by ISO 17123-3:2001, full procedure",
        "directions",
        60,
        32,
        "mgon",
        1e-3 * ANGLE_UNITS["gon"],
    ),
    "iso17123-4": Procedure(
        "Test of a distance meter by ISO 17123-4:2012, full procedure", "distance", 21, 14, "mm", 1e-3
    ),
}
"""Four series of three sets to five targets; seven points in a line, with all distances and an unknown zero offset."""


class Figures(NamedTuple):
    """Results of a test, in the unit of its procedure."""

    s: float
    """Experimental standard deviation of an observation."""
    sigma: float
    """The standard deviation to test."""
    offset: float | None
    """Zero offset of a distance meter."""
    sigma_offset: float | None
    """From s."""


def figures(view: View, protocol: str) -> Figures:
    """Return the results of a test. Raises :class:`InputError` if they are not of the full procedure."""
    procedure, summary = PROCEDURES[protocol], view.summary
    used = view.used.filter(view.used["type"] == procedure.type)
    sigmas = used["sigma"].unique().to_list()
    offsets = [
        one["components"]["offset"]
        for one in summary["others"]
        if one["kind"] == "distance meter" and one["components"].get("offset", {}).get("status") == "free"
    ]
    wrong = {
        "redundancy": (summary["redundancy"], procedure.freedom),
        "observations": (used.height, procedure.observations),
        "distance meters with a free offset": (len(offsets), int(procedure.type == "distance")),
        "standard deviations of observations": (len(sigmas), 1),
    }
    problems = [
        Message(f"no full procedure of {protocol}: found {found} {name}, expected {expected}")
        for name, (found, expected) in wrong.items()
        if found != expected
    ]
    if problems:
        raise InputError(problems)
    sigma0, unit = summary["sigma0"], str(used["unit"][0])
    sigma = float(sigmas[0]) * (LENGTH_UNITS | ANGLE_UNITS)[unit] / procedure.per_unit
    ratio = sigma0["ratio_of_sigmas"]
    if not offsets:
        return Figures(ratio * sigma, sigma, None, None)
    scale = LENGTH_UNITS[view.length] / procedure.per_unit
    from_s = offsets[0]["sigma"] * ratio * sigma0["apriori"] / sigma0["used_for_sigma"]
    return Figures(ratio * sigma, sigma, offsets[0]["value"] * scale, from_s * scale)


class StatisticalTest(NamedTuple):
    """One statistical test, passed if the figure lies within the limits."""

    name: str
    found: float
    low: float | None
    high: float
    unit: str

    @property
    def passed(self) -> bool:
        """Return True if the hypothesis is not rejected."""
        return (self.low is None or self.low <= self.found) and self.found <= self.high


def statistical_tests(one: Figures, other: Figures | None, protocol: str) -> list[StatisticalTest]:
    """Return the tests of the standards at 95 %: χ² of s, F of two tests, Student's t of the zero offset."""
    freedom, unit = PROCEDURES[protocol].freedom, PROCEDURES[protocol].unit
    high = one.sigma * float(np.sqrt(chdtri(freedom, LEVEL) / freedom))
    tests = [StatisticalTest("a) standard deviation s", one.s, None, high, unit)]
    if other is not None:
        bound = float(fdtri(freedom, freedom, 1.0 - 0.5 * LEVEL))
        ratio = (one.s / other.s) ** 2
        tests.append(StatisticalTest("b) s² / s² of the other test", ratio, 1.0 / bound, bound, "1"))
    if one.offset is not None and one.sigma_offset is not None:
        t = float(stdtrit(freedom, 1.0 - 0.5 * LEVEL))
        limit = t * one.sigma_offset
        tests.append(StatisticalTest("c) zero offset, absolute", abs(one.offset), None, limit, unit))
    return tests


def protocol_text(view: View, other: View | None, protocol: str, words: Words) -> str:
    """Return the protocol of a test, and of its comparison with another one, on one page."""
    procedure, one = PROCEDURES[protocol], figures(view, protocol)
    tests = statistical_tests(one, None if other is None else figures(other, protocol), protocol)
    title = words(procedure.title)

    def said(value: float | None) -> str:
        return f"{words.number(fixed(value, 3))} {procedure.unit}"

    offset = [(words("zero offset"), f"{said(one.offset)}, sigma {said(one.sigma_offset)}")]
    facts: list[tuple[str, Any]] = [
        (words("project"), view.summary["title"] or "–"),
        *persons(view.identity, words),
        (
            words("standard deviation s"),
            words("{s}, {freedom} degrees of freedom", s=said(one.s), freedom=procedure.freedom),
        ),
        (words("to be tested"), said(one.sigma)),
        *(offset if one.offset is not None else []),
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
