"""SINEX: generated solutions in all forms of the matrix, what is left out, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.project.document import Document
from mor.quality.assessment import standard_deviations
from tests.scenarios.small_projects import mor


def sinex(values: np.ndarray, Q: np.ndarray, kind: str = "COVA", triangle: str = "L", velocities: bool = False) -> str:
    """A solution of positions (n, 3), with velocities between them or without; the matrix in one of its forms."""
    names = ("STAX", "STAY", "STAZ", "VELX", "VELY", "VELZ")[: 6 if velocities else 3]
    size = len(names)
    lines = [
        "%=SNX 2.02 XXX 26:100:00000 XXX 26:099:00000 26:099:86370 P 00006 2 S",
        "+FILE/COMMENT",
        " none",
    ]
    lines += [
        "-FILE/COMMENT",
        "+SOLUTION/ESTIMATE",
        "*INDEX TYPE__ CODE PT SOLN _REF_EPOCH__ UNIT S __ESTIMATED",
    ]
    for k, value in enumerate(values.ravel()):
        unit = "m" if names[k % size].startswith("STA") else "m/y"
        site = f"S{k // size:03d}  A    1 26:099:43185 {unit:4} 2"
        lines.append(f"{k + 1:6d} {names[k % size]:6} {site} {value:21.14E} {np.sqrt(Q[k, k]):11.5E}")
    M = np.linalg.inv(Q) if kind == "INFO" else Q.copy()
    if kind == "CORR":
        sigma = np.sqrt(np.diagonal(Q))
        M = Q / np.outer(sigma, sigma)
        np.fill_diagonal(M, sigma)
    lines += ["-SOLUTION/ESTIMATE", f"+SOLUTION/MATRIX_ESTIMATE {triangle} {kind}"]
    for i in range(len(M)):
        columns = range(i + 1) if triangle == "L" else range(i, len(M))
        for first in list(columns)[::3]:
            three = [j for j in (first, first + 1, first + 2) if j in columns]
            lines.append(f"{i + 1:6d} {first + 1:6d} " + " ".join(f"{M[i, j]:.17E}" for j in three))
    return "\n".join([*lines, f"-SOLUTION/MATRIX_ESTIMATE {triangle} {kind}", "%ENDSNX", ""])


def _solution(seed: int, count: int, per_station: int = 3) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    values = np.array([4.2e6, 8.4e5, 4.7e6]) + random.uniform(-5e4, 5e4, (count, 3))
    if per_station == 6:
        values = np.hstack([values, random.uniform(-0.03, 0.03, (count, 3))])
    A = random.normal(0.0, 1e-3, (per_station * count, per_station * count))
    return values, A @ A.T + 1e-6 * np.eye(len(A))


@pytest.mark.parametrize("kind", ["COVA", "CORR", "INFO"])
@pytest.mark.parametrize("triangle", ["L", "U"])
@pytest.mark.parametrize("velocities", [False, True])
def test_positions_and_covariances_come_back(tmp_path: Path, kind: str, triangle: str, velocities: bool) -> None:
    """Adjusted without anything else: the same coordinates, σ of the matrix, no redundancy."""
    size = 6 if velocities else 3
    values, Q = _solution(3, 7, size)
    path = tmp_path / "s.snx"
    path.write_text(sinex(values, Q, kind, triangle, velocities))
    assert format_of(path) == "sinex"
    document = read_foreign(path, "sinex")
    assert any("VELX" in note.message for note in document.notes) == velocities
    solved = solve_network(read_network(document, tmp_path))
    assert solved.quality is not None
    assert solved.quality.redundancy == 0
    numbers = solved.network.things["point"].parts["position"]
    places = solved.network.world.horizon.to_geocentric(solved.adjustment.values["point"][numbers])
    np.testing.assert_allclose(places, values[:, :3], atol=3e-8)
    axes = solved.network.world.horizon.axes
    kept = [size * k + i for k in range(7) for i in range(3)]
    blocks = Q[np.ix_(kept, kept)].reshape(7, 3, 7, 3)[np.arange(7), :, np.arange(7)]
    expected = np.sqrt(np.einsum("ij,njk,ik->ni", axes, blocks, axes))
    np.testing.assert_allclose(standard_deviations(solved.quality, "point")[numbers], expected, rtol=1e-6)


def test_two_solutions_of_the_same_stations(tmp_path: Path) -> None:
    """Next to each other in one project: the weighted mean, as its formula says."""
    values, Q = _solution(4, 4)
    other = values + np.random.default_rng(5).multivariate_normal(np.zeros(12), Q).reshape(4, 3)
    first, second = tmp_path / "a.snx", tmp_path / "b.snx"
    first.write_text(sinex(values, Q))
    second.write_text(sinex(other, 4.0 * Q))
    one, two = (read_foreign(path, "sinex") for path in (first, second))
    one.data["observations"].append(two.data["observations"][0])
    solved = solve_network(read_network(one, tmp_path))
    numbers = solved.network.things["point"].parts["position"]
    places = solved.network.world.horizon.to_geocentric(solved.adjustment.values["point"][numbers])
    np.testing.assert_allclose(places, (4.0 * values + other) / 5.0, atol=3e-8)
    assert solved.quality is not None
    assert solved.quality.redundancy == 12


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("%=SNX", "%=TRO", "expected %=SNX"),
        ("-SOLUTION/MATRIX_ESTIMATE L COVA\n", "", "does not end"),
        ("+SOLUTION/MATRIX_ESTIMATE L COVA", "+SOLUTION/MATRIX_ESTIMATE L NORM", "found 'L NORM'"),
        ("+SOLUTION/ESTIMATE", "+SOLUTION/APRIORI", "there is no block SOLUTION/ESTIMATE"),
        ("     2 STAY ", "     1 STAY ", "parameter 1 is there twice"),
        ("     2 STAY ", "     2 STAX ", "is there twice"),
        (" m    2 ", " km   2 ", "found the unit 'km'"),
        ("\n     3      1 ", "\n    30      1 ", "parameter 30 is not among the estimates"),
        ("\n     1      1 ", "\n     1      2 ", "expected the other triangle"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = sinex(*_solution(6, 3))
    assert old in text
    path = tmp_path / "s.snx"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as raised:
        read_foreign(path, "sinex")
    assert any(said in problem.message for problem in raised.value.problems), raised.value


def test_a_normal_matrix_without_datum_is_told(tmp_path: Path) -> None:
    values, Q = _solution(7, 3)
    text = sinex(values, Q, "INFO")
    N = np.linalg.inv(Q)
    shift = np.tile(np.eye(3), (3, 1)) / np.sqrt(3.0)
    free = (np.eye(9) - shift @ shift.T) @ N @ (np.eye(9) - shift @ shift.T)
    begin, end = text.index("+SOLUTION/MATRIX"), text.index("-SOLUTION/MATRIX")
    rows = [f"{i + 1:6d} {j + 1:6d} {free[i, j]:.17E}" for i in range(9) for j in range(i + 1)]
    path = tmp_path / "s.snx"
    path.write_text("\n".join([text[:begin] + "+SOLUTION/MATRIX_ESTIMATE L INFO", *rows, text[end:]]))
    with pytest.raises(InputError, match="the solution has no datum"):
        read_foreign(path, "sinex")


def test_it_is_adjusted_and_its_frame_is_said_to_be_open(tmp_path: Path) -> None:
    path = tmp_path / "s.snx"
    path.write_text(sinex(*_solution(8, 4)))
    found = mor("adjust", path, "-o", tmp_path / "out", "--no-html")
    assert found.code == 0, found.err
    assert "does not say its reference frame" in found.err


def _written(document: Document, folder: Path, target: Path) -> Path:
    for path, content in write_foreign(document, folder, target, "sinex").files.items():
        path.write_bytes(content)
    return target


@pytest.mark.parametrize("seed", range(5))
def test_written_and_read_again_it_is_the_same(tmp_path: Path, seed: int) -> None:
    """Coordinates of either sign to their last digit, covariances to fourteen; lines keep to their columns."""
    values, Q = _solution(seed, 6)
    values[:, 1] *= -1.0
    path = tmp_path / "s.snx"
    path.write_text(sinex(values, Q).replace("S001  A    1", "S000  A    2"))
    before = read_foreign(path, "sinex")
    assert before.data["points"][0]["rows"][1][0] == "S000 A 2"
    target = _written(before, tmp_path, tmp_path / "o.snx")
    after = read_foreign(target)
    assert after.data["points"] == before.data["points"]
    one, two = (document.data["observations"][0] for document in (before, after))
    assert one["rows"] == two["rows"]
    np.testing.assert_allclose(one["covariance"], two["covariance"], rtol=2e-14, atol=1e-22)
    assert _written(after, tmp_path, tmp_path / "p.snx").read_text() == target.read_text()
    lines = target.read_text().splitlines()
    assert max(map(len, lines)) <= 80
    estimates = [line for line in lines if " STA" in line]
    assert {(line[14:18].strip(), line[40:44].strip(), len(line)) for line in estimates} >= {("S000", "m", 80)}
    assert [float(line[47:68]) for line in estimates] == pytest.approx(values.ravel(), abs=1e-8)


_PROJECT = """
mor: "1"
world: {crs: EPSG:4326, heights: ellipsoidal}
units: {length: m, angle: deg}
points:
  - columns: [id, latitude, longitude, height]
    rows: [[A, 48, 11, 500], [B, 48.01, 11.01, 510], [C, 48.02, 11, 520], [D, 48.02, 11.03, 500]]
observations:
  - type: gnss_position
    columns: [point, x, y, z]
    rows: [[C, 4195900.0, 815600.0, 4718790.0], [D, 4195900.123456789, -815600.3333333333, 4718790.1]]
    covariance: [[9, 1, 1, 2, 0, 0], [1, 9, 1, 0, 2, 0], [1, 1, 9, 0, 0, 2],
                 [2, 0, 0, 8, 0, 0], [0, 2, 0, 0, 8, 0], [0, 0, 2, 0, 0, 8]]
  - type: gnss_position
    columns: [point, x, y, z, cov_x_x, cov_x_y, cov_x_z, cov_y_y, cov_y_z, cov_z_z]
    rows: [[A, 4197000.1, 815800.2, 4717300.3, 4.e-6, 1.e-6, 0, 5.e-6, 0, 6.e-6]]
  - type: gnss_position
    values: {sigma: 0.003}
    columns: [point, x, y, z]
    rows: [[B, 4196200.5, 816500.5, 4718050.5]]
  - {type: gnss_vector, values: {sigma: 0.003}, columns: [from, to, dx, dy, dz], rows: [[B, C, -700, -900, 750]]}
"""


def test_tables_of_positions_become_one_solution(tmp_path: Path) -> None:
    (tmp_path / "n.yaml").write_text(_PROJECT)
    document = read_document(tmp_path / "n.yaml")
    notes = " / ".join(n.message for n in write_foreign(document, tmp_path, tmp_path / "o.snx", "sinex").notes)
    assert "SINEX cannot store: observations gnss_vector" in notes
    found = read_foreign(_written(document, tmp_path, tmp_path / "o.snx"))
    Q = np.array(found.data["observations"][0]["covariance"])
    expected = np.zeros((12, 12))
    expected[:3, :3] = np.ones((3, 3)) + 8.0 * np.eye(3)
    expected[3:6, 3:6] = 8.0 * np.eye(3)
    expected[:3, 3:6] = expected[3:6, :3] = 2.0 * np.eye(3)
    expected[6:9, 6:9] = [[4e-6, 1e-6, 0], [1e-6, 5e-6, 0], [0, 0, 6e-6]]
    expected[9:, 9:] = 9e-6 * np.eye(3)
    assert found.data["observations"][0]["rows"][1] == [
        "D",
        "4195900.123456789",
        "-815600.3333333333",
        "4718790.1",
    ]
    np.testing.assert_allclose(Q, expected, rtol=1e-13, atol=1e-22)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[[B, 4196200.5", "[[A, 4196200.5", "point 'A' has 2 observed positions"),
        ("type: gnss_position", "type: gnss_vector", "this project has none"),
        ("A, 4", "LONGER, 4", "codes of up to four letters"),
        ("world: {crs: EPSG:4326, heights: ellipsoidal}\n", "", "this project has no world"),
    ],
)
def test_what_sinex_cannot_say_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in _PROJECT
    text = _PROJECT.replace(old, new)
    if "none" in said:
        text = _PROJECT[: _PROJECT.index("  - type: gnss_pos")] + _PROJECT[_PROJECT.index("  - {type: gnss_vector") :]
    if "world" in old:
        text = text.replace("latitude, longitude, height", "x, y, z").replace("gnss_position", "coordinates")
        text = text[: text.index("observations")]
    (tmp_path / "n.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        write_foreign(read_document(tmp_path / "n.yaml"), tmp_path, tmp_path / "o.snx", "sinex")
