"""One camera in the calibration files of other programs: the same numbers, or a word that it cannot say them.

OpenCV's file storage and COLMAP's cameras.txt are those of their writers; Metashape's is the XML of *Camera
Calibration, Load*; AICON's five lines of ``.ior``; for PhotoModeler, whose camera files are its own, the values to
type in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mor.errors import InputError, Problem, nearest
from mor.formats.colmap.cameras import camera_from
from mor.formats.colmap.writer import camera_line
from mor.formats.content import Content, content_of, interior_values
from mor.formats.metashape.writer import interior_of
from mor.formats.opencv_file import write_opencv
from mor.project.edge import image_scale, split
from mor.project.file.model import Camera
from mor.project.file.nodes import Document
from mor.units import IMAGE


def write_calibration(document: Document, folder: Path, name: str, form: str, target: Path) -> bytes:
    """The calibration file of one camera of a project, in one of :data:`FORMS`.

    Raises :class:`InputError` for an unknown camera, and where the program has no model that says the same.
    """
    cameras = document.data.get("cameras") or {}
    if name not in cameras:
        raise InputError([Problem(f"unknown camera {name!r}{nearest(name, cameras)}", document.file)])
    kept: dict[str, Any] = {
        key: document.data[key] for key in ("mor", "units", "axes") if key in document.data
    }
    alone = replace(document, data={**kept, "cameras": {name: cameras[name]}}, frames={})
    try:
        return FORMS[form](alone, folder, target)
    except ValueError as error:
        place = (document.file_of(("cameras", name)), document.line(("cameras", name)))
        raise InputError([Problem(f"camera {name}: {error}", *place)]) from None


def _camera(document: Document, folder: Path) -> tuple[str, Camera, Content]:
    content = content_of(document, folder)
    name, camera = next(iter(content.project.cameras.items()))
    return name, camera, content


def _opencv(document: Document, folder: Path, target: Path) -> bytes:
    return write_opencv(document, folder, target).files[target]


def _colmap(document: Document, folder: Path, target: Path) -> bytes:
    _, camera, content = _camera(document, folder)
    return camera_line(camera_from(1, camera, content.edge)).encode()


def _metashape(document: Document, folder: Path, target: Path) -> bytes:
    _, camera, content = _camera(document, folder)
    if camera.image is None:
        raise ValueError("it has no image: {width, height}, which Metashape needs")
    values, _ = interior_of(camera, content)
    width, height = (round(split(text)[0]) for text in (camera.image.width, camera.image.height))
    numbers = "".join(f"  <{key}>{value!r}</{key}>\n" for key, value in values.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n  <projection>frame</projection>\n'
        f"  <width>{width}</width>\n  <height>{height}</height>\n{numbers}</calibration>\n"
    ).encode()


_SIZES = (("xh", "yh", "A1", "A2"), ("A3",), ("B1", "B2"), ("C1", "C2"))


def _aicon(document: Document, folder: Path, target: Path) -> bytes:
    """Five lines, millimetres: identifier 1 −c xh yh A1 A2 r0 / A3 / B1 B2 / C1 C2 / sensor and image size."""
    name, camera, content = _camera(document, folder)
    if camera.model != "mor":
        raise ValueError(f"AICON's model is mor, this one is {camera.model}")
    if camera.unit != "mm" or camera.image is None or camera.image.pixel is None:
        raise ValueError("AICON needs unit: mm, and image: {width, height, pixel}")
    scale = image_scale(camera, content.project.units)
    values = interior_values(camera, content.edge, scale)
    r0 = content.edge.number(camera.r0 or "0", IMAGE, "", scale)
    first, *rest = (" ".join(repr(values.get(key, 0.0)) for key in keys) for keys in _SIZES)
    width, height = (split(text)[0] for text in (camera.image.width, camera.image.height))
    size = f"{width * scale.pixel!r} {height * scale.pixel!r} {width:g} {height:g}"
    return "\n".join([f"{name} 1 {-values['c']!r} {first} {r0!r}", *rest, size, ""]).encode()


def _photomodeler(document: Document, folder: Path, target: Path) -> bytes:
    """The values of PhotoModeler's camera dialog, millimetres; the principal point from the upper left corner."""
    name, camera, content = _camera(document, folder)
    if camera.model != "brown":
        raise ValueError(f"PhotoModeler's model is brown; the numbers of {camera.model} say other things")
    if camera.unit != "mm" or camera.image is None or camera.image.pixel is None:
        raise ValueError("PhotoModeler needs unit: mm, and image: {width, height, pixel}")
    scale = image_scale(camera, content.project.units)
    values = interior_values(camera, content.edge, scale)
    if values.get("b2"):
        raise ValueError("PhotoModeler has no place for its shear (b2)")
    ratio = 1.0 + values.get("b1", 0.0)
    width, height = (split(text)[0] * scale.pixel for text in (camera.image.width, camera.image.height))
    rows = {
        "Focal length [mm]": values["c"],
        "Format width [mm]": width * ratio,
        "Format height [mm]": height,
        "Principal point X [mm]": (values.get("xh", 0.0) + width / 2.0) * ratio,
        "Principal point Y [mm]": height / 2.0 - values.get("yh", 0.0),
        **{key: values.get(key, 0.0) for key in ("K1", "K2", "K3", "P1", "P2")},
    }
    return "".join([f"Camera: {name}\n", *(f"{key}: {value!r}\n" for key, value in rows.items())]).encode()


FORMS: dict[str, Callable[[Document, Path, Path], bytes]] = {
    "opencv": _opencv,
    "metashape": _metashape,
    "colmap": _colmap,
    "aicon": _aicon,
    "photomodeler": _photomodeler,
}
"""Writers by the word that ``--to`` takes."""
SUFFIXES = {"opencv": ".yml", "metashape": ".xml", "colmap": ".txt", "aicon": ".ior", "photomodeler": ".txt"}
