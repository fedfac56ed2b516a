"""Textbook network files: sections, units, inherited σ, the three kinds of datum, mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import read_foreign
from tests.reference_data import network_of, observations, point_results


def _document(tmp_path, text):
    path = tmp_path / "network.dat"
    path.write_text(text, encoding="utf-8")
    return read_foreign(path)


def _solve(tmp_path, text):
    return solve_network(network_of(_document(tmp_path, text), tmp_path))


PLANE = """% a comment
[Project]
Two towers # and a hill
[Quelle]
nobody
[Coordinates]
A 0 0 % east and north
B 30.1 39.9
[Datum]
fix xA
yA
[Sigma0]
0.5 m
[Distances,m,mm]
A B 50.000 5
B A 50.004 # the same
[GridBearings,dms,s]
A B 36°52'11.63" 10
"""


def test_a_plane_network(tmp_path):
    document = _document(tmp_path, PLANE)
    assert document.data["title"] == "Two towers # and a hill"
    assert document.data["settings"] == {"dimensions": "xy", "sigma0": "0.5"}
    solved = solve_network(network_of(document, tmp_path))
    first, second, bearing = observations(solved)
    np.testing.assert_allclose([first.v, second.v], [0.002, -0.002], atol=1e-10)
    np.testing.assert_allclose(solved.network.groups[0].sigma, 0.005)
    assert np.degrees(bearing.observed) == pytest.approx(36 + 52 / 60 + 11.63 / 3600, rel=1e-14)
    coordinates, _ = point_results(solved)["B"]
    np.testing.assert_allclose(coordinates[:2], [50.002 * 0.6, 50.002 * 0.8], atol=1e-6)
    assert [o.line for o in (first, second, bearing)] == [15, 16, 18]


def test_sigma_of_a_levelled_line_grows_with_the_root_of_its_length(tmp_path):
    text = "[Coordinates]\nA 7 8 10\nB 11\n[Datum]\nfix A\n[LevelledHeightDifferences]\n"
    text += "A B 1 4000 0.002\nB A -1.2 1000\n"
    solved = _solve(tmp_path, text)
    np.testing.assert_allclose(solved.network.groups[0].sigma[:, 0], [0.004, 0.002])
    assert point_results(solved)["B"][0][2] == pytest.approx(10 + (1 + 4 * 1.2) / 5, abs=1e-12)


def test_a_free_network_over_chosen_coordinates(tmp_path):
    text = "[Coordinates]\nA 10\nB 11\nC 12\n[Datum]\nfree A\nC\n[LevelledHeightDifferences]\nA B 1 1000 1\nB C 2\n"
    with pytest.raises(InputError, match="found 3 columns"):
        _document(tmp_path, text)
    text = text.replace("B C 2", "B C 2 1000")
    assert _document(tmp_path, text).data["datum"] == {"free": {"z": ["A", "C"]}}
    heights = [point_results(_solve(tmp_path, text))[name][0][2] for name in "ABC"]
    np.testing.assert_allclose(heights, [9.5, 10.5, 12.5], atol=1e-12)


def test_observed_coordinates_keep_their_covariances(tmp_path):
    """Rows of the matrix given out of order: y of B, x of A, x of B, y of A."""
    text = (
        "[Coordinates]\nA 0 0\nB 300 400\n[Datum]\ndyn\nyB 4 .1 .2 .3\nxA .1 5 .4 .5\nxB .2 .4 6 .6\nyA .3 .5 .6 7\n"
        "[Distances]\nA B 500 1\n"
    )
    network = network_of(_document(tmp_path, text), tmp_path)
    (cluster,) = network.correlations
    (group,) = (group for group in network.groups if group.type.key == "coordinates")
    order = ["xyz"[c] + group.references[0][r] for r, c in zip(cluster.rows, cluster.components, strict=True)]
    given = np.array([[4, 0.1, 0.2, 0.3], [0.1, 5, 0.4, 0.5], [0.2, 0.4, 6, 0.6], [0.3, 0.5, 0.6, 7]])
    where = [["yB", "xA", "xB", "yA"].index(name) for name in order]
    np.testing.assert_allclose(cluster.covariance, given[np.ix_(where, where)])


def test_instrument_heights_and_vertical_angles(tmp_path):
    text = (
        "[Coordinates]\nA 0 0 0\nB 30 40 50.5\n[Datum]\nfix xA yA zA xB yB\n"
        "[VerticalAngles]\nA B 50 0.001 1.5 1.0\n[ZenithAngles]\nA B 50 0.001 1.5 1.0\n"
        "[SpatialDistances]\nA B 70.7106781 .01 1.5 1\n"
    )
    solved = _solve(tmp_path, text)
    assert point_results(solved)["B"][0][2] == pytest.approx(50.5, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[Sigma0]", "[Sigma]", 12, "unknown section [Sigma]; did you mean 'Sigma0'?"),
        ("[Distances,m,mm]", "[Distances,m,mn]", 14, "unknown unit 'mn'"),
        ("[Distances,m,mm]", "[Distances,m,gon]", 14, "unit 'gon' does not fit [Distances]"),
        ("A B 50.000 5", "A B 50.000", 15, "no σ here, and none in the lines before"),
        ("A B 50.000 5", "A B 50.000 -5", 15, "expected a number > 0"),
        ("B A 50.004", "B A fifty", 16, "found 'fifty', expected a number"),
        ("B A 50.004", "B A 50.004 1 2", 16, "found 5 columns, expected from to value σ"),
        ("36°52'11.63\"", "36°62'11.63\"", 18, "must stay below 60"),
        ("B 30.1 39.9", "B 30.1", 8, "found 1 coordinates of point 'B', expected x, y"),
        ("B 30.1 39.9", "A 30.1 39.9", 8, "point 'A' is given twice (first in line 7)"),
        ("fix xA", "fix xC", 10, "found 'xC', expected x, y and a point"),
        ("fix xA", "xA", 10, "found 'xA', expected fix, free, dyn"),
        ("0.5 m", "none", 13, "found 'none', expected a number > 0"),
        ("% a comment", "lost", 1, "before the first [section]"),
    ],
)
def test_mistakes_have_their_line(tmp_path, old, new, line, words):
    assert PLANE.count(old) == 1
    with pytest.raises(InputError) as error:
        _document(tmp_path, PLANE.replace(old, new))
    found = [(problem.line, problem.message) for problem in error.value.problems]
    assert any(at == line and words in message for at, message in found), found


def test_all_mistakes_come_at_once(tmp_path):
    with pytest.raises(InputError) as error:
        _document(tmp_path, PLANE.replace("39.9", "north").replace("50.004", "x").replace("0.5 m", "-1 m"))
    assert [problem.line for problem in error.value.problems] == [8, 13, 16]


def test_no_observations(tmp_path):
    with pytest.raises(InputError, match="there are no observations"):
        _document(tmp_path, "[Coordinates]\nA 1 2\n")


DYNAMIC = """\
[Coordinates]
A 100.000
B 101.000
C 102.000

[Datum]
dyn
{datum}

[Sigma0]
0.001 m

[LevelledHeightDifferences]
A B 1.0010 1000 0.001
B C 1.0005 1000
A C 2.0010 2000
"""


@pytest.mark.parametrize(
    "datum",
    [
        "A 1e-6 2e-7\nB 2e-7 4e-6",
        "A 1e-6 2e-7\nB 4e-6",
        "A 1e-6\nB 2e-7 4e-6",
    ],
)
def test_a_covariance_matrix_or_a_triangle_of_it(tmp_path, datum):
    path = tmp_path / "net.dat"
    path.write_text(DYNAMIC.format(datum=datum))
    observed = read_foreign(path).data["observations"][0]
    assert np.array(observed["covariance"], dtype=float).tolist() == [[1e-6, 2e-7], [2e-7, 4e-6]]


def test_standard_deviations_of_a_dynamic_datum(tmp_path):
    path = tmp_path / "net.dat"
    path.write_text(DYNAMIC.format(datum="A 0.001\nB 0.002"))
    observed = read_foreign(path).data["observations"][0]
    np.testing.assert_allclose(np.array(observed["covariance"], dtype=float), [[1e-6, 0.0], [0.0, 4e-6]], rtol=1e-15)


def test_rows_of_a_dynamic_datum_that_are_neither(tmp_path):
    path = tmp_path / "net.dat"
    path.write_text(DYNAMIC.format(datum="A 1 2 3\nB 1"))
    with pytest.raises(InputError, match="found rows of 3, 1 numbers, 2 observed coordinates need a σ each"):
        read_foreign(path)


def test_observed_coordinates_in_two_sections(tmp_path):
    path = tmp_path / "net.dat"
    path.write_text(DYNAMIC.format(datum="A 1e-6 2e-7\nB 2e-7 4e-6\n[Datum]\ndyn\nA 1e-6 2e-7\nB 2e-7 4e-6"))
    with pytest.raises(InputError, match=r"observed coordinates are in two sections \[Datum\]"):
        read_foreign(path)


def test_sections_that_few_networks_have(tmp_path):
    """Trigonometric heights, position angles, azimuths, σ as 30", a name with #, a bare name in the datum."""
    path = tmp_path / "net.dat"
    path.write_text(
        "[Coordinates]\nSix#Mile 0 0 0\nB 100 0 1\nC 50 80 2 # comment\n[Datum]\nfix Six#Mile xB\n"
        "[ApproximateScale]\n1\n"
        '[HorizontalDistances]\nSix#Mile B 100 0.01\n[Azimuth,dms]\nSix#Mile B 90°0\'0" 30"\n'
        "[TrigonometricHeightDifferences]\nB C 1.0 0.005\n[PositionAngles]\nB Six#Mile C 64.4 0.001\n"
        "[SpatialDistances]\nB C 94.34 0.01\n"
    )
    document = read_foreign(path)
    types = [table["type"] for table in document.data["observations"]]
    assert types == ["horizontal_distance", "bearing", "height_difference", "spatial_angle", "distance"]
    assert document.data["observations"][1]["rows"] == [["Six#Mile", "B", "90°0'0\"", "30 arcsec"]]
    assert document.data["points"][0]["fixed"] == ["x", "y", "z"]
    assert "[ApproximateScale] is not read" in " ".join(map(str, document.notes))
    network_of(document, tmp_path)
