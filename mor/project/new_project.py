"""A new project file with comments, begun from the tables that are there."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import yaml

from mor.project.column_names import (
    ANGLES,
    BENCHMARK,
    DECIMETRE,
    LINES,
    NUMBER,
    OF_POINTS,
    PLACES,
    SIGMAS,
    name_and_unit,
    normalised,
)
from mor.project.document import LONGEST, guarded
from mor.project.recognition import Found
from mor.units import LENGTH_UNITS

_DMS = re.compile(r"[-+]?\d+\s*[-°:\s]\s*\d+\s*[-'′:\s]\s*\d")


class CameraSettings(NamedTuple):
    """Known settings of the camera; ``None`` if there are none."""

    name: str = "camera"
    constant: float | None = None
    size: tuple[int, int] | None = None
    pixel: str = "0.004 mm"


def begin(
    target: Path,
    tables: Sequence[Found],
    title: str,
    units: tuple[str, str],
    camera: CameraSettings,
    datum: str = "fixed",
) -> dict[Path, str]:
    """Texts by path: the project file and the lists of names that belong to no table.

    ``units``: length and angle; if that of angles is empty, zenith angles or coordinates may tell it.
    """
    listed = {name for t in tables if t.kind == "points" and not t.part.startswith(BENCHMARK) for name in t.texts("id")}
    tables = [t for t in tables if t.rows and (not t.part.startswith(BENCHMARK) or listed.isdisjoint(t.texts("id")))]
    tables = [t._replace(delimiter=",;"[t.decimal_comma]) if t.tidied and t.delimiter == " " else t for t in tables]
    by_kind = {kind: [t for t in tables if t.kind == kind] for kind in ("images", "points", "stations")}
    measured = [t for t in tables if t.kind not in by_kind]
    texts: dict[Path, str] = {}
    for table in tables:
        if table.tidied:
            lines = io.StringIO()
            writer = csv.writer(lines, delimiter=table.delimiter, lineterminator="\n")
            writer.writerows([table.header, *table.rows] if table.has_header else table.rows)
            texts[table.copy(target)] = lines.getvalue()
    seen = [t for t in measured if t.kind == "image"]
    corner = any(_from_a_corner(t) for t in seen)
    kinds = {t.kind for t in measured}
    levelled = bool(measured) and all(t.kind == "height_difference" for t in measured)
    has_heights = any(t.has_heights for t in by_kind["points"])
    # Types without heights.
    plane = {"angle", "bearing", "directions", "horizontal_distance"}
    in_plan = any("x" in t.columns and not t.has_heights for t in by_kind["points"]) or not (
        has_heights or kinds.isdisjoint(plane)
    )
    is_plane = (kinds <= plane | {"distance"} and in_plan) or (
        "horizontal_distance" in kinds <= plane and not has_heights
    )
    if is_plane:
        flat = [{ours: cell for ours, cell in t.columns.items() if ours != "z"} for t in by_kind["points"]]
        by_kind["points"] = [t._replace(columns=c) for t, c in zip(by_kind["points"], flat, strict=True)]
    in_lists = {name for t in by_kind["points"] for name, z in zip(*map(t.texts, ("id", "z")), strict=False) if z}
    is_flat = bool(measured) and kinds <= plane and not is_plane and in_lists.issuperset(_names(measured, PLACES))
    held = ("x", "y") if levelled else ("z",) if is_flat else ()
    circles = _circles(tables)
    guessed = circles.unit if not units[1] else None
    vertical_columns = {"zenith", "vertical", "zenith_angle", "vertical_direction"}
    # Types with a vertical circle, where a table has its readings.
    vertical = ("zenith_directions", "directions", "zenith_angle", "vertical_direction")
    content = {
        "name": target.name,
        "title": _quoted(title),
        "length": units[0],
        "angle": units[1] or guessed or "gon",
        "angle_guessed": guessed is not None,
        "axes": _exchanged(by_kind["points"]) if circles.reversed else "",
        "zenith": any(t.kind in vertical and not vertical_columns.isdisjoint(t.columns) for t in measured),
        "camera": _camera(camera, corner, seen) if seen or by_kind["images"] else None,
        "more_images": _rest(target, "images", _names(seen, ("image",)), by_kind["images"], texts),
        "more_points": _rest(
            target, "points", _names(measured, PLACES), [*by_kind["points"], *by_kind["stations"]], texts
        ),
        "observations": [_entry(target, table, corner) for table in measured],
        "datum": datum,
        "levelled": levelled,
        "plane": is_plane,
        **{
            kind: [
                _entry(target, table, corner, held, table.is_control and not table.has_sigma and datum == "fixed")
                for table in found
            ]
            for kind, found in by_kind.items()
        },
    }
    return {target: _rendered("new.yaml.j2", content), **texts}


def _quoted(text: str) -> str:
    return str(yaml.safe_dump(text, allow_unicode=True, width=1000)).split("\n")[0]


def _rendered(template: str, content: dict[str, Any]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("mor.project"),
        undefined=StrictUndefined,
        trim_blocks=True,
        autoescape=False,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(content)


def begin_test(target: Path, title: str, protocol: str) -> dict[Path, str]:
    """Texts by path: the project of a test by ISO 17123 or VDI/VDE 2634, and its table to fill in."""
    content = {"name": target.name, "title": _quoted(title)}
    if protocol == "iso17123-4":
        table, header = "distances.csv", "from,to,distance"
        pairs = [(str(one), str(other)) for one, other in combinations(range(1, 8), 2)]
    elif protocol == "vdi2634-1":
        table, header = "lengths.csv", "from,to,distance"
        pairs = [(f"L{line}-1", f"L{line}-{end}") for line, end in product(range(1, 8), range(2, 7))]
        content["ends"] = ", ".join(f"[L{line}-{end}]" for line, end in product(range(1, 8), range(1, 7)))
    elif protocol == "iso17123-5":
        table, header = "coordinates.csv", "system,point,x,y,z"
        set_ups = list(product("123", "123"))
        pairs = [(f"{series}-{k}", f"{to},,") for series, k in set_ups for to in "123" if to != k]
        content["systems"] = "\n      - ".join(f'["{one}-{k}", "{k}", 0, 0, 1]' for one, k in set_ups)
    elif protocol == "iso17123-8":
        table, header = "positions.csv", "series,set,point,x,y,z"
        pairs = [(f"{series},{k}", f"{point},,") for series, k, point in product("123", "12345", "12")]
    else:
        table, header = "directions.csv", "station,to,horizontal"
        sets, targets = list(product(range(1, 5), range(1, 4))), list(product(range(1, 5), range(2, 6)))
        pairs = [(f"S{series}-{k}", f"T{series}-{t}") for series, k in sets for t in range(1, 6)]
        content |= {
            "stations": ", ".join(f"[S{series}-{k}, S]" for series, k in sets),
            "targets": ", ".join(f"[T{series}-{t}]" for series, t in targets),
            "distances": ", ".join(f"[S, T{series}-{t}]" for series, t in targets),
        }
    rows = "".join(f"{one},{other},\n" for one, other in pairs)
    return {target: _rendered(f"{protocol}.yaml.j2", content), target.with_name(table): f"{header}\n{rows}"}


def _camera(settings: CameraSettings, corner: bool, seen: Sequence[Found]) -> dict[str, Any]:
    width, height = settings.size or (_format(seen) if corner else (None, None))
    return {
        "name": settings.name,
        "constant": settings.constant or 28,
        "guessed": settings.constant is None,
        "r0": 14,
        "width": width,
        "height": height,
        "pixel": settings.pixel,
        "sure": settings.size is not None,
        "corner": corner,
    }


def _format(seen: Sequence[Found]) -> tuple[int, int]:
    """Width and height of a format 3 : 2 that holds the image points."""
    values = (
        value / size for table in seen for axis, size in (("x", 1500), ("y", 1000)) for value in table.numbers(axis)
    )
    times = max(4, math.ceil(max(values, default=0.0)))
    return 1500 * times, 1000 * times


def _from_a_corner(table: Found) -> bool:
    if table.units.get("x", "px") != "px":
        return False
    values = [value for name in "xy" for value in table.numbers(name)]
    # Image coordinates that go beyond 100 and never below zero are pixels from a corner.
    return bool(values) and min(values) >= 0.0 and max(values) > 100.0


class _Circles(NamedTuple):
    """Unit and sense of angles, as the angles and the coordinates beside them tell."""

    unit: str | None = None
    """Degrees or gon; empty if the angles do not tell, ``None`` if all are in a stated unit."""
    reversed: bool = False
    """True if angles agree with coordinates only in the other sense."""


def _circles(tables: Sequence[Found]) -> _Circles:
    """Return the unit and the sense of horizontal angles.

    Most sights are level, or else horizontal angles agree with coordinates, or those of a traverse close.
    """
    bare = [table for table in tables if any(_is_bare(table, name) for name in ANGLES)]
    places = {
        name: (float(x.replace(",", ".")), float(y.replace(",", ".")))
        for table in tables
        if table.kind == "points"
        for name, x, y in zip(*map(table.texts, ("id", "x", "y")), strict=False)
        if NUMBER.fullmatch(x) and NUMBER.fullmatch(y)
    }
    circles = {"gon": 400.0, "deg": 360.0}
    ways = tuple(product(circles, (1, -1)))
    off = {(unit, sense): [_misfit(table, places, circles[unit], sense) for table in tables] for unit, sense in ways}
    best = {way: min((size for size in sizes if size is not None), default=1.0) for way, sizes in off.items()}
    for name, full in circles.items():
        sums = [abs((total / full * 2.0 + 0.5) % 1.0 - 0.5) for table in bare for total in _traversed(table)]
        best[name, 1] = min([best[name, 1], *sums])
    zeniths = [v for t in bare for name in ("zenith", "zenith_angle") if name not in t.units for v in t.numbers(name)]
    least = {name: min(best[name, 1], best[name, -1]) for name in circles}
    level = [median(abs(v % (full / 2) - full / 4) for v in zeniths or (0.0,)) for full in circles.values()]
    # Zenith angles tell the unit if half of the sights rise or fall by at most 2 degrees or gon; steep ones do not.
    if min(level) < 2.0:
        least = dict(zip(circles, level, strict=True))
    first, second = sorted(circles, key=lambda name: least[name])
    # Part of the misfit in the other unit or sense that angles in theirs have at most.
    agrees = 0.5
    told = (first if least[first] < agrees * least[second] else "") or _by_range(bare)
    known = told or "gon"
    # With exchanged axes angles agree within 2 % of the circle.
    is_reversed = best[known, -1] < min(agrees * best[known, 1], 0.02)
    return _Circles(told if bare else None, is_reversed)


def _by_range(tables: Sequence[Found]) -> str:
    """Unit of directions: gon go beyond 360; several that end right below 360 are back where their set began."""
    values = [v for table in tables if "horizontal" not in table.units for v in table.numbers("horizontal")]
    if max(values, default=0.0) >= 360.0:
        return "gon"
    return "deg" if sum(v > 359.9 for v in values) > 1 else ""


def _traversed(table: Found) -> Iterator[float]:
    """Sum of the angles of a closed traverse, a multiple of half a circle; nothing if they are not those of one."""
    if table.kind != "angle":
        return
    numbers = table.numbers("angle")
    ends = dict(zip(table.texts("at"), table.texts("to"), strict=False))
    if len(ends) == len(table.rows) == len(numbers) > 2:
        at = start = next(iter(ends))
        passed = 0
        while at in ends and passed < len(ends) and (passed == 0 or at != start):
            at, passed = ends[at], passed + 1
        if at == start and passed == len(ends):
            yield sum(numbers)


def _exchanged(points: Iterable[Found]) -> str:
    """Axes of coordinates that fit angles in the other sense: x leads north if the columns do not say otherwise."""
    named = {name_and_unit(table.columns.get("x", ""))[0] for table in points}
    return "{xy: ne}" if named <= {"x", "x0", "xo", "xcoord", "xcoordinate", "coordx"} else "{angles: counterclockwise}"


def _is_bare(table: Found, name: str) -> bool:
    """Return whether a table has angles of this name that are plain numbers in no stated unit."""
    return name in table.columns and name not in table.units and bool(table.numbers(name))


def _misfit(table: Found, places: Mapping[str, tuple[float, float]], full: float, sense: int) -> float | None:
    """Median misfit of angles to coordinates as part of the circle, ``None`` without both.

    Angles in no stated unit are in the unit that has ``full`` in a circle. ``sense`` -1 is that of exchanged axes.
    """
    # Columns with the point of the circle, where an angle begins and ends, and the reading.
    names = {
        "angle": ("at", "from", "to", "angle"),
        "bearing": ("from", "from", "to", "bearing"),
        "directions": ("station", "station", "to", "horizontal"),
        "zenith_directions": ("station", "station", "to", "horizontal"),
    }.get(table.kind)
    if names is None:
        return None
    before, apart = dict[tuple[str, ...], tuple[float, float]](), list[float]()
    carried = dict[tuple[str, str], float]()
    sets, faces, zeniths = (table.texts(name) or [""] * len(table.rows) for name in ("set", "face", "zenith"))
    full = {"deg": 360.0, "gon": 400.0}.get(table.units.get(names[3], ""), full)

    def leads(at: str, end: str) -> float | None:
        """Bearing by coordinates, or else by the angles of the traverse before."""
        if at == end or not {at, end} <= places.keys() or places[at] == places[end]:
            return carried.get((at, end))
        return math.atan2(places[end][0] - places[at][0], places[end][1] - places[at][1]) / math.tau

    for at, start, end, text, zenith, *circle in zip(*map(table.texts, names), zeniths, sets, faces, strict=False):
        value, tilt = (_turn(t.replace(",", ".") if table.decimal_comma else t, full) for t in (text, zenith))
        if value is not None and tilt is not None and tilt > 0.5:
            value += 0.5  # in face 2
        back, ahead = leads(at, start), leads(at, end)
        if value is None or (table.kind == "angle" and back is None) or (table.kind != "angle" and ahead is None):
            continue
        if back is not None and table.kind == "angle":
            if ahead is not None:
                apart.append(value - sense * (ahead - back))
            carried[end, at] = back + sense * value + 0.5
        elif ahead is not None and table.kind == "bearing":
            apart.append(value - (ahead if sense > 0 else 0.25 - ahead))
        elif ahead is not None:
            last = before.get((at, *circle))
            before[at, *circle] = value, ahead
            if last is not None and last[1] != ahead:  # not the same target once more
                apart.append(value - last[0] - sense * (ahead - last[1]))
    return median(abs((size + 0.5) % 1.0 - 0.5) for size in apart) if apart else None


def _turn(text: str, full: float) -> float | None:
    """An angle as part of the circle; degrees, minutes and seconds may be in one cell."""
    if NUMBER.fullmatch(text):
        return float(text) / full if "," not in text else None
    if not _DMS.match(text):
        return None
    degrees, minutes, *seconds = map(float, re.findall(r"\d+\.?\d*", text)[:3])
    return (degrees + minutes / 60.0 + sum(seconds) / 3600.0) / 360.0


def _names(tables: Iterable[Found], columns: Sequence[str]) -> list[str]:
    names = (name for table in tables for column in columns for name in table.texts(column))
    return list(dict.fromkeys(name for name in names if name))


def _units_of_precision(table: Found) -> dict[str, str]:
    """Units of standard deviations and covariances that would be too large or small in the units of the project.

    Those of lengths above a decimetre are millimetres, those of angles above a tenth of a degree or gon seconds of arc,
    those of angles finer than any theodolite radians.
    """
    is_angle = table.kind in ("directions", "angle", "bearing", "zenith_angle", "zenith_directions")
    is_list_of_heights = table.kind == "points" and "x" not in table.columns
    if table.kind not in (*LINES, "height_difference", "vector") and not (is_angle or is_list_of_heights):
        return {}
    variances = [value for name in ("cov_dx_dx", "cov_dy_dy", "cov_dz_dz") for value in table.numbers(name)]
    stated = [name for name in table.columns if name.startswith("sigma") and "height" not in name]
    sizes = [math.sqrt(abs(variance)) for variance in variances]
    sizes += [value for name in stated for value in table.numbers(name)]
    # Standard deviation in degrees or gon below that of any theodolite.
    is_fine = is_angle and 0.0 < median(sizes or [0.0]) < 1e-4
    if not sizes or (median(sizes) < DECIMETRE and not is_fine):
        return {}
    stated += [name for name in table.columns if name.startswith("cov_")]
    return {name: "rad" if is_fine else "arcsec" if is_angle else "mm" for name in stated if name not in table.units}


def _kilometres(table: Found) -> dict[str, str]:
    """Unit of the lengths of levelling lines if in metres one is shorter than its height difference, or all below 5."""
    if not {"dz", "length"} <= table.columns.keys() or "length" in table.units:
        return {}
    metre = LENGTH_UNITS.get(table.units.get("dz", "m"), 1.0)
    texts = ([cell.replace(",", ".") for cell in table.texts(name)] for name in ("dz", "length"))
    pairs = [pair for pair in zip(*texts, strict=False) if all(map(NUMBER.fullmatch, pair))]
    lines = [(abs(float(dz)) * metre, float(far)) for dz, far in pairs]
    lines = [(dz, far) for dz, far in lines if far > 0.0]
    is_short = any(dz > far for dz, far in lines) or max((far for _, far in lines), default=5.0) < 5.0
    return {"length": "km"} if is_short else {}


_ON_ONE_LINE: Mapping[str, Any] = {
    "default_flow_style": True,
    "sort_keys": False,
    "width": 100_000,
    "allow_unicode": True,
}


def _rest(target: Path, what: str, names: list[str], tables: list[Found], texts: dict[Path, str]) -> str:
    listed = set(_names(tables, ("id",)))
    rest = [name for name in names if name not in listed]
    if not rest:
        return ""
    if len(rest) <= LONGEST:
        rows = yaml.safe_dump([[name] for name in rest], **_ON_ONE_LINE).strip()
        return f"columns: [id]\n    rows: {rows}"
    path = target.with_name(f"{target.stem}_{what}.csv")
    texts[path] = "id\n" + "".join(f"{guarded(name)}\n" for name in rest)
    return f"file: {path.name}"


def _entry(target: Path, table: Found, corner: bool, held: Sequence[str] = (), is_held: bool = False) -> dict[str, Any]:
    """Entry of the template for a table; ``held``: coordinates that nothing measures.

    ``is_held``: all coordinates in it are held.
    """
    renamed = {theirs: ours for ours, theirs in table.columns.items() if ours != theirs}
    others = [name for name in table.header if name not in table.columns.values()]
    if "km" in normalised(table.columns.get("length", "")):
        table = table._replace(units={"length": "km", **table.units})
    guessed = _units_of_precision(table) | _kilometres(table)
    units = {**table.units, **guessed}
    units |= dict.fromkeys((name for name in ANGLES if any(map(_DMS.match, table.texts(name)))), "dms")
    keys: dict[str, Any] = {"sheet": table.sheet} if table.sheet and not table.tidied else {}
    if not table.has_header:
        keys["columns"] = [renamed.get(name, name if name in table.columns else None) for name in table.header]
    elif renamed or others:
        keys["columns"] = {**renamed, **dict.fromkeys(others)}
    if units:
        keys["units"] = units
    if table.delimiter != ",":
        keys["delimiter"] = table.delimiter
    if table.decimal_comma:
        keys["decimal"] = ","
    if held:
        keys |= ({} if held[0] in table.columns else {"values": dict.fromkeys(held, 0)}) | {"fixed": list(held)}
    if is_held:
        keys["fixed"] = list(
            dict.fromkeys([*keys.get("fixed", ()), *(axis for axis in "xyz" if axis in table.columns)])
        )
    lines = [f"{key}: {yaml.safe_dump(value, **_ON_ONE_LINE).splitlines()[0]}" for key, value in keys.items()]
    if table.header[:4] == OF_POINTS and not table.has_header:
        lines[0] += "  # CHECK the order: the file has no header"
    lines = [f"{line}  # CHECK" if is_held and line.startswith("fixed:") else line for line in lines]
    if guessed:
        strange = "lengths" if "length" in guessed else "standard deviations"
        words = f"  # CHECK: the {strange} are no usual ones in the unit of the readings"
        lines = [f"{line}{words}" if line.startswith("units:") else line for line in lines]
    return {
        "kind": table.kind,
        "file": Path(os.path.relpath(table.copy(target) if table.tidied else table.path, target.parent)).as_posix(),
        "details": lines,
        "has_camera": "camera" in table.columns,
        "has_sigma": table.has_sigma or is_held,
        "of": "1 km" if "length" in table.columns else "your measurements",
        "sigma": "{sigma: 0.3 px}" if table.kind == "image" and corner else SIGMAS.get(table.kind, ""),
    }
