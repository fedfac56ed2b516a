"""Field books: which sights belong to which station, and which records are raw, computed or given."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mor
from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.project.document import Document
from tests.reference_data import network_of

CONTROL = {
    "K1": (0.0, 0.0, 10.0),
    "K2": (120.0, 15.0, 12.0),
    "K3": (70.0, 130.0, 9.0),
    "K4": (-40.0, 90.0, 14.0),
}


def _read(tmp_path: Path, name: str, text: str) -> Document:
    path = tmp_path / name
    path.write_text(text)
    return read_foreign(path)


def _tables(document: Document, type_: str) -> list[dict[str, Any]]:
    return [table for table in document.data.get("observations", []) if table["type"] == type_]


def _rows(document: Document, type_: str) -> list[dict[str, str]]:
    return [
        dict(zip(table["columns"], row, strict=True)) for table in _tables(document, type_) for row in table["rows"]
    ]


def _points(document: Document) -> dict[str, list[float]]:
    """Points with given coordinates: those of the other table, if it has any, are start values."""
    return {
        row[0]: [float(cell) for cell in row[1:4] if cell is not None]
        for table in document.data["points"][:1]
        if "x" in table["columns"]
        for row in table["rows"]
    }


def _notes(document: Document) -> str:
    return " ".join(map(str, document.notes))


def _station_of_lines(document: Document) -> dict[int, str]:
    """The point of the station that each sight was read at, by the line of the sight."""
    points = {row[0]: row[1] for table in document.data["stations"] for row in table["rows"]}
    found = {}
    for k, table in enumerate(document.data["observations"]):
        if "station" in table["columns"]:
            at = table["columns"].index("station")
            for i, row in enumerate(table["rows"]):
                found[document.lines["observations", k, "rows", i]] = points[row[at]]
    return found


class _Gsi:
    """A GSI-16 book of our own making with the station that each line was read at."""

    def __init__(self, seed: int, located: bool) -> None:
        self.random = np.random.default_rng(seed)
        self.located = located
        self.lines: list[str] = []
        self.truth: dict[int, str] = {}

    def word(self, index: str, value: float, digits: int = 3, unit: str = "0") -> str:
        number = round(value * 10**digits)
        return f"{index}..1{unit}{'-' if number < 0 else '+'}{abs(number):016d}"

    def line(self, name: str, *words: str) -> int:
        self.lines.append(f"*11{len(self.lines) + 1:04d}+{name:0>16} {' '.join(words)}")
        return len(self.lines)

    def place(self, name: str, place: tuple[float, float, float], first: int) -> list[str]:
        return [self.word(str(first + k), value) for k, value in enumerate(place)]

    def sight(self, at: str, station: Any, name: str, target: Any, turn: float, computed: bool) -> None:
        dx, dy, dz = np.subtract(target, station)
        plan = float(np.hypot(dx, dy))
        words = [
            self.word("21", (np.degrees(np.arctan2(dx, dy)) / 0.9 + turn) % 400, 5, "2"),
            self.word("22", np.degrees(np.arctan2(plan, dz)) / 0.9, 5, "2"),
            self.word("31", float(np.hypot(plan, dz)), 4, "6"),
            self.word("87", 0.0),
        ]
        words += self.place(name, tuple(target), 81) if computed and self.located else []
        self.truth[self.line(name, *words)] = at


def _book(seed: int, located: bool) -> _Gsi:
    """Stations that are known, or resected after their sights, with details; the circle turned or not."""
    book = _Gsi(seed, located)
    random = book.random
    for name, place in CONTROL.items():
        book.line(name, *book.place(name, place, 81))
    for k in range(int(random.integers(2, 5))):
        name = f"S{k + 1}"
        station = np.array([*random.uniform(-100, 200, 2), random.uniform(8, 14)])
        seen = random.permutation(list(CONTROL))[: random.integers(2, 5)]
        turn = float(random.uniform(50, 350)) if random.random() < 0.5 else 0.0
        resected = bool(random.random() < 0.6)
        record = [*book.place(name, tuple(station), 84), book.word("88", 0.0)]
        record += [book.word("25", -turn % 400, 5, "2")] if resected and random.random() < 0.5 else []
        if resected:
            for target in seen:
                book.sight(name, station, target, CONTROL[target], turn, computed=False)
        book.line(name, *record)
        if not resected:
            for target in seen:
                book.sight(name, station, target, CONTROL[target], 0.0, computed=True)
        for n in range(int(random.integers(1, 4))):
            detail = station + random.uniform(-30, 30, 3) * [1, 1, 0.1]
            book.sight(name, station, f"D{k}{n}", detail, 0.0, computed=True)
    return book


@pytest.mark.parametrize("located", [True, False])
def test_sights_belong_to_the_station_that_the_instrument_means(tmp_path: Path, located: bool) -> None:
    """150 books: by blocks without coordinates if others have them, by distances between given coordinates if not."""
    wrong = 0
    for seed in range(150):
        book = _book(seed, located)
        document = _read(tmp_path, "book.gsi", "\n".join(book.lines))
        wrong += _station_of_lines(document) != book.truth
    assert wrong == 0


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_resected_stations_come_out_right(tmp_path: Path, seed: int) -> None:
    """Coordinates of stations and details: the circle readings before and after a station record fit together."""
    book = _book(seed, located=False)
    document = _read(tmp_path, "book.gsi", "\n".join(book.lines))
    solved = solve_network(network_of(document, tmp_path))
    assert solved.quality.sigma0 < 0.5
    assert not set(_points(document)) - set(CONTROL) - {f"S{k}" for k in range(9)}


def test_a_code_block_opens_a_set_up(tmp_path: Path) -> None:
    def block(number: int, code: int, station: str, height: int) -> str:
        return f"*41{number:04d}+{code:016d} 42....+{station:0>16} 43....+{height:016d}"

    def sight(number: int, target: str, hz: int) -> str:
        return (
            f"*11{number:04d}+{target:0>16} 21.322+{hz:016d} 22.322+{10000000:016d} "
            f"31..00+{100000:016d} 87..10+{1500:016d}"
        )

    lines = [
        block(1, 21, "P1", 1550),
        sight(2, "P2", 0),
        sight(3, "P3", 10000000),
        block(4, 21, "P2", 1600),
        sight(5, "P1", 0),
        "*410006+0000000000000007 42....+00000000000TREE 43....+0000000000012000",
        sight(7, "P3", 35000000),
        block(8, 2, "0", 0),
        sight(9, "0", 35000000),
    ]
    document = _read(tmp_path, "b.gsi", "\n".join(lines))
    assert [row[:3] for row in document.data["stations"][0]["rows"]] == [
        ["P1", "P1", "1.55"],
        ["P2", "P2", "1.6"],
    ]
    assert _station_of_lines(document) == {2: "P1", 3: "P1", 5: "P2", 7: "P2", 9: "P2"}
    assert "not read: code block (2 records, lines 6, 8)" in _notes(document)


@pytest.mark.parametrize(("second", "stations"), [(3, ["S1", "S2"]), (2, ["station 1"])])
def test_a_code_whose_stations_are_no_targets(tmp_path: Path, second: int, stations: list[str]) -> None:
    """A code before the readings opens set-ups, unless a single reading follows one of its blocks."""

    def sight(target: str) -> str:
        return f"*110001+{target:0>16} 21.322+{0:016d} 22.322+{10000000:016d} 31..00+{100000:016d} 87..10+{1500:016d}"

    def code(station: str) -> str:
        return f"*410002+{20:016d} 42....+{station:0>16} 43....+{1550:016d}"

    lines = [code("S1"), sight("P1"), sight("P2"), sight("P3")]
    lines.insert(second, code("S2"))
    lines += [sight("P1")] * (second == 3)
    document = _read(tmp_path, "b.gsi", "\n".join(lines))
    assert [row[1] for row in document.data["stations"][0]["rows"]] == stations


def test_gsi_blocks_in_one_line_heights_and_repeated_stations(tmp_path: Path) -> None:
    text = (
        "110001+0000000A 21.102+00000000 22.102+10000000 31..00+00010000 84..10+00001000 85..10+00002000 "
        "110002+0000000B 21.102+10000000 22.102+10000000 31..00+00020000 84..10+00001000 85..10+00002000 "
        "88..10+00001500 110003+0000000A 21.102+00000000 22.102+10000000 31..00+00010000 84..10+00005000 "
        "85..10+00006000 88..10+00001600"
    )
    document = _read(tmp_path, "b.gsi", text)
    assert len(_rows(document, "zenith_directions")) == 3
    assert [row[2] for row in document.data["stations"][0]["rows"]] == ["0.0", "1.5", "1.6"]


SDR = "00NMSDR33V04-01     000001-Jan-20 14:20:113111\n"


def _sdr(kind: str, *cells: str) -> str:
    return kind + "".join(f"{cell:<16}" if k or kind[:2] == "03" else f"{cell:>16}" for k, cell in enumerate(cells))


def _sdr_sight(station: str, target: str, slope: float, zenith: float, hz: float, kind: str = "09F1") -> str:
    return f"{kind}{station:>16}{target:>16}{slope:<16}{zenith:<16}{hz:<16}"


def test_computed_coordinates_of_sdr_are_no_observations(tmp_path: Path) -> None:
    lines = [
        _sdr("08KI", "A", "100.0", "200.0", "10.0"),
        _sdr("02TP", "S1", "150.0", "200.0", "10.0", "1.5"),
        "03NM1.5",
        _sdr_sight("S1", "A", 50.0, 90.0, 180.0),
        _sdr_sight("S1", "S2", 30.0, 90.0, 90.0),
        _sdr("08TP", "S2", "150.0", "230.0", "10.0"),
        _sdr("02TP", "S2", "150.0", "230.0", "10.0", "1.6"),
        _sdr_sight("S2", "S1", 30.0, 90.0, 270.0),
        _sdr_sight("S2", "A", 58.31, 90.0, 211.0, kind="09MC"),
        "0000",
        "\x03",
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert _points(document) == {"A": [200.0, 100.0, 10.0], "S1": [200.0, 150.0, 10.0]}
    assert "coordinates that the instrument computed from its readings (2 records, lines 7–8)" in _notes(document)
    assert "observations reduced by the instrument (MC) (1 record" in _notes(document)


def test_computed_coordinates_of_a_station_that_no_sight_reached_are_given(tmp_path: Path) -> None:
    lines = [
        _sdr("02KI", "A", "100.0", "200.0", "10.0", "1.5"),
        _sdr_sight("A", "P", 5.0, 90.0, 0.0),
        _sdr("08TP", "B", "150.0", "230.0", "10.0"),
        _sdr("02TP", "B", "150.0", "230.0", "10.0", "1.6"),
        _sdr_sight("B", "A", 58.31, 90.0, 211.0),
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert _points(document) == {"A": [200.0, 100.0, 10.0], "B": [230.0, 150.0, 10.0]}


def test_azimuths_of_backsights_orient_stations_that_sight_no_known_point(tmp_path: Path) -> None:
    """The circle reads 30° at the backsight, whose azimuth is 90°: the azimuth of P is 60° more than its reading."""
    lines = [
        _sdr("02KI", "A", "100.0", "200.0", "10.0", "1.5"),
        _sdr("07TP", "A", "R", "90.0", "30.0"),
        _sdr_sight("A", "R", 8.0, 90.0, 30.0),
        _sdr_sight("A", "P", 5.0, 90.0, 100.0),
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert [row["bearing"] for row in _rows(document, "bearing")] == ["90.0", "160.0"]
    text = "CO,Angle Units: DDDMMSS\nMP,A,,100,200,10,\nST,A,,R,,1.5,90.0000,30.0000\nSS,P,1.5,5,100.0000,90.0000,,\n"
    document = _read(tmp_path, "b.raw", "CO,Nikon RAW data format V2.00\n" + text)
    assert {row["to"]: row["bearing"] for row in _rows(document, "bearing")} == {"R": "90.0", "P": "160.0"}


def _gsi(name: str, **words: str) -> str:
    """A block of GSI-16; names of words are w21_324."""
    cells = "".join(f"{key[1:].replace('_', '.')}+{value:>016} " for key, value in words.items())
    return f"*110001+{name:>016} {cells}\n"


def test_gsi_computed_coordinates_orient_and_tell_the_unit(tmp_path: Path) -> None:
    """S (100, 200) is written with a digit more than its unit says; P is 30 m east of it, the circle reads 80 gon."""
    station = _gsi("S", w84__10="1000000", w85__10="2000000", w86__="5000", w88__10="0")
    sight = {"w21_022": "8000000", "w22_022": "10000000", "w31__00": "30000"}
    sights = [
        _gsi("P", **sight, w81__00="130000", w82__00="200000", w83__00="5000"),
        _gsi("Q", **(sight | {"w21_022": "18000000"}), w81__00="100000", w82__00="170000", w83__00="5000"),
    ]
    document = _read(tmp_path, "b.gsi", station + "".join(sights))
    assert _points(document) == {"S": [100.0, 200.0, 5.0]}
    assert "10 times those from which the instrument computed" in _notes(document)
    assert [float(row["bearing"]) for row in _rows(document, "bearing")] == pytest.approx([100.0, 200.0])
    turned = sights[0] + sights[1].replace("18000000", "17000000")
    document = _read(tmp_path, "b.gsi", station + turned)
    assert not _rows(document, "bearing"), "computed coordinates of another orientation"


def test_given_coordinates_beyond_the_reach_of_sights_are_left_out(tmp_path: Path) -> None:
    """A is 20 km from B and C though 90 m of sights lead to them; B and C agree."""
    lines = [
        *(_sdr("08KI", name, "0.0", x, "7.0") for name, x in (("A", "20000.0"), ("B", "100.0"), ("C", "150.5"))),
        _sdr("02TP", "S", "", "", "", "1.5"),
        *(_sdr_sight("S", name, 45.0, 90.0, hz) for name, hz in (("A", 0.0), ("B", 90.0), ("C", 158.0))),
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert set(_points(document)) == {"B", "C"}
    assert "farther from other given ones, or nearer, than the sights between them allow (1 record, lines 2)" in _notes(
        document
    )


@pytest.mark.parametrize(("rough", "used"), [(90.1, 2), (90.001, 3)])
def test_rough_zenith_angles_of_pointings(tmp_path: Path, rough: float, used: int) -> None:
    sights = [("B", "", rough, 0.0), ("P", 20.0, 91.0, 50.0), ("B", 60.0, 90.0, 0.0)]
    lines = [f"09F1{'S':>16}{to:>16}{slope:<16}{zenith:<16}{hz:<16}" for to, slope, zenith, hz in sights]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join([_sdr("02TP", "S", "", "", "", "1.5"), *lines]))
    assert len(_rows(document, "zenith_directions")) == used
    assert ("which are rough" in _notes(document)) is (used == 2)


@pytest.mark.parametrize(("slope", "is_given"), [(50.0, True), (70.0, False)])
def test_an_origin_at_0_is_given_if_distances_fit_it(tmp_path: Path, slope: float, is_given: bool) -> None:
    lines = [
        _sdr("02TP", "O", "0.0", "0.0", "0.0", "1.5"),
        _sdr("08KI", "B", "30.0", "40.0", "1.0"),
        _sdr_sight("O", "B", slope, 90.0, 53.13),
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert ("O" in _points(document)) is is_given
    assert ("all 0" in _notes(document)) is not is_given


def test_a_resection_of_sdr_precedes_its_station(tmp_path: Path) -> None:
    """The readings of the last attempt count; the station and its coordinates follow from them."""
    lines = [
        _sdr("08KI", "A", "100.0", "100.0", "10.0"),
        _sdr("08KI", "B", "100.0", "200.0", "10.0"),
        "13NMStart of Resection",
        _sdr_sight("0", "A", 1.0, 90.0, 5.0, kind="13F1"),
        "13NMStart of Resection",
        _sdr_sight("0", "A", 50.0, 90.0, 0.0, kind="13F1"),
        _sdr_sight("0", "B", 50.0, 90.0, 180.0, kind="13F1"),
        _sdr("08KI", "S", "100.0", "150.0", "10.0"),
        _sdr("02KI", "S", "100.0", "150.0", "10.0", "0.0"),
        _sdr_sight("S", "D", 20.0, 90.0, 270.0),
    ]
    document = _read(tmp_path, "b.sdr", SDR + "\n".join(lines))
    assert set(_points(document)) == {"A", "B"}
    assert _station_of_lines(document) == {7: "S", 8: "S", 11: "S"}
    circle = {row["to"]: float(row["horizontal"]) for row in _rows(document, "zenith_directions")}
    assert circle == {"A": pytest.approx(270.0), "B": pytest.approx(90.0), "D": pytest.approx(270.0)}
    assert "sights of a resection that was started again (1 record, lines 5)" in _notes(document)
    assert "was turned when its station was recorded" in _notes(document)


def _m5(what: str, *values: str) -> str:
    return f"For M5|Adr 1|{what}|" + "|".join(f"{value:<22}" for value in (*values, "", "", "")[:3]) + "|"


def test_m5_heights_follow_the_station_and_end_closes(tmp_path: Path) -> None:
    line = _m5
    text = "\n".join(
        [
            line("TI      KN STAT"),
            line("PI1           A      B", "", "Hz 110.0849 DMS", "V1 90.0000 DMS"),
            line("PI1           S      S1", "Y 5.0 m", "X 6.0 m", "Z 7.0 m"),
            line("TI", "", "Om 249.5111 DMS"),
            line("TI      INPUT", "th 1.300 m", "ih 1.645 m"),
            line("PI1                  P", "SD 10.0 m", "Hz 0.0000 DMS", "V1 90.0000 DMS"),
            line("PI1                  P", "Y 5.0 m", "X 16.0 m", "Z 7.3 m"),
            line("PI1                  Q", "SD 10.0 m", "Hz 90.0000 DMS", "V1 90.0000 DMS"),
            "END",
        ]
    )
    document = _read(tmp_path, "b.m5", text)
    assert document.data["stations"][0]["rows"] == [["S1", "S1", "1.645"]]
    assert set(_points(document)) == {"S1"}
    bearings = [float(row["bearing"]) for row in _rows(document, "bearing")]
    assert bearings == pytest.approx([0.0, 0.0, 90.0]), "the circle was turned by Om: what it reads then are azimuths"
    assert [row["to"] for row in _rows(document, "zenith_angle")] == ["P", "Q"], "B has no heights"
    assert "Om" not in _notes(document)


@pytest.mark.parametrize("before", [False, True])
def test_m5_directions_of_stations_by_om(tmp_path: Path, before: bool) -> None:
    """S1 at the origin sees S2 alone of the points of S2: the azimuths after Om join the two, and P lies at (30, 40).

    The station record follows Om or stands before it, and the origin has a second name, H, without a height.
    """
    places = {"S1": (0.0, 0.0), "S2": (30.0, 0.0), "P": (30.0, 40.0), "Q": (10.0, 20.0)}

    def sight(station: str, target: str, turn: float = 0.0) -> str:
        east, north = (b - a for a, b in zip(places[station], places[target], strict=True))
        azimuth = 200.0 / pi * atan2(east, north)
        values = (f"SD {hypot(east, north):.4f} m", f"Hz {(azimuth - turn) % 400.0:.5f} gon", "V1 100.0 gon")
        return _m5(f"PI1                  {target}", *values)

    def stationing(station: str, turn: float, back: str) -> list[str]:
        east, north = places[station]
        record = _m5(f"PI1           S      {station}", f"Y {east} m", f"X {north} m", "Z 0.0 m")
        om = _m5("TI", "", f"Om {turn:.4f} gon")
        return [_m5("TI      KN STAT"), back, *([om, record] if before else [record, om])]

    heights = _m5("TI      INPUT", "th 1.5 m", "ih 1.5 m")
    lines = [
        *stationing("S1", 50.0, _m5("PI1           A      0", "", "Hz 10.0 gon", "V1 100.0 gon")),
        *(heights, sight("S1", "S2"), sight("S1", "Q")),
        *(_m5("PI1                  Q", "Y 10.0 m", "X 20.0 m", "Z 0.0 m"), _m5("TI      KN STAT")),
        _m5("PI1           A      H", "Y 0.0 m", "X 0.0 m"),
        *stationing("S2", 20.0, _m5("PI1           A      H", "", "Hz 280.0 gon", "V1 100.0 gon")),
        *(heights, sight("S2", "P"), _m5("PI1                  P", "Y 30.0 m", "X 40.0 m", "Z 0.0 m")),
    ]
    document = _read(tmp_path, "b.m5", "\n".join(lines))
    assert _points(document) == {"S1": [0.0, 0.0, 0.0]}
    bearings = {(row["from"], row["to"]): float(row["bearing"]) for row in _rows(document, "bearing")}
    assert bearings[("S1", "S2")] == pytest.approx(100.0, abs=1e-4)
    result = mor.adjust(str(tmp_path / "b.m5"))
    points = result.project.network.things["point"]
    found = result.solved.adjustment.values["point"][points.part("P", "position")]
    assert found == pytest.approx([30.0, 40.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("face", [1, 2])
def test_m5_targets_beside_the_point(tmp_path: Path, face: int) -> None:
    """The prism stands 0.1 m before the point, 0.3 m to the right, and 0.2 m to the left of it."""
    to_point = {"Tv": (0.0, 0.1), "Tr": (-0.3, 0.0), "Tl": (0.2, 0.0)}
    lines = [_m5("PI1           S      S1", "Y 5.0 m", "X 6.0 m", "Z 7.0 m"), _m5("TI", "th 1.0 m", "ih 1.5 m")]
    vertical, turned = ("V1 90.0 gon", 0.0) if face == 1 else ("V1 310.0 gon", 200.0)
    readings = ("SD 10.0 m", f"Hz {100.0 + turned} gon", vertical)
    for name, (right, ahead) in to_point.items():
        lines += [_m5(f"PI1           7      {name}", f"{name} {abs(right or ahead)} m")]
        lines += [_m5(f"PI1           7      {name}", *readings)]
        lines += [_m5(f"PI1           7      {name}", "Y 0.0 m", "X 0.0 m", "Z 8.0 m")]
    lines += [_m5("PI1           7      B", *readings), _m5("PI1           7      C", "Tv 0.1 m")]
    lines += [_m5("PI1           7      C", "", *readings[1:])]
    document = _read(tmp_path, "b.m5", "\n".join(lines))
    slopes = {row["to"]: float(row["distance"]) for row in _rows(document, "distance")}
    plan, rise = 10.0 * cos(pi / 20), 10.0 * sin(pi / 20)
    for row in _rows(document, "zenith_directions"):
        right, ahead = to_point.get(row["to"], (0.0, 0.0))
        length = hypot(plan + ahead, right)
        zenith = atan2(length, rise) * 200.0 / pi
        assert slopes[row["to"]] == pytest.approx(hypot(length, rise), abs=1e-9)
        assert float(row["zenith"]) == pytest.approx(zenith if face == 1 else 400.0 - zenith, abs=1e-9)
        direction = 100.0 + turned + atan2(right, plan + ahead) * 200.0 / pi
        assert float(row["horizontal"]) == pytest.approx(direction, abs=1e-9)
    assert set(slopes) == {"Tv", "Tr", "Tl", "B"}
    assert "beside the point (Tv, Tr, Tl) (1 record" in _notes(document)


def test_nikon_stations_backsights_and_uploaded_points(tmp_path: Path) -> None:
    """A sight that reads something else than the circle was set to was made before."""
    text = "\n".join(
        [
            "CO,Ruide Raw data",
            "CO,Angle Units: DDDMMSS",
            "CO,Coord Order: ENZ",
            "UP,A,,100.0,200.0,5.0,",
            "UP,B,,100.0,300.0,5.0,",
            "ST,A,,B,,1.5,0.0000,0.0000",
            "F1,B,1.5,100.0,13.1726,90.0000, 09:00:28",
            "SS,P,1.3,20.0,90.0000,90.0000, 09:01:11,",
            "CC,P,,120.0,200.0,5.0,",
            "CO,3pt Resection",
            "F1,A,1.5,20.0,0.0000,90.0000, 09:02:00",
            "F1,B,1.5,102.0,90.0000,90.0000, 09:02:30",
            "ST,S,,,,1.4,0.0000,0.0000",
            "SS,Q,1.3,5.0,10.0000,90.0000, 09:03:00,",
        ]
    )
    path = tmp_path / "book.sdr"
    path.write_text(text)
    assert format_of(path) == "nikon", "by its records, whatever the suffix"
    document = read_foreign(path)
    assert _station_of_lines(document) == {6: "A", 7: "A", 8: "A", 11: "S", 12: "S", 14: "S"}
    assert set(_points(document)) == {"A", "B"}
    sets = {(r["station"], r["to"]): r.get("set") for r in _rows(document, "directions")}
    assert sets == {("A", "B"): "2"}, "the reading of the circle at the backsight is in the set of the side shots"


def test_geodimeter_labels(tmp_path: Path) -> None:
    """Both faces from 24 and 17; coordinates of a point with readings are computed, those of 62 are its own."""
    text = "2=S\n37=10.0\n38=20.0\n39=5.0\n62=R\n37=110.0\n38=20.0\n3=1.6\n23=1112\n"
    text += "5=P\n6=1.3\n24=100.0000\n25=100.0000\n17=300.0000\n18=300.0000\n9=50.0\n37=10.0\n38=75.0\n39=5.3\n"
    text += "5=Q\n7=50.0000\n8=100.0000\n9=0.000\nEND\n"
    document = _read(tmp_path, "b.job", text)
    assert _points(document)["S"][:2] == [20.0, 10.0]
    assert set(_points(document)) == {"S", "R"}
    assert document.data["stations"][0]["rows"] == [["S", "S", "1.6"]]
    faces = [(r["to"], r["face"], float(r["horizontal"])) for r in _rows(document, "zenith_directions")]
    assert faces == [("P", "1", 100.0), ("P", "2", 300.0), ("Q", "1", 50.0)]
    assert len(_rows(document, "distance")) == 1
    assert document.data["units"]["angle"] == "gon"


def test_rw5_takes_the_later_coordinates_and_those_of_gnss(tmp_path: Path) -> None:
    text = (
        "--a book that begins with comments\nSP,PN104,N 5000.0,E 2100.0,EL0.0,--B\nGPS,PNG1,LA45.1,LN-66.0,EL23.4,--\n"
        "--GS,PNG1,N 5000.0,E 2000.0,EL500.0,--\n--GS,PNG1,N x,E 2000.0,EL500.0,--\n"
        "OC,OP104,N 5000.0,E 2100.0,EL510.0,--B\nLS,HI1.5,HR1.5\nBK,OP104,BPG1,BS270.0000,BC0.0000\n"
        "BD,OP104,FPG1,AR0.0000,ZE95.4238,SD100.499,--A\nSP,PNG1,N 5000.1,E 2000.0,EL500.0,--A\n"
    )
    document = _read(tmp_path, "b.rw5", text)
    assert _points(document) == {"104": [2100.0, 5000.0, 510.0], "G1": [2000.0, 5000.0, 500.0]}
    assert "1 point with other coordinates later in the book, which replace the earlier ones: 104 (line 2" in _notes(
        document
    )
    assert "computed from its readings (1 record, lines 10)" in _notes(document)


LANDXML = """<?xml version="1.0"?>
<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2">
<Units><Metric linearUnit="meter" angularUnit="grads" directionUnit="grads"/></Units>
<CgPoints><CgPoint name="A" oID="1">100 200 5</CgPoint><CgPoint name="P" oID="2">150 200 5</CgPoint></CgPoints>
<Survey><InstrumentSetup id="s" stationName="A" instrumentHeight="1.5"/>
<ObservationGroup setupID="s">
<RawObservation azimuth="0.0" horizAngle="10" zenithAngle="100" slopeDistance="50" horizDistance="50"
 targetHeight="1.5">
<TargetPoint name="P">150 200 5</TargetPoint></RawObservation>
<ReducedObservation azimuth="0" horizDistance="20"><TargetPoint name="Q"/></ReducedObservation>
<ReducedObservation azimuth="0" horizDistance="30"><TargetPoint name="R"/></ReducedObservation>
</ObservationGroup></Survey>{leica}</LandXML>
"""


@pytest.mark.parametrize("measured", [True, False])
def test_derived_values_of_landxml(tmp_path: Path, measured: bool) -> None:
    """Azimuths beside circle readings, and 0 to several targets, are none; nor are points that Leica calls measured."""
    leica = '<HexagonLandXML><Point uniqueID="2" class="measured"/></HexagonLandXML>' if measured else ""
    document = _read(tmp_path, "b.xml", LANDXML.format(leica=leica))
    # The azimuth of P in its coordinates orients the set-up: 0, not the reading 10 nor the azimuth of others.
    assert [(row["to"], float(row["bearing"])) for row in _rows(document, "bearing")] == [("P", 0.0)] * measured
    assert [row["to"] for row in _rows(document, "horizontal_distance")] == ["Q", "R"]
    assert set(_points(document)) == ({"A"} if measured else {"A", "P"})
    notes = _notes(document)
    for words in (
        "azimuth that is computed (1",
        "azimuths 0 to several targets of a set-up (2",
        "horizDistance that",
    ):
        assert words in notes


def test_idx_classes_tell_given_from_computed(tmp_path: Path) -> None:
    text = (
        "HEADER\n\tUNITS\n\t\tANGULAR GON\n\t\tLINEAR METRE\n\tEND UNITS\nEND HEADER\nDATABASE\n"
        "\tPOINTS(PointNo, PointID, East, North, Elevation, Code, Date, CLASS)\n"
        '\t\t1,\t"A", 1.0, 2.0, 3.0,"",\t,\tCTRL;\n\t\t2,\t"B", 16.0, 2.0, 3.0,"",\t,\tMEAS;\n'
        '\t\t3,\t"C", 12.0, 2.0, 3.0,"",\t,\tAVGE;\n\tEND POINTS\n'
        '\tSETUP\n\t\tSTN_NO 1\n\t\tSTN_ID "A"\n\t\tINST_HT 1.5;\n\tEND SETUP\n'
        "\tSLOPE(TgtNo, TgtID, CfgNo, Hz, Vz, SDist, RefHt)\n"
        '\t\t2,\t"B",\t1,\t0.0,\t100.0,\t10.0,\t1.5;\n\t\t3,\t"C",\t1,\t1.0,\t100.0,\t0.0,\t1.5;\n\tEND SLOPE\n'
    )
    document = _read(tmp_path, "b.idx", text)
    assert set(_points(document)) == {"A"}
    assert len(_rows(document, "distance")) == 1, "a circle reading without a distance is no distance of 0"
    assert len(_rows(document, "zenith_directions")) == 2


def test_a_point_of_a_job_without_a_station_belongs_to_the_last_one(tmp_path: Path) -> None:
    circle = "<Circle><HorizontalCircle>1</HorizontalCircle><VerticalCircle>90</VerticalCircle></Circle>"
    records = "".join(
        f"<PointRecord><Name>{name}</Name><Method>DirectReading</Method>{circle}"
        "<ComputedGrid><North>1</North><East>2</East><Elevation>3</Elevation></ComputedGrid></PointRecord>"
        for name in "AB"
    )
    text = (
        '<!-- a comment with <LandXML> in it -->\n<JOBFile jobName="j"><FieldBook><StationRecord ID="7">'
        f"<StationName>S</StationName></StationRecord>{records}</FieldBook></JOBFile>"
    )
    document = _read(tmp_path, "b.jxl", text)
    assert {row["station"] for row in _rows(document, "zenith_directions")} == {"S"}
    assert not _points(document)


def test_gnss_points_have_the_precision_of_the_job(tmp_path: Path) -> None:
    """σ in plan is that of both coordinates together, of each of them the part 1 / √2."""
    place = "<East>2.0</East><North>1.0</North><Elevation>3.0</Elevation>"
    job = "".join(
        f"<PointRecord><Name>{name}</Name><Method>GpsRTK</Method><ECEFDeltas/><ComputedGrid>{place}</ComputedGrid>"
        f"<Precision><Horizontal>0.02</Horizontal><Vertical>0.03</Vertical></Precision></PointRecord>"
        for name in "AB"
    )
    text = "".join(
        f"GPS,PN{name},LA45.0,LN7.0,EL1.0\n--GS,PN{name},N 1.0,E 2.0,EL3.0\n--HRMS:0.020, VRMS:0.030, STATUS:FIXED\n"
        for name in "AB"
    )
    for file, content in (
        ("b.jxl", f'<JOBFile jobName="j"><FieldBook>{job}</FieldBook></JOBFile>'),
        ("b.rw5", f"JB,NMj\nMO,AD0,UN1\n{text}"),
    ):
        document = _read(tmp_path, file, content)
        table = document.data["points"][0]
        row = dict(zip(table["columns"], table["rows"][1], strict=True))
        assert [float(row[name]) for name in ("x", "y", "z")] == [2.0, 1.0, 3.0]
        sigmas = [float(row[f"sigma_{name}"]) for name in "xyz"]
        assert sigmas == pytest.approx([0.02 / 2**0.5, 0.02 / 2**0.5, 0.03])
        assert "says none" not in " ".join(map(str, document.notes))


@pytest.mark.parametrize("known", ["", " 84..40+0000000000500000 85..40+0000000000600000 86..40+0000000000010000"])
def test_one_set_up_solves_with_and_without_coordinates(tmp_path: Path, known: str) -> None:
    """Knowing more never solves less; with coordinates the station keeps them."""
    lines = [f"*110001+000000000000000A{known} 88..10+0000000000001550"]
    lines += [
        f"*11000{k}+000000000000000{name} 21.322+{hz:016d} 22.322+0000000010000000 31..00+{d:016d} "
        "87..10+0000000000001550"
        for k, (name, hz, d) in enumerate([("B", 0, 60000), ("C", 5000000, 45000), ("D", 11000000, 35000)], 2)
    ]
    solved = solve_network(network_of(_read(tmp_path, "b.gsi", "\n".join(lines)), tmp_path))
    points = solved.network.things["point"]
    values = solved.adjustment.values["point"]
    places = {name: values[points.part(name, "position")] for name in points.ids}
    for name, length in (("B", 60.0), ("C", 45.0), ("D", 35.0)):
        assert np.linalg.norm(places[name] - places["A"]) == pytest.approx(length, abs=1e-4)
    if known:
        # Start values are plane and the datum is free, so the curvature over 60 m moves all points by tenths of a mm.
        assert places["A"] == pytest.approx([500.0, 600.0, 10.0], abs=5e-4)


def test_a_name_used_again_elsewhere_is_another_point(tmp_path: Path) -> None:
    """Two sights of one set-up whose distances differ by metres are not to one point; in the other face they are."""
    rows = [
        ("P", 0, 10000000, 20000),
        ("P", 20000000, 30000000, 20000),
        ("P", 0, 10000000, 35000),
        ("Q", 1, 9000000, 9),
    ]
    lines = ["*110001+000000000000000A 88..10+0000000000001550"]
    lines += [
        f"*11000{k}+{name:0>16} 21.322+{hz:016d} 22.322+{v:016d} 31..00+{d:016d} 87..10+0000000000001550"
        for k, (name, hz, v, d) in enumerate(rows, 2)
    ]
    document = _read(tmp_path, "b.gsi", "\n".join(lines))
    assert [row["to"] for row in _rows(document, "zenith_directions")] == ["P", "P", "P (2)", "Q"]
    assert "1 name used again for points elsewhere" in _notes(document)


def test_a_book_without_heights_is_in_the_plane(tmp_path: Path) -> None:
    text = "".join(f"2=S{k}\n23=1112\n5=A\n7={hz}\n11=50.0\n5=B\n7=80.0\n11=40.0\n" for k, hz in enumerate((0.5, 9.0)))
    assert _read(tmp_path, "b.job", text).data["settings"]["dimensions"] == "xy"


def test_points_without_readings_say_that_records_were_left_out(tmp_path: Path) -> None:
    text = "JB,NMjob\nMO,AD0,UN1\nSP,PNA,N 10,E 20,EL1\nGPS,PN1,LA45.1,LN-66.0,EL3.0\n"
    with pytest.raises(InputError, match="no observations: GNSS positions, as in this file, are read as points"):
        network_of(_read(tmp_path, "a.rw5", text), tmp_path)
    text = "JB,NMjob\nMO,AD0,UN1\nSP,PNA,N 10,E 20,EL1\n"
    with pytest.raises(InputError, match="no observations, only points; mor convert lists what was not read"):
        network_of(_read(tmp_path, "b.rw5", text), tmp_path)


def test_the_units_of_a_commented_record_count_if_there_is_no_other(tmp_path: Path) -> None:
    book = "OC,OPA,N 0,E 0,EL0\nLS,HI5.0,HR0\nSS,OPA,FPB,AR10.0,ZE90.0,SD100.0\n"
    (row,) = _rows(_read(tmp_path, "a.rw5", f"--MO,AD0,UN0,SF1.0,EC0,EO0.0,AU0\n{book}"), "distance")
    assert float(row["distance"]) == pytest.approx(30.48)
    (row,) = _rows(_read(tmp_path, "b.rw5", f"MO,AD0,UN1\n--MO,AD0,UN0\n{book}"), "distance")
    assert float(row["distance"]) == 100.0
    assert "no MO record tells the units" in _notes(_read(tmp_path, "c.rw5", book))


def test_a_stream_of_topcon_gts6(tmp_path: Path) -> None:
    """Lengths in mm or 0.1 mm, angles to 1 or 0.1 second; lines end anywhere, records may be incomplete."""
    text = (
        "_'S1_(X_)1.500_+A_ ?+00012345m0903015+3595930d+00012344***+00+00000_*_,1.400_+B_ W+0001234\n"
        "56m08959300-00010200d+0000000001+0000000002-0000000003***+0000+000000_*T_,1.60000_+C_ <0900000+0450000d"
        "_*_,1.2_+D_\n ?+0001"
        "_'S2_(_)1.700_+A_ ?+00020000m0900000+0000000d+00020000***_*_,1.300"
    )
    document = _read(tmp_path, "b.raw", text)
    names = ("horizontal", "zenith", "to_height")
    angles = [
        (row["station"], row["to"], *(float(row[name]) for name in names))
        for row in _rows(document, "zenith_directions")
    ]
    assert angles == [
        ("S1", "A", pytest.approx(359 + 59.5 / 60), pytest.approx(90 + 30.25 / 60), 1.4),
        ("S1", "B", pytest.approx(-(10 / 60 + 20 / 3600)), pytest.approx(89 + 59.5 / 60), 1.6),
        ("S1", "C", 45.0, 90.0, 1.2),
        ("S2", "A", 0.0, 90.0, 1.3),
    ]
    lengths = [(row["from"], row["to"], row["distance"], row["from_height"]) for row in _rows(document, "distance")]
    assert lengths == [
        ("S1", "A", "12.345", "1.5"),
        ("S1", "B", "12.3456", "1.5"),
        ("S2", "A", "20.0", "1.7"),
    ]
    assert "sights without readings (1 record" in _notes(document)


@pytest.mark.parametrize("turn", [0.0, 37.0])
def test_stations_without_a_name_stand_where_the_instrument_computed_from(tmp_path: Path, turn: float) -> None:
    """The first is over M, whose coordinates follow; then the instrument is moved. Other circles tell no place."""
    book = _Gsi(0, located=True)
    stations = {"M": np.array([500.0, 300.0, 21.5]), "": np.array([540.0, 260.0, 22.0])}
    for name, station in stations.items():
        for k, step in enumerate(([30, 5, 1], [-20, 40, 2], [7, -35, 0])):
            book.sight(name, station, f"{name}D{k}", station + step, turn, computed=True)
    book.line("M", *book.place("M", (500.0, 300.0, 20.0), 81))
    document = _read(tmp_path, "b.gsi", "\n".join(book.lines))
    names = set(_station_of_lines(document).values())
    if turn:
        assert names == {"station 1"}
        return
    assert "2 set-ups whose station the book does not name stand where the instrument computed" in _notes(document)
    assert _points(document) == {"M": [500.0, 300.0, 20.0], "station 2": [540.0, 260.0, 22.0]}
    heights = {row[1]: float(row[2]) for table in document.data["stations"] for row in table["rows"]}
    assert heights == {"M": 1.5, "station 2": 0.0}
    network = network_of(document, tmp_path)
    solved = solve_network(network)
    for name, station in stations.items():
        for k, step in enumerate(([30, 5, 1], [-20, 40, 2], [7, -35, 0])):
            number = network.blocks["point"].ids.index(f"{name}D{k}")
            assert solved.adjustment.values["point"][number] == pytest.approx(station + step, abs=2e-3)


def _sights_from(station: tuple[float, float], names: str, first: int) -> list[str]:
    """Sights to targets K, L, M, … at fixed places, in GSI-16."""
    book, lines = _Gsi(first, located=False), []
    book.lines = [""] * first
    for name in names:
        k = ord(name) - ord("K")
        target = (60.0 * np.cos(k), 60.0 * np.sin(k), 0.5 * k)
        book.sight("S", (*station, 0.0), name, target, 50.0 * first, computed=False)
        lines.append(book.lines[-1])
    return lines


def test_an_instrument_moved_without_a_record_is_named(tmp_path: Path) -> None:
    """Targets are sighted again that have the same distances from each other, but not from the instrument."""
    head = "*110001+000000000000000S 84..10+0000000000000000 85..10+0000000000000100 86..10+0000000000000000"
    moved = [head, *_sights_from((0.0, 0.1), "KLMNO", 1), *_sights_from((20.0, -15.0), "LNKPQ", 6)]
    document = _read(tmp_path, "a.gsi", "\n".join(moved))
    with pytest.raises(
        InputError, match="only points; not read: sights of set-ups during which the instrument was mov"
    ):
        network_of(document, tmp_path)
    again = [head, *_sights_from((0.0, 0.1), "KLMNO", 1), *_sights_from((0.0, 0.1), "LNKPQ", 6)]
    assert len(_rows(_read(tmp_path, "b.gsi", "\n".join(again)), "distance")) == 10, "the circle was turned"
    others = [line.replace(f"000{name}", f"000{other}") for line in again[6:] for name, other in ("LK", "NL", "KN")]
    document = _read(tmp_path, "c.gsi", "\n".join([*again[:6], *others]))
    assert "instrument was moved" not in _notes(document)


def test_sights_straight_up_are_left_out(tmp_path: Path) -> None:
    book = "JB,NMj\nMO,AD0,UN1,AU0\nOC,OPA,N 0,E 0,EL0\nLS,HI1.5,HR0\n"
    book += "SS,OPA,FPB,AR55.0552,ZE0.0001,SD12.5\nSS,OPA,FPC,AR10.0,ZE80.0,SD12.5\n"
    document = _read(tmp_path, "a.rw5", book)
    assert [row["to"] for row in _rows(document, "distance")] == ["C"]
    assert "sights straight up or down, whose horizontal direction means nothing (1 record, lines 5)" in _notes(
        document
    )


@pytest.mark.parametrize(("minutes", "unit"), [("45.1731", "deg"), ("45.1764", "gon")])
def test_angles_of_an_rw5_job_in_gon_may_be_degrees(tmp_path: Path, minutes: str, unit: str) -> None:
    book = "JB,NMj\nMO,AD0,UN1,AU1\nOC,OPA,N 0,E 0,EL0\nLS,HI1.5,HR0\n"
    book += "".join(f"SS,OPA,FP{k},AR1{k}.3{k}2{k},ZE9{k}.1{k}4{k},SD12.5\n" for k in range(5))
    document = _read(tmp_path, "a.rw5", f"{book}SS,OPA,FPX,AR{minutes},ZE80.01,SD12.5\n")
    assert document.data["units"]["angle"] == unit
    assert ("the job says gon, but no angle has 60" in _notes(document)) == (unit == "deg")


def test_given_points_near_to_each_other_leave_the_orientation_to_the_circle(tmp_path: Path) -> None:
    """A station that was entered twice, 5 cm apart: the azimuths of the circle hold."""
    book = _Gsi(0, located=True)
    for name, place in (("A", (1000.0, 500.0, 10.0)), ("A2", (1000.05, 500.0, 10.0))):
        book.line(name, *book.place(name, place, 84), book.word("88", 0.0))
        for k, step in enumerate(([30, 5, 1], [-20, 40, 2])):
            book.sight(name, place, f"D{k}", np.add((1000.0, 500.0, 10.0), step), 0.0, computed=True)
    document = _read(tmp_path, "b.gsi", "\n".join(book.lines))
    bearings = [float(row["bearing"]) for row in _rows(document, "bearing")]
    assert bearings == pytest.approx(np.degrees(np.arctan2([30, -20], [5, 40])) / 0.9 % 400, abs=1e-3)


@pytest.mark.parametrize("pad", [8, 0])
def test_keys_of_gts7_may_end_with_one_blank(tmp_path: Path, pad: int) -> None:
    rows = (("STN", "S,1.5,"), ("XYZ", "10,20,30"), ("SS", "A,1.3,"), ("SD", "45.0000,89.3000,50.0"))
    text = "".join(f"{key:{pad}} {cells}\n" for key, cells in rows)
    (row,) = _rows(_read(tmp_path, "a.gt7", text), "zenith_directions")
    assert [row["station"], row["to"], row["to_height"], row["zenith"]] == ["S", "A", "1.3", "89.5"]


def test_one_sight_at_a_station_with_large_coordinates_solves(tmp_path: Path) -> None:
    lines = [_sdr("02TP", "S", "1045000.0", "745000.0", "300.0", "1.5"), _sdr_sight("S", "A", 45.0, 90.0, 10.0)]
    solved = solve_network(network_of(_read(tmp_path, "b.sdr", SDR + "\n".join(lines)), tmp_path))
    station, target = solved.adjustment.values["point"]
    assert np.hypot(*(target - station)[:2]) == pytest.approx(45.0, abs=1e-4)


def test_a_target_height_of_gsi_holds_until_another_one(tmp_path: Path) -> None:
    sight = {"w21_022": "8000000", "w22_022": "10000000", "w31__00": "30000"}
    book = [
        _gsi("S", w84__10="100000", w85__10="200000", w86__10="5000", w87__10="1500", w88__10="1600"),
        _gsi("P", **sight),
        _gsi("Q", **sight, w87__10="1700"),
        _gsi("R", **sight),
    ]
    rows = _rows(_read(tmp_path, "b.gsi", "".join(book)), "distance")
    assert [row["to_height"] for row in rows] == ["1.5", "1.7", "1.7"]


def test_negative_degrees_of_gsi(tmp_path: Path) -> None:
    """A circle reading of −4° 30′; an elevation of −0° 43′ is no zenith angle."""
    book = _gsi("S", w84__10="100000", w85__10="200000") + _gsi(
        "P", w21_324="430000", w22_324="9000000", w31__00="9000"
    )
    book += _gsi("Q", w21_324="0", w22_324="43000", w31__00="9000")
    book = book.replace("21.324+0000000000430000", "21.324-0000000000430000").replace(
        "22.324+000000000004", "22.324-000000000004"
    )
    document = _read(tmp_path, "b.gsi", book)
    assert [row["horizontal"] for row in _rows(document, "zenith_directions")] == ["-4.5"]
    assert "sights with an impossible zenith angle (1 record" in _notes(document)


@pytest.mark.parametrize(("zero", "zenith"), [("31", ["5.275", "184.5"]), ("32", ["84.725", "265.5"])])
def test_sdr_vertical_angles_from_the_horizon(tmp_path: Path, zero: str, zenith: list[str]) -> None:
    """The record of the instrument says where vertical angles are 0; from the horizon they go on in face 2."""
    lines = [
        f"01NM:{'SET 5':16}123456{'SET 5':16}123456{zero}0.00000000",
        _sdr("02TP", "S", "10.0", "20.0", "30.0", "1.5"),
        _sdr_sight("S", "A", 45.0, 5.275, 10.0),
        _sdr_sight("S", "A", 45.0, 184.5, 190.0).replace("09F1", "09F2"),
    ]
    rows = _rows(_read(tmp_path, "b.sdr", SDR + "\n".join(lines)), "zenith_directions")
    assert [float(row["zenith"]) for row in rows] == pytest.approx([float(value) for value in zenith])


def test_a_target_height_of_nikon_holds_until_another_one(tmp_path: Path) -> None:
    head = "CO,Nikon RAW data format V2.00\nCO,Dist Units: Metres\nCO,Angle Units: Gons\nST,S,,,,1.5,0.0,0.0\n"
    book = (
        head + "SS,A,1.6,10.0,50.0,99.0,10:00:00,\nF2,A,,10.0,250.0,301.0,10:00:30\nSS,B,1.7,9.0,60.0,98.0,10:01:00,\n"
    )
    rows = _rows(_read(tmp_path, "b.raw", book), "distance")
    assert [row["to_height"] for row in rows] == ["1.6", "1.6", "1.7"]


def test_a_circle_of_a_trimble_m3_that_is_set_anew_is_another_set_up(tmp_path: Path) -> None:
    """The book names no station, and a comment may give another height of the instrument before."""
    lines = [
        "CO,Nikon RAW data format V2.00",
        "CO,Dist Units: Metres",
        "CO,Angle Units: Gons",
        "CO,TI  HOLD      Hz         0.0000 grd",
        "CO,TI  INPUT     th          2.000 m    ih          1.500 m",
        "SS,1,2.000,12.0,104.4,99.1,11:50:34,",
        "CO,TI  INPUT     th          2.000 m    ih          1.480 m",
        "CO,TI  HOLD      Hz         0.0000 grd",
        "SS,2,2.000,13.0,76.8,97.3,11:29:01,",
        "CO,TI  Hz=0      Hz         0.0000 grd",
        "SS,3,2.000,14.0,98.3,97.3,11:07:01,",
    ]
    rows = _rows(_read(tmp_path, "m3.raw", "\n".join(lines)), "distance")
    assert [(row["from"], row["to"]) for row in rows] == [("station 1", "1"), ("station 2", "2"), ("station 3", "3")]
    assert [row["from_height"] for row in rows] == ["1.5", "1.48", "1.48"]


def test_a_list_of_a_nikon_dtm_300(tmp_path: Path) -> None:
    """B lies 30 m from A and 4 m above it; P has mils and feet of its own, and Q was deleted."""
    zenith = 100.0 - atan2(4.0 + 1.8 - 1.5, 30.0) * 200.0 / pi
    back = 100.0 + atan2(4.0 + 1.6 - 1.2, 30.0) * 200.0 / pi
    text = "\n".join(
        [
            "1 , 2 , MG , A--1.500, 0.000, 0.000",
            f"1 , 0 , MG , B , {hypot(30.0, 4.3):.4f} , 0.0000 , {zenith:.5f} , 1.800",
            "1 , 0 , FM , P , 10.000 , 1600.0 , 1600.0 , 1.000",
            "0 , 0 , MG , Q , 5.000 , 0.0000 , 100.0 , 1.800",
            "1 , 1 , MG , B , 30.000 , 0.000",
            "1 , 2 , MG , B-1.60, 30.000, 0.000",
            f"1 , 0 , MG , A , {hypot(30.0, 4.4):.4f} , 50.0000 , {back:.5f} , 1.200",
            "1 , 3 , MG , C , 1.000 , 2.000 , 3.000",
        ]
    )
    document = _read(tmp_path, "a.nik", text)
    assert format_of(tmp_path / "a.nik") == "nikon"
    assert document.data["stations"][0]["rows"] == [["A", "A", "1.5"], ["B", "B", "1.6"]]
    sights = {(row["station"], row["to"]): row for row in _rows(document, "zenith_directions")}
    assert set(sights) == {("A", "B"), ("A", "P"), ("B", "A")}
    assert [float(sights["A", "P"][key]) for key in ("horizontal", "zenith", "to_height")] == pytest.approx(
        [100.0, 100.0, 1200 / 3937]
    )
    assert float(_rows(document, "distance")[1]["distance"]) == pytest.approx(10 * 1200 / 3937)
    notes = _notes(document)
    for words in ("records that were deleted (1 record, lines 4)", "station A: the height of the instrument behind --"):
        assert words in notes
    result = mor.adjust(str(tmp_path / "a.nik"))
    assert result.solved.quality.sigma0 == pytest.approx(0.0, abs=0.3)
    sexagesimal = "1,2,MD,A-1.5\n1,0,MD,B,30.0,90.3000,88.1530,1.8\n1,0,MG,C,30.0,50.0,90.0,1.8\n"
    first, second = _rows(_read(tmp_path, "b.nik", sexagesimal), "zenith_directions")
    assert float(first["zenith"]) == pytest.approx(88.0 + 15.5 / 60.0)
    assert [float(row["horizontal"]) for row in (first, second)] == pytest.approx([90.5, 45.0])
    with pytest.raises(InputError, match=r"c\.nik:3: found '1 , 5 , MG , x', expected a state"):
        _read(tmp_path, "c.nik", "\n".join(text.splitlines()[:2]) + "\n1 , 5 , MG , x\n")
