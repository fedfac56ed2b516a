"""Read camera, focal length, size and GNSS position with its accuracy from photographs (EXIF)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.draft import Draft, Row, east_north_up
from mor.input_files import check_regular, note_input
from mor.project.document import Document

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".png", ".webp", ".heic")


class Photograph(NamedTuple):
    """A photograph; what it does not say is ``None`` or 0."""

    path: Path
    camera: tuple[str, int, int, float, float]
    """Make and model, width and height (px), focal length and its 35 mm equivalent (mm)."""
    place: tuple[float, float, float] | None
    """Latitude, longitude (degrees), height (m)."""
    accuracy: float
    """Horizontal, m."""


def read_photographs(paths: Sequence[Path], target: Path) -> Document:
    """A project with the cameras and images of photographs; ``target`` is the project file they begin.

    Raises :class:`InputError` if one cannot be read, and where Pillow, of the extra ``formats``, is missing.
    """
    draft = Draft(str(target))
    photographs = [_photograph(path) for path in paths]
    names = [photograph.path.name for photograph in photographs]
    for name in sorted({name for name in names if names.count(name) > 1}):
        draft.problem(f"two photographs are called {name!r}: names of images have to differ")
    draft.put("title", target.stem)
    draft.put("units", {"length": "m", "angle": "gon"})
    draft.put("axes", {"xy": "en"})
    groups = list(dict.fromkeys(photograph.camera for photograph in photographs))
    draft.put("cameras", {_name(k, group): _camera(group) for k, group in enumerate(groups, start=1)})
    rows, located = _rows(photographs, groups, draft)
    axes = ("x", "y", "z")
    draft.table("images", ("id", "camera", *axes, *(f"sigma_{axis}" for axis in axes)), rows)
    draft.note(f"{counted(len(rows), 'photograph')} of {counted(len(groups), 'camera')}")
    if located < 3:
        draft.put("datum", "free")
    return draft.finish()


def _photograph(path: Path) -> Photograph:
    check_regular(path)
    note_input(path)
    try:
        from PIL import Image
    except ImportError:
        words = "photographs need the extra formats: pip install 'mor-adjustment[formats]'"
        raise InputError([Message(words, str(path))]) from None
    exif_part, gps_part = 0x8769, 0x8825
    try:
        with warnings.catch_warnings(), Image.open(path) as picture:
            warnings.simplefilter("ignore")
            width, height = picture.size
            exif = picture.getexif()
            inner, gps = dict(exif.get_ifd(exif_part)), dict(exif.get_ifd(gps_part))
    except Exception as error:  # noqa: BLE001 - damaged pictures end in errors of all kinds
        raise InputError([Message(f"this picture cannot be read: {error}", str(path))]) from None
    tag_of_make, tag_of_model, tag_of_focal, tag_of_focal_35 = 0x010F, 0x0110, 0x920A, 0xA405
    make, model = (str(exif.get(tag, "")).strip("\0 ") for tag in (tag_of_make, tag_of_model))
    model = model if model.startswith(make) else f"{make} {model}".strip()
    focal, wide = (_number(inner.get(tag)) for tag in (tag_of_focal, tag_of_focal_35))
    return Photograph(path, (model, width, height, focal, wide), _place(gps), _number(gps.get(31)))


def _number(value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return number if np.isfinite(number) and 0.0 < number < 1e9 else 0.0


def _place(gps: dict[int, Any]) -> tuple[float, float, float] | None:
    """Latitude and longitude of tags 1 to 4, height of 5 and 6."""
    try:
        latitude, longitude = (sum(float(part) / 60.0**k for k, part in enumerate(gps[tag])) for tag in (2, 4))
        height = float(gps.get(6, 0.0))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    south, west = str(gps.get(1)).upper().startswith("S"), str(gps.get(3)).upper().startswith("W")
    below = gps.get(5) in (1, b"\x01")
    place = (-latitude if south else latitude, -longitude if west else longitude, -height if below else height)
    good = np.isfinite(place).all() and abs(latitude) <= 90.0 and abs(longitude) <= 180.0
    return place if good and (latitude or longitude) else None


def _name(number: int, group: tuple[str, int, int, float, float]) -> str:
    model, width, height, focal, _ = group
    words = [model or "camera", f"{focal:g} mm" if focal else "", f"{width} x {height}"]
    return f"{number}: {' '.join(word for word in words if word)}"


def _camera(group: tuple[str, int, int, float, float]) -> dict[str, Any]:
    """Pixels from the corner; c from the 35 mm equivalent where there is one, free like the distortion."""
    _, width, height, _, wide = group
    camera: dict[str, Any] = {
        "model": "mor",
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": str(width), "height": str(height)},
        "interior": {name: {"free": "0"} for name in ("xh", "yh", "A1", "A2", "B1", "B2")},
    }
    return {**camera, **({"focal_length_35mm": repr(wide)} if wide else {})}


def _rows(
    photographs: Sequence[Photograph], groups: Sequence[tuple[str, int, int, float, float]], draft: Draft
) -> tuple[list[Row], int]:
    """Images with their positions, east, north, up about the first of them; and how many have one."""
    located = [photograph for photograph in photographs if photograph.place is not None]
    places = np.array([photograph.place for photograph in located], dtype=float).reshape(-1, 3)
    local = east_north_up(places, places[0]) if len(located) else places
    at = {photograph.path: place for photograph, place in zip(located, local.tolist(), strict=True)}
    rows = []
    # σ of positions that say no accuracy, m: those of a camera's own receiver.
    sigma_plan, sigma_height = 5.0, 10.0
    for photograph in photographs:
        camera = _name(groups.index(photograph.camera) + 1, photograph.camera)
        place = at.get(photograph.path)
        plan = photograph.accuracy or sigma_plan
        sigma = [plan, plan, 2.0 * plan if photograph.accuracy else sigma_height]
        cells = [None] * 6 if place is None else [repr(v) for v in (*place, *sigma)]
        rows.append(Row([photograph.path.name, camera, *cells], 0))
    if located:
        latitude, longitude, height = places[0].tolist()
        draft.note(
            f"positions of {counted(len(located), 'photograph')} are east, north, up about latitude {latitude:.9g}, "
            f"longitude {longitude:.9g}, height {height:.9g}, observed with the accuracy they say, or 5 m and 10 m"
        )
    return rows, len(located)
