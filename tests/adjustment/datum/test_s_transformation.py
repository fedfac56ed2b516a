"""The datum: inner constraints, independence of the way there, covariances in any datum against bordered systems."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.quality.assessment import assess
from mor.solve import datum as s_transformation
from mor.solve.datum import binds, constraint, datum_mask, into_datum
from mor.solve.iterate import Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.scenes import (
    coordinates,
    levelling_network,
    mixed_network,
    photo_block,
    plane_network,
    solve,
)

NETWORKS = {
    "plane, distances": plane_network,
    "plane, directions": lambda: plane_network(distances=False, directions=True),
    "levelling": levelling_network,
    "bundle": photo_block,
    "bundle with a scale bar": lambda: photo_block(scale_bar=True),
}
EACH = pytest.mark.parametrize("network", NETWORKS)


def noisy(network, datum=slice(None), seed=1, **options):
    scene, points = NETWORKS[network]()
    return scene, points, scene.problem(np.random.default_rng(seed), points[datum], **options)


def similarity_generators(xyz):
    """Seven displacements of points (n, 3), written out independently of the program: (3n, 7)."""
    columns = [np.tile(np.eye(3)[k], len(xyz)) for k in range(3)]
    columns += [np.cross(np.eye(3)[k], xyz).ravel() for k in range(3)]
    return np.stack([*columns, xyz.ravel()], axis=1)


MOVEMENT_NUMBER = {
    name: number
    for number, name in enumerate(
        ["translation X", "translation Y", "translation Z", "rotation X", "rotation Y", "rotation Z", "scale"]
    )
}


@EACH
@pytest.mark.parametrize("datum", [slice(None), slice(0, 4)], ids=["all points", "four points"])
def test_the_total_corrections_satisfy_the_inner_constraints(network, datum):
    scene, points, problem = noisy(network, datum)
    adjustment = adjust(problem, scene.start(5e-3))
    assert adjustment.outcome is Outcome.CONVERGED
    chosen = points[datum]
    truth = np.array([scene.truth["point"][name] for name in chosen])
    free = np.array([scene.free["point"][name] for name in chosen])
    correction = np.where(free, coordinates(adjustment, chosen) - truth, 0.0)
    # movements at the adjusted coordinates: then no similarity brings the points closer to the reference
    adjusted = coordinates(adjustment, chosen)
    generators = similarity_generators(adjusted - adjusted.mean(axis=0))
    moved = generators.T @ correction.ravel()
    assert np.abs(correction).max() > 1e-5
    for name in adjustment.defect.movements:
        size = np.linalg.norm(generators[:, MOVEMENT_NUMBER[name]]) * np.linalg.norm(correction)
        assert abs(moved[MOVEMENT_NUMBER[name]]) < 1e-7 * size, name


@EACH
def test_the_movements_may_be_taken_at_coordinates_the_datum_names(network):
    scene, points, problem = noisy(network)
    elsewhere = {"point": problem.datum.reference["point"] * [1.1, 0.8, 1.3] + 0.3}
    adjustment = adjust(replace(problem, datum=problem.datum._replace(movements=elsewhere)), scene.start(5e-3))
    assert adjustment.outcome is Outcome.CONVERGED
    numbers = [scene.number("point", name) for name in points]
    free = np.array([scene.free["point"][name] for name in points])
    truth = scene.values()["point"][numbers]
    correction = np.where(free, coordinates(adjustment, points) - truth, 0.0)
    generators = similarity_generators(elsewhere["point"][numbers] - elsewhere["point"][numbers].mean(axis=0))
    for name in adjustment.defect.movements:
        column = generators[:, MOVEMENT_NUMBER[name]]
        size = np.linalg.norm(column) * np.linalg.norm(correction)
        assert abs(column @ correction.ravel()) < 1e-7 * size, name


@EACH
def test_the_result_does_not_depend_on_the_start(network):
    scene, points, problem = noisy(network)
    results = [adjust(problem, scene.start(amount, seed)) for amount, seed in ((1e-2, 1), (3e-2, 2), (1e-6, 3))]
    first = coordinates(results[0], points)
    for other in results[1:]:
        assert other.outcome is Outcome.CONVERGED
        np.testing.assert_allclose(coordinates(other, points), first, atol=1e-9)


@EACH
def test_residuals_and_redundancy_are_the_same_in_every_datum(network):
    scene, points, problem = noisy(network)
    datums = [points, points[:4], points[-3:]]
    qualities = []
    for names in datums:
        mask = np.array([[name in names] * 3 for name in scene.truth["point"]])
        other = replace(problem, datum=problem.datum._replace(mask={"point": mask}))
        adjustment = adjust(other, scene.start(1e-3))
        assert adjustment.outcome is Outcome.CONVERGED, names
        qualities.append(assess(adjustment))
    for quality in qualities[1:]:
        assert quality.sigma0 == pytest.approx(qualities[0].sigma0, rel=1e-9)
        for group, one, first in zip(problem.groups, quality.groups, qualities[0].groups, strict=True):
            np.testing.assert_allclose(one.v / group.sigma, first.v / group.sigma, atol=1e-6)
            np.testing.assert_allclose(one.r, first.r, atol=1e-9)


def _bordered(dense, normals):
    """Q of the bordered system [[N, B], [Bᵀ, 0]], scaled for accuracy."""
    scale = 1.0 / np.sqrt(np.diagonal(dense.normal))
    N = dense.normal * np.outer(scale, scale)
    B = normals * scale[:, None]  # Bᵀx = 0 in the scaled unknowns y = x/scale
    B = B / np.linalg.norm(B, axis=0)
    d = B.shape[1]
    together = np.block([[N, B], [B.T, np.zeros((d, d))]])
    return np.linalg.inv(together)[: len(N), : len(N)] * np.outer(scale, scale)


@EACH
@pytest.mark.parametrize("datum", [slice(None), slice(0, 4)], ids=["all points", "four points"])
def test_cofactors_in_the_datum_equal_the_bordered_solution(network, datum):
    scene, points, _ = noisy(network)
    adjustment = solve(scene, None, points[datum], disturbed=1e-4)
    dense = dense_system(adjustment.problem, adjustment.values)
    index = adjustment.problem.index
    truth = scene.values()["point"]
    generators = similarity_generators(truth - truth.mean(axis=0)).reshape(len(truth), 3, 7)
    B = np.zeros((index.count, len(adjustment.defect.movements)))
    for k, name in enumerate(adjustment.defect.movements):
        for number, identifier in enumerate(index.blocks["point"].ids):
            for component, column in enumerate(index.columns["point"][number]):
                if column >= 0 and identifier in points[datum]:
                    B[column, k] = generators[number, component, MOVEMENT_NUMBER[name]]
    Q = _bordered(dense, B)
    cofactors = assess(adjustment).cofactors["point"]
    for number, columns in enumerate(index.columns["point"]):
        used = columns >= 0
        expected = Q[np.ix_(columns[used], columns[used])]
        found = cofactors[number][np.ix_(used, used)]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("network", ["plane, distances", "levelling"])
def test_cofactors_in_the_free_datum_over_all_unknowns_are_the_pseudo_inverse(network):
    scene, points, _ = noisy(network)
    adjustment = solve(scene, None, points, disturbed=1e-5)
    dense = dense_system(adjustment.problem, adjustment.values)
    Q = np.linalg.pinv(dense.normal, rcond=1e-10, hermitian=True)
    cofactors = assess(adjustment).cofactors["point"]
    for number, columns in enumerate(adjustment.problem.index.columns["point"]):
        used = columns >= 0
        np.testing.assert_allclose(
            cofactors[number][np.ix_(used, used)],
            Q[np.ix_(columns[used], columns[used])],
            atol=1e-8 * np.abs(Q).max(),
        )


def test_a_free_network_moves_least_from_its_reference():
    scene, points, problem = noisy("plane, distances")
    free = coordinates(adjust(problem, scene.start(1e-3)), points)
    reference = np.array([scene.truth["point"][name] for name in points])
    least = np.linalg.norm(free - reference)
    for generator in similarity_generators(reference).T[[0, 1, 5]]:
        for step in (1e-4, -1e-4):
            moved = free + step * generator.reshape(-1, 3) / np.linalg.norm(generator)
            assert np.linalg.norm(moved - reference) > least


def test_the_datum_may_be_carried_by_chosen_components():
    scene, points, problem = noisy("bundle with a scale bar", axes=(True, True, False))
    adjustment = adjust(problem, scene.start(1e-3))
    # x and y of all points do not settle a translation in z
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.reason == "the datum points do not define the datum"
    mask = {"point": problem.datum.mask["point"].copy()}
    mask["point"][:3, 2] = True
    adjustment = adjust(replace(problem, datum=problem.datum._replace(mask=mask)), scene.start(1e-3))
    assert adjustment.outcome is Outcome.CONVERGED
    heights = coordinates(adjustment, points[:3])[:, 2] - [scene.truth["point"][name][2] for name in points[:3]]
    assert abs(heights.sum()) < 1e-12
    assert np.abs(heights).max() > 1e-6


def test_a_network_without_a_defect_keeps_its_datum_whatever_the_mask():
    scene, points = mixed_network()
    noise = [np.random.default_rng(4) for _ in range(2)]
    fixed, free = solve(scene, noise[0]), solve(scene, noise[1], points)
    np.testing.assert_allclose(coordinates(fixed, points), coordinates(free, points), atol=1e-12)
    assert free.constraint.normals.shape[1] == 0


def test_mask_of_the_unknowns():
    *_, problem = noisy("plane, distances", datum=slice(0, 2))
    mask = datum_mask(problem.datum, problem.index)
    assert [problem.index.label(k)[1] for k in np.flatnonzero(mask)] == ["N0", "N0", "N1", "N1"]


def test_constraints_that_bind_too_little_are_recognised():
    scene, points, problem = noisy("plane, distances", datum=slice(0, 1))
    adjustment = adjust(problem, scene.start(1e-3))
    null = adjustment.defect.datum
    assert not binds(null, constraint(null, problem, scene.values()), problem.index)
    everything = scene.problem(None, points)
    assert binds(null, constraint(null, everything, scene.values()), problem.index)
    assert binds(null[:, :0], constraint(null[:, :0], everything, scene.values()), problem.index)


def test_a_step_beyond_all_size_is_moved_all_the_same():
    """A network that runs away asks for it: what B changes by is then no number, and its first derivatives do."""
    scene, _, problem = noisy("bundle")
    adjustment = adjust(problem, scene.start(5e-3))
    null = adjustment.defect.datum
    values = {**adjustment.values, "point": 1e156 * adjustment.values["point"]}
    step, gain = into_datum(np.full(len(null), 1e159), null, adjustment.constraint, problem, values)
    assert np.isfinite(step).all()
    assert gain == 1.0


def test_movements_that_bend_against_themselves_to_round_off_are_not_solved_for(monkeypatch):
    # (BᵀG)⁻¹K + I of rank one: what is left of its other eigenvalues is round-off, of either sign
    scene, _, problem = noisy("plane, directions")
    adjustment = adjust(problem, scene.start(1e-3))
    null, bound, values = adjustment.defect.datum, adjustment.constraint, adjustment.values
    across, d = bound.normals.T @ null, null.shape[1]
    step = np.where(bound.mask, 1e-3, 0.0)
    plainly, _ = into_datum(step, null, bound, problem, values)
    for direction in np.random.default_rng(5).normal(size=(50, d)):
        derivative = across @ (np.outer(direction, direction) - np.eye(d))
        bent = s_transformation._MovementChange(derivative, np.zeros((4, d)))
        monkeypatch.setattr(s_transformation, "_bent", lambda *_, bent=bent: bent)
        moved, gain = into_datum(step, null, bound, problem, values)
        np.testing.assert_array_equal(moved, plainly)
        assert gain == 1.0
