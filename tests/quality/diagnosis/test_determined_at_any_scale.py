"""Whether a network is determined depends neither on the unit of length nor on the size of σ and residuals."""

from __future__ import annotations

from pathlib import Path

import pytest

import mor
from tests.scenarios.seeded_networks import KINDS, OPEN, drawn
from tests.scenarios.small_projects import mor as command

CASE = Path(__file__).parents[2] / "cases" / "dam_not_determined" / "dam.yaml"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_free_movements_are_the_same_at_any_size(kind: str, size: float) -> None:
    result = mor.adjust(drawn(kind, 1, size=size, rough=1e-3).project())
    assert result.converged, result.reason
    assert len(result.solved.adjustment.defect.movements) == len(OPEN[kind])


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_unobserved_direction_is_found_at_any_size(size: float) -> None:
    network = drawn("images", 1, size=size, rough=1e-3)
    rays = network.rows["image"]
    rays[:] = [row for row in rays if row[1] != "P2" or row[0] == "I0"]
    result = mor.adjust(network.project())
    assert not result.converged
    assert "P2" in {
        name for one in result.solved.adjustment.defect.undetermined for _, name, _ in one.unknowns
    } | {thing.name for thing in result.solved.network.undeterminable}


def test_result_with_sigma_of_metres_is_not_accepted(tmp_path: Path) -> None:
    run = command("adjust", CASE, "-o", tmp_path / "out")
    assert run.code == 0
    assert "NOT DETERMINED: 8 of 8 points" in run.err
    assert command("adjust", CASE, "-o", tmp_path / "strict", "--strict").code == 1
    result = mor.adjust(CASE)
    assert not result.accepted
    verdict = result.to_dict()["verdict"]
    assert verdict["says"] == "not determined"
    assert verdict["determined"]["largest_sigma"] > 10.0


def test_sigma_of_one_for_every_observation_says_nothing_about_the_geometry() -> None:
    result = mor.adjust(drawn("plane distances", 3, sigma_scale=1e4).project())
    found = result.solved.verdict.determined
    assert found.everywhere
