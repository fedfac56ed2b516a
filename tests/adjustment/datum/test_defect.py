"""What is found to be undetermined: movements of the network by name, and what hangs loose inside it."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from mor.quality.assessment import assess
from mor.solve import datum as undetermined
from mor.solve.iterate import Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.datum_scenes import local_system, theodolites
from tests.scenarios.scenes import (
    add_image,
    levelling_network,
    photo_block,
    plane_network,
)

TRANSLATION = {"translation X", "translation Y", "translation Z"}
ROTATION = {"rotation X", "rotation Y", "rotation Z"}


def defect_of(scene, points, disturbed=1e-3):
    problem = scene.problem(np.random.default_rng(1), points)
    return adjust(problem, scene.start(disturbed))


def loose_blocks(adjustment):
    """The blocks each undetermined direction moves."""
    return [{(kind, block) for kind, block, _ in one.unknowns} for one in adjustment.defect.undetermined]


NETWORKS = {
    "plane, distances": (plane_network, {"translation X", "translation Y", "rotation Z"}),
    "plane, directions": (
        lambda: plane_network(distances=False, directions=True),
        {"translation X", "translation Y", "rotation Z", "scale"},
    ),
    "plane, both": (lambda: plane_network(directions=True), {"translation X", "translation Y", "rotation Z"}),
    "levelling": (levelling_network, {"translation Z"}),
    "bundle": (photo_block, TRANSLATION | ROTATION | {"scale"}),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), TRANSLATION | ROTATION),
    "theodolites, full orientation": (lambda: theodolites("free"), TRANSLATION | ROTATION | {"scale"}),
    "theodolites, levelled": (lambda: theodolites("fixed"), TRANSLATION | {"rotation Z", "scale"}),
    "theodolites, level in their axes": (lambda: theodolites("axes"), TRANSLATION | {"rotation Z", "scale"}),
    "local system, all free": (local_system, TRANSLATION | ROTATION | {"scale"}),
    "local system, scale fixed": (lambda: local_system(scale=False), TRANSLATION | ROTATION),
    "local system, levelled": (
        lambda: local_system(rotation=(False, False, True), level=True),
        TRANSLATION | {"rotation Z", "scale"},
    ),
    "local system, origin fixed, offset free": (
        lambda: local_system(origin=False, offset=True),
        TRANSLATION | ROTATION | {"scale"},
    ),
    "plane through a fixed origin, offset free": (
        lambda: local_system(
            origin=False, rotation=(True, True, False), scale=False, offset=(False, False, True), only=(2,)
        ),
        TRANSLATION | ROTATION,
    ),
    "plane with an origin that moves along z only": (
        lambda: local_system(origin=(False, False, True), rotation=(True, True, False), scale=False, only=(2,)),
        TRANSLATION | ROTATION,
    ),
}


@pytest.mark.parametrize("network", NETWORKS)
def test_the_movements_of_a_free_network_are_found_and_named(network):
    make, movements = NETWORKS[network]
    scene, points = make()
    adjustment = defect_of(scene, points)
    assert adjustment.defect.undetermined == ()
    assert sorted(adjustment.defect.movements) == sorted(movements)
    assert adjustment.outcome is Outcome.CONVERGED


@pytest.mark.parametrize("network", NETWORKS)
def test_null_vectors_change_no_observation(network):
    make, movements = NETWORKS[network]
    scene, points = make()
    adjustment = defect_of(scene, points)
    null = adjustment.inverse.null
    assert null.shape[1] == len(movements)
    dense = dense_system(adjustment.problem, adjustment.values)
    rows = dense.A / np.linalg.norm(dense.A, axis=1, keepdims=True)
    assert np.abs(rows @ (null / np.linalg.norm(null, axis=0))).max() < 1e-11
    assert np.linalg.matrix_rank(dense.A / np.linalg.norm(dense.A, axis=0), tol=1e-9) == dense.A.shape[1] - len(
        movements
    )


def test_a_datum_that_is_partly_given_leaves_a_combination():
    # one fixed point: turn and scale about it are free, neither about the centre of the network
    scene, points = plane_network(distances=False, directions=True, fixed=["N0"])
    adjustment = defect_of(scene, points[1:])
    assert adjustment.defect.undetermined == ()
    assert adjustment.defect.datum.shape[1] == 2
    assert adjustment.outcome is Outcome.CONVERGED


def test_without_a_free_datum_a_defect_is_an_error():
    scene, _ = plane_network()
    adjustment = defect_of(scene, None)
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.reason == "the datum is not defined"
    assert set(adjustment.defect.movements) == {"translation X", "translation Y", "rotation Z"}


def test_datum_points_that_do_not_settle_the_datum():
    scene, points = photo_block()
    adjustment = defect_of(scene, points[:1])
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.reason == "the datum points do not define the datum"


@pytest.mark.parametrize("free_datum", [True, False])
def test_a_point_seen_once_is_named_and_nothing_else(free_datum):
    scene, points = photo_block()
    if not free_datum:
        for name in ("P0", "P4", "P11"):
            scene.free["point"][name] = np.zeros(3, dtype=bool)
    scene.add("point", "lonely", [1.0, 1.0, 1.0])
    scene.observe("image/mor", "I0", "I0", None, None, "camera", "lonely", sigma=1e-3)
    adjustment = defect_of(scene, points if free_datum else None)
    assert adjustment.outcome is Outcome.SINGULAR
    assert loose_blocks(adjustment) == [{("point", "lonely")}]
    assert len(adjustment.defect.movements) == (7 if free_datum else 0)
    # it is loose along its ray
    along = np.zeros(3)
    (one,) = adjustment.defect.undetermined
    for (_, _, component), amount in zip(one.unknowns, one.amounts, strict=True):
        along["xyz".index(component)] = amount
    ids = scene.number("point", "lonely"), scene.number("point", "I0")
    ray = adjustment.values["point"][ids[0]] - adjustment.values["point"][ids[1]]
    assert np.linalg.norm(np.cross(along, ray)) < 2e-3 * np.linalg.norm(along) * np.linalg.norm(ray)


def test_a_single_new_point_does_not_pass_for_the_network():
    # it is all that could move, and its movement is a "translation"; the fixed points say that it is none
    scene, _ = plane_network(fixed=[f"N{i}" for i in range(5)])
    scene.add("point", "new", [30.0, 40.0, 0.0], free=(True, True, False))
    scene.observe("horizontal_distance", "N0", None, "new", None, sigma=1e-3)
    adjustment = defect_of(scene, ["new"])
    assert adjustment.defect.movements == ()
    assert loose_blocks(adjustment) == [{("point", "new")}]


def test_a_bench_mark_whose_position_nothing_looks_at_does_not_hold_the_network():
    scene, points = photo_block(scale_bar=True)
    scene.add("point", "bench mark", [100.0, 50.0, 2.0], free=False)
    scene.observe("height_difference", "bench mark", None, "P0", None, sigma=1e-3)
    adjustment = defect_of(scene, points)
    assert adjustment.defect.undetermined == ()
    assert adjustment.defect.datum.shape[1] == 5
    assert {"translation X", "translation Y"} <= set(adjustment.defect.movements)
    assert adjustment.outcome is Outcome.CONVERGED


def test_several_loose_things_are_told_apart():
    scene, points = photo_block()
    for name in ("one", "two"):
        scene.add("point", name, [1.0, 1.0 + 0.1 * len(name), 1.0])
        scene.observe("image/mor", "I1", "I1", None, None, "camera", name, sigma=1e-3)
    scene.add("point", "unseen", [0.0, 0.0, 0.0])
    adjustment = defect_of(scene, points)
    found = loose_blocks(adjustment)
    assert sorted(found, key=str) == sorted(
        [{("point", "one")}, {("point", "two")}, *[{("point", "unseen")}] * 3], key=str
    )
    unseen = [one.unknowns for one in adjustment.defect.undetermined if ("point", "unseen", "x") in one.unknowns]
    assert unseen == [(("point", "unseen", "x"),)]


def test_an_image_that_too_few_points_tie_is_named():
    scene, points = photo_block()
    add_image(scene, "I9", [3.0, -9.0, 5.0], points[:2])  # two points: four equations for six unknowns
    adjustment = defect_of(scene, points)
    assert len(adjustment.defect.undetermined) == 2
    assert set.union(*loose_blocks(adjustment)) == {("point", "I9"), ("rotation", "I9")}


def test_two_networks_without_a_tie_are_loose_against_each_other():
    scene, points = plane_network()
    for name, xy in (("M0", [300.0, 0.0]), ("M1", [330.0, 10.0]), ("M2", [310.0, 40.0])):
        scene.add("point", name, [*xy, 0.0], free=(True, True, False))
    for one, other in (("M0", "M1"), ("M1", "M2"), ("M0", "M2")):
        scene.observe("horizontal_distance", one, None, other, None, sigma=1e-3)
    adjustment = defect_of(scene, points)
    assert len(adjustment.defect.undetermined) == 3
    assert len(adjustment.defect.movements) == 3
    assert {("point", "M0"), ("point", "M1"), ("point", "M2")} <= set.union(*loose_blocks(adjustment))


def test_levels_as_object_angles_leave_the_turn_determined_with_a_huge_sigma():
    # ω and φ are tilts about axes of the object: turning the network by θ changes ω by φ θ. With tilts of the size of
    # their σ the turn is "determined" with a σ of a radian; it is weak, not null, and must not be lost either way.
    scene, points = theodolites("angles")
    for number, (omega, phi) in enumerate([(1.3e-4, -0.7e-4), (-0.4e-4, 1.1e-4), (0.9e-4, 0.8e-4)]):
        angles = np.array([omega, phi, 0.3 + number])
        scene.truth["rotation"][f"S{number}"] = rotation_from_angles(angles)
    adjustment = adjust(scene.problem(None, points), scene.start(1e-6))
    assert adjustment.outcome is Outcome.CONVERGED
    assert set(adjustment.defect.movements) == TRANSLATION | {"scale"}
    quality = assess(adjustment)
    assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-8)
    sigma = np.sqrt(quality.cofactors["rotation"][:, 2, 2])
    # the mean tilt is a tilt of the whole network and tells nothing of the turn
    tilts = np.array([[1.3, -0.7], [-0.4, 1.1], [0.9, 0.8]])
    np.testing.assert_allclose(sigma, 1.0 / np.linalg.norm(tilts - tilts.mean(axis=0)), rtol=1e-2)


def test_a_large_null_space_is_told_in_echelon_form(monkeypatch):
    """As many directions, of the same blocks, each with an unknown of its own that no other one moves."""
    scene, points = photo_block()
    for name, place in (("I8", [-3.0, -9.0, 5.0]), ("I9", [3.0, -9.0, 5.0])):
        add_image(scene, name, place, points[:2])
    sparse = defect_of(scene, points)
    monkeypatch.setattr(undetermined, "_SPARSEST", 0)
    echelon = defect_of(scene, points)
    assert len(echelon.defect.undetermined) == len(sparse.defect.undetermined) == 4
    assert set.union(*loose_blocks(echelon)) == set.union(*loose_blocks(sparse))
    named = [set(one.unknowns) for one in echelon.defect.undetermined]
    for k, own in enumerate(named):
        assert own - set.union(*(other for j, other in enumerate(named) if j != k))
