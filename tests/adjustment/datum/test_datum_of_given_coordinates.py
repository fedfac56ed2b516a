"""Inner constraints refer to the given coordinates, whatever becomes of start values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from tests.scenarios.seeded_networks import KINDS, drawn

CASES = Path(__file__).parents[2] / "cases" / "datum_of_given_coordinates"
ROUGH = (0.0, 1e-4, 1e-3, 1e-2, 3e-2, 0.05, 0.1, 0.2)
"""σ of given coordinates as a part of the size of the network: up to 10⁴ σ of the observations."""


def misclosure(kind: str, seed: int, rough: float) -> float:
    """Return the largest component of Gᵀ(x − x given), in units of the median σ of a point; NaN without a solution."""
    network = drawn(kind, seed, rough=rough)
    result = mor.adjust(network.project())
    if not result.converged:
        return float("nan")
    frame = result.points.frame
    rows = [frame["id"].to_list().index(name) for name in network.names]
    x, sigma = (frame.select(columns).to_numpy()[rows] for columns in (["x", "y", "z"], ["sx", "sy", "sz"]))
    sums = network.movements(x).T @ (x - network.given).ravel()
    return float(np.abs(sums).max() / np.median(np.linalg.norm(sigma, axis=1)))


@pytest.mark.parametrize("kind", KINDS)
def test_constraint_holds_on_the_result(kind: str) -> None:
    assert misclosure(kind, 5, 0.05) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_constraint_holds_on_the_results_of_many_networks(kind: str) -> None:
    found = np.array([misclosure(kind, seed, ROUGH[seed % len(ROUGH)]) for seed in range(24)])
    assert found.max() < 1e-6  # NaN, of a network without a solution, is not


def test_replaced_start_value_of_a_datum_point_does_not_move_the_datum() -> None:
    # D is given 0.3 m from its place. The centre of the given coordinates moves by 0.06 m in x.
    near, far = (mor.adjust(CASES / name) for name in ("f0.gkf", "f0.3.gkf"))
    centres = [result.points.frame.select("x", "y").to_numpy().mean(axis=0) for result in (near, far)]
    np.testing.assert_allclose(centres[1] - centres[0], [0.06, 0.0], atol=1e-9)


def test_free_levelling_keeps_the_sum_of_its_given_heights() -> None:
    heights = mor.adjust(CASES / "free.gkf").points.frame["z"].to_numpy()
    assert abs(heights.sum() - (100 + 105 + 103 + 102)) < 1e-9
