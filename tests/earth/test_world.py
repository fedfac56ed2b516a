"""A project with ``world``: what is read, what is told, what is written."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pyproj import Geod, Transformer

from mor.model.earth import Ellipsoid, Horizon
from tests.scenarios.small_projects import mor, write

PROJECT = """\
mor: 1
title: three points
units: {length: m, angle: deg}
world: {crs: "EPSG:25832", heights: ellipsoidal}
points:
  - columns: [id, east, north, height]
    rows: [[A, 600000, 5500000, 100]]
    fixed: [x, y, z]
  - columns: [id, east, north, height, sigma_east, sigma_north, sigma_up]
    rows: [[B, 600300, 5500400, 150, "", "", 0.002]]
  - columns: [id, east, north, height]
    rows: [[C, 600000, 5500400, 120]]
settings: {sigma: apriori}
observations:
  - type: gnss_vector
    columns: [from, to, dx, dy, dz]
    rows: VECTORS
    values: {sigma: 0.004}
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[B, C, DISTANCE, 0.003]]
"""
COORDINATES = np.array([[600000.0, 5500000.0, 100.0], [600300.0, 5500400.0, 150.0], [600000.0, 5500400.0, 120.0]])


def _geocentric(coordinates: np.ndarray, crs: str = "EPSG:25832") -> np.ndarray:
    longitude, latitude = Transformer.from_crs(crs, "EPSG:4258", always_xy=True).transform(*coordinates.T[:2])
    cart = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
    return np.stack(cart.transform(longitude, latitude, coordinates[:, 2]), axis=1)


def _text(errors: float = 0.0) -> str:
    places = _geocentric(COORDINATES)
    ends = [("A", "B", 0, 1), ("A", "C", 0, 2), ("B", "C", 1, 2)]
    vectors = [[a, b, *(places[j] - places[i] + errors * (j - i)).tolist()] for a, b, i, j in ends]
    distance = float(np.linalg.norm(places[1] - places[2])) - errors
    return PROJECT.replace("VECTORS", json.dumps(vectors)).replace("DISTANCE", repr(distance))


def _changed(*pairs: tuple[str, str]) -> str:
    text = _text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def test_coordinates_come_out_as_they_went_in(tmp_path: Path) -> None:
    """Free of errors: places, σ by the law of propagation, the way through adjusted.yaml, GeoJSON with its system."""
    assert mor("adjust", write(tmp_path, _text()), "-o", tmp_path / "out", "--no-html").code == 0
    places = pl.read_csv(tmp_path / "out" / "places.csv")
    np.testing.assert_allclose(places.select("east", "north", "height").to_numpy(), COORDINATES, atol=3e-6)
    geocentric = places.select("geocentric_x", "geocentric_y", "geocentric_z").to_numpy()
    np.testing.assert_allclose(geocentric, _geocentric(COORDINATES), atol=3e-6)
    assert places["geoid"].is_null().all()
    assert places.row(0, named=True)["seast"] == 0.0
    assert 0.0015 < places.row(1, named=True)["sup"] < 0.002  # observed with 2 mm
    assert places.row(2, named=True)["sup"] > places.row(1, named=True)["sup"]
    again = mor("adjust", tmp_path / "out" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.code == 0
    assert "without deflections" in again.err
    twice = pl.read_csv(tmp_path / "again" / "places.csv")
    np.testing.assert_allclose(
        twice.drop("id", "geoid", "orthometric_height").to_numpy(),
        places.drop("id", "geoid", "orthometric_height").to_numpy(),
        atol=1e-8,
    )
    assert mor("convert", tmp_path / "out" / "adjusted.yaml", tmp_path / "a.geojson").code == 0
    collection = json.loads((tmp_path / "a.geojson").read_text())
    assert collection["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::25832"
    np.testing.assert_allclose(collection["features"][1]["geometry"]["coordinates"], COORDINATES[1], atol=3e-6)
    refused = mor("convert", tmp_path / "out" / "adjusted.yaml", tmp_path / "a.gkf")
    assert refused.code == 2
    assert "networks on the earth are written as dynadjust, dynaml, snap, sinex, geojson" in refused.err


def test_the_report_says_what_coordinates_refer_to(tmp_path: Path) -> None:
    project = write(tmp_path, _text(errors=0.002))
    assert mor("adjust", project, "-o", tmp_path / "de", "--no-html", "--lang", "de").code == 0
    text = (tmp_path / "de" / "report.txt").read_text()
    assert "Punkte in ETRS89 / UTM zone 32N (EPSG:25832)" in text
    assert re.search(r"Netzmitte, Breite 49,6\d+°, Länge\s+10,3\d+°", text)
    assert mor("adjust", project, "-o", tmp_path / "en", "--no-html").code == 0
    assert "east, north, up in the horizon of each point" in (tmp_path / "en" / "report.txt").read_text()


def _grid(path: Path, south: float, west: float) -> None:
    """A GTX grid (3 × 3, 0.5°) of N = 40 + the number of the node, from the south-west, row by row."""
    heights = (40.0 + np.arange(9)).astype(">f4")
    path.write_bytes(struct.pack(">ddddii", south, west, 0.5, 0.5, 3, 3) + heights.tobytes())


def test_heights_above_a_geoid_of_a_grid(tmp_path: Path) -> None:
    """The plane of the nodes is N = 40 + 3 (φ − φ0)/0.5 + (λ − λ0)/0.5."""
    _grid(tmp_path / "g.gtx", 49.0, 9.5)
    text = _text().replace("heights: ellipsoidal", "heights: orthometric, geoid: g.gtx")
    assert mor("adjust", write(tmp_path, text), "-o", tmp_path / "out", "--no-html").code == 0
    places = pl.read_csv(tmp_path / "out" / "places.csv")
    longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True).transform(*COORDINATES.T[:2])
    expected = 40.0 + 3.0 * (latitude - 49.0) / 0.5 + (longitude - 9.5) / 0.5
    np.testing.assert_allclose(places["geoid"].to_numpy(), expected, atol=1e-6)
    height = places["ellipsoidal_height"].to_numpy() - places["geoid"].to_numpy()
    np.testing.assert_allclose(height, places["height"].to_numpy(), atol=1e-8)
    assert mor("adjust", tmp_path / "out" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html").code == 0
    _grid(tmp_path / "far.gtx", 30.0, 9.5)
    outside = mor("check", write(tmp_path, text.replace("g.gtx", "far.gtx")))
    assert outside.code == 2
    assert "the geoid far.gtx does not cover point 'A'" in outside.err
    (tmp_path / "bad.gtx").write_bytes(b"no grid")
    assert "PROJ cannot read it" in mor("check", write(tmp_path, text.replace("g.gtx", "bad.gtx"))).err
    missing = mor("check", write(tmp_path, text.replace("g.gtx", "none.gtx"))).err
    assert missing.count("geoid: none.gtx: this file does not exist") == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            [("EPSG:25832", "EPSG:999999")],
            r"project.yaml:4: crs: found 'EPSG:999999', expected a coordinate reference",
        ),
        (
            [(", heights: ellipsoidal", "")],
            r"project.yaml:4: ETRS89 / UTM zone 32N .* does not say what heights refer to",
        ),
        (
            [("EPSG:25832", "EPSG:25832+7837"), (", heights: ellipsoidal", "")],
            r"heights of these points are above the geoid, but",
        ),
        (
            [("EPSG:25832", "EPSG:25832+7837")],
            r"heights: found ellipsoidal, but those of the system are 'DHHN2016 height'",
        ),
        ([('"EPSG:25832"', '\'LOCAL_CS["mine",UNIT["metre",1]]\'')], r"'mine' has no datum"),
        ([("EPSG:25832", "EPSG:7837")], r"'DHHN2016 height' has no datum"),
        (
            [("EPSG:25832", "EPSG:31467")],
            r"point 'A' lies outside the area that DHDN / 3-degree Gauss-Kruger zone 3",
        ),
        (
            [("[A, 600000, 5500000", "[A, 5500000, 600000")],
            r":7: point 'A' lies .*with east and north exchanged it would lie inside",
        ),
        (
            [("world:", "axes: {xy: ne}\nworld:")],
            r"project.yaml:4: xy: on the earth x is east and y is north",
        ),
        (
            [("settings: {", "settings: {dimensions: xy, ")],
            r"dimensions: a network on the earth is one in space",
        ),
        (
            [("fixed: [x, y, z]", "fixed: [z]")],
            r":8: fixed: on the earth a point is fixed in x, y, z together",
        ),
        ([('"", "", 0.002', '0, "", 0.002')], r":10: σ 0 holds a point in east, north and up together"),
        (
            [("[C, 600000, 5500400, 120]", "[C, 600000, '', 120]")],
            r":12: a position on the earth needs all of east, north, height",
        ),
        (
            [("type: distance", "type: horizontal_distances")],
            r"unknown observation type 'horizontal_distances'; did you mean",
        ),
        (
            [("type: distance", "type: bearing")],
            r"bearing does not say what it refers to on the earth, expected azimuth",
        ),
        ([("type: gnss_vector", "type: vector")], r"vector does not say .* expected gnss_vector"),
        (
            [("type: distance", "type: mean_sea_level_distance")],
            r"'B': its height is above the geoid, but the geoid is unknown",
        ),
        (
            [('world: {crs: "EPSG:25832", heights: ellipsoidal}\n', "")],
            r"gnss_vector needs to know where on the earth",
        ),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path: Path, changes: list[tuple[str, str]], words: str) -> None:
    found = mor("check", write(tmp_path, _changed(*changes)))
    assert found.code == 2
    assert re.search(words, found.err), found.err
    assert "Traceback" not in found.err


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("[A, 10.4, 49.6, 100]", "with latitude and longitude exchanged it would lie inside"),
        (
            "[A, 149.6, 10.4, 100]",
            "latitude: found 149.6°, expected it between -90° and 90°; are latitude and longitude",
        ),
    ],
)
def test_degrees_in_the_wrong_order(tmp_path: Path, place: str, words: str) -> None:
    text = f"""\
mor: 1
units: {{angle: deg}}
world: {{crs: "EPSG:4258", heights: ellipsoidal}}
points:
  - columns: [id, latitude, longitude, height]
    rows: [{place}]
    fixed: [x, y, z]
  - {{columns: [id, latitude, longitude, height], rows: [[B, 49.61, 10.4, 100]]}}
observations:
  - {{type: gnss_vector, columns: [from, to, dx, dy, dz, sigma], rows: [[A, B, 1, 2, 3, 0.01]]}}
"""
    found = mor("check", write(tmp_path, text))
    assert found.code == 2
    assert words in found.err


def test_a_network_of_one_kilometre_with_and_without_the_earth(tmp_path: Path) -> None:
    """A polar point: in the plane s cos z high, on the earth s² sin² z / 2R higher."""
    observed = """\
observations:
  - {type: distance, columns: [from, to, distance, sigma], rows: [[A, B, 1000, 0.003]]}
  - {type: zenith_angle, columns: [from, to, zenith_angle, sigma], rows: [[A, B, 88, 0.001]]}
  - {type: TYPE, columns: [from, to, NAME, sigma], rows: [[A, B, 30, 0.001]]}
"""
    plane = f"""\
mor: 1
units: {{angle: deg}}
points:
  - {{columns: [id, x, y, z], rows: [[A, 0, 0, 100]], fixed: [x, y, z]}}
  - {{columns: [id, x, y, z], rows: [[B, 500, 870, 130]]}}
{observed.replace("TYPE", "bearing").replace("NAME", "bearing")}"""
    earth = f"""\
mor: 1
units: {{angle: deg}}
world: {{crs: "EPSG:4937"}}
points:
  - {{columns: [id, latitude, longitude, height], rows: [[A, 49, 10, 100]], fixed: [x, y, z]}}
  - {{columns: [id, latitude, longitude, height], rows: [[B, 49.0078, 10.0068, 130]]}}
{observed.replace("TYPE", "azimuth").replace("NAME", "azimuth")}"""
    assert mor("adjust", write(tmp_path / "plane", plane), "-o", tmp_path / "p", "--no-html").code == 0
    assert mor("adjust", write(tmp_path / "earth", earth), "-o", tmp_path / "e", "--no-html").code == 0
    height = pl.read_csv(tmp_path / "p" / "points.csv")["z"][1]
    places = pl.read_csv(tmp_path / "e" / "places.csv").row(1, named=True)
    assert height == pytest.approx(100.0 + 1000.0 * np.cos(np.radians(88.0)), abs=1e-9)
    a, e2 = 6378137.0, 0.00669438002290
    w2 = 1.0 - e2 * np.sin(np.radians(49.0)) ** 2
    M, N = a * (1 - e2) / w2**1.5, a / np.sqrt(w2)
    radius = 1.0 / (np.cos(np.radians(30.0)) ** 2 / M + np.sin(np.radians(30.0)) ** 2 / N)
    rise = (1000.0 * np.sin(np.radians(88.0))) ** 2 / (2.0 * radius)
    assert places["height"] - height == pytest.approx(rise, abs=2e-6)
    azimuth, _, _ = Geod(ellps="GRS80").inv(10.0, 49.0, places["longitude"], places["latitude"])
    assert azimuth == pytest.approx(30.0, abs=3e-6)  # the height of B turns the normal section by 0.005″


def test_projects_that_are_nowhere_on_the_earth_load_nothing_of_it(tmp_path: Path) -> None:
    project = write(tmp_path, "mor: 1\npoints:\n  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]}\n")
    code = (
        "import sys; from mor.cli import run; run(['check', sys.argv[1]]); "
        "sys.exit(any(name.startswith('pyproj') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code, str(project)], check=False).returncode == 0


def test_without_pyproj_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    found = mor("check", write(tmp_path, _text()))
    assert found.code == 2
    assert "pip install mor-adjustment[earth]" in found.err


def test_a_geoid_elsewhere_is_told_once_for_a_table_with_the_place(tmp_path: Path) -> None:
    """Of a wrong zone: where the points are shows it; what follows from it is not told again."""
    _grid(tmp_path / "g.gtx", 49.0, 15.5)
    world = '"EPSG:25832", heights: ellipsoidal'
    levelled = "  - type: height_difference\n    columns: [from, to, dz, sigma]\n    rows: [[A, B, 50, 1]]\n"
    one = '[[B, 600300, 5500400, 150, "", "", 0.002], [D, 600310, 5500400, 150, "", "", 0.002]]'
    text = _changed((world, '"EPSG:25832", heights: orthometric, geoid: g.gtx')).replace(
        '[[B, 600300, 5500400, 150, "", "", 0.002]]', one
    )
    found = mor("check", write(tmp_path, text + levelled))
    assert found.code == 2
    lines = found.err.splitlines()
    assert len(lines) == 3, found.err
    assert "does not cover point 'A' at latitude 49.6" in lines[0]
    assert "covers none of these points (point 'B' at latitude 49.6" in lines[1]
    assert "°, longitude 10.3" in lines[1]


def test_points_whose_place_is_found_have_heights_above_the_grid(tmp_path: Path) -> None:
    _grid(tmp_path / "g.gtx", 49.0, 9.5)
    text = _text().replace("heights: ellipsoidal", "heights: orthometric, geoid: g.gtx")
    given = write(tmp_path, text)
    assert mor("adjust", given, "-o", tmp_path / "one", "--no-html").code == 0
    unknown = "- columns: [id]\n    rows: [[C]]"
    text = text.replace("- columns: [id, east, north, height]\n    rows: [[C, 600000, 5500400, 120]]", unknown)
    assert unknown in text
    assert mor("adjust", write(tmp_path, text), "-o", tmp_path / "two", "--no-html").code == 0
    one, two = (pl.read_csv(tmp_path / name / "places.csv").drop("id").to_numpy() for name in ("one", "two"))
    np.testing.assert_allclose(one, two, atol=1e-7)
    assert np.isfinite(two).all()
    again = mor("adjust", tmp_path / "two" / "adjusted.yaml", "-o", tmp_path / "three", "--no-html")
    assert again.code == 0, again.err


BEARING = """\
  - type: projected_bearing
    columns: [from, to, bearing, sigma]
    rows: [[B, C, 270, 0.001]]
"""
GEOGRAPHIC = f"""\
mor: 1
units: {{length: m, angle: deg}}
world: {{crs: "EPSG:4258", heights: ellipsoidal}}
points:
  - columns: [id, latitude, longitude, height]
    rows: [[B, 49.64, 10.39, 100], [C, 49.64, 10.38, 100]]
    values: {{sigma: 0.1}}
observations:
{BEARING}"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "type: distance",
            "type: distance\n    projection: EPSG:25832",
            r"projection: distance refers to none",
        ),
        ("_bearing", "_bearing\n    projection: EPSG:4258", r"projection: ETRS89 \S+ is not a projection"),
        ("_bearing", "_bearing\n    projection: EPSG:31467", r"is of another ellipsoid than ETRS89"),
    ],
)
def test_mistakes_of_projections_are_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert mor("adjust", write(tmp_path, _text() + BEARING), "-o", tmp_path / "out", "--no-html").code == 0
    found = mor("check", write(tmp_path, (_text() + BEARING).replace(old, new, 1)))
    assert found.code == 2
    assert re.search(words, found.err), found.err


def test_a_project_in_latitude_and_longitude_names_the_projection_of_bearings(tmp_path: Path) -> None:
    found = mor("check", write(tmp_path, GEOGRAPHIC))
    assert found.code == 2
    assert re.search(r"projected_bearing: ETRS89 \S+ is not a projection; name one", found.err), found.err
    named = GEOGRAPHIC.replace("_bearing", "_bearing\n    projection: EPSG:25832")
    assert mor("check", write(tmp_path, named)).code == 0


def test_an_unknown_place_changes_no_other_one() -> None:
    """A point that is left out has no coordinates; the verticals of all others stay as they are."""
    horizon = Horizon(Ellipsoid(6378388.0, 1.0 / 297.0), -0.7158, 3.025)
    places = np.array([[-437.4, -377.6, 150.0], [151.4, 288.8, 250.0]])
    unknown = np.full((1, 3), np.nan)
    np.testing.assert_array_equal(
        horizon.to_geodetic(np.concatenate([unknown, places]))[1:], horizon.to_geodetic(places)
    )
