"""What is said of an adjustment in domains as a whole: for programs, and as text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import polars as pl

from mor.escapes import escaped
from mor.project.file.model import Settings
from mor.quality.tests.test_statistics import GlobalTest
from mor.report.columns import paragraphs
from mor.report.layout import ALL, fixed, heading, short, table
from mor.report.text import checks
from mor.report.text.groups import components_in_words
from mor.report.text.reliability import robust_in_words, snooped_in_words
from mor.report.verdict import sentences, words_of_reliability
from mor.report.words.language import ENGLISH, Words

SCHEMA = "mor domains 1"
_LISTED = 20


class Solution(NamedTuple):
    """What only a solution has."""

    sigma0: float
    redundancy_sum: float
    test: GlobalTest
    critical: float
    flagged: int
    groups: list[dict[str, Any]]
    cameras: list[dict[str, Any]]
    worst: pl.DataFrame
    """Rows of the table of residuals."""
    verdict: dict[str, Any]
    reliability: dict[str, Any] | None
    checks: list[dict[str, Any]]
    snooping: dict[str, Any] | None
    robust: dict[str, Any] | None
    """As ``results.json`` has them."""
    components: dict[str, Any] | None
    """How variance components were found."""
    settings: Settings
    length: str
    """Unit of lengths."""

    @property
    def accepted(self) -> bool:
        """True where the global test and the tests of all groups accept."""
        return self.test.accepted and not self.verdict["rejected"]


@dataclass(frozen=True)
class Summary:
    """An adjustment in domains."""

    title: str
    outcome: str
    reason: str
    loose: tuple[str, ...]
    """Unknowns that nothing determines, as names."""
    observations: int
    unknowns: int
    defect: int
    redundancy: int
    datum: str
    iterations: tuple[tuple[float, float], ...]
    """σ0 (or vᵀPv without redundancy) before each step, and its size in units of σ."""
    domains: tuple[tuple[int, int], ...]
    """Image points and outer unknowns of each domain."""
    root: int
    """Unknowns at the root."""
    tables: Mapping[str, str]
    """Name of each table that is written, by what it is."""
    identity: Mapping[str, Any]
    solution: Solution | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)


def as_json(summary: Summary) -> str:
    """The manifest, ``domains.json``."""
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "title": summary.title,
        "identity": dict(summary.identity),
        "outcome": summary.outcome,
        "reason": summary.reason,
        "undetermined": list(summary.loose),
        "observations": summary.observations,
        "unknowns": summary.unknowns,
        "defect": summary.defect,
        "redundancy": summary.redundancy,
        "datum": summary.datum,
        "iterations": [{"sigma0": size, "change": change} for size, change in summary.iterations],
        "domains": [{"rays": rays, "outer": outer} for rays, outer in summary.domains],
        "root": summary.root,
        "tables": dict(summary.tables),
        "notes": list(summary.notes),
    }
    if summary.solution is not None:
        data |= _of_solution(summary.solution)
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False, default=float) + "\n"


def _of_solution(one: Solution) -> dict[str, Any]:
    test = one.test
    return {
        "sigma0": one.sigma0,
        "redundancy_sum": one.redundancy_sum,
        "global_test": {
            "accepted": test.accepted,
            "statistic": test.statistic,
            "lower": test.lower,
            "upper": test.upper,
        },
        "critical": one.critical,
        "flagged": one.flagged,
        "groups": one.groups,
        "cameras": one.cameras,
        "worst": one.worst.head(_LISTED).to_dicts(),
    }


def as_text(summary: Summary, words: Words = ENGLISH, full: bool = False) -> str:
    """The report, ``report.txt``; ``full`` without its long lists cut."""
    sections = [_head(summary, words)]
    if summary.solution is not None:
        one = summary.solution
        shown: dict[str, int] = {"shown": ALL} if full else {}
        sections += [
            checks.section_of(one.checks, one.length, words),
            sentences.section_of(one.verdict, words, **shown),
            words_of_reliability.section_of(
                one.reliability, one.length, words, **({"weakest": ALL, "named": ALL} if full else {})
            ),
            _groups(one, words),
            _cameras(one, words),
            _worst(one, words),
            "\n".join(snooped_in_words(one.snooping, words, **shown)),
            "\n".join(robust_in_words(one.robust, one.length, words, **shown)),
        ]
    sections += [_iterations(summary, words), _domains(summary, words)]
    return escaped("\n\n".join(section for section in sections if section) + "\n")


def _head(summary: Summary, words: Words) -> str:
    lines = [heading(summary.title or words("Adjustment in domains"))]
    lines.append(paragraphs(verdict(summary, words)))
    counts = words(
        "n = {n}, u = {u}, d = {d}, redundancy {redundancy}",
        n=summary.observations,
        u=summary.unknowns,
        d=summary.defect,
        redundancy=summary.redundancy,
    )
    lines.append(counts)
    if summary.solution is not None:
        one = summary.solution
        lines.append(words("sigma0 a posteriori {after}, a priori 1", after=fixed(one.sigma0, 6)))
        sums = words("sum of redundancy numbers {sum}", sum=fixed(one.redundancy_sum, 6))
        lines.append(sums)
    lines.append(paragraphs(words("Datum: {datum}", datum=words.told(summary.datum))))
    return "\n".join(lines)


def verdict(summary: Summary, words: Words) -> str:
    """What came out, in a few sentences."""
    one = summary.solution
    if one is None:
        said = words("No solution: {reason}.", reason=words.told(summary.reason or summary.outcome))
        names = ", ".join(summary.loose[:12])
        return f"{said} {words('Not determined: {names}.', names=names)}" if names else said
    count, limit = one.flagged, fixed(one.critical, 2)
    if not one.test.accepted:
        told = words(
            "The adjustment converged; the global test rejects. "
            "{count:observation exceeds|observations exceed} |w| = {limit}.",
            count=count,
            limit=limit,
        )
    else:
        told = words(
            "The adjustment converged; the global test accepts. "
            "{count:observation exceeds|observations exceed} |w| = {limit}.",
            count=count,
            limit=limit,
        )
    return " ".join([told, *sentences.contradictions(one.verdict, words)])


def _groups(one: Solution, words: Words) -> str:
    rows = [
        [
            str(row["name"]),
            str(row["type"]),
            str(row["observations"]),
            fixed(row["redundancy"], 3),
            fixed(row["sigma0"], 4),
            fixed(row["largest_w"], 2),
            str(row["flagged"]),
        ]
        for row in one.groups
    ]
    headers = ["group", "type", "observations", "sum r", "sigma0", "largest w", "flagged"]
    lines = [heading(words("Observation groups")), table(headers, rows, 2, words)]
    return "\n".join([*lines, *components_in_words(one.components, one.groups, one.settings, words)])


def _cameras(one: Solution, words: Words) -> str:
    rows = [
        [str(camera["id"]), name, short(part["value"], 8), short(part["sigma"], 3), str(part["status"])]
        for camera in one.cameras
        for name, part in camera["components"].items()
    ]
    if not rows:
        return ""
    headers = ["camera", "component", "value", "sigma", "status"]
    return f"{heading(words('Cameras'))}\n{table(headers, rows, 2, words, True)}"


def _worst(one: Solution, words: Words) -> str:
    rows = [
        [
            *(str(row[key] or "") for key in ("type", "at", "from", "to", "component")),
            fixed(row["v"], 5),
            fixed(row["r"], 3),
            fixed(row["w"], 2),
        ]
        for row in one.worst.head(_LISTED).to_dicts()
    ]
    headers = ["type", "at", "from", "to", "component", "v", "r", "w"]
    return f"{heading(words('Largest test values'))}\n{table(headers, rows, 5, words)}"


def _iterations(summary: Summary, words: Words) -> str:
    rows = [
        [str(number + 1), short(size, 8), short(change, 3)]
        for number, (size, change) in enumerate(summary.iterations)
    ]
    return (
        f"{heading(words('Iterations'))}\n{table(['step', 'sigma0', 'change'], rows, 1, words)}"
        if rows
        else ""
    )


def _domains(summary: Summary, words: Words) -> str:
    rows = [[str(d), str(rays), str(outer)] for d, (rays, outer) in enumerate(summary.domains)]
    said = paragraphs(
        words(
            "Each domain reduces what is inside it and hands up its normal equations in the outer unknowns, those "
            "it has in common with others; {root} are left at the root. The results are those of one adjustment "
            "of everything.",
            root=summary.root,
        )
    )
    listed = table(["domain", "image points", "outer unknowns"], rows, 1, words)
    return "\n".join([heading(words("Domains")), said, listed])
