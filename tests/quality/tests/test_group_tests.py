"""Tests of groups: moments against the dense projection, levels by simulation, what they find."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.stats

from mor.quality import global_tests
from mor.quality import group_tests as quadratic_form
from mor.quality.assessment import Quality, assess
from mor.quality.external_reliability import whitened_rows
from mor.quality.global_tests import common_effects
from mor.quality.group_tests import Moments, bounds, group_tests, log_tail, moments
from mor.quality.solution import Solved
from mor.solve.iterate import adjust
from mor.types import BoolArray, FloatArray
from sample_projects.expected import solve_sample
from tests.dense_reference import dense_system
from tests.scenarios.reliability_scenes import correlated_everywhere
from tools.group_test_levels import measured_anew, rejections


@cache
def building() -> Solved:
    return solve_sample("building")


def quality_of(solved: Solved) -> Quality:
    assert solved.quality is not None
    return solved.quality


@cache
def correlated_network() -> Quality:
    scene, _ = correlated_everywhere()
    return assess(adjust(scene.problem(np.random.default_rng(5)), scene.start(1e-4)))


def projection(quality: Quality) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Dense cofactors R of the whitened residuals, the whitening, and the numbers of the entries."""
    dense = dense_system(quality.adjustment.problem, quality.adjustment.values)
    whitening = np.linalg.inv(np.linalg.cholesky(dense.covariance))
    white = whitening @ dense.A
    white /= np.maximum(np.linalg.norm(white, axis=0), 1e-300)
    return np.eye(len(white)) - white @ np.linalg.pinv(white, rcond=1e-9), whitening, dense.entries


def masks_of(quality: Quality, numbers: list[int]) -> list[BoolArray]:
    """All observations of some groups."""
    groups = quality.adjustment.problem.groups
    return [group.mask & (k in numbers) for k, group in enumerate(groups)]


def flat(masks: list[BoolArray], entries: FloatArray) -> BoolArray:
    """The masks at the entries of the dense system."""
    return np.concatenate([mask.ravel() for mask in masks])[entries.astype(int)]


@pytest.mark.parametrize("number", range(9))
def test_moments_of_every_table_of_a_building(number: int) -> None:
    quality = quality_of(building())
    R, _, entries = _projection_of_building()
    masks = masks_of(quality, [number])
    here = flat(masks, entries)
    eigenvalues = np.linalg.eigvalsh(R[np.ix_(here, here)])
    found = moments(whitened_rows(quality, masks), float(eigenvalues.sum()))
    rel = 1e-6 if here.sum() <= quadratic_form.MOST_PROBES else 0.05
    assert found.second[0] == pytest.approx(float(np.sum(eigenvalues**2)), rel=rel)
    assert found.third[0] == pytest.approx(float(np.sum(eigenvalues**3)), rel=rel)
    least, largest = bounds(np.array([eigenvalues.sum()]), np.array([float(here.sum())]), 722.0)
    assert least.second[0] <= np.sum(eigenvalues**2) * (1 + 1e-9)
    assert np.sum(eigenvalues**2) <= largest.second[0] * (1 + 1e-9)


@cache
def _projection_of_building() -> tuple[FloatArray, FloatArray, FloatArray]:
    return projection(quality_of(building()))


def test_correlated_observations_are_whitened_as_they_are_dense() -> None:
    quality = correlated_network()
    R, whitening, entries = projection(quality)
    everything = whitened_rows(quality, [group.mask for group in quality.adjustment.problem.groups])
    v = np.concatenate([one.v.ravel() for one in quality.groups])[entries.astype(int)]
    own = everything.whitened([np.nan_to_num(one.v) for one in quality.groups])
    assert own @ own == pytest.approx(float(np.sum((whitening @ v) ** 2)), rel=1e-9)
    assert own @ own == pytest.approx(quality.omega, rel=1e-6)
    squares = float(np.sum(everything.residuals_of(np.eye(everything.design.shape[0])) ** 2))
    assert squares == pytest.approx(quality.redundancy, rel=1e-6)
    assert np.trace(R) == pytest.approx(quality.redundancy, rel=1e-6)


def test_the_tail_is_that_of_a_weighted_sum_of_squares() -> None:
    eigenvalues = np.array([0.95, 0.9, 0.9, 0.7, 0.6, 0.4, 0.2, 0.05])
    drawn = np.random.default_rng(1).chisquare(1, (400_000, len(eigenvalues))) @ eigenvalues
    of = Moments(*(np.array([np.sum(eigenvalues**power)]) for power in (1, 2, 3)))
    for level in (0.05, 0.01, 0.002):
        omega = np.array([np.quantile(drawn, 1.0 - 0.5 * level)])
        assert np.exp(log_tail(omega, of)[0]) == pytest.approx(level, rel=0.06)
    one = np.array([0.3])  # one eigenvalue: exact
    assert np.exp(log_tail(np.array([0.3 * 6.0]), Moments(one, one**2, one**3))[0]) == pytest.approx(
        2.0 * scipy.stats.chi2.sf(6.0, 1), rel=1e-9
    )


@pytest.mark.slow
def test_error_free_measurements_are_rejected_at_the_level() -> None:
    # 1 000 seeds of every sample: python -m tools.group_test_levels
    rejected = rejections(building(), 500).any(axis=1).sum()
    assert scipy.stats.binomtest(int(rejected), 500, 0.05).pvalue > 0.001


def test_an_offset_in_a_few_of_many_observations_rejects_their_group_and_is_estimated() -> None:
    solved = building()
    adjustment = measured_anew(solved.adjustment, 4)
    assert not group_tests(assess(adjustment), solved.network).rejected
    groups = list(adjustment.problem.groups)
    number = next(k for k, group in enumerate(groups) if group.name == "distances to plates")
    groups[number] = replace(groups[number], observed=groups[number].observed + 0.034)
    quality = assess(adjust(replace(adjustment.problem, groups=tuple(groups)), adjustment.values))
    judged = replace(solved, adjustment=quality.adjustment, quality=quality).verdict
    assert judged is not None
    assert not judged.all_alike
    worst = judged.explained[0]
    assert worst.test.name == "distances to plates"
    assert worst.effect is not None
    assert worst.suffices
    assert worst.effect.kind == "offset"
    assert abs(worst.effect.size - 0.034) < 4.0 * worst.effect.sigma
    # what it promises is what another adjustment finds
    corrected = replace(groups[number], observed=groups[number].observed - worst.effect.size)
    groups[number] = corrected
    again = adjust(replace(adjustment.problem, groups=tuple(groups)), quality.adjustment.values)
    assert again.normals.objective == pytest.approx(quality.omega - worst.effect.test**2, rel=1e-3)


def test_one_gross_error_is_no_offset_of_its_group() -> None:
    solved = building()
    problem = measured_anew(solved.adjustment, 4).problem
    groups = list(problem.groups)
    number = next(k for k, group in enumerate(groups) if group.name == "distances to plates")
    observed = groups[number].observed.copy()
    observed[2] += 0.2
    groups[number] = replace(groups[number], observed=observed)
    quality = assess(adjust(replace(problem, groups=tuple(groups)), solved.adjustment.values))
    judged = replace(solved, adjustment=quality.adjustment, quality=quality).verdict
    assert judged is not None
    worst = next(one for one in judged.explained if one.test.name == "distances to plates")
    masks = judged.tests.rows(worst.test, quality.adjustment.problem)
    effects = common_effects(quality, lambda: whitened_rows(quality, masks), masks, worst.test.redundancy)
    assert abs(effects[0].test) > quality.critical, "beside the a-priori sigma it is significant"
    assert worst.effect is None
    assert worst.flagged
    assert worst.gain == pytest.approx(np.nanmax(np.abs(quality.reliability[number].test)) ** 2)


def test_tests_that_were_needed_before_are_those_of_the_verdict_of_the_same_observations() -> None:
    solved = building()
    assert solved.verdict is not None
    assert solved.tested is not None
    assert solved.verdict.tests is solved.tested[1]
    quality = assess(measured_anew(solved.adjustment, 7))
    anew = replace(solved, adjustment=quality.adjustment, quality=quality).verdict
    assert anew is not None
    assert anew.tests is not solved.tested[1]
    assert anew.tests.tests == group_tests(quality, solved.network).tests


def test_sigmas_that_are_all_wrong_by_one_factor_blame_no_group() -> None:
    solved = building()
    problem = measured_anew(solved.adjustment, 6).problem
    groups = tuple(replace(group, sigma=0.5 * group.sigma) for group in problem.groups)
    quality = assess(adjust(replace(problem, groups=groups), solved.adjustment.values))
    judged = replace(solved, adjustment=quality.adjustment, quality=quality).verdict
    assert judged is not None
    assert judged.tests.rejected
    assert judged.all_alike


def test_an_effect_against_one_more_unknown() -> None:
    quality = quality_of(building())
    number = next(k for k, g in enumerate(quality.adjustment.problem.groups) if g.name == "distances to plates")
    masks = masks_of(quality, [number])
    R, whitening, entries = _projection_of_building()
    v = whitening @ np.concatenate([one.v.ravel() for one in quality.groups])[entries.astype(int)]
    here = flat(masks, entries)
    group = quality.adjustment.problem.groups[number]
    for kind, derivative in (("offset", np.ones(group.count)), ("scale", group.observed[:, 0])):
        c = np.zeros(len(v))
        c[here] = derivative / group.sigma[:, 0]
        found = next(
            one
            for one in common_effects(quality, lambda: whitened_rows(quality, masks), masks, 7.0)
            if one.kind == kind
        )
        assert found.sigma == pytest.approx(1.0 / np.sqrt(c @ R @ c), rel=1e-6)
        assert found.size == pytest.approx(-(c @ v) / (c @ R @ c), rel=1e-6, abs=1e-6 * found.sigma)


@pytest.mark.parametrize(
    ("sample", "table"), [("building", "distances to plates"), ("aerial_strip", "tie and control points")]
)
def test_effects_in_a_long_table_are_those_of_its_design_matrix(
    sample: str, table: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    quality = quality_of(solve_sample(sample))
    number = next(k for k, g in enumerate(quality.adjustment.problem.groups) if g.name == table)
    masks = masks_of(quality, [number])
    by_rows = common_effects(quality, lambda: whitened_rows(quality, masks), masks, 7.0)
    monkeypatch.setattr(global_tests, "ROWS_OF_A_LONG_TABLE", 0)
    by_passes = common_effects(quality, lambda: pytest.fail("the design matrix is made"), masks, 7.0)
    assert len(by_rows) > 1
    assert [one[:3] for one in by_passes] == [one[:3] for one in by_rows]
    for one, other in zip(by_passes, by_rows, strict=True):
        assert one[3:] == pytest.approx(other[3:], rel=1e-9)
