"""Surveys with what is less common: points that move, panoramas, rolling shutters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.composed import finish, prune
from tests.scenarios.mixtures.surveys.earth import on_the_earth
from tests.scenarios.mixtures.surveys.instruments import stations
from tests.scenarios.mixtures.surveys.photographs import PIXEL, measure_photographs, photographs
from tests.scenarios.mixtures.surveys.scenes import scene
from tests.scenarios.mixtures.surveys.survey import Photo, Survey
from tests.scenarios.mixtures.surveys.ties import levelling
from tests.scenarios.mixtures.world import looking, rotation

EPOCHS = ("2015-04-01", "2016-04-01", "2018-10-01")
YEARS = (0.0, 366.0 / 365.25, 1279.0 / 365.25)


def epochs(seed: int) -> Survey:
    """Images and stations of two or three epochs; a third of the points move, by up to a part in a hundred a year."""
    survey = scene(seed)
    count = int(survey.draw.integers(2, 4))
    number = int(survey.draw.integers(1, 4)) * count
    images = int(survey.draw.integers(2, 6)) * count if survey.chance(0.8) else 0
    for name in [*(f"s{k}" for k in range(number)), *(f"i{k}" for k in range(images))]:
        survey.times[name] = YEARS[int(name[1:]) % count]
    reach = survey.size * 10.0 ** survey.draw.uniform(-4.0, -2.0)
    survey.moves = {p: reach * survey.draw.standard_normal(3) for p in survey.marks if survey.draw.random() < 0.33}
    stations(survey, number)
    if images:
        photographs(survey, images)
        measure_photographs(survey)
    if survey.chance(0.3, "levelling"):
        levelling(survey)
    prune(survey)
    moving = [p for p in survey.moves if p in survey.marks]
    survey.more["epochs"] = {"reference": EPOCHS[0]}
    known = {"vx": 0.0, "vy": 0.0, "vz": 0.0, "sigma": survey.in_length(2.0 * reach)}
    observed = {"values": known} if survey.chance(0.8) else {}
    survey.more["motions"] = [{"model": "velocity", "points": moving, **observed}]
    finish(survey)
    for (section, _), (_, rows) in survey.tables.items():
        for row in rows:
            if section in ("images", "stations"):
                row["epoch"] = EPOCHS[YEARS.index(survey.times.get(str(row["id"]), 0.0))]
            elif section == "observations" and not {"image", "station"} & set(row):
                begin = str(row.get("from", ""))
                row["epoch"] = EPOCHS[YEARS.index(_time_of(survey, begin))]
    return survey


def _time_of(survey: Survey, name: str) -> float:
    """Of an instrument, or of the one that stands over a mark."""
    over = {mark: station for station, mark in survey.stations.items()}
    return survey.times.get(over.get(name, name), 0.0)


def panoramas(seed: int) -> Survey:
    """Panoramas, of which nobody knows where they are, with images or stations, or alone."""
    survey = scene(seed)
    if survey.chance(0.5):
        stations(survey, int(survey.draw.integers(1, 3)))
    if survey.chance(0.5):
        photographs(survey, int(survey.draw.integers(2, 6)))
        measure_photographs(survey)
    c, sigma = 50.0, 0.004
    survey.more["cameras"] = {"pano": {"model": "panorama", "interior": {"c": c}}}
    names = survey.seen_marks("images")
    for k in range(int(survey.draw.integers(2, 6))):
        inside = 0.15 if "room" in survey.tags else 0.9
        place = inside * survey.size * survey.draw.uniform(-1.0, 1.0, 3) * [1.0, 1.0, 0.3]
        heading = survey.draw.uniform(0.0, 2.0 * np.pi)
        tilt = rotation(survey.one_of(0.0, 0.02, 0.2) * survey.draw.standard_normal(3))
        D = tilt @ looking(place, place + np.array([np.cos(heading), np.sin(heading), 0.0]), 0.0)
        survey.photos[f"p{k}"] = Photo("pano", place, D)
        for name in names:
            x, y, z = D @ (survey.marks[name].xyz - place)
            steep = y / np.hypot(x, z)
            if abs(steep) < 1.0 and survey.draw.random() < survey.marks[name].share:
                reading = c * np.array([np.arctan2(x, -z), steep]) + sigma * survey.draw.standard_normal(2)
                keys = {"type": "image", "values": {"sigma": sigma}}
                survey.row(
                    "observations",
                    "panoramas",
                    keys,
                    image=f"p{k}",
                    point=name,
                    x=float(reading[0]),
                    y=float(reading[1]),
                )
    prune(survey)
    finish(survey)
    return survey


def rolling(seed: int) -> Survey:
    """A camera that moves while its rows are read, with gyroscopes; some stations beside."""
    survey = scene(seed)
    stations(survey, int(survey.draw.integers(0, 3)))
    photographs(survey, int(survey.draw.integers(4, 14)))
    for camera in survey.cameras.values():
        camera.free, camera.true, camera.pixels = False, (camera.c, 0.0, 0.0), True
    readout = float(survey.draw.uniform(0.01, 0.06))
    motions: dict[str, FloatArray] = {}
    names = survey.seen_marks("images")
    for image, photo in survey.photos.items():
        camera = survey.cameras[photo.camera]
        v = survey.size * 0.1 * survey.draw.standard_normal(3) * [1.0, 1.0, 0.2]
        w = 0.1 * survey.draw.standard_normal(3)
        motions[image] = np.concatenate([v, w])
        for name in names:
            xy = _rolled(survey, photo, survey.marks[name].xyz, (v, w), readout)
            if xy is None or survey.draw.random() > survey.marks[name].share:
                continue
            x, y = xy + camera.sigma * survey.draw.standard_normal(2)
            keys = {"type": "image", "values": {"sigma": camera.sigma / PIXEL}}
            u, down = (x + camera.half[0]) / PIXEL, (camera.half[1] - y) / PIXEL
            survey.row(
                "observations",
                f"image {photo.camera}",
                keys,
                image=image,
                point=name,
                x=float(u),
                y=float(down),
            )
    prune(survey)
    finish(survey)
    for camera in survey.more.get("cameras", {}).values():
        camera["readout"] = f"{1e3 * readout} ms"
    for row in survey.tables.get(("images", "images"), ({}, []))[1]:
        motion = motions[str(row["id"])]
        for axis, value in zip("xyz", motion[:3], strict=True):
            row[f"v{axis}"] = survey.in_length(value + 0.005 * survey.size * survey.draw.standard_normal())
            row[f"sigma_v{axis}"] = survey.in_length(0.005 * survey.size)
        for axis, value in zip("xyz", motion[3:], strict=True):
            row[f"rate_{axis}"] = survey.in_angle(value + 0.005 * survey.draw.standard_normal())
            row[f"sigma_rate_{axis}"] = survey.in_angle(0.005)
    return survey


def _rolled(
    survey: Survey, photo: Photo, xyz: FloatArray, motion: tuple[FloatArray, FloatArray], readout: float
) -> FloatArray | None:
    """Image coordinates (mm) where the row that is read out meets the point; none outside the format."""
    camera, t = survey.cameras[photo.camera], 0.0
    for _ in range(30):
        star = rotation(-motion[1] * t) @ (photo.D @ (xyz - photo.centre) - motion[0] * t)
        if star[2] >= 0.0:
            return None
        xy: FloatArray = -camera.c * star[:2] / star[2]
        t = readout * (-xy[1] / (2.0 * camera.half[1]))
    return xy if bool((np.abs(xy) < camera.half).all()) else None


NEWER: dict[str, Callable[[int], Survey]] = {
    "epochs": epochs, "panoramas": panoramas, "rolling": rolling, "earth": on_the_earth,
}  # fmt: skip
