"""``python -m tests.scenarios.tables --count 100 --seed 1``: tables as people write them, for ``mor new``.

Each is a survey with known coordinates: levelling, sights of total stations, plane networks, GNSS vectors. Names of
columns are drawn from the known ones of all languages, and so are order, separators, decimal signs, units, rows of
units, titles, empty rows, stations in the first row of a set-up only, remarks, and the kind of file. Both tables may
stand below each other in one file, with parameters above them and derived values below. Readings in both faces may
stand beside each other, levelling forms have several rows for each set-up, and some tables have no header at all. What
counts is whether ``mor new`` and ``mor adjust`` end at the known coordinates.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.project.column_names import KINDS, NAMES
from tests.scenarios.small_projects import mor

CIRCLES = {"deg": 360.0, "gon": 400.0}
SEPARATORS = (",", ";", "\t", " ")
_LISTS = vars(NAMES)


class Column(NamedTuple):
    """A column: what it means, its values, and the unit that may stand in its heading."""

    meaning: str
    names: str
    values: list[str]
    unit: str = ""


class World(NamedTuple):
    """Points, and a way to draw."""

    random: np.random.Generator
    ids: list[str]
    places: np.ndarray

    def pairs(self, count: int) -> Iterator[tuple[int, int]]:
        """Lines that tie each point to one before it, and further ones."""
        for k in range(1, len(self.ids)):
            yield int(self.random.integers(k)), k
        for _ in range(count):
            one, other = self.random.choice(len(self.ids), 2, replace=False)
            yield int(one), int(other)

    def control(self, axes: str, count: int) -> list[Column]:
        """The list of the first points, known along ``axes``."""
        found = [Column("id", _LISTS["point"], self.ids[:count])]
        for axis in axes:
            k = "xyz".index(axis)
            names = (
                _LISTS["z"] if axis == "z" else {"x": "x|e|east|easting|rechtswert", "y": "y|n|north|northing"}[axis]
            )
            found.append(Column(axis, names, [f"{value:.4f}" for value in self.places[:count, k]]))
        return found


def world(seed: int) -> World:
    """Points within 300 m by 200 m by 20 m with names of one kind."""
    random = np.random.default_rng(seed)
    count = int(random.integers(5, 9))
    form = random.choice(["P{}", "{}", "PT-{}", "B{:03d}", "{}A"])
    ids = [str(form).format(k) for k in random.choice(np.arange(1, 200), count, replace=False)]
    return World(random, ids, np.round(random.uniform([100, 500, 50], [400, 700, 70], (count, 3)), 4))


Tables = dict[str, list[Column]]


def levelling(world: World) -> Tables:
    """Height differences, and a list of known heights."""
    lines = list(world.pairs(4))
    rises = [world.places[b, 2] - world.places[a, 2] for a, b in lines]
    kind = KINDS["height_difference"][0]
    return {
        "observed": [
            Column("from", kind["from"], [world.ids[a] for a, _ in lines]),
            Column("to", kind["to"], [world.ids[b] for _, b in lines]),
            Column("dz", kind["dz"], [f"{value:.4f}" for value in rises]),
        ],
        "control": world.control("z", 2),
    }


def sights(world: World) -> Tables:
    """Directions, zenith angles and slope distances of three set-ups, and a list of control points."""
    unit = str(world.random.choice(list(CIRCLES)))
    full, rows = CIRCLES[unit], []
    for station in range(3):
        turn = world.random.uniform(0.0, full)
        height = round(world.random.uniform(1.4, 1.8), 3)
        for target in world.random.permutation(len(world.ids)):
            if target == station:
                continue
            target_height = round(world.random.uniform(1.2, 2.0), 3)
            d = world.places[target] - world.places[station] + [0.0, 0.0, target_height - height]
            azimuth = math.atan2(d[0], d[1]) / math.tau * full
            zenith = math.atan2(math.hypot(d[0], d[1]), d[2]) / math.tau * full
            rows.append(
                (
                    world.ids[station],
                    world.ids[target],
                    f"{(azimuth - turn) % full:.5f}",
                    f"{zenith:.5f}",
                    f"{np.linalg.norm(d):.4f}",
                    f"{height:.3f}",
                    f"{target_height:.3f}",
                )
            )
    columns = list(map(list, zip(*rows, strict=True)))
    return {
        "observed": [
            Column("station", _LISTS["from_"], columns[0]),
            Column("to", _LISTS["to"], columns[1]),
            Column("horizontal", _LISTS["horizontal"], columns[2], unit),
            Column("zenith", _LISTS["zenith"], columns[3], unit),
            Column("distance", "sd|slopedistance|slopedist|schraegstrecke|distanciainclinada|斜距", columns[4], "m"),
            Column("from_height", _LISTS["from_height"], columns[5], "m"),
            Column("to_height", _LISTS["to_height"], columns[6], "m"),
        ],
        "control": world.control("xyz", 3),
    }


def faces(world: World) -> Tables:
    """Sights in both faces, with the face in a column."""
    tables = sights(world)
    signs = [("1", "2"), ("I", "II"), ("L", "R"), ("CL", "CR"), ("left", "right")][int(world.random.integers(5))]
    full, found = CIRCLES[next(column.unit for column in tables["observed"] if column.meaning == "zenith")], []
    for column in tables["observed"]:
        second = list(column.values)
        if column.meaning == "horizontal":
            second = [f"{(float(value) + full / 2) % full:.5f}" for value in column.values]
        elif column.meaning == "zenith":
            second = [f"{full - float(value):.5f}" for value in column.values]
        both = [value for pair in zip(column.values, second, strict=True) for value in pair]
        found.append(column._replace(values=both))
    found.append(Column("face", "face|lage|kreislage", list(signs) * len(tables["observed"][0].values)))
    return {**tables, "observed": found}


def book(world: World) -> Tables:
    """A book of levelling, set-up by set-up: staff readings back, forward and between."""
    count = len(world.ids)
    rows = []
    line = [0, *range(2, count), 1]
    horizon = 0.0
    for number, point in enumerate(line):
        z = world.places[point, 2]
        fore = f"{horizon - z:.4f}" if number else ""
        back = ""
        if number + 1 < len(line):
            horizon = max(z, world.places[line[number + 1], 2]) + round(world.random.uniform(0.5, 2.5), 4)
            back = f"{horizon - z:.4f}"
        rows.append((world.ids[point], back, "", fore))
    columns = list(map(list, zip(*rows, strict=True)))
    return {
        "observed": [
            Column("point", _LISTS["point"], columns[0]),
            Column("back", _LISTS["back"], columns[1]),
            Column("between", _LISTS["between"], columns[2]),
            Column("fore", _LISTS["fore"], columns[3]),
        ],
        "control": world.control("z", 2),
    }


def plane(world: World) -> Tables:
    """Directions and horizontal distances in the plane of all points, and a list of control points."""
    unit = str(world.random.choice(list(CIRCLES)))
    full, rows = CIRCLES[unit], []
    for station in range(3):
        turn = world.random.uniform(0.0, full)
        for target in range(len(world.ids)):
            if target != station:
                d = world.places[target] - world.places[station]
                circle = (math.atan2(d[0], d[1]) / math.tau * full - turn) % full
                rows.append((world.ids[station], world.ids[target], f"{circle:.5f}", f"{math.hypot(d[0], d[1]):.4f}"))
    columns = list(map(list, zip(*rows, strict=True)))
    return {
        "observed": [
            Column("station", _LISTS["from_"], columns[0]),
            Column("to", _LISTS["to"], columns[1]),
            Column("horizontal", _LISTS["horizontal"], columns[2], unit),
            Column("distance", _LISTS["plan_distance"], columns[3], "m"),
        ],
        "control": world.control("xy", 3),
    }


def vectors(world: World) -> Tables:
    """Vectors with their standard deviations, and one known point."""
    lines = list(world.pairs(4))
    d = [world.places[b] - world.places[a] for a, b in lines]
    return {
        "observed": [
            Column("from", _LISTS["from_"], [world.ids[a] for a, _ in lines]),
            Column("to", _LISTS["to"], [world.ids[b] for _, b in lines]),
            *(Column(f"d{a}", f"d{a}|delta{a}", [f"{one[k]:.4f}" for one in d], "m") for k, a in enumerate("xyz")),
            *(Column(f"s{a}", f"s{a}|std{a}|sigma{a}", ["0.003"] * len(d), "m") for a in "xyz"),
        ],
        "control": world.control("xyz", 1),
    }


FACES = (("盘左", "盘右"), ("Lage I", "Lage II"), ("FL", "FR"), ("PD", "PI"), ("Face 1", "Face 2"), ("left", "right"))
"""Headings of readings in the first and second face."""


def faces_beside(world: World) -> Tables:
    """Sights with the readings in both faces in columns beside each other, and means behind them."""
    found, words = list[Column](), FACES[int(world.random.integers(len(FACES)))]
    for column in sights(world)["observed"]:
        if column.meaning not in ("horizontal", "zenith"):
            found.append(column)
            continue
        full = CIRCLES[column.unit]
        first = [float(value) for value in column.values]
        turned = [(v + full / 2) % full if column.meaning == "horizontal" else full - v for v in first]
        name = str(world.random.choice(_alone(column.names)))
        second = [f"{value:.5f}" for value in turned]
        found.append(Column(column.meaning, f"{name} {words[0]}", column.values, column.unit))
        found.append(Column("second", f"{name} {words[1]}", second, column.unit))
        found.append(Column("mean", f"mean {name}", column.values, column.unit))
    return {"observed": found, "control": world.control("xyz", 3)}


def set_ups(world: World) -> Tables:
    """Height differences that a staff of 3 m reaches."""
    world.places[:, 2] = np.round(50 + 0.05 * (world.places[:, 2] - 50), 4)
    return levelling(world)


def bare(world: World) -> Tables:
    """Distances and coordinates of all points without a header."""
    lines = list(combinations(range(len(world.ids)), 2))
    ends = [[world.ids[pair[k]] for pair in lines] for k in (0, 1)]
    sizes = [math.dist(world.places[a, :2], world.places[b, :2]) for a, b in lines]
    return {
        "observed": [
            Column("from", "", ends[0]),
            Column("to", "", ends[1]),
            Column("distance", "", [f"{value:.4f}" for value in sizes]),
        ],
        "control": [
            Column("id", "", world.ids),
            *(Column(axis, "", [f"{value:.4f}" for value in world.places[:, k]]) for k, axis in enumerate("xy")),
        ],
    }


SURVEYS: dict[str, tuple[Callable[[World], Tables], str]] = {
    "levelling": (levelling, "z"),
    "sights": (sights, "xyz"),
    "faces": (faces, "xyz"),
    "book": (book, "z"),
    "plane": (plane, "xy"),
    "vectors": (vectors, "xyz"),
    "faces beside each other": (faces_beside, "xyz"),
    "form": (set_ups, "z"),
    "bare": (bare, "xy"),
}
"""Surveys, and the coordinates that they determine."""


def as_spreadsheet(path: Path, *texts: str) -> Path:
    """Sheets S, T, …: numbers as numbers, the rest as texts, in the smallest .xlsx file."""
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    relations = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    packages = "http://schemas.openxmlformats.org/package/2006"
    path = path.with_suffix(".xlsx")
    numbers = range(1, len(texts) + 1)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{packages}/content-types"><Default Extension="xml" ContentType="application/xml"/></Types>',
        )
        file.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{packages}/relationships"><Relationship Id="a" '
            f'Type="{relations}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        )
        sheets = (f'<sheet name="{"STUVW"[k - 1]}" sheetId="{k}" r:id="a{k}"/>' for k in numbers)
        file.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{relations}"><sheets>{"".join(sheets)}</sheets></workbook>',
        )
        links = (
            f'<Relationship Id="a{k}" Type="{relations}/worksheet" Target="worksheets/sheet{k}.xml"/>' for k in numbers
        )
        file.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{packages}/relationships">{"".join(links)}</Relationships>',
        )
        for k, text in zip(numbers, texts, strict=True):
            file.writestr(
                f"xl/worksheets/sheet{k}.xml",
                f'<worksheet xmlns="{main}"><sheetData>{_sheet_rows(text)}</sheetData></worksheet>',
            )
    return path


def _sheet_rows(text: str) -> str:
    rows = []
    for line in text.splitlines():
        cells = []
        for cell in line.split(";"):
            number = cell.replace(",", ".")
            is_number = number.removeprefix("-").replace(".", "").isdigit()
            cells.append(f"<c><v>{number}</v></c>" if is_number else f'<c t="inlineStr"><is><t>{cell}</t></is></c>')
        rows.append(f"<row>{''.join(cells)}</row>")
    return "".join(rows)


def _alone(names: str) -> list[str]:
    """Names that mean nothing else, unlike ``h`` for a height or a horizontal circle."""
    elsewhere = Counter(name for words in _LISTS.values() for name in words.split("|"))
    return [name for name in names.split("|") if elsewhere[name] <= 1 and len(name) > 1]


def _named(world: World, columns: Sequence[Column], is_chinese: bool) -> dict[str, Column]:
    """Columns by drawn names, Chinese ones where there are some if the others are."""
    found = dict[str, Column]()
    for column in columns:
        alone = _alone(column.names)
        if is_chinese:
            alone = [name for name in alone if not name.isascii() and name > "一"] or list(filter(str.isascii, alone))
        found[str(world.random.choice([name for name in alone if name not in found]))] = column
    return found


def form(world: World, columns: Sequence[Column]) -> list[list[str]]:
    """A levelling form with four rows for each set-up: upper and lower hair, both faces of both staffs."""
    names, ends = (
        ("测站", "点号", "后尺上丝", "前尺上丝", "方向及尺号", "标尺读数", "", "K+黑-红"),
        ("后视距", "前视距"),
    )
    rows = [list(names), ["", "", "后尺下丝", "前尺下丝", "", "黑面", "红面", ""], ["", "", *ends, *[""] * 4]]
    rows.append(["", "", "视距差", "累积差", *[""] * 4])
    zeros = [4687, 4787]
    for number, (one, other, rise) in enumerate(zip(*(column.values for column in columns), strict=True), start=1):
        fore = int(world.random.integers(400, 2500))
        back, half = fore + round(10_000 * float(rise)) / 10, int(world.random.integers(80, 400))
        red = [f"{value + zero:g}" for value, zero in zip((back, fore), zeros, strict=True)]
        rows += [
            [str(number), one, f"{back + half:g}", f"{fore + half:g}", "后1", f"{back:g}", red[0], "0"],
            ["", other, f"{back - half:g}", f"{fore - half:g}", "前2", f"{fore:g}", red[1], "0"],
            ["", "", f"{half / 5:g}", f"{half / 5:g}", "后-前", f"{back - fore:g}", f"{back - fore - 100:g}", ""],
            ["", "", "0", "0", "", "", "", ""],
        ]
    return rows


def _dms(degrees: float, form: str) -> str:
    tenths = round(degrees * 3600 * 10_000)
    return form.format(tenths // 36_000_000, tenths // 600_000 % 60, tenths % 600_000 / 10_000)


def written(seed: int, folder: Path) -> tuple[str, list[Path], World]:
    """The survey of a seed, its tables in a folder, and its world."""
    here = world(seed)
    random = here.random
    survey = str(random.choice(list(SURVEYS)))
    tables = SURVEYS[survey][0](here)
    is_one = survey != "bare" and random.random() < 0.3
    is_chinese = random.random() < 0.2
    separator, paths, sheet = str(random.choice(SEPARATORS[:3])), list[Path](), list[list[str]]()
    for role, columns in tables.items():
        has_gaps = is_one or survey == "form" or any("" in column.values for column in columns)
        if not is_one:
            separator = str(random.choice(SEPARATORS[:-1] if has_gaps else SEPARATORS))
        if survey == "bare":
            rows = [list(row) for row in zip(*(column.values for column in columns), strict=True)]
        elif survey == "form" and role == "observed":
            rows = form(here, columns)
        else:
            rows = _rows(here, columns, separator, is_chinese)
        if not is_one:
            paths.append(_saved(here, folder / f"{role}.csv", rows, separator, is_chinese))
        elif role == "observed":
            above = [["focal length", "152.7"], ["number of points", "12"], []] if random.random() < 0.3 else []
            sheet = [*above, ["Readings"], *rows, []]
        else:
            sheet += [["Control points"], *rows]
            if survey == "levelling" and random.random() < 0.5:
                sheet += [[], ["Adjusted height differences"], *_rows(here, tables["observed"], separator, is_chinese)]
    if is_one:
        paths.append(_saved(here, folder / "field.csv", sheet, separator, is_chinese))
    return survey, paths, here


def _rows(world: World, columns: Sequence[Column], separator: str, is_chinese: bool) -> list[list[str]]:
    """A table of columns with a header as somebody may write it."""
    random = world.random
    named = _named(world, [column for column in columns if " " not in column.names], is_chinese)
    named = {next((n for n, c in named.items() if c is column), column.names): column for column in columns}
    order = [list(named)[k] for k in random.permutation(len(named))]
    if random.random() < 0.6:
        order = list(named)
    has_comma = separator != "," and random.random() < 0.3
    style, units_below = str(random.choice(["plain", "upper", "title"])), random.random() < 0.2
    heads = [getattr(name, {"plain": "lower"}.get(style, style))() for name in order]
    has_faces = any(column.meaning == "second" for column in columns)
    if has_faces:
        heads, units_below = [name.replace(" ", "_") if separator == " " else name for name in order], False
    elif not units_below:
        forms = ["{} [{}]", "{} ({})", "{}_{}"] if separator != " " else ["{}_{}"]
        form = str(random.choice(forms))
        heads = [form.format(h, u) if (u := named[n].unit) else h for h, n in zip(heads, order, strict=True)]
    dms = str(
        random.choice(["{:d}-{:02d}-{:07.4f}", "{:d}°{:02d}'{:07.4f}\"", "{:d} {:02d} {:07.4f}", "{}", "{}", "{}"])
    )
    values = {name: named[name].values for name in order}
    for name in order:
        if named[name].unit == "deg" and dms != "{}" and separator != " ":
            values[name] = [_dms(float(value), dms) for value in values[name]]
            named[name] = named[name]._replace(unit="")
    rows = [list(row) for row in zip(*(values[name] for name in order), strict=True)]
    if has_comma:
        numbers = [
            k
            for k, name in enumerate(order)
            if any("." in value for value in values[name]) and values[name] is named[name].values
        ]
        rows = [[cell.replace(".", ",") if k in numbers else cell for k, cell in enumerate(row)] for row in rows]
    place = next((k for k, name in enumerate(order) if named[name].meaning == "station"), None)
    if place is not None and separator != " " and random.random() < 0.3:
        rows = [
            ["" if k == place and number and rows[number - 1][k] == cell else cell for k, cell in enumerate(row)]
            for number, row in enumerate(rows)
        ]
    if random.random() < 0.3 and separator != " ":
        heads, rows = [*heads, "remark"], [[*row, ""] for row in rows]
    if units_below and separator != " " and any(named[name].unit for name in named):
        rows = [[named[name].unit if name in named else "" for name in (*order, "")][: len(heads)], *rows]
    return [heads, *rows]


def _saved(world: World, path: Path, rows: list[list[str]], separator: str, is_chinese: bool) -> Path:
    """Write a text or a spreadsheet, and return its path."""
    random = world.random
    if random.random() < 0.15:
        sheet = "\n".join(map(";".join, rows))
        return as_spreadsheet(path, sheet if path.stem == "field" else sheet.replace(",", "."))
    head = ["Survey of May"] if random.random() < 0.2 and separator != " " else []
    encoding = str(random.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16"]))
    text = "\n".join([*head, *map(separator.join, rows)]) + "\n"
    path.write_text(text, encoding="gb18030" if is_chinese and not text.isascii() else encoding)
    return path


def trial(seed: int, folder: Path) -> tuple[str, str]:
    """The kind of survey of a seed, and what is wrong with what becomes of its tables; empty where it is right."""
    survey, paths, here = written(seed, folder)
    project = folder / "p.yaml"
    free = ("--datum", "free") if survey == "bare" else ()
    begun = mor("new", project, *paths, *free)
    if begun.code:
        return survey, f"new: {begun.err.splitlines()[-1]}"
    lines = project.read_text(encoding="utf-8").splitlines()
    listed = lines.index("points:") if "points:" in lines else len(lines)
    at = next((k for k, line in enumerate(lines) if k > listed and "file:" in line), None)
    if at is None:
        return survey, "the list of control points is not in the project"
    end = next(k for k in range(at + 1, len(lines)) if lines[k][:4].strip(" #"))
    kept = [line for line in lines[at + 1 : end] if not line.strip().startswith("fixed:")]
    axes = "xyz" if SURVEYS[survey][1] == "z" else SURVEYS[survey][1]
    lines[at + 1 : end] = kept if free else [f"    fixed: [{', '.join(axes)}]", *kept]
    flat = (line for line in lines if not line.startswith("curvature:"))
    project.write_text("\n".join(flat) + "\n", encoding="utf-8")
    done = mor("adjust", project)
    if done.code:
        return survey, f"adjust: {(done.err.splitlines() or ['?'])[0]}"
    points = pl.read_csv(folder / "p.results" / "points.csv", infer_schema_length=None)
    found = {str(row["id"]): row for row in points.iter_rows(named=True)}
    for name, place in zip(here.ids, here.places, strict=True):
        for axis in SURVEYS[survey][1]:
            if name not in found:
                return survey, f"point {name} is not in the results"
            off = abs(float(found[name][axis]) - place["xyz".index(axis)])
            if off > 0.005:
                return survey, f"{axis} of point {name} is {off:.4f} m off"
    return survey, ""


def main() -> None:
    """Try tables, and print what is wrong and how many are right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    counts = Counter[tuple[str, bool]]()
    for seed in range(chosen.seed, chosen.seed + chosen.count):
        with tempfile.TemporaryDirectory() as folder:
            survey, wrong = trial(seed, Path(folder))
        counts[survey, not wrong] += 1
        if wrong:
            print(f"{seed} {survey}: {wrong[:300]}", flush=True)
    for survey in SURVEYS:
        right, wrong_ones = counts[survey, True], counts[survey, False]
        print(f"{survey}: {right} of {right + wrong_ones}")


if __name__ == "__main__":
    main()
