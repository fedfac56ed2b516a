"""Networks for the tests of reliability and of gross errors: correlated ones, and a well-built block of many rays."""

from __future__ import annotations

import numpy as np

from tests.scenarios.scenes import CAMERA_STATIONS, Scene, add_image, mixed_network


def correlated_everywhere() -> tuple[Scene, list[str]]:
    """A mixed network in which observations of several groups, and parts of rows, are correlated."""
    scene, points = mixed_network()
    scene.observe("observed/point", "P9", sigma=1.0)
    entries = [
        ("observed/point", 0, 0),
        ("observed/point", 0, 1),
        ("zenith_directions", 3, 0),
        ("distance", 3, 0),
        ("image/mor", 20, 1),
    ]
    sigma = np.array([1e-3, 1e-3, 2e-5, 1e-3, 1e-3])
    factor = np.tril(np.random.default_rng(3).uniform(-0.6, 0.6, (5, 5))) + np.eye(5)
    scene.correlate(entries, factor @ factor.T * np.outer(sigma, sigma))
    return scene, points


def well_built_block() -> tuple[Scene, list[str]]:
    """Nine images of thirty points from all sides, four of them known: 270 rays."""
    random = np.random.default_rng(11)
    scene = Scene()
    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.2, 1.8], [0.3, 3.4, 1.6], [4.1, 3.1, -0.2]])
    places = np.concatenate([corners, random.uniform([0.0, 0.0, -0.5], [4.0, 3.5, 2.0], (26, 3))])
    points = [scene.add("point", f"P{i}", xyz, free=i >= 4) for i, xyz in enumerate(places)]
    for k in range(9):
        angle = 2.0 * np.pi * k / 9.0
        position = np.array([2.0, 1.7, 2.0 + 1.5 * (k % 3)]) + 8.5 * np.array([np.cos(angle), np.sin(angle), 0.0])
        add_image(scene, f"I{k}", position, points)
    return scene, points


def plant(
    problem,
    group: int,
    rows: np.ndarray,
    sizes: np.ndarray,  # type: ignore[no-untyped-def]
) -> None:
    """Add gross errors (k, m) in units of σ to rows (k,) of a group, in place."""
    observations = problem.groups[group]
    observations.observed[rows] += sizes * observations.sigma[rows]


__all__ = ["CAMERA_STATIONS", "correlated_everywhere", "plant", "well_built_block"]
