"""Metashape's frame camera against its published equation, against OpenCV's model, and its derivatives."""

from __future__ import annotations

import numpy as np

from mor.model.cameras import CAMERA_MODELS

MODEL = CAMERA_MODELS["metashape"]
INTERIOR = np.array([3705.5, 11.7, -27.7, 0.53, -0.31, -0.092, -0.076, 0.116, -0.076, -3.1e-4, 1.2e-4, 0.4, -0.2])


def _points(n: int = 40) -> np.ndarray:
    rng = np.random.default_rng(3)
    depth = rng.uniform(5.0, 20.0, n)
    return np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)) * depth[:, None], -depth])


def _project(star: np.ndarray, interior: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = np.broadcast_to(interior, (len(star), len(interior)))
    return MODEL.project(star, rows, np.zeros((len(star), 0)), np.zeros((len(star), 2)))


def test_the_published_equation() -> None:
    f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2, p3, p4 = INTERIOR
    star = _points()
    X, Y, Z = star[:, 0], -star[:, 1], -star[:, 2]  # right, down, forward
    x, y = X / Z, Y / Z
    r = np.hypot(x, y)
    radial = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6 + k4 * r**8
    more = 1 + p3 * r**2 + p4 * r**4
    xd = x * radial + (p1 * (r**2 + 2 * x**2) + 2 * p2 * x * y) * more
    yd = y * radial + (p2 * (r**2 + 2 * y**2) + 2 * p1 * x * y) * more
    u, v = cx + xd * f + xd * b1 + yd * b2, cy + yd * f
    np.testing.assert_allclose(_project(star, INTERIOR)[0], np.column_stack([u, -v]), rtol=0, atol=1e-9)


def test_without_its_own_terms_it_is_opencv() -> None:
    interior = INTERIOR.copy()
    interior[[4, 8, 11, 12]] = 0.0
    f, cx, cy, b1, _, k1, k2, k3, _, p1, p2, _, _ = interior
    other = np.array([f + b1, f, cx, cy, k1, k2, p2, p1, k3, 0, 0, 0])
    star = _points()
    rows = np.broadcast_to(other, (len(star), 12))
    opencv = CAMERA_MODELS["opencv"].project(star, rows, np.zeros((len(star), 0)), np.zeros((len(star), 2)))
    np.testing.assert_allclose(_project(star, interior)[0], opencv.xy, rtol=0, atol=1e-9)


def test_derivatives() -> None:
    star = _points()
    _, by_star, by_interior = _project(star, INTERIOR)
    for k in range(3):
        h = 1e-6
        step = np.eye(3)[k] * h
        there = (_project(star + step, INTERIOR)[0] - _project(star - step, INTERIOR)[0]) / (2 * h)
        np.testing.assert_allclose(by_star[:, :, k], there, rtol=1e-6, atol=1e-5)
    for k in range(13):
        h = 1e-4 if k < 5 else 1e-6
        step = np.eye(13)[k] * h
        there = (_project(star, INTERIOR + step)[0] - _project(star, INTERIOR - step)[0]) / (2 * h)
        np.testing.assert_allclose(by_interior[:, :, k], there, rtol=1e-6, atol=1e-4)
