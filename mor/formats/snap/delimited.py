"""Delimited text files of SNAP: columns that a definition (``.dtf``) names, as words of SNAP's own forms.

Source: the help of SNAP, *CSV format definition files*, *The data_file command*, *The coordinate_file command*.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from mor.errors import InputError, Message
from mor.formats.draft import Draft, read_lines

_PART = re.compile(r'"([^"]*)"|@(\w+)|\$(\w+)|(\w+)\(\s*([@$]\w+)\s*\)|(\S+)')


@dataclass
class _RecordValues:
    """Values of one observation, or of a station, by the names of their commands."""

    values: dict[str, str] = field(default_factory=dict)
    classes: list[tuple[str, str]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    """Columns that are classifications; ``c_*`` are all that begin so, of ``c_**`` without these letters."""
    omits_missing: bool = False


@dataclass
class Definition:
    """The form of a file: how it is divided, and what its columns are."""

    path: Path
    options: dict[str, str]
    """Of the command that names the file; ``$name`` stands for them."""
    reader: dict[str, Any] = field(default_factory=lambda: {"delimiter": ",", "quotechar": '"'})
    """Options of :func:`csv.reader`; none where blanks divide the fields."""
    header: bool = True
    columns: list[str] = field(default_factory=list)
    required: list[str] = field(default_factory=list)
    skipped: int = 0
    lookups: dict[str, dict[str, str]] = field(default_factory=dict)
    station: _RecordValues = field(default_factory=_RecordValues)
    observations: list[_RecordValues] = field(default_factory=list)

    def value(self, definition: str, cells: dict[str, str]) -> str:
        """The value of a definition on a line: the first of its alternatives that is not blank."""
        text = ""
        for match in _PART.finditer(definition):
            literal, column, option, lookup, key, other = match.groups()
            if other is not None and other.lower() == "default":
                if text.strip():
                    break
                text = ""
            elif lookup is not None:
                table = self.lookups.get(lookup.lower(), {})
                text += table.get(self.value(key, cells).lower(), table.get("", ""))
            elif column is not None:
                text += cells.get(_plain(column), "")
            elif option is not None:
                text += self.options.get(option.lower(), "")
            else:
                text += literal if literal is not None else other
        return text.strip()


class Record(NamedTuple):
    """Values of one observation or station by their names, with the number of its line."""

    line: int
    values: dict[str, str]
    classes: dict[str, str]


def _plain(column: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", column.strip().lower()).strip("_")


def definition_of(path: Path, options: dict[str, str], draft: Draft) -> Definition:
    """The content of a definition. Raises :class:`InputError`."""
    if not path.is_file():
        raise InputError([Message("this file does not exist", str(path))])
    found = Definition(path, options)
    block = found.station
    lookup: dict[str, str] | None = None
    of_station = {
        *("code", "name", "coordinate_system", "longitude", "latitude", "height", "geoid_undulation"),
        *("deflection_east", "deflection_north", "height_type", "angle_format"),
    }
    of_observation = {
        *("type", "set_id", "instrument_station", "instrument_height", "target_station", "target_height"),
        *("value", "error", "error_factor", "datetime", "datetime_format", "projection", "id", "note", "rejected"),
        *("reference_frame", "refraction_coefficient", "bearing_orientation_error", "distance_scale_factor"),
        *("vector_error_type", "distance_error_type", "angle_format", "angle_error_type"),
        *("zenith_distance_error_type", "height_difference_error_type"),
    }
    also = {
        "easting": "longitude",
        "x": "longitude",
        "northing": "latitude",
        "y": "latitude",
        "z": "height",
        "time": "datetime",
        "time_format": "datetime_format",
        "angle_error_unit": "angle_error_units",
    }
    for number, text in enumerate(read_lines(path, draft), start=1):
        name, _, rest = text.strip().partition(" ")
        name, rest = also.get(name.lower(), name.lower()), rest.strip()
        if not name or name.startswith("!"):
            continue
        if name == "end_lookup":
            lookup = None
        elif lookup is not None:
            lookup["" if name == "default" else name] = rest
        elif name == "lookup":
            lookup = found.lookups.setdefault(rest.lower(), {})
        elif name == "observation":
            block = _RecordValues()
            found.observations.append(block)
        elif name == "end_observation":
            block = found.station
        elif name == "format":
            _divide(found, rest)
            try:
                csv.reader([], **found.reader)
            except (TypeError, ValueError):
                draft.problem(f"found {rest!r}, expected single letters that divide fields", number, str(path))
                found.reader = {}
        elif name in ("columns", "required_columns"):
            names = [_plain(word) for word in rest.split()]
            found.columns, found.required = (names, found.required) if name == "columns" else (found.columns, names)
        elif name == "skip_lines":
            found.skipped = int(rest) if rest.isdigit() else 0
        elif name == "classification":
            key, _, definition = rest.partition(" ")
            block.classes.append((key.lower(), definition))
        elif name == "classification_columns":
            block.columns += rest.lower().split()
        elif name == "ignore_missing_observations":
            block.omits_missing = True
        elif name in (of_station if block is found.station else of_observation | {"angle_error_units"}):
            block.values[name] = rest
        elif name not in ("format_name", "optional_columns", "required_configuration"):
            draft.problem(f"command {name!r} is not supported", number, str(path))
    if draft.problems:
        raise InputError(draft.problems)
    return found


def _divide(found: Definition, rest: str) -> None:
    for word in rest.split():
        key, _, value = word.lower().partition("=")
        value = {"tab": "\t", "space": " "}.get(value, value)
        if key == "header":
            found.header = value[:1] != "n"
        elif key == "whitespace":
            found.reader = {}
        elif key == "delimiter":
            found.reader = {"delimiter": value, "quoting": csv.QUOTE_NONE}
        elif key == "quote" and value:
            found.reader |= {"quotechar": value, "quoting": csv.QUOTE_MINIMAL}
        elif key == "escape" and value != found.reader.get("quotechar"):
            found.reader |= {"escapechar": value, "doublequote": False}


def records(path: Path, found: Definition, blocks: list[_RecordValues], draft: Draft) -> Iterator[Record]:
    """Yield the records of a file, one for each block and line. Raises :class:`InputError`."""
    if not path.is_file():
        raise InputError([Message("this file does not exist", str(path))])
    lines = read_lines(path, draft)[found.skipped :]
    rows = csv.reader(lines, strict=True, **found.reader) if found.reader else None
    names = [] if found.header else found.columns
    try:
        for k, row in enumerate(rows if rows is not None else map(str.split, lines), start=1):
            number = found.skipped + (rows.line_num if rows is not None else k)
            if not any(cell.strip() for cell in row):
                continue
            if not names:
                header = row if found.header else [f"col{i}" for i in range(1, len(row) + 1)]
                names = found.columns or [_plain(name) for name in header]
                lost = [name for name in found.required if name not in names]
                if lost:
                    words = f"column {lost[0]!r} is missing, which {found.path.name} requires"
                    raise InputError([Message(words, str(path), number)])
                if found.header:
                    continue
            cells = dict(zip(names, (cell.strip() for cell in row), strict=False))
            for block in blocks:
                values = {name: found.value(text, cells) for name, text in block.values.items()}
                classes = {name: found.value(text, cells) for name, text in block.classes}
                classes |= _classes(block.columns, cells)
                if values.get("value") or not block.omits_missing:
                    yield Record(number, values, {name: value for name, value in classes.items() if value})
    except csv.Error as error:
        raise InputError([Message(f"the line cannot be divided into fields: {error}", str(path))]) from None


def _classes(columns: list[str], cells: dict[str, str]) -> dict[str, str]:
    found = {}
    for column in columns:
        start = column.rstrip("*")
        for name, value in cells.items():
            if name == _plain(column) if start == column else name.startswith(start):
                found[name.removeprefix(start) if column.endswith("**") else name] = value
    return found


def form_of(text: str) -> str:
    """``deg``, ``dms`` or ``hp``. Raises ``ValueError``."""
    forms = {"degrees": "deg", "dms_angles": "dms", "hp_angles": "hp"}
    form = forms.get(text.lower(), text.lower() or "deg")
    if form not in forms.values():
        raise ValueError(f"found the form of angles {text!r}, expected degrees, dms or hp")
    return form


def angle_words(text: str, hemispheres: str) -> list[str]:
    """Words of an angle; of a latitude or longitude, which may have a sign, with its hemisphere at the end."""
    match = re.fullmatch(r"([NSEW]?)(.*?)([NSEW]?)", text.strip(), re.IGNORECASE)
    assert match is not None
    before, middle, behind = match.groups()
    letter = before or behind
    if hemispheres and not letter:
        letter = hemispheres[middle.startswith("-")]
        middle = middle.removeprefix("-")
    return [*middle.split(), *letter]


def date_by(text: str, form: str) -> datetime | None:
    """A date whose parts stand in the order of Y, M, D, h, m, s and N (day of the year). Raises ``ValueError``."""
    parts = dict(zip(form, re.findall(r"[A-Za-z]+|\d+", text), strict=False))
    if not parts:
        return None
    try:
        month = parts.get("M", "1")
        if not month.isdigit():
            months = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
            month = str(months.index(month[:3].lower()) + 1)
        day = f"{parts['Y']} {parts['N']}" if "N" in parts else f"{parts['Y']} {month} {parts.get('D', '1')}"
        time = " ".join(parts.get(letter, "0") for letter in "hms")
        return datetime.strptime(f"{day} {time}", ("%Y %j" if "N" in parts else "%Y %m %d") + " %H %M %S")
    except (ValueError, KeyError):
        raise ValueError(f"found the date {text!r}, expected it in the order {form!r}") from None
