"""Bearings in the plane of a projection: of the straight line between both ends there, clockwise from grid north.

The projection is a polynomial in the object coordinates x, y of the feet on the ellipsoid, in Chebyshev form over the
area of the network, so that the solver knows of no library of projections:

    (E, N) = Σ c_ij T_i(ξ) T_j(η),   t = atan2(E_to − E_from, N_to − N_from).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import FROM_TO
from mor.observations._contract import Computed, ObservationType, Slot
from mor.observations.earth.arcs import foot_with_derivatives
from mor.observations.terrestrial.bearing import BEARING

KEY = "projected_bearing"


class Plane(NamedTuple):
    """A projection as a polynomial over a rectangle of object coordinates."""

    middle: FloatArray
    """(2,) of the rectangle."""
    half: FloatArray
    """(2,) its sides, halved."""
    coefficients: FloatArray
    """(d + 1, d + 1, 2) of E and N, less those of a place of the area."""
    crs: str | None = None
    """What names the projection; ``None`` that of the network."""

    def holds(self, xy: FloatArray) -> BoolArray:
        """(n,) false where a foot (n, 2) is beyond the rectangle."""
        return np.asarray((np.abs(xy - self.middle) <= self.half).all(axis=1))

    def at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """E, N (n, 2), less those of that place, at feet (n, 2), and their derivatives (n, 2, 2).

        Beyond the rectangle it goes on linearly.
        """
        from numpy.polynomial import chebyshev  # no network without a projection waits for it

        place = (xy - self.middle) / self.half
        inside = np.clip(place, -1.0, 1.0)
        x, y = inside.T
        values = np.asarray(chebyshev.chebval2d(x, y, self.coefficients)).T
        by = [
            np.asarray(chebyshev.chebval2d(x, y, chebyshev.chebder(self.coefficients, axis=k))).T
            / self.half[k]
            for k in range(2)
        ]
        derivatives = np.stack(by, axis=2)
        values = values + np.einsum("nij,nj->ni", derivatives, (place - inside) * self.half)
        return values, derivatives


@dataclass(frozen=True, eq=False)
class InPlane:
    """The equation of a bearing in the plane of a projection."""

    horizon: Horizon
    plane: Plane

    def __call__(self, blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        """t of n lines, from blocks of both ends."""
        ends, moves = [], []
        for position in blocks:
            foot, by_position = foot_with_derivatives(self.horizon, position)
            there, by_foot = self.plane.at(foot[:, :2])
            ends.append(there)
            moves.append(by_foot @ by_position[:, :2])
        east, north = (ends[1] - ends[0]).T
        by_plane = np.stack([north, -east], axis=1) / (east**2 + north**2)[:, None]
        by_ends = [np.einsum("ni,nij->nj", by_plane, move)[:, None, :] for move in moves]
        return Computed(np.arctan2(east, north)[:, None], (-by_ends[0], by_ends[1]))


def projected_bearing(horizon: Horizon, plane: Plane) -> ObservationType:
    """t in the plane of a projection."""
    return open_projection()._replace(equation=InPlane(horizon, plane))


def open_projection() -> ObservationType:
    """The type before anything says which projection is meant."""
    slots = tuple(Slot("point", end, "position") for end in ("from", "to"))
    return BEARING._replace(key=KEY, references=FROM_TO, slots=slots, equation=_open)


def _open(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    raise AssertionError("a projection is still to be named")


def is_open(type_: ObservationType) -> bool:
    """Return True if the projection is still to be named."""
    return type_.equation is _open
