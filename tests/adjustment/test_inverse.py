"""Null and weak directions, and cofactors that know nothing of the anchors they were computed with."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from mor.solve.inverse import damped_step, find_anchors, invert
from mor.solve.normals import build_normals, make_plan
from tests.dense_reference import dense_system
from tests.scenarios.scenes import Scene, levelling_network, mixed_network, photo_block, plane_network

NETWORKS = {
    "mixed": (mixed_network, 0),
    "plane, distances": (plane_network, 3),
    "plane, directions": (lambda: plane_network(distances=False, directions=True), 4),
    "levelling": (levelling_network, 1),
    "bundle": (photo_block, 7),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), 6),
}
EACH = pytest.mark.parametrize("network", NETWORKS)


def prepare(scene: Scene, disturbed=1e-3):
    problem, values = scene.problem(np.random.default_rng(2)), scene.start(disturbed)
    plan = make_plan(problem)
    return plan, build_normals(plan, values), values, dense_system(problem, values)


def functionals(dense, seed=0):
    """Vectors in the range of N: what the observations do determine."""
    white = np.linalg.solve(np.linalg.cholesky(dense.covariance), dense.A)
    return white.T @ np.random.default_rng(seed).standard_normal((len(white), 5))


def pseudo_solution(dense, rhs):
    """Fᵀ N⁺ F by the pseudo-inverse of the scaled matrix."""
    scale = 1.0 / np.sqrt(np.diagonal(dense.normal))
    inverse = np.linalg.pinv(dense.normal * np.outer(scale, scale), rcond=1e-11, hermitian=True)
    return rhs.T @ (inverse * np.outer(scale, scale)) @ rhs


def round_off(dense, inverse):
    """ε times the condition number of the scaled system, apart from its null directions."""
    sizes = np.linalg.eigvalsh(dense.normal * np.outer(inverse.scale, inverse.scale))
    return np.finfo(float).eps * sizes[-1] / sizes[inverse.null.shape[1]]


@EACH
def test_as_many_null_vectors_as_there_are_and_each_is_null(network):
    make, dimension = NETWORKS[network]
    plan, normals, values, dense = prepare(make()[0])
    inverse = invert(plan, normals, values, find_anchors(plan, normals).unknowns)
    assert inverse.null.shape[1] == dimension
    assert inverse.weak.shape[1] == 0
    unit = inverse.null / np.linalg.norm(inverse.null / inverse.scale[:, None], axis=0)
    assert np.abs(np.linalg.solve(np.linalg.cholesky(dense.covariance), dense.A) @ unit).max(initial=0.0) < 1e-10


@EACH
def test_solutions_of_equations_in_the_range(network):
    plan, normals, values, dense = prepare(NETWORKS[network][0]()[0])
    inverse = invert(plan, normals, values, find_anchors(plan, normals).unknowns)
    F = functionals(dense)
    expected = pseudo_solution(dense, F)
    np.testing.assert_allclose(F.T @ inverse.solve(F), expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())
    one, several = (x / inverse.scale for x in (inverse.solve(F[:, 0]), inverse.solve(F)[:, 0]))
    atol = 10 * round_off(dense, inverse) * np.abs(one).max()  # one column goes another way through the processor
    np.testing.assert_allclose(several, one, rtol=0, atol=atol)


def _other_anchors(plan, normals, values, found):
    """As many anchors as needed, that hold all null vectors, but with nothing else in common with the ones found."""
    inverse = invert(plan, normals, values, found)
    null = inverse.null / inverse.scale[:, None]
    null[found] *= 1e-6
    *_, order = scipy.linalg.qr(null.T, mode="economic", pivoting=True)
    return np.sort(order[: len(found)])


@EACH
def test_which_unknowns_are_anchored_changes_no_result(network):
    make, dimension = NETWORKS[network]
    plan, normals, values, dense = prepare(make()[0])
    F = functionals(dense)
    expected = pseudo_solution(dense, F)
    u = plan.target.structure.unknowns
    found = find_anchors(plan, normals).unknowns
    more = np.union1d(found, np.random.default_rng(7).permutation(u)[:4])
    for anchors in (found, _other_anchors(plan, normals, values, found), more, np.arange(u)):
        inverse = invert(plan, normals, values, anchors)
        assert inverse.null.shape[1] == dimension
        np.testing.assert_allclose(F.T @ inverse.solve(F), expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@EACH
def test_selected_cofactors_and_weak_part_make_the_variances_of_observations(network):
    make, dimension = NETWORKS[network]
    plan, normals, values, dense = prepare(make()[0])
    F = dense.A.T  # variances of the adjusted observations do not depend on the datum
    expected = np.diagonal(pseudo_solution(dense, F))
    u = plan.target.structure.unknowns
    for anchors in (find_anchors(plan, normals).unknowns, np.arange(min(u, dimension + 3))):
        inverse = invert(plan, normals, values, anchors)
        Q = inverse.selected().to_dense() + inverse.weak @ inverse.weak.T
        if not plan.clusters:  # else the pattern holds what the observations of a cluster need, checked in quality
            found = np.einsum("iu,uv,iv->i", dense.A, Q, dense.A)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * expected.max())


def test_a_weak_direction_is_neither_null_nor_lost():
    # a point 50 km away that two rays fix which are nearly parallel, askew to the axes
    scene, points = plane_network()
    for name in points[:3]:
        scene.free["point"][name] = np.zeros(3, dtype=bool)
    scene.add("point", "far", [4e4, 3e4, 0.0], free=(True, True, False))
    scene.add("point", "other", [-0.3, 0.4, 0.0], free=False)
    for start in ("N0", "other"):
        scene.observe("bearing", start, None, "far", None, sigma=1e-5)
    plan, normals, values, dense = prepare(scene, disturbed=1e-6)
    anchors = find_anchors(plan, normals).unknowns
    inverse = invert(plan, normals, values, anchors)
    assert inverse.null.shape[1] == 0
    assert inverse.weak.shape[1] == len(anchors) == 1
    Q = np.linalg.inv(dense.normal)
    found = inverse.selected().to_dense() + inverse.weak @ inverse.weak.T
    np.testing.assert_allclose(np.diagonal(found), np.diagonal(Q), rtol=1e-4)
    # closed form: along the sight σ = s² σ_t √2 / b with the base b across it, 0.5 m; 0.8 of it in x
    column = plan.problem.index.columns["point"][scene.number("point", "far"), 0]
    assert np.sqrt(found[column, column]) == pytest.approx(0.8 * 5e4**2 * 1e-5 * np.sqrt(2) / 0.5, rel=1e-2)


def test_a_damped_step_is_the_solution_of_the_damped_system():
    plan, _, values, dense = prepare(photo_block()[0], disturbed=1e-2)
    N, b = dense.normal, dense.A.T @ dense.weights @ dense.l
    damping = 1e-3
    expected = np.linalg.solve(N + damping * np.diag(np.diagonal(N)), b)
    np.testing.assert_allclose(
        damped_step(plan, values, damping).step, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max()
    )
