"""Images of a survey: cameras that are calibrated or not, and where they stand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.survey import Camera, Photo, Start, Survey
from tests.scenarios.mixtures.world import looking, rotation

CAMERAS = (
    (30.0, (18.0, 12.0)),
    (8.8, (6.6, 4.4)),
    (100.0, (52.0, 34.0)),
    (15.0, (18.0, 12.0)),
    (4.2, (3.1, 2.3)),
)
PIXEL = 0.005
UP = np.array([0.0, 0.0, 1.0])


def photographs(survey: Survey, count: int) -> None:
    """Images of one arrangement, of all points or in two clusters."""
    _cameras(survey, count)
    tags = survey.tags
    kind = (
        "vertical" if tags & {"site", "valley"}
        else "inside out" if "room" in tags
        else survey.one_of("row", "convergent") if "facade" in tags
        else survey.one_of("circle", "convergent", "circle", "vertical")
    )  # fmt: skip
    survey.tags.add(f"images {kind}")
    halves = _clusters(survey) if count >= 6 and survey.chance(0.2, "two clusters") else [None]
    for k in range(count):
        sees = halves[k * len(halves) // count]
        camera = str(survey.one_of(*survey.cameras))
        place, at = ARRANGEMENTS[kind](survey, survey.cameras[camera], k / count)
        roll = float(survey.one_of(0.0, 0.0, np.pi / 2.0, -np.pi / 2.0) + 0.05 * survey.draw.standard_normal())
        survey.photos[f"i{k}"] = Photo(camera, place, looking(place, at, roll), sees)


def _cameras(survey: Survey, count: int) -> None:
    for k in range(survey.one_of(1, 1, 2) if count > 3 else 1):
        c, half = CAMERAS[int(survey.draw.integers(len(CAMERAS)))]
        free = count >= 6 and survey.chance(0.25, "uncalibrated camera")
        off = np.array(half) * 0.01 * survey.draw.standard_normal(2) if free else np.zeros(2)
        true = (
            c * (1.0 + (0.02 * survey.draw.standard_normal() if free else 0.0)),
            float(off[0]),
            float(off[1]),
        )
        sigma = float(half[0] * 10.0 ** survey.draw.uniform(-4.3, -3.5))
        pixels = survey.chance(0.4, "pixels")
        survey.cameras[f"cam{k}"] = Camera(c, np.array(half), sigma, pixels, free, true)


def _clusters(survey: Survey) -> list[frozenset[str] | None]:
    """Two halves of the object without a common point in images."""
    names = list(survey.marks)
    middle = float(np.median([survey.marks[name].xyz[0] for name in names]))
    left = frozenset(name for name in names if survey.marks[name].xyz[0] < middle)
    return [left, frozenset(names) - left]


def _circle(survey: Survey, camera: Camera, part: float) -> tuple[FloatArray, FloatArray]:
    angle = 2.0 * np.pi * (part + 0.03 * survey.draw.standard_normal())
    far = _distance(survey, camera) * survey.draw.uniform(0.8, 1.3)
    place = far * np.array([np.cos(angle), np.sin(angle), survey.draw.uniform(0.0, 0.7)])
    return place, 0.08 * survey.size * survey.draw.standard_normal(3)


def _convergent(survey: Survey, camera: Camera, part: float) -> tuple[FloatArray, FloatArray]:
    angle = survey.draw.uniform(-0.7, 0.7) - np.pi / 2.0
    far = _distance(survey, camera) * survey.draw.uniform(0.7, 1.3)
    place = far * np.array([np.cos(angle), np.sin(angle), survey.draw.uniform(-0.1, 0.5)])
    return place, 0.1 * survey.size * survey.draw.standard_normal(3)


def _row(survey: Survey, camera: Camera, part: float) -> tuple[FloatArray, FloatArray]:
    far = 0.8 * _distance(survey, camera)
    place = np.array([survey.size * (part - 0.5), -far, 0.1 * survey.size * survey.draw.standard_normal()])
    return place, place + np.array([0.05 * far * survey.draw.standard_normal(), far, 0.0])


def _vertical(survey: Survey, camera: Camera, part: float) -> tuple[FloatArray, FloatArray]:
    up = _distance(survey, camera) * survey.draw.uniform(0.7, 1.1)
    x = survey.size * (part - 0.5) * 0.8
    place = np.array([x, 0.2 * survey.size * survey.draw.uniform(-1.0, 1.0), up])
    return place, np.array([place[0], place[1], 0.0]) + 0.05 * up * np.append(survey.draw.standard_normal(2), 0.0)


def _inside_out(survey: Survey, camera: Camera, part: float) -> tuple[FloatArray, FloatArray]:
    angle = 2.0 * np.pi * (part + 0.05 * survey.draw.standard_normal())
    away = np.array([np.cos(angle), np.sin(angle), 0.3 * survey.draw.standard_normal()])
    place = 0.12 * survey.size * survey.draw.standard_normal(3) * [
        1.0,
        1.0,
        0.3,
    ] - 0.25 * survey.size * away * [1, 1, 0]
    return place, place + away


ARRANGEMENTS: dict[str, Callable[[Survey, Camera, float], tuple[FloatArray, FloatArray]]] = {
    "circle": _circle, "convergent": _convergent, "row": _row, "vertical": _vertical, "inside out": _inside_out,
}  # fmt: skip


def _distance(survey: Survey, camera: Camera) -> float:
    """From where the object about fills the format."""
    return float(0.6 * survey.size * camera.c / camera.half[1])


def measure_photographs(survey: Survey) -> None:
    """Image coordinates of what is seen; uneven, for some points are hard to see."""
    most = int(survey.one_of(12, 25, 60))
    names = survey.seen_marks("images")
    share = np.array([survey.marks[name].share for name in names])
    for image, photo in survey.photos.items():
        if photo.camera not in survey.cameras:
            continue
        xyz = np.array([survey.place(name, image) for name in names])
        camera = survey.cameras[photo.camera]
        star = (xyz - photo.centre) @ photo.D.T
        c, xh, yh = camera.true
        xy = np.array([xh, yh]) - c * star[:, :2] / star[:, 2:]
        seen = (star[:, 2] < 0.0) & (np.abs(xy) < camera.half).all(axis=1)
        seen &= survey.draw.random(len(names)) < share
        seen &= np.array([photo.sees is None or name in photo.sees for name in names])
        chosen = np.flatnonzero(seen)
        plain = share[chosen] + 0.3 * survey.draw.random(len(chosen))
        for i in chosen[np.argsort(-plain)][:most]:
            u, v = _reading(survey, camera, xy[i])
            keys = {
                "type": "image",
                "values": {"sigma": camera.sigma / PIXEL if camera.pixels else camera.sigma},
            }
            survey.row("observations", f"image {photo.camera}", keys, image=image, point=names[i], x=u, y=v)


def _reading(survey: Survey, camera: Camera, xy: FloatArray) -> tuple[float, float]:
    x, y = xy + camera.sigma * survey.draw.standard_normal(2)
    if camera.pixels:
        return float((x + camera.half[0]) / PIXEL), float((camera.half[1] - y) / PIXEL)
    return float(x), float(y)


def write_cameras(survey: Survey) -> None:
    """Cameras; a free one says nothing but its nominal constant, or nothing at all."""
    for name, camera in survey.cameras.items():
        used = any(photo.camera == name for photo in survey.photos.values())
        if not used:
            continue
        interior: dict[str, object] = {"c": camera.c}
        if camera.free:
            true = dict(zip(("c", "xh", "yh"), camera.true, strict=True))
            interior = {key: {"free": Start(value, camera.c if key == "c" else 0.0)} for key, value in true.items()}
        width, height = np.rint(2.0 * camera.half / PIXEL)
        survey.more.setdefault("cameras", {})[name] = {
            "image": {"width": int(width), "height": int(height), "pixel": f"{PIXEL} mm"},
            "coordinates": "corner" if camera.pixels else "centred",
            "interior": interior,
        }


def write_images(survey: Survey, rough: dict[str, float]) -> None:
    """The table of images; those in ``rough`` have start values that are off by so many parts of the size."""
    observed = survey.sigma_length * 10.0 if survey.photos and survey.chance(0.12, "positions observed") else None
    for name, photo in survey.photos.items():
        off = rough.get(name)
        D = photo.D if off is None else rotation(off * survey.draw.standard_normal(3)) @ photo.D
        cells: dict[str, object] = {"id": name, "camera": photo.camera}
        for axis, value in zip("xyz", survey.origin + photo.centre, strict=True):
            shaken = value + (off or 0.0) * survey.size * survey.draw.standard_normal()
            cells[axis] = survey.start(value, None if off is None else shaken)
            if observed is not None:
                cells[axis] = survey.in_length(value + observed * survey.draw.standard_normal())
                cells[f"sigma_{axis}"] = survey.in_length(observed)
        for angle, true, said in zip(("omega", "phi", "kappa"), angles(photo.D), angles(D), strict=True):
            cells[angle] = Start(survey.in_angle(true), None if off is None else survey.in_angle(said))
        survey.row("images", "images", {}, **cells)  # type: ignore[arg-type]


def angles(D: FloatArray) -> tuple[float, float, float]:
    """ω, φ, κ (rad) of D = (Rx Ry Rz)ᵀ."""
    return (
        float(np.arctan2(-D[2, 1], D[2, 2])), float(np.arcsin(np.clip(D[2, 0], -1.0, 1.0))),
        float(np.arctan2(-D[1, 0], D[0, 0])),
    )  # fmt: skip
