"""Wrong pairs are found and left out, the same ones every time."""

import numpy as np
import pytest

from mor.start.bundle import image_bundle
from mor.start.image_pair import robust_relative_orientation
from mor.start.relative_orientation import RelativeOutcome
from tests.selection import slow_after


def spoilt(scenes, seed, kind, part, noise=0.002):
    rng = np.random.default_rng(seed + 1000)
    made = getattr(scenes, kind)(seed, noise, n=int(rng.integers(20, 51)))
    n = len(made.points)
    wrong = rng.choice(n, max(1, int(part * n)), replace=False)
    made.rays[1][wrong, :2] = rng.uniform(-1, 1, (len(wrong), 2)) * [18.0, 12.0]
    return made, wrong


@pytest.mark.parametrize("kind", slow_after(1, ["scene", "plane_scene"]))
@pytest.mark.parametrize("part", slow_after(1, [0.3, 0.05]))
def test_wrong_pairs_are_left_out(scenes, kind, part):
    for seed in range(8):
        made, wrong = spoilt(scenes, seed, kind, part)
        base, rotation = scenes.relative_truth(made.cameras)
        result = robust_relative_orientation(*(image_bundle(r, made.sigma) for r in made.rays))
        found = result.orientation
        assert found.outcome in (RelativeOutcome.DETERMINED, RelativeOutcome.AMBIGUOUS)
        error = min(
            np.linalg.norm(one.base - base) + np.linalg.norm(one.rotation - rotation)
            for one in (found, *found.alternatives)
        )
        assert error < 0.03
        assert np.sum(result.agreeing[wrong]) <= 1
        assert np.sum(~result.agreeing) <= len(wrong) + 1


@pytest.mark.slow
def test_one_pair_off_a_plane_does_not_decide_between_its_orientations(scenes):
    """The pair is made to fit the wrong one of two orientations."""
    checked = 0
    for seed in range(30):
        made = scenes.plane_scene(seed, 0.001, n=40)
        made.rays[1][1, :2] = [17.0, -11.0]  # a wrong pair that is seen to be wrong
        a, b = (image_bundle(r, made.sigma) for r in made.rays)
        found = robust_relative_orientation(a, b).orientation
        if found.outcome is not RelativeOutcome.AMBIGUOUS:
            continue
        _, rotation = scenes.relative_truth(made.cameras)
        every = sorted((found, *found.alternatives), key=lambda one: np.linalg.norm(one.rotation - rotation))
        wrong = every[-1]
        point = 0.3 * np.array([1.0, 2.0, -40.0]) + wrong.base  # in front of both? only then it is a case
        seen = wrong.rotation @ (point - wrong.base)
        if seen[2] > -0.1:
            continue
        made.rays[0][0] = point * (-scenes.c / point[2])
        made.rays[1][0] = seen * (-scenes.c / seen[2])
        again = robust_relative_orientation(*(image_bundle(r, made.sigma) for r in made.rays)).orientation
        checked += 1
        assert again.outcome is RelativeOutcome.AMBIGUOUS
        both = (again, *again.alternatives)
        assert min(np.linalg.norm(one.rotation - rotation) for one in both) < 0.05
    assert checked > 1


def test_without_wrong_pairs_nothing_is_sampled(scenes):
    made = scenes.scene(2, 0.001, n=30)
    result = robust_relative_orientation(*(image_bundle(r, made.sigma) for r in made.rays))
    assert result.samples == 0
    assert np.all(result.agreeing)


def test_same_input_gives_the_same_result(scenes):
    made, _ = spoilt(scenes, 3, "scene", 0.2)
    bundles = [image_bundle(r, made.sigma) for r in made.rays]
    first, second = (robust_relative_orientation(*bundles) for _ in range(2))
    np.testing.assert_array_equal(first.orientation.rotation, second.orientation.rotation)
    np.testing.assert_array_equal(first.agreeing, second.agreeing)


def test_mismatched_identities_throughout_are_refused(scenes):
    made = scenes.scene(5, 0.001, n=25)
    shuffled = made.rays[1][np.random.default_rng(1).permutation(25)]
    result = robust_relative_orientation(image_bundle(made.rays[0], 0.001), image_bundle(shuffled, 0.001))
    assert not result.orientation.outcome.usable
    assert not np.any(result.agreeing)


def test_degenerate_data_keep_their_name(scenes):
    made = scenes.scene(6, 0.001, n=25)
    a = image_bundle(made.rays[0], 0.001)
    assert robust_relative_orientation(a, a).orientation.outcome is RelativeOutcome.IDENTICAL


def test_a_mirrored_bundle_is_not_taken_for_wrong_pairs(scenes):
    made = scenes.scene(0, 0.001, n=25)
    rng = np.random.default_rng(1)
    made.rays[1][:2, :2] = rng.uniform(-1, 1, (2, 2)) * [18.0, 12.0]
    mirrored = image_bundle(made.rays[1] * [-1.0, 1.0, 1.0], 0.001)
    result = robust_relative_orientation(image_bundle(made.rays[0], 0.001), mirrored)
    assert result.orientation.outcome is RelativeOutcome.MIRRORED
    assert not np.any(result.agreeing)
