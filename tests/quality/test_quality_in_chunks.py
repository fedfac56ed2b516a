"""Statistics of many observations, worked out a piece at a time, are those of the whole, to the last digit."""

from __future__ import annotations

import numpy as np
import pytest

from mor.quality import test_statistics as pieces
from mor.quality.assessment import Quality, assess
from mor.quality.external_reliability import effects
from mor.quality.robust_estimation import exclude
from mor.quality.test_statistics import in_pieces, omega_of, redundancy_of, sum_of_known
from mor.solve.iterate import adjust
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import Scene, photo_block, solve

OF_QUALITY = ("r", "q_adjusted", "q_residual", "weighted", "precision", "q_weighted", "joint", "freedom")
OF_TESTS = ("test", "error", "smallest", "external")


def _with_one_excluded(scene: Scene, points: list[str]) -> Quality:
    problem = scene.problem(np.random.default_rng(4), points)
    out = [np.zeros(group.observed.shape, dtype=bool) for group in problem.groups]
    out[0][2, 0] = True
    return assess(adjust(exclude(problem, out), scene.start(1e-4)))


@pytest.fixture(params=["correlated", "excluded"])
def quality(request: pytest.FixtureRequest) -> Quality:
    if request.param == "excluded":
        return _with_one_excluded(*photo_block())
    scene, _ = correlated_everywhere()
    return assess(solve(scene, np.random.default_rng(4), None))


def _everything(quality: Quality) -> list[np.ndarray]:
    return [
        *(getattr(one, name) for one in quality.groups for name in OF_QUALITY),
        *(getattr(one, name) for one in quality.reliability for name in OF_TESTS),
        *quality.w,
        np.array([effect.movement for effect in effects(quality)]),
    ]


def test_pieces_are_the_whole(quality: Quality, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _everything(quality)
    monkeypatch.setattr(pieces, "ROWS_AT_A_TIME", 3)
    for one, other in zip(_everything(quality), whole, strict=True):
        np.testing.assert_array_equal(one, other)
    for one in quality.groups:
        assert redundancy_of(one) == pytest.approx(np.nansum(one.r), rel=1e-14)
        assert omega_of(one) == pytest.approx(np.nansum(one.v * one.weighted), rel=1e-14)


def test_rows_may_be_asked_for_in_any_order_and_more_than_once() -> None:
    """As those of two components of one vector are, where both are among the worst observations."""
    scene, _ = correlated_everywhere()
    quality = assess(solve(scene, np.random.default_rng(4), None))
    for one, tests in zip(quality.groups, quality.reliability, strict=True):
        rows = np.array([2, 0, 2, 1, 0, 0]) % len(one.v)
        for name in OF_QUALITY:
            np.testing.assert_array_equal(getattr(one.at(rows), name), getattr(one, name)[rows])
        for name in OF_TESTS:
            np.testing.assert_array_equal(getattr(tests.at(rows), name), getattr(tests, name)[rows])


@pytest.mark.parametrize("width", [1, 2])
def test_sums_of_pieces_are_the_sum_to_the_last_digit(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(3).standard_normal((70_001, width)) * 1e3
    values[::7] = np.nan
    monkeypatch.setattr(pieces, "ROWS_AT_A_TIME", 1000)
    assert sum_of_known(values.shape, lambda rows: values[rows]) == np.nansum(values)
    assert np.cumsum(np.nan_to_num(values))[-1] != np.nansum(values)  # another order gives other digits


def test_pieces_come_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "ROWS_AT_A_TIME", 4)
    numbers = np.arange(22.0).reshape(11, 2)
    seen = []

    def work(rows: slice) -> np.ndarray:
        seen.append(numbers[rows])
        return numbers[rows] > 7.0

    np.testing.assert_array_equal(in_pieces(numbers.shape, work), numbers > 7.0)
    assert [len(piece) for piece in seen] == [4, 4, 3]


def test_the_joint_test_is_kept_once_for_a_row_and_told_of_what_was_tested() -> None:
    quality = _with_one_excluded(*photo_block())
    one, group = quality.groups[0], quality.adjustment.problem.groups[0]
    assert one.joint_of_row.shape == one.freedom_of_row.shape == (group.count,)
    tested = group.mask & ~group.left_out
    assert not tested.all()
    np.testing.assert_array_equal(np.isfinite(one.joint), tested)
    np.testing.assert_array_equal(np.isfinite(one.freedom), tested)
    both = tested.all(axis=1)
    np.testing.assert_array_equal(one.joint[both, 0], one.joint[both, 1])
