"""Positions and rotations of frames: own ones, shared ones, those of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.geometry.rotations import angles_from_rotation, rotation_from_angles
from mor.parameters.kinds import POINT, ROTATION
from mor.project.edge import Edge
from mor.project.network.entities import entities
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import Statuses, component_rows
from mor.project.tables.tables import Column, Rows


def positions(reading: Reading, rows: Rows, labels: list[str], fixed: Sequence[str]) -> IntArray:
    """Position block of every row: its own, or that of the point or shared position it names."""
    shop = reading.shop
    statuses = in_dimensions(component_rows(rows, POINT.components, fixed, reading.problems), reading)
    if reading.project.world is not None:
        from mor.project.world.frames import start_places  # most projects need nothing of it

        statuses = start_places(reading, rows, statuses)
    column = "position" if "position" in rows.texts else "point"
    named = rows.text(column)
    points = shop.things["point"]
    shared = shop.things.setdefault("position", entities((), {"position": np.zeros(0, dtype=np.int64)}))
    known = {name: shared.part(name, "position") for name in shared.ids}
    result = np.full(len(labels), -1, dtype=np.int64)
    new: dict[str, list[int]] = {}
    for i, name in enumerate(named):
        if name in points.numbers:
            result[i] = points.part(name, "position")
        elif name in known:
            result[i] = known[name]
        elif name:
            new.setdefault(name, []).append(i)
    own = np.flatnonzero([not name for name in named])
    inner = inwards(reading.edge, statuses)
    told = _told(reading, inner)
    block_ids = [*(labels[i] for i in own), *(f"position {name}" for name in new)]
    together = [_of_rows(inner, told, np.array(same)) for same in new.values()]
    added = shop.store("point").add(block_ids, *_stacked([inner.rows(own), *together]))
    result[own] = added[: len(own)]
    for name, block in zip(new, added[len(own) :].tolist(), strict=True):
        known[name] = block
        result[new[name]] = block
    shared_rows = np.flatnonzero([bool(name) for name in named])
    _check_shared(reading, rows, column, inner, told, shared_rows, result[shared_rows])
    shop.things["position"] = entities(known, {"position": np.array(list(known.values()), dtype=np.int64)})
    return result


def _told(reading: Reading, statuses: Statuses) -> BoolArray:
    """(n, 3) coordinates that rows fix or observe, and do not only let start somewhere."""
    if reading.project.world is not None:
        return np.zeros(statuses.free.shape, dtype=bool)  # start values are all that places on the earth have
    absent = [c not in reading.project.settings.dimensions for c in "xyz"]
    told: BoolArray = (~statuses.free | np.isfinite(statuses.sigma)) & ~np.array(absent)
    return told


def _of_rows(statuses: Statuses, told: BoolArray, rows: IntArray) -> Statuses:
    """What rows (k,) say of one position: each coordinate by the first that fixes or observes it, or has a value."""
    weight = 2 * told[rows] + np.isfinite(statuses.values[rows])
    chosen = rows[np.argmax(weight, axis=0)]
    return Statuses(*(column[chosen, np.arange(3)][None] for column in statuses))


def _stacked(parts: Sequence[Statuses]) -> Statuses:
    return Statuses(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _check_shared(
    reading: Reading,
    rows: Rows,
    column: str,
    statuses: Statuses,
    told: BoolArray,
    chosen: IntArray,
    blocks: IntArray,
) -> None:
    """Tell rows (k,) that fix or observe a coordinate of their position (k,) otherwise than it is."""
    if not told[chosen].any():
        return
    whole = reading.shop.store("point").merged()
    other = (statuses.values[chosen] != whole.values[blocks]) | (statuses.free[chosen] != whole.free[blocks])
    sigma, given = statuses.sigma[chosen], whole.sigma[blocks]
    other |= (sigma != given) & ~(np.isnan(sigma) & np.isnan(given))
    wrong = np.zeros(rows.count, dtype=bool)
    wrong[chosen] = (told[chosen] & other).any(axis=1)
    names = rows.text(column)
    tell_rows(
        reading.problems,
        wrong,
        rows,
        lambda row: f"{column}: {names[row]!r} has another value or σ where it stands first",
    )


def position_columns(reading: Reading) -> list[Column]:
    """Columns of the positions of frames besides x, y, z: on the earth those of the reference system."""
    if reading.project.world is None:
        return []
    from mor.project.world.frames import frame_columns

    return frame_columns(reading)


def in_dimensions(statuses: Statuses, reading: Reading) -> Statuses:
    """Positions whose coordinates are fixed where the network has no such dimension, at 0 where none is given."""
    absent = [c not in reading.project.settings.dimensions for c in "xyz"]
    return Statuses(
        np.where(absent, np.nan_to_num(statuses.values), statuses.values),
        statuses.free & ~np.array(absent),
        np.where(absent, np.nan, statuses.sigma),
        np.where(absent, np.nan, statuses.start),
    )


def rotations(
    reading: Reading,
    rows: Rows,
    labels: list[str],
    fixed: Sequence[str],
    level: bool = False,
    oriented: BoolArray | None = None,
) -> IntArray:
    """Rotation block of every row; levelled ones have ω = φ = 0 fixed.

    ω, φ, κ refer to project axes where these are right-handed, to east, north, up where they are not, for levelled
    frames, and where κ comes from an orientation (``oriented``).
    """
    values, free, sigma, start = component_rows(rows, ROTATION.components, fixed, reading.problems)
    if level:
        values[:, :2] = 0.0
        free[:, :2], sigma[:, :2], start[:, :2] = False, np.nan, np.nan
    as_given = np.full(len(labels), level or not reading.edge.turned)
    as_given |= oriented if oriented is not None else False
    if np.isfinite(sigma[~as_given]).any() or not free[~as_given].all():
        reading.problems.append(
            Problem("fixed or observed ω, φ, κ need axes: {xy: en}", rows.file, int(rows.lines[0]))
        )
    values[~as_given] = _turned_angles(values[~as_given], reading.edge.matrix)
    return reading.shop.store("rotation").add(labels, values, free, sigma, start)


def _turned_angles(values: FloatArray, M: FloatArray) -> FloatArray:
    """ω, φ, κ that refer to project axes, for internal axes: D ← D Mᵀ."""
    result = values.copy()
    known = np.isfinite(values).all(axis=1)
    result[known] = angles_from_rotation(rotation_from_angles(values[known]) @ M.T)
    return result


def inwards(edge: Edge, statuses: Statuses) -> Statuses:
    """Coordinates with their statuses from project axes to internal ones."""
    M = edge.matrix
    source = np.argmax(np.abs(M), axis=1)
    sign = M[np.arange(3), source]
    return Statuses(
        statuses.values[:, source] * sign,
        statuses.free[:, source],
        statuses.sigma[:, source],
        statuses.start[:, source] * sign,
    )


class Seen(NamedTuple):
    """Names of one table, where they were read."""

    names: pl.Series
    rows: Rows


def check_unique(what: str, names: list[str], rows: Rows, seen: list[Seen], problems: list[Problem]) -> None:
    """Report names that occur twice; ``seen`` remembers the names of the tables before."""
    here = pl.Series(names, dtype=pl.String)
    again = (~here.is_first_distinct()).to_numpy()
    for table in seen:
        again |= here.is_in(table.names.implode()).to_numpy()
    seen.append(Seen(here, rows))
    tell_rows(
        problems,
        again,
        rows,
        lambda row: f"{what} {names[row]!r} is given twice ({_first(seen, names[row])})",
    )


def _first(seen: list[Seen], name: str) -> str:
    """Words for the place where a name was seen first."""
    for table in seen:
        there = (table.names == name).to_numpy()
        if there.any():
            return f"first in {table.rows.file}:{int(table.rows.lines[int(np.argmax(there))])}"
    return ""
