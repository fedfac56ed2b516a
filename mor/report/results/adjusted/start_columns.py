"""Columns of the tables of start values: value, σ and start of every component, as the project would give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.rotations import angles_from_rotation
from mor.observations.earth import DEFLECTIONS, GEOID
from mor.parameters.index import Values
from mor.parameters.kinds import KINDS, POINT, ROTATION, BlockKind
from mor.project.network.build import Network
from mor.project.network.set_ups import shared_column
from mor.project.world.frames import place_names
from mor.units import ANGLE, ANGLE_UNITS


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


def plain_columns(
    placed: Placed, kind: str, numbers: IntArray, names: Sequence[str]
) -> dict[str, FloatArray]:
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
            self.names + other.names,
            np.hstack([self.free, other.free]),
            np.hstack([self.barred, other.barred]),
        )

    def of_table(self, rows: IntArray | slice) -> list[str]:
        """Names that are free in a table of these rows."""
        named = np.asarray(self.free[rows].any(axis=0) & ~self.barred[rows].any(axis=0))
        return [name for name, free in zip(self.names, named, strict=True) if free]


def unknown_constants(
    placed: Placed, kind: BlockKind, numbers: IntArray, own: BoolArray, any_: BoolArray
) -> Unknown:
    """Unknowns among the constants of the frames (n,) that have ``own`` ones; ``any_`` are those that may have any."""
    free = placed.network.blocks[kind.key].free[numbers]
    observed = np.isfinite(placed.network.sigma[kind.key][numbers])
    return Unknown(kind.names, free & ~observed & own[:, None], (observed | ~own[:, None]) & any_[:, None])


def _shared_names(placed: Placed, numbers: IntArray) -> list[str]:
    """Names of the points or shared positions that frames stand on; empty if a position is a frame's own."""
    names: dict[int, str] = {}
    for space in ("position", "point"):
        things = placed.network.things.get(space)
        if things is not None:
            here = np.flatnonzero(np.isin(things.parts["position"], numbers))
            names |= {int(things.parts["position"][i]): things.ids[i] for i in here}
    return [names.get(int(n), "") for n in numbers]


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
    return {
        shared: _shared_names(placed, positions),
        **places,
        **angle_columns(placed, rotations, edge.matrix if edge.turned and not level else np.eye(3)),
    }
