"""Grids in the format of NTv2 (GSB) that hold a geoid: at every node N, ξ and η, as AUSGeoid has them.

Records of 16 bytes: a name of 8 characters and a value. The head of the file has 11 of them, then each subgrid has 11
and its nodes, four 32-bit numbers each (here N in m, ξ and η in ″, and one without a meaning), row by row from the
south, in a row from the east. Longitudes count to the west (Junkins and Farley, *NTv2 Developer's Guide*, 1995).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError
from mor.input_files import PROJECT, read_bytes

RECORD = 16
_RECORDS = 11
_UNITS = {"SECONDS": 1.0 / 3600.0, "MINUTES": 1.0 / 60.0, "DEGREES": 1.0}
_HIGHEST = 200.0
"""Geoid heights are within 110 m of the ellipsoid: a larger value stands for a node without one."""
_MOST_STEPS = 1e6
"""Steps along a side: no file has as many."""
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
        inside = np.all((place >= -_EDGE) & (place <= last + _EDGE), axis=0)
        place = np.where(inside, np.clip(place, 0.0, last), 0.0)
        i, j = np.minimum(place, last - 1.0).astype(int)
        up, left = (place - [i, j])[:, :, None]
        lower = self.nodes[i, j] * (1.0 - left) + self.nodes[i, j + 1] * left
        upper = self.nodes[i + 1, j] * (1.0 - left) + self.nodes[i + 1, j + 1] * left
        values: FloatArray = np.where(inside[:, None], lower * (1.0 - up) + upper * up, np.nan)
        return values


_EDGE = 1e-6
"""Steps beyond an edge that round-off of its coordinates may amount to."""


def read_gsb(file: Path) -> list[Subgrid]:
    """The subgrids of a file, the finest last. Raises :class:`GridError`."""
    try:
        content = read_bytes(file, PROJECT)
    except InputError as error:
        raise GridError(error.problems[0].message) from None
    order = next(
        (sign for sign in "<>" if content[:12] == b"NUM_OREC" + struct.pack(sign + "i", _RECORDS)), ""
    )
    if not order or len(content) < _RECORDS * RECORD:
        raise GridError("this is no binary grid of the format NTv2 (GSB)")
    count = struct.unpack_from(order + "i", content, 2 * RECORD + 8)[0]
    unit = _UNITS.get(content[3 * RECORD + 8 : 4 * RECORD].decode("latin-1").strip("\0 "))
    if unit is None:
        raise GridError("its angles (GS_TYPE) are none of SECONDS, MINUTES, DEGREES")
    grids, start = [], _RECORDS * RECORD
    for _ in range(count):
        grid, start = _subgrid(content, start, order, np.radians(unit))
        grids.append(grid)
    return sorted(grids, key=lambda grid: -grid.steps[0])


def _subgrid(content: bytes, start: int, order: str, unit: float) -> tuple[Subgrid, int]:
    """One subgrid and where the next one begins."""
    first = start + _RECORDS * RECORD
    if len(content) < first:
        raise GridError("it ends before the head of a subgrid does")
    south, north, east, west, step, step_west = (
        struct.unpack_from(order + "d", content, start + k * RECORD + 8)[0] for k in range(4, 10)
    )
    count = struct.unpack_from(order + "i", content, start + 10 * RECORD + 8)[0]
    if not np.isfinite([south, north, east, west, step, step_west]).all() or not (
        step > 0.0 and step_west > 0.0
    ):
        raise GridError("its limits are no numbers, or its steps (LAT_INC, LONG_INC) not above 0")
    with np.errstate(over="ignore"):
        sizes = np.array([north - south, west - east]) / [step, step_west]
    if not (np.abs(sizes) < _MOST_STEPS).all():
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
    values[np.abs(nodes[:, :, 0]) > _HIGHEST] = np.nan
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
