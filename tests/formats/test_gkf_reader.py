"""GNU Gama files: axes, units, σ, covariances, datum, and what is left out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.formats import read_foreign
from mor.formats.gkf.reader import carried
from tests.reference_data import network_of, observations, point_results

COMPASS = {"e": (1.0, 0.0), "n": (0.0, 1.0), "w": (-1.0, 0.0), "s": (0.0, -1.0)}
TRUTH = {
    "A": (100.0, 200.0, 10.0),
    "B": (180.0, 230.0, 14.0),
    "P": (150.0, 280.0, 21.0),
    "Q": (90.0, 270.0, 7.5),
}
"""East, north, height."""


def _document(tmp_path, body, network="", parameters="", implicit=""):
    path = tmp_path / "network.gkf"
    path.write_text(
        f'<?xml version="1.0"?>\n<gama-local><network {network}>\n<parameters {parameters}/>\n'
        f"<points-observations {implicit}>\n{body}\n</points-observations></network></gama-local>\n"
    )
    return read_foreign(path)


def _solve(tmp_path, body, **keys):
    return solve_network(network_of(_document(tmp_path, body, **keys), tmp_path))


def _in_axes(place, axes):
    """Coordinates in the axes of a file of a place given by east, north, height."""
    x, y = (np.dot(COMPASS[letter], place[:2]) for letter in axes)
    return np.array([x, y, place[2]])


def _bearing(a, b, turn):
    """Azimuth in gon from north: clockwise (turn = 1) or counterclockwise (turn = −1)."""
    east, north = np.subtract(TRUTH[b][:2], TRUTH[a][:2])
    return (turn * np.degrees(np.arctan2(east, north)) / 0.9) % 400.0


def _physical_file(axes, turn):
    """A network of all kinds of observations, free of errors, written from east, north and height alone."""
    lines = []
    for name, place in TRUTH.items():
        x, y, z = _in_axes(place, axes)
        status = 'fix="xyz"' if name in "AB" else 'adj="xyz"'
        shift = 0.0 if name in "AB" else 0.2
        lines.append(f'<point id="{name}" x="{x + shift:.17g}" y="{y - shift:.17g}" z="{z + shift:.17g}" {status}/>')
    lines.append('<obs from="P">')
    orientation = 37.0
    for to in "ABQ":
        direction = (_bearing("P", to, turn) - orientation) % 400.0
        lines.append(f'<direction to="{to}" val="{direction:.17g}" stdev="5"/>')
    lines.append("</obs><obs>")
    lines.append(f'<azimuth from="A" to="Q" val="{_bearing("A", "Q", turn):.17g}" stdev="5"/>')
    angle = (_bearing("B", "P", turn) - _bearing("B", "A", turn)) % 400.0
    lines.append(f'<angle from="B" bs="A" fs="P" val="{angle:.17g}" stdev="5"/>')
    for a, b in ("AP", "BQ", "PQ"):
        vector = np.subtract(TRUTH[b], TRUTH[a])
        horizontal = float(np.hypot(*vector[:2]))
        rise = vector[2] + 1.3 - 1.6
        slope, zenith = np.hypot(horizontal, rise), np.degrees(np.arctan2(horizontal, rise)) / 0.9
        heights = 'from_dh="1.6" to_dh="1.3"'
        lines.append(f'<distance from="{a}" to="{b}" val="{horizontal:.17g}" stdev="3"/>')
        lines.append(f'<s-distance from="{a}" to="{b}" val="{slope:.17g}" stdev="3" {heights}/>')
        lines.append(f'<z-angle from="{a}" to="{b}" val="{zenith:.17g}" stdev="5" {heights}/>')
    lines.append("</obs><height-differences>")
    lines.append(f'<dh from="A" to="Q" val="{TRUTH["Q"][2] - TRUTH["A"][2]:.17g}" dist="0.3"/></height-differences>')
    dx, dy, dz = _in_axes(np.subtract(TRUTH["Q"], TRUTH["P"]), axes)
    x, y, z = _in_axes(TRUTH["P"], axes)
    lines.append(f'<vectors><vec from="P" to="Q" dx="{dx:.17g}" dy="{dy:.17g}" dz="{dz:.17g}"/>')
    lines.append('<cov-mat dim="3" band="2">9 2 1 7 -1 8</cov-mat></vectors>')
    lines.append(f'<coordinates><point id="P" x="{x:.17g}" y="{y:.17g}" z="{z:.17g}"/>')
    lines.append('<cov-mat dim="3" band="1">400 20 300 -10 500</cov-mat></coordinates>')
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("axes", "sense"),
    list(itertools.product(("ne", "sw", "es", "wn", "en", "nw", "se", "ws"), ("left-handed", "right-handed"))),
)
def test_all_axes_and_senses_of_angles_are_physical(tmp_path, axes, sense):
    body = _physical_file(axes, 1.0 if sense == "left-handed" else -1.0)
    solved = _solve(tmp_path, body, network=f'axes-xy="{axes}" angles="{sense}"')
    assert solved.adjustment.problem.observations == 21
    assert solved.quality.sigma0 == pytest.approx(0.0, abs=1e-6)
    for name, (coordinates, _) in point_results(solved).items():
        np.testing.assert_allclose(coordinates, _in_axes(TRUTH[name], axes), rtol=0, atol=1e-9)


LEVELLED = """<point id="A" z="10" fix="z"/><point id="B" z="11" adj="z"/><point id="C" z="13" adj="z"/>"""


def test_heights_alone_make_a_height_network(tmp_path):
    body = LEVELLED + (
        '<height-differences><dh from="A" to="B" val="1" stdev="2"/><dh from="B" to="C" val="2" dist="0.25"/>'
        '<dh from="C" to="A" val="-3.004" dist="0.25"/></height-differences>'
    )
    document = _document(tmp_path, body, parameters='sigma-apr="4"')
    assert document.data["settings"]["dimensions"] == "z"
    (table,) = document.data["observations"]
    assert [row[-1] for row in table["rows"]] == ["2", "2.0", "2.0"]  # σ = sigma-apr √km
    solved = solve_network(network_of(document, tmp_path))
    np.testing.assert_allclose([o.v for o in observations(solved)], [0.004 / 3] * 3, atol=1e-12)


def test_implicit_sigmas_follow_their_formula(tmp_path):
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="0" y="500" adj="xy"/>'
        '<obs from="A"><distance to="B" val="500"/><azimuth to="B" val="100"/></obs>'
    )
    for given, expected in (("5", 5.0), ("2 3", 3.5), ("2 3 0.5", 2.0 + 3.0 * 0.5**0.5)):
        document = _document(tmp_path, body, implicit=f'distance-stdev="{given}" azimuth-stdev="12"')
        distance, azimuth = document.data["observations"]
        assert float(distance["rows"][0][-1]) == pytest.approx(expected, rel=1e-15)
        assert azimuth["rows"][0][-1] == "12"
        assert (distance["units"]["sigma"], azimuth["units"]["sigma"]) == ("mm", "cc")


def test_angles_in_degrees_have_sigmas_in_arc_seconds(tmp_path):
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="0" y="500" adj="xy"/>'
        '<obs from="A"><azimuth to="B" val="90-00-03.6" stdev="2"/><distance to="B" val="500" stdev="1"/></obs>'
    )
    solved = _solve(tmp_path, body)
    azimuth = observations(solved)[0]
    assert azimuth.observed == pytest.approx(np.radians(90.001), rel=1e-14)
    assert solved.network.groups[0].sigma[0, 0] == pytest.approx(np.radians(2 / 3600), rel=1e-14)


def test_mixed_clusters_keep_every_covariance_in_its_place(tmp_path):
    """Rows of the matrix are in the order of the file, groups of the project in the order of types."""
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="300" y="400" adj="xy"/>'
        '<point id="C" x="0" y="500" adj="xy"/>'
        '<obs from="A"><distance to="B" val="500"/><azimuth to="C" val="100"/><distance to="C" val="500"/>'
        '<azimuth to="B" val="53-07-48.4"/><cov-mat dim="4" band="3">11 1 2 3  12 4 5  13 6  14</cov-mat></obs>'
    )
    network = network_of(_document(tmp_path, body), tmp_path)
    (cluster,) = network.correlations
    names = ["dB", "aC", "dC", "aB"]
    order = [
        {"horizontal_distance": "d", "bearing": "a"}[network.groups[g].type.key] + network.groups[g].references[1][r]
        for g, r in zip(cluster.groups, cluster.rows, strict=True)
    ]
    assert sorted(order) == sorted(names)
    file = np.array([[11, 1, 2, 3], [1, 12, 4, 5], [2, 4, 13, 6], [3, 5, 6, 14]], dtype=float)
    units = np.array([1e-3, np.pi / 2e6, 1e-3, np.pi / 648000])
    where = [names.index(name) for name in order]
    np.testing.assert_allclose(cluster.covariance, (file * np.outer(units, units))[np.ix_(where, where)], rtol=1e-14)


def test_capital_letters_carry_the_datum_component_by_component(tmp_path):
    body = (
        '<point id="A" x="0" y="0" z="0" adj="XYz"/><point id="B" x="0" y="500" z="3" adj="xyZ"/>'
        '<point id="C" x="9" y="8" z="7" fix="xy" adj="XYZ"/>'
        '<vectors><vec from="A" to="B" dx="0" dy="500" dz="3"/><vec from="A" to="C" dx="9" dy="8" dz="7"/>'
        '<cov-mat dim="6" band="0">1 1 1 1 1 1</cov-mat></vectors>'
    )
    document = _document(tmp_path, body)
    assert document.data["datum"] == {"free": {"xy": ["A"], "z": ["B", "C"]}}
    solved = solve_network(network_of(document, tmp_path))
    assert solved.adjustment.defect.movements == ("translation Z",)


def test_a_direction_set_with_one_target_is_left_out_with_a_note(tmp_path):
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="0" y="500" adj="xy"/>\n'
        '<obs from="A"><direction to="B" val="0" stdev="1"/>\n<direction to="B" val="0.001" stdev="1"/></obs>\n'
        '<obs from="A"><distance to="B" val="500" stdev="1"/><azimuth to="B" val="100" stdev="1"/></obs>'
    )
    document = _document(tmp_path, body)
    assert [table["type"] for table in document.data["observations"]] == ["horizontal_distance", "bearing"]
    assert [note.line for note in document.notes] == [6, 7]
    assert "no second target" in document.notes[0].message


def test_points_that_take_no_part_take_their_observations_with_them(tmp_path):
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="0" y="500" adj="xy"/><point id="idle" x="1" y="1"/>\n'
        '<obs from="A"><distance to="B" val="500" stdev="1"/><azimuth to="B" val="100" stdev="1"/>\n'
        '<distance to="idle" val="1.41" stdev="1"/>\n<s-distance to="B" val="500" stdev="1"/></obs>'
    )
    document = _document(tmp_path, body)
    assert [row[0] for table in document.data["points"] for row in table["rows"]] == ["A", "B"]
    assert [note.line for note in document.notes] == [7, 8]
    assert "neither fixed nor adjusted in z" in document.notes[1].message


def test_covariances_of_observations_left_out_go_too(tmp_path):
    body = (
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="0" y="500" adj="xy"/>'
        '<obs from="A"><distance to="B" val="500"/><distance to="X" val="1"/><azimuth to="B" val="100"/>'
        '<cov-mat dim="3" band="2">1 2 3 100 4 25</cov-mat></obs>'
    )
    network = network_of(_document(tmp_path, body), tmp_path)
    covariance = network.correlations[0].covariance / np.outer([1e-3, np.pi / 2e6], [1e-3, np.pi / 2e6])
    np.testing.assert_allclose(covariance, [[1, 3], [3, 25]], rtol=1e-13)


@pytest.mark.parametrize(
    ("axes", "sense", "turn"),
    [("ne", "left-handed", 1.0), ("en", "left-handed", 1.0), ("wn", "right-handed", -1.0)],
)
def test_gross_observations_are_left_out(tmp_path, axes, sense, turn):
    """1.5 m at the target is left out with tol-abs = 1000 mm, 0.2 m is not; nothing of the good ones is."""
    body = _physical_file(axes, turn)
    place = TRUTH["A"], TRUTH["Q"]
    length = float(np.hypot(*np.subtract(place[1], place[0])[:2]))
    bearing = _bearing("A", "Q", turn)
    wrong = "".join(
        f'<azimuth from="A" to="Q" val="{bearing + np.degrees(error / length) / 0.9:.17g}" stdev="5"/>\n'
        f'<distance from="A" to="Q" val="{length + error:.17g}" stdev="5"/>\n'
        for error in (1.5, -1.5, 0.2)
    )
    body += f"\n<obs>\n{wrong}</obs>"
    document = _document(tmp_path, body, network=f'axes-xy="{axes}" angles="{sense}"')
    first = next(i for i, line in enumerate((tmp_path / "network.gkf").read_text().splitlines(), 1) if line == "<obs>")
    assert [note.line for note in document.notes] == [first + 1, first + 2, first + 3, first + 4]
    assert all("tol-abs" in note.message for note in document.notes)


@pytest.mark.parametrize(
    ("sigma_apriori", "sigma", "error", "second_leg", "used"),
    [
        (10, 10, 1.2, 100, 1),
        (10, 10, 0.8, 100, 2),
        (1, 10, 1.2, 100, 2),
        (10, 20, 1.9, 100, 2),
        (10, 20, 2.1, 100, 1),
        (10, 10, 0.8, 1000, 2),
    ],
)
def test_tolerance_of_angles_is_that_of_gnu_gama(tmp_path, sigma_apriori, sigma, error, second_leg, used):
    """An angle is compared at its first target, and weighted with its standard deviation; the distance is 3 m off."""
    body = (
        f'<point id="A" x="0" y="0" fix="xy"/><point id="B" x="100" y="0" fix="xy"/>'
        f'<point id="C" x="0" y="{second_leg}" adj="xy"/>\n<obs from="A">\n'
        f'<distance to="C" val="{second_leg + 3}" stdev="1"/>\n'
        f'<angle bs="B" fs="C" val="{100 + np.degrees(error / 100) / 0.9:.12f}" stdev="{sigma}"/>\n'
        f'<angle bs="B" fs="C" val="100" stdev="{sigma}"/></obs>'
    )
    document = _document(tmp_path, body, parameters=f'sigma-apr="{sigma_apriori}"')
    angles = [len(table["rows"]) for table in document.data["observations"] if table["type"] == "angle"]
    assert angles == [used]


def test_a_gross_direction_does_not_spoil_its_set(tmp_path):
    names = {"B": (500, 0), "C": (0, 500), "D": (-500, 0), "E": (0, -500)}
    points = "".join(f'<point id="{k}" x="{x}" y="{y}" fix="xy"/>' for k, (x, y) in names.items())
    body = (
        f'<point id="A" x="0" y="0" adj="xy"/>{points}\n<obs from="A"><direction to="B" val="11" stdev="1"/>\n'
        '<direction to="C" val="113" stdev="1"/>\n<direction to="D" val="211" stdev="1"/>\n'
        '<direction to="E" val="311" stdev="1"/></obs>'
    )
    document = _document(tmp_path, body)
    assert [note.line for note in document.notes] == [7]
    (table,) = document.data["observations"]
    assert [row[1] for row in table["rows"]] == ["B", "D", "E"]


@pytest.mark.parametrize(
    ("text", "carried_"),
    [
        ("12-34-60", "12-35-0"),
        ("12-59-60.00", "13-0-0"),
        ("-0-59-60", "-1-0-0"),
        ("12-34-56.7", "12-34-56.7"),
        ("12-61-0", "12-61-0"),
    ],
)
def test_seconds_rounded_up_to_sixty(text, carried_):
    assert carried(text) == carried_


def test_positions_and_heights_that_nothing_observes_are_not_adjusted(tmp_path):
    """As in gama-local: distances and directions determine plan coordinates, a height difference a height."""
    body = (
        '<point id="A" x="0" y="0" z="10" fix="xyz"/><point id="B" x="100" y="0" z="11" fix="xyz"/>\n'
        '<point id="C" x="60" y="80" adj="xyz"/><point id="D" x="40" y="-30" z="9" adj="XYZ"/>\n'
        '<point id="E" x="1" y="2" adj="xyz"/>\n'
        '<obs from="C"><direction to="A" val="0"/><direction to="B" val="70.4833"/><distance to="A" val="100"/></obs>\n'
        '<height-differences><dh from="A" to="D" val="-1" stdev="1"/></height-differences>\n'
    )
    document = _document(tmp_path, body, implicit='distance-stdev="5" direction-stdev="10"')
    adjusted = {
        row[0]: sorted(set("xyz") - set(table.get("fixed", ())))
        for table in document.data["points"]
        for row in table["rows"]
    }
    assert adjusted == {"A": [], "B": [], "C": ["x", "y"], "D": ["z"]}
    (note,) = (note for note in document.notes if "nothing observes it" in note.message)
    assert "C z, D xy, E xy, E z" in note.message
    assert document.data["datum"] == {"free": {"z": ["D"]}}
