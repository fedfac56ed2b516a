"""Total station and level of the simulated scenes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sample_projects.simulate.geometry import Array, Frame, rotation


class Sight(NamedTuple):
    """What a total station reads: horizontal circle and zenith angle in radians, distance."""

    horizontal: float
    zenith: float
    distance: float


def theodolite(mark: Array, height: float, orientation: float, tilt: tuple[float, float] = (0.0, 0.0)) -> Frame:
    """A theodolite above a mark; ``orientation`` is the bearing of the zero of its circle, all angles in radians."""
    levelled = rotation(0.0, 0.0, -orientation)
    return Frame(mark + np.array([0.0, 0.0, height]), rotation(*tilt, 0.0) @ levelled)


def sight(instrument: Frame, target: Array) -> Sight:
    """Error-free readings to a target, face one: directions clockwise, zenith angles from the upright axis."""
    x, y, z = instrument.D @ (target - instrument.position)
    across = float(np.hypot(x, y))
    return Sight(float(np.arctan2(x, y)), float(np.arctan2(across, z)), float(np.hypot(across, z)))


def read(true: Sight, sigma: Sight, random: np.random.RandomState, second_face: bool = False) -> Sight:
    """Readings with noise of the given σ; circles from 0 to 2π, in face two turned over."""
    horizontal, zenith, distance = (t + s * random.standard_normal() for t, s in zip(true, sigma, strict=True))
    if second_face:
        horizontal, zenith = horizontal + np.pi, 2.0 * np.pi - zenith
    return Sight(horizontal % (2.0 * np.pi), zenith, distance)


def with_centring(sigma: Sight, distance: float, ppm: float, instrument: float, target: float) -> Sight:
    """σ of readings over a distance, with the part per million of the distance and the centring errors added."""
    off = float(np.hypot(instrument, target))
    turned = off / distance
    along = float(np.sqrt(sigma.distance**2 + (ppm * 1e-6 * distance) ** 2 + off**2))
    return Sight(float(np.hypot(sigma.horizontal, turned)), float(np.hypot(sigma.zenith, turned)), along)
