"""The ellipsoid of the simulated dam against PROJ: it shares nothing with the program, and so is checked by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pyproj import Transformer

ROOT = Path(__file__).resolve().parents[2]
from mor.project.reference_system import geoid_heights  # noqa: E402
from sample_projects.simulate import earth  # noqa: E402


def test_projection_and_geocentric_coordinates_against_proj(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    places = np.column_stack(
        [
            np.radians(random.uniform(44, 56, 40)),
            np.radians(random.uniform(6, 12, 40)),
            random.uniform(-100, 3000, 40),
        ]
    )
    longitude, latitude = np.degrees(places[:, 1]), np.degrees(places[:, 0])
    plane = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True).transform(longitude, latitude)
    np.testing.assert_allclose(earth.utm(places), np.stack(plane, axis=1), atol=2e-8)
    np.testing.assert_allclose(earth.from_utm(earth.utm(places)), places[:, :2], atol=1e-14)
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    xyz = np.stack(cart.transform(longitude, latitude, places[:, 2]), axis=1)
    np.testing.assert_allclose(earth.geocentric(places), xyz, atol=2e-9)
    np.testing.assert_allclose(earth.geodetic(xyz), places, atol=2e-9)


def test_the_grid_between_its_nodes_against_proj(tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    grid = earth.Geoid(46.0, 11.0, 0.1, np.round(random.uniform(40, 50, (5, 7)), 3))
    (tmp_path / "g.gtx").write_bytes(grid.gtx())
    places = np.radians(np.column_stack([random.uniform(46, 46.39, 30), random.uniform(11, 11.59, 30), np.zeros(30)]))
    np.testing.assert_allclose(geoid_heights(tmp_path / "g.gtx", places), grid.at(places), atol=1e-5)
