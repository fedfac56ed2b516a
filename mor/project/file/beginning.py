"""A new project file with comments, begun from the tables that are there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from mor.project.file.recognition import PLACES, Found
from mor.project.file.writing import LONGEST
from mor.project.tables.guarded import guarded

_SIGMA = {
    "image": "{sigma: 1 um}",
    "zenith_directions": "{sigma_horizontal: 1 mgon, sigma_zenith: 1 mgon}",
    "directions": "{sigma: 1 mgon}",
    "angle": "{sigma: 1 mgon}",
    "bearing": "{sigma: 1 mgon}",
    "zenith_angle": "{sigma: 1 mgon}",
    "vertical_direction": "{sigma: 1 mgon}",
    "distance": "{sigma: 2 mm}",
    "vector": "{sigma: 5 mm}",
    "height_difference": "{sigma: 1 mm}",
}
_VERTICAL = ("zenith_directions", "directions", "zenith_angle", "vertical_direction")
"""Types with a vertical circle, where a table has its readings."""
_VERTICAL_COLUMNS = {"zenith", "vertical", "zenith_angle", "vertical_direction"}
_PIXELS = 100.0
"""Image coordinates that go beyond this and never below zero are pixels from a corner."""


_VARIANCE = 0.01
"""Square of a standard deviation of 0.1: no vector between points is worse in metres."""


class CameraSettings(NamedTuple):
    """What is known of the camera; ``None`` if nothing is."""

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
    """Texts by path: the project file and the lists of names that belong to no table. ``units``: length, angle."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    by_kind = {kind: [t for t in tables if t.kind == kind] for kind in ("images", "points", "stations")}
    measured = [t for t in tables if t.kind not in by_kind]
    texts: dict[Path, str] = {}
    seen = [t for t in measured if t.kind == "image"]
    environment = Environment(
        loader=PackageLoader("mor.project.file"),
        undefined=StrictUndefined,
        trim_blocks=True,
        autoescape=False,
        keep_trailing_newline=True,
    )
    corner = any(_from_a_corner(t) for t in seen)
    content = {
        "name": target.name,
        "title": yaml.safe_dump(title, allow_unicode=True, width=1000).split("\n")[0],
        "length": units[0],
        "angle": units[1],
        "zenith": any(t.kind in _VERTICAL and not _VERTICAL_COLUMNS.isdisjoint(t.columns) for t in measured),
        "camera": _camera(camera, corner) if seen or by_kind["images"] else None,
        "more_images": _rest(target, "images", _names(seen, ("image",)), by_kind["images"], texts),
        "more_points": _rest(
            target, "points", _names(measured, PLACES), [*by_kind["points"], *by_kind["stations"]], texts
        ),
        "observations": [_entry(target, table, corner) for table in measured],
        "datum": datum,
        **{kind: [_entry(target, table, corner) for table in found] for kind, found in by_kind.items()},
    }
    return {target: environment.get_template("new.yaml.j2").render(content), **texts}


def _camera(settings: CameraSettings, corner: bool) -> dict[str, Any]:
    width, height = settings.size or ((6000, 4000) if corner else (None, None))
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


def _from_a_corner(table: Found) -> bool:
    if table.units.get("x", "px") != "px":
        return False
    values = [value for name in "xy" for value in table.numbers(name)]
    return bool(values) and min(values) >= 0.0 and max(values) > _PIXELS


def _names(tables: Iterable[Found], columns: Sequence[str]) -> list[str]:
    names = (name for table in tables for column in columns for name in table.texts(column))
    return list(dict.fromkeys(name for name in names if name))


def _units_of_covariances(table: Found) -> dict[str, str]:
    """Millimetres for covariances that would mean a standard deviation above a decimetre in metres."""
    variances = [value for name in ("cov_dx_dx", "cov_dy_dy", "cov_dz_dz") for value in table.numbers(name)]
    if not variances or sorted(variances)[len(variances) // 2] < _VARIANCE:
        return {}
    return {name: "mm" for name in table.columns if name.startswith("cov_") and name not in table.units}


def _rest(target: Path, what: str, names: list[str], tables: list[Found], texts: dict[Path, str]) -> str:
    """Rows, or a file, with the names that no table has; empty if there are none."""
    listed = set(_names(tables, ("id",)))
    rest = [name for name in names if name not in listed]
    if not rest:
        return ""
    if len(rest) <= LONGEST:
        rows = yaml.safe_dump([[name] for name in rest], default_flow_style=True, width=100_000).strip()
        return f"columns: [id]\n    rows: {rows}"
    path = target.with_name(f"{target.stem}_{what}.csv")
    texts[path] = "id\n" + "".join(f"{guarded(name)}\n" for name in rest)
    return f"file: {path.name}"


def _entry(target: Path, table: Found, corner: bool) -> dict[str, Any]:
    """What the template says of a table."""
    renamed = {theirs: ours for ours, theirs in table.columns.items() if ours != theirs}
    others = [name for name in table.header if name not in table.columns.values()]
    units = {**table.units, **_units_of_covariances(table)}
    keys: dict[str, Any] = {}
    if not table.has_header:
        keys["columns"] = list(table.header)
    elif renamed or others:
        keys["columns"] = {**renamed, **dict.fromkeys(others)}
    if units:
        keys["units"] = units
    if table.delimiter != ",":
        keys["delimiter"] = table.delimiter
    if table.decimal_comma:
        keys["decimal"] = ","
    lines = [
        f"{key}: {yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=100_000).splitlines()[0]}"
        for key, value in keys.items()
    ]
    if not table.has_header:
        lines[0] += "  # CHECK the order: the file has no header"
    lines = [
        f"{line}  # CHECK the units of the covariances: found values that are large for squares of the unit of length"
        if line.startswith("units:") and units != table.units
        else line
        for line in lines
    ]
    return {
        "kind": table.kind,
        "file": Path(os.path.relpath(table.path, target.parent)).as_posix(),
        "details": lines,
        "has_camera": "camera" in table.columns,
        "has_sigma": table.has_sigma,
        "sigma": "{sigma: 0.3 px}" if table.kind == "image" and corner else _SIGMA.get(table.kind, ""),
    }
