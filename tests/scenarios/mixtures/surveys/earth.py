"""Surveys on the earth: control in a projection, everything else found; with or without deflections and a geoid."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from mor.model.rotations import angles_from_rotation
from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.gravity import Gravity, deflection, gravity_field, height
from tests.scenarios.mixtures.surveys.photographs import write_cameras
from tests.scenarios.mixtures.surveys.survey import Camera, Mark, Photo, Start, Survey
from tests.scenarios.mixtures.world import looking, rotation

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
    gravity = gravity_field(survey)
    used = _stations(survey, names, gravity) | _vectors(survey, names)
    if survey.chance(0.5, "images"):
        used |= _images(survey, names)
        attitudes(survey)
    if survey.chance(0.4, "levelling"):
        used |= _levelling(survey, names, gravity)
    if survey.chance(0.3, "bearings of the projection"):
        projected_bearings(survey, sorted(used))
    if survey.chance(0.3, "ratios of distances"):
        distance_ratios(survey, sorted(used), gravity)
    _control(survey, [p for p in names if p in used], gravity)
    return survey


def geocentric(survey: Survey, xyz: FloatArray) -> FloatArray:
    """Geocentric coordinates (3,) of a place east, north, up of the middle in the projection."""
    return np.array(_TO_GEOCENTRIC.transform(*(survey.origin + xyz)))


def horizon(survey: Survey, xyz: FloatArray, xi: float = 0.0, eta: float = 0.0) -> FloatArray:
    """(3, 3) east, north and up at a place, geocentric; of the plumb line where it is deflected by ξ, η."""
    longitude, latitude = np.radians(_TO_GEOGRAPHIC.transform(*(survey.origin + xyz)[:2]))
    latitude, longitude = latitude + xi, longitude + eta / np.cos(latitude)
    e = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    u = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    return np.stack([e, np.cross(u, e), u])


def _stations(survey: Survey, names: list[str], gravity: Gravity | None) -> set[str]:
    used: set[str] = set()
    air = air_of(survey)
    for k in range(int(survey.draw.integers(1, 4))):
        at, height = names[k], round(float(survey.draw.uniform(1.4, 1.8)), 3)
        axes = horizon(survey, survey.marks[at].xyz, *deflection(survey, gravity, at))
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
                keys = {"type": "distance", **survey.of_length, **({"instrument": "edm"} if air else {})}
                length, columns = through_air(survey, length) if air else (length, {})
                ends = {"from": f"s{k}", "to": to}
                survey.row("observations", "distances", keys, **ends, distance=length, **columns)
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


def _levelling(survey: Survey, names: list[str], gravity: Gravity | None) -> set[str]:
    line = [str(p) for p in survey.draw.permutation(names)[:5]]
    for a, b in pairwise(line):
        dz = survey.measured(height(survey, gravity, b) - height(survey, gravity, a))
        type_ = "ellipsoidal_height_difference" if gravity is None else "height_difference"
        keys = {"type": type_, **survey.of_length}
        survey.row("observations", "levelling", keys, **{"from": a, "to": b}, dz=dz)
    return set(line)


def _images(survey: Survey, names: list[str]) -> set[str]:
    """Nearly vertical images over the middle; their axes count in the horizon there."""
    camera = Camera(100.0, np.array([75.0, 75.0]), 0.004, False, False, (100.0, 0.0, 0.0))
    survey.cameras["c"] = camera
    axes, middle = horizon(survey, np.zeros(3)), geocentric(survey, np.zeros(3))
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


def _control(survey: Survey, names: list[str], gravity: Gravity | None) -> None:
    """The first tables of points: some are held, the others have no coordinates.

    A grid is read at the coordinates that are given: there all have some, a metre beside.
    """
    heights = "ellipsoidal" if gravity is None else "orthometric"
    survey.more["world"] = {"crs": "EPSG:25832", "heights": heights, **(gravity.keys if gravity else {})}
    held = {str(p) for p in survey.draw.permutation(names)[: int(survey.draw.integers(2, 5))]}
    for p in names:
        place = dict(zip(("east", "north"), (survey.origin + survey.marks[p].xyz)[:2].tolist(), strict=True))
        place["height"] = height(survey, gravity, p)
        columns = gravity.columns(survey, p) if gravity else {}
        if p in held:
            survey.row("points", "control", {"fixed": ["x", "y", "z"]}, id=p, **place, **columns)
            continue
        if gravity is not None and gravity.keys:
            beside = {key: value + float(survey.draw.standard_normal()) for key, value in place.items()}
            survey.row("points", "new", {}, id=p, **beside)
            continue
        starts = {key: Start(value) for key, value in place.items()}
        survey.row("points", "new", {}, id=p, **starts, **columns)


_C, _WAVELENGTH = 281.8, 0.658
"""Of a distance meter: (n_REF − 1) · 10⁶, carrier in µm."""


def air_of(survey: Survey) -> bool:
    """True where distances were measured through air that their tables tell of."""
    if not survey.chance(0.4, "atmosphere"):
        return False
    instrument = {"atmosphere": {"C": _C, "wavelength": f"{_WAVELENGTH} um"}}
    survey.more.setdefault("instruments", {})["edm"] = instrument
    return True


def through_air(survey: Survey, length: float) -> tuple[float, dict[str, float]]:
    """What a distance meter shows, and the columns of the air (dry: its formulae are tested elsewhere)."""
    temperature, pressure = float(survey.draw.uniform(-15.0, 35.0)), float(survey.draw.uniform(800.0, 1030.0))
    D = 273.15 / 1013.25 * (287.604 + 4.8864 / _WAVELENGTH**2 + 0.068 / _WAVELENGTH**4)
    correction = 1e-6 * (_C - D * pressure / (273.15 + temperature))
    columns = {"temperature": temperature, "pressure": pressure, "humidity": 0.0}
    return length / (1.0 + correction), columns


def attitudes(survey: Survey) -> None:
    """Roll, pitch, yaw, or ω, φ, κ of the projection, of images; of an inertial system beside their axes."""
    if not survey.photos or not survey.chance(0.6):
        return
    kind = str(survey.one_of("navigation_attitude", "projected_attitude"))
    survey.tags.add(kind)
    keys: dict[str, Any] = {"type": kind, "values": {"sigma": survey.in_angle(_SIGMA_ATTITUDE)}}
    boresight = np.eye(3)
    if survey.chance(0.6, "misalignment"):
        boresight = rotation(0.03 * survey.draw.standard_normal(3))
        free = {name: {"free": 0} for name in ("omega", "phi", "kappa")}
        survey.more.setdefault("instruments", {})["ins"] = {"boresight": free}
        keys["instrument"] = "ins"
    placed = survey.chance(0.5)
    for image, photo in survey.photos.items():
        middle, centre = horizon(survey, np.zeros(3)), geocentric(survey, np.zeros(3))
        there = np.array(_TO_GEOCENTRIC.transform(*(centre + photo.centre @ middle), direction="INVERSE"))
        axes = horizon(survey, there - survey.origin)
        D = boresight @ photo.D @ middle @ axes.T
        cells: dict[str, float] = {}
        if kind == "projected_attitude":
            D = D @ _grid_north(there, axes).T
            cells = dict(zip(("east", "north"), there[:2].tolist(), strict=True)) if placed else {}
            angles, names = _cardan(D), ("omega", "phi", "kappa")
        else:
            angles, names = _navigation(D), ("roll", "pitch", "yaw")
        noisy = angles + _SIGMA_ATTITUDE * survey.draw.standard_normal(3)
        cells |= {name: survey.in_angle(value) for name, value in zip(names, noisy, strict=True)}
        survey.row("observations", "attitudes", keys, image=image, **cells)


_SIGMA_ATTITUDE = 5e-5


def _grid_north(there: FloatArray, axes: FloatArray) -> FloatArray:
    """(3, 3) from east, north, up to grid east, grid north, up: by two places 20 m apart along grid north."""
    ends = [np.array(_TO_GEOCENTRIC.transform(there[0], there[1] + d, there[2])) for d in (-10.0, 10.0)]
    e, n, _ = axes @ (ends[1] - ends[0])
    length = np.hypot(e, n)
    return np.array([[n / length, -e / length, 0.0], [e / length, n / length, 0.0], [0.0, 0.0, 1.0]])


def _cardan(D: FloatArray) -> FloatArray:
    """ω, φ, κ with D = R_z(κ)ᵀ R_y(φ)ᵀ R_x(ω)ᵀ."""
    return angles_from_rotation(D[None])[0]


def _navigation(D: FloatArray) -> FloatArray:
    """Roll, pitch, yaw of body axes forward = y, right = x, down = −z of the image, in north, east, down."""
    body = np.stack([D[1], D[0], -D[2]], axis=1)[[1, 0, 2]] * [[1.0], [1.0], [-1.0]]
    yaw, pitch, roll = Rotation.from_matrix(body).as_euler("ZYX")
    return np.array([roll, pitch, yaw])


def projected_bearings(survey: Survey, names: list[str]) -> None:
    """Bearings of lines of the projection, which control or other measurements determine already."""
    for _ in range(int(survey.draw.integers(1, 6))):
        a, b = (str(p) for p in survey.draw.permutation(names)[:2])
        east, north = (survey.marks[b].xyz - survey.marks[a].xyz)[:2]
        keys = {"type": "projected_bearing", **survey.of_angle}
        bearing = survey.read(np.arctan2(east, north) % (2.0 * np.pi))
        survey.row("observations", "bearings", keys, **{"from": a, "to": b}, bearing=bearing)


def distance_ratios(survey: Survey, names: list[str], gravity: Gravity | None) -> None:
    """Ratios of distances from an instrument raised along its plumb line, σ of 5 ppm."""
    for _ in range(int(survey.draw.integers(1, 6))):
        at, first, second = (str(p) for p in survey.draw.permutation(names)[:3])
        up = horizon(survey, survey.marks[at].xyz, *deflection(survey, gravity, at))[2]
        begin = geocentric(survey, survey.marks[at].xyz) + 1.5 * up
        one, other = (float(np.linalg.norm(geocentric(survey, survey.marks[p].xyz) - begin)) for p in (first, second))
        ratio = other / one * (1.0 + 5e-6 * float(survey.draw.standard_normal()))
        cells = {"at": at, "from": first, "to": second, "ratio": ratio, "sigma": 5e-6 * other / one}
        survey.row("observations", "ratios", {"type": "distance_ratio"}, **cells, at_height=1.5)
