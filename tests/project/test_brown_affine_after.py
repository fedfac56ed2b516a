"""Cameras of DBAT's models 4 and 5 through the whole program: the truth they were simulated with comes back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mor.types import FloatArray
from tests.scenarios.small_projects import CENTRES, OBJECT, attitude, mor, table, write

PROJECT = """\
mor: 1
cameras:
  K:
    model: %s
    interior: {c: {free: 19.8}, xh: {free: 0}, yh: {free: 0}, K1: {free: 0}, K2: 0, b1: {free: 0}, b2: {free: 0}}
points: [{file: points.csv, fixed: [x, y, z]}]
images: [{file: images.csv}]
observations: [{type: image, file: rays.csv, values: {sigma: 1 um}}]
"""
TRUTH = {"c": 20.0, "xh": 0.11, "yh": -0.07, "K1": 4e-4, "b1": 2e-3, "b2": -3e-3}


def correction(key: str, measured: FloatArray) -> FloatArray:
    """Corrected coordinates of measured ones (n, 2)."""
    _, xh, yh, k1, b1, b2 = TRUTH.values()
    stretch = 1.0 + b1 * (key == "brown-5")
    reduced = measured * [stretch, 1.0] - [xh, yh]
    x, y = (reduced * (1.0 + k1 * (reduced**2).sum(axis=1, keepdims=True))).T
    return np.column_stack(((1.0 + b1 * (key == "brown-4")) * x + b2 * y, y))


def measured(key: str, ideal: FloatArray) -> FloatArray:
    """Measured coordinates whose correction is ideal, by iteration."""
    found = ideal.copy()
    for _ in range(100):
        found = found + 0.7 * (ideal - correction(key, found))
    np.testing.assert_allclose(correction(key, found), ideal, rtol=0, atol=1e-13)
    return found


@pytest.mark.parametrize("key", ["brown-4", "brown-5"])
def test_truth_comes_back(key: str, tmp_path: Path) -> None:
    images, rays = [], []
    for k, centre in enumerate(CENTRES):
        D, angles = attitude(centre, 0.8 * k)
        star = (OBJECT - centre) @ D.T
        xy = measured(key, -TRUTH["c"] * star[:, :2] / star[:, 2:])
        images.append([f"I{k}", "K", *map(float, centre + 0.05), *angles])
        rays += [[f"I{k}", f"P{i}", *map(float, row)] for i, row in enumerate(xy)]
    path = write(
        tmp_path,
        PROJECT % key,
        points=table("id,x,y,z", [[f"P{i}", *map(float, xyz)] for i, xyz in enumerate(OBJECT)]),
        images=table("id,camera,x,y,z,omega,phi,kappa", images),
        rays=table("image,point,x,y", rays),
    )
    run = mor("adjust", path, "--json", "--quiet")
    assert run.code == 0, run.err
    data = json.loads(run.out)
    assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-7)
    (camera,) = data["cameras"]
    for name, value in TRUTH.items():
        assert camera["components"][name]["value"] == pytest.approx(value, rel=1e-6), name
    assert mor("adjust", path, "-o", tmp_path / "out", "--quiet", "--no-html").code == 0
