"""Tables of start values, section by section: those of the project, each by its name, with the adjusted values."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.kinds import (
    BASE,
    ECCENTRICITY,
    HEIGHT,
    IMAGE_VELOCITY,
    INTERIORS,
    POINT,
    ROTATION,
    ROTATION_RATE,
    SCALE,
    BlockKind,
)
from mor.project.network.set_ups import shared_column
from mor.report.results.adjusted.start_columns import (
    Placed,
    Unknown,
    angle_columns,
    constant_columns,
    coordinate_columns,
    place_columns,
    plain_columns,
    pose_columns,
    start_frame,
    unknown_constants,
)
from mor.report.results.adjusted.start_trajectories import on_trajectories, trajectory_tables


def start_tables(placed: Placed) -> dict[str, list[tuple[pl.DataFrame, dict[str, Any]]]]:
    """Tables of each section of things, with the keys they have in the project."""
    return {
        "points": _points(placed),
        "trajectories": trajectory_tables(placed),
        "images": _images(placed),
        "pairs": _pairs(placed),
        "stations": _stations(placed),
        "systems": _systems(placed),
    }


def _by_table(
    placed: Placed,
    space: str,
    columns: dict[str, Any],
    unknown: Unknown | None = None,
) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    """A table for each one the things of a namespace came from, by its name, with its ``unknown`` constants free."""
    ids = placed.network.things[space].ids
    result, first = [], 0
    for name, count in placed.network.tables.get(space, ()):
        rows = slice(first, first + count)
        frame = start_frame(ids[rows], {key: column[rows] for key, column in columns.items()})
        result.append((frame, {**({"name": name} if name else {}), **_free(unknown, rows)}))
        first += count
    return result


def _free(unknown: Unknown | None, rows: slice | IntArray) -> dict[str, Any]:
    """The key for constants that are unknowns in a table of these rows."""
    names = unknown.of_table(rows) if unknown is not None else []
    return {"free": names} if names else {}


def _points(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    positions = placed.network.things["point"].parts["position"]
    tables, first = [], 0
    on_earth = placed.network.world is not None
    columns = place_columns(placed, positions) if on_earth else coordinate_columns(placed, positions)
    for frame, keys in _by_table(placed, "point", columns):
        group = placed.network.point_groups.get(int(positions[first])) if frame.height else None
        tables.append((frame, {**keys, **({"group": group} if group else {})}))
        first += frame.height
    return tables


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
    pose = pose_columns(placed, parts["position"], parts["rotation"], "position")
    columns: dict[str, Any] = {
        "camera": [network.things["camera"].ids[k] for k in parts["camera"]],
        "epoch": [network.motion.label_of("image", name) for name in things.ids],
        "leader": [leader_of[int(r)] if f else "" for r, f in zip(parts["rotation"], follows, strict=True)],
        "pair": [pair_of[int(b)] if f else "" for b, f in zip(parts["base"], follows, strict=True)],
        **pose,
        **constant_columns(placed, HEIGHT, parts["height"], raised),
        **constant_columns(placed, ECCENTRICITY, parts["eccentricity"], apart),
        **_motions(placed),
    }
    for key, column in columns.items():
        if isinstance(column, np.ndarray):
            column[follows] = np.nan
        elif key not in ("camera", "epoch", "leader", "pair"):
            columns[key] = ["" if f else name for f, name in zip(follows, column, strict=True)]
    unknown = unknown_constants(placed, HEIGHT, parts["height"], raised & ~follows, ~follows)
    unknown = unknown.beside(
        unknown_constants(placed, ECCENTRICITY, parts["eccentricity"], apart & ~follows, ~follows)
    )
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        if kind.key in placed.network.blocks:
            own, moving = _moving(placed, kind), parts[kind.key] >= 0
            unknown = unknown.beside(unknown_constants(placed, kind, parts[kind.key], own, moving))
    columns = on_trajectories(placed, columns, pose)
    return _by_table(placed, "image", columns | _image_variant(placed), unknown)


def _motions(placed: Placed) -> dict[str, Any]:
    """Velocities and rates of rotation of the images that have one, and the names they share."""
    columns: dict[str, Any] = {}
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        if kind.key in placed.network.blocks:
            numbers = placed.network.things["image"].parts[kind.key]
            columns |= constant_columns(placed, kind, numbers, _moving(placed, kind))
    return columns


def _moving(placed: Placed, kind: BlockKind) -> BoolArray:
    """(n,) images that have a motion of a kind."""
    ids = placed.network.blocks[kind.key].ids
    numbers = placed.network.things["image"].parts[kind.key]
    return np.array([number >= 0 and ids[number] != "none" for number in numbers], dtype=bool)


def _image_variant(placed: Placed) -> dict[str, FloatArray]:
    """Start values of the interior components that every image has of its own, empty if it has none."""
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
        **plain_columns(placed, "base", things.parts["base"], BASE.names),
        **angle_columns(placed, things.parts["rotation"], np.eye(3)),
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
            "epoch": [network.motion.label_of("station", things.ids[i]) for i in chosen],
            **pose_columns(placed, parts["position"], parts["rotation"], "point", level=level == "fixed"),
            **constant_columns(placed, HEIGHT, parts["height"], parts["height"] != 0),
        }
        _empty_places_of_sets(columns)
        idle = np.array([things.ids[i] in placed.network.unoriented for i in chosen], dtype=bool)
        for key, column in columns.items():
            if key.split("_")[-1] in ROTATION.names:
                column[idle] = np.nan  # no direction was observed there
        if level == "fixed":
            columns = {key: c for key, c in columns.items() if key.split("_")[-1] not in ("omega", "phi")}
        first = np.array([not set_ for _, set_ in names], dtype=bool)
        unknown = unknown_constants(placed, HEIGHT, parts["height"], first & (parts["height"] != 0), first)
        frame = start_frame([station for station, _ in names], columns)
        result.append(
            (frame, {**({"name": name} if name else {}), "level": level, **_free(unknown, slice(None))})
        )
    return result


def _empty_places_of_sets(columns: dict[str, Any]) -> None:
    """A further set stands where its station stands: it has no position and height of its own."""
    is_set = np.array([bool(name) for name in columns["set"]])
    names = ("point", shared_column(HEIGHT))
    for key, column in columns.items():
        if key in names:
            columns[key] = ["" if s else name for s, name in zip(is_set, column, strict=True)]
        elif key.split("_")[-1] in (*POINT.names, *HEIGHT.names):
            column[is_set] = np.nan


def _systems(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    things = placed.network.things["system"]
    if not things.ids:
        return []
    columns = {
        **pose_columns(placed, things.parts["position"], things.parts["rotation"], "point"),
        **plain_columns(placed, "scale", things.parts["scale"], SCALE.names),
    }
    offsets = things.parts["offset"]
    own, all_ = offsets != 0, np.ones(len(offsets), dtype=bool)
    columns |= constant_columns(placed, ECCENTRICITY, offsets, own)
    return _by_table(placed, "system", columns, unknown_constants(placed, ECCENTRICITY, offsets, own, all_))
