"""JAG3D's project as SQL text: the rows of its tables as HSQLDB's command SCRIPT writes them.

A project of JAG3D is an HSQLDB data base: its ``.script`` has the tables, and their rows are in a binary file ``.data``
beside it, which is not read; a text with the rows is what ``SCRIPT 'file'`` writes. Source: the tables that JAG3D makes
(``SQLManager``): metres and radians, y east and x north.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.formats.jag3d.columns import AXES
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_TABLE = re.compile(r'CREATE\s+(?:\w+\s+)?TABLE\s+(?:"?\w+"?\.)?"(\w+)"\s*\((.*)\)\s*;?\s*$', re.IGNORECASE)
_INSERT = re.compile(r'INSERT\s+INTO\s+(?:"?\w+"?\.)?"(\w+)"\s+VALUES\s*\((.*)\)\s*;?\s*$', re.IGNORECASE)
_VALUE = re.compile(r"\s*('(?:[^']|'')*'|[^',]*)\s*(,|$)")
_TYPES = {
    "1": "height_difference",
    "2": "directions",
    "3": "horizontal_distance",
    "4": "distance",
    "5": "zenith_angle",
}
"""Types of observations by JAG3D's numbers; 6 to 8 are GNSS."""
_SIGMA = {"directions": "5e-6", "zenith_angle": "5e-6"}
SIGMA_LENGTH = "0.002"
"""σ (rad, m) where neither a row nor its group says any."""
_FIXED, _OBSERVED, _DATUM = "1", "2", "3"
_COLUMNS = {
    "height_difference": ("from", "to", "dz", "sigma"),
    "directions": ("station", "set", "to", "horizontal", "sigma"),
    "horizontal_distance": ("from", "to", "distance", "sigma"),
    "distance": ("from", "to", "distance", "sigma", "from_height", "to_height"),
    "zenith_angle": ("from", "to", "zenith_angle", "sigma", "from_height", "to_height"),
}
_LEFT_OUT = ("GNSSObservationApriori", "CongruenceAnalysisPointPairApriori", "VerticalDeflectionApriori")


@dataclass
class Script:
    """Rows of tables by their names, each as values by column, with its line."""

    columns: dict[str, list[str]] = field(default_factory=dict)
    rows: dict[str, list[tuple[dict[str, str], int]]] = field(default_factory=dict)
    cached: bool = False
    """True if rows of a table are in the file .data."""

    def of(self, name: str) -> list[tuple[dict[str, str], int]]:
        """Rows of a table."""
        return self.rows.get(name, [])


def read_jag3d_script(path: Path) -> Document:
    """The project of an SQL text. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    script = _parse(path, draft)
    if "PointApriori" not in script.columns:
        raise InputError(
            [Problem('found no table "PointApriori", expected a project of JAG3D', str(path), 1)]
        )
    if not script.of("PointApriori") and not draft.problems:
        raise InputError([Problem(_without_rows(script, path), str(path), 1)])
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    try:
        _put_points(script, draft)
        _put_observations(script, draft)
    except KeyError as error:
        draft.problem(f"found no column {error} in a table of the project")
    for name in _LEFT_OUT:
        if script.of(name):
            draft.note(f"{counted(len(script.of(name)), 'row')} of {name} not read", script.of(name)[0][1])
    return draft.finish()


def _without_rows(script: Script, path: Path) -> str:
    """Hint for a project without points: their rows may be in its binary file."""
    if not script.cached:
        return "found no points in this project: its tables are empty"
    data = path.with_suffix(".data").name
    place = f"jdbc:hsqldb:file:{path.stem}"
    steps = f"open it in a tool of HSQLDB ({place}), run SCRIPT 'rows.script', and read rows.script"
    return f"the rows of this project are in {data}, a binary file that HSQLDB alone reads: {steps}"


def _parse(path: Path, draft: Draft) -> Script:
    script = Script()
    for line, text in enumerate(read_lines(path, draft), start=1):
        table, insert = _TABLE.match(text.strip()), _INSERT.match(text.strip())
        if table:
            script.cached |= "CACHED" in text.upper().partition("TABLE")[0]
            script.columns[table[1]] = re.findall(r'(?:^|,)\s*"(\w+)"\s+[A-Z]', table[2])
        elif insert:
            values = _values(insert[2])
            columns = script.columns.get(insert[1])
            if columns is None or len(values) != len(columns):
                found = len(values)
                words = f"{insert[1]}: found {found} values, expected {len(columns or ())} as its table has columns"
                draft.problem(words, line)
                continue
            script.rows.setdefault(insert[1], []).append((dict(zip(columns, values, strict=True)), line))
    return script


def _values(text: str) -> list[str]:
    """Values of a row: texts without their quotes, everything else as it stands."""
    values, at = [], 0
    while at <= len(text):
        found = _VALUE.match(text, at)
        if found is None or (found.end() == at and at < len(text)):
            return []
        word = found[1].strip()
        values.append(_text(word) if word.startswith("'") else word)
        if not found[2]:
            break
        at = found.end()
    return values


def _text(word: str) -> str:
    plain = word[1:-1].replace("''", "'")
    return re.sub(r"\\u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), plain)


def _on(row: dict[str, str]) -> bool:
    return row["enable"].upper() == "TRUE"


def _put_points(script: Script, draft: Draft) -> None:
    """Points of the groups that are switched on: fixed, observed, free with and without the datum."""
    groups = {row["id"]: row for row, _ in script.of("PointGroup") if _on(row)}
    tables: dict[tuple[str, str], list[Row]] = {}
    datum: list[str] = []
    off = 0
    for row, line in script.of("PointApriori"):
        group = groups.get(row["group_id"])
        if group is None or not _on(row):
            off += 1
            continue
        size = group["dimension"] if group["dimension"] in AXES else "3"
        axes = {"x": "y", "y": "x", "z": "z"}
        try:
            place = [repr(number(row[f"{axes[axis]}0"])) for axis in AXES[size]]
            sigma = [_sigma_of(row[f"sigma_{axes[axis]}0"]) for axis in AXES[size]]
        except ValueError as error:
            draft.problem(f"point {row['name']!r}: {error}", line)
            continue
        own = sigma if group["type"] == _OBSERVED else []
        tables.setdefault((group["type"], size), []).append(Row([row["name"], *place, *own], line))
        datum += [row["name"]] if group["type"] == _DATUM else []
    for (type_, size), rows in tables.items():
        axes_of = AXES[size]
        columns = ("id", *axes_of, *(f"sigma_{axis}" for axis in axes_of if type_ == _OBSERVED))
        draft.table("points", columns, rows, fixed=list(axes_of) if type_ == _FIXED else [])
    if off:
        draft.note(f"{counted(off, 'point')} switched off")
    count = sum(map(len, tables.values()))
    if datum:
        draft.put("datum", "free" if len(datum) == count else {"free": datum})
    sizes = {size for _, size in tables}
    draft.put("settings", {"dimensions": {"1": "z", "2": "xy"}.get("".join(sizes), "xyz")})


def _sigma_of(text: str) -> str:
    value = number(text)
    return repr(value) if value > 0.0 else SIGMA_LENGTH


def _put_observations(script: Script, draft: Draft) -> None:
    groups = {row["id"]: row for row, _ in script.of("ObservationGroup") if _on(row)}
    constant = _uncertainties(script, draft)
    tables: dict[str, list[Row]] = {}
    stations: dict[tuple[str, str], int] = {}
    sets: Counter[str] = Counter()
    off, without = 0, 0
    for row, line in script.of("ObservationApriori"):
        group = groups.get(row["group_id"])
        type_ = _TYPES.get(group["type"]) if group is not None else None
        if group is None or type_ is None or not _on(row):
            off += 1
            continue
        start, end = row["start_point_name"], row["end_point_name"]
        try:
            value, sigma = number(row["value_0"]), number(row["sigma_0"])
            heights = [number(row[f"{kind}_height"]) for kind in ("instrument", "reflector")]
            if start == end:
                raise ValueError(f"found {start!r} at both ends")
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        own = repr(sigma) if sigma > 0.0 else constant.get(row["group_id"], "")
        without += not own
        cells: list[str | None] = [start, end, repr(value), own or _SIGMA.get(type_, SIGMA_LENGTH)]
        if type_ == "directions":
            if (start, row["group_id"]) not in stations:
                sets[start] += 1
                stations[start, row["group_id"]] = sets[start]
            number_ = stations[start, row["group_id"]]
            cells.insert(1, None if number_ == 1 else str(number_))
        if len(_COLUMNS[type_]) == 6:
            cells += [repr(height) for height in heights]
        tables.setdefault(type_, []).append(Row(cells, line))
    for type_, rows in tables.items():
        draft.table("observations", _COLUMNS[type_], rows, type=type_)
    if not tables:
        draft.problem("there are no observations that are followed")
    if off:
        draft.note(f"{counted(off, 'observation')} switched off, or of a type that is not read")
    if without:
        words = f"{counted(without, 'observation')} without σ: {_SIGMA['directions']} rad or {SIGMA_LENGTH} m is taken"
        draft.note(words)


def _uncertainties(script: Script, draft: Draft) -> dict[str, str]:
    """The constant part of the σ of groups (10 of JAG3D's types); parts that depend on the distance are told."""
    constant: dict[str, str] = {}
    depending = []
    for row, line in script.of("ObservationGroupUncertainty"):
        try:
            value = number(row["value"])
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        if row["type"] == "10" and value > 0.0:
            constant[row["group_id"]] = repr(value)
        elif row["type"] != "10" and value > 0.0:
            depending.append(line)
    if depending:
        words = f"parts of σ that depend on the distance in {counted(len(depending), 'row')} not read"
        draft.note(words, depending[0])
    return constant
