"""Recognise tables of measurements and coordinates by the names of their columns."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations, groupby, pairwise, permutations, product, takewhile, zip_longest
from pathlib import Path
from statistics import median
from typing import NamedTuple

from mor.errors import InputError, Message, counted
from mor.input_files import CODE_PAGES, TABLE, as_utf8, decoded, not_utf8, read_bytes
from mor.project.column_names import (
    ANGLES,
    DERIVED,
    EMPTY,
    HEIGHT,
    KINDS,
    LINES,
    NAMES,
    NO_READING,
    NUMBER,
    OF_POINTS,
    PLACEHOLDER,
    PLACES,
    SIGMAS,
    TITLES,
    TOTAL,
    UNITS_OF_NAMES,
    ZERO,
    Cells,
    cell_at,
    columns_of,
    columns_that_are_known,
    fits_a_table,
    is_control,
    is_heading,
    kinds_of,
    known_kinds,
    name_and_unit,
    named_columns,
    normalised,
    number_in,
)
from mor.project.document import plain
from mor.project.headerless import headerless, titles_of_sections, with_names_apart, without_counts
from mor.project.tables import is_spreadsheet, read_sheets, sheet_rows
from mor.project.tidying import (
    TableRows,
    image_points_of_matrix,
    plain_header,
    tables_in,
    tell_elevations,
    tidied_rows,
    with_faces,
    with_faces_apart,
    with_hairs,
    with_image,
    with_sigmas,
    with_station,
    with_targets,
    with_whole_readings,
    without_empty_readings,
    without_packed_angles,
    without_switched_off,
    without_zero_readings,
    without_zeros,
)
from mor.units import ANGLE_UNITS

_NOTHING = re.compile(r"\s*(?:[-–—]{2,}|\*+|NaN)\s*")
"""What programs write into empty cells; an asterisk is the σ of what is free."""
_BRACKETED_UNIT = re.compile(rf" ([(\[](?:{'|'.join(map(re.escape, UNITS_OF_NAMES))})[)\]])(?= |$)", re.IGNORECASE)
_TWO_NUMBERS = re.compile(r"\s*[-+]?\d*\.\d+\s+[-+]?\d+\.?\d*\s*")
"""Two numbers in one cell, between which tabs are missing; degrees have no fraction."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_QUADRANT = re.compile(
    r"(?P<from>[NS])\s*(?P<d>\d+(?:[.,]\d+)?)(?:\s*[-°ºd:\s]\s*(?P<m>\d+(?:[.,]\d+)?))?"
    r"(?:\s*[-'’′m:\s]\s*(?P<s>\d+(?:[.,]\d+)?))?[\s°ºd'’′m\"”″s-]*(?P<to>[EWO])\.?",
    re.IGNORECASE,
)
"""Bearings from north or south towards east or west (O: ouest, oeste)."""
_DIGIT = re.compile(r"[-+]?[.,]?\d")
_JOINS = re.compile(r"\s*(?:->|[-–—→/:>]|\bto\b)\s*")


class _UnknownKindError(InputError):
    """A table of no known kind; the note is for a sheet that has other tables."""

    note = ""


class Found(NamedTuple):
    """A table that was recognised."""

    path: Path
    kind: str
    columns: Mapping[str, str]
    """Its columns by their names in a project."""
    unused: tuple[str, ...]
    """Columns that neither this kind nor another one in the same table reads."""
    units: Mapping[str, str]
    """Units that the names of columns say."""
    delimiter: str
    decimal_comma: bool
    has_header: bool
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...] = ()
    """Lines of the file that the rows of a levelling book stand in."""
    sheet: str = ""
    """Sheet of a spreadsheet that has several."""
    tidied: bool = False
    """True if the rows are not those of the file: a copy of them is written."""
    notes: tuple[str, ...] = ()
    is_control: bool = False
    """True for points whose coordinates are known: a benchmark, or a list that says so."""
    part: str = ""
    """Kind, if other kinds in the table have readings in other rows."""
    title: str = ""
    """Words above the table."""

    def copy(self, target: Path) -> Path:
        """Path of a copy of the rows beside the project."""
        sheet = re.sub(r"\W+", "_", self.sheet)
        return target.with_name("_".join(filter(None, (target.stem, self.path.stem, sheet, self.part))) + ".csv")

    def texts(self, name: str) -> list[str]:
        """Cells of a column, empty if it is missing."""
        if name not in self.columns:
            return []
        place = self.header.index(self.columns[name])
        return [plain(row[place].strip()) for row in self.rows if len(row) > place]

    def numbers(self, name: str) -> list[float]:
        """Cells of a column that are plain numbers."""
        cells = (cell.replace(",", ".") if self.decimal_comma else cell for cell in self.texts(name))
        return [float(cell) for cell in cells if NUMBER.fullmatch(cell) and "," not in cell]

    def places(self) -> dict[str, tuple[float, ...]]:
        """Coordinates of a list of points by name."""
        axes = [axis for axis in "xyz" if axis in self.columns] if self.kind == "points" else []
        cells = (cell.replace(",", ".") for axis in axes for cell in self.texts(axis))
        values = [float(cell) if NUMBER.fullmatch(cell) else math.nan for cell in cells]
        return {
            name: tuple(values[k :: len(self.rows)])
            for k, name in enumerate(self.texts("id"))
            if axes[:2] == ["x", "y"]
        }

    @property
    def has_sigma(self) -> bool:
        """True if the table has standard deviations or covariances."""
        return any(name.startswith(("sigma", "cov_")) for name in self.columns)

    @property
    def has_heights(self) -> bool:
        """True if the table has heights, and not known positions with heights that are not known."""
        return "z" in self.columns and not ("sigma_x" in self.columns and "sigma_z" not in self.columns)


_STARRED = re.compile(r"([\d.]+)\*")
"""The last number of a station in some books."""


def read_tables(path: Path, *names: Sequence[str]) -> list[Found]:
    """Read a table and return what it holds, one entry per kind: a field book may hold directions and distances.

    Of several sheets in a spreadsheet those are returned that hold something known. ``names`` of columns, ``-`` for one
    that is not used, take the place of a header; several of them are those of rows of different lengths.
    Raises :class:`InputError` if the columns are those of no kind.
    """
    sheets = [name for name, rows in read_sheets(path).items() if rows] if is_spreadsheet(path) else []
    if len(sheets) < 2:
        return _recognise(path, None, names)
    found, mistakes = list[Found](), list[Message]()
    for name in sheets:
        try:
            found += [table._replace(sheet=name) for table in _recognise(path, name, names)]
        except InputError as error:
            mistakes += [Message(f"sheet {name}: {mistake.message}", str(path)) for mistake in error.problems]
    if not found:
        raise InputError(mistakes)
    return _with_sheets_apart(found)


def _with_sheets_apart(tables: list[Found]) -> list[Found]:
    """The tables with other names of sets where a station has directions in an earlier sheet as well."""
    seen, apart = dict[str, str](), list[Found]()
    for table in tables:
        own = dict.fromkeys(table.texts("station")) if "horizontal" in table.columns else {}
        again = {name for name in own if seen.setdefault(name, table.sheet) != table.sheet}
        if again:
            place = table.header.index(table.columns["station"])
            header = table.header if "set" in table.columns else (*table.header, "set")
            k = header.index(table.columns.get("set", "set"))
            full = [(*row, *[""] * (len(header) - len(row))) for row in table.rows]
            names = [f"{row[k]} {table.sheet}".strip() if cell_at(row, place) in again else row[k] for row in full]
            rows = tuple((*row[:k], name, *row[k + 1 :]) for row, name in zip(full, names, strict=True))
            columns = {**table.columns, "set": header[k]}
            words = f"stations that another sheet has too are set up once more: {', '.join(sorted(again))}"
            table = table._replace(header=header, rows=rows, columns=columns, part=table.part or table.kind)
            table = table._replace(tidied=True, notes=(*table.notes, words))
        apart.append(table)
    return apart


def _recognise(path: Path, sheet: str | None, names: Sequence[Sequence[str]]) -> list[Found]:
    cells = _cells(path, sheet, set(map(len, names)))
    apart = () if any(map(is_heading, cells.rows)) else with_names_apart(cells.rows)
    cells = cells._replace(rows=apart, was_joined=True) if apart and apart != cells.rows else cells
    if len(names) > 1:
        return _of_several_widths(path, cells, names)
    if not names:
        return _of_rows(path, cells)
    headed = _with_header(path, cells, names[0])
    more = len(headed.rows[0]) - len(names[0])
    notes: tuple[str, ...] = ()
    if more > 0:
        notes = (f"{counted(more, 'column')} behind those that have names not used",)
    above = cells.rows[: len(cells.rows) - len(headed.rows) + 1]
    if unread := sum(any(NUMBER.fullmatch(cell.strip()) for cell in row) for row in above):
        notes += (f"rows with numbers stand above the header: {counted(unread, 'row')} not read",)
    return [table._replace(notes=(*notes, *table.notes)) for table in _of_rows(path, headed)]


def _of_several_widths(path: Path, cells: _File, names: Sequence[Sequence[str]]) -> list[Found]:
    """Tables of rows of different lengths; a row that only names a station or an image is part of those below it."""
    filled = tuple(full for row in cells.rows if (full := tuple(filter(None, map(str.strip, row)))))
    begin = len(cells.rows) - len(without_counts(filled)) if len(filled) == len(cells.rows) else 0
    cells = cells._replace(rows=cells.rows[begin:], lines=cells.lines[begin:])
    notes = ["the first row counts rows of the tables below it: not used"] if begin else []
    kept = [k for k, row in enumerate(cells.rows) if not _is_end_mark(row)]
    if ends := len(cells.rows) - len(kept):
        notes.append(f"-99 and zeros end a list: {counted(ends, 'row')} not used")
    cells = cells._replace(rows=tuple(cells.rows[k] for k in kept), lines=tuple(cells.lines[k] for k in kept))
    above = [own for own in names if {"station", "image"} & {*own} and not kinds_of(named_columns(own))]
    parts = list[list[Found]]()
    for own in names:
        rows = _of_width(cells, len(own))
        if {*own} <= {"", "-"}:
            notes.append(f"{counted(len(rows.rows), 'row')} of {len(own)} cells not used")
        elif above and own is not above[0] and not {"station", "image"} & {*own}:
            joined = _below(cells, len(above[0]), len(own))
            parts.append(_of_rows(path, _with_header(path, joined, (*above[0], *own))))
        elif own not in above:
            parts.append(_of_rows(path, _with_header(path, rows, own)))
    widths = {len(own) for own in names}
    if left := sum(len(row) not in widths for row in filled[begin:]):
        notes.append(f"{counted(left, 'row')} of other lengths than --columns names not used")
    return [
        t._replace(part=f"{t.kind}_{k}", tidied=True, notes=(*notes, *t.notes))
        for k, part in enumerate(parts, 1)
        for t in part
    ]


def _is_end_mark(row: Sequence[str]) -> bool:
    """Return whether a row is -99 or its like, and zeros."""
    first, *zeros = [*filter(None, map(str.strip, row))] or [""]
    is_zero = [NUMBER.fullmatch(cell) is not None and number_in(cell) is None for cell in zeros]
    return re.fullmatch(r"-9+(\.0*)?", first) is not None and bool(zeros) and all(is_zero)


def _below(cells: _File, above: int, width: int) -> _File:
    """The rows of one width, each behind the last row of the width ``above`` before it."""
    rows, lines, last = list[tuple[str, ...]](), list[int](), ("",) * above
    for row, line in zip(cells.rows, cells.lines, strict=True):
        filled = tuple(filter(None, map(str.strip, row)))
        if len(filled) == above:
            last = filled
        elif len(filled) == width:
            rows.append((*last, *(_STARRED.sub(r"\1", cell) for cell in filled)))
            lines.append(line)
    return cells._replace(rows=tuple(rows), lines=tuple(lines))


def _of_width(cells: _File, width: int) -> _File:
    """The rows that have as many cells as a table, as in files of several tables without headers."""
    kept = [k for k, row in enumerate(cells.rows) if len(list(filter(None, map(str.strip, row)))) == width]
    rows = tuple(tuple(map(str.strip, cells.rows[k][:width])) for k in kept)
    return cells._replace(rows=rows, lines=tuple(cells.lines[k] for k in kept))


def _of_rows(path: Path, cells: _File) -> list[Found]:
    width = max((k for row in cells.rows for k, cell in enumerate(row, start=1) if cell.strip()), default=0)
    blank = tuple(tuple("" if _NOTHING.fullmatch(cell) else cell for cell in row[:width]) for row in cells.rows)
    named = tuple(row if any(map(number_in, row)) else with_hairs(row) for row in blank)
    by_image = image_points_of_matrix(blank)
    blocks = [TableRows(by_image, cells.lines[:1])] if by_image else tables_in(named, cells.lines)
    found, unknown = list[list[Found]](), list[_UnknownKindError]()
    for block in blocks:
        try:
            found.append(_of_block(path, cells, block, len(blocks) > 1))
        except _UnknownKindError as error:
            unknown.append(error)
    if not any(found) and unknown:
        raise unknown[0]
    rest = tuple(error.note for error in unknown)
    found = [[table._replace(notes=(*rest, *table.notes)) for table in tables] for tables in found]
    tables, copies = list[Found](), list[str]()
    for table in (table for tables in found for table in tables):
        copies.append(table.part)
        again = copies.count(table.part)
        tables.append(table._replace(part=f"{table.part}_{again}") if table.part and again > 1 else table)
    return tables


def _with_header(path: Path, cells: _File, names: Sequence[str]) -> _File:
    """The rows below a header of these names, which takes the place of rows without numbers above them."""
    filled = [list(filter(None, map(str.strip, row))) for row in cells.rows]
    # A number alone above a table is no row of it, as a focal length or a scale.
    numbers = [any(map(NUMBER.fullmatch, row)) and (len(row) > 1 or len(names) < 2) for row in filled]
    start = numbers.index(True) if True in numbers else len(numbers)
    body = cells.rows[start:]
    widths = [max((k for k, cell in enumerate(row, start=1) if cell.strip()), default=0) for row in body]
    width = max(widths, default=0)
    is_wider = min(widths, default=0) > len(names)  # columns behind those that have names are not used
    fits = [len(row) >= len(names) >= own or is_wider for row, own in zip(body, widths, strict=True)]
    if not all(fits) or not body:
        found, line = (widths[fits.index(False)], cells.lines[start + fits.index(False)]) if body else (0, 0)
        words = f"found {found} columns, expected {len(names)} as --columns names them ({', '.join(names)})"
        if not body:
            words = f"no row has {len(names)} cells, as --columns names them ({', '.join(names)})"
        raise InputError([Message(words, str(path), line)])
    unused = (f"column{k}" for k in range(1, width + 1))
    header = tuple(own if own not in ("", "-") else other for own, other in zip_longest(names, unused, fillvalue=""))
    lines = (cells.lines[max(start - 1, 0)], *cells.lines[start:])
    return cells._replace(rows=(header, *body), lines=lines, was_joined=True)


def _of_block(path: Path, cells: _File, block: TableRows, is_one_of_several: bool) -> list[Found]:
    """Tables of every kind in a block."""
    tidy, stated = tidied_rows(with_faces_apart(block.rows) if block.rows else ())
    tidy, alone = with_station(tidy)
    tidy, off = without_switched_off(tidy)
    tidy, wires = with_whole_readings(tidy)
    tidy, packed = without_packed_angles(tidy)
    tidy, held = with_sigmas(without_empty_readings(tidy))
    tidy, zeros = without_zeros(with_targets(with_faces(tidy)))
    tidy, none = without_zero_readings(tidy)
    tidy, single = with_image(tidy)
    is_encoded = cells.encoding in CODE_PAGES
    encoded: tuple[str, ...] = (not_utf8(cells.encoding),) if is_encoded else ()
    encoded += (*block.notes, *off, *wires, *packed, *held, *zeros, *none, *alone, *single)
    parts = _parts(tidy, path)
    return [
        table._replace(
            tidied=table.tidied or is_encoded or cells.was_joined,
            notes=(*encoded, *notes, *table.notes),
            is_control=table.is_control or _is_control(table, block.title),
            title=block.title,
            part=table.part or (table.kind if len(parts) > 1 or is_one_of_several else ""),
        )
        for rows, notes in parts
        for table in _tables(path, rows, cells, block.lines, stated)
    ]


def _is_control(table: Found, title: str) -> bool:
    return table.kind == "points" and any(map(is_control, (title, table.columns.get("id", ""))))


def _tables(path: Path, rows: Cells, cells: _File, lines: tuple[int, ...], stated: Mapping[str, str]) -> list[Found]:
    """Tables of every kind in the rows. ``lines``: those of the file from the header on."""
    delimiter, above = cells.delimiter, cells.above
    line = lines[0] if lines else 1
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    has_header = bool(header) and is_heading(header)
    if not has_header and len(above) == len(header) and kinds_of(named_columns(above)):
        header = above
    elif not has_header:
        if has_two_names(rows) or not _is_list_of_points(_padded(rows)):
            raise headerless(path, rows, line)
        rows = _padded(rows)
        header = (*OF_POINTS, *(f"column{k}" for k in range(5, len(rows[0]) + 1)))
    named = named_columns(header)
    kinds = kinds_of(named)
    tell_elevations(kinds, header, rows[has_header:])
    geographic = re.compile(r".*latitude|lat|.*longitude|lon|lng|long")
    places = [cell for cell, text, _ in named if geographic.fullmatch(text)]
    if len(places) > 1 and kinds.keys() <= {"points with heights"}:
        words = (
            f"found latitudes and longitudes (columns {', '.join(places)}), expected coordinates in metres; in a "
            "project with world: {crs: EPSG:4326} points have columns latitude, longitude, height"
        )
        raise InputError([Message(words, str(path), line)])
    if {"x", "y", "X", "Y"} <= set(header) and "image" not in kinds:
        words = "x, y beside X, Y: image coordinates need a column with the name of their image"
        raise InputError([Message(words, str(path), line)])
    if not kinds and len(titles_of_sections(rows)) > 1:
        raise headerless(path, rows, line)
    if not kinds:
        known = [columns_that_are_known(row) for row in rows[:TITLES]]
        likely = max(range(len(known)), key=lambda k: (known[k] > 1) * known[k])  # the first row may be a title
        columns = ", ".join(c for c in map(str.strip, rows[likely]) if c and not PLACEHOLDER.fullmatch(c))
        line = lines[max(0, len(lines) - len(rows)) + likely]
        words = f"unknown kind of table: found the columns {columns}; {known_kinds()}"
        if max(known) < 2 or any(len(rows[likely]) > len(row) for row in rows[likely + 1 : likely + 2]):
            words = (
                "no line has the names of the columns of a known table: write them above the values, or give them by "
                f"--columns TABLE NAMES; {known_kinds()}"
            )
        unknown = _UnknownKindError([Message(words, str(path), line)])
        unknown.note = f"another table begins below (columns {columns}): {counted(len(rows) - 1, 'row')} not read"
        raise unknown
    body, nameless = rows[has_header:], 0
    if target := next((columns["to"] for kind, columns in kinds.items() if kind in SIGMAS and "to" in columns), ""):
        place = header.index(target)
        named_rows = tuple(row for row in body if len(row) <= place or row[place].strip())
        body, nameless = named_rows, len(body) - len(named_rows)
    full = {kind: _with_readings(body, kind, columns, header) for kind, columns in kinds.items()}
    kept = {row for rows_of_kind in full.values() for row in rows_of_kind}
    if "image" in full and "points" in full:
        place = header.index(kinds["points"]["id"])
        full["points"] = tuple({cell_at(row, place): row for row in reversed(body)}.values())[::-1]
    repeated, bare = 0, sum(row not in kept for row in body)
    for kind in full:
        if kind.startswith("points") and len(kinds) == 1:
            used_places = [header.index(cell) for cell in kinds[kind].values()]
            named_place = header.index(kinds[kind]["id"])
            by_content = dict[tuple[str, ...], tuple[str, ...]]()
            filled = [row for row in full[kind] if any(cell_at(row, k) for k in used_places)]
            # A row with neither a name nor a number is no point.
            is_told = [
                bool(cell_at(row, named_place)) or any(_DIGIT.match(cell_at(row, k)) for k in used_places)
                for row in filled
            ]
            bare += is_told.count(False)
            filled = [row for row, is_point in zip(filled, is_told, strict=True) if is_point]
            for row in filled:
                by_content.setdefault(tuple(cell_at(row, k) for k in used_places), row)
            full[kind] = tuple(by_content.values())
            repeated = len(filled) - len(by_content)
    notes: tuple[str, ...] = (f"{NO_READING}: {counted(bare, 'row')}",) if bare else ()
    notes += (f"points given twice alike: {counted(repeated, 'row')}",) if repeated else ()
    notes += (f"rows without a target: {counted(nameless, 'row')}",) if nameless else ()
    used = {cell for columns in kinds.values() for cell in columns.values()}
    if twice := sorted(cell for cell in used if header.count(cell) > 1):
        raise InputError([Message(f"column {', '.join(map(repr, twice))} is given twice", str(path))])
    if delimiter == " " and has_header and not any("" in row for row in body):  # in one table as in the file
        _check_width(path, line, header, body, used)
    unused = tuple(cell for cell in header if cell and cell not in used and not PLACEHOLDER.fullmatch(cell))
    short = delimiter == " " and any(len(row) < len(header) for row in body)
    if short and used.isdisjoint(header[min(map(len, body)) :]):  # remarks that are not there
        full = {kind: tuple((*row, *[""] * (len(header) - len(row))) for row in rows_) for kind, rows_ in full.items()}
    units = {**{cell: unit for cell, _, unit in named if unit}, **stated}
    decimal_comma = delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell.strip()) for row in rows for cell in row)
    return [
        Found(
            path,
            kind.split(" ")[0],
            columns,
            unused,
            {o: unit for o, theirs in columns.items() if (unit := units.get(theirs)) and _fits_unit(kind, o, unit)},
            delimiter,
            decimal_comma,
            has_header,
            header,
            full[kind],
            lines[len(lines) - len(body) :] if kind.startswith("levelling") else (),
            tidied=rows != cells.rows or bool(notes) or short or full[kind] != body,
            part=kind if len({len(part) for part in full.values()}) > 1 else "",
            notes=notes,
        )
        for kind, columns in kinds.items()
    ]


def _fits_unit(kind: str, name: str, unit: str) -> bool:
    """Return False for the unit of a length at an angle or its standard deviation."""
    is_precision = name.startswith("sigma") and not KINDS[kind][0].keys().isdisjoint(ANGLES)
    return unit in ANGLE_UNITS or not (name in ANGLES or is_precision)


def _parts(rows: Cells, path: Path) -> list[tuple[Cells, tuple[str, ...]]]:
    """Tables in the rows with notes on what is not used: one for each type of observations, or legs of a traverse."""
    header, body = tuple(cell.strip() for cell in rows[0]) if rows else (), rows[1:]
    if by_type := columns_of("observations by type", named_columns(header)):
        tables = _by_type(header, body, by_type)
        if tables:
            return tables
    kind, columns = next(iter(kinds_of(named_columns(header)).items()), ("", {}))
    if kind == "observations by type":
        types = dict.fromkeys(cell_at(row, header.index(columns["type"])) for row in body)
        words = f"observations of the types {', '.join(types)}: a type is unknown, or no column names the points"
        raise InputError([Message(words, str(path))])
    if "bearing" in columns and not any(cell_at(row, header.index(columns["bearing"])) for row in body):
        others = [named for named in named_columns(header) if named[0] != columns["bearing"]]
        kind, columns = next(iter(kinds_of(others).items()), (kind, columns))
    if "bearing" in columns:
        place = header.index(columns["bearing"])
        if any(_QUADRANT.fullmatch(cell_at(row, place)) for row in body):
            head = "bearing [deg]"
            header = tuple(head if k == place else cell for k, cell in enumerate(header))
            columns = {**columns, "bearing": head}
            body = tuple(tuple(_azimuth(cell) if k == place else cell for k, cell in enumerate(row)) for row in body)
    if kind == "traverse by angles":
        return _by_angles(header, body, columns)
    if kind.startswith("traverse"):
        return [_with_both_ends(header, body, columns, path)]
    return [((header, *body) if "bearing" in columns else rows, ())]


def _azimuth(text: str) -> str:
    """Azimuth in decimal degrees of a quadrant bearing such as N 45-30-10 E; other texts stay."""
    match = _QUADRANT.fullmatch(text.strip())
    if match is None:
        return text
    parts = [float((match[name] or "0").replace(",", ".")) for name in "dms"]
    angle = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    is_south, is_west = match["from"].upper() == "S", match["to"].upper() in "WO"
    angle = 180.0 - angle if is_south else angle
    return f"{(360.0 - angle if is_west else angle):.9g}"


def _with_both_ends(
    header: tuple[str, ...], body: Cells, columns: Mapping[str, str], path: Path
) -> tuple[Cells, tuple[str, ...]]:
    """Legs of a traverse with both points: its name says them (A-B), or it joins the points of consecutive rows."""
    place = header.index(columns.get("leg") or columns["point"])
    bearing, distance = header.index(columns["bearing"]), header.index(columns["distance"])
    # A row with a distance alone is a sum.
    named = [row for row in body if cell_at(row, place) and (cell_at(row, bearing) or not cell_at(row, distance))]
    named = [row for row in named if not TOTAL.match(cell_at(row, place))]
    again = [k for k, row in enumerate(named) if k > 1 and cell_at(row, place) == cell_at(named[0], place)]
    # A closed traverse that ends where it began may have the first bearing once more there, and remarks below.
    if again and not any(cell_at(row, distance) for row in named[again[-1] :]) and "leg" not in columns:
        end = named[again[-1]]
        named = [*named[: again[-1]], (*end[:bearing], "", *end[bearing + 1 :])]
    legs = [row for row in named if cell_at(row, bearing)]
    names, notes = [cell_at(row, place) for row in named], list[str]()
    if "leg" in columns:
        ends = [_ends(cell_at(row, place), path) for row in legs]
    elif named and not cell_at(named[0], bearing):
        ends = [both for both, row in zip(zip(["", *names], names, strict=False), named, strict=True) if row in legs]
    else:
        after = [*names[1:], names[0]] if named else []
        if named and cell_at(named[-1], bearing):
            notes.append(f"each leg leads to the point of the next row, the last one back to {names[0]}")
        ends = [both for both, row in zip(zip(names, after, strict=True), named, strict=True) if row in legs]
    rows = [(*row[:place], *both, *row[place + 1 :]) for both, row in zip(ends, legs, strict=True)]
    if len(legs) < len(body):
        notes.append(f"{NO_READING}: {counted(len(body) - len(legs), 'row')}")
    return ((*header[:place], "from", "to", *header[place + 1 :]), *rows), tuple(notes)


def _by_angles(header: tuple[str, ...], body: Cells, columns: Mapping[str, str]) -> list[tuple[Cells, tuple[str, ...]]]:
    point, angle, distance = (header.index(columns[name]) for name in ("point", "angle", "distance"))
    named = [row for row in body if cell_at(row, point) and not TOTAL.match(cell_at(row, point))]
    read = [any(_DIGIT.match(cell_at(row, k)) for k in (angle, distance)) for row in named]
    first = read.index(True) if True in read else 0
    last = read.index(False, first) if False in read[first:] else len(read)
    named = named[max(first - 1, 0) : last + 1]  # a point without readings may begin and end it
    far = [cell_at(row, distance) for row in named]
    # Distances may stand beside the point that they reach.
    if len(far) > 1 and not far[min(1, first)] and far[last - max(first - 1, 0) - 1]:
        far = [*far[1:], ""]
    if len(named) > 2 and cell_at(named[-1], point) == cell_at(named[0], point) and not far[-1]:
        named = named[:-1]
    names = [cell_at(row, point) for row in named]
    is_closed = len(named) > 2 and bool(far[len(named) - 1])
    around = zip([names[-1], *names], names, [*names[1:], names[0]], named, strict=False) if names else ()
    inner = list(around) if is_closed else list(around)[1:-1]
    angles = [(at, start, end, cell_at(row, angle)) for start, at, end, row in inner if cell_at(row, angle)]
    legs = [
        (names[k], names[(k + 1) % len(names)], far[k])
        for k in range(len(names))
        if far[k] and (is_closed or k + 1 < len(names))
    ]
    words = ["angles of the traverse are taken as clockwise from the point before to the next one"]
    if is_closed:
        words.append(f"each leg leads to the point of the next row, the last one back to {names[0]}")
    length, unit = "horizontal distance", name_and_unit(header[distance])[1]
    if left := len(body) - len(named):
        words.append(f"{NO_READING}: {counted(left, 'row')}")
    found: list[tuple[Cells, tuple[str, ...]]] = [
        ((("at", "from", "to", "angle"), *angles), tuple(words)),
        ((("from", "to", f"{length} [{unit}]" if unit else length), *legs), ()),
    ]
    plan = columns_of("points in the plane", [one for one in named_columns(header) if one[0] != header[angle]])
    if plan and plan["id"] == header[point]:
        cells = [tuple(cell_at(row, header.index(plan[name])) for name in ("id", "x", "y")) for row in named]
        turning = [own for own, row in zip(cells, named, strict=True) if cell_at(row, angle)]
        axes = ("x0", "y0") if all(map(all, turning)) else ("x", "y")  # computed, or known of some
        found.append((((header[point], *axes), *(row for row in cells if all(row))), ()))
    return found


def _ends(leg: str, path: Path) -> tuple[str, str]:
    """Both points in the name of a leg. Raises :class:`InputError`."""
    parts = list(leg) if len(leg) == 2 and leg.isalpha() else _JOINS.split(leg)
    half = len(parts) // 2
    if len(parts) % 2 or not all(parts):
        raise InputError([Message(f"found the leg {leg!r}, expected both points as in A-B", str(path))])
    return "-".join(parts[:half]), "-".join(parts[half:])


def _by_type(header: tuple[str, ...], body: Cells, columns: Mapping[str, str]) -> list[tuple[Cells, tuple[str, ...]]]:
    places = {name: header.index(cell) for name, cell in columns.items()}
    found, rest = list[Cells](), dict[str, int]()
    for name in dict.fromkeys(cell_at(row, places["type"]) for row in body):
        rows = [row for row in body if cell_at(row, places["type"]) == name]
        units = {cell_at(row, places["unit"]) for row in rows} if "unit" in places else set()
        unit = units.pop() if len(units) == 1 else ""
        value = f"{name} [{unit}]" if unit else name
        head = tuple(value if k == places["value"] else cell for k, cell in enumerate(header))
        left_out = (places["type"], places.get("unit"))
        keep = [k for k in range(len(header)) if k not in left_out and any(cell_at(row, k) for row in rows)]
        table = _with_names_apart(tuple(tuple(cell_at(row, k) for k in keep) for row in (head, *rows)))
        if kinds_of(named_columns(table[0])):
            found.append(table)
        else:
            rest[name] = len(rows)
    notes = tuple(f"observations of the type {name!r} not used: {counted(n, 'row')}" for name, n in rest.items())
    return [(rows, notes) for rows in found]


def _with_names_apart(rows: Cells) -> Cells:
    """Rows with both ends, or the points of an angle, in columns of their own if one cell has them: A-B, A-P-B."""
    for k, sign in product(range(len(rows[0])), "_-/>,"):
        parts = [[name.strip() for name in row[k].split(sign)] for row in rows[1:]]
        names = {2: ("from", "to"), 3: ("from", "at", "to")}.get(len(parts[0]), ())
        header = (*rows[0][:k], *names, *rows[0][k + 1 :])
        if names and all(len(one) == len(names) and all(one) for one in parts) and kinds_of(named_columns(header)):
            return (header, *((*row[:k], *one, *row[k + 1 :]) for row, one in zip(rows[1:], parts, strict=True)))
    return rows


def _with_readings(rows: Cells, kind: str, columns: Mapping[str, str], header: Sequence[str]) -> Cells:
    """Rows that have a reading of a kind, and those that are too short; a distance of 0 is none."""
    readings = KINDS[kind][0].keys() - {*PLACES, "image"} if kind in SIGMAS else ()
    places = [header.index(columns[name]) for name in readings]
    nothing = ZERO if kind in LINES else EMPTY
    return tuple(
        row
        for row in rows
        if not places or len(row) < len(header) or not all(nothing.fullmatch(row[k].strip()) for k in places)
    )


def told_apart(tables: Sequence[Found], is_free: bool = False) -> list[Found]:
    """Return the tables, with those lists of points that hold images of the other tables as lists of images.

    A list ``id, x, y, z`` may hold points, or projection centres by GNSS: the measurements tell which of them. Lists
    that lack points that were measured are control, except beside images and in networks that are said to be free.
    Copies of files of one name get numbers. Raises :class:`InputError` for a list with both.
    """
    tables = _with_image_points_apart(_with_names_of_observations(_without_derived(_with_image_of_points(tables))))
    paths = dict.fromkeys(table.path for table in tables)
    for k, table in enumerate(tables):
        same = [path for path in paths if path.stem == table.path.stem].index(table.path)
        tables[k] = table._replace(part=f"{table.part}_{same + 1}".strip("_")) if same else table
    images = {name for table in tables if table.kind == "image" for name in table.texts("image")}
    points = {name for table in tables for place in PLACES for name in table.texts(place) if name}
    found = [_told_apart(table, images - points, points) if table.kind == "points" else table for table in tables]
    lists = [table for table in found if table.kind == "points"]
    bare = [dict(zip(t.texts("id"), t.texts("x"), strict=True)) for t in lists if not t.has_header]
    for number, (one, other) in enumerate(pairwise(bare)):
        elsewhere = sum(one[name] != other[name] for name in one.keys() & other.keys())
        if elsewhere > 2 and 2 * elsewhere > len(other):
            path = [t.path for t in lists if not t.has_header][number + 1]
            words = (
                "a list without a header is read as points (name, x, y, z), but another one has the same names at "
                "other places: write a header if these are points in images"
            )
            raise InputError([Message(words, str(path))])
    new = points.difference(*(table.texts("id") for table in lists))
    found = _with_horizontal_distances(found)
    is_single = len(images) == 1 and all(table.kind in ("image", "points") for table in found)
    in_images = any("x" in table.columns for table in lists) and bool(images) and not is_single
    if is_free or any(table.is_control or table.has_sigma for table in lists) or not (points or images):
        return found
    if in_images or not (new or is_single):
        return [_with_role(table, in_images) if table.kind == "points" else table for table in found]
    words = f"taken as control: {counted(len(new), 'point')} of the measurements are not in it"
    if is_single:
        words = "taken as control: one image determines no point"
    computed = [t.columns.get("x") == "x0" or bool(DERIVED.search(normalised(t.title))) for t in found]
    return [
        t._replace(is_control=True, notes=(*t.notes, words)) if t.kind == "points" and not is_computed else t
        for t, is_computed in zip(found, computed, strict=True)
    ]


def _with_role(table: Found, in_images: bool) -> Found:
    """Return a list of points as control if it is called so and images see it; a note says what it is taken for."""
    parts = [word for name in (table.path.stem, table.sheet) for word in (name, *re.split(r"[\W_]+", name))]
    names = [re.sub(r"\d", "", part) for part in parts]
    is_called = any(is_control(name) or is_control(f"{name}points") for name in names if name)
    if in_images and is_called and not any(HEIGHT.search(normalised(name)) for name in names):
        words = (
            "taken as control and held, as its name says; if its coordinates are known with a σ, write "
            "values: {sigma: 5 mm} in place of fixed:"
        )
        return table._replace(is_control=True, notes=(*table.notes, words))
    axes = ", ".join(axis for axis in "xyz" if axis in table.columns)
    words = (
        f"taken as start values; for control points write fixed: [{axes}] or values: {{sigma: 5 mm}} below the name of "
        "the file, for a free network datum: free"
    )
    return table._replace(notes=(*table.notes, words))


def _with_image_of_points(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with points x, y as those of one image if the only other table has them elsewhere."""
    flat, spatial = ([k for k, table in enumerate(tables) if ("z" in table.columns) is has] for has in (False, True))
    found = list(tables)
    if not len(flat) == len(spatial) == 1 or {table.kind for table in tables} != {"points"}:
        return found
    image, known = tables[flat[0]].places(), tables[spatial[0]].places()
    if 2 * len(shared := image.keys() & known.keys()) <= max(4, len(image)):
        return found
    extent = max(math.dist(one[:2], other[:2]) for one, other in pairwise(known.values()))
    # Coordinates of the same points differ by less than 5 % of their extent, however rough they are.
    if not median(math.dist(known[name][:2], place) for name, place in image.items() if name in shared) > 0.05 * extent:
        return found
    table = tables[flat[0]]
    columns = {"image": "image", "point": table.columns["id"]} | {axis: table.columns[axis] for axis in "xy"}
    words = "points of another table elsewhere: taken as image points, whose image is called 'image'"
    found[flat[0]] = table._replace(
        kind="image",
        columns=columns,
        header=("image", *table.header),
        rows=tuple(("image", *row) for row in table.rows),
        tidied=True,
        notes=(*table.notes, words),
    )
    return found


def _with_horizontal_distances(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with distances as horizontal ones if they fit coordinates in plan four times as well."""
    found, places = list(tables), {name: place for table in tables for name, place in table.places().items()}
    for k, table in enumerate(tables):
        name = name_and_unit(table.columns.get("distance", ""))[0]
        if table.kind != "distance" or name not in NAMES.general_distance.split("|"):
            continue
        ends = [
            tuple(math.dist(a[:n], b[:n]) - float(text.replace(",", ".")) for n in (2, 3))
            for one, other, text in zip(*map(table.texts, ("from", "to", "distance")), strict=False)
            if len(a := places.get(one, ())) == len(b := places.get(other, ())) == 3 and NUMBER.fullmatch(text)
        ]
        plan, slope = (median([abs(pair[k]) for pair in ends] or [0.0]) for k in (0, 1))
        if len(ends) > 2 and 4.0 * plan < slope:
            words = "distances fit the coordinates in plan and not in space: taken as horizontal distances"
            found[k] = table._replace(kind="horizontal_distance", notes=(*table.notes, words))
    return found


def _without_derived(tables: Sequence[Found]) -> list[Found]:
    """Return the tables without those whose values are derived from readings in another one, or are the same.

    Titles and headings say that values are adjusted, reduced or means.
    """
    found, left, values, derived = (
        list(tables),
        set[int](),
        list[dict[tuple[str, ...], tuple[str, ...]]](),
        list[bool](),
    )
    for table in tables:
        keys = [name for name in table.columns if name in (*PLACES, "id", "image")]
        read = [name for name in table.columns if name in KINDS[table.kind][0] and name not in keys]
        rows = list(zip(*map(table.texts, (*keys, *read)), strict=False))
        values.append({row[: len(keys)]: row[len(keys) :] for row in reversed(rows)})
        names = (table.title, table.sheet, table.path.stem, *(table.columns[name] for name in read))
        derived.append(any(DERIVED.search(normalised(name)) for name in names))
    for k, j in permutations(range(len(tables)), 2):
        one, other = tables[k], tables[j]
        if one.kind != other.kind or {k, j} & left or not values[k].keys() <= values[j].keys() or not values[k]:
            continue
        is_same = j < k and len(values[k]) > 2 and all(values[j][key] == value for key, value in values[k].items())
        if (derived[k] and not derived[j]) or (is_same and one.kind in SIGMAS):
            left.add(k)
            name = " ".join(filter(None, (one.path.name, one.sheet, one.title)))
            words = f"{name} has the same readings: not used once more"
            found[j] = found[j]._replace(notes=(*found[j].notes, words))
    return [table for k, table in enumerate(found) if k not in left]


def _with_names_of_observations(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with lists of points by the column that has their names in the observations.

    Lists often have numbers of their own beside them.
    """
    found, names = list(tables), {name for table in tables for place in PLACES for name in table.texts(place) if name}
    for k, table in enumerate(tables):
        if table.kind != "points" or not names.isdisjoint(table.texts("id")):
            continue
        for cell in table.unused:
            columns = {**table.columns, "id": cell}
            other = table._replace(columns=columns)
            own = [name for name in other.texts("id") if name]
            if len(set(own)) == len(own) and 2 * len(names.intersection(own)) > len(own):
                unused = tuple(name for name in table.unused if name != cell)
                found[k] = other._replace(unused=(*unused, table.columns["id"]))
                break
    return found


def _with_image_points_apart(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with other names for points of a table that another table has elsewhere in the same images.

    Tie points and control points are often numbered from 1 each. The table of listed points keeps their names. Raises
    :class:`InputError` if both or neither of them has listed points only.
    """
    found = list(tables)
    listed = {name for table in tables if table.kind == "points" for name in table.texts("id")}
    for one, other in combinations([k for k, table in enumerate(tables) if table.kind == "image"], 2):
        places, names = zip(*(_image_points(found[k]) for k in (one, other)), strict=True)
        shared = places[0].keys() & places[1].keys()
        if not shared:
            continue
        both = [(places[0][key], places[1][key]) for key in shared]
        size = max(abs(value) for pair in both for place in pair for value in place)
        # Two places of one point differ by less than 5 % of the largest image coordinate.
        apart = sum(max(abs(a - b) for a, b in zip(*pair, strict=True)) > 0.05 * size for pair in both)
        if 2 * apart <= len(shared):
            continue
        is_control = [name <= listed for name in names]
        image, point = min(shared)
        first, second = (found[k].path.name for k in (one, other))
        if is_control[0] == is_control[1]:
            words = (
                f"image {image}, point {point} is elsewhere than in {first}: give points of the same name that are "
                "different points other names"
            )
            raise InputError([Message(words, str(found[other].path))])
        k, kept = (one, second) if is_control[1] else (other, first)
        table = found[k]
        place, stem = table.header.index(table.columns["point"]), table.path.stem
        rows = tuple((*row[:place], f"{cell_at(row, place)} ({stem})", *row[place + 1 :]) for row in table.rows)
        note = f"points named as in {kept} are elsewhere in the images and other points: called NAME ({stem})"
        found[k] = table._replace(rows=rows, tidied=True, notes=(*table.notes, note))
    return found


def _image_points(table: Found) -> tuple[dict[tuple[str, str], tuple[float, float]], set[str]]:
    """Places by image and point, and the names of the points."""
    keys = list(zip(table.texts("image"), table.texts("point"), strict=False))
    xs, ys = table.numbers("x"), table.numbers("y")
    is_whole = len(keys) == len(xs) == len(ys)
    return dict(zip(keys, zip(xs, ys, strict=False), strict=False)) if is_whole else {}, {point for _, point in keys}


def _told_apart(table: Found, images: set[str], points: set[str]) -> Found:
    ids = table.texts("id")
    of_images, of_points = ([name for name in ids if name in known] for known in (images, points))
    if of_images and of_points:
        words = (
            f"image {of_images[0]!r} and point {of_points[0]!r} are in one list; split it into two tables, "
            "positions of images and points"
        )
        raise InputError([Message(words, str(table.path))])
    return table._replace(kind="images") if of_images else table


class _File(NamedTuple):
    """Rows of a file without comments and empty lines."""

    delimiter: str
    rows: Cells
    lines: tuple[int, ...]
    above: tuple[str, ...]
    """Cells of a comment that may be the header."""
    encoding: str
    was_joined: bool = False


def _cells(path: Path, sheet: str | None, widths: Collection[int]) -> _File:
    """Rows of a file; ``widths``: numbers of columns that its tables are said to have."""
    if is_spreadsheet(path):
        numbers, cells = sheet_rows(path, sheet)
        return _File(",", tuple(map(tuple, cells)), tuple(numbers), (), "")
    text, encoding = decoded(as_utf8(read_bytes(path, TABLE)))
    if encoding in CODE_PAGES and "\0" in text:
        raise InputError([Message("this is not UTF-8 text", str(path))])
    numbered = [
        (k, ln)
        for k, ln in enumerate(text.split("\n"), start=1)
        if ln.strip() and not ln.startswith(("#", "%")) and not _is_ruler(ln)
    ]
    lines = [line for _, line in numbered]
    comments = [line.strip()[1:] for line in takewhile(lambda line: line.startswith(("#", "%")), text.split("\n"))]
    has_bars = 2 * sum(line.count("|") > 1 for line in lines) > len(lines) and ";" not in text
    if has_bars:
        lines = [line.strip().removeprefix("|").removesuffix("|").replace("|", ";") for line in lines]
    pairs = ("\t" in line and any(map(_TWO_NUMBERS.fullmatch, line.split("\t"))) for line in lines)
    is_mixed = 2 * sum(pairs) > len(lines)
    if is_mixed:
        lines = [line.replace("\t", " ") for line in lines]
    likely = max(";\t,", key=next((line for line in lines if any(map(line.count, ";\t,"))), "").count)
    likely = likely if any(likely in line for line in lines) else " "
    if widths:
        delimiter = next(
            (sign for sign in ";\t ," if any(len(row) in widths for row in _rows(lines[-1:], sign))), likely
        )
    else:
        signs = sorted((likely, *";\t, "), key=lambda sign: sign == " ")  # a title has blanks, too
        fitting = (
            sign for sign in signs if any(fits_a_table(plain_header(row)) for row in _rows(lines[:TITLES], sign))
        )
        delimiter = next(fitting, likely)
    reader = csv.reader(_spaced(lines, delimiter), delimiter=delimiter)
    try:
        found = [(numbered[reader.line_num - 1][0], tuple(row)) for row in reader if any(map(str.strip, row))]
        sizes = [str(len(list(run))) for _, run in groupby(len(row) for _, row in found[1:])]
        counts = list(filter(None, map(str.strip, found[0][1]))) if found else []
        is_counted = bool(counts) and counts in (sizes, [str(len(found) - 1)])
        found = found[is_counted:]  # the first line was the number of rows, perhaps of each table
        heads = [
            tuple(cell.strip() for cell in row) for row in csv.reader(_spaced(comments, delimiter), delimiter=delimiter)
        ]
    except csv.Error as error:
        raise InputError([Message(f"this is not a table: {error}; is a quote not closed?", str(path))]) from None
    above = next((head for head in reversed(heads) if found and len(head) == len(found[0][1])), ())
    joined = (
        is_counted
        or has_bars
        or is_mixed
        or (delimiter == " " and any(_BRACKETED_UNIT.search(" ".join(line.split())) for line in lines))
    )
    return _File(delimiter, tuple(row for _, row in found), tuple(line for line, _ in found), above, encoding, joined)


def _is_ruler(line: str) -> bool:
    """Return whether a line is drawn below a header, with signs alone."""
    return not line.strip(" \t\r;,|+-=_") and any(2 * sign in line for sign in "-=_")


def _rows(lines: list[str], delimiter: str) -> list[list[str]]:
    try:
        return list(csv.reader(_spaced(lines, delimiter), delimiter=delimiter))
    except csv.Error:
        return []


def _spaced(lines: list[str], delimiter: str) -> list[str]:
    """Lines with one blank between cells if blanks separate them; a unit in brackets belongs to the name before it."""
    if delimiter != " ":
        return lines
    return [_BRACKETED_UNIT.sub(r"\1", " ".join(line.split())) for line in lines]


def has_two_names(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the rows are two names (from and to), then numbers."""
    words = [[cell.strip().replace(",", ".") for cell in row] for row in rows]
    if not words or not all(len(row) == len(words[0]) > 2 and all(map(NUMBER.fullmatch, row[2:])) for row in words):
        return False
    starts, ends = {row[0] for row in words}, {row[1] for row in words}
    named = any(not NUMBER.fullmatch(end) for end in ends)
    return named or (bool(starts & ends) and all(end.isdecimal() for end in starts | ends))


def _check_width(path: Path, line: int, header: tuple[str, ...], body: Cells, used: Collection[str]) -> None:
    """Refuse columns between blanks if every row is shorter than the header: which column is empty is not known.

    Columns at the end that are not used, as remarks, may be empty.
    """
    names = [cell for cell in header if not PLACEHOLDER.fullmatch(cell)]
    longest = max((len([cell for cell in row if cell.strip()]) for row in body), default=0)
    if not longest or longest >= len(names):
        return
    last = [cell_at(row, longest - 1) for row in body if len(row) >= longest]
    ends = names[longest - 1] not in used or all(NUMBER.fullmatch(cell.replace(",", ".")) for cell in last)
    if not ends or any(name in used for name in names[longest:]):
        words = (
            f"the header has {len(names)} names and no row more than {longest} values between blanks; separate the "
            "columns by commas or tabs, or write names without blanks"
        )
        raise InputError([Message(words, str(path), line)])


def _padded(rows: Cells) -> Cells:
    length = max(map(len, rows), default=0)
    return tuple((*row, *[""] * (length - len(row))) for row in rows)


def _is_list_of_points(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the rows are name, x, y, z (or nothing), and perhaps codes that are no numbers, each name once.

    A name may be given twice by mistake if the second column has fractions and so no names.
    """
    names, is_whole = {row[0] for row in rows if row}, all(row[1].strip().isdecimal() for row in rows if len(row) > 1)
    return (
        len(rows) > 0
        and (len(names) == len(rows) or (2 * len(names) > len(rows) and not is_whole))
        and all(
            len(row) == len(rows[0]) >= 4
            and row[0].strip()
            and all(NUMBER.fullmatch(cell.strip()) for cell in row[1:3])
            and (not row[3].strip() or NUMBER.fullmatch(row[3].strip()))
            and not any(NUMBER.fullmatch(cell.strip()) for cell in row[4:])
            for row in rows
        )
    )
