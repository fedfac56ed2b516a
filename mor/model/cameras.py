"""Camera models by key: what an image of this program can have been taken with."""

from __future__ import annotations

from mor.model.brown import BROWN, BROWN_4, BROWN_5, BROWN_FORWARD, METASHAPE, MOR
from mor.model.fisheye import FISHEYE, FOV, OPENCV, PANORAMA, RAD_TAN_THIN_PRISM, THIN_PRISM
from mor.model.lens import CameraModel, Projection

CAMERA_MODELS: dict[str, CameraModel] = {
    model.key: model
    for model in (
        MOR,
        BROWN,
        BROWN_4,
        BROWN_5,
        BROWN_FORWARD,
        OPENCV,
        FISHEYE,
        METASHAPE,
        THIN_PRISM,
        RAD_TAN_THIN_PRISM,
        FOV,
        PANORAMA,
    )
}
"""Every camera model, by its key; the first component of each is its camera constant (``c`` or ``fx``)."""


__all__ = [
    "CAMERA_MODELS",
    "CameraModel",
    "Projection",
]
