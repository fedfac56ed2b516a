"""JAG3D files: read and written."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.content import Content, content_of, not_carried, points
from mor.formats.draft import Draft, Row, Written, parse_number, read_lines
from mor.formats.networks import (
    ObservationTable,
    circle_in_face_one,
    groups,
    heights_of,
    places,
    stations,
    tilted_stations,
    zenith_in_face_one,
)
from mor.formats.recognition import AXES, OBSERVATION_FILE, OBSERVATIONS, POINT_FILE, POINTS
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.project.schema import Datum
from mor.units import ANGLE_UNITS

# ---- JAG3D's project as SQL text: the rows of its tables as HSQLDB's command SCRIPT writes them.
#
# A project of JAG3D is an HSQLDB data base: its ``.script`` has the tables, and their rows are in a binary
# file ``.data`` beside it, which is not read; a text with the rows is what ``SCRIPT 'file'`` writes. Source:
# the tables that JAG3D makes (``SQLManager``): metres and radians, y east and x north.

_TABLE = re.compile(r'CREATE\s+(?:\w+\s+)?TABLE\s+(?:"?\w+"?\.)?"(\w+)"\s*\((.*)\)\s*;?\s*$', re.IGNORECASE)
_INSERT = re.compile(r'INSERT\s+INTO\s+(?:"?\w+"?\.)?"(\w+)"\s+VALUES\s*\((.*)\)\s*;?\s*$', re.IGNORECASE)
_VALUE = re.compile(r"\s*('(?:[^']|'')*'|[^',]*)\s*(,|$)")
_TYPES = {"1": "height_difference", "2": "directions", "3": "horizontal_distance", "4": "distance", "5": "zenith_angle"}
"""Types of observations by JAG3D's numbers; 6 to 8 are GNSS."""
SIGMA_LENGTH = "0.002"
"""σ (m) where neither a row, or line, nor its group says any."""
_COLUMNS = {
    "height_difference": ("from", "to", "dz", "sigma"),
    "directions": ("station", "set", "to", "horizontal", "sigma"),
    "horizontal_distance": ("from", "to", "distance", "sigma"),
    "distance": ("from", "to", "distance", "sigma", "from_height", "to_height"),
    "zenith_angle": ("from", "to", "zenith_angle", "sigma", "from_height", "to_height"),
}


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
        raise InputError([Message('found no table "PointApriori", expected a project of JAG3D', str(path), 1)])
    if not script.of("PointApriori") and not draft.problems:
        raise InputError([Message(_without_rows(script, path), str(path), 1)])
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    try:
        _put_points(script, draft)
        _put_observations(script, draft)
    except KeyError as error:
        draft.problem(f"found no column {error} in a table of the project")
    left_out = ("GNSSObservationApriori", "CongruenceAnalysisPointPairApriori", "VerticalDeflectionApriori")
    for name in left_out:
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
    is_fixed, is_observed, is_datum = "1", "2", "3"
    for row, line in script.of("PointApriori"):
        group = groups.get(row["group_id"])
        if group is None or not _on(row):
            off += 1
            continue
        size = group["dimension"] if group["dimension"] in AXES else "3"
        axes = {"x": "y", "y": "x", "z": "z"}
        with draft.at(line, name=f"point {row['name']!r}"):
            place = [repr(parse_number(row[f"{axes[axis]}0"])) for axis in AXES[size]]
            sigma = [_sigma_of(row[f"sigma_{axes[axis]}0"]) for axis in AXES[size]]
            own = sigma if group["type"] == is_observed else []
            tables.setdefault((group["type"], size), []).append(Row([row["name"], *place, *own], line))
            datum += [row["name"]] if group["type"] == is_datum else []
    for (type_, size), rows in tables.items():
        axes_of = AXES[size]
        columns = ("id", *axes_of, *(f"sigma_{axis}" for axis in axes_of if type_ == is_observed))
        draft.table("points", columns, rows, fixed=list(axes_of) if type_ == is_fixed else [])
    if off:
        draft.note(f"{counted(off, 'point')} switched off")
    count = sum(map(len, tables.values()))
    if datum:
        draft.put("datum", "free" if len(datum) == count else {"free": datum})
    sizes = {size for _, size in tables}
    draft.put("settings", {"dimensions": {"1": "z", "2": "xy"}.get("".join(sizes), "xyz")})


def _sigma_of(text: str) -> str:
    value = parse_number(text)
    return repr(value) if value > 0.0 else SIGMA_LENGTH


def _put_observations(script: Script, draft: Draft) -> None:
    groups = {row["id"]: row for row, _ in script.of("ObservationGroup") if _on(row)}
    constant = _uncertainties(script, draft)
    tables: dict[str, list[Row]] = {}
    stations: dict[tuple[str, str], int] = {}
    sets: Counter[str] = Counter()
    off, without = 0, 0
    # σ (rad) where neither a row nor its group says any.
    usual = {"directions": "5e-6", "zenith_angle": "5e-6"}
    for row, line in script.of("ObservationApriori"):
        group = groups.get(row["group_id"])
        type_ = _TYPES.get(group["type"]) if group is not None else None
        if group is None or type_ is None or not _on(row):
            off += 1
            continue
        start, end = row["start_point_name"], row["end_point_name"]
        with draft.at(line):
            value, sigma = parse_number(row["value_0"]), parse_number(row["sigma_0"])
            heights = [parse_number(row[f"{kind}_height"]) for kind in ("instrument", "reflector")]
            if start == end:
                raise ValueError(f"found {start!r} at both ends")
            own = repr(sigma) if sigma > 0.0 else constant.get(row["group_id"], "")
            without += not own
            cells: list[str | None] = [start, end, repr(value), own or usual.get(type_, SIGMA_LENGTH)]
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
        draft.problem("there are no supported observations")
    if off:
        draft.note(f"{counted(off, 'observation')} switched off, or of a type that is not read")
    if without:
        words = f"{counted(without, 'observation')} without σ: {usual['directions']} rad or {SIGMA_LENGTH} m is taken"
        draft.note(words)


def _uncertainties(script: Script, draft: Draft) -> dict[str, str]:
    """The constant part of the σ of groups (10 of JAG3D's types); parts that depend on the distance are told."""
    constant: dict[str, str] = {}
    depending = []
    for row, line in script.of("ObservationGroupUncertainty"):
        with draft.at(line):
            value = parse_number(row["value"])
            if row["type"] == "10" and value > 0.0:
                constant[row["group_id"]] = repr(value)
            elif row["type"] != "10" and value > 0.0:
                depending.append(line)
    if depending:
        draft.note(f"parts of σ that depend on the distance in {counted(len(depending), 'row')} not read", depending[0])
    return constant


# ---- A folder of JAG3D's column text as a project; names of files tell their kinds.

_SIGMAS = {"directions": "0.0003", "zenith_angle": "0.0003"}
"""σ in gon where lines have none: those of the groups stand in JAG3D's project."""


def read_jag3d(path: Path) -> Document:
    """The project of a folder. Raises :class:`InputError` with every mistake found."""
    if not path.is_dir():
        raise InputError([Message("expected the folder with the text files of a JAG3D network", str(path))])
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
        draft.note(f"{counted(count, 'line')} of {what} without σ: {_SIGMAS.get(what, SIGMA_LENGTH)} gon or m is taken")
    if not known or not draft.data.get("observations"):
        draft.problem("there are no points, or no observations: names of files tell what they are")
    if datum:
        draft.put("datum", "free" if len(datum) == len(known) else {"free": datum})
    size = {frozenset("1"): "z", frozenset("2"): "xy"}.get(frozenset(dimensions), "xyz")
    draft.put("settings", {"dimensions": size})
    return draft.finish()


def _words(file: Path, draft: Draft) -> list[tuple[int, list[str]]]:
    lines = enumerate(read_lines(file, draft), start=1)
    return [(line, text.split()) for line, text in lines if text.strip() and not text.lstrip().startswith("#")]


def _read_points(file: Path, kind: str, axes: tuple[str, ...], known: dict[str, str], draft: Draft) -> list[str]:
    """Names of the points of a file: name, coordinates in the order y x z of JAG3D, σ."""
    rows, count = [], len(axes)
    for line, (name, *words) in _words(file, draft):
        with draft.at(line, str(file)):
            numbers = [parse_number(word.replace(",", ".")) for word in words]
            if len(numbers) < count:
                raise ValueError(f"found {len(numbers)} numbers behind the name, expected {count} coordinates")
            sigma = _sigma(numbers[count:], count) if kind == "stochastic" else []
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
        raise ValueError(f"found the σ {' '.join(map(repr, numbers))}, expected up to {count} numbers above 0")
    if not numbers:
        return [SIGMA_LENGTH] * count
    if len(numbers) == count:
        return [repr(value) for value in numbers]
    plan = [repr(numbers[0])] * min(count, 2)
    return [*plan, repr(numbers[-1])] if count == 3 else plan[:count]


def _read_observations(file: Path, type_: str, sets: Counter[str], without: Counter[str], draft: Draft) -> None:
    """Lines from, to, then value, or value and σ, or both heights, value, and σ; a σ of 1 or more is a distance."""
    rows = []
    stations: set[str] = set()
    for line, words in _words(file, draft):
        with draft.at(line, str(file)):
            if len(words) < 3 or len(words) > 6:
                raise ValueError(f"found {len(words)} words, expected from, to, heights, value, σ")
            start, end = words[:2]
            numbers = [parse_number(word) for word in words[2:]]
            if start == end:
                raise ValueError(f"found {start!r} at both ends")
            heights = numbers[:2] if len(numbers) > 2 else [0.0, 0.0]
            value, *sigma = numbers[2:] if len(numbers) > 2 else numbers
            if type_ == "height_difference" and any(heights):
                raise ValueError("found heights of staffs; height differences are those of the points here")
            own = repr(sigma[0]) if sigma and 0.0 < sigma[0] < 1.0 else _SIGMAS.get(type_, SIGMA_LENGTH)
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


# ---- A terrestrial network as JAG3D's column text: a file for each kind of points and each set of directions.

Files = dict[str, list[str]]


def write_jag3d(document: Document, folder: Path, target: Path) -> Written:
    """A folder of files; what JAG3D's text has no place for is noted. Raises :class:`InputError` for the rest."""
    content = content_of(document, folder)
    types_written = (*OBSERVATIONS.values(), "zenith_directions")
    tables = groups(content, types_written)
    problems = tilted_stations(content, "JAG3D's text")
    for group in tables:
        if group.covariance is not None or group.entry.cluster:
            words = f"observations {group.entry.name or group.entry.type}: JAG3D's text has no correlations"
            problems.append(Message(words, group.rows.file))
    files = _points(content, problems)
    if problems:
        raise InputError(problems)
    known = stations(content)
    sets: Files = {}
    for group in tables:
        _observations(group, known, content, files, sets)
    files |= {f"directions_{number}.txt": lines for number, lines in enumerate(sets.values(), start=1)}
    # Files: one of points, one of observations.
    least = 2
    if not any(name.partition("_points_")[1] == "" for name in files) or len(files) < least:
        words = "JAG3D's text has points and terrestrial observations: this project has none that it can hold"
        raise InputError([Message(words, content.document.file)])
    notes = not_carried(content, types_written, ("stations",), "JAG3D's text")
    if any(e.instrument or e.centring or e.ppm for e in content.project.observations):
        words = "scales, offsets, refraction, centring: not written; σ that grow with the distance as they are"
        notes.append(Message(words, str(target)))
    notes.append(Message("units are m and gon: set them in JAG3D before the import", str(target)))
    texts = {target / name: ("\n".join(lines) + "\n").encode() for name, lines in files.items()}
    return Written(texts, notes)


def _points(content: Content, problems: list[Message]) -> Files:
    """Points by kind, with their coordinates and σ in the order of the columns."""
    found = points(content)
    values, sigma, free = places(found, content)
    dimensions = content.project.settings.dimensions
    size = {"z": "1", "xy": "2", "xyz": "3"}[dimensions]
    columns = ["xyz".index(axis) for axis in AXES[size]]
    datum = _datum(content, found.ids, AXES[size], problems)
    files: Files = {}
    for k, name in enumerate(found.ids):
        if set(name) & set(" \t#"):
            words = f"point {name!r}: names in JAG3D's text have no blanks and no #"
            problems.append(Message(words, content.document.file))
        held, observed = ~free[k, columns], np.isfinite(sigma[k, columns])
        if held.all():
            kind = "reference"
        elif observed.all():
            kind = "stochastic"
        elif held.any() or observed.any():
            words = f"point {name!r}: JAG3D holds or observes all coordinates of a point, or none"
            problems.append(Message(words, content.document.file))
            continue
        else:
            kind = "datum" if name in datum else "new"
        numbers = values[k, columns].tolist()
        if not np.isfinite(numbers).all():
            words = f"point {name!r} has no coordinates, which JAG3D needs; convert an adjusted project (adjusted.yaml)"
            problems.append(Message(words, content.document.file))
            continue
        numbers += sigma[k, columns].tolist() if kind == "stochastic" else []
        files.setdefault(f"{kind}_points_{size}d.txt", []).append(" ".join([name, *map(repr, numbers)]))
    return {name: files[name] for kind in POINTS for name in files if name.startswith(kind)}


def _datum(content: Content, ids: list[str], axes: tuple[str, ...], problems: list[Message]) -> set[str]:
    """Points that carry the datum, all coordinates of each."""
    datum = content.project.datum
    if datum == "fixed":
        return set()
    chosen = datum.free if isinstance(datum, Datum) and datum.minimal is None else "all"
    components = datum.components if isinstance(datum, Datum) else ["x", "y", "z"]
    by_axes = chosen if isinstance(chosen, dict) else {"".join(components): ids if chosen == "all" else chosen}
    names = [{str(name) for key, found in by_axes.items() if axis in key for name in found} for axis in axes]
    if (isinstance(datum, Datum) and datum.minimal is not None) or any(one != names[0] for one in names):
        words = "JAG3D has inner constraints over all coordinates of points only"
        problems.append(content.place("datum").problem(words))
    return names[0]


def _observations(
    group: ObservationTable, known: dict[str, tuple[str, float]], content: Content, files: Files, sets: Files
) -> None:
    """Lines of a table: from, to, heights, value, σ; directions by station and set."""
    type_, edge = group.entry.type, content.edge
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    gon = ANGLE_UNITS["gon"]
    kinds = {type_: kind for kind, type_ in OBSERVATIONS.items()}
    for row in range(group.rows.count):
        names = {r.name: group.rows.text(r.name)[row] for r in PLAIN_TYPES[type_].references}
        heights = heights_of(group, names, row, known, edge.metres)
        value, sigma, flat = group.values[row], group.sigma[row], (0.0, 0.0)
        ends = f"{names.get('from', '')} {names['to']}"
        if "station" in names:
            ends = f"{known.get(names['station'], (names['station'], 0.0))[0]} {names['to']}"
            if np.isfinite(value[0]):
                key = f"{names['station']}\0{group.rows.text('set')[row]}"
                circle = float(circle_in_face_one(value[0], face[row])) * edge.sense % (2 * np.pi)
                sets.setdefault(key, []).append(_line(ends, flat, circle / gon, sigma[0] / gon))
        if "zenith" in type_ and np.isfinite(value[-1]):
            zenith = float(zenith_in_face_one(value[-1], face[row]))
            line = _line(ends, heights, zenith / gon, sigma[-1] / gon)
            files.setdefault("zenith_angles.txt", []).append(line)
        elif type_ in ("height_difference", "horizontal_distance", "distance") and np.isfinite(value[0]):
            own = heights if type_ == "distance" else flat
            line = _line(ends, own, value[0] * edge.metres, sigma[0] * edge.metres)
            files.setdefault(f"{kinds[type_]}.txt", []).append(line)


def _line(ends: str, heights: tuple[float, float], value: float, sigma: float) -> str:
    """All six columns. Raises :class:`InputError` for a σ that JAG3D would take for a distance."""
    if not sigma < 1.0:
        raise InputError([Message(f"{ends}: JAG3D reads a σ of 1 and more ({sigma:g}, m or gon) as a distance")])
    return " ".join([ends, *(repr(float(number)) for number in (*heights, value, sigma))])
