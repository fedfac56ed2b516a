"""Two blocks of images without a common point, and one sort of observation between them, nothing given."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.control import control
from tests.scenarios.mixtures.surveys.photographs import measure_photographs, write_cameras, write_images
from tests.scenarios.mixtures.surveys.scenes import KINDS, ORIGINS, write_points
from tests.scenarios.mixtures.surveys.survey import Camera, Mark, Photo, Start, Survey
from tests.scenarios.mixtures.world import about_z, looking

EACH = 14
"""Points of each block."""


def tied(seed: int) -> Survey:
    """A survey of a seed; the sort of observation goes round."""
    draw = np.random.default_rng([seed, 4711])
    kind = str(draw.choice(list(KINDS)))
    size = float(np.exp(draw.uniform(*np.log(KINDS[kind][:2]))))
    origin = np.array(ORIGINS[int(draw.integers(3))]) * (size / 1000.0 if size < 20.0 else 1.0)
    unit = str(draw.choice(KINDS[kind][2]))
    survey = Survey(seed, draw, size, unit, str(draw.choice(["gon", "deg"])), origin, 2e-5 * size, 1e-5)
    _blocks(survey)
    measure_photographs(survey)
    name = list(SORTS)[seed % len(SORTS)]
    survey.tags |= {kind, f"tied by {name}"}
    SORTS[name](survey)
    control(survey)
    if survey.more["datum"] == "free":
        _bar(survey)
    write_points(survey)
    write_cameras(survey)
    write_images(survey, {})
    return survey


def _blocks(survey: Survey) -> None:
    survey.cameras["cam"] = Camera(30.0, np.array([18.0, 12.0]), 0.002, False, False, (30.0, 0.0, 0.0))
    for block, side in (("L", -0.6), ("R", 0.6)):
        middle = survey.size * np.array([side, 0.2 * survey.draw.standard_normal(), 0.0])
        names = [f"{block}{k}" for k in range(EACH)]
        for name in names:
            away = survey.draw.uniform(-0.5, 0.5, 3) * [0.8, 0.7, 0.5]
            survey.marks[name] = Mark(middle + survey.size * away)
        for k in range(4):
            angle = survey.draw.uniform(-0.3, 0.3) + 0.5 * k - np.pi / 2.0 - 0.75
            out = np.array([np.cos(angle), np.sin(angle), survey.draw.uniform(0.0, 0.5)])
            place = middle + 1.8 * survey.size * out
            roll = float(survey.one_of(0.0, np.pi / 2.0))
            photo = Photo("cam", place, looking(place, middle, roll), frozenset(names))
            survey.photos[f"{block.lower()}{k}"] = photo


def _some(survey: Survey, block: str, count: int) -> list[str]:
    return [f"{block}{k}" for k in survey.draw.permutation(EACH)[:count]]


def _between(survey: Survey, count: int) -> list[tuple[str, str, FloatArray]]:
    """Pairs of a point of each block, and what leads from the one to the other."""
    pairs = zip(_some(survey, "L", count), _some(survey, "R", count), strict=True)
    return [(a, b, survey.marks[b].xyz - survey.marks[a].xyz) for a, b in pairs]


def _observe(survey: Survey, kind: str, keys: dict[str, object], **cells: object) -> None:
    survey.row("observations", kind, {"type": kind, **keys}, **cells)  # type: ignore[arg-type]


def _bar(survey: Survey) -> None:
    a, b = _some(survey, "L", 2)
    length = survey.measured(float(np.linalg.norm(survey.marks[a].xyz - survey.marks[b].xyz)))
    _observe(survey, "distance", survey.of_length, **{"from": a, "to": b, "distance": length})


def _distances(survey: Survey) -> None:
    for a, b, d in _between(survey, 12):
        length = survey.measured(float(np.linalg.norm(d)))
        _observe(survey, "distance", survey.of_length, **{"from": a, "to": b, "distance": length})


def _levelling_and_plan(survey: Survey) -> None:
    names = [*_some(survey, "L", 6), *_some(survey, "R", 6)]
    for a, b in zip(names, [*names[1:], names[0]], strict=True):
        dz = survey.measured(float((survey.marks[b].xyz - survey.marks[a].xyz)[2]))
        _observe(survey, "height_difference", survey.of_length, **{"from": a, "to": b, "dz": dz})
    for a, b, d in _between(survey, 8):
        length = survey.measured(float(np.hypot(d[0], d[1])))
        _observe(survey, "horizontal_distance", survey.of_length, **{"from": a, "to": b, "distance": length})


def _spatial_angles(survey: Survey) -> None:
    for a, b, d in _between(survey, 14):
        block, fixed, line = (b[0], a, d) if survey.draw.random() < 0.5 else (a[0], b, -d)
        other = next(p for p in _some(survey, block, 2) if p not in (a, b))
        second = survey.marks[other].xyz - survey.marks[fixed].xyz
        angle = survey.read(float(np.arctan2(np.linalg.norm(np.cross(line, second)), line @ second)))
        ends = {"at": fixed, "from": b if fixed == a else a, "to": other}
        _observe(survey, "spatial_angle", survey.of_angle, **ends, angle=angle)


def _vectors(survey: Survey) -> None:
    for a, b, d in _between(survey, 4):
        cells = {f"d{axis}": survey.measured(float(v)) for axis, v in zip("xyz", d, strict=True)}
        _observe(survey, "vector", survey.of_length, **{"from": a, "to": b}, **cells)


def _bearings_and_zeniths(survey: Survey) -> None:
    for a, b, d in _between(survey, 8):
        ends = {"from": a, "to": b}
        _observe(survey, "bearing", survey.of_angle, **ends, bearing=survey.read(np.arctan2(d[0], d[1])))
        zenith = survey.read(np.arctan2(np.hypot(d[0], d[1]), d[2]))
        _observe(survey, "zenith_angle", survey.of_angle, **ends, zenith_angle=zenith)


def _station(survey: Survey, number: int, reads: str) -> None:
    """Directions (h), zenith angles (z) and distances (d) to points of both blocks from an unknown place."""
    place = survey.size * np.array([0.4 * number - 0.4, -1.2, 0.3 * survey.draw.standard_normal()])
    over, name = f"mark {number}", f"s{number}"
    survey.marks[over] = Mark(place, "none")
    D = about_z(float(survey.draw.uniform(-np.pi, np.pi)))
    if "h" in reads:
        kappa = Start(survey.in_angle(float(np.arctan2(D[0, 1], D[0, 0]))))
        survey.row("stations", "stations", {}, id=name, point=over, height=0.0, kappa=kappa)
    for to in [*_some(survey, "L", 7), *_some(survey, "R", 7)]:
        x, y, z = away = D @ (survey.marks[to].xyz - place)
        if "h" in reads:
            horizontal = survey.read(np.arctan2(x, y) % (2.0 * np.pi))
            _observe(survey, "zenith_directions", survey.of_angle, station=name, to=to, horizontal=horizontal)
        ends = {"from": over, "to": to}
        if "z" in reads:
            zenith = survey.read(np.arctan2(np.hypot(x, y), z))
            _observe(survey, "zenith_angle", survey.of_angle, **ends, zenith_angle=zenith)
        if "d" in reads:
            length = survey.measured(float(np.linalg.norm(away)))
            _observe(survey, "distance", survey.of_length, **ends, distance=length)


def _horizontal_sets(survey: Survey) -> None:
    for number in range(3):
        _station(survey, number, "h")


def _zeniths_and_distances(survey: Survey) -> None:
    for number in range(2):
        _station(survey, number, "zd")


def _sets_and_distances(survey: Survey) -> None:
    _station(survey, 0, "hd")


def _distances_to_unknown_places(survey: Survey) -> None:
    for number in range(3):
        _station(survey, number, "d")


SORTS: dict[str, Callable[[Survey], None]] = {
    "distances": _distances,
    "levelling and plan": _levelling_and_plan,
    "spatial angles": _spatial_angles,
    "vectors": _vectors,
    "bearings and zenith angles": _bearings_and_zeniths,
    "horizontal sets": _horizontal_sets,
    "zenith angles and distances": _zeniths_and_distances,
    "a set with distances": _sets_and_distances,
    "distances to unknown places": _distances_to_unknown_places,
}
