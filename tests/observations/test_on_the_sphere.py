"""Image rays as directions: arcs, the gradient of their squares, and solutions from far away."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg.compilation import kernels_used
from mor.model.contract import ObservationGroup
from mor.model.images import on_the_sphere
from mor.model.observation_types import ALL_TYPES
from mor.quality.robust_estimation import problem_on_the_sphere
from mor.solve.iterate import Outcome, adjust
from mor.solve.normals import build_normals, eliminable_rays, make_plan
from mor.types import FloatArray
from tests.scenarios.gross_error_scenes import disturbed, spoiled
from tests.selection import slow_after

GON = np.pi / 200.0


def _group(kind: str) -> tuple[ObservationGroup, list[FloatArray]]:
    scene = spoiled(1, kind, 0.0)
    sphere = problem_on_the_sphere(scene.problem, scene.truth)
    assert sphere is not None
    group = next(group for group in sphere.groups if "sphere" in group.type.key)
    blocks = [scene.truth[slot.kind][numbers] for slot, numbers in zip(group.type.slots, group.blocks, strict=True)]
    return group, blocks


@pytest.mark.parametrize("far", [0.0, 1.0, 200.0])
def test_values_are_arcs_and_derivatives_those_of_their_squares(far: float) -> None:
    group, blocks = _group("aerial")
    blocks[-1] = blocks[-1] + far * np.random.default_rng(1).standard_normal(blocks[-1].shape)
    computed = group.type.equation(blocks, group.constants)
    star = np.einsum("nij,nj->ni", blocks[1], blocks[-1] - blocks[0])
    cosine = np.einsum("ni,ni->n", star, group.constants[:, 2:]) / np.linalg.norm(star, axis=1)
    arcs = np.arccos(np.clip(cosine, -1.0, 1.0))
    np.testing.assert_allclose(np.linalg.norm(computed.values, axis=1), arcs, rtol=1e-6, atol=1e-7)
    for slot in (0, 5):  # position of the image, point
        for component in range(3):
            gradient = np.einsum("nk,nk->n", computed.values, computed.jacobians[slot][:, :, component])
            numerical = _half_squares_by(group, blocks, slot, component)
            np.testing.assert_allclose(gradient, numerical, rtol=1e-5, atol=1e-9)


def _half_squares_by(group: ObservationGroup, blocks: list[FloatArray], slot: int, component: int) -> FloatArray:
    size, found = 1e-4, []
    for sign in (1.0, -1.0):
        moved = [block.copy() for block in blocks]
        moved[slot][:, component] += sign * size
        values = group.type.equation(moved, group.constants).values
        found.append(0.5 * np.sum(values**2, axis=1))
    result: FloatArray = (found[0] - found[1]) / (2.0 * size)
    return result


def test_points_at_infinity_stay_as_they_are() -> None:
    from mor.model.coordinates import at_infinity

    assert on_the_sphere(at_infinity(ALL_TYPES["image/mor"])) is None


def test_without_images_there_is_nothing_to_turn() -> None:
    scene = spoiled(1, "plane", 0.0)
    assert problem_on_the_sphere(scene.problem, scene.truth) is None


@pytest.mark.parametrize("seed", slow_after(0, [1, 3]))
def test_directions_lead_from_where_coordinates_do_not(seed: int) -> None:
    scene = spoiled(seed, "aerial", 0.0)
    start = disturbed(scene, np.random.default_rng(1_000_000 + seed), 0.4, 40.0 * GON)
    assert adjust(scene.problem, start).outcome is not Outcome.CONVERGED
    sphere = problem_on_the_sphere(scene.problem, start)
    assert sphere is not None
    there = adjust(sphere, start)
    found = adjust(scene.problem, there.values)
    expected = adjust(scene.problem, scene.truth)
    assert found.outcome is Outcome.CONVERGED
    assert found.normals.objective == pytest.approx(expected.normals.objective, rel=1e-9)


@pytest.mark.kernels
@pytest.mark.parametrize("far", [0.0, 0.4])
def test_the_kernel_has_the_directions_of_the_equation(far: float) -> None:
    """Compiled from stereographic coordinates of the rays, in numpy from the rays themselves."""
    scene = spoiled(2, "aerial", 0.0)
    start = disturbed(scene, np.random.default_rng(5), far, far * 100.0 * GON)
    sphere = problem_on_the_sphere(scene.problem, start)
    assert sphere is not None
    found = []
    for used in (True, False):
        with kernels_used(used):
            found.append(build_normals(make_plan(sphere, eliminable_rays(sphere, start)), start))
    compiled, plain = found
    assert compiled.objective == pytest.approx(plain.objective, rel=1e-10)
    np.testing.assert_allclose(compiled.rhs, plain.rhs, rtol=0, atol=1e-9 * np.abs(plain.rhs).max())
