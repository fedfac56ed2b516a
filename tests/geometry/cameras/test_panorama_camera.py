"""The panorama: derivatives, an ideal one against a theodolite, and the turning line camera found by search."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from mor.model.fisheye import PANORAMA

NAMES = [component.name for component in PANORAMA.components]
VALUES = {
    "c": 50.0,
    "xh": 0.3,
    "yh": -0.2,
    "rate": 1e-3,
    "ahead": 0.03,
    "aside": -0.02,
    "lean": 2e-3,
    "pitch": -4e-3,
    "A1": -1e-5,
    "A2": 2e-9,
    "a1": 3e-4,
    "b1": -2e-4,
    "a2": 1e-4,
    "b2": 2e-4,
}
POINTS = np.array(
    [
        [1.0, 0.7, -5.0],
        [4.0, -1.5, 0.5],
        [-3.0, 1.0, 4.0],
        [0.2, 2.0, 6.0],
        [-6.0, -2.0, -0.1],
        [1.5, 0.4, 1.0],
    ]
)


def interior(**values: float) -> np.ndarray:
    return np.tile([values.get(name, 0.0) for name in NAMES], (len(POINTS), 1))


def project(points: np.ndarray, inner: np.ndarray, measured: np.ndarray | None = None):
    near = np.zeros((len(points), 2)) if measured is None else measured
    return PANORAMA.project(points, inner, np.zeros((len(points), 0)), near)


def test_derivatives(assert_derivatives) -> None:
    measured = project(POINTS, interior(**VALUES)).xy
    assert_derivatives(PANORAMA, POINTS, interior(**VALUES), np.zeros((len(POINTS), 0)), measured)


def test_an_ideal_panorama_has_the_directions_of_a_theodolite() -> None:
    xy = project(POINTS, interior(c=50.0)).xy
    right, up, ahead = POINTS[:, 0], POINTS[:, 1], -POINTS[:, 2]  # x, z and y of a levelled theodolite
    np.testing.assert_allclose(xy[:, 0] / 50.0, np.arctan2(right, ahead), atol=1e-14)
    zenith = np.arctan2(np.hypot(right, ahead), up)
    np.testing.assert_allclose(np.arctan(xy[:, 1] / 50.0), np.pi / 2.0 - zenith, atol=1e-14)


def test_x_counts_on_to_the_turn_that_was_measured() -> None:
    inner = interior(c=50.0)
    plain = project(POINTS, inner).xy
    measured = plain + np.array([2.0 * np.pi * 50.0, 0.0]) + 0.1
    np.testing.assert_allclose(project(POINTS, inner, measured).xy, measured - 0.1, rtol=1e-14)


def test_it_is_the_line_camera_that_turns() -> None:
    """Turned until the point is in its line, the line camera images it there: searched for, not solved."""
    v = VALUES
    found = project(POINTS, interior(**v)).xy
    for point, xy in zip(POINTS, found, strict=True):

        def in_line_camera(alpha: float, point: np.ndarray = point) -> np.ndarray:
            sight, right = (
                np.array([np.sin(alpha), 0.0, -np.cos(alpha)]),
                np.array([np.cos(alpha), 0.0, np.sin(alpha)]),
            )
            apart = point - v["ahead"] * sight - v["aside"] * right
            return np.array([apart @ right, apart[1], apart @ sight])

        def beside(alpha: float) -> float:
            across, up, _ = in_line_camera(alpha)
            return across - v["lean"] * up

        middle = np.arctan2(point[0], -point[2])
        alpha = brentq(beside, middle - 0.3, middle + 0.3, xtol=1e-15)
        _, up, depth = in_line_camera(alpha)
        y = v["c"] * np.tan(np.arctan2(up, depth) - v["pitch"])
        waves = (
            v["a1"] * np.sin(alpha)
            + v["b1"] * np.cos(alpha)
            + v["a2"] * np.sin(2 * alpha)
            + v["b2"] * np.cos(2 * alpha)
        )
        x = v["xh"] + v["c"] * (1 + v["rate"]) * (alpha + waves)
        np.testing.assert_allclose(xy, [x, v["yh"] + y * (1 + v["A1"] * y**2 + v["A2"] * y**4)], atol=1e-11)


def test_a_point_at_the_axis_has_no_image() -> None:
    at = np.tile([[0.005, 0.1, 0.0]], (len(POINTS), 1))
    assert np.isnan(project(at, interior(**VALUES)).xy).all(axis=0).any()
