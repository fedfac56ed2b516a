"""The compiled linearisation of rays against the equations of their observation types, and what is left to numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.linalg import compilation
from mor.model.images import read_out_at_once
from mor.model.parameters import INTERIORS
from mor.quality.assessment import assess
from mor.solve import engine as lanes
from mor.solve import product_kernels as image_passes
from mor.solve import rays as ray_plan
from mor.solve.elimination import back_substitute, point_steps, ray_chunks, ray_objective, ray_residuals
from mor.solve.iterate import Outcome, adjust
from mor.solve.normals import build_normals, eliminable_rays, make_plan
from mor.solve.rays import plan_rays
from tests.dense_reference import dense_system
from tests.scenarios.path_scenes import PATHS, path_scene
from tests.scenarios.scenes import OBJECT_POINTS, Scene, add_object_points, looking_at

INTERIOR = {
    "mor": [30.0, 0.1, -0.2, 1e-5, -2e-8, 1e-11, 2e-5, -1e-5, 3e-4, -2e-4],
    "brown": [30.0, 0.1, -0.2, 1e-5, -2e-8, 1e-11, 2e-5, -1e-5, 3e-4, -2e-4],
    "brown-forward": [30.0, 0.1, -0.2, 1e-5, -2e-8, 1e-11, 2e-5, -1e-5],
    "panorama": [30.0, 0.1, -0.2, 1e-3, 0.2, -0.1, 2e-2, -0.03, 1e-5, -2e-8, 1e-2, -2e-2, 5e-3, 1e-2],
    "opencv": [30.0, 30.1, 0.1, -0.2, 0.01, -0.02, 1e-3, -1e-3, 0.01, 0.0, 0.0, 0.0],
}
PLACES = ([9.0, -8.0, 6.0], [-8.0, -9.0, 5.0], [8.0, 9.0, 7.0], [-9.0, 8.0, 5.0], [0.0, -12.0, 6.0])
NAMES = (
    "plain",
    "all free",
    "partly free",
    "image-variant",
    "two cameras",
    "left to numpy",
    "missing and excluded",
    "panoramas among frames",
    "rolling shutters",
    "a rolling shutter among frames",
    "readout time of two models",
    "all of rolling shutters",
)
EVERY_NAME = (*NAMES, *PATHS)
ROLLING = NAMES[-4:]
FREE_OF_ALL = ("all free", "all of rolling shutters")
WITH_GAPS = {"missing and excluded": 5, "all of rolling shutters": 11}
READOUT = "T"


def block(kind: str, models: tuple[str, ...]) -> Scene:
    """Five images of twelve points, the first and the last camera fixed, with whatever the kind asks for."""
    scene = Scene()
    points = add_object_points(scene)
    for number, place in enumerate(PLACES):
        model = models[number % len(models)]
        _add_image(scene, kind, number, place, model)
        for k, name in enumerate(points):
            if (k + number) % 4 == 0:
                continue
            constants = _constants(model, number, k)
            only = [k % 2] if kind in WITH_GAPS and (k + number) % WITH_GAPS[kind] == 0 else None
            frame = (f"C{number}", f"R{number}", *_extras(kind, number))
            interior = f"I {model} {number}" if kind == "image-variant" else f"I {model}"
            form = "image"
            if _rolls(kind, number):
                form, frame = "moving", (*frame, f"V{number}", f"W{number}", READOUT)
                constants = [*constants, 0.01, -0.04, 0.02]
            type_, slots = f"{form}/{model}", (*frame, interior, name)
            scene.observe(type_, *slots, sigma=(0.002, 0.003), constants=constants, only=only)
    return scene


def _rolls(kind: str, number: int) -> bool:
    return kind in ROLLING and (number % 2 == 0 or kind != "a rolling shutter among frames")


def _add_image(scene: Scene, kind: str, number: int, place: list[float], model: str) -> None:
    end = number in (0, len(PLACES) - 1)
    free: bool | tuple[bool, ...] = not end
    if _rolls(kind, number):
        _add_motion(scene, kind, number, end)
    scene.add("point", f"C{number}", place, free=free)
    turned = (True, False, True) if kind == "partly free" and not end else free
    scene.add("rotation", f"R{number}", looking_at(place, [0.0, 0.0, 0.0], 0.3 * number), free=turned)
    if _has_extras(kind):
        everything = kind in FREE_OF_ALL
        scene.add("height", f"H{number}", [1.5], free=everything and number == 1)
        wanted = (everything, False, everything and number == 2)
        scene.add("eccentricity", f"E{number}", [0.1, -0.2, 0.05], free=wanted if not end else False)
    name = f"I {model} {number}" if kind == "image-variant" else f"I {model}"
    if name not in scene.truth.get(INTERIORS[model].key, {}):
        size = INTERIORS[model].size
        some = np.arange(size) % 3 != 2 if kind in ("partly free", "image-variant") else np.arange(size) < 3
        some = np.ones(size, dtype=bool) if model == "panorama" else some
        scene.add(INTERIORS[model].key, name, INTERIOR[model], free=some)


def _add_motion(scene: Scene, kind: str, number: int, end: bool) -> None:
    moves = kind != "readout time of two models"
    turning = (moves, False, moves) if number == 2 else moves and number == 1
    times = 6.0 if kind == "all of rolling shutters" else 1.0  # turns by more than series are for
    scene.add("image velocity", f"V{number}", [0.5 - number, 2.0, -0.4], free=moves and not end)
    rate = times * np.array([0.1, -0.1 * number, 0.2 * number])
    scene.add("rotation rate", f"W{number}", rate, free=turning)
    if READOUT not in scene.truth.get("readout", {}):
        scene.add("readout", READOUT, [0.3], free=not moves or kind in FREE_OF_ALL)


def _has_extras(kind: str) -> bool:
    return kind in (*FREE_OF_ALL, "partly free", "rolling shutters")


def _extras(kind: str, number: int) -> tuple[str | None, str | None]:
    return (f"H{number}", f"E{number}") if _has_extras(kind) else (None, None)


def _constants(model: str, number: int, k: int) -> list[float]:
    measured = [0.5 * k - 3.0, 0.4 * number - 1.0]
    if model == "panorama":
        measured[0] += 2.0 * np.pi * 30.0 * number  # so many turns further
    return [*measured, 4.0] if model == "mor" else measured


def scene_of(name: str) -> Scene:
    if name in PATHS:
        return path_scene(name)
    models = {
        "two cameras": ("mor", "brown-forward"),
        "left to numpy": ("mor", "opencv", "brown"),
        "image-variant": ("brown",),
        "panoramas among frames": ("panorama", "mor"),
        "a rolling shutter among frames": ("mor", "opencv", "brown"),
        "readout time of two models": ("brown", "brown-forward"),
        "all of rolling shutters": ("mor", "brown"),
    }.get(name, ("mor",))
    return block(name, models)


def linearised(problem, values):
    """Everything a pass over the rays yields, as dense rows by point."""
    rays = plan_rays(problem, eliminable_rays(problem, values).points)
    unknowns = problem.index.count
    rows = []
    for chunk in ray_chunks(problem, rays, np.arange(unknowns), values):
        part = chunk.rays
        dense = np.zeros((part.rays, 2, unknowns))
        for i, columns in enumerate(part.columns_of_rays):
            for k, column in enumerate(columns):
                if column >= 0:
                    dense[i, :, column] += part.by_others[i, :, k]
        own = rays.columns[chunk.points][np.repeat(np.arange(part.points), np.diff(part.point_pointers))]
        for i, columns in enumerate(own):
            dense[i][:, columns] += part.by_point[i]
        rows.append((chunk.group, chunk.row, part.residual.copy(), dense))
    return [np.concatenate(parts) for parts in zip(*rows, strict=True)]


@pytest.mark.kernels
@pytest.mark.parametrize("name", EVERY_NAME)
def test_compiled_rays_are_those_of_the_equations(name, monkeypatch):
    scene = scene_of(name)
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-2)
    found = linearised(problem, values)
    monkeypatch.setattr(compilation, "available", False)
    for one, other in zip(found, linearised(problem, values), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * max(1.0, np.abs(other).max()))
    assert np.abs(found[2]).max() > 1.0


@pytest.mark.parametrize("name", ROLLING)
def test_shutters_without_readout_time_are_those_of_frames(name):
    scene = scene_of(name)
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-2)
    values["readout"] = np.zeros_like(values["readout"])
    still = replace(problem, groups=tuple(read_out_at_once(group) for group in problem.groups))
    found, expected = (
        [residual for _, residual in ray_residuals(p, plan_rays(p, eliminable_rays(p, values).points), values)]
        for p in (problem, still)
    )
    np.testing.assert_allclose(np.concatenate(found), np.concatenate(expected), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", EVERY_NAME)
def test_rays_make_up_the_dense_system(name):
    """Not the plan's own code: every row is evaluated and differentiated by its type, one by one."""
    scene = scene_of(name)
    problem, values = scene.problem(np.random.default_rng(2)), scene.start(1e-2)
    rays = eliminable_rays(problem, values)
    assert len(rays.points) == len(OBJECT_POINTS)
    plan = make_plan(problem, rays)
    normals = build_normals(plan, values)
    dense = dense_system(problem, values)
    normal, right = dense.normal, dense.A.T @ dense.weights @ dense.l
    points = rays.columns.ravel()
    outside = normal[np.ix_(plan.kept, points)]
    inner = np.linalg.solve(normal[np.ix_(points, points)], np.column_stack([outside.T, right[points]]))
    size = np.sqrt(np.outer(normals.diagonal, normals.diagonal))
    expected = normal[np.ix_(plan.kept, plan.kept)] - outside @ inner[:, :-1]
    np.testing.assert_allclose(normals.matrix.to_dense() / size, expected / size, atol=1e-11)
    np.testing.assert_allclose(normals.rhs, right, rtol=1e-9, atol=1e-9 * np.abs(right).max())
    assert normals.objective == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-11)
    assert ray_objective(problem, rays, values) == pytest.approx(normals.objective, rel=1e-12)


@pytest.mark.parametrize("available", [pytest.param(True, marks=pytest.mark.kernels), False])
@pytest.mark.parametrize("name", EVERY_NAME)
def test_points_that_follow_a_step_are_those_of_back_substitution(name, available, monkeypatch):
    monkeypatch.setattr(compilation, "available", available)
    scene = scene_of(name)
    problem, values = scene.problem(np.random.default_rng(3)), scene.start(1e-3)
    rays = eliminable_rays(problem, values)
    step = 1e-3 * np.random.default_rng(4).standard_normal(problem.index.count)
    step[rays.columns] = 0.0
    expected = [
        back_substitute(chunk.rays, step, 0.1) for chunk in ray_chunks(problem, rays, np.arange(len(step)), values)
    ]
    found = [steps for _, steps in point_steps(problem, rays, values, step, 0.1)]
    np.testing.assert_allclose(np.concatenate(found), np.concatenate(expected), rtol=1e-8, atol=1e-12)


def many_points(free_position: bool, free_interior: bool) -> Scene:
    """Five images of 1 100 points: more rays than a piece holds, and a last piece that is not full."""
    scene = Scene()
    rng = np.random.default_rng(11)
    scene.add(INTERIORS["mor"].key, "I", INTERIOR["mor"], free=free_interior)
    for number, place in enumerate(PLACES):
        scene.add("point", f"C{number}", place, free=free_position and number not in (0, 4))
        turned = looking_at(place, [0.0, 0.0, 0.0], 0.3 * number)
        scene.add("rotation", f"R{number}", turned, free=free_position and number != 0)
    for k, position in enumerate(rng.uniform(-3.0, 3.0, (1100, 3))):
        scene.add("point", f"N{k}", position)
        for number in rng.permutation(5)[: 3 + k % 3]:
            frame = (f"C{number}", f"R{number}", None, None, "I")
            scene.observe("image/mor", *frame, f"N{k}", sigma=0.002, constants=[0.0, 0.0, 4.0])
    return scene


@pytest.mark.kernels
@pytest.mark.parametrize(("free_position", "free_interior"), [(True, True), (True, False)])
def test_pieces_of_a_chunk_give_what_the_plain_form_gives(free_position, free_interior, monkeypatch):
    scene = many_points(free_position, free_interior)
    problem, values = scene.problem(np.random.default_rng(5)), scene.start(1e-3)
    plan = make_plan(problem, eliminable_rays(problem, values))
    assert len(plan.rays.row) > 1.05 * image_passes.RAYS_OF_A_PIECE
    step = 1e-3 * np.random.default_rng(6).standard_normal(problem.index.count)
    step[plan.rays.columns] = 0.0
    found = []
    for available in (True, False):
        monkeypatch.setattr(compilation, "available", available)
        normals = build_normals(plan, values, 0.1)
        steps = [moved for _, moved in point_steps(problem, plan.rays, values, step, 0.1)]
        arrays = normals.matrix.values, normals.reduced_rhs, normals.rhs, normals.diagonal
        found.append((*arrays, np.concatenate(steps), np.array(normals.objective)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-10 * np.abs(other).max(initial=0.0))


def test_positions_and_rotations_that_belong_together_are_one_block():
    scene = scene_of("plain")
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-3)
    sizes = make_plan(problem, eliminable_rays(problem, values)).target.structure.sizes
    assert sorted(sizes) == [3, 6, 6, 6]  # the interior, and three free images
    scene.add("rotation", "second", looking_at(PLACES[1], [0.0, 0.0, 0.0], 1.0))
    for name in [f"P{k}" for k in range(12)]:  # a second image from the place of the first one
        scene.observe("image/mor", "C1", "second", None, None, "I mor", name, sigma=0.002, constants=[0, 0, 4.0])
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-3)
    sizes = make_plan(problem, eliminable_rays(problem, values)).target.structure.sizes
    assert sorted(sizes) == [3, 3, 3, 3, 6, 6]


def test_the_motion_of_an_image_is_in_the_block_of_its_pose():
    scene = scene_of("rolling shutters")
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-3)
    sizes = make_plan(problem, eliminable_rays(problem, values)).target.structure.sizes
    assert sorted(sizes) == [3, 9, 11, 12]  # the interior, and three free images


def test_residuals_are_zero_where_nothing_was_observed():
    scene = scene_of("missing and excluded")
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-2)
    rays = eliminable_rays(problem, values)
    for chunk, residual in ray_residuals(problem, rays, values):
        seen = problem.groups[0].mask[rays.row[chunk.rays]]
        assert not seen.all()
        assert np.array_equal(residual != 0.0, seen)


def test_many_chunks_give_what_one_gives(monkeypatch):
    scene = scene_of("two cameras")
    problem = scene.problem(np.random.default_rng(5))
    whole = adjust(problem, scene.start(1e-3))
    monkeypatch.setattr(ray_plan, "POINTS_AT_A_TIME", 5)
    pieces = adjust(problem, scene.start(1e-3))
    assert len(pieces.plan.rays.chunks) == 3
    assert whole.outcome is pieces.outcome is Outcome.CONVERGED
    for kind, values in whole.values.items():
        np.testing.assert_allclose(pieces.values[kind], values, atol=1e-10)
    for one, other in zip(assess(whole).groups, assess(pieces).groups, strict=True):
        np.testing.assert_allclose(one.r, other.r, atol=1e-10)


@pytest.mark.kernels  # numpy adds up in an order that depends on where arrays begin
def test_the_number_of_processors_changes_not_a_digit(monkeypatch):
    """Chunks shared out to lanes: the same bits whoever works on them, and what one lane gives."""
    scene = scene_of("two cameras")
    problem = scene.problem(np.random.default_rng(5))
    alone = assess(adjust(problem, scene.start(1e-3)))
    assert len(lanes.in_lanes(alone.adjustment.plan, 0, lambda _, rays, put: rays)) == 1
    monkeypatch.setattr(ray_plan, "POINTS_AT_A_TIME", 1)
    found = []
    for processors in (1, 2, 5):
        monkeypatch.setattr(lanes, "processors", lambda count=processors: count)
        found.append(assess(adjust(problem, scene.start(1e-3))))
    shared = lanes.in_lanes(found[0].adjustment.plan, 0, lambda _, rays, put: rays.chunks)
    assert len(shared) == 4
    assert sum(shared, ()) == found[0].adjustment.plan.rays.chunks
    for other in found[1:]:
        for kind, values in found[0].adjustment.values.items():
            np.testing.assert_array_equal(other.adjustment.values[kind], values)
        for one, same in zip(found[0].groups, other.groups, strict=True):
            np.testing.assert_array_equal(one.r, same.r)
        np.testing.assert_array_equal(found[0].cofactors["point"], other.cofactors["point"])
    for one, other in zip(alone.groups, found[0].groups, strict=True):
        np.testing.assert_allclose(one.r, other.r, atol=1e-10)
        np.testing.assert_allclose(one.v, other.v, atol=1e-10)


def test_the_order_of_the_rows_does_not_matter():
    scene = scene_of("plain")
    problem = scene.problem(np.random.default_rng(6))
    group = problem.groups[0]
    turned = np.random.default_rng(7).permutation(group.count)
    mixed = replace(
        group,
        blocks=tuple(block[turned] for block in group.blocks),
        observed=group.observed[turned],
        sigma=group.sigma[turned],
        constants=group.constants[turned],
    )
    one = assess(adjust(problem, scene.start(1e-3)))
    other = assess(adjust(replace(problem, groups=(mixed,)), scene.start(1e-3)))
    np.testing.assert_allclose(other.groups[0].r, one.groups[0].r[turned], atol=1e-10)
    np.testing.assert_allclose(other.groups[0].v, one.groups[0].v[turned], atol=1e-10)


@pytest.mark.parametrize("name", NAMES[:-1])  # the last one has hardly a redundant observation
def test_quality_of_rays_is_that_of_the_dense_system(name, monkeypatch):
    """Redundancy numbers against the dense system, all else against the form in numpy."""
    scene = scene_of(name)
    adjustment = adjust(scene.problem(np.random.default_rng(8)), scene.start(1e-3))
    assert len(adjustment.plan.rays.points) == len(OBJECT_POINTS)
    quality = assess(adjustment)
    dense = dense_system(adjustment.problem, adjustment.values)
    groups = adjustment.problem.groups
    found = [one.r[group.mask] for one, group in zip(quality.groups, groups, strict=True)]
    np.testing.assert_allclose(np.concatenate(found), dense.redundancy_numbers(), atol=1e-9)
    monkeypatch.setattr(compilation, "available", False)
    for one, other in zip(quality.groups, assess(adjustment).groups, strict=True):
        for name in ("v", "r", "q_adjusted", "q_residual", "weighted", "q_weighted", "joint", "freedom"):
            array, plain = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(array, plain, rtol=1e-6, atol=1e-9 * np.nanmax(np.abs(plain)))


@pytest.mark.parametrize("very_many", [0, 1000])
@pytest.mark.parametrize("name", ["plain", "two cameras", "left to numpy"])
def test_a_common_sigma_is_kept_once(name, very_many, monkeypatch):
    monkeypatch.setattr(ray_plan, "POINTS_AT_A_TIME", 5)
    monkeypatch.setattr(ray_plan, "VERY_MANY_RAYS", very_many)
    scene = scene_of(name)
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(1e-2)
    once = replace(
        problem,
        groups=tuple(
            replace(group, sigma=np.broadcast_to(group.sigma[:1].copy(), group.sigma.shape)) for group in problem.groups
        ),
    )
    plans = [make_plan(p, eliminable_rays(p, values)) for p in (problem, once)]
    whole, short = (plan.rays.measurements.weight for plan in plans)
    rays = len(plans[0].rays.row)
    assert len(whole) == rays
    assert (len(short) < rays) == (name == "plain")
    assert (plans[1].rays.measurements.row is not None) == (name == "plain" and very_many == 0)
    one, other = (build_normals(plan, values) for plan in plans)
    np.testing.assert_array_equal(one.matrix.values, other.matrix.values)
    np.testing.assert_array_equal(one.rhs, other.rhs)
    assert one.objective == other.objective
