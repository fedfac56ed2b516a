"""SINEX: generated solutions in all forms of the matrix, what is left out, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_projects import mor

from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.pipeline import read_network, solve_network
from mor.quality.assess import standard_deviations


def sinex(
    values: np.ndarray, Q: np.ndarray, kind: str = "COVA", triangle: str = "L", velocities: bool = False
) -> str:
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
def test_positions_and_covariances_come_back(
    tmp_path: Path, kind: str, triangle: str, velocities: bool
) -> None:
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
