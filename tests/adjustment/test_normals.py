"""Normal equations of a plan against AᵀPA and AᵀPl worked out densely, with correlations."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import compilation
from mor.solve.normals import build_normals, image_of, make_plan, objective
from tests.dense_reference import dense_system
from tests.scenarios.scenes import Scene, levelling_network, mixed_network, photo_block, plane_network


def image_variant_block() -> tuple[Scene, list[str]]:
    """Cameras that share everything but the camera constant, with observed differences of it."""
    scene, points = photo_block(scale_bar=True)
    for number in range(3):
        name = f"camera {number}"
        shares = dict.fromkeys(range(1, 10), "camera")
        scene.add("interior/mor", name, [20.0, *[0.0] * 9], free=(True, *[False] * 9), shares=shares)
        scene.observe("difference/interior/mor", "camera", name, sigma=0.01, only=(0,))
        rows = scene.groups["image/mor"]
        rows.names = [
            tuple(name if (part, row[0]) == ("camera", f"I{number}") else part for part in row) for row in rows.names
        ]
    scene.free["interior/mor"]["camera"] = np.array([True, True, True, *[False] * 7])
    return scene, points


SCENES = {
    "mixed": mixed_network,
    "photo": photo_block,
    "plane": lambda: plane_network(directions=True),
    "levelling": levelling_network,
    "image-variant": image_variant_block,
}


@pytest.fixture(params=SCENES)
def system(request):
    scene, _ = SCENES[request.param]()
    problem, values = scene.problem(np.random.default_rng(3)), scene.start(0.02)
    return make_plan(problem), values, dense_system(problem, values)


@pytest.mark.parametrize("way", [pytest.param("compiled", marks=pytest.mark.kernels), "plain"])
def test_normal_equations_against_dense_ones(system, way, monkeypatch):
    if way == "plain":
        monkeypatch.setattr(compilation, "available", False)
    plan, values, dense = system
    normals = build_normals(plan, values)
    size = np.sqrt(np.diagonal(dense.normal))
    np.testing.assert_allclose(
        normals.matrix.to_dense() / np.outer(size, size), dense.normal / np.outer(size, size), atol=1e-13
    )
    scale = np.sqrt(dense.l @ dense.weights @ dense.l)
    np.testing.assert_allclose(
        normals.rhs / size / scale, dense.A.T @ dense.weights @ dense.l / size / scale, atol=1e-13
    )
    assert normals.objective == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-12)


def test_objective_alone_is_the_same(system):
    plan, values, dense = system
    assert objective(plan, values) == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-12)


def test_image_of_directions(system):
    plan, values, dense = system
    directions = np.random.default_rng(2).standard_normal((dense.A.shape[1], 4))
    expected = directions.T @ dense.normal @ directions
    np.testing.assert_allclose(image_of(plan, values, directions), expected, rtol=1e-9)


def test_a_cluster_over_several_groups_and_parts_of_rows():
    # a control point's coordinates, a distance and a height difference, correlated with each other
    scene, _ = plane_network()
    scene.free["point"]["N1"] = np.ones(3, dtype=bool)
    one = scene.observe("observed/point", "N1", sigma=1.0)
    two = scene.observe("height_difference", "N0", None, "N1", None, sigma=1.0)
    scene.observe("height_difference", "N2", None, "N1", None, sigma=1e-3)
    factor = np.random.default_rng(5).standard_normal((5, 5))
    entries = [(*two, 0), (*one, 2), (*one, 0), ("horizontal_distance", 3, 0), (*one, 1)]
    scene.correlate(entries, factor @ factor.T + 0.5 * np.eye(5))
    problem, values = scene.problem(np.random.default_rng(1)), scene.start(0.01)
    dense = dense_system(problem, values)
    normals = build_normals(make_plan(problem), values)
    np.testing.assert_allclose(normals.matrix.to_dense(), dense.normal, rtol=1e-11, atol=1e-9 * dense.normal.max())
    assert normals.objective == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-12)


def test_objective_is_infinite_where_an_equation_has_no_value():
    scene, _ = plane_network()
    problem, values = scene.problem(), scene.values()
    values["point"][0, 0] = np.nan
    assert objective(make_plan(problem), values) == np.inf
