"""EP, what the estimated gross error of an observation does to its points, against Q Aᵀ P e ∇ worked out densely."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import compilation
from mor.model.rotations import rotation_from_angles
from mor.quality.assessment import assess
from mor.solve.iterate import Outcome, adjust
from mor.types import FloatArray
from tests.dense_reference import dense_system
from tests.scenarios.datum_scenes import theodolites
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import Scene, add_image, mixed_network, photo_block, plane_network, solve

SIGMA = 1e-4


def _with(scene: Scene, noise: int, datum: list[str] | None):  # type: ignore[no-untyped-def]
    return solve(scene, np.random.default_rng(noise), datum)


def _weak_turn():  # type: ignore[no-untyped-def]
    """Theodolites whose tilts, observed as angles, hardly tell how the free network is turned about Z."""
    scene, points = theodolites("angles")
    random = np.random.default_rng(103)
    for k in range(3):
        angles = np.array([*(2e-4 * random.standard_normal(2)), 0.3 + k])
        scene.truth["rotation"][f"S{k}"] = rotation_from_angles(angles)
    adjustment = adjust(scene.problem(np.random.default_rng(3), points), scene.start(1e-3))
    assert adjustment.outcome is Outcome.CONVERGED
    assert adjustment.inverse.weak.shape[1] == 1
    return adjustment


def _weak_images():  # type: ignore[no-untyped-def]
    """A free block of images whose scale is hardly known: eliminated points, one weak direction."""
    scene, points = photo_block()
    scene.observe("distance", "I0", None, "I1", None, sigma=1.0)
    adjustment = _with(scene, 6, points)
    assert adjustment.inverse.weak.shape[1] == 1
    assert len(adjustment.plan.rays.points) == 12
    return adjustment


def _intersected():  # type: ignore[no-untyped-def]
    """Points that nothing but directions of theodolites and one image meet, the stations free."""
    scene, points = theodolites("axes")
    add_image(scene, "I0", [4.0, -12.0, 3.0], points)
    return _with(scene, 7, points)


def _correlated_rays():  # type: ignore[no-untyped-def]
    """Image coordinates with full covariance matrices, x with y and rays with each other; a held point among them."""
    scene, _ = photo_block()
    scene.free["point"]["P3"] = np.zeros(3, dtype=bool)
    random = np.random.default_rng(2)
    for rows in ((0, 1), (3, 15), (20,)):
        entries = [("image/mor", row, component) for row in rows for component in (0, 1)]
        factor = 1e-3 * (np.eye(len(entries)) + random.uniform(-0.4, 0.4, (len(entries),) * 2))
        scene.correlate(entries, factor @ factor.T)
    return _with(scene, 8, ["P0", "P5", "P10"])


def _free(make, chosen: slice = slice(None)):  # type: ignore[no-untyped-def]
    scene, points = make()
    return _with(scene, 5, points[chosen])


SCENES = {
    "free block": lambda: _free(photo_block),
    "free block, datum over few points": lambda: _free(lambda: photo_block(scale_bar=True), slice(2, 6)),
    "plane": lambda: _free(lambda: plane_network(directions=True)),
    "mixed": lambda: _with(mixed_network()[0], 5, None),
    "correlated": lambda: _with(correlated_everywhere()[0], 5, None),
    "correlated rays": _correlated_rays,
    "weak turn": _weak_turn,
    "weak scale of images": _weak_images,
    "directions": _intersected,
}


def _movements(adjustment, dense):  # type: ignore[no-untyped-def]
    """(u, n) movement of all unknowns by an error of 1 in each observation: pseudo-inverse, then into the datum."""
    lower = np.linalg.cholesky(dense.covariance)
    white = np.linalg.solve(lower, dense.A)
    scale = 1.0 / np.linalg.norm(white, axis=0)
    U, stretch, V = np.linalg.svd(white * scale, full_matrices=False)
    rank = len(scale) - adjustment.defect.datum.shape[1]
    moved = scale[:, None] * (V[:rank].T / stretch[:rank]) @ U[:, :rank].T @ np.linalg.inv(lower)
    null = scale[:, None] * V[rank:].T
    carriers = np.zeros(len(scale), dtype=bool)
    for kind, mask in adjustment.problem.datum.mask.items():
        columns = adjustment.problem.index.columns[kind][mask]
        carriers[columns[columns >= 0]] = True
    binding = np.where(carriers[:, None], null, 0.0)
    into: FloatArray = moved - null @ np.linalg.solve(binding.T @ null, binding.T @ moved)
    return into


def _condition(adjustment):  # type: ignore[no-untyped-def]
    """Condition number of the scaled design matrix, apart from the datum. A weak direction is known to ε times it at
    best (orthogonal methods), to ε times its square at worst (normal equations)."""
    dense = dense_system(adjustment.problem, adjustment.values)
    white = np.linalg.solve(np.linalg.cholesky(dense.covariance), dense.A)
    sizes = np.linalg.svd(white / np.linalg.norm(white, axis=0), compute_uv=False)
    return sizes[0] / sizes[len(sizes) - adjustment.defect.datum.shape[1] - 1]


def _expected(adjustment):  # type: ignore[no-untyped-def]
    """EP of all observations that are there, in their order, and their estimated errors."""
    problem, values = adjustment.problem, adjustment.values
    dense = dense_system(problem, values)
    P = dense.weights
    moved = _movements(adjustment, dense)
    residual = dense.A @ (moved @ dense.l) - dense.l
    cofactors = P - P @ dense.A @ moved
    controlled = np.diagonal(cofactors) > 1e-6 * np.diagonal(P)
    error = -(P @ residual) / np.where(controlled, np.diagonal(cofactors), np.nan)
    carried = [
        _carried(problem, values, group, row, component, moved[:, k])
        for k, (group, row, component) in enumerate(_entries(problem))
    ]
    return error * carried, error


def _entries(problem):  # type: ignore[no-untyped-def]
    return [
        (number, row, component)
        for number, group in enumerate(problem.groups)
        for row, component in np.argwhere(group.mask)
    ]


def _carried(problem, values, number, row, component, moved):  # type: ignore[no-untyped-def]
    """Length of what an error of 1, which moves all unknowns so, does to the points of an observation."""
    group = problem.groups[number]
    blocks = [values[s.kind][b[row : row + 1]] for s, b in zip(group.type.slots, group.blocks, strict=True)]
    jacobians = group.type.equation(blocks, group.constants[row : row + 1]).jacobians
    is_image = group.type.key.startswith(("image/", "follower/"))
    total, positions = 0.0, []
    for k, slot in enumerate(group.type.slots):
        if slot.kind != "point" or (is_image and k < len(blocks) - 1):
            continue
        columns = problem.index.columns["point"][group.blocks[k][row]]
        total += jacobians[k][0, component] @ np.where(columns >= 0, moved[columns], 0.0)
        positions.append(blocks[k][0])
    if is_image:
        return total / np.linalg.norm(jacobians[-1][0, component])
    if group.type.wraps[component] and len(positions) > 1:
        sight = positions[-1] - positions[0]
        return total * np.linalg.norm(sight[:2] if component in group.type.turns else sight)
    return total


@pytest.mark.parametrize("form", [pytest.param("compiled", marks=pytest.mark.kernels), "numpy"])
@pytest.mark.parametrize("name", SCENES)
def test_influence_is_the_movement_of_the_points_by_the_estimated_error(name, form, monkeypatch):
    adjustment = SCENES[name]()
    if form == "numpy":
        monkeypatch.setattr(compilation, "available", False)
    quality = assess(adjustment)
    found = np.concatenate(
        [one.influence[group.mask] for one, group in zip(quality.reliability, adjustment.problem.groups, strict=True)]
    )
    expected, error = _expected(adjustment)
    there = np.isfinite(error)
    size = np.abs(expected[there]).max()
    assert size > 1e-5
    # between what is known at best and at worst: ε·κ and ε·κ² are far apart, and round-off seldom is at its worst
    last = max(1e-7, np.finfo(float).eps * _condition(adjustment) ** 1.5)
    assert last < 1e-4
    np.testing.assert_allclose(found[there], expected[there], rtol=1e-5, atol=last * size)
    assert np.isnan(found[~there]).all()
    assert there.sum() > 0.7 * there.size
