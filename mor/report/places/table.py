"""Points of a network on the earth: in its reference system, above ellipsoid and geoid, geocentric."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.project.world.world import World
from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.tables.shared import once
from mor.units import ANGLE_UNITS

ANGULAR = ("latitude", "longitude")


@once
def place_table(solved: Solved) -> pl.DataFrame:
    """One row for each point, in the units of the project; angles of a project in d-m-s in degrees.

    Coordinates in the reference system, σ east, north, up in the horizon of the point (in the datum of the adjustment),
    height above the ellipsoid, geoid height and height above the geoid where it is known, geocentric coordinates.
    """
    network = solved.network
    world, things = network.world, network.things["point"]
    if world is None:
        return pl.DataFrame()
    numbers = things.parts["position"]
    positions = solved.adjustment.values["point"][numbers].copy()
    if "point" in network.absent:
        positions[network.absent["point"][numbers]] = np.nan
    N = world.geoid_at(numbers, positions)
    unit = ANGLE_UNITS[angle_unit(solved)]
    columns: dict[str, Any] = {"id": list(things.ids)}
    for name, column in zip(world.system.coordinates, world.from_object(positions, N).T, strict=True):
        columns[name] = column / unit if name in ANGULAR else column
    for name, column in zip(("east", "north", "up"), _sigma(solved, world, positions).T, strict=True):
        columns[f"s{name}"] = column
    height = world.horizon.to_geodetic(positions)[:, 2]
    columns |= {"ellipsoidal_height": height, "geoid": N, "orthometric_height": height - N}
    for name, column in zip("XYZ", world.horizon.to_geocentric(positions).T, strict=True):
        columns[f"geocentric_{name.lower()}"] = column
    return pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))


def _sigma(solved: Solved, world: World, positions: FloatArray) -> FloatArray:
    """σ (n, 3) east, north, up at positions (n, 3), NaN if there is no solution."""
    if solved.quality is None:
        return np.full(positions.shape, np.nan)
    numbers = solved.network.things["point"].parts["position"]
    axes = world.horizon.local_axes(positions)
    covariance = solved.quality.cofactors["point"][numbers] * solved.quality.sigma_factor**2
    variances = np.einsum("nij,njk,nik->ni", axes, covariance, axes)
    sigma: FloatArray = np.sqrt(np.maximum(variances, 0.0))
    return sigma
