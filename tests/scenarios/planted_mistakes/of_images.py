"""Mistakes with images and cameras: axes, units, constants."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.scenarios.planted_mistakes.survey import Row, Survey, scaled
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted, one_of

Random = np.random.Generator


def _camera(survey: Survey, random: Random) -> str:
    return str(one_of(random, sorted(survey.project.get("cameras", {}))))


def _rows(survey: Survey, camera: str) -> list[Row]:
    """Image coordinates of a camera."""
    images = [row for entry in survey.entries("images") for row in survey.rows(entry)]
    mine = {row["id"] for row in images if row["camera"] == camera}
    rows = [row for entry in survey.entries("observations", "image") for row in survey.rows(entry)]
    return [row for row in rows if row["image"] in mine]


def _size(survey: Survey, camera: str) -> tuple[float, float] | None:
    """Width and height where coordinates count from the corner; else nothing."""
    given = survey.project["cameras"][camera]
    if given.get("coordinates") != "corner":
        return None
    return float(given["image"]["width"]), float(given["image"]["height"])


def _mirror(survey: Survey, camera: str, rows: list[Row], axes: str) -> None:
    size = _size(survey, camera)
    for row in rows:
        for axis in axes:
            whole = 0.0 if size is None else size["xy".index(axis)]
            row[axis] = f"{whole - float(row[axis]):.6g}"


def flipped(survey: Survey, random: Random) -> Planted:
    """All coordinates of a camera count downwards, where the project says upwards, or the other way round."""
    camera = _camera(survey, random)
    _mirror(survey, camera, _rows(survey, camera), "y")
    return Planted(("image flipped",), {camera})


def one_flipped(survey: Survey, random: Random) -> Planted:
    """The coordinates of one image count downwards."""
    camera = _camera(survey, random)
    image = one_of(random, sorted({row["image"] for row in _rows(survey, camera)}))
    _mirror(survey, camera, [row for row in _rows(survey, camera) if row["image"] == image], "y")
    return Planted(("image flipped",), {image})


def turned(survey: Survey, random: Random) -> Planted:
    """One image turned by 180 degrees."""
    camera = _camera(survey, random)
    image = one_of(random, sorted({row["image"] for row in _rows(survey, camera)}))
    _mirror(survey, camera, [row for row in _rows(survey, camera) if row["image"] == image], "xy")
    return Planted(("image turned",), {image})


def image_unit(survey: Survey, random: Random) -> Planted:
    """Image coordinates of a camera in another unit: micrometres, metres, pixels where the project says mm."""
    camera = _camera(survey, random)
    pixel = survey.project["cameras"][camera].get("image", {}).get("pixel", "0.005 mm").split()[0]
    if _size(survey, camera) is not None:
        factor = float(pixel)  # millimetres where the project says pixels
    else:
        factor = random.choice([1000.0, 0.001, *([1.0 / float(pixel)] if "image" in _given(survey, camera) else [])])
    scaled(_rows(survey, camera), ("x", "y"), factor)
    return Planted(("image unit", "image scale"), {camera})


def _given(survey: Survey, camera: str) -> dict[str, Any]:
    given: dict[str, Any] = survey.project["cameras"][camera]
    return given


def pixel_size(survey: Survey, random: Random) -> Planted:
    """The pixel of a camera is not so large."""
    camera = _camera(survey, random)
    given = _given(survey, camera)
    if "pixel" not in given.get("image", {}) or _size(survey, camera) is None or _constant(given) is None:
        raise NotHereError
    value = float(given["image"]["pixel"].split()[0]) * _factor(random)
    given["image"]["pixel"] = f"{value:.6g} mm"
    return Planted(("image scale",), {camera})


def focal_length(survey: Survey, random: Random) -> Planted:
    """The camera constant is that of another lens; where it is fixed or observed."""
    camera = _camera(survey, random)
    interior = _given(survey, camera)["interior"]
    c = _constant(_given(survey, camera))
    if c is None:
        raise NotHereError
    value = f"{c * _factor(random):.4f}"
    if isinstance(interior["c"], dict):
        interior["c"]["observed"] = value
    else:
        interior["c"] = value
    return Planted(("image scale",), {camera})


def _constant(given: dict[str, Any]) -> float | None:
    """The camera constant, where it is fixed or observed."""
    c = given["interior"]["c"]
    if isinstance(c, dict):
        return float(c["observed"]) if "observed" in c else None
    return float(c)


def _factor(random: Random) -> float:
    return float(random.uniform(1.1, 1.6) ** random.choice([-1, 1]))
