"""Geoid heights and deflections of the vertical out of grid files: GTX and GeoTIFF through PROJ, GSB by ourselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.input_files import note_file
from mor.project.world.gsb import ARCSEC, GridError, values_at

__all__ = ["GridError", "deflections", "geoid_heights"]


def geoid_heights(file: Path, geodetic: FloatArray) -> FloatArray:
    """N (n,), m, at latitudes and longitudes (n, 3; radians), bilinear, NaN if the grid does not reach.

    Raises :class:`GridError`.
    """
    return values_at(file, geodetic)[:, 0] if _is_gsb(file) else _of_proj(file, geodetic)


def deflections(files: tuple[Path, ...], geodetic: FloatArray) -> FloatArray:
    """ξ, η (n, 2), radians, of one GSB grid, or of one grid of arc seconds (GTX, GeoTIFF) for each of them.

    Raises :class:`GridError`.
    """
    if len(files) == 1:
        if not _is_gsb(files[0]):
            raise GridError(
                "only a GSB grid holds both deflections, else give one file for north, one for east"
            )
        return values_at(files[0], geodetic)[:, 1:]
    return np.stack([_of_proj(file, geodetic) for file in files], axis=1) * ARCSEC


def _is_gsb(file: Path) -> bool:
    _check_there(file)
    return file.suffix.lower() == ".gsb"


def _check_there(file: Path) -> None:
    if not file.is_file():
        raise GridError("this file does not exist")


def _of_proj(file: Path, geodetic: FloatArray) -> FloatArray:
    """Values (n,) of a grid with one value at each node, NaN if it does not reach."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    _check_there(file)
    known = np.all(np.isfinite(geodetic[:, :2]), axis=1)
    values = np.full(len(geodetic), np.nan)
    try:
        grid = Transformer.from_pipeline(f'+proj=vgridshift +grids="{file.resolve()}" +multiplier=1')
        latitude, longitude = np.where(known[:, None], geodetic[:, :2], 0.0).T
        shifted = grid.transform(longitude, latitude, np.zeros(len(values)), radians=True)[2]
    except ProjError:
        raise GridError("PROJ cannot read it as a grid of heights (GTX or GeoTIFF)") from None
    note_file(file)
    good = known & np.isfinite(shifted)
    values[good] = np.asarray(shifted)[good]
    return values
