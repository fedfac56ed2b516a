"""Free networks on the earth: what plumb lines leave free of where a network lies, and what they do not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer

from tests.scenarios.small_projects import mor, write

COUNT = 6
GEOCENTRIC = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
UTM = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True)


def survey(size: float, kinds: str, held: int = 0, azimuth: bool = False, seed: int = 1) -> dict[str, Any]:
    """Directions d, slopes s, heights h, vectors v between all points; the first ``held`` points are fixed."""
    random = np.random.default_rng(seed)
    latitude = 49.0 + random.uniform(-0.5, 0.5, COUNT) * size / 111e3
    longitude = 10.0 + random.uniform(-0.5, 0.5, COUNT) * size / 73e3
    height = random.uniform(300.0, 300.0 + 0.03 * size, COUNT)
    X = np.stack(GEOCENTRIC.transform(longitude, latitude, height), axis=1)
    names = [f"P{k}" for k in range(COUNT)]
    rows: dict[str, list[list[Any]]] = {kind: [] for kind in "dshva"}
    for i, a in enumerate(names):
        p, q = np.radians(latitude[i]), np.radians(longitude[i])
        s, c, sl, cl = np.sin(p), np.cos(p), np.sin(q), np.cos(q)
        horizon = np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
        for j, b in enumerate(names):
            vector = X[j] - X[i]
            east, north, up = horizon @ vector
            angle = np.arctan2(east, north) % (2.0 * np.pi)
            if i != j:
                zenith = np.arctan2(np.hypot(east, north), up)
                rows["d"].append(
                    [a, b, *(np.array([(angle - i) % (2.0 * np.pi), zenith]) + random.normal(0.0, 2e-6, 2))]
                )
            if i < j:
                rows["s"].append([a, b, np.linalg.norm(vector) + random.normal(0.0, 0.002)])
                rows["h"].append([a, b, height[j] - height[i] + random.normal(0.0, 0.001)])
                rows["v"].append([a, b, *(vector + random.normal(0.0, 0.005, 3))])
            if (i, j) == (0, 1):
                rows["a"].append([a, b, angle])
    tables = {
        "d": ("zenith_directions", ["station", "to", "horizontal", "zenith"], 2e-6),
        "s": ("distance", ["from", "to", "distance"], 0.002),
        "h": ("ellipsoidal_height_difference", ["from", "to", "dz"], 0.001),
        "v": ("gnss_vector", ["from", "to", "dx", "dy", "dz"], 0.005),
        "a": ("azimuth", ["from", "to", "azimuth"], 1e-6),
    }
    east, north = UTM.transform(longitude, latitude)
    places = [[name, *place] for name, place in zip(names, np.stack([east, north, height], 1).tolist(), strict=True)]
    columns = ["id", "east", "north", "height"]
    found = [{"columns": columns, "rows": places[held:]}]
    if held:
        found.append({"columns": columns, "rows": places[:held], "fixed": ["x", "y", "z"]})
    return {
        "mor": 1,
        "units": {"length": "m", "angle": "rad"},
        "world": {"crs": "EPSG:25832", "heights": "ellipsoidal"},
        "points": found,
        "datum": "fixed" if held else "free",
        "observations": [
            {
                "type": tables[kind][0],
                "columns": tables[kind][1],
                "values": {"sigma": tables[kind][2]},
                "rows": [[cell if isinstance(cell, str) else float(cell) for cell in row] for row in rows[kind]],
            }
            for kind in kinds + ("a" if azimuth else "")
        ],
    }


def _residuals(project: dict[str, Any], folder: Path) -> pl.DataFrame:
    found = mor("adjust", write(folder, json.dumps(project)), "-o", folder / "out", "--no-html")
    assert found.code == 0, found.err
    return pl.read_csv(folder / "out" / "residuals.csv")


@pytest.mark.parametrize("kinds", ["v", "dv", "dsv"])
@pytest.mark.parametrize("size", [1e3, 1e5])
def test_a_free_network_has_the_residuals_of_one_that_is_held_in_a_point(
    tmp_path: Path, kinds: str, size: float
) -> None:
    """They lie a centimetre apart at most, and verticals turn by 2e-9 with it, a thousandth of a σ."""
    free = _residuals(survey(size, kinds), tmp_path / "free")
    held = _residuals(survey(size, kinds, held=1), tmp_path / "held")
    for column, close in (("w", 2e-3), ("r", 1e-8)):
        np.testing.assert_allclose(free[column].to_numpy(), held[column].to_numpy(), atol=close)


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (
            "d",
            "nor leave it free, because verticals differ from place to place; fix or observe two points",
        ),
        ("ds", "fix or observe two points, or one point and an azimuth"),
        ("dsh", "fix or observe two points, or one point and an azimuth"),
        ("dsvh", "nor leave it free, because verticals differ from place to place; fix or observe a point"),
    ],
)
@pytest.mark.parametrize("command", ["check", "adjust", "design"])
def test_a_free_network_that_plumb_lines_do_not_leave_free_is_told(
    tmp_path: Path, kinds: str, words: str, command: str
) -> None:
    project = survey(1e3, kinds)
    told = mor(command, write(tmp_path, json.dumps(project)))
    assert told.code == 2
    assert words in told.err
    assert "project.yaml:1: datum: " in told.err


@pytest.mark.parametrize("kinds", ["d", "ds", "dsh"])
@pytest.mark.parametrize("size", [1e3, 1e5])
def test_one_point_does_not_hold_the_turn(tmp_path: Path, kinds: str, size: float) -> None:
    """It was iterated without an end, and the observations were blamed."""
    told = mor("adjust", write(tmp_path, json.dumps(survey(size, kinds, held=1))))
    assert told.code == 2
    assert "the rotation about the only fixed point" in told.err
    assert "fix or observe a second point, or an azimuth" in told.err


ORIENTED: list[dict[str, Any]] = [
    {"columns": ["id", "point", "kappa"], "rows": [["P0", "P0", 0.0]], "fixed": ["kappa"]},
    {"columns": ["id", "point", "kappa", "sigma_kappa"], "rows": [["P0", "P0", 0.0, 1e-6]]},
]


@pytest.mark.parametrize("station", ORIENTED)
@pytest.mark.parametrize("size", [1e3, 1e5])
def test_an_orientation_holds_the_turn_of_a_free_network(tmp_path: Path, station: dict[str, Any], size: float) -> None:
    """Its residuals are those of a network with one point and an azimuth."""
    free = _residuals({**survey(size, "ds"), "stations": [station]}, tmp_path / "free")
    held = _residuals(survey(size, "ds", held=1, azimuth=True), tmp_path / "held")
    measured = ["zenith_directions", "distance"]
    one, other = (rows.filter(pl.col("type").is_in(measured)) for rows in (free, held))
    np.testing.assert_allclose(one["w"].to_numpy(), other["w"].to_numpy(), atol=5e-3)


@pytest.mark.parametrize(
    ("kinds", "held", "azimuth"), [("ds", 1, True), ("ds", 2, False), ("dsh", 1, True), ("dsvh", 1, False)]
)
@pytest.mark.parametrize("size", [1e3, 1e5])
def test_what_is_advised_leads_to_a_solution(tmp_path: Path, kinds: str, held: int, azimuth: bool, size: float) -> None:
    residuals = _residuals(survey(size, kinds, held, azimuth), tmp_path)
    assert (residuals["w"].drop_nulls().abs() < 5.0).all()


@pytest.mark.slow
def test_levelled_differences_without_instruments_and_systems_are_no_crash(tmp_path: Path) -> None:
    """Slopes and heights over 10 km: how the network is turned is known badly, or not, and said."""
    told = mor("adjust", write(tmp_path, json.dumps(survey(1e4, "sh"))), "-o", tmp_path / "out", "--no-html")
    assert told.code in (0, 4)
    assert "internal error" not in told.err + told.out
    assert "rotation of the whole network" in told.err + told.out
