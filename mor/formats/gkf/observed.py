"""GNU Gama's names and units of observation components."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.networks.terrestrial import circle_in_face_one, zenith_in_face_one

GON = np.pi / 200.0
CC = GON / 1e4
"""Radians per gon and per cc; the σ of lengths are mm."""


class Part(NamedTuple):
    """Element, attribute, and value in face one (internal units) of a component."""

    element: str
    attribute: str
    value: Callable[[FloatArray, FloatArray], FloatArray]
    """Of observed values (n,) and faces (n,)."""


def _same(value: FloatArray, face: FloatArray) -> FloatArray:
    return value


def _from_horizon(value: FloatArray, face: FloatArray) -> FloatArray:
    return np.pi / 2 - value


PARTS: dict[str, tuple[Part, ...]] = {
    "horizontal_distance": (Part("distance", "val", _same),),
    "distance": (Part("s-distance", "val", _same),),
    "directions": (Part("direction", "val", circle_in_face_one),),
    "zenith_directions": (
        Part("direction", "val", circle_in_face_one),
        Part("z-angle", "val", zenith_in_face_one),
    ),
    "angle": (Part("angle", "val", _same),),
    "bearing": (Part("azimuth", "val", _same),),
    "zenith_angle": (Part("z-angle", "val", zenith_in_face_one),),
    "vertical_direction": (Part("z-angle", "val", _from_horizon),),
    "height_difference": (Part("dh", "val", _same),),
    "vector": tuple(Part("vec", name, _same) for name in ("dx", "dy", "dz")),
    "coordinates": tuple(Part("point", name, _same) for name in "xyz"),
}
"""Types that GNU Gama has, with their components in order."""
NAMES = {
    "angle": {"at": "from", "from": "bs", "to": "fs"},
    "coordinates": {"point": "id"},
}
"""Attributes of references that are not called as here."""
