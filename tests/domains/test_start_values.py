"""Points without start values are intersected domain by domain; the results are those of one machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl
import pytest

from tests.domains_compared import ELSEWHERE, differences, have_small_domains, results
from tests.scenarios.domains_blocks import Ended, Kind, command, write_block

pytestmark = pytest.mark.slow


def of_both(notes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The notes that do not depend on how a network is adjusted; domains do not look at the curvature."""
    return [note for note in notes if not note["message"].startswith(("domains:", "curvature of the earth:"))]


@pytest.fixture
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    have_small_domains(monkeypatch)


BLOCKS = {
    "images alone": Kind(strips=4, images=8, points=900),
    "control and sights": Kind(control=6, sights=30),
    "free, referring to what was intersected": Kind(convergent=True, points=150, gnss=False, datum="free"),
}


def both(project: Path, *more: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results of one machine and of domains."""
    above = project.parent.parent
    for folder, options in (("one", ()), ("several", ("--memory", "400MB"))):
        done: Ended = command("adjust", project, "-o", above / folder, "--no-html", *more, *options)
        assert done.exit_code == 0, done.stderr
    return results(above / "one"), results(above / "several")


def same(one: dict[str, Any], several: dict[str, Any]) -> list[str]:
    """Differences, but for tests of groups that sums do not decide and what other start values change."""
    left = (*ELSEWHERE, "iterations", "verdict")
    return differences(*({k: v for k, v in each.items() if k not in left} for each in (one, several)))


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("name", BLOCKS)
def test_points_without_coordinates(name: str, tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", BLOCKS[name])
    table = tmp_path / "block" / "points.parquet"
    pl.read_parquet(table).select("id").write_parquet(table)
    one, several = both(project)
    assert same(one, several) == []
    assert of_both(one["notes"]) == of_both(several["notes"])


@pytest.mark.usefixtures("small_domains")
def test_heights_alone_are_known(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(sights=10))
    table = tmp_path / "block" / "points.parquet"
    heights = pl.read_parquet(table).with_columns(
        x=pl.lit(None, pl.Float64), y=pl.lit(None, pl.Float64), sigma_z=pl.lit(0.5)
    )
    heights.write_parquet(table)
    one, several = both(project)
    assert same(one, several) == []
    assert one["unknowns"] == several["unknowns"] > 3 * len(heights)


@pytest.mark.usefixtures("small_domains")
def test_what_cannot_be_intersected_is_named(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(sights=10))
    folder = project.parent
    pl.read_parquet(folder / "points.parquet").select("id").write_parquet(folder / "points.parquet")
    rays = pl.read_parquet(folder / "rays.parquet")
    lost = rays["point"].unique(maintain_order=True)[:3].to_list()
    once = rays.filter(pl.col("point").is_in(lost)).unique("point", maintain_order=True)
    pl.concat([rays.filter(~pl.col("point").is_in(lost)), once]).write_parquet(folder / "rays.parquet")
    one = command("adjust", project, "-o", tmp_path / "one")
    several = command("adjust", project, "-o", tmp_path / "several", "--memory", "400MB")
    assert (one.exit_code, several.exit_code) == (2, 2)
    told = [
        {line for line in done.stderr.splitlines() if "seen from too few known places" in line}
        for done in (one, several)
    ]
    assert len(told[0]) == 3
    assert told[0] == told[1]
    assert "domains leave nothing out" in several.stderr
    assert not (tmp_path / "several").exists()


@pytest.mark.usefixtures("small_domains")
def test_what_is_not_divided_needs_start_values(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(sights=10))
    text = project.read_text(encoding="utf-8")
    point = "points:\n  - {columns: [id], rows: [[Q]]}\n"
    sight = (
        "  - {type: distance, columns: [from, to, distance], rows: [[Q, P1, 100]], values: {sigma: '0.01'}}\n"
    )
    text = text.replace("points:\n", point).replace("observations:\n", f"observations:\n{sight}")
    project.write_text(text, encoding="utf-8")
    done = command("adjust", project, "-o", tmp_path / "several", "--memory", "400MB")
    assert done.exit_code == 2
    assert "no start value: Q; domains need those of all but points that images in tables see" in done.stderr


FREE = "settings: {undeclared_points: free}\ndatum:"


def undeclared(project: Path, kept: int) -> list[str]:
    """Leave the first points in the table of a block, and let those that are not there be free; their names."""
    table = project.parent / "points.parquet"
    points = pl.read_parquet(table)
    points[:kept].write_parquet(table)
    text = project.read_text(encoding="utf-8")
    if kept == 0:
        text = text.replace("  - {file: points.parquet}\n", "").replace("points:\nobs", "points: []\nobs")
    project.write_text(text.replace("datum:", FREE), encoding="utf-8")
    return points["id"][kept:].to_list()


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("kept", [0, 40])
def test_points_that_no_table_declares(name: str, kept: int, tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", BLOCKS[name])
    new = undeclared(project, kept)
    one, several = both(project)
    assert same(one, several) == []
    assert [row["id"] for row in one["points"]] == [row["id"] for row in several["points"]]
    assert of_both(one["notes"]) == of_both(several["notes"])
    assert f"{len(new)} points that only observations name" in one["notes"][0]["message"]
    again = command("adjust", tmp_path / "several" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.exit_code == 0, again.stderr
    found = results(tmp_path / "again")
    assert found["iterations"] <= 2
    assert found["sigma0"]["aposteriori"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-9)


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("kept", [3, 500])
@pytest.mark.parametrize("table", ["parquet", "csv"])
def test_names_that_may_be_slips(kept: int, table: str, tmp_path: Path) -> None:
    """Few declared points beside many others, and many beside few."""
    project = write_block(tmp_path / "block", Kind(strips=2, sights=10, table="csv"))
    undeclared_in_csv(project, kept)
    rays = pl.read_csv(project.parent / "rays.csv")
    first = pl.read_csv(project.parent / "points.csv")["id"][0]
    of_first = (rays["point"] == first).arg_true()
    renamed = rays["point"].scatter(of_first[:2], f"{first}x")  # two rays of the first point
    rays.with_columns(point=renamed).write_csv(project.parent / "rays.csv")
    if table == "parquet":
        as_parquet(project)
    one, several = both(project)
    assert any(f"'{first}x' is in no table of points" in note["message"] for note in one["notes"])
    assert of_both(one["notes"]) == of_both(several["notes"])

    once = renamed.scatter(of_first[1:2], first)
    if table == "parquet":
        rays.with_columns(point=once).write_parquet(project.parent / "rays.parquet")
    else:
        rays.with_columns(point=once).write_csv(project.parent / "rays.csv")
    told = []
    for options in ((), ("--memory", "400MB")):
        done = command("adjust", project, "-o", tmp_path / "none", *options)
        assert done.exit_code == 2
        told.append([line for line in done.stderr.splitlines() if "is named by this row only" in line])
    assert len(told[0]) == 1
    assert told[0] == told[1]


def undeclared_in_csv(project: Path, kept: int) -> None:
    points = pl.read_csv(project.parent / "points.csv")
    points[:kept].write_csv(project.parent / "points.csv")
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace("datum:", FREE), encoding="utf-8")


def as_parquet(project: Path) -> None:
    """Let the rays of a block be in a Parquet file."""
    pl.read_csv(project.parent / "rays.csv").write_parquet(project.parent / "rays.parquet")
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace("rays.csv", "rays.parquet"), encoding="utf-8")
