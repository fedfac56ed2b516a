"""Several foreign files as one project: what the first one is, with what the others know of its points and images."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import polars as pl

from mor.errors import InputError, Message, counted
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import POINT, ROTATION
from mor.project.document import Document, KeyPath
from mor.units import ANGLE, LENGTH, Quantity

_COORDINATES = ("x", "y", "z")
_SECTIONS = ("points", "images", "stations", "systems", "pairs", "observations")


@dataclass
class _Project:
    """A document that is taken apart or added to."""

    data: dict[str, Any]
    lines: dict[KeyPath, int]
    file: str
    files: dict[KeyPath, str]
    notes: list[Message]
    frames: dict[str, pl.DataFrame]
    problems: list[Message] = field(default_factory=list)

    def tables(self, section: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.data.get(section) or []
        return found

    def note(self, words: str, line: int = 0) -> None:
        self.notes.append(Message(words, self.file, line))


def combined(documents: Sequence[Document]) -> Document:
    """One document of several foreign ones: points and images of the same name are the same.

    Of a point that several files have the one that is held or observed stays, of equal ones the later; positions of
    images that a later file gives are taken over. Coordinates of files without control are in systems of their own:
    they are left out, those of the first file only where another one has control. Images and cameras that two files
    describe alike are the same. Raises :class:`InputError` if axes differ or different cameras share a name.
    """
    whole, *others = (_opened(document) for document in _once(documents))
    for other in others:
        _add(whole, other)
    if others:
        _without_idle_images(whole)
    if whole.problems:
        raise InputError(whole.problems)
    notes = tuple(whole.notes)
    return Document(whole.data, whole.lines, whole.file, whole.files, notes, frames=whole.frames)


def _once(documents: Sequence[Document]) -> list[Document]:
    """The documents without those that say what an earlier one says: files that belong together were named each."""
    kept, said = list[Document](), list[dict[str, Any]]()
    for document in documents:
        content = {section: document.data.get(section) for section in _SECTIONS}
        if document.frames or content not in said:
            kept.append(document)
            said.append(content)
    return kept


def _opened(document: Document) -> _Project:
    data = {
        key: [dict(entry) for entry in value] if isinstance(value, list) else value
        for key, value in document.data.items()
    }
    lines, files, frames = dict(document.lines), dict(document.files), dict(document.frames)
    return _Project(data, lines, document.file, files, list(document.notes), frames)


def _add(whole: _Project, other: _Project) -> None:
    if _axes(whole) != _axes(other):
        words = f"the axes are not those of {whole.file}: convert one of them by itself first"
        whole.problems.append(Message(words, other.file))
    _in_units_of(whole, other)
    held, own = _control(other), _control(whole)
    datum = other.data.pop("datum", None)
    if held and not own:
        if not _lacks_height(held, whole):
            whole.data.pop("datum", None)
        _without_coordinates(whole)
    elif not held:
        _without_coordinates(other)
        if datum is not None and (not whole.tables("points") or (own and _lacks_height(own, other))):
            whole.data.setdefault("datum", datum)
    cameras, more = (project.data.get("cameras") or {} for project in (whole, other))
    for name in sorted(name for name in set(cameras) & set(more) if cameras[name] != more[name]):
        words = f"camera {name!r} is in {whole.file}, too, with other values"
        whole.problems.append(Message(words, other.file, other.lines.get(("cameras", name), 0)))
    if more:
        whole.data["cameras"] = {**cameras, **more}
    measured = [dict(p.data.get("settings") or {}) for p in (whole, other) if p.tables("observations")]
    sizes = {str(settings.get("dimensions", "xyz")) for settings in measured}
    settings = {**(other.data.get("settings") or {}), **(whole.data.get("settings") or {})}
    settings.pop("dimensions", None)
    if len(sizes) == 1 and sizes != {"xyz"}:
        settings["dimensions"] = sizes.pop()
    whole.data.pop("settings", None)
    if settings:
        whole.data["settings"] = settings
    _take_positions(whole, other)
    _images_once(whole, other)
    _say_once(whole, other)
    for section in _SECTIONS:
        _append(whole, section, other)
    whole.notes += other.notes


def _axes(project: _Project) -> dict[str, str]:
    plain = {"xy": "en", "angles": "clockwise", "bearings_from": "north"}
    return {**plain, **(project.data.get("axes") or {})}


def _control(project: _Project) -> set[str]:
    """Components that tables hold, or observe with σ."""
    found: set[str] = set()
    for table in (*project.tables("points"), *project.tables("images")):
        names = [str(name) for name in table.get("columns") or ()]
        found |= _fixed(table) | {name.removeprefix("sigma_") for name in names if name.startswith("sigma_")}
        found |= set(_COORDINATES) if "sigma" in names else set()
    return found


def _lacks_height(control: set[str], measured: _Project) -> bool:
    """Return whether control leaves the heights of a project free."""
    return "z" not in control and "z" in str((measured.data.get("settings") or {}).get("dimensions", "z"))


def _fixed(table: Mapping[str, Any]) -> set[str]:
    """Components that a table holds at values of their own: one value for all rows, as of heights, is no control."""
    return set(table.get("fixed") or ()) - set(table.get("values") or ())


def _without_coordinates(project: _Project) -> None:
    lost = False
    pose = (*_COORDINATES, "omega", "phi", "kappa")
    for section, names in (("points", _COORDINATES), ("images", pose)):
        for table in project.tables(section):
            frame = project.frames.get(str(table.get("file")))
            columns = list(frame.columns) if frame is not None else table["columns"]
            kept = [k for k, name in enumerate(columns) if name not in names]
            lost = lost or len(kept) < len(columns)
            if frame is not None:
                project.frames[table["file"]] = frame[:, kept]
            else:
                table["columns"] = [columns[k] for k in kept]
                table["rows"] = [[row[k] for k in kept] for row in table["rows"]]
    if lost:
        project.note("coordinates and poses, in a system of their own, are not taken: they are computed again")


def _names(project: _Project, section: str) -> list[str]:
    names: list[str] = []
    for table in project.tables(section):
        frame = project.frames.get(str(table.get("file")))
        if frame is not None:
            names += frame["id"].cast(pl.String).to_list()
        else:
            at = table["columns"].index("id")
            names += [str(row[at]) for row in table["rows"]]
    return names


def _say_once(whole: _Project, other: _Project) -> None:
    """Keep one entry of each point in both files: held or observed, else with coordinates, else the later one."""
    _regroup_heights(whole, other)
    first, second = _weights(whole), _weights(other)
    both = first.keys() & second.keys()
    later = {name for name in both if second[name] >= first[name]}
    _drop_points(whole, later)
    _drop_points(other, both - later)
    for names, taken in ((later, other), (both - later, whole)):
        said = sum(max(first[name], second[name]) > 0 for name in names)
        if said:
            other.note(f"{counted(said, 'point')} in {whole.file}, too: taken from {taken.file}")


def _images_once(whole: _Project, other: _Project) -> None:
    """Keep one entry of each image that both files have with the same camera: the one that says more."""
    first, second = _image_entries(whole), _image_entries(other)
    both = {name for name in first.keys() & second.keys() if first[name][0] == second[name][0]}
    later = {name for name in both if second[name][1] > first[name][1]}
    for project, names in ((whole, later), (other, both - later)):
        for number, table in enumerate(project.tables("images")):
            kept = [k for k, name in enumerate(_ids(table)) if name not in names or "camera" not in table["columns"]]
            _keep_rows(project, ("images", number), table, kept)
        _drop_empty(project, "images")
    if both:
        other.note(f"{counted(len(both), 'image')} in {whole.file}, too: the fuller entry is taken")


def _without_idle_images(whole: _Project) -> None:
    """Drop images of which nothing is measured, as files of cameras list them, if others are measured."""
    used: set[str] = set()
    for table in (*whole.tables("observations"), *whole.tables("pairs")):
        frame = whole.frames.get(str(table.get("file")))
        cells = (str(cell) for row in table.get("rows") or () for cell in row if cell is not None)
        used |= {cell.removeprefix("image ") for cell in cells}
        if frame is not None and "image" in frame.columns:
            used |= set(frame["image"].cast(pl.String).drop_nulls().to_list())
    entries = _image_entries(whole)
    idle = entries.keys() - used
    if not idle or len(idle) == len(entries):
        return
    for number, table in enumerate(whole.tables("images")):
        kept = [k for k, name in enumerate(_ids(table)) if name not in idle]
        _keep_rows(whole, ("images", number), table, kept)
    _drop_empty(whole, "images")
    seeing = {camera for name, (camera, _) in entries.items() if name in used}
    whole.data["cameras"] = {name: one for name, one in whole.data.get("cameras", {}).items() if name in seeing}
    whole.note(f"{counted(len(idle), 'image')} in which nothing is measured: not read")


def _image_entries(project: _Project) -> dict[str, tuple[str, int]]:
    """Camera of each image that has one, and how many cells its row fills."""
    found = {}
    for table in project.tables("images"):
        if "camera" in table["columns"]:
            at = table["columns"].index("camera")
            for name, row in zip(_ids(table), table["rows"], strict=True):
                found[name] = (str(row[at]), sum(cell not in (None, "") for cell in row))
    return found


def _regroup_heights(whole: _Project, other: _Project) -> None:
    """Hold the height of a point that no reading of either file tells, in the tables of both files."""
    flat, tall = set[str](), set[str]()
    for project in (whole, other):
        for table in (one for one in project.tables("points") if "rows" in one):
            if _holds_height(table):
                flat |= set(_ids(table))
            elif project.tables("observations"):
                tall |= set(_ids(table))
    if not flat:
        return
    for project in (whole, other):
        for number, table in enumerate(project.tables("points")[:]):
            if "rows" not in table:
                continue
            held = _holds_height(table)
            z = table["columns"].index("z") if "z" in table["columns"] else None
            names = [
                name if z is None or row[z] is None else ""
                for name, row in zip(_ids(table), table["rows"], strict=True)
            ]
            wrong = [k for k, name in enumerate(names) if (name in flat - tall) != held]
            if not wrong or (table.get("fixed") and not held):
                continue
            kept = [k for k, name in enumerate(table["columns"]) if held or name not in ("z", "sigma_z")]
            keys = {} if held else {"fixed": ["z"], "values": {"z": "0"}}
            columns = [table["columns"][k] for k in kept]
            rows = [[table["rows"][row][k] for k in kept] for row in wrong]
            project.data["points"].append({**keys, "columns": columns, "rows": rows})
            _keep_rows(project, ("points", number), table, sorted(set(range(len(table["rows"]))) - set(wrong)))
        _drop_empty(project, "points")


def _holds_height(table: Mapping[str, Any]) -> bool:
    """Return whether a table holds all heights at one value, as those that no reading tells."""
    return "z" in (table.get("values") or ())


def _ids(table: Mapping[str, Any]) -> list[str]:
    at = table["columns"].index("id")
    return [str(row[at]) for row in table["rows"]]


def _weights(project: _Project) -> dict[str, int]:
    """Rank of each point entry: 2 held or observed coordinates, 1 start values, 0 name alone."""
    weights: dict[str, int] = {}
    for table in project.tables("points"):
        frame = project.frames.get(str(table.get("file")))
        if frame is not None:
            there = int(any(axis in frame.columns for axis in _COORDINATES))
            weights |= dict.fromkeys(frame["id"].cast(pl.String).to_list(), there)
            continue
        columns = table["columns"]
        for row in table["rows"]:
            said = {str(name) for name, cell in zip(columns, row, strict=True) if cell not in (None, "")}
            held = _fixed(table) or any(name.startswith("sigma") for name in said)
            weights[str(row[columns.index("id")])] = 2 if held else int(bool(said & set(_COORDINATES)))
    return weights


def _drop_points(project: _Project, names: Collection[str]) -> None:
    if not names:
        return
    for number, table in enumerate(project.tables("points")):
        frame = project.frames.get(str(table.get("file")))
        if frame is not None:
            project.frames[table["file"]] = frame.filter(~pl.col("id").cast(pl.String).is_in(list(names)))
        else:
            at = table["columns"].index("id")
            kept = [k for k, row in enumerate(table["rows"]) if row[at] not in names]
            _keep_rows(project, ("points", number), table, kept)
    _drop_empty(project, "points")


def _keep_rows(whole: _Project, path: KeyPath, table: dict[str, Any], kept: list[int]) -> None:
    lines = [whole.lines.get((*path, "rows", k), 0) for k in kept]
    for k in range(len(table["rows"])):
        whole.lines.pop((*path, "rows", k), None)
    table["rows"] = [table["rows"][k] for k in kept]
    whole.lines.update({(*path, "rows", k): line for k, line in enumerate(lines) if line})


def _drop_empty(whole: _Project, section: str) -> None:
    """Tables that lost every row go, and the lines of those behind them move up."""
    tables = whole.tables(section)
    kept = [
        k for k, table in enumerate(tables) if table.get("rows") or len(whole.frames.get(str(table.get("file")), ()))
    ]
    if len(kept) == len(tables):
        return
    new = {old: k for k, old in enumerate(kept)}
    for mapping in (whole.lines, whole.files):
        found: list[tuple[KeyPath, Any]] = [(path, mapping.pop(path)) for path in _inside(mapping, section)]
        for path, value in found:
            if path[1] in new:
                mapping[(section, new[int(path[1])], *path[2:])] = value
    whole.data[section] = [tables[k] for k in kept]


def _inside(mapping: Mapping[KeyPath, Any], section: str) -> list[KeyPath]:
    return [path for path in mapping if len(path) > 1 and path[0] == section]


def _take_positions(whole: _Project, other: _Project) -> None:
    """Images without a camera are what a file knows of images of the project; names may lack their suffix."""
    own = _by_name(_names(whole, "images"))
    _take_image_points(whole, other, own)
    for number, table in enumerate(other.tables("images")):
        if "camera" in table["columns"]:
            continue
        at = table["columns"].index("id")
        columns = [name for name in table["columns"] if name != "id"]
        known: dict[str, list[str | None]] = {}
        lost: list[int] = []
        for k, row in enumerate(table["rows"]):
            name = own.get(str(row[at])) or own.get(PurePath(str(row[at])).stem)
            if name is None:
                lost.append(other.lines.get(("images", number, "rows", k), 0))
            else:
                known[name] = [cell for place, cell in enumerate(row) if place != at]
        if lost:
            other.note(f"{counted(len(lost), 'image')} not in {whole.file}: not read", lost[0])
        for entry in whole.tables("images"):
            _fill(entry, columns, known, table.get("units") or {})
        _keep_rows(other, ("images", number), table, [])
    _drop_empty(other, "images")


def _take_image_points(whole: _Project, other: _Project, own: Mapping[str, str]) -> None:
    bare = {
        str(row[table["columns"].index("id")])
        for table in other.tables("images")
        if "camera" not in table["columns"]
        for row in table["rows"]
    }
    for number, table in enumerate(other.tables("observations")):
        if table.get("type") != "image" or "image" not in (table.get("columns") or ()):
            continue
        at = table["columns"].index("image")
        kept = []
        for k, row in enumerate(table["rows"]):
            name = str(row[at])
            found = own.get(name) or own.get(PurePath(name).stem)
            if name in bare and found is not None:
                row[at] = found
            if name not in bare or found is not None:
                kept.append(k)
        lost = len(table["rows"]) - len(kept)
        if lost:
            other.note(f"{counted(lost, 'image point')} of images not in {whole.file}: not read")
            _keep_rows(other, ("observations", number), table, kept)
    _drop_empty(other, "observations")


def _by_name(names: list[str]) -> dict[str, str]:
    stems: dict[str, list[str]] = {}
    for name in names:
        stems.setdefault(PurePath(name).stem, []).append(name)
    return {**{stem: found[0] for stem, found in stems.items() if len(found) == 1}, **{name: name for name in names}}


def _fill(
    entry: dict[str, Any], columns: list[str], known: Mapping[str, list[str | None]], units: Mapping[str, str]
) -> None:
    """Values into the rows of images, by their names."""
    at = entry["columns"].index("id")
    if not any(row[at] in known for row in entry["rows"]):
        return
    own = list(entry["columns"])
    names = [*own, *(name for name in columns if name not in own)]
    rows = []
    for row in entry["rows"]:
        cells: dict[str, str | None] = dict(zip(own, row, strict=True))
        cells |= dict(zip(columns, known.get(row[at], ()), strict=False))
        rows.append([cells.get(name) for name in names])
    entry["columns"], entry["rows"] = names, rows
    if units:
        entry["units"] = {**(entry.get("units") or {}), **units}


def _append(whole: _Project, section: str, other: _Project) -> None:
    offset = len(whole.tables(section))
    for number, table in enumerate(other.tables(section)):
        name = str(table.get("file"))
        if name in other.frames:
            table["file"] = name if name not in whole.frames else f"{name} of {other.file}"
            whole.frames[table["file"]] = other.frames[name]
        whole.files[section, offset + number] = other.files.get((section, number), other.file)
        whole.data.setdefault(section, []).append(table)
    for path in _inside(other.lines, section):
        whole.lines[(section, offset + int(path[1]), *path[2:])] = other.lines[path]


def _in_units_of(whole: _Project, other: _Project) -> None:
    """Write the units of a project into its tables where they are not those of another."""
    (length, angle), theirs = (
        (units.get("length", "m"), units.get("angle", "gon"))
        for units in (project.data.get("units") or {} for project in (other, whole))
    )
    if (length, angle) == theirs:
        return
    for table in (table for section in _SECTIONS for table in other.tables(section)):
        given = table.get("units") or {}
        if isinstance(given, str):
            continue
        found = {}
        for name in (*(table.get("columns") or _COORDINATES), *(table.get("values") or {})):
            quantity = _quantity(str(name), str(table.get("type", "")))
            if quantity in (LENGTH, ANGLE):
                found[str(name)] = length if quantity == LENGTH else angle
        if found:
            table["units"] = {**found, **given}


def _quantity(column: str, type_: str) -> Quantity | None:
    """Quantity of a column by its name; σ and start values have the quantity that they belong to."""
    if type_ and type_ not in PLAIN_TYPES:
        return None
    components = PLAIN_TYPES[type_].components if type_ else (*POINT.components, *ROTATION.components)
    known = {component.name: component.quantity for component in components}
    lengths = ("height", "from_height", "to_height", "station_height", "at_height", "bx", "by", "bz")
    known |= {**dict.fromkeys(lengths, LENGTH), "orientation": ANGLE}
    if column == "sigma":
        return components[0].quantity
    return known.get(column.removeprefix("sigma_").removeprefix("start_"))
