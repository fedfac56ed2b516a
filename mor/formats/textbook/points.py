"""Coordinates and datum of a textbook network: fixed, free or observed with covariances."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor.formats.draft import Draft, Row, number
from mor.formats.textbook.sections import Line, Section

DATUM_KINDS = ("fix", "free", "dyn")


@dataclass
class Coordinates:
    """Coordinates as written, by point and component, and what the datum says of them."""

    estimated: str
    """Estimated components: ``z``, ``xy`` or ``xyz``."""
    texts: dict[str, dict[str, str]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    fixed: set[tuple[str, str]] = field(default_factory=set)
    free: list[tuple[str, str]] | None = None
    """Components that carry the datum of a free network; ``None`` if it is none."""
    observed: list[tuple[str, str]] = field(default_factory=list)
    covariance: list[list[str]] = field(default_factory=list)
    datum_line: int = 0


def read_coordinates(sections: list[Section], estimated: str, draft: Draft) -> Coordinates:
    """Coordinates: ``id x y [z]``; in levelling networks the height stands in the last column."""
    result = Coordinates(estimated)
    for line in (line for section in sections if section.name == "Coordinates" for line in section.lines):
        name, *values = line.words
        names = {1: "z", 2: "xy", 3: "xyz"}.get(len(values), "")
        if len(values) == 2 and estimated == "z":
            names = "xz"
        lacking = [component for component in estimated if component not in names]
        if lacking or not names:
            words = f"found {len(values)} coordinates of point {name!r}, expected {', '.join(estimated)}"
            draft.problem(words, line.number)
            continue
        if name in result.texts:
            draft.problem(f"point {name!r} is given twice (first in line {result.lines[name]})", line.number)
            continue
        if _numbers(values, line, draft):
            kept = {c: text for c, text in zip(names, values, strict=True) if c in estimated}
            result.texts[name], result.lines[name] = kept, line.number
    for section in sections:
        if section.name == "Datum":
            _read_datum(section, result, draft)
    return result


def _numbers(words: list[str], line: Line, draft: Draft) -> bool:
    before = len(draft.problems)
    for word in words:
        try:
            number(word)
        except ValueError as error:
            draft.problem(str(error), line.number)
    return len(draft.problems) == before


def _read_datum(section: Section, coordinates: Coordinates, draft: Draft) -> None:
    kind = ""
    coordinates.datum_line = section.number
    for line in section.lines:
        words = list(line.words)
        if words[0].lower() in DATUM_KINDS:
            kind = words.pop(0).lower()
            if kind == "free":
                coordinates.free = coordinates.free or []
        if not kind:
            draft.problem(f"found {words[0]!r}, expected {', '.join(DATUM_KINDS)}", line.number)
            return
        if kind == "dyn" and words:
            component = _component(words[0], coordinates, line, draft)
            if component is not None and _numbers(words[1:], line, draft):
                coordinates.observed.append(component)
                coordinates.covariance.append(words[1:])
            continue
        for component in (c for word in words for c in _components(word, coordinates, line, draft)):
            if kind == "fix":
                coordinates.fixed.add(component)
            elif coordinates.free is not None:
                coordinates.free.append(component)
    coordinates.covariance[:] = _complete(coordinates.covariance, section.number, draft)


def _complete(rows: list[list[str]], line: int, draft: Draft) -> list[list[str]]:
    """The whole covariance matrix [m²] behind its rows: complete, a triangle of them, or a σ [m] of each alone."""
    size = len(rows)
    lengths = [len(row) for row in rows]
    if all(length == size for length in lengths) and size > 1:
        return rows
    if all(length == 1 for length in lengths):
        return [
            [repr(float(row[0]) * float(row[0])) if i == k else "0" for k in range(size)]
            for i, row in enumerate(rows)
        ]
    lower = lengths == list(range(1, size + 1))
    if lower or lengths == list(range(size, 0, -1)):
        at = (lambda i, k: rows[i][k]) if lower else (lambda i, k: rows[k][i - k])
        return [[at(max(i, k), min(i, k)) for k in range(size)] for i in range(size)]
    words = f"expected of {size} observed coordinates a σ each, a covariance matrix {size} × {size} or a triangle of it"
    draft.problem(f"found rows of {', '.join(map(str, lengths))} numbers, {words}", line)
    return []


def _components(word: str, coordinates: Coordinates, line: Line, draft: Draft) -> list[tuple[str, str]]:
    """Point and component behind ``xA``; all components of the point behind a bare name."""
    means_one = word[:1].lower() in coordinates.estimated and word[1:] in coordinates.texts
    if word in coordinates.texts and not means_one:
        return [(word, component) for component in coordinates.estimated]
    component = _component(word, coordinates, line, draft)
    return [] if component is None else [component]


def _component(word: str, coordinates: Coordinates, line: Line, draft: Draft) -> tuple[str, str] | None:
    """Point and component behind ``xA``, or behind the bare name of a levelled point."""
    if coordinates.estimated == "z" and word in coordinates.texts:
        return word, "z"
    if word[:1].lower() in coordinates.estimated and word[1:] in coordinates.texts:
        return word[1:], word[0].lower()
    expected = (
        "a point"
        if coordinates.estimated == "z"
        else f"{', '.join(coordinates.estimated)} and a point, as in xA"
    )
    draft.problem(f"found {word!r}, expected {expected} of [Coordinates]", line.number)
    return None


def put_coordinates(coordinates: Coordinates, draft: Draft) -> None:
    """Tables of points by their fixed components, observed coordinates, and the datum."""
    tables: dict[str, list[Row]] = {}
    for name, texts in coordinates.texts.items():
        held = "".join(c for c in coordinates.estimated if (name, c) in coordinates.fixed)
        tables.setdefault(held, []).append(
            Row([name, *(texts.get(c) for c in "xyz")], coordinates.lines[name])
        )
    for held, rows in tables.items():
        draft.table("points", ("id", "x", "y", "z"), rows, fixed=list(held))
    if coordinates.free is not None:
        draft.put("datum", _free(coordinates), coordinates.datum_line)
    if coordinates.covariance:
        _put_observed(coordinates, draft)


def _free(coordinates: Coordinates) -> dict[str, object]:
    if not coordinates.free:
        return {"free": "all"}
    by_point: dict[str, str] = {}
    for name, component in coordinates.free:
        by_point[name] = by_point.get(name, "") + component
    by_components: dict[str, list[str]] = {}
    for name, components in by_point.items():
        by_components.setdefault("".join(sorted(set(components))), []).append(name)
    return {"free": by_components}


def _put_observed(coordinates: Coordinates, draft: Draft) -> None:
    """Observed coordinates, the covariances in the order of points and components."""
    names = list(dict.fromkeys(name for name, _ in coordinates.observed))
    ordered = sorted(
        range(len(coordinates.observed)),
        key=lambda k: (names.index(coordinates.observed[k][0]), coordinates.observed[k][1]),
    )
    chosen = set(coordinates.observed)
    rows = [
        Row(
            [name, *(coordinates.texts[name][c] if (name, c) in chosen else None for c in "xyz")],
            coordinates.datum_line,
        )
        for name in names
    ]
    matrix = np.array(coordinates.covariance, dtype=object)[np.ix_(ordered, ordered)].tolist()
    draft.table("observations", ("point", "x", "y", "z"), rows, type="coordinates", covariance=matrix)
