"""Rays of many points, and frames that settle together, against truth."""

import numpy as np
import pytest

from mor.model.rotations import rotate
from mor.start.intersection import meet, posed_frames
from mor.start.local_adjustment import settle
from mor.start.part import Frame, empty_part, sightings
from mor.start.seeds import WINDOW, common_pairs


def frames_of(made, wrong=0):
    """Frames of a scene, each ray with a target height of 0.25, the first ``wrong`` rays of the first frame astray."""
    frames = []
    lifted = made.points + np.array([0.0, 0.0, 0.25])
    for number, (place, rotation) in enumerate(made.cameras):
        rays = (lifted - place) @ rotation.T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        if number == 0:
            rays[:wrong] = rays[:wrong] @ rotate(np.eye(3), np.array([0.1, 0.2, 0.0]))
        count = len(rays)
        frames.append(
            Frame(
                name=f"image {number}",
                position=0,
                rotation=0,
                height=0,
                eccentricity=0,
                relative=None,
                points=np.arange(count),
                heights=np.full(count, 0.25),
                rays=rays,
                sigma=np.full(count, 1e-4),
                offset=np.zeros(4),
                up=np.full(3, np.nan),
            )
        )
    return frames


@pytest.mark.parametrize("images", [2, 4])
def test_points_of_wrong_rays_or_none_are_not_good(scenes, images):
    for seed in range(10):
        made = scenes.scene(seed, n=20, images=images)
        frames = frames_of(made, wrong=5)
        seen = sightings(frames, 25)
        posed = posed_frames(dict(enumerate(made.cameras[:images])), images)
        found = meet(np.arange(25), seen, posed, 5e-4)
        assert found.good[5:20].all()
        assert not found.good[20:].any()
        np.testing.assert_allclose(found.X[5:20], made.points[5:], atol=1e-10)


def test_targets_at_several_heights_over_a_point_tell_one_place(scenes):
    """The mark itself from one station, a target above it from another: the rays do not meet, the point is one."""
    made = scenes.scene(1, n=12, images=3)
    poses = dict(enumerate(made.cameras))
    frames = []
    for number, frame in enumerate(frames_of(made)):
        heights = np.full(12, 0.25 * number)
        away = made.points + np.outer(heights, [0.0, 0.0, 1.0]) - poses[number][0]
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        frames.append(frame._replace(rays=away @ poses[number][1].T, heights=heights))
    found = meet(np.arange(12), sightings(frames, 12), posed_frames(poses, 3), 5e-4)
    assert found.good.all()
    np.testing.assert_allclose(found.X, made.points, atol=1e-9)


def test_one_wrong_ray_does_not_draw_a_point_away_from_the_others(scenes):
    """Points of four rays or more: the mean of all rays lies where none agrees."""
    for seed in range(10):
        made = scenes.scene(seed, n=20, images=4)
        seen = sightings(frames_of(made, wrong=5), 20)
        found = meet(np.arange(20), seen, posed_frames(dict(enumerate(made.cameras)), 4), 5e-4)
        assert found.good.all()
        np.testing.assert_allclose(found.X, made.points, atol=1e-9)


def test_frames_without_a_pose_have_no_say(scenes):
    made = scenes.scene(1, n=12, images=3)
    seen = sightings(frames_of(made), 12)
    poses = {0: made.cameras[0], 2: made.cameras[2]}
    found = meet(np.arange(12), seen, posed_frames(poses, 3), 5e-4)
    np.testing.assert_allclose(found.X, made.points, atol=1e-10)
    assert not meet(np.arange(12), seen, posed_frames({1: made.cameras[1]}, 3), 5e-4).good.any()


def test_pairs_do_not_grow_with_the_square_of_the_frames(scenes):
    """Ten points that all frames see: pairs within windows only, and still every frame in many pairs."""
    count = 10 * WINDOW
    one = frames_of(scenes.scene(1, n=10))[0]
    pairs = common_pairs(sightings([one] * count, 10))
    assert len(pairs.first) == 10 * WINDOW * (WINDOW - 1) // 2
    assert len(np.unique(np.concatenate([pairs.first, pairs.second]))) == count
    assert (pairs.first < pairs.second).all()


def block(rng, held=3):
    """Ten frames over a field of points in a row, the first ``held`` posed exactly, the others a little wrong."""
    points = np.column_stack([rng.uniform(-2, 20, 300), rng.uniform(-4, 4, 300), rng.uniform(0, 1, 300)])
    frames, poses = [], {}
    for number in range(10):
        place, D = (
            np.array([2.0 * number, rng.normal(0, 0.1), 10.0]),
            rotate(np.eye(3), rng.normal(0, 0.05, 3)),
        )
        star = (points - place) @ D.T
        seen = np.flatnonzero(np.abs(star[:, 0]) < 4.5)
        rays = star[seen] / np.linalg.norm(star[seen], axis=1, keepdims=True)
        count = len(seen)
        frames.append(
            Frame(
                f"image {number}",
                300 + number,
                0,
                0,
                0,
                None,
                seen,
                np.zeros(count),
                rays,
                np.full(count, 1e-4),
                np.zeros(4),
                np.full(3, np.nan),
            )
        )
        poses[number] = (place, D)
    wrong = {
        k: (place + 0.01, rotate(D, np.full(3, 2e-3))) if k >= held else (place, D) for k, (place, D) in poses.items()
    }
    return frames, poses, wrong


@pytest.mark.parametrize("given", [False, True])
def test_frames_settle_to_the_truth_together(given):
    """Tied to frames that are held, or to given positions alone: the points are only as good as the wrong poses."""
    frames, truth, wrong = block(np.random.default_rng(4), held=0 if given else 3)
    seen = sightings(frames, 310)
    part = empty_part(310)
    part.poses = dict(wrong)
    for number in range(10 if given else 0):
        part.points[300 + number] = truth[number][0]
        part.fixed[300 + number], part.sigma[300 + number] = True, 1e-4
    poses = posed_frames(part.poses, 10)
    moving = list(range(0 if given else 3, 10))
    for _ in range(8):
        part.points[:300] = meet(np.arange(300), seen, poses, 2e-3).X
        settle(part, frames, seen, poses, moving)
    for number in moving:
        np.testing.assert_allclose(part.poses[number][0], truth[number][0], atol=1e-5)
        np.testing.assert_allclose(part.poses[number][1], truth[number][1], atol=1e-5)


def test_a_frame_whose_rays_all_pass_by_stays_where_it_is():
    """Nothing tells of it; its block of the normal equations is zero, and the others settle all the same."""
    frames, truth, wrong = block(np.random.default_rng(4), held=3)
    seen = sightings(frames, 310)
    part = empty_part(310)
    part.poses = wrong | {9: (wrong[9][0] + 500.0, wrong[9][1])}
    poses = posed_frames(part.poses, 10)
    stays = part.poses[9]
    for _ in range(8):
        known = posed_frames({k: pose for k, pose in part.poses.items() if k != 9}, 10)
        part.points[:300] = meet(np.arange(300), seen, known, 2e-3).X
        settle(part, frames, seen, poses, list(range(3, 10)))
    np.testing.assert_allclose(part.poses[9][0], stays[0], rtol=1e-12)
    np.testing.assert_allclose(part.poses[9][1], stays[1], atol=1e-12)
    for number in range(3, 8):
        np.testing.assert_allclose(part.poses[number][0], truth[number][0], atol=1e-5)


def test_rays_are_found_by_their_points():
    frames, _, _ = block(np.random.default_rng(4), held=3)
    seen = sightings(frames, 310)
    for point in (0, 150, 299, 305):
        rays = seen.of_points(np.array([point]))
        assert (seen.point[rays] == point).all()
        assert seen.frame[rays].tolist() == [k for k, frame in enumerate(frames) if point in frame.points]
        for ray, number in zip(rays, seen.frame[rays], strict=True):
            own = frames[number].rays[frames[number].points == point][0]
            np.testing.assert_array_equal(seen.rays[ray], own)
