"""Shift, turn and scale of a GNSS solution against the frame of the points: planted values, another formulation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from mor.api.pipeline import solve_network
from tests.reference_data import network_of_yaml
from tests.scenarios.small_projects import mor, write

ARCSEC = np.pi / 648000.0
SHIFT, TURN, SCALE = np.array([0.31, -0.22, 0.47]), np.array([1.3, -0.8, 2.1]) * ARCSEC, 1.0 + 2.4e-6
NAMES = [f"P{k}" for k in range(9)]
HELD = NAMES[:4]
SIGMA = 0.004
KEYS = ("shift_x", "shift_y", "shift_z", "turn_x", "turn_y", "turn_z", "scale")


def _places() -> np.ndarray:
    random = np.random.default_rng(5)
    geodetic = np.column_stack([random.uniform(11.2, 11.5, 9), random.uniform(47.2, 47.4, 9)])
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    return np.stack(cart.transform(*geodetic.T, random.uniform(500, 2000, 9)), axis=1)


def _in_frame(places: np.ndarray, middle: np.ndarray, frame: np.ndarray) -> np.ndarray:
    turned = Rotation.from_euler("xyz", frame[3:6]).apply(places - middle)
    return middle + frame[:3] + frame[6] * turned


def _project(frame: dict[str, Any], middle: np.ndarray, errors: float = 1.0) -> dict[str, Any]:
    places, random = _places(), np.random.default_rng(6)
    there = _in_frame(places, middle, np.array([*SHIFT, *TURN, SCALE]))
    positions = there + errors * random.normal(0.0, SIGMA, there.shape)
    ends = [(i, j) for i in range(9) for j in range(i + 1, 9) if (i + j) % 2]
    vectors = [there[j] - there[i] + errors * random.normal(0.0, SIGMA, 3) for i, j in ends]
    known = [[name, *map(repr, place.tolist())] for name, place in zip(NAMES, places, strict=True)]
    rounded = [[name, *(f"{value:.0f}" for value in place)] for name, place in zip(NAMES, places, strict=True)]
    columns = ["id", "x", "y", "z"]
    return {
        "mor": "1",
        "units": {"length": "m", "angle": "rad"},
        "world": {"crs": "EPSG:4936"},
        "instruments": {"GNSS": {"frame": frame}},
        "points": [
            {"columns": columns, "rows": known[:4], "fixed": ["x", "y", "z"]},
            {"columns": columns, "rows": rounded[4:]},
        ],
        "settings": {"sigma": "apriori"},
        "observations": [
            {
                "type": "gnss_position",
                "instrument": "GNSS",
                "columns": ["point", "x", "y", "z"],
                "rows": [[n, *map(repr, p.tolist())] for n, p in zip(NAMES, positions, strict=True)],
                "values": {"sigma": str(SIGMA)},
            },
            {
                "type": "gnss_vector",
                "instrument": "GNSS",
                "columns": ["from", "to", "dx", "dy", "dz"],
                "rows": [[NAMES[i], NAMES[j], *map(repr, v.tolist())] for (i, j), v in zip(ends, vectors, strict=True)],
                "values": {"sigma": str(SIGMA)},
            },
        ],
    }


def _solved(project: dict[str, Any]) -> Any:
    return solve_network(network_of_yaml(json.dumps(project), None))


@pytest.fixture(scope="module")
def middle() -> np.ndarray:
    """Where the program puts its object system: what it says, to 0.0001°, on the ellipsoid."""
    network = network_of_yaml(json.dumps(_project({"scale": "1"}, np.zeros(3))), None)
    horizon = network.world.horizon
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    return np.array(cart.transform(np.degrees(horizon.longitude), np.degrees(horizon.latitude), 0.0))


def _frame_of(solved: Any) -> tuple[np.ndarray, np.ndarray]:
    block = solved.network.things["instrument"].part("GNSS", "gnss frame")
    covariance = solved.quality.cofactors["gnss frame"][block]
    return solved.adjustment.values["gnss frame"][block], np.sqrt(np.diagonal(covariance))


FREE = {key: {"free": "1" if key == "scale" else "0"} for key in KEYS}


def test_planted_values_are_found_exactly_without_errors(middle: np.ndarray) -> None:
    values, _ = _frame_of(_solved(_project(FREE, middle, errors=0.0)))
    np.testing.assert_allclose(values, [*SHIFT, *TURN, SCALE], rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(values[3:], [*TURN, SCALE], rtol=0.0, atol=2e-13)


def test_free_and_observed_frames_against_a_formulation_in_geocentric_coordinates(middle: np.ndarray) -> None:
    """Coordinates and seven parameters by Gauss-Newton with differences: the same values, σ and vᵀPv."""
    observed = {**FREE, "turn_z": {"observed": repr(2.13 * ARCSEC), "sigma": repr(0.05 * ARCSEC)}}
    for frame in (FREE, observed):
        project = _project(frame, middle)
        solved = _solved(project)
        values, sigma = _frame_of(solved)
        positions = np.array([row[1:] for row in project["observations"][0]["rows"]], dtype=float)
        rows = project["observations"][1]["rows"]
        vectors = np.array([row[2:] for row in rows], dtype=float)
        i, j = ([NAMES.index(row[k]) for row in rows] for k in range(2))
        held = _places()[:4]

        def residuals(
            x: np.ndarray,
            frame: dict[str, Any] = frame,
            positions: np.ndarray = positions,
            vectors: np.ndarray = vectors,
            i: list[int] = i,
            j: list[int] = j,
            held: np.ndarray = held,
        ) -> np.ndarray:
            places = np.concatenate([held, middle + 1e3 * x[7:].reshape(-1, 3)])
            parameters = np.array([*x[:3], *(1e-6 * x[3:6]), 1.0 + 1e-6 * x[6]])
            there = _in_frame(places, middle, parameters)
            known = [] if frame is FREE else [(1e-6 * x[5] - 2.13 * ARCSEC) / (0.05 * ARCSEC)]
            return np.concatenate(
                [(there - positions).ravel() / SIGMA, (there[j] - there[i] - vectors).ravel() / SIGMA, known]
            )

        start = np.concatenate([np.zeros(7), ((_places()[4:] - middle) / 1e3).ravel()])
        for _ in range(5):
            J = np.stack(
                [(residuals(start + step) - residuals(start - step)) / 2e-3 for step in 1e-3 * np.eye(len(start))],
                axis=1,
            )
            start = start - np.linalg.lstsq(J, residuals(start), rcond=None)[0]
        Q = np.linalg.inv(J.T @ J)
        units = np.array([1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6, 1e-6])
        expected = start[:7] * units + np.array([0, 0, 0, 0, 0, 0, 1.0])
        np.testing.assert_allclose((values - expected) / sigma, 0.0, atol=1e-3)
        np.testing.assert_allclose(sigma, np.sqrt(np.diagonal(Q))[:7] * units, rtol=1e-4)
        assert np.sum(residuals(start) ** 2) == pytest.approx(
            solved.quality.sigma0**2 * solved.quality.redundancy, rel=1e-6
        )
        assert (np.abs(values - [*SHIFT, *TURN, SCALE]) < 4.0 * sigma).all()


def test_a_fixed_frame_is_the_same_as_vectors_that_were_turned_beforehand(middle: np.ndarray) -> None:
    fixed = {key: repr(float(v)) for key, v in zip(KEYS, [*SHIFT, *TURN, SCALE], strict=True)}
    project = _project(fixed, middle)
    one = _solved(project)
    back = Rotation.from_euler("xyz", TURN).inv()
    for row in project["observations"][0]["rows"]:
        turned = middle + back.apply(np.array(row[1:], dtype=float) - middle - SHIFT) / SCALE
        row[1:] = list(map(repr, turned.tolist()))
    for row in project["observations"][1]["rows"]:
        row[2:] = list(map(repr, (back.apply(np.array(row[2:], dtype=float)) / SCALE).tolist()))
    project["instruments"] = {"GNSS": {"frame": {"scale": "1"}}}
    other = _solved(project)
    numbers = one.network.things["point"].parts["position"]
    np.testing.assert_allclose(
        one.adjustment.values["point"][numbers], other.adjustment.values["point"][numbers], atol=5e-9
    )
    assert one.quality.sigma0 == pytest.approx(other.quality.sigma0, rel=1e-5)


def test_results_say_the_frame_and_a_second_run_begins_there(tmp_path: Path, middle: np.ndarray) -> None:
    project = _project(FREE, middle)
    assert mor("adjust", write(tmp_path, json.dumps(project)), "-o", tmp_path / "out", "--no-html").code == 0
    report = (tmp_path / "out" / "report.txt").read_text()
    assert "turn_x" in report
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["iterations"] > 1
    again = mor("adjust", tmp_path / "out" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.code == 0
    one, other = (pl.read_csv(tmp_path / name / "places.csv") for name in ("out", "again"))
    np.testing.assert_allclose(*(frame.select("x", "y", "z", "seast").to_numpy() for frame in (one, other)), atol=1e-7)


def test_a_shift_that_only_vectors_have_is_told(tmp_path: Path, middle: np.ndarray) -> None:
    project = _project(FREE, middle)
    del project["observations"][0]
    told = mor("adjust", write(tmp_path, json.dumps(project)), "-o", tmp_path / "out", "--no-html")
    assert told.code == 4
    assert "vectors have no shift" in told.out + told.err


def test_components_that_do_not_exist_and_scales_of_nothing_are_told(tmp_path: Path, middle: np.ndarray) -> None:
    project = _project({"shift": {"free": "0"}, "scale": "0"}, middle)
    told = mor("check", write(tmp_path, json.dumps(project)))
    assert told.code == 2
    assert "unknown component 'shift'; did you mean 'shift_" in told.err
    assert "scale: expected a number above 0" in told.err
