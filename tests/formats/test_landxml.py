"""LandXML surveys: a network in every unit, a plan of bearings and distances, what is left out, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.errors import InputError
from mor.formats import format_of, read_foreign

from .test_field_books import HEIGHTS, PLACES, TARGET, _readings

_HEAD = '<?xml version="1.0"?>\n<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">\n'
METRES = {"meter": 1.0, "foot": 0.3048, "USSurveyFoot": 1200 / 3937, "millimeter": 1e-3}


def _angle(gon: float, unit: str) -> str:
    if not unit.endswith("dd.mm.ss"):
        return repr(float(gon) * {"radians": np.pi / 200, "grads": 1.0, "decimal degrees": 0.9}[unit])
    micro = round(gon * 0.9 * 3600e6)
    degrees, rest = divmod(micro, 3600_000_000)
    minutes, seconds = divmod(rest, 60_000_000)
    return f"{degrees}.{minutes:02d}{seconds:08d}"


def survey(length: str = "meter", angle: str = "decimal dd.mm.ss") -> str:
    """The network of the field books: two points with coordinates, one named by what refers to it, one free."""
    metres = METRES[length]
    system = "Imperial" if "oot" in length else "Metric"
    lines = [f'<Units><{system} linearUnit="{length}" angularUnit="{angle}" directionUnit="{angle}"/></Units>']
    lines += ['<CgPoints name="given">']
    for name, point in (("1", "1"), ("id-4", "4")):
        east, north, up = (value / metres for value in PLACES[point])
        lines.append(f'<CgPoint name="{name}">{north!r} {east!r} {up!r}</CgPoint>')
    lines += ["</CgPoints>", '<Survey>\n<SurveyHeader name="net"/>']
    for station, height in HEIGHTS.items():
        lines += [f'<InstrumentSetup id="s{station}" stationName="{station}" instrumentHeight="{height / metres!r}">']
        lines += [f'<InstrumentPoint pntRef="{station}"/>', "</InstrumentSetup>"]
        lines += [f'<ObservationGroup id="g{station}" setupID="s{station}">']
        for face in (1, 2):
            for at, target, circle, zenith, slope in _readings(face):
                if at == station:
                    angles = f'horizAngle="{_angle(circle, angle)}" zenithAngle="{_angle(zenith, angle)}"'
                    far = f'slopeDistance="{slope / metres!r}" targetHeight="{TARGET / metres!r}"'
                    point = f'<TargetPoint name="{target}" pntRef="{"id-4" if target == "4" else target}"/>'
                    direct = f'directFace="{str(face == 1).lower()}"'
                    lines.append(f"<RawObservation {angles} {far} {direct}>{point}</RawObservation>")
        lines += ["</ObservationGroup>"]
    return _HEAD + "\n".join([*lines, "</Survey>", "</LandXML>"]) + "\n"


@pytest.mark.parametrize(
    ("length", "angle"),
    [
        ("meter", "decimal dd.mm.ss"),
        ("meter", "decimal  dd.mm.ss"),
        ("foot", "decimal degrees"),
        ("USSurveyFoot", "radians"),
        ("millimeter", "grads"),
    ],
)
def test_a_network_comes_out_as_it_was(tmp_path: Path, length: str, angle: str) -> None:
    """Noise-free readings: every place to what the digits carry, also that of the point without coordinates."""
    path = tmp_path / "n.xml"
    path.write_text(survey(length, angle).replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    assert format_of(path) == "landxml"
    read = mor.read(str(path))
    plane = {key: value for key, value in read.document.data.items() if key != "curvature"}
    result = mor.adjust(plane)  # the readings were computed with parallel verticals
    network, solved = result.project.network, result.solved
    points = network.things["point"]
    assert set(points.ids) == set(PLACES)
    for name, place in PLACES.items():
        found = solved.adjustment.values["point"][points.part(name, "position")]
        np.testing.assert_allclose(found, place, atol=1e-6)
    assert "3 set-ups, 3 sets" in " ".join(read.notes)


PLAN = (
    _HEAD
    + """<Units><Metric linearUnit="meter" angularUnit="decimal dd.mm.ss" directionUnit="decimal dd.mm.ss"/></Units>
<CgPoints><CgPoint name="A" pntSurv="boundary">100.0 200.0</CgPoint><CgPoint name="C">180.0 260.0</CgPoint></CgPoints>
<Survey><SurveyHeader name="plan"/>
"""
    + "".join(f'<InstrumentSetup id="IS-{n}" stationName="{n}" instrumentHeight="0"/>\n' for n in "ABC")
    + """<ObservationGroup id="OG-1">
<ReducedObservation name="1" setupID="IS-A" targetSetupID="IS-B" azimuth="90.0000" horizDistance="60.0"
 azimuthType="measured" distanceType="measured"/>
<ReducedObservation name="2" setupID="IS-B" targetSetupID="IS-C" azimuth="0.00" horizDistance="80.0" vertDistance="1"/>
<ReducedObservation name="3" setupID="IS-C" targetSetupID="IS-A" azimuth="216.5211" horizDistance="99.0"
 distanceType="computed"/>
<ReducedObservation name="4" setupID="IS-C" targetSetupID="IS-A" status="deleted" azimuth="1"/>
<RedVerticalObservation setupID="IS-A" height="3"/>
</ObservationGroup>
</Survey>
</LandXML>
"""
)


def test_a_plan_of_bearings_and_distances(tmp_path: Path) -> None:
    """Bearings from north, no heights anywhere: a network in the plane; what is computed or deleted is left out."""
    path = tmp_path / "plan.xml"
    path.write_text(PLAN)
    document = read_foreign(path)
    assert document.data["settings"]["dimensions"] == "xy"
    tables = {table["type"]: table["rows"] for table in document.data["observations"]}
    assert [[row[0], row[1], float(row[2])] for row in tables["bearing"]] == [
        ["A", "B", 90.0],
        ["B", "C", 0.0],
        ["C", "A", pytest.approx(216 + 52 / 60 + 11 / 3600)],
    ]
    assert [row[2] for row in tables["horizontal_distance"]] == ["60.0", "80.0"]
    result = mor.adjust(str(path))
    points = result.project.network.things["point"]
    B = result.solved.adjustment.values["point"][points.part("B", "position")]
    np.testing.assert_allclose(B[:2], [260.0, 100.0], atol=1e-3)
    notes = " ".join(map(str, document.notes))
    for words in (
        "horizDistance that is computed (1 record, lines 13)",
        "deleted observations (1",
        "vertDistance (1 record, lines 12)",
        "RedVerticalObservation (1",
    ):
        assert words in notes


def test_arcs_of_a_plan_are_their_chords_and_heights_that_nothing_measures_are_not_used(
    tmp_path: Path,
) -> None:
    arc = (
        '<ReducedArcObservation name="5" setupID="IS-A" targetSetupID="IS-C" chordAzimuth="36.5212" radius="50.0" '
        'length="157.079633" rot="cw"/>\n'
    )
    path = tmp_path / "plan.xml"
    path.write_text(
        PLAN.replace("<RedVert", arc + "<RedVert").replace('pntSurv="boundary">100.0 200.0<', ">100.0 200.0 7.5<")
    )
    document = read_foreign(path)
    assert document.data["settings"]["dimensions"] == "xy"
    tables = {table["type"]: table["rows"] for table in document.data["observations"]}
    (distance,) = (float(row[2]) for row in tables["horizontal_distance"] if row[:2] == ["A", "C"])
    (bearing,) = (float(row[2]) for row in tables["bearing"] if row[:2] == ["A", "C"])
    assert (distance, bearing) == pytest.approx((100.0, 36.87), abs=1e-6)
    assert "1 given height not used" in " ".join(map(str, document.notes))
    assert mor.adjust(str(path)).solved is not None


def test_a_backsight_that_nothing_measures_is_a_sight(tmp_path: Path) -> None:
    path = tmp_path / "n.xml"
    back = '<Backsight circle="12.3000"><BacksightPoint name="9">1000.0 2000.0 30.0</BacksightPoint></Backsight>'
    measured = '<Backsight circle="0"><BacksightPoint name="3"/></Backsight>'
    path.write_text(
        survey()
        .replace('<InstrumentPoint pntRef="1"/>', f'<InstrumentPoint pntRef="1"/>{back}')
        .replace('<InstrumentPoint pntRef="2"/>', f'<InstrumentPoint pntRef="2"/>{measured}')
    )
    document = read_foreign(path)
    alone = [table["rows"] for table in document.data["observations"] if table["type"] == "directions"]
    assert [[row[0], row[1], float(row[2])] for row in alone[0]] == [["1", "9", 12.5]]
    known = {row[0]: row[1:4] for table in document.data["points"] for row in table["rows"]}
    assert known["9"] == ["2000.0", "1000.0", "30.0"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('linearUnit="meter"', 'linearUnit="cubit"', r"n\.xml:3: found the linearUnit 'cubit'"),
        ('angularUnit="decimal dd.mm.ss"', 'angularUnit="mils"', r"n\.xml:3: found the angularUnit 'mils'"),
        ("Units>", "Other>", r"n\.xml:2: found no <Units>"),
        ('id="s2"', 'id="s1"', r"n\.xml:\d+: InstrumentSetup: found the id 's1', expected one that no other"),
        ('setupID="s2"', 'setupID="s8"', r"n\.xml:\d+: RawObservation: found the setupID 's8'"),
        (
            'targetHeight="1.3"',
            'targetHeight="1,3"',
            r"n\.xml:14: RawObservation: found '1,3', expected a number",
        ),
        ("0.0 0.0 10.0", "0.0", r"n\.xml:5: CgPoint: found 1 coordinates"),
        ('<TargetPoint name="2" pntRef="2"/>', "", r"n\.xml:\d+: RawObservation: found no TargetPoint"),
        ("LandXML", "Land", r"n\.xml:2: found <Land>, expected <LandXML>"),
        (
            'zenithAngle="88.21',
            'zenithAngle="88.71',
            r"n\.xml:14: RawObservation: found '88\.71.*expected less than 60",
        ),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "n.xml"
    path.write_text(survey().replace(old, new))
    with pytest.raises(InputError, match=words):
        read_foreign(path, "landxml")


def test_the_part_of_leica_is_said_not_to_be_read(tmp_path: Path) -> None:
    path = tmp_path / "n.xml"
    part = '<HexagonLandXML xmlns="http://xml.hexagon.com/schema/HeXML-1.9"><Point uniqueID="A"/></HexagonLandXML>'
    path.write_text(PLAN.replace("</LandXML>", f"{part}\n</LandXML>"))
    before = [note.message for note in read_foreign(path).notes if "HexagonLandXML" in note.message]
    assert before == [
        "HexagonLandXML is not read: ppm, prism constants and codes; distances are those of LandXML's own part"
    ]


def test_a_design_without_a_survey_says_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "road.xml"
    path.write_text(
        '<LandXML version="1.2"><Units><Metric linearUnit="meter"/></Units><Surfaces/><Alignments/></LandXML>'
    )
    with pytest.raises(InputError, match=r"it has only: Surfaces \(1 record\); Alignments \(1 record\)"):
        read_foreign(path)


def test_set_ups_that_backsights_name_and_points_from_side_shots(tmp_path: Path) -> None:
    """Civil 3D names the set-up of a group in its backsight; side shots have computed coordinates."""
    path = tmp_path / "civil.xml"
    path.write_text(
        """<LandXML version="1.1"><Units><Imperial linearUnit="foot" angularUnit="decimal dd.mm.ss"/></Units>
        <CgPoints><CgPoint name="1" pntSurv="control">100 200 10</CgPoint>
        <CgPoint name="2" pntSurv="control">300 200 10</CgPoint>
        <CgPoint name="7" pntSurv="sideShot">100 400 10</CgPoint></CgPoints>
        <Survey><InstrumentSetup id="s1" stationName="1" instrumentHeight="5"><InstrumentPoint pntRef="1"/>
        </InstrumentSetup>
        <ObservationGroup id="o1"><TargetPoint pntRef="1"/>
        <Backsight circle="0." setupID="s1"><BacksightPoint pntRef="2"/></Backsight>
        <RawObservation horizAngle="-359.5958" zenithAngle="90.0000" slopeDistance="200" targetHeight="5">
        <TargetPoint pntRef="2"/></RawObservation>
        <RawObservation horizAngle="-270.0000" zenithAngle="90.0000" slopeDistance="200" targetHeight="5">
        <TargetPoint pntRef="7"/></RawObservation></ObservationGroup></Survey></LandXML>"""
    )
    document = read_foreign(path)
    given = [row[0] for row in document.data["points"][0]["rows"]]
    assert given == ["1", "2"]
    assert "coordinates that the instrument computed" in " ".join(map(str, document.notes))
    (angles,) = (t for t in document.data["observations"] if t["type"] == "zenith_directions")
    rows = [dict(zip(angles["columns"], row, strict=True)) for row in angles["rows"]]
    assert [(row["station"], row["to"]) for row in rows] == [("1", "2"), ("1", "7")]
    assert float(rows[0]["horizontal"]) % 360.0 == pytest.approx(2.0 / 3600.0, abs=1e-9)
    assert float(rows[1]["horizontal"]) % 360.0 == pytest.approx(90.0)
    (lengths,) = (t for t in document.data["observations"] if t["type"] == "distance")
    assert float(lengths["rows"][1][lengths["columns"].index("distance")]) == pytest.approx(60.96)


def test_the_azimuth_of_the_circle_orients_a_set_up_without_known_targets(tmp_path: Path) -> None:
    path = tmp_path / "radial.xml"
    path.write_text(
        _HEAD
        + """<Units><Metric linearUnit="meter" angularUnit="grads" directionUnit="decimal degrees"/></Units>
<CgPoints><CgPoint name="A">100.0 200.0 5.0</CgPoint></CgPoints>
<Survey><SurveyHeader name="radial"/>
<InstrumentSetup id="s" stationName="A" instrumentHeight="1.5" orientationAzimuth="45"/>
<ObservationGroup id="g" setupID="s">
<RawObservation horizAngle="50" slopeDistance="30" zenithAngle="100" targetHeight="1.5"><TargetPoint name="P"/>
</RawObservation></ObservationGroup></Survey></LandXML>
"""
    )
    result = mor.adjust(str(path))
    points = result.project.network.things["point"]
    P = result.solved.adjustment.values["point"][points.part("P", "position")]
    np.testing.assert_allclose(P[:2], [230.0, 100.0], atol=1e-6)  # 45° and 50 gon: due east
