"""Camera models by key: what an image of this program can have been taken with."""

from __future__ import annotations

from mor.model.brown import BROWN, BROWN_4, BROWN_5, BROWN_FORWARD, METASHAPE, MOR
from mor.model.fisheye import FISHEYE, FOV, OPENCV, PANORAMA, RAD_TAN_THIN_PRISM, THIN_PRISM
from mor.model.lens import CameraModel, Projection
from mor.model.ports import PORTS, behind

LENSES: dict[str, CameraModel] = {
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
"""Every camera model in air, by its key; the first component of each is its camera constant (``c`` or ``fx``)."""

_UNDER_WATER = [behind(port, lens) for lens in LENSES.values() if lens is not PANORAMA for port in PORTS]
CAMERA_MODELS = LENSES | {model.key: model for model in _UNDER_WATER}
"""The same, and those behind the ports of underwater housings: ``opencv+flat-port``."""


def lens_of(key: str) -> CameraModel:
    """Return the camera model without its port."""
    return LENSES[key.partition("+")[0]]


__all__ = ["CAMERA_MODELS", "LENSES", "CameraModel", "Projection", "lens_of"]
