"""Closed-form similarity in two and three dimensions, planes and lines."""

import numpy as np
import pytest

from mor.start.bundle import SimilarityOutcome, congruence, similarity


def rotation_of(scenes, rng, dimension):
    if dimension == 3:
        return scenes.random_rotation(rng)
    turn = rng.uniform(-np.pi, np.pi)
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])


@pytest.mark.parametrize("dimension", [2, 3])
def test_transformation_is_recovered_exactly(scenes, dimension):
    rng = np.random.default_rng(dimension)
    for n in (dimension, dimension + 1, 20):
        rotation, scale, shift = (
            rotation_of(scenes, rng, dimension),
            rng.uniform(0.1, 9),
            rng.normal(size=dimension),
        )
        source = rng.normal(size=(n, dimension))
        target = scale * source @ rotation.T + shift
        found = similarity(source, target)
        assert found.outcome is SimilarityOutcome.DETERMINED
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        assert found.scale == pytest.approx(scale)
        np.testing.assert_allclose(found.transform(source), target, atol=1e-12)
        np.testing.assert_allclose(found.inverse(target), source, atol=1e-12)
        np.testing.assert_allclose(found.transform(found.origin[None]), 0.0, atol=1e-12)
        rigid = congruence(source, target / scale)
        np.testing.assert_allclose(rigid.rotation, rotation, atol=1e-12)
        assert rigid.scale == 1.0


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("solve", [similarity, congruence])
def test_the_solution_is_the_minimum(scenes, dimension, solve):
    rng = np.random.default_rng(7)
    source = rng.normal(size=(8, dimension))
    target = source @ rotation_of(scenes, rng, dimension).T + 0.1 * rng.normal(size=(8, dimension)) + 3.0
    found = solve(source, target)
    best = np.sum(found.residuals**2)
    for _ in range(50):
        skew = 1e-3 * rng.normal(size=(dimension, dimension))
        near = found.rotation @ np.linalg.qr(np.eye(dimension) + skew - skew.T)[0]
        near *= np.sign(np.sum(near * found.rotation))
        scale = found.scale * (1 + 1e-3 * rng.normal()) if solve is similarity else 1.0
        other = scale * source @ near.T + found.translation + 1e-3 * rng.normal(size=dimension) - target
        assert np.sum(other**2) > best
    parameters = {2: 3, 3: 6}[dimension] + (solve is similarity)
    assert found.sigma0 == pytest.approx(np.sqrt(best / (8 * dimension - parameters)))


def test_plane_sets_are_no_mirror_images(scenes):
    rng = np.random.default_rng(1)
    source = np.column_stack([rng.normal(size=(6, 2)), np.zeros(6)])
    rotation = scenes.random_rotation(rng)
    found = similarity(source, source @ rotation.T)
    assert found.outcome is SimilarityOutcome.DETERMINED
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)


def test_degenerate_sets_are_named():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(6, 3))
    line = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    assert similarity(line, line).outcome is SimilarityOutcome.COLLINEAR
    assert similarity(points[:2], points[:2]).outcome is SimilarityOutcome.TOO_FEW
    assert similarity(points, points[:5]).outcome is SimilarityOutcome.INVALID
    assert similarity(points * np.nan, points).outcome is SimilarityOutcome.INVALID
    assert similarity(np.ones((4, 3)), points[:4]).outcome is SimilarityOutcome.COINCIDENT
    assert similarity(points, points * [1, 1, -1]).outcome is SimilarityOutcome.MIRRORED
    assert congruence(points, points[:, [1, 0, 2]]).outcome is SimilarityOutcome.MIRRORED
    assert similarity(points[:, :2], points[:, [1, 0]]).outcome is SimilarityOutcome.MIRRORED
    assert not SimilarityOutcome.COLLINEAR.usable
