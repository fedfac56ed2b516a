"""Point elimination against the dense normal equations of all unknowns, and both forms of it together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.linalg import compilation
from mor.linalg.block_matrix import structure_from_cliques
from mor.linalg.cholesky import factorise
from mor.linalg.selected_inverse import selected_inverse
from mor.linalg.symbolic import analyse
from mor.solve import elimination as point_reference
from mor.solve import product_kernels as point_store
from mor.solve.clique_kernels import Pattern
from mor.solve.elimination import Rays, accumulate, back_substitute, cofactors, empty_reduced_system, split
from mor.solve.product_kernels import begin_gathering

CAMERA = 4  # unknowns shared by all images; then one position (3) and one attitude (3) for each image
WIDTH = CAMERA + 6


def simulate(points=40, images=9, seed=0, fewest=3, camera_last=False, mixed=False):
    """Return rays with random Jacobians, and the pattern of the reduced system.

    The camera is one block before (or behind) the blocks of the images; one component of every third
    position is fixed, so that blocks have different sizes. Columns may be ``mixed``: then a block comes again behind
    others, as those of the knots of trajectories do.
    """
    rng = np.random.default_rng(seed)
    degree = rng.integers(fewest, min(7, images + 1), points)
    pointers = np.concatenate(([0], np.cumsum(degree)))
    image = np.concatenate([rng.permutation(images)[:d] for d in degree])
    sizes = np.array([2 if b % 6 == 0 else 3 for b in range(2 * images)])
    sizes = np.append(sizes, CAMERA) if camera_last else np.insert(sizes, 0, CAMERA)
    camera, shift = (2 * images, 0) if camera_last else (0, 1)
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    columns = np.full((image.size, WIDTH), -1)
    columns[:, :CAMERA] = offsets[camera] + np.arange(CAMERA)
    for i, number in enumerate(image):
        for part in range(2):
            block = 2 * number + part + shift
            first = CAMERA + 3 * part + 3 - sizes[block]  # a fixed component stands first and stays at -1
            columns[i, first : CAMERA + 3 * part + 3] = np.arange(*offsets[block : block + 2])
    blocks = np.stack([np.full(image.size, camera), 2 * image + shift, 2 * image + 1 + shift], 1)
    structure = structure_from_cliques(sizes, 3 * pointers, blocks.ravel())
    if mixed:
        columns = columns[:, rng.permutation(WIDTH)]
    of_frames, frame = np.unique(columns, axis=0, return_inverse=True)
    rays = Rays(
        rng.normal(size=(image.size, 2)),
        rng.normal(size=(image.size, 2, 3)),
        rng.normal(size=(image.size, 2, WIDTH)),
        of_frames,
        pointers,
        frame.ravel(),
    )
    return rays, structure


def dense_design(rays, structure):
    """Return the whole design matrix (2n, reduced unknowns + 3p), written entry by entry."""
    n = structure.unknowns
    design = np.zeros((2 * rays.rays, n + 3 * rays.points))
    for p in range(rays.points):
        for i in range(rays.point_pointers[p], rays.point_pointers[p + 1]):
            for c in range(2):
                design[2 * i + c, n + 3 * p : n + 3 * p + 3] = rays.by_point[i, c]
                for k, column in enumerate(rays.columns[rays.frame[i]]):
                    if column >= 0:
                        design[2 * i + c, column] = rays.by_others[i, c, k]
    return design


def cofactors_by(rays, inverse):
    """Return the cofactors of the rays, the selected inverse split for them alone."""
    return cofactors(rays, split(rays.columns, inverse))


def with_camera_behind(rays):
    """Return the rays with the columns of the camera, which all frames have, behind those of the images."""
    columns, by_others = (np.roll(array, -CAMERA, axis=-1) for array in (rays.columns, rays.by_others))
    return replace(rays, columns=columns, by_others=np.ascontiguousarray(by_others))


def chunk(rays, first, last):
    part = slice(rays.point_pointers[first], rays.point_pointers[last])
    pointers = rays.point_pointers[first : last + 1] - rays.point_pointers[first]
    return replace(
        rays,
        residual=rays.residual[part],
        by_point=rays.by_point[part],
        by_others=rays.by_others[part],
        point_pointers=pointers,
        frame_of_ray=rays.frame[part],
    )


def without_compiler(monkeypatch):
    monkeypatch.setattr(compilation, "available", False)


@pytest.fixture(params=[pytest.param("compiled", marks=pytest.mark.kernels), "dense", "pairs"])
def either_form(request, monkeypatch):
    if request.param != "compiled":
        without_compiler(monkeypatch)
    if request.param == "pairs":
        monkeypatch.setattr(point_reference, "_MOST_ENTRIES", 0)
        monkeypatch.setattr(point_reference, "_PAIRS_SORTED", 50)
        monkeypatch.setattr(point_reference, "_PAIRS_AT_A_TIME", 20)
    return request.param


@pytest.mark.usefixtures("either_form")
@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("camera_last", [False, True])
@pytest.mark.parametrize("mixed", [False, True])
def test_reduced_system_is_the_schur_complement(damping, camera_last, mixed):
    rays, structure = simulate(camera_last=camera_last, mixed=mixed)
    reduced = empty_reduced_system(structure)
    held = accumulate(rays, reduced, damping).held
    design = dense_design(rays, structure)
    n = structure.unknowns
    normal, right = design.T @ design, -design.T @ rays.residual.ravel()
    points = np.arange(n, n + 3 * rays.points)
    normal[points, points] *= 1.0 + damping
    eliminated = np.linalg.solve(normal[n:, n:], np.column_stack([normal[n:, :n], right[n:]]))
    expected = normal[:n, :n] - normal[:n, n:] @ eliminated[:, :n]
    np.testing.assert_allclose(reduced.matrix.to_dense(), expected, atol=1e-10)
    np.testing.assert_allclose(reduced.right_hand_side, right[:n] - normal[:n, n:] @ eliminated[:, n], atol=1e-10)
    np.testing.assert_allclose(reduced.diagonal, np.diag(normal)[:n], rtol=1e-12)
    assert held.shape == (rays.points, 3)
    assert not held.any()


@pytest.mark.usefixtures("either_form")
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_both_steps_together_solve_the_whole_system(damping):
    rays, structure = simulate(seed=1)
    reduced = empty_reduced_system(structure)
    accumulate(rays, reduced, damping)
    design = dense_design(rays, structure)
    n = structure.unknowns
    normal = design.T @ design
    points = np.arange(n, n + 3 * rays.points)
    normal[points, points] *= 1.0 + damping
    expected = np.linalg.solve(normal, -design.T @ rays.residual.ravel())
    step = np.linalg.solve(reduced.matrix.to_dense(), reduced.right_hand_side)
    np.testing.assert_allclose(step, expected[:n], atol=1e-8)
    np.testing.assert_allclose(back_substitute(rays, step, damping).ravel(), expected[n:], atol=1e-8)


@pytest.mark.usefixtures("either_form")
@pytest.mark.parametrize("camera_last", [False, True])
@pytest.mark.parametrize("order", ["camera first", "camera behind", "mixed"])
def test_cofactors_equal_those_of_the_inverse_of_the_whole_system(order, camera_last):
    rays, structure = simulate(seed=2, images=25, points=80, camera_last=camera_last, mixed=order == "mixed")
    if order == "camera behind":
        rays = with_camera_behind(rays)
    reduced = empty_reduced_system(structure)
    accumulate(rays, reduced)
    scale = 1.0 / np.sqrt(reduced.diagonal)
    factor = factorise(reduced.matrix.scaled(scale), analyse(structure))
    of_points, of_rays, shares = cofactors_by(rays, selected_inverse(factor).scaled(scale))
    design = dense_design(rays, structure)
    n = structure.unknowns
    inverse = np.linalg.inv(design.T @ design)
    expected = inverse[n:, n:].reshape(rays.points, 3, rays.points, 3)
    expected = expected[np.arange(rays.points), :, np.arange(rays.points)]
    np.testing.assert_allclose(of_points, expected, rtol=1e-7, atol=1e-9)
    whole = (design @ inverse @ design.T).reshape(rays.rays, 2, rays.rays, 2)
    own = whole[np.arange(rays.rays), :, np.arange(rays.rays)]
    np.testing.assert_allclose(of_rays, own, rtol=1e-7, atol=1e-9)
    of_all_points = np.where(np.arange(design.shape[1]) >= n, design, 0.0)  # a row has one point
    into_points = np.sum((of_all_points @ inverse) * design, axis=1).reshape(rays.rays, 2)
    np.testing.assert_allclose(shares, into_points, rtol=1e-7, atol=1e-9)
    assert np.trace(own, axis1=1, axis2=2).sum() == pytest.approx(
        design.shape[1], rel=1e-9
    )  # the trace of a projection is its rank


@pytest.mark.usefixtures("either_form")
def test_chunks_of_whole_points_give_what_one_call_gives():
    rays, structure = simulate(seed=3)
    whole, pieces = empty_reduced_system(structure), empty_reduced_system(structure)
    accumulate(rays, whole)
    parts = [chunk(rays, first, last) for first, last in [(0, 1), (1, 17), (17, 17), (17, 40)]]
    for part in parts:
        accumulate(part, pieces)
    np.testing.assert_allclose(pieces.matrix.values, whole.matrix.values, atol=1e-11)
    np.testing.assert_allclose(pieces.right_hand_side, whole.right_hand_side, atol=1e-11)
    step = np.random.default_rng(0).normal(size=structure.unknowns)
    steps = np.concatenate([back_substitute(part, step) for part in parts])
    np.testing.assert_allclose(steps, back_substitute(rays, step), atol=1e-12)


@pytest.mark.usefixtures("either_form")
def test_coordinates_the_rays_do_not_determine_are_held_and_harm_nothing():
    rays, structure = simulate(seed=4)
    by_point = rays.by_point.copy()
    first, second = (slice(*rays.point_pointers[p : p + 2]) for p in (5, 11))
    by_point[first, :, 2] = 2.0 * by_point[first, :, 0] - by_point[first, :, 1]  # a null direction
    by_point[second, :, 1] = 0.0  # does not act at all
    rays = replace(rays, by_point=by_point)
    reduced = empty_reduced_system(structure)
    held = accumulate(rays, reduced).held
    assert np.argwhere(held).tolist() == [[5, 2], [11, 1]]
    design = dense_design(rays, structure)
    n = structure.unknowns
    kept = np.setdiff1d(np.arange(design.shape[1]), [n + 3 * 5 + 2, n + 3 * 11 + 1])
    normal = design[:, kept].T @ design[:, kept]
    expected = np.zeros(design.shape[1])
    expected[kept] = np.linalg.solve(normal, -design[:, kept].T @ rays.residual.ravel())
    step = np.linalg.solve(reduced.matrix.to_dense(), reduced.right_hand_side)
    np.testing.assert_allclose(step, expected[:n], atol=1e-8)
    np.testing.assert_allclose(back_substitute(rays, step).ravel(), expected[n:], atol=1e-8)
    scale = 1.0 / np.sqrt(reduced.diagonal)
    inverse = selected_inverse(factorise(reduced.matrix.scaled(scale), analyse(structure))).scaled(scale)
    of_points, of_rays, _ = cofactors_by(rays, inverse)
    assert not of_points[5, 2].any()
    assert not of_points[11, :, 1].any()
    assert np.trace(of_rays, axis1=1, axis2=2).sum() == pytest.approx(kept.size, rel=1e-9)


def test_points_with_a_single_ray_have_one_coordinate_held():
    rays, structure = simulate(seed=5, fewest=1)
    held = accumulate(rays, empty_reduced_system(structure)).held
    single = np.diff(rays.point_pointers) == 1
    assert single.any()
    assert np.array_equal(held.sum(axis=1), single.astype(int))


@pytest.mark.kernels
@pytest.mark.parametrize("images", [4, 20])
def test_compiled_and_plain_form_agree(images, monkeypatch):
    """With four images many points share their unknowns; with twenty hardly any do."""
    rays, structure = simulate(points=300, images=images, seed=6, fewest=1)
    step = np.random.default_rng(1).normal(size=structure.unknowns)
    results = []
    for _ in range(2):
        reduced = empty_reduced_system(structure)
        noted = accumulate(rays, reduced, 0.01)
        results.append(
            (
                reduced.matrix.values,
                reduced.right_hand_side,
                reduced.diagonal,
                reduced.gradient,
                *noted,
                back_substitute(rays, step, 0.01),
                *cofactors_by(rays, reduced.matrix),
            )
        )
        without_compiler(monkeypatch)
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * max(1.0, abs(other).max()))


@pytest.mark.kernels
@pytest.mark.parametrize("width", [1, 3, 6])
def test_rays_of_few_columns(width, monkeypatch):
    rays, structure = simulate(seed=3)
    few = replace(rays, by_others=rays.by_others[:, :, :width].copy(), columns=rays.columns[:, :width].copy())
    found = []
    for available in (True, False):
        monkeypatch.setattr(compilation, "available", available)
        reduced = empty_reduced_system(structure)
        accumulate(few, reduced, 0.1)
        found.append((reduced.matrix.values, reduced.right_hand_side, reduced.diagonal, reduced.gradient))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * abs(other).max())


@pytest.mark.kernels
def test_more_points_than_the_store_holds_give_what_small_chunks_give(monkeypatch):
    """The large call fills the store and several strips of the reduced system, the small ones never do."""
    rays, structure = simulate(points=6_000, images=150, seed=8)
    unknowns = 6 * np.diff(rays.point_pointers).mean() * 17 / 18 + CAMERA
    assert 3 * rays.points * unknowns > 1.1 * point_store.SMALL_STORE
    assert structure.position[-1] > 1.5 * point_store.STRIP
    whole, pieces = empty_reduced_system(structure), empty_reduced_system(structure)
    accumulate(rays, whole)
    parts = [chunk(rays, first, first + 400) for first in range(0, 6_000, 400)]
    for part in parts:
        accumulate(part, pieces)
    size = abs(whole.matrix.values).max()
    np.testing.assert_allclose(pieces.matrix.values, whole.matrix.values, atol=1e-12 * size)
    np.testing.assert_allclose(pieces.right_hand_side, whole.right_hand_side, atol=1e-9)
    results = [cofactors_by(part, whole.matrix) for part in parts]
    for k, together in enumerate(cofactors_by(rays, whole.matrix)):
        np.testing.assert_allclose(together, np.concatenate([result[k] for result in results]), rtol=1e-9)
    small = chunk(rays, 0, 60)
    without_compiler(monkeypatch)
    for one, other in zip(cofactors_by(small, whole.matrix), results[0], strict=True):
        np.testing.assert_allclose(one, other[: len(one)], rtol=1e-9)


@pytest.mark.usefixtures("either_form")
def test_rays_without_unknowns_of_their_own_determine_their_points_alone():
    rays, structure = simulate(seed=9)
    fixed = np.full_like(rays.columns, -1)
    rays = replace(rays, columns=fixed)
    reduced = empty_reduced_system(structure)
    accumulate(rays, reduced)
    assert not reduced.matrix.values.any()
    assert not reduced.right_hand_side.any()
    steps = back_substitute(rays, np.ones(structure.unknowns))
    of_points, of_rays, _ = cofactors_by(rays, reduced.matrix)
    for p in range(rays.points):
        part = slice(*rays.point_pointers[p : p + 2])
        design = rays.by_point[part].reshape(-1, 3)
        inverse = np.linalg.inv(design.T @ design)
        np.testing.assert_allclose(steps[p], -inverse @ design.T @ rays.residual[part].ravel(), atol=1e-9)
        np.testing.assert_allclose(of_points[p], inverse, rtol=1e-8, atol=1e-9)
        whole = (design @ inverse @ design.T).reshape(-1, 2, design.shape[0] // 2, 2)
        for i, own in enumerate(of_rays[part]):
            np.testing.assert_allclose(own, whole[i, :, i], atol=1e-9)


@pytest.mark.usefixtures("either_form")
def test_a_pattern_without_a_pair_that_meets_is_refused():
    rays, structure = simulate(seed=7)
    alone = structure_from_cliques(structure.sizes, [0], [])
    with pytest.raises(ValueError, match="lacks a pair"):
        accumulate(rays, empty_reduced_system(alone))
    with pytest.raises(ValueError, match="lacks a pair"):
        cofactors_by(rays, empty_reduced_system(alone).matrix)


def test_rays_that_do_not_fit_together_are_refused():
    rays, structure = simulate(seed=10)
    with pytest.raises(ValueError, match="shapes"):
        replace(rays, residual=rays.residual[1:])
    with pytest.raises(ValueError, match="pointers"):
        replace(rays, point_pointers=rays.point_pointers[:-1])
    with pytest.raises(ValueError, match="frames beyond"):
        replace(rays, frame_of_ray=rays.frame + 1)
    beyond = np.where(rays.columns >= 0, rays.columns + structure.unknowns, -1)
    rays = replace(rays, columns=beyond)
    with pytest.raises(ValueError, match="beyond"):
        accumulate(rays, empty_reduced_system(structure))


@pytest.mark.usefixtures("either_form")
def test_frames_may_be_named_once_or_ray_by_ray():
    rays, structure = simulate(seed=12)
    spread = replace(rays, columns=rays.columns_of_rays, frame_of_ray=None)
    assert len(spread.columns) > 10 * len(rays.columns)
    one, other = empty_reduced_system(structure), empty_reduced_system(structure)
    accumulate(rays, one)
    accumulate(spread, other)
    np.testing.assert_allclose(one.matrix.values, other.matrix.values, atol=1e-11)
    np.testing.assert_allclose(one.right_hand_side, other.right_hand_side, atol=1e-11)
    for a, b in zip(cofactors_by(rays, one.matrix), cofactors_by(spread, one.matrix), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(a).max())


def test_the_layout_of_the_arrays_does_not_matter():
    rays, structure = simulate(seed=11)
    strided = Rays(
        np.asfortranarray(rays.residual),
        np.asfortranarray(rays.by_point),
        np.asfortranarray(rays.by_others),
        np.asfortranarray(rays.columns),
        rays.point_pointers,
        rays.frame,
    )
    one, other = empty_reduced_system(structure), empty_reduced_system(structure)
    accumulate(rays, one)
    accumulate(strided, other)
    np.testing.assert_array_equal(one.matrix.values, other.matrix.values)


def test_places_that_are_kept_serve_the_next_pass():
    rays, structure = simulate(seed=5)
    others, _ = simulate(seed=5)
    later = replace(rays, residual=2.0 * rays.residual, by_others=-3.0 * rays.by_others)
    with compilation.chosen_by_size(compilation.WORTH_COMPILING - 1):
        for some in (rays, later):
            system, alone = empty_reduced_system(structure), empty_reduced_system(simulate(seed=5)[1])
            accumulate(some, system)
            accumulate(some, alone)
            np.testing.assert_array_equal(system.matrix.values, alone.matrix.values)
        assert len(structure.known) == 1
        fixed = replace(others, columns=np.where(others.columns < CAMERA, -1, others.columns))
        system, alone = empty_reduced_system(structure), empty_reduced_system(simulate(seed=5)[1])
        accumulate(fixed, system)
        accumulate(fixed, alone)
        np.testing.assert_array_equal(system.right_hand_side, alone.right_hand_side)


@pytest.mark.kernels
@pytest.mark.parametrize("camera_last", [True, False])
@pytest.mark.parametrize("camera_behind", [True, False])
def test_what_images_share_may_stand_anywhere(camera_behind, camera_last, monkeypatch):
    """Behind the pose, what an image alone has to do with is left to its sums; before it, it is not."""
    rays, structure = simulate(seed=11, camera_last=camera_last)
    order = np.roll(np.arange(WIDTH), -CAMERA) if camera_behind else np.arange(WIDTH)
    rays = replace(rays, by_others=rays.by_others[:, :, order].copy(), columns=rays.columns[:, order].copy())
    pattern = Pattern(structure.block_of, structure.offsets, structure.indptr, structure.indices, structure.position)
    assert begin_gathering(rays.columns, pattern).nested is camera_behind
    found = []
    for available in (True, False):
        monkeypatch.setattr(compilation, "available", available)
        reduced = empty_reduced_system(structure)
        accumulate(rays, reduced, 0.1)
        found.append((reduced.matrix.values, reduced.right_hand_side, reduced.diagonal, reduced.gradient))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * abs(other).max())
