"""Surveys on the earth: control in a projection, everything else found; plumb lines are normals of the ellipsoid."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from pyproj import Transformer

from mor.arrays import FloatArray
from tests.mixtures.surveys.photographs import write_cameras
from tests.mixtures.surveys.survey import Camera, Mark, Photo, Start, Survey
from tests.mixtures.world import looking

_TO_GEOCENTRIC = Transformer.from_crs("EPSG:25832", "EPSG:4936", always_xy=True)
_TO_GEOGRAPHIC = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True)


def on_the_earth(seed: int) -> Survey:
    """GNSS vectors, total stations, levelling and images over some kilometres, between control points."""
    draw = np.random.default_rng([seed, 5])
    size = float(10.0 ** draw.uniform(2.3, 4.0))
    origin = np.array([draw.uniform(350e3, 650e3), draw.uniform(5250e3, 5900e3), draw.uniform(-20.0, 1500.0)])
    survey = Survey(seed, draw, size, "m", str(draw.choice(["gon", "deg", "rad"])), origin, 0.003, 5e-6)
    for k in range(int(draw.integers(10, 30))):
        survey.marks[f"p{k}"] = Mark(size * draw.uniform(-0.5, 0.5, 3) * [1.0, 1.0, 0.1])
    names = list(survey.marks)
    used = _stations(survey, names) | _vectors(survey, names)
    if survey.chance(0.5, "images"):
        used |= _images(survey, names)
    if survey.chance(0.4, "levelling"):
        used |= _levelling(survey, names)
    _control(survey, [p for p in names if p in used])
    return survey


def geocentric(survey: Survey, xyz: FloatArray) -> FloatArray:
    """Geocentric coordinates (3,) of a place east, north, up of the middle in the projection."""
    return np.array(_TO_GEOCENTRIC.transform(*(survey.origin + xyz)))


def _horizon(survey: Survey, xyz: FloatArray) -> FloatArray:
    """(3, 3) east, north and up at a place, geocentric."""
    longitude, latitude = np.radians(_TO_GEOGRAPHIC.transform(*(survey.origin + xyz)[:2]))
    e = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    u = np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    return np.stack([e, np.cross(u, e), u])


def _stations(survey: Survey, names: list[str]) -> set[str]:
    used: set[str] = set()
    for k in range(int(survey.draw.integers(1, 4))):
        at, height = names[k], round(float(survey.draw.uniform(1.4, 1.8)), 3)
        axes = _horizon(survey, survey.marks[at].xyz)
        begin = geocentric(survey, survey.marks[at].xyz) + height * axes[2]
        turn = float(survey.draw.uniform(0.0, 2.0 * np.pi))
        survey.row("stations", "stations", {}, id=f"s{k}", point=at, height=height)
        far = survey.chance(0.7, "distances")
        for to in names:
            if to == at or survey.draw.random() < 0.3:
                continue
            away = geocentric(survey, survey.marks[to].xyz) - begin
            e, n, u = axes @ away
            keys = {"type": "zenith_directions", **survey.of_angle}
            horizontal, zenith = (np.arctan2(e, n) - turn) % (2.0 * np.pi), np.arctan2(np.hypot(e, n), u)
            cells = {
                "station": f"s{k}",
                "to": to,
                "horizontal": survey.read(horizontal),
                "zenith": survey.read(zenith),
            }
            survey.row("observations", "readings", keys, **cells)
            if far:
                length = survey.measured(float(np.linalg.norm(away)))
                keys = {"type": "distance", **survey.of_length}
                survey.row("observations", "distances", keys, **{"from": f"s{k}", "to": to}, distance=length)
            used |= {at, to}
    return used


def _vectors(survey: Survey, names: list[str]) -> set[str]:
    used: set[str] = set()
    for _ in range(int(survey.draw.integers(0, 8))):
        a, b = (str(p) for p in survey.draw.permutation(names)[:2])
        d = geocentric(survey, survey.marks[b].xyz) - geocentric(survey, survey.marks[a].xyz)
        cells = {f"d{axis}": survey.measured(v) for axis, v in zip("xyz", d, strict=True)}
        survey.row(
            "observations",
            "vectors",
            {"type": "gnss_vector", **survey.of_length},
            **{"from": a, "to": b},
            **cells,
        )
        used |= {a, b}
        survey.tags.add("GNSS vectors")
    return used


def _levelling(survey: Survey, names: list[str]) -> set[str]:
    line = [str(p) for p in survey.draw.permutation(names)[:5]]
    for a, b in pairwise(line):
        dz = survey.measured(survey.marks[b].xyz[2] - survey.marks[a].xyz[2])
        keys = {"type": "ellipsoidal_height_difference", **survey.of_length}
        survey.row("observations", "levelling", keys, **{"from": a, "to": b}, dz=dz)
    return set(line)


def _images(survey: Survey, names: list[str]) -> set[str]:
    """Nearly vertical images over the middle; their axes count in the horizon there."""
    camera = Camera(100.0, np.array([75.0, 75.0]), 0.004, False, False, (100.0, 0.0, 0.0))
    survey.cameras["c"] = camera
    axes, middle = _horizon(survey, np.zeros(3)), geocentric(survey, np.zeros(3))
    local = {p: axes @ (geocentric(survey, survey.marks[p].xyz) - middle) for p in names}
    seen: set[str] = set()
    for k in range(int(survey.draw.integers(3, 7))):
        place = survey.size * np.array([*survey.draw.uniform(-0.4, 0.4, 2), survey.draw.uniform(0.9, 1.3)])
        D = looking(place, place * [0.9, 0.9, 0.0], float(0.1 * survey.draw.standard_normal()))
        rows = []
        for p in names:
            star = D @ (local[p] - place)
            xy = -camera.c * star[:2] / star[2]
            if (np.abs(xy) < camera.half).all():
                rows.append((p, *(xy + camera.sigma * survey.draw.standard_normal(2))))
        if len(rows) < 8:
            continue
        survey.photos[f"i{k}"] = Photo("c", place, D)
        survey.row("images", "images", {}, id=f"i{k}", camera="c")
        for p, x, y in rows:
            keys = {"type": "image", "values": {"sigma": camera.sigma}}
            survey.row("observations", "images", keys, image=f"i{k}", point=p, x=float(x), y=float(y))
        seen |= {row[0] for row in rows}
    write_cameras(survey)
    return seen


def _control(survey: Survey, names: list[str]) -> None:
    """The first tables of points: some are held, the others have no coordinates."""
    survey.more["world"] = {"crs": "EPSG:25832", "heights": "ellipsoidal"}
    held = {str(p) for p in survey.draw.permutation(names)[: int(survey.draw.integers(2, 5))]}
    for p in names:
        place = dict(zip(("east", "north", "height"), survey.origin + survey.marks[p].xyz, strict=True))
        if p in held:
            survey.row("points", "control", {"fixed": ["x", "y", "z"]}, id=p, **place)
        else:
            survey.row(
                "points", "new", {}, id=p, **{key: Start(float(value)) for key, value in place.items()}
            )
