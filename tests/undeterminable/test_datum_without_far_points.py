"""Points far from the others do not carry a free datum in which nothing would be known of these."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.errors import InputError
from mor.project.network import Network
from mor.quality.assessment import median_distance, points_far_off
from mor.quality.determinability import with_nearer_datum
from mor.solve.iterate import Adjustment

SAMPLES = Path(__file__).parents[2] / "sample_projects"


def solved(name: str) -> tuple[Network, Adjustment]:
    """A sample project, adjusted."""
    found = mor.adjust(str(SAMPLES / name / "project.yaml")).solved
    return found.network, found.adjustment


def test_a_point_beyond_ten_median_distances_is_far_off() -> None:
    _, adjustment = solved("test_field")
    assert len(points_far_off(adjustment)) == 0
    points = adjustment.values["point"].copy()
    median = np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1))
    points[7] += [12.0 * median, 0.0, 0.0]
    moved = adjustment._replace(values={**adjustment.values, "point": points})
    assert points_far_off(moved).tolist() == [7]


def test_far_points_leave_the_datum_and_it_is_said() -> None:
    network, adjustment = solved("test_field")
    far = np.array([3, 5])
    nearer = with_nearer_datum(network, adjustment, far)
    assert nearer is not None
    changed = (nearer.datum.mask != network.datum.mask).any(axis=1)
    assert np.flatnonzero(changed).tolist() == [3, 5]
    assert not nearer.datum.mask[far].any()
    assert "2 points" in nearer.notes[-1].message


def test_a_datum_that_the_user_chose_stays() -> None:
    network, adjustment = solved("dam_epochs")
    assert with_nearer_datum(network, adjustment, np.array([0])) is None
    network, adjustment = solved("test_field")
    assert with_nearer_datum(network, adjustment, np.array([], dtype=np.int64)) is None


def test_sights_to_one_target_say_nothing_about_the_size_of_the_network() -> None:
    """Direction and distance determine each of five targets at one place: the distance between them is no size."""
    sights = [[f"P{k}", 50.0 + 1e-4 * k, 100.0, 20.0] for k in range(5)]
    found = mor.adjust(
        {
            "mor": 1,
            "units": {"length": "m", "angle": "gon"},
            "datum": "free",
            "points": [{"columns": ["id"], "rows": [["S"], *([name] for name, *_ in sights)]}],
            "observations": [
                {
                    "type": "zenith_directions",
                    "columns": ["station", "to", "horizontal", "zenith"],
                    "rows": [["S", *row[:3]] for row in sights],
                    "values": {"sigma": "1 mgon"},
                },
                {
                    "type": "distance",
                    "columns": ["from", "to", "distance"],
                    "rows": [["S", name, distance] for name, _, _, distance in sights],
                    "values": {"sigma": "2 mm"},
                },
            ],
        }
    ).solved
    assert found.adjustment.outcome.is_solution
    assert median_distance(found.adjustment) == pytest.approx(20.0, rel=0.01)


def test_a_levelling_line_that_nothing_ties_is_named_as_such() -> None:
    project = {
        "mor": 1,
        "points": [
            {"columns": ["id", "z"], "rows": [["A", 10.0]], "values": {"x": 0, "y": 0}, "fixed": ["x", "y", "z"]},
            {"columns": ["id"], "rows": [["B"], ["C"], ["D"]], "values": {"x": 0, "y": 0}, "fixed": ["x", "y"]},
        ],
        "observations": [
            {
                "type": "height_difference",
                "columns": ["from", "to", "dz"],
                "rows": [["A", "B", 1.0], ["C", "D", 1.0]],
                "values": {"sigma": "1 mm"},
            }
        ],
    }
    with pytest.raises(InputError, match="point C: no height difference ties it to a point with a height"):
        mor.adjust(project)
