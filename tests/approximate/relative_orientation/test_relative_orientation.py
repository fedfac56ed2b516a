"""Relative orientation without approximate values: success, candidates, and every degenerate case by its
name."""

import numpy as np
import pytest

from mor.model.rotations import cross_matrix, exponential, rotation_from_angles
from mor.start.bundle import direction_bundle, image_bundle
from mor.start.image_pair import relative_orientation
from mor.start.relative_orientation import RelativeOutcome, SceneGeometry, adjust_coplanarity


def oriented(made, sigma=None):
    return relative_orientation(*(image_bundle(rays, sigma or made.sigma) for rays in made.rays))


def distance(found, base, rotation):
    return np.linalg.norm(found.base - base) + np.linalg.norm(found.rotation - rotation) / np.sqrt(2)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.005])
@pytest.mark.parametrize("kind", ["scene", "plane_scene"])
def test_every_random_scene_is_oriented(scenes, kind, noise):
    for seed in range(40):
        made = getattr(scenes, kind)(seed, noise)
        base, rotation = scenes.relative_truth(made.cameras)
        found = oriented(made)
        assert found.outcome in (RelativeOutcome.DETERMINED, RelativeOutcome.AMBIGUOUS)
        assert kind == "plane_scene" or found.outcome is RelativeOutcome.DETERMINED
        assert (found.geometry is SceneGeometry.PLANE) == (kind == "plane_scene")
        best = adjust_coplanarity(*(image_bundle(r, made.sigma) for r in made.rays), base, rotation)
        reached = min(distance(one, best.base, best.rotation) for one in (found, *found.alternatives))
        assert reached < 1e-5
        if noise == 0.0:
            assert min(distance(one, base, rotation) for one in (found, *found.alternatives)) < 1e-11


def test_exactly_eight_points_are_enough(scenes):
    for seed in range(30):
        made = scenes.scene(seed, n=8)
        found = oriented(made)
        assert found.outcome is RelativeOutcome.DETERMINED
        assert distance(found, *scenes.relative_truth(made.cameras)) < 1e-9


TURNED = np.diag([1.0, -1.0, -1.0])
"""Between image axes x right, y up, looking along −z, and those of OpenCV: y down, looking along +z."""


def opencv_pose(cv2, matrix, a, b):
    """Base and rotation in our axes that OpenCV takes from an essential matrix, with the points in front."""
    count, rotation, shift, _ = cv2.recoverPose(matrix, a, b, np.eye(3))
    assert count == len(a)
    return -TURNED @ rotation.T @ shift.ravel(), TURNED @ rotation @ TURNED


def test_without_noise_the_orientation_is_exact(scenes):
    for seed in range(100):
        made = scenes.scene(seed, n=20)
        assert distance(oriented(made), *scenes.relative_truth(made.cameras)) < 1e-12


def test_another_library_finds_the_same_orientation(scenes):
    """To 1e-9. OpenCV keeps the solution of one sample of five points, which alone can cost it that many digits:

    where its own distance from the truth is larger (1 scene in 20) its digits are the limit, not ours. The essential
    matrix of all points, from the linear system and decomposed by OpenCV, has no such limit.
    """
    cv2 = pytest.importorskip("cv2")
    sharp = 0
    for seed in range(40):
        made = scenes.scene(seed, n=20)
        found, truth = oriented(made), scenes.relative_truth(made.cameras)
        a, b = (rays[:, :2] / scenes.c * [1.0, -1.0] for rays in made.rays)
        sampled = opencv_pose(cv2, cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.999, 1e-8)[0][:3], a, b)
        own = np.linalg.norm(sampled[0] - truth[0]) + np.linalg.norm(sampled[1] - truth[1]) / np.sqrt(2)
        sharp += own < 1e-9
        assert distance(found, *sampled) < max(1e-9, 1.001 * own)
        rows = np.einsum("ni,nj->nij", np.c_[b, np.ones(20)], np.c_[a, np.ones(20)]).reshape(20, 9)
        linear = opencv_pose(cv2, np.linalg.svd(rows)[2][8].reshape(3, 3), a, b)
        assert distance(found, *linear) < 1e-12
    assert sharp >= 36


def test_another_library_decomposes_into_the_same_four_candidates(scenes):
    cv2 = pytest.importorskip("cv2")
    for seed in range(10):
        found = oriented(scenes.scene(seed, n=20))
        r1, r2, t = cv2.decomposeEssentialMat(TURNED @ found.unknowns.T @ TURNED)
        for rotation in (r1, r2):
            for sign in (1.0, -1.0):
                base = -sign * TURNED @ rotation.T @ t.ravel()
                candidates = [distance(c, base, TURNED @ rotation @ TURNED) for c in found.candidates]
                assert min(candidates) < 1e-9


def test_four_candidates_are_reported_with_their_counts(scenes):
    found = oriented(scenes.scene(5, 0.001, n=20))
    assert found.candidates[0].in_front_of_both == 20
    assert all(c.in_front_of_both == 0 for c in found.candidates[1:])
    np.testing.assert_allclose(found.candidates[0].base, found.base, atol=1e-12)
    np.testing.assert_allclose(found.candidates[0].rotation, found.rotation, atol=1e-12)
    assert np.all(found.front)


def test_angles_and_their_precision(scenes):
    made = scenes.scene(6, 0.002, n=30)
    found = oriented(made)
    np.testing.assert_allclose(rotation_from_angles(found.angles), found.rotation, atol=1e-12)
    assert 0.5 < found.sigma0 < 1.6
    assert len(found.residuals) == 30
    base, _ = scenes.relative_truth(made.cameras)
    assert np.all(np.abs(found.base - base) < 6 * found.sigma_base)
    assert np.all((found.sigma_angles > 1e-5) & (found.sigma_angles < 1e-2))
    assert found.base @ found.covariance[:3, :3] @ found.base == pytest.approx(0.0, abs=1e-15)


def test_different_cameras_and_units_may_be_mixed(scenes):
    made = scenes.scene(7, n=12)
    a, b = image_bundle(made.rays[0] * 250.0, 0.25), image_bundle(made.rays[1], 0.001)
    found = relative_orientation(a, b)
    assert distance(found, *scenes.relative_truth(made.cameras)) < 1e-10


def test_theodolites_all_round_are_oriented_like_images(scenes):
    rng = np.random.default_rng(3)
    for _ in range(10):
        points = rng.uniform(-10, 10, size=(15, 3))
        base = rng.normal(size=3)
        rotation = scenes.random_rotation(rng)
        found = relative_orientation(
            direction_bundle(points, 1e-5), direction_bundle((points - base) @ rotation.T, 1e-5)
        )
        assert found.outcome is RelativeOutcome.DETERMINED
        assert distance(found, base / np.linalg.norm(base), rotation) < 1e-9


def test_seven_points_are_too_few(scenes):
    assert oriented(scenes.scene(1, n=7)).outcome is RelativeOutcome.TOO_FEW


def test_unequal_bundles_and_missing_numbers_are_refused(scenes):
    rays = scenes.scene(1, n=10).rays
    a, b = (image_bundle(r, 0.001) for r in rays)
    assert relative_orientation(a, b.take(np.arange(9))).outcome is RelativeOutcome.INVALID
    broken = rays[0].copy()
    broken[3, 1] = np.nan
    assert relative_orientation(image_bundle(broken, 0.001), b).outcome is RelativeOutcome.INVALID
    broken[3] = 0.0
    assert relative_orientation(image_bundle(broken, 0.001), b).outcome is RelativeOutcome.INVALID


def test_points_in_a_line_are_named(scenes):
    rng = np.random.default_rng(2)
    points = np.linspace(-1, 1, 15)[:, None] * [0.3, 0.8, -0.4]
    rays = [scenes.image(points, *scenes.camera(rng, points), 0.001, rng) for _ in range(2)]
    found = relative_orientation(*(image_bundle(r, 0.001) for r in rays))
    assert found.outcome is RelativeOutcome.COLLINEAR


def test_identical_images_and_pure_rotation_have_no_base(scenes):
    rng = np.random.default_rng(3)
    made = scenes.scene(4, 0.001, n=20)
    a = image_bundle(made.rays[0], 0.001)
    assert relative_orientation(a, a).outcome is RelativeOutcome.IDENTICAL
    position, rotation = made.cameras[0]
    turn = exponential(np.array([0.1, -0.05, 0.8]))
    for shift in (0.0, 1e-5):
        rays = scenes.image(made.points, position + shift, turn @ rotation, 0.001, rng)
        found = relative_orientation(a, image_bundle(rays, 0.001))
        assert found.outcome is RelativeOutcome.NO_BASE
        np.testing.assert_allclose(found.rotation, turn, atol=1e-3)
        assert np.all(np.isnan(found.base))


def test_a_short_base_beyond_the_noise_is_unsure_not_wrong(scenes):
    unsure = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        made = scenes.scene(seed, 0.001, n=20)
        position, rotation = made.cameras[0]
        shift = rotation.T @ np.array([1.5e-3, 0.0, 0.0])
        rays = scenes.image(made.points, position + shift, exponential(np.full(3, 0.02)) @ rotation, 0.001, rng)
        found = relative_orientation(*(image_bundle(r, 0.001) for r in (made.rays[0], rays)))
        unsure += found.outcome in (RelativeOutcome.WEAK, RelativeOutcome.AMBIGUOUS)
        if found.outcome is RelativeOutcome.DETERMINED:
            assert np.max(found.sigma_base) < 0.1
            assert np.linalg.norm(found.base - [1.0, 0.0, 0.0]) < 0.5
    assert unsure > 2


def angles_to_base(made):
    """Sum of the angles at both centres between the direction of the base and a point."""
    (x1, _), (x2, _) = made.cameras
    base = (x2 - x1) / np.linalg.norm(x2 - x1)
    cosines = [(made.points - x) @ base / np.linalg.norm(made.points - x, axis=1) for x in (x1, x2)]
    return np.arccos(cosines).sum(axis=0)


def test_a_mirrored_image_is_named_where_the_pair_can_show_it(scenes):
    """Mirrored rays, twisted about the base, meet in front again if all angles add up to the same side of
    π."""
    shown = 0
    for seed in range(12):
        made = scenes.scene(seed, 0.001, n=25)
        mirrored = made.rays[1] * [-1.0, 1.0, 1.0]
        found = relative_orientation(*(image_bundle(r, 0.001) for r in (made.rays[0], mirrored)))
        side = np.mean(angles_to_base(made) < np.pi)
        if 0.1 < side < 0.9:
            shown += 1
            assert found.outcome is RelativeOutcome.MIRRORED
        elif side in (0.0, 1.0):
            assert found.outcome is RelativeOutcome.DETERMINED
    assert shown > 3


def test_wrong_focal_length_and_mismatched_identities_do_not_fit(scenes):
    made = scenes.scene(8, 0.001, n=25)
    a = image_bundle(made.rays[0], 0.001)
    longer = made.rays[1] * [1.0, 1.0, 1.3]
    assert relative_orientation(a, image_bundle(longer, 0.001)).outcome is RelativeOutcome.DOES_NOT_FIT
    shuffled = made.rays[1][np.random.default_rng(1).permutation(25)]
    assert relative_orientation(a, image_bundle(shuffled, 0.001)).outcome is RelativeOutcome.DOES_NOT_FIT


def on_critical_surface(seed, n=25):
    """Points for which a second, wrong orientation fulfils all coplanarity conditions as well."""
    rng = np.random.default_rng(seed)
    base, rotation = np.array([1.0, 0.0, 0.0]), exponential(np.array([0.05, 0.4, 0.1]))
    for _ in range(100):
        wrong = cross_matrix(rng.normal(size=3)) @ exponential(0.5 * rng.normal(size=3)).T
        rays = np.column_stack([rng.uniform(-0.5, 0.5, (1000, 2)), np.full(1000, -1.0)])
        # (s ray)ᵀ E' D (s ray − b) = 0 in s: the point of the quadric on the ray besides the centre.
        s = rays @ wrong @ rotation @ base / np.einsum("ni,ij,nj->n", rays, wrong @ rotation, rays)
        points = s[:, None] * rays
        q = (points - base) @ rotation.T
        good = (s > 0.5) & (s < 20.0) & np.all(np.abs(q[:, :2]) < -1.5 * q[:, 2:], axis=1)
        if np.sum(good) >= 4 * n:
            return base, rotation, points[good][:n], q[good][:n]
    raise RuntimeError("no critical surface in front of both cameras")


def test_a_critical_surface_is_named_and_still_solved(scenes):
    for seed in range(3):
        base, rotation, a, b = on_critical_surface(seed)
        rays = [scenes.image(p, np.zeros(3), np.eye(3)) for p in (a, b)]
        found = relative_orientation(*(image_bundle(r, 1e-4) for r in rays))
        assert found.geometry is SceneGeometry.CRITICAL_SURFACE
        assert found.outcome in (RelativeOutcome.DETERMINED, RelativeOutcome.AMBIGUOUS)
        assert min(distance(one, base, rotation) for one in (found, *found.alternatives)) < 1e-6
        assert found.singular_values[7] < 1.0 < found.singular_values[6]


def test_outcomes_speak(scenes):
    found = oriented(scenes.plane_scene(3, 0.001, n=20))
    assert "plane" in found.words
    assert not RelativeOutcome.TOO_FEW.usable


@pytest.mark.parametrize(("kind", "seed", "points"), [("plane_scene", 20498, None), ("scene", 20204, 8)])
def test_two_minima_are_two_however_near(scenes, kind, seed, points):
    """Two minima less than four standard deviations apart: the covariance of one knows nothing of the other."""
    made = getattr(scenes, kind)(seed, 0.005, n=points)
    a, b = (image_bundle(rays, made.sigma) for rays in made.rays)
    found = relative_orientation(a, b)
    assert found.outcome is RelativeOutcome.AMBIGUOUS
    (other,) = found.alternatives
    sigma = np.sqrt(np.linalg.eigvalsh(found.covariance)[-1])
    apart = np.hypot(
        np.linalg.norm(found.base - other.base),
        np.linalg.norm(found.rotation - other.rotation) / np.sqrt(2.0),
    )
    assert sigma < apart < 4.0 * sigma
    again = adjust_coplanarity(a, b, other.base, other.rotation)
    assert np.linalg.norm(again.rotation - other.rotation) < 1e-5
    base, rotation = scenes.relative_truth(made.cameras)
    strict = adjust_coplanarity(a, b, base, rotation)
    assert min(np.linalg.norm(one.rotation - strict.rotation) for one in (found, other)) < 1e-5
