"""Height differences from the staff readings of levelling books."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import zip_longest
from math import isclose
from statistics import median
from typing import NamedTuple

from mor.errors import InputError, Message, counted
from mor.project.column_names import (
    BENCHMARK,
    DECIMETRE,
    NO_READING,
    NUMBER,
    SECOND_READINGS,
    STAFF_DISTANCES,
    SUMS,
    TOTAL,
    normalised,
)
from mor.project.levelling import ALONE, SAME_HEIGHT, Levelling, StaffReading
from mor.project.recognition import Found
from mor.project.tidying import are_wires, of_wires, repeats_header
from mor.units import LENGTH_UNITS

_CODES = {
    **dict.fromkeys(["b", "bs", "back", "backsight", "rueckblick", "r", "ab"], "back"),
    **dict.fromkeys(["f", "fs", "fore", "foresight", "vorblick", "v", "vb"], "fore"),
    **dict.fromkeys(["i", "is", "intermediate", "zwischenblick", "z", "zs"], "between"),
}
"""Codes of staff readings in a column of their own; others are those of results."""
_READINGS = ("back", "fore", "between", *STAFF_DISTANCES)
_TO_ITSELF = "height differences from a point to itself"
_DIGIT, _WORD = re.compile(r"\d"), re.compile(r"\w")
_STAFF = 10.0
"""No staff is as long in metres: larger readings are millimetres."""


class _Book(NamedTuple):
    """A table with levelling books: its lines in ``levelling``, and rows that are not used, by reason."""

    table: Found
    levelling: Levelling
    lines: slice
    second: Levelling
    """Lines of a second instrument."""
    left: dict[str, int]


class _Heights(NamedTuple):
    """Heights that books have by point, with their rows, and points that books before have levelled."""

    listed: dict[str, list[tuple[float, _LevelRow]]]
    reached: set[str]


def levelled(tables: Sequence[Found]) -> list[Found]:
    """Return the tables with height differences and benchmarks for levelling books, each of which is used once.

    A point inside two books is two points unless both have the same height for it: turning points are numbered anew.
    Raises :class:`InputError` for a book that cannot be read.
    """
    joint, read, mistakes = Levelling(), list[Found | _Book](), list[Message]()
    copies = dict[tuple[tuple[str, str, str], ...], int]()
    for table in tables:
        if table.kind != "levelling":
            read.append(table)
            continue
        table = _with_mean_wires(table)
        # Where each row names both points, a name is that of one point.
        levelling, second = Levelling() if "to" in table.columns else joint, Levelling()
        left = dict.fromkeys((NO_READING, SUMS, ALONE, _TO_ITSELF), 0)
        try:
            lines = _add(levelling, table, left)
        except InputError as error:
            if not table.sheet:
                raise
            mistakes += error.problems
            continue
        rows = tuple((r.start, r.end, f"{r.value:.6g}") for ln in levelling.lines[lines] for r in ln.all_differences())
        again = copies.setdefault(rows, len(read))
        if rows and again < len(read):
            del levelling.lines[lines]
            first = read[again]
            if isinstance(first, _Book):
                words = f"{f'{table.path.name} {table.sheet}'.strip()} has the same readings: not used once more"
                read[again] = first._replace(table=first.table._replace(notes=(*first.table.notes, words)))
            continue
        if table.columns.keys() >= {*SECOND_READINGS}:
            names = {"back": table.columns["back2"], "fore": table.columns["fore2"]}
            _add(second, table._replace(columns={**table.columns, **names}), left)
        read.append(_Book(table, levelling, lines, second, left))
    heights = _Heights({}, set())
    found = [table for one in read for table in (_levelled(one, heights) if isinstance(one, _Book) else (one,))]
    if not found and mistakes:
        raise InputError(mistakes)
    return found


def _add(levelling: Levelling, table: Found, left: dict[str, int]) -> slice:
    """Add the books of a table, and return their lines. ``left`` is counted up."""
    first, alone = len(levelling.lines), len(levelling.alone)
    for book in _books(table):
        levelling.begin()
        if "code" in table.columns:
            _add_by_codes(levelling, book, left)
        else:
            _add_book(levelling, book, left)
    levelling.close()
    if not levelling.lines[-1].all_differences():
        levelling.lines.pop()
    left[ALONE] += len(levelling.alone) - alone
    return slice(first, len(levelling.lines))


def _levelled(book: _Book, heights: _Heights) -> tuple[Found, ...]:
    table, left = book.table, book.left
    renamed = book.levelling.names_of_lines()[0]
    own, lines = renamed[book.lines], book.levelling.lines[book.lines]
    rows = [
        row.with_names(names)
        for part in (lines, book.second.lines)
        for line, names in zip(part, own, strict=False)
        for row in line.all_differences()
    ]
    found = [row for row in rows if row.start != row.end]
    left[_TO_ITSELF] += len(rows) - len(found)
    if not found and table.sheet:
        return ()
    if not found and table.rows:
        raise InputError([Message("no set-up has readings back and forward", str(table.path))])
    names = ["from", "to", "dz", "length"][: 3 + all(row.length is not None for row in found)]
    read = ("back", "fore", "reading")
    values = [abs(value) for ours in read for value in table.numbers(ours)]
    unit = next((table.units[name] for name in read if name in table.units), "")
    units = {"dz": unit or ("mm" if values and median(values) > _STAFF else "")}
    distances = ("distance", *STAFF_DISTANCES)
    units["length"] = next((table.units[name] for name in distances if name in table.units), "")
    cells = [(row.start, row.end, f"{row.value:.9g}", f"{row.length or 0.0:.9g}")[: len(names)] for row in found]
    notes: tuple[str, ...] = (*table.notes, f"{counted(len(found), 'height difference')} from the staff readings")
    if len(lines) > 1:
        notes += (f"{len(lines)} levelling books below each other",)
    elsewhere = [
        {names.get(name, name) for name in line.inside() | line.ends()}
        for line, names in zip(book.levelling.lines, renamed, strict=True)
    ]
    everywhere = [name for one in elsewhere for name in one]
    shared = {name for one in elsewhere[book.lines] for name in one if everywhere.count(name) > 1}
    if shared:
        notes += (f"points that several books have are the same points: {', '.join(sorted(shared))}",)
    if others := sorted({name for one in own for name in one}):
        notes += (f"points of the same name in other books are other points: {', '.join(others)}",)
    written = table._replace(delimiter=",", decimal_comma=False, has_header=True, tidied=True)
    measured, benchmark = {name for row in found for name in (row.start, row.end)}, tuple[Found, ...]()
    known = {name: height for name, height in _benchmarks(table, heights).items() if name in measured}
    heights.reached.update(measured)
    suffix = table.part.removeprefix("levelling") if table.part.startswith("levelling") else ""
    if known:
        given = [row.height() for row in _level_rows(table) if row.has_height()]
        below = counted(sum(map(bool, given)) - sum(bool(float(height)) for height in known.values()), "height")
        notes += (f"the height of {', '.join(known)} is taken over; {below} below not used: they are computed",)
        unit = table.units.get("height", "")
        control = written._replace(
            kind="points",
            columns={"id": "id", "z": "z"},
            unused=(),
            units={"z": unit} if unit else {},
            header=("id", "z"),
            rows=tuple(known.items()),
            notes=(),
            is_control=True,
            part=f"{BENCHMARK}{suffix}",
        )
        benchmark = (control,)
    differences = written._replace(
        kind="height_difference",
        columns=dict(zip(names, names, strict=True)),
        unused=(*table.unused, *(table.columns[n] for n in distances if n in table.columns and "length" not in names)),
        units={name: unit for name, unit in units.items() if unit and name in names},
        header=tuple(names),
        rows=tuple(cells),
        notes=(*notes, *(f"{what}: {counted(n, 'row')}" for what, n in left.items() if n)),
        part=f"height_difference{suffix}" if benchmark or table.part else "",
    )
    return differences, *benchmark


def _level_rows(table: Found) -> list[_LevelRow]:
    return [_LevelRow(table, line, cells) for line, cells in zip(table.lines, table.rows, strict=True)]


def _books(table: Found) -> list[list[_LevelRow]]:
    """Rows of levelling books below each other: each has the header again, unless it goes on at the last point."""
    books, last = [list[_LevelRow]()], ""
    rows = _level_rows(table)
    for k, row in enumerate(rows):
        if repeats_header(row.cells, table.header, table.columns.values()):
            first = next((below for below in rows[k:] if below.has_readings()), None)
            is_page = first is not None and (
                first.number("back") is None or first.number("fore") is not None or first.text("point") == last
            )
            if not is_page and "to" not in table.columns:
                books.append([])
        else:
            books[-1].append(row)
            last = (row.text("point") if row.has_readings() else "") or last
    return books


def _benchmarks(table: Found, heights: _Heights) -> dict[str, str]:
    """First heights in books, by point, that no book before has levelled.

    Raises :class:`InputError` if books begin at one point with two heights.
    """
    found = dict[str, str]()
    tolerance = DECIMETRE / LENGTH_UNITS.get(table.units.get("height", "m"), 1.0)
    for book in _books(table):
        known = [row for row in book if row.has_height()]
        for row in known[:1]:
            name, height = row.text("point"), row.height()
            before = heights.listed.get(name, [])
            if before and min(abs(height - other) for other, _ in before) > tolerance:
                other, first = before[0]
                place = (
                    f"{first.table.path.name}:{first.row}" if first.table.sheet == table.sheet else first.table.sheet
                )
                words = (
                    f"the books that begin here and in {place} give point {name} the heights {height:g} and {other:g}: "
                    "put books of different points into files of their own"
                )
                raise InputError([Message(words, str(table.path), row.row)])
            if not before and name not in heights.reached:
                found[name] = row.text("height").replace(",", ".")
        for row in known[:1] + [row for row in known[1:] if row.height()]:
            heights.listed.setdefault(row.text("point"), []).append((row.height(), row))
    return found


def _add_by_codes(levelling: Levelling, rows: Sequence[_LevelRow], left: dict[str, int]) -> None:
    """Add readings whose side a code says; a row with another code has the result of a set-up."""
    for row in rows:
        name, side, value, height = row.text("point"), row.side(), row.number("reading"), row.number("height")
        if not side and row.text("code") and _DIGIT.search("".join(row.cells)):
            levelling.result(name, height)
            continue
        if not side or value is None:
            left[NO_READING] += 1
            continue
        reading = StaffReading(name or f"line {row.row}", value, row.number("distance"), row.row)
        if side == "back":
            levelling.sight_back(reading)
        elif side == "fore":
            levelling.sight_forward(reading)
        else:
            levelling.sight_between(reading)
        levelling.record(name, height)


def _add_book(levelling: Levelling, rows: Sequence[_LevelRow], left: dict[str, int]) -> None:
    """Add a levelling book: a reading forward ends a set-up, one back begins the next."""
    full = [row for row in rows if row.has_readings()]
    left[NO_READING] += len(rows) - len(full)
    for row in rows:
        if row.has_height():
            levelling.record(row.text("point"), row.height())
    if _is_read_twice(full):
        for one, other in zip(full[::2], full[1::2], strict=True):
            for row in (one, other):
                back, fore, _, behind, ahead = map(row.number, _READINGS)
                levelling.sight_back(StaffReading(one.text("point"), back or 0.0, behind, row.row))
                levelling.sight_forward(StaffReading(other.text("point"), fore or 0.0, ahead, row.row))
            levelling.close()
        return
    distances = [value for row in full if (value := row.number("distance")) is not None]
    is_chainage = distances == sorted(set(distances))
    total = 0.0
    for row, after in zip_longest(full, full[1:]):
        back, fore, between, behind, ahead = map(row.number, _READINGS)
        if behind is None and ahead is None and not is_chainage and (back is None or fore is None):
            behind = ahead = row.number("distance")
        elif "to" in row.table.columns and behind is None and ahead is None:
            behind = ahead = (row.number("distance") or 0.0) / 2.0 or None
        if "to" in row.table.columns and back is not None and fore is not None:
            levelling.sight_back(StaffReading(row.text("from"), back, behind, row.row))
            levelling.sight_forward(StaffReading(row.text("to"), fore, ahead, row.row))
            levelling.close()
            continue
        is_last = after is None or (after.number("back") is not None and after.number("fore") is None)
        if is_last and back is not None and fore is not None and isclose(back, total, abs_tol=1e-6):
            left[SUMS] += 1
            total = 0.0
            continue
        total += back or 0.0
        if row is full[0] and back is not None and fore is not None:
            words = "found readings back and forward in the first row; expected a row for each point, first one back"
            raise InputError([Message(words, str(row.table.path), row.row)])
        name = row.text("point")
        if back is None and after and after.number("fore") is not None and not (after.text("point") == name != ""):
            fore, between = None, fore if between is None else between  # no reading back from this point follows
        if between is not None:
            levelling.sight_between(StaffReading(name or f"line {row.row}", between, ahead, row.row))
        if fore is not None:
            levelling.sight_forward(StaffReading(name, fore, ahead, row.row))
        if back is not None:
            levelling.sight_back(StaffReading(name, back, behind, row.row))


def _is_read_twice(rows: Sequence[_LevelRow]) -> bool:
    """Return whether rows have the readings of set-ups twice: one row with the point behind, one with that ahead."""
    read = [(row.number("back"), row.number("fore")) for row in rows]
    if (
        len(rows) % 2
        or not rows
        or any(back is None or fore is None for back, fore in read)
        or "to" in rows[0].table.columns
    ):
        return False
    steps = [(back or 0.0) - (fore or 0.0) for back, fore in read]
    unit = 1000.0 if max(abs(back or 0.0) for back, _ in read) > _STAFF else 1.0
    names = [row.text("point") for row in rows]
    return all(one != other for one, other in zip(names[::2], names[1::2], strict=True)) and all(
        abs(one - other) < SAME_HEIGHT * unit for one, other in zip(steps[::2], steps[1::2], strict=True)
    )


def _with_mean_wires(table: Found) -> Found:
    """One row for each point of a book with three wires in rows below each other: their mean, and the distance.

    The first row of a point names it; their mean may stand in a row below them. The middle wire is the mean of the
    outer ones, and the distance is 100 times what they differ by.
    """
    groups = list[list[_LevelRow]]()
    for row in _level_rows(table):
        if row.text("point"):
            groups.append([])
        if groups and row.has_readings():
            groups[-1].append(row)
    full = [rows for rows in groups if rows]
    read = [
        {name: [v for row in rows if (v := row.number(name)) is not None] for name in _READINGS[:3]} for rows in full
    ]
    sides = [one for three in read for name, one in three.items() if one and name != "between"]
    several = [one for one in sides if len(one) > 2]
    if len(full) < 2 or 2 * len(several) <= len(sides) or 3 * sum(map(are_wires, several)) <= 2 * len(several):
        return table
    # Names without three readings are those of sums and of other words below the book.
    left = [len(max(three["back"], three["fore"], three["between"], key=len)) < 3 for three in read]
    words = ", ".join(rows[0].text("point") for rows, is_left in zip(full, left, strict=True) if is_left)
    full = [rows for rows, is_left in zip(full, left, strict=True) if not is_left]
    read = [three for three, is_left in zip(read, left, strict=True) if not is_left]
    # A column between in which no wires stand has intervals.
    has_between = all(not three["between"] or are_wires(three["between"]) for three in read)
    names = [name for name in _READINGS[: 3 if has_between else 2] if name in table.columns]
    header, ends, off = ("point", *names, "back_distance", "fore_distance"), ("back", "fore"), list[str]()
    means = []
    for rows, three in zip(full, read, strict=True):
        ahead = three["fore"] or (three["between"] if has_between else [])
        if not all(are_wires(three[name]) for name in names if three[name]):
            off.append(f"{rows[0].text('point')} ({rows[0].row})")
        means.append(
            (
                rows[0].text("point"),
                *(f"{of_wires(three[name]):.9g}" if three[name] else "" for name in names),
                *(f"{100.0 * (one[0] - one[2]):.9g}" if len(one) > 2 else "" for one in (three["back"], ahead)),
            )
        )
    unit = table.units.get(ends[0], "mm" if median(table.numbers(ends[0])) > _STAFF else "")
    units = dict.fromkeys((*names, "back_distance", "fore_distance"), unit) if unit else {}
    return table._replace(
        columns=dict(zip(header, header, strict=True)),
        units=units,
        header=header,
        rows=tuple(means),
        lines=tuple(rows[0].row for rows in full),
        decimal_comma=False,
        notes=(
            *table.notes,
            f"three wires at {counted(len(means), 'point')}: their mean, and 100 times their interval",
            *((f"names without three wires left out: {words}",) if words else ()),
            *(
                (f"wires that contradict each other, of which the middle one is read, with rows: {', '.join(off)}",)
                if off
                else ()
            ),
        ),
    )


class _LevelRow(NamedTuple):
    """A row of a levelling book, and the line of the file it stands in."""

    table: Found
    row: int
    cells: tuple[str, ...]

    def text(self, name: str) -> str:
        """Cell of a column, empty if it is missing."""
        place = self.table.header.index(self.table.columns[name]) if name in self.table.columns else len(self.cells)
        return self.cells[place].strip() if place < len(self.cells) else ""

    def side(self) -> str:
        """Name of the reading that a code says, empty if it is that of no reading."""
        return _CODES.get(normalised(self.text("code")), "")

    def has_height(self) -> bool:
        """Return whether the row has a point and a height."""
        return bool(self.text("point") and NUMBER.fullmatch(self.text("height")))

    def height(self) -> float:
        """Height in a row that has one."""
        return float(self.text("height").replace(",", "."))

    def has_readings(self) -> bool:
        """Return whether the row has a reading, and no word as in checks below a book: of a sum, or in its place."""
        cells = list(map(self.text, _READINGS[:3]))
        is_told = any(_WORD.search(cell) and not _DIGIT.search(cell) for cell in cells)
        is_told |= not self.text("point") and any(TOTAL.match(cell.strip()) for cell in self.cells)
        return not is_told and any(self.number(name) is not None for name in _READINGS[:3])

    def number(self, name: str) -> float | None:
        """Number in a column, ``None`` if the cell has none or 0. Raises :class:`InputError` for a text with digits."""
        text = self.text(name)
        if not _DIGIT.search(text):
            return None
        if not NUMBER.fullmatch(text):
            words = f"column {self.table.columns[name]}: found {text!r}, expected a number"
            raise InputError([Message(words, str(self.table.path), self.row)])
        return float(text.replace(",", ".")) or None
