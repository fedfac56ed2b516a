"""Rows of tables as people write them, made plain: one header, one value a cell, a station in every row."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import chain, pairwise
from statistics import median
from typing import NamedTuple

from mor.errors import counted
from mor.project.column_names import (
    ANGLES,
    AXES,
    DERIVED,
    KINDS,
    KNOWN_NAMES,
    NAMES,
    NUMBER,
    PLACEHOLDER,
    PLACES,
    SIGHT,
    TITLES,
    WORDS_OF_UNITS,
    ZERO,
    Cells,
    cell_at,
    columns_of,
    columns_that_are_known,
    fits_a_table,
    is_control,
    is_heading,
    kinds_of,
    name_and_unit,
    named_columns,
    normalised,
    number_in,
)
from mor.project.headerless import titles_of_sections

_PARTS = tuple(
    re.compile(f"(.*?)(?:{words})")
    for words in (
        "degrees?|deg|grados?|graus?|gradi|d|g",
        "minutes?|minutos?|minuti|min|m",
        "seconds?|segundos?|secondi|seg|sec|s",
    )
)
"""Headings of degrees, minutes and seconds in columns of their own, behind a common name."""
_HAIRS = tuple(
    tuple(re.compile(f"(?:hilo|fil|filo)?(?:{name})(?:hair|wire|stadia|reading|faden)?") for name in names)
    for names in (
        ("upper|up|top|u|t", "middle|mid|centre|center|m|c", "lower|low|bottom|bot|l|b"),
        ("oben|ober|o", "mitte|mittel|m", "unten|unter|u"),
        ("superior|superieur|superiore|sup|s", "medio|central|moyen|m|c", "inferior|inferieur|inferiore|inf|i"),
    )
)
"""Names of the upper, middle and lower hair behind that of the reading; only where all three are there."""
_PLACE = re.compile(r"[(\[]?\s*([-+]?\d+(?:\.\d*)?)\s*[,;]\s*([-+]?\d+(?:\.\d*)?)\s*[)\]]?")
"""x and y in one cell."""
_LEADING = re.compile(r"[-+]?\d+(\.\d*)?")
_PACKED = re.compile(r"(?P<whole>\d{1,3})(?:\.(?P<rest>\d*))?")
_YES = {"true", "yes", "y", "1", "fix", "fixed", "held", "known", "control", "x", "ja", "wahr", "si", "oui", "vrai"}
_NO = {"", "false", "no", "n", "0", "free", "unknown", "new", "nein", "falsch", "non", "faux", "-"}
_FACES = {"": "", "1": "1", "2": "2"} | {
    word: face
    for face, words in (
        ("1", "l|left|fl|faceleft|cl|i|d|direct|links|direta|directa|directo|pd|cd|左|盘左|кл"),
        ("2", "r|right|fr|faceright|cr|ii|reverse|rechts|inversa|inverso|pi|ci|右|盘右|кп"),
    )
    for word in words.split("|")
}
"""Faces of an instrument by their names."""
_FACE_COLUMNS = [
    tuple(
        re.compile(word if word > "z" else rf"(?<![^\W_]){word.replace('_', '[ ._-]*')}(?![^\W_])", re.IGNORECASE)
        for word in pair.split("/")
    )
    for pair in (
        *(
            "盘左/盘右",
            "face_left/face_right",
            "circle_left/circle_right",
            "kreis_links/kreis_rechts",
            "fl/fr",
            "cl/cr",
        ),
        *("lage_i/lage_ii", "lage_1/lage_2", "face_i/face_ii", "face_1/face_2", "f1/f2", "pd/pi", "cd/ci", "cg/cd"),
        *("кл/кп", "direct/reverse", "direct[ao]/invers[ao]", "diret[ao]/invers[ao]", "left/right", "l/r", "i/ii"),
    )
]
"""Words for the first and second face in headings of columns."""


_NUMBERED_SIDE = re.compile(r"(?:[后後](?![视视]?[-—–~一]?前)|前)[视尺]?")
"""Side of a staff in a row of a Chinese form, before its number or the name of its point; not of their difference."""
_HAS_LETTER = re.compile(r"[^\W\d_].*\w|\w.*[^\W\d_]")
_HAS_DIGIT = re.compile(r"\d")
_DOTTED = re.compile(r"([-+]?\d{1,3})\.(\d{1,2})\.(\d{1,2}(?:\.\d*)?)")
"""Degrees, minutes and seconds between points."""
_ENDS_OF_FORM = re.compile(r"\s*(?:[-–—~～→至|]|\n)+\s*")
"""Signs between both points of a set-up."""


class TableRows(NamedTuple):
    """Rows with one header, their lines in the file, notes on what is not read, and the title above."""

    rows: Cells
    lines: tuple[int, ...]
    notes: tuple[str, ...] = ()
    title: str = ""


def of_wires(values: Sequence[float]) -> float:
    """Return the mean of three hairs, or the reading."""
    return sum(values[:3]) / 3 if are_wires(values) else values[min(1, len(values) - 1)]


def are_wires(values: Sequence[float | None]) -> bool:
    """Return whether readings are those of the upper, middle and lower wire, perhaps with their mean, or none."""
    if len(values) not in (3, 4) or None in values[:3]:
        return not any(values)
    upper, middle, lower = (value or 0.0 for value in values[:3])
    mean = values[3] or 0.0 if len(values) > 3 else middle
    # The middle wire may be off by a tenth of the interval of the outer ones.
    return upper > lower and max(abs(upper + lower - 2.0 * middle), abs(mean - middle)) <= 0.1 * (upper - lower)


def _without_index(rows: Cells) -> Cells:
    """Rows without numbers that count them and have no heading, as programs print a table."""
    header, below = (rows[0], rows[1:]) if rows else ((), ())
    counts = [row[0].strip() for row in below if len(row) == len(header) + 1]
    start = int(counts[0]) if counts and counts[0] in ("0", "1") else 0
    if len(counts) < 2 or any(map(NUMBER.fullmatch, header)) or counts != [str(start + k) for k in range(len(below))]:
        return rows
    return (header, *(row[1:] for row in below))


def tables_in(rows: Cells, lines: tuple[int, ...]) -> list[TableRows]:
    """Return the tables of a sheet, below and beside each other, each with its header in the first row.

    A header has no numbers, but rows with numbers below it. A table ends where another header follows.
    """
    rows, lines = _with_headers_of_points(*_with_set_ups_in_rows(rows, lines))
    starts = _headers(rows, lines)
    if not starts:
        start = next((k for k, row in enumerate(rows) if len(_words(row)) > 1), 0)  # below titles
        return [TableRows(_without_index(with_whole_angles(rows[start:])), lines[start:])]
    found, rest = list[TableRows](), list[str]()
    unread = sum(any(map(NUMBER.fullmatch, map(str.strip, row[1:]))) for row in rows[: starts[0]])
    if unread:
        rest.append(f"rows with numbers stand above the header: {counted(unread, 'row')} not read")
    ends = [_end(rows, lines, start, after) for start, after in pairwise([*starts, len(rows)])]
    for start, end in zip(starts, ends, strict=True):
        above = rows[start - 1] if start else ()
        title = "" if any(map(_begins_with_digit, _words(above))) else " ".join(_words(above))
        table = with_whole_angles(_with_whole_header(rows[start:end]))
        if not any(map(_begins_with_digit, chain(*table[1:]))):  # a form that is not filled in
            table = table[:1]
        own_lines = (lines[start], *lines[end - len(table) + 1 : end])
        is_again = any(_repeats(table, one.rows) for one in found)
        beside = [] if is_again else _beside_each_other(table, own_lines, above, title)
        if beside or not found:
            found += beside
        else:
            names, count = ", ".join(_words(table[0])), counted(len(table) - 1, "row")
            rest.append(f"another table begins below (columns {names}): {count} not read")
    return [block._replace(notes=(*rest, *block.notes)) for block in found]


def _with_set_ups_in_rows(rows: Cells, lines: tuple[int, ...]) -> tuple[Cells, tuple[int, ...]]:
    """Rows and lines of a levelling form that has several rows for each set-up, with one row for each of them.

    The heading of a column may have a name for each of these rows; or a column says which row is back and which fore.
    """
    is_head = [len(set(_words(row))) > 1 and not any(map(_begins_with_digit, row)) for row in rows]
    end = next((k for k in range(2, len(rows)) if all(is_head[k - 2 : k]) and not is_head[k]), 0)
    start = end
    while start and is_head[start - 1]:
        start -= 1
    begins = [k for k in range(end, len(rows)) if cell_at(rows[k], 0)]
    size = begins[1] - begins[0] if len(begins) > 1 else 0
    if not (2 <= size <= 6 and end - start > 1):
        return rows, lines
    apart = [after - one for one, after in pairwise([*begins, len(rows)])]
    last = next((k + (far > size) for k, far in enumerate(apart[:-1]) if far != size), len(begins))
    width = max(map(len, rows[start:]))
    forms = [[[cell_at(row, j) for j in range(width)] for row in rows[k : k + size]] for k in begins[:last]]
    heads = [[cell_at(row, j) for j in range(width)] for row in rows[max(start, end - size) : end]]
    heads += [[""] * width for _ in range(size - len(heads))]
    names = [
        "" if any(head[j] == above[j] for above in heads[:i]) else head[j]
        for i, head in enumerate(heads)
        for j in range(width)
    ]
    whole = [list(chain(*form)) for form in forms if len(form) == size]
    found: list[tuple[str, ...]] = [tuple(names), *map(tuple, whole)]
    if columns_of("levelling between points", named_columns(names)) is None:
        found = _by_sides(names, whole, width)
    if not found:
        return rows, lines
    checks = begins[last - 1] + size  # rows up to the next table
    rest = next((checks + k for k in _headers(rows[checks:], lines[checks:])), len(rows))
    own = (lines[start], *(lines[k] for k in begins[: len(whole)]))
    return (*rows[:start], *found, *rows[rest:]), (*lines[:start], *own, *lines[rest:])


def _with_headers_of_points(rows: Cells, lines: tuple[int, ...]) -> tuple[Cells, tuple[int, ...]]:
    """Rows and lines with a header between a title such as "known points" and names with one to three coordinates."""
    if any(not is_control(title.replace(" ", "")) for title in titles_of_sections(rows)):
        return rows, lines
    found, numbers = list[tuple[str, ...]](), list[int]()
    for row, below, line in zip(rows, (*rows[1:], ()), lines, strict=False):
        found.append(row)
        numbers.append(line)
        cells = _words(below)
        is_listed = 1 < len(cells) < 5 and all(map(NUMBER.fullmatch, cells[1:]))
        if is_listed and len(words := _words(row)) < 4 and is_control("".join(words)):
            found.append(("id", "x", "y", "z")[: len(cells)] if cells[2:] else ("id", "z"))
            numbers.append(line)
    return tuple(found), tuple(numbers)


def _by_sides(names: Sequence[str], forms: list[list[str]], width: int) -> list[tuple[str, ...]]:
    """Rows of set-ups whose forms say in a column which row is back and which fore; empty for others."""
    sides = [[_side(cell) for cell in form] for form in forms]
    place = next((k for k in range(len(names)) if all(one[k] == "back" for one in sides)), -1)
    other = next((k for k in range(place + width, len(names), width) if all(one[k] == "fore" for one in sides)), -1)
    if place < 0 or other < 0 or place % width == width - 1:
        return []
    of_points = [k % width for k, name in enumerate(names) if normalised(name) in NAMES.point.split("|")]
    ends = list[list[str]]()
    for form in forms:
        own = [_NUMBERED_SIDE.sub("", form[k]).strip() for k in (place, other)]
        named = [cell for j in of_points for cell in form[j::width] if cell]
        parts = [part for cell in (*named, form[0]) for part in _ENDS_OF_FORM.split(cell) if part]
        ends.append(own if all(map(_HAS_LETTER.search, own)) else named[:2] if len(named) > 1 else parts[:2])
    if any(len(both) < 2 or both[0] == both[1] for both in ends):
        return []
    columns = {"from": [one for one, _ in ends], "to": [end for _, end in ends]}
    read = {side: [form[k + 1] for form in forms] for side, k in (("back", place), ("fore", other))}
    for side, k in (("back", place), ("fore", other)) if place % width + 2 < width else ():
        pairs = [(number_in(form[k + 1]) or 0.0, number_in(form[k + 2]) or 0.0) for form in forms]
        unit = 1.0 if max(black for black, _ in pairs) > 10.0 else 0.001
        zeros = [min((4687.0, 4787.0), key=lambda mm: abs(red - black - mm * unit)) * unit for black, red in pairs]
        # A red face begins at 4687 or 4787 mm; readings of one staff on both faces agree within a centimetre.
        if all(abs(red - black - zero) < 10.0 * unit for (black, red), zero in zip(pairs, zeros, strict=True)):
            read[f"{side}2"] = [f"{red - zero:.9g}" for (_, red), zero in zip(pairs, zeros, strict=True)]
    for ours, others in (("back_distance", NAMES.back_distance), ("fore_distance", NAMES.fore_distance)):
        if far := [k for k, name in enumerate(names) if name_and_unit(name)[0] in others.split("|")]:
            read[ours] = [form[far[0]] for form in forms]
    columns |= read
    return [tuple(columns), *zip(*columns.values(), strict=True)]


def _side(cell: str) -> str:
    word = _NUMBERED_SIDE.match(cell.strip())
    return {"前": "fore"}.get(word[0][0], "back") if word else ""


def _headers(rows: Cells, lines: tuple[int, ...]) -> list[int]:
    """Rows that begin tables: the first with the names of a known one, and those of other tables below."""
    found, has_values, is_derived = list[int](), False, False
    header: tuple[str, ...] = ()
    for k, row in enumerate(rows):
        words = _words(row)
        if any(map(_begins_with_digit, words)) and (
            found or k >= TITLES or not (is_heading(row) and fits_a_table(row))
        ):
            has_values = True
            continue
        below = _words(rows[k + 1]) if k + 1 < len(rows) else []
        if (found and not has_values) or len(words) < 2:
            is_listed = has_values and header[:1] == ("id",) and len(words) == 1
            if is_listed and below[2:] and not NUMBER.fullmatch(below[1]):
                found.append(k + 1)  # a list of known points without a header ends
                has_values, header = False, ("",)
            continue
        whole = _with_whole_header(rows[k : k + 3])
        is_known = fits_a_table(plain_header(whole[0]))
        titled = bool(k) and bool(DERIVED.search(normalised("".join(rows[k - 1]))))
        if found and repeats_header(row, header, header) and titled == is_derived:
            continue
        if found and not is_known:
            numbers = sum(map(_begins_with_digit, below))
            is_apart = lines[k] > lines[k - 1] + 1 or len(_words(rows[k - 1])) == 1
            is_named = is_apart and (numbers > 1 or columns_that_are_known(row) > 1)
            begins_alike = normalised(cell_at(row, 0)) == normalised(header[0]) != ""
            is_known = len(below) - 1 <= len(words) > 2 and numbers > 0 and (is_named or begins_alike)
        if is_known:
            found.append(k)
            has_values, header, is_derived = False, tuple(cell.strip() for cell in row), titled
    return found


def _end(rows: Cells, lines: tuple[int, ...], start: int, after: int) -> int:
    """End of a table: titles and rows of a name and a value above the next header do not belong to it."""
    if after == len(rows):
        return after
    gaps = [k for k in range(start + 1, after + 1) if lines[k] > lines[k - 1] + 1]
    if gaps and all(len(_words(row)) < 3 for row in rows[gaps[-1] : after]):
        after = gaps[-1]
    while after - 1 > start and len(above := _words(rows[after - 1])) == 1 and not _begins_with_digit(above[0]):
        after -= 1
    return after


def _with_whole_header(rows: Cells) -> Cells:
    """Rows with one header: rows of subheadings are joined to the first as long as they name columns that are known."""
    header, found = tuple(cell.strip() for cell in rows[0]), rows
    for k in range(1, min(len(rows), 3)):
        header = _with_subheadings(header, rows[k])
        if not header:
            break
        if _columns_read(plain_header(header)) >= max(_columns_read(plain_header(found[0])), 1):
            found = (header, *rows[k + 1 :])
    return found


def _columns_read(header: tuple[str, ...]) -> int:
    """Return how many columns the kinds of tables that a header fits read; 0 if it fits none."""
    named = named_columns([cell.strip() for cell in header])
    kinds = kinds_of(named) or kinds_of([*named, ("", "station", "")])
    return len({cell for columns in kinds.values() for cell in columns.values() if cell})


def plain_header(header: Sequence[str]) -> tuple[str, ...]:
    """Return a header as it becomes with parts of angles in one column, and faces in rows."""
    return with_faces_apart(with_whole_angles((tuple(header),)))[0]


def _pairs_of_faces(header: Sequence[str]) -> list[tuple[int, int, str]]:
    """Columns of one reading in the first and in the second face, and the name of the reading."""
    for first, second in _FACE_COLUMNS:
        ends = {normalised(second.sub(" ", cell)): k for k, cell in enumerate(header) if second.search(cell)}
        names = {k: first.sub(" ", cell).strip() for k, cell in enumerate(header) if first.search(cell)}
        if found := [(k, ends[normalised(name)], name) for k, name in names.items() if normalised(name) in ends]:
            is_known = [name_and_unit(name)[0] in KNOWN_NAMES - {""} for _, _, name in found]
            one = is_known.index(False) if False in is_known else -1
            return [(k, j, "horizontal" if i == one else name) for i, (k, j, name) in enumerate(found)]
    return []


def with_faces_apart(rows: Cells) -> Cells:
    """Rows of sights with the readings in both faces below each other, if they stand in columns beside each other."""
    header = [cell.strip() for cell in rows[0]]
    pairs = _pairs_of_faces(header)
    for k, j, name in pairs:
        header[k], header[j] = name, ""
    columns = next(iter(kinds_of(named_columns([*header, "face"])).values()), {}) if pairs else {}
    if "face" not in columns or "face" in header:
        return rows
    shared = [k for k, cell in enumerate(header) if cell in [columns.get(name) for name in (*PLACES, *SIGHT)]]
    found = [(*header, "face")]
    for row in rows[1:]:
        cells = [cell_at(row, k) for k in range(len(header))]
        second = [cell if k in shared else "" for k, cell in enumerate(cells)]
        for k, j, _ in pairs:
            second[k], cells[j] = cells[j], ""
        found.append((*cells, "1"))
        if any(second[k] for k, *_ in pairs):
            found.append((*second, "2"))
    return tuple(found)


def _repeats(rows: Cells, earlier: Cells) -> bool:
    """Return whether all rows of a table stand in an earlier one with columns of the same names, as its computation."""
    places = [{normalised(cell): k for k, cell in enumerate(one[0]) if _words([cell])} for one in (rows, earlier)]
    shared = [name for name in places[0] if name in places[1]]
    one, other = (
        [tuple(cell_at(row, own[name]) for name in shared) for row in table[1:]]
        for own, table in zip(places, (rows, earlier), strict=True)
    )
    return len(shared) > 2 and len(one) > 1 and set(one) <= set(other)


def _words(row: Sequence[str]) -> list[str]:
    return [cell for cell in map(str.strip, row) if cell and not PLACEHOLDER.fullmatch(cell)]


def _begins_with_digit(cell: str) -> bool:
    return cell.lstrip("+-−.,")[:1].isdigit()


def _beside_each_other(rows: Cells, lines: tuple[int, ...], above: tuple[str, ...], title: str) -> list[TableRows]:
    """Return tables beside each other; ``above``: the row above their headers."""
    found, rest, kinds = list[TableRows](), list[str](), set[str]()
    for one, end in _side_by_side(rows, above):
        cut = [tuple(cell_at(row, k) for k in range(one, end)) for row in rows] if end else rows
        kept = [k for k, row in enumerate(cut) if not end or any(row)]
        table, names = tuple(cut[k] for k in kept), [cell.strip() for cell in cut[0]]
        kind = next(iter(kinds_of(named_columns(names))), "") if end else "alone"
        if end == 0 and not fits_a_table(plain_header(names)):
            continue
        if kind and (kind not in kinds or kind.startswith(("points", "levelling"))):
            kinds.add(kind)
            own = next(iter(_words(above[one:end])), "") if end else title
            found.append(TableRows(*_first_table(table, tuple(lines[k] for k in kept)), own))
        elif named := _words(names):
            count = counted(len(table) - 1, "row")
            rest.append(f"another table stands beside it (columns {', '.join(named)}): {count} not read")
    return [block._replace(notes=(*block.notes, *rest)) for block in found]


def _side_by_side(rows: Cells, above: tuple[str, ...]) -> list[tuple[int, int]]:
    """Columns of tables beside each other: one is named twice, and empty ones or titles above part them; or (0, 0)."""
    header = [cell.strip() for cell in rows[0]]
    header = ["" if PLACEHOLDER.fullmatch(cell) else cell for cell in header]
    named = [cell for cell in header if cell]
    if len(set(named)) == len(named):
        return [(0, 0)]
    titled = [k for k, cell in enumerate(above[: len(header)]) if _words([cell])]
    empty = [k for k, cell in enumerate(header) if not cell and not any(cell_at(row, k) for row in rows[1:])]
    edges = sorted({0, len(header), *empty, *(titled if len(titled) > 1 else ())})
    found = list(pairwise(edges))
    return found if sum(bool(kinds_of(named_columns(header[one:end]))) for one, end in found) > 1 else [(0, 0)]


def _first_table(rows: Cells, lines: tuple[int, ...]) -> tuple[Cells, tuple[int, ...], tuple[str, ...]]:
    """Rows without headers below, each column once, angles in one column; lines, and notes on the rest."""
    header, body, notes = tuple(cell.strip() for cell in rows[0]), rows[1:], list[str]()
    kinds = kinds_of(named_columns(header))
    used = {cell for columns in kinds.values() for cell in columns.values()} or set(header)
    again = [k for k, row in enumerate(body) if repeats_header(row, header, used)]
    if not any(kind.startswith("levelling") for kind in kinds):  # each book has points and heights of its own
        body = tuple(row for k, row in enumerate(body) if k not in again)
    if {len(row) for row in body} == {len(list(filter(None, header)))}:  # headings several tabs apart
        header = tuple(filter(None, header))
    header, *body_rows = _without_index((header, *body))
    header, body = _with_joined_parts(header, tuple(body_rows))
    if twice := sorted({cell for cell in header if cell and header.count(cell) > 1}):
        notes.append(f"column {', '.join(map(repr, twice))} is given twice: the first one is read")
        keep = [k for k, cell in enumerate(header) if not cell or cell not in header[:k]]
        header, body = tuple(header[k] for k in keep), tuple(tuple(cell_at(row, k) for k in keep) for row in body)
    return (header, *body), lines, tuple(notes)


def repeats_header(row: tuple[str, ...], header: Sequence[str], used: Collection[str]) -> bool:
    """Return whether a row has the header once more, at least its columns that are used."""
    return all(cell_at(row, k) == cell for k, cell in enumerate(header) if cell in used)


def _with_joined_parts(header: tuple[str, ...], body: Cells) -> tuple[tuple[str, ...], Cells]:
    """Degrees, minutes and seconds below one heading, with two columns beside it that have none, as one column."""
    for k in range(len(header) - 2):
        if not header[k] or not all(not cell or PLACEHOLDER.fullmatch(cell) for cell in header[k + 1 : k + 3]):
            continue
        cells = [[_whole(cell_at(row, j)) for j in (k, k + 1, k + 2)] for row in body]
        parts = [[cell or "0" for cell in three] if three[0] else three for three in cells]
        if sum(map(all, cells)) > 1 and all(map(_is_sexagesimal, parts)):
            angles = ("-".join(three) if any(three) else "" for three in parts)
            below = tuple((*row[:k], angle, *row[k + 3 :]) for row, angle in zip(body, angles, strict=True))
            return _with_joined_parts((*header[: k + 1], *header[k + 3 :]), below)
    return header, body


def tidied_rows(rows: Cells) -> tuple[Cells, dict[str, str]]:
    """Rows with whole headings and without units below them, with the station in every row, and the units."""
    if not rows or not fits_a_table(rows[0]):
        return rows, {}
    header, body = tuple(cell.strip() for cell in rows[0]), rows[1:]
    units = [cell.strip(" []()") for cell in body[0]] if body else []
    stated = {}
    known = [WORDS_OF_UNITS.get(unit) or WORDS_OF_UNITS.get(unit.lower(), "") for unit in units]
    if any(units) and all(word for word, unit in zip(known, units, strict=True) if unit not in ("", "-")):
        stated = {cell: unit for cell, unit in zip(header, known, strict=False) if unit}
        body = body[1:]
    elif body and len(_words(body[0])) > 2 and not any(map(_HAS_DIGIT.search, body[0])):
        rows, body = (header, *body[1:]), body[1:]  # abbreviations of the headings
    named = named_columns(header)
    if not kinds_of(named):
        return _with_stations(header, body) or rows, stated
    columns: Mapping[str, str] = next(iter(kinds_of(named).values()))
    # Columns that hold for the rows below as well, until another station stands there.
    kept = ("station", "at", "from", "station_height", "at_height", "from_height")
    places = [header.index(columns[name]) for name in kept if name in columns]
    body = _without_zeros_below(header, body, columns, places)
    empty = [bool(places) and len(row) == len(header) and not row[places[0]].strip() for row in body]
    if not stated and not any(empty[1:]):
        return rows, {}
    filled: list[tuple[str, ...]] = []
    if any(empty) and "set" in KINDS[next(iter(kinds_of(named)))][1]:
        header, body, columns = _with_set_ups(header, body, columns)
        empty = [len(row) == len(header) and not row[places[0]].strip() for row in body]
    for row, below in zip(body, empty, strict=True):
        above = filled[-1] if filled and below and len(filled[-1]) == len(header) else row
        sets = () if above is row or "set" not in columns else (header.index(columns["set"]),)
        filled.append(
            tuple(above[k] if k in places or (k in sets and not cell) else cell for k, cell in enumerate(row))
        )
    return (header, *filled), stated


def _without_zeros_below(header: Sequence[str], body: Cells, columns: Mapping[str, str], places: list[int]) -> Cells:
    """Rows without the name 0 of a station if it stands below another one and no sight leads to 0."""
    targets = [header.index(columns[name]) for name in ("to", "point") if name in columns]
    if not places or not targets or any(cell_at(row, k) == "0" for row in body for k in targets):
        return body
    place, first = places[0], next(iter(body), ())
    if cell_at(first, place) in ("", "0"):
        return body
    return tuple((*row[:place], "", *row[place + 1 :]) if cell_at(row, place) == "0" else row for row in body)


def _with_set_ups(
    header: tuple[str, ...], body: Cells, columns: Mapping[str, str]
) -> tuple[tuple[str, ...], Cells, Mapping[str, str]]:
    """Rows below their stations with other names of sets where a station is set up once more, after another one."""
    place, visits, last, row_visits = header.index(columns["station"]), dict[str, int](), "", list[int]()
    for row in body:
        name = cell_at(row, place)
        visits[name] = visits.get(name, 0) + bool(name and name != last)
        last = name or last
        row_visits.append(visits.get(last, 1))
    if max(row_visits, default=1) == 1:
        return header, body, columns
    if "set" not in columns:
        header, body, columns = (*header, "set"), tuple((*row, "") for row in body), {**columns, "set": "set"}
    k, last = header.index(columns["set"]), ""
    rows = list[tuple[str, ...]]()
    for row, visit in zip(body, row_visits, strict=True):
        last = cell_at(row, k) or ("" if cell_at(row, place) else last)
        name = last if visit == 1 else f"{last} ({visit})".strip()
        rows.append((*row[:k], name, *row[k + 1 :]))
    return header, tuple(rows), columns


def _with_subheadings(header: Sequence[str], below: Sequence[str]) -> tuple[str, ...]:
    """Names of columns from headings, each for several columns, and subheadings below them; empty if there are none."""
    if any(NUMBER.fullmatch(cell.strip()) for cell in below) or len(below) != len(header):
        return ()
    names, group, divided = list[str](), "", False
    parts = [name_and_unit(part.strip())[0] for part in below]
    for cell, part, name in zip(header, below, parts, strict=True):
        is_own = bool(cell) and not PLACEHOLDER.fullmatch(cell)
        group = cell if is_own else group
        divided |= bool(part) and not is_own
        # A name of its own that no other group has needs none, as the height behind the readings of a book.
        # Headings of up to three Latin letters such as D, M, S and sec say nothing without the one above them.
        is_alone = name in KNOWN_NAMES and len(part.strip().encode()) > 3 and parts.count(name) == 1
        is_alone &= not is_own or name_and_unit(cell)[0] not in KNOWN_NAMES
        part = "" if part.strip() == cell else part.strip()
        names.append((part if is_alone else f"{group} {part}") if part else cell)
    return with_hairs(names) if divided else ()


def _hairs(header: Sequence[str]) -> dict[str, tuple[int, int, int]]:
    """Places of the upper, middle and lower hair of readings back, forward and between, where all three are."""
    names, found = [name_and_unit(cell.strip())[0] for cell in header], dict[str, tuple[int, int, int]]()
    for ours in ("back", "fore", "between"):
        others = getattr(NAMES, ours).split("|")
        for forms in _HAIRS:
            rest = [[name[len(other) :] for other in others if name.startswith(other)] for name in names]
            places = [[k for k, ends in enumerate(rest) if any(map(form.fullmatch, ends))] for form in forms]
            if all(len(one) == 1 for one in places) and len({one[0] for one in places}) == len(places):
                found.setdefault(ours, (places[0][0], places[1][0], places[2][0]))
    return found


def with_hairs(header: Sequence[str]) -> tuple[str, ...]:
    """Header of a levelling book in which the hairs of readings have names that are known, and their units."""
    cells = list(header)
    for ours, places in _hairs(header).items():
        for k, hair in zip(places, ("upper", "middle", "lower"), strict=True):
            unit = name_and_unit(cells[k].strip())[1]
            cells[k] = f"{ours} {hair} [{unit}]" if unit else f"{ours} {hair}"
    return tuple(cells if columns_of("levelling", named_columns(cells)) else header)


def with_whole_readings(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows with the mean of three hairs in columns beside each other, and 100 times their interval; and a note on it.

    Where the middle hair is not the mean of the others in every row, it alone is the reading.
    """
    hairs = _hairs(rows[0]) if rows else {}
    read = {ours: [[number_in(cell_at(row, k)) for k in places] for row in rows[1:]] for ours, places in hairs.items()}
    if not {"back", "fore"} <= read.keys() or not all(are_wires(one) for found in read.values() for one in found):
        return rows, ()
    unit = name_and_unit(rows[0][hairs["back"][1]].strip())[1]
    ends = {"back": "back_distance", "fore": "fore_distance"}
    header = [f"{name} [{unit}]" if unit else name for name in (*read, *ends.values())]
    left = {k for places in hairs.values() for k in places}
    lines = [(*(cell for k, cell in enumerate(rows[0]) if k not in left), *header)]
    for k, row in enumerate(rows[1:]):
        three = {ours: [value for value in found[k] if value is not None] for ours, found in read.items()}
        means = [f"{sum(values) / 3:.9g}" if values else "" for values in three.values()]
        sights = (three["back"], three["fore"] or three.get("between", []))
        far = [f"{100.0 * (values[0] - values[2]):.9g}" if values else "" for values in sights]
        full = (*row, *[""] * (len(rows[0]) - len(row)))
        lines.append((*(cell for k, cell in enumerate(full) if k not in left), *means, *far))
    count = sum(any(one[0] is not None for one in found) for found in zip(*read.values(), strict=True))
    return tuple(lines), (f"three wires at {counted(count, 'point')}: their mean, and 100 times their interval",)


def with_whole_angles(rows: Cells) -> Cells:
    """Return rows with degrees, minutes and seconds of columns of their own in one."""
    # Headings of a quadrant bearing in columns of its own.
    quadrant_parts = re.compile(r"ns d(?:eg\w*)? m(?:in\w*)? (?:s(?:ec\w*)? )?(?:ew|we)\b")
    for k, row in enumerate(rows[:TITLES]):
        names = [_bare_name(cell) for cell in row]
        for j in range(len(row) - 2):
            if quadrant := quadrant_parts.match(" ".join(names[j : j + 5])):
                end = j + len(quadrant[0].split())
                bearings = (
                    f"{line[j]} {'-'.join(map(_whole, line[j + 1 : end - 1]))} {line[end - 1]}"
                    if len(line) >= end and any(line[j:end])
                    else ""
                    for line in rows[k + 1 :]
                )
                below = ((*ln[:j], text, *ln[end:]) for ln, text in zip(rows[k + 1 :], bearings, strict=True))
                return with_whole_angles((*rows[:k], (*row[:j], "bearing", *row[end:]), *below))
            found = [form.fullmatch(name) for form, name in zip(_PARTS, names[j : j + 3], strict=True)]
            before = {match[1] for match in found if match}
            if None in found or len(before) > 1:
                continue
            cells = [[_whole(cell) for cell in line[j : j + 3]] for line in rows[k + 1 :]]
            bare = before.pop()
            name = next(row[j][:k].strip() for k in range(len(row[j]) + 1) if _bare_name(row[j][:k]) == bare)
            if not name and len(names[j]) == 1 and names[j].isalpha() and not all(map(_is_sexagesimal, cells)):
                continue
            if not name:
                header = (*row[:j], "angle", *row[j + 3 :])
                name = "angle" if columns_of("angle", named_columns(header)) else "direction"
            parts = ("-".join(cell or "0" for cell in three) if any(three) else "" for three in cells)
            joined = (
                (*line[:j], angle, *line[j + 3 :]) if len(line) > j + 2 else line
                for line, angle in zip(rows[k + 1 :], parts, strict=True)
            )
            return with_whole_angles((*rows[:k], (*row[:j], name, *row[j + 3 :]), *joined))
    return rows


def without_packed_angles(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows with d-m-s for angles in degrees, minutes and seconds behind one point, as 12.3456; and a note on them.

    Of other angles one in three has minutes and seconds below 60 in this sense.
    """
    header, body, notes = tuple(cell.strip() for cell in rows[0]) if rows else (), rows[1:], list[str]()
    places = {
        cell for columns in kinds_of(named_columns(header)).values() for name, cell in columns.items() if name in ANGLES
    }
    for k in (k for k, cell in enumerate(header) if cell in places):
        if any(_DOTTED.fullmatch(cell_at(row, k)) for row in body):
            rows = _replaced(rows, k, header[k], [_DOTTED.sub(r"\1-\2-\3", cell_at(row, k)) for row in body])
            body = rows[1:]
        cells = [_PACKED.fullmatch(cell_at(row, k).replace(",", ".")) for row in body]
        digits = [(match["rest"] or "").ljust(4, "0") for match in cells if match]
        long = {text for text in digits if len(text.rstrip("0")) > 2}
        numbers = [cell_at(row, k) for row in body if NUMBER.fullmatch(cell_at(row, k))]
        # Twelve different angles tell d.mmss: in others all minutes and seconds are below 60 once in 200 000 tables.
        if len(long) < 12 or len(digits) < len(numbers) or any(max(t[:1], t[2:3]) > "5" for t in digits):
            continue
        texts = []
        for row, match in zip(body, cells, strict=True):
            rest = (match["rest"] or "").ljust(4, "0") if match else ""
            seconds = f"{rest[2:4]}.{rest[4:]}".rstrip(".")
            texts.append(f"{match['whole']}-{rest[:2]}-{seconds}" if match else cell_at(row, k))
        rows = _replaced(rows, k, header[k], texts)
        body = rows[1:]
        notes.append(f"column {header[k]!r}: degrees, minutes and seconds as d.mmss")
    return rows, tuple(notes)


def _is_sexagesimal(cells: Sequence[str]) -> bool:
    """Return whether three cells are degrees, minutes and seconds, or empty."""
    if not any(cells):
        return True
    if not all(map(NUMBER.fullmatch, cells)):
        return False
    minutes, seconds = (float(cell.replace(",", ".")) for cell in cells[1:])
    return minutes.is_integer() and 0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0


def without_switched_off(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows without those that a column of yes and no leaves out, and a note on them."""
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    kinds = kinds_of(named_columns([cell.strip() for cell in header]))
    switched_off = re.compile(
        r"(?:is)?(?:ignored?|reject(?:ed)?|excluded?|disabled?|omit(?:ted)?|skip(?:ped)?|outlier|unused|sluk)"
    )
    switched_on = re.compile(r"(?:is)?(?:used?|active|enabled?|included?|aktiv)")
    for k, name in enumerate(map(normalised, header)):
        cells = [normalised(cell_at(row, k)) or cell_at(row, k) for row in body]
        if not kinds or any(kind.startswith("points") for kind in kinds) or not set(cells) <= _YES | _NO:
            continue
        if switched_off.fullmatch(name) or switched_on.fullmatch(name):
            unwanted = _YES if switched_off.fullmatch(name) else _NO
            kept = tuple(row for row, cell in zip(body, cells, strict=True) if cell not in unwanted)
            words = f"rows that the column {header[k].strip()} leaves out: {counted(len(body) - len(kept), 'row')}"
            return ((header, *kept), (words,)) if 0 < len(kept) < len(body) else (rows, ())
    return rows, ()


def without_empty_readings(rows: Cells) -> Cells:
    """Rows without names of columns of readings that are empty in each row: of forms that have one for each kind."""
    while len(rows) > 1:
        header = [cell.strip() for cell in rows[0]]
        places = {
            header.index(cell)
            for kind, columns in kinds_of(named_columns(header)).items()
            if not kind.startswith(("points", "images", "stations", "levelling"))
            for name, cell in columns.items()
            if (name in KINDS[kind][0] and name not in (*PLACES, "image")) or name.startswith("sigma")
        }
        listed = kinds_of(named_columns(header)).get("points", {})
        plan = {header.index(listed[axis]) for axis in "xy" if axis in listed}
        empty = {k for k in places | plan if not any(cell_at(row, k) for row in rows[1:])}
        empty -= plan if not plan <= empty or "z" not in listed else set()
        if not empty:
            break
        rows = (tuple(f"column{k + 1}" if k in empty else cell for k, cell in enumerate(rows[0])), *rows[1:])
    return rows


def with_sigmas(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows with standard deviations for variances, and with 0 for those that a column of yes and no holds fixed.

    Where it does, standard deviations of the other points are of former results, and a note says that they are not
    used.
    """
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    names = [normalised(cell) for cell in header]
    # Headings of variances, perhaps of a coordinate or reading.
    variances = re.compile(
        r"(?:var(?:iance)?(?P<of>[a-z]?)|sigma(?P<behind>[xyz]?)(?:2|²|squared)"
        r"|(?P<before>dist|distance|dir|direction|hz|angle|dh|dz)var(?:iance)?)"
    )
    for k, name in enumerate(names):
        match = variances.fullmatch(name)
        cells = [cell_at(row, k).replace(",", ".") for row in body]
        others = {"sigma", "sigma1"}.intersection(names)
        if match and not others and all(NUMBER.fullmatch(cell) and cell[0] != "-" for cell in cells if cell):
            roots = [f"{math.sqrt(float(cell)):.9g}" if cell else "" for cell in cells]
            of = match["of"] or match["behind"] or match["before"] or ""
            rows = _replaced(rows, k, f"sigma_{of}" if of else "sigma", roots)
    kinds = kinds_of(named_columns([cell.strip() for cell in header]))
    points = next((columns for kind, columns in kinds.items() if kind.startswith("points")), {})
    former = [[cell.strip() for cell in header].index(points[name]) for name in points if name.startswith("sigma")]
    notes: tuple[str, ...] = ()
    # Headings of columns that say whether a point, or a coordinate of it, is fixed.
    held = re.compile(
        r"(?:is)?(?:fix|fixed|held|known|control|constrained|fasthold|fest|fijo|fixe)(?:1(?:free)?0)?(?P<axis>[xyzenhu]?)"
    )
    role = re.compile("(?:point)?(?:type|status|role|class)")
    # What signs in a column mean, as its heading says: Known[n]/Unknown[u].
    legend_entry = re.compile(r"([^\W_]+)\s*[\[(=:]\s*([^\W_]+)")
    for k, name in enumerate(names if points else ()):
        match, signs = held.fullmatch(name), dict[str, str]()
        if len(legend := legend_entry.findall(header[k])) > 1:
            signs = {normalised(sign): normalised(word) for word, sign in legend}
        elif role.fullmatch(name):
            # Letters of known and new points; the heading says no more.
            signs = {"c": "control", "k": "known", "f": "fixed", "u": "unknown", "n": "new", "p": "free"}
        cells = [normalised(cell_at(row, k)) or cell_at(row, k) for row in body]
        cells = [signs.get(cell, cell) for cell in cells]
        axis_named = match["axis"] if match else ""
        axes = [axis for axis in "xyz" if axis in points and (axis_named or axis) in AXES[axis]]
        is_told = match or (signs and any(cell.isalpha() and cell in _NO for cell in cells))
        if is_told and axes and _YES & set(cells) and set(cells) <= _YES | _NO:
            for place in former:
                notes = ("standard deviations beside a column that says what is fixed are not used",)
                rows = _replaced(rows, place, f"column{place + 1}", [cell_at(row, place) for row in rows[1:]])
            zeros = ["0" if cell in _YES else "" for cell in cells]
            rows = _replaced(rows, k, f"sigma_{axes[0]}", zeros)
            for axis in axes[1:]:
                rows = tuple((*row, cell) for row, cell in zip(rows, (f"sigma_{axis}", *zeros), strict=True))
    return rows, notes


def with_faces(rows: Cells) -> Cells:
    """Rows with 1 and 2 for faces that are letters or words."""
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    for k, name in enumerate(map(normalised, header)):
        cells = [normalised(cell_at(row, k)) for row in body]
        if name in SIGHT["face"].split("|") and any(cells) and set(cells) <= _FACES.keys():
            faces = [_FACES[cell] for cell in cells]
            for below in range(1, len(faces) if faces[0] else 0):
                faces[below] = faces[below] or faces[below - 1]
            rows = _replaced(rows, k, header[k], faces)
    return rows


def with_targets(rows: Cells) -> Cells:
    """Rows in face 2 with the target of the row above in face 1, if they have none of their own."""
    header, body = ([cell.strip() for cell in rows[0]], rows[1:]) if rows else ([], ())
    columns = next(
        (columns for columns in kinds_of(named_columns(header)).values() if "face" in columns and "to" in columns), {}
    )
    if not columns:
        return rows
    face, to = header.index(columns["face"]), header.index(columns["to"])
    cells = [cell_at(row, to) for row in body]
    for k, (above, row) in enumerate(pairwise(body), start=1):
        if not cells[k] and (cell_at(above, face), cell_at(row, face)) == ("1", "2"):
            cells[k] = cells[k - 1]
    return rows if cells == [cell_at(row, to) for row in body] else _replaced(rows, to, rows[0][to], cells)


def with_station(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows of directions with a column for their station if there is none, as for one set-up; and a note on it."""
    named = named_columns([cell.strip() for cell in rows[0]]) if rows else []
    kinds, with_one = kinds_of(named), [("station", "station", ""), *named]
    is_listed = all(kind.startswith("points") for kind in kinds)  # coordinates that were computed from the sights
    if not named or not is_listed or columns_of("zenith_directions" if kinds else "directions", with_one) is None:
        return rows, ()
    below = (("station", *row) for row in rows[1:])
    return (("station", *rows[0]), *below), ("no column names the station of the readings: it is called 'station'",)


def with_image(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows of x, y beside X, Y, Z with columns for their image and their points, as for one image; and a note on it."""
    header = [cell.strip() for cell in rows[0]] if rows else []
    bare = {re.split(r"[\s(\[_]", cell, maxsplit=1)[0] for cell in header}  # without units
    if not {"x", "y", "X", "Y", "Z"} <= bare or "image" in kinds_of(named_columns(header)):
        return rows, ()
    own = (columns_of("image", named_columns(["image", *header])) or {}).get("point", "")
    names = [cell_at(row, header.index(own)) for row in rows[1:]] if own else []
    added = ("image",) if own else ("image", "point")
    if len(set(names)) < len(names) or "image" not in kinds_of(named_columns([*added, *header])):
        return rows, ()
    below = (("image", *(() if own else (str(k),)), *row) for k, row in enumerate(rows[1:], start=1))
    words = "no column names the image of the points: it is called 'image'"
    return ((*added, *rows[0]), *below), (words,) if own else (words, "points without names are numbered")


def image_points_of_matrix(rows: Cells) -> Cells:
    """Rows image, point, x, y of a matrix with a row for each point and a column for each image; empty for others."""
    if len(rows) < 2 or len(rows[0]) < 3 or any(map(fits_a_table, rows[:TITLES])):
        return ()
    header, body = rows[0], rows[1:]
    filled = [(k, row[0], row[k].strip()) for row in body for k in range(1, len(row)) if row[k].strip()]
    cells = [(k, point, _PLACE.fullmatch(cell)) for k, point, cell in filled]
    if not cells or not all(match for *_, match in cells) or len(set(header)) < len(header):
        return ()
    found = ((header[k].strip(), point.strip(), match[1], match[2]) for k, point, match in cells if match)
    return (("image", "point", "x", "y"), *found)


def without_zeros(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows without coordinates that are all 0 if several points have such: they are none. And a note on it."""
    header = [cell.strip() for cell in rows[0]] if rows else []
    kinds = kinds_of(named_columns(header))
    columns = next((columns for kind, columns in kinds.items() if kind.startswith("points")), {})
    places = [header.index(columns[axis]) for axis in "xyz" if axis in columns]
    if len(places) < 2:
        return rows, ()
    bare = [
        row
        for row in rows[1:]
        if all(ZERO.fullmatch(cell_at(row, k)) for k in places) and any(cell_at(row, k) for k in places)
    ]
    if len(bare) < 2:
        return rows, ()
    kept = tuple(
        tuple("" if k in places else cell for k, cell in enumerate(row)) if row in bare else row for row in rows[1:]
    )
    return (rows[0], *kept), (f"coordinates that are all 0 are none: {counted(len(bare), 'point')}",)


def without_zero_readings(rows: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Rows without the 0 of a direction or a distance if each row has one of them: it was not measured."""
    header = [cell.strip() for cell in rows[0]] if rows else []
    kinds = kinds_of(named_columns(header))
    pairs = []
    for name in ("horizontal", "distance"):
        columns = next((columns for columns in kinds.values() if name in columns), {})
        pairs.append([header.index(columns[part]) for part in (name, "sigma") if part in columns])
    if not all(pairs):
        return rows, ()
    body, zeros = list(rows[1:]), [[bool(ZERO.fullmatch(cell_at(row, pair[0]))) for pair in pairs] for row in rows[1:]]
    counts = [sum(column) for column in zip(*zeros, strict=True)]
    if min(counts, default=0) < 1 or sum(counts) < 3 or not all(one != other for one, other in zeros):
        return rows, ()
    for number, (row, zero) in enumerate(zip(rows[1:], zeros, strict=True)):
        gone = {place for pair, none in zip(pairs, zero, strict=True) if none for place in pair}
        body[number] = tuple("" if k in gone else cell for k, cell in enumerate(row))
    return (rows[0], *body), (f"readings of 0 beside another reading are none: {counted(sum(counts), 'row')}",)


def _replaced(rows: Cells, place: int, name: str, cells: Sequence[str]) -> Cells:
    """Rows with another name and other cells in one column; rows that are too short are filled up."""
    width = len(rows[0])
    full = ((*row, *[""] * (width - len(row))) for row in rows)
    return tuple((*row[:place], cell, *row[place + 1 :]) for row, cell in zip(full, (name, *cells), strict=True))


def _bare_name(cell: str) -> str:
    signs = {"°": "deg", "º": "deg", "''": "sec", '"': "sec", "″": "sec", "'": "min", "′": "min"}
    text = cell.strip().lower()
    for sign, word in signs.items():
        text = text.replace(sign, word)
    return normalised(text)


def _whole(cell: str) -> str:
    """Part of an angle without the ``.0`` of spreadsheets."""
    return re.sub(r"[.,]0+$", "", cell.strip())


def _with_stations(header: tuple[str, ...], rows: Cells) -> Cells:
    """Rows of sights with the stations, which stand in rows of their own without readings; empty if none does."""
    kind, columns = next(iter(kinds_of([*named_columns(header), ("", "station", "")]).items()))
    places = {name: header.index(cell) for name, cell in columns.items() if cell}
    readings = [places[name] for name in KINDS[kind][0] if name in places and name != "to"]
    height = places.get("station_height", places.get("from_height"))
    station, found = ("", ""), list[tuple[str, ...]]()
    for cells in rows:
        row = (*cells, *[""] * (len(header) - len(cells)))
        if "to" in places and not any(row[place].strip() for place in readings):
            station = row[places["to"]], "" if height is None else row[height]
        elif not station[0]:
            return ()
        else:
            found.append((station[0], *(cell or station[1] if k == height else cell for k, cell in enumerate(row))))
    return (("station", *header), *found) if found else ()


def tell_elevations(kinds: dict[str, dict[str, str]], header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Change kinds of zenith angles, in place, to those of elevations where the readings are such."""
    # Kind and column of vertical circles that read elevations, whose columns have the same names.
    elevations = {"zenith_directions": ("directions", "vertical"), "zenith_angle": ("vertical_direction",) * 2}
    for kind, (other, column) in elevations.items():
        old = "zenith" if kind == "zenith_directions" else kind
        if kind not in kinds:
            continue
        place = header.index(kinds[kind][old])
        cells = (row[place].strip().replace(",", ".") for row in rows if len(row) > place)
        values = [abs(float(match[0])) for match in map(_LEADING.match, cells) if match]
        # The median of zenith angles is larger than 45 degrees or gon, that of elevations is smaller.
        if values and median(values) < 45.0:
            columns = kinds.pop(kind)
            kinds[other] = {column if name == old else name: cell for name, cell in columns.items()}
