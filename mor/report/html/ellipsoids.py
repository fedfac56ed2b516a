"""Error ellipsoids of the table of points: covariances, and where their semi-axes point to."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.project.edge import Edge
from mor.project.file.model import Axes, Units
from mor.quality.precision.ellipses import error_ellipsoids
from mor.report.tables.ellipses import bearings_of
from mor.report.view import View
from mor.units import ANGLE_UNITS

_FLAT = 1e-6
"""Part of the longest semi-axis below which an ellipsoid has no extent along another, which then has no direction."""
DIRECTIONS = tuple(f"ellipsoid_{which}_{axis}" for axis in "abc" for which in ("azimuth", "elevation"))
"""Columns of the directions, a semi-axis after the other."""


def covariances(view: View) -> FloatArray:
    """(n, 3, 3) covariance matrices of the table of points, project axes."""
    points = view.points.fill_null(0.0)
    sigma = points.select("sx", "sy", "sz").to_numpy()
    matrix = np.tile(np.eye(3), (points.height, 1, 1))
    for name, (i, j) in {"rxy": (0, 1), "rxz": (0, 2), "ryz": (1, 2)}.items():
        matrix[:, i, j] = matrix[:, j, i] = points[name].to_numpy()
    covariance: FloatArray = matrix * sigma[:, :, None] * sigma[:, None, :]
    return covariance


def directions_of_semi_axes(view: View) -> pl.DataFrame:
    """Azimuth and elevation of the semi-axes a, b, c of each point, as ``ellipses`` of the text report has them.

    Azimuths as the project counts bearings, elevations above the horizontal plane, in its unit of angles, to a tenth.
    Nothing for semi-axes without length.
    """
    edge = Edge(Units(**view.summary["units"]), Axes(**view.summary["axes"]))
    unit = edge.units.angle
    inside = edge.matrix @ covariances(view) @ edge.matrix.T
    space = error_ellipsoids(np.nan_to_num(inside))
    there = space.axes > _FLAT * space.axes[:, :1]
    columns = {}
    for k, axis in enumerate("abc"):
        parts = (bearings_of(edge, unit, space.azimuths[:, k]), space.elevations[:, k] / ANGLE_UNITS[unit])
        for which, values in zip(("azimuth", "elevation"), parts, strict=True):
            shown = np.where(there[:, k], np.round(values, _DECIMALS.get(unit, 1)), np.nan)
            columns[f"ellipsoid_{which}_{axis}"] = shown
    return pl.DataFrame(columns, schema=dict.fromkeys(DIRECTIONS, pl.Float64))


_DECIMALS = {"rad": 3, "mrad": 0, "mgon": 0}
