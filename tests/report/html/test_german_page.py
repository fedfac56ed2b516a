"""The page in German: nothing of it stays English, its numbers are those of the English one."""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path
from typing import Any

import pytest

import mor.report
from mor.model.cameras import CAMERA_MODELS
from mor.report.language import words_of
from mor.report.page import MEANINGS, OF_PANORAMA, headline, meaning, page, statements
from mor.report.page_data import page_data
from mor.report.view import View
from tests.page_in_browser import wait_until

HTML = Path(mor.report.__file__).parent
SAID = re.compile(r"""\bsay\(\s*"((?:[^"\\]|\\.)*)\"""")
"""What templates and scripts say."""
SILENT = re.compile(r"<(script|style)[ >].*?</\1>|<[^>]*>", re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e−\d+)?")
GERMAN = words_of("de", "page")


def said_in_python(path: Path) -> set[str]:
    """Texts of calls of ``words`` and ``say``."""
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    found = set()
    for call in calls:
        name = getattr(call.func, "id", getattr(call.func, "attr", ""))
        if name in ("words", "say") and call.args and isinstance(call.args[0], ast.Constant):
            found.add(str(call.args[0].value))
    return found


def everything_said() -> set[str]:
    texts = [*HTML.glob("templates/*.j2"), *HTML.glob("assets/*.js")]
    return set().union(
        *(said_in_python(path) for path in (HTML / f"{name}.py" for name in ("page_data", "figures", "page"))),
        said_in_python(HTML / "plots.py"),
        *(SAID.findall(path.read_text(encoding="utf-8")) for path in texts),
        MEANINGS.values(),
        OF_PANORAMA.values(),
    )


def visible(text: str) -> str:
    """Return the text of a page without its scripts."""
    return html.unescape(SILENT.sub(" ", text))


def test_every_sentence_is_there_in_german() -> None:
    assert len(everything_said()) > 200
    assert sorted(everything_said() - set(GERMAN.catalogue)) == []


def test_templates_hold_no_english_of_their_own() -> None:
    """Words between tags and in attributes that people see come from the dictionary."""
    for path in HTML.glob("templates/*.html.j2"):
        plain = re.sub(r"\{\{.*?\}\}|\{%.*?%\}", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        seen = [*re.findall(r'(?:title|placeholder|aria-label)="([^"]*)"', plain), SILENT.sub(" ", plain)]
        left = set(re.findall(r"[A-Za-z]{3,}", " ".join(seen)))
        assert left - {"residuals", "points", "csv", "DOCTYPE", "html"} == set(), path.name


def test_every_component_of_an_interior_orientation_has_a_meaning() -> None:
    for model in CAMERA_MODELS.values():
        assert [c.name for c in model.components if not meaning(model.key, c.name)] == []


def test_verdict_in_german(facade_view: View) -> None:
    data = page_data(facade_view, GERMAN)
    assert headline(data).title == "Angenommen, einzelne Beobachtungen sind anzusehen"
    words = {statement.title: statement.words for statement in statements(data)}
    assert list(words)[:4] == ["Globaltest", "Tests der Gruppen", "Einzelne Beobachtungen", "Zuverlässigkeit"]
    assert words["Zuverlässigkeit"].startswith("Mittlerer Redundanzanteil 0.78; ")


def test_both_languages_show_the_same_numbers(building_view: View) -> None:
    english, german = (visible(page(building_view, *words)) for words in ((), (GERMAN,)))
    assert german.count("Datum: fest") >= 5
    assert "Kammerkonstante" in german
    assert sorted(NUMBER.findall(english)) == sorted(NUMBER.findall(german))


@pytest.fixture(scope="module")
def german(browser: Any, building_view: View, tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page(building_view, GERMAN), encoding="utf-8")
    browser.get_log("browser")
    browser.get(path.as_uri())
    wait_until(browser, "document.documentElement.dataset.ready === 'all'")
    return browser


@pytest.mark.browser
class TestInABrowser:
    def test_language_and_no_complaint(self, german: Any) -> None:
        assert german.execute_script("return document.documentElement.lang") == "de"
        assert [entry for entry in german.get_log("browser") if entry["level"] == "SEVERE"] == []

    def test_figures_and_tables_are_german(self, german: Any) -> None:
        titles = german.execute_script(
            "const plots = [...document.querySelectorAll('.chart .plot')], names = ['xaxis', 'yaxis'];"
            "const axes = plots.flatMap((p) => names.map((a) => ((p.layout[a] || {}).title || {}).text || ''));"
            "const traces = plots.flatMap((p) => p.data.map((t) => t.name || ''));"
            "return axes.concat(traces, [...document.querySelectorAll('.long th')].map((h) => h.textContent))"
        )
        text = " ".join(titles)
        for word in (
            "Redundanzanteil r",
            "Abstand vom Hauptpunkt",
            "Verzeichnung",
            "Punkte",
            "Standpunkte",
            "Strahlen",
        ):
            assert word in text
        english = "images?|points?|rays|observations|distortion|density|flagged|largest|mean|height|covered"
        assert re.findall(rf"\b({english})\b", text) == []

    def test_a_picked_point_is_told_in_german(self, german: Any) -> None:
        german.execute_script("pick(known('N2'))")
        words = german.find_element("id", "picked").text
        assert words.startswith("Punkt N2 · X 40.1144 m ± ")
        assert "(σ im Datum: fest)" in words

    def test_status_is_shown_and_filtered_in_german(self, german: Any) -> None:
        assert german.execute_script(
            "const t = report.tables.points; t.filterBy('status', 'frei'); const n = t.rows.length;"
            "const shown = t.body.querySelector('td:last-child').textContent; t.filterBy('status', '');"
            "return [n, shown]"
        ) == [german.execute_script("return report.points.rows") - 1, "frei"]
