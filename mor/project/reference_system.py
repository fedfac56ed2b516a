"""Reference systems, grids of geoid heights and deflections, and the world of a project."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mor.errors import InputError
from mor.input_files import PROJECT, note_file, read_bytes
from mor.model.earth import Ellipsoid, Horizon
from mor.model.geodetic import DEFLECTIONS, GEOID
from mor.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from pyproj import CRS


# ---- Grids in the format of NTv2 (GSB) that hold a geoid: at every node N, ξ and η, as AUSGeoid has them.
#
# Records of 16 bytes: a name of 8 characters and a value. The head of the file has 11 of them, then each
# subgrid has 11 and its nodes, four 32-bit numbers each (here N in m, ξ and η in ″, and one without a
# meaning), row by row from the south, in a row from the east. Longitudes count to the west (Junkins and
# Farley, *NTv2 Developer's Guide*, 1995).

RECORD = 16
_RECORDS = 11
ARCSEC = np.pi / (180.0 * 3600.0)


class GridError(ValueError):
    """A file that is no such grid; the words say why."""


class Subgrid(NamedTuple):
    """Values at equal steps of latitude and longitude, radians."""

    south: float
    east: float
    """Its longitude, positive to the east."""
    steps: tuple[float, float]
    """To the north and to the west."""
    nodes: FloatArray
    """(rows from the south, columns from the east, 3): N (m), ξ, η (radians); NaN if there is none."""

    def at(self, geodetic: FloatArray) -> FloatArray:
        """(n, 3) N, ξ, η at latitudes and longitudes (n, 2 or more), bilinear; NaN beyond its edges."""
        rows, columns = self.nodes.shape[:2]
        to_west = np.remainder(self.east - geodetic[:, 1] + 1e-12, 2.0 * np.pi) - 1e-12
        with np.errstate(over="ignore"):  # steps may be as small as a file says
            place = np.stack([(geodetic[:, 0] - self.south) / self.steps[0], to_west / self.steps[1]])
        last = np.array([[rows - 1.0], [columns - 1.0]])
        # Steps beyond an edge that round-off of its coordinates may amount to.
        edge = 1e-6
        inside = np.all((place >= -edge) & (place <= last + edge), axis=0)
        place = np.where(inside, np.clip(place, 0.0, last), 0.0)
        i, j = np.minimum(place, last - 1.0).astype(int)
        up, left = (place - [i, j])[:, :, None]
        lower = self.nodes[i, j] * (1.0 - left) + self.nodes[i, j + 1] * left
        upper = self.nodes[i + 1, j] * (1.0 - left) + self.nodes[i + 1, j + 1] * left
        return np.asarray(np.where(inside[:, None], lower * (1.0 - up) + upper * up, np.nan))


def read_gsb(file: Path) -> list[Subgrid]:
    """The subgrids of a file, the finest last. Raises :class:`GridError`."""
    try:
        content = read_bytes(file, PROJECT)
    except InputError as error:
        raise GridError(error.problems[0].message) from None
    order = next((sign for sign in "<>" if content[:12] == b"NUM_OREC" + struct.pack(sign + "i", _RECORDS)), "")
    if not order or len(content) < _RECORDS * RECORD:
        raise GridError("this is not a binary grid of the format NTv2 (GSB)")
    count = struct.unpack_from(order + "i", content, 2 * RECORD + 8)[0]
    units = {"SECONDS": 1.0 / 3600.0, "MINUTES": 1.0 / 60.0, "DEGREES": 1.0}
    unit = units.get(content[3 * RECORD + 8 : 4 * RECORD].decode("latin-1").strip("\0 "))
    if unit is None:
        raise GridError("its angles (GS_TYPE) are none of SECONDS, MINUTES, DEGREES")
    grids, start = [], _RECORDS * RECORD
    for _ in range(count):
        grid, start = _subgrid(content, start, order, np.radians(unit))
        grids.append(grid)
    return sorted(grids, key=lambda grid: -grid.steps[0])


def _subgrid(content: bytes, start: int, order: str, unit: float) -> tuple[Subgrid, int]:
    first = start + _RECORDS * RECORD
    if len(content) < first:
        raise GridError("it ends before the head of a subgrid does")
    south, north, east, west, step, step_west = (
        struct.unpack_from(order + "d", content, start + k * RECORD + 8)[0] for k in range(4, 10)
    )
    count = struct.unpack_from(order + "i", content, start + 10 * RECORD + 8)[0]
    if not np.isfinite([south, north, east, west, step, step_west]).all() or not (step > 0.0 and step_west > 0.0):
        raise GridError("its limits are not numbers, or its steps (LAT_INC, LONG_INC) not above 0")
    with np.errstate(over="ignore"):
        sizes = np.array([north - south, west - east]) / [step, step_west]
    # Steps along a side: no file has as many.
    if not (np.abs(sizes) < 1e6).all():
        raise GridError("its limits and steps (LAT_INC, LONG_INC) make more nodes than a file can have")
    rows, columns = (round(float(size)) + 1 for size in sizes)
    if rows < 2 or columns < 2 or rows * columns != count:
        raise GridError(f"its limits and steps make {rows} by {columns} nodes, and GS_COUNT is {count}")
    behind = first + RECORD * count
    if len(content) < behind:
        raise GridError(f"it ends before its {count} nodes do")
    nodes = np.frombuffer(content, order + "f4", 4 * count, first).reshape(rows, columns, 4)
    with np.errstate(invalid="ignore"):  # what stands for no value may be no number
        values = nodes[:, :, :3] * np.array([1.0, ARCSEC, ARCSEC])
    # Geoid heights are within 110 m of the ellipsoid: a larger value stands for a node without one.
    values[np.abs(nodes[:, :, 0]) > 200.0] = np.nan
    return Subgrid(south * unit, -east * unit, (step * unit, step_west * unit), values), behind


def values_at(file: Path, geodetic: FloatArray) -> FloatArray:
    """(n, 3) N (m), ξ, η (radians) at latitudes and longitudes (n, 2 or more; radians), of the finest subgrid there.

    NaN if none reaches. Raises :class:`GridError`.
    """
    result = np.full((len(geodetic), 3), np.nan)
    for grid in read_gsb(file):
        found = grid.at(np.nan_to_num(geodetic))
        known = np.isfinite(found).all(axis=1) & np.isfinite(geodetic[:, :2]).all(axis=1)
        result[known] = found[known]
    return result


# ---- Geoid heights and deflections of the vertical out of grid files: GTX and GeoTIFF through PROJ, GSB by ourselves.


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
            raise GridError("only a GSB grid holds both deflections, else give one file for north, one for east")
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


# ---- A coordinate reference system: coordinates of a project to latitude, longitude, height of its ellipsoid and back.
#
# No datum is ever changed here: a projection is undone within its own datum, and heights are taken as they are.


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
        # Names of coordinates by the kind of system.
        return {
            "geographic": ("latitude", "longitude", "height"),
            "projected": ("east", "north", "height"),
            "geocentric": ("x", "y", "z"),
        }[self.kind]

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
        # Degrees by which networks may reach beyond the area a system is made for.
        margin = 2.0
        with np.errstate(over="ignore", invalid="ignore"):  # what is no angle at all does not lie inside
            latitude, longitude = np.degrees(geodetic[:, :2]).T
            east = (longitude - area.west + margin) % 360.0
        width = (area.east - area.west) % 360.0 or 360.0
        north = (latitude >= area.south - margin) & (latitude <= area.north + margin)
        return np.asarray(~(north & (east <= width + 2.0 * margin)))


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
        words = f"found {_short(text)}, expected a coordinate reference system that PROJ knows, e.g. EPSG:25832"
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
        raise ReferenceSystemError(f"{words}; a local system needs no world, and one on the earth needs its ellipsoid")
    if any(axis.direction.lower() in ("south", "west") for axis in crs.axis_info[:2]):
        raise ReferenceSystemError(f"the axes of {crs.name!r} count to the south or west, expected north and east")
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


# ---- Reference system, object system, verticals and geoid of a network on the earth.


@dataclass(frozen=True)
class EarthModel:
    """The earth under a network. Lengths are in the unit of the project."""

    system: ReferenceSystem
    horizon: Horizon
    metres: float
    """Metres per unit of length."""
    orthometric: bool
    """True if heights of points are above the geoid."""
    extent: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """(2, 2) least and largest object coordinates x, y of the points whose places are given."""
    geoid: Path | None = None
    """Grid of geoid heights."""
    at_points: dict[str, FloatArray] = field(default_factory=dict)
    """(points,) by block: N, ξ, η; NaN if unknown. Points that were read later are not in it."""

    def of_points(self, name: str, blocks: IntArray) -> FloatArray:
        """(n,) ξ, η (0 where nothing is given) or N (NaN if nothing is given) of point blocks."""
        known = self.at_points.get(name, np.zeros(0))
        result = np.full(len(blocks), np.nan if name == GEOID else 0.0)
        inside = (blocks >= 0) & (blocks < len(known))
        result[inside] = known[blocks[inside]]
        return np.nan_to_num(result) if name in DEFLECTIONS else result

    def geoid_at(self, blocks: IntArray, positions: FloatArray) -> FloatArray:
        """N (n,) of point blocks at object coordinates (n, 3): as given, else of the grid there, else NaN."""
        N = self.of_points(GEOID, blocks)
        missing = np.isnan(N) & np.isfinite(positions).all(axis=1)
        if self.geoid is not None and missing.any():
            N[missing] = geoid_heights(self.geoid, self.horizon.to_geodetic(positions[missing])) / self.metres
        return N

    def to_object(self, coordinates: FloatArray, geoid: FloatArray) -> FloatArray:
        """Object coordinates (n, 3) of coordinates (n, 3) in the system; lengths and radians."""
        geodetic = self.system.to_geodetic(self.in_metres(coordinates))
        geodetic[:, 2] = geodetic[:, 2] / self.metres
        if self.orthometric:
            geodetic[:, 2] += geoid
        return self.horizon.from_geodetic(geodetic)

    def inside(self) -> FloatArray:
        """Coordinates (3,) in the system of the origin of the object system, at height 0: a place for what has none."""
        return np.asarray(self.from_object(np.zeros((1, 3)), np.zeros(1))[0])

    def in_metres(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates (n, 3) in the system with their lengths (not their angles) in metres."""
        return _scaled(self.system, coordinates, self.metres)

    def grid(self, position: FloatArray) -> FloatArray:
        """∂(east, north)/∂(e, n) (n, 2, 2) at object coordinates (n, 3): scale and convergence of the projection."""
        axes, nothing = self.horizon.local_axes(position), np.zeros(len(position))
        columns = []
        # Length over which a projection is differentiated: its scale changes by 1/R for every unit.
        step = 10.0
        for k in range(2):
            ahead, behind = (self.from_object(position + sign * step * axes[:, k], nothing) for sign in (1, -1))
            columns.append((ahead - behind)[:, :2] / (2.0 * step))
        return np.stack(columns, axis=2)

    def convergence(self, east_north: FloatArray) -> FloatArray:
        """(n,) direction of grid north, clockwise from true north, where coordinates (n, 2) of a projection are."""
        there = np.hstack([east_north, np.zeros((len(east_north), 1))])
        by_local = self.grid(self.to_object(there, np.zeros(len(there))))
        # Grid north keeps east as it is: it leads along (e, n) with ∂E/∂e e + ∂E/∂n n = 0.
        return np.asarray(np.arctan2(-by_local[:, 0, 1], by_local[:, 0, 0]))

    def from_object(self, position: FloatArray, geoid: FloatArray) -> FloatArray:
        """Coordinates (n, 3) in the system of object coordinates (n, 3); the way back of :meth:`to_object`."""
        geodetic = self.horizon.to_geodetic(position)
        if self.orthometric:
            geodetic[:, 2] -= geoid
        geodetic[:, 2] *= self.metres
        return _scaled(self.system, self.system.from_geodetic(geodetic), 1.0 / self.metres)


def _scaled(system: ReferenceSystem, coordinates: FloatArray, factor: float) -> FloatArray:
    lengths = [1.0 if name in ("latitude", "longitude") else factor for name in system.coordinates]
    return np.asarray(coordinates * np.array(lengths))


def middle(ellipsoid: Ellipsoid, geodetic: FloatArray) -> Horizon:
    """The object system at the middle of places (n, 3), rounded."""
    directions = np.mean(ellipsoid.geocentric(geodetic), axis=0)
    latitude, longitude, _ = np.degrees(ellipsoid.geodetic(directions[None])[0])
    # Degrees to which the middle of a network is rounded: the object system stays the same when a digit changes.
    step = 1e-4
    rounded = np.radians(np.round(np.array([latitude, longitude]) / step) * step)
    return Horizon(ellipsoid, float(rounded[0]), float(rounded[1]))
