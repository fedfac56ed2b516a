"""``mor explain``: every column, flag, outcome and exit code of the results has its words."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import polars as pl
import pytest

import mor.report
from mor.cli import ENDED, INTERRUPTED, LEFT, run
from mor.errors import ExitCode, InputError
from mor.report.language import find, terms
from mor.solve.iterate import Outcome

HTML = Path(mor.report.__file__).parent
SAMPLES = Path(__file__).parents[2] / "sample_projects"


def test_every_column_of_the_tables_is_explained(tmp_path: Path) -> None:
    project = SAMPLES / "single_station" / "project.yaml"
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    for name in ("residuals.csv", "points.csv", "images.csv"):
        for column in pl.read_csv(tmp_path / "r" / name, n_rows=1, infer_schema=False).columns:
            assert find(column), column


@pytest.mark.parametrize("word", ["gross", "uncontrolled", "excluded", "check", *(o.value for o in Outcome)])
def test_flags_and_outcomes(word: str) -> None:
    assert word in find(word)[0].names


def test_exit_codes() -> None:
    for code in (*ExitCode, INTERRUPTED, ENDED, LEFT):
        assert f"exit code {int(code)}" in find(str(int(code)))[0].names


def test_no_name_stands_twice_and_nothing_is_empty() -> None:
    names = [name for term in terms() for name in term.names]
    assert sorted(set(names)) == sorted(names)
    assert all(term.german and term.text.endswith((".", ")")) for term in terms())


def test_words_of_a_term(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "exit", "code", "4"]) == 0
    assert "do not determine some unknowns" in capsys.readouterr().out
    assert run(["explain", "redundanzanteil"]) == 0
    assert capsys.readouterr().out.startswith("r, redundancy number, redundancy numbers (German: Redundanzanteil)")


def test_unknown_term(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "nabula"]) == 2
    assert "did you mean 'nabla'" in capsys.readouterr().err


def test_all_terms_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(terms())


def test_every_term_is_explained_in_german_too(capsys: pytest.CaptureFixture[str]) -> None:
    """The same terms, and advice where there is advice in English; no sentence was left as it was."""
    english, german = terms("en"), terms("de")
    assert [t.names for t in english] == [t.names for t in german]
    assert [bool(t.advice) for t in english] == [bool(t.advice) for t in german]
    same = {e.names[0] for e, g in zip(english, german, strict=True) if e.text == g.text}
    assert same <= {"A1"}
    assert run(["explain", "--lang", "de", "r"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Redundanzanteil: r, redundancy number")
    assert "Was zu tun ist: Unter 0,1 bleibt ein grober Fehler unbemerkt." in said


def test_the_language_may_be_told_once(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("MOR_LANG", "de")
    assert run(["explain", "datum"]) == 0
    assert "Was zu tun ist: " in capsys.readouterr().out
    assert run(["explain", "datum", "--lang", "en"]) == 0
    assert "What to do: " in capsys.readouterr().out


def test_every_heading_of_the_reports_is_explained() -> None:
    """Heads of tables of the text report, of the page, and of its key figures."""
    text = {name for part in ("text", "text_tables", "text_findings") for name in headers(HTML / f"{part}.py")}
    templates = " ".join(path.read_text(encoding="utf-8") for path in (HTML / "templates").glob("*.j2"))
    heads = re.findall(r"<th\b[^>]*>(.*?)</th>", templates)
    page = {name for head in heads for name in (re.findall(r'say\("([^"]*)"', head) or [head])}
    columns = re.findall(r'say\("([^"]*)"\)', (HTML / "assets" / "main.js").read_text(encoding="utf-8"))
    wanted = {name for name in (text | page | set(columns)) if "{" not in name} - {"", "none"}
    assert len(wanted) > 80
    assert {name for name in wanted if not is_explained(name)} == set()


@pytest.mark.parametrize(
    "word",
    ["value", "sigma", "sum r", "flagged", "beyond test", "hardly determined", "minimal", "S-transformation"],
)
def test_words_of_reports(word: str) -> None:
    assert len(find(word)) == 1


def is_explained(name: str) -> bool:
    try:
        return bool(find(name))
    except InputError:
        return False


def headers(path: Path) -> set[str]:
    """Constants of lists that are called headers, without their units."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "headers":
            constants = [str(part.value) for part in ast.walk(node.value) if isinstance(part, ast.Constant)]
            found |= {text.partition(" [")[0] for text in constants} - {"", "]"}
    return found
