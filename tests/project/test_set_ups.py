"""Heights, eccentricities and offsets as unknowns: the truth they were simulated with, and the same said otherwise."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from tests.scenarios.small_projects import C, Run, mor, table, write

GON = np.pi / 200.0
TARGET, HEIGHT = np.array([1.2, 0.8, 6.0]), 1.55
ECCENTRICITY = np.array([0.012, -0.02, 0.064])
ATTITUDES = np.array([[8.0, 3.0, 0.0], [-6.0, 9.0, 95.0], [2.0, -12.0, 210.0], [-9.0, -5.0, 290.0], [4, 11, 40]])
NAMES = [f"I{k}" for k in range(len(ATTITUDES))]
POINTS = np.array([[x, y, 0.7 * np.sin(3 * x + y)] for x in (-1.0, 0.5, 2.0, 3.5) for y in (-1.0, 1.0, 2.5)])
PROJECT = """\
mor: 1
units: {length: m}
cameras:
%s
points:
  - {file: control.csv, fixed: [x, y, z]}
images:
%s
observations:
  - {type: image, file: rays.csv, values: {sigma: 2 um}}
"""


def project(folder: Path, cameras: str, images: str, noise: float = 0.0, eccentric: bool = True) -> Path:
    """Five images from a tripod, turned about one point; the projection centre lies beside it."""
    random = np.random.default_rng(3)
    rays: list[list[Any]] = []
    for name, angles in zip(NAMES, ATTITUDES, strict=True):
        D = rotation_from_angles(angles * GON)
        star = (POINTS - TARGET - [0.0, 0.0, HEIGHT]) @ D.T + ECCENTRICITY * eccentric
        xy = -C * star[:, :2] / star[:, 2:] + noise * random.standard_normal((len(POINTS), 2))
        rays += [[name, f"P{i}", float(x), float(y)] for i, (x, y) in enumerate(xy)]
    points = [[f"P{i}", *map(float, xyz)] for i, xyz in enumerate(POINTS)] + [["T", *map(float, TARGET)]]
    return write(
        folder,
        PROJECT % (cameras, images),
        control=table("id,x,y,z", points),
        rays=table("image,point,x,y", rays),
    )


def adjusted(path: Path) -> dict[str, Any]:
    run = mor("adjust", path, "--json", "--quiet")
    assert run.code == 0, run.err
    data: dict[str, Any] = json.loads(run.out)
    assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-7)
    return data


def other(data: dict[str, Any], name: str) -> dict[str, Any]:
    """Components of one of the further unknowns."""
    (found,) = [row["components"] for row in data["others"] if row["id"] == name]
    assert isinstance(found, dict)
    return found


CAMERA = "  K: {interior: {c: 20}}\n"


def rows(columns: str, ends: list[str], **keys: str) -> str:
    """A table of the five images: name, camera K, start attitude, and what differs."""
    cells = [f"[{name}, K, {', '.join(map(str, angles + 0.02))}, {end}]" for name, angles, end in
             zip(NAMES, ATTITUDES, ends, strict=True)]  # fmt: skip
    further = "".join(f"\n    {key}: {value}" for key, value in keys.items())
    return f"  - columns: [id, camera, omega, phi, kappa, {columns}]\n    rows: [{', '.join(cells)}]{further}\n"


SHARED = "position: T, shared_height: tripod, shared_eccentricity: head"
FREE = {"values": f"{{{SHARED}}}", "free": "[height, rx, ry, rz]"}


def test_shared_free_height_and_eccentricity_find_the_truth(tmp_path: Path) -> None:
    data = adjusted(project(tmp_path, CAMERA, rows("height", ["1.5"] * 5, **FREE)))
    assert data["unknowns"] == 3 * len(NAMES) + 1 + 3
    assert other(data, "height tripod")["height"]["value"] == pytest.approx(HEIGHT, abs=1e-9)
    found = [other(data, "eccentricity head")[key]["value"] for key in ("rx", "ry", "rz")]
    np.testing.assert_allclose(found, ECCENTRICITY, atol=1e-9)


def test_without_a_value_they_start_at_zero(tmp_path: Path) -> None:
    data = adjusted(project(tmp_path, CAMERA, rows("leader", ['""'] * 5, **FREE)))
    assert other(data, "height tripod")["height"]["value"] == pytest.approx(HEIGHT, abs=1e-9)


def test_a_free_height_is_a_free_height_of_the_position(tmp_path: Path) -> None:
    """The height above a known target, and a position of which x and y are known, are the same network."""
    free = {"free": "[height]", "values": "{position: T, shared_height: tripod}"}
    one = adjusted(project(tmp_path / "a", CAMERA, rows("height", ["1.5"] * 5, **free), 0.002, False))
    stand = {"fixed": "[x, y]", "values": "{position: stand}"}
    ends = [f"{TARGET[0]}, {TARGET[1]}, 7.4"] * 5
    two = adjusted(project(tmp_path / "b", CAMERA, rows("x, y, z", ends, **stand), 0.002, False))
    assert one["redundancy"] == two["redundancy"]
    assert one["sigma0"]["aposteriori"] == pytest.approx(two["sigma0"]["aposteriori"], rel=1e-9)
    height = other(one, "height tripod")["height"]
    assert height["value"] + TARGET[2] == pytest.approx(two["images"][0]["z"], abs=1e-9)
    assert height["sigma"] == pytest.approx(two["images"][0]["sz"], rel=1e-7)


@pytest.mark.parametrize("per", ["set-up", "image"])
def test_eccentricities_of_their_own_are_those_of_cameras_of_their_own(per: str, tmp_path: Path) -> None:
    """One camera with an eccentricity in each image or set-up, or as many cameras with the same interior."""
    group = ["a", "a", "a", "b", "b"] if per == "set-up" else NAMES
    shared = [f"{g}" if per == "set-up" else '""' for g in group]
    free = {"free": "[rx, ry]", "values": "{position: T, height: 1.55, rz: 0.064}"}
    one = adjusted(project(tmp_path / "a", CAMERA, rows("shared_eccentricity", shared, **free), 0.002))
    eccentricity = "{rx: {free: 0}, ry: {free: 0}, rz: 0.064}"
    names = list(dict.fromkeys(group))
    cameras = "".join(f"  {name}: {{interior: {{c: 20}}, eccentricity: {eccentricity}}}\n" for name in names)
    text = rows("leader", ['""'] * 5, values="{position: T, height: 1.55}")
    for name, camera in zip(NAMES, group, strict=True):
        text = text.replace(f"[{name}, K,", f"[{name}, {camera},")
    two = adjusted(project(tmp_path / "b", cameras, text, 0.002))
    assert one["redundancy"] == two["redundancy"]
    assert one["sigma0"]["aposteriori"] == pytest.approx(two["sigma0"]["aposteriori"], rel=1e-9)
    for name in names:
        first = other(one, f"eccentricity {name}" if per == "set-up" else f"image {name}")
        second = other(two, f"camera {name}")
        for key in ("rx", "ry"):
            assert first[key]["value"] == pytest.approx(second[key]["value"], abs=1e-9)
            assert first[key]["sigma"] == pytest.approx(second[key]["sigma"], rel=1e-6)


def test_the_adjusted_project_says_the_same(tmp_path: Path) -> None:
    first = rows("height", ["1.5"] * 5, **FREE)
    path = project(tmp_path, CAMERA, first, 0.002)
    assert mor("adjust", path, "-o", tmp_path / "out", "--quiet", "--no-html").code == 0
    again = adjusted(tmp_path / "out" / "adjusted.yaml")
    before = json.loads((tmp_path / "out" / "results.json").read_text())
    assert again["iterations"] <= 2
    assert again["unknowns"] == before["unknowns"]
    assert other(again, "height tripod")["height"]["value"] == pytest.approx(
        other(before, "height tripod")["height"]["value"], abs=1e-9
    )
    with (tmp_path / "out" / "start_images.csv").open() as file:
        assert {row["shared_eccentricity"] for row in csv.DictReader(file)} == {"head"}


OFFSET = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 1, 2, 0], [B, 4, 2, 1], [C, 2, 5, 2], [D, 5, 6, 0.5]], fixed: [x, y, z]}
systems:
  - columns: [id, x, y, z, omega, phi, kappa, scale]
    rows: [[S, 0, 0, 0, 1, 2, 30, 1]]
    %s
observations:
  - type: local
    columns: [point, x, y, z]
    values: {system: S, sigma: 0.01}
    rows: %s
"""


def local(folder: Path, keys: str) -> dict[str, Any]:
    points = np.array([[1, 2, 0], [4, 2, 1], [2, 5, 2], [5, 6, 0.5]])
    D = rotation_from_angles(np.array([1.1, 1.9, 31.0]) * GON)
    measured = 1.01 * points @ D.T + [0.3, -0.2, 0.5] + 0.004 * np.sin(np.arange(12.0)).reshape(4, 3)
    cells = [[name, *map(float, xyz)] for name, xyz in zip("ABCD", measured, strict=True)]
    return adjusted(write(folder, OFFSET % (keys, json.dumps(cells))))


def test_a_free_offset_is_a_free_origin(tmp_path: Path) -> None:
    """r̄ = −λ D X0: the origin in local coordinates, and the same σ0, attitude and scale."""
    offset = local(tmp_path / "a", "fixed: [x, y, z]\n    free: [rx, ry, rz]")
    origin = local(tmp_path / "b", "")
    assert offset["redundancy"] == origin["redundancy"] == 5
    assert offset["sigma0"]["aposteriori"] == pytest.approx(origin["sigma0"]["aposteriori"], rel=1e-9)
    (one,), (two,) = offset["systems"], origin["systems"]
    for key in ("omega", "phi", "kappa", "scale", "somega", "sphi", "skappa", "sscale"):
        assert one[key] == pytest.approx(two[key], rel=1e-8), key
    D = rotation_from_angles(np.array([two[key] for key in ("omega", "phi", "kappa")]) * GON)
    expected = -two["scale"] * D @ [two[key] for key in "xyz"]
    found = [other(offset, "system S")[key]["value"] for key in ("rx", "ry", "rz")]
    np.testing.assert_allclose(found, expected, atol=1e-9)


def refused(path: Path) -> str:
    run: Run = mor("check", path)
    assert run.code == 2
    return run.err


def test_mistakes(tmp_path: Path) -> None:
    twice = rows("height", ["1.5", "1.5", "1.6", "1.5", "1.5"], values=f"{{{SHARED}}}")
    assert "shared_height: 'tripod' has another value in a row above" in refused(project(tmp_path, CAMERA, twice))
    both = rows("height", ["1.5"] * 5, free="[height]", values="{position: T, sigma_height: 0.01}")
    assert "height is free in this table, and has a σ" in refused(project(tmp_path, CAMERA, both))
    wrong = rows("height", ["1.5"] * 5, free="[hieght]", values="{position: T}")
    assert "did you mean 'height'" in refused(project(tmp_path, CAMERA, wrong))


def test_a_station_with_a_place_of_its_own_has_no_height_in_a_plane_network(tmp_path):
    places = {"A": (0.0, 0.0), "B": (100.0, 0.0), "C": (90.0, 70.0)}
    here, kappa = np.array([40.0, 30.0]), 0.7
    rows = [
        ["S", name, f"{(np.arctan2(x - here[0], y - here[1]) + kappa) % (2.0 * np.pi) / GON:.9f}"]
        for name, (x, y) in places.items()
    ]
    directions = f"""\
mor: 1
units: {{length: m, angle: gon}}
settings: {{dimensions: xy}}
points:
  - columns: [id, x, y]
    rows: {json.dumps([[name, *place] for name, place in places.items()])}
    fixed: [x, y]
stations: [{{columns: [id], rows: [[S]]}}]
observations:
  - {{type: directions, columns: [station, to, horizontal], rows: {json.dumps(rows)}, values: {{sigma: 1 mgon}}}}
"""
    project = write(tmp_path, directions)
    assert mor("adjust", project, "--quiet").code == 0
    found = json.loads((tmp_path / "project.results" / "results.json").read_text())
    assert found["unknowns"] == 3
    (station,) = found["stations"]
    assert [station["x"], station["y"]] == pytest.approx(here, abs=1e-6)


HEIGHTS = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: CONTROL, fixed: [x, y, z]}
stations:
STATIONS
observations:
  - type: zenith_directions
    columns: [station, set, to, horizontal, zenith]
    rows: ROWS
    values: {sigma: 1 mgon}
"""
STANDS = {"S1": ("A", 1.55, ""), "S1 again": ("A", 1.55, "2"), "S2": ("B", 1.55, ""), "S3": ("C", 1.62, "")}


def heights(folder: Path, stations: str) -> Path:
    """Levelled stations over known points, one with a second set; noise of the size of σ."""
    control = {"A": (0, 0, 10), "B": (40, 5, 11), "C": (20, 35, 9), "D": (-15, 30, 14), "E": (55, 40, 13)}
    rows: list[list[Any]] = []
    random = np.random.default_rng(8)
    for k, (station, (stand, height, set_)) in enumerate(STANDS.items()):
        for target in sorted(set(control) - {stand}):
            x, y, z = np.subtract(control[target], control[stand]) - [0, 0, height]
            angles = np.array([np.arctan2(x, y) + k, np.arctan2(np.hypot(x, y), z)]) / GON
            angles += 0.001 * random.standard_normal(2)
            rows.append([station[:2], set_, target, *map(float, angles)])
    text = HEIGHTS.replace("STATIONS", stations).replace("ROWS", json.dumps(rows))
    return write(folder, text.replace("CONTROL", json.dumps([[name, *xyz] for name, xyz in control.items()])))


def stations(columns: str, rows: str, free: str = "") -> str:
    return f"  - {{columns: [id, set, point, {columns}], rows: [{rows}]{', free: [height]' if free else ''}}}\n"


SETS = "[S1, '', A, h, ''], [S1, '2', '', '', '']"


def test_the_adjusted_project_keeps_what_is_shared_and_what_is_not(tmp_path: Path) -> None:
    """S2 shares its height with a table of free ones; S3 beside it has one that is known, and a set has none."""
    free = stations("shared_height, height", SETS, "free")
    mixed = stations("shared_height, height", "[S2, '', B, h, ''], [S3, '', C, '', 1.62]")
    path = heights(tmp_path, free + mixed)
    assert mor("adjust", path, "-o", tmp_path / "out", "--quiet", "--no-html").code == 0
    before = json.loads((tmp_path / "out" / "results.json").read_text())
    again = adjusted(tmp_path / "out" / "adjusted.yaml")
    assert before["unknowns"] == again["unknowns"] == 4 + 1
    found, expected = (other(data, "height h")["height"] for data in (again, before))
    assert [found["value"], found["sigma"]] == pytest.approx([expected["value"], expected["sigma"]], rel=1e-7)
    assert again["sigma0"]["aposteriori"] == pytest.approx(before["sigma0"]["aposteriori"], rel=1e-9)


@pytest.mark.parametrize("said", ["11", "10", "01"])
def test_any_row_may_say_what_several_share(said: str, tmp_path: Path) -> None:
    """Value and σ in both rows, in the first or in the second: the same."""
    one, two = ("1.5512, 0.001" if here == "1" else "'', ''" for here in said)
    columns = "shared_height, height, sigma_height"
    first = stations(columns, f"[S1, '', A, h, {one}], [S1, '2', '', '', '', '']")
    second = stations(columns, f"[S2, '', B, h, {two}], [S3, '', C, '', 1.62, '']")
    data = adjusted(heights(tmp_path, first + second))
    assert data["unknowns"] == 4 + 1
    assert data["observations"] == 2 * 16 + 1
    assert other(data, "height h")["height"]["value"] == pytest.approx(1.55, abs=2e-3)


def test_rows_that_contradict_each_other_in_what_they_share(tmp_path: Path) -> None:
    columns = "shared_height, height, sigma_height"
    third = stations("height", "[S3, '', C, 1.62]")
    first = stations(columns, "[S1, '', A, h, 1.55, 0.001], [S1, '2', '', '', '', '']") + third
    other_sigma = stations(columns, "[S2, '', B, h, 1.55, 0.002]")
    assert "'h' has another σ in a row above" in refused(heights(tmp_path, first + other_sigma))
    loose = stations("shared_height", "[S2, '', B, h]", "free")
    assert "'h' is free in one row and has a σ in another" in refused(heights(tmp_path, first + loose))


STAND = "stand, 1.21, 0.8, 7.55, 0.01, 0.01, 0.01"
SOMEWHERE = "stand, '', '', '', '', '', ''"
PLACE = "position, x, y, z, sigma_x, sigma_y, sigma_z"


@pytest.mark.parametrize("which", ["first", "second"])
def test_any_row_may_observe_the_position_that_several_share(which: str, tmp_path: Path) -> None:
    """In one row, or in all of them: it is observed once."""
    ends = [STAND, *[SOMEWHERE] * 4] if which == "first" else [SOMEWHERE, STAND, *[SOMEWHERE] * 3]
    one = adjusted(project(tmp_path / "one", CAMERA, rows(PLACE, ends), 0.002, False))
    every = adjusted(project(tmp_path / "all", CAMERA, rows(PLACE, [STAND] * 5), 0.002, False))
    assert one["observations"] == every["observations"] == 2 * len(POINTS) * len(NAMES) + 3
    for key in ("x", "sx", "z"):
        assert one["images"][3][key] == pytest.approx(every["images"][3][key], rel=1e-9)


def test_rows_that_contradict_the_position_they_share(tmp_path: Path) -> None:
    another = "'stand' has another value or σ in its first row"
    for other_row in (STAND.replace("1.21", "1.22"), STAND.replace("0.8, 7.55, 0.01", "0.8, 7.55, 0.02")):
        text = rows(PLACE, [STAND, *[SOMEWHERE] * 3, other_row])
        assert another in refused(project(tmp_path, CAMERA, text))
    text = rows(PLACE, [STAND.replace("stand", "T")] * 5)
    assert "'T' has another value or σ in its first row" in refused(project(tmp_path, CAMERA, text))
