"""An aerial block in UTM with heights above the geoid: control, antennas at cameras, rays between places of PROJ."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from mor.api.pipeline import read_document, read_network
from mor.model.earth import Ellipsoid, Horizon, east_north_up
from mor.model.geodetic import projected_position
from mor.model.rotations import angles_from_rotation, nearest_rotation, rotation_from_angles
from mor.project.reference_system import EarthModel, reference_system
from tests.scenarios.small_projects import mor, table, write
from tests.selection import slow_after

GEOID = 47.2
"""Above the ellipsoid, everywhere."""
C = 100.0
ALIGNED = np.eye(3)
LEVER = np.array([0.3, -0.2, 1.1])
"""From the projection centre to the antenna, image axes, m."""


def _geocentric(utm: np.ndarray) -> np.ndarray:
    longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True).transform(*utm.T[:2])
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
    world = EarthModel(system, horizon, 1.0, orthometric=True)
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
    ground = np.stack([690000.0 + east.ravel(), 5340000.0 + north.ravel(), 500 + random.uniform(0, 80, 54)], axis=1)
    centres = np.array([[690000.0 + 500 * i, 5340200.0 + 480 * j, 1320.0 + 5 * i] for j in range(2) for i in range(4)])
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


def _attitudes(
    project: Path, kind: str, rng: np.random.Generator, boresight: np.ndarray = ALIGNED
) -> list[list[object]]:
    """Attitudes of what stands at B D in the images of an adjustment without it, by axes that PROJ gives there."""
    found = mor("adjust", project, "-o", project.parent.parent / f"before {kind}", "--no-html")
    assert found.code == 0
    results = json.loads((project.parent.parent / f"before {kind}" / "results.json").read_text())
    world = read_network(read_document(project), project.parent).world
    assert world is not None
    horizon = world.horizon
    rows: list[list[object]] = []
    for image in results["images"]:
        place = horizon.to_geocentric(np.array([[image[c] for c in "xyz"]]))
        angles = np.array([[image[c] for c in ("omega", "phi", "kappa")]]) * np.pi / 200.0
        D = boresight @ rotation_from_angles(angles)[0] @ horizon.axes  # image axes (rows) in geocentric ones
        east, north, height = _utm(place)[0]
        if kind == "projected_attitude":
            ahead = [_geocentric(np.array([[east, north, height]]) + 50.0 * np.eye(3)[k])[0] for k in range(3)]
            axes = np.array([(there - place[0]) / np.linalg.norm(there - place[0]) for there in ahead])
            given = angles_from_rotation(nearest_rotation(D @ axes.T)[None])[0]
            rows.append([image["id"], east, north, *_noisy(given, rng)])
        else:
            longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True).transform(east, north)
            enu = east_north_up(np.radians(latitude), np.radians(longitude))
            ned = enu[[1, 0, 2]] * [[1.0], [1.0], [-1.0]]
            body = ned @ np.stack([D[1], D[0], -D[2]], axis=1)  # forward, right, down as columns
            yaw, pitch, roll = Rotation.from_matrix(body).as_euler("ZYX")
            rows.append([image["id"], *_noisy(np.array([roll, pitch, yaw]), rng)])
    return rows


def _noisy(angles: np.ndarray, rng: np.random.Generator) -> list[float]:
    """In gon, with a σ of 5 mgon."""
    noisy: list[float] = (angles * 200.0 / np.pi + rng.normal(0.0, 0.005, 3)).tolist()
    return noisy


def _with_columns(rows: list[list], columns: str) -> list[list]:
    """The rows without east and north, where they are not wanted: then the convergence is that at the image."""
    return rows if "east" in columns or "roll" in columns else [[row[0], *row[3:]] for row in rows]


of_each_kind = pytest.mark.parametrize(
    ("kind", "columns"),
    slow_after(
        0,
        [
            ("navigation_attitude", "image,roll,pitch,yaw"),
            ("projected_attitude", "image,east,north,omega,phi,kappa"),
            ("projected_attitude", "image,omega,phi,kappa"),
        ],
    ),
)


@of_each_kind
def test_attitudes_of_a_projection_and_of_navigation(
    block: tuple[Path, np.ndarray, list[str]], tmp_path: Path, kind: str, columns: str
) -> None:
    """They are 5 mgon off what the rays say: with convergence (1.9 gon here) or axes wrong it would be gon."""
    project, _, _ = block
    rows = _attitudes(project, kind, np.random.default_rng(3))
    rows = _with_columns(rows, columns)
    extra = f"  - {{type: {kind}, file: {kind}.csv, values: {{sigma: 5 mgon}}}}\n"
    shutil.copytree(project.parent, tmp_path / "with")
    with_attitudes = write(tmp_path / "with", project.read_text() + extra, **{kind: table(columns, rows)})
    found = mor("adjust", with_attitudes, "-o", tmp_path / "out", "--no-html")
    assert found.code == 0, found.err + found.out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["global_test"]["accepted"]
    observed = [row for row in results["residuals"] if row["type"] == kind]
    assert len(observed) == 24
    assert 0.6 < np.sqrt(np.mean([row["w"] ** 2 for row in observed])) < 1.4
    total = sum(row["r"] for row in results["residuals"])
    assert total == pytest.approx(results["redundancy"], abs=1e-6)


@of_each_kind
def test_the_misalignment_of_an_inertial_system_is_found(
    block: tuple[Path, np.ndarray, list[str]], tmp_path: Path, kind: str, columns: str
) -> None:
    """An inertial system that is turned against the camera by a degree, and by a quarter circle about its axis."""
    project, _, _ = block
    planted = np.radians([0.7, -0.4, 90.3])
    rows = _attitudes(project, kind, np.random.default_rng(4), rotation_from_angles(planted[None])[0])
    rows = _with_columns(rows, columns)
    extra = f"  - {{type: {kind}, file: {kind}.csv, instrument: IMU, values: {{sigma: 5 mgon}}}}\n"
    free = "{omega: {free: 0}, phi: {free: 0}, kappa: {free: 100}}"
    extra += f"instruments: {{IMU: {{boresight: {free}}}}}\n"
    shutil.copytree(project.parent, tmp_path / "with")
    with_attitudes = write(tmp_path / "with", project.read_text() + extra, **{kind: table(columns, rows)})
    found = mor("adjust", with_attitudes, "-o", tmp_path / "out", "--no-html")
    assert found.code == 0, found.err + found.out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    [boresight] = results["boresights"]
    for name, true in zip(("omega", "phi", "kappa"), planted * 200.0 / np.pi, strict=True):
        assert abs(boresight[name] - true) < 4.0 * boresight[f"s{name}"]
        assert 1e-3 < boresight[f"s{name}"] < 1e-2  # 5 mgon of eight images
    assert "Misalignment of inertial systems" in (tmp_path / "out" / "report.txt").read_text()
    again = mor("adjust", tmp_path / "out" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.code == 0, again.err
    assert json.loads((tmp_path / "again" / "results.json").read_text())["iterations"] <= 2


def test_an_adjusted_block_begins_where_it_ended(block: tuple[Path, np.ndarray, list[str]], tmp_path: Path) -> None:
    """Places and attitudes of images go through adjusted.yaml; the object system stays where it was."""
    project, _, _ = block
    assert mor("adjust", project, "-o", tmp_path / "one", "--no-html").code == 0
    given = pl.read_csv(tmp_path / "one" / "start_images.csv")
    assert {"east", "north", "elevation", "geoid"} < set(given.columns)
    true = np.array([[690000.0 + 500 * i, 5340200.0 + 480 * j] for j in range(2) for i in range(4)])
    np.testing.assert_allclose(given.select("east", "north").to_numpy(), true, atol=0.5)
    np.testing.assert_allclose(given["geoid"], GEOID, atol=1e-9)
    assert mor("adjust", tmp_path / "one" / "adjusted.yaml", "-o", tmp_path / "two", "--no-html").code == 0
    steps = [json.loads((tmp_path / d / "results.json").read_text())["iterations"] for d in ("one", "two")]
    assert steps[1] <= 2 < steps[0]
    for file in ("points.csv", "images.csv"):
        one, two = (pl.read_csv(tmp_path / d / file).select("x", "y", "z").to_numpy() for d in ("one", "two"))
        np.testing.assert_allclose(one, two, atol=1e-6)


@pytest.mark.parametrize(
    ("columns", "cells", "words"),
    [
        (
            "x, y, z",
            "1, 2, 3",
            "x, y, z of its own are not possible on the earth; expected east, north, elevation",
        ),
        (
            "east, north",
            "690000, 5340200",
            "a position on the earth needs all of east, north, elevation, or none",
        ),
        (
            "east, north, elevation",
            "690000, 5340200, 1300",
            "height above the geoid, but the geoid is unknown",
        ),
        ("east, north, elevation, sigma_x", "690000, 5340200, 1300, 1", "place of a frame is a start value"),
    ],
)
def test_mistakes_in_places_of_images(
    block: tuple[Path, np.ndarray, list[str]], tmp_path: Path, columns: str, cells: str, words: str
) -> None:
    project, _, _ = block
    shutil.copytree(project.parent, tmp_path / "with")
    text = project.read_text().replace("[id, camera]", f"[id, camera, {columns}]")
    text = text.replace('["B0", "K"]', f'["B0", "K", {cells}]')
    empty = ', ""' * (columns.count(",") + 1)
    text = re.sub(r'\["(B[1-9])", "K"\]', rf'["\1", "K"{empty}]', text)
    found = mor("check", write(tmp_path / "with", text))
    assert found.code == 2
    assert words in found.err
