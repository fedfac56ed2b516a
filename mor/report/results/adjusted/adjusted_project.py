"""The adjusted project: the same project with the adjusted values as start values.

What is fixed or observed stays as it was given; only start values change, so that a second run converges at once and to
the same result. Tables of observations are referred to where they stand.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.errors import Undeterminable
from mor.geometry.rotations import angles_from_rotation
from mor.observations.earth import DEFLECTIONS
from mor.parameters.kinds import ECCENTRICITY, GNSS_FRAME, INTERIORS, READOUT, ROTATION, TIME_OFFSET
from mor.project.file.nodes import Document
from mor.project.file.writing import LONGEST, matrix_text
from mor.project.file.yaml_text import yaml_text
from mor.project.network.build import Network
from mor.report.results.adjusted.start_columns import Placed, angle_unit
from mor.report.results.adjusted.start_motions import motions
from mor.report.results.adjusted.start_tables import start_tables
from mor.units import ANGLE, ANGLE_UNITS

Given: TypeAlias = pl.DataFrame | str
"""A table beside the project, or the text of a matrix."""
_OFFSET = "time_offset"
_REMARKED = 50
"""Things that nothing determines that are named in the adjusted project."""


def adjusted_project(
    placed: Placed,
    document: Document,
    source: Path,
    target: Path,
    starts: Mapping[str, list[tuple[pl.DataFrame, dict[str, Any]]]] | None = None,
) -> tuple[str, dict[str, Given]]:
    """YAML text of the adjusted project, to stand in the folder ``target``, and the tables it refers to.

    ``source`` is the folder of the original project. ``starts`` stand for the tables of start values of sections that
    others have put together.
    """
    data = dict(document.data)
    tables: dict[str, Given] = {}
    for section, frames in {**start_tables(placed), **(starts or {})}.items():
        entries = []
        for name, (frame, keys) in zip(start_names(section, len(frames)), frames, strict=True):
            tables[name] = frame
            entries.append({"file": name, "units": _units(placed, frame), **keys})
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
        data["curvature"] = with_sphere_origin(data["curvature"], placed.network)
    for section in ("observations", "checks", "candidates", "line_times"):
        if section in data:
            data[section] = [_moved(entry, document, source, target, tables) for entry in data[section] or []]
    if data.get("visibility"):
        data["visibility"] = _surroundings_moved(data["visibility"], source, target)
    if "cameras" in data:
        data["cameras"] = {name: _camera(placed, name, dict(c)) for name, c in data["cameras"].items()}
    if "instruments" in data:
        data["instruments"] = {name: _instrument(placed, name, c) for name, c in data["instruments"].items()}
    if placed.snooping:
        data["settings"] = {**(data.get("settings") or {}), "snooping": "true"}
    return yaml_text(data, width=1000), tables


def start_names(section: str, count: int) -> list[str]:
    """Files of the tables of start values of a section."""
    if count == 1:
        return [f"start_{section}.csv"]
    return [f"start_{section}_{number}.csv" for number in range(1, count + 1)]


def remarks(things: Sequence[Undeterminable]) -> str:
    """Comments that say what did not take part, or only with its direction."""
    lines = [
        f"# {thing.treatment}: {thing.kind} {json.dumps(thing.name, ensure_ascii=False)}: {thing.reason}"
        for thing in things[:_REMARKED]
    ]
    if len(things) > _REMARKED:
        lines.append(f"# and {len(things) - _REMARKED} more: undetermined.csv has all of them")
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
    """Degrees with the digits that an angle was given with."""
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


def with_sphere_origin(section: Any, network: Network) -> dict[str, Any]:
    """Return the section ``curvature`` with the origin that the network has, whatever its coordinates are now."""
    assert network.sphere is not None
    given = np.array(network.sphere.origin) @ network.edge.matrix
    kept = dict(section) if isinstance(section, Mapping) else {}
    if "origin" not in kept:
        kept["origin"] = {name: repr(float(value)) for name, value in zip("xyz", given, strict=True)}
    return kept


def _surroundings_moved(visibility: dict[str, Any], source: Path, target: Path) -> dict[str, Any]:
    """What stands in the way of sights, with its meshes and tables as they are found from the new folder."""
    moved = dict(visibility)
    for key in ("surfaces", "normals"):
        if moved.get(key):
            moved[key] = [
                {**one, "file": _from(target, source / one["file"])} if one.get("file") else one
                for one in moved[key]
            ]
    return moved


def _from(folder: Path, file: Path) -> str:
    """A file as it is found from a folder."""
    return Path(os.path.relpath(file, folder)).as_posix()


def _units(placed: Placed, frame: pl.DataFrame) -> dict[str, str]:
    """Units of the angles, where the project's own (d-m-s) is not what a table of numbers has."""
    angular = (*ROTATION.names, "orientation", "latitude", "longitude")
    angles = [c for c in frame.columns if c.split("_")[-1] in angular or c in DEFLECTIONS]
    return dict.fromkeys(angles, angle_unit(placed))


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
    readout = placed.network.things["camera"].part(name, READOUT.key)
    if readout >= 0:
        camera |= _settings(
            {READOUT.key: camera["readout"]}, READOUT.names, placed.values[READOUT.key][readout]
        )
    return camera


def _instrument(placed: Placed, name: str, instrument: dict[str, Any]) -> dict[str, Any]:
    result = dict(instrument)
    for kind, names in (("distance meter", ("scale", "offset")), ("refraction", ("refraction",))):
        number = placed.network.things["instrument"].part(name, kind)
        given = {key: result[key] for key in names if key in result}
        result |= _settings(given, names, placed.values[kind][number])
    if result.get("frame"):
        number = placed.network.things["instrument"].part(name, GNSS_FRAME.key)
        turned = [component.quantity == ANGLE for component in GNSS_FRAME.components]
        units = np.where(turned, ANGLE_UNITS[angle_unit(placed)], 1.0)
        values = placed.values[GNSS_FRAME.key][number] / units
        result["frame"] = _settings(result["frame"], GNSS_FRAME.names, values)
    for key, part in (("lever_arm", "lever arm"), ("boresight", "boresight"), (_OFFSET, TIME_OFFSET.key)):
        number = placed.network.things["instrument"].part(name, part)
        if number < 0:
            continue
        if part == "boresight":
            angles = angles_from_rotation(placed.values["rotation"][number])
            result[key] = _settings(result[key], ROTATION.names, angles / ANGLE_UNITS[angle_unit(placed)])
        elif part == "lever arm":
            result[key] = _settings(result[key], ECCENTRICITY.names, placed.values["eccentricity"][number])
        else:
            result |= _settings({key: result[key]}, (key,), placed.values[part][number])
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
