"""``mor datum``, ``mor covariance``, ``mor compare``, and what a project says of checks, snooping and weights."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from mor.report.comparison import Difference, differences
from tests.scenarios.small_projects import BLOCK, LEVELLING, OBJECT, block, mor, write, write_block
from tests.selection import slow_after

FREE = {"over three": "free: [P0, P5, P9]", "by components": "free: {xy: [P0, P1], xyz: [P7, P9], z: [P3]}"}
MINIMAL = "minimal: {xyz: [P0, P4], z: P8}"


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def numbers(table: list[dict[str, str]], *columns: str) -> np.ndarray:
    return np.array([[float(row[c]) for c in columns] for row in table])


def adjusted(folder: Path, text: str = BLOCK, **options: object) -> Path:
    project = write_block(folder, text, **options)  # type: ignore[arg-type]
    run = mor("adjust", project, "-o", folder / "results", "--quiet")
    assert run.code == 0, run.err
    return folder / "results"


@pytest.mark.parametrize("target", [*FREE.values(), MINIMAL])
def test_another_datum_is_what_a_direct_adjustment_gives(tmp_path: Path, target: str) -> None:
    results = adjusted(tmp_path / "one")
    carried = mor("datum", results, "--to", target)
    assert carried.code == 0, carried.err
    direct = adjusted(tmp_path / "other", BLOCK.replace("datum: free", f"datum: {{{target}}}"))
    expected = rows((direct / "points.csv").read_text())
    found = rows(carried.out)
    assert [row["id"] for row in found] == [row["id"] for row in expected]
    np.testing.assert_allclose(numbers(found, *"xyz"), numbers(expected, *"xyz"), atol=1e-9)
    sigma = ("sx", "sy", "sz", "ellipsoid_a")
    np.testing.assert_allclose(numbers(found, *sigma), numbers(expected, *sigma), atol=1e-9)
    before = numbers(rows((results / "points.csv").read_text()), *"xyz")
    assert np.abs(before - numbers(found, *"xyz")).max() > 1e-5


def test_another_datum_leaves_every_residual_as_it_is(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    run = mor("datum", results, "--to", MINIMAL, "-o", tmp_path / "minimal")
    assert run.code == 0, run.err
    one, other = (rows((folder / "residuals.csv").read_text()) for folder in (results, tmp_path / "minimal"))
    columns = ("v", "r", "w", "nabla", "external", "error")
    np.testing.assert_allclose(numbers(one, *columns), numbers(other, *columns), rtol=1e-6, atol=1e-9)
    held = {row["id"]: row for row in rows((tmp_path / "minimal" / "points.csv").read_text())}
    start = {row[0]: row[1:] for row in block(noise=0.002).points}
    for name in ("P0", "P4"):
        np.testing.assert_allclose([float(held[name][c]) for c in "xyz"], start[name], atol=1e-12)
        assert float(held[name]["sx"]) == 0.0
    assert float(held["P8"]["sz"]) == 0.0
    assert float(held["P8"]["sx"]) > 0.0


def test_another_datum_never_overwrites_the_files_it_is_read_from(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    before = {path.name: path.read_bytes() for path in results.iterdir()}
    run = mor("datum", results, "--to", MINIMAL, "-o", results, "--force")
    assert run.code == 2
    for name in ("adjusted.yaml", "reference.csv"):
        assert f"{results / name}: results would overwrite this file, from which the project is read" in run.err
    assert {path.name: path.read_bytes() for path in results.iterdir()} == before
    # a project whose table bears the name of a result
    rays = (tmp_path / "rays.csv").read_text()
    project = write_block(tmp_path / "own", BLOCK.replace("rays.csv", "residuals.csv"), residuals=rays)
    run = mor("datum", project, "--to", MINIMAL, "-o", project.parent, "--force")
    assert run.code == 2
    assert (project.parent / "residuals.csv").read_text() == rays


def test_a_minimal_datum_names_as_many_coordinates_as_there_are_movements(tmp_path: Path) -> None:
    project = write_block(tmp_path, BLOCK.replace("datum: free", "datum: {minimal: {xyz: [P0, P4, P8]}}"))
    run = mor("adjust", project)
    assert run.code == 2
    assert "9 free coordinates" in run.err
    assert "7 free movements" in run.err


def test_fixed_points_are_released_where_they_do_not_strain_the_network(tmp_path: Path) -> None:
    project = write(tmp_path, LEVELLING)
    assert mor("adjust", project, "-o", tmp_path / "results").code == 0
    run = mor("datum", tmp_path / "results", "--to", "free")
    assert run.code == 0, run.err
    heights = numbers(rows(run.out), "z", "sz")
    # loop misclosure 2 mm in three equal parts; corrections sum to zero over the three marks
    np.testing.assert_allclose(heights[:, 0] - [10.0, 11.0, 12.0], [-2e-3 / 3, -1e-3 / 3, 1e-3], atol=1e-12)
    np.testing.assert_allclose(heights[:, 1], np.full(3, heights[0, 1]), rtol=1e-9)


def test_fixed_points_that_strain_the_network_are_not_given_up_silently(tmp_path: Path) -> None:
    text = LEVELLING.replace("[B, 0, 0, 11]", "[B, 0, 0, 11.05]").replace(
        "rows: [[B, 0, 0, 11.05], [C, 0, 0, 12]], fixed: [x, y]}",
        "rows: [[B, 0, 0, 11.05]], fixed: [x, y, z]}\n"
        "  - {columns: [id, x, y, z], rows: [[C, 0, 0, 12]], fixed: [x, y]}",
    )
    project = write(tmp_path, text)
    assert mor("adjust", project, "-o", tmp_path / "results").code == 0
    run = mor("datum", tmp_path / "results", "--to", "free")
    assert run.code == 2
    assert "strain" in run.err
    # and the report says which of them the observations contradict
    contradicted = json.loads((tmp_path / "results" / "results.json").read_text())["fixed_points"]
    assert {row["id"] for row in contradicted} == {"A", "B"}
    # B has come out 50 mm too high against A: one observation between them, two by way of C
    for row in contradicted:
        assert row["freedom"] == 1
        assert abs(row["movement"][2]) == pytest.approx(0.05 - 0.001 + 2e-3 / 3 - 1e-3, abs=2e-3)
        assert row["p"] < 1e-10
    assert "contradict these fixed coordinates" in (tmp_path / "results" / "report.txt").read_text()


def test_covariances_of_chosen_points(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    for suffix in ("npz", "csv", "mtx"):
        run = mor("covariance", results, "--points", "P3,P0", "-o", tmp_path / f"chosen.{suffix}")
        assert run.code == 0, run.err
    archive = np.load(tmp_path / "chosen.npz")
    assert list(archive["labels"]) == [f"point {p} {c}" for p in ("P3", "P0") for c in "xyz"]
    table = {row["id"]: row for row in rows((results / "points.csv").read_text())}
    expected = [float(table[p][f"s{c}"]) for p in ("P3", "P0") for c in "xyz"]
    np.testing.assert_allclose(np.sqrt(np.diagonal(archive["covariance"])), expected, rtol=1e-7)
    np.testing.assert_allclose(archive["values"], [float(table[p][c]) for p in ("P3", "P0") for c in "xyz"], atol=1e-9)
    written = rows((tmp_path / "chosen.csv").read_text())
    np.testing.assert_allclose(numbers(written, *archive["labels"]), archive["covariance"], rtol=1e-15)
    from scipy.io import mmread

    np.testing.assert_allclose(mmread(tmp_path / "chosen.mtx"), archive["covariance"], rtol=1e-15)
    assert "datum: free" in (tmp_path / "chosen.mtx").read_text()
    twice = ["--points", "P3", "--points", "P0", "-o", tmp_path / "twice.csv"]
    assert mor("covariance", results, *twice).code == 0
    assert (tmp_path / "twice.csv").read_text() == (tmp_path / "chosen.csv").read_text()


def test_expanded_uncertainties_are_multiples_of_sigma(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    for suffix in ("npz", "csv", "mtx"):
        run = mor("covariance", results, "--points", "P3", "--coverage", "2", "-o", tmp_path / f"u.{suffix}")
        assert run.code == 0, run.err
    archive = np.load(tmp_path / "u.npz")
    np.testing.assert_allclose(archive["U"], 2.0 * np.sqrt(np.diagonal(archive["covariance"])), rtol=1e-14)
    assert [float(row["U"]) for row in rows((tmp_path / "u.csv").read_text())] == archive["U"].tolist()
    assert f"U = {archive['U'].tolist()[0]!r}" in (tmp_path / "u.mtx").read_text()
    freedom = json.loads((results / "results.json").read_text())["redundancy"]
    assert f"{100.0 * (1.0 - 2.0 * student.sf(2.0, freedom)):.2f} % (Student's t, {freedom} degrees" in run.err
    again = ("--points", "P3", "--coverage", "2", "--lang", "de", "-o", tmp_path / "de.csv")
    assert re.search(r"k = 2: Überdeckungswahrscheinlichkeit \d\d,\d\d %", mor("covariance", results, *again).err)
    for option, value, sigma in (("--blocks", "Ux", "xx"), ("--relative", "Udistance", "sdistance")):
        given = [option] if option == "--blocks" else [option, "P1,P2"]
        table = tmp_path / f"{option}.csv"
        assert mor("covariance", results, *given, "--coverage", "3", "-o", table).code == 0
        row = rows(table.read_text())[0]
        expected = 3.0 * float(row[sigma]) ** (0.5 if option == "--blocks" else 1.0)
        assert float(row[value]) == pytest.approx(expected, rel=1e-14)


def test_full_covariance_has_all_unknowns_in_the_axes_of_the_project(tmp_path: Path) -> None:
    results = adjusted(tmp_path, BLOCK.replace("title:", "axes: {xy: nw}\ntitle:"))
    assert mor("covariance", results, "--full", "-o", tmp_path / "all.npz").code == 0
    archive = np.load(tmp_path / "all.npz")
    labels = list(archive["labels"])
    assert len(labels) == 60
    sigma = np.sqrt(np.diagonal(archive["covariance"]))
    correlations = archive["covariance"] / np.outer(sigma, sigma)
    # seven free movements: a free network has no variance along them
    sizes = np.linalg.eigvalsh(correlations)
    assert sizes[6] < 1e-8 < sizes[7]
    images = {row["id"]: row for row in rows((results / "images.csv").read_text())}
    for name in ("omega", "kappa"):
        k = labels.index(f"rotation image 010 {name}")
        assert archive["units"][k] == "gon"
        assert np.sqrt(archive["covariance"][k, k]) == pytest.approx(float(images["010"][f"s{name}"]), rel=1e-6)
    points = {row["id"]: row for row in rows((results / "points.csv").read_text())}
    k = labels.index("point P2 y")
    assert np.sqrt(archive["covariance"][k, k]) == pytest.approx(float(points["P2"]["sy"]), rel=1e-7)


def test_blocks_and_relative_ellipsoids(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    assert mor("covariance", results, "--blocks", "-o", tmp_path / "blocks.csv").code == 0
    assert mor("covariance", results, "--points", "P1,P2", "-o", tmp_path / "two.npz").code == 0
    assert mor("covariance", results, "--relative", "P1,P2", "-o", tmp_path / "pairs.csv").code == 0
    blocks = {row["id"]: row for row in rows((tmp_path / "blocks.csv").read_text())}
    q = np.load(tmp_path / "two.npz")["covariance"]
    assert float(blocks["P1"]["xz"]) == pytest.approx(q[0, 2], rel=1e-7)
    (pair,) = rows((tmp_path / "pairs.csv").read_text())
    difference = q[:3, :3] + q[3:, 3:] - q[:3, 3:] - q[3:, :3]
    assert float(pair["sdx"]) == pytest.approx(np.sqrt(difference[0, 0]), rel=1e-7)
    expected = np.sqrt(np.linalg.eigvalsh(difference))[::-1]
    np.testing.assert_allclose([float(pair[c]) for c in "abc"], expected, rtol=1e-6)
    d = np.array([float(pair[c]) for c in ("dx", "dy", "dz")])
    length = np.linalg.norm(d)
    assert float(pair["distance"]) == pytest.approx(length)
    assert float(pair["sdistance"]) == pytest.approx(np.sqrt(d @ difference @ d) / length, rel=1e-6)


def test_covariances_of_images_and_cameras_are_those_of_all_unknowns(tmp_path: Path) -> None:
    results = adjusted(tmp_path, BLOCK.replace("c: 20", "c: {free: 20}"))
    wanted = ("--points", "P1", "--images", "1e3,010", "--cameras")
    assert mor("covariance", results, *wanted, "-o", tmp_path / "some.npz").code == 0
    assert mor("covariance", results, "--full", "-o", tmp_path / "all.npz").code == 0
    some, everything = np.load(tmp_path / "some.npz"), np.load(tmp_path / "all.npz")
    where = [list(everything["labels"]).index(label) for label in some["labels"]]
    assert len(where) == 3 + 2 * 6 + 1
    expected = everything["covariance"][np.ix_(where, where)]
    scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    np.testing.assert_allclose(some["covariance"] / scale, expected / scale, atol=1e-9)


def _relative_pose(poses: np.ndarray) -> np.ndarray:
    """Base and angles (gon) of the second image in the axes of the first: two rows x, y, z, ω, φ, κ (gon)."""
    first, second = (Rotation.from_euler("XYZ", np.radians(angles * 0.9)) for angles in poses[:, 3:])
    base = first.inv().apply(poses[1, :3] - poses[0, :3])
    return np.concatenate([base, np.degrees((first.inv() * second).as_euler("XYZ")) / 0.9])


def test_relative_pose_against_differences_of_the_poses(tmp_path: Path) -> None:
    results = adjusted(tmp_path)
    assert mor("covariance", results, "--images", "010,1e3", "-o", tmp_path / "two.npz").code == 0
    assert mor("covariance", results, "--relative-pose", "010,1e3", "-o", tmp_path / "pose.csv").code == 0
    two = np.load(tmp_path / "two.npz")
    poses, steps = two["values"].reshape(2, 6), np.sqrt(np.diagonal(two["covariance"])) * 0.1
    columns = []
    for step in np.diag(steps):
        ahead, back = (_relative_pose(poses + sign * step.reshape(2, 6)) for sign in (1.0, -1.0))
        columns.append((ahead - back) / (2.0 * step.sum()))
    A = np.stack(columns, axis=1)
    expected = A @ two["covariance"] @ A.T
    (row,) = rows((tmp_path / "pose.csv").read_text())
    names = ("bx", "by", "bz", "omega", "phi", "kappa")
    np.testing.assert_allclose([float(row[name]) for name in names], _relative_pose(poses), atol=1e-7)
    sigma = np.array([float(row[f"s{name}"]) for name in names])
    np.testing.assert_allclose(sigma, np.sqrt(np.diagonal(expected)), rtol=1e-4)
    assert float(row["cov_bx_kappa"]) / (sigma[0] * sigma[5]) == pytest.approx(
        expected[0, 5] / (sigma[0] * sigma[5]), abs=1e-4
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "or one of"),
        (("--full", "--blocks"), "or one of"),
        (("--images", "010,Q9"), "Q9"),
        (("--cameras", "Q9"), "Q9"),
        (("--images", "010", "--full"), "or one of"),
        (("--relative-pose", "010"), "two images"),
        (("--points", "P1,Q9"), "Q9"),
        (("--relative", "P1"), "two points"),
    ],
)
def test_mistakes_in_what_is_wanted(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    results = adjusted(tmp_path)
    run = mor("covariance", results, *arguments, "-o", tmp_path / "out.csv")
    assert run.code == 2
    assert words in run.err
    assert not (tmp_path / "out.csv").exists()


def test_equal_results_are_equal_and_others_are_not(tmp_path: Path) -> None:
    one, other = adjusted(tmp_path / "one"), adjusted(tmp_path / "other")
    assert mor("compare", one, other).code == 0
    different = adjusted(tmp_path / "third", rows=block(noise=0.002, seed=9))
    run = mor("compare", one, different, "--tol", "1e-6")
    assert run.code == 1
    assert "points.P0.x" in run.out or "more" in run.out
    assert mor("compare", one, different, "--tol", "1e6").code == 1, "flags and texts differ all the same"
    assert mor("compare", one).code == 2
    assert mor("compare", one, tmp_path / "nowhere").code == 2


def test_numbers_are_compared_with_the_tolerance_that_is_given() -> None:
    assert differences({"x": 1.0}, {"x": 1.0 + 2e-6}, 1e-6) == [Difference("x", 1.0, 1.0 + 2e-6)]
    assert differences({"x": 1.0}, {"x": 1.0 + 2e-6}, 3e-6) == []
    assert differences({"x": 100.0}, {"x": 100.0 + 2e-6}, 1e-6) == []


def _epoch(folder: Path, seed: int, moved: tuple[float, float, float] | None = None) -> Path:
    """The block with four images, one point perhaps elsewhere; start values as they were."""
    if moved is not None:
        OBJECT[6] += moved
    try:
        rows_ = block(noise=0.0002, seed=seed)
    finally:
        if moved is not None:
            OBJECT[6] -= moved
    rows_ = rows_._replace(points=block().points)
    bar = float(np.linalg.norm(OBJECT[0] - OBJECT[11]))
    text = BLOCK.replace("2 um", "0.2 um").replace(
        "observations:",
        "observations:\n  - {type: distance, columns: [from, to, distance, sigma], "
        f"rows: [[P0, P11, {bar!r}, 0.0001]]}}",
    )
    return adjusted(folder, text, rows=rows_)


def test_epochs(tmp_path: Path) -> None:
    spring, autumn = _epoch(tmp_path / "spring", 1), _epoch(tmp_path / "autumn", 2)
    still = mor("compare", spring, autumn, "--epochs")
    assert still.code == 0, still.err
    assert "congruent" in still.err
    later = _epoch(tmp_path / "later", 3, moved=(0.0, 0.0, -0.01))
    run = mor("compare", spring, later, "--epochs")
    assert run.code == 1
    assert "NOT congruent" in run.err
    assert "as moved: P6." in run.err
    table = {row["point"]: row for row in rows(run.out)}
    assert [name for name, row in table.items() if row["moved"] == "true"] == ["P6"]
    assert float(table["P6"]["dz"]) == pytest.approx(-0.01, abs=4.0 * float(table["P6"]["sdz"]))


def test_page_of_two_epochs(tmp_path: Path) -> None:
    """Vectors and ellipses at one scale, what has moved told apart, no label over another, both languages."""
    spring, later = (
        _epoch(tmp_path / "spring", 1),
        _epoch(tmp_path / "later", 3, moved=(0.0, 0.0, -0.01)),
    )
    assert mor("compare", spring, later, "--page", tmp_path / "x.html").code == 2
    run = mor("compare", spring, later, "--epochs", "--page", tmp_path / "en.html")
    assert run.code == 1
    page = (tmp_path / "en.html").read_text(encoding="utf-8")
    assert "1 point has moved, of 12" in page
    table = {row["point"]: row for row in rows(run.out)}
    drawing = page[page.index('<svg class="drawing"') : page.index("</svg>", page.index('<svg class="drawing"'))]
    lines = [
        [float(x) for x in found]
        for found in re.findall(r'<line class="(?:moved|stable)" x1="(.*?)" y1="(.*?)" x2="(.*?)" y2="(.*?)"', drawing)
    ]
    vectors = np.array([[c - a, d - b] for a, b, c, d in lines])
    assert len(lines) == len(table) == drawing.count("<ellipse")
    assert drawing.count('<line class="moved"') == 1
    sizes = {  # of the two axes that are drawn: those whose vectors are all at one scale
        axes: np.hypot(*(np.array([float(row[f"d{axis}"]) for row in table.values()]) for axis in axes))
        for axes in ("xy", "xz", "yz")
    }
    lengths = np.hypot(*vectors.T)
    assert any(np.allclose(lengths, size * (lengths @ size) / (size @ size), atol=0.15) for size in sizes.values())
    boxes = [
        (float(x) - 3.0 * len(name), float(y) - 10.0, float(x) + 3.0 * len(name), float(y))
        for x, y, name in re.findall(
            r'<text(?: class="strong")? x="([\d.]+)" y="([\d.]+)" text-anchor="middle">(P\d+)<', drawing
        )
    ]
    assert len(boxes) >= 6
    apart = [
        a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3] for k, a in enumerate(boxes) for b in boxes[:k]
    ]
    assert all(apart)
    german = mor("compare", spring, later, "--epochs", "--page", tmp_path / "de.html", "--lang", "de")
    assert "NICHT kongruent" in german.err
    assert german.out == run.out
    assert "1 Punkt hat sich bewegt, von 12" in (tmp_path / "de.html").read_text(encoding="utf-8")
    assert mor("compare", spring, later, "--epochs", "--page", tmp_path / "de.html").code == 2


def test_pairs_of_points_of_one_adjustment(tmp_path: Path) -> None:
    text = """\
mor: 1
points:
  - {columns: [id, z], rows: [[A, 0]], fixed: [z]}
  - {columns: [id, z], rows: [[B0, 1], [B1, 1], [C0, 2], [C1, 2]]}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, B0, 1.000, 0.001], [A, B0, 1.001, 0.001], [A, B1, 1.020, 0.001], [A, B1, 1.021, 0.001],
           [A, C0, 2.000, 0.001], [A, C0, 1.999, 0.001], [A, C1, 2.001, 0.001], [A, C1, 2.000, 0.001]]
settings: {dimensions: z}
"""
    project = write(tmp_path, text, pairs="first,second\nB0,B1\nC0,C1\n")
    assert mor("adjust", project, "-o", tmp_path / "results").code == 0
    run = mor("compare", tmp_path / "results", "--pairs", tmp_path / "pairs.csv", "--known-sigma0")
    assert run.code == 1, run.err
    one, other = rows(run.out)
    assert (one["moved"], other["moved"]) == ("true", "false")
    assert float(one["dz"]) == pytest.approx(0.020)
    assert float(one["test"]) == pytest.approx(0.02**2 / 1e-6, rel=1e-9)


CHECKS = """\
checks:
  - {name: known points, type: coordinates, columns: [point, x, y, z], values: {sigma: 1 mm}, rows: ROWS}
  - {name: tape, type: distance, columns: [from, to, distance], values: {sigma: 1 mm}, rows: TAPE}
"""


def _with_checks(folder: Path, shift: float) -> Path:
    """The block with six points observed as control, and three others as check points."""
    points = block().points
    control = "\n".join(f"      - [{', '.join(map(repr, row))}]" for row in points[:6])
    entry = (
        "observations:\n  - type: coordinates\n    columns: [point, x, y, z]\n"
        f"    values: {{sigma: 1 mm}}\n    rows:\n{control}"
    )
    known = [[name, x, y, z + shift] for name, x, y, z in points[8:11]]
    tape = float(np.linalg.norm(OBJECT[8] - OBJECT[10])) - shift
    checks = CHECKS.replace("ROWS", json.dumps(known)).replace("TAPE", f"[[P8, P10, {tape!r}]]")
    return adjusted(folder, BLOCK.replace("datum: free", checks).replace("observations:", entry))


def test_checks_are_kept_out_and_reported_apart(tmp_path: Path) -> None:
    results = _with_checks(tmp_path / "good", 0.0)
    data = json.loads((results / "results.json").read_text())
    plain = json.loads((adjusted(tmp_path / "plain") / "results.json").read_text())
    assert data["observations"] == plain["observations"] + 18
    assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-6)
    rms = {(row["group"], row["component"]): row for row in data["checks"]}
    assert rms["known points", "x"]["count"] == 3
    assert all(row["rms"] < 0.003 for row in data["checks"])
    assert all(row["exceeding"] == 0 for row in data["checks"])
    wrong = _with_checks(tmp_path / "wrong", 0.02)
    other = json.loads((wrong / "results.json").read_text())
    assert other["sigma0"] == data["sigma0"], "checks take no part in the adjustment"
    table = {(row["group"], row["component"]): row for row in other["checks"]}
    assert table["known points", "z"]["mean"] == pytest.approx(-0.02 + rms["known points", "z"]["mean"], abs=1e-9)
    assert table["known points", "z"]["exceeding"] == 3
    assert table["known points", "x"]["rms"] == pytest.approx(rms["known points", "x"]["rms"], abs=1e-9)
    report = (wrong / "report.txt").read_text()
    assert "Largest length measurement error" in report
    flags = [row["flag"] for row in rows((wrong / "residuals.csv").read_text()) if row["group"] == "tape"]
    assert flags == ["check"]
    # the adjusted project checks the same again
    again = mor("adjust", wrong / "adjusted.yaml", "-o", tmp_path / "again")
    assert again.code == 0, again.err
    repeated = json.loads((tmp_path / "again" / "results.json").read_text())["checks"]
    assert repeated[2]["mean"] == pytest.approx(other["checks"][2]["mean"], abs=1e-8)


def test_a_check_of_what_nothing_determines_is_a_mistake(tmp_path: Path) -> None:
    text = BLOCK.replace(
        "datum: free",
        "checks:\n  - {type: coordinates, columns: [point, x, y, z, sigma], rows: [[Z, 1, 2, 3, 0.001]]}\ndatum: free",
    )
    text = text.replace(
        "  - file: points.csv", "  - file: points.csv\n  - {columns: [id, x, y, z], rows: [[Z, 1, 2, 3]]}"
    )
    run = mor("adjust", write_block(tmp_path, text))
    assert run.code == 2
    assert "'Z' is a check point, but nothing determines it" in run.err


def _spoiled(folder: Path) -> Path:
    rows_ = block(noise=0.002)
    rows_.rays[17][2] += 0.2
    return write_block(folder, rows=rows_)


def test_snooping_excludes_the_gross_error_and_shows_it(tmp_path: Path) -> None:
    project = _spoiled(tmp_path)
    plain = mor("adjust", project, "-o", tmp_path / "plain", "--strict")
    assert plain.code == 1
    explained = (tmp_path / "plain" / "report.txt").read_text()
    assert "would move" in explained
    run = mor("adjust", project, "--snoop", "-o", tmp_path / "snooped", "--strict")
    assert run.code == 0, run.err
    excluded = [row for row in rows((tmp_path / "snooped" / "residuals.csv").read_text()) if row["flag"] == "excluded"]
    assert {(row["from"], row["to"]) for row in excluded} == {("no", "P5")}
    in_x = next(row for row in excluded if row["component"] == "x")
    assert float(in_x["v"]) == pytest.approx(-0.2, abs=0.02)
    assert float(in_x["sigma"]) == pytest.approx(0.002)
    data = json.loads((tmp_path / "snooped" / "results.json").read_text())
    assert data["gross_errors"]["snooping"]["clean"]
    again = mor("adjust", tmp_path / "snooped" / "adjusted.yaml", "-o", tmp_path / "again", "--quiet")
    assert again.code == 0
    assert mor("compare", tmp_path / "snooped", tmp_path / "again", "--tol", "1e-6").code in (0, 1)
    one, other = (rows((tmp_path / name / "points.csv").read_text()) for name in ("snooped", "again"))
    np.testing.assert_allclose(numbers(one, *"xyz"), numbers(other, *"xyz"), atol=1e-8)


@pytest.mark.parametrize("method", slow_after(1, ["l1", "danish"]))
def test_robust_estimation_is_shown_beside_least_squares(tmp_path: Path, method: str) -> None:
    project = _spoiled(tmp_path)
    project.write_text(project.read_text() + f"settings: {{robust: {method}}}\n")
    assert mor("adjust", project, "-o", tmp_path / "results").code == 0
    robust = json.loads((tmp_path / "results" / "results.json").read_text())["gross_errors"]["robust"]
    assert {"image": "no", "point": "P5"} in [row["names"] for row in robust["rejected"]]
    assert robust["largest_shift"] > 1e-3


@pytest.mark.parametrize("method", ["simplified", "helmert"])
def test_variance_components_are_iterated_into_the_weights(tmp_path: Path, method: str) -> None:
    settings = f"settings: {{variance_components: iterate, variance_method: {method}}}\n"
    text = BLOCK.replace("2 um", "8 um") + settings
    results = adjusted(tmp_path, text)
    data = json.loads((results / "results.json").read_text())
    assert data["sigma0"]["ratio"] == pytest.approx(1.0, rel=1e-4)
    (group,) = data["groups"]
    assert group["sigma_factor"] == pytest.approx(0.25, abs=4.0 * group["sigma_of_factor"])
    told = data["variance_components"]
    assert (told["method"], told["iterated"], told["settled"]) == (method, True, True)
    words = {"simplified": "simplified, group by group", "helmert": "Helmert's full system"}[method]
    assert f"({words}; iterated into the weights)" in (results / "report.txt").read_text()


def test_familywise_level_lowers_the_level_of_each_test(tmp_path: Path) -> None:
    results = adjusted(tmp_path, BLOCK + "settings: {familywise_level: 0.05}\n")
    data = json.loads((results / "results.json").read_text())
    assert 1.0 - (1.0 - data["snooping_level"]) ** 96 == pytest.approx(0.05, rel=1e-9)
    assert data["critical_w"] > 3.4


def test_reports_in_another_datum_in_german(tmp_path: Path) -> None:
    results = adjusted(tmp_path / "one")
    run = mor("datum", results, "--to", "free: [P0, P5, P9]", "-o", tmp_path / "other", "--lang", "de")
    assert run.code == 0, run.err
    assert run.err.startswith("Ergebnisse in ")
    report = (tmp_path / "other" / "report.txt").read_text(encoding="utf-8")
    assert "Teilspurminimierung über x, y, z von 3 genannten Punkten oder Gruppen" in report
    assert '<html lang="de"' in (tmp_path / "other" / "report.html").read_text(encoding="utf-8")
