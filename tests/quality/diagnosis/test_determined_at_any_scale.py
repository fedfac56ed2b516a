"""The unit of length and the size of σ and residuals do not decide whether a network is determined."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mor
from mor.errors import NoStartValuesError
from sample_projects.expected import ROOT
from tests.scenarios.seeded_networks import KINDS, OPEN, RELATIVE, drawn
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
    assert "P2" in {name for one in result.solved.adjustment.defect.undetermined for _, name, _ in one.unknowns} | {
        thing.name for thing in result.solved.network.undeterminable
    }


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


def test_sizes_are_told_in_the_unit_of_the_project() -> None:
    result = mor.adjust(ROOT / "machine_part" / "project.yaml")
    told = result.to_dict()["verdict"]["determined"]
    points = result.solved.adjustment.values["point"]
    assert told["size"] == pytest.approx(
        2.0 * np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)), rel=0.5
    )
    assert told["largest_sigma"] < 1.0


def test_sigma_of_one_for_every_observation_says_nothing_about_the_geometry() -> None:
    result = mor.adjust(drawn("plane distances", 3, sigma_scale=1e4).project())
    found = result.solved.verdict.determined
    assert found.everywhere


SCALES = (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9)
FAR = {"in line": (2.0, 0.2), "parallel": None, "hardly converging": (5e3, 5e4)}
"""A point sighted from A (0, 0) and B (1, 0.1), in units of the size of the network."""


def hanging(kind: str, size: float, noise: float, sigma_scale: float) -> dict[str, Any]:
    """A network of a kind with a point, or two, that too few observations tie to the rest."""
    network = drawn(kind, 3, size=size, sigma_scale=sigma_scale, noise=noise, rough=1e-3)
    for key, rows in network.rows.items():
        if kind in ("levelling", "vectors"):
            rows[:] = [row for row in rows if (row[0] in ("P0", "P1")) == (row[1] in ("P0", "P1"))]
        elif key in ("directions", "zenith_directions", "image"):
            rows[:] = [row for row in rows if row[0] != "P0" and (row[1] != "P0" or row[0] in "P2 I0")]
        else:
            few = {"plane distances": 1, "distances": 2}.get(kind, 0)
            rows[:] = [row for row in rows if "P0" not in row[:2]] + [r for r in rows if "P0" in r[:2]][:few]
    return network.project()


def lines_of_sight(where: str, size: float, noise: float, sigma_scale: float) -> dict[str, Any]:
    """A point that two stations see along one line, along parallel lines, or where these hardly converge."""
    random = np.random.default_rng(1)
    at = {"A": (0.0, 0.0), "B": (1.0, 0.1), "C": (0.4, 0.9), "D": (0.7, -0.6), "far": FAR[where]}
    rows = []
    for station, others in (("A", ("C", "D", "B", "far")), ("B", ("C", "D", "A", "far"))):
        for name in others:
            bearing = 0.3 if at[name] is None else np.arctan2(*np.subtract(at[name], at[station]))
            rows.append([station, name, float(bearing + noise * RELATIVE * random.standard_normal())])
    at["far"] = at["far"] or (0.7, 2.0)
    points = {name: [name, xy[0] * size, xy[1] * size, 0.0] for name, xy in at.items()}
    return {
        "mor": 1,
        "units": {"length": "m", "angle": "rad"},
        "points": [
            {"columns": ["id", "x", "y", "z"], "rows": [points[k] for k in names], "fixed": fixed}
            for names, fixed in (("ABC", ["x", "y", "z"]), (("D", "far"), ["z"]))
        ],
        "observations": [
            {
                "type": "directions",
                "columns": ["station", "to", "horizontal"],
                "rows": rows,
                "values": {"sigma": repr(sigma_scale * RELATIVE)},
            }
        ],
    }


def says_determined(project: dict[str, Any]) -> bool:
    try:
        result = mor.adjust(project)
    except NoStartValuesError:
        return False
    if not result.converged:
        assert "determine" in result.reason, result.reason
        return False
    return result.solved.verdict.determined.everywhere and not result.solved.network.undeterminable


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("sigma_scale", [1.0, 1e9])
@pytest.mark.parametrize("where", FAR)
def test_lines_of_sight_without_an_intersection(where: str, sigma_scale: float, noise: float) -> None:
    assert not says_determined(lines_of_sight(where, 1.0, noise, sigma_scale))


def test_a_network_without_images_may_have_suspects() -> None:
    """At this scale round-off makes suspects, and most networks here have no rotations."""
    for seed, kind in itertools.product((3, 4, 7), KINDS):
        network = drawn(kind, seed, size=1e9, sigma_scale=1e-9, noise=0.0, rough=1e-3)
        assert says_determined(network.project()), (kind, seed)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("size", SCALES)
@pytest.mark.parametrize("sigma_scale", SCALES)
def test_known_rank_at_any_scale(size: float, sigma_scale: float, noise: float) -> None:
    for kind in KINDS:
        sound = drawn(kind, 3, size=size, sigma_scale=sigma_scale, noise=noise, rough=1e-3)
        assert says_determined(sound.project()), kind
        assert not says_determined(hanging(kind, size, noise, sigma_scale)), kind
    for where in FAR if sigma_scale >= 1.0 else ("in line", "parallel"):
        assert not says_determined(lines_of_sight(where, size, noise, sigma_scale)), where
