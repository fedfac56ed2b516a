"""Camera files of OpenCV (``cv::FileStorage``): camera matrix and distortion, as ``calibrateCamera`` writes them."""

from __future__ import annotations

from pathlib import Path

from mor.errors import InputError, Problem
from mor.formats.colmap.cameras import MODELS, camera_from
from mor.formats.content import content_of
from mor.formats.written import Written
from mor.project.file.nodes import Document

_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def write_opencv(document: Document, folder: Path, target: Path) -> Written:
    """A file for each camera, beside each other where there are several.

    cx and cy count from the centre of the upper left pixel, as OpenCV counts: half a pixel less than from its corner.
    Raises :class:`InputError` if OpenCV has no model that says the same.
    """
    content = content_of(document, folder)
    problems: list[Problem] = []
    files: dict[Path, bytes] = {}
    several = len(content.project.cameras) > 1
    for name, camera in content.project.cameras.items():
        if several and set(name) & set("/\\"):
            words = (
                f"camera {name!r}: its name becomes the name of a file, which cannot have / or \\; rename it"
            )
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
        raise InputError([Problem("there is no camera", document.file)])
    return Written(files, [Problem("an OpenCV file has the camera only", str(target))])


def _text(values: dict[str, float], model: str, size: tuple[int, int]) -> str:
    fx, fy = values.get("fx", values.get("f", 0.0)), values.get("fy", values.get("f", 0.0))
    matrix = [fx, 0.0, values["cx"] - 0.5, 0.0, fy, values["cy"] - 0.5, 0.0, 0.0, 1.0]
    names = ("k1", "k2", "k3", "k4") if model == "OPENCV_FISHEYE" else _DISTORTION
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
