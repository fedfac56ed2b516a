"""Ratios of distances: quotients of what distances are, a place found from them alone, the scale that cancels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

import mor as api
from mor.api.pipeline import read_document, read_network, solve_network
from mor.model.earth import Ellipsoid, Horizon
from mor.model.geodetic import earth_types
from mor.model.observation_types import PLAIN_TYPES
from tests.scenarios.small_projects import mor, write

HORIZON = Horizon(Ellipsoid(6378137.0, 1.0 / 298.257222101), 0.87, 0.18)


@pytest.mark.parametrize("types", [PLAIN_TYPES, earth_types(HORIZON)], ids=["plane", "earth"])
def test_a_ratio_is_the_quotient_of_two_distances(types):
    """On the earth instruments and targets are raised along plumb lines; their deflections are constants."""
    rng = np.random.default_rng(1)
    places, heights = rng.normal(size=(3, 20, 3)) * [3000.0, 3000.0, 200.0], rng.uniform(0.0, 2.0, (3, 20, 1))
    ratio = types["distance_ratio"]
    deflections = rng.normal(size=(20, len(ratio.constants))) * 1e-4
    blocks = [part for k in range(3) for part in (places[k], heights[k])]
    found = ratio.equation(blocks, deflections).values[:, 0]
    lengths = []
    for end in (2, 1):
        own = [part for k in (0, end) for part in (places[k], heights[k])]
        slots = types["distance"].slots
        extra = [np.tile([[1.0, 0.0]], (20, 1))] if len(slots) > len(own) else []
        each = len(ratio.constants) // 3
        constants = np.concatenate([deflections[:, k * each : (k + 1) * each] for k in (0, end)], axis=1)
        lengths.append(types["distance"].equation([*own, *extra], constants).values[:, 0])
    np.testing.assert_allclose(found, lengths[0] / lengths[1], rtol=1e-14)


def test_a_place_from_ratios_alone(tmp_path: Path) -> None:
    known = {"A": (0, 0, 0), "B": (80, 5, 3), "C": (60, 70, 12), "D": (-10, 55, 1), "E": (20, 30, 25)}
    truth = np.array([31.0, 22.0, 6.0])
    length = {name: np.linalg.norm(np.array(xyz) - truth - [0, 0, 1.5]) for name, xyz in known.items()}
    rows = [["P", "A", name, repr(float(length[name] / length["A"])), 1.5] for name in "BCDE"]
    points = [[name, *xyz] for name, xyz in known.items()]
    text = f"""\
mor: 1
points:
  - {{columns: [id, x, y, z], rows: {points}, fixed: [x, y, z]}}
  - {{columns: [id, x, y, z], rows: [[P, 28, 25, 4]]}}
observations:
  - {{type: distance_ratio, columns: [at, from, to, ratio, at_height], rows: {rows}, values: {{sigma: 3 ppm}}}}
"""
    solved = solve_network(read_network(read_document(write(tmp_path, text)), tmp_path))
    point = solved.network.things["point"].part("P", "position")
    np.testing.assert_allclose(solved.adjustment.values["point"][point], truth, atol=1e-9)
    assert solved.quality is not None
    assert solved.quality.redundancy == 1
    assert mor("adjust", tmp_path / "project.yaml", "-o", tmp_path / "out", "--lang", "de").code in (0, 1)


def test_equal_lengths_have_a_common_one() -> None:
    """Three bars of one unknown length: distances 0 with the free offset of one instrument, against SciPy."""
    random = np.random.default_rng(3)
    ends = np.cumsum(random.normal(size=(6, 3)), axis=0)
    ends[1::2] = ends[::2] + 1.2 * (way := random.normal(size=(3, 3))) / np.linalg.norm(way, axis=1)[:, None]
    observed = ends + random.normal(0.0, 0.01, ends.shape)
    result = api.adjust(
        {
            "mor": 1,
            "instruments": {"bar": {"offset": {"free": 1.0}}},
            "points": [{"columns": ["id"], "rows": [[f"P{k}"] for k in range(6)]}],
            "observations": [
                {
                    "type": "coordinates",
                    "columns": ["point", "x", "y", "z"],
                    "rows": [[f"P{k}", *row] for k, row in enumerate(observed.tolist())],
                    "values": {"sigma": 0.01},
                },
                {
                    "type": "distance",
                    "instrument": "bar",
                    "columns": ["from", "to", "distance"],
                    "rows": [[f"P{k}", f"P{k + 1}", 0] for k in (0, 2, 4)],
                    "values": {"sigma": 1e-4},
                },
            ],
        }
    )

    def misclosures(x: np.ndarray) -> np.ndarray:
        points = x[:18].reshape(6, 3)
        bars = np.linalg.norm(points[1::2] - points[::2], axis=1) - x[18]
        return np.concatenate([(points - observed).ravel() / 0.01, bars / 1e-4])

    best = optimize.least_squares(misclosures, np.append(observed, 1.2), x_scale="jac", xtol=1e-15, ftol=1e-15)
    found = [[result.points.row(f"P{k}")[c] for c in "xyz"] for k in range(6)]
    np.testing.assert_allclose(found, best.x[:18].reshape(6, 3), rtol=0.0, atol=1e-8)
    (bar,) = (one for one in result.to_dict()["others"] if one["id"] == "bar")
    assert bar["components"]["offset"]["value"] == pytest.approx(best.x[18], abs=1e-8)
