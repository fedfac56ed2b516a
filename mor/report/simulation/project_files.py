"""A simulated project as files: simulated values in place of measured ones, the rest as it was given."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.geometry.rotations import angles_from_rotation
from mor.observations import PLAIN_TYPES, ObservationGroup, is_image_point
from mor.parameters.index import Values
from mor.parameters.kinds import (
    ECCENTRICITY,
    GNSS_FRAME,
    INTERIORS,
    KINDS,
    READOUT,
    ROTATION,
    TIME_OFFSET,
)
from mor.project.edge import UnitError
from mor.project.file.model import Observations
from mor.project.file.nodes import Document
from mor.project.motion.model import AT
from mor.project.network.build import Network
from mor.project.observations.atmosphere import AIR
from mor.project.tables.columns import Place, Source
from mor.project.tables.sources import from_file, from_rows
from mor.quality.simulation.planted import Planted
from mor.report.edge import said, said_differences, said_values
from mor.report.results.adjusted.adjusted_project import Given, adjusted_project, grids_moved
from mor.report.results.adjusted.start_columns import Placed
from mor.report.tables.observations import named_places
from mor.units import ANGLE, ANGLE_UNITS, LENGTH, Quantity

_OF_VALUES = ("parameter", "difference")
_OF_INSTRUMENTS = (
    ("frame", GNSS_FRAME.key, GNSS_FRAME.key),
    ("lever_arm", ECCENTRICITY.key, "lever arm"),
    ("boresight", ROTATION.key, "boresight"),
    ("time_offset", TIME_OFFSET.key, TIME_OFFSET.key),
)
"""What instruments have besides: its key, the kind of its block, its part."""


def simulated_project(
    network: Network, place: Values, document: Document, source: Path, target: Path
) -> tuple[str, dict[str, Given]]:
    """YAML text of a project with the observations of the network, to stand in ``target``, and its tables.

    ``source`` is the folder of the original project; start values are those of the ``place``. Rows without any value
    are left out. Simulated distances are corrected for the air already, and their tables have none.
    """
    text_of: dict[str, Any] = {}
    tables: dict[str, Given] = {}
    for section, groups in (("observations", network.groups), ("checks", network.checks)):
        entries = getattr(network.project, section)
        if entries:
            text_of[section] = [
                _simulated(network, groups, document, source, section, number, entry, tables)
                for number, entry in enumerate(entries)
            ]
    data = {**document.data, **text_of}
    if data.get("candidates"):
        data["candidates"] = [
            entry
            if document.frame(str(entry.get("file"))) is not None
            else _where_it_stands(entry, source, target)
            for entry in data["candidates"]
        ]
    for section in ("cameras", "instruments"):
        if data.get(section):
            data[section] = {
                name: _with_observed(network, section[:-1], name, one) for name, one in data[section].items()
            }
    if data.get("world"):
        data["world"] = grids_moved(data["world"], source, target)
    data.pop("visibility", None)  # it has been worked out; its meshes stay where they are
    begun = replace(document, data=data)
    text, starts = adjusted_project(Placed(network, place), begun, target, target)
    return text, {**starts, **tables}


def _where_it_stands(entry: dict[str, Any], source: Path, target: Path) -> dict[str, Any]:
    """A table of candidates, which nobody has measured, found from the new folder."""
    if not isinstance(entry.get("file"), str):
        return entry
    file = Path(os.path.relpath(source / entry["file"], target)).as_posix()
    return {"name": entry["file"], **entry, "file": file}


def _simulated(
    network: Network,
    groups: Sequence[ObservationGroup],
    document: Document,
    source: Path,
    section: str,
    number: int,
    entry: Observations,
    tables: dict[str, Given],
) -> dict[str, Any]:
    """An entry whose table stands in a file of its own, with simulated values."""
    found = _raw(document, source, section, number, entry)
    columns = {name: cells.cast(pl.String) for name, cells in found.columns.items() if name not in AIR}
    label = entry.name or entry.file or f"{entry.type} {number + 1}"
    mine = [
        group
        for group in groups
        if len(group.lines) and (group.name, group.file) == (label, found.file) and _is_of(group, entry)
    ]
    keep = np.zeros(len(found.lines), dtype=bool)
    values: dict[str, Any] = {}
    measured: dict[str, str] = {}
    for group in mine:
        rows = _rows_of(group, found, len(mine) == 1)
        given = said_values(group, group.observed)
        keep[rows] |= np.isfinite(given).any(axis=1)
        if entry.type in _OF_VALUES:
            _put_values(group, given, rows, values, columns, len(found.lines))
            continue
        for k, component in enumerate(group.type.components):
            column = values.setdefault(component.name, np.full(len(found.lines), np.nan))
            column[rows] = np.where(np.isfinite(given[:, k]), _wrapped(group, k, given[:, k]), np.nan)
            measured[component.name] = said(group).external.units[k]
    if entry.type in _OF_VALUES:
        keep[:] = True
    frame = pl.DataFrame({**columns, **values}).with_columns(pl.col(pl.Float64).fill_nan(None))
    name = f"{section}_{number + 1}_{entry.type.replace(' ', '_')}.csv"
    kept = [c for c in frame.columns if c not in measured or frame[c].is_not_null().any()]
    tables[name] = frame.filter(pl.Series(keep)).select(kept)
    data = dict(document.data[section][number])
    for key in ("rows", "columns", "delimiter", "file", "values", "units"):
        data.pop(key, None)
    data |= {"name": label, "file": name}
    constants = {key: text for key, text in entry.values.items() if key not in {*measured, *values, *AIR}}
    type_ = mine[0].type if mine else PLAIN_TYPES.get(entry.type)
    components = {one.name: one.quantity for one in type_.components} if type_ is not None else {}
    units = _units(network, entry, components, [*columns, *constants], measured)
    covariance = data.get("covariance")
    if isinstance(covariance, str):
        data["covariance"] = str((source / covariance).resolve())
    return {**data, **({"values": constants} if constants else {}), **({"units": units} if units else {})}


def _rows_of(group: ObservationGroup, found: Source, alone: bool) -> IntArray:
    """(n,) rows of a table that the rows of a group came from: by their lines, or by names where lines hold several."""
    count = len(found.lines)
    if len(np.unique(found.lines)) == count:
        order = np.argsort(found.lines, kind="stable")
        return order[np.searchsorted(found.lines[order], group.lines)].astype(np.int64)
    if alone and group.count == count:
        return np.arange(count, dtype=np.int64)
    named = [found.columns[r.name].cast(pl.String).str.strip_chars().to_list() for r in group.type.references]
    left: dict[tuple[object, ...], list[int]] = {}
    for row, key in reversed(list(enumerate(zip(found.lines.tolist(), *named, strict=True)))):
        left.setdefault(key, []).append(row)
    own = zip(
        group.lines.tolist(), *(_as_given(names.texts().to_list()) for names in group.references), strict=True
    )
    return np.array([left[key].pop() for key in own], dtype=np.int64)


def _as_given(names: list[str]) -> list[str]:
    """Names of rows as their table has them: of a point at a time that of the point."""
    return [name.partition(AT)[0] for name in names]


def _is_of(group: ObservationGroup, entry: Observations) -> bool:
    """True for groups that an entry of this type makes."""
    if entry.type == "image":
        return is_image_point(group.type)
    return entry.type in _OF_VALUES or group.type.name == entry.type


def _put_values(
    group: ObservationGroup,
    given: FloatArray,
    rows: IntArray,
    values: dict[str, Any],
    columns: dict[str, pl.Series],
    count: int,
) -> None:
    """Values of observed parameters, each with the unit of its component."""
    texts = values.setdefault("value", columns["value"].to_list() if "value" in columns else [None] * count)
    units = said(group).external.units
    for row, line in zip(rows.tolist(), given, strict=True):
        component = int(np.flatnonzero(np.isfinite(line))[0])
        unit = units[component]
        texts[row] = f"{float(line[component])!r}{'' if unit in ('', '1') else ' ' + unit}"


def _wrapped(group: ObservationGroup, component: int, given: FloatArray) -> FloatArray:
    """Readings of full circles from 0 on."""
    internal = int(said(group).source[component])
    if not group.type.wraps[internal] or internal not in (*group.type.turns, *group.type.bearings):
        return given
    factor = float(said(group).external.factors[component])
    return np.remainder(given, 2.0 * np.pi / factor)


def _raw(document: Document, source: Path, section: str, number: int, entry: Observations) -> Source:
    """The table of an entry as it stands there; it has been read before, so that it has no mistakes."""
    at = Place(document, (section, number), source)
    found = from_rows(entry, at, []) if entry.rows is not None else from_file(entry, {}, at, [])
    assert found is not None
    return found


def _units(
    network: Network,
    entry: Observations,
    components: dict[str, Quantity],
    names: Sequence[str],
    measured: dict[str, str],
) -> dict[str, str]:
    """Units of the columns that stay as they are given, and of those that are simulated."""
    if not isinstance(entry.units, str):
        units = {key: unit for key, unit in entry.units.items() if key in names}
    else:
        units = {name: entry.units for name in names if _fits(network, entry, components, name)}
    return {**units, **{name: unit for name, unit in measured.items() if unit not in ("", "1")}}


def _fits(network: Network, entry: Observations, components: dict[str, Quantity], name: str) -> bool:
    """True for a column of numbers that the one unit of all columns fits."""
    if entry.type == "image":
        return name.startswith("sigma")
    if name.endswith("_height"):
        quantity = LENGTH
    elif name.startswith(("sigma", "cov_")) and components:
        parts = [part for part in name.split("_")[1:] if part in components]
        quantity = components[parts[0]] if parts else next(iter(components.values()))
    else:
        return name == "sigma"
    try:
        network.edge.factor(quantity, str(entry.units))
    except UnitError:
        return False
    return True


def _with_observed(network: Network, space: str, name: str, given: dict[str, Any]) -> dict[str, Any]:
    """A camera or an instrument with simulated values of what a laboratory observed."""
    result = dict(given)
    parts = network.things[space].parts
    number = network.things[space].numbers[name]
    if space == "camera":
        kind = INTERIORS[network.project.cameras[name].model].key
        places = {"interior": (kind, parts["interior"][number])}
        if result.get("eccentricity"):
            places["eccentricity"] = ("eccentricity", parts["eccentricity"][number])
        for key, (of, block) in places.items():
            if result.get(key):
                result[key] = _settings(network, of, int(block), result[key])
        if parts[READOUT.key][number] >= 0:
            readout = {READOUT.key: result["readout"]}
            result |= _settings(network, READOUT.key, int(parts[READOUT.key][number]), readout)
        return result
    for kind in ("distance meter", "refraction"):
        result = _settings(network, kind, int(parts[kind][number]), result)
    for key, of, part in _OF_INSTRUMENTS:
        if result.get(key) and parts[part][number] >= 0:
            given = result[key] if of != TIME_OFFSET.key else {key: result[key]}
            found = _settings(network, of, int(parts[part][number]), given)
            result[key] = found if of != TIME_OFFSET.key else found[key]
    return result


def _settings(network: Network, kind: str, block: int, settings: dict[str, Any]) -> dict[str, Any]:
    names = KINDS[kind].names
    result = dict(settings)
    for name, setting in settings.items():
        if name in names and isinstance(setting, dict) and "observed" in setting:
            value = float(network.observed[kind][block, names.index(name)])
            text = repr(value)
            if KINDS[kind].components[names.index(name)].quantity == ANGLE:
                unit = network.edge.default_unit(ANGLE)
                text = f"{value / ANGLE_UNITS[unit]!r} {unit}"
            result[name] = {**setting, "observed": text}
    return result


def truth_table(network: Network, place: Values) -> pl.DataFrame:
    """True values of everything, in the axes and units of the project: kind, id, component, value, unit."""
    rows = []
    edge = network.edge
    angle = edge.default_unit(ANGLE)
    for kind, values in place.items():
        blocks = network.blocks[kind]
        said_of = values
        if kind == "point":
            said_of = values @ edge.matrix
        elif blocks.kind.is_rotation:
            said_of = (
                angles_from_rotation(values @ edge.matrix if edge.turned else values) / ANGLE_UNITS[angle]
            )
        for k, name in enumerate(blocks.ids):
            for component, value in zip(blocks.kind.components, said_of[k], strict=True):
                unit = edge.default_unit(component.quantity)
                rows.append((kind, name, component.name, float(value), unit))
    schema = ["kind", "id", "component", "value", "unit"]
    return pl.DataFrame(rows, schema=schema, orient="row")


def planted_table(network: Network, errors: Sequence[Planted]) -> pl.DataFrame:
    """The errors that were planted: which observation, how much, in its unit and in units of σ."""
    rows = []
    for one in errors:
        group = network.groups[one.group]
        names = {key: column.texts()[one.row] for key, column in named_places(group).items()}
        component, unit, amount, ratio = "", "", None, None
        if one.component >= 0:
            internal = np.zeros((1, len(group.type.components)))
            internal[0, one.component] = one.amount
            out = said(group)
            k = int(np.flatnonzero(out.source == one.component)[0])
            component, unit = group.type.components[k].name, out.external.units[k]
            amount = float(said_differences(group, internal)[0, k])
            ratio = abs(one.amount / float(group.sigma[one.row, one.component]))
        rows.append(
            (
                one.kind,
                group.name,
                names.get("at", ""),
                names["from"],
                names["to"],
                component,
                amount,
                unit,
                ratio,
            )
        )
    schema = {
        **dict.fromkeys(("kind", "group", "at", "from", "to", "component"), pl.String),
        "amount": pl.Float64,
        "unit": pl.String,
        "sigmas": pl.Float64,
    }
    return pl.DataFrame(rows, schema=schema, orient="row")
