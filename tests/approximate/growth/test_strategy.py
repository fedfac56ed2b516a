"""Start values from nothing: the same solution as with given ones, for every kind of network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.project.network import Network
from mor.quality.solution import Solved
from mor.solve.iterate import Outcome
from mor.start.assembly import approximate
from tests.reference_data import NETWORKS, network_name
from tests.selection import slow_but

SAMPLES = Path(__file__).parents[3] / "sample_projects"
TRAVERSES = ("traverse-01-nw", "traverse-01-se", "traverse-01-wn", "traverse-01-ws")
GAMA = [
    path for path in NETWORKS if path.parent.name == "gama" and not path.stem.startswith((*TRAVERSES, "scale-cov-dms"))
]
"""One of the traverses that differ in their axes only, and of the same network in other units."""


def without_start(network: Network) -> Network:
    """The network with the start values of all free, unobserved coordinates and attitudes taken away."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    free = network.blocks["point"].free & ~np.isfinite(network.sigma["point"])
    start["point"][free] = np.nan
    if "rotation" in start:
        blocks = network.blocks["rotation"]
        loose = blocks.free.any(axis=1) & ~np.isfinite(network.sigma["rotation"]).any(axis=1)
        if blocks.about_axes is not None:
            loose &= ~blocks.about_axes
        start["rotation"][loose] = np.nan
    if "base" in start:
        start["base"][network.blocks["base"].free] = np.nan
    return replace(network, start=start, datum=network.datum._replace(given=None))


def of_project(path: Path) -> Network:
    return read_network(read_document(path), path.parent)


def assert_same_solution(found: Solved, expected: Solved) -> None:
    assert found.adjustment.outcome is Outcome.CONVERGED
    assert found.quality is not None
    assert expected.quality is not None
    assert found.quality.redundancy == expected.quality.redundancy
    assert found.quality.sigma0 == pytest.approx(expected.quality.sigma0, rel=1e-7, abs=1e-8)


def _begins_with_something(project: Path) -> bool:
    """Knots of trajectories begin at what satellites and inertial systems say."""
    return "trajectories:" in project.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name",
    slow_but(
        ("bridge", "facade"),
        sorted(p.parent.name for p in SAMPLES.glob("*/project.yaml") if not _begins_with_something(p)),
    ),
)
def test_sample_projects_from_nothing(name: str) -> None:
    network = of_project(SAMPLES / name / "project.yaml")
    assert_same_solution(solve_network(without_start(network)), solve_network(network))


@pytest.mark.slow
def test_a_network_from_nothing_but_plan_coordinates_has_heights_of_its_own() -> None:
    network = of_project(SAMPLES / "bridge" / "project.yaml")
    point = network.start["point"].copy()
    point[:, 2] = np.nan
    in_plan = replace(network, start={**network.start, "point": point})
    assert_same_solution(solve_network(in_plan), solve_network(network))


@pytest.mark.parametrize("path", GAMA, ids=network_name)
def test_geodetic_networks_without_coordinates_of_new_points(path: Path) -> None:
    network = of_project(path)
    assert_same_solution(solve_network(without_start(network)), solve_network(network))


def test_given_values_are_never_overridden() -> None:
    network = of_project(SAMPLES / "facade" / "project.yaml")
    found = approximate(without_start(network)).start
    kept = np.isfinite(without_start(network).start["point"])
    np.testing.assert_array_equal(found["point"][kept], network.start["point"][kept])
    assert approximate(network).start is network.start


def test_everything_is_told_how_it_was_obtained() -> None:
    network = of_project(SAMPLES / "test_field" / "project.yaml")
    how = approximate(without_start(network)).how
    images = {f"image {name}" for name in network.things["image"].ids}
    assert images <= how.keys()
    assert sum("relative orientation" in str(rule) for rule in how.values()) >= 2


def test_what_cannot_be_known_is_named() -> None:
    network = without_start(of_project(SAMPLES / "facade" / "project.yaml"))
    lost = network.things["point"].ids[-1]
    group = network.groups[0]
    rows = [i for i, name in enumerate(group.references[1]) if name == lost][1:]
    observed = group.observed.copy()
    observed[rows] = np.nan
    crippled = replace(network, groups=(replace(group, observed=observed), *network.groups[1:]))
    assert [thing for thing in approximate(crippled).missing if (thing.kind, thing.name) == ("point", lost)]
