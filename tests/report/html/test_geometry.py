"""Nothing is clipped, overlaps or scrolls sideways, on a phone as on a desk: told by where things stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from mor.report.language import words_of
from mor.report.page import page
from mor.report.view import View
from tests.page_geometry import browser, problems
from tests.scenarios.small_projects import LEVELLING, mor, write

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(browser() is None, reason="no browser was found"),
]


PAPER = 703
"""Pixels of A4 without its margins, with a scroll bar."""


@pytest.mark.parametrize(("width", "theme"), [(400, "dark"), (800, "light"), (PAPER, "printed")])
def test_page(building_view: View, tmp_path: Path, width: int, theme: str) -> None:
    """The sample with everything in it, in German, whose words are longer."""
    found = problems(page(building_view, words_of("de", "page")), width, tmp_path, theme)
    assert found["ready"] == "all"
    assert found["found"] == []
    assert isinstance(found["names"], int)
    assert found["names"] >= (0 if theme == "printed" else 10)


def test_levelling_line_on_a_phone(tmp_path: Path) -> None:
    assert mor("adjust", write(tmp_path, LEVELLING), "--quiet").code == 0
    text = (tmp_path / "project.results" / "report.html").read_text(encoding="utf-8")
    assert problems(text, 400, tmp_path)["found"] == []


def test_certificate_on_a_phone(tmp_path: Path) -> None:
    sample = Path(__file__).parents[3] / "sample_projects" / "facade" / "project.yaml"
    results = tmp_path / "results"
    assert mor("adjust", sample, "-o", results, "--no-html").code == 0
    assert mor("certificate", results, "D7", "-o", tmp_path / "D7.html", "--lang", "de").code == 0
    text = (tmp_path / "D7.html").read_text(encoding="utf-8")
    assert problems(text, 400, tmp_path)["found"] == []


def test_what_sticks_out_is_seen(tmp_path: Path) -> None:
    wide = "<!DOCTYPE html><html><body><p style='width:900px'>too wide</p></body></html>"
    found = problems(wide, 400, tmp_path)["found"]
    assert isinstance(found, list)
    assert any("scrolls sideways" in one for one in found)
    assert any(one.startswith("P ") for one in found)


def test_words_over_words_are_seen(tmp_path: Path) -> None:
    """In a chart: two texts in one place, and one that ends beyond the chart."""
    words = [("left", 20), ("over it", 25), ("far beyond", 280)]
    texts = "".join(f"<text x='{x}' y='50'>{word}</text>" for word, x in words)
    svg = f"<svg class='main-svg' width='300' height='90'>{texts}</svg>"
    chart = f"<div class='chart' id='some' style='width:300px'><div class='plot'>{svg}</div></div>"
    found = problems(f"<!DOCTYPE html><html><body>{chart}</body></html>", 400, tmp_path)["found"]
    assert found == ['chart some: "far beyond" is cut off', 'chart some: "left" over "over it"']
