"""The adjusted project: the same project with the adjusted values as start values.

What is fixed or observed stays as it was given; only start values change, so that a second run converges at once and to
the same result. Tables of observations are referred to where they stand.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Undeterminable
from mor.geometry.rotations import angles_from_rotation
from mor.parameters.index import Values
from mor.parameters.kinds import BASE, ECCENTRICITY, HEIGHT, INTERIORS, POINT, ROTATION, SCALE, BlockKind
from mor.project.file.nodes import Document
from mor.project.file.yaml_text import yaml_text
from mor.project.network.build import Network
from mor.project.network.set_ups import shared_column
from mor.units import ANGLE, ANGLE_UNITS

_REMARKED = 50
"""Things that nothing determines that are named in the adjusted project."""


@dataclass(frozen=True)
class Placed:
    """A network and the values its blocks have got."""

    network: Network
    values: Values
    snooping: bool = False
    """True where data snooping was asked for outside the project file."""


def _angle_unit(placed: Placed) -> str:
    return placed.network.edge.default_unit(ANGLE)


def adjusted_project(
    placed: Placed, document: Document, source: Path, target: Path
) -> tuple[str, dict[str, pl.DataFrame]]:
    """YAML text of the adjusted project, to stand in the folder ``target``, and the tables it refers to.

    ``source`` is the folder of the original project.
    """
    data = dict(document.data)
    tables: dict[str, pl.DataFrame] = {}
    for section, frames in _sections(placed).items():
        entries = []
        for number, (frame, keys) in enumerate(frames, start=1):
            name = f"{section}.csv" if len(frames) == 1 else f"{section}_{number}.csv"
            tables[f"start_{name}"] = frame
            entries.append({"file": f"start_{name}", "units": _units(placed, frame), **keys})
        if entries:
            data[section] = entries
    for section in ("observations", "checks"):
        if section in data:
            data[section] = [_moved(entry, document, source, target, tables) for entry in data[section] or []]
    if "cameras" in data:
        data["cameras"] = {name: _camera(placed, name, dict(c)) for name, c in data["cameras"].items()}
    if "instruments" in data:
        data["instruments"] = {name: _instrument(placed, name, c) for name, c in data["instruments"].items()}
    if placed.snooping:
        data["settings"] = {**(data.get("settings") or {}), "snooping": "true"}
    return yaml_text(data, width=1000), tables


def remarks(things: Sequence[Undeterminable]) -> str:
    """Comments that say what did not take part, or only with its direction."""
    lines = [
        f"# {thing.treatment}: {thing.kind} {json.dumps(thing.name, ensure_ascii=False)}: {thing.reason}"
        for thing in things[:_REMARKED]
    ]
    if len(things) > _REMARKED:
        lines.append(f"# and {len(things) - _REMARKED} more: undetermined.csv has all of them")
    return "".join(f"{line}\n" for line in lines)


def _sections(placed: Placed) -> dict[str, list[tuple[pl.DataFrame, dict[str, Any]]]]:
    return {
        "points": _points(placed),
        "images": _images(placed),
        "pairs": _pairs(placed),
        "stations": _stations(placed),
        "systems": _systems(placed),
    }


def _moved(
    entry: dict[str, Any], document: Document, source: Path, target: Path, tables: dict[str, pl.DataFrame]
) -> dict[str, Any]:
    """An entry whose files are found from the new folder; a data frame without a file becomes one of ``tables``."""
    moved = dict(entry)
    for key in ("file", "covariance"):
        frame = document.frame(str(moved.get(key)))
        if frame is not None:
            words = "".join(c if c.isalnum() else " " for c in str(moved[key])).split()
            moved[key] = f"given_{'_'.join(words)}.csv"
            tables[moved[key]] = frame
        elif isinstance(moved.get(key), str):
            moved[key] = Path(os.path.relpath(source / moved[key], target)).as_posix()
    if "file" in moved and "name" not in moved:
        moved["name"] = entry["file"]
    return moved


def _units(placed: Placed, frame: pl.DataFrame) -> dict[str, str]:
    """Units of the angles, where the project's own (d-m-s) is not what a table of numbers has."""
    angles = [c for c in frame.columns if c.split("_")[-1] in (*ROTATION.names, "orientation")]
    return dict.fromkeys(angles, _angle_unit(placed))


def _component_columns(
    placed: Placed,
    kind: str,
    numbers: IntArray,
    names: Sequence[str],
    values: FloatArray,
    per_unit: float = 1.0,
) -> dict[str, FloatArray]:
    """Value, σ and start columns: fixed σ = 0, observed with the observed value and its start, free with its start."""
    network = placed.network
    free = network.blocks[kind].free[numbers]
    sigma, observed = network.sigma[kind][numbers], network.observed[kind][numbers]
    if kind == "point":
        M = network.edge.matrix
        source = np.argmax(np.abs(M), axis=0)
        free, sigma = free[:, source], sigma[:, source]
        observed = observed[:, source] * M[source, np.arange(3)]
    is_observed = np.isfinite(sigma)
    columns: dict[str, FloatArray] = {}
    for k, name in enumerate(names):
        columns[name] = np.where(is_observed[:, k], observed[:, k] / per_unit, values[:, k])
        columns[f"sigma_{name}"] = np.where(free[:, k], sigma[:, k] / per_unit, 0.0)
        columns[f"start_{name}"] = np.where(is_observed[:, k], values[:, k], np.nan)
    return {key: column for key, column in columns.items() if not np.isnan(column).all() or key in names}


def _frame(ids: Sequence[str], columns: dict[str, Any]) -> pl.DataFrame:
    frame = pl.DataFrame({"id": pl.Series("id", list(ids), dtype=pl.String), **columns})
    frame = frame.with_columns(pl.col(pl.Float64).fill_nan(None))
    kept = [c for c in frame.columns if frame[c].dtype != pl.String or (frame[c] != "").any() or c == "id"]
    return frame.select(kept)


def _positions(placed: Placed, numbers: IntArray) -> dict[str, FloatArray]:
    values = placed.values["point"][numbers] @ placed.network.edge.matrix
    return _component_columns(placed, "point", numbers, POINT.names, values)


def _rotations(placed: Placed, numbers: IntArray, M: FloatArray) -> dict[str, FloatArray]:
    per_unit = ANGLE_UNITS[_angle_unit(placed)]
    values = angles_from_rotation(placed.values["rotation"][numbers] @ M) / per_unit
    return _component_columns(placed, "rotation", numbers, ROTATION.names, values, per_unit)


def _plain(placed: Placed, kind: str, numbers: IntArray, names: Sequence[str]) -> dict[str, FloatArray]:
    return _component_columns(placed, kind, numbers, names, placed.values[kind][numbers])


def _set_ups(placed: Placed, kind: BlockKind, numbers: IntArray, own: BoolArray) -> dict[str, Any]:
    """Heights, eccentricities or offsets of the frames (n,) that have ``own`` ones, and names they share."""
    columns: dict[str, Any] = dict(_plain(placed, kind.key, numbers, kind.names))
    for column in columns.values():
        column[~own] = np.nan
    columns = {key: column for key, column in columns.items() if not np.isnan(column).all()}
    shared = placed.network.things.get(shared_column(kind))
    if shared is not None and shared.ids:
        names = dict(zip(shared.parts[kind.key].tolist(), shared.ids, strict=True))
        columns[shared_column(kind)] = [names.get(int(number), "") for number in numbers]
    return columns


def _unknown(placed: Placed, kind: BlockKind, numbers: IntArray, own: BoolArray) -> list[tuple[str, ...]]:
    """Of each frame (n,) the components that are unknowns without a σ."""
    free = placed.network.blocks[kind.key].free[numbers]
    loose = free & np.isnan(placed.network.sigma[kind.key][numbers]) & own[:, None]
    return [tuple(name for name, there in zip(kind.names, row, strict=True) if there) for row in loose]


def _by_table(
    placed: Placed,
    space: str,
    columns: dict[str, Any],
    unknown: Sequence[tuple[str, ...]] | None = None,
) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    """A table for each one the things of a namespace came from, by its name, with its ``unknown`` constants free."""
    ids = placed.network.things[space].ids
    result, first = [], 0
    for name, count in placed.network.tables.get(space, ()):
        rows = slice(first, first + count)
        frame = _frame(ids[rows], {key: column[rows] for key, column in columns.items()})
        result.append(
            (frame, {**({"name": name} if name else {}), **_free(unknown[rows] if unknown else ())})
        )
        first += count
    return result


def _free(unknown: Iterable[tuple[str, ...]]) -> dict[str, Any]:
    """The key for constants that are unknowns in a table."""
    names = list(dict.fromkeys(name for row in unknown for name in row))
    return {"free": names} if names else {}


def _points(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    positions = placed.network.things["point"].parts["position"]
    tables, first = [], 0
    for frame, keys in _by_table(placed, "point", _positions(placed, positions)):
        group = placed.network.point_groups.get(int(positions[first])) if frame.height else None
        tables.append((frame, {**keys, **({"group": group} if group else {})}))
        first += frame.height
    return tables


def _shared_names(placed: Placed, numbers: IntArray) -> list[str]:
    """Names of the points or shared positions that frames stand on; empty where a position is a frame's own."""
    names: dict[int, str] = {}
    for space in ("position", "point"):
        things = placed.network.things.get(space)
        if things is not None:
            here = np.flatnonzero(np.isin(things.parts["position"], numbers))
            names |= {int(things.parts["position"][i]): things.ids[i] for i in here}
    return [names.get(int(n), "") for n in numbers]


def _pose(
    placed: Placed, positions: IntArray, rotations: IntArray, shared: str, level: bool = False
) -> dict[str, Any]:
    edge = placed.network.edge
    return {
        shared: _shared_names(placed, positions),
        **_positions(placed, positions),
        **_rotations(placed, rotations, edge.matrix if edge.turned and not level else np.eye(3)),
    }


def _images(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    things, network = placed.network.things["image"], placed.network
    if not things.ids:
        return []
    parts = things.parts
    pair_of = {
        int(n): name
        for name, n in zip(network.things["pair"].ids, network.things["pair"].parts["base"], strict=True)
    }
    leader_of = {int(n): things.ids[i] for i, n in enumerate(parts["rotation"]) if parts["base"][i] < 0}
    follows = parts["base"] >= 0
    of_cameras = network.things["camera"].parts["eccentricity"][parts["camera"]]
    raised, apart = parts["height"] != 0, parts["eccentricity"] != of_cameras
    columns: dict[str, Any] = {
        "camera": [network.things["camera"].ids[k] for k in parts["camera"]],
        "leader": [leader_of[int(r)] if f else "" for r, f in zip(parts["rotation"], follows, strict=True)],
        "pair": [pair_of[int(b)] if f else "" for b, f in zip(parts["base"], follows, strict=True)],
        **_pose(placed, parts["position"], parts["rotation"], "position"),
        **_set_ups(placed, HEIGHT, parts["height"], raised),
        **_set_ups(placed, ECCENTRICITY, parts["eccentricity"], apart),
    }
    for key, column in columns.items():
        if isinstance(column, np.ndarray):
            column[follows] = np.nan
        elif key not in ("camera", "leader", "pair"):
            columns[key] = ["" if f else name for f, name in zip(follows, column, strict=True)]
    heights = _unknown(placed, HEIGHT, parts["height"], raised & ~follows)
    eccentricities = _unknown(placed, ECCENTRICITY, parts["eccentricity"], apart & ~follows)
    unknown = [(*a, *b) for a, b in zip(heights, eccentricities, strict=True)]
    return _by_table(placed, "image", columns | _image_variant(placed), unknown)


def _image_variant(placed: Placed) -> dict[str, FloatArray]:
    """Start values of the interior components that every image has of its own, empty where it has none."""
    things, cameras = placed.network.things["image"], placed.network.project.cameras
    columns: dict[str, FloatArray] = {}
    for number, name in enumerate(placed.network.things["camera"].ids):
        kind = INTERIORS[cameras[name].model]
        mine = np.flatnonzero(things.parts["camera"] == number)
        for component in cameras[name].image_variant:
            column = columns.setdefault(component, np.full(len(things.ids), np.nan))
            values = placed.values[kind.key][things.parts["interior"][mine]]
            column[mine] = values[:, kind.names.index(component)]
    return columns


def _pairs(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    things = placed.network.things["pair"]
    if not things.ids:
        return []
    columns = {
        **_plain(placed, "base", things.parts["base"], BASE.names),
        **_rotations(placed, things.parts["rotation"], np.eye(3)),
    }
    return _by_table(placed, "pair", columns)


def _stations(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    """The tables they came from; those that only observations name are levelled."""
    things, network = placed.network.things["station"], placed.network
    result = []
    tables = [
        (network.station_tables.get(name, ""), network.station_levels.get(name, "fixed"))
        for name in things.ids
    ]
    for table in dict.fromkeys(tables):
        chosen = np.array([i for i, own in enumerate(tables) if own == table], dtype=np.int64)
        name, level = table
        parts = {part: numbers[chosen] for part, numbers in things.parts.items()}
        names = [placed.network.sets.get(things.ids[i], (things.ids[i], "")) for i in chosen]
        columns = {
            "set": [set_ for _, set_ in names],
            **_pose(placed, parts["position"], parts["rotation"], "point", level=level == "fixed"),
            **_set_ups(placed, HEIGHT, parts["height"], parts["height"] != 0),
        }
        _empty_places_of_sets(columns)
        idle = np.array([things.ids[i] in placed.network.unoriented for i in chosen], dtype=bool)
        for key, column in columns.items():
            if key.split("_")[-1] in ROTATION.names:
                column[idle] = np.nan  # no direction was observed there
        if level == "fixed":
            columns = {key: c for key, c in columns.items() if key.split("_")[-1] not in ("omega", "phi")}
        of_own = (parts["height"] != 0) & np.array([not set_ for _, set_ in names], dtype=bool)
        unknown = _unknown(placed, HEIGHT, parts["height"], of_own)
        frame = _frame([station for station, _ in names], columns)
        result.append((frame, {**({"name": name} if name else {}), "level": level, **_free(unknown)}))
    return result


def _empty_places_of_sets(columns: dict[str, Any]) -> None:
    """A further set stands where its station stands: it has no position and height of its own."""
    is_set = np.array([bool(name) for name in columns["set"]])
    for key in ("point", shared_column(HEIGHT)):
        if key in columns:
            columns[key] = ["" if s else name for s, name in zip(is_set, columns[key], strict=True)]
    for key, column in columns.items():
        if key.split("_")[-1] in (*POINT.names, *HEIGHT.names):
            column[is_set] = np.nan


def _systems(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    things = placed.network.things["system"]
    if not things.ids:
        return []
    columns = {
        **_pose(placed, things.parts["position"], things.parts["rotation"], "point"),
        **_plain(placed, "scale", things.parts["scale"], SCALE.names),
    }
    offsets = things.parts["offset"]
    columns |= _set_ups(placed, ECCENTRICITY, offsets, offsets != 0)
    return _by_table(placed, "system", columns, _unknown(placed, ECCENTRICITY, offsets, offsets != 0))


def _camera(placed: Placed, name: str, camera: dict[str, Any]) -> dict[str, Any]:
    model = placed.network.project.cameras[name].model
    number = placed.network.things["camera"].part(name, "interior")
    kind = INTERIORS[model]
    values = placed.values[kind.key][number]
    camera["interior"] = _settings(camera.get("interior") or {}, kind.names, values)
    eccentricity = placed.network.things["camera"].part(name, "eccentricity")
    if eccentricity:
        row = placed.values["eccentricity"][eccentricity]
        camera["eccentricity"] = _settings(camera["eccentricity"], ("rx", "ry", "rz"), row)
    return camera


def _instrument(placed: Placed, name: str, instrument: dict[str, Any]) -> dict[str, Any]:
    result = dict(instrument)
    for kind, names in (("distance meter", ("scale", "offset")), ("refraction", ("refraction",))):
        number = placed.network.things["instrument"].part(name, kind)
        given = {key: result[key] for key in names if key in result}
        result |= _settings(given, names, placed.values[kind][number])
    return result


def _settings(given: dict[str, Any], names: Sequence[str], values: FloatArray) -> dict[str, Any]:
    """Settings with the adjusted values: free ones replaced, observed ones given a start."""
    result: dict[str, Any] = {}
    for name, setting in given.items():
        value = repr(float(values[list(names).index(name)]))
        if isinstance(setting, dict) and "free" in setting:
            result[name] = {"free": value}
        elif isinstance(setting, dict) and "observed" in setting:
            result[name] = {**setting, "start": value}
        else:
            result[name] = setting
    return result
