"""Killian's quadrilateral: cubic, roots, all solutions, against truth and the decomposition of the
collineation."""

from typing import NamedTuple

import numpy as np
import pytest

from mor.start.killian import (
    angles_in_image,
    corners_in_frame,
    cubic,
    cubic_roots,
    linking_constants,
    solve_quadrilateral,
)
from mor.start.relative_orientation import nearest_rotation


class Made(NamedTuple):
    halves: np.ndarray
    cos_alpha: float
    corners: np.ndarray
    cameras: list
    rays: list


def quadrilateral(scenes, seed, images=2, normal_free=0.25):
    """Diagonals of random halves that cross in the origin under a random angle, in the plane Z = 0."""
    rng = np.random.default_rng(seed)
    turn, alpha, halves = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 2.7), rng.uniform(0.3, 1.0, 4)
    one = np.array([np.cos(turn), np.sin(turn), 0.0])
    two = np.array([np.cos(turn + alpha), np.sin(turn + alpha), 0.0])
    corners = np.array([halves[0] * one, -halves[1] * one, halves[2] * two, -halves[3] * two])
    cameras = []
    while len(cameras) < images:
        direction = rng.normal(size=3)
        direction[2] = abs(direction[2])
        direction /= np.linalg.norm(direction)
        if direction[2] > normal_free:
            cameras.append(scenes.camera(rng, corners, direction))
    return Made(halves, np.cos(alpha), corners, cameras, [scenes.image(corners, *each) for each in cameras])


def collineation(made):
    """H of the bundles from the cameras themselves, D (1 − b nᵀ / d)."""
    (x1, d1), (x2, d2) = made.cameras
    normal = -d1[:, 2]
    distance = normal @ (d1 @ -x1)
    return d2 @ d1.T @ (np.eye(3) - np.outer(d1 @ (x2 - x1), normal) / distance)


@pytest.mark.parametrize("seed", range(30))
def test_truth_is_among_the_admissible_solutions(scenes, seed):
    made = quadrilateral(scenes, seed)
    unit = np.linalg.norm(made.cameras[0][0])
    solutions = [s for s in solve_quadrilateral(*made.rays) if s.admissible]
    errors = [np.abs(s.halves - made.halves / unit).max() + abs(s.cos_alpha - made.cos_alpha) for s in solutions]
    best = solutions[int(np.argmin(errors))]
    assert min(errors) < 1e-9
    assert best.r_b == pytest.approx(np.linalg.norm(made.cameras[1][0]) / unit, rel=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_roots_are_the_squared_stretches_of_the_ray_to_the_crossing(scenes, seed):
    """An equivalent form of the cubic: |H s|² / σ_i², with the collineation taken from the cameras."""
    made = quadrilateral(scenes, seed)
    angles = [angles_in_image(rays) for rays in made.rays]
    roots = cubic_roots(linking_constants(*angles))
    H = collineation(made)
    expected = np.sum((H @ angles[0].crossing) ** 2) / np.linalg.svd(H)[1] ** 2
    assert len(roots) == 3
    np.testing.assert_allclose(roots, np.sort(expected), rtol=1e-8)


def test_printed_sign_of_the_cubic_is_wrong(scenes):
    made = quadrilateral(scenes, 3)
    link = linking_constants(*(angles_in_image(rays) for rays in made.rays))
    true = (np.linalg.norm(made.cameras[1][0]) / np.linalg.norm(made.cameras[0][0])) ** 2
    right = cubic(link)
    printed = right.copy()
    h = link.k1 * link.k2 + link.k_a * link.c1 * link.c2
    printed[2] += 2.0 * (link.g1 * link.g2 - h**2)
    scale = np.abs(right).max()
    assert abs(np.polyval(right, true)) < 1e-12 * scale
    assert abs(np.polyval(printed, true)) > 1e-3 * scale


@pytest.mark.parametrize("seed", range(10))
def test_cubic_comes_from_the_unsquared_equation(scenes, seed):
    """R1 R2 − (K1 K2 − (1 − ϱ) R0)² = (1 − ϱ) times the cubic, for any ϱ."""
    link = linking_constants(*(angles_in_image(rays) for rays in quadrilateral(scenes, seed).rays))
    for rho in (0.2, 0.7, 1.5, 4.0):
        r0 = link.k1 * link.k2 + link.k_a * link.c1 * link.c2 - rho * link.k_b
        r1 = link.k1**2 - (1 - rho) * (link.g1 - rho)
        r2 = link.k2**2 - (1 - rho) * (link.g2 - rho)
        squared = r1 * r2 - (link.k1 * link.k2 - (1 - rho) * r0) ** 2
        scale = 1.0 + np.abs(cubic(link)).sum() * max(rho, 1.0) ** 4
        assert squared == pytest.approx((1 - rho) * np.polyval(cubic(link), rho), abs=1e-12 * scale)


@pytest.mark.parametrize("seed", range(30))
def test_all_solutions_are_those_of_the_decomposed_collineation(scenes, seed):
    cv2 = pytest.importorskip("cv2")
    made = quadrilateral(scenes, seed)
    H = collineation(made)
    _, rotations, shifts, normals = cv2.decomposeHomographyMat(H, np.eye(3))
    solutions = solve_quadrilateral(*made.rays)
    assert len(solutions) == 2
    matched = set()
    for solution in solutions:
        a, b = (corners_in_frame(made.rays[image], solution, image) for image in (0, 1))
        rotation = nearest_rotation((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
        normal = np.linalg.svd(a - a.mean(axis=0))[2][2]
        normal /= normal @ a[0]  # n · X = 1, in units of OS
        shift = b[0] - rotation @ a[0]
        for k in range(len(rotations)):
            same = np.abs(rotations[k] - rotation).max() < 1e-9
            plane = np.outer(shifts[k], normals[k])
            if same and np.abs(plane - np.outer(shift, normal)).max() < 1e-9 * max(1.0, np.abs(plane).max()):
                matched.add(k)
    # Each of the two stands for a pair that differs in the sign of shift and normal.
    assert matched == {0, 1, 2, 3}


def test_solutions_hidden_from_an_image_are_not_admissible(scenes):
    counts = {
        len([s for s in solve_quadrilateral(*quadrilateral(scenes, seed).rays) if s.admissible]) for seed in range(30)
    }
    assert counts == {1, 2}


def test_equal_distances_are_no_special_case(scenes):
    """ϱ = 1 makes (8a) linear; the factor 1 − ϱ has been divided out of the cubic."""
    made = quadrilateral(scenes, 1)
    (x1, _), (x2, _) = made.cameras
    x2 = x2 * np.linalg.norm(x1) / np.linalg.norm(x2)
    turned = scenes.looking(x2, np.zeros(3), 0.7)
    rays = [made.rays[0], scenes.image(made.corners, x2, turned)]
    halves = made.halves / np.linalg.norm(x1)
    assert min(np.abs(s.halves - halves).max() for s in solve_quadrilateral(*rays)) < 1e-7


def test_corners_that_make_no_quadrilateral_leave_no_solution(scenes):
    rays = quadrilateral(scenes, 1).rays
    assert solve_quadrilateral(rays[0], rays[1][[0, 2, 1, 3]]) == []
    assert solve_quadrilateral(rays[0][[0, 2, 1, 3]], rays[1][[0, 2, 1, 3]]) == []
    collapsed = np.tile(rays[0][0], (4, 1))
    assert solve_quadrilateral(collapsed, rays[1]) == []


def test_cubics_of_two_pairs_have_no_common_root(scenes):
    """The paper subtracts the cubics of two pairs; their unknowns are different ratios of distances."""
    made = quadrilateral(scenes, 8, images=3)
    angles = [angles_in_image(rays) for rays in made.rays]
    roots = [cubic_roots(linking_constants(angles[0], other)) for other in angles[1:]]
    assert np.min(np.abs(roots[0][:, None] - roots[1][None, :])) > 1e-3
