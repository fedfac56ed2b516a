"""``mor report``: a PDF by a browser or of the text, and the page in another language."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest

from mor.report import page as paper
from mor.report.page import browser
from tests.scenarios.small_projects import LEVELLING, mor, write


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    project = write(folder, LEVELLING + 'title: A "loop" of <levels> \\\n')
    assert mor("adjust", project, "--full").code == 0
    return folder / "project.results"


def pages(path: Path) -> tuple[int, list[tuple[float, float]]]:
    """Number of pages of a PDF and their sizes in points, from its page objects."""
    data = path.read_bytes()
    assert data.startswith(b"%PDF-")
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", data, re.S):
        try:
            data += zlib.decompress(stream)
        except zlib.error:
            continue
    boxes = re.findall(rb"/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)\s*\]", data)
    return len(re.findall(rb"/Type\s*/Page\b", data)), [(float(a), float(b)) for a, b in boxes]


def test_text_where_there_is_no_browser(
    results: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("MOR_BROWSER", "no-such-program")
    for name, (width, height) in {"A4": (595, 842), "Letter": (612, 792)}.items():
        target = tmp_path / f"{name}.pdf"
        run = mor("report", results, "--pdf", "--paper", name, "-o", target)
        assert run.code == 0
        assert "no browser was found" in run.err
        count, sizes = pages(target)
        assert count >= 1
        assert all(size == pytest.approx((width, height), abs=1.0) for size in sizes)
    first = target.read_bytes()
    assert mor("report", results, "--pdf", "--paper", "Letter", "-o", target).code == 2
    assert mor("report", results, "--pdf", "--paper", "Letter", "-o", target, "--force").code == 0
    assert target.read_bytes() == first


@pytest.mark.browser
def test_page_where_there_is_one(results: Path) -> None:
    if browser() is None:
        pytest.skip("no browser was found")
    assert mor("report", results, "--pdf", "--paper", "Letter").code == 0
    count, sizes = pages(results / "report.pdf")
    assert count >= 3
    assert {tuple(map(round, size)) for size in sizes} == {(612, 792), (792, 612)}


def test_a_browser_that_prints_nothing_is_told(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "BROWSERS", ("false",))
    monkeypatch.setattr(paper, "_APPLICATIONS", ())
    run = mor("report", results, "--pdf")
    assert run.code == 2
    assert "the browser made no PDF" in run.err


def test_page_in_the_other_language(results: Path, tmp_path: Path) -> None:
    assert mor("report", results, "--lang", "de", "-o", tmp_path / "de.html").code == 0
    german = (tmp_path / "de.html").read_text(encoding="utf-8")
    assert '<html lang="de">' in german
    english = (results / "report.html").read_text(encoding="utf-8")
    assert mor("report", results).code == 0
    again = (results / "report.html").read_text(encoding="utf-8")
    without = re.compile(r'id="payload">[^<]*<')  # numbers as they stand in results.json
    assert without.sub("", again) == without.sub("", english)


def test_titles_cannot_leave_the_style_sheet(results: Path) -> None:
    page = (results / "report.html").read_text(encoding="utf-8")
    head = page[page.index("@top-left") :].split("}")[0]
    assert r'content: "A \22 loop\22  of \3c levels\3e  \5c "' in head


def test_no_results(tmp_path: Path) -> None:
    run = mor("report", tmp_path, "--pdf")
    assert run.code == 2
    assert run.err == f"{tmp_path}: there is no results.json in this folder\n"
