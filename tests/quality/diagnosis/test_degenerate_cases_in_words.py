"""Degenerate networks as a user meets them: from the project file to the words that are printed."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from mor.model.rotations import angles_from_rotation
from tests.scenarios.scenes import (
    CAMERA_STATIONS,
    OBJECT_POINTS,
    Scene,
    add_image,
    add_object_points,
    photo_block,
)
from tests.scenarios.small_projects import LEVELLING, mor, table, write

GON = np.pi / 200.0
PROJECT = """\
mor: 1
title: at the edge
cameras:
  K: {interior: %s}
points:
%simages:
  - file: images.csv
observations:
  - type: image
    file: rays.csv
    values: {sigma: 1 um}
%sdatum: %s
"""


def project(folder, scene, interior="{c: 20}", datum="free", distances=(), noise=1, held=()):
    """A scene of images as a project; the points called ``held`` are fixed."""
    numbers = scene.problem(None if noise is None else np.random.default_rng(noise))
    group = numbers.groups[0]
    images = list(scene.truth["rotation"])
    at = {name: list(map(float, xyz)) for name, xyz in scene.truth["point"].items()}
    angles = {
        name: list(map(float, angles_from_rotation(scene.truth["rotation"][name][None])[0] / GON)) for name in images
    }
    points = [name for name in at if name not in images]
    rays = [
        [names[0], names[-1], *map(float, xy)]
        for names, xy in zip(scene.groups["image/mor"].names, group.observed, strict=True)
    ]
    rows = ", ".join(f"[{one}, {other}, {length!r}, {sigma!r}]" for one, other, length, sigma in distances)
    more = f"  - {{type: distance, columns: [from, to, distance, sigma], rows: [{rows}]}}\n" if distances else ""
    sources = ["  - {file: held.csv, fixed: [x, y, z]}\n"] if held else []
    sources += ["  - file: points.csv\n"] if len(held) < len(points) else []
    return write(
        folder,
        PROJECT % (interior, "".join(sources), more, datum),
        held=table("id,x,y,z", [[name, *at[name]] for name in points if name in held]),
        points=table("id,x,y,z", [[name, *at[name]] for name in points if name not in held]),
        images=table("id,camera,x,y,z,omega,phi,kappa", [[name, "K", *at[name], *angles[name]] for name in images]),
        rays=table("image,point,x,y", rays),
    )


def adjusted(folder, path):
    run = mor("adjust", path, "-o", folder / "results")
    report = folder / "results" / "report.txt"
    return run, " ".join(report.read_text().split()) if report.is_file() else ""


def residuals(folder):
    with (folder / "results" / "residuals.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def _length(scene, one, other):
    return float(np.linalg.norm(scene.truth["point"][one] - scene.truth["point"][other]))


def test_a_single_scale_bar_has_no_test_and_it_is_said(tmp_path):
    scene, _ = photo_block()
    run, report = adjusted(
        tmp_path, project(tmp_path, scene, distances=[("P0", "P10", _length(scene, "P0", "P10"), 1e-4)])
    )
    assert run.code == 0, run.err
    assert "Observations that hardly anything controls (r < 0.01)" in report
    said = "1 observation uncontrolled (r < 0.01): distance from P0, to P10."
    assert said in report
    assert said in run.err
    page = (tmp_path / "results" / "report.html").read_text(encoding="utf-8")
    assert "distance from P0, to P10: r = 0" in page
    (bar,) = (row for row in residuals(tmp_path) if row["type"] == "distance")
    assert bar["flag"] == "uncontrolled"
    assert abs(float(bar["r"])) < 1e-9
    assert bar["w"] == bar["nabla"] == ""


def test_an_observation_the_network_does_not_need_has_r_of_one(tmp_path):
    # one good scale bar and one with a σ of 10 m, which contributes nothing and is controlled to the last
    scene, _ = photo_block()
    bars = [("P0", "P10", _length(scene, "P0", "P10"), 1e-4), ("P1", "P9", _length(scene, "P1", "P9"), 10.0)]
    run, _ = adjusted(tmp_path, project(tmp_path, scene, distances=bars))
    assert run.code == 0, run.err
    good, idle = (row for row in residuals(tmp_path) if row["type"] == "distance")
    assert float(idle["r"]) == pytest.approx(1.0, abs=1e-8)
    assert float(idle["external"]) == pytest.approx(0.0, abs=1e-3)
    assert float(idle["nabla"]) == pytest.approx(4.1321 * 10.0, rel=1e-4)
    assert idle["flag"] == ""
    assert float(good["r"]) < 1e-8


def test_a_point_seen_twice_along_one_ray_is_named_with_its_direction(tmp_path):
    scene, _ = photo_block()
    station = np.array([2.0, -9.0, 2.0])
    for name in ("I5", "I6"):
        add_image(scene, name, station, [f"P{k}" for k in range(12)])
    away = OBJECT_POINTS.mean(axis=0) - station
    scene.add("point", "T", station + 0.8 * away + np.array([0.3, 0.0, 0.4]))
    for name in ("I5", "I6"):
        scene.observe("image/mor", name, name, None, None, "camera", "T", sigma=1e-3)
    # both images stand on the same place: one position, given and fixed
    path = project(tmp_path, scene, noise=None, datum="fixed", held=[f"P{k}" for k in range(12)])
    text = path.read_text().replace("  - file: images.csv", "  - {file: images.csv, fixed: [x, y, z]}")
    path.write_text(text)
    run, _ = adjusted(tmp_path, path)
    assert run.code == 4
    assert "point T is not determined in one direction" in run.err
    assert "observe it from a second place" in run.err


def test_a_strip_with_control_on_its_axis_is_told_to_tilt(tmp_path):
    scene = Scene()
    random = np.random.default_rng(3)
    held = []
    for k in range(12):
        for side in (-1.0, 0.0, 1.0):
            name = f"G{k}{'lmr'[int(side) + 1]}"
            known = side == 0.0 and k in (0, 6, 11)
            y, z = (0.0, 0.0) if known else (8.0 * side + random.uniform(-1, 1), random.uniform(-1, 1))
            scene.add("point", name, [4.0 * k, y, z], free=not known)
            held += [name] if known else []
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=False)
    names = list(scene.truth["point"])
    for i in range(5):
        scene.add("point", f"I{i}", [4.0 + 9.0 * i, 0.2, 25.0])
        scene.add("rotation", f"I{i}", np.eye(3))
        for name in names:
            if abs(scene.truth["point"][name][0] - 4.0 - 9.0 * i) < 14.0:
                scene.observe("image/mor", f"I{i}", f"I{i}", None, None, "camera", name, sigma=1e-3)
    run, _ = adjusted(tmp_path, project(tmp_path, scene, datum="fixed", held=held))
    assert run.code == 4
    assert "The observations leave 1 movement of the whole network open" in run.err
    assert "The network can tilt about the line through G0m, G6m, G11m." in run.err
    assert "Fix or observe coordinates" in run.err


def test_two_images_only_control_the_parallax_and_nothing_else(tmp_path):
    scene = Scene()
    points = add_object_points(scene)
    for name, position in (("I0", CAMERA_STATIONS[0]), ("I1", CAMERA_STATIONS[2])):
        add_image(scene, name, position, points)
    run, report = adjusted(tmp_path, project(tmp_path, scene))
    assert run.code == 0, run.err
    # 12 points: 48 image coordinates, 36 + 12 unknowns, 7 movements
    assert sum(float(row["r"]) for row in residuals(tmp_path)) == pytest.approx(len(points) - 5, abs=1e-6)
    for row in residuals(tmp_path):
        assert row["joint"] == row["joint_freedom"] == "", "one direction of a ray is controlled, not both"
    # which of the four rays' coordinates is wrong cannot be told: all have the same test
    tests = {}
    for row in residuals(tmp_path):
        tests.setdefault(row["to"], []).append(abs(float(row["w"])))
    for values in tests.values():
        np.testing.assert_allclose(values, values[0], rtol=1e-4)
    assert "redundancy n - u + d 7 (sum of redundancy numbers 7.000000)" in report


def test_a_plane_object_and_parallel_images_do_not_give_c_and_principal_point(tmp_path):
    scene = Scene()
    names = [scene.add("point", f"P{i}{j}", [1.0 * i, 1.0 * j, 0.0], free=False) for i in range(5) for j in range(4)]
    scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=False)
    for k, xy in enumerate(([1.0, 1.0], [3.0, 2.0], [2.0, 0.5])):
        scene.add("point", f"I{k}", [*xy, 10.0])
        scene.add("rotation", f"I{k}", np.eye(3))
        for name in names:
            scene.observe("image/mor", f"I{k}", f"I{k}", None, None, "camera", name, sigma=1e-3)
    path = project(
        tmp_path,
        scene,
        interior="{c: {free: 20}, xh: {free: 0}, yh: {free: 0}}",
        datum="fixed",
        noise=None,
        held=names,
    )
    run, _ = adjusted(tmp_path, path)
    assert run.code == 4
    assert run.err.count("These cannot be separated from each other: ") == 3
    for component in ("(c)", "(xh)", "(yh)"):
        assert f"the interior orientation of camera K {component}" in run.err
    assert "the position of image I0" in run.err
    assert "measure rolled images and points in depth" in run.err


def test_what_no_observation_refers_to_is_said_to_be_idle(tmp_path):
    """A camera without images, an instrument that nothing was measured with: no word of rolled images."""
    levels = LEVELLING.replace(
        "points:",
        "cameras: {Z: {interior: {c: {free: 10}}}}\ninstruments: {edm: {scale: {free: 1}}}\npoints:",
    )
    run = mor("adjust", write(tmp_path, levels), "-o", tmp_path / "out", "--quiet")
    assert run.code == 4
    said = " ".join((tmp_path / "out" / "report.txt").read_text().split())
    assert "No observation refers to the interior orientation of camera Z;" in said
    assert "No observation refers to distance meter edm;" in said
    assert "rolled images" not in said
