"""What flagged observations have in common, and whether all w fit one factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from mor.api import pipeline
from mor.quality.global_tests import _is_normal, fits_one_factor
from mor.quality.group_tests import _tail, common_to_flagged
from mor.quality.redundancy import Reliability
from mor.quality.solution import Solved
from tests.scenarios.planted_mistakes.survey import SAMPLES, survey

BRIDGE = "bridge"


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    path = survey(BRIDGE).write(tmp_path_factory.mktemp("bridge"))
    return pipeline.solve_network(pipeline.read_network(pipeline.read_document(path), path.parent))


def _flagged(solved: Solved, column: int, name: str):  # type: ignore[no-untyped-def]
    quality = replace(solved.quality)
    group = solved.adjustment.problem.groups[0]
    rows = np.array([one == name for one in group.references[column]])
    masks = [np.zeros(g.observed.shape, dtype=bool) for g in solved.adjustment.problem.groups]
    masks[0][rows] = True
    quality.__dict__["flagged"] = tuple(masks)
    return quality, int(rows.sum())


@pytest.mark.parametrize(("column", "of", "name"), [(0, "station", "P3"), (1, "point", "NW1")])
def test_the_station_or_point_of_the_flagged_is_named(solved: Solved, column: int, of: str, name: str) -> None:
    quality, count = _flagged(solved, column, name)
    found = common_to_flagged(quality, solved.network)
    assert (found[0].of, found[0].name) == (of, name)
    assert found[0].flagged == found[0].all_flagged == count


def test_flags_by_chance_have_nothing_in_common(solved: Solved) -> None:
    assert solved.quality is not None
    groups = solved.adjustment.problem.groups
    named = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        quality = replace(solved.quality)
        quality.__dict__["flagged"] = tuple(g.mask & (random.random(g.observed.shape) < 0.03) for g in groups)
        named += bool(common_to_flagged(quality, solved.network))
    assert named <= 3, "the family-wise level is 0.001"


def test_the_tail_is_that_of_the_binomial_distribution() -> None:
    for k, n, p in [(2, 10, 0.1), (5, 5, 0.3), (7, 40, 0.05)]:
        expected = stats.binom.sf(k - 1, n, p)
        assert _tail(np.array([float(k)]), np.array([float(n)]), p)[0] == pytest.approx(expected, rel=1e-9)


def test_normal_residuals_fit_and_those_with_a_gross_error_or_two_scales_do_not() -> None:
    rejected = 0
    for seed in range(1000):
        random = np.random.default_rng(seed)
        sizes = np.abs(random.standard_normal(60))
        rejected += not _is_normal(sizes, 1e-3)
        assert not _is_normal(np.append(sizes, 8.0), 1e-3)
    assert rejected <= 6, "the level is 0.001, 1 of 1000 expected"
    mixed = np.abs(np.random.default_rng(1).standard_normal(400)) * np.repeat([0.3, 2.5], 200)
    assert not _is_normal(mixed / (np.median(mixed) / 0.6745), 1e-3)


def test_one_factor_fits_all_sigmas_that_are_too_small_alike_and_not_two_factors(
    solved: Solved,
) -> None:
    assert solved.quality is not None
    assert fits_one_factor(_scaled(solved, (5.0, 5.0)))
    assert not fits_one_factor(_scaled(solved, (1.0, 8.0)))


def _scaled(solved: Solved, factors: tuple[float, float]):  # type: ignore[no-untyped-def]
    """The quality with the w of the first two tables multiplied."""
    quality = solved.quality
    assert quality is not None
    pairs = zip(quality.groups, (*factors, *(1.0 for _ in quality.groups)), strict=False)
    groups = tuple(replace(one, v=one.v * factor) for one, factor in pairs)
    return replace(quality, groups=groups, reliability=tuple(Reliability(one, quality.noncentrality) for one in groups))


@pytest.mark.parametrize("sample", ["drone_block", "three_line_strip"])
def test_checks_are_not_flagged(sample: str) -> None:
    """The project keeps them out: that they are out is nothing to tell."""
    path = SAMPLES / sample / "project.yaml"
    network = pipeline.read_network(pipeline.read_document(path), path.parent)
    solved = pipeline.solve_network(network)
    assert network.checks
    assert solved.quality is not None
    assert common_to_flagged(solved.quality, solved.network) == ()
