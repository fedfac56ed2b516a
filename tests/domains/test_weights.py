"""Robust solutions and iterated variance components over domains: those of one machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from mor.domains import robust
from mor.quality.gross_errors import robust_estimation
from tests.domains_compared import ELSEWHERE, differences, have_small_domains, results
from tests.scenarios.domains_blocks import Kind, command, write_block

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    have_small_domains(monkeypatch)


def both(project: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results of one machine and of domains."""
    above = project.parent.parent
    for folder, options in (("one", ()), ("several", ("--memory", "400MB"))):
        done = command("adjust", project, "-o", above / folder, "--no-html", *options)
        assert done.exit_code == 0, done.stderr
    return results(above / "one"), results(above / "several")


def same(one: dict[str, Any], several: dict[str, Any]) -> list[str]:
    """Differences but for groups that reject, which domains explain less of, and hypotheses."""
    left = (*ELSEWHERE, "possible_causes", "verdict")
    return differences(*({k: v for k, v in each.items() if k not in left} for each in (one, several)))


def with_settings(project: Path, settings: str) -> Path:
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace("datum:", f"settings: {{{settings}}}\ndatum:"), encoding="utf-8")
    return project


def with_gross_errors(project: Path) -> Path:
    """Some image coordinates wrong by ten σ and more."""
    table = project.parent / "rays.parquet"
    wrong = pl.int_range(pl.len()) % 151 == 5
    size = 0.05 + 0.001 * (pl.int_range(pl.len()) % 37)
    pl.read_parquet(table).with_columns(x=pl.col("x") + wrong * size).write_parquet(table)
    return project


BLOCKS = {
    "control and sights": Kind(strips=2, points=400, control=6, sights=30),
    "free": Kind(convergent=True, points=150, gnss=False, datum="free"),
}


@pytest.mark.parametrize(("name", "method"), [("control and sights", "danish"), ("free", "l1")])
def test_robust_solutions(name: str, method: str, tmp_path: Path) -> None:
    project = with_gross_errors(write_block(tmp_path / "block", BLOCKS[name]))
    one, several = both(with_settings(project, f"robust: {method}"))
    found = one["gross_errors"]["robust"]
    assert found["settled"]
    assert len(found["rejected"]) > 5 or method == "l1"
    assert found["largest_shift"] > 0.001
    assert same(one, several) == []
    text = (tmp_path / "several" / "report.txt").read_text(encoding="utf-8")
    assert f"Robust estimation ({method})" in text


def test_robust_solutions_that_do_not_settle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (robust, robust_estimation):
        monkeypatch.setattr(module, "ROUNDS", 2)
    project = with_gross_errors(write_block(tmp_path / "block", Kind()))
    one, several = both(with_settings(project, "robust: danish"))
    assert not one["gross_errors"]["robust"]["settled"]
    assert same(one, several) == []


@pytest.mark.parametrize("name", BLOCKS)
def test_iterated_variance_components(name: str, tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", BLOCKS[name])
    text = project.read_text(encoding="utf-8").replace("sigma: '0.005'", "sigma: '0.009'")
    project.write_text(text.replace("sigma: '0.01'", "sigma: '0.004'"), encoding="utf-8")
    one, several = both(with_settings(project, "variance_components: iterate"))
    assert one["variance_components"]["iterated"]
    assert one["variance_components"]["settled"]
    factors = {row["name"]: row["sigma_factor"] for row in one["groups"]}
    assert factors["rays.parquet"] == pytest.approx(5.0 / 9.0, rel=0.05)
    assert same(one, several) == []
    assert "iterated into the weights" in (tmp_path / "several" / "report.txt").read_text(encoding="utf-8")


def test_a_robust_solution_and_variance_components(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (robust, robust_estimation):
        monkeypatch.setattr(module, "ROUNDS", 5)
    project = with_gross_errors(write_block(tmp_path / "block", Kind(strips=2, points=300)))
    one, several = both(with_settings(project, "robust: danish, variance_components: iterate"))
    assert one["gross_errors"]["robust"]["rejected"]
    assert same(one, several) == []


def test_tables_of_one_name_have_no_weights_of_their_own(tmp_path: Path) -> None:
    project = with_settings(write_block(tmp_path / "block", Kind(sights=10)), "variance_components: iterate")
    text = project.read_text(encoding="utf-8")
    more = "{type: distance, name: twice, columns: [from, to, distance], rows: [[P1, P2, 9]], values: {sigma: '1'}}"
    project.write_text(
        text.replace("observations:\n", f"observations:\n  - {more}\n  - {more}\n"), encoding="utf-8"
    )
    done = command("adjust", project, "-o", tmp_path / "out", "--memory", "400MB")
    assert done.exit_code == 2
    assert "iterated variance components of several tables of one name, 'twice'" in done.stderr


@pytest.mark.parametrize("asked", ["robust: danish", "variance_components: iterate"])
def test_not_together_with_data_snooping(asked: str, tmp_path: Path) -> None:
    project = with_settings(write_block(tmp_path / "block", Kind()), asked)
    done = command("adjust", project, "-o", tmp_path / "out", "--memory", "400MB", "--snoop")
    assert done.exit_code == 2
    assert "and data snooping" in done.stderr
    assert not (tmp_path / "out").exists()


def test_nothing_is_left_of_what_was_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robust, "ROUNDS", 2)
    project = with_gross_errors(write_block(tmp_path / "block", Kind(points=200)))
    with_settings(project, "robust: danish, variance_components: iterate")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    done = command("adjust", project, "--memory", "400MB", "--scratch", scratch, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert list(scratch.iterdir()) == []
    told = json.loads((tmp_path / "out" / "domains.json").read_text(encoding="utf-8"))
    assert told["outcome"] == "converged"
