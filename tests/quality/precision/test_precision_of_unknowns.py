"""Cofactors of the unknowns against the dense inverse: points, interiors, ω φ κ, partly free and shared blocks."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.parameters import moves_by_angles
from mor.model.rotations import angles_from_rotation, rotate
from mor.quality.assessment import assess, standard_deviations
from mor.quality.precision import angle_cofactors
from tests.dense_reference import dense_system
from tests.scenarios.scenes import mixed_network, photo_block, solve


def controlled_block():
    scene, points = photo_block(scale_bar=True)
    for name in ("P0", "P5", "P10", "P7"):
        scene.free["point"][name] = np.zeros(3, dtype=bool)
    scene.free["interior/mor"]["camera"] = np.array([True, True, True, True, *[False] * 6])
    return scene, points


def _angles_by_difference(D):
    """d(ω, φ, κ)/dδ of one rotation from differences."""
    columns = []
    for k in range(3):
        delta = 1e-6 * np.eye(3)[k]
        columns.append((angles_from_rotation(rotate(D, delta)) - angles_from_rotation(rotate(D, -delta))) / 2e-6)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("make", [controlled_block, mixed_network])
def test_cofactors_of_all_blocks_are_those_of_the_dense_inverse(make):
    scene, _ = make()
    adjustment = solve(scene, np.random.default_rng(1))
    quality = assess(adjustment)
    dense = dense_system(adjustment.problem, adjustment.values)
    scale = 1.0 / np.sqrt(np.diagonal(dense.normal))
    Q = np.linalg.inv(dense.normal * np.outer(scale, scale)) * np.outer(scale, scale)
    index = adjustment.problem.index
    for kind, columns in index.columns.items():
        for number, row in enumerate(columns):
            used = row >= 0
            expected = np.zeros((len(row), len(row)))
            expected[np.ix_(used, used)] = Q[np.ix_(row[used], row[used])]
            found = quality.cofactors[kind][number]
            size = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
            np.testing.assert_allclose(found, expected, atol=1e-6 * size.max() + 1e-300, err_msg=f"{kind} {number}")


@pytest.mark.parametrize("make", [controlled_block, mixed_network])
def test_cofactors_of_omega_phi_kappa_are_propagated_rigorously(make):
    scene, _ = make()
    quality = assess(solve(scene, np.random.default_rng(1)))
    D = quality.adjustment.values["rotation"]
    by_angles = moves_by_angles(quality.adjustment.problem.index.blocks["rotation"])
    q = quality.cofactors["rotation"]
    found = angle_cofactors(q, D, by_angles)
    for number in range(len(D)):
        J = np.eye(3) if by_angles[number] else _angles_by_difference(D[number])
        expected = J @ q[number] @ J.T
        np.testing.assert_allclose(found[number], expected, atol=1e-8 * np.abs(expected).max())


def test_standard_deviations_are_scaled_by_sigma0_and_zero_where_fixed():
    scene, _ = controlled_block()
    quality = assess(solve(scene, np.random.default_rng(2)))
    sigma = standard_deviations(quality, "point")
    fixed = scene.number("point", "P5")
    np.testing.assert_array_equal(sigma[fixed], 0.0)
    free = scene.number("point", "P1")
    expected = quality.sigma0 * np.sqrt(np.diagonal(quality.cofactors["point"][free]))
    np.testing.assert_allclose(sigma[free], expected, rtol=1e-14)
    assert quality.sigma0 != 1.0


def test_sigma_grows_with_the_sigma_of_the_observations():
    results = []
    for factor in (1.0, 3.0):
        scene, _ = controlled_block()
        for rows in scene.groups.values():
            rows.sigma = [factor * sigma for sigma in rows.sigma]
        results.append(assess(solve(scene, None, disturbed=1e-4)))
    for kind in ("point", "rotation"):
        np.testing.assert_allclose(results[1].cofactors[kind], 9.0 * results[0].cofactors[kind], rtol=1e-6, atol=1e-20)
