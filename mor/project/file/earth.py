"""The sections ``world`` and ``curvature`` of the project file: where on the earth the network is, or on a sphere."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.project.file.scalars import Measure, Strict, Text


class DeflectionGrids(Strict):
    """Grids of the deflections of the vertical, arc seconds."""

    north: Text = Field(description="Grid of ξ, north positive (GTX, GeoTIFF; arc seconds)")
    east: Text = Field(description="Grid of η, east positive (GTX, GeoTIFF; arc seconds)")


class Origin(Strict):
    """Where the object system is in the horizon, at height 0."""

    latitude: Measure = Field(
        description="Latitude, in the unit of angles or with one of its own (49.6412 deg)"
    )
    longitude: Measure = Field(description="Longitude, likewise")


class World(Strict):
    """Where on the earth the network is: the points are given in a coordinate reference system of the earth."""

    crs: Text = Field(
        description="Coordinate reference system of the points: EPSG code (EPSG:25832, compound EPSG:25832+7837) or WKT"
    )
    heights: Literal["ellipsoidal", "orthometric"] | None = Field(
        default=None,
        description="What heights of points are above: the ellipsoid or the geoid; where crs does not say it",
    )
    geoid: Text | None = Field(
        default=None,
        description="Grid of geoid heights (GTX, GeoTIFF, GSB) for points without a value in their column geoid",
    )
    deflections: Text | DeflectionGrids | None = Field(
        default=None,
        description="Grid of deflections of the vertical for points without values in their columns: a GSB file with "
        "geoid heights and deflections, or one grid each for north and east",
    )
    origin: Origin | None = Field(
        default=None,
        description="Origin of the object system; by itself it is the middle of the points, rounded to 0.0001°",
    )


class SphereOrigin(Strict):
    """Where the sphere is: plan coordinates of a point, and the height at which distances are those of the plan."""

    x: Measure = Field(description="x in the axes of the project")
    y: Measure = Field(description="y in the axes of the project")
    z: Measure = Field(
        description="Height of the sphere: distances at this height are those between coordinates"
    )


class Curvature(Strict):
    """The sphere under a local network; true alone is the mean radius of the earth, 6371 km."""

    radius: Measure | None = Field(default=None, description="Radius, e.g. 6381 km; default 6371 km")
    latitude: Measure | None = Field(
        default=None,
        description="In place of the radius: latitude, whose Gaussian mean radius on GRS80 is taken (48 deg)",
    )
    origin: SphereOrigin | None = Field(
        default=None,
        description="Origin of the sphere; by itself the median of the given coordinates, rounded to a metre",
    )
