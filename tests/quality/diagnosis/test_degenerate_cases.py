"""Networks at the edge: what is null, what is nearly null, and what is said about it."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.rotations import exponential
from mor.quality.assessment import assess
from mor.quality.singularity import _cure, _name, english, tilt
from mor.quality.solution import weak_directions
from mor.solve.iterate import Outcome, SolverSettings, adjust
from tests.scenarios.scenes import (
    OBJECT_POINTS,
    Scene,
    add_image,
    add_object_points,
    photo_block,
    plane_network,
    solve,
)
from tests.scenarios.small_projects import BLOCK, block, mor, write_block


def test_two_images_only_control_nothing_but_the_parallax():
    # relative orientation of two images: per point four coordinates, three unknowns, so Σr = points − 5
    scene = Scene()
    points = add_object_points(scene)
    for name, position in (("I0", (-4.0, -6.0, 1.2)), ("I1", (8.5, -5.0, 0.4))):
        add_image(scene, name, position, points)
    quality = assess(solve(scene, np.random.default_rng(1), points))
    assert quality.adjustment.defect.datum.shape[1] == 7
    assert quality.redundancy == len(points) - 5
    assert quality.redundancy_sum == pytest.approx(len(points) - 5, abs=1e-6)
    freedom = quality.groups[0].freedom
    assert (freedom == 1.0).all(), "one direction of each ray is controlled, the other is not"
    # both coordinates of a ray are tested as one: the same w wherever they are tested
    w = np.abs(quality.reliability[0].test)
    np.testing.assert_allclose(w[:, 0], w[:, 1], rtol=1e-4)
    np.testing.assert_allclose(quality.groups[0].joint[:, 0], w[:, 0] ** 2, rtol=1e-4)


def test_a_point_seen_twice_along_one_ray():
    # two images from the same place: the depth of a point that only they see is not determined
    scene, points = photo_block(scale_bar=True)
    station = np.array([2.0, -9.0, 2.0])
    for name in ("I5", "I6"):
        add_image(scene, name, station, points)
    away = OBJECT_POINTS.mean(axis=0) - station
    scene.add("point", "T", station + 0.8 * away + np.array([0.3, 0.0, 0.4]))
    for name in ("I5", "I6"):
        scene.observe("image/mor", name, name, None, None, "camera", "T", sigma=1e-3)
    adjustment = adjust(scene.problem(None, points), scene.start(0.0))
    if adjustment.outcome is Outcome.SINGULAR:
        (direction,) = adjustment.defect.undetermined
        assert {block for _, block, _ in direction.unknowns} == {"T"}
        along = dict(zip((c for _, _, c in direction.unknowns), direction.amounts, strict=True))
        ray = scene.truth["point"]["T"] - station
        ray = ray / np.abs(ray).max()
        for k, component in enumerate("xyz"):
            assert abs(along.get(component, 0.0)) == pytest.approx(abs(ray[k]), abs=2e-3)
    else:
        # round-off may leave it determined on paper: then it must be shown as what it is
        told = {block for d in weak_directions(adjustment, assess(adjustment)) for _, block, _ in d.unknowns}
        assert "T" in told


def _strip(noise, control):
    """Five images in a row that look straight down on a strip of points; both ends known, all on the axis."""
    scene = Scene()
    random = np.random.default_rng(3)
    names = []
    for k in range(12):
        for side in (-1.0, 0.0, 1.0):
            xyz = [
                4.0 * k,
                0.0 if side == 0.0 else 8.0 * side + random.uniform(-1, 1),
                random.uniform(-1.0, 1.0),
            ]
            known = control and side == 0.0 and k in (0, 6, 11)
            names.append(scene.add("point", f"G{k}{side:+.0f}", xyz, free=not known))
    down = np.eye(3)
    for i in range(5):
        position = [4.0 + 9.0 * i, 0.2, 25.0]
        scene.add("point", f"I{i}", position)
        scene.add("rotation", f"I{i}", down)
        if "camera" not in scene.truth.get("interior/mor", {}):
            scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=False)
        for name in names:
            if abs(scene.truth["point"][name][0] - position[0]) < 14.0:
                scene.observe("image/mor", f"I{i}", f"I{i}", None, None, "camera", name, sigma=1e-3)
    return scene


def test_a_strip_with_control_on_its_axis_only_can_tilt_about_it():
    scene = _strip(None, control=True)
    for name, xyz in scene.truth["point"].items():
        if not scene.free["point"][name].any():
            xyz[1:] = 0.0  # exactly on one line
    problem = scene.problem(np.random.default_rng(1))
    adjustment = adjust(problem, scene.start(1e-6))
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.defect.datum.shape[1] + len(adjustment.defect.undetermined) == 1
    assert tilt(adjustment) == "The network can tilt about the line through G0+0, G6+0, G11+0."


def test_a_plane_object_cannot_give_principal_point_and_constant_of_parallel_images():
    # all points in a plane, all images parallel to it and upright: c and height, principal point and position
    scene = Scene()
    names = [scene.add("point", f"P{i}{j}", [1.0 * i, 1.0 * j, 0.0], free=False) for i in range(5) for j in range(4)]
    interior = np.array([True, True, True, *[False] * 7])
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=interior)
    for k, xy in enumerate(([1.0, 1.0], [3.0, 2.0], [2.0, 0.5])):
        scene.add("point", f"I{k}", [*xy, 10.0])
        scene.add("rotation", f"I{k}", np.eye(3))
        for name in names:
            scene.observe("image/mor", f"I{k}", f"I{k}", None, None, "camera", name, sigma=1e-3)
    adjustment = adjust(scene.problem(), scene.start(0.0))
    assert adjustment.outcome is Outcome.SINGULAR
    assert len(adjustment.defect.undetermined) == 3
    kinds = [{kind for kind, _, _ in d.unknowns} for d in adjustment.defect.undetermined]
    assert all("interior/mor" in found for found in kinds)
    assert all(found <= {"interior/mor", "point", "rotation"} for found in kinds)


def test_levels_observed_about_object_axes_leave_a_free_network_with_a_weak_turn():
    # tilts observed as angles are tilts about object axes: the turn about Z is determined, but hardly
    scene, points = photo_block(scale_bar=True)
    for k in range(5):
        scene.observe("observed/rotation", f"I{k}", sigma=1e-3, only=(0, 1))
    adjustment = adjust(scene.problem(np.random.default_rng(2), points), scene.start(1e-4))
    assert adjustment.outcome is Outcome.CONVERGED
    # the object is not levelled here, so the angles do tell the turn; nothing is left but shifts
    assert adjustment.defect.datum.shape[1] == 3


def test_observed_levels_leave_the_turn_about_the_plumb_line_exactly_free():
    scene, points = plane_network(distances=True, directions=True)
    adjustment = solve(scene, np.random.default_rng(2), points)
    assert adjustment.defect.movements == ("translation X", "translation Y", "rotation Z")
    assert adjustment.inverse.weak.shape[1] == 0


def test_unscaled_distortion_columns_are_neither_null_nor_weak():
    scene, points = photo_block(scale_bar=True)
    scene.free["interior/mor"]["camera"] = np.array([True, True, True, True, True, False, *[False] * 4])
    quality = assess(solve(scene, np.random.default_rng(4), points, disturbed=1e-6))
    assert quality.adjustment.defect.datum.shape[1] == 6
    assert quality.adjustment.inverse.null.shape[1] == 6
    assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-5)


def test_an_image_with_two_points_can_rotate_about_their_line(tmp_path):
    rows = block(noise=0.002)
    rays = [ray for ray in rows.rays if ray[0] != "no" or ray[1] in ("P3", "P7")]
    run = mor("adjust", write_block(tmp_path, BLOCK, rows._replace(rays=rays)))
    assert run.code == 4
    assert "image no sees two points only, P3, P7: it can rotate about the line of its two points" in run.err


def test_an_image_whose_points_lie_on_one_line_can_rotate_about_it(tmp_path):
    rows = block(noise=0.0)
    first, second = np.array(rows.points[0][1:]), np.array(rows.points[11][1:])
    rows.points.append(["M", *map(float, 0.5 * (first + second))])
    rays = [ray for ray in rows.rays if ray[0] != "no" or ray[1] in ("P0", "P11")]
    for name in ("010", "no", "1e3", "12:30"):
        rays.append([name, "M", *_image_of(rows, name, rows.points[-1][1:])])
    text = BLOCK.replace("datum: free", "datum: fixed").replace(
        "file: points.csv", "file: points.csv\n    fixed: [x, y, z]"
    )
    run = mor("adjust", write_block(tmp_path, text, rows._replace(rays=rays)))
    assert run.code == 4
    assert "lie on one line: it can rotate about this line" in run.err


def _image_of(rows, name, xyz):
    """Image coordinates of a point, by the two rays of the same image next to it: the point is on their line."""
    from tests.scenarios.small_projects import C, attitude

    row = next(image for image in rows.images if image[0] == name)
    centre = np.array(row[2:5])
    roll = 0.4 * ("010", "no", "1e3", "12:30").index(name)
    D, _ = attitude(centre, roll)
    star = D @ (np.array(xyz) - centre)
    return [float(-C * star[0] / star[2]), float(-C * star[1] / star[2])]


def test_a_point_at_infinity_is_called_a_point_with_a_direction():
    assert _name("rotation", "point 7", english) == "the direction of point 7"
    assert _name("rotation", "station 7", english) == "the rotation of station 7"
    assert _cure("rotation", "point 7", english).startswith("observe it from a second place")


def test_without_a_solution_the_camera_is_named_before_the_points_that_move_with_it():
    # images nearly parallel to a plane object: principal point, constant and positions are hardly determined
    scene = Scene()
    names = [scene.add("point", f"P{i}{j}", [1.0 * i, 1.0 * j, 0.0], free=False) for i in range(5) for j in range(4)]
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=np.array([True, True, True, *[False] * 7]))
    for k, xy in enumerate(([1.0, 1.0], [3.0, 2.0], [2.0, 0.5])):
        scene.add("point", f"I{k}", [*xy, 10.0])
        scene.add("rotation", f"I{k}", exponential(np.array([1e-4 * (k + 1), -1e-4 * k, 0.0])))
        for name in names:
            scene.observe("image/mor", f"I{k}", f"I{k}", None, None, "camera", name, sigma=1e-3)
    adjustment = adjust(scene.problem(np.random.default_rng(5)), scene.start(1e-6), SolverSettings(max_iterations=1))
    assert adjustment.outcome is Outcome.NOT_CONVERGED
    told = [[kind for kind, _, _ in direction.unknowns] for direction in weak_directions(adjustment, None)]
    assert any("interior/mor" in kinds for kinds in told)
    assert all(kinds == sorted(kinds, key=lambda kind: kind == "point") for kinds in told)
