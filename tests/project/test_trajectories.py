"""Trajectories and line scanners in a project file: one clear message for each mistake, and equivalent networks."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.errors import InputError
from mor.project.entities import Trajectory
from mor.quality.solution import Solved
from mor.report.estimates import image_table, point_table
from mor.report.text import text_report

SAMPLES = Path(__file__).resolve().parents[2] / "sample_projects"
STRIP = SAMPLES / "three_line_strip"


def strip(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """The sample with texts changed: file, old, new."""
    target = folder / "strip"
    shutil.copytree(STRIP, target)
    for file, old, new in changes:
        text = (target / file).read_text(encoding="utf-8")
        assert old in text, old
        (target / file).write_text(text.replace(old, new), encoding="utf-8")
    return target / "project.yaml"


def solved(path: Path) -> Solved:
    return solve_network(read_network(read_document(path), path.parent))


P = "project.yaml"
MISTAKES = [
    ("images.csv", "nadir,east,", "nadir,eest,", "images.csv:3: trajectory 'eest' does not exist"),
    (
        "images.csv",
        "nadir,east,200000",
        "nadir,east,199990",
        "images.csv:3: image 'nadir east': the time 199990 s is outs",
    ),
    (
        "images.csv",
        "nadir,east,200000.0000",
        "nadir,east,",
        "images.csv:3: image 'nadir east' is on a trajectory, but has",
    ),
    (
        "images.csv",
        "nadir,east,200000.0000",
        "nadir,,",
        "images.csv:3: image 'nadir east' is of a line scanner: it nee",
    ),
    (
        "gnss_ins.csv",
        "east,200003.0000",
        "east,200001.2000",
        "gnss_ins.csv:8: trajectory 'east': 200001.2 s comes after",
    ),
    (
        "gnss_ins.csv",
        "east,200003.0000",
        "east,200002.5000",
        "gnss_ins.csv:8: trajectory 'east': 200002.5 s is given tw",
    ),
    (
        "gnss_ins.csv",
        "east,200003.0000",
        "esat,200003.0000",
        "gnss_ins.csv:8: trajectory 'esat' has one row; a trajecto",
    ),
    (
        P,
        "line_time: 1.5 ms\n",
        "line_time: 0.0015\n",
        ":16: line_time: found 0.0015, expected a time with its unit",
    ),
    (
        P,
        "line_time: 1.5 ms\n",
        "line_time: -1.5 ms\n",
        ":16: line_time: found -1.5 ms, expected a time above 0",
    ),
    (P, "spacing: 1 s", "spacing: 1 m", ":27: spacing: unit 'm' does not fit a time"),
    (
        P,
        "spacing: 1 s",
        "gap: 0.2 s",
        "gnss_ins.csv:2: trajectory 'east': the stretch that begins at 200000 s has too few knots",
    ),
    (P, "spacing: 1 s", "spacing: 1 s\n    fixed: [x]", ":28: fixed: knots at a spacing are free"),
    (
        P,
        "spacing: 1 s",
        "spacing: 1 s\n    smoothness: {position: 1 m/s}",
        ":28: smoothness: position: unit 'm/s' does",
    ),
    (P, "instrument: gnss", "instrument: gns", ":52: instrument 'gns' does not exist; did you mean 'gnss'?"),
    (P, "{shift_x:", "{shiftx:", ":44: unknown component 'shiftx'; did you mean 'shift_x'?"),
    (
        P,
        "checks:",
        "settings: {dimensions: xy}\nchecks:",
        ":24: trajectories need settings: {dimensions: xyz}",
    ),
    (
        P,
        "line: 27.3",
        "line: 27.3\n    readout: 20 ms",
        ":18: a camera has a readout time or is a line scanner",
    ),
    (
        P,
        "checks:",
        '  - {type: distance, columns: [from, to, distance, sigma], rows: [["centre:nadir east", C1, 9, 1]]}\nchecks:',
        "image 'centre:nadir east' is on a trajectory: its projection centre cannot be named here",
    ),
]


@pytest.mark.parametrize(("file", "old", "new", "words"), MISTAKES, ids=[m[3][-40:] for m in MISTAKES])
def test_one_message_for_each_mistake(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    path = strip(tmp_path, (file, old, new))
    with pytest.raises(InputError) as raised:
        read_network(read_document(path), path.parent)
    told = [str(problem) for problem in raised.value.problems]
    assert len(told) == 1 or all("stretch" in one for one in told)
    assert words in told[0]


def test_a_row_before_the_flight_is_told_with_its_line(tmp_path: Path) -> None:
    path = strip(tmp_path)
    lines = (path.parent / "image_points.csv").read_text(encoding="utf-8").split("\n")
    lines[5] = ",".join([*lines[5].split(",")[:3], "-40"])
    (path.parent / "image_points.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=r"image_points.csv:6: the time 199999.94 s is outside the trajectory 'east'"):
        read_network(read_document(path), path.parent)


def test_gaps_are_outside() -> None:
    times = np.array([0.0, 1.0, 2.0, 10.0, 11.0])
    numbers = np.arange(5)
    found = Trajectory("t", times, np.array([0, 0, 0, 1, 1]), numbers, numbers, False)
    clock = found.clock(np.array([-0.1, 0.0, 2.0, 2.1, 10.0, 11.0, 11.1]))
    assert clock.inside.tolist() == [False, True, True, False, True, True, False]
    assert "it has a gap from 2 s to 10 s" in found.outside(5.0)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_knot_for_each_image_is_single_images(tmp_path: Path, interpolation: str) -> None:
    sample = tmp_path / "single"
    shutil.copytree(SAMPLES / "aerial_strip", sample)
    single = solved(sample / P)
    images = image_table(single).to_dicts()
    given = (sample / "images.csv").read_text(encoding="utf-8").splitlines()[1:]
    rows = {line.split(",")[0]: line.split(",")[2:] for line in given}
    knots, timed = [], []
    for number, image in enumerate(images):
        strip_, time = image["id"][0], number * 2.7 + 0.01 * number**2
        start = [repr(image[name]) for name in ("omega", "phi", "kappa")]
        knots.append(",".join([strip_, repr(time), *rows[image["id"]][:3], *start]))
        timed.append(",".join([image["id"], image["camera"], strip_, repr(time)]))
    head = "trajectory,time,x,y,z,omega,phi,kappa"
    (sample / "knots.csv").write_text("\n".join([head, *knots]) + "\n", encoding="utf-8")
    (sample / "images.csv").write_text("\n".join(["id,camera,trajectory,time", *timed]) + "\n", encoding="utf-8")
    text = (sample / P).read_text(encoding="utf-8")
    values = "    values: {sigma_x: 0.05, sigma_y: 0.05, sigma_z: 0.08}\n"
    assert values in text
    text = text.replace(values, "").replace(
        "images:\n",
        f"trajectories:\n  - file: knots.csv\n    interpolation: {interpolation}\n{values}images:\n",
    )
    (sample / P).write_text(text, encoding="utf-8")
    along = solved(sample / P)
    assert along.quality is not None
    assert single.quality is not None
    assert along.quality.redundancy == single.quality.redundancy
    assert along.quality.omega == pytest.approx(single.quality.omega, rel=1e-8)
    for table, names in (
        (point_table, ("x", "y", "z", "sx", "sz")),
        (image_table, ("x", "omega", "sx", "skappa")),
    ):
        one, other = table(single), table(along)
        for name in names:
            assert other[name].to_numpy() == pytest.approx(one[name].to_numpy(), rel=1e-8, abs=2e-8)


def test_lines_with_times_of_their_own_are_those_of_a_rate(tmp_path: Path) -> None:
    rate = solved(STRIP / P)
    rows = "".join(
        f"      - [{camera} {name}, {row}, {first + 0.0015 * row!r}]\n"
        for camera in ("forward", "nadir", "backward")
        for name, first in (("east", 200000.0), ("west", 200300.0))
        for row in (0, 9000, 23000)
    )
    table = f"line_times:\n  - columns: [image, row, time]\n    rows:\n{rows}points:\n"
    path = strip(
        tmp_path,
        (P, "    line_time: 1.5 ms\n", ""),
        (P, "line_time: 1.5 ms, ", ""),
        (P, "points:\n  - file: control", f"{table}  - file: control"),
        ("images.csv", ",200000.0000", ","),
        ("images.csv", ",200300.0000", ","),
    )
    own = solved(path)
    assert point_table(own)["x"].to_numpy() == pytest.approx(point_table(rate)["x"].to_numpy(), abs=1e-6)
    assert rate.quality is not None
    assert own.quality is not None
    assert own.quality.sigma0 == pytest.approx(rate.quality.sigma0, rel=1e-7)
    assert rate.quality.redundancy_sum == pytest.approx(rate.quality.redundancy, abs=1e-6)
    assert "Misalignment of inertial systems" in text_report(rate)


def test_a_knot_that_nothing_observes_is_named(tmp_path: Path) -> None:
    text = (STRIP / P).read_text(encoding="utf-8")
    ins = text[text.index("  - type: trajectory_attitude") : text.index("  - type: image")]
    gnss = text[text.index("  - type: trajectory_position") : text.index("  - type: trajectory_attitude")]
    found = solved(strip(tmp_path, (P, gnss, ""), (P, ins, "")))
    said = text_report(found)
    assert not found.adjustment.outcome.is_solution
    assert "the rotation of knot east@200000, " in " ".join(said.split())
    assert "constancy or smoothness" in " ".join(said.split())


def test_smoothness_bridges_knots_without_attitudes(tmp_path: Path) -> None:
    text = (STRIP / P).read_text(encoding="utf-8")
    ins = text[text.index("  - type: trajectory_attitude") : text.index("  - type: image")]
    smooth = "spacing: 1 s\n    smoothness: {attitude: 0.5 deg/s^2}"
    other = text.replace(ins, "").replace("spacing: 1 s", smooth)
    other = other[: other.index("  ins:\n")] + other[other.index("observations:\n") :]
    path = strip(tmp_path)
    path.write_text(other, encoding="utf-8")
    found = solved(path)
    assert found.quality is not None
    assert found.quality.redundancy_sum == pytest.approx(found.quality.redundancy, abs=1e-6)
    assert found.network.trajectories["east"].order == 4
