"""Rinner's auxiliary unknowns against simulated truth, identity by identity."""

import numpy as np
import pytest

from mor.start.relative_orientation import (
    adjoint,
    auxiliary_unknowns,
    base_in_three_ways,
    compatible_unknowns,
    conditions,
    conditions_by_unknowns,
    coplanarity_rows,
    four_candidates,
    homogeneous_unknowns,
    nearest_rotation,
    printed_conditions,
    triad,
)


def orientation(scenes, seed):
    rng = np.random.default_rng(seed)
    base = rng.normal(size=3)
    return base / np.linalg.norm(base), scenes.random_rotation(rng)


def homologous(scenes, seed, n=12):
    base, rotation = orientation(scenes, seed)
    points = np.random.default_rng(seed + 1).normal(size=(n, 3)) + np.array([0.0, 0.0, -5.0])
    return base, rotation, points, (points - base) @ rotation.T


@pytest.mark.parametrize("seed", range(5))
def test_unknowns_are_triple_products(scenes, seed):
    base, rotation = orientation(scenes, seed)
    ik = auxiliary_unknowns(base, rotation)
    for i in range(3):
        for k in range(3):
            assert ik[i, k] == pytest.approx(np.linalg.det([np.eye(3)[i], rotation[k], base]), abs=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_products_of_the_columns_carry_base_and_signed_cosines(scenes, seed):
    base, rotation = orientation(scenes, seed)
    ik = auxiliary_unknowns(base, rotation)
    np.testing.assert_allclose(adjoint(ik), np.outer(base, rotation @ base), atol=1e-14)
    basis = base_in_three_ways(ik)
    sign = np.sign(basis.base @ base)
    np.testing.assert_allclose(basis.base * sign, base, atol=1e-14)
    np.testing.assert_allclose(basis.cosines * sign, rotation @ base, atol=1e-14)
    np.testing.assert_allclose(basis.three, np.tile(basis.base, (3, 1)), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_triad_follows_from_base_and_unknowns(scenes, seed):
    base, rotation = orientation(scenes, seed)
    ik = auxiliary_unknowns(base, rotation)
    np.testing.assert_allclose(triad(ik, base), rotation, atol=1e-13)
    twisted = triad(ik, -base)
    np.testing.assert_allclose(twisted, rotation @ (2 * np.outer(base, base) - np.eye(3)), atol=1e-13)


@pytest.mark.parametrize("seed", range(20))
def test_linear_system_returns_the_truth_among_four(scenes, seed):
    base, rotation, a, b = homologous(scenes, seed)
    solution = homogeneous_unknowns(coplanarity_rows(a, b))
    candidates = four_candidates(solution.ik)
    assert len(candidates) == 4
    distances = [np.abs(c[0] - base).max() + np.abs(c[1] - rotation).max() for c in candidates]
    assert min(distances) < 1e-11
    assert sum(distance < 1.0 for distance in distances) == 1


@pytest.mark.parametrize("seed", range(5))
def test_conditions_hold_for_every_orientation(scenes, seed):
    ik = auxiliary_unknowns(*orientation(scenes, seed))
    np.testing.assert_allclose(printed_conditions(ik), 0.0, atol=1e-14)
    np.testing.assert_allclose(conditions(ik), 0.0, atol=1e-14)


def test_derivatives_of_the_conditions_are_differences(scenes):
    ik = auxiliary_unknowns(*orientation(scenes, 9)) + 0.1
    step = 1e-6
    differences = [
        (conditions(ik + step * change) - conditions(ik - step * change)) / (2 * step)
        for change in np.eye(9).reshape(9, 3, 3)
    ]
    np.testing.assert_allclose(conditions_by_unknowns(ik), np.transpose(differences), atol=1e-8)


def test_printed_conditions_lose_a_rank_in_the_normal_case_and_the_full_set_does_not(scenes):
    printed = [0, 1, 4, 6]
    base, rotation = orientation(scenes, 4)
    general = conditions_by_unknowns(auxiliary_unknowns(base, rotation))
    normal_case = conditions_by_unknowns(auxiliary_unknowns(rotation[0], rotation))
    assert np.linalg.matrix_rank(general[printed], tol=1e-8) == 4
    assert np.linalg.matrix_rank(normal_case[printed], tol=1e-8) == 3
    assert np.linalg.matrix_rank(general, tol=1e-8) == 4
    assert np.linalg.matrix_rank(normal_case, tol=1e-8) == 4


@pytest.mark.parametrize("normal_case", [False, True])
def test_corrections_make_unknowns_compatible_and_are_the_smallest(scenes, normal_case):
    base, rotation = orientation(scenes, 5)
    truth = auxiliary_unknowns(rotation[0] if normal_case else base, rotation)
    disturbed = truth + 0.03 * np.random.default_rng(1).normal(size=(3, 3))
    result = compatible_unknowns(disturbed, np.eye(9))
    assert result.misclosure < 1e-14
    np.testing.assert_allclose(np.linalg.svd(result.ik)[1], [1.0, 1.0, 0.0], atol=1e-12)
    # The nearest compatible matrix is known in closed form: singular values replaced by 1, 1, 0.
    left, _, right = np.linalg.svd(disturbed)
    np.testing.assert_allclose(result.ik, left @ np.diag([1.0, 1.0, 0.0]) @ right, atol=1e-9)
    np.testing.assert_allclose(result.corrections, result.ik - disturbed, atol=1e-15)


def test_nearest_rotation_is_proper():
    matrix = np.diag([2.0, 1.0, -3.0])
    rotation = nearest_rotation(matrix)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
