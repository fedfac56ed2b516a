"""Sensors of Metashape as cameras, and back: frame cameras in model ``metashape``, with its own numbers."""

from __future__ import annotations

from typing import Any

from mor.formats.draft import number
from mor.formats.xml import Element

NAMES = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")


class SensorError(ValueError):
    """A mistake in a sensor."""


def camera_of(sensor: Element) -> tuple[dict[str, Any], bool]:
    """A camera as a project file says it, and whether its interior is fixed.

    What Metashape estimated (the parameters of its covariance) is free; without that, all that is not 0. Raises
    :class:`SensorError`.
    """
    kind = sensor.attributes.get("type", "frame")
    if kind != "frame":
        raise SensorError(
            f"type {kind!r} has no counterpart in mor that says exactly the same (known: frame)"
        )
    calibration = _calibration(sensor)
    size = next(iter((calibration.all("resolution") if calibration else []) + sensor.all("resolution")), None)
    if size is None:
        raise SensorError("found no resolution")
    width, height = (_number(size.attributes.get(key, ""), key) for key in ("width", "height"))
    if min(width, height) < 1.0:
        raise SensorError("found a resolution below 1 px")
    values = _values(calibration, sensor, width)
    held = any(
        p.attributes.get("name") == "fixed" and p.attributes.get("value") in ("true", "1")
        for p in sensor.all("property")
    )
    free = () if held else _estimated(calibration, values)
    interior = {
        name: {"free" if name in free else "fixed": repr(value)}
        for name, value in values.items()
        if value or name in free or name in ("f", "cx", "cy")
    }
    camera = {
        "model": "metashape",
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": f"{width:.0f}", "height": f"{height:.0f}"},
        "interior": interior,
    }
    return camera, not free


def _number(text: str, what: str) -> float:
    try:
        return number(text)
    except ValueError as error:
        raise SensorError(f"{what}: {error}") from None


def _calibration(sensor: Element) -> Element | None:
    """The adjusted calibration, else the initial one."""
    found = {c.attributes.get("class", "adjusted"): c for c in sensor.all("calibration")}
    return found.get("adjusted") or found.get("initial") or next(iter(found.values()), None)


def _values(calibration: Element | None, sensor: Element, width: float) -> dict[str, float]:
    texts = {child.name: child.text.strip() for child in calibration.children} if calibration else {}
    values = {name: _number(texts[name], name) if texts.get(name) else 0.0 for name in NAMES}
    if texts.get("fx") and not texts.get("f"):
        fx, fy = _number(texts["fx"], "fx"), _number(texts.get("fy", texts["fx"]), "fy")
        values["f"], values["b1"] = fy, fx - fy
        for name, size in (("cx", "width"), ("cy", "height")):
            resolution = next(iter(calibration.all("resolution") if calibration else []), None)
            half = _number(resolution.attributes.get(size, "0"), size) / 2.0 if resolution else 0.0
            values[name] -= half if values[name] else 0.0
    if not values["f"]:
        values["f"] = _from_properties(sensor, width)
    if not 1e-6 < values["f"] < 1e9:
        raise SensorError(f"found the focal length {values['f']:g} px, expected it above 0")
    return values


def _from_properties(sensor: Element, width: float) -> float:
    """Focal length of a sensor without calibration: in mm by the size of a pixel, or the width of the image."""
    given = {p.attributes.get("name"): p.attributes.get("value", "") for p in sensor.all("property")}
    if given.get("focal_length") and given.get("pixel_width"):
        return _number(given["focal_length"], "focal_length") / (
            _number(given["pixel_width"], "pixel_width") or 1.0
        )
    return width


def _estimated(calibration: Element | None, values: dict[str, float]) -> tuple[str, ...]:
    if calibration is not None:
        for covariance in calibration.all("covariance"):
            for params in covariance.all("params"):
                return tuple(name for name in params.text.split() if name in NAMES)
    return tuple(name for name in NAMES if values[name] or name in ("f", "cx", "cy"))
