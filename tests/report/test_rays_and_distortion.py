"""Angles between rays, coverage of images, distortion with its σ: against closed forms and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mor.report.view import RayPairs, covered, distortion, intersection_angles, radial_curve, window


def test_angle_is_that_of_the_two_rays_nearest_to_a_right_angle() -> None:
    start = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 30.0, 0.0]])
    end = np.array([[5.0, 5.0, 0.0], [5.0, 50.0, 0.0], [0.0, 1.0, 0.0]])
    rays = RayPairs(np.array([0, 2, 3, 0, 1, 2, 0]), np.array([0, 1, 1, 1, 1, 0, 2]))
    angles = intersection_angles(rays, start, end)
    assert angles[0] == pytest.approx(np.pi / 4.0)
    assert angles[1] == pytest.approx(2.0 * np.arctan2(5.0, 50.0))
    assert np.isnan(angles[2])


def test_opposite_rays_do_not_intersect() -> None:
    rays = RayPairs(np.array([0, 1]), np.array([0, 0]))
    angle = intersection_angles(rays, np.array([[0.0, 0, 0], [2.0, 0, 0]]), np.array([[1.0, 0.0, 0.0]]))
    assert angle[0] == pytest.approx(0.0, abs=1e-7)


def test_coverage_of_half_an_image() -> None:
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 3.0], [0.0, 3.0], [5.0, 1.0]])
    assert covered(corners, 60.0) == pytest.approx(0.5)
    assert covered(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), 60.0) == 0.0


def test_window_in_pixels_and_in_camera_units() -> None:
    camera = {"unit": "mm", "format": {"width": 6000, "height": 4000, "pixel": 0.004, "origin": "corner"}}
    nothing = np.zeros((0, 2))
    assert window(camera, "px", nothing).x == (0.0, 6000.0)
    centred = {**camera, "format": {**camera["format"], "origin": "centred"}}
    assert window(centred, "mm", nothing).x == pytest.approx((-12.0, 12.0))
    assert window(centred, "um", nothing).y == pytest.approx((-8000.0, 8000.0))


def camera(r0: float = 10.0) -> dict[str, Any]:
    values = {"c": 28.0, "xh": 0.1, "yh": -0.05, "A1": -1e-4, "A2": 1.5e-7, "A3": 0.0}
    values |= {"B1": 1e-5, "B2": -2e-5, "C1": 3e-5, "C2": -1e-5}
    sigma = {"c": 1e-3, "A1": 2e-7, "A2": 5e-10, "B1": 1e-6}
    matrix = np.eye(4)
    matrix[1, 2] = matrix[2, 1] = -0.9
    return {
        "model": "mor",
        "unit": "mm",
        "r0": r0,
        "components": {name: {"value": value, "sigma": sigma.get(name)} for name, value in values.items()},
        "correlations": {"components": list(sigma), "matrix": matrix.tolist()},
    }


def test_radial_curve_is_the_polynomial_and_vanishes_at_r0() -> None:
    curve = radial_curve(camera(), 14.0, 15)
    r = curve.radius
    expected = r * (-1e-4 * (r**2 - 100.0) + 1.5e-7 * (r**4 - 1e4)) + 0.5 * 3e-5 * r
    np.testing.assert_allclose(curve.shift, expected, atol=1e-15)


def test_sigma_of_the_radial_curve() -> None:
    curve = radial_curve(camera(), 14.0, 15)
    r = curve.radius
    a1, a2 = r * (r**2 - 100.0), r * (r**4 - 1e4)
    variance = (a1 * 2e-7) ** 2 + (a2 * 5e-10) ** 2 - 2 * 0.9 * a1 * a2 * 2e-7 * 5e-10
    np.testing.assert_allclose(curve.sigma, np.sqrt(variance), rtol=1e-9, atol=1e-18)


def test_distortion_vectors_follow_the_model() -> None:
    ideal = np.array([[6.0, -8.0], [3.0, 4.0]])
    x, y = ideal.T
    r2 = x**2 + y**2
    radial = -1e-4 * (r2 - 100.0) + 1.5e-7 * (r2**2 - 1e4)
    dx = x * radial + 1e-5 * (r2 + 2 * x**2) - 4e-5 * x * y + 3e-5 * x - 1e-5 * y
    dy = y * radial - 2e-5 * (r2 + 2 * y**2) + 2e-5 * x * y
    outcome = distortion(camera(), ideal)
    np.testing.assert_allclose(outcome.shift, np.column_stack([dx, dy]), atol=1e-14)
    assert np.linalg.eigvalsh(outcome.covariance).min() >= -1e-20


@pytest.mark.parametrize("model", ["brown", "brown-forward"])
def test_other_models_have_their_distortion_too(model: str) -> None:
    mor = camera()
    names = ["c", "xh", "yh", "K1", "K2", "K3", "P1", "P2", "b1", "b2"]
    components = {name: {"value": 0.0, "sigma": None} for name in names}
    components |= {"c": {"value": 28.0, "sigma": None}, "K1": {"value": 1e-5, "sigma": 1e-7}}
    other = {**mor, "model": model, "r0": None, "components": components}
    other["correlations"] = {"components": ["K1"], "matrix": [[1.0]]}
    curve = radial_curve(other, 10.0, 3)
    assert abs(curve.shift[-1]) == pytest.approx(1e-5 * 1000.0, rel=1e-6)
    assert curve.sigma[-1] == pytest.approx(1e-7 * 1000.0, rel=1e-6)


def test_images_of_a_line_scanner_reach_over_all_lines_that_were_measured() -> None:
    camera = {"format": {"width": 8000, "height": 1, "pixel": 0.0065, "origin": "corner"}, "unit": "mm"}
    area = window(camera, "px", np.array([[10.0, 200.0], [7000.0, 12_000.0]]))
    assert area.x == (0.0, 8000.0)
    assert area.y == (200.0, 12_000.0)
