"""Input that is well-formed and cannot be computed with: refused with its line, no internal error and no number."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from tests.scenarios.kinds_of_projects import KINDS
from tests.scenarios.small_projects import BLOCK, LEVELLING, mor, write, write_block

TRIANGLE = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10], [B, 100, 0, 11]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[C, 50, 80, 12]]}
observations:
  - {type: distance, columns: [from, to, distance, sigma], rows: [[A, C, 94.36, 0.002], [B, C, 94.35, 0.002]]}
  - {type: zenith_angle, columns: [from, to, zenith_angle, sigma], rows: [[A, C, 98.65, 1 mgon], [B, C, 99.3, 1 mgon]]}
"""
DISTANCE = "{type: distance,"
OF_C = "{columns: [id, x, y, z], rows: [[C, 50, 80, 12]]}"
INTERIOR = "{interior: {c: 20}}"


def refused(project: Path, line: int) -> str:
    """What is said of a project that is refused, without its place."""
    run = mor("adjust", project)
    assert run.code == 2, run.err
    assert not (project.parent / "project.results").exists()
    place = f"{project}:{line}: "
    assert run.err.startswith(place)
    return run.err.splitlines()[0].removeprefix(place)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[C, 50", "[C, 1e160", 4, "x: found '1e160', expected a number up to 1e+50"),
        ("[C, 50", "[C, 1e999", 4, "x: found '1e999', expected a finite number"),
        ("94.36,", "1e60,", 6, "distance: found '1e60', expected a number up to 1e+50"),
        ("94.36, 0.002", "94.36, 1e-160", 6, "distance 1: found σ = 1e-160, expected one from 1e-50 to 1e+50"),
        (DISTANCE, f"{DISTANCE} factor: 1e-60,", 6, "distance 1: found σ = 2e-63, expected one from 1e-50"),
        (DISTANCE, f"{DISTANCE} ppm: 1e300,", 6, "observations → 1 → ppm: found '1e300', expected 1e+50 or less"),
        ("94.36,", "-94.36,", 6, "found a negative distance, expected one above 0"),
        ("mor: 1", "mor: 1\nsettings: {sigma0: 1e999}", 2, "settings → sigma0: found '1e999', expected a finite"),
        ("mor: 1", "mor: 1\ndatum: {free: []}", 2, "datum: names no coordinates"),
        ("mor: 1", "mor: 1\ndatum: {free: all, components: []}", 2, "datum: names no coordinates"),
        ("mor: 1", "mor: 1\ndatum: {minimal: {}}", 2, "datum: names no coordinates"),
        (OF_C, '{file: "a\\0b.csv"}', 4, "points → 2 → file: found 'a\\x00b.csv'"),
        (DISTANCE, f'{DISTANCE} covariance: "a\\0b",', 6, "observations → 1 → covariance: found 'a\\x00b'"),
    ],
)  # fmt: skip
def test_numbers_and_names(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    assert refused(write(tmp_path, TRIANGLE.replace(old, new)), line).startswith(words)


@pytest.mark.parametrize("scale", ["0", "-1", "{free: 0}", "{observed: 1, sigma: 0.1, start: 0}"])
def test_scale_of_an_instrument(tmp_path: Path, scale: str) -> None:
    text = TRIANGLE.replace("{type: distance,", "{type: distance, instrument: e,")
    said = refused(write(tmp_path, f"{text}instruments: {{e: {{scale: {scale}}}}}\n"), 8)
    assert said == "scale: expected a number above 0"


@pytest.mark.parametrize("scale", ["0", "-1"])
def test_scale_of_a_local_system(tmp_path: Path, scale: str) -> None:
    project = KINDS["local system"](tmp_path)
    project.write_text(project.read_text().replace("0.1, 1]", f"0.1, {scale}]"))
    assert refused(project, 10) == "scale: expected a number above 0"


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ("{interior: {c: 20 gon}}", "c: unit 'gon' does not fit image coordinates"),
        ("{r0: 5 gon, interior: {c: 20}}", "r0: unit 'gon' does not fit image coordinates"),
        ("{interior: {c: 20, A1: 3 gon}}", "A1: unit 'gon' does not fit, expected 1/mm^2"),
        (
            "{interior: {c: {free: 20}}, image_variant: {c: -5 um}}",
            "c: found a negative σ (-5 um), expected a σ ≥ 0",
        ),
        ("{interior: {c: 1e160}}", "c: found '1e160', expected a number up to 1e+50"),
        (
            "{image: {width: 0, height: 1, pixel: 1}, interior: {c: 20}}",
            "width: found 0, expected a number above 0",
        ),
        (
            "{image: {width: 9, height: 9, pixel: -1}, interior: {c: 20}}",
            "pixel: found -1, expected a number above 0",
        ),
    ],
)
def test_cameras(tmp_path: Path, camera: str, words: str) -> None:
    assert refused(write_block(tmp_path, BLOCK.replace(INTERIOR, camera)), 4) == words


def test_a_zero_sigma_of_image_variant_is_no_difference(tmp_path: Path) -> None:
    free = BLOCK.replace(INTERIOR, "{interior: {c: {free: 20}}}")
    same = BLOCK.replace(INTERIOR, "{interior: {c: {free: 20}}, image_variant: {c: 0}}")
    for folder, text in ((tmp_path / "free", free), (tmp_path / "same", same)):
        assert mor("adjust", write_block(folder, text), "--no-html").code == 0
    found = [json.loads((tmp_path / name / "project.results/results.json").read_text()) for name in ("free", "same")]
    for key in ("unknowns", "redundancy", "sigma0", "points", "cameras"):
        assert found[0][key] == found[1][key]


@pytest.mark.parametrize("unit", ["gon", "{sigma: gon}", "{x: gon, y: gon}"])
def test_image_coordinates_in_units_of_an_angle(tmp_path: Path, unit: str) -> None:
    text = BLOCK.replace("type: image", f"type: image\n    units: {unit}").replace("2 um", "0.002")
    run = mor("check", write_block(tmp_path, text))
    assert (run.code, "gon" in run.err) == (2, True)


@pytest.mark.parametrize("key", ["snooping_level", "familywise_level", "global_level"])
@pytest.mark.parametrize("level", ["1e-300", "1e-16", "0.9999999999999999"])
@pytest.mark.parametrize("power", ["1e-16", "0.8", "0.9999999999999999"])
def test_levels_of_tests_at_the_edge(tmp_path: Path, key: str, level: str, power: str) -> None:
    text = f"{LEVELLING}settings: {{{key}: {level}, power: {power}}}\n"
    run = mor("adjust", write(tmp_path, text), "--no-html")
    assert run.code == 0, run.err


def test_start_values_that_coincide_lead_to_the_same_solution(tmp_path: Path) -> None:
    coinciding = TRIANGLE.replace("[C, 50, 80, 12]", "[C, 0, 0, 10]")
    found = []
    for name, text in (("apart", TRIANGLE), ("together", coinciding)):
        assert mor("adjust", write(tmp_path / name, text), "--no-html").code == 0
        results = json.loads((tmp_path / name / "project.results" / "results.json").read_text())
        found.append(results["sigma0"]["aposteriori"])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


def test_without_unknowns_observations_are_compared_with_what_is_given(tmp_path: Path) -> None:
    fixed = TRIANGLE.replace("[[C, 50, 80, 12]]", "[[C, 50, 80, 12]], fixed: [x, y, z]")
    run = mor("adjust", write(tmp_path, fixed))
    assert run.code == 0, run.err
    assert "all coordinates and parameters are fixed: the residuals compare" in run.err
    data = json.loads((tmp_path / "project.results" / "results.json").read_text())
    assert (data["unknowns"], data["redundancy"]) == (0, data["observations"])
    points = {"A": (0.0, 0.0, 10.0), "B": (100.0, 0.0, 11.0), "C": (50.0, 80.0, 12.0)}
    for row in data["residuals"]:
        computed = math.dist(points[row["from"]], points[row["to"]])
        if row["type"] == "distance":
            assert row["v"] == pytest.approx(computed - row["observed"], abs=1e-12)
        assert row["r"] == 1.0


def test_nothing_that_is_estimated_is_observed(tmp_path: Path) -> None:
    said = refused(write(tmp_path, LEVELLING + "settings: {dimensions: xy}\n"), 3)
    assert said.startswith("there is nothing to adjust")


REPEATED = """\
mor: 1
settings: {dimensions: xy}
points:
  - {columns: [id, x, y], rows: [[A, 0, 0], [B, 100, 0]], fixed: [x, y]}
  - {columns: [id], rows: [[S], [N]]}
observations:
  - type: directions
    columns: [station, to, horizontal]
    rows: [[S, A, 0.0000], [S, A, 0.0003], [S, A, 399.9998], [S, N, 150], [N, S, 0], [N, B, 130]]
    values: {sigma: 1 mgon}
  - type: horizontal_distance
    columns: [from, to, distance]
    rows: [[A, S, 50], [S, N, 40], [N, B, 60]]
    values: {sigma: 2 mm}
"""


def test_one_target_sighted_three_times(tmp_path: Path) -> None:
    run = mor("adjust", write(tmp_path, REPEATED), "--no-html")
    assert run.code in (0, 2, 3, 4)
    assert run.code != 2 or "point" in run.err


def test_a_point_that_no_ray_refers_to_where_there_are_none(tmp_path: Path) -> None:
    rows = "[[B, 0, 0, 11], [C, 0, 0, 12]], fixed: [x, y]}"
    assert rows in LEVELLING
    listed = LEVELLING.replace(rows, rows + "\n  - {columns: [id, x, y, z], rows: [[N, 1, 2, 3]]}")
    run = mor("adjust", write(tmp_path, listed), "--no-html")
    assert (run.code, "No observation refers to point N" in run.err) == (4, True)


def test_a_screen_of_what_is_not_determined(tmp_path: Path) -> None:
    listed = ", ".join(f"[N{k}, 0, 0, {k}]" for k in range(60))
    rows = f"  - {{columns: [id, x, y, z], rows: [{listed}]}}\nobservations:"
    run = mor("adjust", write(tmp_path, LEVELLING.replace("observations:", rows)), "--no-html")
    assert run.code == 4
    assert len(run.err.splitlines()) <= 30
    assert "more lines in the report" in run.err
    assert "N59" in (tmp_path / "project.results" / "report.txt").read_text()


def test_ppm_where_no_length_is_measured_between_two_places(tmp_path: Path) -> None:
    text = TRIANGLE.replace("{type: zenith_angle,", "{type: zenith_angle, ppm: 2,")
    said = refused(write(tmp_path, text), 7)
    assert said.startswith("found ppm for observations of type zenith_angle; ppm needs lengths")


def test_a_standard_deviation_of_a_datum_whose_square_is_no_number(tmp_path: Path) -> None:
    project = tmp_path / "network.dat"
    project.write_text(
        "[Coordinates]\nA 100.0\nB 101.0\nC 102.0\n\n[Datum]\ndyn\nA 0.001\nB 1e300\n\n[Sigma0]\n0.001 m\n\n"
        "[LevelledHeightDifferences]\nA B 1.0010 1000\nB C 1.0005 1000\nA C 2.0010 2000\n"
    )
    run = mor("adjust", project)
    assert run.code == 2, run.err
    assert "internal" not in run.err


def test_images_in_which_one_coordinate_alone_is_measured(tmp_path: Path) -> None:
    project = write_block(tmp_path)
    rays = tmp_path / "rays.csv"
    lines = [line.split(",") for line in rays.read_text().splitlines()]
    y = lines[0].index("y")
    rays.write_text(
        "\n".join(",".join([*cells[:y], "" if k else cells[y], *cells[y + 1 :]]) for k, cells in enumerate(lines))
    )
    run = mor("adjust", project)
    assert run.code in (0, 1, 2, 3, 4), run.err
    assert "internal" not in run.err
