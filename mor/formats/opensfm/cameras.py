"""OpenSfM's cameras in mor's: where both say exactly the same.

OpenSfM's image coordinates count from the image centre, x right, y down, in units of the longer side s of the image;
its camera axes are right, down, forward (OpenSfM documentation, "Geometric Models"). With focal length f, c = f s, and
px from the upper left corner u = s x + w/2, v = s y + h/2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mor.formats.json_text import Wrong, number

Numbers = Mapping[str, float]


def camera_of(name: str, given: dict[str, Any]) -> dict[str, Any]:
    """A camera as a project file says it. Raises :class:`Wrong` if mor has no model that says the same."""
    kind = str(given.get("projection_type", "perspective"))
    if kind not in _KINDS:
        words = f"projection type {kind!r} has no counterpart in mor that says exactly the same"
        raise Wrong(f"camera {name!r}: {words} (known: {', '.join(_KINDS)})")
    values = {
        key: number(value, f"camera {name!r}: {key}")
        for key, value in given.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    width, height = (values.get(key, 0.0) for key in ("width", "height"))
    if not (0.0 < width < 1e6 and 0.0 < height < 1e6):
        raise Wrong(f"camera {name!r}: found no width and height above 0")
    model, interior = _KINDS[kind](values, max(width, height), width, height)
    first = next(iter(interior.values()))
    if not 1e-9 < first < 1e12:
        raise Wrong(f"camera {name!r}: found the focal length {first:g} px, expected it above 0")
    return {
        "model": model,
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": f"{width:.0f}", "height": f"{height:.0f}"},
        "interior": {key: {"free": repr(value)} for key, value in interior.items()},
    }


Interior = tuple[str, dict[str, float]]


def _perspective(values: Numbers, side: float, width: float, height: float) -> Interior:
    c = values.get("focal", 0.0) * side
    square = c * c or 1.0
    radial = {"A1": values.get("k1", 0.0) / square, "A2": values.get("k2", 0.0) / square**2}
    return "mor", {"c": c, **radial}


def _two_focal_lengths(values: Numbers, side: float, width: float, height: float) -> dict[str, float]:
    fx = values.get("focal_x", values.get("focal", 0.0))
    return {
        "fx": fx * side,
        "fy": values.get("focal_y", fx) * side,
        "cx": values.get("c_x", 0.0) * side + width / 2.0,
        "cy": values.get("c_y", 0.0) * side + height / 2.0,
    }


def _opencv(*names: str) -> Callable[[Numbers, float, float, float], Interior]:
    def interior(values: Numbers, side: float, width: float, height: float) -> Interior:
        focal = _two_focal_lengths(values, side, width, height)
        return "opencv", {**focal, **{name: values.get(name, 0.0) for name in names}}

    return interior


def _fisheye(*names: str) -> Callable[[Numbers, float, float, float], Interior]:
    def interior(values: Numbers, side: float, width: float, height: float) -> Interior:
        focal = _two_focal_lengths(values, side, width, height)
        return "fisheye", {**focal, **{name: values.get(name, 0.0) for name in names}}

    return interior


_KINDS: dict[str, Callable[[Numbers, float, float, float], Interior]] = {
    "perspective": _perspective,
    "brown": _opencv("k1", "k2", "p1", "p2", "k3"),
    "radial": _opencv("k1", "k2"),
    "simple_radial": _opencv("k1"),
    "fisheye": _fisheye("k1", "k2"),
    "fisheye_opencv": _fisheye("k1", "k2", "k3", "k4"),
}
"""Projection types; OpenSfM's fisheye has one focal length and its principal point in the centre, which is told."""
LOOSER = ("fisheye",)
"""Projection types whose counterpart has more unknowns."""
