"""Data snooping over domains: what one machine takes out and puts back, round by round, and the same results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from tests.domains_compared import ELSEWHERE, differences, have_small_domains, results
from tests.scenarios.domains_blocks import Kind, command, write_block

pytestmark = pytest.mark.slow

Spoil = Callable[[Path, np.random.Generator], None]


@pytest.fixture(autouse=True)
def _small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    have_small_domains(monkeypatch)


def _wrong_rays(folder: Path, random: np.random.Generator, part: float = 0.02, image: str = "") -> None:
    rays = pl.read_parquet(folder / "rays.parquet")
    wrong = (random.random(rays.height) < part) | (
        (rays["image"] == image).to_numpy() & (random.random(rays.height) < 0.8)
    )
    size = wrong * random.choice([-1.0, 1.0], rays.height) * random.uniform(0.03, 0.3, rays.height)
    rays.with_columns(x=pl.col("x") + size, y=pl.col("y") + 0.5 * size).write_parquet(folder / "rays.parquet")


def _wrong_sights(folder: Path, random: np.random.Generator) -> None:
    _wrong_rays(folder, random)
    table = pl.read_parquet(folder / "distances.parquet")
    wrong = pl.int_range(pl.len()) % 11 == 3
    table.with_columns(pl.col("distance") + pl.when(wrong).then(0.2).otherwise(0.0)).write_parquet(
        folder / "distances.parquet"
    )


def _wrong_image(folder: Path, random: np.random.Generator) -> None:
    _wrong_rays(folder, random, 0.01, "I7")


def _wrong_point_of_two_rays(folder: Path, random: np.random.Generator) -> None:
    """All but two rays of a point are gone, and these contradict each other: one component of the four can go."""
    rays = pl.read_parquet(folder / "rays.parquet")
    point = rays["point"][0]
    two = rays.filter(pl.col("point") == point)[[0, -1]]
    wrong = two.with_columns(x=pl.col("x") + pl.Series([0.0, 0.2]), y=pl.col("y") + pl.Series([0.0, 0.2]))
    pl.concat([rays.filter(pl.col("point") != point), wrong]).write_parquet(folder / "rays.parquet")


CASES: dict[str, tuple[Kind, Spoil]] = {
    "rays": (Kind(control=6), _wrong_rays),
    "rays and sights": (Kind(control=6, sights=30), _wrong_sights),
    "an image": (Kind(control=6), _wrong_image),
    "a point of two rays": (Kind(), _wrong_point_of_two_rays),
    "free": (Kind(convergent=True, points=150, gnss=False, datum="free"), _wrong_rays),
}


def _adjusted(tmp_path: Path, kind: Kind, spoil: Spoil) -> tuple[dict[str, Any], dict[str, Any]]:
    project = write_block(tmp_path / "block", kind)
    spoil(project.parent, np.random.default_rng(3))
    for folder, options in (("one", ()), ("several", ("--memory", "400MB"))):
        done = command("adjust", project, "--snoop", "--no-html", "-o", tmp_path / folder, *options)
        assert done.exit_code == 0, done.stderr
    return results(tmp_path / "one"), results(tmp_path / "several")


def _in_order(steps: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Steps of each round; domains put back one after the other."""
    return sorted(
        steps, key=lambda step: [step[key] for key in ("round", "action", "type", "from", "to", "component")]
    )


@pytest.mark.parametrize("name", CASES)
def test_the_same_rows_go_in_the_same_rounds(name: str, tmp_path: Path) -> None:
    one, several = _adjusted(tmp_path, *CASES[name])
    here, there = (each["gross_errors"]["snooping"] for each in (one, several))
    assert here["steps"]
    assert len(here["steps"]) == len(there["steps"])
    for a, b in zip(*(_in_order(each["steps"]) for each in (here, there)), strict=True):
        assert {**a, "w": 0.0} == {**b, "w": 0.0}
        assert a["w"] == pytest.approx(b["w"], rel=1e-7)
    assert (here["clean"], here["mostly_out"]) == (there["clean"], there["mostly_out"])
    assert here["sigma0_before"] == pytest.approx(there["sigma0_before"], rel=1e-10)
    assert bool(here["mostly_out"]) == (name == "an image")
    for key in ("observations", "unknowns", "redundancy", "flagged", "outcome"):
        assert one[key] == several[key]
    assert several["redundancy_sum"] == pytest.approx(several["redundancy"], abs=1e-6)
    assert several["sigma0"]["aposteriori"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-10)
    found = differences(*({k: v for k, v in each.items() if k not in ELSEWHERE} for each in (one, several)))
    # compared above; looked for within a domain; not decided by sums
    elsewhere = ("/snooping/steps", "/cure", "/verdict/groups/")
    assert [line for line in found if not any(words in line for words in elsewhere)] == []
    tables = [
        pl.read_csv(tmp_path / folder / "residuals.csv").sort("type", "group", "from", "to", "component")
        for folder in ("one", "several")
    ]
    assert tables[0]["flag"].equals(tables[1]["flag"])
    assert (tables[0]["flag"] == "excluded").sum() == sum(group["excluded"] for group in one["groups"])


def test_the_report_and_the_adjusted_project_say_it(tmp_path: Path) -> None:
    _, several = _adjusted(tmp_path, *CASES["rays"])
    text = (tmp_path / "several" / "report.txt").read_text(encoding="utf-8")
    done = [step["action"] for step in several["gross_errors"]["snooping"]["steps"]]
    counts = done.count("excluded"), done.count("put back")
    assert "Data snooping: {} excluded, {} put back".format(*counts) in text
    assert "snooping: true" in (tmp_path / "several" / "adjusted.yaml").read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["block", "one", "several"]
    again = command("adjust", tmp_path / "several" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.exit_code == 0, again.stderr
    assert results(tmp_path / "again")["observations"] == several["observations"]
