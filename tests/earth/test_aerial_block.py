"""An aerial block in UTM with heights above the geoid: control, antennas at cameras, rays between places of PROJ."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer
from small_projects import mor, table, write

from mor.geometry.earth import Ellipsoid, Horizon
from mor.observations.earth import projected_position
from mor.project.world.reference_system import reference_system
from mor.project.world.world import World

GEOID = 47.2
"""Above the ellipsoid, everywhere."""
C = 100.0
LEVER = np.array([0.3, -0.2, 1.1])
"""From the projection centre to the antenna, image axes, m."""


def _geocentric(utm: np.ndarray) -> np.ndarray:
    longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True).transform(
        *utm.T[:2]
    )
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    return np.stack(cart.transform(longitude, latitude, utm[:, 2] + GEOID), axis=1)


def _utm(geocentric: np.ndarray) -> np.ndarray:
    back = Transformer.from_crs("EPSG:4936", "EPSG:4937", always_xy=True).transform(*geocentric.T)
    east, north = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True).transform(back[0], back[1])
    return np.stack([east, north, back[2] - GEOID], axis=1)


def test_the_projection_is_linearised_where_it_was_observed() -> None:
    """Half a metre away, 200 km from the central meridian: scale and convergence are those of PROJ."""
    system = reference_system("EPSG:25832")
    horizon = Horizon(Ellipsoid(6378137.0, 1 / 298.257222101), np.radians(49.0), np.radians(11.5))
    world = World(system, horizon, 1.0, orthometric=True)
    given = np.array([[700000.0, 5435000.0, 380.0]])
    place = world.to_object(given, np.array([GEOID]))
    constants = np.concatenate([place, world.grid(place).reshape(-1, 4), given], axis=1)
    moved = place + np.array([[0.4, -0.3, 0.2]])
    computed = projected_position(horizon).equation([moved], constants).values
    np.testing.assert_allclose(computed, _utm(horizon.to_geocentric(moved)), atol=2e-7)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, list[str]]:
    """Two strips of four images 800 m above 4 × 2 km of ground; its project and the true points."""
    random = np.random.default_rng(11)
    east, north = np.meshgrid(np.linspace(0, 1600, 9), np.linspace(0, 900, 6))
    ground = np.stack(
        [690000.0 + east.ravel(), 5340000.0 + north.ravel(), 500 + random.uniform(0, 80, 54)], axis=1
    )
    centres = np.array(
        [[690000.0 + 500 * i, 5340200.0 + 480 * j, 1320.0 + 5 * i] for j in range(2) for i in range(4)]
    )
    points, cameras = _geocentric(ground), _geocentric(centres)
    up = cameras / np.linalg.norm(cameras, axis=1)[:, None]  # nadir, to a fifth of a degree
    rows: list[list[object]] = []
    antennas = []
    for k, (X0, z) in enumerate(zip(cameras, up, strict=True)):
        x = np.cross([0.0, 0.0, 1.0], z) + random.normal(0.0, 0.01, 3)
        x = x - (x @ z) * z
        x = x / np.linalg.norm(x)
        D = np.stack([x, np.cross(z, x), z])
        star = (points - X0) @ D.T
        image = -C * star[:, :2] / star[:, 2:]
        antennas.append(X0 + D.T @ LEVER)
        for i in np.flatnonzero((np.abs(image) < 70.0).all(axis=1)):
            rows.append([f"B{k}", f"P{i}", *(image[i] + random.normal(0.0, 0.004, 2)).tolist()])
    antenna = _utm(np.array(antennas)) + random.normal(0.0, 0.03, (8, 3))
    control = [0, 8, 22, 45, 53]
    text = f"""\
mor: 1
units: {{length: m, angle: gon}}
world: {{crs: "EPSG:25832", heights: orthometric}}
cameras:
  K: {{interior: {{c: 100, xh: 0, yh: 0}}, eccentricity: {{rx: {LEVER[0]}, ry: {LEVER[1]}, rz: {LEVER[2]}}}}}
images:
  - {{columns: [id, camera], rows: {json.dumps([[f"B{k}", "K"] for k in range(8)])}}}
points:
  - file: control.csv
  - {{columns: [id, geoid], rows: {json.dumps([[f"P{i}", str(GEOID)] for i in range(54) if i not in control])}}}
observations:
  - {{type: image, file: rays.csv, values: {{sigma: 4 um}}}}
  - {{type: projected_position, file: antennas.csv, values: {{sigma: 0.03, geoid: {GEOID}}}}}
"""
    folder = tmp_path_factory.mktemp("aerial")
    given = [[f"P{i}", *(ground[i] + random.normal(0.0, 0.02, 3)).tolist(), GEOID, 0.02] for i in control]
    project = write(
        folder,
        text,
        rays=table("image,point,x,y", rows),
        control=table("id,east,north,height,geoid,sigma", given),
        antennas=table("point,east,north,height", [[f"B{k}", *antenna[k].tolist()] for k in range(8)]),
    )
    return project, ground, [f"P{i}" for i in range(54)]


def test_a_block_in_utm_with_antennas(block: tuple[Path, np.ndarray, list[str]], tmp_path: Path) -> None:
    project, ground, names = block
    found = mor("adjust", project, "-o", tmp_path / "out", "--no-html")
    assert found.code == 0, found.err + found.out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["global_test"]["accepted"]
    places = {row["id"]: row for row in pl.read_csv(tmp_path / "out" / "places.csv").iter_rows(named=True)}
    errors = np.array([[places[name][key] for key in ("east", "north", "height")] for name in names]) - ground
    sigma = np.array([[places[name][key] for key in ("seast", "snorth", "sup")] for name in names])
    assert 0.7 < np.sqrt(np.mean((errors / sigma) ** 2)) < 1.4
    assert sigma.max() < 0.12
    observed = [row for row in results["residuals"] if row["type"] == "projected_position"]
    assert {row["component"] for row in observed} == {"east", "north", "height"}
    assert min(row["r"] for row in observed) > 0.05
