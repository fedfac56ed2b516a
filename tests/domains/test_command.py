"""``mor adjust --memory``: when domains are taken, what they refuse, what they leave behind."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from mor.cli._progress import Progress
from mor.domains import assessing, results, room, story
from mor.errors import InputError
from mor.report.domains import listed
from tests.domains_compared import differences
from tests.scenarios.domains_blocks import Ended, Kind, command, write_block

pytestmark = pytest.mark.slow


def adjust(project: Path, *options: str) -> Ended:
    return command("adjust", project, *options)


@pytest.fixture
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "rays_of_domain", lambda rays, memory, workers=1: 700)
    monkeypatch.setattr(room, "PROGRAM", 0.0)
    monkeypatch.setattr(room, "OF_OUTER", 0)


@pytest.mark.usefixtures("small_domains")
def test_results_in_parts_and_nothing_else_left(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(control=6))
    done = adjust(project, "--memory", "1MB", "--table-format", "parquet", "-o", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    told = json.loads((tmp_path / "out" / "domains.json").read_text(encoding="utf-8"))
    assert told["outcome"] == "converged"
    assert told["redundancy_sum"] == pytest.approx(told["redundancy"], abs=1e-6)
    assert len(told["domains"]) > 2
    rays = pl.read_parquet(tmp_path / "block" / "rays.parquet").height
    residuals = pl.read_parquet(tmp_path / "out" / "residuals" / "*.parquet")
    assert residuals.filter(pl.col("type") == "image").height == 2 * rays
    images = pl.read_parquet(tmp_path / "out" / "images" / "*.parquet")
    assert images["id"].is_unique().all()
    assert images["points"].sum() == rays
    assert sorted(path.name for path in tmp_path.iterdir()) == ["block", "out"]
    assert "sum of redundancy numbers" in (tmp_path / "out" / "report.txt").read_text(encoding="utf-8")


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("options", [(), ("--snoop",)])
def test_domains_are_counted_while_they_are_read_and_assessed(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted: dict[str, list[int]] = {}

    def counter(self: Progress, total: int) -> Callable[[int], None]:
        told = counted.setdefault(self.name, [])
        told.append(-total)
        return told.append

    monkeypatch.setattr(Progress, "counter", counter)
    project = write_block(tmp_path / "block", Kind(control=6))
    done = adjust(project, "--memory", "1MB", "--no-html", "-o", str(tmp_path / "out"), *options)
    assert done.exit_code == 0, done.stderr
    count = len(json.loads((tmp_path / "out" / "domains.json").read_text(encoding="utf-8"))["domains"])
    for phase in ("reading", "precision and reliability"):
        assert [-counted[phase][-count - 1], *counted[phase][-count:]] == [count, *[1] * count]


def test_what_fits_is_adjusted_as_ever(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    assert adjust(project, "--memory", "4GB", "-o", str(tmp_path / "out")).exit_code == 0
    assert (tmp_path / "out" / "results.json").is_file()


@pytest.mark.usefixtures("small_domains")
def test_german(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    adjust(project, "--memory", "1MB", "--lang", "de", "-o", str(tmp_path / "out"))
    text = (tmp_path / "out" / "report.txt").read_text(encoding="utf-8")
    assert "Teilgebiet" in text
    assert "domain" not in text


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (
            "datum: fixed",
            "datum: fixed\nsettings: {robust: danish, snooping: true}",
            "a robust solution and data snooping",
        ),
        ("K: {r0: 0,", "K: {readout: 20 ms, r0: 0,", "a rolling shutter"),
    ],
)
def test_what_domains_do_not_do_is_said_before_the_work(
    tmp_path: Path, before: str, after: str, words: str
) -> None:
    project = write_block(tmp_path / "block", Kind())
    project.write_text(project.read_text(encoding="utf-8").replace(before, after), encoding="utf-8")
    done = adjust(project, "--memory", "1MB", "-o", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert words in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("small_domains")
def test_images_that_share_a_block_are_not_divided(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    text = project.read_text(encoding="utf-8")
    shared = text.replace("images.parquet}", "images.parquet, values: {shared_eccentricity: head}}")
    project.write_text(shared, encoding="utf-8")
    done = adjust(project, "--memory", "1MB", "-o", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert "images that share something" in done.stderr


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("inline", [10_000, 100])
def test_json_is_printed_and_no_folder_written(
    inline: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (assessing, results, story):
        monkeypatch.setattr(module, "INLINE", inline)
    project = write_block(tmp_path / "block", Kind(control=6, sights=20))
    done = adjust(project, "--json", "--quiet")
    assert done.exit_code == 0, done.stderr
    one = json.loads(capsys.readouterr().out)
    done = adjust(project, "--memory", "1MB", "--json", "--quiet", "--scratch", str(tmp_path))
    assert (done.exit_code, done.stderr) == (0, "")
    several = json.loads(capsys.readouterr().out)
    assert [path.name for path in tmp_path.iterdir()] == ["block"]
    assert list(several) == list(one)
    for key in ("tables", "images", "groups"):
        assert differences(one[key], several[key]) == []
    by_name = sorted(one["points"], key=lambda row: row["id"])
    assert differences(by_name, sorted(several["points"], key=lambda row: row["id"])) == []
    assert inline < 10_000 or differences(one["points"], several["points"]) == []
    assert inline == 10_000 or several["residuals"] is None


@pytest.mark.usefixtures("small_domains")
def test_json_beside_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = write_block(tmp_path / "block", Kind())
    done = adjust(project, "--memory", "1MB", "--json", "-o", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    printed = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert {**written, "tables": {}, "files": []} == printed
    assert str(tmp_path / "out") in done.stderr


@pytest.mark.usefixtures("small_domains")
def test_json_of_no_solution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = write_block(tmp_path / "block", Kind(gnss=False))
    assert adjust(project, "--memory", "1MB", "--json").exit_code == 4
    assert json.loads(capsys.readouterr().out)["outcome"] == "singular"


@pytest.mark.usefixtures("small_domains")
def test_a_full_report_lists_what_that_of_one_machine_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listed, "_ROWS_TOGETHER", 3_000)
    project = write_block(tmp_path / "block", Kind(control=6, sights=20))
    adjust(project, "--full", "-o", str(tmp_path / "one"))
    options = ("--full", "--tables", "worst", "--no-html")
    adjust(project, "--memory", "1MB", *options, "-o", str(tmp_path / "several"))
    one, several = (
        (tmp_path / name / "report.txt").read_text(encoding="utf-8") for name in ("one", "several")
    )
    assert not (tmp_path / "several" / "residuals.csv").exists()
    for title in ("Images", "Points (datum: fixed)", "Error ellipses", "All observations"):
        rows = [_rows(text, title) for text in (one, several)]
        assert len(rows[1]) > 15
        assert rows[1] <= rows[0] if title == "Error ellipses" else rows[1] == rows[0], title


def _rows(report: str, title: str) -> set[tuple[str, ...]]:
    """Words of each line of the tables of a section that begins with a point, an image or a type of observations."""
    section = report.partition(f"\n{title}\n")[2]
    end = re.search(r"\n\n[^\n]+\n-+\n", section)
    lines = section[: end.start()].splitlines() if end else section.splitlines()
    return {
        tuple(line.split()) for line in lines if re.match(r"[IP]\d|(image|distance|height_difference) ", line)
    }


def test_too_little_memory_to_divide(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    done = adjust(project, "--memory", "1MB")
    assert done.exit_code == 5
    assert "are allowed (--memory)" in done.stderr


@pytest.mark.usefixtures("small_domains")
def test_bad_start_values_are_damped_as_on_one_machine(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    points = pl.read_parquet(tmp_path / "block" / "points.parquet")
    points.with_columns(pl.col("z") + 500.0 * (pl.int_range(pl.len()) % 2)).write_parquet(
        tmp_path / "block" / "points.parquet"
    )
    adjust(project, "-o", str(tmp_path / "one"))
    adjust(project, "--memory", "1MB", "-o", str(tmp_path / "several"))
    one = json.loads((tmp_path / "one" / "results.json").read_text(encoding="utf-8"))
    several = json.loads((tmp_path / "several" / "domains.json").read_text(encoding="utf-8"))
    assert several["outcome"] == "converged"
    assert several["sigma0"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-9)


@pytest.mark.parametrize(
    ("text", "size"), [("4GB", 4e9), ("800 mb", 8e8), ("1.5GiB", 1.5 * 2**30), ("12", 12.0)]
)
def test_amounts(text: str, size: float) -> None:
    assert room.size_of(text) == size


@pytest.mark.parametrize("text", ["", "GB", "4 parsec", "-1GB", "nan", "1e400"])
def test_no_amounts(text: str) -> None:
    with pytest.raises(ValueError, match="expected an amount of memory"):
        room.size_of(text)


def test_room_in_the_scratch_folder(tmp_path: Path) -> None:
    worst, all_ = room.results_of_ray("parquet", False), room.results_of_ray("parquet", True)
    goes = room.need_of_scratch(1000, all_, stays=False, again=False)
    assert room.need_of_scratch(1000, worst, False, False) < goes
    assert goes < room.need_of_scratch(1000, room.results_of_ray("csv", True), False, False)
    assert goes < room.need_of_scratch(1000, all_, True, False) < room.need_of_scratch(1000, all_, True, True)
    room.check_scratch(goes, tmp_path)
    with pytest.raises(InputError, match="the state of the domains takes about"):
        room.check_scratch(1e18, tmp_path)
