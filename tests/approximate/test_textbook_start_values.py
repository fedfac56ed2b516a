"""Published small examples: a collineation, two resections and a relative orientation."""

import json
from pathlib import Path

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from mor.start.bundle import image_bundle
from mor.start.killian import solutions_of_homography
from mor.start.relative_orientation import adjust_coplanarity
from mor.start.resection import ResectionOutcome, resect

EXAMPLES = Path(__file__).parents[1] / "reference" / "networks" / "worked-examples" / "small-computations.json"


@pytest.fixture
def examples():
    return json.loads(EXAMPLES.read_text(encoding="utf-8"))


def test_published_collineation_has_the_published_decompositions(examples):
    example = examples["homography"]
    K = np.array(example["K"])
    H = np.linalg.solve(K, np.array(example["H"]) @ K)
    axes = np.diag([1.0, -1.0, -1.0])
    H = axes @ H @ axes * np.sign(np.linalg.det(H))
    # The published solution sees every ray that lies well on its side of the plane; any such field will do.
    normal = axes @ np.array(example["published"]["n"])
    rays = normal + 0.2 * np.random.default_rng(0).normal(size=(6, 3))
    found = solutions_of_homography(H, rays, rays @ H.T)
    expected = example["solutions"]
    assert len(found) == 2
    matched = set()
    for solution in found:
        shift = -solution.rotation @ solution.base
        plane = np.outer(shift, solution.normal)
        for k, other in enumerate(expected):
            same = np.abs(axes @ np.array(other["R"]) @ axes - solution.rotation).max() < 1e-9
            if same and np.abs(np.outer(axes @ other["t"], axes @ other["n"]) - plane).max() < 1e-9:
                matched.add(k)
    assert matched == {0, 1, 2, 3}


def test_resection_of_wolf_and_dewitt(examples):
    example = examples["resection_wolf_dewitt"]
    xy, points = np.array(example["image_xy_mm"]), np.array(example["object_XYZ_m"])
    rays = np.column_stack([xy, np.full(len(xy), -example["f_mm"])])
    found = resect(image_bundle(rays, 0.003), points)
    result = example["result"]
    assert found.outcome in (ResectionOutcome.DETERMINED, ResectionOutcome.AMBIGUOUS)
    np.testing.assert_allclose(found.position, result["X0_m"], atol=1e-5)
    np.testing.assert_allclose(np.rad2deg(found.angles), result["omega_phi_kappa_deg"], atol=1e-7)
    assert found.sigma0 * 0.003 == pytest.approx(result["sigma0_mm"], rel=1e-6)


def test_resection_with_other_angles(examples):
    example = examples["resection_phi_omega_kappa"]
    xy, points = np.array(example["image_xy_mm"]), np.array(example["object_XYZ_m"])
    rays = np.column_stack([xy, np.full(len(xy), -example["f_mm"])])
    found = resect(image_bundle(rays, 0.007), points)
    np.testing.assert_allclose(found.position, example["result"]["Xs_m"], atol=1e-3)
    assert found.sigma0 * 0.007 == pytest.approx(example["result"]["sigma0_mm"], rel=1e-6)


def test_relative_orientation_of_dewitt(examples):
    """Six points: one more than the parameters, fewer than the closed form needs; the adjustment is
    compared."""
    example = examples["relative_orientation"]
    xy, result = np.array(example["observations_mm"]), example["result"]
    c = np.full((len(xy), 1), -example["f_mm"])
    a, b = image_bundle(np.hstack([xy[:, :2], c]), 1.0), image_bundle(np.hstack([xy[:, 2:], c]), 1.0)
    found = adjust_coplanarity(a, b, np.array([1.0, 0.0, 0.0]), np.eye(3))
    assert found.converged
    base = np.array([example["XL_mm"], result["YL_ZL_mm"][0], result["YL_ZL_mm"][1] - example["f_mm"]])
    np.testing.assert_allclose(found.base, base / np.linalg.norm(base), atol=1e-7)
    angles = np.deg2rad(result["omega_phi_kappa_right_deg"])
    np.testing.assert_allclose(found.rotation, rotation_from_angles(angles), atol=1e-7)
    assert np.sqrt(found.objective / 1) == pytest.approx(result["sigma0_mm"], rel=1e-6)
