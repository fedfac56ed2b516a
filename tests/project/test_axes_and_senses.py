"""One network in all eight axis orientations and both angle senses: the same σ, r, v and the same places."""

from __future__ import annotations

import json
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.scenarios.small_projects import mor, write

AXES = ("en", "nw", "ws", "se", "ne", "sw", "es", "wn")
SENSES = ("clockwise", "counterclockwise")
COMPASS = {"e": (1.0, 0.0, 0.0), "n": (0.0, 1.0, 0.0), "w": (-1.0, 0.0, 0.0), "s": (0.0, -1.0, 0.0)}
ZERO = {"north": 0.0, "east": 100.0, "south": 200.0, "west": 300.0}
TRUTH = {
    "A": (0.0, 0.0, 10.0),
    "B": (310.0, 40.0, 14.0),
    "C": (150.0, 260.0, 31.0),
    "D": (-120.0, 190.0, 22.0),
    "E": (60.0, -170.0, 5.0),
}
"""East, north, up."""
GON = 200.0 / np.pi


class Frame(NamedTuple):
    """Axes, sense and zero of one variant."""

    xy: str
    sense: str
    zero: str = "north"

    @property
    def matrix(self) -> np.ndarray:
        """Project coordinates = matrix · (east, north, up)."""
        return np.array([COMPASS[self.xy[0]], COMPASS[self.xy[1]], (0.0, 0.0, 1.0)])

    def vector(self, enu: np.ndarray) -> list[float]:
        return [float(x) for x in self.matrix @ enu]

    def turn(self, clockwise: float) -> float:
        """An angle or a reading of the circle, given clockwise."""
        return float(clockwise if self.sense == "clockwise" else -clockwise) % 400.0

    def bearing(self, azimuth: float) -> float:
        return self.turn(azimuth - ZERO[self.zero])


def azimuth(a: str, b: str) -> float:
    east, north, _ = np.subtract(TRUTH[b], TRUTH[a])
    return float(np.arctan2(east, north)) * GON


def length(a: str, b: str) -> float:
    return float(np.linalg.norm(np.subtract(TRUTH[b], TRUTH[a])))


def zenith(a: str, b: str) -> float:
    return float(np.arccos(np.subtract(TRUTH[b], TRUTH[a])[2] / length(a, b))) * GON


def project_text(frame: Frame) -> str:
    """The network as somebody who works in these axes would write it; the same errors everywhere."""
    noise = iter(np.random.default_rng(3).standard_normal(200))
    F = frame
    start = {name: np.add(xyz, (0.3, -0.2, 0.1)) for name, xyz in TRUTH.items()}
    sets = [
        [
            station,
            target,
            F.turn(azimuth(station, target) - orientation + 0.0005 * next(noise)),
            zenith(station, target) + 0.001 * next(noise),
        ]
        for station, orientation in (("A", 33.0), ("C", 271.0), ("E", 390.0))
        for target in TRUTH
        if target != station
    ]
    distances = [[a, b, length(a, b) + 0.003 * next(noise)] for a, b in product("ABD", "CDE") if a < b]
    angles = [
        [at, a, b, F.turn(azimuth(at, b) - azimuth(at, a) + 0.001 * next(noise))]
        for at, a, b in (("D", "A", "B"), ("B", "E", "D"))
    ]
    bearings = [["A", "B", F.bearing(azimuth("A", "B") + 0.001 * next(noise))]]
    error = np.array([0.004, -0.003, 0.005]) * [next(noise) for _ in range(3)]
    vector = F.vector(np.subtract(TRUTH["E"], TRUTH["B"]) + error)
    S = F.matrix @ np.array([[20.0, 6.0, 2.0], [6.0, 10.0, -3.0], [2.0, -3.0, 30.0]]) @ F.matrix.T * 1e-6
    covariances = [S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2]]
    gnss = F.vector(np.add(TRUTH["C"], (0.011, -0.006, 0.004)))
    east = next(k for k in range(3) if F.matrix[k, 0])
    known_east = F.matrix[east, 0] * (TRUTH["D"][0] + 0.02)
    names = [f"cov_d{a}_d{b}" for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")]
    spread = np.diag([1e-4, 4e-4, 9e-4]) + 0.5e-4
    matrix = (F.matrix @ spread @ F.matrix.T).tolist()
    return json.dumps(
        {
            "mor": 1,
            "axes": {"xy": F.xy, "angles": F.sense, "bearings_from": F.zero},
            "points": [
                {
                    "columns": ["id", "x", "y", "z"],
                    "rows": [["A", *F.vector(np.array(TRUTH["A"]))]],
                    "fixed": ["x", "y", "z"],
                },
                {"columns": ["id", "x", "y", "z"], "rows": [[n, *F.vector(start[n])] for n in "BCDE"]},
            ],
            "observations": [
                {
                    "type": "zenith_directions",
                    "name": "sets",
                    "columns": ["station", "to", "horizontal", "zenith"],
                    "rows": sets,
                    "values": {"sigma": "0.8 mgon"},
                },
                {
                    "type": "distance",
                    "columns": ["from", "to", "distance"],
                    "rows": distances,
                    "values": {"sigma": 0.003},
                },
                {
                    "type": "angle",
                    "columns": ["at", "from", "to", "angle"],
                    "rows": angles,
                    "values": {"sigma": "1 mgon"},
                },
                {
                    "type": "bearing",
                    "columns": ["from", "to", "bearing"],
                    "rows": bearings,
                    "values": {"sigma": "1 mgon"},
                },
                {
                    "type": "vector",
                    "columns": ["from", "to", "dx", "dy", "dz", *names],
                    "rows": [["B", "E", *vector, *covariances]],
                },
                {
                    "type": "coordinates",
                    "columns": ["point", "x", "y", "z"],
                    "rows": [["C", *gnss]],
                    "covariance": matrix,
                },
                {
                    "type": "parameter",
                    "columns": ["of", "component", "value", "sigma"],
                    "rows": [["point D", "xyz"[east], known_east, 0.02]],
                },
            ],
        },
        indent=1,
    )


class Outcome(NamedTuple):
    """Results of one variant, turned to east, north, up and clockwise."""

    sigma0: float
    places: dict[str, np.ndarray]
    sigmas: dict[str, np.ndarray]
    v: dict[Any, float]
    r: dict[Any, float]


def solve(folder: Path, frame: Frame) -> Outcome:
    run = mor("adjust", write(folder, project_text(frame)), "--json")
    assert run.code == 0, run.err
    data = json.loads(run.out)
    turned = np.abs(frame.matrix).T
    places = {p["id"]: frame.matrix.T @ [p["x"], p["y"], p["z"]] for p in data["points"]}
    sigmas = {p["id"]: turned @ [p["sx"], p["sy"], p["sz"]] for p in data["points"]}
    v, r = {}, {}
    for row in data["residuals"]:
        key, sign = observation(frame, row)
        v[key], r[key] = sign * row["v"], row["r"]
        assert row["adjusted"] - row["observed"] == pytest.approx(row["v"], abs=1e-9)
    return Outcome(data["sigma0"]["aposteriori"], places, sigmas, v, r)


def observation(frame: Frame, row: dict[str, Any]) -> tuple[tuple[str, ...], float]:
    """A name of an observation that does not depend on the axes, and the sign its residual has."""
    component, sign = row["component"], 1.0
    of_axes = row["type"] in ("vector", "coordinates") or (row["type"] == "parameter" and component in "xyz")
    if of_axes:
        axis = "xyz".index(component[-1])
        direction = frame.matrix[axis]
        component, sign = "enu"[int(np.argmax(np.abs(direction)))], float(direction.sum())
    elif component in ("horizontal", "angle", "bearing"):
        sign = 1.0 if frame.sense == "clockwise" else -1.0
    return (row["type"], row["at"], row["from"], row["to"], component), sign


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return solve(tmp_path_factory.mktemp("reference"), Frame("en", "clockwise"))


def test_reference_finds_the_truth(reference: Outcome) -> None:
    assert 0.6 < reference.sigma0 < 1.4
    for name, place in reference.places.items():
        assert np.abs(place - TRUTH[name]).max() < 0.02, name
    assert len(reference.v) == 24 + len("ACADAEBCBDBEDE") // 2 + 2 + 1 + 3 + 3 + 1


@pytest.mark.parametrize(("xy", "sense"), [*product(AXES, SENSES)])
def test_same_results_in_all_axes_and_senses(tmp_path: Path, reference: Outcome, xy: str, sense: str) -> None:
    compare(solve(tmp_path, Frame(xy, sense)), reference)


@pytest.mark.parametrize("zero", ["east", "south", "west"])
def test_same_results_with_bearings_from_elsewhere(tmp_path: Path, reference: Outcome, zero: str) -> None:
    compare(solve(tmp_path, Frame("ne", "counterclockwise", zero)), reference)


def compare(found: Outcome, reference: Outcome) -> None:
    assert found.sigma0 == pytest.approx(reference.sigma0, rel=1e-9)
    for name in TRUTH:
        assert found.places[name] == pytest.approx(reference.places[name], abs=1e-8)
        assert found.sigmas[name] == pytest.approx(reference.sigmas[name], abs=1e-10)
    assert set(found.v) == set(reference.v)
    for key in reference.v:
        assert found.v[key] == pytest.approx(reference.v[key], abs=1e-8), key
        assert found.r[key] == pytest.approx(reference.r[key], abs=1e-9), key


def test_images_in_left_handed_axes_are_refused(tmp_path: Path) -> None:
    from tests.scenarios.small_projects import BLOCK, write_block

    run = mor("check", write_block(tmp_path, BLOCK + "axes: {xy: ne}\n"))
    assert run.code == 2
    assert "images need right-handed axes; ne is left-handed" in run.err


@cache
def block_points(folder: Path, xy: str) -> tuple[np.ndarray, np.ndarray]:
    """Points and σ of the small block of images, given and taken in other axes, in east, north, up."""
    from tests.scenarios.small_projects import BLOCK, block, write_block

    rows = block(noise=0.002)
    frame = Frame(xy, "clockwise")
    points = [[name, *frame.vector(np.array(xyz))] for name, *xyz in rows.points]
    images = []
    for name, camera, *pose in rows.images:
        images.append([name, camera, *frame.vector(np.array(pose[:3])), *turned_angles(pose[3:], frame.matrix)])
    project = write_block(folder, BLOCK + f"axes: {{xy: {xy}}}\n", rows._replace(points=points, images=images))
    run = mor("adjust", project, "--json")
    assert run.code == 0, run.err
    data = json.loads(run.out)["points"]
    places = np.array([[p["x"], p["y"], p["z"]] for p in data]) @ frame.matrix
    return places, np.array([[p["sx"], p["sy"], p["sz"]] for p in data]) @ np.abs(frame.matrix)


def turned_angles(angles: list[float], matrix: np.ndarray) -> list[float]:
    """ω, φ, κ of the same camera against turned axes: R' = M R with R = Rx(ω) Ry(φ) Rz(κ)."""
    o, p, k = np.array(angles) / GON
    rx = np.array([[1, 0, 0], [0, np.cos(o), -np.sin(o)], [0, np.sin(o), np.cos(o)]])
    ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    rz = np.array([[np.cos(k), -np.sin(k), 0], [np.sin(k), np.cos(k), 0], [0, 0, 1]])
    R = matrix @ rx @ ry @ rz
    turned = (np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0]))
    return [float(angle * GON) for angle in turned]


@pytest.mark.parametrize("xy", ["nw", "ws", "se"])
def test_block_of_images_in_right_handed_axes(tmp_path: Path, xy: str) -> None:
    places, sigmas = block_points(tmp_path / xy, xy)
    expected, expected_sigmas = block_points(tmp_path / "en", "en")
    assert places == pytest.approx(expected, abs=1e-8)
    assert sigmas == pytest.approx(expected_sigmas, abs=1e-10)
