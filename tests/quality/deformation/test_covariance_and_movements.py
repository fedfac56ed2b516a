"""Joint covariances and S-transformation against dense algebra; movements between epochs against simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from mor.quality.assessment import assess, joint_cofactors, relative_ellipsoid
from mor.quality.deformation import congruence, movement_test, pair_movement
from mor.solve.datum import constraint
from mor.solve.iterate import adjust
from tests.dense_reference import dense_system
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import Scene, levelling_network, mixed_network, photo_block, plane_network, solve

NETWORKS = {
    "mixed": (mixed_network, False),
    "correlated": (correlated_everywhere, False),
    "plane": (lambda: plane_network(directions=True), True),
    "bundle": (photo_block, True),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), True),
}


def _dense_cofactors(adjustment):
    """Inverse of the system bordered with the inner constraints of the datum, columns scaled."""
    dense = dense_system(adjustment.problem, adjustment.values)
    scale = 1.0 / np.sqrt(np.diagonal(dense.normal))
    N = dense.normal * np.outer(scale, scale)
    B = adjustment.constraint.normals * scale[:, None]
    B = B / np.linalg.norm(B, axis=0)
    d = B.shape[1]
    bordered = np.block([[N, B], [B.T, np.zeros((d, d))]])
    return np.linalg.inv(bordered)[: len(N), : len(N)] * np.outer(scale, scale)


@pytest.mark.parametrize("name", NETWORKS)
def test_joint_cofactors_are_those_of_the_bordered_system(name):
    make, free = NETWORKS[name]
    scene, points = make()
    quality = assess(solve(scene, np.random.default_rng(2), points[:4] if free else None))
    expected = _dense_cofactors(quality.adjustment)
    everything = np.arange(len(expected))
    found = joint_cofactors(quality, everything)
    size = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    np.testing.assert_allclose(found / size, expected / size, atol=2e-6)
    some = np.array([7, -1, 3, 11])
    picked = joint_cofactors(quality, some)
    np.testing.assert_allclose(picked[np.ix_([0, 2, 3], [0, 2, 3])], found[np.ix_([7, 3, 11], [7, 3, 11])], rtol=1e-7)
    assert (picked[1] == 0.0).all()
    assert (picked[:, 1] == 0.0).all()


@pytest.mark.parametrize("scale_bar", [False, True])
@pytest.mark.parametrize("target", [["P0", "P5", "P10"], ["P1", "P2", "P3", "P7"]])
def test_carried_into_another_datum_it_is_the_direct_adjustment(scale_bar, target):
    scene, points = photo_block(scale_bar=scale_bar)
    reference = scene.start(2e-2, seed=5)["point"]
    noise = [np.random.default_rng(3) for _ in range(2)]
    here = adjust(scene.problem(noise[0], points, reference=reference), scene.start(1e-2))
    other = scene.problem(noise[1], target, reference=reference)
    direct = assess(adjust(other, scene.start(1e-2, seed=8)))
    carried = assess(adjust(other, here.values))  # from the solution: no residual changes
    np.testing.assert_allclose(carried.adjustment.values["point"], direct.adjustment.values["point"], atol=1e-9)
    assert np.abs(here.values["point"] - direct.adjustment.values["point"]).max() > 1e-4
    for kind, q in direct.cofactors.items():
        np.testing.assert_allclose(carried.cofactors[kind], q, rtol=1e-9, atol=1e-10 * np.abs(q).max() + 1e-300)
    np.testing.assert_allclose(carried.groups[0].v, assess(here).groups[0].v, atol=1e-12)


def test_cofactors_of_one_datum_follow_from_those_of_any_other():
    # S Q Sᵀ with S = I − G (BᵀG)⁻¹ Bᵀ, from the inner constraints over all points to those over three
    scene, points = photo_block()
    quality = assess(solve(scene, np.random.default_rng(3), points))
    G = quality.adjustment.defect.datum
    other = scene.problem(None, points[:3])
    B = constraint(G, other, quality.adjustment.values).normals
    S = np.eye(len(G)) - G @ np.linalg.solve(B.T @ G, B.T)
    columns = np.arange(len(G))
    expected = S @ joint_cofactors(quality, columns) @ S.T
    reference = quality.adjustment.values["point"]
    same = scene.problem(np.random.default_rng(3), points[:3], reference=reference)
    found = joint_cofactors(assess(adjust(same, quality.adjustment.values)), columns)
    size = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=1e-6)


def test_a_minimal_datum_holds_its_coordinates_exactly():
    scene, points = photo_block()
    problem = scene.problem(np.random.default_rng(3), points)
    mask = np.zeros_like(problem.datum.mask["point"])
    mask[0] = mask[4] = True
    mask[8, 2] = True
    minimal = replace(problem, datum=problem.datum._replace(mask={"point": mask}))
    quality = assess(adjust(minimal, scene.start(1e-2)))
    held = np.flatnonzero(mask.any(axis=1))
    reference = problem.datum.reference["point"]
    np.testing.assert_allclose(quality.adjustment.values["point"][held[:2]], reference[held[:2]], atol=1e-12)
    assert (quality.cofactors["point"][0] == 0.0).all()
    assert (quality.cofactors["point"][8][2] == 0.0).all()
    assert quality.cofactors["point"][8][0, 0] > 0.0


def test_relative_ellipsoids_do_not_depend_on_the_datum_where_the_network_has_its_scale_and_attitude():
    # levelling: nothing but a shift is free
    scene, points = levelling_network()
    found = []
    for names in (points, points[:1], points[1:3]):
        quality = assess(solve(scene, np.random.default_rng(3), names))
        found.append(relative_ellipsoid(quality, 0, 2))
    for other in found[1:]:
        np.testing.assert_allclose(other.covariance, found[0].covariance, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(other.difference, found[0].difference, atol=1e-12)
    assert found[0].axes[0] == pytest.approx(np.sqrt(found[0].covariance[2, 2]))


def _epoch(seed, moved=None):
    scene, points = plane_network(directions=True)
    if moved is not None:
        name, shift = moved
        scene.truth["point"][name] = scene.truth["point"][name] + shift
    return assess(solve(scene, np.random.default_rng(seed), points, disturbed=1e-4))


def _compare(first, second, known=False, level=0.001):
    columns = first.adjustment.problem.index.columns["point"].ravel()
    q = joint_cofactors(first, columns) + joint_cofactors(second, columns)
    null = first.adjustment.defect.datum
    generators = np.where((columns >= 0)[:, None], null[columns], 0.0)
    d = second.adjustment.values["point"] - first.adjustment.values["point"]
    redundancy = first.redundancy + second.redundancy
    variance = (first.omega + second.omega) / redundancy
    return congruence(d, q, generators, variance, redundancy, level, known)


@pytest.mark.slow
def test_epochs_without_movement_are_congruent_as_often_as_the_level_says():
    rejected, repetitions = 0, 60
    for seed in range(repetitions):
        found = _compare(_epoch(2 * seed), _epoch(2 * seed + 1), level=0.05)
        rejected += int(found.global_test.ratio > found.critical)
    assert scipy.stats.binomtest(rejected, repetitions, 0.05).pvalue > 0.01


def test_the_point_that_moved_is_found_and_the_others_carry_the_datum():
    shift = np.array([0.012, -0.009, 0.0])
    for known in (False, True):
        found = _compare(_epoch(1), _epoch(2, ("N3", shift)), known)
        value = found.global_test.statistic if known else found.global_test.ratio
        assert value > found.critical
        np.testing.assert_array_equal(found.stable, [True, True, True, False, True])
        test = found.points[3]
        assert np.abs(test.movement - shift).max() < 4.0 * test.sigma.max()
        assert test.freedom == 2
        assert test.log_p_estimated < np.log(1e-3)
        assert all(other.log_p_estimated > np.log(1e-3) for k, other in enumerate(found.points) if k != 3)


def test_the_test_does_not_depend_on_the_datum_of_the_epochs():
    scene, points = plane_network(directions=True)
    results = []
    for names in (points, points[:3]):
        epochs = [assess(solve(scene, np.random.default_rng(s), names, disturbed=1e-4)) for s in (4, 5)]
        results.append(_compare(*epochs))
    assert results[0].global_test.freedom == results[1].global_test.freedom == 7
    assert results[0].global_test.statistic == pytest.approx(results[1].global_test.statistic, rel=1e-4)


def test_movement_of_two_points_of_one_adjustment_in_closed_form():
    # two heights over the same mark, each measured twice: d = mean difference, q = σ²
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    values = {"before": (1.0, 1.002), "after": (1.010, 1.006)}
    for name, heights in values.items():
        scene.add("point", name, [3.0, 4.0, 1.0], free=(False, False, True))
        for height in heights:
            scene.observe("height_difference", "A", None, name, None, sigma=2e-3, observed=height)
    quality = assess(adjust(scene.problem(), scene.start(0.0)))
    test = pair_movement(quality, 1, 2)
    assert test.movement[2] == pytest.approx(0.007, abs=1e-12)
    assert test.freedom == 1
    assert test.statistic == pytest.approx(0.007**2 / 4e-6, rel=1e-9)
    assert test.ratio == pytest.approx(test.statistic / quality.sigma0**2, rel=1e-12)
    assert np.exp(test.log_p) == pytest.approx(scipy.stats.chi2.sf(test.statistic, 1), rel=1e-9)


def test_a_movement_without_any_variance_is_not_tested():
    test = movement_test(np.zeros(3), np.zeros((3, 3)), 1.0, 5)
    assert test.freedom == 0
    assert test.statistic == 0.0
