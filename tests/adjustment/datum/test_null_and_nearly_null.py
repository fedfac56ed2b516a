"""Null and nearly null directions told apart, with the count that geometry gives, not the program."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mor.quality.assessment import assess
from mor.solve.iterate import Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.datum_scenes import local_system
from tests.scenarios.scenes import Scene, add_image, add_object_points, mixed_network, photo_block

LENGTH, SIGMA = 1000.0, 1e-5


def _two_stations(difference: float) -> Scene:
    """Zenith angles there and back and a distance of unknown scale; targets stand higher by ``difference``/2.

    Point A is fixed, B may move in x and z. The sum of the two elevations is difference/x: that alone tells the scale.
    """
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [LENGTH, 0.0, 0.0], free=(True, False, True))
    scene.add("height", "instrument", [1.5], free=False)
    scene.add("height", "target", [1.5 + 0.5 * difference], free=False)
    scene.add("distance meter", "meter", [1.0, 0.0], free=(True, False))
    scene.add("refraction", "none at all", [0.0], free=False)
    for one, other in (("A", "B"), ("B", "A")):
        scene.observe(
            "zenith_angle",
            one,
            "instrument",
            other,
            "target",
            "none at all",
            sigma=SIGMA,
            constants=(1e12, 1.0),
        )
    scene.observe("horizontal_distance", "A", None, "B", None, "meter", sigma=1e-3)
    return scene


@pytest.mark.parametrize("difference", [0.2, 2e-2, 2e-3])
def test_heights_of_instruments_and_targets_tell_the_scale_of_the_distances_hardly(difference):
    scene = _two_stations(difference)
    adjustment = adjust(scene.problem(None, ["B"]), scene.start(0.0))
    assert adjustment.outcome is Outcome.CONVERGED
    assert adjustment.inverse.null.shape[1] == 0
    assert adjustment.defect.movements == ()
    quality = assess(adjustment)
    square = LENGTH**2 + (0.5 * difference) ** 2
    sigma = np.sqrt(2.0) * SIGMA * square / difference
    assert np.sqrt(quality.cofactors["point"][1, 0, 0]) == pytest.approx(sigma, rel=1e-6)
    assert quality.redundancy == 0
    assert quality.redundancy_sum == pytest.approx(0.0, abs=1e-6)


def test_equal_heights_tell_nothing_of_the_scale():
    scene = _two_stations(0.0)
    adjustment = adjust(scene.problem(np.random.default_rng(1), ["B"]), scene.start(0.0))
    assert adjustment.outcome is Outcome.CONVERGED
    assert adjustment.inverse.null.shape[1] == adjustment.defect.datum.shape[1] == 1
    assert adjustment.inverse.weak.shape[1] == 0
    quality = assess(adjustment)
    assert quality.redundancy == 1
    # the two zenith angles control each other, the distance of unknown scale controls nothing
    np.testing.assert_allclose(quality.groups[0].r[:, 0], [0.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(quality.groups[1].r[:, 0], [0.0], atol=1e-9)


def _tacheometry(sighted: bool, heights: bool, scale: bool) -> tuple[Scene, list[str]]:
    """Three levelled total stations and six points; stations sighted by each other or not; heights or scale unknown."""
    scene = Scene()
    places = np.array([[0.0, 0.0, 1.0], [80.0, 10.0, 4.0], [30.0, 90.0, -2.0]])
    targets = places.mean(axis=0) + 40.0 * np.random.default_rng(5).standard_normal((6, 3))
    stations = [scene.add("point", f"S{k}", xyz) for k, xyz in enumerate(places)]
    points = [scene.add("point", f"P{k}", xyz) for k, xyz in enumerate(targets)]
    scene.add("distance meter", "meter", [1.0, 0.0], free=(scale, False))
    scene.add("refraction", "none at all", [0.0], free=False)
    for k, station in enumerate(stations):
        scene.add("rotation", station, [0.0, 0.0, 0.5 + k], free=(False, False, True))
        scene.add("height", station, [1.4 + 0.1 * k], free=heights)
        for target in (*points, *(stations if sighted else ())):
            if target == station:
                continue
            scene.observe(
                "zenith_directions", station, station, station, target, None, "none at all",
                sigma=1e-5, constants=(1e12, 1.0),
            )  # fmt: skip
            scene.observe("distance", station, station, target, None, "meter", sigma=1e-3)
    return scene, [*points, *stations]


@pytest.mark.parametrize(
    ("sighted", "heights", "scale", "movements", "loose"),
    [
        (True, False, False, 4, 0),  # shifts and the turn about Z
        (True, True, False, 4, 0),
        (True, True, True, 5, 0),  # heights of instruments grow with the network
        (False, False, False, 4, 0),
        (False, True, False, 4, 3),  # each station may sink by what its instrument rises
        (False, True, True, 5, 3),
    ],
)
def test_unknown_scale_of_distances_beside_heights_of_instruments(sighted, heights, scale, movements, loose):
    scene, points = _tacheometry(sighted, heights, scale)
    adjustment = adjust(scene.problem(np.random.default_rng(2), points), scene.start(1e-4))
    assert adjustment.inverse.null.shape[1] == movements + loose
    assert adjustment.inverse.weak.shape[1] == 0
    assert len(adjustment.defect.undetermined) == loose
    assert adjustment.defect.datum.shape[1] == movements
    assert adjustment.outcome is (Outcome.SINGULAR if loose else Outcome.CONVERGED)
    told = [{(kind, block) for kind, block, _ in one.unknowns} for one in adjustment.defect.undetermined]
    assert sorted(told, key=sorted) == [{("point", f"S{k}"), ("height", f"S{k}")} for k in range(3)][:loose]


@pytest.mark.parametrize("scale", [True, False])
@pytest.mark.parametrize("rotation", [(True, True, True), (False, False, True), (False, False, False)])
@pytest.mark.parametrize("origin", list(itertools.product((True, False), repeat=3))[::2])
def test_a_frame_partly_fixed_leaves_a_movement_for_each_of_its_free_components(origin, rotation, scale):
    # all three coordinates of five points in one system: whatever the system may do, the network may do
    scene, points = local_system(origin=origin, rotation=rotation, scale=scale)
    adjustment = adjust(scene.problem(np.random.default_rng(3), points), scene.start(1e-4))
    expected = sum(origin) + sum(rotation) + int(scale)
    assert adjustment.inverse.null.shape[1] == expected
    assert adjustment.defect.datum.shape[1] == expected
    assert adjustment.defect.undetermined == ()
    assert adjustment.inverse.weak.shape[1] == 0
    assert adjustment.outcome is Outcome.CONVERGED
    dense = dense_system(adjustment.problem, adjustment.values)
    rank = np.linalg.matrix_rank(dense.A / np.linalg.norm(dense.A, axis=0), tol=1e-9)
    assert dense.A.shape[1] - rank == expected


@pytest.mark.parametrize("tilt", [0.0, 1e-3, 0.4])
def test_observed_levels_leave_the_turn_about_the_plumb_line_free_whatever_the_tilt(tilt):
    # two components of D e_Z of every image: exactly invariant, also where cameras look down obliquely
    scene, points = photo_block()
    for k in range(5):
        scene.observe("level", f"I{k}", sigma=1e-4)
    start = scene.start(1e-4)
    start["point"] = start["point"] @ np.array(
        [[np.cos(tilt), -np.sin(tilt), 0], [np.sin(tilt), np.cos(tilt), 0], [0, 0, 1.0]]
    )
    turned = start["rotation"] @ np.array(
        [[np.cos(tilt), -np.sin(tilt), 0.0], [np.sin(tilt), np.cos(tilt), 0.0], [0.0, 0.0, 1.0]]
    )
    adjustment = adjust(scene.problem(np.random.default_rng(4), points), {**start, "rotation": turned})
    assert adjustment.outcome is Outcome.CONVERGED
    assert adjustment.defect.movements == (
        "translation X", "translation Y", "translation Z", "rotation Z", "scale",
    )  # fmt: skip
    assert adjustment.inverse.null.shape[1] == 5
    assert adjustment.inverse.weak.shape[1] == 0


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3], ids=["mm", "m", "um"])
def test_columns_of_distortion_in_any_unit(unit):
    # A1 and A2 have derivatives of c³ and c⁵: over units from um to m these span thirty powers of ten
    scene = Scene()
    points = add_object_points(scene)
    free = np.array([True, True, True, True, True, *[False] * 5])
    scene.add("interior/mor", "camera", np.array([20.0 * unit, *[0.0] * 9]), free=free)
    stations = [[-4.0, -6.0, 1.2], [2.0, -8.5, 3.0], [8.5, -5.0, 0.4], [9.0, 8.0, 2.5], [1.0, 10.0, 1.0]]
    for number, position in enumerate(stations):
        add_image(scene, f"I{number}", position, points)
    rows = scene.groups["image/mor"]
    rows.sigma[:] = [np.full(2, 1e-3 * unit)] * len(rows.sigma)
    scene.observe("distance", "P0", None, "P10", None, sigma=1e-4)
    adjustment = adjust(scene.problem(np.random.default_rng(6), points), scene.start(0.0))
    assert adjustment.outcome is Outcome.CONVERGED
    assert adjustment.inverse.null.shape[1] == 6
    assert adjustment.inverse.weak.shape[1] == 0
    quality = assess(adjustment)
    assert quality.redundancy == 121 - (36 + 30 + 5) + 6
    assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-6)
    reference = _redundancy_numbers_in_mm()
    np.testing.assert_allclose(quality.groups[0].r, reference, atol=1e-6)


_IN_MM: list[np.ndarray] = []


def _redundancy_numbers_in_mm() -> np.ndarray:
    """By the dense system of the same block in mm."""
    if not _IN_MM:
        scene, points = photo_block(scale_bar=True)
        scene.free["interior/mor"]["camera"] = np.array([True, True, True, True, True, *[False] * 5])
        adjustment = adjust(scene.problem(np.random.default_rng(6), points), scene.start(0.0))
        dense = dense_system(adjustment.problem, adjustment.values)
        _IN_MM.append(dense.redundancy_numbers()[:120].reshape(60, 2))
    return _IN_MM[0]


def test_a_network_without_a_defect_has_neither():
    scene, _ = mixed_network()
    adjustment = adjust(scene.problem(np.random.default_rng(7)), scene.start(1e-3))
    assert adjustment.inverse.null.shape[1] == adjustment.inverse.weak.shape[1] == 0
