"""A result carried into another datum is the direct adjustment there, and its covariance the exact one: to 1e-9.

Truth does not go by the normal equations, whose condition is the square of that of the observation equations: with Z
an orthonormal basis of all x with Bᵀx = 0, Q = Z (R⁻¹ R⁻ᵀ) Zᵀ, R the triangle of the whitened A Z.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from mor.api.pipeline import determinable_start, make_problem, read_document, read_network
from mor.quality.assessment import assess, joint_cofactors
from mor.solve.iterate import Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.datum_scenes import free_mixed_network, local_system, theodolites
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import levelling_network, photo_block, plane_network
from tests.selection import slow_after

THREE, FOUR = ["P0", "P5", "P10"], ["P1", "P2", "P3", "P7"]
NETWORKS = {
    "levelling, 1-D": (levelling_network, ["B0"], ["B1", "B2"]),
    "plane, 2-D": (lambda: plane_network(directions=True), ["N0", "N1"], ["N2", "N3", "N4"]),
    "plane, directions only": (
        lambda: plane_network(distances=False, directions=True),
        ["N0", "N1"],
        ["N2", "N3", "N4"],
    ),
    "images": (photo_block, THREE, FOUR),
    "images and a scale bar": (lambda: photo_block(scale_bar=True), THREE, FOUR),
    "theodolites, full orientation": (lambda: theodolites("free"), THREE, FOUR),
    "theodolites, levelled": (lambda: theodolites("fixed"), THREE[:2], FOUR),
    "theodolites, level observed": (lambda: theodolites("axes"), THREE[:2], FOUR),
    "local system": (local_system, THREE, FOUR),
    "everything": (free_mixed_network, THREE, FOUR),
}
FOLDER = Path(__file__).resolve().parents[3] / "sample_projects"
SAMPLES = ("image_variant", "stereo_rig", "test_field")


def exact_cofactors(adjustment):
    """Cofactors in the datum of an adjustment at its values, by orthogonal transformations alone."""
    dense = dense_system(adjustment.problem, adjustment.values)
    white = scipy.linalg.solve_triangular(np.linalg.cholesky(dense.covariance), dense.A, lower=True)
    scale = 1.0 / np.linalg.norm(white, axis=0)
    B = adjustment.constraint.normals * scale[:, None]
    d = B.shape[1]
    basis = np.linalg.qr(B / np.linalg.norm(B, axis=0), mode="complete")[0] if d else np.eye(len(B))
    Z = basis[:, d:]
    R = np.linalg.qr((white * scale) @ Z, mode="r")
    root = scale[:, None] * scipy.linalg.solve_triangular(R.T, Z.T, lower=True).T
    return root @ root.T


def everything(quality):
    return joint_cofactors(quality, np.arange(quality.adjustment.problem.index.count))


def assert_equal_covariances(found, expected, tolerance=1e-9):
    """Each entry to the tolerance, in units of the largest σ of the two kinds of components it belongs to."""
    size = np.sqrt(np.abs(np.diagonal(expected)))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=tolerance, rtol=0.0)


@pytest.mark.parametrize("target", slow_after(1, [0, 1]), ids=["few points", "more points"])
@pytest.mark.parametrize("name", NETWORKS)
def test_carried_and_direct_are_one(name, target):
    make, *targets = NETWORKS[name]
    scene, points = make()
    reference = scene.start(2e-2, seed=5)["point"]
    here = adjust(scene.problem(np.random.default_rng(3), points, reference=reference), scene.start(1e-3))
    other = scene.problem(np.random.default_rng(3), targets[target], reference=reference)
    direct, carried = adjust(other, scene.start(1e-3, seed=8)), adjust(other, here.values)
    assert direct.outcome is carried.outcome is Outcome.CONVERGED
    assert len(carried.iterations) <= 11  # mostly six; the last digit of the start decides
    np.testing.assert_allclose(carried.values["point"], direct.values["point"], atol=1e-9, rtol=0.0)
    assert np.abs(here.values["point"] - direct.values["point"]).max() > 1e-4
    one, two = assess(direct), assess(carried)
    for group, other_group, before in zip(one.groups, two.groups, assess(here).groups, strict=True):
        size = np.nanmax(np.sqrt(group.q_adjusted))
        np.testing.assert_allclose(other_group.v, group.v, atol=1e-9 * size, rtol=0.0)
        np.testing.assert_allclose(other_group.v, before.v, atol=1e-7 * size, rtol=0.0)
        np.testing.assert_allclose(other_group.r, before.r, atol=1e-9, rtol=0.0)
    for kind, q in one.cofactors.items():
        size = np.sqrt(np.diagonal(q, axis1=1, axis2=2).max(axis=0))
        np.testing.assert_allclose(two.cofactors[kind], q, atol=1e-9 * np.outer(size, size).max(), rtol=0.0)
    moving = np.diagonal(everything(one)) > 1e-14 * np.diagonal(everything(one)).max()
    assert_equal_covariances(everything(two)[np.ix_(moving, moving)], everything(one)[np.ix_(moving, moving)])


@pytest.mark.parametrize("name", ["images", "images and a scale bar", "local system"])
def test_a_way_into_another_datum_is_no_standstill(name):
    """It begins with a step of nothing, and takes some pieces, as many as the last digits will have it."""
    make, *targets = NETWORKS[name]
    scene, points = make()
    reference = scene.start(2e-2, seed=5)["point"]
    for seed in range(3, 6):
        here = adjust(scene.problem(np.random.default_rng(seed), points, reference=reference), scene.start(1e-3))
        for target in targets:
            other = scene.problem(np.random.default_rng(seed), target, reference=reference)
            carried = adjust(other, here.values)
            assert carried.outcome is Outcome.CONVERGED, (seed, carried.reason)
            assert len(carried.iterations) <= 12


@pytest.mark.parametrize("name", [*NETWORKS, "correlated"])
def test_the_covariance_is_the_exact_one(name):
    make, _, target = NETWORKS.get(name, (correlated_everywhere, None, None))
    scene, _ = make()
    adjustment = adjust(scene.problem(np.random.default_rng(3), target), scene.start(1e-3, seed=8))
    assert adjustment.outcome is Outcome.CONVERGED
    assert_equal_covariances(everything(assess(adjustment)), exact_cofactors(adjustment))


@pytest.mark.parametrize("sample", slow_after(1, SAMPLES))
def test_sample_projects_in_a_datum_of_four_of_their_points(sample):
    folder = FOLDER / sample
    network = read_network(read_document(folder / "project.yaml"), folder)
    network, start = determinable_start(network)
    problem = make_problem(network, start, start)
    points = np.flatnonzero(network.datum.mask.all(axis=1))
    mask = np.zeros_like(network.datum.mask)
    mask[points[[0, len(points) // 3, 2 * len(points) // 3, -1]]] = True
    other = replace(problem, datum=problem.datum._replace(mask={"point": mask}))
    direct, carried = adjust(other, start), adjust(other, adjust(problem, start).values)
    assert direct.outcome is carried.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(carried.values["point"], direct.values["point"], atol=1e-9, rtol=0.0)
    one, two, exact = assess(direct), assess(carried), exact_cofactors(direct)
    for kind, q in one.cofactors.items():
        columns = problem.index.columns[kind]
        free = (columns >= 0)[:, :, None] & (columns >= 0)[:, None, :]
        expected = np.where(free, exact[columns[:, :, None], columns[:, None, :]], 0.0)
        size = np.sqrt(np.diagonal(expected, axis1=1, axis2=2).max(axis=0))
        unit = np.where(np.outer(size, size) > 0.0, np.outer(size, size), 1.0)
        np.testing.assert_allclose(q / unit, expected / unit, atol=1e-9, rtol=0.0)
        np.testing.assert_allclose(two.cofactors[kind] / unit, q / unit, atol=1e-9, rtol=0.0)
