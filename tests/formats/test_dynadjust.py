"""DynAdjust's files: a real GNSS network against the program's own adjustment, what is left out, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reference_data import missing, network_of, point_results, reference_folder

from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.pipeline import solve_network
from mor.project.file.nodes import Document

REAL = reference_folder("earth/dynadjust")

STATIONS = """!#=DNA 3.01 STN    13.12.2018       GDA2020    01.01.2020         3
A                   CCC XYZ     -4250323.0000        2871048.0000        -3778696.0000    first one
B B                 FFF LLH      -36.3238821312      145.5821570921            167.5630
C                   FFF UTM         320236.2750        5813988.8399             31.4770 55
unused              FFF LLH      -36.3238821312      145.5821570921            167.5630
"""
_N = " " * 62


def _line(code: str, *names: str, scales: str = "   1.00      1.00      1.00      1.00") -> str:
    frame = "   GDA2020   01.01.2020" if code[0] in "GX" else ""
    return code.ljust(2) + "".join(name.ljust(20) for name in names).ljust(60) + scales + frame


def _numbers(*values: float) -> str:
    return f"{_N}{values[0]:20.4f}" + "".join(f"{value:19.12e}" for value in values[1:])


def _block(*values: float) -> str:
    return " " * 82 + "".join(f"{value:19.12e}" for value in values)


MEASURED = "\n".join(
    [
        "!#=DNA 3.01 MSR    13.12.2018       GDA2020    01.01.2020         4",
        "* a comment",
        _line("G", "A", "B B", scales="   4.00      1.00      1.00      1.00"),
        _numbers(-1617.5, 1e-5),
        _numbers(-124.25, -2e-6, 2e-5),
        _numbers(1722.75, 3e-6, 4e-6, 3e-5),
        _line("X", "A", "B B", "2"),
        _numbers(-1617.51, 1e-5),
        _numbers(-124.26, 0, 1e-5),
        _numbers(1722.76, 0, 0, 1e-5),
        _block(1e-6, 2e-6, 3e-6),
        _block(4e-6, 1e-6, 1e-6),
        _block(1e-6, 0, 0),
        _line("X", "A", "C"),
        _numbers(100, 2e-5),
        _numbers(200, 0, 2e-5),
        _numbers(300, 0, 0, 2e-5),
        _line("S", "B B", "C", scales="    2259.0              0.005"),
        _line("S", "B B", "C", scales="    2259.0              0.005  1.606  1.565"),
        _line("G*", "A", "C"),
        _numbers(-9, 1e-5),
        _numbers(-9, 0, 1e-5),
        _numbers(9, 0, 0, 1e-5),
        _line("H", "A", scales="    43.0859               0.065000"),
        "",
    ]
)


def _files(folder: Path, stations: str = STATIONS, measured: str = MEASURED) -> Path:
    (folder / "n.stn").write_text(stations, newline="")
    (folder / "n.msr").write_text(measured.replace("\n", "\r\n"), newline="")
    return folder / "n.msr"


def test_what_the_files_say(tmp_path: Path) -> None:
    path = _files(tmp_path)
    assert format_of(path) == format_of(tmp_path / "n.stn") == "dynadjust"
    document = read_foreign(tmp_path / "n.stn")
    free, held = document.data["points"][1], document.data["points"][0]
    held, free = (free, held) if free.get("fixed") else (held, free)
    assert held["rows"] == [["A", "-4250323.0", "2871048.0", "-3778696.0"]]
    assert [row[0] for row in free["rows"]] == ["B B", "C"]
    cluster, single, distance = document.data["observations"]
    Q = np.array(cluster["covariance"])
    assert Q[0, 4] == Q[4, 0] == 2e-6
    assert Q[1, 3] == 4e-6
    assert [float(v) for v in single["rows"][0][5:8]] == [4e-5, -8e-6, 1.2e-5]
    assert distance["rows"] == [["B B", "C", "2259.0", "0.005"]]
    notes = " ".join(map(str, document.notes))
    for words in ("slope distances with heights (1)", "switched off (*) (1)", "orthometric heights (1)"):
        assert words in notes
    network_of(document, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CCC XYZ", "CCF XYZ", r"n\.stn:2: station 'A': CCF in XYZ needs the ellipsoid"),
        ("FFF LLH", "CCC LLH", r"n\.stn:3: station 'B B': CCC in LLH needs"),
        ("-36.32", "-96.32", r"n\.stn:3: station 'B B': found the latitude"),
        ("\nC  ", "\nD  ", r"n\.msr:7: station 'C' is not in n\.stn|n\.msr:14: station 'C' is not in n\.stn"),
        ("!#=DNA 3", "!#=DNA 1", r"n\.(stn|msr):1: found '!#=DNA 1"),
        ("4.00      1.00", "4.00      2.00", r"n\.msr:3: scales of the covariances in latitude"),
        ("2         ", "x         ", r"n\.msr:7: found 'x', expected the number of members"),
        ("2         ", "3         ", r"n\.msr:\d+: "),
        (
            "1.000000000000e-05\n",
            "1.000000000000e-05 7\n",
            r"n\.msr:4: found 3 numbers, expected a value and 1",
        ),
        ("2.000000000000e-05", "2.000000000000e-15", r"n\.msr:3: the covariance matrix is not positive"),
        ("G A", "w A", r"n\.msr:3: found the measurement 'w'"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = _files(tmp_path, STATIONS.replace(old, new, 1), MEASURED.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def _expected() -> tuple[list[float], dict[str, list[float]]]:
    """Measured values after DynAdjust's own transformation, and adjusted coordinates, as printed."""
    assert REAL is not None
    text = (REAL / "gnss.simult.adj.expected").read_text()
    rows = [line for line in text.splitlines() if line[:2] in ("G ", "X ", "Y ") and line[65:66] in "XYZ"]
    places = text[text.index("Adjusted Coordinates") :].splitlines()[5:]
    found = {line[:20].strip(): [float(v) for v in line[20:].split()[5:8]] for line in places if line.strip()}
    return [float(line[66:88]) for line in rows if line[65:66].strip()], found


def _with_values(document: Document, values: list[float]) -> None:
    """Put other measured values in place, in the order of the file."""
    tables = [
        (t, row, k)
        for t, table in enumerate(document.data["observations"])
        for k, row in enumerate(table["rows"])
    ]
    tables.sort(key=lambda place: document.lines["observations", place[0], "rows", place[2]])
    for (t, row, _), xyz in zip(tables, np.reshape(values, (-1, 3)).tolist(), strict=True):
        first = 2 if document.data["observations"][t]["type"] == "vector" else 1
        np.testing.assert_allclose([float(v) for v in row[first : first + 3]], xyz, atol=5e-3)
        row[first : first + 3] = [repr(v) for v in xyz]


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_a_real_network_adjusts_to_what_dynadjust_says() -> None:
    """417 measurements, 288 degrees of freedom, χ² 336.64, coordinates to the printed 0.1 mm."""
    assert REAL is not None
    document = read_foreign(REAL / "gnss-network.msr")
    values, places = _expected()
    assert len(values) == 417
    _with_values(document, values)
    solved = solve_network(network_of(document, REAL))
    assert solved.quality.redundancy == 288
    assert solved.quality.sigma0**2 * 288 == pytest.approx(336.64, abs=0.5)  # values are printed to 0.1 mm
    found = point_results(solved)
    assert set(found) == set(places)
    difference = np.array([found[name][0] - places[name] for name in places])
    assert np.abs(difference).max() < 2e-4


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_a_network_on_the_ellipsoid_is_refused_by_name() -> None:
    assert REAL is not None
    with pytest.raises(
        InputError,
        match=r"urban-network\.stn:99: station '2215': FFC in UTM needs the ellipsoid and the geoid",
    ):
        read_foreign(REAL / "urban-network.msr")
