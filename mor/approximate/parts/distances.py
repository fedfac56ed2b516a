"""Horizontal distances and vertical directions between positions, ready for look-ups."""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.part import Part
from mor.approximate.terrestrial.sights import Terrestrial


class Distances:
    """Horizontal distances between two positions, as far as they are measured or follow from slope and vertical.

    Where the part is not ``scaled`` there are none, and heights of instruments and targets do not count.
    """

    def __init__(self, measured: Terrestrial, scaled: bool):
        self.lifts = scaled
        self.horizontal: dict[tuple[int, int], float] = {}
        self.slope: dict[tuple[int, int], tuple[float, float]] = {}
        self.vertical: dict[tuple[int, int], tuple[float, float]] = {}
        self.neighbours: dict[int, set[int]] = {}
        self.sigma: dict[tuple[int, int], float] = {}
        """By the two ends, the smaller number first."""
        self._collect_verticals(measured)
        self._as_arrays()
        if not scaled:
            return
        for lengths in (measured.horizontals, measured.slopes):
            ends = zip(lengths.start.tolist(), lengths.end.tolist(), strict=True)
            self.sigma |= {
                (min(a, b), max(a, b)): s for (a, b), s in zip(ends, lengths.sigma.tolist(), strict=True)
            }
        for a, b, s in zip(
            measured.horizontals.start,
            measured.horizontals.end,
            measured.horizontals.value[:, 0],
            strict=True,
        ):
            self._put(self.horizontal, int(a), int(b), float(s))
        slopes = measured.slopes
        for a, b, ha, hb, s in zip(
            slopes.start, slopes.end, slopes.start_height, slopes.end_height, slopes.value[:, 0], strict=True
        ):
            rise = float(ha - hb)
            self.slope[int(a), int(b)], self.slope[int(b), int(a)] = (float(s), rise), (float(s), -rise)
            self._meet(int(a), int(b))

    def _collect_verticals(self, measured: Terrestrial) -> None:
        v = measured.verticals
        for a, b, ha, hb, value in zip(
            v.start, v.end, v.start_height, v.end_height, v.value[:, 0], strict=True
        ):
            self.vertical[int(a), int(b)] = (float(value), self._lift(ha - hb))
        for sight in measured.sights:
            for b, hb, value in zip(sight.points, sight.heights, sight.verticals, strict=True):
                if np.isfinite(value):
                    self.vertical[sight.position, int(b)] = (float(value), self._lift(sight.height - hb))

    def _as_arrays(self) -> None:
        self.ends = np.array(list(self.vertical), dtype=np.int64).reshape(-1, 2)
        steep = np.array(list(self.vertical.values())).reshape(-1, 2)
        self.tangents, self.rises = np.tan(steep[:, 0]), steep[:, 1]

    def _lift(self, rise: float) -> float:
        """Heights of instrument and target, which count only in the length unit."""
        return float(rise) if self.lifts else 0.0

    def _put(self, where: dict[tuple[int, int], float], a: int, b: int, value: float) -> None:
        where[a, b] = where[b, a] = value
        self._meet(a, b)

    def _meet(self, a: int, b: int) -> None:
        self.neighbours.setdefault(a, set()).add(b)
        self.neighbours.setdefault(b, set()).add(a)

    def verticals_at(self, point: int) -> list[tuple[int, bool, float, float]]:
        """Other end, whether it was measured there, vertical direction and rise, of all sights from and to a point."""
        found = []
        for row in np.flatnonzero((self.ends == point).any(axis=1)).tolist():
            a, b = self.ends[row].tolist()
            found.append((a if b == point else b, b == point, *self.vertical[a, b]))
        return found

    def between(self, part: Part, a: int, b: int) -> float:
        """Horizontal distance from a to b, NaN where it is not known."""
        if (a, b) in self.horizontal:
            return self.horizontal[a, b]
        if (a, b) not in self.slope:
            return float("nan")
        slope, rise = self.slope[a, b]
        for one, other in ((a, b), (b, a)):
            if (one, other) in self.vertical:
                return slope * float(np.cos(self.vertical[one, other][0]))
        dz = part.points[b, 2] - part.points[a, 2] - rise
        if np.isfinite(dz):
            return float(np.sqrt(max(slope**2 - dz**2, 0.0)))
        return float("nan")
