"""The parts of a COLMAP model: cameras, images, rigs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mor.formats.content import interior_values
from mor.formats.draft import FLIP
from mor.model.rotations import quaternions, rotation_of_quaternion
from mor.project.axes import Edge, ImageScale, image_scale, split
from mor.project.schema import Camera
from mor.types import FloatArray, IntArray
from mor.units import IMAGE

# ---- The content of a COLMAP model, as text or binary files (COLMAP documentation, "Output Format").

NO_POINT = -1
"""Point of an image point that belongs to none."""


class ColmapCamera(NamedTuple):
    """A camera: parameters in px, counted from the upper left corner of the upper left pixel."""

    id: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]
    line: int = 0


class QuaternionPose(NamedTuple):
    """A movement x' = R(q) x + t; q = (w, x, y, z)."""

    quaternion: tuple[float, float, float, float]
    translation: tuple[float, float, float]


class ColmapImage(NamedTuple):
    """An image: its pose (camera from world) and image points."""

    id: int
    pose: QuaternionPose
    camera: int
    name: str
    xy: FloatArray
    """(n, 2), px."""
    points: IntArray
    """(n,) numbers of the object points, −1 where there is none."""
    line: int = 0


class Sensor(NamedTuple):
    """A camera of a rig, with its pose from that of the reference camera where it is known."""

    camera: int
    pose: QuaternionPose | None


class Rig(NamedTuple):
    """Cameras fixed to each other; the first is the reference."""

    id: int
    sensors: tuple[Sensor, ...]


class RigFrame(NamedTuple):
    """Images a rig took at one time."""

    id: int
    rig: int
    images: tuple[int, ...]


@dataclass(frozen=True)
class ColmapModel:
    """A whole model."""

    cameras: list[ColmapCamera]
    images: list[ColmapImage]
    point_ids: IntArray
    point_xyz: FloatArray
    rigs: list[Rig] = field(default_factory=list)
    frames: list[RigFrame] = field(default_factory=list)


def empty_points() -> tuple[FloatArray, IntArray]:
    """Image points of an image that has none."""
    return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)


# ---- Poses: COLMAP's quaternions and translations, mor's rotations and projection centres.


def ours(pose: QuaternionPose) -> tuple[FloatArray, FloatArray]:
    """Rotation D (3, 3), object to image axes, and projection centre (3,): x = R X + t is D = F R, X0 = −Rᵀ t."""
    R = rotation_of_quaternion(np.array(pose.quaternion))
    return FLIP @ R, -(R.T @ np.array(pose.translation))


def relative(pose: QuaternionPose) -> tuple[FloatArray, FloatArray]:
    """Rotation D* and base b* of a stereo follower: x_B = R x_A + t is X*_B = D* (X*_A − b*), D* = F R F."""
    D = FLIP @ rotation_of_quaternion(np.array(pose.quaternion)) @ FLIP
    return D, -(D.T @ FLIP @ np.array(pose.translation))


def theirs(D: FloatArray, centre: FloatArray) -> FloatArray:
    """Quaternions and translations (n, 7) of rotations (n, 3, 3), object to image axes, and centres (n, 3)."""
    R = FLIP @ D
    translation = -np.einsum("nij,nj->ni", R, centre)
    return np.concatenate([quaternions(R), translation], axis=1)


# ---- COLMAP's camera models in mor's: where both say exactly the same.
#
# COLMAP's axes are right, down, forward, its image coordinates px from the upper left corner of the upper left pixel.
# With u = X/Z, v = Y/Z and r² = u² + v² (COLMAP source, ``sensor/models.h``):
#
# * one focal length and radial distortion is model ``mor``: c = f, A1 = k1/f², A2 = k2/f⁴, xh = cx − w/2, yh
#   = h/2 − cy;
# * OPENCV and FULL_OPENCV are ``opencv``, OPENCV_FISHEYE and FISHEYE are ``fisheye``, with their own numbers
#   and names;
# * FOV, THIN_PRISM_FISHEYE and RAD_TAN_THIN_PRISM_FISHEYE are models of the same names, with their own numbers;
# * fisheyes with one focal length are ``fisheye`` with fx = fy = f at first, two unknowns there.


class ColmapCameraModel(NamedTuple):
    """A camera model: its number in binary files, its parameters, and the model of mor that says it."""

    number: int
    parameters: tuple[str, ...]
    ours: str = ""


_TWO, _ONE = ("fx", "fy", "cx", "cy"), ("f", "cx", "cy")
MODELS: dict[str, ColmapCameraModel] = {
    "SIMPLE_PINHOLE": ColmapCameraModel(0, _ONE, "mor"),
    "PINHOLE": ColmapCameraModel(1, _TWO, "opencv"),
    "SIMPLE_RADIAL": ColmapCameraModel(2, (*_ONE, "k1"), "mor"),
    "RADIAL": ColmapCameraModel(3, (*_ONE, "k1", "k2"), "mor"),
    "OPENCV": ColmapCameraModel(4, (*_TWO, "k1", "k2", "p1", "p2"), "opencv"),
    "OPENCV_FISHEYE": ColmapCameraModel(5, (*_TWO, "k1", "k2", "k3", "k4"), "fisheye"),
    "FULL_OPENCV": ColmapCameraModel(6, (*_TWO, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), "opencv"),
    "FOV": ColmapCameraModel(7, (*_TWO, "omega"), "fov"),
    "SIMPLE_RADIAL_FISHEYE": ColmapCameraModel(8, (*_ONE, "k1"), "fisheye"),
    "RADIAL_FISHEYE": ColmapCameraModel(9, (*_ONE, "k1", "k2"), "fisheye"),
    "THIN_PRISM_FISHEYE": ColmapCameraModel(
        10, (*_TWO, "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"), "thin-prism-fisheye"
    ),
    "RAD_TAN_THIN_PRISM_FISHEYE": ColmapCameraModel(
        11,
        (*_TWO, "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
        "rad-tan-thin-prism-fisheye",
    ),
    "SIMPLE_DIVISION": ColmapCameraModel(12, (*_ONE, "k1")),
    "DIVISION": ColmapCameraModel(13, (*_TWO, "k1")),
    "SIMPLE_FISHEYE": ColmapCameraModel(14, _ONE, "fisheye"),
    "FISHEYE": ColmapCameraModel(15, _TWO, "fisheye"),
    "EUCM": ColmapCameraModel(16, (*_TWO, "alpha", "beta")),
    "EQUIRECTANGULAR": ColmapCameraModel(17, ("w", "h")),
}
"""Camera models by name."""
LOST = {
    "SIMPLE_DIVISION": "it divides by 1 + k1 r² at the distorted coordinates, mor's models multiply",
    "DIVISION": "it divides by 1 + k1 r² at the distorted coordinates, mor's models multiply",
    "EUCM": "its alpha and beta bend the projection itself",
    "EQUIRECTANGULAR": "it is a panorama, no central projection onto a plane",
}
"""What of a model without a counterpart mor cannot say."""


def has_one_unknown_more(name: str) -> bool:
    """True for a model with one focal length whose counterpart in mor has two."""
    return MODELS[name].ours == "fisheye" and MODELS[name].parameters[0] == "f"


def camera_of(camera: ColmapCamera, held: bool = False) -> dict[str, Any]:
    """A camera as a project file says it; principal points are fixed, as COLMAP's own adjustment has them.

    ``held``: all is fixed.
    """
    model = MODELS[camera.model]
    given = dict(zip(model.parameters, camera.parameters, strict=True))
    if model.ours != "mor" and "f" in given:
        f = given.pop("f")
        given = {"fx": f, "fy": f, **given}
    interior = _radial(camera, given) if model.ours == "mor" else given
    fixed = interior if held else ("xh", "yh", "cx", "cy")
    return {
        "model": model.ours,
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": str(camera.width), "height": str(camera.height)},
        "interior": {name: {"fixed" if name in fixed else "free": repr(value)} for name, value in interior.items()},
    }


def _radial(camera: ColmapCamera, given: Mapping[str, float]) -> dict[str, float]:
    f = given["f"]
    interior = {"c": f, "xh": given["cx"] - camera.width / 2.0, "yh": camera.height / 2.0 - given["cy"]}
    powers = (("A1", "k1", f * f), ("A2", "k2", f * f * f * f))
    return {**interior, **{ours: given[name] / power for ours, name, power in powers if name in given}}


def camera_from(number: int, camera: Camera, edge: Edge, what: str = "COLMAP") -> ColmapCamera:
    """COLMAP's camera that says the same. Raises ``ValueError`` with words where none does.

    ``what`` is written with its numbers, for the words.
    """
    if camera.image is None:
        raise ValueError(f"it has no image: {{width, height}}, which {what} needs")
    scale = image_scale(camera)
    width, height = (split(text)[0] for text in (camera.image.width, camera.image.height))
    values = interior_values(camera, edge, scale)
    # COLMAP's models with the numbers and names of mor's.
    same = {
        "fisheye": "OPENCV_FISHEYE",
        "thin-prism-fisheye": "THIN_PRISM_FISHEYE",
        "rad-tan-thin-prism-fisheye": "RAD_TAN_THIN_PRISM_FISHEYE",
        "fov": "FOV",
    }
    if camera.model in ("mor", "brown-forward"):
        name, parameters = _from_radial(_as_mor(camera, values, edge, scale), (width, height), scale.pixel)
    elif camera.model == "opencv":
        name, parameters = _from_opencv(values, scale.pixel)
    elif camera.model in same and not values.get("alpha"):
        name = same[camera.model]
        values = {"fy": values["fx"], **values}
        parameters = [values.get(key, 0.0) / (scale.pixel if key in _TWO else 1.0) for key in MODELS[name].parameters]
    else:
        raise ValueError(f"no model of {what} says what its model {camera.model} says")
    if camera.model in ("opencv", *same) and not scale.corner:
        parameters[2:4] = parameters[2] + width / 2.0, parameters[3] + height / 2.0
    return ColmapCamera(number, name, round(width), round(height), tuple(parameters))


def _as_mor(camera: Camera, values: dict[str, float], edge: Edge, scale: ImageScale) -> dict[str, float]:
    """Components of model mor without r0 (``docs/camera-models.md``: what converts to what)."""
    if camera.model == "brown-forward":
        names = {"K1": "A1", "K2": "A2", "K3": "A3", "P1": "B1", "P2": "B2"}
        return {names.get(k, k): -v if k in names else v for k, v in values.items()}
    if values.get("C1") or values.get("C2"):
        raise ValueError("COLMAP cannot store its affinity (C1, C2)")
    r0 = edge.number(camera.r0 or "0", IMAGE, "", scale)
    f = 1.0 - sum(values.get(f"A{k}", 0.0) * r0 ** (2 * k) for k in (1, 2, 3))
    powers = {"c": -1, "A1": 3, "A2": 5, "A3": 7, "B1": 2, "B2": 2}
    return {name: value / f ** powers[name] if name in powers else value for name, value in values.items()}


def _from_radial(values: dict[str, float], size: tuple[float, float], pixel: float) -> tuple[str, list[float]]:
    c = values["c"]
    f, centre = (
        c / pixel,
        (size[0] / 2.0 + values.get("xh", 0.0) / pixel, size[1] / 2.0 - values.get("yh", 0.0) / pixel),
    )
    k = [values.get(f"A{i}", 0.0) * (c * c) ** i for i in (1, 2, 3)]
    if "B1" in values or "B2" in values or "A3" in values:
        p1, p2 = -values.get("B2", 0.0) * c, values.get("B1", 0.0) * c
        name = "FULL_OPENCV" if "A3" in values else "OPENCV"
        return name, [f, f, *centre, k[0], k[1], p1, p2, *([k[2], 0.0, 0.0, 0.0] if "A3" in values else [])]
    count = 2 if "A2" in values else 1 if "A1" in values else 0
    return ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")[count], [f, *centre, *k[:count]]


def _from_opencv(values: dict[str, float], pixel: float) -> tuple[str, list[float]]:
    given = set(values)
    name = "FULL_OPENCV" if given & {"k3", "k4", "k5", "k6"} else "OPENCV" if given - set(_TWO) else "PINHOLE"
    values = {"fy": values["fx"], **values}
    return name, [values.get(key, 0.0) / (pixel if key in _TWO else 1.0) for key in MODELS[name].parameters]
