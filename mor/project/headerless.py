"""Tables without a header: what their columns may be, by their form and by coordinates of the points they name."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from statistics import median, pstdev

from mor.errors import InputError, Message
from mor.project.column_names import NUMBER, Cells, cell_at, fits_a_table, kinds_of, named_columns, number_in

_CLOSE = 1e-3
"""Part of a length by which what is equal may differ."""
_NAMES_OF_FILES = [
    (meant, re.compile(words))
    for meant, words in (
        ("horizontal", "dir|richt|hz|方向"),
        ("bearing", "azi|bearing|rumbo|方位"),
        ("dz", "dh|dz|level|niv|hoeh|height|高差|水准"),
    )
]
"""What the values of files with such names are."""
Places = Mapping[str, Sequence[float]]


class HeaderlessError(InputError):
    """A table whose columns have no names; ``rows`` are all of it."""

    rows: Cells = ()


def headerless(path: Path, rows: Cells, line: int) -> HeaderlessError:
    """Return the mistake with values of each column, and a command with names that the columns may have."""
    blocks = [tuple(block) for _, block in groupby(rows, key=len)]
    columns, proposed = list[str](), list[list[str]]()
    widths = Counter(map(len, rows))
    kept = without_counts(rows)
    listed = {row[0]: len(row) for row in rows if len(row) == min(widths)} if len(widths) > 1 else {}
    told = _names_below_others(blocks)
    for width in sorted(sorted(widths, key=lambda own: -widths[own])[:3]):
        some = [row for row in kept if len(row) == width] or [row for row in rows if len(row) == width]
        for k in range(width):
            values = ", ".join(dict.fromkeys(cell_at(row, k) for row in some[:3]))
            columns.append(f"{k + 1}/{width}: {values}" if len(widths) > 1 else f"{k + 1}: {values}")
        if some[0] not in kept:
            continue
        likely = told.get(width) or _likely_names(path, tuple(some), listed)
        if len(widths) > 1 and width not in told and (told or not kinds_of(named_columns(likely))):
            likely = ["-"] * width
        proposed.append(likely)
    words = "this text has no rows: all lines are empty, or begin with # or %"
    if columns:
        words = f"expected a header with the names of the columns, which are {'; '.join(columns)}"
    titles = titles_of_sections(rows)
    if not told and (len(titles) > 1 or any(title[0] == "[" for title in titles)):
        words = f"this text has sections whose columns have no names ({', '.join(titles)}); {_APART}"
    elif mixed := _mixed(kept):
        words = f"this text has no header, and rows of {mixed} cells hold different things; {_APART}"
    elif len(set(map(len, kept))) > 3:
        words = f"this text has no header, and rows of more than three lengths; {_APART}"
    elif _is_image_pair(kept):
        words = f"{words}; image coordinates of two images go to mor orient relative (columns point, x1, y1, x2, y2)"
    elif any({*names} - {"-"} for names in proposed):
        options = " ".join(f"--columns {path.name} {','.join(names)}" for names in proposed)
        command = f"mor new PROJECT {path.name} {options}"
        words = f"{words}; or give their names, as in {command}"
    elif columns:
        words = f"{words}; none of them names points"
    mistake = HeaderlessError([Message(words, str(path), line)])
    mistake.rows = rows
    return mistake


_APART = "write each table to a file of its own, with the names of its columns in the first line"


def without_counts(rows: Cells) -> Cells:
    """Rows without a first one of numbers, among them the count of each of several tables below it."""
    numbers = rows[0] if rows and all(NUMBER.fullmatch(cell.strip()) for cell in rows[0]) else ()
    counts = {len(tuple(block)) for _, block in groupby(rows[1:], key=len)}
    is_count = len(counts) > 1 and counts <= {int(cell) for cell in map(str.strip, numbers) if cell.isdecimal()}
    return rows[1:] if is_count else rows


def titles_of_sections(rows: Cells) -> list[str]:
    """Titles of sections without headers: words in brackets, or else one to three words in a row above numbers."""
    lines = [" ".join(row).strip() for row in rows]
    return [line for line in lines if re.fullmatch(r"\[\w+\]", line)] or [
        line
        for line, row, below in zip(lines, rows, rows[1:], strict=False)
        if 0 < len(line.split()) < 4 and len(row) < 4 and not re.search(r"\d", line)
        if any(map(NUMBER.fullmatch, below)) and not fits_a_table(row)
    ]


def _mixed(rows: Cells) -> int:
    """Return the length of rows that have names and decimals in one column; 0 if there are none."""
    for width in sorted(set(map(len, rows))):
        for k in range(width):
            cells = [row[k].strip() for row in rows if len(row) == width]
            if any(cell[:1].isalpha() for cell in cells) and any(
                "." in cell and NUMBER.fullmatch(cell) for cell in cells
            ):
                return width
    return 0


def _is_image_pair(rows: Cells) -> bool:
    """Return whether rows are points with their coordinates in two images, which differ by nearly the same parallax."""
    if len(rows) < 5 or {len(row) for row in rows} != {5}:
        return False
    if not all(NUMBER.fullmatch(cell.strip()) for row in rows for cell in row[1:]):
        return False
    x1, y1, x2, y2 = ([number_in(row[k].strip()) or 0.0 for row in rows] for k in range(1, 5))
    return all(
        pstdev([b - a for a, b in zip(one, other, strict=True)]) < 0.5 * pstdev(one)
        for one, other in ((x1, x2), (y1, y2))
    )


def _names_below_others(blocks: Sequence[Cells]) -> dict[int, list[str]]:
    """Return names by width where single short rows, of stations or images, stand above longer ones; else nothing."""
    longest = max(blocks, key=len, default=())
    width = len(longest[0]) if longest else 0
    short = [len(block[0]) for block, below in pairwise(blocks) if len(below[0]) == width and len(block) < 3]
    above = max(set(short), key=short.count, default=0)
    if width not in (3, 4, 5) or above not in (1, 2) or short.count(above) < 2:
        return {}
    cells = [cell for block in blocks if len(block[0]) == width for row in block for cell in row[1:]]
    is_image = width == 3 and any(cell.startswith("-") for cell in cells)
    if is_image:
        return {above: ["image", "-"][:above], width: ["point", "x", "y"]}
    sight = ["to", *["to_height"][: width - 4], "horizontal", *["zenith"][: width - 3], "distance"]
    return {above: ["station", "from_height"][:above], width: sight}


def with_names_apart(rows: Cells) -> Cells:
    """Rows of a number behind two or three names that one cell joins, as T7-T5-T6, with a cell for each name."""
    for sign in "-_/":
        names = [row[0].split(sign) for row in rows]
        is_network = not {one[0] for one in names}.isdisjoint(one[-1] for one in names)
        if is_network and all(len(one) in (2, 3) and len(row) == 2 for one, row in zip(names, rows, strict=True)):
            return tuple((*one, *row[1:]) for one, row in zip(names, rows, strict=True))
    return rows


def _likely_names(path: Path, rows: Cells, listed: Mapping[str, int]) -> list[str]:
    """Names that the columns of rows of one length may have; ``listed``: points, and cells in their rows."""
    columns = [[cell_at(row, k).replace(",", ".") for row in rows] for k in range(len(rows[0]))]
    is_counted = columns[0] == [str(k) for k in range(1, len(rows) + 1)]
    is_word = len(set(columns[0])) == 1 and len(columns[0][0]) > 2 and not columns[0][0].isdecimal()
    if len(columns) > 3 and len(rows) > 1 and (is_counted or is_word):
        return ["-", *_likely_names(path, tuple(row[1:] for row in rows), listed)]
    sexagesimal = next((k for k in range(1, len(columns) - 2) if _are_sexagesimal(columns[k : k + 3])), 0)
    is_name = [not all(map(NUMBER.fullmatch, cells)) or all(map(str.isdecimal, cells)) for cells in columns]
    is_name[0] |= len(set(columns[0])) == len(rows) and all(cell.lstrip("-").isdecimal() for cell in columns[0])
    names = next((k for k, is_one in enumerate(is_name) if not is_one), len(columns))
    names = min(names, sexagesimal or names)
    if names > 3:
        # The last three may be points; a set, a number or a code stands in front of them.
        return ["-", *_likely_names(path, tuple(row[1:] for row in rows), listed)]
    falls = [any(cell.startswith("-") for cell in cells) for cells in columns[names:]]
    is_network = names > 1 and not set(columns[0]).isdisjoint({*columns[1], *listed})
    is_short = any(0.0 < abs(number_in(cell) or 0.0) < 1.0 for cell in columns[min(names, len(columns) - 1)])
    # Pixels from a corner; σ and lengths of lines in kilometres are smaller.
    are_pixels = not any(falls) and all(median(number_in(v) or 0.0 for v in own) > 50.0 for own in columns[names:])
    told = next((meant for meant, form in _NAMES_OF_FILES if form.search(path.stem.lower())), "")
    if not names:
        return []
    if names == 3 and all(len(c) > len(a + b) and a in c and b in c for a, b, c in zip(*columns[:3], strict=True)):
        # The third one joins both ends, as a name of files.
        return ["from", "to", "-", *_likely_names(path, tuple((*row[:2], *row[3:]) for row in rows), listed)[2:]]
    if names == 3:  # the vertex is named in fewer ways than the other points, and mostly between them
        ends = ["from", "at", "to"] if len(set(columns[1])) <= len(set(columns[0])) else ["at", "from", "to"]
        found = [*ends, *(("angle_d", "angle_m", "angle_s") if sexagesimal else ("angle",))]
    elif sexagesimal:
        found = ["station", "to", "horizontal_d", "horizontal_m", "horizontal_s"]
    elif names < 2:
        found = ["id", "x", "y", "z"] if len(falls) > 1 else ["id", "z"]
    elif len(falls) == 2 and (all(falls) or are_pixels or (not is_network and len(set(columns[0])) < len(columns[0]))):
        ends = ["image", "point"] if len(set(columns[0])) <= len(set(columns[1])) else ["point", "image"]
        found = [*ends, "x", "y"]
    elif len(falls) > 2:
        found = ["from", "to", "dx", "dy", "dz"]
    elif told:
        found = ["station" if told == "horizontal" else "from", "to", told, "length" if told == "dz" else "sigma"]
    elif falls[:1] == [True] or 2 in listed.values() or is_short:
        found = ["from", "to", "dz", "length"]
    else:
        found = ["from", "to", "distance", "dz" if any(falls) else "sigma"]
    return [*found[: len(columns)], *["-"] * (len(columns) - len(found))]


def _are_sexagesimal(columns: Sequence[Sequence[str]]) -> bool:
    whole = all(cell.isdecimal() for cells in columns[:2] for cell in cells)
    return whole and all(
        int(d) < 400 and int(m) < 60 and NUMBER.fullmatch(s) is not None and 0.0 <= float(s) < 60.0
        for d, m, s in zip(*columns, strict=True)
    )


def listed_places(rows: Cells) -> dict[str, tuple[float, ...]]:
    """Return coordinates by point if each row is a name and two or three of them; nothing for other tables.

    A number alone above them, as their count, is passed by.
    """
    rows = rows[1:] if rows and len(rows[0]) == 1 else rows
    places = {
        row[0].strip(): tuple(float(cell.replace(",", ".")) for cell in row[1:])
        for row in rows
        if len(row) in (3, 4) and all(NUMBER.fullmatch(cell.strip()) for cell in row[1:])
    }
    return places if len(places) == len(rows) else {}


def names_of_lists(listed: Mapping[Path, Places], read: Sequence[Places]) -> dict[Path, list[str]]:
    """Return names of the columns of a list with two numbers to a point, and of one with three numbers to most of them.

    ``read``: lists with a header.
    """
    found = dict[Path, list[str]]()
    for path, own in listed.items():
        for other, places in (*listed.items(), *((None, one) for one in read)):
            shared = [name for name in own if name in places]
            widths = {len(own[name]) for name in shared}, {len(places[name]) for name in shared}
            if widths == ({2}, {3}) and len(shared) > max(2, len(own) // 2):
                found[path] = ["id", "x", "y"]
                found |= {other: ["id", "x", "y", "z"]} if other else {}
    return found


def names_by_coordinates(rows: Cells, places: Places) -> list[str]:
    """Return names of the columns if the values fit the coordinates of the points in one way; nothing for others.

    Two columns name points. Three rows that agree within 0.1 % do so by chance once in 100 million tables.
    """
    width = min(map(len, rows), default=0)
    ends = [k for k in range(min(width, 3)) if all(row[k].strip() in places for row in rows)]
    if len(rows) < 3 or len(ends) != 2 or {len(row) for row in rows} != {width}:
        return []
    pairs = [tuple(places[row[k].strip()] for k in ends) for row in rows]
    in_plan = [math.dist(one[:2], other[:2]) for one, other in pairs]
    expected = {"distance": in_plan}
    if all(len(place) > 2 for pair in pairs for place in pair):
        rises = [other[2] - one[2] for one, other in pairs]
        expected = {"horizontal distance": in_plan, "distance": list(map(math.hypot, in_plan, rises)), "dz": rises}
    names = ["-"] * width
    for k in range(ends[-1] + 1, width):
        texts = [row[k].strip().replace(",", ".") for row in rows]
        values = list(map(float, texts)) if all(map(NUMBER.fullmatch, texts)) else []
        for name, sizes in expected.items():
            off = [abs(value - size) - _CLOSE * far for value, size, far in zip(values, sizes, in_plan, strict=False)]
            if name not in names and names[k] == "-" and off and max(off) < 0.0:
                names[k] = name
    if set(names) == {"-"}:
        return []
    names[ends[0]], names[ends[1]] = "from", "to"
    return names
