"""Camera models by key: what an image of this program can have been taken with."""

from __future__ import annotations

from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras.brown import BROWN
from mor.geometry.cameras.brown_affine_after import BROWN_4, BROWN_5
from mor.geometry.cameras.brown_forward import BROWN_FORWARD
from mor.geometry.cameras.fisheye import FISHEYE
from mor.geometry.cameras.fov import FOV
from mor.geometry.cameras.metashape import METASHAPE
from mor.geometry.cameras.mor import MOR
from mor.geometry.cameras.opencv import OPENCV
from mor.geometry.cameras.panorama import PANORAMA
from mor.geometry.cameras.thin_prism import RAD_TAN_THIN_PRISM, THIN_PRISM

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

__all__ = ["CAMERA_MODELS", "CameraModel", "Projection"]
