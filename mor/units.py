"""Units of measured and estimated quantities.

Inside the program there are only the project's length unit, radians and the image unit of each camera.
Everything else is converted at the edge, on the way in and out, with the factors of this module.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

LENGTH_UNITS = {
    "m": 1.0,
    "dm": 1e-1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "μm": 1e-6,
    "km": 1e3,
    "ft": 0.3048,
    "us-ft": 1200.0 / 3937.0,
    "in": 0.0254,
}
"""Metres per unit."""

ANGLE_UNITS = {
    "rad": 1.0,
    "mrad": 1e-3,
    "gon": math.pi / 200.0,
    "mgon": math.pi / 200e3,
    "cc": math.pi / 2e6,
    "deg": math.pi / 180.0,
    "arcmin": math.pi / 10800.0,
    "arcsec": math.pi / 648000.0,
    "dms": math.pi / 180.0,
}
"""Radians per unit. ``dms`` is written ``d-m-s`` and behaves as degrees once read."""

NUMBER_UNITS = {"1": 1.0, "ppm": 1e-6, "%": 1e-2}

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "h": 3600.0}
"""Seconds per unit."""

PIXEL = "px"
SECOND = "s"


class Quantity(NamedTuple):
    """Physical dimension as exponents of object length, angle, image length and time."""

    length: int = 0
    angle: int = 0
    image: int = 0
    time: int = 0

    def unit(self, length: str, angle: str, image: str) -> str:
        """Unit of this quantity in words, for headers: ``"mm"``, ``"gon"``, ``"1/mm^2"``, ``"m/s"``, ``"1"``."""
        powers = ((length, self.length), (angle, self.angle), (image, self.image), (SECOND, self.time))
        above = [_power(u, e) for u, e in powers if e > 0]
        below = [_power(u, -e) for u, e in powers if e < 0]
        if below:
            return f"{' '.join(above) or '1'}/{' '.join(below)}"
        return " ".join(above) or "1"


def _power(unit: str, exponent: int) -> str:
    return unit if exponent == 1 else f"{unit}^{exponent}"


NUMBER = Quantity()
LENGTH = Quantity(length=1)
ANGLE = Quantity(angle=1)
IMAGE = Quantity(image=1)
TIME = Quantity(time=1)
SPEED = Quantity(length=1, time=-1)
TURN_RATE = Quantity(angle=1, time=-1)


class Component(NamedTuple):
    """A named component of a parameter block or of an observation, with its physical dimension."""

    name: str
    quantity: Quantity
    default: float = 0.0


_DMS = re.compile(
    r"^\s*(?P<sign>[-+−]?)(?P<d>\d+)(?:[-°:\s]\s*(?P<m>\d+(?:\.\d*)?)(?:[-'′:\s]\s*(?P<s>\d+(?:\.\d*)?)[\"″]?)?['′]?)?°?\s*$"
)


def parse_dms(text: str) -> float:
    """Angle in degrees from ``d-m-s``, ``d°m's"`` or ``d:m:s`` text.

    Raises ``ValueError`` when the text is no such angle or minutes or seconds reach 60.
    """
    match = _DMS.match(text)
    if match is None:
        raise ValueError(f"{text!r} is not an angle d-m-s")
    minutes, seconds = float(match["m"] or 0.0), float(match["s"] or 0.0)
    if minutes >= 60.0 or seconds >= 60.0:
        raise ValueError(f"{text!r}: minutes and seconds must stay below 60")
    value = float(match["d"]) + minutes / 60.0 + seconds / 3600.0
    return -value if match["sign"] in ("-", "−") else value
