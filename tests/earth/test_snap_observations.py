"""SNAP's test of its observation types: every computed value against what SNAP prints (observed − residual).

Mode data_check: nothing is adjusted, all is computed from the given coordinates on the International ellipsoid.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

from mor.model.contract import wrap
from mor.model.earth import Horizon
from mor.model.geodetic import earth_types
from mor.project.reference_system import reference_system
from tests.reference_data import missing, reference_folder

REAL = reference_folder("earth/snap")
pytestmark = pytest.mark.skipif(REAL is None, reason=missing("earth/snap"))

SYSTEM = reference_system("EPSG:4272")
GEOID = {"1": 0.0, "2": 0.0, "3": 0.0, "4": 30.0, "5": 30.0}
HORIZON = Horizon(SYSTEM.ellipsoid, np.radians(-41.01), np.radians(173.33))
TYPES = earth_types(HORIZON)
_METER, _NONE = np.array([[1.0, 0.0]]), np.zeros((1, 0))
_PRINTED = {"angle": np.radians(0.6e-5), "length": 0.6e-4}


def _rows() -> list[dict[str, str]]:
    assert REAL is not None
    with (REAL / "expected-test1-obs.csv").open() as file:
        return list(csv.DictReader(file))


def _stations() -> dict[str, np.ndarray]:
    assert REAL is not None
    with (REAL / "expected-test1-stn.csv").open() as file:
        rows = list(csv.DictReader(file))
    geodetic = {
        row["code"]: [
            np.radians(float(row["latitude"])),
            np.radians(float(row["longitude"])),
            float(row["ellheight"]),
        ]
        for row in rows
    }
    return {name: HORIZON.from_geodetic(np.array([place])) for name, place in geodetic.items()}


def _height(row: dict[str, str], end: str) -> np.ndarray:
    return np.array([[float(row[end] or 0.0)]])


def _computed(key: str, row: dict[str, str], at: dict[str, np.ndarray], *extra: np.ndarray) -> np.ndarray:
    """Value of a type between the stations of a row, with heights where the type has them."""
    type_ = TYPES[key]
    values = {
        ("from", "position"): at[row["fromstn"]],
        ("point", "position"): at[row["fromstn"]],
        ("to", "position"): at.get(row["tostn"], at[row["fromstn"]]),
        ("from", "height"): _height(row, "fromhgt"),
        ("to", "height"): _height(row, "tohgt"),
        ("instrument", "distance meter"): _METER,
        ("instrument", "refraction"): np.zeros((1, 1)),
        ("instrument", "gnss frame"): np.array([[0.0] * 6 + [1.0]]),
    }
    constants = []
    for constant in type_.constants:
        name, _, end = constant.name.partition(" of ")
        station = row["tostn"] if end == "to" else row["fromstn"]
        known = {"geoid": GEOID[station or row["fromstn"]], "earth radius": 6.371e6, "face": 1.0}
        constants.append(known.get(name, 0.0))
    blocks = [values[slot.of, slot.part].copy() for slot in type_.slots]
    return type_.equation(blocks, np.array([constants]) if constants else _NONE).values[0]


_TYPES = {
    "AZ": "azimuth",
    "SD": "distance",
    "ED": "ellipsoid_arc",
    "MD": "mean_sea_level_distance",
    "HD": "height_reduced_distance",
    "ZD": "zenith_angle",
    "LV": "ellipsoidal_height_difference",
    "OH": "orthometric_height",
    "EH": "ellipsoidal_height",
}


def _degrees(text: str) -> float:
    """Radians of an angle that was given to 0.1″ and is printed to 0.00001°."""
    return float(np.radians(round(float(text) * 36000.0) / 36000.0))


@pytest.mark.parametrize("code", _TYPES)
def test_values_of_single_observations(code: str) -> None:
    at = _stations()
    rows = [row for row in _rows() if row["obstype"] == code]
    assert rows
    for row in rows:
        computed = float(_computed(_TYPES[code], row, at)[0])
        if code in ("OH", "EH"):  # of the antenna, by its height above the mark
            computed += float(row["fromhgt"])
        angular = code in ("AZ", "ZD")
        observed = _degrees(row["value"]) if angular else float(row["value"])
        residual = np.radians(float(row["residual"])) if angular else float(row["residual"])
        difference = float(wrap(np.array(observed - computed))) if angular else observed - computed
        assert difference == pytest.approx(residual, abs=_PRINTED["angle" if angular else "length"])


@pytest.mark.parametrize(("code", "component"), [("LT", 0), ("LN", 1)])
def test_latitudes_and_longitudes(code: str, component: int) -> None:
    at = _stations()
    for row in (row for row in _rows() if row["obstype"] == code):
        computed = _computed("geodetic_position", row, at)[component]
        assert np.degrees(computed) == pytest.approx(float(row["value"]) - float(row["residual"]), abs=0.6e-6)


def test_horizontal_angles_up_to_the_orientation_of_their_set() -> None:
    at, sets = _stations(), {}
    for row in (row for row in _rows() if row["obstype"] == "HA"):
        adjusted = _degrees(row["value"]) - np.radians(float(row["residual"]))
        turn = float(wrap(np.array(adjusted - _computed("azimuth", row, at)[0])))
        sets.setdefault(row["obsset"], []).append(turn)
    assert len(sets) >= 9
    for turns in sets.values():
        np.testing.assert_allclose(turns, turns[0], atol=2.0 * _PRINTED["angle"])


def test_distance_ratios_up_to_their_scale() -> None:
    at, sets = _stations(), {}
    for row in (row for row in _rows() if row["obstype"] == "DR"):
        ratio = (float(row["value"]) - float(row["residual"])) / float(_computed("distance", row, at)[0])
        sets.setdefault(row["obsset"], []).append(ratio)
    assert len(sets) == 2
    for ratios in sets.values():
        np.testing.assert_allclose(ratios, ratios[0], atol=3e-7)


@pytest.mark.parametrize(("code", "key"), [("GB", "gnss_vector"), ("GX", "gnss_position")])
def test_vectors_and_positions_of_satellites(code: str, key: str) -> None:
    """Residuals are printed east, north, up: at the point, of a vector at the middle of its ends."""
    at = _stations()
    rows = [row for row in _rows() if row["obstype"] == code]
    assert len(rows) == 21
    for row in rows:
        computed = _computed(key, row, at)
        observed = np.array([float(row[f"value{k}"]) for k in (1, 2, 3)])
        middle = 0.5 * (at[row["fromstn"]] + at.get(row["tostn"], at[row["fromstn"]]))
        residual = HORIZON.local_axes(middle)[0] @ HORIZON.axes @ (observed - computed)
        np.testing.assert_allclose(residual, [float(row[f"residual{k}"]) for k in (1, 2, 3)], atol=1.3e-4)
