"""A coordinate reference system: coordinates of a project to latitude, longitude, height of its ellipsoid and back.

No datum is ever changed here: a projection is undone within its own datum, and heights are taken as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.geometry.earth import Ellipsoid

if TYPE_CHECKING:
    from pyproj import CRS

COORDINATES = {
    "geographic": ("latitude", "longitude", "height"),
    "projected": ("east", "north", "height"),
    "geocentric": ("x", "y", "z"),
}
"""Names of coordinates by the kind of system."""


class ReferenceSystemError(ValueError):
    """The text does not name a reference system on the earth."""


@dataclass(frozen=True)
class ReferenceSystem:
    """A system with an ellipsoid. Coordinates are in metres and radians whatever its own units are."""

    crs: CRS
    kind: str
    """``geographic``, ``projected`` or ``geocentric``."""
    vertical: str
    """Name of the heights of a compound system, else empty."""

    @property
    def name(self) -> str:
        """Name by its authority, e.g. ``ETRS89 / UTM zone 32N (EPSG:25832)``."""
        authority = self.crs.to_authority()
        return f"{self.crs.name} ({':'.join(authority)})" if authority else str(self.crs.name)

    @property
    def urn(self) -> str:
        """Name as a URN, e.g. ``urn:ogc:def:crs:EPSG::25832``; empty if no authority has it."""
        authority = self.crs.to_authority()
        return f"urn:ogc:def:crs:{authority[0]}::{authority[1]}" if authority else ""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its three coordinates."""
        return COORDINATES[self.kind]

    @property
    def ellipsoid(self) -> Ellipsoid:
        """Its ellipsoid, metres."""
        ellipsoid = self.crs.ellipsoid
        assert ellipsoid is not None  # reference_system sees to it
        inverse = ellipsoid.inverse_flattening
        return Ellipsoid(ellipsoid.semi_major_metre, 1.0 / inverse if inverse else 0.0)

    @cached_property
    def _transformer(self) -> Any:
        """Between the plane of a projection (east, north) and degrees (longitude, latitude) of its own datum."""
        from pyproj import Transformer

        return Transformer.from_crs(self.crs, self.crs.geodetic_crs, always_xy=True)

    @property
    def _metres(self) -> float:
        return float(self.crs.axis_info[0].unit_conversion_factor)

    def to_geodetic(self, coordinates: FloatArray) -> FloatArray:
        """Latitude, longitude, height (n, 3) of coordinates (n, 3) as :attr:`coordinates` names them."""
        if self.kind == "geographic":
            return coordinates.copy()
        if self.kind == "geocentric":
            return self.ellipsoid.geodetic(coordinates)
        plane = coordinates[:, :2] / self._metres
        longitude, latitude = self._transformer.transform(plane[:, 0], plane[:, 1])
        degrees = np.stack([latitude, longitude], axis=1)
        return np.concatenate([np.radians(degrees), coordinates[:, 2:]], axis=1)

    def from_geodetic(self, geodetic: FloatArray) -> FloatArray:
        """The coordinates (n, 3) of latitude, longitude, height (n, 3)."""
        if self.kind == "geographic":
            return geodetic.copy()
        if self.kind == "geocentric":
            return self.ellipsoid.geocentric(geodetic)
        degrees = np.degrees(geodetic[:, :2])
        plane = self._transformer.transform(degrees[:, 1], degrees[:, 0], direction="INVERSE")
        return np.concatenate([np.stack(plane, axis=1) * self._metres, geodetic[:, 2:]], axis=1)

    def outside(self, geodetic: FloatArray) -> BoolArray:
        """(n,) true where a place lies outside the area the system is made for; nowhere where that is not known."""
        area = self.crs.area_of_use
        if area is None:
            return np.zeros(len(geodetic), dtype=bool)
        with np.errstate(over="ignore", invalid="ignore"):  # what is no angle at all does not lie inside
            latitude, longitude = np.degrees(geodetic[:, :2]).T
            east = (longitude - area.west + _MARGIN) % 360.0
        width = (area.east - area.west) % 360.0 or 360.0
        north = (latitude >= area.south - _MARGIN) & (latitude <= area.north + _MARGIN)
        outside: BoolArray = ~(north & (east <= width + 2.0 * _MARGIN))
        return outside


_MARGIN = 2.0
"""Degrees by which networks may reach beyond the area a system is made for."""


def reference_system(text: str) -> ReferenceSystem:
    """The system that a text (EPSG code, WKT, PROJ string) names. Raises :class:`ReferenceSystemError`."""
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        words = "coordinate reference systems need pyproj, which is not installed: pip install mor-adjustment[earth]"
        raise ReferenceSystemError(words) from None
    try:
        whole = CRS.from_user_input(text)
    except CRSError:
        words = (
            f"found {_short(text)}, expected a coordinate reference system that PROJ knows, e.g. EPSG:25832"
        )
        raise ReferenceSystemError(words) from None
    vertical = ""
    crs = whole
    if whole.is_compound:
        crs, *others = whole.sub_crs_list
        vertical = others[0].name
    if crs.is_bound and crs.source_crs is not None:
        crs = crs.source_crs
    kind = _kind(crs)
    if not kind or crs.geodetic_crs is None or crs.ellipsoid is None:
        words = f"{crs.name!r} has no datum: it does not say where on the earth its coordinates are"
        raise ReferenceSystemError(
            f"{words}; a local system needs no world, and one on the earth needs its ellipsoid"
        )
    if any(axis.direction.lower() in ("south", "west") for axis in crs.axis_info[:2]):
        words = f"the axes of {crs.name!r} count to the south or west, expected north and east"
        raise ReferenceSystemError(words)
    return ReferenceSystem(crs, kind, vertical)


def _kind(crs: CRS) -> str:
    if crs.is_geocentric:
        return "geocentric"
    if crs.is_geographic:
        return "geographic"
    return "projected" if crs.is_projected else ""


def _short(text: str) -> str:
    line = text.splitlines()[0] if text else ""
    return repr(line[:60] + "…" if len(line) > 60 else line)
