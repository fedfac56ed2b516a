"""Comp3D's files: a small network of our own, whose readings are computed from the coordinates."""

from __future__ import annotations

import csv
from math import atan2, hypot, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

import mor
from mor.errors import InputError
from mor.formats import read_foreign
from mor.formats.recognition import format_of
from mor.project.document import Document
from tests.scenarios.small_projects import mor as run

PLACES = {"A": (1000.0, 2000.0, 5.0), "B": (1060.0, 2080.0, 8.0), "C": (960.0, 2050.0, 2.0)}
COR = "1 A 1000 2000 5 0 0 0 *held\n2 B 1060 2080 8 0.01 0.02 0\n0 C 960.02 2050.01 2\n-1 Z\n"
COMP = (
    'data=\n{\n"COMP3D_VERSION" : "x",\n"config" : {"center_latitude" : 45.0, "internal_constraints" : false,\n'
    '"local_center" : [\n1000.0,\n2000.0,\n0.0\n],\n"refraction" : 0.0, "root_COR_file" : "n.cor",\n'
    '"use_proj" : false, '
    '"root_OBS_file" : "sub/n.obs"}\n}\n'
)


def _azimuth(one: str, other: str) -> float:
    (e, n, _), (e2, n2, _) = PLACES[one], PLACES[other]
    return atan2(e2 - e, n2 - n) * 200.0 / pi % 400.0


def _slope(one: str, other: str, up: float = 0.0) -> float:
    (e, n, h), (e2, n2, h2) = PLACES[one], PLACES[other]
    return sqrt((e2 - e) ** 2 + (n2 - n) ** 2 + (h2 - h + up) ** 2)


def observed() -> str:
    """The observations file of the network: two rounds, distances, heights."""
    lines = ["* a comment", f"8 A B {_azimuth('A', 'B'):.5f} 0.001"]
    for station, (one, other) in {"A": ("B", "C"), "C": ("A", "B")}.items():
        lines += [f"7 {station} {one} 0.0 0.001 0.002"]
        lines += [f"5 {station} {other} {(_azimuth(station, other) - _azimuth(station, one)) % 400.0:.5f} 0.001"]
    lines += [
        f"3 A C {_slope('A', 'C', -0.2):.4f} 0.001 0.00001 1.5 1.3",
        f"1 C B {_slope('C', 'B'):.4f} 0.002",
    ]
    lines += [
        "4 A C -3.0 0.001",
        "-3 A B 5.0 0.001",
        "3 A B 5.0 -0.001",
        "3 A Z 7.0 0.001",
        "22 @a.eq",
        "@more.obs",
    ]
    return "\n".join(lines) + "\n"


def write(folder: Path) -> Path:
    """Write the files of the network; return the project."""
    (folder / "sub").mkdir()
    (folder / "n.cor").write_text(COR)
    (folder / "sub" / "n.obs").write_text(observed())
    (folder / "sub" / "more.obs").write_text("9 C D 0 0.003 0.001\n4 C D 1.5 0.001\n14 A B 60 0.01\n")
    path = folder / "n.comp"
    path.write_text(COMP)
    return path


def _rows(document: Document, type_: str) -> list[dict[str, Any]]:
    tables = [table for table in document.data["observations"] if table["type"] == type_]
    return [dict(zip(table["columns"], row, strict=True)) for table in tables for row in table["rows"]]


def test_a_project_of_comp3d(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert format_of(path) == "comp3d"
    document = read_foreign(path)
    (A, B, C, D) = (
        dict(zip(table["columns"], row, strict=True)) | {"fixed": table.get("fixed")}
        for table in document.data["points"]
        for row in table["rows"]
    )
    assert (A["fixed"], B["sigma_x"], B["sigma_y"], C["fixed"]) == (["x", "y", "z"], "0.01", "0.02", None)
    assert B.get("sigma_z") is None
    assert D["id"] == "D"
    assert document.data["curvature"]["origin"] == {"x": "1000.0", "y": "2000.0", "z": "0"}
    (long, short) = _rows(document, "distance")
    measured = round(_slope("A", "C", -0.2), 4)  # the distance, not that of the coordinates given for C
    assert float(long["sigma"]) == pytest.approx(0.001 + 1e-5 * measured, abs=1e-12)
    assert [short[key] for key in ("from", "to", "from_height")] == ["C", "B", "0.0"]
    first, second = (row for row in _rows(document, "directions") if row["station"] == "A")
    assert float(first["sigma"]) == pytest.approx(0.001 + 0.002 / hypot(60.0, 80.0, 3.0) * 200.0 / pi)
    assert (first["set"], second["set"], second["sigma"]) == ("1", "1", "0.001")
    centring, difference = _rows(document, "vector")
    assert [centring[key] for key in ("dx", "dy", "sigma_dx", "sigma_dy")] == ["0.0", "0.0", "0.003", "0.001"]
    assert [difference[key] for key in ("dx", "dy", "sigma_dx")] == ["60.0", None, "0.01"]
    notes = " ".join(map(str, document.notes))
    for words in (
        "switched off not read (2 records)",
        "points that are ignored not read (1 record)",
        "equal distances (22) not read (1",
    ):
        assert words in notes
    values = mor.adjust(str(path))
    points = values.project.network.things["point"]
    place = values.solved.adjustment.values["point"][points.part("C", "position")]
    np.testing.assert_allclose(place, PLACES["C"], atol=2e-3)


def test_a_file_of_observations_takes_the_coordinates_beside_it(tmp_path: Path) -> None:
    write(tmp_path)
    observations = tmp_path / "sub" / "n.obs"
    with pytest.raises(InputError, match=r"found no \.cor file that belongs to it"):
        read_foreign(observations)
    (tmp_path / "sub" / "n.cor").write_text(COR)
    assert format_of(observations) == "comp3d"
    document = read_foreign(observations)
    assert "no .comp file that is read says the coefficient of refraction" in " ".join(map(str, document.notes))


def test_both_files_of_a_network_named_are_the_network_once(tmp_path: Path) -> None:
    (tmp_path / "n.cor").write_text(COR)
    (tmp_path / "n.obs").write_text("\n".join(line for line in observed().splitlines() if "@" not in line) + "\n")
    names = [str(tmp_path / name) for name in ("n.cor", "n.obs", "p.yaml")]
    assert run("convert", *names).code == 0
    assert run("check", names[-1]).code == 0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("4 A C -3.0 0.001", "4 A C -3.0", r"n\.obs:9: found '4 A C -3.0', expected a code, origin, target"),
        ("4 A C -3.0 0.001", "4 A C -3.0 0", r"n\.obs:9: found the σ 0, expected more than 0"),
        ("4 A C -3.0 0.001", "@n.obs", "files name each other in a circle"),
        ("4 A C -3.0 0.001", "x A C", r"n\.obs:9: found 'x', expected a code"),
    ],
)
def test_mistakes_are_told_with_their_lines(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write(tmp_path)
    observations = tmp_path / "sub" / "n.obs"
    observations.write_text(observations.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def test_projects_without_observations_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "sub" / "n.obs").write_text("18 A @a.axe\n")
    with pytest.raises(InputError, match=r"no observations that are read; left out: rotation axes \(18\)"):
        read_foreign(path)


NEAR = {
    "A": (1000.0, 2000.0, 5.0),
    "B": (1006.0, 2008.0, 6.0),
    "C": (996.0, 2005.0, 2.0),
    "D": (1003.0, 1996.0, 7.0),
}
"""Places so near to each other that the curvature of the earth is less than the tolerance."""


def _turned(name: str, origin: str, omega: float, kappa: float) -> Any:
    """Coordinates of a point in a frame at another one, turned about x and then z."""
    c, s = np.cos([omega, kappa]), np.sin([omega, kappa])
    about_x = np.array([[1, 0, 0], [0, c[0], s[0]], [0, -s[0], c[0]]])
    about_z = np.array([[c[1], s[1], 0], [-s[1], c[1], 0], [0, 0, 1]])
    return about_z @ about_x @ np.subtract(NEAR[name], NEAR[origin])


@pytest.mark.parametrize(("options", "omega"), [("", 0.7), ("V 2", 0.0), ("1", 0.0), ("N", 0.2)])
@pytest.mark.parametrize("code", [11, 12])
def test_frames_at_a_point(tmp_path: Path, code: int, options: str, omega: float) -> None:
    """C follows from a frame at D in which the others are measured, Cartesian or polar."""
    rows = []
    for name in "ABC":
        x, y, z = _turned(name, "D", omega, 0.4)
        if code == 11:
            rows.append(f"{name} {x:.6f} {y:.6f} {z:.6f} 0.001 0.0001")
        else:
            angles = np.array([atan2(y, x), atan2(z, hypot(x, y))]) * 200.0 / pi
            rows.append(f"{name} {angles[0]:.6f} {angles[1]:.6f} {hypot(x, y, z):.6f} 0.001 0.002 0.0001")
    path = write(tmp_path)
    held = [f"1 {name} {' '.join(map(str, NEAR[name]))} 0 0 0" for name in "AB"]
    (tmp_path / "n.cor").write_text("\n".join([*held, "0 D 1003.1 1996.2 7", ""]))
    (tmp_path / "sub" / "n.obs").write_text(f"{code} D @f.xyz {options}\n4 A D 2.0 0.001\n")
    (tmp_path / "sub" / "f.xyz").write_text("\n".join([*rows, "**! comment", ""]))
    values = mor.adjust(str(path))
    points = values.project.network.things["point"]
    place = values.solved.adjustment.values["point"][points.part("C", "position")]
    np.testing.assert_allclose(place, NEAR["C"], atol=5e-5)
    (table,) = (one for one in read_foreign(path).data["observations"] if one["type"] in ("local", "distance"))
    sigma = float(dict(zip(table["columns"], table["rows"][0], strict=True))["sigma_x" if code == 11 else "sigma"])
    distance = sqrt(sum(value**2 for value in _turned("A", "D", 0.0, 0.0)))
    expected = (0.001 if code == 11 else 0.002) + 0.0001 * distance
    assert sigma == pytest.approx(expected * (2.0 if options == "V 2" else 1.0), rel=1e-6)


@pytest.mark.parametrize("origin", ["1 D 3000 2000 5 0 0 0\n", ""], ids=["given", "unknown"])
def test_a_levelled_frame_far_from_the_centre(tmp_path: Path, origin: str) -> None:
    """2 km from the centre of the project the vertical leans by 2000/R: 3 mm on 10 m if the frame did not follow."""
    path = write(tmp_path)
    held = "1 A 2990 2000 5 0 0 0\n1 B 3000 2010 5 0 0 0\n"
    (tmp_path / "n.cor").write_text(f"{held}{origin}0 C 3010.1 1999.9 5.1\n")
    (tmp_path / "sub" / "n.obs").write_text("11 D @f.xyz V\n")
    (tmp_path / "sub" / "f.xyz").write_text("A -10 0 0 0.001\nB 0 10 0 0.001\nC 10 0 0 0.001\n")
    values = mor.adjust(str(path))
    points = values.project.network.things["point"]
    place = values.solved.adjustment.values["point"][points.part("C", "position")]
    np.testing.assert_allclose(place, [3010.0, 2000.0, 5.0], atol=3e-5)


def test_a_point_with_a_height_alone_is_named_so(tmp_path: Path) -> None:
    """B has a height from A; in a projection a point needs a place in plan, too, and that is the reason told."""
    path = write(tmp_path)
    path.write_text(COMP.replace('"use_proj" : false', '"use_proj" : true, "proj_def" : "EPSG:2154"'))
    (tmp_path / "n.cor").write_text("1 A 700000 6600000 100 0 0 0\n")
    (tmp_path / "sub" / "n.obs").write_text("19 A @b.bas\n4 A B 2.0 0.001\n")
    (tmp_path / "sub" / "b.bas").write_text("C 10 20 30 1e-6 0 0 1e-6 0 1e-6\n")
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "undetermined.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["id"], row["reason"]) == ("B", "height differences tell its height, and nothing its position in plan")


def test_a_project_in_a_projection(tmp_path: Path) -> None:
    """Baselines in geocentric axes, deflections of the vertical; coordinates by pyproj."""
    geocentric = Transformer.from_crs("EPSG:4965", "EPSG:4964", always_xy=True)
    plane = Transformer.from_crs("EPSG:4171", "EPSG:2154", always_xy=True)
    given = {"A": (2.5, 48.5, 100.0), "B": (2.501, 48.502, 120.0), "C": (2.499, 48.501, 90.0)}
    space = {name: np.array(geocentric.transform(*place)) for name, place in given.items()}
    east, north = plane.transform(*given["A"][:2])
    path = write(tmp_path)
    projection = '"use_proj" : true, "proj_def" : "EPSG:2154", "input_proj_def" : "?"'
    path.write_text(COMP.replace('"use_proj" : false', projection))
    (tmp_path / "n.cor").write_text(f"1 A {east:.4f} {north:.4f} 100 0 0 0 3.0 -2.0\n")
    matrix = "1e-6 1e-7 0 2e-6 -1e-7 3e-6"
    rows = [f"{name} {' '.join(f'{v:.4f}' for v in space[name] - space['A'])} {matrix}" for name in "BC"]
    (tmp_path / "sub" / "n.obs").write_text("19 A @b.bas 2\n4 B C -30.0 0.001\n8 A B 12.0 0.001\n14 A B 5.0 0.001\n")
    (tmp_path / "sub" / "b.bas").write_text("\n".join(rows) + "\n")
    document = read_foreign(path)
    points = document.data["points"][0]
    held = dict(zip(points["columns"], points["rows"][0], strict=True))
    assert (points["fixed"], held["deflection_east"], held["deflection_north"]) == (
        ["x", "y", "z"],
        "3.0",
        "-2.0",
    )
    notes = " ".join(map(str, document.notes))
    assert "azimuths (8) in a projection (use_proj) not read (1 record)" in notes
    assert "coordinates (14) in a projection (use_proj) not read (1 record)" in notes
    vectors = next(table for table in document.data["observations"] if table["type"] == "gnss_vector")
    assert np.array(vectors["covariance"])[0] == pytest.approx([4e-6, 4e-7, 0.0])
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "places.csv").open(newline="") as file:
        places = {row["id"]: row for row in csv.DictReader(file)}
    found = [float(places["B"][column]) for column in ("east", "north")]
    assert found == pytest.approx(plane.transform(*given["B"][:2]), abs=2e-4)
    assert float(places["C"]["height"]) == pytest.approx(90.0, abs=2e-4)


@pytest.mark.parametrize(
    ("observations", "words"),
    [
        ("8 A B 10 0.001\n", r"left out: azimuths \(8\) in a projection"),
        (
            "14 A B 0 0.001\n15 A B 0 0.001\n",
            r"plan coordinates \(14\) in a projection \(use_proj\); .* plan coordinates \(15\) in a projection",
        ),
        ("11 A @none.xyz\n", "this file does not exist"),
        ("11 A f.xyz\n", r"found '11 A f\.xyz', expected a code, origin, @file"),
    ],
)
def test_what_a_projection_cannot_have(tmp_path: Path, observations: str, words: str) -> None:
    path = write(tmp_path)
    path.write_text(COMP.replace('"use_proj" : false', '"use_proj" : true, "proj_def" : "EPSG:2154"'))
    (tmp_path / "sub" / "n.obs").write_text(observations)
    (tmp_path / "sub" / "f.xyz").write_text("B 1 2 3 0.001\n")
    with pytest.raises(InputError, match=words):
        read_foreign(path)


@pytest.mark.parametrize("projected", [False, True])
def test_heights_that_no_observation_tells_are_held(tmp_path: Path, projected: bool) -> None:
    """C follows from directions alone; its plan coordinates are those of the scene, its height is that of the file."""
    path = write(tmp_path)
    if projected:
        projection = '"use_proj" : true, "proj_def" : "EPSG:2154"'
        path.write_text(COMP.replace('"use_proj" : false', projection))
    shift = (700000.0, 6600000.0, 0.0) if projected else (0.0, 0.0, 0.0)
    places = {name: np.add(place, shift) for name, place in PLACES.items()}
    rows = [f"{1 if name in 'AB' else 0} {name} {' '.join(map(str, place))} 0 0 0" for name, place in places.items()]
    (tmp_path / "n.cor").write_text("\n".join(rows).replace(" 2.0 0 0 0", " 2.5 0 0 0") + "\n")
    angles = [
        f"{code} {station} {target} {_azimuth(station, target):.6f} 0.001"
        for station in "AB"
        for code, target in zip((7, 5), "ABC".replace(station, ""), strict=True)
    ]
    (tmp_path / "sub" / "n.obs").write_text("\n".join(angles) + "\n")
    assert "1 point without an observation of the height: their heights are held" in str(read_foreign(path).notes)
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / ("places.csv" if projected else "points.csv")).open(newline="") as file:
        (found,) = (row for row in csv.DictReader(file) if row["id"] == "C")
    names = ("east", "north", "height") if projected else ("x", "y", "z")
    assert [float(found[name]) for name in names] == pytest.approx([*places["C"][:2], 2.5], abs=2e-3)


def test_deflections_and_baselines_need_a_projection(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "n.cor").write_text(COR.replace("0 C 960.02 2050.01 2", "0 C 960.02 2050.01 2 0 0 0 1.5 2"))
    (tmp_path / "sub" / "more.obs").write_text("19 A @b.bas\n#VERT\n")
    with pytest.raises(InputError) as raised:
        read_foreign(path)
    said = " ".join(str(problem) for problem in raised.value.problems)
    assert "point C: deflections of the vertical need a project in a projection" in said
    (tmp_path / "n.cor").write_text(COR)
    assert "GNSS baselines (19) without a projection (use_proj) not read (1 record)" in str(read_foreign(path).notes)


@pytest.mark.parametrize(
    ("version", "expected"), [("v5.22dev-linux", 10.0), ("v5.23", 26.0), ("v5.24dev-PROJ", 26.0), ("?", 26.0)]
)
def test_the_distance_that_the_sigma_of_a_direction_depends_on(tmp_path: Path, version: str, expected: float) -> None:
    """B lies 10 m beside A and 24 m above it: horizontal until version 5.22, spatial from 5.23 on."""
    path = write(tmp_path)
    path.write_text(COMP.replace('"COMP3D_VERSION" : "x"', f'"COMP3D_VERSION" : "COMP3D {version}"'))
    (tmp_path / "n.cor").write_text("7 A 1000 2000 5 0.01 0.01 0\n7 B 1006 2008 29 0.01 0.01 0\n")
    (tmp_path / "sub" / "n.obs").write_text("7 A B 0 0.001 0.002\n6 A B 30 0.001 0.002\n")
    document = read_foreign(path)
    sigmas = [float(_rows(document, type_)[0]["sigma"]) for type_ in ("directions", "zenith_angle")]
    assert sigmas == pytest.approx([0.001 + 0.002 / distance * 200.0 / pi for distance in (expected, 26.0)])
    (tmp_path / "sub" / "n.obs").write_text("7 A C 0 0.001 0.002\n6 A C 40 0.001\n3 A C 10 0.001\n3 A B 26 0.001\n")
    own = 10.0 * np.sin(0.2 * pi) if expected < 26.0 else 10.0
    (row,) = _rows(read_foreign(path), "directions")
    assert float(row["sigma"]) == pytest.approx(0.001 + 0.002 / own * 200.0 / pi)


def test_adjusted_coordinates_give_the_distances_of_sigmas(tmp_path: Path) -> None:
    """Comp3D takes the distance of the current iteration; the coordinates of its last one are in the .new file."""
    path = write(tmp_path)
    (tmp_path / "n.cor").write_text("1 A 1000 2000 5 0.01 0.01 0\n0 B 1010 2000 5\n")
    (tmp_path / "n.new").write_text("* Begin\n  A 1000.0 2000.0 5 0.1 0.1 0.1 *\n -1 Z\n  B 1006 2008 5 0 0 0\n C x\n")
    (tmp_path / "sub" / "n.obs").write_text("7 A B 0 0.001 0.002\n14 A B 6 0.001\n15 A B 8 0.001 0.01\n")
    document = read_foreign(path)
    (direction,) = _rows(document, "directions")
    assert float(direction["sigma"]) == pytest.approx(0.001 + 0.0002 * 200.0 / pi)
    assert float(_rows(document, "vector")[1]["sigma_dy"]) == pytest.approx(0.101)
    (tmp_path / "n.cor").write_text("1 A 1000 2000 5 0.01 0.01 0\n0 B 1030 2040 5\n")
    assert read_foreign(path).data["observations"] == document.data["observations"]
    assert "n.new: its coordinates give the distances in 2 σ" in " ".join(map(str, document.notes))


@pytest.mark.parametrize("projected", [False, True])
def test_points_that_only_directions_intersect(tmp_path: Path, projected: bool) -> None:
    """C is in no .cor file. Stations A and B, of observed coordinates, see it; D has one direction alone."""
    path = write(tmp_path)
    if projected:
        projection = '"use_proj" : true, "proj_def" : "EPSG:2154"'
        path.write_text(COMP.replace('"use_proj" : false', projection))
    shift = (700000.0, 6600000.0, 0.0) if projected else (0.0, 0.0, 0.0)
    rows = [f"1 {name} {' '.join(map(str, np.add(PLACES[name], shift)))} 0.001 0.001 0.002" for name in "AB"]
    (tmp_path / "n.cor").write_text("\n".join(rows) + "\n")
    angles = [
        f"{code} {station} {target} {_azimuth(station, target):.6f} 0.001"
        for station in "AB"
        for code, target in zip((7, 5), "ABC".replace(station, ""), strict=True)
    ]
    (tmp_path / "sub" / "n.obs").write_text("\n".join([*angles, "5 A D 100.0 0.001", ""]))
    words = "1 point in no .cor file, seen in plan alone: it gets the height of a point at the other end and holds it"
    assert words in str(read_foreign(path).notes)
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / ("places.csv" if projected else "points.csv")).open(newline="") as file:
        found = {row["id"]: row for row in csv.DictReader(file)}
    names = ("east", "north", "height") if projected else ("x", "y", "z")
    place = [float(found["C"][name]) for name in names]
    assert place[:2] == pytest.approx(np.add(PLACES["C"], shift)[:2], abs=2e-3)
    assert place[2] == pytest.approx(5.0, abs=1e-4)
    with (tmp_path / "out" / "undetermined.csv").open(newline="") as file:
        assert [row["id"] for row in csv.DictReader(file)] == ["D"]


def test_the_project_beside_a_file_of_observations(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(COMP.replace("sub/n.obs", "n.obs").replace('"refraction" : 0.0', '"refraction" : 0.2'))
    observations = tmp_path / "n.obs"
    observations.write_text("8 A B 40.0 0.001\n3 A C 50.0 0.001\n")
    for name in ("n.obs", "n.cor"):
        document = read_foreign(tmp_path / name)
        assert document.data["instruments"] == {"comp3d": {"refraction": "0.2"}}
        assert ".comp" not in str(document.notes)
    other = path.rename(tmp_path / "m.comp")
    (tmp_path / "broken.comp").write_text('{"root_OBS_file" : "\\x"}')
    assert ".comp" not in str(read_foreign(observations).notes)
    (tmp_path / "k.comp").write_text(other.read_text())
    notes = str(read_foreign(observations).notes)
    assert "k.comp, m.comp name this file: none of them is read" in notes
    assert "no .comp file that is read says the coefficient of refraction" in notes
    path.write_text(other.read_text())
    assert ".comp" not in str(read_foreign(observations).notes)


@pytest.mark.parametrize(
    ("levelled", "deflection"),
    [(False, (0.0, 0.0)), (True, (0.0, 0.0)), (False, (40.0, -20.0))],
    ids=["centring", "frame", "deflection"],
)
def test_plumb_lines_in_a_projection(tmp_path: Path, levelled: bool, deflection: tuple[float, float]) -> None:
    """C is 100 m below B, whose plumb line leans by 2 km/R against that amid the points: 0.03 m. Places by pyproj."""
    plane = Transformer.from_crs("EPSG:4171", "EPSG:2154", always_xy=True)
    longitude, latitude, height = 2.527, 48.5, 130.0
    at_b = plane.transform(longitude, latitude)
    path = write(tmp_path)
    path.write_text(COMP.replace('"use_proj" : false', '"use_proj" : true, "proj_def" : "EPSG:2154"'))
    east, north = plane.transform(2.5, 48.5)
    rows = [f"1 {name} {east + k:.4f} {north:.4f} 30 0 0 0" for k, name in enumerate(("A", "A2", "A3"))]
    (tmp_path / "n.cor").write_text(
        "\n".join([*rows, f"1 B {at_b[0]:.4f} {at_b[1]:.4f} {height} 0 0 0 {deflection[0]} {deflection[1]}", ""])
    )
    if levelled:
        # axes east and north at B: those of a levelled frame are turned about the plumb line, as A and B tell
        geocentric = Transformer.from_crs("EPSG:4965", "EPSG:4964", always_xy=True)
        phi, lam = np.radians([latitude, longitude])
        up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
        e = np.array([-np.sin(lam), np.cos(lam), 0.0])
        axes = np.stack([e, np.cross(up, e), up])
        origin = np.array(geocentric.transform(longitude, latitude, height))
        to_a = axes @ (np.array(geocentric.transform(2.5, 48.5, 30.0)) - origin)
        (tmp_path / "f.xyz").write_text(f"A {' '.join(f'{v:.5f}' for v in to_a)} 0.001\nC 0 0 -100 0.001\n")
        (tmp_path / "sub" / "n.obs").write_text("11 B @../f.xyz V\n")
    else:
        (tmp_path / "sub" / "n.obs").write_text("9 B C 0 0.001 0.002\n4 B C -100.0 0.001\n")
    assert "not read" not in str(read_foreign(path).notes)
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "places.csv").open(newline="") as file:
        found = {row["id"]: row for row in csv.DictReader(file)}
    place = [float(found["C"][name]) for name in ("east", "north", "height")]
    east, north = np.subtract(at_b, 100.0 * np.radians(np.divide(deflection, 3600.0)))
    assert place == pytest.approx([east, north, height - 100.0], abs=1e-3 if any(deflection) else 2e-4)
