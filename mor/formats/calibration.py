"""Calibrations of single cameras for other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mor.errors import InputError, Message, nearest
from mor.formats.aicon import camera_lines
from mor.formats.colmap.model import MODELS, camera_from
from mor.formats.colmap.writer import camera_line
from mor.formats.content import Content, content_of, interior_values
from mor.formats.draft import Written
from mor.formats.metashape import interior_of
from mor.project.axes import image_scale, split
from mor.project.document import Document
from mor.project.schema import Camera

# ---- Camera files of OpenCV (``cv::FileStorage``): camera matrix and distortion, as ``calibrateCamera`` writes them.


def write_opencv(document: Document, folder: Path, target: Path) -> Written:
    """A file for each camera, beside each other where there are several.

    cx and cy count from the centre of the upper left pixel, as OpenCV counts: half a pixel less than from its corner.
    Raises :class:`InputError` if OpenCV has no model that says the same.
    """
    content = content_of(document, folder)
    problems: list[Message] = []
    files: dict[Path, bytes] = {}
    several = len(content.project.cameras) > 1
    for name, camera in content.project.cameras.items():
        if several and set(name) & set("/\\"):
            words = f"camera {name!r}: its name becomes the name of a file, which cannot have / or \\; rename it"
            problems.append(content.place("cameras", name).problem(words))
            continue
        place = target.with_name(f"{target.stem}_{name}{target.suffix}") if several else target
        try:
            theirs = camera_from(1, camera, content.edge, "OpenCV")
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
            continue
        values = dict(zip(MODELS[theirs.model].parameters, theirs.parameters, strict=True))
        files[place] = _text(values, theirs.model, (theirs.width, theirs.height)).encode()
    if problems:
        raise InputError(problems)
    if not files:
        raise InputError([Message("there is no camera", document.file)])
    return Written(files, [Message("an OpenCV file has the camera only", str(target))])


def _text(values: dict[str, float], model: str, size: tuple[int, int]) -> str:
    fx, fy = values.get("fx", values.get("f", 0.0)), values.get("fy", values.get("f", 0.0))
    matrix = [fx, 0.0, values["cx"] - 0.5, 0.0, fy, values["cy"] - 0.5, 0.0, 0.0, 1.0]
    names = ("k1", "k2", "k3", "k4") if model == "OPENCV_FISHEYE" else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    distortion = [values.get(name, 0.0) for name in names]
    if model != "OPENCV_FISHEYE":
        distortion = distortion if any(distortion[5:]) else distortion[:5]
    return (
        f"%YAML:1.0\n---\nimage_width: {size[0]}\nimage_height: {size[1]}\n"
        f"{_matrix('camera_matrix', matrix, 3, 3)}"
        f"{_matrix('distortion_coefficients', distortion, 1, len(distortion))}"
    )


def _matrix(name: str, values: list[float], rows: int, columns: int) -> str:
    data = ", ".join(repr(value) for value in values)
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"


# ---- One camera in the calibration files of other programs: the same numbers, or a word that it cannot say them.
#
# OpenCV's file storage and COLMAP's cameras.txt are those of their writers; Metashape's is the XML of *Camera
# Calibration, Load*; AICON's five lines of ``.ior``; for PhotoModeler, whose camera files are its own, the values to
# type in.


def write_calibration(document: Document, folder: Path, name: str, form: str, target: Path) -> bytes:
    """The calibration file of one camera of a project, in one of :data:`FORMS`.

    Raises :class:`InputError` for an unknown camera, and where the program has no model that says the same.
    """
    cameras = document.data.get("cameras") or {}
    if name not in cameras:
        raise InputError([Message(f"unknown camera {name!r}{nearest(name, cameras)}", document.file)])
    kept: dict[str, Any] = {key: document.data[key] for key in ("mor", "units", "axes") if key in document.data}
    alone = replace(document, data={**kept, "cameras": {name: cameras[name]}}, frames={})
    try:
        return FORMS[form](alone, folder, target)
    except ValueError as error:
        place = (document.file_of(("cameras", name)), document.line(("cameras", name)))
        raise InputError([Message(f"camera {name}: {error}", *place)]) from None


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


def _aicon(document: Document, folder: Path, target: Path) -> bytes:
    name, camera, content = _camera(document, folder)
    lines, _ = camera_lines(name, camera, content)
    return "\n".join([*lines, ""]).encode()


def _photomodeler(document: Document, folder: Path, target: Path) -> bytes:
    """The values of PhotoModeler's camera dialog, millimetres; the principal point from the upper left corner."""
    name, camera, content = _camera(document, folder)
    if camera.model != "brown":
        raise ValueError(f"PhotoModeler's model is brown; the numbers of {camera.model} say other things")
    if camera.unit != "mm" or camera.image is None or camera.image.pixel is None:
        raise ValueError("PhotoModeler needs unit: mm, and image: {width, height, pixel}")
    scale = image_scale(camera)
    values = interior_values(camera, content.edge, scale)
    if values.get("b2"):
        raise ValueError("PhotoModeler cannot store its shear (b2)")
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
