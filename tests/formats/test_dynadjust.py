"""DynAdjust's files: two real networks against the program's own adjustments, what is left out, mistakes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from pyproj import Transformer

from mor.api.pipeline import determinable_start, levels, make_problem
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.project.document import Document
from mor.project.network import Network
from mor.quality.assessment import assess
from mor.quality.solution import Solved
from mor.solve.iterate import adjust
from mor.solve.problem import misclosures
from mor.types import FloatArray
from tests.earth.test_gravity_grids import gsb, plane
from tests.reference_data import missing, network_of, reference_folder

REAL = reference_folder("earth/dynadjust")

STATIONS = """!#=DNA 3.01 STN    13.12.2018       GDA2020    01.01.2020         3
A                   CCC XYZ     -4250323.0000        2871048.0000        -3778696.0000    first one
B B                 FFF LLH      -36.3238821312      145.5821570921            167.5630
C                   FFF UTM         320236.2750        5813988.8399             31.4770 55
unused              FFF LLH      -36.3238821312      145.5821570921            167.5630
"""
_N = " " * 62


def _line(code: str, *names: str, scales: str = "   1.00      1.00      1.00      1.00") -> str:
    frame = "   GDA2020   01.01.2020" if code[:1] in ("G", "X") else ""
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
        _line("R", "A", scales="    43.0859               0.065000"),
        _line("V", "A", "B B", scales="     90 24 31.0000   20.000  1.545  0.125"),
        _line("Z", "A", "B B", scales="     -0 24 31.0000   20.000"),
        _line("A", "A", "B B", "C", scales="    190 05 01.5000   20.000"),
        _line("P", "A", scales="    -36 32 23.8821    0.001"),
        _line("D", "A", "B B", "2", scales="     10 00 01.0000    2.000"),
        _line("D", "", "", "C", scales="    350 59 59.5000    3.000"),
        _line("D*", "", "", "unused", scales="      0 00 00.0000    3.000"),
        _line("D*", "A", "B B", "1", scales="     10 00 01.0000    2.000"),
        _line("D", "", "", "C", scales="    350 59 59.5000    3.000"),
        _line("D", "B B", "A", "1", scales="      0 00 00.0000    2.000"),
        _line("", "", "", "C", scales="     20 59 59.5000    3.000"),
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
    assert document.data["world"] == {"crs": "EPSG:7844", "heights": "ellipsoidal"}
    place = [float(value) for value in held["rows"][0][1:4]]
    x, y, z = (float(word) for word in STATIONS.splitlines()[1][27:].split()[:3])
    back = Transformer.from_crs("EPSG:7843", "EPSG:7842", always_xy=True).transform(place[1], place[0], place[2])
    np.testing.assert_allclose(back, [x, y, z], atol=1e-6)
    assert [row[0] for row in free["rows"]] == ["B B", "C"]
    cluster, single, sets, distance, *others = document.data["observations"]
    assert (sets["type"], sets["columns"]) == ("directions", ["station", "to", "horizontal", "sigma", "set"])
    assert sets["rows"] == [
        ["A", "B B", "10-0-1.0", "2.000", "1"],
        ["A", "C", "350-59-59.5", "3.000", "1"],
        ["B B", "A", "0-0-0.0", "2.000", "2"],
        ["B B", "C", "20-59-59.5", "3.000", "2"],
    ]
    Q = np.array(cluster["covariance"])
    assert Q[0, 4] == Q[4, 0] == 2e-6
    assert Q[1, 3] == 4e-6
    assert [float(v) for v in single["rows"][0][5:8]] == [4e-5, -8e-6, 1.2e-5]
    assert distance["rows"] == [
        ["B B", "C", "2259.0", "0.005", None, None],
        ["B B", "C", "2259.0", "0.005", "1.606", "1.565"],
    ]
    assert [(table["type"], table["rows"]) for table in others] == [
        ("ellipsoidal_height", [["A", "43.0859", "0.065000"]]),
        ("zenith_angle", [["A", "B B", "90-24-31.0", "20.000", "1.545", "0.125"]]),
        ("vertical_direction", [["A", "B B", "-0-24-31.0", "20.000"]]),
        ("angle", [["A", "B B", "C", "190-5-1.5", "20.000"]]),
        ("geodetic_position", [["A", "-36-32-23.8821", "0.001"]]),
    ]
    notes = " ".join(map(str, document.notes))
    for words in ("switched off (*) (3)", "the geoid is taken as the ellipsoid"):
        assert words in notes
    network_of(document, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CCC XYZ", "CCF XYZ", r"n\.stn:2: station 'A': CCF in XYZ holds a geocentric axis"),
        ("CCC XYZ", "CCX XYZ", r"n\.stn:2: station 'A': found the constraints 'CCX'"),
        ("31.4770 55", "31.4770 65", r"n\.stn:4: station 'C': found the zone '65'"),
        (
            "MSR    13.12.2018       GDA2020",
            "MSR    13.12.2018       GDA1966",
            r"n\.msr:1: found the reference frame",
        ),
        (
            "MSR    13.12.2018       GDA2020    01.01.2020",
            "MSR    13.12.2018         GDA66    01.01.2020",
            r"n\.msr:1: found the reference frame 'GDA66', expected one of GDA94",
        ),
        ("24 31.0", "64 31.0", r"n\.msr:\d+: found the angle 90 64 31"),
        ("0 00 01.0", "0 61 01.0", r"n\.msr:\d+: found the angle 10 61 01"),
        (
            "B B                 2                        10 00",
            "B B                 3                        10 00",
            r"n\.msr:\d+: found 2 directions behind the first, expected 3",
        ),
        ("-36.32", "-96.32", r"n\.stn:3: station 'B B': found the latitude"),
        ("\nC  ", "\nD  ", r"n\.msr:7: station 'C' is not in n\.stn|n\.msr:14: station 'C' is not in n\.stn"),
        ("!#=DNA 3", "!#=DNA 1", r"n\.(stn|msr):1: found '!#=DNA 1"),
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


def _adjusted(network: Network) -> Solved:
    """The adjustment and its quality, without the search for causes: both global tests reject."""
    network, start = determinable_start(network)
    adjustment = adjust(make_problem(network, start, start), start)
    return Solved(network, adjustment, assess(adjustment, levels(network.project.settings)))


def _expected() -> tuple[list[float], dict[str, list[float]]]:
    """Measured values after DynAdjust's own transformation, and adjusted coordinates, as printed."""
    assert REAL is not None
    text = (REAL / "gnss.simult.adj.expected").read_text()
    rows = [line for line in text.splitlines() if line[:2] in ("G ", "X ", "Y ") and line[65:66] in "XYZ"]
    places = text[text.index("Adjusted Coordinates") :].splitlines()[5:]
    found = {line[:20].strip(): [float(v) for v in line[20:].split()[5:8]] for line in places if line.strip()}
    return [float(line[66:88]) for line in rows if line[65:66].strip()], found


def _with_values(document: Document, values: list[float]) -> None:
    """Put the printed values in place, in the order of the file: mor transforms to 0.2 mm what DynAdjust prints."""
    tables = [
        (t, row, k) for t, table in enumerate(document.data["observations"]) for k, row in enumerate(table["rows"])
    ]
    tables.sort(key=lambda place: document.lines["observations", place[0], "rows", place[2]])
    for (t, row, _), xyz in zip(tables, np.reshape(values, (-1, 3)).tolist(), strict=True):
        first = 2 if document.data["observations"][t]["type"] == "gnss_vector" else 1
        np.testing.assert_allclose([float(v) for v in row[first : first + 3]], xyz, atol=2e-4)
        row[first : first + 3] = [repr(v) for v in xyz]


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_a_real_network_adjusts_to_what_dynadjust_says() -> None:
    """417 measurements, 288 degrees of freedom, χ² 336.64, coordinates to the printed 0.1 mm."""
    assert REAL is not None
    document = read_foreign(REAL / "gnss-network.msr")
    values, places = _expected()
    assert len(values) == 417
    _with_values(document, values)
    solved = _adjusted(network_of(document, REAL))
    assert solved.quality.redundancy == 288
    assert solved.quality.sigma0**2 * 288 == pytest.approx(336.64, abs=0.5)  # values are printed to 0.1 mm
    found = _geocentric(solved)
    assert set(found) == set(places)
    difference = np.array([found[name] - places[name] for name in places])
    assert np.abs(difference).max() < 2e-4


def _geocentric(solved: Solved) -> dict[str, FloatArray]:
    """Geocentric coordinates of the points."""
    network = solved.network
    positions = network.things["point"].parts["position"]
    there = network.world.horizon.to_geocentric(solved.adjustment.values["point"][positions])
    return dict(zip(network.things["point"].ids, there, strict=True))


_CODES = {
    "gnss_vector": "G",
    "angle": "A",
    "astronomic_azimuth": "K",
    "azimuth": "B",
    "zenith_angle": "V",
    "vertical_direction": "Z",
    "mean_sea_level_distance": "M",
    "distance": "S",
    "height_difference": "L",
    "orthometric_height": "H",
    "geodetic_position": "Y",
}
_MARKS = {"gnss_vector": "XYZ", "geodetic_position": "PLH"}


class _Printed(NamedTuple):
    """Adjusted measurement of a listing: correction, σ of the adjusted value and of the correction, test statistic."""

    correction: float
    adjusted: float
    residual: float
    normalised: float


def _printed_measurements(text: str) -> dict[tuple[str, tuple[str, ...], str], list[_Printed]]:
    found: dict[tuple[str, tuple[str, ...], str], list[_Printed]] = {}
    begin, end = text.index("Adjusted Measurements"), text.index("Adjusted Coordinates")
    for line in text[begin:end].splitlines()[5:]:
        if line.strip():
            names = tuple(name for name in (line[2:22].strip(), line[22:42].strip(), line[42:62].strip()) if name)
            correction, _, *rest = (float(word) for word in line[105:172].split()[:5])
            found.setdefault((line[0], names, line[65].strip()), []).append(_Printed(correction, *rest))
    return found


def _with_printed_geoid(document: Document, text: str) -> None:
    """Geoid heights of the listing (0.1 mm) in place of those of the file beside it (1 mm)."""
    places = text[text.index("Adjusted Coordinates") :].splitlines()[5:]
    words = {line[:20].strip(): line[20:].split() for line in places if line.strip()}
    N = {name: float(row[4]) - float(row[3]) for name, row in words.items()}
    before = {row[0]: float(row[4]) for table in document.data["points"] for row in table["rows"]}
    for table in document.data["points"]:
        table["rows"] = [[*row[:4], repr(N[row[0]]), *row[5:]] for row in table["rows"]]
    for table in document.data["observations"]:
        if table["type"] == "geodetic_position":
            table["rows"] = [[*row[:3], repr(float(row[3]) - before[row[0]] + N[row[0]])] for row in table["rows"]]


def _with_zenith_distances_as_dynadjust_has_them(network: Network) -> Network:
    """Deflections of the opposite sign at zenith distances: its vertical angles, and physics, have the other one."""
    groups = [
        replace(group, constants=group.constants * np.array([1.0, 1.0, -1.0, -1.0, -1.0, -1.0]))
        if group.type.key == "zenith_angle"
        else group
        for group in network.groups
    ]
    return replace(network, groups=tuple(groups))


@pytest.fixture(scope="module")
def urban() -> tuple[Solved, str]:
    """The network of total stations, levels and GNSS on the ellipsoid, and what DynAdjust prints of it."""
    if REAL is None:
        pytest.skip(missing("earth/dynadjust"))
    text = (REAL / "urban.phased.adj.expected").read_text()
    document = read_foreign(REAL / "urban-network.msr")
    _with_printed_geoid(document, text)
    network = _with_zenith_distances_as_dynadjust_has_them(network_of(document, REAL))
    return _adjusted(network), text


def test_a_network_on_the_ellipsoid_adjusts_to_what_dynadjust_says(urban: tuple[Solved, str]) -> None:
    """Coordinates and σ east, north, up; the printed geoid heights leave 0.2 mm and 0.3 of χ² 627.05 open."""
    solved, text = urban
    quality = solved.quality
    assert quality.redundancy == 742
    assert quality.sigma0**2 * 742 == pytest.approx(627.05, abs=0.4)
    found = _geocentric(solved)
    numbers = dict(
        zip(solved.network.things["point"].ids, solved.network.things["point"].parts["position"], strict=True)
    )
    for line in text[text.index("Adjusted Coordinates") :].splitlines()[5:]:
        name, words = line[:20].strip(), [float(word) for word in line[20:].split()[3:11] if line.strip()]
        if not name:
            continue
        np.testing.assert_allclose(found[name], words[2:5], atol=2e-4)
        position = solved.adjustment.values["point"][numbers[name]][None]
        axes = solved.network.world.horizon.local_axes(position)[0]
        sigma = np.sqrt(np.diag(axes @ quality.cofactors["point"][numbers[name]] @ axes.T))
        np.testing.assert_allclose(sigma, words[5:8], atol=5.1e-5)


def test_every_measurement_has_the_residual_and_precision_dynadjust_prints(urban: tuple[Solved, str]) -> None:
    solved, text = urban
    printed = _printed_measurements(text)
    checked = 0
    for group, quality, w in zip(solved.network.groups, solved.quality.groups, solved.quality.w, strict=True):
        code = _CODES.get(group.type.key)
        for row in range(group.count if code else 0):
            names = tuple(reference[row] for reference in group.references)
            for k, component in enumerate(group.type.components):
                expected = printed[code, names, _MARKS.get(group.type.key, " ")[k].strip()].pop(0)
                angular = component.quantity.angle == 1
                v = quality.v[row, k] * (np.degrees(3600.0) if angular else 1.0)
                assert v == pytest.approx(expected.correction, abs=0.06 if angular else 2e-4)
                checked += 1
                if code == "Y":  # its σ of latitude and longitude are those of a sphere
                    continue
                s = np.sqrt(quality.q_adjusted[row, k]) * (np.degrees(3600.0) if angular else 1.0)
                assert s == pytest.approx(expected.adjusted, abs=1.5e-4)
                if expected.residual > 0.1 * s and code not in "GL":
                    assert w[row, k] == pytest.approx(expected.normalised, abs=0.02 + 0.5e-4 / expected.residual * 3)
    assert checked == 1182


def test_deflections_act_on_zenith_and_vertical_angles_alike() -> None:
    """z = 90° − v at every place: the misclosures of both kinds are each other's opposite."""
    if REAL is None:
        pytest.skip(missing("earth/dynadjust"))
    document = read_foreign(REAL / "urban-network.msr")
    tables = document.data["observations"]
    zenith = next(table for table in tables if table["type"] == "zenith_angle")
    rows = [[row[0], row[1], "90", *row[3:]] for row in zenith["rows"]]
    vertical = {**zenith, "type": "vertical_direction", "columns": list(zenith["columns"])}
    vertical["columns"][2] = "vertical_direction"
    vertical["rows"] = [[row[0], row[1], "0", *row[3:]] for row in rows]
    zenith["rows"] = rows
    tables[:] = [zenith, vertical]
    network = network_of(document, REAL)
    first, second = (misclosures(group, network.start) for group in network.groups[:2])
    np.testing.assert_allclose(first, -second, atol=1e-14)


FREE = """!#=DNA 3.01 STN    13.12.2018       ITRF2014    01.01.2020         3
A                   FFF LLH      -36.3300000000      145.5800000000            150.0000
B                   FFF LLH      -36.3238821312      145.5821570921            167.5630
"""


def test_identifiers_of_a_database_and_a_network_without_held_stations(tmp_path: Path) -> None:
    """Whole numbers behind the values, with frame and epoch or without, are identifiers; no station held is free."""
    head = "!#=DNA 3.01 MSR    08.08.2020       ITRF2014    01.01.2020         5"
    lines = [
        head,
        "S " + "A".ljust(20) + "B".ljust(40) + "    1150.0000       0.0159   1.500  0.000       12      1001",
        "S " + "A".ljust(20) + "B".ljust(40) + "    1150.0000       0.0159    GDA2020   01.01.2020       13",
        "V " + "A".ljust(20) + "B".ljust(40) + "         89 10 11.5000   1.0000   1.500  0.000       14      1001",
        "D " + "A".ljust(20) + "B".ljust(20) + "1".ljust(20) + "        247 55 04.2736   0.0009      31      1001",
        "D " + " " * 20 + " " * 20 + "C".ljust(20) + "        334 55 50.4714   0.0009      32      1001",
        "B " + "A".ljust(20) + "B".ljust(40) + "          9 10 11.5000   1.0000       15",
    ]
    (tmp_path / "n.msr").write_text("\n".join(lines) + "\n")
    (tmp_path / "n.stn").write_text(FREE + FREE.splitlines()[1].replace("A  ", "C  ", 1) + "\n")
    document = read_foreign(tmp_path / "n.msr")
    assert document.data["datum"] == "free"
    tables = {table["type"]: list(table["rows"]) for table in document.data["observations"]}
    assert [row[2:4] for row in tables["distance"]] == [["1150.0000", "0.0159"]] * 2
    assert tables["distance"][0][4:] == ["1.500", "0.000"]
    assert tables["zenith_angle"][0][2:] == ["89-10-11.5", "1.0000", "1.500", "0.000"]
    assert len(tables["directions"]) == 2
    (tmp_path / "n.stn").write_text(
        (tmp_path / "n.stn").read_text().replace("A                   FFF", "A                   CCC")
    )
    assert "datum" not in read_foreign(tmp_path / "n.msr").data


def test_identifiers_at_the_epoch_are_no_part_of_it(tmp_path: Path) -> None:
    rows = "\n".join(_numbers(*numbers) for numbers in ((-1617.5, 1e-5), (-124.25, 0, 2e-5), (1722.75, 0, 0, 3e-5)))
    lines = ["!#=DNA 3.01 MSR    13.12.2018       GDA2020    01.01.2020         2"]
    for number in (127, 128):
        frame = f"            GDA2020          01.01.2020{number}"
        lines += [_line("G", "A", "B B", scales="   4.00      1.00      1.00      1.00" + frame), rows]
    document = read_foreign(_files(tmp_path, measured="\n".join(lines) + "\n"))
    assert not [note for note in document.notes if "frames and epochs" in note.message]


def test_scales_in_latitude_longitude_and_height(tmp_path: Path) -> None:
    """σ north, east and up at the station where the vector begins; the scale of the whole matrix multiplies them."""
    measured = MEASURED.replace("   4.00      1.00      1.00      1.00", "   4.00      2.00      3.00      5.00")
    assert measured != MEASURED
    (_, single, *_), (_, plain, *_) = (
        read_foreign(_files(tmp_path, measured=text)).data["observations"] for text in (measured, MEASURED)
    )

    def matrix(table: dict[str, Any]) -> FloatArray:
        xx, xy, xz, yy, yz, zz = (float(value) for value in table["rows"][0][5:11])
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    place = np.array([-4250323.0, 2871048.0, -3778696.0])
    longitude, latitude, _ = np.radians(
        Transformer.from_crs("EPSG:7842", "EPSG:7843", always_xy=True).transform(*place)
    )
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    local = np.stack([np.cross(up, east), east, up])
    scaled = local @ matrix(single) @ local.T / (local @ matrix(plain) @ local.T)
    roots = np.sqrt([2.0, 3.0, 5.0])
    np.testing.assert_allclose(scaled, np.outer(roots, roots), rtol=1e-6)


def test_a_free_station_may_be_there_twice_and_without_a_geoid_there_is_a_note(tmp_path: Path) -> None:
    twice = STATIONS + STATIONS.splitlines()[2].replace("167.5630", "167.5600") + "\n"
    document = read_foreign(_files(tmp_path, twice))
    notes = " ".join(note.message for note in document.notes)
    assert "station 'B B' is there twice; its coordinates are start values" in notes
    assert "the geoid is taken as the ellipsoid" in notes
    assert [row[3] for table in document.data["points"] for row in table["rows"] if row[0] == "B B"] == ["167.563"]
    with pytest.raises(InputError, match=r"n\.stn:6: station 'A' is there twice"):
        read_foreign(_files(tmp_path, STATIONS + STATIONS.splitlines()[1] + "\n"))


def _at(frame: str, *names: str, code: str = "G") -> str:
    return _line(code, *names, scales=f"      1.00      1.00      1.00      1.00            {frame}")


_ROWS = "\n".join(_numbers(v, *[0.0] * k, 1e-5) for k, v in enumerate((-1617.5, -124.25, 1722.75)))
_HEAD = "!#=DNA 3.01 MSR    13.12.2018       GDA2020    01.01.2020         2\n"


def _vectors(document: Document) -> FloatArray:
    return np.array([[float(v) for v in row[2:5]] for row in document.data["observations"][0]["rows"]])


def test_vectors_and_positions_of_other_frames_are_transformed(tmp_path: Path) -> None:
    """ITRF2014 turns against GDA2020 by the published rates, mas a year since 2020 (GDA2020 Technical Manual)."""
    own, other = _at("GDA2020          01.01.2020", "A", "B B"), _at("ITRF2014         01.01.2010", "A", "B B")
    document = read_foreign(_files(tmp_path, measured=f"{_HEAD}{own}\n{_ROWS}\n{other}\n{_ROWS}\n"))
    before, after = _vectors(document)
    rx, ry, rz = np.radians(np.array([1.50379, 1.18346, 1.20716]) / 3.6e6) * -10.0
    turn = np.array([[0.0, rz, -ry], [-rz, 0.0, rx], [ry, -rx, 0.0]])
    np.testing.assert_allclose(after - before, turn @ before, atol=1e-8)
    assert np.abs(after - before).max() > 5e-5
    notes = [note.message for note in document.notes]
    assert "measurements in 1 frame and epoch (ITRF2014 01.01.2010) are transformed to GDA2020" in notes
    position = _at("ITRF2014   01.01.2010", "A", "XYZ", "1", code="Y")
    xyz = "\n".join(_numbers(v, *[0.0] * k, 1e-5) for k, v in enumerate((-4250323.0, 2871048.0, -3778696.0)))
    document = read_foreign(_files(tmp_path, measured=f"{_HEAD}{position}\n{xyz}\n"))
    found = np.array([float(v) for v in document.data["observations"][0]["rows"][0][1:4]])
    given = np.array([-4250323.0, 2871048.0, -3778696.0])
    np.testing.assert_allclose(found - given, turn @ given, atol=2e-7 * 10)


def test_epochs_between_which_only_plate_motion_leads_are_taken_as_they_are(tmp_path: Path) -> None:
    stations, head = (text.replace("GDA2020    01.01.2020", "ITRF2014   01.01.2020") for text in (STATIONS, _HEAD))
    stations = "\n".join(line for line in stations.splitlines() if "UTM" not in line)
    lines = [
        _at("ITRF2014         01.01.2010", "A", "B B"),
        _ROWS,
        _at("ITRF97           01.01.2020", "A", "B B"),
        _ROWS,
    ]
    document = read_foreign(_files(tmp_path, stations, head + "\n".join(lines) + "\n"))
    notes = " ".join(note.message for note in document.notes)
    assert "(ITRF2014 01.01.2010) are taken as they are" in notes
    assert "(ITRF1997 01.01.2020) are transformed to ITRF2014" in notes
    with pytest.raises(InputError, match=r"found the epoch '31\.02\.2010', expected dd\.mm\.yyyy"):
        read_foreign(_files(tmp_path, measured=f"{_HEAD}{_at('ITRF2014   31.02.2010', 'A', 'B B')}\n{_ROWS}\n"))


def test_a_file_without_frame_and_stations_of_another_file(tmp_path: Path) -> None:
    """The frame is GDA2020, DynAdjust's default; stations of the only file that has all of them."""
    path = _files(tmp_path, measured=f"!#=DNA 3.00 MSR\n{_at('', 'A', 'B B')}\n{_ROWS}\n")
    stations = path.with_name("n.stn").rename(tmp_path / "all.stn")
    (tmp_path / "few.stn").write_text("\n".join(STATIONS.splitlines()[:2]) + "\n")
    document = read_foreign(path)
    assert document.data["world"]["crs"] == "EPSG:7844"
    notes = " ".join(note.message for note in document.notes)
    assert "found no reference frame: GDA2020 01.01.2020 is taken" in notes
    assert "n.stn does not exist: stations are taken from all.stn" in notes
    (tmp_path / "more.stn").write_text(stations.read_text())
    with pytest.raises(InputError, match=r"n\.stn: this file does not exist"):
        read_foreign(path)
    with pytest.raises(InputError, match="found measurements without values, a list for simulations"):
        read_foreign(_files(tmp_path, measured=f"{_HEAD}A A                   B B                 C\nG A    B B\n"))


def test_a_grid_of_this_name_is_the_geoid_and_llh_with_a_small_h_is_above_the_ellipsoid(tmp_path: Path) -> None:
    stations = STATIONS.splitlines()[0] + "\n"
    for name, kind in (("A", "CCC LLH"), ("B B", "FFF LLh")):
        stations += f"{name:20}{kind} {'49.3000000000':>20}{'10.1500000000':>20}{'200.0000':>20}\n"
    path = _files(tmp_path, stations, f"{_HEAD}{_at('', 'A', 'B B')}\n{_ROWS}\n")
    (tmp_path / "n-geoid.gsb").write_bytes(gsb())
    document = read_foreign(path)
    N, xi, eta = plane(np.array(49.5), np.array(10.25)).tolist()
    rows = {row[0]: list(map(float, row[1:7])) for table in document.data["points"] for row in table["rows"]}
    assert rows["A"] == pytest.approx([49.5, 10.25, 200.0, N, xi, eta], abs=1e-5)
    assert rows["B B"] == pytest.approx([49.5, 10.25, 200.0 - N, N, xi, eta], abs=1e-5)
    assert document.data["world"]["heights"] == "orthometric"
    (tmp_path / "n-geoid.gsb").write_bytes(b"no grid")
    with pytest.raises(InputError, match=r"n-geoid\.gsb: this is not a binary grid"):
        read_foreign(path)


def test_a_set_with_a_target_twice_and_stations_in_columns_of_other_widths(tmp_path: Path) -> None:
    narrow = STATIONS.replace(
        "C                   FFF UTM         320236.2750        5813988.8399             31.4770 55",
        "C                   FFF UTM   320236.2750      5813988.8399        31.4770            S55 description",
    )
    plain, other = (read_foreign(_files(tmp_path, text)) for text in (STATIONS, narrow))
    assert narrow != STATIONS
    assert other.data["points"] == plain.data["points"]
    twice = MEASURED.replace(
        _line("D", "", "", "C", scales="    350 59 59.5000    3.000"),
        _line("D", "", "", "B B", scales="     10 00 03.0000    2.000"),
    )
    tables = read_foreign(_files(tmp_path, measured=twice)).data["observations"]
    sets = next(table for table in tables if table["type"] == "directions")
    assert [row[1:3] for row in sets["rows"][:2]] == [["B B", "10-0-1.0"], ["B B", "10-0-3.0"]]
    head = _line("D", "A", "B B", "2")[:62].rstrip()
    wrong = MEASURED.replace(head, f"{head[:-1]}3")
    with pytest.raises(InputError) as error:
        read_foreign(_files(tmp_path, measured=wrong))
    assert [problem.message for problem in error.value.problems] == ["found 2 directions behind the first, expected 3"]


def test_a_project_file_names_the_pair(tmp_path: Path) -> None:
    plain = read_foreign(_files(tmp_path))
    (tmp_path / "n.stn").rename(tmp_path / "other.stn")
    text = "#general      VALUE\nnetwork-name   x\n#import\nstn-msr-file     other.stn   \nstn-msr-file     n.msr  \n"
    (tmp_path / "p.dnaproj").write_text(text)
    assert format_of(tmp_path / "p.dnaproj") == "dynadjust"
    assert read_foreign(tmp_path / "p.dnaproj").data["observations"] == plain.data["observations"]
    (tmp_path / "p.dnaproj").write_text(text + "stn-msr-file more.msr\n")
    with pytest.raises(InputError, match="found 3 files of stations and measurements"):
        read_foreign(tmp_path / "p.dnaproj")


def test_astronomic_latitudes_and_longitudes_less_the_deflection_are_geodetic(tmp_path: Path) -> None:
    """φ = Φ − ξ, λ = Λ − η / cos φ; as ddd.mmss or as degrees, minutes and seconds."""
    path = _files(tmp_path, measured=_HEAD + "\n".join(
        [
            _line("I", "B B", scales="    -36.323882            0.021"),
            _line("J", "B B", scales="    145 58 21.5700  0.021"),
            _line("P", "B B", scales="    -36.323882            0.021"),
            "",
        ]
    ))  # fmt: skip
    (tmp_path / "n.geo").write_text("B B                 5.0 3.6 -7.2\n")
    tables = read_foreign(path).data["observations"]
    found = [
        float(table["rows"][0][1]) if "-" not in table["rows"][0][1][1:] else table["rows"][0][1] for table in tables
    ]
    latitude = -(36 + 32 / 60 + 38.82 / 3600)
    assert found[0] == pytest.approx(latitude - 0.001, abs=1e-10)
    longitude = 145 + 58 / 60 + 21.57 / 3600
    assert found[1] == pytest.approx(
        longitude + 0.002 / np.cos(np.radians(-(36 + 32 / 60 + 38.821312 / 3600))), abs=1e-9
    )
    assert found[2] == "-36-32-38.82"
    assert [table["columns"][1:] for table in tables[:2]] == [
        ["latitude", "sigma_latitude"],
        ["longitude", "sigma_longitude"],
    ]
