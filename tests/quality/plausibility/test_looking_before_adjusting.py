"""Looking before adjusting: each mistake is told with its file and line, and what is right is not."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network
from sample_projects.simulate import SCENES
from tests.reference_data import NETWORKS, network_name
from tests.scenarios.small_projects import mor, write

SAMPLES = Path(__file__).resolve().parents[3] / "sample_projects"
Rows = list[dict[str, str]]


def notes_of(project: Path) -> list[str]:
    network = read_network(read_document(project), project.parent)
    return [str(note) for note in network.notes]


@pytest.fixture
def changed(tmp_path: Path) -> Callable[[str, str, Callable[[Rows], object]], Path]:
    """A sample project with the rows of one of its tables changed."""

    def change(sample: str, table: str, mistake: Callable[[Rows], object]) -> Path:
        folder = tmp_path / sample
        shutil.copytree(SAMPLES / sample, folder, ignore=shutil.ignore_patterns("*.results"))
        with (folder / table).open(newline="") as file:
            rows = list(csv.DictReader(file))
        mistake(rows)
        with (folder / table).open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        return folder / "project.yaml"

    return change


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_said_of_a_sample(name: str) -> None:
    words = (
        "outside the format",
        "twice",
        "than that of any",
        "off the known",
        "the loop has a misclosure",
        "the given coordinates",
        "the height is",
        "are they",
        "start pose shows",
        "the camera constant",
    )
    assert [note for note in notes_of(SAMPLES / name / "project.yaml") if any(w in note for w in words)] == []


CONTRADICT_THEMSELVES = {"krumm-niemeier-height-free"}
"""Its loop 1 - 2 - 3 misses by 9 mm, with a standard deviation of 1.5 mm."""


@pytest.mark.parametrize("path", [p for p in NETWORKS if p.parent.name == "gama"], ids=network_name)
def test_nothing_is_said_of_a_reference_network(path: Path) -> None:
    said = [note for note in notes_of(path) if "misclosure" in note or "sigma)" in note or "any instrument" in note]
    assert len(said) == (path.stem in CONTRADICT_THEMSELVES)


def test_image_coordinates_outside_the_format(changed) -> None:  # type: ignore[no-untyped-def]
    project = changed("facade", "image_points.csv", lambda rows: rows[4].update(x="6417.2"))
    (note,) = notes_of(project)
    assert "image_points.csv:6: " in note
    assert note.endswith("outside the format of the camera")


def test_the_same_ray_twice(changed) -> None:  # type: ignore[no-untyped-def]
    project = changed("facade", "image_points.csv", lambda rows: rows.append(dict(rows[10])))
    (note,) = notes_of(project)
    assert "image_points.csv:1033: image " in note
    assert note.endswith("twice, in line 12, too")


def test_a_sigma_in_another_unit(changed) -> None:  # type: ignore[no-untyped-def]
    project = changed("bridge", "pillars.csv", lambda rows: None)
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace("sigma_zenith: 0.5 mgon", "sigma_zenith: 50 gon"), encoding="utf-8")
    (note,) = notes_of(project)
    assert "directions.csv:2: zenith_directions, zenith: the standard deviation is larger" in note


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_image_coordinates_in_another_unit(changed, factor: float) -> None:  # type: ignore[no-untyped-def]
    def scale(rows: Rows) -> None:
        for row in rows:
            row.update({key: repr(factor * float(row[key])) for key in ("x", "y")})

    notes = notes_of(changed("test_field", "image_points.csv", scale))
    assert sum("times the camera constant from the origin; check their unit" in note for note in notes) == 1


def test_an_image_turned_away_from_all_of_its_points(changed) -> None:  # type: ignore[no-untyped-def]
    def turned(rows: Rows) -> None:
        rows[3]["phi" if "phi" in rows[3] else "omega"] = str(float(rows[3].get("phi", "0")) + 180.0)

    project = changed("facade", "images.csv", turned)
    with (project.parent / "images.csv").open() as file:
        name = list(csv.DictReader(file))[3]["id"]
    assert [note for note in notes_of(project) if f"image {name}: its start pose shows none of its" in note]


LEVELLING = """mor: 1
points:
  - columns: [id, z]
    rows: [[A, 100.000]]
    fixed: [z]
  - columns: [id, z]
    rows: [[E, 101.700]]
    fixed: [z]
  - columns: [id]
    rows: [[B], [C], [D]]
settings: {dimensions: z}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows:
      - [A, B, 1.0003, 0.001]
      - [B, C, 0.4998, 0.001]
      - [C, A, BAD, 0.001]
      - [C, D, 0.1001, 0.001]
      - [D, E, 0.1000, 0.001]
"""


@pytest.mark.parametrize(("closing", "misses"), [("-1.5003", False), ("-1.5200", True)])
def test_a_levelling_loop_that_does_not_close(tmp_path: Path, closing: str, misses: bool) -> None:
    project = write(tmp_path, LEVELLING.replace("BAD", closing))
    found = [note for note in notes_of(project) if "the loop has a misclosure of" in note]
    assert bool(found) == misses
    if misses:  # A - B - C - A, and the way to E by that line
        (loop,) = (note for note in found if note.endswith("its lines: 17, 18, 16"))
        assert "project.yaml:17: levelling B - C - A: the loop has a misclosure of -0.0199 m" in loop


def test_levelling_between_known_heights_that_contradict_it(tmp_path: Path) -> None:
    text = LEVELLING.replace("BAD", "-1.5003").replace("[[E, 101.700]]", "[[E, 101.750]]")
    assert [note for note in notes_of(write(tmp_path, text)) if "the loop has a misclosure of" in note]


KNOWN = """mor: 1
points:
  - columns: [id, x, y, z]
    rows: [[A, 0, 0, 0], [B, 100, 0, 0], [C, 0, 80, 5]]
    fixed: [x, y, z]
  - columns: [id]
    rows: [[P]]
observations:
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[A, B, DISTANCE, 0.002], [A, P, 50, 0.002], [B, P, 70, 0.002], [C, P, 60, 0.002], [B, C, 128.1600, 0.002]]
"""


@pytest.mark.parametrize(("distance", "said"), [("100.0031", False), ("99.9660", True)])
def test_a_distance_between_known_points(tmp_path: Path, distance: str, said: bool) -> None:
    notes = [note for note in notes_of(write(tmp_path, KNOWN.replace("DISTANCE", distance))) if "off the known" in note]
    assert bool(notes) == said
    if said:
        assert "distance from A, to B" in notes[0]
        assert "(17 sigma)" in notes[0]


def test_a_length_of_next_to_nothing(tmp_path: Path) -> None:
    """σ are compared with it without a quotient, which would be beyond all numbers."""
    notes = notes_of(write(tmp_path, KNOWN.replace("DISTANCE", "100.0031").replace("P, 50,", "P, 1e-320,")))
    assert not [note for note in notes if "standard deviation" in note]


@pytest.mark.slow
def test_misclosures_of_error_free_networks_are_noted_at_their_level(tmp_path: Path) -> None:
    # at a level of 0.001 of all together one of a thousand would be noted by chance
    random, noted = np.random.default_rng(8), 0
    for _ in range(40):
        errors = 0.002 * random.standard_normal(2)
        text = KNOWN.replace("DISTANCE", f"{100.0 + errors[0]:.5f}")
        text = text.replace("128.1600", f"{float(np.sqrt(100**2 + 80**2 + 5**2)) + errors[1]:.5f}")
        noted += any("off the known" in note for note in notes_of(write(tmp_path, text)))
    assert noted == 0


def test_check_and_adjust_say_it(changed) -> None:  # type: ignore[no-untyped-def]
    project = changed("facade", "image_points.csv", lambda rows: rows.append(dict(rows[10])))
    for run in (mor("check", project), mor("adjust", project, "--no-html")):
        assert run.code == 0
        assert "note: " in run.err
        assert "twice, in line 12, too" in run.err


@pytest.mark.slow
def test_readings_in_gon_declared_as_radians(tmp_path: Path) -> None:
    """They are told before the adjustment, which comes to an end in words however far from sense it is."""
    shutil.copytree(SAMPLES / "bridge", tmp_path / "bridge")
    project = tmp_path / "bridge" / "project.yaml"
    project.write_text(project.read_text().replace("angle: gon", "angle: rad"))
    notes = [note for note in notes_of(project) if "full circle" in note]
    assert len(notes) == 2
    assert all("directions.csv:2" in note and "59 of 59 angles" in note for note in notes)
    run = mor("adjust", project, "--no-html")
    assert run.code == 3
    assert "NO SOLUTION" in run.out + run.err


def test_elevations_in_a_table_of_zenith_angles(
    changed: Callable[[str, str, Callable[[Rows], object]], Path],
) -> None:
    def mistake(rows: Rows) -> None:
        for row in rows:
            row["zenith"] = f"{(100.0 - float(row['zenith'])) % 400.0:.4f}"

    notes = [note for note in notes_of(changed("bridge", "directions.csv", mistake)) if "elevations" in note]
    assert len(notes) == 1
    assert "zenith angles are near 0 or a half circle; are they elevations?" in notes[0]


@pytest.mark.parametrize(("factor", "said"), [(1.0 / 0.3048, "3.28 times"), (1000.0, "1e+03 times")])
def test_distances_in_another_unit_than_the_given_coordinates(
    factor: float, said: str, changed: Callable[[str, str, Callable[[Rows], object]], Path]
) -> None:
    def mistake(rows: Rows) -> None:
        for row in rows:
            row["distance"] = f"{factor * float(row['distance']):.4f}"

    notes = [note for note in notes_of(changed("bridge", "distances.csv", mistake)) if "check their unit" in note]
    assert len(notes) == 1
    assert said in notes[0]


def test_one_distance_far_off_the_given_coordinates(
    changed: Callable[[str, str, Callable[[Rows], object]], Path],
) -> None:
    def mistake(rows: Rows) -> None:
        rows[3]["distance"] = f"{float(rows[3]['distance']) + 200.0:.4f}"

    notes = notes_of(changed("bridge", "distances.csv", mistake))
    found = [note for note in notes if "as far from the given coordinates" in note]
    assert len(found) == 1
    assert "distances.csv:5:" in found[0]
