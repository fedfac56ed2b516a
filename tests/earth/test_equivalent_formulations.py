"""One network of 100 km in four formulations: projected, geographic, geocentric, and local with plumb lines by hand.

The simulated observations come from PROJ's geocentric and topocentric coordinates, not from the program.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

from mor.api.pipeline import solve_network
from mor.model.rotations import angles_from_rotation
from mor.project.document import yaml_text
from mor.quality.solution import Solved
from tests.reference_data import network_of_yaml

LATITUDE, LONGITUDE = 47.3, 11.4
NAMES = ("A", "B", "C", "D", "E", "F", "G")
HELD = ("A", "B")
PAIRS = [(a, b) for k, a in enumerate(NAMES) for b in NAMES[k + 1 :]]
ARCSEC = np.pi / 648000.0


class Truth:
    """Places in latitude, longitude, ellipsoidal height, their geoid and deflections, and what is measured there."""

    def __init__(self) -> None:
        random = np.random.default_rng(7)
        self.geodetic = np.stack(
            [
                LATITUDE + random.uniform(-0.4, 0.4, 7),
                LONGITUDE + random.uniform(-0.6, 0.6, 7),
                random.uniform(500.0, 2500.0, 7),
            ],
            axis=1,
        )
        self.N = random.uniform(46.0, 50.0, 7)
        self.deflection = random.uniform(-20.0, 20.0, (7, 2)) * ARCSEC
        self.geocentric = np.stack(
            Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True).transform(
                self.geodetic[:, 1], self.geodetic[:, 0], self.geodetic[:, 2]
            ),
            axis=1,
        )
        self.start = self.geodetic + np.where(
            np.isin(NAMES, HELD)[:, None], 0.0, random.uniform(-1.0, 1.0, (7, 3)) * [2e-6, 2e-6, 0.2]
        )
        self.random = random

    def horizon(self, k: int) -> np.ndarray:
        """Axes east, north, up (rows) of the plumb line of a place, geocentric."""
        latitude = np.radians(self.geodetic[k, 0]) + self.deflection[k, 0]
        longitude = np.radians(self.geodetic[k, 1]) + self.deflection[k, 1] / np.cos(np.radians(self.geodetic[k, 0]))
        s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
        return np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])


@pytest.fixture(scope="module")
def truth() -> Truth:
    return Truth()


@pytest.fixture(scope="module")
def measured(truth: Truth) -> dict[str, list[list[Any]]]:
    """Vectors, directions with zenith angles, distances and height differences with errors of their σ."""
    random = truth.random
    found: dict[str, list[list[Any]]] = {"vectors": [], "directions": [], "distances": [], "heights": []}
    turn = dict(zip(NAMES, random.uniform(0.0, 6.0, 7), strict=True))
    for a, b in PAIRS:
        i, j = NAMES.index(a), NAMES.index(b)
        vector = truth.geocentric[j] - truth.geocentric[i]
        if (i + j) % 2:
            found["vectors"].append([a, b, *(vector + random.normal(0.0, 0.02, 3))])
        found["distances"].append([a, b, np.linalg.norm(vector) + random.normal(0.0, 0.03)])
        rise = (truth.geodetic[j, 2] - truth.N[j]) - (truth.geodetic[i, 2] - truth.N[i])
        found["heights"].append([a, b, rise + random.normal(0.0, 0.03)])
        for (station, s), (target, t) in (((a, i), (b, j)), ((b, j), (a, i))):
            east, north, up = truth.horizon(s) @ (truth.geocentric[t] - truth.geocentric[s])
            horizontal = (np.arctan2(east, north) - turn[station]) % (2 * np.pi)
            zenith = np.arctan2(np.hypot(east, north), up)
            errors = random.normal(0.0, 0.5 * ARCSEC, 2)
            found["directions"].append([station, target, horizontal + errors[0], zenith + errors[1]])
    return found


def _texts(rows: list[list[Any]]) -> list[list[str]]:
    return [
        [cell if isinstance(cell, str) else "" if np.isnan(cell) else repr(float(cell)) for cell in row] for row in rows
    ]


def _observations(measured: dict[str, list[list[Any]]], heights: bool) -> list[dict[str, Any]]:
    tables = [
        ("gnss_vector", ["from", "to", "dx", "dy", "dz"], measured["vectors"], "0.02"),
        ("distance", ["from", "to", "distance"], measured["distances"], "0.03"),
        (
            "zenith_directions",
            ["station", "to", "horizontal", "zenith"],
            measured["directions"],
            "0.5 arcsec",
        ),
    ]
    if heights:
        tables.append(("height_difference", ["from", "to", "dz"], measured["heights"], "0.03"))
    return [
        {"type": type_, "columns": columns, "rows": _texts(rows), "values": {"sigma": sigma}}
        for type_, columns, rows, sigma in tables
        if rows
    ]


def _on_earth(
    truth: Truth,
    measured: Any,
    crs: str,
    coordinates: np.ndarray,
    levelled: bool,
    free: bool = False,
    **world: str,
) -> Solved:
    names = {"EPSG:25832": ["east", "north", "height"], "EPSG:4936": ["x", "y", "z"]}.get(
        crs, ["latitude", "longitude", "height"]
    )
    columns = ["id", *names, "geoid", "deflection_north", "deflection_east"]
    rows = [
        [name, *place, N, *deflection]
        for name, place, N, deflection in zip(NAMES, coordinates, truth.N, truth.deflection, strict=True)
    ]
    units = {"deflection_north": "rad", "deflection_east": "rad"}
    if "latitude" in names:
        units |= {"latitude": "deg", "longitude": "deg"}
    table = {"columns": columns, "units": units}
    held, new = ([row for row in _texts(rows) if (row[0] in HELD) is on] for on in (True, False))
    points = [{**table, "rows": held, "fixed": ["x", "y", "z"]}, {**table, "rows": new}]
    project = {
        "mor": "1",
        "units": {"length": "m", "angle": "rad"},
        "world": {"crs": crs, **world},
        "points": [{**table, "rows": _texts(rows)}] if free else points,
        "datum": "free" if free else "fixed",
        "observations": _observations(measured, levelled),
    }
    return solve_network(network_of_yaml(yaml_text(project, width=1000), None))  # type: ignore[arg-type]


def _projected(geodetic: np.ndarray) -> np.ndarray:
    utm = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True)
    return np.column_stack([*utm.transform(geodetic[:, 1], geodetic[:, 0]), geodetic[:, 2]])


def _compare(one: Solved, other: Solved, digits: float) -> None:
    """The same v, r, σ0 of all observations that both have; ``digits`` (m) of lengths, whose σ are 2e-2."""
    assert one.quality.sigma0 == pytest.approx(other.quality.sigma0, rel=digits)
    assert one.quality.redundancy == other.quality.redundancy
    theirs = dict(zip((g.name for g in other.network.groups), other.quality.groups, strict=True))
    for group, quality in zip(one.network.groups, one.quality.groups, strict=True):
        angular = group.type.wraps.all()
        np.testing.assert_allclose(quality.v, theirs[group.name].v, atol=1e-12 if angular else digits)
        np.testing.assert_allclose(quality.r, theirs[group.name].r, atol=1e-9)


def _places(solved: Solved) -> np.ndarray:
    numbers = solved.network.things["point"].parts["position"]
    places = solved.network.world.horizon.to_geocentric(solved.adjustment.values["point"][numbers])
    order = [solved.network.things["point"].ids.index(name) for name in NAMES]
    return places[order]


def test_projected_geographic_and_geocentric_coordinates_give_the_same_adjustment(truth: Truth, measured: Any) -> None:
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    geocentric = np.stack(cart.transform(truth.start[:, 1], truth.start[:, 0], truth.start[:, 2]), axis=1)
    above_geoid = truth.start - np.column_stack([np.zeros((7, 2)), truth.N])
    solutions = [
        _on_earth(truth, measured, "EPSG:4937", truth.start, True),
        _on_earth(truth, measured, "EPSG:25832", _projected(above_geoid), True, heights="orthometric"),
        _on_earth(truth, measured, "EPSG:4936", geocentric, True),
    ]
    for solved in solutions:
        assert (
            solved.quality.redundancy
            == sum(len(rows) * m for rows, m in zip(measured.values(), (3, 2, 1, 1), strict=True)) - 15 - 7
        )
        np.testing.assert_allclose(_places(solved), _places(solutions[0]), atol=1e-8)
        _compare(solved, solutions[0], 4e-9)  # the held points are read to 1e-9 m, in coordinates of 6e6 m
    assert 0.8 < solutions[0].quality.sigma0 < 1.2


def test_a_free_network_is_the_same_to_all_digits_in_every_formulation(truth: Truth, measured: Any) -> None:
    """Coordinates are start values here: what is read of them to 1e-9 m changes no residual."""
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    geocentric = np.stack(cart.transform(truth.start[:, 1], truth.start[:, 0], truth.start[:, 2]), axis=1)
    given = [("EPSG:4937", truth.start), ("EPSG:25832", _projected(truth.start)), ("EPSG:4936", geocentric)]
    ellipsoidal = {"EPSG:25832": {"heights": "ellipsoidal"}}
    solutions = [
        _on_earth(truth, measured, crs, places, False, True, **ellipsoidal.get(crs, {})) for crs, places in given
    ]
    for solved in solutions[1:]:
        _compare(solved, solutions[0], 1e-9)
        np.testing.assert_allclose(_places(solved), _places(solutions[0]), atol=1e-7)


def test_a_local_system_with_plumb_lines_by_hand_gives_the_same_adjustment(truth: Truth, measured: Any) -> None:
    """Fixed ω, φ of every station turn its axes into the horizon of its plumb line; vectors are turned beforehand."""
    earth = _on_earth(truth, measured, "EPSG:4937", truth.start, False)
    horizon = earth.network.world.horizon
    adjusted = _places(earth)
    local = (adjusted - horizon.origin) @ horizon.axes.T
    back = Transformer.from_crs("EPSG:4936", "EPSG:4937", always_xy=True).transform(*adjusted.T)
    stations = []
    for k, name in enumerate(NAMES):
        truth_there = Truth.__new__(Truth)
        truth_there.geodetic = np.column_stack([back[1], back[0], back[2]])
        truth_there.deflection = truth.deflection
        D = truth_there.horizon(k) @ horizon.axes.T
        omega, phi, _ = angles_from_rotation(D[None])[0]
        stations.append([name, name, omega, phi])
    points = {
        on: [[name, *place] for name, place in zip(NAMES, local, strict=True) if (name in HELD) is on]
        for on in (True, False)
    }
    vectors = [[a, b, *(horizon.axes @ np.array(v))] for a, b, *v in measured["vectors"]]
    observations = _observations({**measured, "vectors": vectors}, heights=False)
    observations[0]["type"] = "vector"
    project = {
        "mor": "1",
        "units": {"length": "m", "angle": "rad"},
        "points": [
            {"columns": ["id", "x", "y", "z"], "rows": _texts(points[True]), "fixed": ["x", "y", "z"]},
            {"columns": ["id", "x", "y", "z"], "rows": _texts(points[False])},
        ],
        "stations": [
            {
                "columns": ["id", "point", "omega", "phi"],
                "rows": _texts(stations),
                "level": "free",
                "fixed": ["omega", "phi"],
            }
        ],
        "observations": observations,
    }
    plane = solve_network(network_of_yaml(yaml_text(project, width=1000), None))  # type: ignore[arg-type]
    assert plane.quality.sigma0 == pytest.approx(earth.quality.sigma0, rel=1e-9)
    numbers = plane.network.things["point"].parts["position"]
    order = [plane.network.things["point"].ids.index(name) for name in NAMES]
    np.testing.assert_allclose(plane.adjustment.values["point"][numbers][order], local, atol=1e-7)
    for k, (one, other) in enumerate(zip(earth.quality.groups, plane.quality.groups, strict=True)):
        if k == 0:  # geocentric and local axes: the lengths of the residuals, and the sum of r
            np.testing.assert_allclose(np.linalg.norm(one.v, axis=1), np.linalg.norm(other.v, axis=1), atol=1e-9)
            np.testing.assert_allclose(one.r.sum(axis=1), other.r.sum(axis=1), atol=1e-9)
        else:
            np.testing.assert_allclose(one.v, other.v, atol=1e-9)
            np.testing.assert_allclose(one.r, other.r, atol=1e-9)


@pytest.mark.parametrize(
    "kinds", [("vectors", "directions", "distances", "heights"), ("vectors", "heights"), ("vectors",)]
)
def test_start_values_are_worked_out_on_the_earth(truth: Truth, measured: Any, kinds: tuple[str, ...]) -> None:
    """Points of which nothing is given but their geoid; as if verticals were parallel, heights begin 100 m off."""
    some = {name: rows if name in kinds else [] for name, rows in measured.items()}
    given = _on_earth(truth, some, "EPSG:4937", truth.start, "heights" in kinds)
    unknown = np.where(np.isin(NAMES, HELD)[:, None], truth.start, np.nan)
    found = _on_earth(truth, some, "EPSG:4937", unknown, "heights" in kinds)
    assert found.adjustment.outcome.is_solution
    np.testing.assert_allclose(_places(found), _places(given), atol=1e-7)
