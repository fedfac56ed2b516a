"""What reports are of: the same in text, page and ``results.json``, the same bytes for the same input."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
from pathlib import Path

import pytest

from tests.published_schemas import mistakes
from tests.scenarios.small_projects import LEVELLING, mor, write

IDENTIFIED = LEVELLING + 'report: {operator: A. Surveyor, client: City of Mill, remarks: "Cloudy,\\n 12 degrees."}\n'
DAY = 1_700_000_000
"""2023-11-14, 22:13 UTC."""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project that reads a plain and a compressed table, of known ages."""
    text = IDENTIFIED + "checks:\n  - {type: height_difference, file: sub/more.csv.gz}\n"
    path = write(tmp_path, text)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "more.csv.gz").write_bytes(gzip.compress(b"from,to,dz,sigma\nA,B,1.0,0.001\n"))
    os.utime(path, (DAY, DAY))
    os.utime(tmp_path / "sub" / "more.csv.gz", (DAY - 1e7, DAY - 1e7))
    return path


def test_files_with_their_sums_as_they_lie_on_disk(project: Path) -> None:
    folder = project.parent
    assert mor("adjust", project, "--snoop", "--no-html").code == 0
    results = folder / "project.results" / "results.json"
    assert mistakes(results) == []
    identity = json.loads(results.read_text())["identity"]
    assert identity["inputs"] == [
        {
            "file": name,
            "bytes": (folder / name).stat().st_size,
            "sha256": hashlib.sha256((folder / name).read_bytes()).hexdigest(),
        }
        for name in ("project.yaml", "sub/more.csv.gz")
    ]
    assert identity["date"] == "2023-11-14"
    assert identity["options"] == ["--snoop"]
    text = (folder / "project.results" / "report.txt").read_text()
    for said in ("A. Surveyor", "City of Mill", "Cloudy, 12 degrees.", "2023-11-14", "--snoop"):
        assert said in text
    assert all(file["sha256"] in text for file in identity["inputs"])
    assert "signature" in text


def test_page_says_who_from_what_and_has_a_place_to_sign(project: Path) -> None:
    assert mor("adjust", project, "--lang", "de").code == 0
    page = (project.parent / "project.results" / "report.html").read_text()
    identity = json.loads((project.parent / "project.results" / "results.json").read_text())["identity"]
    for said in ("Bearbeitung: A. Surveyor", "Auftraggeber: City of Mill", "Unterschrift", "2023-11-14"):
        assert said in page
    assert all(file["sha256"] in page for file in identity["inputs"])


def test_date_of_the_environment(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    data = json.loads(mor("adjust", project, "--json", "-q").out)
    assert data["identity"]["date"] == "1970-01-02"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1e300")
    run = mor("adjust", project, "--json", "-q")
    assert run.code == 2
    assert "SOURCE_DATE_EPOCH: found '1e300' in the environment" in run.err


def test_foreign_folders_name_all_files_they_are_read_from(tmp_path: Path, project: Path) -> None:
    assert mor("convert", project, "--to", "gkf", "-o", tmp_path / "network.gkf").code == 0
    data = json.loads(mor("adjust", tmp_path / "network.gkf", "--json", "-q").out)
    assert [file["file"] for file in data["identity"]["inputs"]] == ["network.gkf"]


def test_who_signs_changes_no_number(project: Path) -> None:
    before = json.loads(mor("adjust", project, "--json", "-q").out)
    project.write_text(project.read_text().replace("A. Surveyor", "B. Other"))
    after = json.loads(mor("adjust", project, "--json", "-q").out)
    assert before.pop("identity") != after.pop("identity")
    assert before == after
