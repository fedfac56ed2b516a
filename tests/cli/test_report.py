"""``mor report``: a PDF to sign, its appendices, and the page in another language."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest

from mor.report.language import words_of
from mor.report.paper import Writer, _shared, report_on_paper
from mor.report.view import view_of_folder
from tests.scenarios.small_projects import LEVELLING, mor, write

SAMPLES = Path(__file__).parents[2] / "sample_projects"


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


def test_pdf_on_both_papers_the_same_bytes_each_time(results: Path, tmp_path: Path) -> None:
    for name, (width, height) in {"A4": (595, 842), "Letter": (612, 792)}.items():
        target = tmp_path / f"{name}.pdf"
        assert mor("report", results, "--pdf", "--paper", name, "-o", target).code == 0
        count, sizes = pages(target)
        assert 1 <= count <= 6
        assert all(size == pytest.approx((width, height), abs=1.0) for size in sizes)
    first = target.read_bytes()
    assert mor("report", results, "--pdf", "--paper", "Letter", "-o", target).code == 2
    assert mor("report", results, "--pdf", "--paper", "Letter", "-o", target, "--force").code == 0
    assert target.read_bytes() == first


def test_only_appendices_that_are_there(results: Path, tmp_path: Path) -> None:
    short, long = tmp_path / "short.pdf", tmp_path / "long.pdf"
    assert mor("report", results, "--pdf", "-o", short).code == 0
    assert mor("report", results, "--appendix", "residuals,covariances", "-o", long).code == 0
    assert pages(long)[0] == pages(short)[0] + 2
    for name in ("images", "residual"):  # a levelling network has no images
        run = mor("report", results, "--appendix", name, "-o", tmp_path / "none.pdf")
        assert run.code == 2
        assert run.err == f"no appendix {name!r} of these results (known: residuals, covariances)\n"


@pytest.mark.parametrize(("sample", "most"), [("facade", 10), ("dam_epochs", 14)])
def test_a_report_one_signs(sample: str, most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pages with every section, no commands, and no word broken: each cell is as wide as its longest word."""
    folder = tmp_path / "results"
    source = next((SAMPLES / sample).glob("*.yaml"))
    assert mor("adjust", source, "-o", folder, "--no-html").code == 0
    said: list[str] = []
    words = words_of("en", "page")
    for name in ("heading", "text", "note"):
        original = getattr(Writer, name)

        def kept(self: Writer, text: str, *given: object, original: object = original, **named: object) -> None:
            said.append(text)
            original(self, text, *given, **named)  # type: ignore[operator]

        monkeypatch.setattr(Writer, name, kept)
    tables: list[list[list[str]]] = []
    table = Writer.table
    monkeypatch.setattr(
        Writer,
        "table",
        lambda self, head, rows, *more, **named: (tables.append(rows), table(self, head, rows, *more, **named))[1],
    )
    target = tmp_path / "report.pdf"
    report_on_paper(view_of_folder(folder), folder, (), "A4", words).write(target)
    assert 4 <= pages(target)[0] <= most
    sections = {
        "Verdict",
        "Network",
        "Summary of the adjustment",
        "Datum",
        "Cameras",
        "Weakest spots",
        "Points",
        "Inputs",
    }
    assert sections <= set(said)
    cells = [cell for rows in tables for row in rows for cell in row]
    assert not [text for text in [*said, *cells] if re.search(r"\bmor [a-z]+\b(?!\s*0)", text) and "model" not in text]


def test_cells_are_wrapped_between_words_only() -> None:
    whole, least = [300.0, 40.0], [90.0, 40.0]
    assert _shared(whole, least, 500.0) == whole
    narrow = _shared(whole, least, 200.0)
    assert sum(narrow) == pytest.approx(200.0)
    assert all(width >= low for width, low in zip(narrow, least, strict=True))


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
