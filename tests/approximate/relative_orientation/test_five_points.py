"""Five-point solutions: the conditions hold, the truth is among them, and a second library finds the same."""

import numpy as np
import pytest

from mor.start.relative_orientation import auxiliary_unknowns, conditions, five_point_unknowns


def samples(scenes, seeds, plane=False):
    a, b, truths = [], [], []
    for seed in seeds:
        made = (scenes.plane_scene if plane else scenes.scene)(seed, n=5)
        a.append(made.rays[0] / scenes.c)
        b.append(made.rays[1] / scenes.c)
        truths.append(auxiliary_unknowns(*scenes.relative_truth(made.cameras)))
    return np.stack(a), np.stack(b), truths


@pytest.mark.parametrize("plane", [False, True])
def test_truth_is_among_the_solutions(scenes, plane):
    a, b, truths = samples(scenes, range(40), plane)
    for k, truth in enumerate(truths):
        found = five_point_unknowns(a[k : k + 1], b[k : k + 1])
        distance = np.minimum(np.abs(found - truth).max((1, 2)), np.abs(found + truth).max((1, 2)))
        assert distance.min() < 1e-5


def test_solutions_are_compatible_and_fulfil_the_equations(scenes):
    a, b, _ = samples(scenes, [7])
    for ik in five_point_unknowns(a, b):
        assert np.abs(conditions(ik)).max() < 1e-7
        assert np.abs(np.einsum("ni,ik,nk->n", a[0], ik, b[0])).max() < 1e-9


def test_another_library_finds_the_same_solutions(scenes):
    cv2 = pytest.importorskip("cv2")
    a, b, _ = samples(scenes, range(20))
    for k in range(len(a)):
        mine = five_point_unknowns(a[k : k + 1], b[k : k + 1])
        # x right, y down, looking along +z; there p_bᵀ E p_a = 0.
        flip = np.array([1.0, -1.0])
        stacked, _ = cv2.findEssentialMat(a[k, :, :2] * flip, b[k, :, :2] * flip, np.eye(3))
        for other in stacked.reshape(-1, 3, 3):
            turned = np.diag([1.0, -1.0, -1.0])
            ik = (turned @ other @ turned).T
            ik *= np.sqrt(2.0) / np.linalg.norm(ik)
            distance = np.minimum(np.abs(mine - ik).max((1, 2)), np.abs(mine + ik).max((1, 2)))
            assert distance.min() < 1e-5


def test_no_solution_from_rays_that_are_all_equal():
    rays = np.ones((1, 5, 3))
    assert five_point_unknowns(rays, rays).shape[1:] == (3, 3)
