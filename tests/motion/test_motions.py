"""Points that move: equivalent formulations, known truth, what is not determined, tests with the power they claim."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from mor.quality.deformation import compare_within, movements, noncentrality_of, vector_tests
from mor.quality.singularity import explain_singularity
from mor.report.estimates import movement_rows
from mor.report.page_data import covariances
from tests.scenarios.motion_scenes import Scene, project, scene, solve, values

ALL = "  - {model: epochs, points: ['D*']}"


def moving_scene() -> tuple[Scene, str]:
    """Points with a velocity, with an oscillation beside, with a step, with coordinates of every epoch."""
    truth = scene(count=4, epochs=7, per_year=0.3)
    truth.velocity = {"D1": np.array([1e-3, -2e-3, 0.5e-3]), "D2": np.array([0.0, 0.0, -3e-3])}
    truth.sine = {"D2": np.array([1e-3, 2e-3, 0.0])}
    truth.cosine = {"D2": np.array([0.0, 1e-3, -2e-3])}
    truth.steps = {"D3": (2016.0, np.array([3e-3, 0.0, -4e-3]))}
    motions = (
        "  - {model: velocity, points: [D1, D2]}\n  - {model: seasonal, points: [D2]}\n"
        "  - {model: steps, points: [D3], values: {time: 2016.0}}\n  - {model: epochs, points: [D4]}"
    )
    return truth, motions


def test_epochs_in_one_adjustment_are_the_single_adjustments() -> None:
    truth, random = scene(), np.random.default_rng(5)
    together = solve(project(truth, ALL, np.random.default_rng(5)))
    omega = 0.0
    for epoch, time in enumerate(truth.times):
        alone = solve(project(truth, "", random, [epoch]))
        omega += alone.quality.omega
        for name in truth.points:
            x, sigma = values(alone, "point", name)
            there, its_sigma = values(together, "point", name if epoch == 0 else f"{name}@{time!r}")
            assert np.abs(x - there).max() < 1e-9
            assert np.abs(sigma / its_sigma - 1.0).max() < 1e-9
    assert together.quality.omega == pytest.approx(omega, rel=1e-9)


def test_velocity_held_at_zero_is_no_velocity() -> None:
    truth = scene()
    held = "  - {model: velocity, points: ['D*'], fixed: [vx, vy, vz]}"
    one, other = (solve(project(truth, motions, np.random.default_rng(6))) for motions in (held, ""))
    assert one.quality.redundancy == other.quality.redundancy
    for name in truth.points:
        for a, b in zip(values(one, "point", name), values(other, "point", name), strict=True):
            assert np.abs(a - b).max() < 1e-12


def test_a_step_held_at_its_size_is_known_and_one_observed_is_between() -> None:
    truth = scene(count=2)
    truth.steps = {"D1": (2016.0, np.array([4e-3, -2e-3, 1e-3]))}
    step = "  - {{model: steps, {how}, columns: [id, time, dx, dy, dz], rows: [[D1, 2016.0, 0.004, -0.002, 0.001]]}}"
    sigmas = []
    for how in ("fixed: [dx, dy, dz]", "values: {sigma: 0.1 mm}", "name: free"):
        solved = solve(project(truth, step.format(how=how), np.random.default_rng(8)))
        assert solved.quality.redundancy_sum == pytest.approx(solved.quality.redundancy, abs=1e-6)
        sigmas.append(values(solved, "point", "D1")[1][0])
        first, after = (values(solved, "point", name)[0] for name in ("D1", "D1@2016.0"))
        if how.startswith("fixed"):
            assert np.abs(after - first - truth.steps["D1"][1]).max() < 1e-12
    assert sigmas[0] < sigmas[1] < sigmas[2]


@pytest.mark.slow
def test_true_movements_are_found_within_their_sigmas() -> None:
    truth, motions = moving_scene()
    found = []
    for seed in range(4):
        solved = solve(project(truth, motions, np.random.default_rng(1000 + seed)))
        assert solved.quality.redundancy_sum == pytest.approx(solved.quality.redundancy, abs=1e-6)
        pairs = [
            *((values(solved, "velocity", n), truth.velocity[n]) for n in ("D1", "D2")),
            (values(solved, "sine", "D2"), truth.sine["D2"]),
            (values(solved, "cosine", "D2"), truth.cosine["D2"]),
            (values(solved, "point", "D3@2016.0"), truth.points["D3"] + truth.steps["D3"][1]),
            (values(solved, "point", f"D4@{truth.times[3]!r}"), truth.points["D4"]),
        ]
        found += [(x - true) / sigma for (x, sigma), true in pairs]
    ratio = np.array(found)
    assert np.abs(ratio).max() < 4.5
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.25)


def test_what_does_not_move_is_told_from_what_does() -> None:
    truth, motions = moving_scene()
    found = movements(solve(project(truth, motions, np.random.default_rng(3))))
    parameters = found.parameters
    rows = zip(parameters.names, parameters.what, parameters.significant, strict=True)
    told = {(name, what): bool(significant) for name, what, significant in rows}
    assert told == {
        ("D1", "velocity"): True,
        ("D2", "velocity"): True,
        ("D2", "annual oscillation"): True,
        ("D3", "step"): True,
    }
    of_d4 = [s for n, s in zip(found.between.names, found.between.significant, strict=True) if n == "D4"]
    assert len(of_d4) == 6
    assert not any(of_d4)


def test_the_table_of_movements_has_their_covariances() -> None:
    truth, motions = moving_scene()
    solved = solve(project(truth, motions, np.random.default_rng(3)))
    rows, found = movement_rows(solved), movements(solved).between
    M = solved.network.edge.matrix
    expected = solved.quality.sigma_factor**2 * (M.T @ found.tests.cofactors[:, :3, :3] @ M)
    assert np.abs(covariances(rows) - expected).max() < 1e-9 * np.abs(expected).max()
    for m, T, h, Q in zip(rows.select("x", "y", "z").to_numpy(), rows["test"], rows["freedom"], expected, strict=True):
        if h == 3:
            assert m @ np.linalg.solve(Q, m) / h == pytest.approx(T, rel=1e-6)


def test_congruence_of_two_epochs_finds_who_moved() -> None:
    truth = scene(count=5)
    truth.steps = {"D2": (2016.0, np.array([4e-3, 3e-3, 0.0]))}
    solved = solve(project(truth, ALL, np.random.default_rng(9)))
    labels = solved.network.motion.labels
    found = compare_within(solved, 0, len(labels) - 1, 0.001, known=True)
    assert [n for n, stable in zip(found.names, found.result.stable, strict=True) if not stable] == ["D2"]


@pytest.mark.parametrize(
    ("motions", "epochs", "per_year", "words"),
    [
        (
            "velocity",
            1,
            0.7,
            "the velocity of point D1 is not determined along vx, vy, vz; observe the point in a",
        ),
        (
            "seasonal",
            5,
            1.0,
            "the sine of point D1 is not determined along sin_x, sin_y, sin_z; observe the point at",
        ),
    ],
)
def test_what_time_does_not_determine_is_named(motions: str, epochs: int, per_year: float, words: str) -> None:
    truth = scene(epochs=epochs, per_year=per_year)
    solved = solve(project(truth, f"  - {{model: {motions}, points: [D1]}}", np.random.default_rng(7)))
    assert solved.adjustment.outcome.value == "singular"
    assert any(words in line for line in explain_singularity(solved))


@pytest.mark.parametrize("redundancy", [None, 40])
def test_smallest_movement_is_found_with_the_power_it_claims(redundancy: int | None) -> None:
    random = np.random.default_rng(11)
    level, n = 0.01, 40_000
    q = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.2], [0.5, 0.2, 1.0]])
    ncp = noncentrality_of(3, level, 0.8, redundancy)
    u = np.array([0.6, -0.64, 0.48])
    planted = np.sqrt(ncp / (u @ np.linalg.solve(q, u))) * u
    for factor in (1.0, 1.2):
        d = factor * planted + random.standard_normal((n, 3)) @ np.linalg.cholesky(q).T
        tests = vector_tests(d, np.broadcast_to(q, (n, 3, 3)))
        if redundancy is None:
            log_p = tests.log_p(0, None)
        else:
            variance = random.chisquare(redundancy, n) / redundancy
            log_p = tests._replace(statistic=tests.statistic / variance).log_p(redundancy, 1.0)
        expected = _power(level, factor**2 * ncp, redundancy)
        assert np.mean(log_p < np.log(level)) == pytest.approx(expected, abs=0.01)
    assert _power(level, ncp, redundancy) == pytest.approx(0.8, abs=1e-3)


def _power(level: float, ncp: float, redundancy: int | None) -> float:
    if redundancy is None:
        return float(scipy.stats.ncx2.sf(scipy.stats.chi2.isf(level, 3), 3, ncp))
    return float(scipy.stats.ncf.sf(scipy.stats.f.isf(level, 3, redundancy), 3, redundancy, ncp))
