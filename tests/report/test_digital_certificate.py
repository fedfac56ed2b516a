"""The digital calibration certificate: elements in the order of PTB's schema DCC 3.2.0, values and units in D-SI."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

import mor as api
from mor.report.digital_certificate import si_unit
from tests.scenarios.small_projects import mor

SAMPLES = Path(__file__).parents[2] / "sample_projects"
ADMIN = """
identifier: EX-2026-0042
country: DE
begin: 2026-03-02
end: 2026-03-03
place: laboratory
laboratory: {name: Example Laboratory, city: Berlin, country: DE, street: A street, email: a@example.org, code: X-1}
customer: {name: Example Customer, city: Hannover}
persons: [{name: First Person, role: head, signs: true}, {name: Second Person}]
item: {name: digital camera, manufacturer: Example Cameras, serial: "0815"}
"""
ORDER = {  # children in the order that the schema prescribes, of every element that mor writes
    "digitalCalibrationCertificate": "administrativeData measurementResults",
    "administrativeData": "dccSoftware coreData items calibrationLaboratory respPersons customer",
    "software": "name release",
    "coreData": "countryCodeISO3166_1 usedLangCodeISO639_1 mandatoryLangCodeISO639_1 uniqueIdentifier "
    "beginPerformanceDate endPerformanceDate performanceLocation",
    "item": "name manufacturer model identifications",
    "identification": "issuer value",
    "calibrationLaboratory": "calibrationLaboratoryCode contact",
    "contact": "name eMail phone location",
    "customer": "name eMail phone location",
    "respPerson": "person role mainSigner",
    "measurementResult": "name usedMethods usedSoftware results measurementMetaData",
    "usedMethod": "name description norm",
    "result": "name data",
    "quantity": "name list real realListXMLList",
    "realList": "real ellipsoidalRegion",
    "real": "label value unit expandedUnc",
    "realListXMLList": "valueXMLList unitXMLList expandedUncXMLList",
    "expandedUnc": "uncertainty coverageFactor coverageProbability distribution",
    "expandedUncXMLList": "uncertaintyXMLList coverageFactorXMLList coverageProbabilityXMLList",
    "ellipsoidalRegion": "covarianceMatrix coverageFactor coverageProbability distribution",
    "covariance": "value unit",
    "metaData": "declaration data",
}
DECIMAL = r"[-+]?((\d*\.\d+)|(\d+\.\d*)|(\d+\.?))([Ee][-+]?\d+)?"
PATTERNS = {
    "value": DECIMAL,
    "uncertainty": DECIMAL.removeprefix("[-+]?"),
    "coverageFactor": r"([1-9]\d*\.\d*)|([1-9]\d*)",
    "coverageProbability": r"(0(\.\d*)?)|(1(\.0*)?)",
}
D, S = "{https://ptb.de/dcc}", "{https://ptb.de/si}"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dcc") / "results"
    assert mor("adjust", SAMPLES / "facade" / "project.yaml", "-o", folder, "--no-html").code == 0
    return folder


def written(results: Path, folder: Path, *options: str, admin: str = ADMIN) -> Any:
    (folder / "admin.yaml").write_text(admin, encoding="utf-8")
    given = ("--dcc", folder / "admin.yaml", "-o", folder / "d7.xml", *options)
    run = mor("certificate", results, "D7", *given)
    assert run.code == 0, run.err
    return ElementTree.parse(folder / "d7.xml").getroot()


def local(element: Any) -> str:
    return str(element.tag).partition("}")[2]


@pytest.mark.parametrize("language", ["en", "de"])
def test_elements_follow_the_schema(results: Path, tmp_path: Path, language: str) -> None:
    root = written(results, tmp_path, "--lang", language)
    assert root.get("schemaVersion") == "3.2.0"
    for element in root.iter():
        name, children = local(element), [local(child) for child in element]
        if name in ORDER and not (name == "list" or element.tag == S + "list"):
            order = ORDER[name].split()
            places = [order.index(child) for child in children]
            assert places == sorted(places), name
        elif element.tag == S + "value" or (name in PATTERNS and element.tag.startswith(S)):
            assert re.fullmatch(PATTERNS[name], element.text), (name, element.text)
        if not children:
            assert re.fullmatch(r"\S+(\s+\S+)*", element.text or ""), name
    codes = [e.text for e in root.iter(D + "usedLangCodeISO639_1")]
    assert codes == [language]
    assert {e.get("lang") for e in root.iter(D + "content")} == {None, language}
    words = {e.text for e in root.iter(D + "content")}
    assert ("innere Orientierung" if language == "de" else "interior orientation") in words


def test_administrative_data_are_those_of_the_laboratory(results: Path, tmp_path: Path) -> None:
    root = written(results, tmp_path)
    texts = [e.text for e in root.find(D + "administrativeData").iter() if e.text and e.text.strip()]
    for text in (
        "EX-2026-0042",
        "2026-03-02",
        "Example Laboratory",
        "a@example.org",
        "X-1",
        "Second Person",
        "0815",
    ):
        assert texts.count(text) == 1, text


def test_python_gives_what_the_command_writes(results: Path, tmp_path: Path) -> None:
    """The numbers of the two certificates; those of the command went through the tables of results."""
    assert mor("certificate", results, "D7", "--coverage", 2, "-o", tmp_path / "d7.txt", "--lang", "de").code == 0
    result = api.adjust(SAMPLES / "facade" / "project.yaml")
    text = result.certificate("D7", coverage=2.0, language="de")
    assert text == (tmp_path / "d7.txt").read_text(encoding="utf-8")
    written(results, tmp_path)
    document = result.certificate("D7", administration=tmp_path / "admin.yaml")
    assert document == (tmp_path / "d7.xml").read_text(encoding="utf-8")
    with pytest.raises(api.InputError, match="known: D7"):
        result.certificate("D8")


@pytest.mark.parametrize("key", ["identifier", "begin", "place", "laboratory", "customer", "persons", "item"])
def test_missing_data_are_refused_by_name(results: Path, tmp_path: Path, key: str) -> None:
    path = tmp_path / "admin.yaml"
    path.write_text("\n".join(line for line in ADMIN.splitlines() if not line.startswith(key)))
    run = mor("certificate", results, "D7", "--dcc", path, "-o", tmp_path / "d7.xml")
    assert (run.code, (tmp_path / "d7.xml").exists()) == (2, False)
    assert f"{key}: this key is required" in run.err


def test_wrong_data_are_refused(results: Path, tmp_path: Path) -> None:
    path = tmp_path / "admin.yaml"
    path.write_text(ADMIN.replace("end: 2026-03-03", "end: 2026-02-30").replace("country: DE\n", "country: de\n"))
    run = mor("certificate", results, "D7", "--dcc", path, "-o", tmp_path / "d7.xml")
    assert "expected a date such as 2026-03-01" in run.err
    assert "expected two capital letters" in run.err
    path.write_text(ADMIN.replace("2026-03-03", "2026-03-01"))
    assert "not before begin" in mor("certificate", results, "D7", "--dcc", path, "-o", tmp_path / "x").err
    path.write_text(ADMIN)
    given = ("certificate", results, "D7", "--dcc", path, "-o", tmp_path / "x")
    assert "expected 1 or more" in mor(*given, "--coverage", "0.5").err
    assert "choose one of" in mor(*given, "--to", "opencv").err


def test_values_uncertainties_and_covariances(results: Path, tmp_path: Path) -> None:
    """Against the covariance matrix that mor writes as NumPy archive, and SciPy's t and F."""
    root = written(results, tmp_path, "--coverage", "2.5")
    assert mor("covariance", results, "--cameras", "-o", tmp_path / "c.npz").code == 0
    archive = np.load(tmp_path / "c.npz")
    names = [label.split()[-1] for label in archive["labels"]]
    freedom = json.loads((results / "results.json").read_text())["redundancy"]
    found = root.find(f".//{S}realList")
    reals = found.findall(S + "real")
    assert [real.find(S + "label").text.split(":")[0] for real in reals] == names
    values = [float(real.find(S + "value").text) for real in reals]
    np.testing.assert_allclose(values, archive["values"], rtol=1e-9, atol=1e-14)
    u = [float(real.find(f".//{S}uncertainty").text) for real in reals]
    np.testing.assert_allclose(u, 2.5 * np.sqrt(np.diagonal(archive["covariance"])), rtol=1e-7)
    p = {real.find(f".//{S}coverageProbability").text for real in reals}
    assert [float(text) for text in p] == pytest.approx([1.0 - 2.0 * stats.t.sf(2.5, freedom)], abs=1e-12)
    columns = [[float(e.text) for e in c.iter(S + "value")] for c in found.iter(S + "column")]
    sigma = np.sqrt(np.diagonal(archive["covariance"]))
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(np.array(columns) / scale, archive["covariance"] / scale, atol=1e-7)
    units = [real.find(S + "unit").text for real in reals]
    assert units[:4] == [r"\milli\metre"] * 3 + [r"\milli\metre\tothe{-2}"]
    assert [e.text for e in found.find(f".//{S}column").iter(S + "unit")][:4] == [
        *[r"\milli\metre\tothe{2}"] * 3,
        r"\milli\metre\tothe{-1}",
    ]
    k = float(found.find(f"{S}ellipsoidalRegion/{S}coverageFactor").text)
    assert k == pytest.approx(np.sqrt(len(names) * stats.f.ppf(0.95, len(names), freedom)), rel=1e-9)


def test_distortion_by_the_equations_of_the_model(results: Path, tmp_path: Path) -> None:
    """x (A1 (r² − r0²) + A2 (r⁴ − r0⁴)) of docs/camera-models.md, written out, up to the farthest measured point."""
    root = written(results, tmp_path)
    radius, shift = (
        np.array(e.find(S + "valueXMLList").text.split(), dtype=float) for e in root.iter(S + "realListXMLList")
    )
    camera = json.loads((results / "results.json").read_text())["cameras"][0]
    a, b = (camera["components"][name]["value"] for name in ("A1", "A2"))
    r0 = camera["r0"]
    expected = radius * (a * (radius**2 - r0**2) + b * (radius**4 - r0**4))
    np.testing.assert_allclose(shift, expected, atol=1e-9)
    covered = root.find(f".//{D}metaData").find(f".//{S}value").text
    assert radius[-1] <= float(covered) < 21.7


@pytest.mark.parametrize(
    ("units", "expected"),
    [
        (("mm",), r"\milli\metre"),
        (("1/mm^2", "mm"), r"\milli\metre\tothe{-1}"),
        (("1/mm^2", "1/mm^4"), r"\milli\metre\tothe{-6}"),
        (("1/mm", "mm"), r"\one"),
        (("m", "1/mm"), r"\metre\milli\metre\tothe{-1}"),
        (("px", "1/px^2"), r"\one"),
        (("1",), r"\one"),
    ],
)
def test_units(units: tuple[str, ...], expected: str) -> None:
    assert si_unit(*units) == expected
