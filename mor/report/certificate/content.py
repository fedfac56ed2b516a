"""Content of a camera certificate as plain data."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.errors import InputError, Problem, nearest
from mor.geometry.cameras import CAMERA_MODELS
from mor.parameters.kinds import INTERIORS
from mor.report.html.derived import image_points
from mor.report.html.figures.layout import small_unit
from mor.report.tables.distortion import RadialCurve, radial_curve
from mor.report.view import View
from mor.units import LENGTH_UNITS

ROWS = 12
"""Rows of the table of distortion, at most."""


class Certificate(NamedTuple):
    """A camera of an adjustment: its parameters, its distortion and what they rest on. Lengths in ``unit``."""

    view: View
    camera: dict[str, Any]
    units: dict[str, str]
    """Unit of each component."""
    images: int
    rays: int
    rms: float
    """Root mean square of the residuals of image coordinates."""
    covered: float
    """Distance from the principal point up to which points were measured."""
    corner: float | None
    """Distance of the farthest corner of the image from the principal point; ``None`` without a format."""
    curve: RadialCurve
    """Up to the corner, or what is covered."""
    table: RadialCurve
    """The same at round radii."""

    @property
    def unit(self) -> str:
        """Unit of the interior orientation."""
        return str(self.camera["unit"])

    @property
    def small(self) -> tuple[str, float]:
        """Unit and factor of distortions."""
        return small_unit(self.unit, float(np.abs(self.curve.shift).max(initial=0.0)))


def certificate(view: View, name: str) -> Certificate:
    """The certificate of a camera. Raises :class:`InputError` for an unknown one, or one without image points."""
    cameras = {camera["id"]: camera for camera in view.cameras}
    if name not in cameras:
        known = f" (known: {', '.join(cameras)})" if cameras else ""
        raise InputError([Problem(f"unknown camera {name!r}{nearest(name, cameras)}{known}")])
    camera = cameras[name]
    if not CAMERA_MODELS[camera["model"]].central:
        words = (
            f"camera {name} is of the model {camera['model']}, whose images have no radial distortion; the report "
            "has its parameters"
        )
        raise InputError([Problem(words)])
    images = view.images.filter(pl.col("camera") == name)
    measured = image_points(view).join(images.select(pl.col("id").alias("image")), on="image", how="semi")
    measured = measured.filter(~pl.col("flag").str.contains("excluded|check"))
    if not measured.height:
        raise InputError([Problem(f"camera {name} has no image points: there is nothing to certify")])
    radii = _radii(camera, measured)
    covered, corner = float(np.nanmax(radii)), _corner(camera)
    largest = max(covered, corner or 0.0)
    residuals = measured.select("vx", "vy").to_numpy() * _per_unit(camera, str(measured["unit"][0]))
    quantities = {component.name: component.quantity for component in INTERIORS[camera["model"]].components}
    return Certificate(
        view=view,
        camera=camera,
        units={key: quantities[key].unit("m", "rad", camera["unit"]) for key in camera["components"]},
        images=images.height,
        rays=measured.height,
        rms=float(np.sqrt(np.nanmean(residuals**2))),
        covered=covered,
        corner=corner,
        curve=radial_curve(camera, largest),
        table=_at_round_radii(camera, largest),
    )


def _per_unit(camera: dict[str, Any], unit: str) -> float:
    """Units of the camera in one of its image coordinates."""
    if unit == camera["unit"]:
        return 1.0
    if unit == "px":
        return float(camera["format"]["pixel"])
    return LENGTH_UNITS[unit] / LENGTH_UNITS[camera["unit"]]


def _principal_point(camera: dict[str, Any]) -> FloatArray:
    """(2,) from where the camera counts it: the image centre, y up, or the corner, y down."""
    values = camera["components"]
    names = ("cx", "cy") if "cx" in values else ("xh", "yh")
    return np.array([values[name]["value"] if name in values else 0.0 for name in names])


def _radii(camera: dict[str, Any], measured: pl.DataFrame) -> FloatArray:
    """Distances of image points from the principal point, in the unit of the camera."""
    xy = measured.select("x", "y").to_numpy() * _per_unit(camera, str(measured["unit"][0]))
    radii: FloatArray = np.linalg.norm(
        xy - _origin(camera) - _principal_point(camera) * _senses(camera), axis=1
    )
    return radii


def _is_corner(camera: dict[str, Any]) -> bool:
    """Return True if image coordinates count from the upper left corner, y down."""
    size = camera.get("format")
    return size is not None and size["origin"] == "corner"


def _counts_from_corner(camera: dict[str, Any]) -> bool:
    """Return True if the principal point does, too."""
    return _is_corner(camera) and "cx" in camera["components"]


def _origin(camera: dict[str, Any]) -> FloatArray:
    """(2,) where the principal point counts from, in image coordinates."""
    if not _is_corner(camera) or _counts_from_corner(camera):
        return np.zeros(2)
    size = camera["format"]
    middle: FloatArray = np.array([size["width"], size["height"]]) * size["pixel"] / 2.0
    return middle


def _senses(camera: dict[str, Any]) -> FloatArray:
    down = _is_corner(camera) and not _counts_from_corner(camera)
    return np.array([1.0, -1.0 if down else 1.0])


def _corner(camera: dict[str, Any]) -> float | None:
    size = camera.get("format")
    if size is None:
        return None
    half = np.array([size["width"], size["height"]]) * size["pixel"] / 2.0
    centre = _principal_point(camera) - (half if _counts_from_corner(camera) else 0.0)
    return float(np.hypot(*(half + np.abs(centre))))


def _at_round_radii(camera: dict[str, Any], largest: float) -> RadialCurve:
    """The curve at multiples of 1, 2 or 5 times a power of ten, and at its end."""
    power = 10.0 ** np.floor(np.log10(largest / ROWS))
    step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power * ROWS >= largest)
    count = int(np.floor(largest / step * (1.0 + 1e-12)))
    return radial_curve(camera, count * step, count + 1)
