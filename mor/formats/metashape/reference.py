"""Metashape's reference pane as text: markers or cameras with coordinates, accuracies and whether they are used.

A line ``# CoordinateSystem:`` may stand before the header, whose names begin with ``#Label`` (Agisoft, *Metashape User
Manual*, "Reference pane", export and import of reference data). Estimated values and errors are left out.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.formats.metashape.reader import SIGMA_CAMERA, SIGMA_MARKER
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_TABLES = ("#cameras", "#markers", "#scalebars")
_COLUMNS = {
    "label": "id",
    "x/easting": "x",
    "y/northing": "y",
    "z/altitude": "z",
    "accuracy_x_(m)": "sigma_x",
    "accuracy_y_(m)": "sigma_y",
    "accuracy_z_(m)": "sigma_z",
    "accuracy_(m)": "sigma",
    "accuracy": "sigma",
    "enable": "on",
    "enabled": "on",
    "yaw": "yaw",
}
_GEOGRAPHIC = ("x/longitude", "y/latitude")
_AXES = ("x", "y", "z")
IMAGE = re.compile(r"\.(jpe?g|tiff?|png|dng|nef|cr2|arw|raw|iiq)$", re.IGNORECASE)


def read_reference(path: Path) -> Document:
    """Points, or positions of images, that other files name. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    lines = read_lines(path, draft)
    at = next((k for k, text in enumerate(lines) if _header(text)), None)
    if at is None:
        words = "found no header, expected #Label,X/Easting,Y/Northing,Z/Altitude as Metashape exports it"
        raise InputError([Problem(words, draft.file, 1)])
    sign = next(sign for sign in "\t;," if sign in lines[at])
    decimal = sign != "," and any(re.search(r"\d,\d", text) for text in lines[at + 1 :])
    names = [name.strip().lower().lstrip("#").strip() for name in lines[at].split(sign)]
    if any(name in _GEOGRAPHIC for name in names) or any("GEOGCS" in text[:80] for text in lines[: at + 1]):
        words = "the coordinates are longitude and latitude: export them in a projected or local system"
        raise InputError([Problem(words, draft.file, at + 1)])
    columns = {_COLUMNS[name]: k for k, name in enumerate(names) if name in _COLUMNS}
    if "id" not in columns:
        raise InputError([Problem(f"found no column Label, but {', '.join(names)}", draft.file, at + 1)])
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "deg"})
    draft.put("axes", {"xy": "en"})
    cells: list[tuple[int, list[str]]] = []
    for line, text in enumerate(lines[at + 1 :], start=at + 2):
        if text.lower().replace(" ", "").startswith(_TABLES):
            draft.note("another table begins here: only the first one is read", line)
            break
        if text.startswith("#") or not text.replace(sign, "").strip():
            continue
        row = next(csv.reader([text], delimiter=sign))
        cells.append(
            (line, [cell.replace(",", ".") if decimal and k else cell for k, cell in enumerate(row)])
        )
    _put(cells, columns, names, draft)
    if decimal:
        draft.note("numbers have decimal commas", at + 2)
    return draft.finish()


def _header(text: str) -> bool:
    return re.match(r"#?\s*label\s*[,;\t]\s*x/", text, re.IGNORECASE) is not None


def _put(cells: list[tuple[int, list[str]]], columns: dict[str, int], names: list[str], draft: Draft) -> None:
    labels = [row[columns["id"]].strip() for _, row in cells if len(row) > columns["id"]]
    cameras = "yaw" in columns or (bool(labels) and all(IMAGE.search(name) for name in labels))
    default = repr(SIGMA_CAMERA if cameras else SIGMA_MARKER)
    rows, off, twice = [], 0, set()
    for line, row in cells:
        given = {name: row[k].strip() for name, k in columns.items() if k < len(row)}
        name = given.get("id", "")
        try:
            place = _place(given)
            sigma = [
                _sigma(given, axis, default) if place[k] is not None else None for k, axis in enumerate(_AXES)
            ]
        except ValueError as error:
            draft.problem(str(error), line)
            continue
        if not name and not any(place):
            continue  # the line of the total error
        if not name or name in twice:
            draft.problem(f"label {name!r} is there twice" if name else "the label is missing", line)
            continue
        twice.add(name)
        used = given.get("on", "1").lower() not in ("0", "false")
        off += not used
        if any(text is not None for text in place):
            rows.append(Row([name, *place, *(sigma if used else [None] * 3)], line))
    if off:
        draft.note(f"{counted(off, 'label')} switched off: coordinates without a σ")
    left = [name for name in names if name and name not in _COLUMNS]
    if left:
        draft.note(f"columns not read: {', '.join(left)}")
    if not {"accuracy", "accuracy_(m)", "accuracy_x_(m)"} & set(names):
        draft.note(f"σ = {default} m for all coordinates: the file says none")
    if rows:
        section = "images" if cameras else "points"
        draft.table(section, ("id", *_AXES, *(f"sigma_{axis}" for axis in _AXES)), rows)
    else:
        draft.problem("there are no coordinates")


def _place(given: dict[str, str]) -> list[str | None]:
    place: list[str | None] = [given.get(axis) or None for axis in _AXES]
    for text in place:
        if text is not None:
            number(text)
    return place


def _sigma(given: dict[str, str], axis: str, default: str) -> str:
    """σ of a coordinate; one number for all, or two or three with / between them, as the pane shows them."""
    own = given.get(f"sigma_{axis}") or ""
    parts = (given.get("sigma") or "").split("/")
    text = own or (parts[0] if len(parts) == 1 else parts[min(_AXES.index(axis), len(parts) - 1)]).strip()
    if len(parts) == 2 and not own:
        text = parts[1 if axis == "z" else 0].strip()
    if not text:
        return default
    if number(text) < 0.0:
        raise ValueError(f"found the accuracy {text}, expected 0 or more")
    return text
