"""Tables of results: whole or in pieces, as CSV or Parquet, all or the worst; nothing half-written."""

from __future__ import annotations

import json
import shutil
import signal
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.project.document import Document
from mor.quality.solution import Solved
from mor.report import estimates
from mor.report import observations as assessed_rows
from mor.report import results as results_json
from mor.report import results as write_module
from mor.report.estimates import point_table
from mor.report.identity import RunIdentity
from mor.report.observations import SCHEMA, observation_table, uncontrolled_residuals, worst_residuals
from mor.report.output_folder import reserve
from mor.report.results import Choice, point_writer, residual_writer, table_writer, write_results
from mor.report.units import forget
from tests.scenarios.small_projects import block, mor, write_block


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_block(tmp_path_factory.mktemp("block"), rows=block(noise=0.002))


@pytest.fixture(scope="module")
def solved(project: Path) -> Solved:
    return solve_network(read_network(read_document(project), project.parent))


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assessed_rows, "PIECE", 3)


def nothing(rows: int) -> None:
    """Nobody counts."""


def test_pieces_make_the_whole(solved: Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = observation_table(solved)
    monkeypatch.setattr(assessed_rows, "PIECE", 3)
    assert observation_table(solved).equals(whole)
    assert whole.height == solved.adjustment.problem.observations


@pytest.mark.usefixtures("small_pieces")
def test_files_hold_what_the_table_has(solved: Solved, tmp_path: Path) -> None:
    table, counted = observation_table(solved), []
    residual_writer(solved, "parquet", counted.append)(tmp_path / "r.parquet")
    assert pl.read_parquet(tmp_path / "r.parquet").equals(table)
    assert sum(counted) == table.height
    residual_writer(solved, "csv", nothing)(tmp_path / "r.csv")
    text = pl.read_csv(tmp_path / "r.csv", schema=SCHEMA)
    exact = ["observed", "adjusted", "v", "sigma"]
    assert text.select(exact).equals(table.select(exact))
    for name in ("r", "w", "p", "p_t", "nabla", "external"):
        found, expected = (frame[name].cast(pl.Float64).fill_null(np.nan).to_numpy() for frame in (text, table))
        np.testing.assert_allclose(found, expected, rtol=6e-7, equal_nan=True)
    again = tmp_path / "again.csv"
    residual_writer(solved, "csv", nothing)(again)
    assert again.read_bytes() == (tmp_path / "r.csv").read_bytes()


def test_a_long_table_of_points_is_written_in_pieces(
    solved: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forget(solved)
    table, summary = point_table(solved), estimates.point_summary(solved)
    table_writer(table)(tmp_path / "whole.csv")
    forget(solved)
    monkeypatch.setattr(estimates, "ROWS_AT_A_TIME", 8)
    monkeypatch.setattr(estimates, "point_table", lambda solved: pytest.fail("the whole table was made"))
    found = estimates.point_summary(solved)
    point_writer(solved, "parquet")(tmp_path / "p.parquet")
    assert pl.read_parquet(tmp_path / "p.parquet").equals(table)
    point_writer(solved, "csv")(tmp_path / "p.csv")
    assert (tmp_path / "p.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert found.shown.equals(table.head(found.shown.height))
    assert (found.rms, found.weakest) == (summary.rms, summary.weakest)


@pytest.mark.usefixtures("small_pieces")
def test_the_worst_are_those_of_the_whole_table(solved: Solved) -> None:
    table = observation_table(solved).with_row_index("row").filter(pl.col("w").is_not_null())
    for count in (1, 7, table.height, 10 * table.height):
        expected = table.sort([pl.col("w").abs().round(6), "row"], descending=[True, False]).head(count)
        assert worst_residuals(solved, count).equals(expected.drop("row"))


def test_uncontrolled_ones_are_counted_all(solved: Solved) -> None:
    table = observation_table(solved).filter(pl.col("flag") == "uncontrolled")
    some, count = uncontrolled_residuals(solved, 3)
    assert count == table.height
    assert some.equals(table.head(3))


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ("none", set()),
        ("worst", {"points.parquet", "images.parquet", "residuals_worst.parquet"}),
        ("all", {"points.parquet", "images.parquet", "residuals.parquet"}),
    ],
)
def test_tables_that_were_asked_for(project: Path, tmp_path: Path, tables: str, expected: set[str]) -> None:
    run = mor(
        "adjust",
        project,
        "-o",
        tmp_path / "out",
        "--no-html",
        "--tables",
        tables,
        "--table-format",
        "parquet",
    )
    assert run.code == 0, run.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    always = {"README.txt", "results.json", "report.txt", "adjusted.yaml", "reference.csv"}
    beside = {"external_reliability.csv"} if expected else set()
    assert {name for name in names if not name.startswith("start_")} == expected | always | beside
    data = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert set(data["tables"].values()) == expected


def test_another_choice_leaves_no_table_of_the_one_before(project: Path, tmp_path: Path) -> None:
    assert mor("adjust", project, "-o", tmp_path / "out", "--no-html").code == 0
    assert mor("adjust", project, "-o", tmp_path / "out", "--no-html", "--force", "--tables", "none").code == 0
    assert not list((tmp_path / "out").glob("residuals*"))
    assert not list((tmp_path / "out").glob("points*"))


def test_many_observations_are_not_written_unasked(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_module, "MOST_LISTED", 10)
    monkeypatch.setattr(write_module, "MOST_OF_PAGE", 10)
    run = mor("adjust", project, "-o", tmp_path / "out")
    assert run.code == 0
    assert "--tables all" in run.err
    assert "mor report writes it" in run.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "residuals_worst.csv" in names
    assert not names & {"residuals.csv", "report.html"}
    assert mor("adjust", project, "-o", tmp_path / "all", "--tables", "all", "--html").code == 0
    assert {"residuals.parquet", "report.html"} <= {path.name for path in (tmp_path / "all").iterdir()}


def test_long_tables_are_parquet_unless_csv_is_asked_for(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_module, "MOST_OF_PAGE", 10)
    for more in ([], ["--table-format", "csv"]):
        folder = tmp_path / f"out{len(more)}"
        assert mor("adjust", project, "-o", folder, *more).code == 0
        assert not (folder / "report.html").exists()
        assert mor("report", folder).code == 0
        assert (folder / "report.html").stat().st_size > 100_000
    assert (tmp_path / "out0" / "residuals.parquet").exists()
    assert (tmp_path / "out0" / "images.csv").exists()
    assert (tmp_path / "out2" / "residuals.csv").exists()


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_long_tables_stand_beside_and_are_found_again(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(results_json, "INLINE", 2)
    run = mor("adjust", project, "-o", tmp_path / "out", "--no-html", "--table-format", kind)
    assert run.code == 0, run.err
    data = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert data["points"] is None
    assert data["images"] is None
    assert data["residuals"] is None
    assert mor("plot", "network", tmp_path / "out", "-o", tmp_path / "network.svg").code == 0
    assert mor("plot", "residuals", tmp_path / "out", "-o", tmp_path / "residuals.svg").code == 0
    printed = json.loads(mor("adjust", project, "--json", "--quiet").out)
    assert printed["points"]


def test_pictures_need_all_residuals_and_say_so(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results_json, "INLINE", 2)
    assert mor("adjust", project, "-o", tmp_path / "out", "--no-html", "--tables", "worst").code == 0
    run = mor("plot", "histogram", tmp_path / "out", "-o", tmp_path / "w.svg")
    assert run.code == 2
    assert "--tables all" in run.err


def _write(solved: Solved, document: Document, source: Path, folder: Path, choice: Choice) -> None:
    with reserve(folder, force=True) as place:
        write_results(solved, document, RunIdentity((), source), place, choice)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_interrupted_in_the_middle_of_a_table(solved: Solved, project: Path, tmp_path: Path, kind: str) -> None:
    def interrupt(rows: int) -> None:
        raise KeyboardInterrupt

    document = read_document(project)
    _write(solved, document, project.parent, tmp_path / "out", Choice(html=False))
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    choice = Choice(kind=kind, html=False, done=interrupt)  # type: ignore[arg-type]
    with pytest.raises(KeyboardInterrupt):
        _write(solved, document, project.parent, tmp_path / "out", choice)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_interrupted_once_more_while_clearing_away(
    solved: Solved, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(rows: int) -> None:
        raise KeyboardInterrupt

    def clearing(path: Path, ignore_errors: bool) -> None:
        monkeypatch.undo()
        signal.raise_signal(signal.SIGINT)
        shutil.rmtree(path, ignore_errors=ignore_errors)

    def interrupt_clearing(rows: int) -> None:
        monkeypatch.setattr("mor.report.output_folder.shutil.rmtree", clearing)
        interrupt(rows)

    choice = Choice(html=False, done=interrupt_clearing)
    with pytest.raises(KeyboardInterrupt):
        _write(solved, read_document(project), project.parent, tmp_path / "out", choice)
    assert not list(tmp_path.iterdir())


def test_of_very_many_observations_the_long_table_is_written_by_itself(
    solved: Solved, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, choice = read_document(project), Choice(html=False)
    _write(solved, document, project.parent, tmp_path / "one", choice)
    remembered = point_table(solved)
    assert point_table(solved) is remembered
    monkeypatch.setattr(write_module, "MOST_LISTED", 1)
    _write(solved, document, project.parent, tmp_path / "two", choice)
    assert point_table(solved) is not remembered
    assert point_table(solved).equals(remembered)
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("one", "two"))
    assert one == two


def test_order_of_writing_changes_no_byte(
    solved: Solved, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reports of a very large network come before the long table; those of others are made beside it."""
    document, choice, written = read_document(project), Choice(tables="all", html=False), []
    for most in (2_000_000, 0):
        monkeypatch.setattr("mor.report.results.MOST_LISTED", most)
        folder = tmp_path / "results"
        _write(solved, document, project.parent, folder, choice)
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert written[0] == written[1]
    assert {"results.json", "report.txt", "residuals.csv", "points.csv"} <= set(written[0])
