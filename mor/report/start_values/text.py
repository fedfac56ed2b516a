"""Start values for reading: how many, in which parts, each with its rule and its precision, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.approximation import Approximation
from mor.approximate.parts.history import Join
from mor.approximate.parts.rule import Rule
from mor.report.layout import heading, short, table
from mor.report.start_values.data import StartValue, counts
from mor.report.words.language import ENGLISH, Words

SHOWN = 1000
"""Values of a kind that the text lists; JSON has all."""
_EXPLAINED = (
    "misfit: root mean square of observed - computed of its own observations at the start values, in units of sigma.",
    "sigma: largest component, from these observations with all else held, times the misfit where that exceeds 1;",
    "what the neighbours are wrong by is not in it. A dash: its own observations do not determine it alone.",
)
STATUSES = ("given", "found", "replaced", "missing")


def start_text(approximation: Approximation, rows: Sequence[StartValue], words: Words = ENGLISH) -> str:
    """The report on start values."""
    all_given = words("All start values are given.") if all(row.status == "given" for row in rows) else ""
    parts = [
        all_given,
        _counts(rows, words),
        _parts(approximation, words),
        *_values(rows, words),
        _missing(approximation, words),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _counts(rows: Sequence[StartValue], words: Words) -> str:
    lines = [
        [words.listed(kind), words.listed(what), *(str(number[status]) for status in STATUSES)]
        for kind, what, number in counts(rows)
    ]
    return f"{heading(words('Start values'))}\n{table(['thing', 'value', *STATUSES], lines, 2, words)}"


def _parts(approximation: Approximation, words: Words) -> str:
    if not approximation.parts:
        return ""
    lines = []
    for join in approximation.parts:
        images, stations = _frames(join, approximation)
        lines.append(
            [
                str(join.number), str(images), str(stations), str(len(join.points)), _knows(join, words),
                words.listed("object system") if join.into == 0 else str(join.into), _tied(join, words),
                sentence(join.began, words),
            ]
        )  # fmt: skip
    headers = ["part", "images", "stations", "points", "knows", "joined", "what ties it", "began with"]
    drawn = table(headers, lines, 1, words, True)
    explained = words(
        "Part 0 is the object system with what is given. knows: vertical, direction of the axes in plan, scale."
    )
    return f"{heading(words('Parts'))}\n{drawn}\n{explained}"


def _frames(join: Join, approximation: Approximation) -> tuple[int, int]:
    """Counts of images, stations and sets of a part."""
    names = {approximation.frames[number].name for number in join.frames}
    names |= {approximation.sights[number].name for number in join.sights}
    images = sum(name.startswith("image ") for name in names)
    return images, len(names) - images


def _knows(join: Join, words: Words) -> str:
    names = ("vertical", "direction", "scale")
    known = [
        words.listed(n) for n, k in zip(names, (join.levelled, join.oriented, join.scaled), strict=True) if k
    ]
    return ", ".join(known) or "-"


def _tied(join: Join, words: Words) -> str:
    if join.tie is None:
        return words("nothing: it stays in its axes")
    tie = join.tie
    said = words(
        "redundancy {redundancy}, misfit {misfit} %",
        redundancy=tie.redundancy,
        misfit=short(100.0 * tie.misfit, 2),
    )
    if tie.open:
        said += "; " + words("{count:movement stays open|movements stay open}", count=tie.open)
    if tie.alternatives:
        said += "; " + words(
            "{count:other movement fits|other movements fit} as well: the likeliest one is taken",
            count=tie.alternatives,
        )
    return said


def _values(rows: Sequence[StartValue], words: Words) -> list[str]:
    lines = [_line(row, words) for row in rows[:SHOWN] if row.status != "missing"]
    if not lines:
        return []
    headers = [
        "thing",
        "id",
        "value",
        "status",
        "part",
        "observations",
        "misfit [sigma]",
        "sigma",
        "unit",
        "how",
    ]
    parts = [heading(words("Values")), table(headers, lines, 4, words, True)]
    if len(rows) > SHOWN:
        parts.append(words("{count} more stand in the JSON report.", count=len(rows) - SHOWN))
    parts += [words(line) for line in _EXPLAINED]
    return ["\n".join(parts)]


def _line(row: StartValue, words: Words) -> list[str]:
    largest = float(np.nanmax(row.sigma)) if np.isfinite(row.sigma).any() else None
    status = words.listed(row.status)
    if row.status in ("found", "replaced") and 0 < len(row.found) < len(row.components):
        status += f" ({', '.join(row.found)})"
    return [
        words.listed(row.kind),
        row.name,
        words.listed(row.what),
        status,
        "-" if row.part is None else str(row.part),
        str(row.observations),
        short(row.misfit, 3),
        short(largest, 2),
        row.units[0] if largest is not None else "",
        "" if row.how is None else sentence(row.how, words),
    ]


def sentence(how: Rule, words: Words) -> str:
    """A rule in the words of a language; names of things with the word for what they are."""
    return words(how.words, **{name: _named(value, words) for name, value in how.values.items()})


def _named(value: str | int | float, words: Words) -> str:
    kind, blank, name = str(value).partition(" ")
    return f"{words.listed(kind)} {name}" if blank else words.listed(kind)


def _missing(approximation: Approximation, words: Words) -> str:
    if not approximation.missing:
        return ""
    rows = [
        [words.listed(thing.kind), thing.name, str(thing.observations), words.told(thing.reason)]
        for thing in approximation.missing
    ]
    lines = [heading(words("What stays without start values"))]
    lines.append(table(["thing", "id", "observations", "reason"], rows, 2, words, True))
    lines += [sentence(remark, words) for remark in approximation.remarks]
    return "\n".join(lines)
