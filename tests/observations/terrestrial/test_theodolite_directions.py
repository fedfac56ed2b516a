"""Directions of a theodolite: orientation, tilt, heights, faces, against plain trigonometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mor.model.contract import wrap
from mor.model.observation_types import ALL_TYPES
from mor.model.rotations import rotation_from_angles

STATION, POINT = np.array([[10.0, 20.0, 3.0]]), np.array([[17.0, 12.0, 5.0]])
INSTRUMENT, TARGET = np.array([[1.5]]), np.array([[0.3]])
RADIUS = 6_371_000.0


def directions(key="directions", angles=(0.0, 0.0, 0.0), k=0.0, face=1.0):
    D = rotation_from_angles(np.array([angles]))
    blocks = [STATION, D, INSTRUMENT, POINT, TARGET, np.array([[k]])]
    return ALL_TYPES[key].equation(blocks, np.array([[RADIUS, face]])).values[0]


BEARING = math.atan2(7.0, -8.0)
ELEVATION = math.atan2(5.0 + 0.3 - 3.0 - 1.5, math.hypot(7.0, 8.0))


def test_a_levelled_circle_reads_bearing_plus_orientation():
    for kappa in (0.0, 0.4, -1.0):
        horizontal, vertical = directions(angles=(0.0, 0.0, kappa))
        assert wrap(np.array(horizontal - BEARING - kappa)) == pytest.approx(0.0, abs=1e-14)
        assert vertical == pytest.approx(ELEVATION, abs=1e-15)


def test_a_tilted_frame_sees_the_point_in_its_own_axes():
    angles = (0.2, -0.3, 0.9)
    star = rotation_from_angles(np.array(angles)) @ [7.0, -8.0, 0.8]
    horizontal, vertical = directions(angles=angles)
    assert horizontal == pytest.approx(math.atan2(star[0], star[1]), abs=1e-14)
    assert vertical == pytest.approx(math.asin(star[2] / np.linalg.norm(star)), abs=1e-14)


def test_face_two_reads_the_other_side_of_both_circles():
    one, two = directions(face=1.0), directions(face=2.0)
    assert wrap(np.array(two[0] - one[0] - math.pi)) == pytest.approx(0.0, abs=1e-15)
    assert two[1] == pytest.approx(math.pi - one[1], abs=1e-15)
    zenith_one, zenith_two = (directions("zenith_directions", face=face) for face in (1.0, 2.0))
    assert zenith_one[1] == pytest.approx(math.pi / 2 - ELEVATION, abs=1e-15)
    assert zenith_one[1] + zenith_two[1] == pytest.approx(2 * math.pi, abs=1e-15)
    np.testing.assert_array_equal([zenith_one[0], zenith_two[0]], [one[0], two[0]])


@pytest.mark.parametrize("face", [1.0, 2.0])
def test_refraction_makes_zenith_angles_smaller_in_face_one(face):
    bending = 0.13 * math.hypot(7.0, 8.0) / (2.0 * RADIUS)
    sign = 1.0 if face == 1.0 else -1.0
    vertical = directions(k=0.13, face=face)[1] - directions(face=face)[1]
    zenith = directions("zenith_directions", k=0.13, face=face)[1] - directions("zenith_directions", face=face)[1]
    assert vertical == pytest.approx(sign * bending, abs=2e-15)
    assert zenith == pytest.approx(-sign * bending, abs=2e-15)


def test_in_a_levelled_frame_vertical_directions_are_those_between_points():
    blocks = [STATION, INSTRUMENT, POINT, TARGET, np.array([[0.2]])]
    plain = ALL_TYPES["vertical_direction"].equation(blocks, np.array([[RADIUS]])).values[0, 0]
    assert directions(angles=(0.0, 0.0, 1.1), k=0.2)[1] == pytest.approx(plain, abs=1e-15)
