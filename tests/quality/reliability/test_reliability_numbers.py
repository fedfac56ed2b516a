"""Reliability of observations against dense algebra, against planted errors, and in different datums."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from mor.quality import external_reliability as local_influence
from mor.quality.assessment import assess
from mor.quality.external_reliability import ObservationComponent, effects, movements, point_movements
from mor.quality.redundancy import student_square
from mor.quality.test_statistics import chi2_level, log_p_chi2, log_p_f, log_p_normal, noncentrality, sidak
from mor.solve.iterate import Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import Scene, levelling_network, mixed_network, photo_block, plane_network, solve

NETWORKS = {
    "mixed": (mixed_network, False),
    "correlated": (correlated_everywhere, False),
    "plane": (lambda: plane_network(directions=True), True),
    "levelling": (levelling_network, True),
    "bundle": (photo_block, True),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), True),
}


@pytest.fixture(params=NETWORKS)
def network(request):
    make, free = NETWORKS[request.param]
    scene, points = make()
    adjustment = solve(scene, np.random.default_rng(4), points if free else None)
    return assess(adjustment), dense_system(adjustment.problem, adjustment.values)


def _dense_cofactors(dense):
    """P Q_vv P by way of the pseudo-inverse."""
    lower = np.linalg.cholesky(dense.covariance)
    white = np.linalg.solve(lower, dense.A)
    white = white / np.linalg.norm(white, axis=0)
    projector = np.eye(len(white)) - white @ np.linalg.pinv(white, rcond=1e-9)
    root = np.linalg.inv(lower)
    return root.T @ projector @ root


def _flat(arrays, dense):
    return np.concatenate([array.ravel() for array in arrays])[dense.entries]


def test_reliability_against_dense_algebra(network):
    quality, dense = network
    P = dense.weights
    S = np.diagonal(_dense_cofactors(dense))
    weighted = -P @ dense.l
    tested = 1e-6 * np.diagonal(P) < S
    S = np.where(tested, S, 1.0)
    delta = np.sqrt(quality.noncentrality)
    expected = {
        "test": weighted / np.sqrt(S),
        "error": -weighted / S,
        "smallest": delta / np.sqrt(S),
        "external": delta / np.sqrt(S) * np.sqrt(np.maximum(np.diagonal(P) - S, 0.0)),
    }
    for name, values in expected.items():
        found = _flat([getattr(one, name) for one in quality.reliability], dense)
        assert (np.isfinite(found) == tested).all()
        np.testing.assert_allclose(found[tested], values[tested], rtol=2e-7, atol=1e-9 * np.abs(values[tested]).max())


def test_joint_tests_against_dense_algebra(network):
    quality, dense = network
    S, weighted = _dense_cofactors(dense), -dense.weights @ dense.l
    number, checked = 0, 0
    for group, one in zip(quality.adjustment.problem.groups, quality.groups, strict=True):
        for row in range(group.count):
            m = group.observed.shape[1]
            entries = number + m * row + np.flatnonzero(group.mask[row])
            places = np.searchsorted(dense.entries, entries)
            if len(places) < 2 or one.freedom[row][group.mask[row]].max() < len(places):
                continue
            u, block = weighted[places], S[np.ix_(places, places)]
            expected = u @ np.linalg.solve(block, u)
            found = one.joint[row][group.mask[row]]
            if len(set(np.round(found, 9))) > 1:
                continue  # a row of which a part is correlated with other rows: tested in parts
            assert found[0] == pytest.approx(expected, rel=1e-6, abs=1e-9)
            checked += 1
        number += group.observed.size
    if any(group.mask.sum(axis=1).max() > 1 for group in quality.adjustment.problem.groups):
        assert checked > 0


def test_without_correlations_the_test_is_the_normalised_residual():
    scene, points = photo_block(scale_bar=True)
    quality = assess(solve(scene, np.random.default_rng(3), points))
    for one, w in zip(quality.reliability, quality.w, strict=True):
        np.testing.assert_allclose(one.test, w, rtol=1e-12)


def test_an_estimated_error_is_the_difference_from_what_all_others_say():
    # leaving an observation out: its misclosure against the rest is the estimated gross error, exactly
    scene, points = levelling_network()
    problem = scene.problem(np.random.default_rng(2), points)
    quality = assess(adjust(problem, scene.start(1e-3)))
    error = quality.reliability[0].error[2, 0]
    observed = problem.groups[0].observed[2, 0]
    problem.groups[0].observed[2, 0] = observed - error
    again = assess(adjust(problem, scene.start(1e-3)))
    assert again.groups[0].v[2, 0] == pytest.approx(0.0, abs=1e-12)
    assert again.reliability[0].error[2, 0] == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("make", [mixed_network, correlated_everywhere, lambda: photo_block(scale_bar=True)])
def test_gross_errors_move_the_unknowns_as_foretold(make):
    scene, points = make()
    free = points if scene.free["point"]["P0"].any() else None
    problem = scene.problem(None, free)  # without noise: residuals times curvature are no part of it
    before = adjust(problem, scene.start(1e-3))
    quality = assess(before)
    entry = ObservationComponent(0, 7, 1)
    error = 1e-3 * problem.groups[0].sigma[7, 1]
    (foretold,) = movements(quality, [entry], np.array([error])).T
    problem.groups[0].observed[7, 1] += error
    after = adjust(problem, before.values)
    assert after.outcome is Outcome.CONVERGED
    columns = problem.index.columns["point"]
    moved = (after.values["point"] - before.values["point"])[columns >= 0]
    expected = foretold[columns[columns >= 0]]
    np.testing.assert_allclose(moved, expected, atol=2e-5 * np.abs(expected).max() + 1e-13)


def test_external_reliability_bounds_the_effect_on_any_point():
    scene, points = photo_block(scale_bar=True)
    quality = assess(solve(scene, np.random.default_rng(4), points))
    for row in range(0, 60, 7):
        entry = ObservationComponent(0, row, 0)
        reliability = quality.reliability[0]
        (moved,) = movements(quality, [entry], reliability.smallest[row, :1]).T
        columns = quality.adjustment.problem.index.columns["point"]
        for point, own in enumerate(columns):
            q = quality.cofactors["point"][point]
            effect = moved[own]
            bound = np.sqrt(effect @ np.linalg.pinv(q, rcond=1e-10) @ effect)
            assert bound <= reliability.external[row, 0] * (1.0 + 1e-6)


@pytest.mark.parametrize("scale_bar", [False, True])
def test_nothing_of_it_depends_on_the_datum(scale_bar):
    results = []
    for names in (None, ["P0", "P5", "P10"], ["P1", "P2", "P3", "P11"]):
        scene, points = photo_block(scale_bar=scale_bar)
        quality = assess(solve(scene, np.random.default_rng(9), names or points))
        results.append(quality)
    first = results[0]
    for other in results[1:]:
        assert other.sigma0 == pytest.approx(first.sigma0, rel=1e-9)
        for a, b in zip(first.groups, other.groups, strict=True):
            scale = np.abs(a.v).max() + 1e-3
            np.testing.assert_allclose(a.v, b.v, atol=1e-9 * scale)
            np.testing.assert_allclose(a.r, b.r, atol=1e-9)
        for a, b in zip(first.reliability, other.reliability, strict=True):
            for name in ("test", "error", "smallest", "external"):
                np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-9, atol=1e-9)
    # what does depend on it, so that the test above is not empty
    assert np.abs(first.cofactors["point"] - results[1].cofactors["point"]).max() > 1e-9


def test_influence_of_distances_is_what_is_hidden_of_the_error():
    # nothing but coordinates: the whole of 1 − r goes into them
    scene, points = plane_network()
    quality = assess(solve(scene, np.random.default_rng(5), points))
    influence = quality.reliability[0].influence
    expected = quality.reliability[0].error * (1.0 - quality.groups[0].r)
    np.testing.assert_allclose(influence, expected, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "free"),
    [
        (photo_block, True),
        (lambda: photo_block(scale_bar=True), True),
        (mixed_network, False),
        (correlated_everywhere, False),
    ],
)
def test_influence_of_rays_is_the_movement_of_their_point_across_the_ray(make, free):
    scene, points = make()
    quality = assess(solve(scene, np.random.default_rng(5), points[:4] if free else None))
    problem = quality.adjustment.problem
    number = next(k for k, group in enumerate(problem.groups) if group.type.key == "image/mor")
    group, influence = problem.groups[number], quality.reliability[number].influence
    entries = [ObservationComponent(number, row, c) for row in range(group.count) for c in (0, 1)]
    errors = np.array([quality.reliability[number].error[e.row, e.component] for e in entries])
    whole = movements(quality, entries, errors)
    values = quality.adjustment.values
    blocks = [values[s.kind][b] for s, b in zip(group.type.slots, group.blocks, strict=True)]
    slope = group.type.equation(blocks, group.constants).jacobians[-1]
    size = np.nanmax(np.abs(influence))
    moved_at_all = 0
    for k, entry in enumerate(entries):
        columns = problem.index.columns["point"][group.blocks[-1][entry.row]]
        movement = np.where(columns >= 0, whole[columns, k], 0.0)
        across = slope[entry.row, entry.component]
        expected = movement @ across / np.linalg.norm(across)
        assert influence[entry.row, entry.component] == pytest.approx(expected, rel=1e-6, abs=1e-8 * size)
        moved_at_all += int(abs(expected) > 1e-3 * size)
    assert moved_at_all > len(entries) // 2


@pytest.mark.parametrize("few", [0, 2_000])  # by a pass over all rays, and by those of the points alone
@pytest.mark.parametrize("name", NETWORKS)
def test_movements_of_the_points_next_to_an_error_are_those_of_the_whole(name, few, monkeypatch):
    monkeypatch.setattr(local_influence, "FEW_POINTS", few)
    make, free = NETWORKS[name]
    scene, points = make()
    quality = assess(solve(scene, np.random.default_rng(4), points if free else None))
    problem = quality.adjustment.problem
    entries, named = [], []
    for number, group in enumerate(problem.groups):
        for row in range(0, group.count, 3):
            component = int(np.flatnonzero(group.mask[row])[-1])
            entries.append(ObservationComponent(number, row, component))
            slots = zip(group.type.slots, group.blocks, strict=True)
            named.append([int(blocks[row]) for slot, blocks in slots if slot.kind == "point"])
    errors = np.linspace(1.0, 2.0, len(entries)) * 1e-3
    whole = movements(quality, entries, errors)
    found = point_movements(quality, entries, errors, named)
    for k, some in enumerate(named):
        columns = problem.index.columns["point"][some]
        expected = np.where(columns >= 0, whole[columns, k], 0.0)
        np.testing.assert_allclose(found[k], expected, rtol=1e-6, atol=1e-9 * np.abs(whole[:, k]).max())
    chosen = [np.arange(group.count)[:, None] % 3 < 2 * group.mask for group in problem.groups]
    rows = local_influence.whitened_rows(quality, chosen)
    L, S = rows.system.factors(rows.design.T.tocsr())
    expected = rows.design @ rows.system.solve(rows.design.T.toarray())
    np.testing.assert_allclose(L.T @ S, expected, atol=1e-9)


def test_effects_name_the_worst_observation_and_its_point():
    scene, points = photo_block(scale_bar=True)
    problem = scene.problem(np.random.default_rng(4), points)
    problem.groups[0].observed[17, 0] += 30e-3
    quality = assess(adjust(problem, scene.start(1e-3)))
    worst = effects(quality)[0]
    assert worst.entry == ObservationComponent(0, 17, 0)
    assert worst.error == pytest.approx(30e-3, rel=0.2)
    assert worst.point == problem.groups[0].blocks[-1][17]
    assert np.linalg.norm(worst.movement) > 0.0


def _levelled_twice(sigma, misclosure):
    """A height told by one observation of ``sigma`` = 1e-3 and by one of the given σ, which differ."""
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [10.0, 0.0, 1.0], free=(False, False, True))
    scene.observe("height_difference", "A", None, "B", None, sigma=1e-3, observed=1.0)
    scene.observe("height_difference", "A", None, "B", None, sigma=sigma, observed=1.0 + misclosure)
    return assess(adjust(scene.problem(), scene.start(0.0)))


def test_a_movement_through_the_whole_network_by_what_nothing_controls_is_not_told():
    quality = _levelled_twice(5e-6, 5e-3)
    assert [effect.tells for effect in effects(quality)] == [
        True,
        True,
    ]  # 5 mm, whichever of the two is wrong
    quality = _levelled_twice(3e-3, 5.0)
    assert [effect.tells for effect in effects(quality)] == [True, True]
    assert min(effect.r for effect in effects(quality)) > 0.05
    quality = _levelled_twice(5e-6, 5.0)
    told = {round(effect.r): effect.tells for effect in effects(quality)}
    assert told == {1: True, 0: False}


def test_equal_test_values_stand_in_the_order_of_the_rows():
    quality = _levelled_twice(1e-3, 5e-3)
    assert [effect.entry.row for effect in effects(quality)] == [0, 1]
    for last in (1.0 + 1e-12, 1.0 - 1e-12):
        noisy = _levelled_twice(1e-3 * last, 5e-3)
        assert [effect.entry.row for effect in effects(noisy)] == [0, 1]


def test_noncentrality_and_levels():
    assert noncentrality(0.001, 0.8) == pytest.approx(17.074646805189502, rel=1e-12)
    for alpha, beta in ((0.001, 0.8), (0.05, 0.9), (0.01, 0.5)):
        ncp = noncentrality(alpha, beta)
        limit = scipy.stats.chi2.ppf(1.0 - alpha, 1)
        assert scipy.stats.ncx2.sf(limit, 1, ncp) == pytest.approx(beta, rel=1e-9)
        found = chi2_level(3, ncp, beta)
        assert scipy.stats.ncx2.sf(found.critical, 3, ncp) == pytest.approx(beta, rel=1e-7)
        assert found.level == pytest.approx(scipy.stats.chi2.sf(found.critical, 3), rel=1e-9)
    assert 1.0 - (1.0 - sidak(0.05, 200)) ** 200 == pytest.approx(0.05, rel=1e-9)


def test_probabilities_also_where_they_underflow():
    w = np.array([0.0, 1.0, 3.29, 30.0])
    np.testing.assert_allclose(log_p_normal(w), np.log(2.0) + scipy.stats.norm.logsf(w), rtol=1e-12)
    assert log_p_normal(np.array([1e3]))[0] == pytest.approx(-0.5e6, rel=1e-4)
    ratio = np.array([0.1, 4.0, 80.0])
    np.testing.assert_allclose(log_p_f(ratio, 2.0, 30.0), scipy.stats.f.logsf(ratio, 2, 30), rtol=1e-10)
    # both sides of the change to the continued fraction
    near = np.array([7.0e4, 9.0e4, 1.2e5])
    tail = log_p_f(near, 1.0, 100.0)
    assert (np.diff(tail) < 0.0).all()
    exact = [_log_tail_of_student(np.sqrt(x), 100.0) for x in (1e9, 1e14)]
    np.testing.assert_allclose(log_p_f(np.array([1e9, 1e14]), 1.0, 100.0), exact, rtol=1e-6)
    np.testing.assert_allclose(
        log_p_chi2(np.array([3.0, 700.0]), np.array([2.0, 3.0])),
        scipy.stats.chi2.logsf([3.0, 700.0], [2, 3]),
        rtol=1e-9,
    )
    assert log_p_chi2(np.array([2e4]), np.array([2.0]))[0] == pytest.approx(-1e4, rel=1e-12)


def _log_tail_of_student(t, f):
    """Leading term of both tails: P → 2 f^{(f−1)/2} Γ((f+1)/2) / (√(fπ) Γ(f/2)) · √f t^{−f} / …, by its logarithm."""
    from scipy.special import gammaln

    density = gammaln((f + 1.0) / 2.0) - gammaln(f / 2.0) - 0.5 * np.log(f * np.pi) + (f + 1.0) / 2.0 * np.log(f)
    return np.log(2.0) + density - np.log(f) - f * np.log(t)


def test_student_form_leaves_the_tested_observation_out():
    scene, points = levelling_network()
    problem = scene.problem(np.random.default_rng(6), points)
    quality = assess(adjust(problem, scene.start(1e-3)))
    f = quality.redundancy
    found = student_square(quality.reliability[0].test, quality.omega, f)
    for row in range(problem.groups[0].count):
        inside = problem.groups[0].observed[row, 0]
        problem.groups[0].observed[row, 0] = np.nan
        without = assess(adjust(problem, scene.start(1e-3)))
        problem.groups[0].observed[row, 0] = inside
        assert without.redundancy == f - 1
        expected = quality.reliability[0].test[row, 0] ** 2 / without.sigma0**2
        assert found[row, 0] == pytest.approx(expected, rel=1e-6)
    assert np.isnan(student_square(np.array([1.0]), 3.0, 1)).all()


def test_observations_that_nothing_controls_have_no_test():
    scene, points = photo_block(scale_bar=True)
    quality = assess(solve(scene, np.random.default_rng(6), points))
    for name in ("test", "error", "smallest", "external"):
        assert np.isnan(getattr(quality.reliability[1], name)).all()
    assert quality.groups[1].freedom[0, 0] == 0.0


def test_quality_of_some_rows_is_that_of_the_whole():
    scene, points = photo_block(scale_bar=True)
    quality = assess(solve(scene, np.random.default_rng(6), points))
    whole, rows = quality.reliability[0], np.array([7, 2, 11])
    for name in ("test", "error", "smallest", "external"):
        np.testing.assert_array_equal(getattr(whole.at(rows), name), getattr(whole, name)[rows])
        np.testing.assert_array_equal(getattr(whole.at(slice(3, 6)), name), getattr(whole, name)[3:6])


def test_an_observation_controlled_by_very_many_others():
    # r ≈ 1: a thousand repetitions of one height difference
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 10.0], free=False)
    scene.add("point", "B", [5.0, 0.0, 12.0], free=(False, False, True))
    for _ in range(1000):
        scene.observe("height_difference", "A", None, "B", None, sigma=2e-3)
    quality = assess(solve(scene, np.random.default_rng(8)))
    reliability = quality.reliability[0]
    np.testing.assert_allclose(reliability.smallest, np.sqrt(quality.noncentrality / 0.999) * 2e-3, rtol=1e-9)
    np.testing.assert_allclose(reliability.external, np.sqrt(quality.noncentrality * 0.001 / 0.999), rtol=1e-9)
