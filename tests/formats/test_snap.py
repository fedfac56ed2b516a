"""SNAP's files: its own test of observation types, what is left out, a generated network there and back, mistakes."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

from mor.api.pipeline import read_network, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.project.document import Document
from mor.quality.solution import Solved
from mor.units import ANGLE
from tests.reference_data import missing, reference_folder
from tests.scenarios.small_projects import mor

REAL = reference_folder("earth/snap")
real = pytest.mark.skipif(REAL is None, reason=missing("earth/snap"))
_SCALAR = {"length": 0.6e-4, "angle": 0.6e-5}

COMMANDS = """title Three stations ! a comment
coordinate_file n.crd
data_file n.dat
mode 3d adjustment
fix A
refraction_coefficient DEFAULT 0.07
list input_data
"""
STATIONS = """Three stations
NZGD2000
options ellipsoidal_heights no_deflections geoid_heights c=Order

! code latitude longitude height geoid order name
A  41 00 46.800000 S 173 19 15.600000 E   150.0000  10.0 2 First one
B  41 00 25.200000 S 173 19 40.800000 E   250.0000  10.0 2
C  41 00 28.800000 S 173 19 58.800000 E    70.0000  10.0 3
"""
MEASURED = """Three stations
#date 12 May 2001
#classification equpt
#data HA error ZD error SD equpt no_heights
#ds_error 3 mm 2 ppm
A
B  10 28 15.8 2.0   83 35 17.3 4.0   894.9014 EDM
C  30 11 26.3 2.0   -                1154.9438 EDM

B
A   1 27 59.3 2.0   96 25 11.5 4.0   894.902 error 0.005 EDM
C * 244 47 28.1 2.0  112 25 00.0 4.0   -

#data LV
#lv_error 5 mm
A 1.5 B 1.5 100.0
#hp_angles
#data AZ error no_heights
A B 41.28158 4
#gps_error_type full
#data GB error no_heights
A B -577.70 -525.31 437.21 &
    4e-6 1e-7 5e-6 -2e-7 1e-7 6e-6
#gps_enu_error 3 3 5 mm 1 1 2 ppm
#data GB grouped no_heights
A
B -577.70 -525.31 437.22
* C -419.25 -967.36 471.50
#end_set
#data PB error no_heights
#projection NZTM
A B 40.30568 4
"""


def _files(folder: Path, data: str = MEASURED, stations: str = STATIONS, commands: str = COMMANDS) -> Path:
    for name, text in {"n.snp": commands, "n.crd": stations, "n.dat": data}.items():
        (folder / name).write_text(text)
    return folder / "n.snp"


def _solved(path: Path) -> Solved:
    return solve_network(read_network(read_foreign(path, "snap"), path.parent))


def _by_line(solved: Solved) -> dict[tuple[str, int], list[tuple[int, int]]]:
    """Groups and rows by the line of the file they come from."""
    found: dict[tuple[str, int], list[tuple[int, int]]] = {}
    for number, group in enumerate(solved.network.groups):
        for row, line in enumerate(group.lines):
            found.setdefault((Path(group.file).name, int(line)), []).append((number, row))
    return found


@real
def test_every_observation_of_its_own_test() -> None:
    """Residuals, σ and redundancy to the printed digit; the circles' orientations and scales of ratios are unknowns."""
    assert REAL is not None
    solved = _solved(REAL / "test1.snp")
    places = _by_line(solved)
    with (REAL / "expected-test1-obs.csv").open() as file:
        rows = list(csv.DictReader(file))
    used = [row for row in rows if row["status"] == "use"]
    assert solved.quality is not None
    assert solved.quality.redundancy == 153
    horizon = solved.network.world.horizon
    compared = 0
    for row in used:
        number, k = places[row["sourcefile"], int(row["sourcelineno"])][0]
        group, quality = solved.network.groups[number], solved.quality.groups[number]
        if row["obstype"] in ("GB", "GX"):
            blocks = [
                block[k] for block, slot in zip(group.blocks, group.type.slots, strict=True) if slot.kind == "point"
            ]
            middle = solved.adjustment.values["point"][blocks].mean(axis=0)
            axes = horizon.local_axes(middle[None])[0] @ horizon.axes
            residual = axes @ -quality.v[k]
            np.testing.assert_allclose(residual, [float(row[f"residual{i}"]) for i in (1, 2, 3)], atol=1.3e-4)
        else:
            component = int(np.flatnonzero(group.mask[k])[0])
            angular = group.type.components[component].quantity == ANGLE
            unit = np.degrees(1.0) if angular else 1.0
            digits = 10.0 ** -len(row["residual"].partition(".")[2])
            given = float(row["residual"])
            assert -quality.v[k, component] * unit == pytest.approx(given, abs=0.6 * digits), row
            assert group.given_sigma[k, component] * unit == pytest.approx(float(row["error"]), abs=0.6 * digits), row
            assert np.sqrt(quality.r[k, component]) == pytest.approx(float(row["redundancy"]), abs=6e-4), row
        compared += 1
    assert compared == len(used) == 121


def test_a_network_of_all_kinds_and_what_is_left_out(tmp_path: Path) -> None:
    document = read_foreign(_files(tmp_path), "snap")
    told = " / ".join(note.message for note in document.notes)
    assert "rejected observations (*) (2)" in told
    tables = {(t["type"], len(t["rows"])) for t in document.data["observations"]}
    assert tables == {
        ("directions", 3),
        ("zenith_angle", 3),
        ("distance", 3),
        ("height_difference", 1),
        ("azimuth", 1),
        ("projected_bearing", 1),
        ("gnss_vector", 1),
    }
    assert document.data["instruments"]["refraction DEFAULT"] == {"refraction": "0.14"}
    assert [t.get("fixed") for t in document.data["points"]] == [["x", "y", "z"], None]


@pytest.mark.parametrize("name", ["n.snp", "n.crd", "n.dat"])
def test_each_file_of_an_adjustment_is_recognised(tmp_path: Path, name: str) -> None:
    _files(tmp_path)
    assert format_of(tmp_path / name) == "snap"
    notes = [note.message for note in read_foreign(tmp_path / name, "snap").notes]
    assert any("all stations are free" in note for note in notes) == (name != "n.snp")


def test_errors_of_a_set_are_those_between_any_two_of_its_stations(tmp_path: Path) -> None:
    data = MEASURED.replace("* C -419.25", "C -419.25")
    document = read_foreign(_files(tmp_path, data), "snap")
    Q = next(np.array(t["covariance"]) for t in document.data["observations"] if "covariance" in t)
    A = np.hstack([-np.eye(3), np.eye(3)])
    between = A @ Q @ A.T
    length = np.linalg.norm([-577.70 + 419.25, -525.31 + 967.36, 437.22 - 471.50])
    expected = np.array([3.0, 3.0, 5.0]) ** 2 + (1e-3 * length * np.array([1.0, 1.0, 2.0])) ** 2
    np.testing.assert_allclose(np.linalg.eigvalsh(between) * 1e6, np.sort(expected), rtol=1e-9)


def test_positions_of_a_set_have_the_covariances_of_its_command(tmp_path: Path) -> None:
    positions = "A -4787264.52 560595.57 -4163681.80\nB -4787842.22 560070.26 -4163244.58\n"
    data = f"Set\n#gx_enu_error 40 60 120 mm 20 30 50 mmr 2 5 10 ppmr\n#data GX grouped no_heights\n{positions}"
    document = _document(tmp_path, "", data)
    Q = next(np.array(t["covariance"]) for t in document.data["observations"]) * 1e6
    distance = np.linalg.norm([577.70, 525.31, 437.22]) * 1e-3
    expected = np.array([20.0, 30.0, 50.0]) ** 2 + (distance * np.array([2.0, 5.0, 10.0])) ** 2
    np.testing.assert_allclose(np.linalg.eigvalsh(Q[:3, 3:]), np.sort(expected), rtol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(Q[:3, :3]), np.square([40.0, 60.0, 120.0]), rtol=1e-9)
    with pytest.raises(InputError, match="found the unit 'mmr', expected mm, m, ppm"):
        _document(tmp_path, "", data.replace("gx_enu", "gps_enu"))


def _text(random: np.random.Generator) -> tuple[str, str, np.ndarray]:
    """A network of 2 km with errors of its σ, as SNAP reads it; its true places."""
    places = np.column_stack(
        [random.uniform(-41.03, -41.01, 5), random.uniform(173.30, 173.33, 5), random.uniform(20, 300, 5)]
    )
    xyz = np.stack(
        Transformer.from_crs("EPSG:4959", "EPSG:4960", always_xy=True).transform(*places[:, [1, 0, 2]].T),
        axis=1,
    )

    def dms(value: float, letters: str) -> str:
        seconds = round(abs(value) * 3600.0, 6)
        d, m = int(seconds // 3600), int(seconds % 3600 // 60)
        return f"{d} {m:02d} {seconds - 3600 * d - 60 * m:09.6f} {letters[int(value < 0)]}"

    stations = "Generated\nNZGD2000\noptions ellipsoidal_heights no_geoid\n" + "".join(
        f"S{k} {dms(p[0], 'NS')} {dms(p[1], 'EW')} {p[2]:.4f}\n" for k, p in enumerate(places)
    )
    vectors = ["#gps_error_type correlation", "#data GB error no_heights"]
    slopes = ["#ds_error 3 mm", "#data SD"]
    for i in range(5):
        for j in range(i + 1, 5):
            d = xyz[j] - xyz[i] + random.normal(0.0, 0.004, 3)
            vectors.append(f"S{i} S{j} {d[0]:.5f} {d[1]:.5f} {d[2]:.5f} 0.004 0.004 0.004 0 0 0")
            slopes.append(f"S{i} 0 S{j} 0 {np.linalg.norm(xyz[j] - xyz[i]) + random.normal(0.0, 0.003):.5f}")
    return stations, "\n".join(["Generated", *vectors, *slopes, ""]), places


@pytest.mark.slow
def test_generated_networks_come_back(tmp_path: Path) -> None:
    """Thirty of them: σ0 is 1 within its uncertainty, places are where they were."""
    omega = redundancy = 0.0
    for seed in range(30):
        stations, data, places = _text(np.random.default_rng(seed))
        solved = _solved(_files(tmp_path, data, stations, "coordinate_file n.crd\ndata_file n.dat\nfix s0 S1\n"))
        quality = solved.quality
        assert quality is not None
        omega += quality.sigma0**2 * quality.redundancy
        redundancy += quality.redundancy
        numbers = [solved.network.things["point"].numbers[f"S{k}"] for k in range(5)]
        blocks = solved.network.things["point"].parts["position"][numbers]
        found = solved.network.world.horizon.to_geodetic(solved.adjustment.values["point"][blocks])
        error = (found - np.column_stack([np.radians(places[:, :2]), places[:, 2]])) * [6.37e6, 4.8e6, 1.0]
        assert np.abs(error).max() < 0.02
    assert omega / redundancy == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / redundancy))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("A 1.5 B 1.5 100.0", "A 1.5 D 1.5 100.0", "station 'D' is not in n.crd"),
        ("#lv_error 5 mm", "#lv_error 5 inch", "found the unit 'inch'"),
        ("#hp_angles", "#gon_angles", "command #gon_angles is not supported"),
        ("A B 41.28158 4", "A B 41.78158 4", "expected degrees, minutes, seconds"),
        ("A B 41.28158 4", "A A 41.28158 4", "both ends are 'A'"),
        ("#ds_error 3 mm 2 ppm", "", "nothing says the error: #ds_error"),
        ("4e-6 1e-7 5e-6", "-4e-6 1e-7 5e-6", "not positive definite"),
        ("#data LV", "#data LVV", "found 'LVV', expected a data type"),
        ("10 28 15.8 2.0 ", "10 28 15.8 -2.0 ", "found the error -2"),
        ("\nA\nB  10", "\nB  10", "expected the station of the instrument"),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in MEASURED
    with pytest.raises(InputError) as raised:
        read_foreign(_files(tmp_path, MEASURED.replace(old, new, 1)), "snap")
    assert any(said in problem.message and problem.line for problem in raised.value.problems), raised.value


@pytest.mark.parametrize(
    ("stations", "commands", "said"),
    [
        (STATIONS.replace("NZGD2000", "ED50"), COMMANDS, "coordinate system 'ED50' is not supported"),
        (
            STATIONS.replace("NZGD2000", "NZGD2000/NZVD2016").replace(" geoid_heights", ""),
            COMMANDS,
            "geoid of NZVD2016",
        ),
        (STATIONS.replace("41 00 25.2", "141 00 25.2"), COMMANDS, "found the latitude -141"),
        (
            STATIONS,
            COMMANDS + "free inside NZGD2000\n",
            "the line ends where the file of an area behind inside NZGD2000 is expected",
        ),
        (STATIONS, COMMANDS + "free inside NZGD1949 n.crd\n", "the area in NZGD1949 is on another ellipsoid"),
        (STATIONS, COMMANDS + "free inside NZGD2000 none\n", "file 'none' does not exist"),
        (STATIONS, COMMANDS.replace("fix A", "fix D"), "station 'D' is not in n.crd"),
        (STATIONS, COMMANDS.replace("fix A", "fix automatically all"), "fix automatically is not supported"),
        (STATIONS, COMMANDS.replace("3d", "4d"), "mode 4d is not supported"),
        (STATIONS, COMMANDS.replace("n.dat", "no.dat"), "this file does not exist"),
        (
            STATIONS,
            COMMANDS + "reweight_observations 2 SD\n",
            "found 'sd', expected a criterion such as data_type=SD",
        ),
    ],
)
def test_mistakes_of_stations_and_commands(tmp_path: Path, stations: str, commands: str, said: str) -> None:
    with pytest.raises(InputError) as raised:
        read_foreign(_files(tmp_path, MEASURED, stations, commands), "snap")
    assert any(said in problem.message for problem in raised.value.problems), raised.value


@pytest.mark.parametrize(("mode", "held"), [("2d", {"sigma_up"}), ("1d", {"sigma_east", "sigma_north"}), ("3d", set())])
def test_modes_hold_what_they_do_not_adjust(tmp_path: Path, mode: str, held: set[str]) -> None:
    document = read_foreign(_files(tmp_path, commands=COMMANDS.replace("3d", mode)), "snap")
    columns = [set(table["columns"]) for table in document.data["points"] if not table.get("fixed")]
    assert [found & {"sigma_east", "sigma_north", "sigma_up"} for found in columns] == [held]


def test_stations_in_a_meridional_circuit(tmp_path: Path) -> None:
    rows = "A 350000.0 680000.0 5.0\nB 350300.0 680400.0 5.0\n"
    stations = f"Two stations\nTAIETM1949\noptions ellipsoidal_heights\n{rows}"
    measured = "Two\n#data SD error no_heights\nA B 499.98 0.002\n"
    document = read_foreign(_files(tmp_path, measured, stations), "snap")
    assert document.data["world"]["crs"] == "EPSG:27231"


def test_it_is_adjusted_by_the_command(tmp_path: Path) -> None:
    _files(tmp_path)
    assert mor("adjust", tmp_path / "n.snp", "-o", tmp_path / "out", "--no-html").code == 0
    assert json.loads((tmp_path / "out" / "results.json").read_text())["outcome"] == "converged"


def _document(folder: Path, commands: str, measured: str = MEASURED, stations: str = STATIONS) -> Document:
    return read_foreign(_files(folder, measured, stations, COMMANDS + commands), "snap")


def _grid(corners: list[tuple[float, float]]) -> str:
    """A ring in NZTM, x before y."""
    plane = Transformer.from_crs("EPSG:4167", "EPSG:2193", always_xy=True)
    return ", ".join("{:.2f} {:.2f}".format(*plane.transform(*one)) for one in [*corners, corners[0]])


def _count(document: Document, kind: str) -> int:
    tables = [table for table in document.data["observations"] if table["type"] == kind]
    return sum(len(table["rows"]) for table in tables)


@pytest.mark.parametrize(
    ("commands", "distances"),
    [
        ("", 3),
        ("ignore C", 2),
        ("reject all\naccept A B", 2),
        ("ignore_observations data_type=SD/ZD", 0),
        ("reject_observations @equpt=e?m using_stations C end_stations data_type=SD", 2),
        ("reject_observations equpt='e?m'", 3),
        ("ignore_observations between_stations A B", 1),
        ("ignore_observations before 2001-05-12", 3),
        ("ignore_observations before 2001-05-13 data_type=SD", 0),
        ("ignore_observations after 2001-05-13", 3),
        ("ignore_observations data_type=SD data_file=o*.dat", 3),
        ("recode C to *", 2),
        ("recode C to D\nignore_observations using_stations D", 2),
        ("recode C to D after 2009-01-01\nignore_observations using_stations D", 3),
        ("recode C to * after 13-May-2001", 3),
        ("ignore_missing_stations\nrecode C to D", 3),
        ("classification equpt reject EDM", 0),
        ("ignore order=3", 2),
        ("ignore B-Z except B", 2),
        ("ignore inside NZGD2000 area.wkt", 1),
        ("ignore outside NZTM grid", 2),
    ],
)
def test_commands_leave_observations_out(tmp_path: Path, commands: str, distances: int) -> None:
    ring = "(533.326 -41.006, 533.334 -41.006, 533.334 -41.009, 533.326 -41.009, 533.326 -41.006)"
    hole = "(173.3328 -41.0078, 173.3332 -41.0078, 173.3332 -41.0082, 173.3328 -41.0082, 173.3328 -41.0078)"
    (tmp_path / "area.wkt").write_text(f"POLYGON({ring},{hole})")  # B lies in it, C in the hole
    corners = _grid([(173.320, -41.014), (173.3285, -41.014), (173.3285, -41.005), (173.320, -41.005)])
    (tmp_path / "grid.wkt").write_text(f"POLYGON(({corners}))")  # A and B
    assert _count(_document(tmp_path, commands), "distance") == distances


def test_ranges_count_numbers_in_codes_by_their_value(tmp_path: Path) -> None:
    """C_11 lies between C_10 and C_100, C_9 does not."""
    stations = STATIONS.splitlines()[:5]
    stations += [STATIONS.splitlines()[5].replace("A", code, 1) for code in ("C_9", "C_10", "C_11", "C_100")]
    data = "x\n#oh_error 5 mm\n#data OH no_heights\nC_9 1\nC_10 1\nC_11 1\nC_100 1\n"
    commands = COMMANDS.replace("fix A", "ignore C_10-C_100")
    document = read_foreign(_files(tmp_path, data, "\n".join(stations), commands), "snap")
    assert [row[0] for row in document.data["observations"][0]["rows"]] == ["C_9"]


def test_factors_of_sigma_multiply(tmp_path: Path) -> None:
    plain = _document(tmp_path, "")
    twice = _document(tmp_path, "reweight_observations 2 data_type=SD\nreweight_observations 3 using_stations C\n")

    def sigmas(document: Document) -> list[float]:
        tables = [table for table in document.data["observations"] if table["type"] == "distance"]
        return [float(row[t["columns"].index("sigma")]) for t in tables for row in t["rows"]]

    ratios = np.array(sigmas(twice)) / sigmas(plain)
    assert ratios.tolist() == pytest.approx([2.0, 6.0, 2.0])


def test_floats_and_stations_fixed_in_part(tmp_path: Path) -> None:
    commands = "fix horizontal B\nhorizontal_float_error 0.5\nfloat C\nvertical_float_error 0.02\nfloat vertical B\n"
    tables = _document(tmp_path, commands).data["points"]
    found = {row[0]: dict(zip(table["columns"], row, strict=True)) for table in tables for row in table["rows"]}
    names = ("sigma_east", "sigma_north", "sigma_up")
    assert [float(found["B"][name]) for name in names] == [1e-6, 1e-6, 0.02]
    assert [float(found["C"][name]) for name in names] == [0.5, 0.5, 1.0]
    assert not set(names) & set(found["A"])


def test_a_recode_with_an_error_ties_both_marks(tmp_path: Path) -> None:
    document = _document(tmp_path, "recode C to C_1 hv_error 0.1 0.3 m after 2001-05-01\n")
    assert "C_1" in {row[0] for table in document.data["points"] for row in table["rows"]}
    dated = MEASURED.replace("#data LV\n", "#date unknown\n#data LV\n").replace("A 1.5 B", "C 1.5 B")
    both = _document(tmp_path, "recode C to C_1 hv_error 0.1 0.3 m after 2001-05-01\n", dated)
    ties = [t for t in both.data["observations"] for row in t["rows"] if row[:2] == ["C", "C_1"]]
    assert len(ties) == 1
    row = next(row for row in ties[0]["rows"] if row[:2] == ["C", "C_1"])
    cell = dict(zip(ties[0]["columns"], row, strict=True))
    trace = sum(float(cell[f"cov_{name}_{name}"]) for name in ("dx", "dy", "dz"))
    assert trace == pytest.approx(0.1**2 + 0.1**2 + 0.3**2)


@pytest.mark.parametrize(
    ("system", "options"),
    [
        ("NZGD2000(20160701)", "options ellipsoidal_heights geoid_heights c=Order"),
        ("ITRF2008@20150601", "options ellipsoidal_heights geoid_heights c=Order"),
        ("NZGD2000", "ellipsoidal_heights geoid_heights station_orders"),
    ],
)
def test_headers_of_stations(tmp_path: Path, system: str, options: str) -> None:
    given = STATIONS.replace("NZGD2000", system)
    given = given.replace("options ellipsoidal_heights no_deflections geoid_heights c=Order", options)
    rows = [row for t in _document(tmp_path, "", stations=given).data["points"] for row in t["rows"]]
    assert rows[0][1:4] == [repr(-(41 + 46.8 / 3600)), repr(173 + 19 / 60 + 15.6 / 3600), "150.0"]


def test_geocentric_stations(tmp_path: Path) -> None:
    to_xyz = Transformer.from_crs("EPSG:4959", "EPSG:4960", always_xy=True)
    places = {"A": (-41.013, 173.321, 150.0), "B": (-41.007, 173.328, 250.0), "C": (-41.008, 173.333, 70.0)}
    lines = ["Three stations", "NZGD2000_XYZ", "options geoid_heights"]
    for name, (latitude, longitude, height) in places.items():
        x, y, z = to_xyz.transform(longitude, latitude, height)
        lines.append(f"{name} {x:.6f} {y:.6f} {z:.6f} 10.0")
    document = _document(tmp_path, "", stations="\n".join(lines) + "\n")
    for row in (row for table in document.data["points"] for row in table["rows"]):
        assert np.array(row[1:4], float) == pytest.approx(places[row[0]], abs=1e-6)


def test_files_of_recodes(tmp_path: Path) -> None:
    """A data file has its own recodes before those of all; the last of equal ones and the narrowest date win."""
    (tmp_path / "own.csv").write_text("codefrom,codeto,datefrom,dateto\nC,D\nC,E,2001-01-01,\n*,*\nA,A\n")
    (tmp_path / "all.csv").write_text("codefrom,codeto\nE,A\nE,B\n")
    data = "x\n#date 12 May 2001\n#oh_error 5 mm\n#data OH no_heights\nA 1\nB 2\nC 3\n"
    commands = COMMANDS.replace("n.dat", "n.dat recode own.csv error_factor 2") + "recode file all.csv\n"
    document = read_foreign(_files(tmp_path, data, commands=commands), "snap")
    (table,) = document.data["observations"]
    assert table["rows"] == [["A", "1.0", "0.01"], ["B", "3.0", "0.01"]]
    (tmp_path / "all.csv").write_text("codefrom,codeto\nE\n")
    with pytest.raises(InputError, match="expected codefrom,codeto,datefrom,dateto"):
        read_foreign(tmp_path / "n.snp", "snap")


def test_recodes_at_one_date_are_one_step(tmp_path: Path) -> None:
    """The larger errors count; recodes to one code at two dates contradict each other."""
    data = "x\n#ds_error 3 mm\n#data date SD no_heights\nA C 2000-01-01 1154.9\nA C 2002-01-01 1154.9\n"
    twice = "recode C to C1 hv_error 0.3 0.1 m after 2001-01-01\nrecode C to C1 hv_error 0.2 0.5 m after {}\n"
    document = _document(tmp_path, twice.format("2001-01-01"), data)
    tie = next(t for t in document.data["observations"] if t["type"] == "gnss_vector")
    trace = sum(float(tie["rows"][0][k]) for k in (7, 10, 12))
    assert trace == pytest.approx(0.3**2 + 0.3**2 + 0.5**2)
    with pytest.raises(InputError, match="station 'C' is recoded to 'C1' at two dates"):
        _document(tmp_path, twice.format("2001-06-01"), data)


def test_classify_holds_for_its_types(tmp_path: Path) -> None:
    data = MEASURED.replace("#data HA", "#classify ZD/LV sky clear\n#classify day one\n#data HA")
    assert _count(_document(tmp_path, "reject_observations sky=clear", data), "zenith_angle") == 0
    assert _count(_document(tmp_path, "reject_observations sky=clear", data), "distance") == 3
    assert _count(_document(tmp_path, "reject_observations day=one data_type=SD", data), "distance") == 0


def _covariances(document: Document) -> list[np.ndarray]:
    return [np.array(t["covariance"]) for t in document.data["observations"] if "covariance" in t]


def test_errors_of_whole_sets(tmp_path: Path) -> None:
    """by_set scales a set once, offset_error adds an error of a station, centroid_error one of a set of positions."""
    vectors = "x\n#gps_enu_error 4 6 12 mm\n#data GB grouped no_heights\nA\nB -577 -525 437\nC -419 -967 471\n"
    places = "A -4787264 560595 -4163681\nB -4787842 560070 -4163244\n"
    positions = f"#gx_enu_error 4 6 12 mm\n#data GX grouped no_heights\n{places}"
    (alone,) = _covariances(_document(tmp_path, "", vectors))
    for stations in ("C", "A B"):
        commands = f"reweight_observations by_set 2 using_stations {stations}\n"
        np.testing.assert_allclose(_covariances(_document(tmp_path, commands, vectors))[0], 4.0 * alone)
    for station, ends in {"A": [1.0, 1.0], "C": [0.0, 1.0]}.items():
        commands = f"reweight_observations offset_error 0.3 m using_stations {station}\n"
        (found,) = _covariances(_document(tmp_path, commands, vectors))
        expected = 0.09 * np.kron(np.outer(ends, ends), np.eye(3))
        np.testing.assert_allclose(found - alone, expected, atol=1e-12)
    commands = "reweight_observations centroid_error 0.3 0.5 m using_stations B\n"
    (alone,) = _covariances(_document(tmp_path, "", "x\n" + positions))
    (found,) = _covariances(_document(tmp_path, commands, "x\n" + positions))
    added = found - alone
    np.testing.assert_allclose(np.linalg.eigvalsh(added[:3, 3:]), [0.09, 0.09, 0.25])
    np.testing.assert_allclose(added, np.tile(added[:3, :3], (2, 2)))
    with pytest.raises(InputError, match="expected one or two errors of 0 or more and m"):
        _document(tmp_path, commands.replace(" m ", " mm "))


def test_by_set_scales_a_circle_once(tmp_path: Path) -> None:
    data = MEASURED.replace("* 244", "244")
    document = _document(tmp_path, "reweight_observations by_set 3 data_type=HA/SD using_stations C", data)
    tables = {table["type"]: table for table in document.data["observations"]}
    assert [row[3] for row in tables["directions"]["rows"]] == ["6.0", "6.0", "6.0", "6.0"]
    plain = {t["type"]: t for t in _document(tmp_path, "", data).data["observations"]}
    factors = [
        float(one[3]) / float(other[3])
        for one, other in zip(tables["distance"]["rows"], plain["distance"]["rows"], strict=True)
    ]
    assert factors == pytest.approx([1.0, 3.0, 1.0])


def test_translation_of_a_set_of_positions(tmp_path: Path) -> None:
    """All stations are fixed: the translation is the mean of the differences, of equal weights."""
    places = {"A": (-4787263.95, 560595.86, -4163681.77), "B": (-4787841.65, 560070.55, -4163244.55)}
    shift = {"A": (1.0, 2.0, 3.0), "B": (1.2, 2.2, 3.2)}
    rows = "".join(f"{k} {' '.join(map(str, np.add(places[k], shift[k])))}\n" for k in places)
    data = f"x\n#gx_enu_error 4 4 4 mm\n#data GX grouped no_heights\n{rows}#data GX no_heights\n{rows}"
    commands = "fix all\nset_observation_option calculate_gx_translation\n"
    commands += "set_observation_option no_calculate_gx_translation using_stations B\n"
    solved = _solved(_files(tmp_path, data, commands=COMMANDS + commands))
    assert len(solved.network.things["instrument"].numbers) == 2
    found = solved.adjustment.values["gnss frame"]
    given = Transformer.from_crs("EPSG:4959", "EPSG:4960", always_xy=True)
    first = given.transform(173 + (19 + 15.6 / 60) / 60, -41 - 46.8 / 3600, 150.0)
    second = given.transform(173 + (19 + 40.8 / 60) / 60, -41 - 25.2 / 3600, 250.0)
    differences = [np.add(places["A"], shift["A"]) - first, np.add(places["B"], shift["B"]) - second]
    np.testing.assert_allclose(found[1, :3], np.mean(differences, axis=0), atol=1e-6)
    np.testing.assert_allclose(found[2, :3], differences[0], atol=1e-6)
    with pytest.raises(InputError, match="expected calculate_gx_translation"):
        _document(tmp_path, "set_observation_option calculate_translation\n")


@pytest.mark.parametrize(
    ("command", "height", "orders"),
    [
        ("add_coordinate_file coordinates from more.crd", "71.0", ["2", "2", "3"]),
        ("add_coordinate_file classes from more.crd", "70.0", ["2", "2", "1"]),
        ("add_coordinate_file coordinates existing_classes from more.crd", "71.0", ["2", "2", "1"]),
        ("add_coordinate_file stations from more.crd", "70.0", ["2", "2", "3", "1"]),
        ("coordinate_file more.crd", "70.0", ["2", "2", "3", "1"]),
    ],
)
def test_more_coordinate_files(tmp_path: Path, command: str, height: str, orders: list[str]) -> None:
    more = STATIONS.replace("70.0000  10.0 3", "71.0000 10.0 1").replace("B  41", "D  41").replace(" 10.0 2", " 10.0 1")
    kept = [line for line in more.splitlines() if not line.startswith("A ")]
    (tmp_path / "more.crd").write_text("\n".join(kept))
    data = "x\n#oh_error 5 mm\n#data OH no_heights\nA 1\nB 2\nC 3\nD 4\n"
    commands = f"{command}\nignore_missing_stations\n"
    document = _document(tmp_path, commands, data)
    rows = {row[0]: row for table in document.data["points"] for row in table["rows"]}
    assert len(rows) == len(orders)
    assert rows["C"][3] == height
    for order in "123":
        ignored = [point for point, one in zip("ABCD", orders, strict=False) if one == order]
        left = _document(tmp_path, f"{commands}ignore order={order}\n", data)
        used = {row[0] for table in left.data["observations"] for row in table["rows"]}
        assert used == set("ABCD"[: len(orders)]) - set(ignored)


def test_coordinate_files_that_do_not_fit(tmp_path: Path) -> None:
    (tmp_path / "more.crd").write_text(STATIONS.replace("NZGD2000", "NZGD1949"))
    for command, said in {
        "add_coordinate_file stations from more.crd": "coordinates in NZGD1949 cannot be merged with those in NZGD2000",
        "add_coordinate_file all from more.crd": "expected coordinates, classes, existing_classes, stations or from",
        "add_coordinate_file from more.crd": "found no option before from",
    }.items():
        with pytest.raises(InputError, match=said):
            _document(tmp_path, command)


def test_included_commands_and_quoted_names(tmp_path: Path) -> None:
    (tmp_path / "sub dir").mkdir()
    (tmp_path / "sub dir" / "more.inc").write_text('data_file "more data.dat"\n')
    (tmp_path / "sub dir" / "more data.dat").write_text("More\n#lv_error 5 mm\n#data LV no_heights\nA C -80\n")
    document = _document(tmp_path, 'include "sub dir/more.inc"\n')
    assert _count(document, "height_difference") == _count(_document(tmp_path, ""), "height_difference") + 1


def test_sets_with_matrices_follow_each_other(tmp_path: Path) -> None:
    one = "A -4787264.52 560595.57 -4163681.80\nB -4787842.22 560070.26 -4163244.58\n#end_set\n"
    triangle = "\n".join(" ".join("1e-4" if i == j else "0" for j in range(i + 1)) for i in range(6))
    measured = f"Sets\n#data GX error grouped no_heights\n{one}{triangle}\n\n{one}{triangle}\n"
    assert _count(_document(tmp_path, "", measured), "gnss_position") == 4
