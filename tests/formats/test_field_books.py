"""Field books: sets, faces and heights of every format, a network measured twice, real files, what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.formats.fieldbook.book import Sight, rounds, sexagesimal
from mor.project.document import Document
from tests.reference_data import missing, network_of, reference_folder

REAL = reference_folder("formats/total-stations")
PLACES = {"1": (0.0, 0.0, 10.0), "2": (60.0, 10.0, 12.0), "3": (25.0, 50.0, 9.0), "4": (70.0, 60.0, 14.0)}
HEIGHTS = {"1": 1.55, "2": 1.62, "3": 1.48}
TARGET = 1.3


def _readings(face: int = 1) -> list[tuple[str, str, float, float, float]]:
    """Station, target, circle and zenith angle (gon), slope distance (m) of a small network, in one face."""
    rows = []
    for number, (station, height) in enumerate(HEIGHTS.items()):
        for target, place in PLACES.items():
            if target == station:
                continue
            dx, dy, dz = np.array(place) - PLACES[station] + [0, 0, TARGET - height]
            circle = np.arctan2(dx, dy) * 200 / np.pi + 31.0 * number + (200 if face == 2 else 0)
            zenith = np.arctan2(np.hypot(dx, dy), dz) * 200 / np.pi
            slope = float(np.sqrt(dx * dx + dy * dy + dz * dz))
            rows.append((station, target, circle % 400, 400 - zenith if face == 2 else zenith, slope))
    return rows


def _gsi(width: int = 16) -> str:
    star = "*" if width == 16 else ""

    def word(index: str, unit: str, value: int) -> str:
        return f"{index}..1{unit}{'-' if value < 0 else '+'}{abs(value):0{width}d}"

    lines = []
    for station, height in HEIGHTS.items():
        lines.append(f"{star}110001+{station:>0{width}} {word('88', '0', round(height * 1e3))} ")
        for face in (1, 2):
            for at, target, circle, zenith, slope in _readings(face):
                if at == station:
                    words = [word("21", "2", round(circle * 1e5)), word("22", "2", round(zenith * 1e5))]
                    words += [word("31", "6", round(slope * 1e4)), word("87", "0", round(TARGET * 1e3))]
                    lines.append(f"{star}110002+{target:>0{width}} {' '.join(words)} 51....+0000+000 ")
    return "\r\n".join(lines)


def _sdr() -> str:
    lines = ["00NMSDR33  V04-04.34    25-Nov-15 12:33 211111"]
    for station, height in HEIGHTS.items():
        lines.append(f"02TP{station:>16}{'':16}{'':16}{'':16}{height:<16}")
        lines.append(f"03NM{TARGET:<16}")
        for face in (1, 2):
            for at, target, circle, zenith, slope in _readings(face):
                if at == station:
                    lines.append(f"09F{face}{at:>16}{target:>16}{slope:<16.5f}{zenith:<16.6f}{circle:<16.6f}")
    return "\n".join(lines)


def _m5() -> str:
    lines = []
    for station, height in HEIGHTS.items():
        x, y, z = PLACES[station]
        lines.append(f"For M5|Adr 1|TI  INPUT |th {TARGET:.3f} m   |ih {height:.3f} m   |      |")
        lines.append(f"For M5|Adr 1|PI1       S    {station}|Y   {x} m   |X   {y} m   |Z {z} m   |")
        for face in (1, 2):
            for at, target, circle, zenith, slope in _readings(face):
                if at == station:
                    values = f"SD {slope:.5f} m   |Hz {circle:.6f} gon |V1 {zenith:.6f} gon "
                    lines.append(f"For M5|Adr 1|PI1            {target}|{values}|")
    return "\n".join(lines)


def _jxl() -> str:
    """Raw distances: the prism constant and the ppm are still to be added; what was computed or deleted is in it."""
    ppm = "<PPM>25</PPM><ApplyPPMToRawDistances>true</ApplyPPMToRawDistances>"
    target = f"<PrismConstant>-0.0344</PrismConstant><TargetHeight>{TARGET}</TargetHeight>"
    records = [
        f'<AtmosphereRecord ID="a">{ppm}</AtmosphereRecord>',
        f'<TargetRecord ID="t">{target}</TargetRecord>',
    ]
    for station, height in HEIGHTS.items():
        records.append(
            f'<StationRecord ID="s{station}"><StationName>{station}</StationName>'
            f"<TheodoliteHeight>{height}</TheodoliteHeight></StationRecord>"
        )
        for face in (1, 2):
            for at, target, circle, zenith, slope in _readings(face):
                if at == station:
                    raw = (slope + 0.0344) / (1 + 25e-6)
                    records.append(
                        f"<PointRecord><Name>{target}</Name><Method>DirectReading</Method><StationID>s{at}</StationID>"
                        f"<TargetID>t</TargetID><Circle><HorizontalCircle>{circle * 0.9:.8f}</HorizontalCircle>"
                        f"<VerticalCircle>{zenith * 0.9:.8f}</VerticalCircle><EDMDistance>{raw:.6f}</EDMDistance>"
                        f"<Face>Face{face}</Face></Circle><Deleted>false</Deleted></PointRecord>"
                    )
    records += [
        "<PointRecord><Name>4</Name><Method>MeanTurnedAngle</Method><Circle><HorizontalCircle>1</HorizontalCircle>"
        "</Circle></PointRecord>",
        "<PointRecord><Name>9</Name><Method>DirectReading</Method><Deleted>true</Deleted></PointRecord>",
        "<NoteRecord><Notes><Note>rain</Note></Notes></NoteRecord>",
    ]
    body = "\n".join(records)
    return f'<?xml version="1.0"?>\n<JOBFile jobName="net" version="5.6">\n<FieldBook>\n{body}\n</FieldBook></JOBFile>'


def _rw5() -> str:
    """Sets in US survey feet and gon; point 2, the backsight of station 1, is measured in them."""
    feet = 3937.0 / 1200.0
    lines = [
        "JB,NMnet,DT05-06-2024,TM10:15:30",
        "MO,AD0,UN2,SF1.00000000,EC1,EO0.0,AU1",
        "--a comment, with, commas",
    ]
    for station, height in HEIGHTS.items():
        lines += [f"BK,OP{station},BP{'2' if station == '1' else '1'},BS0.0000,BC0.0000"]
        lines += [f"LS,HI{height * feet:.6f},HR{TARGET * feet:.6f}"]
        for face in (1, 2):
            for k, (at, target, circle, zenith, slope) in enumerate(_readings(face)):
                if at == station:
                    kind = ("B" if k % 3 == 0 else "F") + "DR"[face - 1]
                    values = f"AR{circle:.5f},ZE{zenith:.5f},SD{slope * feet:.6f}"
                    lines.append(f"{kind},OP{at},FP{target},{values},--note, with comma")
    return "\r\n".join(lines)


BOOKS = {
    "b.rw5": _rw5(),
    "b.gsi": _gsi(),
    "old.gsi": _gsi(8),
    "b.sdr": _sdr(),
    "b.m5": _m5(),
    "b.jxl": _jxl(),
}


@pytest.mark.parametrize("name", BOOKS)
def test_a_network_comes_out_as_it_was(tmp_path: Path, name: str) -> None:
    """Distances between the points, and their heights above each other, whatever the datum."""
    path = tmp_path / name
    path.write_text(BOOKS[name])
    result = mor.adjust(str(path))
    network, solved = result.project.network, result.solved
    points = network.things["point"]
    found = {point: solved.adjustment.values["point"][points.part(point, "position")] for point in points.ids}
    assert set(found) == set(PLACES)
    for a in PLACES:
        for b in PLACES:
            true = np.array(PLACES[b]) - PLACES[a]
            ours = found[b] - found[a]
            assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(true), abs=2e-3)
            assert ours[2] == pytest.approx(true[2], abs=2e-3)
    assert sum(len(group.observed) for group in network.groups) >= 36
    assert "3 set-ups, 3 sets" in " ".join(result.project.notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<StationName>2</StationName>", "", r"b\.jxl:\d+: StationRecord: found no StationName"),
        (
            "<StationID>s1</StationID>",
            "<StationID>s8</StationID>",
            r"b\.jxl:7: PointRecord: point '2': found no StationR",
        ),
        ("-0.0344", "x", r"b\.jxl:5: TargetRecord: found 'x', expected a number"),
        ("<Name>2</Name>", "", r"b\.jxl:\d+: PointRecord: found no Name"),
        ("JOBFile", "Job", r"found <Job>, expected <JOBFile> with a <FieldBook>"),
    ],
)
def test_mistakes_in_a_job(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "b.jxl"
    path.write_text(_jxl().replace(old, new))
    with pytest.raises(InputError, match=words):
        read_foreign(path, "jobxml")


def test_what_a_job_computed_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "b.jxl"
    path.write_text(_jxl())
    assert format_of(path) == "jobxml"
    notes = " ".join(map(str, read_foreign(path).notes))
    for words in ("points by MeanTurnedAngle (1 record", "deleted points (1 record", "NoteRecord (1 record"):
        assert words in notes


def test_rounds() -> None:
    def sights(names: str, faces: str) -> list[Sight]:
        return [Sight(name, 1, 0.0, face=int(face)) for name, face in zip(names, faces, strict=True)]

    assert rounds(sights("ABCCBA", "111222"), 360) == [1] * 6
    assert rounds(sights("ABCABC", "111111"), 360) == [1, 1, 1, 2, 2, 2]
    assert rounds(sights("ABCA", "1111"), 360) == [1] * 4
    assert rounds(sights("ABBA", "1212") + sights("ABBA", "1212"), 360) == [1, 1, 1, 1, 2, 2, 2, 2]


def test_degrees_minutes_seconds() -> None:
    assert sexagesimal("17.573160") == pytest.approx(17 + 57 / 60 + 31.6 / 3600)
    assert sexagesimal("-0.3") == -0.5
    assert sexagesimal("12.0060") == pytest.approx(12 + 1 / 60)
    for wrong in ("12.6000", "12.0061", "x", "1e3", ""):
        with pytest.raises(ValueError, match="expected"):
            sexagesimal(wrong)


def _real(name: str) -> Document:
    if REAL is None:
        pytest.skip(missing("formats/total-stations"))
    return read_foreign(REAL / name)


def _rows(document: Document, type_: str) -> list[list[str | None]]:
    tables = [table for table in document.data.get("observations", []) if table["type"] == type_]
    return [row for table in tables for row in table["rows"]]


@pytest.mark.parametrize(
    ("name", "key", "points", "both", "distances"),
    [
        ("coords.gsi", "gsi", 40, 0, 0),
        ("20151125.sdr", "sdr", 0, 14, 13),
        ("20151130.sdr", "sdr", 0, 21, 20),
        ("180416-1.m5", "m5", 0, 0, 19),
        ("jkv.gts7", "topcon", 0, 4, 3),
        ("1cs.scr", "sokkia-scr", 0, 18, 12),
        ("test.idx", "idx", 0, 154, 31),
        ("ullo.job", "geodimeter", 0, 12, 0),
        ("ullo.are", "geodimeter", 4, 0, 0),
    ],
)
def test_real_books(name: str, key: str, points: int, both: int, distances: int) -> None:
    document = _real(name)
    assert REAL is not None
    assert format_of(REAL / name) == key
    listed = sum(len(table["rows"]) for table in document.data["points"])
    if points:
        assert listed == points
        assert "observations" not in document.data
    assert len(_rows(document, "zenith_directions")) == both
    assert len(_rows(document, "distance")) == distances


def test_a_real_book_fits(tmp_path: Path) -> None:
    """Circle readings in both faces and horizontal distances of eight stations: what was measured agrees."""
    assert _real("ullo.job") is not None
    assert REAL is not None
    result = mor.adjust(str(REAL / "ullo.job"))
    groups = dict(zip((g.type.key for g in result.solved.network.groups), result.solved.quality.groups, strict=True))
    assert float(np.nansum(groups["directions"].r)) > 70
    for key, sigma in (("directions", 3 / 3600 * np.pi / 180), ("horizontal_distance", 2e-3)):
        v = np.nan_to_num(groups[key].v)
        assert np.sqrt((v**2).sum() / np.nansum(groups[key].r)) < 1.2 * sigma


def test_cyrillic_is_told() -> None:
    notes = " ".join(map(str, _real("20151125.sdr").notes))
    assert "cp1251 (Windows, Cyrillic)" in notes
    assert "not read: notes (13 records, lines 4–8, 11–12, 14, 19, 21, 23, 37, 39)" in notes


def test_readings_that_are_no_angles_are_left_out() -> None:
    assert "angles of some of them are none" in " ".join(map(str, _real("sample.raw").notes))


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "a.gsi",
            "110001+00000001 21.102+1000000x\n110002+0000002 21",
            r"a\.gsi:1: word 21: found '\+1000000x'",
        ),
        ("a.gsi", "110001+00000001 21.102+10000000\n11000", r"a\.gsi:2: found '11000', expected words"),
        ("a.gsi", "110001+00000001 21.109+10000000", r"a\.gsi:1: word 21: found unit '9'"),
        ("a.sdr", "00NMSDR33 V04 25-Nov-15 12:33 911111", r"a\.sdr:1: found angles of kind 9"),
        ("a.m5", "For M5|Adr 1|PI1   2|SD 1.2 in|Hz 12.6101 DMS|", r"a\.m5:1: found SD in 'in'"),
        (
            "a.m5",
            "For M5|Adr 1|TO  Start-Line  BF  1|    |    |    |\nFor M5|Adr 2|KD1  B1  1|Rb 1.5 m |HD 25.3 m |  |",
            "staff readings without a counterpart",
        ),
        ("a.job", "5=P1\nfive=3", r"a\.job:2: found 'five=3'"),
        ("a.job", "9=3", "neither a point nor a reading"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_foreign(path, "geodimeter" if path.suffix == ".job" else "")


def test_m5_may_have_the_names_and_the_gon_of_zeiss(tmp_path: Path) -> None:
    """D is the slope distance, E the horizontal distance, grd the gon."""
    documents = []
    for changes in ((), (("SD ", "D  "), (" gon", " grd"))):
        text = BOOKS["b.m5"]
        for old, new in changes:
            text = text.replace(old, new)
        (tmp_path / "b.m5").write_text(text)
        documents.append(read_foreign(tmp_path / "b.m5").data)
    assert documents[0] == documents[1]


def test_readings_match_the_network(tmp_path: Path) -> None:
    path = tmp_path / "b.gsi"
    path.write_text(BOOKS["b.gsi"])
    network = network_of(read_foreign(path), tmp_path)
    assert {group.type.key for group in network.groups} >= {"zenith_directions", "distance"}


def test_rw5_has_backsights_coordinates_and_angles_of_every_kind(tmp_path: Path) -> None:
    path = tmp_path / "a.rw5"
    path.write_text(
        "JB,NMjob\nMO,AD0,UN0,SF0.9996,EC0,EO0.0,AU0\nSP,PN7,N 1000,E 2000.00,EL10.0,--P\n"
        "OC,OP1,N 5000.0,E 2000.0,EL100.0,--CP\nBK,OP1,BP7,BS180.0000,BC0.0044\nLS,HI5.0,HR6.0\n"
        "SS,OP1,FP2,AR90.3030,ZE86.0000,SD100.0,--a\nSS,OP1,FP3,DR10.0000,VA4.0000,HD50.0\nLS,HR4.0\n"
        "TR,OP1,FP4,AL10.0000,CE1.5,SD20\nSS,OP1,FP5,AZ190.0000,TH1.5,peg\nOC,OP2,N 1.0,E 2.0,EL3.0\n"
        "SS,OP2,FP4,ZE90.0000,SD1\nSS,OP2,FP4,TH1.5\n"
    )
    assert format_of(path) == "rw5"
    document = read_foreign(path)
    data = document.data
    assert [row[0] for row in data["points"][0]["rows"]] == [
        "7",
        "1",
    ]  # 2 was sighted before: its OC is computed
    assert float(data["points"][0]["rows"][0][1]) == pytest.approx(609.6)
    tables = {table["type"]: table for table in data["observations"]}
    back = 44 / 3600
    plain = [[row[1], float(row[2])] for row in tables["directions"]["rows"]]
    assert plain == [["7", pytest.approx(back)], ["4", pytest.approx(350 + back)], ["5", pytest.approx(10 + back)]]
    both = [[row[1], float(row[2]), float(row[3])] for row in tables["zenith_directions"]["rows"]]
    assert both == [["2", pytest.approx(90.50833333), 86.0], ["3", pytest.approx(190 + back), 86.0]]
    assert [row[2] for row in data["stations"][0]["rows"]] == ["1.524", "1.524"]
    notes = " ".join(map(str, document.notes))
    for words in (
        "scale factor 0.9996",
        "differences of height",
        "sights without readings",
        "value TH (2 records",
        "comments (1 record",
    ):
        assert words in notes, notes


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("MO,AD0,UN7", "a.rw5:2: found UN7, expected 0"),
        ("SS,OP1,AR1.0", "a.rw5:2: found no FP in SS"),
        ("SS,FP1,AR1.0", "a.rw5:2: found no OP in SS"),
        ("SS,OP1,FP2,AR10.7500", "a.rw5:2: found '10.7500', expected less than 60 minutes"),
        ("SS,OP1,FP2,AR10.0000,SDx", "a.rw5:2: found 'x', expected a number"),
    ],
)
def test_mistakes_of_rw5(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "a.rw5"
    path.write_text(f"JB,NMjob\n{line}\n")
    with pytest.raises(InputError) as error:
        read_foreign(path)
    assert words in str(error.value)
