"""A folder of JAG3D's column text as a project; names of files tell their kinds."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.formats.jag3d.columns import AXES, OBSERVATION_FILE, OBSERVATIONS, POINT_FILE
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_SIGMA = {"directions": "0.0003", "zenith_angle": "0.0003"}
SIGMA_LENGTH, SIGMA_POINT = "0.002", "0.002"
"""σ in gon and m where lines have none: those of the groups stand in JAG3D's project."""
_COLUMNS = {
    "height_difference": ("from", "to", "dz", "sigma"),
    "directions": ("station", "set", "to", "horizontal", "sigma"),
    "horizontal_distance": ("from", "to", "distance", "sigma"),
    "distance": ("from", "to", "distance", "sigma", "from_height", "to_height"),
    "zenith_angle": ("from", "to", "zenith_angle", "sigma", "from_height", "to_height"),
}


def read_jag3d(path: Path) -> Document:
    """The project of a folder. Raises :class:`InputError` with every mistake found."""
    if not path.is_dir():
        raise InputError([Problem("expected the folder with the text files of a JAG3D network", str(path))])
    draft = Draft(str(path))
    draft.put("title", path.resolve().name)
    draft.put("units", {"length": "m", "angle": "gon"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    dimensions: set[str] = set()
    datum: list[str] = []
    known: dict[str, str] = {}
    sets: Counter[str] = Counter()
    others, without = [], Counter[str]()
    for file in sorted(path.iterdir()):
        points, observed = POINT_FILE.match(file.name), OBSERVATION_FILE.match(file.name)
        if points:
            kind, size = points[1].lower(), points[2]
            dimensions.add(size)
            names = _read_points(file, kind, AXES[size], known, draft)
            datum += names if kind == "datum" else []
        elif observed:
            _read_observations(file, OBSERVATIONS[observed[1].lower()], sets, without, draft)
        else:
            others.append(file.name)
    if others:
        draft.note(f"not read, for their names tell nothing: {', '.join(others[:10])}")
    for what, count in without.items():
        draft.note(
            f"{counted(count, 'line')} of {what} without σ: {_SIGMA.get(what, SIGMA_LENGTH)} gon or m is taken"
        )
    if not known or not draft.data.get("observations"):
        draft.problem("there are no points, or no observations: names of files tell what they are")
    if datum:
        draft.put("datum", "free" if len(datum) == len(known) else {"free": datum})
    size = {frozenset("1"): "z", frozenset("2"): "xy"}.get(frozenset(dimensions), "xyz")
    draft.put("settings", {"dimensions": size})
    return draft.finish()


def _words(file: Path, draft: Draft) -> list[tuple[int, list[str]]]:
    lines = enumerate(read_lines(file, draft), start=1)
    return [
        (line, text.split()) for line, text in lines if text.strip() and not text.lstrip().startswith("#")
    ]


def _read_points(
    file: Path, kind: str, axes: tuple[str, ...], known: dict[str, str], draft: Draft
) -> list[str]:
    """Names of the points of a file: name, coordinates in the order y x z of JAG3D, σ."""
    rows, count = [], len(axes)
    for line, (name, *words) in _words(file, draft):
        try:
            numbers = [number(word.replace(",", ".")) for word in words]
            if len(numbers) < count:
                raise ValueError(
                    f"found {len(numbers)} numbers behind the name, expected {count} coordinates"
                )
            sigma = _sigma(numbers[count:], count) if kind == "stochastic" else []
        except ValueError as error:
            draft.problem(str(error), line, str(file))
            continue
        if name in known:
            draft.problem(f"point {name!r} is in {known[name]}, too", line, str(file))
            continue
        known[name] = file.name
        rows.append(Row([name, *(repr(v) for v in numbers[:count]), *sigma], line))
    if rows:
        columns = ("id", *axes, *(f"sigma_{axis}" for axis in axes if kind == "stochastic"))
        draft.table("points", columns, rows, str(file), fixed=list(axes) if kind == "reference" else [])
    return [str(row.cells[0]) for row in rows]


def _sigma(numbers: list[float], count: int) -> list[str]:
    """One σ for all, one in plan and one in height, or one each. Raises ``ValueError``."""
    if len(numbers) > count or any(value <= 0.0 for value in numbers):
        raise ValueError(
            f"found the σ {' '.join(map(repr, numbers))}, expected up to {count} numbers above 0"
        )
    if not numbers:
        return [SIGMA_POINT] * count
    if len(numbers) == count:
        return [repr(value) for value in numbers]
    plan = [repr(numbers[0])] * min(count, 2)
    return [*plan, repr(numbers[-1])] if count == 3 else plan[:count]


def _read_observations(
    file: Path, type_: str, sets: Counter[str], without: Counter[str], draft: Draft
) -> None:
    """Lines from, to, then value, or value and σ, or both heights, value, and σ; a σ of 1 or more is a distance."""
    rows = []
    stations: set[str] = set()
    for line, words in _words(file, draft):
        try:
            if len(words) < 3 or len(words) > 6:
                raise ValueError(f"found {len(words)} words, expected from, to, heights, value, σ")
            start, end = words[:2]
            numbers = [number(word) for word in words[2:]]
            if start == end:
                raise ValueError(f"found {start!r} at both ends")
            heights = numbers[:2] if len(numbers) > 2 else [0.0, 0.0]
            value, *sigma = numbers[2:] if len(numbers) > 2 else numbers
            if type_ == "height_difference" and any(heights):
                raise ValueError("found heights of staffs; height differences are those of the points here")
        except ValueError as error:
            draft.problem(str(error), line, str(file))
            continue
        own = repr(sigma[0]) if sigma and 0.0 < sigma[0] < 1.0 else _SIGMA.get(type_, SIGMA_LENGTH)
        without[type_] += not (sigma and 0.0 < sigma[0] < 1.0)
        if type_ == "directions":
            if start not in stations:
                stations.add(start)
                sets[start] += 1
            cells = [start, None if sets[start] == 1 else str(sets[start]), end, repr(value), own]
        else:
            cells = [start, end, repr(value), own]
        if len(_COLUMNS[type_]) == 6:
            cells += [repr(height) for height in heights]
        rows.append(Row(cells, line))
    if rows:
        draft.table("observations", _COLUMNS[type_], rows, str(file), type=type_, name=file.stem)
