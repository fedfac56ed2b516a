"""Units and axes of a project on the way in."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from mor.model.contract import External, ObservationType
from mor.project.schema import Axes, Camera, Units
from mor.types import LARGEST, FloatArray
from mor.units import ANGLE, ANGLE_UNITS, LENGTH_UNITS, NUMBER_UNITS, PIXEL, SECOND, TIME_UNITS, Quantity, parse_dms

# ---- The edge: units and axes of the project on the way in and out.
#
# Inside: X east, Y north, Z up (right-handed), bearings clockwise from +Y, radians, the project's length
# unit, the image unit of each camera.

_NUMBER = re.compile(r"^([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ%°]\S*)?$")
_SEXAGESIMAL = re.compile(r"^[-+−]?\d+(?:\s*[-°:]\s*|\s+)\d")
"""How an angle d-m-s begins, in all its spellings; no number with a unit does."""


class UnitError(ValueError):
    """A text that is not a number, or a unit that does not fit; the words say which."""


class ImageScale(NamedTuple):
    """Form in which image coordinates of one camera are read: internal unit, pixel size, origin."""

    unit: str
    pixel: float
    """Camera units per pixel; NaN if the camera says nothing of pixels."""
    size: float
    """Millimetres per pixel; NaN if the camera says nothing of them."""
    centre: tuple[float, float]
    """Origin of the coordinates inside, px from the upper left corner: the image centre, or the corner itself."""
    corner: bool
    """True if coordinates count from the upper left corner, y down."""

    def factor(self, unit: str) -> float:
        """Camera units per given unit. Raises :class:`UnitError`."""
        if unit == self.unit:
            return 1.0
        if unit == PIXEL:
            if np.isnan(self.pixel):
                raise UnitError("pixels need image: {width, height, pixel} in the camera")
            return self.pixel
        if unit in LENGTH_UNITS and self.unit in LENGTH_UNITS:
            return LENGTH_UNITS[unit] / LENGTH_UNITS[self.unit]
        if unit in LENGTH_UNITS and self.unit == PIXEL and not np.isnan(self.size):
            return LENGTH_UNITS[unit] / (LENGTH_UNITS["mm"] * self.size)
        raise UnitError(f"unit {unit!r} does not fit image coordinates")

    @property
    def coordinate_unit(self) -> str:
        """Unit of image coordinates that say none."""
        return PIXEL if self.corner else self.unit

    def inwards(self, xy: FloatArray, unit: str) -> FloatArray:
        """Image coordinates (n, 2) in camera units, y up, from the origin inside."""
        if not self.corner:
            return xy * self.factor(unit)
        centre = np.array(self.centre) * self.factor(PIXEL)
        return np.asarray((xy * self.factor(unit) - centre) * np.array([1.0, -1.0]))


def image_scale(camera: Camera) -> ImageScale:
    """Image scale of a camera. Raises :class:`UnitError`."""
    if camera.image is None:
        if camera.coordinates == "corner":
            raise UnitError("coordinates: corner needs image: {width, height, pixel}")
        nan = float("nan")
        return ImageScale(camera.unit, nan, nan, (nan, nan), False)
    width, height = (_plain(text, PIXEL) for text in (camera.image.width, camera.image.height))
    for name, value in (("width", width), ("height", height)):
        if value <= 0.0:
            raise UnitError(f"{name}: found {value:g}, expected a number above 0")
    size = _pixel_size(camera.image.pixel, camera.unit)
    pixel = 1.0 if camera.unit == PIXEL else size / (LENGTH_UNITS[camera.unit] / LENGTH_UNITS["mm"])
    # Models whose principal point counts from the upper left corner where the image coordinates do.
    centre = (0.0, 0.0) if camera.lens in ("opencv", "fisheye") else (width / 2.0, height / 2.0)
    return ImageScale(camera.unit, pixel, size, centre, camera.coordinates == "corner")


def _pixel_size(text: str | None, unit: str) -> float:
    """Millimetres per pixel, NaN if a camera in pixels does not say. Raises :class:`UnitError`."""
    if text is None:
        if unit == PIXEL:
            return float("nan")
        raise UnitError(f"pixel: the size of a pixel is required where the unit of the camera is {unit}")
    number, own = split(text)
    if number <= 0.0:
        raise UnitError(f"pixel: found {number:g}, expected a number above 0")
    if (own or "mm") not in LENGTH_UNITS:
        raise UnitError(f"unit {own!r} does not fit a pixel size")
    return number * LENGTH_UNITS[own or "mm"] / LENGTH_UNITS["mm"]


def split(text: str) -> tuple[float, str]:
    """Number and unit (or an empty text). Raises :class:`UnitError`."""
    match = _NUMBER.match(text.strip())
    if match is None:
        raise UnitError(f"found {text!r}, expected a number, with or without a unit")
    value = float(match[1])
    if not abs(value) <= LARGEST:
        raise UnitError(beyond(text, value))
    return value, match[2] or ""


SMALLEST_SIGMA = 1e-50
"""σ of observations."""


def beyond(text: str, value: float) -> str:
    """Words for a number that is too large to be computed with."""
    expected = f"a number up to {LARGEST:g}" if np.isfinite(value) else "a finite number"
    return f"found {text!r}, expected {expected}"


def _plain(text: str, expected: str) -> float:
    number, unit = split(text)
    if unit not in ("", expected):
        raise UnitError(f"unit {unit!r} does not fit, expected {expected}")
    return number


class Edge(NamedTuple):
    """Units and axes of a project."""

    units: Units
    axes: Axes

    def default_unit(self, quantity: Quantity, image: ImageScale | None = None) -> str:
        """Unit of values that say none."""
        angle = "deg" if self.units.angle == "dms" else self.units.angle
        return quantity.unit(self.units.length, angle, image.unit if image else "mm")

    def factor(self, quantity: Quantity, unit: str, image: ImageScale | None = None) -> float:
        """Internal units per given unit (``""``: the project's). Raises :class:`UnitError` if it does not fit."""
        if quantity.time:
            return self._of_time(quantity, unit or self.default_unit(quantity))
        if quantity.length == 1 and not quantity.image:
            return self._length(unit or self.units.length)
        if quantity.angle == 1:
            if (unit or self.units.angle) not in ANGLE_UNITS:
                raise UnitError(f"unit {unit!r} does not fit an angle (known: {', '.join(ANGLE_UNITS)})")
            return ANGLE_UNITS[unit or self.units.angle]
        if quantity.image == 1 and image is not None:
            return image.factor(unit or image.unit)
        if not unit or unit == self.default_unit(quantity, image):
            return 1.0
        if quantity == Quantity() and unit in NUMBER_UNITS:
            return NUMBER_UNITS[unit]
        raise UnitError(f"unit {unit!r} does not fit, expected {self.default_unit(quantity, image)}")

    def number(self, text: str, quantity: Quantity, unit: str = "", image: ImageScale | None = None) -> float:
        """Internal value of a text; a unit in the text goes before ``unit``. Raises :class:`UnitError`."""
        if quantity == ANGLE and (unit or self.units.angle) == "dms" and _SEXAGESIMAL.match(text.strip()):
            try:
                return parse_dms(text) * ANGLE_UNITS["dms"]
            except ValueError as error:
                raise UnitError(str(error)) from None
        number, own = split(text)
        return number * self.factor(quantity, own or unit, image)

    def _length(self, unit: str) -> float:
        if unit not in LENGTH_UNITS:
            raise UnitError(f"unit {unit!r} does not fit a length (known: {', '.join(LENGTH_UNITS)})")
        return LENGTH_UNITS[unit] / LENGTH_UNITS[self.units.length]

    def _of_time(self, quantity: Quantity, unit: str) -> float:
        """Internal units per given unit of a time, or of a length or an angle per time: ``ms``, ``m/s^2``."""
        above, _, below = unit.partition("/")
        # Of the time in accelerations.
        squared = quantity.time == -2
        stripped = below.removesuffix("2").removesuffix("^") if squared and below.endswith("2") else ""
        time = above if quantity.time > 0 else stripped if squared else below
        expected = self.default_unit(quantity)
        if time not in TIME_UNITS or (quantity.time > 0 and below):
            kind = "time" if quantity.time > 0 else "rate"
            raise UnitError(f"unit {unit!r} does not fit a {kind}, expected as in {expected}")
        if quantity.time > 0:
            return TIME_UNITS[time] / TIME_UNITS[SECOND]
        whole = Quantity(quantity.length, quantity.angle)
        try:
            return self.factor(whole, above) / TIME_UNITS[time] ** -quantity.time
        except UnitError:
            raise UnitError(f"unit {unit!r} does not fit, expected as in {expected}") from None

    @property
    def metres(self) -> float:
        """Metres per length unit of the project."""
        return LENGTH_UNITS[self.units.length]

    @property
    def sense(self) -> float:
        """+1 where horizontal angles of the project count clockwise, −1 where they count counterclockwise."""
        return 1.0 if self.axes.angles == "clockwise" else -1.0

    @property
    def zero_azimuth(self) -> float:
        """Azimuth (radians, clockwise from north) from which bearings of the project count."""
        return {"north": 0.0, "east": 0.5 * np.pi, "south": np.pi, "west": 1.5 * np.pi}[self.axes.bearings_from]

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) signed permutation that takes project coordinates to internal ones."""
        compass = {"e": (1.0, 0.0), "w": (-1.0, 0.0), "n": (0.0, 1.0), "s": (0.0, -1.0)}
        x, y = (compass[letter] for letter in self.axes.xy)
        return np.array([[x[0], y[0], 0.0], [x[1], y[1], 0.0], [0.0, 0.0, 1.0]])

    @property
    def turned(self) -> bool:
        """True if ω, φ, κ against the project's axes differ from those inside: right-handed axes other than en."""
        return self.right_handed and self.axes.xy != "en"

    @property
    def right_handed(self) -> bool:
        """True if the project's axes form a right-handed system."""
        return bool(np.linalg.det(self.matrix) > 0.0)


# ---- How the components of an observation type go through the edge: axes, sense of rotation, zero of bearings.


def edge_transform(type_: ObservationType, edge: Edge) -> tuple[FloatArray, FloatArray]:
    """(m, m) signed permutation T and (m,) offset t: internal = T · given + t; given = Tᵀ · (internal − t)."""
    size = len(type_.components)
    transform, offset = np.eye(size), np.zeros(size)
    for component in type_.turns:
        transform[component, component] = edge.sense
    for component in type_.bearings:
        offset[component] = edge.zero_azimuth
    if type_.in_object_axes and size == 3:
        transform = edge.matrix
    return transform, offset


def external_image(scale: ImageScale) -> External:
    """Form in which image coordinates of a camera are reported: the unit and origin of the measurements."""
    unit = scale.coordinate_unit
    factor = scale.factor(unit)
    if not scale.corner:
        return External(np.eye(2), np.zeros(2), np.full(2, factor), (unit, unit))
    flip = np.diag([1.0, -1.0])
    return External(flip, -flip @ (np.array(scale.centre) * scale.factor("px")), np.full(2, factor), (unit, unit))


def external(type_: ObservationType, edge: Edge, scale: ImageScale | None = None) -> External:
    """Form in which the components of a type are reported: project axes, senses and units, the camera's image unit."""
    units = tuple(edge.default_unit(component.quantity, scale) for component in type_.components)
    transform, offset = edge_transform(type_, edge)
    factors = np.array([edge.factor(c.quantity, unit, scale) for c, unit in zip(type_.components, units, strict=True)])
    return External(transform, offset, factors, units)
