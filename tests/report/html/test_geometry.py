"""Nothing is clipped, overlaps or scrolls sideways, on a phone as on a desk: told by where things stand."""

from __future__ import annotations

from pathlib import Path

import pytest
from page_geometry import problems
from small_projects import mor

from mor.report.html.page import page
from mor.report.html.paper import browser
from mor.report.view import View
from mor.report.words.language import words_of_page

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(browser() is None, reason="no browser was found"),
]


@pytest.mark.parametrize(("width", "theme"), [(400, "dark"), (800, "light")])
def test_page(building_view: View, tmp_path: Path, width: int, theme: str) -> None:
    """The sample with everything in it, in German, whose words are longer."""
    found = problems(page(building_view, words_of_page("de")), width, tmp_path, theme)
    assert found["ready"] == "all"
    assert found["found"] == []
    assert isinstance(found["names"], int)
    assert found["names"] >= 10


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
