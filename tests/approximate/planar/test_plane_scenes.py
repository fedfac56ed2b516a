"""Collineation, plane orientations, shape from two and more images, and what one does with it."""

import numpy as np
import pytest

from mor.start.bundle import direction_bundle, image_bundle, similarity
from mor.start.killian import PlaneOutcome, convex_hull, corners_within, fit_homography, planar_orientations
from mor.start.plane_object import (
    on_level_plane,
    on_wall,
    scale_from_length,
    shape_of_plane,
    sides_and_angles,
)


def bundles(made):
    return [image_bundle(rays, made.sigma) for rays in made.rays]


def shape_error(points, truth):
    """Largest misfit after a similarity without reflection, relative to the size."""
    seen = np.all(np.isfinite(points), axis=1)
    fit = similarity(points[seen], truth[seen])
    return np.abs(fit.residuals).max() / np.abs(truth).max() if fit.outcome.usable else np.inf


@pytest.mark.parametrize("seed", range(10))
def test_adjusted_collineation_carries_rays_over(scenes, seed):
    made = scenes.plane_scene(seed, n=12)
    found = fit_homography(*bundles(made))
    carried = made.rays[0] @ found.matrix.T
    np.testing.assert_allclose(carried * (-scenes.c / carried[:, 2:]), made.rays[1], atol=1e-9)
    assert np.linalg.svd(found.matrix)[1][1] == pytest.approx(1.0)
    assert found.same_side
    assert found.redundancy == 16


def test_collineation_misfit_is_chi_square(scenes):
    values = [fit_homography(*bundles(scenes.plane_scene(seed, 0.003, n=20))).objective for seed in range(60)]
    assert np.mean(values) == pytest.approx(32.0, abs=4 * np.sqrt(64 / 60))


# The last ones have three of four points nearly in a line.
@pytest.mark.parametrize("seed", [*range(25), 89, 95, 118, 189, 504])
def test_plane_orientations_contain_the_truth(scenes, seed):
    made = scenes.plane_scene(seed, n=4 if seed > 25 else 4 + seed % 3)
    found = planar_orientations(*bundles(made))
    base, rotation = scenes.relative_truth(made.cameras)
    assert found.outcome in (PlaneOutcome.UNIQUE, PlaneOutcome.AMBIGUOUS)
    errors = [
        np.abs(s.base / np.linalg.norm(s.base) - base).max() + np.abs(s.rotation - rotation).max()
        for s in found.solutions
    ]
    best = found.solutions[int(np.argmin(errors))]
    assert min(errors) < 1e-8
    assert best.front == len(made.points)
    np.testing.assert_allclose(best.normal, -made.cameras[0][1] @ made.normal, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("images", [2, 3])
@pytest.mark.parametrize("noise", [0.0, 0.001, 0.005])
def test_shape_of_a_plane_from_images(scenes, images, noise):
    ambiguous = 0
    for seed in range(10):
        made = scenes.plane_scene(seed, noise, images=images)
        found = shape_of_plane(bundles(made))
        assert found.outcome in (PlaneOutcome.UNIQUE, PlaneOutcome.AMBIGUOUS)
        ambiguous += found.outcome is PlaneOutcome.AMBIGUOUS
        error = min(shape_error(one.points, made.flat) for one in (found, *found.alternatives))
        assert error < 1e-10 + 3 * noise
    assert ambiguous < (6 if images == 2 else 2)


@pytest.mark.slow
def test_precision_of_the_shape_is_that_of_repeated_measurements(scenes):
    exact = scenes.plane_scene(5, images=3, n=10)
    rng = np.random.default_rng(1)
    normalised, sums = [], []
    for _ in range(60):
        noisy = [r + np.column_stack([0.002 * rng.normal(size=(10, 2)), np.zeros(10)]) for r in exact.rays]
        found = shape_of_plane([image_bundle(r, 0.002) for r in noisy])
        sums.append(np.sum(found.residuals**2))
        fit = similarity(found.points, exact.flat)
        normalised.append(np.mean((fit.residuals / fit.scale) ** 2) / np.mean(found.sigma_points**2))
    assert found.redundancy == 60 - (18 + 20 - 4)
    assert np.mean(sums) == pytest.approx(26.0, abs=4 * np.sqrt(52 / 60))
    assert np.mean(normalised) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_a_third_image_decides_what_two_leave_open(scenes):
    decided = 0
    for seed in range(60):
        made = scenes.plane_scene(seed, 0.001, images=3, n=12)
        if shape_of_plane(bundles(made)[:2]).outcome is PlaneOutcome.AMBIGUOUS:
            found = shape_of_plane(bundles(made))
            decided += found.outcome is PlaneOutcome.UNIQUE
            assert min(shape_error(one.points, made.flat) for one in (found, *found.alternatives)) < 0.01
    assert decided > 5


def test_points_need_not_be_seen_in_every_image(scenes):
    made = scenes.plane_scene(2, images=3, n=15)
    made.rays[1][:4] = np.nan
    made.rays[2][9:] = np.nan
    made.rays[0][5] = np.nan
    found = shape_of_plane(bundles(made))
    assert shape_error(found.points, made.flat) < 1e-9
    assert np.all(np.isnan(found.residuals[1, :4]))


def test_level_plane_and_wall_put_cameras_where_they_are(scenes):
    made = scenes.plane_scene(6, images=3, n=12)
    found = shape_of_plane(bundles(made))
    length = np.linalg.norm(made.flat[3] - made.flat[1])
    scale = scale_from_length(found, 1, 3, length)
    level = on_level_plane(found, 1, 3, scale)
    np.testing.assert_allclose(level.points[[1, 3]], [[0, 0, 0], [length, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(level.points[:, 2], 0.0, atol=1e-12)
    flight = [(x - made.points[0]) @ made.normal for x, _ in made.cameras]
    np.testing.assert_allclose(level.positions[:, 2], flight, rtol=1e-9)
    wall = on_wall(found, 1, 3, scale)
    np.testing.assert_allclose(wall.points[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(-wall.positions[:, 1], flight, rtol=1e-9)
    for placed in (level, wall):
        np.testing.assert_allclose(np.linalg.det(placed.rotations), 1.0)
        for k in range(3):
            again = scenes.image(placed.points, placed.positions[k], placed.rotations[k])
            np.testing.assert_allclose(again, made.rays[k], atol=1e-7)
    with pytest.raises(ValueError, match="positive length"):
        scale_from_length(found, 1, 1, length)


def test_sides_and_angles_of_known_polygons():
    right = sides_and_angles(np.array([[0, 0], [3, 0], [0, 4.0]]))
    np.testing.assert_allclose(right.sides, [3, 5, 4])
    np.testing.assert_allclose(right.angles, [np.pi / 2, np.arctan2(4, 3), np.arctan2(3, 4)])
    notched = np.array([[0, 0], [2, 0], [0.5, 0.5], [0, 2.0]])
    for corners in (notched, notched[::-1]):
        angles = sides_and_angles(corners).angles
        assert np.sum(angles) == pytest.approx(2 * np.pi)
        assert np.max(angles) > np.pi


def seen_from(scenes, made, positions, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    centre = made.points.mean(axis=0)
    cameras = [(x, scenes.looking(x, centre, roll)) for x, roll in zip(positions, (0.3, -1.1), strict=True)]
    return [image_bundle(scenes.image(made.points, *each, noise, rng), max(noise, 1e-6)) for each in cameras]


@pytest.mark.parametrize("beside", [0.0, 0.7])
def test_both_centres_on_one_normal_are_a_dangerous_locus(scenes, beside):
    made = scenes.plane_scene(3, n=12)
    foot = made.points.mean(axis=0) + beside * (made.points[0] - made.points.mean(axis=0))
    a, b = seen_from(scenes, made, [foot + 4 * made.normal, foot + 6 * made.normal])
    found = planar_orientations(a, b)
    assert found.outcome is PlaneOutcome.BASE_ALONG_NORMAL
    # Named, not divided by: the two solutions have fallen together, to the square root of the precision.
    assert found.solutions
    assert all(np.linalg.norm(np.cross(s.base, s.normal)) < 1e-3 for s in found.solutions)
    assert shape_of_plane([a, b]).outcome is PlaneOutcome.BASE_ALONG_NORMAL


def test_on_the_dangerous_locus_errors_enter_with_their_square_root(scenes):
    made = scenes.plane_scene(3, n=12)
    foot = made.points.mean(axis=0)
    errors = []
    for noise in (1e-6, 1e-4):
        found = []
        for seed in range(12):
            along = [foot + 4 * made.normal, foot + 6 * made.normal]
            a, b = seen_from(scenes, made, along, noise, seed)
            normal = -scenes.looking(along[0], foot, 0.3) @ made.normal
            found.append(min(np.linalg.norm(s.normal - normal) for s in planar_orientations(a, b).solutions))
        errors.append(np.median(found))
    assert 5.0 < errors[1] / errors[0] < 20.0  # 10 for a hundredfold noise


def test_degenerate_plane_data_are_named(scenes):
    made = scenes.plane_scene(7, 0.001, n=10)
    a, b = bundles(made)
    assert planar_orientations(a.take(np.arange(3)), b.take(np.arange(3))).outcome is PlaneOutcome.TOO_FEW
    assert planar_orientations(a, a).outcome is PlaneOutcome.NO_BASE
    line = np.linspace(-1, 1, 10)[:, None] * [1.0, 0.2, 0.0]
    rng = np.random.default_rng(1)
    along = [image_bundle(scenes.image(line, *scenes.camera(rng, line), 0.001, rng), 0.001) for _ in range(2)]
    assert planar_orientations(*along).outcome is PlaneOutcome.COLLINEAR
    three = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0.3, 1, 0.0]])
    rays = [image_bundle(scenes.image(three, *scenes.camera(rng, three)), 0.001) for _ in range(2)]
    assert planar_orientations(*rays).outcome is PlaneOutcome.COLLINEAR
    solid = scenes.scene(3, 0.001, n=20)
    assert planar_orientations(*bundles(solid)).outcome is PlaneOutcome.NOT_PLANE
    shuffled = b.take(np.random.default_rng(2).permutation(10))
    assert planar_orientations(a, shuffled).outcome is PlaneOutcome.NOT_PLANE
    broken = made.rays[0].copy()
    broken[0] = 0.0
    assert planar_orientations(image_bundle(broken, 0.001), b).outcome is PlaneOutcome.INVALID
    assert shape_of_plane([a, shuffled]).outcome is PlaneOutcome.NOT_PLANE


def test_theodolites_see_a_plane_over_more_than_a_right_angle_to_all_sides(scenes):
    rng = np.random.default_rng(4)
    for _ in range(10):
        flat = np.column_stack([rng.uniform([-20, 10], [-10, 20], (12, 2)), np.zeros(12)])
        flat[:3, :2] = rng.uniform([3, -9], [9, -3], (3, 2))  # on the far side of the mean direction
        position, other = np.array([0.0, 0.0, 0.4]), np.array([-4.0, 3.0, 2.0])
        rotation, turn = scenes.random_rotation(rng), scenes.random_rotation(rng)
        a = direction_bundle((flat - position) @ rotation.T, 1e-6)
        b = direction_bundle((flat - other) @ turn.T, 1e-6)
        found = planar_orientations(a, b)
        base = rotation @ (other - position) / 0.4
        errors = [np.abs(s.rotation - turn @ rotation.T).max() + np.abs(s.base - base).max() for s in found.solutions]
        assert min(errors) < 1e-6


def test_hull_and_corners_of_a_field():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0], [0.5, 0.5], [0.5, 0.0]])
    assert sorted(convex_hull(square)) == [0, 1, 2, 3]
    inside = np.array([[0, 0, -1], [1, 0, -1], [0, 1, -1], [0.3, 0.3, -1.0]])
    one, two, three, four = corners_within(inside)
    crossing = np.cross(np.cross(one, two), np.cross(three, four))
    assert abs(crossing[2]) > 1e-3
