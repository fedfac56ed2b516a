"""Relations between positions against plain trigonometry: distances, bearings, angles, vertical and zenith, vectors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mor.model.observation_types import ALL_TYPES

START, END = (3.0, -2.0, 1.0), (-1.5, 4.0, 2.5)
INSTRUMENT, TARGET = 1.6, 1.3
DX, DY, DZ = END[0] - START[0], END[1] - START[1], END[2] + TARGET - START[2] - INSTRUMENT


def compute(type_key, *blocks, constants=()):
    kind = ALL_TYPES[type_key]
    arrays = [np.atleast_2d(np.asarray(block, dtype=float)) for block in blocks]
    row = list(constants) or [component.default for component in kind.constants]
    return kind.equation(arrays, np.array([row])).values[0]


def between(type_key, *more, start=START, end=END, heights=(INSTRUMENT, TARGET), constants=()):
    return compute(type_key, start, [heights[0]], end, [heights[1]], *more, constants=constants)


def test_distances_run_from_instrument_to_target():
    meter = [1.0, 0.0]
    assert between("distance", meter)[0] == pytest.approx(math.sqrt(DX**2 + DY**2 + DZ**2), rel=1e-15)
    assert between("horizontal_distance", meter)[0] == pytest.approx(math.hypot(DX, DY), rel=1e-15)


def test_distance_meter_with_scale_and_offset():
    # s = m s_obs + a: a meter that reads 10 mm short at zero and 5 ppm short
    s = math.sqrt(DX**2 + DY**2 + DZ**2)
    observed = between("distance", [1.000005, 0.010])[0]
    assert 1.000005 * observed + 0.010 == pytest.approx(s, rel=1e-15)
    assert observed < s


@pytest.mark.parametrize(
    ("end", "gon"), [((0, 5, 1), 0), ((5, 5, 0), 50), ((5, 0, 0), 100), ((0, -5, 0), 200), ((-5, 0, 9), -100)]
)
def test_bearings_run_clockwise_from_y(end, gon):
    assert between("bearing", start=(0, 0, 0), end=end)[0] == pytest.approx(gon * math.pi / 200, abs=1e-15)


def test_bearings_and_horizontal_distances_know_no_heights():
    for key, more in (("bearing", ()), ("horizontal_distance", ([1.0, 0.0],))):
        assert between(key, *more) == between(key, *more, heights=(0.0, 7.0))


def test_angle_is_foresight_minus_backsight():
    # at the origin from +Y to +X: a quarter of the circle, clockwise
    assert compute("angle", (0, 0, 0), (0, 3, 5), (2, 0, -1))[0] == pytest.approx(math.pi / 2, abs=1e-15)
    assert compute("angle", (0, 0, 0), (2, 0, 0), (0, 3, 0))[0] == pytest.approx(-math.pi / 2, abs=1e-15)


def test_vertical_direction_and_zenith_angle_without_refraction():
    elevation = math.atan2(DZ, math.hypot(DX, DY))
    assert between("vertical_direction", [0.0])[0] == pytest.approx(elevation, abs=1e-15)
    assert between("zenith_angle", [0.0])[0] == pytest.approx(math.pi / 2 - elevation, abs=1e-15)
    second = between("zenith_angle", [0.0], constants=(6_371_000.0, 2.0))[0]
    assert second == pytest.approx(2 * math.pi - (math.pi / 2 - elevation), abs=1e-15)


def test_refraction_lifts_the_target():
    # k = 0.13 over 1 km: 0.13 · 1000 / (2 · 6 371 000) rad, about 2.1 arc seconds
    far = (0.0, 1000.0, 0.0)
    bending = 0.13 * 1000.0 / (2.0 * 6_371_000.0)
    level = between("vertical_direction", [0.13], start=(0, 0, 0), end=far, heights=(0, 0))[0]
    assert level == pytest.approx(bending, rel=1e-12)
    zenith = between("zenith_angle", [0.13], start=(0, 0, 0), end=far, heights=(0, 0))[0]
    assert zenith == pytest.approx(math.pi / 2 - bending, rel=1e-15)
    both_faces = zenith + between(
        "zenith_angle", [0.13], start=(0, 0, 0), end=far, heights=(0, 0), constants=(6_371_000.0, 2.0)
    )
    assert both_faces[0] == pytest.approx(2 * math.pi, rel=1e-15)


def test_vectors_and_height_differences_count_the_heights():
    np.testing.assert_allclose(between("vector"), [DX, DY, DZ], rtol=1e-15)
    np.testing.assert_allclose(between("height_difference"), [DZ], rtol=1e-15)
    # levelled with the instrument between them: two staff readings, no instrument height
    assert between("height_difference", heights=(0.0, 0.0))[0] == END[2] - START[2]
