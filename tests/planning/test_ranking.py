"""Every ranked gain is that of a plan adjusted anew; the greedy plan reaches what is required with few measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.api import design as ranks
from mor.api.design import ranking
from mor.api.plan import solve_plan
from mor.errors import InputError
from mor.plan import ranking as wide
from mor.plan.requirements import REACHED, interest_of, judged, requirements
from tests.scenarios.planned_networks import BRIDGE, grid, sample


def with_row(network, ranked):
    """The network with one candidate taking part."""
    group = network.candidates[ranked.unit.group]
    alone = np.where(np.arange(group.count)[:, None] == ranked.unit.row, group.observed, np.nan)
    return replace(network, groups=(*network.groups, replace(group, observed=alone)))


def without_row(network, ranked):
    """The network without one row of a group."""
    groups = list(network.groups)
    group = groups[ranked.unit.group]
    left = np.where(np.arange(group.count)[:, None] == ranked.unit.row, np.nan, group.observed)
    groups[ranked.unit.group] = replace(group, observed=left)
    return replace(network, groups=tuple(groups))


def check(network, some, changed, required):
    """The σ ratio and the smallest r of ranked changes against those of the network adjusted anew."""
    for one in some:
        quality = solve_plan(changed(network, one)).quality
        assert quality is not None
        smallest = min(np.nanmin(group.r) for group in quality.groups if np.isfinite(group.r).any())
        assert one.smallest_r == pytest.approx(smallest, abs=1e-9)
        for requirement in required:
            limit = requirement.limit
            assert one.largest_ratio == pytest.approx(judged(requirement, quality).worst / limit, rel=1e-9)


@pytest.mark.slow
def test_gains_and_losses_are_those_of_the_network_adjusted_anew():
    network = sample("bridge", **BRIDGE)
    required = requirements(network)
    found = ranking(solve_plan(network), required, 0)
    assert len(found.candidates) == 7
    check(network, found.candidates, with_row, required)
    possible = [one for one in found.planned if one.possible]
    check(network, possible[:: len(possible) // 6], without_row, required)
    network = grid(1, require={"sigma": {"ellipsoid": "2 mm"}})
    required = requirements(network)
    found = ranking(solve_plan(network), required, 0)
    check(network, found.candidates[::5], with_row, required)


def test_checks_are_nothing_that_could_be_spared():
    check_distance = {
        "type": "distance",
        "columns": ["from", "to", "distance", "sigma"],
        "rows": [["P1", "P4", "170", "0.001"]],
    }
    plain, checked = (sample("bridge", **changes) for changes in ({}, {"checks": [check_distance]}))
    one, other = (ranking(solve_plan(network), (), 0) for network in (plain, checked))
    assert len(checked.checks) == 1
    found = [
        [(row.unit.group, row.unit.row, row.precision, row.smallest_r) for row in each.planned] for each in (one, other)
    ]
    assert found[0] == found[1]


def test_correlated_observations_are_spared_together():
    network = sample("bridge", **BRIDGE)
    k = next(k for k, group in enumerate(network.groups) if group.name == "distances.csv")
    group = network.groups[k]
    rows = np.arange(group.count)
    covariance = 1e-6 * (0.4 * np.eye(group.count) + 0.3)
    from mor.project.network import Correlation

    tied = Correlation(np.full(group.count, k), rows, np.zeros(group.count, dtype=np.int64), covariance)
    network = replace(network, correlations=(tied,))
    solved = solve_plan(network)
    found = ranking(solved, (), 0)
    together = [one for one in found.planned if one.unit.group == k]
    assert [one.unit.cost for one in together] == [group.count]
    left = replace(
        network,
        correlations=(),
        groups=tuple(
            replace(g, observed=np.full(g.observed.shape, np.nan)) if n == k else g
            for n, g in enumerate(network.groups)
        ),
    )
    if together[0].possible:
        quality = solve_plan(left).quality
        assert quality is not None
        smallest = min(np.nanmin(g.r) for g in quality.groups if np.isfinite(g.r).any())
        assert together[0].smallest_r == pytest.approx(smallest, abs=1e-9)
    check(network, found.candidates[:3], with_row, ())
    now = min(np.nanmin(g.r) for g in solved.quality.groups if np.isfinite(g.r).any())
    assert float(found.now.smallest_r[0]) == pytest.approx(now, abs=1e-9)


def unseen(name, count):
    """Rays of a sample that nobody planned: every image and point that it has, but for those it observes."""
    network = sample(name)
    group = next(group for group in network.groups if len(group.lines))
    images, points = (names.texts().to_list() for names in group.references)
    seen = set(zip(images, points, strict=True))
    free = [(i, p) for i in dict.fromkeys(images) for p in dict.fromkeys(points) if (i, p) not in seen]
    rays = {"type": "image", "columns": ["image", "point"], "rows": [list(ray) for ray in free[::7][:count]]}
    return {**rays, "name": "unseen", "values": {"sigma": "0.5"}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "points", "unit", "sigma"),
    [
        ("facade", ("W0*", "W1*"), "mm", "0.5"),
        ("machine_part", ("30*", "10*"), "um", "0.0005"),
        ("test_field", ("010*", "020*"), "um", "0.001"),
    ],
)
def test_large_blocks_are_ranked_like_small_ones(monkeypatch, name, points, unit, sigma):
    require = {
        "sigma": [
            {"points": [points[0]], "xy": f"1 {unit}"},
            {"points": [points[1]], "ellipsoid": f"2 {unit}"},
        ],
        "reliability": {"r": "0.2"},
    }
    rays = {**unseen(name, 25), "values": {"sigma": sigma}}
    network = sample(name, candidates=[rays], require=require)
    solved, required = solve_plan(network), requirements(network)
    small = ranking(solved, required, 0)
    monkeypatch.setattr(ranks, "MOST_ROWS", 100)
    large = ranking(solved, required, 0)
    eliminated = len(solved.adjustment.plan.rays.columns) > 0
    assert eliminated == (name != "machine_part"), "points that only rays meet, in larger projects"
    assert large.planned == ()
    assert len(large.candidates) == len(small.candidates) == 25
    for one, other in zip(large.candidates, small.candidates, strict=True):
        assert (one.unit.group, one.unit.row) == (other.unit.group, other.unit.row)
        assert one.shortfall == pytest.approx(other.shortfall, rel=1e-9)
        assert one.precision == pytest.approx(other.precision, rel=1e-9)
        assert one.largest_ratio == pytest.approx(other.largest_ratio, rel=1e-9)
        assert one.smallest_r == pytest.approx(other.smallest_r, abs=1e-9)
    monkeypatch.setattr(wide, "MOST_LOOKED_AT", 30)
    with pytest.raises(InputError, match="expected 30 in"):
        ranking(solved, required, 0)
    with pytest.raises(InputError, match="--greedy: greedy plans choose up to 100"):
        ranking(solved, required, 5)


def test_what_would_leave_something_undetermined_cannot_be_spared():
    network = sample("bridge")
    found = ranking(solve_plan(network), (), 0)
    lost = [one for one in found.planned if not one.possible]
    for one in lost[:2]:
        changed = solve_plan(without_row(network, one))
        assert changed.quality is None


def test_a_candidate_that_settles_the_datum_is_named_and_not_ranked():
    bearing = {
        "type": "bearing",
        "columns": ["from", "to"],
        "values": {"sigma": "1 mgon"},
        "rows": [["P1", "P2"]],
    }
    network = sample("bridge", candidates=[bearing])
    solved = solve_plan(network)
    found = interest_of(solved.quality, network.candidates, np.arange(3))
    assert found.unestimable == ((0, 0),)
    assert not [unit for unit in found.units if unit.is_candidate]


def test_a_greedy_plan_is_what_the_network_with_its_choices_is():
    network = grid(3)
    required = requirements(network)
    found = ranking(solve_plan(network), required, 100)
    assert found.now.shortfall[0] > 0.0
    assert found.steps[-1].ranked.shortfall <= REACHED
    for step in found.steps:
        network = with_row(network, step.ranked)
    quality = solve_plan(network).quality
    assert min(np.nanmin(group.r) for group in quality.groups) == pytest.approx(
        found.steps[-1].ranked.smallest_r, abs=1e-9
    )


def test_requirements_of_points_that_are_not_there_are_mistakes():
    with pytest.raises(InputError, match=r"there is no point 'Q\*'"):
        requirements(grid(1, require={"sigma": {"points": ["Q*"], "xy": "1 mm"}}))
