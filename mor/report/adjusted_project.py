"""Write a project whose approximate values are the estimates."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import polars as pl

from mor.errors import UndeterminedObject
from mor.model.geodetic import DEFLECTIONS, GEOID
from mor.model.parameters import (
    BASE,
    ECCENTRICITY,
    GNSS_FRAME,
    HEIGHT,
    IMAGE_VELOCITY,
    INTERIORS,
    KINDS,
    MOTIONS,
    POINT,
    READOUT,
    ROTATION,
    ROTATION_RATE,
    SCALE,
    TIME_OFFSET,
    BlockKind,
    Values,
)
from mor.model.rotations import angles_from_rotation
from mor.project.document import LONGEST, Document, matrix_text, yaml_text
from mor.project.network import Network
from mor.project.points import place_names
from mor.project.stations import shared_column
from mor.project.trajectories import TRAJECTORY
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE, ANGLE_UNITS

# ---- Columns of the tables of start values: value, σ and start of every component, as the project would give them.


class Placed(NamedTuple):
    """A network and the values its blocks have got."""

    network: Network
    values: Values
    snooping: bool = False
    """True if data snooping was asked for outside the project file."""


def angle_unit(placed: Placed) -> str:
    """Unit of angles in the tables, where the project writes d-m-s too."""
    return placed.network.edge.default_unit(ANGLE)


def _component_columns(
    placed: Placed, kind: str, numbers: IntArray, names: Sequence[str], values: FloatArray, per_unit: float = 1.0
) -> dict[str, FloatArray]:
    """Value, σ and start columns: fixed σ = 0, observed with the observed value and its start, free with its start."""
    network = placed.network
    free = network.blocks[kind].free[numbers]
    sigma, observed = network.sigma[kind][numbers], network.observed[kind][numbers]
    if KINDS[kind].in_object_axes:
        M = network.edge.matrix
        source = np.argmax(np.abs(M), axis=0)
        free, sigma = free[:, source], sigma[:, source]
        observed = observed[:, source] * M[source, np.arange(3)]
    is_observed = np.isfinite(sigma)
    columns: dict[str, FloatArray] = {}
    for k, name in enumerate(names):
        columns[name] = np.where(is_observed[:, k], observed[:, k] / per_unit, values[:, k])
        held = np.where(np.isnan(columns[name]), np.nan, 0.0)  # without a value it is none of the dimensions
        columns[f"sigma_{name}"] = np.where(free[:, k], sigma[:, k] / per_unit, held)
        columns[f"start_{name}"] = np.where(is_observed[:, k], values[:, k], np.nan)
    return {key: column for key, column in columns.items() if not np.isnan(column).all() or key in names}


def start_frame(ids: Sequence[str], columns: dict[str, Any]) -> pl.DataFrame:
    """A table of things by name; columns of texts that say nothing are left out."""
    frame = pl.DataFrame({"id": pl.Series("id", list(ids), dtype=pl.String), **columns})
    frame = frame.with_columns(pl.col(pl.Float64).fill_nan(None))
    kept = [c for c in frame.columns if frame[c].dtype != pl.String or (frame[c] != "").any() or c == "id"]
    return frame.select(kept)


def coordinate_columns(placed: Placed, numbers: IntArray) -> dict[str, FloatArray]:
    """Coordinates of points, in project axes."""
    values = placed.values["point"][numbers] @ placed.network.edge.matrix
    return _component_columns(placed, "point", numbers, POINT.names, values)


def place_columns(placed: Placed, numbers: IntArray) -> dict[str, FloatArray]:
    """Points on the earth as their tables have them: coordinates, σ east, north, up, geoid height and deflection."""
    world = placed.network.world
    assert world is not None
    N = world.geoid_at(numbers, placed.values["point"][numbers])
    sigma = np.full((len(numbers), 3), np.nan)
    sigma[~placed.network.blocks["point"].free[numbers].any(axis=1)] = 0.0
    given = placed.values["point"][numbers].copy()
    row_of = {int(number): row for row, number in enumerate(numbers)}
    observed = np.zeros(len(numbers), dtype=bool)
    for group in (group for group in placed.network.groups if group.type.key == "control"):
        rows = [row_of[int(number)] for number in group.blocks[0]]
        sigma[rows], given[rows], observed[rows] = group.given_sigma, group.constants, True
    adjusted = world.from_object(placed.values["point"][numbers], N)
    own = world.from_object(given, N)
    per_unit = ANGLE_UNITS[angle_unit(placed)]
    columns: dict[str, FloatArray] = {}
    for k, name in enumerate(world.system.coordinates):
        unit = per_unit if name in ("latitude", "longitude") else 1.0
        columns[name] = own[:, k] / unit
        columns[f"start_{name}"] = np.where(observed, adjusted[:, k] / unit, np.nan)
    columns |= {f"sigma_{name}": sigma[:, k] for k, name in enumerate(("east", "north", "up"))}
    columns[GEOID] = N
    given_there = np.isfinite([world.at_points[name] for name in DEFLECTIONS]).any()
    columns |= {name: world.of_points(name, numbers) / per_unit for name in DEFLECTIONS if given_there}
    return {key: c for key, c in columns.items() if key in world.system.coordinates or not np.isnan(c).all()}


def angle_columns(placed: Placed, numbers: IntArray, M: FloatArray) -> dict[str, FloatArray]:
    """ω, φ, κ of rotations D Mᵀ, in the unit of the tables."""
    per_unit = ANGLE_UNITS[angle_unit(placed)]
    values = angles_from_rotation(placed.values["rotation"][numbers] @ M) / per_unit
    return _component_columns(placed, "rotation", numbers, ROTATION.names, values, per_unit)


def plain_columns(placed: Placed, kind: str, numbers: IntArray, names: Sequence[str]) -> dict[str, FloatArray]:
    """Components that no axes turn."""
    turned = {component.quantity.angle for component in KINDS[kind].components}
    per_unit = ANGLE_UNITS[angle_unit(placed)] if turned == {1} else 1.0
    values = placed.values[kind][numbers] / per_unit
    return _component_columns(placed, kind, numbers, names, values, per_unit)


def motion_columns(placed: Placed, kind: BlockKind, numbers: IntArray) -> dict[str, FloatArray]:
    """Movements of points, in project axes."""
    values = placed.values[kind.key][numbers] @ placed.network.edge.matrix
    return _component_columns(placed, kind.key, numbers, kind.names, values)


def constant_columns(placed: Placed, kind: BlockKind, numbers: IntArray, own: BoolArray) -> dict[str, Any]:
    """Heights, eccentricities or offsets of the frames (n,) that have ``own`` ones, and names they share."""
    columns: dict[str, Any] = dict(plain_columns(placed, kind.key, numbers, kind.names))
    for column in columns.values():
        column[~own] = np.nan
    columns = {key: column for key, column in columns.items() if not np.isnan(column).all()}
    shared = placed.network.things.get(shared_column(kind))
    if shared is not None and shared.ids:
        names = dict(zip(shared.parts[kind.key].tolist(), shared.ids, strict=True))
        columns[shared_column(kind)] = [names.get(int(number), "") for number in numbers]
    return columns


class Unknown(NamedTuple):
    """Mask (n, size) of the constants of n frames that are unknowns without a σ."""

    names: tuple[str, ...]
    free: BoolArray
    barred: BoolArray
    """Components that a table which has them free would change: observed ones, and those that say nothing."""

    def beside(self, other: Unknown) -> Unknown:
        """The components of both."""
        return Unknown(
            self.names + other.names, np.hstack([self.free, other.free]), np.hstack([self.barred, other.barred])
        )

    def of_table(self, rows: IntArray | slice) -> list[str]:
        """Names that are free in a table of these rows."""
        named = np.asarray(self.free[rows].any(axis=0) & ~self.barred[rows].any(axis=0))
        return [name for name, free in zip(self.names, named, strict=True) if free]


def unknown_constants(placed: Placed, kind: BlockKind, numbers: IntArray, own: BoolArray, any_: BoolArray) -> Unknown:
    """Unknowns among the constants of the frames (n,) that have ``own`` ones; ``any_`` are those that may have any."""
    free = placed.network.blocks[kind.key].free[numbers]
    observed = np.isfinite(placed.network.sigma[kind.key][numbers])
    return Unknown(kind.names, free & ~observed & own[:, None], (observed | ~own[:, None]) & any_[:, None])


def _frame_places(placed: Placed, positions: IntArray) -> dict[str, FloatArray]:
    """Places of frames on the earth, in the reference system; of those that stand on points none.

    Where no grid says how high the geoid is there, it is as high as at the points on the average, and the heights are
    above that.
    """
    world = placed.network.world
    assert world is not None
    values = placed.values["point"][positions]
    N = world.geoid_at(positions, values)
    at_points = world.at_points[GEOID]
    if np.isfinite(at_points).any():
        N = np.where(np.isnan(N), np.nanmean(at_points), N)
    found = world.from_object(values, N)
    found[np.isin(positions, placed.network.things["point"].parts["position"])] = np.nan
    if np.isnan(found).all():
        return {}
    columns = dict(zip(place_names(world), found.T, strict=True))
    for name in ("latitude", "longitude"):
        if name in columns:
            columns[name] = columns[name] / ANGLE_UNITS[angle_unit(placed)]
    return {**columns, **({GEOID: N} if world.orthometric else {})}


def pose_columns(
    placed: Placed, positions: IntArray, rotations: IntArray, shared: str, level: bool = False
) -> dict[str, Any]:
    """Position and attitude of frames, and the name of what they stand on."""
    edge = placed.network.edge
    on_earth = placed.network.world is not None
    places = _frame_places(placed, positions) if on_earth else coordinate_columns(placed, positions)
    names: dict[int, str] = {}
    for space in ("position", "point"):
        things = placed.network.things.get(space)
        if things is not None:
            here = np.flatnonzero(np.isin(things.parts["position"], positions))
            names |= {int(things.parts["position"][i]): things.ids[i] for i in here}
    return {
        shared: [names.get(int(n), "") for n in positions],
        **places,
        **angle_columns(placed, rotations, edge.matrix if edge.turned and not level else np.eye(3)),
    }


# ---- Movements of the adjusted project: velocities and oscillations start at their adjusted values.
#
# Steps and coordinates of single epochs start among the points.


def motions(
    placed: Placed, entries: list[dict[str, Any]], tables: dict[str, pl.DataFrame | str]
) -> list[dict[str, Any]]:
    """The entries of the section ``motions``; tables of start values are added to ``tables``."""
    result = []
    points = placed.network.things["point"]
    models = {"velocity": ("velocity",), "seasonal": ("sine", "cosine")}
    for number, (entry, (model, names)) in enumerate(zip(entries, placed.network.motion.tables, strict=True), 1):
        if model not in models:
            result.append(entry)
            continue
        columns: dict[str, Any] = {}
        for kind in (kind for kind in MOTIONS if kind.key in models[model]):
            blocks = np.array([points.part(name, kind.key) for name in names], dtype=np.int64)
            columns |= motion_columns(placed, kind, blocks)
        file = f"start_motions_{number}.csv"
        tables[file] = start_frame(names, columns)
        name = {"name": entry["name"]} if "name" in entry else {"name": f"motions {number}"}
        result.append({"model": model, "file": file, **name})
    return result


# ---- Tables of knots with the adjusted values; those at a spacing are knots now, and images on trajectories have
# times.


def trajectory_tables(placed: Placed) -> list[tuple[pl.DataFrame, dict[str, Any]]]:
    """A table for each one of the project, with the keys it has there."""
    network = placed.network
    parts = network.things["knot"].parts
    columns: dict[str, Any] = {
        "trajectory": [t.name for t in network.trajectories.values() for _ in t.times],
        "time": np.concatenate([np.zeros(0), *(t.times for t in network.trajectories.values())]),
    }
    if not len(columns["time"]):
        return []
    columns |= coordinate_columns(placed, parts["position"])
    columns |= angle_columns(placed, parts["rotation"], np.eye(3))
    whole = pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))
    result, first = [], 0
    for (name, count), table in zip(network.tables["knot"], network.project.trajectories, strict=True):
        keys = {"interpolation", "gap", "constancy", "smoothness"}
        said = table.model_dump(include=keys, exclude_defaults=True, exclude_none=True)
        result.append((whole[first : first + count], {**({"name": name} if name else {}), **said}))
        first += count
    return result


def on_trajectories(placed: Placed, columns: dict[str, Any], pose: dict[str, Any]) -> dict[str, Any]:
    """Columns of images, those on trajectories with trajectory and time in place of the columns of a ``pose``."""
    network = placed.network
    images = network.things["image"]
    on = images.parts[TRAJECTORY] >= 0
    leads = images.parts["base"] < 0
    if not on.any():
        return columns
    for name in pose:
        if isinstance(columns[name], np.ndarray):
            columns[name][on] = np.nan
        else:
            columns[name] = ["" if no else text for no, text in zip(on, columns[name], strict=True)]
    ids = list(network.trajectories)
    named = zip(images.parts[TRAJECTORY], leads, strict=True)
    columns["trajectory"] = [ids[k] if k >= 0 and own else "" for k, own in named]
    tabled = {name for name, lines in network.lines.items() if not lines.steady}
    timed = on & leads & np.array([name not in tabled for name in images.ids])
    columns["time"] = np.array(
        [network.image_times[name] if own else np.nan for name, own in zip(images.ids, timed, strict=True)]
    )
    return columns


# ---- Tables of start values, section by section: those of the project, each by its name, with the adjusted values.


def _by_table(
    placed: Placed, space: str, columns: dict[str, Any], unknown: Unknown | None = None
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
        int(n): name for name, n in zip(network.things["pair"].ids, network.things["pair"].parts["base"], strict=True)
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
    unknown = unknown.beside(unknown_constants(placed, ECCENTRICITY, parts["eccentricity"], apart & ~follows, ~follows))
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        if kind.key in placed.network.blocks:
            own, moving = _moving(placed, kind), parts[kind.key] >= 0
            unknown = unknown.beside(unknown_constants(placed, kind, parts[kind.key], own, moving))
    columns = on_trajectories(placed, columns, pose)
    return _by_table(placed, "image", columns | _image_variant(placed), unknown)


def _motions(placed: Placed) -> dict[str, Any]:
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
    things, cameras = placed.network.things["image"], placed.network.project.cameras
    columns: dict[str, FloatArray] = {}
    for number, name in enumerate(placed.network.things["camera"].ids):
        kind = INTERIORS[cameras[name].model]
        mine = np.flatnonzero(things.parts["camera"] == number)
        for component in cameras[name].image_variant:
            column = columns.setdefault(component, np.full(len(things.ids), np.nan))
            column[mine] = placed.values[kind.key][things.parts["interior"][mine]][:, kind.names.index(component)]
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
    tables = [network.station_tables.get(name, ("", "fixed")) for name in things.ids]
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
        result.append((frame, {**({"name": name} if name else {}), "level": level, **_free(unknown, slice(None))}))
    return result


def _empty_places_of_sets(columns: dict[str, Any]) -> None:
    """A further set has the position of its station: it has no position and height of its own."""
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


# ---- The adjusted project: the same project with the adjusted values as start values.
#
# What is fixed or observed stays as it was given; only start values change, so that a second run converges at
# once and to the same result. Tables of observations are referred to where they stand.

Given: TypeAlias = pl.DataFrame | str
"""A table beside the project, or the text of a matrix."""


def adjusted_project(placed: Placed, document: Document, source: Path, target: Path) -> tuple[str, dict[str, Given]]:
    """YAML text of the adjusted project, to stand in the folder ``target``, and the tables it refers to.

    ``source`` is the folder of the original project.
    """
    data = dict(document.data)
    tables: dict[str, Given] = {}
    for section, frames in {
        "points": _points(placed),
        "trajectories": trajectory_tables(placed),
        "images": _images(placed),
        "pairs": _pairs(placed),
        "stations": _stations(placed),
        "systems": _systems(placed),
    }.items():
        entries = []
        for name, (frame, keys) in zip(start_names(section, len(frames)), frames, strict=True):
            tables[name] = frame
            angular = (*ROTATION.names, "orientation", "latitude", "longitude")
            angles = [c for c in frame.columns if c.split("_")[-1] in angular or c in DEFLECTIONS]
            entries.append({"file": name, "units": dict.fromkeys(angles, angle_unit(placed)), **keys})
        if entries:
            data[section] = entries
    if "motions" in data:
        entries = [_moved(entry, document, source, target, tables) for entry in data["motions"] or []]
        data["motions"] = motions(placed, entries, tables)
    if data.get("world"):
        data["world"] = grids_moved(data["world"], source, target)
        if placed.network.world is not None:  # the same object system, wherever the middle is now
            horizon = placed.network.world.horizon
            place = {"latitude": horizon.latitude, "longitude": horizon.longitude}
            data["world"]["origin"] = {name: f"{_degrees(angle)!r} deg" for name, angle in place.items()}
    if placed.network.sphere is not None:
        assert placed.network.sphere is not None
        given = np.array(placed.network.sphere.origin) @ placed.network.edge.matrix
        kept = dict(data["curvature"]) if isinstance(data["curvature"], Mapping) else {}
        if "origin" not in kept:
            kept["origin"] = {name: repr(float(value)) for name, value in zip("xyz", given, strict=True)}
        data["curvature"] = kept
    for section in ("observations", "checks", "candidates", "line_times"):
        if section in data:
            data[section] = [_moved(entry, document, source, target, tables) for entry in data[section] or []]
    if data.get("visibility"):
        moved = dict(data["visibility"])
        for key in ("surfaces", "normals"):
            if moved.get(key):
                moved[key] = [
                    {**one, "file": _from(target, source / one["file"])} if one.get("file") else one
                    for one in moved[key]
                ]
        data["visibility"] = moved
    for section in ("cameras", "instruments"):
        if section in data:
            data[section] = with_settings(placed.network, section, data[section], placed.values, _started)
    if placed.snooping:
        data["settings"] = {**(data.get("settings") or {}), "snooping": "true"}
    return yaml_text(data, width=1000), tables


def start_names(section: str, count: int) -> list[str]:
    """Files of the tables of start values of a section."""
    if count == 1:
        return [f"start_{section}.csv"]
    return [f"start_{section}_{number}.csv" for number in range(1, count + 1)]


def remarks(things: Sequence[UndeterminedObject]) -> str:
    """Comments that say what did not take part, or only with its direction."""
    # Things that nothing determines that are named in the adjusted project.
    remarked = 50
    lines = [
        f"# {thing.treatment}: {thing.kind} {json.dumps(thing.name, ensure_ascii=False)}: {thing.reason}"
        for thing in things[:remarked]
    ]
    if len(things) > remarked:
        lines.append(f"# and {len(things) - remarked} more: undetermined.csv has all of them")
    return "".join(f"{line}\n" for line in lines)


def _moved(
    entry: dict[str, Any], document: Document, source: Path, target: Path, tables: dict[str, Given]
) -> dict[str, Any]:
    """An entry whose files are found from the new folder; a data frame without a file becomes one of ``tables``."""
    moved = dict(entry)
    for key in ("file", "covariance"):
        frame = document.frame(moved[key]) if isinstance(moved.get(key), str) else None
        if frame is not None:
            words = "".join(c if c.isalnum() else " " for c in str(moved[key])).split()
            moved[key] = f"given_{'_'.join(words)}.csv"
            tables[moved[key]] = frame
        elif isinstance(moved.get(key), str):
            moved[key] = _from(target, source / moved[key])
    if isinstance(moved.get("covariance"), list) and len(moved["covariance"]) > LONGEST:
        name = f"given_covariance_{sum(name.startswith('given_covariance') for name in tables) + 1}.csv"
        tables[name] = matrix_text(moved["covariance"])
        moved["covariance"] = name
    if "file" in moved and "name" not in moved:
        moved["name"] = entry["file"]
    return moved


def _degrees(angle: float) -> float:
    return float(f"{math.degrees(angle):.13g}")


def grids_moved(world: dict[str, Any], source: Path, target: Path) -> dict[str, Any]:
    """The section ``world`` with its grids as they are found from the new folder."""
    moved = dict(world)
    for key in ("geoid", "deflections"):
        given = world.get(key)
        if isinstance(given, str):
            moved[key] = _from(target, source / given)
        elif given:
            moved[key] = {axis: _from(target, source / file) for axis, file in given.items()}
    return moved


def _from(folder: Path, file: Path) -> str:
    return Path(os.path.relpath(file, folder)).as_posix()


# ---- Settings of cameras and instruments, which stand in the project file itself.

Setting: TypeAlias = str | dict[str, Any]
"""A plain number, or a value with its status."""


def with_settings(
    network: Network, section: str, data: dict[str, Any], values: Values, put: Callable[[Setting, str], Setting]
) -> dict[str, Any]:
    """The section ``cameras`` or ``instruments`` with other settings: ``put`` makes one of it and its value."""
    return {
        name: _with_settings(network, section.removesuffix("s"), name, given, values, put)
        for name, given in data.items()
    }


def _with_settings(
    network: Network,
    space: str,
    name: str,
    given: dict[str, Any],
    values: Values,
    put: Callable[[Setting, str], Setting],
) -> dict[str, Any]:
    interior = INTERIORS[network.project.cameras[name].model].key if space == "camera" else ""
    # Key of the settings (none for those that stand beside each other in the entry), kind of their block, its part.
    places = {
        "camera": (
            ("interior", interior, "interior"),
            ("eccentricity", ECCENTRICITY.key, ECCENTRICITY.key),
            ("", READOUT.key, READOUT.key),
        ),
        "instrument": (
            ("", "distance meter", "distance meter"),
            ("", "refraction", "refraction"),
            ("frame", GNSS_FRAME.key, GNSS_FRAME.key),
            ("lever_arm", ECCENTRICITY.key, "lever arm"),
            ("boresight", ROTATION.key, "boresight"),
            ("", TIME_OFFSET.key, TIME_OFFSET.key),
        ),
    }[space]
    edge, result = network.edge, dict(given)
    unit = edge.default_unit(ANGLE)
    for key, kind, part in places:
        number = network.things[space].part(name, part)
        settings = result.get(key) or {} if key else {one: result[one] for one in KINDS[kind].names if one in result}
        if not settings or number < 0:
            continue
        row = values[kind][number]
        row = angles_from_rotation(row) if row.ndim > 1 else row
        texts = {}
        for component, value in zip(KINDS[kind].components, row, strict=True):
            angle = component.quantity == ANGLE
            text = repr(float(value / ANGLE_UNITS[unit] if angle else value))
            texts[component.name] = f"{text} {unit}" if angle and edge.units.angle == "dms" else text
        changed = {one: put(setting, texts[one]) for one, setting in settings.items()}
        result = {**result, key: changed} if key else result | changed
    return result


def _started(setting: Setting, value: str) -> Setting:
    """A setting that starts at its adjusted value."""
    if isinstance(setting, dict) and "free" in setting:
        return {"free": value}
    if isinstance(setting, dict) and "observed" in setting:
        return {**setting, "start": value}
    return setting
