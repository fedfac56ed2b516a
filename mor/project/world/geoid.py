"""Geoid heights out of a grid file (GTX, GeoTIFF), through PROJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.input_files import note_file


class GeoidError(ValueError):
    """A grid that cannot be read; the words say why."""


def geoid_heights(file: Path, geodetic: FloatArray) -> FloatArray:
    """N (n,), m, at latitudes and longitudes (n, 3; radians), NaN where the grid does not reach.

    Raises :class:`GeoidError`.
    """
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    if not file.is_file():
        raise GeoidError("this file does not exist")
    known = np.all(np.isfinite(geodetic[:, :2]), axis=1)
    N = np.full(len(geodetic), np.nan)
    try:
        grid = Transformer.from_pipeline(f'+proj=vgridshift +grids="{file.resolve()}" +multiplier=1')
        latitude, longitude = np.where(known[:, None], geodetic[:, :2], 0.0).T
        shifted = grid.transform(longitude, latitude, np.zeros(len(N)), radians=True)[2]
    except ProjError:
        raise GeoidError("PROJ cannot read it as a grid of heights (GTX or GeoTIFF)") from None
    note_file(file)
    good = known & np.isfinite(shifted)
    N[good] = np.asarray(shifted)[good]
    return N
