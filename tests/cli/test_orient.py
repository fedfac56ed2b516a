"""``mor orient``: simulated images with known truth, through the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mor.cli import run


def rotation(omega: float, phi: float, kappa: float) -> np.ndarray:
    def turn(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R = np.eye(3)
        R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
        return R

    return (turn(0, omega) @ turn(1, phi) @ turn(2, kappa)).T


def image_of(points: np.ndarray, position: np.ndarray, D: np.ndarray, c: float) -> np.ndarray:
    star = (points - position) @ D.T
    return -c * star[:, :2] / star[:, 2:]


def write(path: Path, ids: list[str], *images: np.ndarray) -> Path:
    header = ",".join(["id", *(f"{axis}{k}" for k in range(1, len(images) + 1) for axis in "xy")])
    rows = [
        ",".join([name, *(repr(float(x)) for x in np.concatenate(row))])
        for name, row in zip(ids, zip(*images, strict=True), strict=True)
    ]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_relative_orientation_of_a_simulated_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(11)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (20, 3))
    D, base = rotation(0.1, -0.3, 1.2), np.array([0.8, 0.1, -0.2])
    table = write(
        tmp_path / "pairs.csv",
        [f"{k:03d}" for k in range(20)],
        image_of(points, np.zeros(3), np.eye(3), 28.8),
        image_of(points, base, D, 35.0),
    )
    assert run(["orient", "relative", str(table), "-c", "28.8", "-c", "35", "--json", "--angles", "rad"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["outcome"] == "determined"
    np.testing.assert_allclose(data["base"], base / np.linalg.norm(base), atol=1e-9)
    np.testing.assert_allclose([data["angles"][n] for n in ("omega", "phi", "kappa")], [0.1, -0.3, 1.2], atol=1e-9)
    assert max(abs(r["coplanarity"]) for r in data["residuals"]) < 1e-6
    assert data["residuals"][0]["id"] == "000"


def test_plane_quadrilateral_with_a_length(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [2.5, 0.0, 0.0], [2.7, 1.6, 0.0], [-0.2, 1.9, 0.0]])
    centres = [np.array([0.3, -1.0, 4.0]), np.array([2.9, 0.7, 3.2]), np.array([1.0, 3.0, 4.4])]
    turns = [rotation(0.25, 0.1, 0.4), rotation(-0.1, 0.35, 2.0), rotation(-0.4, 0.0, -1.0)]
    images = [image_of(corners, centre, D, 50.0) for centre, D in zip(centres, turns, strict=True)]
    table = write(tmp_path / "corners.csv", list("ABCD"), *images)
    assert run(["orient", "planar", str(table), "-c", "50", "--length", "A", "B", "2.5", "--json"]) == 0
    solution = json.loads(capsys.readouterr().out)["solutions"][0]
    found = np.array([[p[c] for c in "xyz"] for p in solution["points"]])
    np.testing.assert_allclose(found, corners, atol=1e-6)
    np.testing.assert_allclose([[i[c] for c in "xyz"] for i in solution["images"]], centres, atol=1e-5)


def test_text_has_units_and_the_convention(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (12, 3))
    second = image_of(points, np.array([1.0, 0, 0]), np.eye(3), 30.0)
    table = write(
        tmp_path / "p.csv",
        [str(k) for k in range(12)],
        image_of(points, np.zeros(3), np.eye(3), 30.0),
        second,
    )
    assert run(["orient", "relative", str(table), "-c", "30"]) == 0
    text = capsys.readouterr().out
    assert "gon" in text
    assert "X_B* = D* (X_A* - b*)" in text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("id,x1,y1\n1,0,0\n", "expected the columns id, x1, y1, x2, y2"),
        ("id,x1,y1,x2,y2\n1,0,zero,0,0\n", "p.csv:2: y1: found 'zero', expected a number"),
        ("id,x1,y1,x2,y2\n1,0,0,0,nan\n1,0,0,0,0\n", "p.csv:3: id '1' is given twice (first in line 2)"),
        ("id,x1,y1,x2,y2\n1,0,0,3,\n", "p.csv:2: y2 is empty, and x2 is not"),
        ("id,x1,y1,x2,y2,x3\n1,0,0,3,4,5\n", "p.csv:1: expected the columns id, x1, y1, x2, y2"),
    ],
)
def test_mistakes_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, words: str) -> None:
    path = tmp_path / "p.csv"
    path.write_text(content)
    assert run(["orient", "relative", str(path), "-c", "30"]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [
        ["relative", "-c", "nan"],
        ["relative", "-c", "30", "--sigma", "nan"],
        ["relative", "-c", "30", "--attitude", "0", "0", "inf"],
        ["planar", "-c", "30", "--length", "1", "2", "nan"],
        ["planar", "-c", "30", "--length-sigma", "inf"],
    ],
)
def test_numbers_that_are_none_are_no_numbers(tmp_path: Path, options: list[str]) -> None:
    path = tmp_path / "p.csv"
    path.write_text("id,x1,y1,x2,y2\n1,0,0,0,0\n2,0,0,0,0\n")
    assert run(["orient", options[0], str(path), *options[1:]]) == 2


def test_seven_points_are_too_few_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (7, 3))
    images = [image_of(points, np.array(p), np.eye(3), 30.0) for p in ([0.0, 0, 0], [1.0, 0, 0])]
    table = write(tmp_path / "p.csv", [str(k) for k in range(7)], *images)
    assert run(["orient", "relative", str(table), "-c", "30"]) == 4
    assert "fewer than eight homologous points" in capsys.readouterr().out


def strip(
    tmp_path: Path, images: int, noise: float = 0.0
) -> tuple[Path, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    rng = np.random.default_rng(7)
    points = rng.uniform([-4, -3, -12], [8, 3, -7], (30, 3))
    cameras = [(np.array([1.6 * k, 0.2 * k, 0.1 * k]), rotation(0.05 * k, -0.1 * k, 0.3 * k)) for k in range(images)]
    measured = [image_of(points, *camera, 30.0) for camera in cameras]
    measured = [one + noise * rng.normal(size=one.shape) for one in measured]
    return write(tmp_path / "strip.csv", [f"P{k}" for k in range(30)], *measured), points, cameras


def test_a_chain_in_the_object_system(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Given ω′ φ′ κ′ of the first image, four images in one call: model, attitudes, and points with σ."""
    table, points, cameras = strip(tmp_path, 4)
    given = np.array([0.2, -0.1, 1.0])
    words = [repr(float(x)) for x in given]
    command = [
        "orient",
        "relative",
        str(table),
        "-c",
        "30",
        "--angles",
        "rad",
        "--attitude",
        *words,
        "--json",
    ]
    assert run(command) == 0
    data = json.loads(capsys.readouterr().out)
    model, turn = data["model"], rotation(*given)
    assert [pair["images"] for pair in data["pairs"]] == [[1, 2], [2, 3], [3, 4]]
    assert model["system"] == "object"
    assert model["scale_points"] == [30, 30]
    unit = np.linalg.norm(cameras[1][0])
    found = np.array([[p[c] for c in "xyz"] for p in model["points"]])
    np.testing.assert_allclose(found, points @ turn / unit, atol=1e-8)
    for image, (position, D) in zip(model["images"], cameras, strict=True):
        np.testing.assert_allclose([image[c] for c in "xyz"], position @ turn / unit, atol=1e-8)
        np.testing.assert_allclose(image["rotation"], D @ turn, atol=1e-8)
    assert all(p["sx"] > 0.0 and p["sz"] > 0.0 for p in model["points"])
    assert model["redundancy"] == 4 * 60 - 90 - (5 + 12)


def test_a_point_left_out_leaves_the_others_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A wrong pair in the middle of the table, and a point that one image only shows."""
    table, points, _ = strip(tmp_path, 2, 0.001)
    lines = table.read_text().splitlines()
    other = lines[21].split(",")
    lines[10] = ",".join([*lines[10].split(",")[:3], *other[3:]])
    lines[15] = ",".join([*lines[15].split(",")[:3], "", ""])
    table.write_text("\n".join(lines) + "\n")
    assert run(["orient", "relative", str(table), "-c", "30", "--json"]) == 0
    model = json.loads(capsys.readouterr().out)["model"]
    assert model["points"][9]["remark"] == "wrong pair"
    assert model["points"][14]["remark"] == "fewer than two rays"
    assert model["sigma0"] < 1.6
    truth = points / np.linalg.norm(np.array([1.6, 0.2, 0.1]))
    for k in set(range(30)) - {9, 14}:
        found = model["points"][k]
        for axis, value in zip("xyz", truth[k], strict=True):
            assert abs(found[axis] - value) < 5 * found[f"s{axis}"]


def test_the_nine_unknowns_and_their_conditions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, _, _ = strip(tmp_path, 2, 0.005)
    assert run(["orient", "relative", str(table), "-c", "30", "--sigma", "0.005", "--json"]) == 0
    rinner = json.loads(capsys.readouterr().out)["rinner"]
    assert [row["ik"] for row in rinner["ik"]] == ["11", "12", "13", "21", "22", "23", "31", "32", "33"]
    for row in rinner["ik"]:
        assert row["linear"] + row["correction"] == pytest.approx(row["compatible"], abs=1e-12)
        assert abs(row["linear"] - row["adjusted"]) < 30 * row["sigma"] + 1e-3
    first, *_ = rinner["conditions"]
    matrix = np.array([row["linear"] for row in rinner["ik"]]).reshape(3, 3)
    assert first["linear"] == pytest.approx(np.linalg.det(matrix))
    assert all(abs(row["adjusted"]) < 1e-12 for row in rinner["conditions"])
    assert run(["orient", "relative", str(table), "-c", "30", "--sigma", "0.005", "--lang", "de"]) == 0
    german = capsys.readouterr().out
    assert "Hilfsunbekannte ik (Rinner)" in german
    assert "Relative Orientierung: eine Orientierung passt" in german


def test_both_orientations_of_a_plane_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-4, 4, (12, 2)), np.full(12, -9.0)])
    cameras = [(np.zeros(3), np.eye(3)), (np.array([6.0, 0.0, -2.0]), rotation(0.1, 0.7, 0.0))]
    table = write(tmp_path / "p.csv", list("abcdefghijkl"), *(image_of(points, *one, 30.0) for one in cameras))
    assert run(["orient", "relative", str(table), "-c", "30", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["geometry_key"] == "plane"
    chosen, other = data["plane_orientations"]
    assert chosen["behind"] == 0
    assert (data["outcome"] == "ambiguous") == (other["behind"] == 0)
    assert run(["orient", "relative", str(table), "-c", "30"]) == 0
    assert f"points behind a camera: {other['behind']} of 12" in capsys.readouterr().out


CORNERS = np.array([[0.0, 0, 0], [2.5, 0, 0], [2.7, 1.6, 0], [-0.2, 1.9, 0], [1.2, 0.3, 0], [0.9, 1.4, 0]])
CENTRES = [
    (np.array([0.3, -1.0, 4.0]), rotation(0.25, 0.1, 0.4)),
    (np.array([2.9, 0.7, 3.2]), rotation(-0.1, 0.35, 2.0)),
]


def test_points_off_the_plane_get_heights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = np.vstack([CORNERS, [[1.0, 0.8, 0.4]]])
    table = write(tmp_path / "off.csv", list("ABCDEFT"), *(image_of(points, *one, 50.0) for one in CENTRES))
    length = ["--length", "A", "B", "2.5", "--length-sigma", "0.005"]
    for named in ([], ["--off", "T"]):
        assert run(["orient", "planar", str(table), "-c", "50", *length, *named, "--json"]) == 0
        solution = json.loads(capsys.readouterr().out)["solutions"][0]
        tower = solution["points"][6]
        assert tower["place"] == "off the plane"
        np.testing.assert_allclose([tower[c] for c in "xyz"], points[6], atol=1e-6)
        height = next(r for r in solution["results"] if r["kind"] == "height")
        assert height["value"] == pytest.approx(0.4, abs=1e-6)
        assert height["sigma"] > 0.4 * 0.005 / 2.5
        assert np.shape(solution["correlation"]) == (len(solution["results"]),) * 2
        assert solution["points"][0]["sx"] == solution["points"][0]["sz"] == 0.0
        assert solution["points"][0]["correlation"][0] == [None, None, None]
    assert run(["orient", "planar", str(table), "-c", "50", "--off", "X"]) == 2
    assert "off.csv: point 'X' does not exist" in capsys.readouterr().err


def test_two_images_from_one_centre_have_no_base(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(1)
    cameras = [CENTRES[0], (CENTRES[0][0], rotation(0.3, 0.2, -0.5))]
    images = [image_of(CORNERS, *one, 50.0) + 0.003 * rng.normal(size=(6, 2)) for one in cameras]
    table = write(tmp_path / "p.csv", list("ABCDEF"), *images)
    assert run(["orient", "planar", str(table), "-c", "50", "--sigma", "0.003", "--lang", "de"]) == 4
    assert "keine Basis" in capsys.readouterr().out


def test_three_images_give_one_shape_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "corners.csv"
    path.write_text(
        "id,x1,y1,x2,y2,x3,y3\n"
        "p1,-2.7018,-2.8196,9.1173,5.6656,-16.3535,37.0723\n"
        "p2,2.7876,-6.6654,-11.135,8.2713,-17.0458,-47.7273\n"
        "p3,2.5574,2.599,-8.4947,-7.9968,18.9319,-9.5096\n"
        "p4,-2.4608,-0.2583,9.1373,-1.1844,7.7518,46.0743\n"
    )
    assert run(["orient", "planar", str(path), "-c", "15", "-c", "60", "-c", "153", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["outcome"] == "unique"
    assert len(data["solutions"]) == 1


def test_images_of_a_chain_from_one_centre_are_turned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two from the first centre, two from the third; without a base at all there is the turn, and no model."""
    rng = np.random.default_rng(4)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (30, 3))
    places = [np.zeros(3), np.zeros(3), np.array([1.2, 0.1, -0.1])] + [np.array([2.3, -0.1, 0.2])] * 2
    turns = [np.zeros(3), np.array([0.1, -0.05, 0.3]), np.full(3, 0.04), np.zeros(3), np.array([0, 0.1, 0.2])]
    images = [
        image_of(points, place, rotation(*turn), 28.8) + 0.001 * rng.normal(size=(30, 2))
        for place, turn in zip(places, turns, strict=True)
    ]
    ids = [f"P{k}" for k in range(30)]
    table = write(tmp_path / "chain.csv", ids, *images)
    assert run(["orient", "relative", str(table), "-c", "28.8", "--json", "--angles", "rad"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [pair["outcome"] for pair in data["pairs"]] == ["no_base", "determined", "determined", "no_base"]
    assert data["model"]["scale_points"] == [None, 30, None]
    assert 0.6 < data["model"]["sigma0"] < 1.4
    unit = np.linalg.norm(places[2])
    for one, place, turn in zip(data["model"]["images"][1:], places[1:], turns[1:], strict=True):
        for key, truth in zip(["x", "y", "z", "omega", "phi", "kappa"], [*(place / unit), *turn], strict=True):
            assert abs(one[key] - truth) < 4.5 * one[f"s{key}"]
    turned = data["pairs"][0]["angles"]
    for key, truth in zip(("omega", "phi", "kappa"), turns[1], strict=True):
        assert 0.0 < turned[f"s{key}"] < 1e-4
        assert abs(turned[key] - truth) < 4.5 * turned[f"s{key}"]
    table = write(tmp_path / "turned.csv", ids, images[0], images[1], images[1])
    assert run(["orient", "relative", str(table), "-c", "28.8"]) == 4
    said = capsys.readouterr().out
    assert "kappa*" in said
    assert "No model of all images: not every pair of neighbouring images is oriented." in said


def test_on_the_dangerous_locus_no_solution_has_standard_deviations(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Both centres on one normal: to first order σ mean nothing, for the second solution either."""
    case = Path(__file__).parents[1] / "cases" / "plane_one_normal_twice.csv"
    options = ["-c", "50", "--sigma", ".001", "--length", "p0", "p1", "36", "--json"]
    assert run(["orient", "planar", str(case), *options]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["outcome"] == "base_along_normal"
    assert len(data["solutions"]) == 2
    for solution in data["solutions"]:
        assert all(row["sigma"] is None for row in solution["results"])
        assert all(row[key] is None for row in solution["points"] for key in ("sx", "sy", "sz"))
        assert all(row[key] is None for row in solution["images"] for key in ("sx", "somega"))
        assert all(value is None for row in solution["correlation"] for value in row)
