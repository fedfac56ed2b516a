"""``mor explain``: every column, flag, outcome and exit code of the results has its words."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from mor.adjustment.solve import Outcome
from mor.cli import INTERRUPTED, run
from mor.errors import ExitCode
from mor.report.words.terms import find, terms

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
    for code in (*ExitCode, INTERRUPTED):
        assert f"exit code {int(code)}" in find(str(int(code)))[0].names


def test_no_name_stands_twice_and_nothing_is_empty() -> None:
    names = [name for term in terms() for name in term.names]
    assert sorted(set(names)) == sorted(names)
    assert all(term.german and term.text.endswith((".", ")")) for term in terms())


def test_words_of_a_term(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "exit", "code", "4"]) == 0
    assert "leave something open" in capsys.readouterr().out
    assert run(["explain", "redundanzanteil"]) == 0
    assert capsys.readouterr().out.startswith("r, redundancy number (German: Redundanzanteil)")


def test_unknown_term(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "nabula"]) == 2
    assert "did you mean 'nabla'" in capsys.readouterr().err


def test_all_terms_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(terms())
