"""Tables divided into domains: rays go where their point goes, points where they have rays from."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.pipeline import read_document
from mor.project.domains import division_of_points, tables
from mor.project.domains.parts import Parts, divide
from mor.project.file.validation import validate
from tests.scenarios.domains_blocks import Kind, write_block


def divided(project: Path, folder: Path) -> Parts:
    document = read_document(project)
    return divide(validate(document), document, project.parent, folder, 1500)


def rows(found: Parts, section: str) -> pl.DataFrame:
    """All rows of a table with the domain they are in."""
    return pl.concat(
        pl.read_parquet(file).with_columns(domain=pl.lit(d))
        for d in range(found.count)
        for file in found.files((section, 0), d)
    )


@pytest.mark.parametrize("at_a_time", [100, 2_000_000])
def test_domains_that_points_have_rays_from(at_a_time: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(division_of_points, "ROWS_AT_A_TIME", at_a_time)
    random = np.random.default_rng(1)
    domain = random.integers(0, 9, 50)
    image, point = random.integers(0, 50, 3000), random.integers(0, 700, 3000)
    rays = pl.DataFrame({"image": [f"I{k}" for k in image], "point": [f"P{k}" for k in point]})
    of_images = pl.DataFrame(
        {"id": [f"I{k}" for k in range(50)], "domain": pl.Series(domain, dtype=pl.Int32)}
    )
    found = division_of_points.rays_of_points(
        lambda section, number: rays.iter_slices(60 + 10 * number), divided=[0, 1], of_images=of_images
    )
    votes: dict[str, Counter[int]] = {}
    for d, name in zip(domain[image].tolist(), rays["point"].to_list(), strict=True):
        votes.setdefault(name, Counter())[d] += 2  # both tables have all rays
    expected = [(max(some), min(some, key=lambda d: (-some[d], d)), some.total()) for some in votes.values()]
    hashes = division_of_points.hashed(pl.Series(list(votes))).to_list()
    assert found["hash"].is_sorted()
    there = {hash_: tuple(others) for hash_, *others in found.iter_rows()}
    assert there == dict(zip(hashes, expected, strict=True))


def test_points_go_to_the_last_domain_where_none_is_too_large_then() -> None:
    tried = []

    def cut(count: int) -> division_of_points.Cut:
        tried.append(count)
        points = pl.DataFrame(
            {"hash": [1, 2], "last": [count - 1] * 2, "most": [0, count - 1], "rays": [50, 40]}
        )
        return division_of_points.Cut(np.array([count]), 0, points.with_columns(pl.col("rays") - 2 * count))

    for most, rule, count in ((90, "last", 4), (70, "last", 5), (60, "most", 4)):
        tried.clear()
        domain, _, of_points = division_of_points.divide_points(cut, 4, most)
        assert domain[0] == count
        assert of_points.domains.tolist() == ([count - 1] * 2 if rule == "last" else [0, count - 1])
        assert len(tried) == (1 if most == 90 else 2)


@pytest.mark.slow
def test_rays_are_where_their_point_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "ROWS_AT_A_TIME", 100)
    project = write_block(tmp_path / "project", Kind(strips=4, images=8, points=900))
    found = divided(project, tmp_path / "parts")
    assert found.count > 3
    rays = rows(found, "observations")
    given = pl.read_parquet(project.parent / "rays.parquet")
    assert rays.drop("domain").sort(pl.all()).equals(given.sort(pl.all()))
    of_point = dict(rows(found, "points").select("id", "domain").iter_rows())
    assert dict(rays.select("point", "domain").iter_rows()) == of_point


def test_names_with_the_same_hash_are_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = division_of_points.hashed
    monkeypatch.setattr(division_of_points, "hashed", lambda names: plain(names) % 97)
    project = write_block(tmp_path / "project", Kind(strips=4, images=8, points=900))
    found = divided(project, tmp_path / "parts")
    of_point = dict(rows(found, "points").select("id", "domain").iter_rows())
    assert found.count > 1
    assert dict(rows(found, "observations").select("point", "domain").iter_rows()) == of_point
