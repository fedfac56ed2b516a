"""Pix4D's camera file ``…_calibrated_internal_camera_parameters.cam``: cameras alone, in millimetres.

Source: files of the program as readers of others show them; the same camera in pixels stands in the calibrated camera
parameters of their projects.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

HEAD = "Pix4D camera calibration file"
_SIZE = re.compile(r"sensor width of\s+([\d.]+)\s*x\s*([\d.]+)\s*mm", re.IGNORECASE)
_NEEDED = ("F", "Px", "Py")
_KEYS = (*_NEEDED, "K1", "K2", "K3", "T1", "T2")


@dataclass
class _Camera:
    """A block of a file: its name there, the size of the sensor (mm), values by key."""

    name: str
    line: int
    size: tuple[float, float] | None = None
    values: dict[str, float] = field(default_factory=dict)


def read_camera_file(path: Path) -> Document:
    """A project with the cameras of a file and nothing else. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "deg"})
    found: list[_Camera] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        try:
            _read(text.strip(), line, found)
        except ValueError as error:
            draft.problem(str(error), line)
    if not found:
        raise InputError([Problem(f"expected {HEAD!r} in the first line", str(path), 1)])
    cameras: dict[str, Any] = {}
    for camera in found:
        missing = [key for key in _NEEDED if key not in camera.values]
        if missing or camera.size is None:
            what = missing[0] if missing else "the size of the sensor behind #Focal Length"
            draft.problem(f"camera {camera.name}: {what} is missing", camera.line)
        elif camera.name in cameras:
            draft.problem(f"camera {camera.name} is there twice", camera.line)
        else:
            cameras[camera.name] = _camera(camera.values, camera.size)
            draft.lines["cameras", camera.name] = camera.line
    draft.put("cameras", cameras)
    draft.note(
        "the size of the image in pixels is not in this file: for image points in px add image: {width, height, pixel}"
    )
    draft.note("the file does not say which camera parameters were estimated: all are free")
    return draft.finish()


def _read(text: str, line: int, found: list[_Camera]) -> None:
    """A line of a file. Raises ``ValueError`` with words."""
    if text.startswith(HEAD):
        found.append(_Camera(text.removeprefix(HEAD).strip() or str(len(found)), line))
        return
    if not text:
        return
    if not found:
        raise ValueError(f"found {text[:30]!r}, expected {HEAD!r} in the first line")
    if text.startswith("#"):
        size = _SIZE.search(text)
        if size:
            width, height = number(size[1]), number(size[2])
            if min(width, height) <= 0.0:
                raise ValueError("found a sensor without a size")
            found[-1].size = width, height
        return
    words = text.split()
    if len(words) != 2 or words[0] not in _KEYS:
        raise ValueError(f"found {text[:30]!r}, expected one of {', '.join(_KEYS)} and a number")
    if words[0] in found[-1].values:
        raise ValueError(f"{words[0]} is there twice")
    found[-1].values[words[0]] = number(words[1])


def _camera(values: dict[str, float], size: tuple[float, float]) -> dict[str, Any]:
    """Convert a camera to the model ``metashape``, whose principal point counts from the image centre."""
    given = {"f": values["F"], "cx": values["Px"] - size[0] / 2.0, "cy": values["Py"] - size[1] / 2.0}
    given |= {f"k{k}": values.get(f"K{k}", 0.0) for k in (1, 2, 3)}
    given |= {"p1": values.get("T2", 0.0), "p2": values.get("T1", 0.0)}
    interior = {key: {"free": repr(value)} for key, value in given.items()}
    return {"model": "metashape", "unit": "mm", "interior": interior}
