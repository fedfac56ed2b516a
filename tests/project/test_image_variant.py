"""Interior components that every image has of its own, without a σ of their difference from the camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.small_projects import CENTRES, OBJECT, C, attitude, mor, table, write

PROJECT = """\
mor: 1
cameras: {K: {interior: {INTERIOR}, image_variant: VARIANT}}
points: [{file: points.csv, fixed: [x, y, z]}]
images: [{file: images.csv}]
observations:
  - {type: image, file: rays.csv, values: {sigma: 1 um}}
"""
CONSTANTS = C + np.array([0.0, 0.4, -0.3, 0.1])


def adjusted(folder: Path, interior: str, more: str = "", variant: str = "[c]") -> dict[str, Any]:
    images, rays = [], []
    random = np.random.default_rng(2)
    for k, centre in enumerate(CENTRES):
        D, angles = attitude(centre, 0.8 * k)
        star = (OBJECT - centre) @ D.T
        xy = -CONSTANTS[k] * star[:, :2] / star[:, 2:] + 0.001 * random.standard_normal((len(OBJECT), 2))
        images.append([f"I{k}", "K", *map(float, centre + 0.05), *angles])
        rays += [[f"I{k}", f"P{i}", *map(float, row)] for i, row in enumerate(xy)]
    path = write(
        folder,
        PROJECT.replace("INTERIOR", interior).replace("VARIANT", variant) + more,
        points=table("id,x,y,z", [[f"P{i}", *map(float, xyz)] for i, xyz in enumerate(OBJECT)]),
        images=table("id,camera,x,y,z,omega,phi,kappa", images),
        rays=table("image,point,x,y", rays),
    )
    run = mor("adjust", path, "--json", "--quiet")
    assert run.code == 0, run.err
    data: dict[str, Any] = json.loads(run.out)
    return data


def numbers(component: dict[str, Any]) -> list[float]:
    return [component["value"], component["sigma"]]


def test_the_camera_has_no_value_of_its_own(tmp_path: Path) -> None:
    """Free in the camera, as it is where nothing is said, it is where the images start: no unknown."""
    free = adjusted(tmp_path / "free", "c: {free: 20.1}, xh: {free: 0}")
    fixed = adjusted(tmp_path / "fixed", "c: 20.1, xh: {free: 0}")
    assert free["unknowns"] == fixed["unknowns"] == 4 * 7 + 1
    for one, other, truth in zip(free["images"], fixed["images"], CONSTANTS, strict=True):
        c = one["interior"]["c"]
        assert numbers(c) == pytest.approx(numbers(other["interior"]["c"]), rel=1e-9)
        assert abs(c["value"] - truth) < 4 * c["sigma"]


def test_a_difference_from_the_camera_gives_it_one(tmp_path: Path) -> None:
    rows = ", ".join(f"[camera K, image I{k}, c, 0, 0.5]" for k in range(4))
    columns = "columns: [from, to, component, value, sigma]"
    row = f"  - {{type: difference, {columns}, rows: [{rows}]}}\n"
    told = adjusted(tmp_path / "told", "c: {free: 20.1}", row)
    varied = adjusted(tmp_path / "varied", "c: {free: 20.1}", variant="{c: 0.5}")
    assert told["unknowns"] == varied["unknowns"] == 4 * 7 + 1
    one, other = (numbers(data["cameras"][0]["components"]["c"]) for data in (told, varied))
    assert one == pytest.approx(other, rel=1e-7)
    assert one[0] == pytest.approx(CONSTANTS.mean(), abs=0.05)


def test_an_exact_difference_from_the_camera_gives_it_one(tmp_path: Path) -> None:
    columns = "columns: [from, to, component, value, sigma]"
    row = f"  - {{type: difference, {columns}, rows: [[camera K, image I0, c, 0, 0]]}}\n"
    data = adjusted(tmp_path, "c: {free: 20.1}", row)
    assert data["unknowns"] == 4 * 7
    found, image = data["cameras"][0]["components"]["c"], data["images"][0]["interior"]["c"]
    assert found["value"] == pytest.approx(image["value"], rel=1e-12)
