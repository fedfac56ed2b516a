"""COLMAP's FOV and thin prism fisheyes: its own numbers, derivatives, limits, and back from image to ray."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS

from .conftest import AssertDerivatives

POINTS = np.array([[0.3, -0.2, 1.0], [-1.5, 0.7, 1.2], [0.0, 0.9, 1.0], [2.5, 1.5, 0.8], [0.01, 0.02, 1.0]])
"""In COLMAP's axes: right, down, forward."""
INTERIOR = {
    "fov": [700, 705, 800, 600, 0.9],
    "thin-prism-fisheye": [700, 705, 800, 600, -0.02, 4e-3, 1e-3, -2e-3, -1e-3, 2e-4, 3e-3, -4e-3],
    "rad-tan-thin-prism-fisheye": [
        *(700, 705, 800, 600, -0.02, 4e-3, -1e-3, 2e-4, 3e-5, -1e-5, 1e-3, -2e-3, 3e-3, -4e-3, 2e-3, 1e-3),
    ],
}
GOLDEN = {
    "fov": [
        *([1016.9193280156533, 454.35416547520424], [146.60376463467765, 907.0962306217016]),
        *([800.0, 1160.6363271526345], [1663.0595268045174, 1121.5345426261583]),
        [807.5130213184066, 615.1333715127903],
    ],
    "thin-prism-fisheye": [
        *([1000.8527526078898, 464.94473700205674], [208.70125631609767, 876.3204480001218]),
        *([800.3759125813845, 1111.2317552469249], [1560.7876444153835, 1055.424131217121]),
        [806.9991136085633, 614.0964526416668],
    ],
    "rad-tan-thin-prism-fisheye": [
        *([1001.6419349140349, 464.8192267605995], [212.84477724875273, 876.6437064374945]),
        *([800.6980151230192, 1110.3213593594012], [1559.0929833888135, 1062.212580245801]),
        [806.9997426795534, 614.0966642642263],
    ],
}
"""What ``Camera.img_from_cam`` of pycolmap 4.2.1 gives for these points, px."""
MODELS = pytest.mark.parametrize("key", GOLDEN)


def _project(key: str, points: np.ndarray, interior: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    model = CAMERA_MODELS[key]
    rows = np.tile(np.array(interior, dtype=float), (len(points), 1))
    return model.project(points * [1, -1, -1], rows, np.zeros((len(points), 0)), np.zeros((len(points), 2)))


@MODELS
def test_image_points_are_colmaps(key: str) -> None:
    found = _project(key, POINTS, INTERIOR[key])[0] * [1, -1]
    np.testing.assert_allclose(found, GOLDEN[key], rtol=0, atol=1e-9)


@MODELS
def test_derivatives(key: str, assert_derivatives: AssertDerivatives) -> None:
    rng = np.random.default_rng(11)
    n = 200
    depth = rng.uniform(1.0, 10.0, n)
    star = np.column_stack([rng.uniform(-1.5, 1.5, (n, 2)) * depth[:, None], -depth])
    star[:20, :2] *= 1e-3
    interior = np.tile(INTERIOR[key], (n, 1)) * rng.uniform(0.8, 1.2, (n, len(INTERIOR[key])))
    assert_derivatives(CAMERA_MODELS[key], star, interior, np.zeros((n, 0)), np.zeros((n, 2)))


def test_derivatives_beside_and_behind_the_camera(assert_derivatives: AssertDerivatives) -> None:
    rng = np.random.default_rng(12)
    star = np.column_stack([rng.uniform(1.0, 2.0, (50, 2)), rng.uniform(-0.2, 1.0, 50)])
    for key in ("thin-prism-fisheye", "rad-tan-thin-prism-fisheye"):
        interior = np.tile(INTERIOR[key], (50, 1))
        assert_derivatives(CAMERA_MODELS[key], star, interior, np.zeros((50, 0)), np.zeros((50, 2)))


@MODELS
def test_image_points_lead_back_to_their_rays(key: str) -> None:
    """Newton's method with the model's own derivatives finds the ray of an image point again."""
    wanted = POINTS[:, :2] / POINTS[:, 2:]
    image = _project(key, POINTS, INTERIOR[key])[0]
    found = np.zeros_like(wanted)
    for _ in range(60):
        xy, by_star, _ = _project(key, np.column_stack([found, np.ones(len(found))]), INTERIOR[key])
        step = np.linalg.solve(by_star[:, :, :2] * [1, -1], (image - xy)[:, :, None])[:, :, 0]
        found += step / np.maximum(1.0, np.abs(step) / 0.3)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


def test_without_its_own_terms_a_prism_camera_is_the_fisheye() -> None:
    plain = [700.0, 705.0, 800.0, 600.0]
    k = [-0.02, 4e-3, -1e-3, 2e-4]
    expected = _project("fisheye", POINTS, [*plain, *k, 0.0])[0]
    thin = _project("thin-prism-fisheye", POINTS, [*plain, *k[:2], 0, 0, *k[2:], 0, 0])[0]
    other = _project("rad-tan-thin-prism-fisheye", POINTS, [*plain, *k, *[0.0] * 8])[0]
    np.testing.assert_allclose([thin, other], [expected, expected], rtol=0, atol=1e-10)


def test_fov_goes_over_into_the_central_projection_without_a_step() -> None:
    """At ω = 0 exactly, beside it, and where series and closed form meet."""
    plain = _project("opencv", POINTS, [700.0, 705.0, 800.0, 600.0, *[0.0] * 8])[0]
    np.testing.assert_array_equal(_project("fov", POINTS, [700.0, 705.0, 800.0, 600.0, 0.0])[0], plain)
    np.testing.assert_allclose(_project("fov", POINTS, [700.0, 705.0, 800.0, 600.0, 1e-6])[0], plain, atol=1e-8)
    t = 2.0 * np.tan(0.45)
    border = 0.1 / t
    at = np.array([[border * (1.0 - 1e-12), 0, 1.0], [border * (1.0 + 1e-12), 0, 1.0]])
    xy, by_star, by_interior = _project("fov", at, INTERIOR["fov"])
    np.testing.assert_allclose(xy[0], xy[1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(by_star[0], by_star[1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(by_interior[0], by_interior[1], rtol=0, atol=1e-8)


def test_fov_on_the_axis() -> None:
    xy, by_star, _ = _project("fov", np.array([[0.0, 0.0, 2.0]]), INTERIOR["fov"])
    assert xy[0].tolist() == [800.0, -600.0]
    assert np.isfinite(by_star).all()
