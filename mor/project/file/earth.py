"""The section ``world`` of the project file: where on the earth the network is."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.project.file.scalars import Strict, Text


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
        description="Grid of geoid heights (GTX, GeoTIFF) for points without a value in their column geoid",
    )
