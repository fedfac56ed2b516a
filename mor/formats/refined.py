"""Image coordinates as programs of aerial triangulation take them: millimetres, without distortion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.undistort import ideal_rays
from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content, given_points, image_tables, interior_values, unit_of
from mor.geometry.cameras import CAMERA_MODELS
from mor.project.edge import image_scale
from mor.project.file.model import Camera
from mor.units import LENGTH_UNITS

_PLAIN = ("c", "xh", "yh")


class RefinedCamera(NamedTuple):
    """A camera that has nothing but these, mm."""

    c: float
    xh: float
    yh: float
    corrected: bool
    """True if coordinates were freed of distortion."""


class RefinedPoints(NamedTuple):
    """Image points: names, mm from the image centre (y up), σ in mm; (n,), (n, 2)."""

    images: list[str]
    points: list[str]
    xy: FloatArray
    sigma: FloatArray


def refined(
    content: Content, used: dict[str, str], what: str
) -> tuple[dict[str, RefinedCamera], RefinedPoints]:
    """Cameras, and image points freed of what their interior orientations have besides c, xh, yh, as they start.

    ``used`` has the camera of each image. Raises :class:`InputError` for cameras without c, xh, yh or a size in mm,
    and for image points whose distortion cannot be taken away; ``what`` cannot say them.
    """
    problems: list[Problem] = []
    cameras: dict[str, RefinedCamera] = {}
    for name, camera in content.project.cameras.items():
        try:
            cameras[name] = _camera(content, camera)
        except ValueError as error:
            words = f"camera {name}: {what} has c, xh and yh in mm: {error}"
            problems.append(content.place("cameras", name).problem(words))
    if problems:
        raise InputError(problems)
    found = _points(content, used, cameras)
    if not found.images:
        words = f"{what} has image blocks; this project has no image points"
        raise InputError([Problem(words, content.document.file)])
    return cameras, found


def _millimetres(content: Content, camera: Camera) -> float:
    """Millimetres of a unit of the camera. Raises ``ValueError``."""
    scale = image_scale(camera, content.project.units)
    per = LENGTH_UNITS[scale.unit] / LENGTH_UNITS["mm"] if scale.unit in LENGTH_UNITS else scale.size
    if np.isnan(per):
        raise ValueError("it has no image: {width, height, pixel} with the size of a pixel in mm")
    return float(per)


def _camera(content: Content, camera: Camera) -> RefinedCamera:
    model = CAMERA_MODELS[camera.model]
    if tuple(component.name for component in model.components[:3]) != _PLAIN or not model.central:
        raise ValueError(f"model {camera.model} has others")
    if camera.image_variant or camera.eccentricity:
        raise ValueError("it has image-variant parameters or an eccentricity")
    per = _millimetres(content, camera)
    values = interior_values(camera, content.edge, image_scale(camera, content.project.units))
    distorted = any(value for name, value in values.items() if name not in _PLAIN)
    c, xh, yh = (values.get(name, 0.0) * per for name in _PLAIN)
    return RefinedCamera(c, xh, yh, distorted)


def _points(content: Content, used: dict[str, str], cameras: dict[str, RefinedCamera]) -> RefinedPoints:
    images: list[str] = []
    points: list[str] = []
    xys, sigmas = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for entry, rows, place in image_tables(content):
        image = rows.text("image")
        unknown = next((name for name in image if name not in used), None)
        if unknown is not None:
            raise InputError([place.problem(f"image {unknown!r} is not among the images")])
        given, sigma = given_points(entry, rows)
        names = np.array([used[name] for name in image])
        for name in dict.fromkeys(names.tolist()):
            camera, mine = content.project.cameras[name], names == name
            scale, per = (
                image_scale(camera, content.project.units),
                _millimetres(content, camera),
            )
            inside = scale.inwards(given[mine], unit_of(entry, "x", scale))
            if cameras[name].corrected:
                inside = _freed(content, camera, inside)
            if not np.isfinite(inside).all():
                words = f"camera {name}: the distortion of image points cannot be taken away"
                raise InputError([place.problem(words)])
            given[mine] = inside * per
            sigma[mine] *= scale.factor(unit_of(entry, "sigma", scale)) * per
        images += image
        points += rows.text("point")
        xys.append(given)
        sigmas.append(sigma)
    return RefinedPoints(images, points, np.concatenate(xys), np.concatenate(sigmas))


def _freed(content: Content, camera: Camera, xy: FloatArray) -> FloatArray:
    """Coordinates (n, 2) without distortion, in the unit of the camera; NaN if there is no ray."""
    model = CAMERA_MODELS[camera.model]
    scale = image_scale(camera, content.project.units)
    values = interior_values(camera, content.edge, scale)
    interior = np.array([values.get(component.name, 0.0) for component in model.components])
    constants = np.array(
        [
            content.edge.number(getattr(camera, constant.name) or "0", constant.quantity, "", scale)
            for constant in model.constants
        ]
    )
    every, all_constants = (np.tile(row, (len(xy), 1)) for row in (interior, constants))
    rays = ideal_rays(model, interior[None], np.zeros(len(xy), dtype=np.int64), all_constants, xy)
    back = model.project(rays, every, all_constants, xy).xy
    ideal: FloatArray = interior[1:3] - interior[0] * rays[:, :2] / rays[:, 2:]
    wrong = np.abs(back - xy).max(axis=1) > 1e-6 * interior[0]
    ideal[wrong] = np.nan
    return ideal
