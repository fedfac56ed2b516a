"""DynaML against the same networks as DNA files: the same observations, the same adjustment; mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import determinable_start, make_problem
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.project.document import Document
from mor.solve.iterate import adjust
from mor.units import parse_dms
from tests.reference_data import missing, network_of, reference_folder

REAL = reference_folder("earth/dynadjust")


def _element(name: str, **children: object) -> str:
    inner = "".join(f"<{key.rstrip('_')}>{value}</{key.rstrip('_')}>\n" for key, value in children.items())
    return f"<{name}>\n{inner}</{name}>\n"


def _station(name: str, held: str, kind: str, *place: str, zone: str = "") -> str:
    values = dict(zip(("XAxis", "YAxis", "Height"), place, strict=True), Name=name)
    coordinates = _element("StationCoord", **values, **({"HemisphereZone": zone} if zone else {}))
    head = _element("x", Name=name, Constraints=held, Type=kind).removeprefix("<x>\n").removesuffix("</x>\n")
    return f"<DnaStation>\n{head}{coordinates}</DnaStation>\n"


def _vector(xyz: tuple[float, ...], variance: float, blocks: list[list[float]] | None = None) -> str:
    sigmas = {f"Sigma{a}{b}": variance * (a == b) for a, b in ("XX", "XY", "XZ", "YY", "YZ", "ZZ")}
    body = "".join(f"<{k}>{v}</{k}>\n" for k, v in {**dict(zip("XYZ", xyz, strict=True)), **sigmas}.items())
    cells = [(f"m{i}{j}", 3 * (i - 1) + j - 1) for i in (1, 2, 3) for j in (1, 2, 3)]
    for block in blocks or []:
        inner = "".join(f"<{name}>{block[k]}</{name}>" for name, k in cells)
        body += f"<GPSCovariance>{inner}</GPSCovariance>\n"
    return f"<GPSBaseline>\n{body}</GPSBaseline>\n"


def _measured(type_: str, body: str, ignore: str = "<Ignore/>") -> str:
    scales = "".join(f"<{name}>1.0</{name}>" for name in ("Pscale", "Lscale", "Hscale"))
    head = f"<Type>{type_}</Type>\n{ignore}\n"
    if type_ in "GX":
        head += f"<ReferenceFrame>GDA2020</ReferenceFrame><Epoch>01.01.2020</Epoch><Vscale>4</Vscale>{scales}\n"
    return f"<DnaMeasurement>\n{head}{body}</DnaMeasurement>\n"


def _names(*names: str) -> str:
    return "".join(f"<{n}>{v}</{n}>\n" for n, v in zip(("First", "Second", "Third"), names, strict=False))


def _line(*names: str, **values: object) -> str:
    return _names(*names) + "".join(f"<{name}>{value}</{name}>\n" for name, value in values.items())


STATIONS = (
    '<?xml version="1.0"?>\n<DnaXmlFormat type="Station File" referenceframe="GDA2020" epoch="01.01.2020">\n'
    + _station("A", "CCC", "XYZ", "-4250323.0000", "2871048.0000", "-3778696.0000")
    + _station("B B", "FFF", "LLH", "-36.3238821312", "145.5821570921", "167.5630")
    + _station("C", "FFF", "UTM", "320236.2750", "5813988.8399", "31.4770", zone="S55")
    + _station("unused", "FFF", "LLH", "-36.3238821312", "145.5821570921", "167.5630")
    + "</DnaXmlFormat>\n"
)
_BLOCK = [1e-6, 2e-6, 3e-6, 4e-6, 1e-6, 1e-6, 1e-6, 0.0, 0.0]
MEASURED = (
    '<?xml version="1.0"?>\n<DnaXmlFormat type="Measurement File" referenceframe="GDA2020" epoch="01.01.2020">\n'
    + _measured("G", _names("A", "B B") + _vector((-1617.5, -124.25, 1722.75), 1e-5))
    + _measured(
        "X",
        "<Total>2</Total>\n"
        + _names("A", "B B")
        + _vector((-1617.51, -124.26, 1722.76), 1e-5, [_BLOCK])
        + _names("A", "C")
        + _vector((100.0, 200.0, 300.0), 2e-5),
    )
    + _measured("S", _line("B B", "C", Value="2259.0", StdDev="0.005", InstHeight="1.606", TargHeight="1.565"))
    + _measured("S", _line("B B", "C", Value="2259.0", StdDev="0.005"))
    + _measured("G", _names("A", "C") + _vector((-9.0, -9.0, 9.0), 1e-5), "<Ignore>*</Ignore>")
    + _measured("V", _line("A", "B B", Value="90.2431", StdDev="20", InstHeight="1.545", TargHeight="0.125"))
    + _measured("Z", _line("A", "B B", Value="-0.24310000", StdDev="20"))
    + _measured("A", _line("A", "B B", "C", Value="190.050150", StdDev="20"))
    + _measured(
        "D",
        _line("A", "B B", Value="10.00010000", StdDev="2", Total="2")
        + "<Directions><Ignore/><Target>C</Target><Value>350.5959500</Value><StdDev>3</StdDev></Directions>\n"
        + "<Directions><Ignore>*</Ignore><Target>unused</Target><Value>0</Value><StdDev>3</StdDev></Directions>\n",
    )
    + _measured("P", _line("A", Value="-36.3223", StdDev="0.001"))
    + "</DnaXmlFormat>\n"
)


def files(folder: Path, stations: str = STATIONS, measured: str = MEASURED) -> Path:
    """A pair of files with the ends of lines of Windows; returns the one of measurements."""
    (folder / "nstn.xml").write_text(stations.replace("\n", "\r\n"), newline="", encoding="utf-8-sig")
    (folder / "nmsr.xml").write_text(measured.replace("\n", "\r\n"), newline="")
    return folder / "nmsr.xml"


def test_what_the_files_say(tmp_path: Path) -> None:
    path = files(tmp_path)
    assert format_of(path) == format_of(tmp_path / "nstn.xml") == "dynaml"
    document = read_foreign(tmp_path / "nstn.xml")
    assert document.data["title"] == "n"
    assert document.data["world"] == {"crs": "EPSG:7844", "heights": "ellipsoidal"}
    cluster, single, sets, distance, *others = document.data["observations"]
    assert sets["rows"] == [
        ["A", "B B", "10-00-01.0000", "2", "1"],
        ["A", "C", "350-59-59.500", "3", "1"],
    ]
    Q = np.array(cluster["covariance"])
    assert Q[0, 4] == Q[4, 0] == 8e-6  # row of the first member, column of the second; four times as said
    assert Q[1, 3] == 1.6e-5
    assert [float(v) for v in single["rows"][0][5:8]] == [4e-5, 0.0, 0.0]
    assert distance["rows"] == [
        ["B B", "C", "2259.0", "0.005", "1.606", "1.565"],
        ["B B", "C", "2259.0", "0.005", None, None],
    ]
    assert [(table["type"], table["rows"]) for table in others] == [
        ("zenith_angle", [["A", "B B", "90-24-31", "20", "1.545", "0.125"]]),
        ("vertical_direction", [["A", "B B", "-0-24-31.0000", "20"]]),
        ("angle", [["A", "B B", "C", "190-05-01.50", "20"]]),
        ("geodetic_position", [["A", "-36-32-23", "0.001"]]),
    ]
    notes = " ".join(map(str, document.notes))
    for words in ("switched off (*) (2)", "the geoid is taken as the ellipsoid"):
        assert words in notes
    network_of(document, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CCC", "CCX", r"nstn\.xml:3: station 'A': found the constraints 'CCX'"),
        ('<DnaXmlFormat type="M', '<DnaXml type="M', r"nmsr\.xml:\d+: "),
        (
            'File" referenceframe="GDA2020" epoch="01.01.2020">\n<DnaM',
            'File" referenceframe="GDA66">\n<DnaM',
            r"nmsr\.xml:2: found the reference frame 'GDA66'",
        ),
        ("90.2431", "90.6431", r"nmsr\.xml:\d+: found '90\.6431', expected less than 60"),
        ("<Type>V", "<Type>w", r"nmsr\.xml:\d+: found the measurement 'W'"),
        ("<Total>2", "<Total>3", r"nmsr\.xml:\d+: found 2 members of the cluster, expected 3"),
        ("<GPSCovariance>", "<Other>", r"nmsr\.xml:\d+: "),
        ("<m23>1e-06</m23>", "", r"nmsr\.xml:\d+: found no m23 \(line \d+\)"),
        ("<Total>2</Total>\n<Dir", "<Total>4</Total>\n<Dir", r"nmsr\.xml:\d+: found 2 directions behind"),
        ("<Target>C</Target>", "", r"nmsr\.xml:\d+: found the stations 'A', '', expected 2 different"),
        ("<Value>2259.0", "<Value>", r"nmsr\.xml:\d+: found no Value"),
        ("<InstHeight>1.606</InstHeight>", "", r"nmsr\.xml:\d+: found one of InstHeight and TargHeight"),
        ("<SigmaYY>1e-05", "<SigmaYY>-1e-05", r"nmsr\.xml:\d+: the covariance matrix is not positive"),
        ("<Vscale>4", "<Vscale>-4", r"nmsr\.xml:\d+: found '-4 1 1 1', expected four scales above 0"),
        ("<Name>C</Name>", "<Name>D</Name>", r"nmsr\.xml:\d+: station 'C' is not in nstn\.xml"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = files(tmp_path, STATIONS.replace(old, new, 1), MEASURED.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_foreign(path, "dynaml")


def test_one_of_a_pair_is_missing(tmp_path: Path) -> None:
    path = files(tmp_path)
    (tmp_path / "nstn.xml").unlink()
    with pytest.raises(InputError, match=r"nstn\.xml: this file does not exist; DynaML has a pair"):
        read_foreign(path)
    with pytest.raises(InputError, match="expected one that ends in stn"):
        read_foreign(path.rename(tmp_path / "n.xml"))


def test_other_names_of_a_pair_and_both_in_one_file(tmp_path: Path) -> None:
    plain = read_foreign(files(tmp_path))
    stations, measured = ((tmp_path / f"n{kind}.xml").read_text() for kind in ("stn", "msr"))
    (tmp_path / "stn_a.xml").write_text(stations)
    (tmp_path / "msr_a.xml").write_text(measured)
    inner = measured[measured.index("<DnaMeasurement>") :]
    (tmp_path / "both.xml").write_text(stations.replace("</DnaXmlFormat>", "") + inner)
    for name in ("msr_a.xml", "stn_a.xml", "both.xml"):
        document = read_foreign(tmp_path / name)
        assert document.data["observations"] == plain.data["observations"]
        assert document.data["points"] == plain.data["points"]
    everything = measured.replace("<Ignore/>", "<Ignore>*</Ignore>").replace("<Ignore></Ignore>", "<Ignore>*</Ignore>")
    (tmp_path / "msr_a.xml").write_text(everything)
    with pytest.raises(InputError, match=r"no supported observations; not read: measurements that are switched off"):
        read_foreign(tmp_path / "msr_a.xml")


_PLAIN = {"cov_dx_dx", "cov_dx_dy", "cov_dx_dz", "cov_dy_dy", "cov_dy_dz", "cov_dz_dz"}


def _rows(document: Document) -> list[tuple[str, list[str], list[float]]]:
    """Observations as names and numbers; covariance matrices as numbers of their own."""
    found = []
    for table in document.data["observations"]:
        texts = [
            k for k, name in enumerate(table["columns"]) if name in ("from", "to", "at", "point", "station", "set")
        ]
        for row in table["rows"]:
            values = [cell or "0" for k, cell in enumerate(row) if k not in texts]
            numbers = [parse_dms(v) if v.count("-") > 1 and "e" not in v else float(v) for v in values]
            found.append((table["type"], [row[k] for k in texts], numbers))
        if isinstance(table.get("covariance"), list):
            found.append(("covariance", [], np.ravel(table["covariance"]).tolist()))
    return found


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
@pytest.mark.parametrize("name", ["gnss-network", "urban-network"])
def test_real_networks_are_the_same_in_both_formats(tmp_path: Path, name: str) -> None:
    """Every measurement of DynAdjust's samples, and which stations are held; its XML has more digits of some."""
    assert REAL is not None
    for file in REAL.glob(f"{name}*"):  # the XML files of one say GDA2020 and are in GDA94
        text = file.read_bytes()
        epoch = b'epoch="01.01.1994"'
        (tmp_path / file.name).write_bytes(text.replace(b'"GDA2020" ' + epoch, b'"GDA94" ' + epoch))
    dna, xml = read_foreign(tmp_path / f"{name}.msr"), read_foreign(tmp_path / f"{name}msr.xml")
    for (type_, names, values), (other, theirs, numbers) in zip(_rows(dna), _rows(xml), strict=True):
        assert (type_, names) == (other, theirs)
        # a transformed vector is a difference of geocentric coordinates
        np.testing.assert_allclose(values, numbers, rtol=1e-9, atol=5e-9 if type_ == "gnss_vector" else 1e-15)
    held = [
        {(row[0], table["fixed"] != [] if "fixed" in table else False, *map(bool, row[7:])) for row in table["rows"]}
        for table in dna.data["points"]
    ]
    assert held == [
        {(row[0], table["fixed"] != [] if "fixed" in table else False, *map(bool, row[7:])) for row in table["rows"]}
        for table in xml.data["points"]
    ]


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_a_real_network_adjusts_to_the_same() -> None:
    """From other start values of the stations: the XML file has those of another adjustment."""
    assert REAL is not None
    both = []
    for file in ("gnss-network.msr", "gnss-networkmsr.xml"):
        network, start = determinable_start(network_of(read_foreign(REAL / file), REAL))
        values = adjust(make_problem(network, start, start), start).values["point"]
        both.append((network.things["point"].ids, network.world.horizon.to_geocentric(values)))
    assert both[0][0] == both[1][0]
    np.testing.assert_allclose(both[0][1], both[1][1], atol=2e-8)  # geocentric metres have 1e-9 of rounding
