"""Projects with cameras in underwater housings: the port is found again, and its σ are honest."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document
from mor.errors import InputError
from mor.formats.calibration import FORMS
from tests.scenarios.ports import DOME, FLAT, test_field, write_project

test_field.__test__ = False
SIGMA = 5e-4
"""σ of the image coordinates, mm."""
FREE = {"flat": ("tilt_x", "tilt_y", "distance"), "dome": ("centre_x", "centre_y", "centre_z")}
PORTS = {"flat": FLAT, "dome": DOME}


@pytest.fixture(scope="module")
def fields():
    return {name: test_field(port) for name, port in PORTS.items()}


def rough(name):
    """Interior entries of a port whose pose is known to a centimetre or so."""
    port = PORTS[name]
    start = {**dict.fromkeys(FREE[name], 0.0), "distance": 0.05}
    return {key: f"{{free: {start[key]}}}" if key in FREE[name] else value for key, value in port.items()}


def project(tmp_path: Path, fields, name: str, random, **others) -> Path:
    points, seen = fields[name]
    errors = SIGMA * random.standard_normal((len(seen), 2))
    return write_project(tmp_path / "project.yaml", {**rough(name), **others}, points, seen, errors)


def components(result):
    return {row["component"]: row for row in result.cameras.frame.to_dicts()}


@pytest.mark.parametrize("name", PORTS)
def test_the_pose_of_a_port_is_found_again_without_start_values(tmp_path, fields, name):
    result = mor.adjust(project(tmp_path, fields, name, np.random.default_rng(7)))
    found = components(result)
    for key in FREE[name]:
        assert abs(found[key]["value"] - PORTS[name][key]) < 4.0 * found[key]["sigma"], key
    assert 0.8 < result.sigma0 < 1.2
    assert found["glass"]["unit"] == "m"
    assert result.to_dict()["redundancy_sum"] == pytest.approx(result.redundancy, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", PORTS)
def test_its_sigmas_are_honest(tmp_path, fields, name):
    random, normalised, ratios = np.random.default_rng(8), [], []
    for _ in range(100):
        result = mor.adjust(project(tmp_path, fields, name, random))
        found = components(result)
        errors = [(found[key]["value"] - PORTS[name][key]) / found[key]["sigma"] for key in FREE[name]]
        normalised.append(np.array(errors) * result.sigma0)  # σ are a posteriori
        ratios.append(result.sigma0**2)
    f = result.redundancy
    assert np.abs(np.mean(normalised, axis=0)).max() < 3.3 / np.sqrt(100)
    assert np.abs(np.mean(np.square(normalised), axis=0) - 1.0).max() < 3.3 * np.sqrt(2.0 / 100)
    assert abs(np.mean(ratios) - 1.0) < 3.3 * np.sqrt(2.0 / f / 100)


def test_a_dome_round_the_projection_centre_leaves_its_radius_undetermined(tmp_path):
    centred = {**DOME, "centre_x": 0, "centre_y": 0, "centre_z": 0}
    points, seen = test_field(centred)
    file = write_project(
        tmp_path / "project.yaml",
        {**centred, "radius": "{free: 0.08}"},
        points,
        seen,
        np.zeros((len(seen), 2)),
    )
    result = mor.adjust(file)
    assert result.outcome == "singular"
    assert "is not determined along radius" in result.report()


def test_lengths_are_those_of_the_project(tmp_path, fields):
    points, seen = fields["flat"]
    lengths = {"distance": "{free: 50}", "glass": 10}
    file = write_project(
        tmp_path / "mm.yaml", {**rough("flat"), **lengths}, 1e3 * points, seen, np.zeros((len(seen), 2))
    )
    file.write_text("units: {length: mm}\n" + file.read_text(encoding="utf-8"), encoding="utf-8")
    result = mor.adjust(file)
    distance = components(result)["distance"]
    assert (distance["value"], distance["unit"]) == (pytest.approx(60.0, abs=1e-3), "mm")
    assert re.search(r"^distance +mm ", result.report(), re.MULTILINE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"glass": -0.001}, "glass: found -0.001, expected 0 or more"),
        ({"n_water": 0.9}, "n_water: found 0.9, expected 1 or more"),
        ({"radius": 0.01}, "radius: found 0.01, but the centre is 0.0136"),
        ({"n_glass": None}, "n_glass is required for a dome-port"),
        ({"tilt_x": 0.1}, "unknown component 'tilt_x'"),
    ],
)
def test_what_no_port_can_be_is_said(tmp_path, change, message):
    interior = {key: value for key, value in {**DOME, **change}.items() if value is not None}
    file = write_project(tmp_path / "project.yaml", interior, np.zeros((1, 3)), [], np.zeros((0, 2)))
    with pytest.raises(InputError, match=re.escape(message)):
        mor.adjust(file)


def test_no_panorama_behind_a_port_and_no_export_without_it(tmp_path, fields):
    file = project(tmp_path, fields, "flat", np.random.default_rng(9))
    with pytest.raises(InputError, match=r"no model of OpenCV says what its model mor\+flat-port says"):
        FORMS["opencv"](read_document(file), tmp_path, tmp_path / "camera.yml")
    text = file.read_text(encoding="utf-8").replace("  C:\n", "  C:\n    model: panorama\n")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="a panorama has no single projection centre"):
        mor.adjust(file)
