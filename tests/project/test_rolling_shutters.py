"""Readout times and motions in project files: what they mean, what is wrong with them, and what comes out again."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network
from mor.model.images import phases
from tests.mistakes import mistakes
from tests.scenarios.small_projects import mor

SAMPLE = Path(__file__).resolve().parents[2] / "sample_projects" / "drone_block"
PROJECT = (SAMPLE / "project.yaml").read_text(encoding="utf-8")
READOUT = "    readout: {free: 20 ms}\n"
SIGMAS = "sigma_vx: 0.3, sigma_vy: 0.3, sigma_vz: 0.3, sigma_rate_x: 0.3, sigma_rate_y: 0.3, sigma_rate_z: 0.3"


def drone(folder: Path, *changes: tuple[str, str], strips: str = "24") -> Path:
    """Some strips of the sample, with changes of its project file."""
    text = PROJECT
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    folder.mkdir(parents=True, exist_ok=True)
    for file in SAMPLE.glob("*.csv"):
        (folder / file.name).write_bytes(file.read_bytes())
    for name, lines in some_strips(strips).items():
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "project.yaml").write_text(text, encoding="utf-8")
    return folder / "project.yaml"


def some_strips(strips: str) -> dict[str, list[str]]:
    """Images of some strips and their points: not the whole sample, for the sake of time."""
    images, rays, points = (
        (SAMPLE / name).read_text(encoding="utf-8").splitlines()
        for name in ("images.csv", "image_points.csv", "points.csv")
    )
    kept = [line for line in rays[1:] if line[0] in strips]
    count = Counter(line.split(",")[1] for line in kept)
    return {
        "images.csv": [images[0], *(line for line in images[1:] if line[0] in strips)],
        "image_points.csv": [rays[0], *(line for line in kept if count[line.split(",")[1]] > 2)],
        "points.csv": [points[0], *(name for name in points[1:] if count[name] > 2)],
    }


def results(project: Path, folder: Path) -> dict[str, object]:
    run = mor("adjust", project, "--no-html", "-o", folder)
    assert run.code == 0, run.err
    found: dict[str, object] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return found


def test_a_readout_time_of_0_is_a_frame_image_to_the_last_digit(tmp_path: Path) -> None:
    for name, more in (("none", ""), ("zero", r"    readout: 0\n    readout_direction: up\n")):
        folder = tmp_path / name
        shutil.copytree(SAMPLE.parent / "facade", folder)
        text = (folder / "project.yaml").read_text(encoding="utf-8")
        changed, count = re.subn(r"(?m)^cameras:\n  \S+:\n", rf"\g<0>{more}", text)
        assert count == 1
        (folder / "project.yaml").write_text(changed, encoding="utf-8")
        results(folder / "project.yaml", folder / "out")
    for file in ("images.csv", "points.csv", "residuals.csv"):
        one, other = ((tmp_path / name / "out" / file).read_bytes() for name in ("none", "zero"))
        assert one == other, file


@pytest.mark.parametrize("direction", ["down", "up", "right", "left"])
@pytest.mark.parametrize("model", ["mor", "opencv"])
def test_time_runs_from_one_edge_of_the_image_to_the_other(tmp_path: Path, direction: str, model: str) -> None:
    interior = ("model: mor", "c: {free: 8.8}") if model == "mor" else ("model: opencv", "fx: 8.8\n      fy: 8.8")
    body = PROJECT[PROJECT.index("    interior:") : PROJECT.index("images:")]
    project = drone(
        tmp_path,
        ("readout_direction: down", f"readout_direction: {direction}"),
        (body, f"    {interior[0]}\n    interior:\n      {interior[1]}\n\n"),
        ("    r0: 5\n", "    r0: 5\n" if model == "mor" else ""),
    )
    group = read_network(read_document(project), tmp_path).groups[0]
    rows = [line.split(",") for line in (tmp_path / "image_points.csv").read_text().splitlines()[1:]]
    column, row = np.array([[float(x), float(y)] for _, _, x, y in rows]).T
    part = {"down": row / 3648, "up": 1 - row / 3648, "right": column / 5472, "left": 1 - column / 5472}
    found = phases(group.constants[:, :2], group.constants[:, -3:])
    np.testing.assert_allclose(found, part[direction] - 0.5, atol=1e-12)


@pytest.mark.slow
def test_adjusted_project_comes_to_rest_at_once_at_the_same_place(tmp_path: Path) -> None:
    first = results(drone(tmp_path / "a"), tmp_path / "one")
    again = results(tmp_path / "one" / "adjusted.yaml", tmp_path / "two")
    assert again["iterations"] == 1
    one, other = (found["others"][0]["components"]["readout"] for found in (first, again))  # type: ignore[index]
    assert other["value"] == pytest.approx(one["value"], rel=1e-7)
    assert other["sigma"] == pytest.approx(one["sigma"], rel=1e-6)
    readout = first["others"][0]["components"]["readout"]  # type: ignore[index]
    assert abs(readout["value"] - 0.03) < 4.5 * readout["sigma"]


def test_motions_are_said_in_the_units_of_the_project(tmp_path: Path) -> None:
    results(drone(tmp_path / "a"), tmp_path / "out")
    lines = (SAMPLE / "truth" / "images.csv").read_text(encoding="utf-8").splitlines()
    truth = [line.split(",") for line in lines if line[0] in "i24"]
    found = [line.split(",") for line in (tmp_path / "out" / "images.csv").read_text().splitlines()]
    places = [found[0].index(name) for name in truth[0][8:]]
    spreads = [found[0].index(f"s{name}") for name in truth[0][8:]]
    ratios = [
        (float(row[k]) - float(true)) / float(row[s])
        for row, known in zip(found[1:], truth[1:], strict=True)
        for k, s, true in zip(places, spreads, known[8:], strict=True)
    ]
    assert np.abs(ratios).max() < 4.5
    assert 0.85 < np.sqrt(np.mean(np.square(ratios))) < 1.15


def test_what_nothing_tells_is_named(tmp_path: Path) -> None:
    free = "free: [vx, vy, vz, rate_x, rate_y, rate_z]"
    gnss = "sigma_x: 0.02, sigma_y: 0.02, sigma_z: 0.03"
    start, end = PROJECT.index("    values: {sigma_x: 0.02"), PROJECT.index("points:\n")
    sigmas = PROJECT[start:end]
    loose = drone(tmp_path / "a", (sigmas, f"    values: {{{gnss}}}\n    {free}\n\n"), strips="4")
    run = mor("adjust", loose, "--no-html", "-o", tmp_path / "one")
    assert run.code == 4
    assert "its readout time and the motions of its images act by their product alone" in run.err + run.out
    still = drone(tmp_path / "b", (sigmas, f"    values: {{{gnss}}}\n\n"), strips="4")
    table = still.parent / "images.csv"
    lines = [",".join(line.split(",")[:8]) for line in table.read_text().splitlines()]
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    run = mor("adjust", still, "--no-html", "-o", tmp_path / "two", "--lang", "de")
    assert run.code == 4
    assert "keines ihrer Bilder bewegt sich" in run.err + run.out


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (READOUT, "    readout: -3 ms\n", "readout: found -0.003 s, expected 0 or more"),
        (READOUT, "    readout: 30 mm\n", "readout: unit 'mm' does not fit a time, expected as in s"),
        ("readout_direction: down", "readout_direction: across", "'down', 'up', 'right' or 'left'"),
        ("sigma_vx: 0.3,", "sigma_vx: 0.3 deg/s,", "unit 'deg/s' does not fit, expected as in m/s"),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, said: str) -> None:
    project = drone(tmp_path / "p", (old, new))
    if said:
        assert any(said in line for line in mistakes(project)), mistakes(project)


def test_a_readout_time_needs_the_format_of_the_image(tmp_path: Path) -> None:
    image = "    image: {width: 5472, height: 3648, pixel: 2.4 um}\n    coordinates: corner\n"
    project = drone(tmp_path / "p", (image, ""))
    assert any("readout needs image: {width, height, pixel}" in line for line in mistakes(project))


def test_a_motion_without_readout_time_is_noted(tmp_path: Path) -> None:
    project = drone(tmp_path / "p", (READOUT, ""))
    run = mor("check", project)
    assert "camera drone has no readout time: the motion of its images has no effect" in run.err + run.out


def test_parameters_and_differences_of_motions(tmp_path: Path) -> None:
    more = (
        "  - type: parameter\n    columns: [of, component, value, sigma]\n"
        "    rows: [[camera drone, readout, 31 ms, 1 ms]]\n"
        "  - type: difference\n    columns: [from, to, component, value, sigma]\n"
        "    rows: [[image 4_01, image 4_02, vy, 0, 0.5], [image 4_01, image 4_02, rate_x, 0, 4]]\n\nchecks:"
    )
    project = drone(tmp_path / "p", ("checks:", more))
    found = results(project, tmp_path / "out")
    groups = {row["name"]: row for row in found["groups"]}  # type: ignore[attr-defined]
    assert groups["parameter 2"]["observations"] == 1
    assert groups["parameter 2"]["redundancy"] > 0.5
    assert groups["difference 3"]["observations"] >= 1
